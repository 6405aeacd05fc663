"""Sags, lowest points and clearances against a cable integrated apart by SciPy, and by sampling.

The integration (`oracles.hanging_cable`) has no formula of the package, and is good to 1e-12 of the
length.
"""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import pieces
from oracles.convergence import converged
from oracles.hanging_cable import HangingCable
from oracles.taylor import TIGHT, remembered, slope
from oracles.traced import traced

import jaxcable as jc
from jaxcable import results

EA, WEIGHT = 33e6, 16.0  # N, N/m
SPAN = 300.0  # m
RISE = SPAN * np.array([0.0, 0.3, 1.0, 0.1, 1.0, 0.0])
# unstressed length over chord: from taut by 0.05 % to slack by a factor of 3
RATIO = np.array([1.002, 1.003, 1.001, 1.5, 3.0, 0.9995])
LENGTH = RATIO * np.hypot(SPAN, RISE)
WIND = np.array([5.0, -9.0, 0.0])  # N/m, neither along nor across the spans
COUNT = len(RISE)
ENDS = np.zeros((COUNT, 2, 3))
ENDS[:, 1] = np.column_stack([np.full(COUNT, 0.8 * SPAN), np.full(COUNT, 0.6 * SPAN), RISE])
LINKS = np.arange(2 * COUNT).reshape(COUNT, 2)
DOWN = np.array([0.0, 0, -WEIGHT])
PHASES = [jc.Phase(loads=jc.SelfWeight()), jc.Phase(loads=jc.LineLoads(tuple(WIND)))]
NEAR = 1e-9  # m, of lengths up to 1300 m; 3e-13 is measured


def spans():
    cables = jc.Catenaries(LINKS, axial_stiffness=EA, weight=WEIGHT, rest_length=LENGTH)
    return jc.Structure(ENDS.reshape(-1, 3), cables, supports=jc.pinned(range(2 * COUNT)))


@functools.cache
def solved():
    return converged(jc.solve(spans(), PHASES))


@functools.cache
def oracle(phase, k):
    load = DOWN + phase * WIND
    pull = np.asarray(solved().phases[phase].results["end_pull"])[k, 0]
    return HangingCable(*ENDS[k], LENGTH[k], EA, load, 1.01 * pull)


@pytest.mark.slow_cases("1")
@pytest.mark.parametrize("phase", [0, 1])
def test_sags_are_those_of_the_integrated_cable(phase):
    """Level and inclined to h/l = 1, taut and slack, in the middle phase and in the wind."""
    found = results.sags(spans(), solved().phases[phase])
    for k in range(COUNT):
        cable = oracle(phase, k)
        low, place = cable.least(lambda p: p[2])
        below, under = cable.least(cable.below_chord)
        apart, aside = cable.least(cable.near_chord)
        told = [found.midspan[k], found.lowest[k, 2], found.largest[k], found.deflection[k]]
        assert np.abs(np.array(told) - [cable.sag_at_midspan(), low, -below, -apart]).max() < NEAR
        # places of extremes are known to the root of the rounding of the extreme, 1e-5 m
        for mine, other in ((found.lowest, place), (found.largest_at, under)):
            assert np.abs(np.asarray(mine[k]) - other).max() < 1e-4
        assert np.abs(np.asarray(found.deflection_at[k]) - aside).max() < 1e-4
        assert float(found.span[k]) == pytest.approx(SPAN)
    if phase:  # the control: the deflection is not the sag
        assert float(found.deflection[0] / found.largest[0]) > 1.1


def test_a_level_catenary_by_its_closed_form():
    """``H/w (cosh(w l/2H) - 1)`` for EA that is nearly infinite; H all along."""
    H = 6e3
    length = 2 * H / WEIGHT * np.sinh(WEIGHT * SPAN / 2 / H)
    cable = jc.Catenaries([[0, 1]], axial_stiffness=1e14, weight=WEIGHT, rest_length=length)
    nodes = [[0.0, 0, 0], [SPAN, 0, 0]]
    structure = jc.Structure(nodes, cable, supports=jc.pinned([0, 1]))
    solution = converged(jc.solve(structure, PHASES[0]))
    sag = H / WEIGHT * (np.cosh(WEIGHT * SPAN / 2 / H) - 1)
    found = results.sags(structure, solution)
    # a strain of H / EA = 6e-11, which the sag enlarges by 3/16 (l/f)^2 = 18
    np.testing.assert_allclose(
        [found.midspan[0], found.largest[0], found.deflection[0], -found.lowest[0, 2]],
        sag,
        rtol=1e-8,
    )
    np.testing.assert_allclose(results.horizontal_tensions(structure, solution), H, rtol=1e-8)


