"""Wrong input gets the answers in `messages.py` and `rules.py`, and every rule has a row there."""

import ast
import functools
import re
import warnings
from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rules
from messages import LINKS, NODES, ODD, REFUSED, SUSPICIOUS, Phase, analyse, cables, net, run
from oracles.traced import traced
from rooms import PACKAGE
from rules import OTHERWISE, RULES, stressed

import jaxcable as jc
from jaxcable import forms
from jaxcable.common import status


def ids(table):
    return [text.replace("\\", "").lstrip("^")[:50] for text in table]


@pytest.mark.slow_cases(
    ".*the solution is being traced",
    "breaks: must increase",
    "fit: a batch of shape (2,)",
    "masses: expected a scalar or shape (4,), got (7,);",
)
@pytest.mark.parametrize(("call", "message"), REFUSED, ids=ids(text for _, text in REFUSED))
def test_what_is_wrong(call, message):
    with pytest.raises(ValueError, match=message):
        run(call)


@pytest.mark.parametrize(("call", "message"), SUSPICIOUS, ids=ids(text for _, text in SUSPICIOUS))
def test_what_is_suspicious(call, message):
    with pytest.warns(jc.InputWarning) as seen:
        run(call)
    assert len(seen) == 1
    assert re.search(message, str(seen[0].message)), seen[0].message


@pytest.mark.parametrize(("call", "name"), ODD, ids=ids(text for _, text in ODD))
def test_what_is_odd_and_legitimate_is_silent(call, name):
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always", jc.InputWarning)
        run(call)
    assert [str(one.message) for one in seen] == []


def test_results_are_computed_all_the_same():
    """Warnings name the line where the person can change it, and are silenced by their category."""
    structure = net(NODES[:3], cables(LINKS[:2], axial_stiffness=98.0), (0, 2))
    with pytest.warns(jc.InputWarning, match="a strain of 204 %") as seen:
        solution = jc.solve(structure, [Phase(pretension=200.0)])
    assert seen[0].filename == __file__ and issubclass(jc.InputWarning, UserWarning)
    assert jc.describe(solution.status) == "converged"
    assert solution.tension == pytest.approx(200.0, rel=1e-12)  # straight: nothing moves


def test_float32_by_accident():
    """Once where double precision is given, for analyses and forms; float32 is taken as it is."""
    text = r"nodes: float64, but jax works in float32 .*jax_enable_x64\", True\) .*astype\(numpy."
    with jax.enable_x64(False):
        for call in (
            lambda structure: analyse(Phase(pretension=10.0), structure=structure),
            lambda structure: jax.eval_shape(lambda q: forms.force_density(structure, q), 1.0),
        ):
            with pytest.warns(jc.InputWarning, match=text) as seen:
                call(net(NODES.tolist()))
            assert len(seen) == 1
            call(net(NODES.astype(np.float32)))


# --- traced numbers


def test_traced_numbers_are_not_looked_at():
    """A batch may hold anything: it ends in statuses, case by case."""

    def judged(number):
        group = cables(axial_stiffness=number, rest_length=number, area=None, strength=number)
        structure = net(number * NODES, group)
        pull = jc.NodalLoads([2], number * jnp.ones(3))
        analyse(Phase(pretension=1e6 * number, loads=pull), structure=structure)
        analyse(Phase(loads=pull), structure=structure)
        return number

    assert jax.eval_shape(judged, 1e-6).shape == ()
    with pytest.warns(jc.InputWarning):  # control
        judged(jnp.asarray(1e-6))


@pytest.mark.slow
def test_nan_in_the_points_of_a_law_is_no_error_but_gives_nan():
    """A batch survives it; an analysis turns it into a status."""
    law = jc.Polygonal([0, 1e-3, 2e-3], [0, np.nan, 2e8])
    assert np.isnan(law.stress_at(5e-4))


def fails(outcome):
    """Whether an outcome says that it is none: a status, or NaN in numbers."""
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(outcome)]
    codes = [leaf for leaf in leaves if leaf.dtype == np.int32]
    if codes:
        assert set(np.unique(codes)) <= {status.OK, status.INVALID_INPUT}
        return codes[0] == status.INVALID_INPUT
    return any(np.isnan(leaf).any() for leaf in leaves if leaf.dtype == float)


@pytest.mark.slow_cases(
    ".*pretension[1] = 1000001.0: more than the law ana",
    "direction: is zero; give the direction of the unit",
    "first, second: the ends lie above each other forms",
    "gravity.* = -1.0 dynamics/modes.py:gravity",
    "places[0] = 1.5 results/internal_forces.py:places",
    "q[0] = -1.0 forms/input_checks.py:values_by_group",
    "tension = -1.0: with this tension in group forms/f",
)
@pytest.mark.filterwarnings("ignore::jaxcable.InputWarning")  # numbers are odd, not physical
@pytest.mark.parametrize(
    ("message", "function", "good", "bad"),
    [row[2:] for row in RULES],
    ids=ids(f"{message} {file}:{argument}" for file, argument, message, *_ in RULES),
)
def test_a_number_that_is_refused_when_known_fails_when_traced(message, function, good, bad):
    stressed()  # solved where nothing is traced
    good, bad = (np.asarray(v, float) for v in (good, bad))
    jax.eval_shape(lambda: function(good))  # known, and not refused
    with pytest.raises(ValueError, match=message):
        function(bad)
    within = traced(function)
    assert not fails(within(good))
    assert fails(within(bad))


