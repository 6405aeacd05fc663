"""The oracle of linear frames against textbook values, and its closed forms against integration."""

import dataclasses

import numpy as np
import pytest
from oracles.stiffness_method import (
    CrackedSection,
    Member,
    beam_forces,
    euler_load,
    fixed_end_moment,
    frequency,
    lateral_buckling_moment,
    local_axes,
    offset_cantilever,
    plastic_tip_deflection,
    section_stiffness,
    solve_frame,
)
from scipy.integrate import quad, solve_bvp, solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

# Both sides are the same real number: round-off 1e-16 times the condition, at most 1e7, of frames
# of a few members with EA L2 / EI up to 1e4.
EXACT = 1e-9
SECTION = dict(EA=4e8, GJ=3e6, EIy=8e6, EIz=2e6)
X, Y, Z = np.eye(3)
KINDS = ["simple", "cantilever", "propped", "clamped"]


def assert_near(value, expected, tolerance):
    """Within the tolerance of the largest expected entry."""
    expected = np.asarray(expected, float)
    assert np.abs(value - expected).max() <= tolerance * np.abs(expected).max()


def held(node, kind, axes=(X, Y, Z)):
    return [(node, axis, kind) for axis in axes]


def clamp(node):
    return held(node, "translation") + held(node, "rotation")


def no_loads(count, node=None, force=(0, 0, 0), moment=(0, 0, 0)):
    loads = np.zeros((count, 6))
    if node is not None:
        loads[node] = [*force, *moment]
    return loads


# Closed forms -----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_beam_forces_integrate(kind):
    """EI w'''' = q, M = -EI w'': tol 1e-8 of the residual leaves some 1e-7."""

    def ends(a, b):
        clamps = {"simple": (2, 2), "cantilever": (1, 3), "propped": (1, 2), "clamped": (1, 1)}
        last = [b[2], b[3]] if kind == "cantilever" else [b[0], b[clamps[kind][1]]]
        return np.array([a[0], a[clamps[kind][0]], *last])

    q, L = 3.0, 2.0
    x = np.linspace(0, L, 9)
    found = solve_bvp(
        lambda x, y: np.vstack([y[1:], np.full_like(x, q)]), ends, x, np.zeros((4, 9)), tol=1e-8
    )
    M, V = beam_forces(kind, q, L, x / L)
    assert_near(-found.sol(x)[2], M, 1e-6)
    assert_near(-found.sol(x)[3], V, 1e-6)


@pytest.mark.parametrize("N", [-35.0, -10.0, -2e-3, 0.0, 2e-3, 50.0])
def test_fixed_end_moment_integrates(N):
    """EI w'''' - N w'' = q, clamped; tol 1e-8 near the buckling load 39.5 / 35 leaves some 1e-6."""
    found = solve_bvp(
        lambda x, y: np.vstack([y[1:], 1 + N * y[2]]),
        lambda a, b: np.array([a[0], a[1], b[0], b[1]]),
        np.linspace(0, 1, 21),
        np.zeros((4, 21)),
        tol=1e-8,
    )
    assert_near(found.sol(0)[2], fixed_end_moment(1, 1, 1, N), 1e-5)


@pytest.mark.parametrize("N", [4e-3, -4e-3])
def test_fixed_end_moment_series_meets_closed_form(N):
    """At u2 = 1e-3 the closed form loses 3 digits; a wrong second term would show by 6e-9."""
    below, above = (fixed_end_moment(1, 1, 1, N * (1 + side)) for side in (-1e-12, 1e-12))
    assert_near(below, above, 1e-11)


def characteristic(A, start, end):
    """Determinant of the conditions at both ends of y' = A y, length 1."""
    return np.linalg.det(np.vstack([start, end @ expm(A)]))


def check_eigenvalue(system, value, mode):
    """`value` is a zero of the determinant, and mode - 1 lie below it."""
    below = np.array([characteristic(*system(v)) for v in np.linspace(0.01, 0.97, 300) * value])
    assert np.sum(below[1:] * below[:-1] < 0) == mode - 1
    zero = brentq(lambda v: characteristic(*system(v)), 0.97 * value, 1.03 * value, xtol=1e-14)
    assert_near(zero, value, 1e-8)  # the determinant of expm loses digits with cosh of the mode


@pytest.mark.parametrize(
    "kind", ["pinned-pinned", "clamped-free", "clamped-pinned", "clamped-clamped"]
)
def test_euler_load(kind):
    def system(P):
        A = np.eye(4, k=1)
        A[3, 2] = -P
        w, slope, moment, shear = np.eye(4)
        end = {"pinned": [w, moment], "clamped": [w, slope], "free": [moment, shear + P * slope]}
        first, last = kind.split("-")
        return A, np.array(end[first]), np.array(end[last])

    check_eigenvalue(system, euler_load(kind, 1.0, 1.0), 1)
    # dimensions: both sides one number
    assert_near(euler_load(kind, 6.0, 2.0), 1.5 * euler_load(kind, 1, 1), 1e-14)


