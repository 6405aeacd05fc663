"""Motion in time of whole structures: chains, beams that spin, trains, friction."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.special import ellipj, ellipk, jn_zeros

import jaxcable as jc
from jaxcable.dynamics import Dashpots, transient
from jaxcable.numerics.rotations import to_matrix

pytestmark = [
    pytest.mark.slow,
    # weights are masses, chains end freely, and a beam that flies may spin about its line
    pytest.mark.filterwarnings("ignore::jaxcable.InputWarning"),
]

GRAVITY = 9.80665


def test_energy_stays_over_ten_thousand_steps():
    """Two links that go slack and taut some hundred times."""
    nodes = [[0.0, 0, 0], [0.4, 0.1, -0.9], [0.9, 0, -1.4]]
    ropes = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
    structure = jc.Structure(nodes, ropes, supports=jc.pinned([0]))
    load = jc.NodalLoads([1, 2], (0, 0, -GRAVITY))
    given = {"dt": 2e-3, "steps": 10_000, "masses": np.array([0.0, 1.0, 1.0])}
    moved = transient(structure, load, **given, scheme="energy-momentum")
    assert int(moved.status) == 0
    assert np.sum(np.diff(np.asarray(moved.tension) > 0, axis=0)) > 500
    assert_allclose(moved.energy.error, 0, atol=1e-8 * float(np.max(moved.energy.kinetic)))
    # by average acceleration noise stays bounded, too, but is far above
    moved = transient(structure, load, **given, spectral_radius=0.9)
    assert int(moved.status) == 0
    assert 1e-5 < np.abs(moved.energy.error).max() < 0.01


def test_a_hanging_chain_swings_with_the_period_of_bessel():
    """``w = j / 2 sqrt(g / L)`` with the first zero j of J0; the error falls with the links."""
    length, period = 2.0, 4 * np.pi / jn_zeros(0, 1)[0] * np.sqrt(2.0 / GRAVITY)
    errors = []
    for n in (5, 10):
        height = np.linspace(0, -length, n + 1)
        nodes = np.column_stack([0 * height, 0 * height, height])
        links = [[k, k + 1] for k in range(n)]
        chain = jc.Cables(links, axial_stiffness=1e6, weight=30.0)
        structure = jc.Structure(nodes, chain, supports=jc.pinned([0]))
        hung = jc.solve(structure, jc.Phase(loads=jc.SelfWeight()))
        assert int(hung.status) == 0
        steps = 200
        speed = np.zeros((n + 1, 3))
        found = jc.dynamics.modes(structure, hung, n=1)
        speed[:] = 0.01 * np.asarray(found.shape)[0]
        moved = transient(structure, start=hung, dt=period / steps, steps=steps, velocity=speed)
        assert int(moved.status) == 0
        way = np.abs(speed[-1]).argmax()
        tip = np.asarray(moved.displacement)[:, -1, way] * np.sign(speed[-1, way])
        k = int(np.flatnonzero((tip[:-1] > 0) & (tip[1:] <= 0))[0])  # half a period
        half = (k + tip[k] / (tip[k] - tip[k + 1])) * period / steps
        # the method lengthens periods by (w h)^2 / 12
        errors.append(2 * half / period - 1 - (2 * np.pi / steps) ** 2 / 12)
    assert abs(errors[1]) < 2e-3 and abs(errors[0]) > 3.5 * abs(errors[1])


def test_a_chain_falls_faster_than_freely():
    """A folded chain of which one end is released (Calkin, March, Am. J. Phys. 57 (1989) 154)."""
    n, length = 40, 1.0
    link = length / n
    nodes = [
        [0.0, 0, -k * link] if k <= n // 2 else [0.02, 0, (k - n) * link] for k in range(n + 1)
    ]
    masses = np.full(n + 1, link)
    masses[[0, -1]] /= 2
    chain = jc.Cables([[k, k + 1] for k in range(n)], axial_stiffness=2e3)
    structure = jc.Structure(nodes, chain, supports=jc.pinned([0]))
    weight = jc.PointMasses(range(n + 1), masses)
    moved = transient(
        *(structure, weight),
        dt=2e-4,
        steps=1900,
        masses=masses,
        scheme="energy-momentum",
        nodes=[n],
        halvings=3,
    )
    assert int(moved.status) == 0
    fallen = -np.asarray(moved.displacement)[:, 0, 2]

    def pace(root):  # of an inextensible chain, by its energy; the variable is the root of the way
        x = root**2
        return 2 * root / np.sqrt(2 * GRAVITY * x * (1 - x / (2 * length)) / (1 - x / length))

    for x in (0.5, 0.8):
        time = 2e-4 * np.argmax(fallen > x)
        chained, free = quad(pace, 1e-9, np.sqrt(x))[0], np.sqrt(2 * x / GRAVITY)
        # 40 links are 4 % slower than a chain, 80 are 1 %; a free body is 6 and 11 %
        assert chained < time < chained + 0.65 * (free - chained)


def test_a_beam_spins_freely():
    """Angular momentum, with the rotary inertia of sections, and the motion to second order."""
    n, spin = 2, np.array([3.0, 1.0, 8.0])
    place = np.column_stack([np.linspace(-1, 1, n + 1), np.zeros(n + 1), np.zeros(n + 1)])
    section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(2e11))
    beam = jc.Beams([[k, k + 1] for k in range(n)], section=section, weight=0.02 * 7850 * GRAVITY)
    tether = jc.Cables([[0, n + 1]], axial_stiffness=1e3, rest_length=50.0)  # always slack
    elements, held = {"beam": beam, "tether": tether}, jc.pinned([n + 1])
    structure = jc.Structure([*place, [5.0, 5.0, 0.0]], elements, supports=held)
    velocity = np.zeros((n + 2, 6))
    velocity[:-1] = np.concatenate([np.cross(spin, place), np.tile(spin, (n + 1, 1))], axis=1)
    mass = 0.02 * 7850 * 2.0 / n
    shares = np.zeros((n + 1, n + 1))
    for k in range(n):
        shares[k : k + 2, k : k + 2] += mass * np.eye(2) / 2
    y, z = (np.asarray(section.stiffness())[k, k] / 2e11 / 0.02 for k in (1, 2))
    rotary = mass * np.diag([y + z, y, z])

    def momentum(moved, k):
        names = "displacement", "velocity", "rotation"
        at, v, q = (np.asarray(moved.histories[name])[k] for name in names)
        levers, speeds = (at[:-1] + place)[:, None], v[None, :-1, :3]
        total = np.einsum("ab,abi->i", shares, np.cross(levers, speeds))
        for a in range(n + 1):
            turn = np.asarray(to_matrix(jnp.asarray(q[a])))
            half = 0.5 if a in (0, n) else 1.0
            total = total + turn @ (half * rotary @ (turn.T @ v[a, 3:]))
        return total

    ends, drifts = [], []
    for steps in (100, 200, 400):
        moved = transient(
            structure,
            dt=0.5 / steps,
            steps=steps,
            velocity=velocity,
            spectral_radius=0.8,  # vibrations along the beam are far faster than the steps
            histories=["displacement", "velocity", "rotation"],
        )
        assert int(moved.status) == 0
        first, last = momentum(moved, 0), momentum(moved, -1)
        drifts.append(np.abs(last - first).max() / np.linalg.norm(first))
        ends.append(np.asarray(moved.displacement)[-1])
    apart = [np.abs(a - b).max() for a, b in itertools.pairwise(ends)]
    assert_allclose(np.log2(apart[0] / apart[1]), 2, atol=0.3)
    assert drifts[2] < 1e-3 and drifts[2] < 0.35 * drifts[1]


def test_a_force_crosses_a_beam():
    """Fryba, Vibration of solids and structures under moving loads (1972), section 1.2."""
    length, n, speed, force = 10.0, 6, 20.0, 1e4
    stiff, mass = 30e9 * 0.4 * 0.8**3 / 12, 0.4 * 0.8 * 2500
    x = np.linspace(0, length, n + 1)
    section = jc.Section.rectangle(0.4, 0.8, jc.Elastic(30e9))
    beam = jc.Beams([[k, k + 1] for k in range(n)], section=section, weight=mass * GRAVITY)
    ends = jc.restrained([0], "xyz", "x") + jc.restrained([n], "yz")
    structure = jc.Structure(np.column_stack([x, 0 * x, 0 * x]), beam, supports=ends)

    def train(time):
        return jc.loads.Train(list(range(n)), speed * time, (0.0, 0.0, -force))

    steps = 300
    moved = transient(structure, train, dt=length / speed / steps, steps=steps, nodes=[n // 2])
    assert int(moved.status) == 0
    time, exact = np.asarray(moved.time), 0.0
    for j in range(1, 30):
        own, forced = (j * np.pi / length) ** 2 * np.sqrt(stiff / mass), j * np.pi * speed / length
        swing = np.sin(forced * time) - forced / own * np.sin(own * time)
        size = 2 * force / (mass * length) * np.sin(j * np.pi / 2) / (own**2 - forced**2)
        exact = exact + size * swing
    # steps of a fiftieth of the period, and the rotary inertia that the closed form leaves out
    assert_allclose(-moved.displacement[:, 0, 2], exact, atol=0.015 * exact.max())


def test_friction_dissipates_and_without_it_nothing_differs():
    nodes, held = [[0.0, 0, 0], [2.0, 0, 1.0], [4.0, 0, -1.0]], jc.pinned([0, 1])
    found = {}
    for friction in (None, 0.0, 0.1):
        kind = jc.SlidingCables if friction is None else jc.FrictionCables
        options = {} if friction is None else {"friction": friction}
        rope = kind([[0, 1, 2]], axial_stiffness=1e6, **options)
        structure = jc.Structure(nodes, rope, supports=held + jc.restrained([2], "xy"))
        weight = jc.NodalLoads([2], (0, 0, -1e3))
        before = jc.solve(structure, jc.Phase(loads=weight))
        sudden = jc.NodalLoads([2], (0, 0, -800.0))
        masses = np.array([0.0, 0.0, 100.0])
        moved = transient(structure, sudden, start=before, dt=2e-3, steps=100, masses=masses)
        assert int(before.status) == int(moved.status) == 0
        found[friction] = moved
    assert_allclose(found[0.0].displacement, found[None].displacement, atol=1e-9)
    lost = -np.asarray(found[0.1].energy.error)
    most = float(np.max(found[0.1].energy.kinetic))
    assert lost[-1] > 0.5 * most and np.diff(lost).min() > -1e-2 * most
    assert np.abs(found[0.0].energy.error).max() < 1e-5 * most  # falls with the step


def test_a_gradient_of_a_peak_by_damper_and_pretension():
    """Against central differences of motions that are iterated to rounding."""
    net, _ = jc.scenes.flat_net(load=15.0)
    masses = np.zeros(net.n_node)
    masses[[3, 4, 7, 8]] = 1.5

    def peak(p, method=None):
        begun = jc.solve(net, jc.Phase(pretension=200.0 * p[0]), method)
        load, damper = jc.NodalLoads([3], (0, 0, -40.0)), Dashpots([3], 20.0 * p[1])
        moved = transient(
            *(net, load),
            start=begun,
            dt=2e-3,
            steps=40,
            masses=masses,
            damping=damper,
            method=method,
        )
        return -moved.displacement[:, 3, 2].min()

    p, tight = jnp.ones(2), jc.Newton(tol=1e-13)
    rate = jax.grad(peak)(p)
    for k in range(2):
        step = 1e-5 * np.eye(2)[k]
        difference = (peak(p + step, tight) - peak(p - step, tight)) / 2e-5
        assert_allclose(rate[k], difference, rtol=1e-6)
    forward = jax.jvp(peak, (p,), (jnp.ones(2),))[1]
    assert_allclose(forward, rate.sum(), rtol=1e-9)


def test_a_beam_swings_as_a_physical_pendulum():
    """Second order over three halvings, about the elliptic functions of the exact swing.

    The beam is released at 2 rad, a quarter of the period before its lowest place. Its moment of
    inertia about the pin is ``m L^2 / 3`` and that of its sections, ``m h^2 / 12``.
    """
    length, depth, first = 2.0, 0.2, 2.0
    section = jc.Section.rectangle(depth, depth, jc.Elastic(1e12))  # nearly rigid
    place = length * np.array([np.sin(first), -np.cos(first)])
    nodes = [[0.0, 0.0, 0.0], [place[0], 0.0, place[1]]]
    weight = depth**2 * 7850 * GRAVITY
    beam = jc.Beams([[0, 1]], section=section, weight=weight, up=(0, 1, 0))
    structure = jc.Structure(nodes, beam, supports=jc.restrained([0], "xyz", "xz"))
    inertia = length**2 / 3 + depth**2 / 12
    pace, modulus = np.sqrt(GRAVITY * length / 2 / inertia), np.sin(first / 2) ** 2
    quarter = ellipk(modulus) / pace
    angles = {}
    for share in (1.0, 0.5):  # at the lowest place, and halfway
        sine = ellipj(ellipk(modulus) - pace * share * quarter, modulus)[0]
        angles[share] = 2 * np.arcsin(np.sqrt(modulus) * sine)
    assert abs(angles[1.0]) < 1e-12
    errors = []
    for steps in (20, 40, 80, 160):
        moved = transient(
            *(structure, jc.SelfWeight()),
            dt=quarter / steps,
            steps=steps,
            spectral_radius=0.8,
            distribution="consistent",
            nodes=[1],
        )
        assert int(moved.status) == 0
        at = np.asarray(moved.displacement)[:, 0, [0, 2]] + place
        angle = np.arctan2(at[:, 0], -at[:, 1])
        errors.append([abs(angle[k] - angles[s]) for s, k in ((0.5, steps // 2), (1.0, steps))])
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    assert_allclose(orders, 2, atol=0.1)
    assert errors[-1][1] < 3e-4  # 160 steps in a quarter of the period


def test_two_masses_on_a_rope_over_a_pulley_with_friction():
    """``a = g (m2 - m1 e) / (m2 + m1 e)``, e = exp(mu pi), of a light rope; below it sticks.

    The rope is stiff and taut at once: its vibrations die out in the first half of the motion.
    """
    friction, one, dt, steps = 0.1, 10.0, 0.005, 60
    nodes = [[-0.3, 0, -2.0], [-0.3, 0, 0.0], [0.3, 0, 0.0], [0.3, 0, -2.0]]
    rope = jc.FrictionCables([[0, 1, 2, 3]], axial_stiffness=1e7, friction=friction)
    structure = jc.Structure(nodes, rope, jc.pinned([1, 2]) + jc.restrained([0, 3], "xy"))
    ratio = np.exp(friction * np.pi)
    for other in (20.0, 13.0):
        weights = jc.PointMasses([0, 3], [one, other])
        moved = transient(
            *(structure, weights),
            dt=dt,
            steps=steps,
            masses=weights,
            spectral_radius=0.0,
            histories=["displacement", "velocity", "segment_tension"],
        )
        assert int(moved.status) == 0
        tension = np.asarray(moved.histories["segment_tension"])[-1, 0]
        way, speed = (-np.asarray(x)[:, 3, 2] for x in (moved.displacement, moved.velocity))
        lost, half = -np.asarray(moved.energy.error), steps // 2
        if other < one * ratio:
            assert abs(speed[-1]) < 1e-6 and abs(lost[-1] - lost[half]) < 1e-9
            assert_allclose(tension[[0, -1]], [one * GRAVITY, other * GRAVITY], rtol=1e-5)
            continue
        pace = GRAVITY * (other - one * ratio) / (other + one * ratio)
        assert_allclose((speed[-1] - speed[half]) / (dt * (steps - half)), pace, rtol=1e-5)
        assert_allclose(tension[0], one * (GRAVITY + pace), rtol=1e-5)
        assert_allclose(tension[-1] / tension[0], ratio, rtol=1e-9)
        # the bearing forces work on the rope that slips: the difference of the tensions
        work = one * (GRAVITY + pace) * (ratio - 1) * (way[-1] - way[half])
        assert_allclose(lost[-1] - lost[half], work, rtol=1e-5)