def calls(node, function=None):
    """Calls in a piece of source by name, each with the function that it stands in."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Call) and function is not None:
            yield getattr(child.func, "attr", getattr(child.func, "id", None)), child, function
        yield from calls(child, child if isinstance(child, ast.FunctionDef) else function)


def arguments(call, function):
    """What a call that makes a rule is about: constants, those of a loop, or its function."""
    first = call.args[0]
    if isinstance(first, ast.Constant):
        return [first.value]
    loops = {}
    for node in ast.walk(function):
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple):
            loops[ast.unparse(node.targets[0])] = node.value
    for node in ast.walk(function):
        if isinstance(node, ast.For | ast.ListComp) and call in ast.walk(node):
            loop = node if isinstance(node, ast.For) else node.generators[0]
            over = loops.get(ast.unparse(loop.iter), loop.iter)
            if isinstance(over, ast.Tuple) and isinstance(over.elts[0], ast.Constant):
                return [item.value for item in over.elts]
    return [function.name]


def test_every_rule_has_a_row():
    made, looks = Counter(), set()
    for path in PACKAGE.rglob("*.py"):
        module = str(path.relative_to(PACKAGE))
        if module in ("common/rules.py", "common/checks.py", "catalogue/conductors.py"):
            continue
        if module.startswith(("lines/", "masts/")):  # `test_line_rules.py`, `test_mast_rules.py`
            continue
        for name, call, function in calls(ast.parse(path.read_text())):
            if name in ("Rule", "positive", "not_negative"):
                made.update(f"{module}:{argument}" for argument in arguments(call, function))
            if name == "array_if_known":
                looks.add(f"{module}:{function.name}")
    rows = Counter(f"{file}:{argument}" for file, argument, *_ in RULES)
    assert not made - rows, "rules without a row in RULES"
    assert not set(rows) - set(made), "rows of no rule"
    assert looks == set(OTHERWISE)


# --- what a verdict does


@traced
@functools.partial(jax.value_and_grad, has_aux=True)
def moved(load, cases):
    """How far the middle of two cables goes in some cases, those that fail left out."""

    def one(stiffness, area, jack, tol):
        law = jc.Polygonal([0.0, 0.1], [0.0, 0.1 * stiffness])
        down = jc.NodalLoads([1], load * np.array([0.0, 0.0, -1.0]))
        phase = jc.Phase(jacking=jc.only([0], jack), loads=down)
        return jc.solve(rules.net(area=area, law=law), phase, jc.Newton(tol=tol))

    solved = jax.vmap(one)(*cases)
    return jnp.sum(jnp.where(solved.status == 0, solved.last.displacement[:, 1, 2], 0.0)), solved


GOOD, COUNT = (1e3, 1.0, 10.0, 1e-10), 5
CASES = [GOOD, (-1e3, 1.0, 10.0, 1e-10), (1e3, -1.0, 10.0, 1e-10), (1e3, 1.0, -10.0, 1e-10)]
CASES.append((1e3, 1.0, 10.0, 1e3))


@pytest.mark.slow
def test_a_case_with_a_bad_number_fails_alone():
    """In a batch: nothing of it is a number, and what the others share keeps its gradient."""
    (total, solved), gradient = moved(1.0, jnp.array(CASES).T)
    assert solved.status.tolist() == [0] + 4 * [status.INVALID_INPUT]
    assert np.isfinite(solved.tension[0]).all() and np.isnan(solved.tension[1:]).all()
    assert (solved.phases[0].path.status == solved.status[:, None]).all()
    (each, alone), slope = moved(1.0, jnp.array(COUNT * [GOOD]).T)
    assert (alone.status == 0).all() and slope != 0
    np.testing.assert_allclose(total, each / COUNT, rtol=1e-12)  # one program, the same numbers
    np.testing.assert_allclose(gradient, slope / COUNT, rtol=1e-12)
    # where only phase 1 could be judged the last state is that of the structure, else there is none
    last = np.isfinite(solved.last.displacement).all(axis=(1, 2))
    assert last.tolist() == [True, False, False, True, True]


@pytest.mark.slow
@pytest.mark.parametrize(
    "analyse",
    [
        lambda structure, phase: jc.solve(structure, phase, jc.Incremental(tol=np.inf)),
        jc.trace_path,
        lambda structure, phase: jc.find_form(structure, 10.0, rules.PULL),
        lambda structure, phase: forms.dynamic_relaxation(structure, 10.0, loads=rules.PULL),
    ],
    ids=["incremental", "trace_path", "find_form", "relaxation"],
)
def test_other_analyses_fail_likewise(analyse):
    def one(stiffness):
        structure = rules.net(axial_stiffness=stiffness)
        return analyse(structure, jc.Phase(pretension=10.0, loads=rules.PULL)).status

    codes = traced(jax.vmap(one))(jnp.array([1e3, -1e3]))
    assert codes.tolist() == [0, status.INVALID_INPUT]