@pytest.mark.parametrize("kind", ["pinned-pinned", "clamped-free"])
@pytest.mark.parametrize("mode", [1, 2, 3])
def test_frequency(kind, mode):
    def system(hertz):
        A = np.eye(4, k=1)
        A[3, 0] = (2 * np.pi * hertz) ** 2
        w, slope, moment, shear = np.eye(4)
        end = {"pinned": [w, moment], "clamped": [w, slope], "free": [moment, shear]}
        first, last = kind.split("-")
        return A, np.array(end[first]), np.array(end[last])

    check_eigenvalue(system, frequency(kind, mode, 1.0, 1.0, 1.0), mode)
    # dimensions: sqrt(8 / 2) / 4 = 1/2
    assert_near(frequency(kind, mode, 8.0, 2.0, 2.0), frequency(kind, mode, 1, 1, 1) / 2, 1e-14)


@pytest.mark.parametrize("ratios", [(0.3, 0.2), (0.7, 0.1)])
def test_lateral_buckling_moment(ratios):
    """A rod bent to a circle by a moment fixed in space, M' + k x M = 0 in the section's axes.

    Both ends have no moment about their own z at the critical moment, and none lower. The moment
    then lies in the x-y plane of both ends, whose forks hold the twist.
    """
    EIy, L = 5.0, 3.0
    EIz, GJ = np.array(ratios) * EIy
    stiffness = np.array([GJ, EIy, EIz])

    def last(M):
        def change(x, m):
            return np.cross(m, m / stiffness)

        path = solve_ivp(change, (0, L), [1e-6 * M, M, 0], rtol=1e-11, atol=1e-14, method="DOP853")
        return path.y[2, -1] / M

    expected = lateral_buckling_moment(EIy, EIz, GJ, L, prebuckling=True)
    lower = np.sign([last(M) for M in np.linspace(0.1, 0.97, 8) * expected])
    assert np.all(lower == lower[0])
    # the disturbance 1e-6 of M changes the moment by its square, the integration by 1e-8 of it
    assert_near(brentq(last, 0.97 * expected, 1.03 * expected, xtol=1e-12), expected, 1e-6)
    plain = lateral_buckling_moment(EIy, EIz, GJ, L)
    # the definition of the correction, round-off alone
    assert_near(plain / expected, np.sqrt((1 - ratios[0]) * (1 - ratios[1])), 1e-14)
    # as EIz, GJ << EIy the bending before buckling no longer counts: 1e-6 apart by (1e-6 + 1e-6)/2
    thin = [lateral_buckling_moment(1e6, 1.0, 1.0, 1.0, prebuckling=p) for p in (False, True)]
    assert_near(thin[0], thin[1], 2e-6)


CRACKED = CrackedSection(b=0.3, h=0.5, Ec=30e9, Es=200e9, As=6e-4, d=0.2)


def summed(section, e0, k):
    """(N, M) by adaptive quadrature over the height, broken at the neutral axis."""
    half = section.h / 2
    points = [-e0 / k] if k and abs(e0 / k) < half else None

    def stress(z):
        return section.Ec * min(e0 + k * z, 0.0)

    whole = dict(points=points, epsabs=1.0)  # exact at once for polynomials in pieces
    forces = [
        section.b * quad(lambda z, m=m: stress(z) * z**m, -half, half, **whole)[0] for m in (0, 1)
    ]
    for z in (section.d, -section.d):
        forces += section.Es * section.As * (e0 + k * z) * np.array([1, z])
    return forces


@pytest.mark.parametrize("k", [-3e-3, 0.0, 2e-3, 1e-2])
@pytest.mark.parametrize("e0", [-1e-3, -2e-4, 0.0, 3e-4, 4e-3])
def test_cracked_section(e0, k):
    if e0 == 0 == k:
        assert CRACKED.forces(0.0, 0.0) == (0, 0)
        assert CRACKED.strains(0.0, 0.0) == (0, 0)
        return
    N, M = summed(CRACKED, e0, k)
    # quad of linear pieces is exact: round-off of stresses up to 1e8 over the area
    assert_near(CRACKED.forces(e0, k), [N, M], 1e-12)
    # residual 1e-10 of the forces times the section's condition in scaled unknowns, 100 if cracked
    assert_near(CRACKED.strains(N, M), [e0, k], 1e-8)


