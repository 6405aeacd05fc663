"""Linear buckling factors: struts by hand, Euler's columns, textbook matrices, SciPy's pencils."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from banks.shapes import beam, pieces
from oracles.convergence import converged
from oracles.traced import traced
from scenes.frames import in_plane, solid

import jaxcable as jc
from jaxcable.stiffness import buckling, buckling_factor

# --- a rigid strut, its top between two cables along x

HEIGHT, REACH, EA, TENSION = 2.0, 4.0, 1e6, 8e3
ALONG = 2 * (EA + TENSION) / REACH * HEIGHT  # 2 EA / L0, L0 = REACH / (1 + TENSION / EA)
ACROSS = 2 * TENSION / REACH * HEIGHT  # critical loads: lateral stiffness times height, N
STRUT = jc.Structure(
    [[0.0, 0, 0], [0.0, 0, HEIGHT], [-REACH, 0, HEIGHT], [REACH, 0, HEIGHT]],
    {
        "cables": jc.Cables([[1, 2], [1, 3]], axial_stiffness=EA, strength=1e5),
        # it shortens by 1e-8 of its height
        "strut": jc.Bars([[0, 1]], axial_stiffness=1e12, strength=1e5),
    },
    supports=jc.pinned([0, 2, 3]),
)
UNSTABLE = pytest.mark.filterwarnings("ignore::jaxcable.UnstableWarning")


def tensioned(tension=TENSION):
    return jc.solve(STRUT, jc.Phase(pretension={"cables": tension, "strut": None}))


@functools.cache
def prestressed():
    return converged(tensioned())


def pressed(load, reference=None):
    force = load * jnp.array([0.0, 0.0, -1.0])
    phase = jc.Phase(loads=jc.NodalLoads([1], force))
    solution = jc.solve(STRUT, phase, start=reference or prestressed())
    assert isinstance(solution.status, jax.core.Tracer) or int(solution.status) == 0
    return solution


@pytest.mark.slow
def test_a_strut_between_cables():
    for load in (10.0, 2e3, 7.9e3):
        found = buckling_factor(STRUT, pressed(load), prestressed(), n=2)
        # the cables, 4 m, sink with the strut by 1e-8 of its height; rounding of 10 N in 5e5 N/m
        np.testing.assert_allclose(load * found.factor, [ACROSS, ALONG], rtol=1e-6)
        np.testing.assert_allclose(found.shapes[:, 1], [[0, 1, 0], [1, 0, 0]], atol=1e-6)
        assert (np.asarray(found.shapes)[:, [0, 2, 3]] == 0).all()
        assert found.factor.shape == (2,) and found.shapes.shape == (2, 4, 3)


@UNSTABLE
def test_beyond_buckling_in_tension_and_without_a_reference():
    """Straight, though it has buckled: a factor below 1. Pulled, nothing buckles.

    Without a reference prestress grows, too: across the cables 2 N f / l stays above P f / h.
    """
    beyond, pulled = pressed(1.25 * ACROSS), pressed(-2e3)
    factor = buckling_factor(STRUT, beyond, prestressed(), n=2).factor
    np.testing.assert_allclose(factor, [0.8, ALONG / (1.25 * ACROSS)], rtol=1e-6)
    up = buckling_factor(STRUT, pulled, prestressed(), n=9).factor
    assert up.shape == (3,) and bool(jnp.isinf(up).all() & (up > 0).all())
    assert bool(jnp.isinf(buckling_factor(STRUT, prestressed(), prestressed(), n=3).factor).all())
    assert bool(jnp.isinf(buckling_factor(STRUT, pressed(2e3), n=3).factor).all())
    # neither stands: unstressed it is a mechanism across the cables
    assert bool(jnp.isnan(buckling_factor(STRUT, beyond, n=3).factor).all())


@pytest.mark.slow
def test_derivatives_by_prestress_and_load():
    """d log(f) / d log(T, P) = (1, -1) of the closed form, in a batch; see also the pencils."""

    def log_factor(p):
        reference = tensioned(TENSION * p[0])
        solution = pressed(2e3 * p[1], reference)
        found = buckling_factor(STRUT, solution, reference)
        return jnp.log(found.factor[0]) + jnp.where(solution.status == 0, 0.0, jnp.nan)

    batch = jnp.array([[1.0, 1.0], [1.0, 2.0], [1.5, 1.0]])
    value, gradient = traced(jax.vmap(jax.value_and_grad(log_factor)))(batch)
    np.testing.assert_allclose(jnp.exp(value), [4.0, 2.0, 6.0], rtol=1e-6)
    expected = np.array([1.0, -1.0]) / np.asarray(batch)
    np.testing.assert_allclose(gradient, expected, atol=1e-6)  # 2e-8: the strut shortens


@UNSTABLE
def test_reports_tell_of_buckling():
    reference, solution = prestressed(), pressed(2e3)
    plain = jc.report(STRUT, solution)
    assert not any("buckling" in line for line in plain.summary)
    note = "force / strength in compression: buckling is not checked here, see"
    assert any(own.startswith(note) for own in plain.tables["members"].notes)
    assert not any(note in own for own in jc.report(STRUT, reference).tables["members"].notes)

    def told(solution, buckling):
        return jc.report(STRUT, solution, buckling=buckling).summary[-1]

    start = "buckling: at 4 times the loads since the reference state (linear theory"
    assert told(solution, reference).startswith(start)
    moved = jc.replace(solution.last, positions=solution.positions.at[1, 0].add(HEIGHT / 10))
    leaning = told(jc.replace(solution, last=moved), reference.last)
    assert leaning.startswith(start)
    assert leaning.endswith("have rotated by up to 5.7 degrees)")  # atan 0.1
    never = "buckling: at no multiple of the loads and all forces of this state"
    assert told(solution, True).startswith(never)
    assert told(pressed(1.25 * ACROSS), True).startswith("buckling: no estimate")


def test_wrong_arguments():
    reference, solution = prestressed(), pressed(2e3)
    blown = jc.Phase(loads=jc.FacePressure([[1, 2, 0]], 1.0))
    blown = converged(jc.solve(STRUT, blown, start=reference))
    for arguments, options, said in (
        ((solution,), {"n": 0}, "n = 0: expected a whole number of at least 1"),
        ((solution, reference.phases[0]), {}, "reference: expected a Solution.*got PhaseResult"),
        ((solution.phases[0],), {}, "state: expected a Solution"),
        ((blown,), {}, "state: follower loads act on it"),
        ((solution, blown), {}, "reference: follower loads act on it"),
    ):
        with pytest.raises(ValueError, match=said):
            buckling_factor(STRUT, *arguments, **options)


# --- other struts, by hand


def by_hand(ends, force, stiffness):
    """Tangent of a bar at one end in x and z: EA / L0 along it, N / l across it, N/m."""
    length = np.linalg.norm(ends[1] - ends[0])
    along = np.outer(*[(ends[1] - ends[0])[[0, 2]] / length] * 2)
    rest = length / (1 + force / stiffness)
    return stiffness / rest * along + force / length * (np.eye(2) - along)


def lowest_root(before, after):
    """The lowest positive factor of a pencil, by SciPy's unsymmetric one (QZ)."""
    roots = scipy.linalg.eig(before, before - after, right=False)
    roots = roots[np.isfinite(roots)].real
    return roots[roots > 0].min()


