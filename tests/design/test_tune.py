"""`design.tune`: prestress in any phases that makes results of any phases what they shall be."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.analysis import phase_loop, recalled_derivative
from jaxcable.analysis.results import RESULT_NAMES
from jaxcable.common import status
from jaxcable.design import Target, targets, tune
from jaxcable.design.bounds import make_bounds
from jaxcable.design.length_bounds import add_default_bounds

TIGHT = jc.Newton(tol=1e-13)
MAST = jc.Structure(
    [[0.0, 0.0, 0.0], [0.0, 0.0, 20.0], [-15.0, 0.0, 0.0], [15.0, 0.0, 0.0]],
    {
        "mast": jc.Bars([[0, 1]], axial_stiffness=1e9),
        "stays": jc.Cables([[2, 1], [3, 1]], axial_stiffness=5e7),
    },
    supports=jc.pinned([0, 2, 3]) + jc.restrained([1], "y"),
)
PULL = jc.Phase(loads=jc.NodalLoads([1], (10e3, 0.0, 0.0)))


def stayed(*forces):
    """Stays with two forces, N, then the pull at the top: one program for all that take these."""
    return [jc.Phase(pretension={"mast": None, "stays": np.array(forces)}), PULL]


STAGES = stayed(40e3, 40e3)
FORCES = [(0, "pretension")]
UPRIGHT = Target("positions", 0.0, at=(1, 0), phase=1, within=1e-4)


def stay(force, phase=1, within=1.0):
    """A target for the force of the second stay, which the pull relieves."""
    return Target("tension", force, at=1, on="stays", phase=phase, within=within)


# two bars of 2 m and 1 MN in a line, held at both ends; the node between them moves along it
LINE = jc.Structure(
    [[0.0, 0, 0], [0, 0, -2.0], [0, 0, -4.0]],
    jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e6),
    jc.pinned([0, 2]) + jc.restrained([1], "xy"),
)


@pytest.mark.slow
def test_fewer_targets_than_unknowns():
    """The shortest way from 40 and 40 kN, and the influence matrix by central differences."""
    found = converged(tune(MAST, STAGES, FORCES, [UPRIGHT], method=TIGHT))
    forces = np.asarray(found.values[0]["stays"])
    np.testing.assert_allclose(forces[0] - 40e3, 40e3 - forces[1], rtol=1e-2)

    def side(change):
        solution = converged(jc.solve(MAST, stayed(*(forces + change)), TIGHT))
        return float(solution.positions[1, 0])

    # a change of 10 N is 1e-7 of the strain: third order is nothing, rounding 1e-9 of it
    expected = [(side(10.0 * e) - side(-10.0 * e)) / 20.0 for e in np.eye(2)]
    np.testing.assert_allclose(found.influence[0], expected, rtol=1e-6)


@pytest.mark.slow
def test_contradictions_are_weighed_by_what_targets_allow():
    """The upper bar of a line is shortened by s: its node rises by s / 2, both pull EA s / 4 m."""
    phases = [jc.Phase(shortening=np.array([0.0, 0.0]))]
    bounds = ([np.array([-1.0, 0.0])], [np.array([1.0, 0.0])])  # the other bar keeps its length

    def sought(*wanted):
        found = converged(tune(LINE, phases, [(0, "shortening")], list(wanted), bounds))
        return found, float(found.values[0][0])

    # near zero all is linear; defaults are 1e-3 m and 1 N
    a, b = 1e-6, 1.0
    force = Target("tension", b, at=0)
    found, s = sought(Target("positions", -2.0 + a, at=(1, 2)), force)
    columns, wanted = np.array([0.5e3, 0.25e6]), np.array([a * 1e3, b])
    assert s == pytest.approx(columns @ wanted / (columns @ columns), rel=1e-5)
    assert [bool(met) for met in found.met] == [True, True]
    found, _ = sought(Target("positions", -2.0 + 0.1, at=(1, 2)), force)
    assert not found.met[0] and abs(float(found.deviation[0][0])) > 0.05
    # two heights: the mean by the squares of what each allows
    low, high = (
        Target("positions", z, (1, 2), within=w) for z, w in ((-2.001, 1e-3), (-2.004, 2e-3))
    )
    found, _ = sought(low, high)
    height = float(found.solution.positions[1, 2])
    assert height == pytest.approx((-2.001 * 4 - 2.004) / 5, abs=1e-9)
    assert [bool(met) for met in found.met] == [True, False]


@pytest.mark.slow
def test_bounds_are_kept():
    bounds = ([{"mast": None, "stays": np.array([45e3, 30e3])}], None)
    found = converged(tune(MAST, stayed(50e3, 50e3), FORCES, [UPRIGHT, stay(20e3)], bounds))
    values = np.asarray(found.values[0]["stays"])
    assert (values >= [45e3, 30e3]).all() and (values[0] == 45e3 or values[1] == 30e3)
    assert not all(bool(free) for free in np.asarray(found.free[0]["stays"]))
    assert not all(bool(met) for met in found.met)


@pytest.mark.slow
def test_a_search_that_starts_where_cables_are_slack():
    """Both stays have to be taut at last; from 1 N they go slack under the load."""
    start, wanted = stayed(1.0, 1.0), [UPRIGHT, stay(30e3)]
    found = tune(MAST, start, FORCES, wanted)
    assert int(found.status) == 0 and all(bool(met) for met in found.met)
    assert int(jc.solve(MAST, start).phases[1].path.n_slack[-1]) == 1  # so they did
    alone = tune(MAST, start, FORCES, wanted, smooth=False)
    assert not all(bool(met) for met in alone.met)  # the control: it ends at the kink


@pytest.mark.slow
def test_a_search_that_passes_forces_that_no_cable_has():
    """Bars in place of cables take a force below zero; the cables themselves are asked then."""
    found = tune(MAST, STAGES, FORCES, [stay(-5e3, 0, 1e3), stay(1e3, 0, 1e3)])
    # below zero is refused as a trial: the search stays where cables are taut
    assert float(found.values[0]["stays"][1]) >= 0 and not all(bool(met) for met in found.met)


def test_analyses_and_derivatives_are_not_traced_again():
    """Not by other numbers of structure, phases and targets, nor by the same call."""
    tune(MAST, STAGES, FORCES, [UPRIGHT])
    programs = [phase_loop.analyse, recalled_derivative.recalled_results]
    before = [set(run.known) for run in programs]
    other = Target("positions", 0.002, at=(1, 0), phase=1, within=2e-4)
    elsewhere = Target("tension", 60e3, at=[0], on="stays", phase=0, within=100.0)
    for again in (
        (MAST, STAGES, FORCES, [UPRIGHT]),
        (MAST, STAGES, FORCES, [other]),
        (MAST, stayed(45e3, 41e3), FORCES, [elsewhere]),
        (jc.replace(MAST, nodes=np.asarray(MAST.nodes) * 1.01), STAGES, FORCES, [UPRIGHT]),
    ):
        found = tune(*again)
        assert int(found.status) == 0 and bool(found.met[0])
    assert [set(run.known) for run in programs] == before


def test_progress_is_told():
    reports = []
    found = tune(MAST, STAGES, FORCES, [UPRIGHT], progress=reports.append)
    assert [news.number for news in reports] == list(range(int(found.steps) + 1))
    assert reports[0].count == 100 and reports[0].first and not reports[-1].first
    misfits = [news.misfit for news in reports if news.accepted]
    assert misfits == sorted(misfits, reverse=True) and misfits[-1] < 1e-5


def test_cables_that_are_nearly_slack_are_said():
    found = tune(MAST, STAGES, FORCES, [UPRIGHT, stay(300.0)])
    assert int(found.status) == 0 and all(bool(met) for met in found.met)
    # the other stay has as much and what holds the pull of 10 kN, 10 kN / 0.6
    assert found.remarks == (
        "stays: 1 of 2 nearly slack; the least is element 1, 300 N at the end of phase 1",
    )
    assert tune(MAST, STAGES, FORCES, [UPRIGHT, stay(30e3)]).remarks == ()


@pytest.mark.slow
def test_targets_of_several_stages_are_met_exactly():
    """Rods that carry a plate come one after the other, with the forces that share its load alike.

    At last the first one is shortened by s: ``z / (2 - s) + z = 3 + P / EA`` for the plate's depth.
    """
    push, stiffness, depth = 9e3, 1e6, 2.004
    keys = [f"rod {k}" for k in range(3)]
    rods = {key: jc.Bars([[0, 1]], axial_stiffness=stiffness) for key in keys}
    guide = jc.pinned([0]) + jc.restrained([1], "xy")
    structure = jc.Structure([[0.0, 0.0, 0.0], [0.0, 0.0, -2.0]], rods, supports=guide)
    nothing = dict.fromkeys(keys)
    phases = [
        jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -push)), removes=keys[1:]),
        *(jc.Phase(adds=key, jacking={**nothing, key: 1e3}) for key in keys[1:]),
        jc.Phase(shortening={**nothing, "rod 0": jc.only([0], 0.0)}),
    ]
    wanted = [Target("tension", push / 3, on=key, phase=2, within=1e-3) for key in keys]
    wanted.append(Target("positions", -depth, at=(1, 2), within=1e-6))
    unknowns = [(1, "jacking"), (2, "jacking"), (3, "shortening")]
    found = tune(structure, phases, unknowns, wanted, method=TIGHT)
    assert int(found.status) == 0 and all(bool(met) for met in found.met)
    assert [part.shape for part in found.deviation] == [(1,)] * 4
    assert found.influence.shape == (4, 3)
    forces = [float(np.ravel(jax.tree.leaves(value))[0]) for value in found.values]
    # the second rod takes half of the load first, as long as it bears alone with the first
    assert forces[0] == pytest.approx(push / 2, rel=1e-3)
    assert forces[1] == pytest.approx(push / 3, rel=1e-9)
    assert forces[2] == pytest.approx(2 - 1 / ((3 + push / stiffness) / depth - 1), abs=1e-8)
    check = converged(jc.solve(structure, found.phases, TIGHT))
    assert float(check.positions[1, 2]) == pytest.approx(-depth, abs=1e-9)
    for key in keys:
        assert float(check.phases[2].tension[key][0]) == pytest.approx(push / 3, rel=1e-7)


def shortened(of, value=0.0, bounds=None):
    """The upper bar of the line is shortened, so that the node between is where it shall be."""
    target, phases = Target(of, value, within=1e-6), [jc.Phase(shortening=jc.only([0], 0.0))]
    return tune(LINE, phases, [(0, "shortening")], target, bounds, method=TIGHT)


def height(phase):
    return phase.positions[1, 2]


@pytest.mark.slow
def test_the_search_is_that_of_fit():
    """Mapped it is `fit`, one program of everything: the same steps, derivatives and closed form.

    By equal forces (s - u) / (2 - s) = u / 2, with the rise u of the node. One value for some
    elements is one unknown.
    """
    levels = np.array([-2.0, -1.999, -1.99])
    whole = jax.vmap(lambda level: shortened(height, level))(jnp.asarray(levels))
    assert not whole.status.any() and whole.influence.shape == (3, 1, 1)
    found = shortened(height, levels[2])
    assert int(found.status) == 0 and int(found.steps) == int(whole.steps[2])
    values = np.append(whole.values[0].values, found.values[0].values)
    levels, rates = np.append(levels, levels[2]), np.append(whole.influence, found.influence)
    np.testing.assert_allclose(values, 4 * (2 + levels) / (4 + levels), atol=1e-9)
    np.testing.assert_allclose(rates, 8 / (4 - values) ** 2, rtol=1e-9)


def test_lengths_end_at_what_a_turnbuckle_can_do():
    """A bar of 2 m is let out by 2 m at most: equal forces, (s - u) / (2 - s) = u / 2, u = -2/3 m.

    The level asked for needs s = -76 m: bounds that allow it are taken.
    """
    with pytest.warns(
        jc.InputWarning, match=r"unknowns\[0\]\.values \(shortening\) = -2: at the def"
    ):
        found = converged(shortened(height, -3.9))
    assert float(found.values[0].values) == -2.0 and not bool(found.met[0])
    assert float(found.deviation[0][0]) == pytest.approx(3.9 - 8 / 3, abs=1e-9)
    assert "default bound" in found.remarks[0] and "off by up to 1.23" in found.remarks[1]
    assert repr(found).startswith("Tuned: converged; targets missed: number 0\n")
    with pytest.raises(jc.AnalysisError, match=r"^targets missed: number 0; .*off by up to 1.23"):
        jc.raise_if_failed(found)
    with pytest.warns(jc.InputWarning, match=r"shortening\[0\] = -76: the element has 2 m"):
        wide = converged(shortened(height, -3.9, (-100.0, None)))
    assert float(wide.values[0].values) == pytest.approx(-76.0, rel=1e-6)
    assert wide.remarks == () and repr(wide).startswith("Tuned: converged\n")
    jc.raise_if_failed(wide)
    near = converged(shortened(height, -3.9, (-0.5, None)))
    stop = "unknowns[0].values (shortening) = -0.5: at a bound that was given"
    assert near.remarks[0] == stop and "off by" in near.remarks[1]


def test_default_bounds_of_all_lengths():
    """One number for bars of 2 m and 6 m keeps to the shorter one; forces have no bounds."""
    nodes = [[0.0, 0, 0], [0, 0, -2.0], [0, 0, -8.0]]
    bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e6)
    line = jc.Structure(nodes, {"bars": bars}, jc.pinned([0, 2]))
    given = [
        ("shortening", np.array(0.0), -2.0, 2.0),
        ("rest_length", {"bars": np.array([5.0, 6.0])}, [0.0, 0.0], [5.0, 12.0]),
        ("prestrain", {"bars": jc.only([1], np.array([1e-3]))}, -0.5, 1.0),
        ("pretension", {"bars": np.array([1e3, 1e3])}, [-np.inf] * 2, [np.inf] * 2),
    ]
    for name, start, low, high in given:
        box = add_default_bounds(make_bounds(None, [start]), line, [(0, name)], [start])
        np.testing.assert_array_equal(box.lower, np.ravel(low))
        np.testing.assert_array_equal(box.upper, np.ravel(high))
        kept = make_bounds((-0.25, 20.0), [start]) if name != "pretension" else box
        box = add_default_bounds(kept, line, [(0, name)], [start])
        np.testing.assert_array_equal((box.lower, box.upper), (kept.lower, kept.upper))


def test_paths_have_no_derivatives():
    """A target on the path has none: its derivative is NaN, not silently zero."""
    with pytest.warns(jc.InputWarning, match="derivative of value 0 .* is not finite"):
        found = shortened(lambda phase: phase.path.displacement[-1, 1, 2], 0.01)
    assert int(found.status) == status.BAD_START and int(found.steps) == 0


# --- targets and arguments


@functools.cache
def solved():
    return converged(jc.solve(MAST, STAGES))


def test_an_index_may_be_a_list():
    for at in ([0, 1], np.array([0, 1]), [True, True], (slice(0, 2),), ...):
        found = Target("tension", at=at, on="stays").measured_values(solved())
        np.testing.assert_array_equal(found, solved().tension["stays"])
    with pytest.raises(ValueError, match=r"at: index 2 is out .* the result has shape \[2\]"):
        Target("tension", at=[0, 2], on="stays").measured_values(
            solved()
        )  # jax would take the nearest


def test_the_default_tolerance_is_that_of_the_kind_of_result():
    metres = ("positions", "displacement", "displacement_in_phase", "rest_length")
    forces = ("tension", "peak_tension", "reactions", "load", "section_forces")
    kinds = dict.fromkeys(metres, 1e-3) | dict.fromkeys((*forces, "reaction_moments"), 1.0)
    for of, expected in kinds.items():
        assert Target(of).within == expected and Target(of, within=0.25).within == 0.25
        assert f'"{of}"' in Target.__doc__
    # a turn by 1e-3 rad about any axis, as a unit quaternion beside none
    assert Target("rotation").within == pytest.approx(np.sin(0.5e-3), rel=1e-6)
    assert set(targets.WITHIN) == {*kinds, "rotation"}
    assert set(RESULT_NAMES) == set(targets.WITHIN) - {"displacement_in_phase"} | {"results"}
    assert Target(lambda phase: phase.positions[1, 2]).within == 1.0  # its unit is not known


def test_stays_that_end_slack_are_named():
    """A pull of 10 kN on two stays at 0.6 to the horizontal, of 2 kN: one carries all, 10 / 0.6."""
    pull = jc.Phase(loads=jc.NodalLoads([1], (-10e3, 0.0, 0.0)))
    phases, target = [stayed(2e3, 2e3)[0], pull], stay(10e3 / 0.6, within=100.0)
    tuned = tune(MAST, phases, FORCES, target, smooth=False, steps=3)
    assert int(tuned.solution.status) == 0 and float(tuned.solution.tension["stays"][0]) == 0.0
    assert any("stays: 1 of 2 SLACK at the end: elements 0" in one for one in tuned.remarks)