def test_cracked_section_in_bending():
    """Transformed section of the textbooks: b x2 / 2 = n As (h - 2 x), by the quadratic formula."""
    b, h, d = CRACKED.b, CRACKED.h, CRACKED.d
    nA = CRACKED.Es / CRACKED.Ec * CRACKED.As
    x = (-2 * nA + np.sqrt(4 * nA**2 + 2 * b * nA * h)) / b
    EI = CRACKED.Ec * (b * x**3 / 3 + nA * ((h / 2 + d - x) ** 2 + (h / 2 - d - x) ** 2))
    e0, k = CRACKED.strains(0.0, 5e4)
    assert_near([e0, k], 5e4 / EI * np.array([h / 2 - x, 1]), 1e-8)  # as above
    # curvature proportional to P (L - x): quad is exact to its 1e-10, the roots to 1e-8
    assert_near(CRACKED.tip_deflection(2e4, 0.0, 3.0), 2e4 * 3**3 / (3 * EI), 1e-8)


def test_cracked_cantilever_whole_or_open():
    """Below the limit the section is linear: whole in compression, steel alone in tension."""
    L = 3.0
    for N, concrete in [(-4e5, True), (1e5, False)]:
        EI = CRACKED.stiffness(concrete)[1]
        P = 0.99 * CRACKED.limit(N) / L
        assert_near(CRACKED.tip_deflection(P, N, L), P * L**3 / (3 * EI), 1e-8)  # of the roots
        ratio = CRACKED.strains(N, 1.05 * CRACKED.limit(N))[1] * EI / (1.05 * CRACKED.limit(N))
        # 5 % beyond the limit: softer by cracking, stiffer by contact; 1e-4 is far above the roots'
        assert ratio > 1 + 1e-4 if concrete else ratio < 1 - 1e-4


def test_cracked_cantilever_without_steel():
    """Eccentric compression of a rectangle: depth 3 (h/2 - M/N), curvature 2 N / (b Ec depth2)."""
    b, h, Ec, L, N = 0.3, 0.5, 30e9, 3.0, 1e6
    plain = CrackedSection(b=b, h=h, Ec=Ec, Es=200e9, As=0.0, d=0.2)
    P = 0.4 * h * N / L  # eccentricity 0.4 h at the clamp
    whole = P * (N * h / 6 / P) ** 3 / (3 * Ec * b * h**3 / 12)
    last = h / 2 - P * L / N
    cracked = h / 2 * (1 / last - 3 / h) - np.log(h / 3 / last)
    expected = whole + 2 * N / (9 * b * Ec) * (N / P) ** 2 * cracked
    assert_near(plain.tip_deflection(P, -N, L), expected, 1e-8)  # of the roots


@pytest.mark.parametrize("p", [0.8, 1.0, 1.2, 1.45])
def test_plastic_tip_deflection(p):
    """Moment over the height and curvature along the length by quadrature and root finding."""
    L, b, h, E, strength = 2.0, 0.05, 0.1, 70e9, 2e8
    first = strength * b * h**2 / 6 / L
    k_first = 2 * strength / (E * h)

    def moment(k):
        edge = strength / (E * k)
        points = [edge] if edge < h / 2 else None
        return 2 * b * quad(lambda z: min(E * k * z, strength) * z, 0, h / 2, points=points)[0]

    def curvature(M):
        return brentq(lambda k: moment(k) - M, 1e-9 * k_first, 20 * k_first, xtol=1e-15)

    total = quad(lambda a: curvature(p * first * a) * a, 0, L, points=[min(L / p, 0.999 * L)])[0]
    # quad's 1.5e-8, each curvature to 1e-12; a break off the yield point costs some 1e-8
    assert_near(total, plastic_tip_deflection(p * first, L, b, h, E, strength), 1e-7)


def test_plastic_collapse():
    """20/9 of the deflection at first yield, from the textbooks; sqrt(round-off) = 1e-8 at it."""
    unit = dict(L=1.0, b=1.0, h=1.0, E=1.0, strength=6.0)
    yielding = plastic_tip_deflection(1.0, **unit)
    assert_near(plastic_tip_deflection(1.5, **unit), 20 / 9 * yielding, 1e-7)
    with pytest.raises(ValueError, match="collapse"):
        plastic_tip_deflection(1.51, **unit)


# Single members ---------------------------------------------------------------------------------


def test_local_axes():
    """Right-handed for the usual beam; signs and zeros are exact."""
    assert np.array_equal(local_axes([2, 0, 0], [0, 0, 1]), [X, Y, Z])
    assert np.array_equal(local_axes([0, 0, 3], [5, 0, 1]), [Z, -Y, X])
    with pytest.raises(ValueError, match="parallel"):
        local_axes([1, 1, 0], [-2, -2, 0])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("plane", [1, 2])