def test_cables_that_went_slack_or_were_removed_since():
    """NaN where stiffness jumps in between; without a reference slack cables are left out."""
    nodes = [[0.0, 0, 0], [0, 0, 1], [3, 0, 1], [-3, 0, 1]]
    parts = {
        "cables": jc.Cables([[1, 2], [1, 3]], axial_stiffness=1e5),
        "strut": jc.Bars([[0, 1]], axial_stiffness=1e7),
    }
    supports = jc.pinned([0, 2, 3]) + jc.restrained([1], "y")
    structure = jc.Structure(nodes, parts, supports=supports)
    first = jc.solve(structure, jc.Phase(pretension={"cables": 100.0, "strut": None}))
    push = jc.NodalLoads([1], np.array([300.0, 0.0, -1e3]))
    solution = jc.solve(structure, jc.Phase(loads=push), start=first)
    assert int(first.status) == int(solution.status) == 0
    assert sorted(np.asarray(solution.tension["cables"] == 0).tolist()) == [False, True]
    assert bool(jnp.isnan(buckling_factor(structure, solution, first).factor[0]))
    factor = float(buckling_factor(structure, solution).factor[0])
    taut = int(np.argmax(solution.tension["cables"]))
    pairs = [([1, 2 + taut], "cables", taut, 1e5), ([0, 1], "strut", 0, 1e7)]
    before, after = np.zeros((2, 2, 2))
    for ends, name, k, stiffness in pairs:
        force = float(solution.tension[name][k])
        before += by_hand(np.array(nodes)[ends], 0.0, stiffness)
        after += by_hand(np.asarray(solution.positions)[ends], force, stiffness)
    assert factor == pytest.approx(lowest_root(before, after), rel=1e-9)  # condition 1e3
    # a cable that has been removed is none, as a slack one
    gone = {"cables": jc.only([1 - taut])}
    removed = converged(jc.solve(structure, jc.Phase(loads=push, removes=gone), start=first))
    assert float(buckling_factor(structure, removed).factor[0]) == pytest.approx(factor, rel=1e-9)
    assert bool(jnp.isnan(buckling_factor(structure, removed, first).factor[0]))


