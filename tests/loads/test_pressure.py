"""Pressure that follows cables, faces and beams: arcs, volumes, a ring, an elastica, tangents."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import at_rest, beam, pieces
from oracles.convergence import converged
from oracles.taylor import TIGHT
from oracles.traced import traced
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.sparse.csgraph import connected_components

import jaxcable as jc
from jaxcable.analysis.preparation import complete_input, prepare
from jaxcable.common.tree import copy_with, merge_indices
from jaxcable.mechanics.load_ramp import LoadRamp

AXIS = (0.0, -1.0, 0.0)  # what runs along x is pressed up, along axis x d


def chain(n, first=0):
    return first + pieces(n)[1]


def bow(n, y=0.0):
    """Nodes [n + 1, 3] on a parabola over 4 m."""
    x = np.linspace(0, 4, n + 1)
    return np.column_stack([x, 0 * x + y, 0.2 * x * (4 - x)])


# --- cables


def arch(n):
    """Cable of n elements along x between two points 4 m apart, longer than that, on a parabola."""
    edge = jc.Cables(chain(n), axial_stiffness=1e5, rest_length=4.8 / n)
    held = jc.pinned([0, n]) + jc.restrained(range(1, n), "y")
    return jc.Structure(bow(n), {"edge": edge}, held)


def test_a_pressed_cable_is_a_circular_arc():
    """n equal chords c of a circle of radius r, turning by phi: T = p r cos(phi/2).

    At a node 2 T sin(phi/2) balances half of the pressure on both chords, p c cos(phi/2), with
    c = 2 r sin(phi/2): the polygon is exact, not only its limit.
    """
    n = 8
    phase = jc.Phase(loads=jc.CablePressure(100.0, AXIS, on="edge"))
    solution = converged(jc.solve(arch(n), phase, TIGHT))
    places, tension = np.asarray(solution.positions), np.asarray(solution.tension["edge"])
    chord = 4.8 / n * (1 + tension[0] / 1e5)
    assert np.ptp(tension) < 1e-11 * tension.max()
    # the span of the arc, 2 r sin(n phi / 2) = 4, fixes phi
    low, high = 1e-6, 2 * np.pi / n
    for _ in range(100):
        phi = 0.5 * (low + high)
        radius = chord / (2 * np.sin(phi / 2))
        low, high = (phi, high) if 2 * radius * np.sin(n * phi / 2) > 4 else (low, phi)
    centre = np.array([2.0, 0, -radius * np.cos(n * phi / 2)])
    assert np.linalg.norm(places - centre, axis=1) == pytest.approx(radius, rel=1e-11)
    assert tension == pytest.approx(100 * radius * np.cos(phi / 2), rel=1e-11)
    # on the whole cable it pushes like on its chord: p (axis x chord)
    assert np.asarray(solution.load.sum(0)) == pytest.approx([0, 0, 400.0], abs=1e-10)
    assert np.asarray(solution.reactions.sum(0)) == pytest.approx([0, 0, -400.0], abs=1e-9)


@pytest.mark.parametrize("per", ["current", "unstressed"])
def test_each_end_gets_half_of_the_pressure_on_its_element(per):
    """On the chord as it is, or on the unstressed length, across axis and chord."""
    structure = arch(2)
    load = jc.CablePressure(30.0, AXIS, on="edge", per=per).with_group_indices(structure)
    groups, states, nodes = at_rest(structure)
    moved = nodes + jnp.array([[0.0, 0, 0], [0.3, 0, 0.5], [0, 0, 0]])
    across = np.cross(AXIS, np.diff(np.asarray(moved), axis=0))
    if per == "unstressed":
        across *= 2.4 / np.linalg.norm(across, axis=1)[:, None]
    force = load.following_forces(groups, states, nodes, moved)
    expected = 15.0 * np.array([across[0], across[0] + across[1], across[1]])
    np.testing.assert_allclose(force, expected, rtol=1e-14)


# --- faces


def volume(places, faces):
    """Volume between faces (quadrilaterals: the bilinear surface) and the plane z = 0."""
    total = 0.0
    t, w = np.polynomial.legendre.leggauss(3)
    t, w = 0.5 * (t + 1), 0.5 * w
    for face in faces:
        x = places[list(face)]
        if len(face) == 3 or face[2] == face[3]:
            a, b, c = x[:3]
            total += np.cross(b - a, c - a)[2] / 2 * (a + b + c)[2] / 3
            continue
        for s, ws in zip(t, w, strict=True):
            for r, wr in zip(t, w, strict=True):
                along = (1 - r) * (x[1] - x[0]) + r * (x[2] - x[3])
                across = (1 - s) * (x[3] - x[0]) + s * (x[2] - x[1])
                place = (1 - s) * ((1 - r) * x[0] + r * x[3]) + s * ((1 - r) * x[1] + r * x[2])
                total += ws * wr * np.cross(along, across)[2] * place[2]
    return total


@functools.lru_cache
def saddle():
    structure, _ = jc.scenes.saddle(3, 3, spacing=1.0, rise=0.3)
    return structure, jc.net_faces(structure.nodes, structure.elements.links, border="ends")


def test_face_pressure_is_the_derivative_of_the_volume():
    """Inside a net of triangles and quadrilaterals: p dV/dx, V integrated by Gauss's rule."""
    structure, faces = saddle()
    places = np.asarray(structure.nodes)
    places = places + 0.1 * np.random.default_rng(3).normal(size=places.shape)
    load = jc.FacePressure(faces, 2.0)
    load = copy_with(load, faces=load.faces.array)
    force = np.asarray(load.following_forces([], [], None, jnp.asarray(places)))
    h = 1e-5
    for node in np.flatnonzero(~structure.supports.fixed(structure.n_node)[:, 0]):
        for k in range(3):
            step = np.zeros_like(places)
            step[node, k] = h
            rate = (volume(places + step, faces) - volume(places - step, faces)) / (2 * h)
            # V is cubic: h^2 and eps V / h
            assert force[node, k] == pytest.approx(2 * rate, abs=1e-9)