def test_beam_in_a_skew_position(kind, plane):
    """Uniform load towards -y or -z: Mz = M, Vy = -V; My = -M, Vz = -V."""
    nodes, up, q = np.array([[1.0, 2, 3], [3, 1, 5]]), (0.3, 0.5, 1), 700.0
    axes, L = local_axes(nodes[1] - nodes[0], up), 3.0
    member = Member(0, 1, **SECTION, up=up, load=-q * axes[plane])
    supports = [*held(0, "translation", axes), (0, axes[0], "rotation")]
    supports += held(0, "rotation", axes[1:]) if kind != "simple" else []
    supports += held(1, "translation", axes[1:]) if kind != "cantilever" else []
    supports += held(1, "rotation", axes[1:]) if kind == "clamped" else []
    s = np.linspace(0, 1, 7)
    M, V = beam_forces(kind, q, L, s)
    expected = np.zeros((7, 6))
    expected[:, plane] = -V
    expected[:, 6 - plane] = M if plane == 1 else -M
    found = solve_frame(nodes, [member], supports, no_loads(2))
    assert_near(found.internal(0, s)[:, :3], expected[:, :3], EXACT)
    assert_near(found.internal(0, s)[:, 3:], expected[:, 3:], EXACT)


def general_frame():
    """A frame with all that there is: (nodes, members, supports, loads, springs)."""
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
        Member(4, 3, EA=1e6, axial=True, tension=5e3, load=(5, 0, -40)),
    ]
    supports = [*clamp(0), (3, (1, 2, 3), "translation"), (3, (1, 0, 1), "rotation")]
    springs = [(3, (2, -1, 0.3), "translation", 4e5), (3, (1, 1, 1), "rotation", 2e5)]
    return nodes, members, supports, rng.normal(size=(5, 6)) * 1e3, springs


@pytest.mark.parametrize("member", [0, 4])
def test_compatibility_and_signs(member):
    """The section's strains, from the internal forces, integrate to the ends' displacements.

    Moments are quadratic, hence with the lever arm cubic: two Gauss points are exact. Member 4 is
    compared between its ends, behind the joints' springs (moment over stiffness).
    """
    nodes, members, supports, loads, springs = general_frame()
    found = solve_frame(nodes, members, supports, loads, springs)
    m = members[member]
    axes, L = local_axes(nodes[m.second] - nodes[m.first], m.up), found.lengths[member]
    u = found.displacements[[m.first, m.second]].reshape(4, 3) @ axes.T
    joints = np.array(m.joints)
    softness = np.divide(1, joints, out=np.zeros((2, 3)), where=joints > 0)
    u[[1, 3]] -= found.end_forces[member].reshape(4, 3)[[1, 3]] * softness
    s = (1 + np.array([-1, 1]) / np.sqrt(3)) / 2
    forces = found.internal(member, s)
    e0, ky, kz = np.linalg.solve(m.D, forces[:, [0, 4, 5]].T)
    bends = np.column_stack([forces[:, 3] / m.GJ, ky, kz])
    turned = L * bends.mean(axis=0)
    moved = (e0[:, None] * X + np.cross(bends, ((1 - s) * L)[:, None] * X)).mean(axis=0) * L
    assert_near(u[2] - u[0] - np.cross(u[1], L * X), moved, EXACT)
    known = joints[1] > 0  # the rotation behind a released joint is not among the results
    assert_near((u[3] - u[1])[known], turned[known], EXACT)
    if member == 0:  # elongation of the fibre at (y, z) is the integral of e0 + ky z - kz y
        place = np.array([0, 0.3, -0.2])
        ends = u[[0, 2]] + np.cross(u[[1, 3]], place)
        strain = e0 + ky * place[2] - kz * place[1]
        assert_near(ends[1, 0] - ends[0, 0], L * strain.mean(), EXACT)


def test_forces_along_a_member():
    """N' = -qx, V' = -q, T' = 0, My' = Vz, Mz' = -Vy: exact by differences of quadratics."""
    nodes, members, supports, loads, springs = general_frame()
    found = solve_frame(nodes, members, supports, loads, springs)
    q, L = found.loads[3], found.lengths[3]
    before, here, after = found.internal(3, np.array([0.3, 0.5, 0.7]))
    change = (after - before) / (0.4 * L)
    assert_near(change[:3], -q, EXACT)
    assert_near(change[3:], [0, here[2], -here[1]], EXACT)
    for m in range(len(members)):
        ends = found.end_forces[m]
        assert_near(found.internal(m, 0.0), -ends[:6], EXACT)
        assert_near(found.internal(m, 1.0), ends[6:], EXACT)


