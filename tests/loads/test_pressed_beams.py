"""Pressure that follows beams: a ring by statics, a cantilever by shooting, tangents, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.taylor import TIGHT, slope
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jaxcable as jc
from jaxcable.analysis.preparation import prepare, ready
from jaxcable.common.tree import copy, fill
from jaxcable.mechanics.ramp import Ramp

UP = (0.0, -1.0, 0.0)  # a beam along x is pressed up, along axis x d
LENGTH, SIDE, MODULUS = 2.0, 0.05, 10e9
EA, EI = MODULUS * SIDE**2, MODULUS * SIDE**4 / 12
PRESSURE = 6 * EI / LENGTH**3  # turns the tip by about one radian


def cantilever(n, pressure=PRESSURE, **options):
    """Clamped at the origin, along x."""
    section = jc.Section.rectangle(SIDE, SIDE, jc.Elastic(MODULUS))
    nodes = np.linspace([0.0, 0, 0], [LENGTH, 0, 0], n + 1)
    links = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    structure = jc.Structure(nodes, jc.Beams(links, section=section), jc.clamped([0]))
    load = jc.CablePressure(pressure, UP, **options)
    return structure, jc.Phase(loads=load, increments=3)


def elastica(pressure, per):
    """Tip x, z and root moment of an extensible rod under normal pressure, by shooting.

    From the tip, where force and moment are zero, back to the root, which must be level. ``F`` is
    the force of the outer part; with the stretch ``1 + F.t/EA`` of the rod,
    ``r' = (1 + F.t/EA) t``, ``theta' = M/EI``, ``M' = -r' x F``, ``F' = -p n`` per length.
    """

    def rate(_, y):
        along = np.array([np.cos(y[2]), np.sin(y[2])])
        way = along * (1 + y[4:] @ along / EA)
        size = np.linalg.norm(way) if per == "current" else 1.0
        across = pressure * size * np.array([-along[1], along[0]])
        return [*way, y[3] / EI, -(way[0] * y[5] - way[1] * y[4]), *-across]

    def root(turn):
        return solve_ivp(
            rate, [LENGTH, 0], [0, 0, turn, 0, 0, 0], rtol=1e-11, atol=1e-12, method="DOP853"
        ).y[:, -1]

    y = root(brentq(lambda turn: root(turn)[2], 0.1, 2.0, xtol=1e-13))
    return -y[0], -y[1], y[3]


@pytest.mark.slow
def test_cantilever_under_a_pressure_that_follows():
    """A tip that turns by 56 degrees converges at the fourth order, moments included.

    Half of the force to each end would be of the second, with the moment of a single element at its
    middle wrong by p l^2 / 8.
    """
    x, z, moment = elastica(PRESSURE, "current")
    errors = []
    for n in (2, 4, 8):
        structure, phase = cantilever(n)
        solution = jc.solve(structure, [phase], TIGHT)
        assert int(solution.status) == 0
        tip, force = np.asarray(solution.positions[-1]), np.asarray(solution.section_forces[0])
        errors.append(
            [np.hypot(tip[0] - x, tip[2] - z) / LENGTH, abs(force[0, 4] + moment) / moment]
        )
    errors = np.array(errors)
    rates = np.log2(errors[:-1] / errors[1:])
    assert rates[:, 0].min() > 3.7, (errors, rates)
    assert errors[1, 1] < 1e-4 and errors[2, 1] < 1e-5  # statics on a place that is that good
    assert errors[2, 0] < 3e-5


def test_cantilever_under_a_pressure_per_unstressed_length():
    """Its resultant is larger than that on an arc by (kappa l)^2 / 24 of itself: second order."""
    x, z, _ = elastica(PRESSURE, "unstressed")
    structure, phase = cantilever(8, per="unstressed")
    solution = jc.solve(structure, [phase], TIGHT)
    assert int(solution.status) == 0
    assert np.asarray(solution.positions[-1]) == pytest.approx(
        [x, 0, z], abs=(0.7 * LENGTH / 8) ** 2 / 24 * LENGTH
    )


def ring(n=12, pressure=-2e3, radius=1.5):
    """Closed ring in the x-z plane, pressed inward, held where symmetry needs nothing."""
    angle = 2 * np.pi * np.arange(n) / n
    nodes = radius * np.column_stack([np.cos(angle), 0 * angle, np.sin(angle)])
    links = np.column_stack([np.arange(n), (np.arange(n) + 1) % n])
    section = jc.Section.rectangle(0.04, 0.06, jc.Elastic(1e10))
    mask = np.zeros((n, 6), bool)
    mask[:, [1, 3, 5]] = True
    mask[0, [0, 2]] = mask[n // 2, 2] = True
    structure = jc.Structure(
        nodes, jc.Beams(links, section=section, up=(0.0, 1.0, 0.0)), jc.Supports(mask)
    )
    return structure, jc.Phase(loads=jc.CablePressure(-pressure, UP))


def test_ring_under_pressure():
    """N = -p R cos(pi/n) in the middles of chords, exactly: half a ring between two of them.

    And it bends the chords: between their ends and middles the moment differs by p c^2 / 8.
    """
    n, pressure = 12, 2e3  # 70 % of 3 EI / R^3
    structure, phase = ring(n, -pressure)
    solution = jc.solve(structure, [phase], TIGHT)
    assert int(solution.status) == 0
    places = np.asarray(solution.positions)
    radius = np.linalg.norm(places - places.mean(axis=0), axis=1)
    assert np.ptp(radius) < 1e-11 * radius[0] and radius[0] < 1.5 - 1e-4  # shrunk by p R^2 / EA
    forces = np.asarray(solution.section_forces)
    expected = -pressure * radius[0] * np.cos(np.pi / n)
    assert forces[:, 1, 0] == pytest.approx(expected, rel=1e-10)
    chord = 2 * radius[0] * np.sin(np.pi / n)
    bent = forces[:, 1, 4:] - forces[:, 0, 4:]
    # the normal force on the bow of a chord, p c^4 / 384 EI, is 1.4 % of that
    assert np.abs(bent).max(axis=1) == pytest.approx(pressure * chord**2 / 8, rel=0.02)
    assert np.abs(np.asarray(solution.reactions)).max() < 1e-8 * pressure


def system_at(structure, phase):
    """The system at the end of a phase of frames, and a point a little out of place."""
    task = prepare(structure, phase, jc.Newton(linear_solver="dense"), None)

    @jax.jit
    def built(thawed):
        nodes, groups, carry, schedule = ready(fill(thawed, task.arrays), task.bundles)
        system = Ramp.build(nodes, groups, carry, schedule.phase(0)).at(1.0)
        step = 0.1 * np.random.default_rng(0).normal(size=len(system.freedoms.free))
        return system, system.move(system.place(carry.motion), jnp.asarray(step))

    return built(task.thawed)


@pytest.mark.parametrize(
    ("per", "held", "symmetric"),
    [
        ("current", (0, 3), True),
        pytest.param("current", (0,), False, marks=pytest.mark.slow),
        pytest.param("unstressed", (0, 3), False, marks=pytest.mark.slow),
    ],
)
def test_tangent_is_the_jacobian_and_symmetric_where_there_is_a_potential(per, held, symmetric):
    """Across an axis that is not that of any bending; far from equilibrium."""
    x = np.linspace(0, 4, 4)
    nodes = np.column_stack([x, 0 * x, 0.2 * x * (4 - x)])
    section = jc.Section.rectangle(0.05, 0.08, jc.Elastic(1e8))
    beams = jc.Beams([[0, 1], [1, 2], [2, 3]], section=section)
    structure = jc.Structure(nodes, beams, jc.clamped(held))
    phase = jc.Phase(loads=jc.CablePressure(50.0, (0.3, -1.0, 0.2), per=per))
    system, point = system_at(structure, phase)

    @jax.jit
    def tangents(system, point):
        """Of all, as the Jacobian of the residual, and without the load."""
        residual, zero, _ = system.chart(point)
        unpressed = [copy(state, pressed=None) for state in system.states]
        bare = copy(system, followers=None, states=unpressed)
        return system.tangent(point), jax.jacfwd(residual)(zero), bare.tangent(point)

    tangent, jacobian, dead = map(np.asarray, tangents(system, point))
    assert np.abs(tangent - jacobian).max() < 1e-13 * np.abs(jacobian).max()
    load = np.abs(tangent - dead).max()
    apart = np.abs(tangent - tangent.T).max() / load
    assert apart < 1e-12 if symmetric else apart > 0.01  # eps of the beams over that of the load


@pytest.mark.slow
def test_gradient():
    """Taylor test of the tip by pressures of the elements, and its corrupted control."""
    structure, _ = cantilever(3)

    @jax.jit
    def tip(pressure):
        load = jc.CablePressure(pressure, UP)
        return jc.solve(structure, [jc.Phase(loads=load)], TIGHT).positions[-1, 2]

    start = jnp.array([0.4, 0.5, 0.6]) * PRESSURE
    gradient = jax.grad(tip)(start)
    assert 1.9 < slope(tip, start, gradient) < 2.1
    assert slope(tip, start, 1.01 * gradient) < 1.2


def test_what_cannot_be_pressed():
    hanging = jc.Catenaries([[0, 1]], axial_stiffness=1e5)
    structure = jc.Structure([[0.0, 0, 0], [1, 0, 0]], hanging, jc.pinned([0, 1]))
    with pytest.raises(ValueError, match="only cables and bars of two nodes, and beams"):
        jc.solve(structure, [jc.Phase(loads=jc.CablePressure(1.0, UP))])
