"""`design.tune`: prestress in any phases that makes results of any phases what they shall be."""

import importlib
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.analysis import solver
from jaxcable.common import compilation, status
from jaxcable.common.progress import Printer, compiling, hearing
from jaxcable.design import Target, sensitivity, tune

TIGHT = jc.Newton(tol=1e-13)


def rods(count=2, stiffness=1e6):
    """Rods of 2 m side by side that carry a plate, each in a group."""
    bars = {f"rod {k}": jc.Bars([[0, 1]], axial_stiffness=stiffness) for k in range(count)}
    guide = jc.pinned([0]) + jc.restrained([1], "xy")
    return jc.Structure([[0.0, 0.0, 0.0], [0.0, 0.0, -2.0]], bars, supports=guide)


def mast():
    nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, 20.0], [-15.0, 0.0, 0.0], [15.0, 0.0, 0.0]]
    groups = {
        "mast": jc.Bars([[0, 1]], axial_stiffness=1e9),
        "stays": jc.Cables([[2, 1], [3, 1]], axial_stiffness=5e7),
    }
    supports = jc.pinned([0, 2, 3]) + jc.restrained([1], "y")
    return jc.Structure(nodes, groups, supports=supports)


STAGES = [
    jc.Phase(pretension={"mast": None, "stays": np.array([40e3, 40e3])}),
    jc.Phase(loads=jc.NodalLoads([1], (10e3, 0.0, 0.0))),
    jc.Phase(shortening={"mast": None, "stays": jc.only([0], 0.0)}),
]
UPRIGHT = Target("positions", 0.0, at=(1, 0), phase=1, within=1e-4)


def test_targets_of_several_stages_are_met_exactly():
    """Upright before and after, with a force that is asked for: three numbers for three."""
    structure = mast()
    lean = Target("positions", 0.005, at=(1, 0), phase=2, within=1e-4)
    force = Target("tension", 70e3, at=1, on="stays", phase=-1, within=10.0)
    unknowns = [(0, "pretension"), (2, "shortening")]
    found = tune(structure, STAGES, unknowns, [UPRIGHT, lean, force], method=TIGHT)
    assert int(found.status) == 0 and all(bool(met) for met in found.met)
    check = jc.solve(structure, found.phases, TIGHT)
    assert int(check.status) == 0
    assert abs(float(check.phases[1].positions[1, 0])) < 1e-9
    assert float(check.phases[2].positions[1, 0]) == pytest.approx(0.005, abs=1e-9)
    assert float(check.tension["stays"][1]) == pytest.approx(70e3, abs=1e-2)
    assert [part.shape for part in found.deviation] == [(1,), (1,), (1,)]
    # by statics: the sum of moments about the foot, upright
    stays = np.asarray(check.phases[1].tension["stays"])
    assert (stays[0] - stays[1]) * 0.6 == pytest.approx(10e3, rel=2e-4)  # the mast shortens
    assert found.influence.shape == (3, 3)


def test_the_influence_matrix_is_that_of_the_phases():
    structure = mast()
    found = tune(structure, STAGES[:2], [(0, "pretension")], [UPRIGHT], method=TIGHT)
    matrix = jc.influence(
        structure,
        found.phases,
        of=lambda solution: solution.phases[1].positions[1, 0],
        wrt="pretension",
        method=TIGHT,
    )
    expected = matrix["stays"] if isinstance(matrix, dict) else matrix
    np.testing.assert_allclose(found.influence[0], np.asarray(expected).ravel(), rtol=1e-9)
    # fewer targets than unknowns: from 40 and 40 kN the shortest way
    change = np.asarray(found.values[0]["stays"]) - 40e3
    np.testing.assert_allclose(change[0], -change[1], rtol=1e-2)