def test_member_in_pieces():
    """Interpolation is exact: a member in three unequal pieces gives the same."""
    nodes, members, supports, loads, springs = general_frame()
    whole = solve_frame(nodes, members, supports, loads, springs)
    cuts = nodes[0] + np.outer([0.2, 0.7], nodes[1] - nodes[0])
    pieces = [
        dataclasses.replace(members[0], first=i, second=j) for i, j in [(0, 5), (5, 6), (6, 1)]
    ]
    loads = np.vstack([loads, np.zeros((2, 6))])
    parts = solve_frame(np.vstack([nodes, cuts]), pieces + members[1:], supports, loads, springs)
    assert_near(parts.displacements[:5], whole.displacements, EXACT)
    assert_near(parts.internal(1, 0.4), whole.internal(0, 0.4), EXACT)  # 0.2 + 0.4 * 0.5


def test_section_stiffness():
    """A rectangle of 0.2 x 0.4 off the axis, quadratics over it by two Gauss points each way."""
    E, b, h, y, z = 3.0, 0.2, 0.4, 0.15, -0.25
    D = np.zeros((3, 3))
    for a in (-1, 1):
        for c in (-1, 1):
            row = np.array([1, z + c * h / np.sqrt(12), -(y + a * b / np.sqrt(12))])
            D += E * b * h / 4 * np.outer(row, row)
    found = section_stiffness(E * b * h, E * b * h**3 / 12, E * h * b**3 / 12, y, z)
    assert_near(found, D, 1e-14)  # the same polynomials


@pytest.mark.parametrize("P, N", [(900.0, 0.0), (0.0, 5e4), (900.0, -5e4)])
def test_offset_cantilever(P, N):
    """The coupled section, the closed form and the centric member on rigid arms agree."""
    L, e = 2.5, -0.3
    nodes = np.array([[0.0, 0, 0], [L, 0, 0]])
    arms = ((0, 0, e), (0, 0, e))
    D = section_stiffness(SECTION["EA"], SECTION["EIy"], SECTION["EIz"], z=e)
    loads = no_loads(2, 1, (N, 0, P))
    u, w, slope = offset_cantilever(P, N, L, SECTION["EA"], SECTION["EIy"], e)
    for member in [Member(0, 1, D=D, GJ=1e6), Member(0, 1, **SECTION, offsets=arms)]:
        found = solve_frame(nodes, [member], clamp(0), loads).displacements[1]
        assert_near(found, [u, 0, w, 0, -slope, 0], EXACT)


# Frames -----------------------------------------------------------------------------------------


def test_fork():
    """Torque in the middle between forks: T L / (4 GJ), half of the torque each side."""
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    members = [Member(0, 1, **SECTION), Member(1, 2, **SECTION)]
    supports = [(0, X, "translation")]
    for node in (0, 2):
        supports += [*held(node, "translation", (Y, Z)), (node, X, "rotation")]
    found = solve_frame(nodes, members, supports, no_loads(3, 1, moment=(800, 0, 0)))
    assert_near(found.displacements[1, 3], 800 * 2 / (4 * SECTION["GJ"]), EXACT)
    assert_near([found.internal(m, 0.5)[3] for m in (0, 1)], [400, -400], EXACT)
    assert_near(found.reactions[[0, 2], 3], [-400, -400], EXACT)


@pytest.mark.parametrize("ratio", [0.5, 3.0])
def test_portal_frame(ratio):
    """Clamped feet, P at the beam: P h/2 (3k+1)/(6k+1) below, 3k/(6k+1) above (Kleinlogel)."""
    h, l, P, EI = 3.0, 5.0, 1e4, 2e6
    nodes = np.array([[0.0, 0, 0], [0, 0, h], [l, 0, h], [l, 0, 0]])
    stiff = dict(EA=1e8 * EI, GJ=EI, EIz=EI)  # inextensible: errors of 1e-8, round-off of 1e-8
    members = [
        Member(0, 1, EIy=EI, up=(-1, 0, 0), **stiff),
        Member(1, 2, EIy=ratio * EI, **stiff),
        Member(3, 2, EIy=EI, up=(-1, 0, 0), **stiff),
    ]
    k = ratio * h / l
    found = solve_frame(nodes, members, clamp(0) + clamp(3), no_loads(4, 1, (P, 0, 0)))
    foot, corner = P * h / 2 * np.array([3 * k + 1, 3 * k]) / (6 * k + 1)
    assert_near(found.reactions[[0, 3], 4], [-foot, -foot], 1e-6)
    assert_near(found.internal(0, np.array([0, 1]))[:, 4], [foot, -corner], 1e-6)
    assert_near(found.reactions[3, [0, 2]], [-P / 2, 2 * corner / l], 1e-6)
    sway = P * h**3 / (12 * EI) * (3 * k + 2) / (6 * k + 1)
    assert_near(found.displacements[1:3, 0], [sway, sway], 1e-6)


