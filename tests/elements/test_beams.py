"""Beams against closed forms, an independent energy and an independent boundary value solver."""

import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import beam, pieces
from oracles.convergence import converged
from oracles.traced import traced
from scenes.frames import in_plane
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

import jaxcable as jc
from jaxcable.common.tree import copy_with
from jaxcable.elements import AxialState
from jaxcable.elements.prestress import single_element

STEEL = jc.Elastic(210e9)
BOX = jc.Section.rectangle(0.05, 0.05, STEEL, (10, 10))
EA, EI = float(BOX.stiffness()[0, 0]), float(BOX.stiffness()[1, 1])
RNG = np.random.default_rng(5)


# --- one element


def one_beam(section=BOX, **options):
    ends = jnp.asarray([[0.3, -0.2, 0.5], [1.1, 0.4, 0.9]])
    group = single_element(jc.Beams([[0, 1]], section=section, **options), {})
    length = jnp.linalg.norm(ends[1] - ends[0])
    return group, AxialState(length, jnp.zeros(())), ends


def test_a_rigid_motion_of_any_size_gives_no_force():
    group, state, ends = one_beam()
    forces = traced(lambda *at: (group.end_forces(*at), group.tension(*at)))
    for degrees in [10, 90, 180, 359, 725] * 5:
        axis = RNG.normal(size=3)
        turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis))
        shift = RNG.normal(size=3)
        moved = turn.apply(np.array(ends)) + shift - np.array(ends)
        motion = np.column_stack([moved, np.tile(np.roll(turn.as_quat(), 1), (2, 1))])
        # displacements of order 3 m: a strain of eps 3 m / 1 m is what rounding leaves of EA
        for found in forces(state, ends, jnp.asarray(motion)):
            assert jnp.abs(found).max() < 20 * 2.2e-16 * EA


def independent_energy(ends, u, turns, section_stiffness, torsion, up):
    """Energy of one element with SciPy's rotations: mean by half the rotation between the ends."""
    chord = ends[1] - ends[0]
    length0 = np.linalg.norm(chord)
    e1 = chord / length0
    e3 = up - (up @ e1) * e1
    e3 /= np.linalg.norm(e3)
    axes = np.stack([e1, np.cross(e3, e1), e3])
    now = chord + u[1] - u[0]
    length = np.linalg.norm(now)
    half = Rotation.from_rotvec(0.5 * (turns[1] * turns[0].inv()).as_rotvec())
    mean = half * turns[0]
    a, b = mean.apply(e1), now / length
    axis = np.cross(a, b)
    angle = np.arctan2(np.linalg.norm(axis), a @ b)
    align = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    frame = align * mean
    first, second = (axes @ (frame.inv() * turn).as_rotvec() for turn in turns)
    shortening = (
        sum(2 * p**2 - p * q + 2 * q**2 for p, q in zip(first[1:], second[1:], strict=True)) / 30
    )
    e0 = (length - length0) / length0 + shortening
    ea, eiy, eiz = np.diag(section_stiffness)
    bending = sum(
        ei * 2 / length0 * (p**2 + p * q + q**2)
        for ei, p, q in zip((eiy, eiz), first[1:], second[1:], strict=True)
    )
    return (
        0.5 * ea * length0 * e0**2 + bending + 0.5 * torsion / length0 * (second[0] - first[0]) ** 2
    )