def test_end_tensions_of_a_middle_phase_are_those_of_an_analysis_that_ends_there():
    structure = spans()
    alone = jc.solve(structure, PHASES[:1])
    for function in (jc.forms.end_tensions, results.horizontal_tensions, jc.forms.catenary_curves):
        here, there = function(structure, solved().phases[0]), function(structure, alone)
        np.testing.assert_allclose(here, there, rtol=1e-12, atol=1e-12 * LENGTH.max())
        last = function(structure, solved().last)
        np.testing.assert_array_equal(last, function(structure, solved()))
        assert np.abs(np.asarray(last) - np.asarray(there)).max() > 1e-3
    for phase in (0, 1):
        found = jc.forms.end_tensions(structure, solved().phases[phase])
        for k in range(COUNT):
            np.testing.assert_allclose(found[k], oracle(phase, k).ends, rtol=1e-11)


# --- chains


def hung_chain(force):
    """Two catenaries and a bar in a row, with a force in the middle; and its nodes."""
    nodes = np.array([[0.0, 0, 0], [100.0, 0, -5], [220.0, 0, -3], [300.0, 0, 10]])
    length = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    parts = {
        "bar": jc.Bars([[2, 3]], axial_stiffness=EA),
        "cables": jc.Catenaries(
            [[0, 1], [2, 1]], axial_stiffness=EA, weight=WEIGHT, rest_length=1.002 * length[:2]
        ),
    }
    structure = jc.Structure(nodes, parts, supports=jc.pinned([0, 3]))
    loads = [jc.SelfWeight(), jc.NodalLoads([1], force)]
    solution = jc.solve(structure, jc.Phase(loads=loads), TIGHT)
    return structure, solution


def chain_points(structure, solution):
    curves = np.asarray(jc.forms.catenary_curves(structure, solution, 20_001)["cables"])
    bar = np.asarray(solution.positions)[[2, 3]]
    return np.concatenate([curves[0], curves[1][::-1], np.linspace(*bar, 11)])


@pytest.mark.slow
def test_a_chain_of_catenaries_and_bars_against_its_points():
    structure, solution = hung_chain((300.0, 200.0, -2e3))
    assert int(solution.status) == 0
    found = results.sags(structure, solution, {"line": [0, 1, 2, 3]})["line"]
    back = results.sags(structure, solution, {"line": [3, 2, 1, 0]})["line"]
    points = chain_points(structure, solution)
    chord = points[-1] - points[0]
    below = points[0, 2] + points[:, 0] / SPAN * chord[2] - points[:, 2]
    apart = np.linalg.norm(np.cross(points - points[0], chord), axis=1) / np.linalg.norm(chord)
    middle = np.interp(SPAN / 2, points[:, 0], below)
    # between points 5 mm apart a parabola of curvature w/H = 1e-3/m is 3e-9 m deeper
    told = [found.midspan, found.largest, found.deflection, found.lowest[2]]
    want = [middle, below.max(), apart.max(), points[:, 2].min()]
    np.testing.assert_allclose(told, want, atol=1e-8)
    for one, other in zip(jax.tree.leaves(back), jax.tree.leaves(found), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)
    assert results.nodes_along(structure, [0, 1], on="cables") == [0, 1, 2]


# --- clearances

HILL = np.array([[-20.0, -3, -40], [60, 2, -12], [140, -1, -25], [230, 0, -13], [320, 0, -10]])
ROAD = np.array([[120.0, -80, -30], [150, 0, -28], [190, 90, -33]])


def point_to_segments(points, line):
    """Distances of points from a polyline: the least over its pieces, by hand."""
    found = []
    for a, b in itertools.pairwise(line):
        d = b - a
        at = np.clip((points - a) @ d / (d @ d), 0, 1)
        found.append(np.linalg.norm(points - a - at[:, None] * d, axis=1))
    return np.min(found, axis=0)


def heights_over(points, line):
    """Heights over a profile: each piece is level across its direction in plan."""
    found = np.full(len(points), np.inf)
    for a, b in itertools.pairwise(line):
        d = b - a
        at = (points - a)[:, :2] @ d[:2] / (d[:2] @ d[:2])
        beside = (at >= 0) & (at <= 1)
        height = points[:, 2] - a[2] - at * d[2]
        found = np.where(beside, np.minimum(found, height), found)
    return found


def clearances(structure, solution):
    plane = results.clearance_to_plane(structure, solution, (0.0, 0.0, -60.0), (0.1, -0.3, 1.0))
    ground = results.clearance_over_ground(structure, solution, HILL)
    return plane, ground, results.distance_to_line(structure, solution, ROAD)


def test_a_chain_over_pulleys_has_all_of_its_nodes():
    nodes, rope = pieces(4)[0], jc.SlidingCables([[0, 1, 2, 3]], axial_stiffness=1e5)
    structure = jc.Structure(nodes, {"rope": rope, "tie": jc.Cables([[3, 4]], 1e5)}, jc.pinned([0]))
    assert results.nodes_along(structure, [0], on="rope") == [0, 1, 2, 3]


def test_a_cross_arm_at_the_end_of_a_profile_counts_as_a_whole():
    """It falls from 3 m to 2 m above the last point of the ground, at right angles to it."""
    nodes = [[10.0, -1.0, 3.0], [10.0, 1.0, 2.0]]
    held = jc.pinned([0]) + jc.restrained([1], "xz")
    structure = jc.Structure(nodes, jc.Bars([[0, 1]], 1e6), held)
    solution = jc.solve(structure, jc.Phase())
    ground = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]]
    for turned in (ground, ground[::-1]):
        found = results.clearance_over_ground(structure, solution, turned)
        assert float(found.least) == pytest.approx(2.0, rel=1e-12)