def mises(load, rise=0.1):
    structure, phases = jc.scenes.von_mises_truss(rise=rise, load=load)
    solution = converged(jc.solve(structure, phases))
    return solution, float(buckling_factor(structure, solution).factor[0])


def test_a_shallow_truss():
    """``K_0 / (K_0 - K)`` with K(z) = 2 EA (1/l0 - b^2/l^3); from small loads, sqrt(3) too much."""
    b, length = 1.0, np.hypot(1.0, 0.1)

    def stiffness(z):
        return 2e6 * (1 / length - b**2 / np.hypot(b, z) ** 3)

    limit = 381.087190  # closed form in the docstring of the scene
    estimates = []
    for load in (1.0, 200.0, 380.0):
        solution, factor = mises(load)
        z = float(solution.positions[1, 2])
        exact = stiffness(0.1) / (stiffness(0.1) - stiffness(z))
        assert factor == pytest.approx(exact, rel=1e-9)  # 1 N moves it by 1e-4: eps / 1e-4 / 1e-3
        estimates.append(load * factor / limit)
    assert estimates[0] > estimates[1] > estimates[2] > 1
    # the closer to buckling the better; the square root of what is missing
    assert estimates[2] < 1 + 2 * np.sqrt(1 - 380 / limit)
    _, factor = mises(1e-5, rise=0.01)
    # K'(z) at z = h gives 4/6 c h^3, the limit load is 2 / sqrt(27) c h^3; shallow to (h/b)^2
    ratio = 1e-5 * factor / (2e6 / np.sqrt(27) * 0.01**3)
    assert ratio == pytest.approx(np.sqrt(3), rel=5e-3)


# --- columns

LENGTH, EI = 4.0, 2100.0
EULER = {"free": np.pi**2 * EI / (2 * LENGTH) ** 2, "pinned": np.pi**2 * EI / LENGTH**2}


def column(n, kind, share=0.5, moment=0.0):
    """A structure and its solution under a share of Euler's load, and a moment at the top."""
    nodes, links = pieces(n, LENGTH, (0.0, 0.0, 1.0))
    # EA = 2e11 N: its shortening by 1e-9 is no part of the result
    section = solid(1.0, EI / 210e9, 210e9)
    beams = jc.Beams(links, section=section, torsional_stiffness=1e3, up=(0.0, 1.0, 0.0))
    mask = np.array(in_plane(n + 1, clamped=[0] if kind == "free" else []).mask)
    if kind == "pinned":
        mask[0, :3] = mask[n, 0] = True
    structure = jc.Structure(nodes, beams, supports=jc.Supports(mask))
    force = (0.0, 0.0, -share * EULER[kind])
    load = jc.NodalLoads([n], force, moments=(0.0, moment, 0.0))
    solution = converged(jc.solve(structure, jc.Phase(loads=load)))
    return structure, solution