def test_grid_with_torsion():
    """A cantilever bent by a right angle: P (a3 + b3) / 3EI + P b2 a / GJ at its tip."""
    a, b, P = 2.0, 1.5, 1e3
    nodes = np.array([[0.0, 0, 0], [a, 0, 0], [a, b, 0]])
    members = [Member(0, 1, **SECTION), Member(1, 2, **SECTION)]
    found = solve_frame(nodes, members, clamp(0), no_loads(3, 2, (0, 0, -P)))
    w = P * (a**3 + b**3) / (3 * SECTION["EIy"]) + P * b**2 * a / SECTION["GJ"]
    assert_near(found.displacements[2, 2], -w, EXACT)
    # the part beyond turns about -x by P at y = b, and about +y by P at the lever a
    assert_near(found.internal(0, 0.0), [0, 0, -P, -P * b, P * a, 0], EXACT)


def test_hinged_member():
    """Clamped beams meet in a hinge at midspan: by symmetry two cantilevers under q."""
    q, l = 2e3, 3.0
    nodes = np.array([[0.0, 0, 0], [l, 0, 0], [2 * l, 0, 0]])
    hinge = ((np.inf,) * 3, (np.inf, 0, np.inf))
    members = [
        Member(0, 1, **SECTION, joints=hinge, load=(0, 0, -q)),
        Member(1, 2, **SECTION, load=(0, 0, -q)),
    ]
    found = solve_frame(nodes, members, clamp(0) + clamp(2), no_loads(3))
    assert_near(found.displacements[1, 2], -q * l**4 / (8 * SECTION["EIy"]), EXACT)
    M, V = beam_forces("cantilever", q, l, np.array([0.0, 0.3, 1]))
    assert_near(found.internal(0, np.array([0.0, 0.3, 1]))[:, 4], -M, EXACT)
    assert_near(found.internal(0, np.array([0.0, 0.3, 1]))[:, 2], -V, EXACT)


@pytest.mark.parametrize("axis", [1, 2])
@pytest.mark.parametrize("k", [0.0, 1e5, 5e6, np.inf])
def test_rotational_spring(axis, k):
    """Between simple and propped: end moment q L2/8 / (1 + 3EI / (k L))."""
    q, L = 2e3, 4.0
    EI = SECTION["EIy" if axis == 1 else "EIz"]
    joint = np.full(3, np.inf)
    joint[axis] = k
    load = -q * (Z if axis == 1 else Y)
    for first, second in [(0, 1), (1, 0)]:  # the spring at the first or the second end
        joints = (joint, (np.inf,) * 3) if first == 0 else ((np.inf,) * 3, joint)
        member = Member(first, second, **SECTION, joints=joints, load=load)
        supports = [*clamp(0), *held(1, "translation", (Y, Z))]
        found = solve_frame([[0.0, 0, 0], [L, 0, 0]], [member], supports, no_loads(2))
        expected = q * L**2 / 8 / (1 + 3 * EI / (k * L)) if k else 0.0
        moment = found.reactions[0, 3 + axis] * (-1 if axis == 1 else 1)
        assert abs(moment - expected) <= EXACT * q * L**2 / 8


def test_torsional_spring():
    """In series with the member: T (L / GJ + 1 / k)."""
    member = Member(0, 1, **SECTION, joints=((4e5, np.inf, np.inf), (np.inf,) * 3))
    loads = no_loads(2, 1, moment=(300, 0, 0))
    found = solve_frame([[0.0, 0, 0], [2, 0, 0]], [member], clamp(0), loads)
    assert_near(found.displacements[1, 3], 300 * (2 / SECTION["GJ"] + 1 / 4e5), EXACT)