# --- beams

LENGTH, SIDE, MODULUS = 2.0, 0.05, 10e9
EA, EI = MODULUS * SIDE**2, MODULUS * SIDE**4 / 12
PRESSURE = 6 * EI / LENGTH**3  # turns the tip by about one radian


def cantilever(n, **options):
    """Clamped at the origin, along x."""
    structure = beam(n, jc.Section.rectangle(SIDE, SIDE, jc.Elastic(MODULUS)), LENGTH)
    load = jc.CablePressure(PRESSURE, AXIS, **options)
    return converged(jc.solve(structure, jc.Phase(loads=load, increments=3), TIGHT))


@functools.lru_cache
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
    """A tip that turns by 56 degrees, of the fourth order, moments included.

    Half of the force to each end would be of the second, with the moment of a single element at its
    middle wrong by p l^2 / 8.
    """
    x, z, moment = elastica(PRESSURE, "current")
    solution = cantilever(4)
    tip, force = np.asarray(solution.positions[-1]), np.asarray(solution.section_forces[0])
    assert np.hypot(tip[0] - x, tip[2] - z) / LENGTH < 5e-4  # 3e-5 of 8 elements, times 2^4
    assert abs(force[0, 4] + moment) / moment < 1e-4  # statics on a place that is that good


@pytest.mark.slow
def test_cantilever_under_a_pressure_per_unstressed_length():
    """Its resultant is larger than that on an arc by (kappa l)^2 / 24 of itself: second order."""
    x, z, _ = elastica(PRESSURE, "unstressed")
    near = (0.7 * LENGTH / 4) ** 2 / 24 * LENGTH
    np.testing.assert_allclose(cantilever(4, per="unstressed").positions[-1], [x, 0, z], atol=near)