def test_end_forces_are_differences_of_an_independent_energy():
    up = np.array([0.2, -0.5, 1.0])
    soft = jc.Section.rectangle(0.3, 0.2, jc.Elastic(1e3), (4, 4))
    group, state, ends = one_beam(soft, up=up, torsional_stiffness=0.7)
    group = copy_with(group, up=jnp.asarray(up), torsional_stiffness=jnp.asarray(0.7))
    rigid = Rotation.from_rotvec([2.0, 1.0, -1.5])
    u = rigid.apply(np.array(ends)) - np.array(ends) + 0.05 * RNG.normal(size=(2, 3))
    turns = [Rotation.from_rotvec(0.1 * RNG.normal(size=3)) * rigid for _ in (0, 1)]
    motion = np.column_stack([u, [np.roll(turn.as_quat(), 1) for turn in turns]])
    forces = np.asarray(group.end_forces(state, ends, jnp.asarray(motion)))
    stiffness = np.asarray(soft.stiffness())

    def energy(step):
        moved = u + step[:, :3]
        spun = [
            Rotation.from_rotvec(spin) * turn for spin, turn in zip(step[:, 3:], turns, strict=True)
        ]
        return independent_energy(np.array(ends), moved, spun, stiffness, 0.7, up)

    h = 1e-5
    steps = h * np.eye(12).reshape(12, 2, 6)
    difference = np.array([(energy(s) - energy(-s)) / (2 * h) for s in steps]).reshape(2, 6)
    # truncation h^2 and rounding eps E/h are both near 1e-9 of forces of order 10
    assert np.abs(forces - difference).max() < 1e-7 * np.abs(forces).max()


# --- large bending


def test_a_cantilever_bends_into_a_half_circle():
    errors = []
    for n in (5, 10, 20):
        load = jc.NodalLoads([n], (0, 0, 0.0), moments=(0, -np.pi * EI, 0))
        solution = converged(jc.solve(beam(n, BOX), [jc.Phase(loads=load, increments=5)]))
        tip = np.asarray(solution.positions)[n]
        errors.append(np.linalg.norm(tip - [0, 0, 2 / np.pi]))
        assert np.abs(np.asarray(solution.rotation)[n]).argmax() == 2  # half a turn about y
    assert errors[0] < 6e-5 and errors[2] < 3e-7
    # chord frames alone are of order 2; the shortening of the bent axis makes it 4 here
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx([4, 4], abs=0.1)


def test_45_degree_bend():
    """Bathe and Bolourchi's bend of radius 100, 1 x 1, E 1e7, G 5e6, J = 1/6."""
    n, exact = 8, np.array([47.150, 15.685, 53.475])  # geometrically exact rod, to 3 decimals
    angle = np.linspace(0, np.pi / 4, n + 1)
    nodes = 100 * np.column_stack([np.sin(angle), 1 - np.cos(angle), 0 * angle])
    # four fibres with exactly I = 1/12: at the places of a two-point Gauss rule
    g = 0.5 / np.sqrt(3)
    section = jc.Section([-g, g, g, -g], [-g, -g, g, g], [0.25] * 4, jc.Elastic(1e7))
    group = jc.Beams(pieces(n)[1], section=section, torsional_stiffness=5e6 / 6)
    load = jc.Phase(loads=jc.NodalLoads([n], (0, 0, 600.0)), increments=6)
    solution = converged(jc.solve(jc.Structure(nodes, group, jc.clamped([0])), load))
    error = np.linalg.norm(np.asarray(solution.positions)[n] - exact)
    assert error < 1e-3 * np.linalg.norm(exact)  # straight elements on a curved axis


def rod_reaction(half_span, rise, ea, ei, pushes):
    """Force that pushes a toggle of two clamped rods down: half of it as a boundary value problem.

    Planar extensible rod: x' = (1+e) cos t, z' = (1+e) sin t, t' = M/EI,
    M' = (1+e)(H sin t - V cos t) with axial strain e = (H cos t + V sin t)/EA; clamped below,
    without rotation at the apex.
    """
    length = np.hypot(half_span, rise)
    slope = np.arctan2(rise, half_span)
    s = np.linspace(0, length, 81)
    force = np.zeros(2)
    y = np.stack([s * np.cos(slope), s * np.sin(slope), 0 * s + slope, 0 * s])
    out = []
    for push in pushes:

        def rates(s, y, p):
            cos, sin = np.cos(y[2]), np.sin(y[2])
            stretch = 1 + (p[0] * cos + p[1] * sin) / ea
            moment = stretch * (p[0] * sin - p[1] * cos)
            return np.stack([stretch * cos, stretch * sin, y[3] / ei, moment])

        def ends(a, b, p, push=push):
            below = [a[0], a[1], a[2] - slope]
            return np.array([*below, b[0] - half_span, b[1] - rise + push, b[2] - slope])

        found = solve_bvp(rates, ends, s, y, p=force, tol=1e-8)
        assert found.success
        s, y, force = found.x, found.y, found.p
        out.append(-2 * force[1])
    return np.array(out)