def test_rigid_arms_are_the_limit_of_stiff_members():
    """Arms against members 1e2, 1e4 times as stiff: the difference falls as 1 / stiffness."""
    nodes = np.array([[0.0, 0, 0], [0.2, 0.1, 0.4], [3, 0.5, 1], [3.2, 0, 0.7]])
    arms = (nodes[1] - nodes[0], nodes[2] - nodes[3])
    load = (100.0, 200, -900)
    loads = no_loads(2, 1, (50, 900, -700), (300, -500, 200))
    supports = clamp(0)
    rigid = solve_frame(
        nodes[[0, 3]], [Member(0, 1, **SECTION, offsets=arms, load=load)], supports, loads
    )
    errors = []
    for factor in (1e2, 1e4):
        stiff = {name: factor * value for name, value in SECTION.items()}
        members = [
            Member(1, 2, **SECTION, load=load),
            Member(0, 1, **stiff),
            Member(3, 2, **stiff),
        ]
        all_loads = np.zeros((4, 6))
        all_loads[3] = loads[1]
        found = solve_frame(nodes, members, supports, all_loads)
        # statically determinate: equal forces, however stiff; round-off of the stiff members 1e4
        assert_near(found.end_forces[0], rigid.end_forces[0], 1e-7)
        errors.append(np.abs(found.displacements[3] - rigid.displacements[1]).max())
    assert errors[0] > 1e-3 * np.abs(rigid.displacements).max()
    assert 90 < errors[0] / errors[1] < 110  # 100, the first order in 1 / factor, within 1 / 1e2


def test_equilibrium_of_the_whole():
    """Loads, reactions and springs have no resultant force nor moment about the origin."""
    nodes, members, supports, loads, springs = general_frame()
    found = solve_frame(nodes, members, supports, loads, springs)
    on_nodes = loads + found.reactions
    for (node, vector, kind, _), force in zip(springs, found.springs, strict=True):
        start = 0 if kind == "translation" else 3
        on_nodes[node, start : start + 3] += force * np.array(vector) / np.linalg.norm(vector)
    force = on_nodes[:, :3].sum(axis=0)
    moment = (on_nodes[:, 3:] + np.cross(nodes, on_nodes[:, :3])).sum(axis=0)
    for m, length in zip(members, found.lengths, strict=True):
        ends = nodes[[m.first, m.second]] + np.array(m.offsets)
        force += length * np.array(m.load)
        moment += np.cross(ends.mean(axis=0), length * np.array(m.load))
    # the tension of the axial member turns with it in the stiffness alone: its moment of
    # T / L * (transversal displacement) * L, a term of second order, is taken out
    axial = members[-1]
    along = nodes[axial.second] - nodes[axial.first]
    pull = found.end_forces[-1, 6:9] @ local_axes(along, axial.up)
    moment -= np.cross(along, pull + found.lengths[-1] / 2 * np.array(axial.load))
    scale = np.abs(on_nodes).max()
    assert np.abs(force).max() <= EXACT * scale
    assert np.abs(moment).max() <= EXACT * scale * np.abs(nodes).max()


def test_rotated_structure():
    """Everything turned, skew supports included: vectors turn along, local forces stay."""
    nodes, members, supports, loads, springs = general_frame()
    R = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()
    still = solve_frame(nodes, members, supports, loads, springs)
    turned = solve_frame(
        nodes @ R.T,
        [
            dataclasses.replace(m, up=R @ m.up, offsets=np.array(m.offsets) @ R.T, load=R @ m.load)
            for m in members
        ],
        [(node, R @ vector, kind) for node, vector, kind in supports],
        (loads.reshape(-1, 3) @ R.T).reshape(-1, 6),
        [(node, R @ vector, kind, k) for node, vector, kind, k in springs],
    )
    for name in ("displacements", "reactions"):
        expected = (getattr(still, name).reshape(-1, 3) @ R.T).reshape(-1, 6)
        assert_near(getattr(turned, name), expected, EXACT)
    for name in ("held", "springs", "end_forces"):
        assert_near(getattr(turned, name), getattr(still, name), EXACT)


def test_reciprocity():
    """Maxwell: the displacement of j under 1 at i is that of i under 1 at j, of all free pairs."""
    nodes, members, supports, _, springs = general_frame()
    members = [dataclasses.replace(m, load=(0, 0, 0), tension=0.0) for m in members]
    columns = [
        solve_frame(nodes, members, supports, unit.reshape(5, 6), springs).displacements.ravel()
        for unit in np.eye(30)
    ]
    flexibility = np.array(columns)
    # rows of held directions are round-off, 1e-16; the stiffest of the others is about 1e-4
    assert np.linalg.matrix_rank(flexibility, rtol=1e-10) == 30 - len(supports)
    assert_near(flexibility, flexibility.T, EXACT)


def test_inclined_roller():
    """A roller at 45 degrees: half of the load upwards brings as much thrust along the beam."""
    q, L = 1e3, 4.0
    member = Member(0, 1, **SECTION, load=(0, 0, -q))
    supports = [*held(0, "translation"), (0, X, "rotation"), (0, Z, "rotation")]
    supports += [(1, Y, "translation"), (1, (-1, 0, 1), "translation")]
    found = solve_frame([[0.0, 0, 0], [L, 0, 0]], [member], supports, no_loads(2))
    assert_near(found.held[-1], q * L / np.sqrt(2), EXACT)
    assert_near(found.internal(0, 0.5), [-q * L / 2, 0, 0, 0, -q * L**2 / 8, 0], EXACT)
    shortening = q * L / 2 * L / SECTION["EA"]
    assert_near(found.displacements[1, [0, 2]], [-shortening, -shortening], EXACT)