def test_contradictions_are_weighed():
    """Two forces for one rod: the mean by the squares of what each allows."""
    structure = rods(1)
    load = jc.NodalLoads([1], (0.0, 0.0, -1e3))
    phases = [jc.Phase(shortening=0.0, loads=load)]
    at = [Target("positions", -2.001, at=(1, 2), within=1e-3), Target("positions", -2.004, (1, 2))]
    at[1] = Target("positions", -2.004, at=(1, 2), within=2e-3)
    found = tune(structure, phases, [(0, "shortening")], at)
    assert int(found.status) == 0
    expected = (-2.001 * 4 - 2.004) / 5
    assert float(found.solution.positions[1, 2]) == pytest.approx(expected, abs=1e-9)
    assert [bool(met) for met in found.met] == [True, False]


def test_bounds_are_kept():
    structure = mast()
    bounds = ([{"mast": None, "stays": np.array([45e3, 30e3])}], None)
    phases = [jc.Phase(pretension={"mast": None, "stays": np.array([50e3, 50e3])}), STAGES[1]]
    little = Target("tension", 20e3, at=1, on="stays", within=1.0)
    found = tune(structure, phases, [(0, "pretension")], [UPRIGHT, little], bounds)
    values = np.asarray(found.values[0]["stays"])
    assert values[0] == 45e3 or values[1] == 30e3
    assert not all(bool(free) for free in np.asarray(found.free[0]["stays"]))
    assert not all(bool(met) for met in found.met)
    with pytest.raises(ValueError, match="lower bound"):
        tune(structure, phases, [(0, "pretension")], UPRIGHT, (np.ones(7), None))


def test_a_search_that_starts_where_cables_are_slack():
    """Both stays have to be taut at last; from 1 N they go slack under the load."""
    structure = mast()
    phases = [jc.Phase(pretension={"mast": None, "stays": np.array([1.0, 1.0])}), STAGES[1]]
    force = Target("tension", 30e3, at=1, on="stays", within=1.0)
    found = tune(structure, phases, [(0, "pretension")], [UPRIGHT, force])
    assert int(found.status) == 0 and all(bool(met) for met in found.met)
    assert int(jc.solve(structure, phases).phases[1].path.n_slack[-1]) == 1  # so they did
    alone = tune(structure, phases, [(0, "pretension")], [UPRIGHT, force], smooth=False)
    assert not all(bool(met) for met in alone.met)  # the control: it ends at the kink


def test_elements_come_with_the_forces_that_are_found():
    """Rods that are jacked one after the other and shall share the load alike at last."""
    structure, count, push = rods(3), 3, 9e3
    load = jc.NodalLoads([1], (0.0, 0.0, -push))
    keys = [f"rod {k}" for k in range(count)]
    nothing = dict.fromkeys(keys)
    phases = [jc.Phase(loads=load, removes=keys[1:])]
    phases += [jc.Phase(adds=key, jacking={**nothing, key: 1e3}) for key in keys[1:]]
    targets = [Target("tension", push / count, on=key, within=1e-3) for key in keys]
    unknowns = [(1, "jacking"), (2, "jacking")]
    found = tune(structure, phases, unknowns, targets, method=TIGHT)
    assert int(found.status) == 0 and all(bool(met) for met in found.met)
    # the second rod takes half of it first, as long as it bears alone with the first
    forces = [float(np.ravel(jax.tree.leaves(value))[0]) for value in found.values]
    assert forces[1] == pytest.approx(push / count, rel=1e-9)
    assert forces[0] == pytest.approx(push / 2, rel=1e-3)


def test_it_can_be_mapped():
    structure = rods(1)
    load = jc.NodalLoads([1], (0.0, 0.0, -1e3))

    def shortening(level):
        target = Target(lambda phase: phase.positions[1, 2], level, within=1e-6)
        phases = [jc.Phase(shortening=0.0, loads=load)]
        found = tune(structure, phases, [(0, "shortening")], target)
        return found.values[0], found.status

    levels = jnp.array([-2.0, -1.999, -1.99])
    values, codes = jax.vmap(shortening)(levels)
    assert not codes.any()
    expected = 2 - (-np.asarray(levels)) / 1.001  # strained by 1 kN / 1 MN
    np.testing.assert_allclose(values, expected, atol=1e-9)


