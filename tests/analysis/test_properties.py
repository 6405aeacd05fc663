"""What holds of every analysis, whatever its numbers: other units, turned axes, another order.

A mast of beams, held by cables, a bar and a catenary, is analysed twice, with numbers drawn by
hypothesis; the second analysis is of the same structure, stated otherwise.
"""

from typing import NamedTuple

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st
from oracles.convergence import converged
from scipy.spatial.transform import Rotation

import jaxcable as jc

EXACT = jc.Newton(tol=1e-12)
# residuals of 1e-12 of the forces, over stiffnesses that differ by 1e3
CLOSE = 1e-8
NODES = np.array([[0, 0, 0], [0, 0, 3], [0, 0, 6], [5, 0, 0.3], [-2, 4, 0], [-2, -4, 0], [4, 3, 0]])
LINKS = {
    "mast": [[0, 1], [1, 2]],
    "guys": [[2, 3], [2, 4], [5, 2]],
    "strut": [[6, 1]],
    "chain": [[4, 1]],
}
LENGTH = np.linalg.norm(NODES[1] - NODES[4])


class Statement(NamedTuple):
    """How the structure is stated.

    Attributes:
        length, force: units of lengths and forces in those of the statement.
        turn: rotation of the axes, [3, 3].
        order: new number of every node, [7].
    """

    length: float = 1.0
    force: float = 1.0
    turn: np.ndarray = np.eye(3)
    order: np.ndarray = np.arange(7)


def draw(seed):
    """Numbers of a scene: places, stiffnesses, prestress, loads."""
    rng = np.random.default_rng(seed)
    return {
        "nodes": NODES + rng.uniform(-0.2, 0.2, NODES.shape),
        "EA": 10 ** rng.uniform(5.5, 6.5, 3),
        "EI": 10 ** rng.uniform(5.0, 6.0, 3),
        "pretension": rng.uniform(1e3, 5e3, 3),
        "slack": rng.uniform(1.01, 1.05),
        "push": rng.normal(size=(2, 3)) * 500,
        "wind": rng.normal(size=3) * 50,
    }


PLAIN = Statement()


def analyse(numbers, told=PLAIN, further=0.0):
    """Displacement [7, 3] by node of the first order, and element forces, in its units and axes.

    `further` [3] is added to the force on the top.
    """
    L, F, turn = told.length, told.force, told.turn
    nodes = np.empty_like(NODES, float)
    nodes[told.order] = L * numbers["nodes"] @ turn.T
    links = {name: told.order[np.array(pairs)] for name, pairs in LINKS.items()}
    EI = F * L**2 * numbers["EI"]
    section = jc.Section.linear(F * 1e8, EIy=EI[0], EIz=EI[1], GJ=EI[2])
    up = turn @ (1.0, 0.2, 0.0)
    chain = jc.Catenaries(
        links["chain"],
        axial_stiffness=F * 1e6,
        rest_length=[L * LENGTH * numbers["slack"]],
    )
    elements = {
        "mast": jc.Beams(links["mast"], section=section, up=up),
        "guys": jc.Cables(links["guys"], axial_stiffness=F * numbers["EA"]),
        "strut": jc.Bars(links["strut"], axial_stiffness=F * 1e6),
        "chain": chain,
    }
    held = jc.clamped(told.order[[0]]) + jc.pinned(told.order[3:])
    structure = jc.Structure(nodes, elements, held)
    push = numbers["push"] + np.array([np.zeros(3), further * np.ones(3)])
    loads = [
        jc.NodalLoads(told.order[[1, 2]], F * push @ turn.T),
        jc.LineLoads(F / L * (turn @ numbers["wind"])),
    ]
    pretension = {"guys": F * numbers["pretension"]}
    solution = converged(
        jc.solve(structure, [jc.Phase(pretension=pretension), jc.Phase(loads=loads)], EXACT)
    )
    displacement = np.asarray(solution.displacement)[told.order] @ turn / L
    tensions = [np.ravel(solution.tension[name]) / F for name in ("guys", "strut", "chain")]
    return displacement, np.concatenate(tensions)


def assert_same(found, expected):
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=CLOSE * np.abs(other).max())


def examples(count):
    """Decorator: so many examples, the same ones at every run."""
    return hypothesis.settings(
        max_examples=count,
        derandomize=True,
        deadline=None,  # the first one is traced
        database=None,
        phases=[hypothesis.Phase.generate],
    )


ODD = pytest.mark.filterwarnings("ignore::jaxcable.InputWarning")  # numbers in other units
seeds = st.integers(0, 2**31 - 1)


@ODD
@examples(5)
@hypothesis.given(seeds, st.floats(-3, 3), st.floats(-3, 3))
def test_units_do_not_matter(seed, length, force):
    numbers = draw(seed)
    assert_same(analyse(numbers, Statement(10**length, 10**force)), analyse(numbers))


@examples(5)
@hypothesis.given(seeds, st.integers(0, 2**31 - 1))
def test_axes_do_not_matter(seed, turned):
    numbers = draw(seed)
    turn = Rotation.random(random_state=turned).as_matrix()
    assert_same(analyse(numbers, Statement(turn=turn)), analyse(numbers))


@examples(5)
@hypothesis.given(seeds, st.permutations(range(7)))
def test_the_order_of_nodes_does_not_matter(seed, order):
    numbers = draw(seed)
    assert_same(analyse(numbers, Statement(order=np.array(order))), analyse(numbers))


@examples(2)
@hypothesis.given(seeds)
def test_small_loads_add_up(seed):
    """Changes by a small force and by twice of it: their difference falls with its square."""
    numbers = draw(seed)
    base = analyse(numbers)[0]

    def excess(force):
        once, twice = (analyse(numbers, further=k * force)[0] - base for k in (1, 2))
        return np.abs(twice - 2 * once).max() / np.abs(once).max()

    assert excess(2.0) / excess(1.0) == pytest.approx(2, abs=0.05)
    assert excess(2.0) < 0.01
