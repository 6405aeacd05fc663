"""The oracle of linear frames against textbook values, and its closed forms against integration."""

import dataclasses

import numpy as np
import pytest
from oracles.stiffness_method import (
    CrackedSection,
    Member,
    local_axes,
    offset_cantilever,
    section_stiffness,
    solve_frame,
)
from scipy.integrate import quad

# Both sides are the same real number: round-off 1e-16 times the condition, at most 1e7, of frames
# of a few members with EA L2 / EI up to 1e4.
EXACT = 1e-9
SECTION = dict(EA=4e8, GJ=3e6, EIy=8e6, EIz=2e6)
X, Y, Z = np.eye(3)
BAR = dict(EA=1e6, axial=True)


def assert_near(value, expected, tolerance=EXACT):
    """Within the tolerance of the largest expected entry."""
    expected = np.asarray(expected, float)
    assert np.abs(value - expected).max() <= tolerance * np.abs(expected).max()


def held(node, kind, axes=(X, Y, Z)):
    return [(node, axis, kind) for axis in axes]


def clamp(node):
    return held(node, "translation") + held(node, "rotation")


def solved(nodes, members, supports, loaded=(), springs=()):
    """The frame under forces and moments (node, six numbers)."""
    loads = np.zeros((len(nodes), 6))
    for node, *values in loaded:
        loads[node] = values
    return solve_frame(nodes, members, supports, loads, springs)


# Closed forms -----------------------------------------------------------------------------------


CRACKED = CrackedSection(b=0.3, h=0.5, Ec=30e9, Es=200e9, As=6e-4, d=0.2)


def summed(section, e0, k):
    """(N, M) by adaptive quadrature over the height, broken at the neutral axis."""
    half = section.h / 2
    points = [-e0 / k] if k and abs(e0 / k) < half else None

    def integral(power):
        def integrand(z):
            return section.b * section.Ec * min(e0 + k * z, 0.0) * z**power

        return quad(integrand, -half, half, points=points, epsabs=1.0)[0]

    steel = [section.Es * section.As * (e0 + k * z) * np.array([1, z]) for z in (0.2, -0.2)]
    return np.array([integral(0), integral(1)]) + sum(steel)


@pytest.mark.parametrize("k", [-3e-3, 0.0, 1e-2])
def test_cracked_section(k):
    """Whole, cracked and open, against quadrature; and back from the forces to the strains."""
    for e0 in (-1e-3, -2e-4, 3e-4, 4e-3):
        N, M = summed(CRACKED, e0, k)
        # quad of linear pieces is exact: round-off of stresses up to 1e8 over the area
        assert_near(CRACKED.forces(e0, k), [N, M], 1e-12)
        # residual 1e-10 of the forces times the section's condition, 100 if cracked
        assert_near(CRACKED.strains(N, M), [e0, k], 1e-8)
    assert CRACKED.strains(0.0, 0.0) == (0, 0)


def test_cracked_cantilevers():
    """Without axial force, whole or open, and without steel: closed forms; to 1e-8 of the roots."""
    b, h, d, L = CRACKED.b, CRACKED.h, CRACKED.d, 3.0
    # transformed section of the textbooks: b x2 / 2 = n As (h - 2 x)
    nA = CRACKED.Es / CRACKED.Ec * CRACKED.As
    x = (-2 * nA + np.sqrt(4 * nA**2 + 2 * b * nA * h)) / b
    EI = CRACKED.Ec * (b * x**3 / 3 + nA * ((h / 2 + d - x) ** 2 + (h / 2 - d - x) ** 2))
    assert_near(CRACKED.strains(0.0, 5e4), 5e4 / EI * np.array([h / 2 - x, 1]), 1e-8)
    assert_near(CRACKED.tip_deflection(2e4, 0.0, L), 2e4 * L**3 / (3 * EI), 1e-8)
    # below the limit the section is linear: whole in compression, steel alone in tension
    for N, concrete in [(-4e5, True), (1e5, False)]:
        EI = CRACKED.stiffness(concrete)[1]
        P = 0.99 * CRACKED.limit(N) / L
        assert_near(CRACKED.tip_deflection(P, N, L), P * L**3 / (3 * EI), 1e-8)
        ratio = CRACKED.strains(N, 1.05 * CRACKED.limit(N))[1] * EI / (1.05 * CRACKED.limit(N))
        # 5 % beyond the limit: softer by cracking, stiffer by contact
        assert ratio > 1 + 1e-4 if concrete else ratio < 1 - 1e-4
    # eccentric compression of a rectangle: depth 3 (h/2 - M/N), curvature 2 N / (b Ec depth2)
    plain, N = dataclasses.replace(CRACKED, As=0.0), 1e6
    P = 0.4 * h * N / L  # eccentricity 0.4 h at the clamp
    whole = P * (N * h / 6 / P) ** 3 / (3 * plain.Ec * b * h**3 / 12)
    last = h / 2 - P * L / N
    cracked = h / 2 * (1 / last - 3 / h) - np.log(h / 3 / last)
    expected = whole + 2 * N / (9 * b * plain.Ec) * (N / P) ** 2 * cracked
    assert_near(plain.tip_deflection(P, -N, L), expected, 1e-8)