@pytest.mark.parametrize(
    "unknowns, targets, said",
    [
        ([], UPRIGHT, "unknowns: none"),
        ([(0, "pretension")], [], "targets: none"),
        ([(7, "pretension")], UPRIGHT, "unknowns.0.: phase 7; there are phases 0 to 2"),
        (
            [(0, "tension")],
            UPRIGHT,
            "unknowns.0. = 'tension': not a statement; there are 'pretension'",
        ),
        ([(0, "shortening")], UPRIGHT, "unknowns.0.: phases.0. states no shortening"),
        (["pretension"], UPRIGHT, "unknowns.0. = 'pretension': expected .phase, statement."),
        ([(0, "pretension")], 3.0, "targets.0.: expected a Target, got float"),
        ([(0, "pretension")], [Target("tension", phase=3)], "targets.0..phase = 3: there are"),
    ],
)
def test_what_is_refused(unknowns, targets, said):
    targets = [targets] if isinstance(targets, float) else targets
    with pytest.raises(ValueError, match=said):
        tune(mast(), STAGES, unknowns, targets)


@pytest.mark.parametrize(
    "options, said",
    [
        ({"within": 0.0}, "within = 0.0: must be positive"),
        ({"phase": 1.0}, "phase = 1.0: expected the number of a phase"),
        ({"value": "level"}, "value: expected numbers"),
    ],
)
def test_targets_that_are_none(options, said):
    with pytest.raises(ValueError, match=said):
        Target("tension", **options)


@pytest.mark.parametrize(
    "at, said",
    [
        (0.5, "at = 0.5: expected an index"),
        ("all", "at = 'all': expected an index"),
        ([[0.0, 1.0]], r"at = \[\[0.0, 1.0\]\]: expected an index"),
    ],
)
def test_indices_that_are_none(at, said):
    with pytest.raises(ValueError, match=said):
        Target("tension", at=at)


@pytest.mark.parametrize("at", [[0, 1], np.array([0, 1]), [True, True], (slice(0, 2),), ...])
def test_an_index_may_be_a_list(at):
    structure = mast()
    solution = jc.solve(structure, STAGES)
    target = Target("tension", at=at, on="stays")
    np.testing.assert_array_equal(target.measured(solution), solution.tension["stays"])


def test_an_index_that_is_not_there():
    """jax would take the nearest number that is there."""
    with pytest.raises(ValueError, match=r"at: index 2 is out .* the result has shape \[2\]"):
        tune(mast(), STAGES, [(0, "pretension")], Target("tension", at=[0, 2], on="stays"))


def test_one_value_for_some_elements_is_one_unknown():
    structure = mast()
    pair = jc.Phase(pretension={"mast": None, "stays": jc.only([0, 1], 40e3)})
    force = Target("tension", 60e3, at=[0, 1], on="stays", within=1.0)
    found = tune(structure, pair, [(0, "pretension")], force)
    assert found.influence.shape == (2, 1) and int(found.status) == 0
    assert jnp.shape(found.values[0]["stays"].values) == ()
    np.testing.assert_allclose(found.solution.tension["stays"], 60e3, rtol=1e-8)
    each = jc.Phase(pretension={"mast": None, "stays": jc.only([0, 1], [40e3, 40e3])})
    assert tune(structure, each, [(0, "pretension")], force).influence.shape == (2, 2)


def test_the_search_is_that_of_fit():
    """Same design and influence as by one program of everything, which `fit` compiles."""
    structure = mast()
    force = Target(lambda phase: phase.peak_tension["stays"][1], 70e3, phase=1, within=10.0)
    targets = [UPRIGHT, force, Target("reactions", 0.0, at=(0, 0), phase=1, within=1e3)]

    def residuals(values):
        phases = [jc.Phase(pretension={"mast": None, "stays": values}), STAGES[1]]
        solution = jc.solve(structure, phases, TIGHT)
        return [t.deviation(solution) / t.within for t in targets], solution

    unknowns = [(0, "pretension")]
    found = tune(structure, STAGES[:2], unknowns, targets, method=TIGHT, smooth=False)
    whole = jc.fit(residuals, jnp.array([40e3, 40e3]))
    assert int(found.status) == int(whole.status) == 0 and int(found.steps) == int(whole.steps)
    np.testing.assert_allclose(found.values[0]["stays"], whole.params, rtol=1e-9)
    scale = np.array([1e-4, 10.0, 1e3])[:, None]
    # both by exact derivatives at points that differ by rounding
    np.testing.assert_allclose(found.influence, whole.jacobian * scale, rtol=1e-8, atol=1e-12)