def textbook(n, kind):
    """Buckling loads over Euler's by cubic elements with consistent geometric stiffness."""
    h = LENGTH / n
    bend = np.array(
        [[12, 6 * h, -12, 6 * h], [0, 4 * h * h, -6 * h, 2 * h * h], [0, 0, 12, -6 * h], [0] * 4]
    )
    bend[3, 3] = 4 * h * h
    press = np.array(
        [[36, 3 * h, -36, 3 * h], [0, 4 * h * h, -3 * h, -h * h], [0, 0, 36, -3 * h], [0] * 4]
    )
    press[3, 3] = 4 * h * h
    K, G = np.zeros((2, 2 * n + 2, 2 * n + 2))
    for e in range(n):
        at = slice(2 * e, 2 * e + 4)
        K[at, at] += EI / h**3 * (np.triu(bend) + np.triu(bend, 1).T)
        G[at, at] += (np.triu(press) + np.triu(press, 1).T) / (30 * h)
    free = np.setdiff1d(np.arange(2 * n + 2), [0, 1] if kind == "free" else [0, 2 * n])
    at = np.ix_(free, free)
    return 1 / scipy.linalg.eigh(G[at], K[at], eigvals_only=True)[::-1] / EULER[kind]


@pytest.mark.parametrize(
    ("n", "kind"),
    [(2, "free"), (2, "pinned"), pytest.param(8, "pinned", marks=pytest.mark.slow)],
)
def test_a_column_has_the_factors_of_textbook_matrices(n, kind):
    structure, solution = column(n, kind)
    found = buckling_factor(structure, solution, n=2)
    # its shortening is 1e-9; tangents by autodiff have eps EA / EI h^2 = 1e-8 at most
    np.testing.assert_allclose(0.5 * found.factor, textbook(n, kind)[:2], rtol=1e-7)
    side = np.asarray(found.shapes)[0, :, 0]
    z = np.linspace(0, LENGTH, n + 1)
    sine = 1 - np.cos(np.pi * z / 2 / LENGTH) if kind == "free" else np.sin(np.pi * z / LENGTH)
    assert np.allclose(side, sine, atol=3e-3)  # 2e-3 with two elements
    if n == 8:  # cubic fields are too stiff, at the fourth order
        assert 0 < 0.5 * found.factor[0] - 1 < 5e-5


@UNSTABLE
def test_a_column_far_beyond_and_in_tension():
    beyond = buckling_factor(*column(2, "free", 3.0), n=2).factor
    np.testing.assert_allclose(3 * beyond, textbook(2, "free")[:2], rtol=1e-7)
    assert np.isinf(buckling_factor(*column(2, "free", -1.0), n=2).factor).all()


# --- moments on nodes, in space: strips and shafts by closed forms

STRIP = (0.02, 1.0)  # m: about z 2500 times softer than about y
TORSION = 3.0e5  # GJ, N m2


def strip(n, section, moments, forks):
    """A structure along x and its states without, and with, moments at its ends, [2, 3], N m."""
    held = jc.clamped([0])
    if forks:
        held = jc.restrained([0], "xyz", "x") + jc.restrained([n], "yz", "x")
    structure = beam(n, section, LENGTH, held, torsional_stiffness=TORSION)
    load = jc.NodalLoads([0, n], np.zeros((2, 3)), moments=moments)
    states = [jc.solve(structure, jc.Phase(loads=kind)) for kind in ((), load)]
    assert [int(state.status) for state in states] == [0, 0]
    return structure, *states


def factors_of_determinant(structure, before, after):
    """Real factors f > 0 at which the unsymmetric K_ref + f (K - K_ref) is singular, by SciPy.

    And how unsymmetric K is, relative to what the load has changed.
    """
    first, second = (
        np.asarray(jc.stiffness.tangent_stiffness(structure, x)) for x in (before, after)
    )
    kappa = scipy.linalg.eigvals(second - first, first)
    real = kappa.real[(np.abs(kappa.imag) < 1e-3 * np.abs(kappa)) & (kappa.real < 0)]
    apart = np.abs(second - second.T).max() / np.abs(second - first).max()
    return np.sort(-1 / real[real < -1e-3 * np.abs(kappa).max()]), apart


