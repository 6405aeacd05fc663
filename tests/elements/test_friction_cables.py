"""Cables that slide with friction: ratios of tensions, slips, clamps, jacks, derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.convergence import converged
from oracles.coulomb import angles, draw_in, violations
from oracles.taylor import TIGHT, assert_gradient, joined
from oracles.traced import traced

import jaxcable as jc

EA = 1e6


def over_pulleys(n, **friction):
    """A rope over n fixed pulleys on half a circle, from an anchor to an end that moves down."""
    at = np.pi * np.arange(n) / max(n - 1, 1)
    circle = np.stack([np.cos(at), np.zeros(n), np.sin(at)], axis=1)
    nodes = np.vstack([[[1.0, 0, -2.0]], circle, [[-1.0, 0, -2.0]]])
    rope = jc.SlidingCables([range(n + 2)], axial_stiffness=EA, **friction)
    return jc.Structure(
        nodes, {"rope": rope}, jc.pinned(range(n + 1)) + jc.restrained([n + 1], "xy")
    )


def of_segments(phase, name="segment_tension"):
    return np.asarray(phase.element_results[name]["rope"][0])


@pytest.mark.parametrize("n", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_capstan(n):
    """exp(mu theta) over all pulleys together; axles with friction by the balance of moments."""
    structure = over_pulleys(n, friction=0.2, axle_friction=0.0)
    pull = jc.Phase(loads=jc.NodalLoads([n + 1], (0.0, 0.0, -1000.0)), increments=2)
    solution = converged(jc.solve(structure, [jc.Phase(pretension=10.0), pull], TIGHT))
    tension, turn = of_segments(solution), angles(np.asarray(structure.nodes))
    assert_allclose(tension, 1000 * np.exp(-0.2 * np.append(np.cumsum(turn[::-1])[::-1], 0)), 1e-12)
    assert_allclose(of_segments(solution, "friction_used"), 1.0, rtol=1e-12)
    assert (of_segments(solution, "slip") > 0).all()
    turning = over_pulleys(n, friction=0.0, axle_friction=0.1)
    turned = converged(jc.solve(turning, [jc.Phase(pretension=10.0), pull], TIGHT))
    high, low = of_segments(turned)[[-1, -2]]
    # (T2 - T1) R = mu r |T2 t2 - T1 t1| with 0.1 = mu r / R
    resultant = np.sqrt(high**2 + low**2 - 2 * high * low * np.cos(turn[-1]))
    assert high - low == pytest.approx(0.1 * resultant, rel=1e-11)


def loaded(seed, friction, clamped=None, stiffness=EA):
    """A rope over six nodes in space, two of them on springs, under three loads in turn."""
    rng = np.random.default_rng(seed)
    nodes = np.cumsum(rng.uniform(1, 3, (6, 1)) * [1.0, 0, 0], axis=0)
    nodes = nodes + rng.uniform(-1, 1, (6, 3)) * [0, 0.5, 1.5]
    rope = jc.SlidingCables([range(6)], axial_stiffness=stiffness, friction=friction)
    springs = jc.Springs([2, 4], [2e5, 3e5, 1e5])
    structure = jc.Structure(nodes, {"rope": rope, "springs": springs}, jc.pinned([0, 1, 3, 5]))
    if friction is not None:  # clamps that hold nothing: one program with those that do
        clamped = {"rope": np.zeros(4) if clamped is None else clamped}
    first = jc.NodalLoads([2, 4], [[0, 0, -900.0], [0, 100.0, -600.0]])
    phases = [jc.Phase(pretension={"rope": 3e3}, loads=first, clamped=clamped, increments=2)]
    for _ in range(2):
        load = jc.NodalLoads([2, 4], rng.normal(size=(2, 3)) * 300.0)
        phases.append(jc.Phase(loads=load, increments=2))
    return structure, phases


def assert_coulomb(structure, solution, bound_of, stiffness=EA):
    """Assert the conditions of friction in every phase; return how many nodes slip, in all."""
    slid, n = 0, structure.elements["rope"].links.shape[1]
    for phase in solution.phases:
        places, tension = np.asarray(phase.positions)[:n], of_segments(phase)
        # the last increment began with what the one before has left
        before = np.asarray(phase.path.element_results["slip"]["rope"])[-2, 0]
        start = np.linalg.norm(np.diff(np.asarray(structure.nodes)[:n], axis=0), axis=1)
        rest = start / start.sum() * float(phase.rest_length["rope"][0])
        rest = rest - np.diff(before, prepend=0, append=0)
        worst, _ = violations(places, tension, rest, bound_of(angles(places)), stiffness)
        assert worst < 1e-9
        slid += int((np.abs(of_segments(phase, "friction_used")) > 1 - 1e-9).sum())
    return slid


@pytest.mark.parametrize("seed", range(3))
def test_coulomb_and_equilibrium(seed):
    """Conditions that have one solution, and forces at free nodes; some nodes slip, some stick."""
    mu = np.array([[0.0, 0.05, 0.4, 0.15]])
    structure, phases = loaded(seed, mu)
    solution = converged(jc.solve(structure, phases, jc.Newton(tol=1e-12, watch=False)))
    slid = assert_coulomb(structure, solution, lambda theta: mu[0] * theta)
    assert 3 <= slid < 12  # of four nodes in three phases, one without friction
    way = np.diff(np.asarray(solution.positions), axis=0)
    pull = of_segments(solution)[:, None] * way / np.linalg.norm(way, axis=1, keepdims=True)
    applied = sum(np.asarray(phase.loads.forces) for phase in phases)
    springs = np.asarray(solution.displacement)[[2, 4]] * [2e5, 3e5, 1e5]
    assert_allclose((pull[1:] - pull[:-1])[[1, 3]], springs - applied, atol=1e-8)


def test_without_friction_and_clamped():
    """mu = 0 is the cable without friction; clamps are mu without end, and no clamp afterwards."""
    each = np.ones((1, 4))  # friction of every node: one program
    plain = [converged(jc.solve(*loaded(0, mu))) for mu in (None, 0 * each)]
    for one, other in zip(*(solution.phases for solution in plain), strict=True):
        assert_allclose(one.displacement, other.displacement, atol=1e-11)
        assert_allclose(one.tension["rope"], other.tension["rope"], rtol=1e-9)
    given = (1e3 * each,), (0.1 * each, np.ones(4)), ([[0.1, 0.1, 1e3, 1e3]], [1, 1, 0, 0])
    held = [converged(jc.solve(*loaded(0, *one))) for one in given]
    for other in held[1:]:
        assert_allclose(held[0].displacement, other.displacement, atol=1e-13)
    assert np.abs(of_segments(held[1], "slip")).max() < 1e-15
    used = [of_segments(phase, "friction_used") for phase in held[1].phases]
    assert np.abs(used).max() > 1  # what the clamps have to hold


@pytest.mark.slow
def test_pulled_back_and_forth():
    """A rope over a bar against a spring: a cycle costs friction times slip, by hand.

    The rope is stiff: at the spring it moves as its end does. Going up the end has exp(b) times the
    tension at the spring, coming back exp(-b) of it.
    """
    nodes = np.array([[-2.0, 0, 0], [0.0, 0, 0], [0.0, 0, -1.0], [-5.0, 0, 0]])
    rope = jc.FrictionCables(links=[[0, 1, 2]], axial_stiffness=1e9, friction=0.3)
    spring = jc.Cables([[3, 0]], axial_stiffness=3e4)  # 10 kN/m
    held = jc.pinned([1, 2, 3]) + jc.restrained([0], "yz")
    structure = jc.Structure(nodes, {"rope": rope, "spring": spring}, held)

    def moved(by):
        return jc.Phase(loads=jc.SupportMovement([2], (0.0, 0.0, by)), increments=8)

    start = jc.Phase(pretension={"rope": 500.0, "spring": 500.0})
    phases = [start, moved(-0.1), moved(0.08), moved(-0.08)]
    solution = converged(jc.solve(structure, phases))
    grows = np.exp(0.3 * np.pi / 2)
    tensions = np.array([of_segments(phase) for phase in solution.phases[1:]])
    assert_allclose(tensions[:, 1] / tensions[:, 0], [grows, 1 / grows, grows], rtol=1e-10)
    assert_allclose(tensions[2], tensions[0], rtol=1e-6)  # the loop closes but for the stiff rope
    work = 0.0
    for phase in solution.phases[2:]:
        path = phase.path
        force = np.asarray(path.element_results["segment_tension"]["rope"])[:, 0, 1]
        place = np.asarray(path.displacement)[:, 2, 2]
        work -= np.sum(np.diff(place) * (force[1:] + force[:-1]) / 2)
    slip = np.asarray([of_segments(p, "slip")[0] for p in solution.phases])
    mean = tensions[:2, 0].mean()
    expected = abs(slip[2] - slip[1]) * (grows - 1 / grows) * mean
    # the turning points, where it sticks while the spring stays, are within one increment of eight
    assert work == pytest.approx(expected, rel=0.15)


GIVEN = ("jacking", 3e6), ("shortening", -0.006)


def tendon(n=21):
    """A draped tendon in ducts, jacked from its first end; and the bounds of friction."""
    x = np.linspace(0.0, 30.0, n)
    nodes = np.stack([x, 0 * x, -4.8 * (x / 30) * (1 - x / 30)], axis=1)
    one = jc.FrictionCables(
        links=[range(n)], axial_stiffness=2e8, friction=0.19, wobble=0.19 * 0.005
    )
    # a node that moves, so that something is solved for
    nodes = np.vstack([nodes, [[0.0, 0.0, 1.0]]])
    mast = jc.Bars([[n, 0]], axial_stiffness=1e9)
    supports = jc.pinned(range(n)) + jc.restrained([n], "xy")
    structure = jc.Structure(nodes, {"rope": one, "mast": mast}, supports)
    nodes = nodes[:n]
    length = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    bound = 0.19 * angles(nodes) + 0.19 * 0.005 * 0.5 * (length[1:] + length[:-1])
    return structure, length, bound


@pytest.mark.slow  # in `make test` a tendon in a beam, tests/scenes/test_friction_scenes.py
def test_losses_of_a_tendon():
    """Force at the far end, elongation, lock-off, and the draw-in of the anchor."""
    structure, length, bound = tendon()
    jack, slip = ({name: {"rope": value, "mast": None}} for name, value in GIVEN)
    phases = [jc.Phase(**jack), jc.Phase(), jc.Phase(**slip)]
    solution = converged(jc.solve(structure, phases))
    losses = 3e6 * np.exp(-np.append(0.0, np.cumsum(bound)))
    for phase in solution.phases[:2]:
        assert_allclose(of_segments(phase), losses, rtol=1e-13)
    rest = np.sum(length / (1 + losses / 2e8))
    assert float(solution.phases[1].rest_length["rope"][0]) == pytest.approx(rest, rel=1e-14)
    after = draw_in(3e6, bound, length, 2e8, 0.006)
    assert_allclose(of_segments(solution), after, rtol=1e-10)
    assert (after < losses - 1.0).sum() == 8  # it reaches a part of the tendon


def weighed(p):
    """1 kN on both sides of a bar, one held by a spring; then more on the other: its way, m."""
    nodes = np.array([[-2.0, 0, 0], [0.0, 0, 0], [0.0, 0, -1.0], [-5.0, 0, 0]])
    nodes = np.vstack([nodes, [[-1.0, 1, 0], [0.0, 1, 0], [1.0, 1, -1], [2.0, 1, 0]]])
    # a longer chain beside it, so that the rope has fillers: derivatives go through them
    chains = [[0, 1, 2], [4, 5, 6, 7]]
    rope = jc.FrictionCables(links=chains, axial_stiffness=p["EA"], friction=p["mu"])
    spring = jc.Cables([[3, 0]], axial_stiffness=3e4)
    held = jc.pinned([1, 3, 4, 5, 6, 7]) + jc.restrained([0], "yz") + jc.restrained([2], "xy")
    structure = jc.Structure(nodes, {"rope": rope, "spring": spring}, held)
    first, more = (
        jc.Phase(loads=jc.NodalLoads([2], jnp.stack([0.0, 0.0, -force])))
        for force in (1000.0, p["more"])
    )
    first = jc.replace(first, pretension={"rope": 1000.0, "spring": 1000.0})
    solution = jc.solve(structure, [first, more], TIGHT)
    return solution.displacement[2, 2] - solution.phases[0].displacement[2, 2], solution.status


CAPACITY = 1000 * (np.exp(0.2 * np.pi / 2) - 1)


POINT = {"mu": 0.2, "EA": EA, "more": 1.5 * CAPACITY}


@pytest.mark.slow
def test_taylor():
    assert_gradient(*joined(weighed, POINT))


def test_derivatives():
    """Beyond what friction holds; below it, where only the hanging part stretches; NaN between."""

    @traced
    @jax.grad
    def slope(part):
        return weighed({**POINT, "more": part * CAPACITY})[0] / CAPACITY

    # exp(-b) of the load stretches 2 m of rope and the spring, whose unstressed length is below 3 m
    soft = 2 / EA + 3 / (1 + 1000 / 3e4) / 3e4
    assert -slope(1.5) == pytest.approx(1 / EA + np.exp(-0.1 * np.pi) * soft, rel=2e-3)
    assert slope(0.5) == pytest.approx(-1 / EA, rel=2e-3)  # strains of 1e-3
    assert np.isnan(slope(1.0))


@pytest.mark.slow
def test_added_where_the_nodes_are_then():
    """A rope that a phase adds is unstressed in every part; then a clamp holds a difference."""
    nodes = [[-12.0, 0, 0], [0.0, 0, 9.0], [12.0, 0, 0]]
    rope = jc.FrictionCables([[0, 1, 2]], axial_stiffness=2e7, friction=0.2)
    groups = {"rope": rope, "springs": jc.Springs([2], (1e8, 1e8, 1e5))}
    structure = jc.Structure(nodes, groups, jc.pinned([0, 1]))
    sinks = jc.Phase(loads=jc.NodalLoads([2], (0, 0, -60e3)), removes="rope")  # by 0.6 m
    added = jc.Phase(adds="rope", clamped={"rope": 1.0})
    more = jc.Phase(loads=jc.NodalLoads([2], (0, 0, -9e3)))
    solution = converged(jc.solve(structure, [sinks, added, more]))
    assert np.abs(of_segments(solution.phases[1])).max() < 1e-3
    assert float(solution.phases[1].displacement[2, 2]) == pytest.approx(-0.6, abs=1e-9)
    left, right = of_segments(solution)
    assert left < 1e-3 < right == pytest.approx(of_segments(solution, "clamp_force")[0])


@pytest.mark.parametrize("friction", [0.2, 2.0])
def test_stressed_where_the_nodes_are_then(friction):
    """A pretension in the phase that adds a rope is that of one drawn where the nodes have moved.

    With the larger friction the rope sticks.
    """
    nodes, rope = np.array([[-12.0, 0, 0], [0.0, 0, 9.0], [12.0, 0, 0]]), [[0, 1, 2]]
    groups = {
        "rope": jc.FrictionCables(rope, axial_stiffness=2e7, friction=friction),
        "springs": jc.Springs([2], (1e8, 1e8, 1e5)),
    }
    load, held = jc.NodalLoads([2], (0, 0, -9e3)), jc.pinned([0, 1])
    sinks = jc.Phase(loads=jc.NodalLoads([2], (0, 0, -60e3)), removes="rope")  # by 0.6 m
    added = jc.Phase(adds="rope", pretension={"rope": 1e5}, loads=load)
    later = jc.Phase(shortening={"rope": -2e-3}, loads=load)
    moved = converged(jc.solve(jc.Structure(nodes, groups, held), [sinks, added, later]))
    # springs have the force that holds the first load, and are linear
    drawn = jc.Structure(nodes - [[0, 0, 0], [0, 0, 0], [0, 0, 0.6]], groups, held)
    rest = np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum() / (1 + 1e5 / 2e7)
    stressed = jc.Phase(rest_length={"rope": rest}, loads=load)
    as_drawn = converged(jc.solve(drawn, [stressed, later]))
    for one, other in zip(moved.phases[1:], as_drawn.phases, strict=True):
        # tol 1e-10 of the residual
        assert_allclose(of_segments(one), of_segments(other), rtol=1e-8)
        assert_allclose(of_segments(one, "slip"), of_segments(other, "slip"), atol=1e-10)
    assert np.ptp(of_segments(moved.phases[1])) > 1e3  # it is no rope of one tension
    assert (np.abs(of_segments(moved, "slip")) > 1e-6) == (friction < 1)