def test_nothing_is_compiled_or_traced_again(monkeypatch):
    """Not by other numbers of structure, phases and targets, nor by the same call."""
    structure, unknowns = mast(), [(0, "pretension")]
    tune(structure, STAGES, unknowns, [UPRIGHT])
    fit = importlib.import_module("jaxcable.design.fit")  # beside the function of that name
    programs = [solver._analyse, sensitivity._pushed, fit._advanced]
    before = [set(run.known) for run in programs]
    monkeypatch.setattr(compilation, "_compiled", None)  # what would trace, lower and compile
    nodes = np.asarray(structure.nodes) * 1.01
    other = Target("positions", 0.002, at=(1, 0), phase=1, within=2e-4)
    elsewhere = Target("tension", 60e3, at=[0], on="stays", phase=2, within=100.0)
    stages = [jc.Phase(pretension={"mast": None, "stays": np.array([45e3, 41e3])}), *STAGES[1:]]
    for again in (
        (structure, STAGES, unknowns, [UPRIGHT]),
        (structure, STAGES, unknowns, [other]),
        (structure, stages, unknowns, [elsewhere]),
        (jc.replace(structure, nodes=nodes), STAGES, unknowns, [UPRIGHT]),
    ):
        found = tune(*again)
        assert int(found.status) == 0 and bool(found.met[0])
    assert [set(run.known) for run in programs] == before


def test_a_search_that_passes_forces_that_no_cable_has():
    """Bars in place of cables take a force below zero; the cables themselves are asked then."""
    structure = mast()
    force = Target("tension", -5e3, at=1, on="stays", phase=0, within=1e3)
    less = Target("tension", 1e3, at=1, on="stays", phase=0, within=1e3)
    found = tune(structure, STAGES[:1], [(0, "pretension")], [force, less])
    # below zero is refused as a trial: the search stays where cables are taut
    assert float(found.values[0]["stays"][1]) >= 0 and not all(bool(met) for met in found.met)


def test_paths_have_no_derivatives():
    """A target on the path has none: its derivative is NaN, not silently zero."""
    target = Target(lambda phase: phase.path.displacement[-1, 1, 0], 0.0, phase=1)
    found = tune(mast(), STAGES[:2], [(0, "pretension")], target, smooth=False)
    assert int(found.status) == status.BAD_START
    assert int(found.steps) == 0


def test_progress_is_told(capsys):
    reports = []
    found = tune(mast(), STAGES[:2], [(0, "pretension")], UPRIGHT, progress=reports.append)
    assert [news.number for news in reports] == list(range(int(found.steps) + 1))
    assert reports[0].count == 100 and reports[0].first and not reports[-1].first
    misfits = [news.misfit for news in reports if news.accepted]
    assert misfits == sorted(misfits, reverse=True) and misfits[-1] < 1e-5
    with hearing(Printer(pause=0.0)), compiling(None):
        time.sleep(0.1)
    assert capsys.readouterr().err == "compiling\n"
    with compiling(None):
        time.sleep(0.1)
    assert not capsys.readouterr().err


def test_cables_that_are_nearly_slack_are_said():
    structure = mast()
    force = Target("tension", 300.0, at=1, on="stays", phase=1, within=1.0)
    found = tune(structure, STAGES[:2], [(0, "pretension")], [UPRIGHT, force])
    assert int(found.status) == 0 and all(bool(met) for met in found.met)
    # the other stay has as much and what holds the pull of 10 kN, 10 kN / 0.6
    assert found.remarks == (
        "stays: 1 of 2 nearly slack; the least is element 1, 300 N at the end of phase 1",
    )
    more = Target("tension", 30e3, at=1, on="stays", phase=1, within=1.0)
    assert tune(structure, STAGES[:2], [(0, "pretension")], [UPRIGHT, more]).remarks == ()
