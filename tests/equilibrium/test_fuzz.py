"""Random scenes and random mistakes: a ValueError that names the argument, or an honest status."""

import dataclasses
import re

import hypothesis
import numpy as np
import pytest
from banks.fuzz_scenes import RANGES, Recipe, build, outcome
from banks.mistakes import MISTAKES
from hypothesis import strategies as st
from oracles.independent import verdict

import jaxcable as jc
from jaxcable.common import status

# each shape is a program to compile: these have the rest in them
SHAPES = [
    ("net", "float64"),
    ("net", "float32"),
    ("mixed", "float64"),
    ("softening", "float64"),
    ("memory", "float64"),
]


def settings(count):
    return hypothesis.settings(
        max_examples=count,
        derandomize=True,  # the same scenes at every run; `experiments/fuzz.py` has others
        deadline=None,  # the first of a shape is compiled
        database=None,
        suppress_health_check=list(hypothesis.HealthCheck),
    )


def recipes(shapes):
    numbers = {name: st.floats(low, high) for name, (low, high) in RANGES.items()}
    seed = st.integers(0, 2**31 - 1)
    return st.sampled_from(shapes).flatmap(
        lambda shape: st.builds(
            Recipe, family=st.just(shape[0]), dtype=st.just(shape[1]), seed=seed, **numbers
        )
    )


ODD = pytest.mark.filterwarnings("ignore::jaxcable.InputWarning")  # numbers over many decades


@pytest.mark.slow
@ODD
@pytest.mark.filterwarnings("ignore::jaxcable.UnstableWarning")  # bars that turn freely
@settings(100)
@hypothesis.given(recipes(SHAPES))
def test_scenes(recipe):
    name, defect = outcome(recipe)
    assert defect is None, f"{name}; {defect}; {recipe}"


@ODD
def test_a_stated_length_has_the_digits_of_its_precision():
    """Two ropes of 141 m whose stated lengths fix their strain to 5e-8 only: OK within these."""
    digits = {"stiffness": 11.645216171355358, "spread": 3.760098205890689}
    digits |= {"strain": -7.934142211464184, "load": -3.1028486391766794}
    digits |= {"size": 2.150031694890572, "offset": 3.4403278621099895}
    digits |= {"slack": 0.3143506049744197, "rough": -3.1361392841345492}
    name, defect = outcome(Recipe("hanging", "float32", 1228950515, **digits))
    assert (name, defect) == ("OK", None)


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes(name):
    make, pattern = MISTAKES[name]
    for seed in range(2):
        rng = np.random.default_rng(seed)
        if pattern is None:
            assert int(make(rng).status) != status.OK
            continue
        with pytest.raises(ValueError) as error:
            make(rng)
        assert re.search(pattern, str(error.value)), error.value


@pytest.mark.slow
def test_a_corrupted_solution_is_caught():
    """Control: of a scene that passes, a displacement moved by 1e-4 of itself does not."""
    recipe = Recipe("net", "float64", 7, 4.0, 0.5, -3.0, 0.0, 0.0, 0.0, 0.0, -1.0)
    assert outcome(recipe) == ("OK", None)
    structure, phases = build(recipe)
    solution = jc.solve(structure, phases)
    wrong = dataclasses.replace(solution, displacement=(1 + 1e-4) * solution.displacement)
    assert verdict(structure, phases, wrong).excess > 1