# A frame with all that there is -----------------------------------------------------------------


def general_frame():
    """Nodes, members, supports, loads and springs to ground."""
    rng = np.random.default_rng(3)
    nodes = np.array([[0.0, 0, 0], [0.5, 1, 3], [4, 0.3, 3.5], [4.5, -1, 0], [2, 3, 3]])
    root = rng.normal(size=(3, 3))
    D = 1e6 * (root @ root.T + np.eye(3))  # coupled, symmetric, positive
    members = [
        Member(0, 1, D=D, GJ=2e6, up=(1, 0.2, 0), load=(100, -300, -500)),
        Member(1, 2, **SECTION, joints=((np.inf, 0, 3e5), (1e5, np.inf, 0))),
        Member(3, 2, D=2 * D, GJ=1e6, up=(1, 1, 0), offsets=((0.1, 0.2, 0), (0, -0.1, -0.2))),
        Member(1, 4, **SECTION, offsets=((0, 0.1, 0.1), (0, 0, 0)), load=(0, 50, -900)),
        Member(4, 2, D=D, GJ=2e6, joints=((1e6,) * 3, (np.inf, 1e6, 0)), load=(10, 20, 30)),
        Member(4, 3, **BAR, tension=5e3, load=(5, 0, -40)),
    ]
    supports = [*clamp(0), (3, (1, 2, 3), "translation"), (3, (1, 0, 1), "rotation")]
    springs = [(3, (2, -1, 0.3), "translation", 4e5), (3, (1, 1, 1), "rotation", 2e5)]
    return nodes, members, supports, rng.normal(size=(5, 6)) * 1e3, springs


FRAME = general_frame()
FOUND = solve_frame(*FRAME)


@pytest.mark.parametrize("member", range(5))
def test_compatibility_and_signs(member):
    """The section's strains, from the internal forces, integrate to the ends' displacements.

    Between the ends of rigid arms, behind the joints' springs (moment over stiffness). Moments are
    quadratic, hence with the lever arm cubic: two Gauss points are exact.
    """
    nodes, m = FRAME[0], FRAME[1][member]
    ends, arms = [m.first, m.second], np.array(m.offsets)
    axes, L = local_axes(np.diff(nodes[ends] + arms, axis=0)[0], m.up), FOUND.lengths[member]
    u = FOUND.displacements[ends].reshape(2, 2, 3)
    u[:, 0] += np.cross(u[:, 1], arms)
    u = u.reshape(4, 3) @ axes.T
    joints, moments = np.array(m.joints), FOUND.end_forces[member].reshape(4, 3)[[1, 3]]
    u[[1, 3]] -= moments * np.divide(1, joints, out=np.zeros((2, 3)), where=joints > 0)
    assert np.abs(moments[joints == 0]).max(initial=0) <= EXACT * np.abs(moments).max()
    s = (1 + np.array([-1, 1]) / np.sqrt(3)) / 2
    forces = FOUND.internal(member, s)
    D = section_stiffness(m.EA, m.EIy, m.EIz) if m.D is None else m.D
    e0, ky, kz = np.linalg.solve(D, forces[:, [0, 4, 5]].T)
    bends = np.column_stack([forces[:, 3] / m.GJ, ky, kz])
    moved = (e0[:, None] * X + np.cross(bends, ((1 - s) * L)[:, None] * X)).mean(axis=0) * L
    # the rotation behind a released joint is not among the results, nor what it displaces
    known = (joints > 0).all(axis=0)
    if known[1:].all():
        assert_near(u[2] - u[0] - np.cross(u[1], L * X), moved)
    assert_near((u[3] - u[1])[known], L * bends.mean(axis=0)[known])
    if member == 0:  # elongation of the fibre at (y, z) is the integral of e0 + ky z - kz y
        place = np.array([0, 0.3, -0.2])
        ends = u[[0, 2]] + np.cross(u[[1, 3]], place)
        assert_near(ends[1, 0] - ends[0, 0], L * (e0 + ky * place[2] - kz * place[1]).mean())