@pytest.mark.slow
def test_ring_under_pressure():
    """N = -p R cos(pi/n) in the middles of chords, exactly: half a ring between two of them.

    And it bends the chords: between their ends and middles the moment differs by p c^2 / 8.
    """
    n, pressure = 12, 2e3  # 70 % of 3 EI / R^3
    angle = 2 * np.pi * np.arange(n) / n
    nodes = 1.5 * np.column_stack([np.cos(angle), 0 * angle, np.sin(angle)])
    section = jc.Section.rectangle(0.04, 0.06, jc.Elastic(1e10))
    mask = np.zeros((n, 6), bool)
    mask[:, [1, 3, 5]] = True
    mask[0, [0, 2]] = mask[n // 2, 2] = True  # where symmetry needs nothing
    beams = jc.Beams(chain(n) % n, section=section, up=(0.0, 1.0, 0.0))
    structure = jc.Structure(nodes, beams, jc.Supports(mask))
    solution = jc.solve(structure, jc.Phase(loads=jc.CablePressure(pressure, AXIS)), TIGHT)
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


# --- tangents


def pressed_parts(per, pressures):
    """An arch of cables, one of beams and a net with faces, not joined to each other."""
    net = [[0.0, 8, 0], [3, 8, 0], [3, 10, 0], [0, 10, 0], [1, 9, 0.5], [2, 9, 0.4]]
    links = 8 + np.array([[0, 4], [3, 4], [4, 5], [5, 1], [5, 2]])
    faces = 8 + np.array([[0, 1, 5, 4], [1, 2, 5, 5], [2, 3, 4, 5], [3, 0, 4, 4]])
    elements = {
        "edge": jc.Cables(chain(3), axial_stiffness=1e5, rest_length=1.4),
        "rib": jc.Beams(chain(3, 4), section=jc.Section.rectangle(0.05, 0.08, jc.Elastic(1e8))),
        "skin": jc.Cables(links, axial_stiffness=1e4, rest_length=0.9),
    }
    held = jc.pinned([0, 3, *range(8, 12)]) + jc.clamped([4, 7])
    structure = jc.Structure(np.vstack([bow(3), bow(3, 4.0), net]), elements, held)
    return structure, [
        jc.CablePressure(100.0, AXIS, on="edge", per=per),
        jc.CablePressure(50.0, (0.3, -1.0, 0.2), on="rib", per=per),  # no axis of its bending
        jc.FacePressure(faces, np.array(pressures)),
    ]


@pytest.mark.parametrize(
    ("per", "pressures", "symmetric"),
    [
        ("current", [300.0] * 4, True),
        pytest.param("unstressed", [100.0, 200.0, 300.0, 250.0], False, marks=pytest.mark.slow),
    ],
)
def test_tangent_is_the_jacobian_and_symmetric_where_there_is_a_potential(
    per, pressures, symmetric
):
    """Each part between fixed ends, far from equilibrium."""
    structure, loads = pressed_parts(per, pressures)
    task = prepare(structure, jc.Phase(loads=loads), jc.Newton(linear_solver="dense"), None)

    @traced
    def tangents(without_indices):
        """Of all, as the Jacobian of the residual, and without the loads."""
        nodes, groups, restart, schedule = complete_input(
            merge_indices(without_indices, task.arrays), task.bundles
        )
        system = LoadRamp.build(nodes, groups, restart, schedule.phase(0)).system_at(1.0)
        step = 0.1 * np.random.default_rng(0).normal(size=len(system.dof_map.free))
        point = system.move(system.impose_supports(restart.motion), jnp.asarray(step))
        residual, zero, _ = system.local_residual(point)
        states = [
            copy_with(state, pressed=None) if hasattr(state, "pressed") else state
            for state in system.states
        ]
        # the pattern has places for the loads
        space = copy_with(system.space, dof_map=copy_with(system.dof_map, pattern=None))
        bare = copy_with(system, followers=None, states=states, space=space)
        return system.tangent(point), jax.jacfwd(residual)(zero), bare.tangent(point)

    tangent, jacobian, dead = (
        np.asarray(m.dense() if hasattr(m, "dense") else m) for m in tangents(task.without_indices)
    )
    assert np.abs(tangent - jacobian).max() < 1e-13 * np.abs(jacobian).max()
    count, part = connected_components(jacobian != 0)
    assert count == 3
    for k in range(count):
        own = np.ix_(part == k, part == k)
        load = np.abs(tangent - dead)[own].max()
        apart = np.abs(tangent - tangent.T)[own].max() / load
        assert load > 0 and (apart < 1e-11 if symmetric else apart > 0.01)  # eps EA/l over p


def test_a_pressure_that_is_known_to_be_zero_is_none():
    """It would make the tangent unsymmetric, and modes would be refused."""
    nodes, links = pieces(4, 10.0)
    cable = jc.Cables(links, axial_stiffness=1e6)
    structure = jc.Structure(nodes, cable, jc.pinned([0, 4]))
    found = []
    for pressure in (None, jc.CablePressure(0.0, axis=(0.0, 1.0, 0.0), per="unstressed")):
        solution = converged(jc.solve(structure, jc.Phase(pretension=1e3, loads=pressure)))
        found.append(jc.dynamics.modes(structure, solution, n=3, masses=1.0).frequency)
    assert np.array_equal(*found)