@pytest.mark.slow
def test_a_strip_in_forks_buckles_sideways_under_end_moments():
    """``M = pi / L sqrt(EI GJ)`` (Timoshenko and Gere); forks make all kinds of moments agree."""
    section = jc.Section.rectangle(*STRIP, jc.Elastic(210e9))
    weak = 210e9 * STRIP[1] * STRIP[0] ** 3 / 12
    exact = np.pi / LENGTH * np.sqrt(weak * TORSION)
    errors = []
    for n in (4, 8):
        size = 1e-3 * exact
        moments = np.array([[0.0, -size, 0], [0, size, 0]])
        structure, before, after = strip(n, section, moments, forks=True)
        found = buckling_factor(structure, after, before)
        own, apart = factors_of_determinant(structure, before, after)
        assert not bool(found.semi_tangential) and apart < 1e-6
        assert float(found.factor[0]) == pytest.approx(own[0], rel=1e-6)
        errors.append(abs(float(found.factor[0]) * size / exact - 1))
        side = np.asarray(found.shapes)[0, :, 1]
        sine = np.sin(np.pi * np.linspace(0, 1, n + 1))
        assert np.abs(np.abs(side) - sine).max() < 0.02
    # fibres give EI 1e-3 less; elements converge at the second order
    assert errors[1] < 0.02 and errors[1] < 0.5 * errors[0]


@pytest.mark.slow_cases("shaft")
@pytest.mark.parametrize("kind", ["strip", "shaft"])
def test_moments_at_a_free_end_are_semi_tangential(kind):
    """A cantilever under a moment at its tip; semi-tangential moments buckle it at ``pi C / L``.

    C is ``sqrt(EI GJ)`` of a strip bent in its plane and EI of a twisted shaft (Ziegler 1968).
    Derivation: ``w' = -i k w + i k/2 w(L)`` for ``w = sqrt(EI) a + i sqrt(GJ) b`` of the rotations,
    ``w(0) = 0``, hence ``exp(-i k L) = -1``. About a fixed axis there is no w(L), and w = 0: no
    load of divergence. The determinant of the unsymmetric tangent says so, too.
    """
    if kind == "strip":
        section = jc.Section.rectangle(*STRIP, jc.Elastic(210e9))
        bend = np.sqrt(210e9 * STRIP[1] * STRIP[0] ** 3 / 12 * TORSION)
        axis = np.array([0.0, 1.0, 0.0])
    else:
        section, axis = solid(0.01, 1e-6, 210e9), np.array([1.0, 0.0, 0.0])
        bend = 210e9 * 1e-6
    exact, n = np.pi * bend / LENGTH, 8
    size = 1e-3 * exact
    structure, before, after = strip(n, section, np.array([0 * axis, size * axis]), forks=False)
    with pytest.warns(jc.InputWarning, match="semi-tangential"):
        found = buckling_factor(structure, after, before)
    assert bool(found.semi_tangential)
    own, apart = factors_of_determinant(structure, before, after)
    assert apart > 1e-3  # that of forks is below 1e-6
    assert len(own) == 0 or own.min() * size > 5 * exact
    # second order in the size of elements, and fibres
    assert float(found.factor[0]) * size == pytest.approx(exact, rel=0.02)


# --- the eigenproblem alone


def pencil(seed, stable):
    """Symmetric matrices of 8 unknowns, the first positive definite or not."""
    rng = np.random.default_rng(seed)
    basis = rng.normal(size=(8, 8)) + 3 * np.eye(8)
    before, after = rng.uniform(1, 5, 8), rng.uniform(0.5, 3, 8)
    if not stable:
        before[:2] = -1.0, 0.0
        after[2:4] = 0.3 * before[2:4]  # some that soften
    return basis @ np.diag(before) @ basis.T, basis @ np.diag(after) @ basis.T


@traced
def solve_pencil(before, after):
    return buckling._solve_buckling_problem(before, after, 3)


@pytest.mark.parametrize("stable", [True, False])
def test_the_lowest_of_all_roots(stable):
    """Against all roots of det K(f) = 0 by SciPy's unsymmetric pencil (QZ)."""
    for seed in range(5):
        before, after = pencil(seed, stable)
        factor, modes = solve_pencil(before, after)
        roots = scipy.linalg.eig(before, before - after, right=False)
        roots = np.sort(roots[np.isfinite(roots)].real)
        wanted = roots[roots > (0.0 if stable else 1.0)][:3]
        wanted = np.append(wanted, [np.inf] * (3 - len(wanted)))
        np.testing.assert_allclose(factor, wanted, rtol=1e-8)  # condition 1e3 to 1e5
        for f, mode in zip(factor, np.asarray(modes).T, strict=True):
            if np.isfinite(f):
                left = (before + float(f) * (after - before)) @ mode
                assert np.abs(left).max() < 1e-8 * np.abs(before @ mode).max() * float(f)