def test_forces_along_a_member():
    """N' = -qx, V' = -q, T' = 0, My' = Vz, Mz' = -Vy: exact by differences of quadratics."""
    before, here, after = FOUND.internal(3, np.array([0.3, 0.5, 0.7]))
    change = (after - before) / (0.4 * FOUND.lengths[3])
    assert_near(change[:3], -FOUND.loads[3])
    assert_near(change[3:], [0, here[2], -here[1]])
    for m, ends in enumerate(FOUND.end_forces):
        assert_near(FOUND.internal(m, 0.0), -ends[:6])
        assert_near(FOUND.internal(m, 1.0), ends[6:])


def test_equilibrium_of_the_whole():
    """Loads, reactions and springs have no resultant; supports hold, and springs yield."""
    nodes, members, supports, loads, springs = FRAME
    u, on_nodes = FOUND.displacements.reshape(5, 2, 3), (loads + FOUND.reactions).reshape(5, 2, 3)
    for node, vector, kind in supports:
        assert abs(u[node, int(kind == "rotation")] @ vector) <= EXACT * np.abs(u).max()
    for (node, vector, kind, stiffness), force in zip(springs, FOUND.springs, strict=True):
        along, turns = np.array(vector) / np.linalg.norm(vector), int(kind == "rotation")
        assert_near(force, -stiffness * u[node, turns] @ along)
        on_nodes[node, turns] += force * along
    on_nodes = on_nodes.reshape(5, 6)
    force = on_nodes[:, :3].sum(axis=0)
    moment = (on_nodes[:, 3:] + np.cross(nodes, on_nodes[:, :3])).sum(axis=0)
    for m, length in zip(members, FOUND.lengths, strict=True):
        ends = nodes[[m.first, m.second]] + np.array(m.offsets)
        force += length * np.array(m.load)
        moment += np.cross(ends.mean(axis=0), length * np.array(m.load))
    # the tension of the axial member turns with it in the stiffness alone: its moment of
    # T / L * (transversal displacement) * L, a term of second order, is taken out
    axial = members[-1]
    along = nodes[axial.second] - nodes[axial.first]
    pull = FOUND.end_forces[-1, 6:9] @ local_axes(along, axial.up)
    moment -= np.cross(along, pull + FOUND.lengths[-1] / 2 * np.array(axial.load))
    scale = np.abs(on_nodes).max()
    assert np.abs(force).max() <= EXACT * scale
    assert np.abs(moment).max() <= EXACT * scale * np.abs(nodes).max()


# Textbook values --------------------------------------------------------------------------------


def test_axes_and_stiffness_of_a_section():
    """Right-handed for the usual beam, exactly; a rectangle off the axis by two Gauss points."""
    assert np.array_equal(local_axes([2, 0, 0], [0, 0, 1]), [X, Y, Z])
    assert np.array_equal(local_axes([0, 0, 3], [5, 0, 1]), [Z, -Y, X])
    E, b, h, y, z = 3.0, 0.2, 0.4, 0.15, -0.25
    D = np.zeros((3, 3))
    for a, c in [(-1, -1), (-1, 1), (1, -1), (1, 1)]:
        row = np.array([1, z + c * h / np.sqrt(12), -(y + a * b / np.sqrt(12))])
        D += E * b * h / 4 * np.outer(row, row)
    found = section_stiffness(E * b * h, E * b * h**3 / 12, E * h * b**3 / 12, y, z)
    assert_near(found, D, 1e-14)  # the same polynomials