@pytest.mark.slow
def test_clearances_against_sampled_points():
    """Of 40 000 points the nearest is at most 5 mm from the true one: 1e-8 m of the distance.

    (At an edge of the ground the height is cut off between two points: 5 mm times a slope of 0.5.)
    """
    structure, solution = hung_chain((300.0, 200.0, -2e3))
    plane, ground, line = clearances(structure, solution)
    points = chain_points(structure, solution)
    unit = np.array([0.1, -0.3, 1.0]) / np.linalg.norm([0.1, -0.3, 1.0])
    sampled = ((points - [0, 0, -60]) @ unit, heights_over(points, HILL))
    for told, values, near in (
        (plane, sampled[0], 1e-8),
        (ground, sampled[1], 3e-3),
        (line, point_to_segments(points, ROAD), 1e-7),
    ):
        assert abs(float(told.least) - values.min()) < near
        assert float(told.least) <= values.min() + 1e-9
        assert np.linalg.norm(np.asarray(told.place) - points[values.argmin()]) < 0.02
        assert (int(told.group), int(told.element)) == (1, int(values.argmin() > 20_000))
    own = np.asarray(ground.distance["cables"])
    assert own.min() == float(ground.least) and np.isfinite(own).all()
    only = results.clearance_to_plane(structure, solution, (0.0, 0.0, -60.0), on="bar")
    assert only.distance["cables"] is None and int(only.group) == 0


@pytest.mark.slow
def test_derivatives_of_sags_and_clearances():
    """By the force in the chain, each result by itself; steps of 0.1 N to 1 N of 2 kN."""
    force = np.array([300.0, 200.0, -2e3])

    def every(force):
        structure, solution = hung_chain(force)
        plane, ground, line = clearances(structure, solution)
        sag = results.sags(structure, solution, {"line": [0, 1, 2, 3]})["line"]
        least = plane.least, ground.least, line.least
        shape = sag.midspan, sag.deflection, sag.largest, sag.lowest[0], line.place[0]
        return jnp.stack(least + shape)

    values = remembered(traced(every))  # of all results at the same points
    jacobian = np.asarray(traced(jax.jacfwd(every))(force))
    reverse = np.asarray(traced(jax.grad(lambda f: jnp.sum(every(f))))(force))
    np.testing.assert_allclose(reverse, jacobian.sum(axis=0), rtol=1e-8)
    for k, gradient in enumerate(jacobian):
        # places are functions of lower order
        right, wrong = (
            slope(lambda f, k=k: values(f)[k], force, factor * gradient) for factor in (1.0, 1.01)
        )
        assert 1.8 < right < 2.2 and wrong < 1.1, k


def test_a_kink_has_the_derivative_of_each_side():
    """The least height of a catenary over level ground as its end is lowered past the lowest point.

    Where the lowest point reaches the end, its height has the derivative 1 of both sides; between
    two supports that are equally high the derivative jumps, as the distance of a taut bar shows.
    """

    def least(z):
        nodes = jnp.array([[0.0, 0.0, 0.0], [SPAN, 0.0, 0.0]]).at[1, 2].set(z)
        bar = jc.Bars([[0, 1]], axial_stiffness=EA)
        held = jc.pinned([0]) + jc.restrained([1], "yz")
        structure = jc.Structure(nodes, bar, supports=held)
        solution = jc.solve(structure, jc.Phase())
        return results.clearance_to_plane(structure, solution, (0.0, 0.0, -5.0)).least

    rates = jax.vmap(jax.grad(least))(jnp.array([-1e-3, 1e-3]))
    np.testing.assert_allclose(rates, [1.0, 0.0], atol=1e-12)


@pytest.mark.slow
def test_absent_and_unloaded_catenaries():
    nodes = [[0.0, 0, 0], [10.0, 0, 0], [20.0, 0, 0]]
    cables = jc.Catenaries([[0, 1], [1, 2]], axial_stiffness=EA, weight=WEIGHT)
    structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 1, 2]))
    taut = converged(jc.solve(structure, jc.Phase(pretension=500.0)))
    np.testing.assert_allclose(jc.forms.end_tensions(structure, taut), 500.0, rtol=1e-9)
    np.testing.assert_allclose(results.horizontal_tensions(structure, taut), 500.0, rtol=1e-9)
    assert not np.asarray(results.sags(structure, taut).midspan).any()
    staged = converged(jc.solve(structure, [PHASES[0], jc.Phase(adds=jc.only([1]))]))
    first, second = (results.sags(structure, phase).midspan for phase in staged.phases)
    assert np.isnan(first[1]) and np.isfinite(second).all()
    assert np.asarray(jc.forms.end_tensions(structure, staged.phases[0]))[1].tolist() == [0, 0]
    clear = results.clearance_to_plane(structure, staged.phases[0], (0.0, 0.0, -5.0))
    assert np.isnan(clear.distance[1]) and int(clear.element) == 0