def test_springs_to_ground():
    """A cantilever and a spring at its tip: P / (k + 3EI / L3), rotational M / (k + EI / L)."""
    member, nodes, L = Member(0, 1, **SECTION), [[0.0, 0, 0], [2, 0, 0]], 2.0
    spring = [(1, 3 * Z, "translation", 4e6)]
    found = solve_frame(nodes, [member], clamp(0), no_loads(2, 1, (0, 0, 1e4)), spring)
    w = 1e4 / (4e6 + 3 * SECTION["EIy"] / L**3)
    assert_near(found.displacements[1, 2], w, EXACT)
    assert_near(found.springs, [-4e6 * w], EXACT)
    spring = [(1, Y, "rotation", 4e6)]
    found = solve_frame(nodes, [member], clamp(0), no_loads(2, 1, moment=(0, 1e4, 0)), spring)
    assert_near(found.displacements[1, 4], 1e4 / (4e6 + SECTION["EIy"] / L), EXACT)


def test_truss():
    """Two bars at 45 degrees under P: N = -P / sqrt2, deflection P L / EA."""
    nodes = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 0, 1]])
    members = [Member(i, 2, EA=1e6, axial=True, up=(0, 1, 0)) for i in (0, 1)]
    supports = held(0, "translation") + held(1, "translation") + [(2, Y, "translation")]
    found = solve_frame(nodes, members, supports, no_loads(3, 2, (0, 0, -500)))
    assert_near([found.internal(m, 0.5)[0] for m in (0, 1)], [-500 / np.sqrt(2)] * 2, EXACT)
    assert_near(found.displacements[2], [0, 0, -500 * np.sqrt(2) / 1e6, 0, 0, 0], EXACT)
    assert_near(found.reactions[:2, :3], [[250, 0, 250], [-250, 0, 250]], EXACT)


def test_taut_string():
    """P in the middle of two strings under tension T: P l / (2 T); the supports carry T."""
    nodes = np.array([[0.0, 0, 0], [1.5, 0, 0], [3, 0, 0]])
    members = [Member(i, i + 1, EA=1e6, axial=True, tension=2e3) for i in (0, 1)]
    supports = held(0, "translation") + held(2, "translation")
    found = solve_frame(nodes, members, supports, no_loads(3, 1, (0, 20, -30)))
    assert_near(found.displacements[1, :3], np.array([0, 20, -30]) * 1.5 / 4e3, EXACT)
    assert_near(found.reactions[[0, 2], :3], [[-2e3, -10, 15], [2e3, -10, 15]], EXACT)
    assert_near(found.internal(0, 0.5)[:3], [2e3, 10, -15], EXACT)


def test_hanging_bar():
    """Own weight: N from q L at the top to 0, elongation q L2 / (2 EA); no moments."""
    member = Member(0, 1, EA=1e6, axial=True, up=(1, 0, 0), load=(0, 0, -50))
    supports = held(0, "translation") + held(1, "translation", (X, Y))
    found = solve_frame([[0.0, 0, 4], [0, 0, 0]], [member], supports, no_loads(2))
    assert_near(found.displacements[1, 2], -50 * 4**2 / 2 / 1e6, EXACT)
    assert_near(found.internal(0, np.array([0, 0.25, 1]))[:, 0], [200, 150, 0], EXACT)


def test_refusals():
    nodes, free = [[0.0, 0, 0], [2, 0, 0]], ((0, np.inf, np.inf),) * 2
    with pytest.raises(ValueError, match="mechanism"):  # simple beam free to turn about its axis
        simple = held(0, "translation") + held(1, "translation")
        solve_frame(nodes, [Member(0, 1, **SECTION)], simple, no_loads(2))
    with pytest.raises(ValueError, match="torsion"):
        solve_frame(nodes, [Member(0, 1, **SECTION, joints=free)], clamp(0), no_loads(2))
    with pytest.raises(ValueError, match="mechanism"):  # a bar without tension, free sideways
        solve_frame(nodes, [Member(0, 1, EA=1e6, axial=True)], clamp(0), no_loads(2))
    with pytest.raises(ValueError, match="moment"):
        bar = [Member(0, 1, EA=1e6, axial=True, tension=1.0)]
        solve_frame(nodes, bar, clamp(0), no_loads(2, 1, moment=(1, 0, 0)))