@pytest.mark.parametrize("plane", [1, 2])
@pytest.mark.parametrize(
    ("kind", "start", "shear"),
    [
        ("simple", 0, 1 / 2),
        ("cantilever", -1 / 2, 1),
        ("propped", -1 / 8, 5 / 8),
        ("clamped", -1 / 12, 1 / 2),
    ],
)
def test_beam_in_a_skew_position(kind, start, shear, plane):
    """Uniform load towards -y or -z, Roark, table 8.1: Mz = M, Vy = -V; My = -M, Vz = -V."""
    nodes, up, q = np.array([[1.0, 2, 3], [3, 1, 5]]), (0.3, 0.5, 1), 700.0
    axes, L = local_axes(nodes[1] - nodes[0], up), 3.0
    member = Member(0, 1, **SECTION, up=up, load=-q * axes[plane])
    supports = [*held(0, "translation", axes), (0, axes[0], "rotation")]
    supports += held(0, "rotation", axes[1:]) if kind != "simple" else []
    supports += held(1, "translation", axes[1:]) if kind != "cantilever" else []
    supports += held(1, "rotation", axes[1:]) if kind == "clamped" else []
    s = np.linspace(0, 1, 7)
    M, V = q * L**2 * (start + shear * s - s**2 / 2), q * L * (shear - s)
    expected = np.zeros((7, 6))
    expected[:, plane] = -V
    expected[:, 6 - plane] = M if plane == 1 else -M
    found = solved(nodes, [member], supports)
    assert_near(found.internal(0, s)[:, :3], expected[:, :3])
    assert_near(found.internal(0, s)[:, 3:], expected[:, 3:])


@pytest.mark.parametrize("P, N", [(900.0, 0.0), (0.0, 5e4), (900.0, -5e4)])
def test_offset_cantilever(P, N):
    """The coupled section, the closed form and the centric member on rigid arms agree."""
    L, e = 2.5, -0.3
    D = section_stiffness(SECTION["EA"], SECTION["EIy"], SECTION["EIz"], z=e)
    u, w, slope = offset_cantilever(P, N, L, SECTION["EA"], SECTION["EIy"], e)
    arms = ((0, 0, e), (0, 0, e))
    for member in [Member(0, 1, D=D, GJ=1e6), Member(0, 1, **SECTION, offsets=arms)]:
        found = solved([[0.0, 0, 0], [L, 0, 0]], [member], clamp(0), [(1, N, 0, P, 0, 0, 0)])
        assert_near(found.displacements[1], [u, 0, w, 0, -slope, 0])


def test_axial_members():
    """Two bars at 45 degrees, a string under tension (P l / 2 T), and a bar under its weight."""
    nodes = [[-1.0, 0, 0], [1, 0, 0], [0, 0, 1]]
    members = [Member(i, 2, **BAR, up=(0, 1, 0)) for i in (0, 1)]
    supports = held(0, "translation") + held(1, "translation") + [(2, Y, "translation")]
    found = solved(nodes, members, supports, [(2, 0, 0, -500, 0, 0, 0)])
    assert_near([found.internal(m, 0.5)[0] for m in (0, 1)], [-500 / np.sqrt(2)] * 2)
    assert_near(found.displacements[2], [0, 0, -500 * np.sqrt(2) / 1e6, 0, 0, 0])
    assert_near(found.reactions[:2, :3], [[250, 0, 250], [-250, 0, 250]])

    nodes = [[0.0, 0, 0], [1.5, 0, 0], [3, 0, 0]]
    members = [Member(i, i + 1, **BAR, tension=2e3) for i in (0, 1)]
    supports = held(0, "translation") + held(2, "translation")
    found = solved(nodes, members, supports, [(1, 0, 20, -30, 0, 0, 0)])
    assert_near(found.displacements[1, :3], np.array([0, 20, -30]) * 1.5 / 4e3)
    assert_near(found.reactions[[0, 2], :3], [[-2e3, -10, 15], [2e3, -10, 15]])

    member = Member(0, 1, **BAR, up=(1, 0, 0), load=(0, 0, -50))
    supports = held(0, "translation") + held(1, "translation", (X, Y))
    found = solved([[0.0, 0, 4], [0, 0, 0]], [member], supports)
    assert_near(found.displacements[1, 2], -50 * 4**2 / 2 / 1e6)
    assert_near(found.internal(0, np.array([0, 0.25, 1]))[:, 0], [200, 150, 0])


def test_refusals():
    nodes, free = [[0.0, 0, 0], [2, 0, 0]], ((0, np.inf, np.inf),) * 2
    beam, bar = Member(0, 1, **SECTION), Member(0, 1, **BAR)
    simple = held(0, "translation") + held(1, "translation")
    for text, member, supports, loaded in (
        ("mechanism", beam, simple, []),  # free to turn about its axis
        ("torsion", dataclasses.replace(beam, joints=free), clamp(0), []),
        ("mechanism", bar, clamp(0), []),  # free sideways
        ("moment", dataclasses.replace(bar, tension=1.0), clamp(0), [(1, 0, 0, 0, 1, 0, 0)]),
        ("parallel", dataclasses.replace(beam, up=X), clamp(0), []),
    ):
        with pytest.raises(ValueError, match=text):
            solved(nodes, [member], supports, loaded)