def test_a_toggle_is_pushed_through_its_limit_point():
    half_span, rise, n, steps = 12.943, 0.386, 8, 14  # Williams (1964), inches and pounds
    x = np.linspace(-half_span, half_span, 2 * n + 1)
    nodes = np.column_stack([x, 0 * x, rise * (1 - np.abs(x) / half_span)])
    section = jc.Section.rectangle(0.753, 0.243, jc.Elastic(1.03e7), (1, 40))
    ends = in_plane(2 * n + 1, clamped=(0, 2 * n))
    supports = ends + jc.pinned([n])
    structure = jc.Structure(nodes, jc.Beams(pieces(2 * n)[1], section=section), supports)

    @traced
    def force(depth):
        move = jc.SupportMovement([n], jnp.stack([0 * depth, 0 * depth, -depth]))
        end = jc.solve(structure, [jc.Phase(loads=move)])
        return end.reactions[n, 2], end.status

    pushes = 0.7 * np.arange(1, steps + 1) / steps
    mine, codes = zip(*(force(depth) for depth in pushes), strict=True)
    assert not any(codes)
    stiffness = section.stiffness()
    peer = rod_reaction(half_span, rise, float(stiffness[0, 0]), float(stiffness[1, 1]), pushes)
    change = np.diff(-np.array(mine))
    assert change[0] > 0 and (change < 0).any() and change[-1] > 0  # up, through the limit, up
    # 8 elements a side; the error is of the elements' shallow local strain
    assert np.abs(-np.array(mine) - peer).max() < 2e-3 * np.abs(peer).max()


# --- loads, hinges, mixed structures


MIXED = jc.Structure(
    np.array([[0, 0, 0], [0, 0, 1.0], [0, 0, 2.0], [2.0, 0, 0], [-1.0, 1.7, 0], [-1.0, -1.7, 0]]),
    {
        "mast": jc.Beams([[0, 1], [1, 2]], section=BOX),
        "guys": jc.Cables([[3, 2], [4, 2], [5, 2]], axial_stiffness=1e6),
    },
    jc.clamped([0]) + jc.pinned([3, 4, 5]),
)


def test_a_scalar_prestress_is_for_cables_and_bars():
    """Beams beside them are left out; a temperature finds those that expand."""
    guys, mast = jc.Phase(pretension=1e4).inputs(MIXED)  # in the order of the keys
    assert mast == {} and guys["pretension"].values.tolist() == [1e4] * 3
    (alone,) = jc.Phase(pretension=1e4).inputs(beam(2, BOX))
    assert alone["pretension"].values.tolist() == [1e4] * 2
    warm = jc.replace(
        MIXED,
        elements={name: jc.replace(g, expansion=1e-5) for name, g in MIXED.elements.items()},
    )
    assert all("temperature" in inputs for inputs in jc.Phase(temperature=5.0).inputs(warm))
    one = jc.replace(warm, elements=warm.elements | {"mast": MIXED.elements["mast"]})
    guys, mast = jc.Phase(temperature=5.0).inputs(one)
    assert mast == {} and "temperature" in guys
    mast, guys = jc.Phase(pretension={"mast": 1.0, "guys": None}).inputs(MIXED)[::-1]
    assert guys == {} and mast["pretension"].values.tolist() == [1.0, 1.0]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:node .* has moved")  # with its support
def test_moved_and_turned_support():
    """A clamp that is turned by 90 degrees takes the whole cantilever along, and its joint."""
    joint = {"hinges": np.array([[False, False], [True, False]]), "springs": 1e3}
    turn = jc.SupportMovement([0], (0.1, 0.2, 0.3), rotations=(0.0, 0.0, np.pi / 2))
    solution = converged(jc.solve(beam(2, BOX, **joint), [jc.Phase(loads=turn, increments=3)]))
    assert np.abs(np.asarray(solution.positions)[2] - [0.1, 1.2, 0.3]).max() < 1e-12
    assert np.abs(np.asarray(solution.tension)).max() < 1e-12 * EA  # a strain of 1e-12
