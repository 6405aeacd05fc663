"""`design.tune`: prestress in any phases that makes results of any phases what they shall be."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.design import Target, tune

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
        ([(0, "tension")], UPRIGHT, "unknowns.0. = 'tension': expected one of pretension"),
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
