"""Elastic catenaries against the integrals of their equilibrium in 60 digits, and closed forms."""

import functools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from oracles.taylor import slope

import jaxcable as jc
from jaxcable.common.tree import copy
from jaxcable.elements.hanging import hang
from jaxcable.mechanics.elementwise import each
from jaxcable.numerics.roots import rising_root

mp.mp.dps = 60
N_DRAW = 10_000


def draw(n, seed=0):
    """Spans, rises, lengths, weights and stiffnesses from slack to EA/N = 1e8."""
    rng = np.random.default_rng(seed)
    x = 10 ** rng.uniform(-8, 0, n)
    x[: n // 3] = rng.uniform(0, 1, n // 3)
    z = rng.uniform(-1, 1, n)
    z[::5] *= 10 ** rng.uniform(-12, -3, len(z[::5]))
    x[7::100], z[11::100] = 0.0, 0.0  # vertical, level
    scale = 10 ** rng.uniform(-1, 3, n) / np.hypot(x, z)
    x, z = x * scale, z * scale
    slack = 1 + 10 ** rng.uniform(-10, 3, n)
    taut = 1 / (1 + 10 ** rng.uniform(-8, -0.3, n))
    length = np.hypot(x, z) * np.choose(np.arange(n) % 3, [slack, taut, np.ones(n)])
    weight = 10 ** rng.uniform(-3, 3, n)
    stiffness = np.where(np.arange(n) % 2, weight * length, 10 ** rng.uniform(0, 6, n))
    return x, z, length, weight, stiffness * 10 ** rng.uniform(0, 10, n)


@jax.jit
def middle_force(x, z, length, weight, stiffness):
    """Tension vectors in the middle, [n, 2], mean tensions and chord over unstressed length."""
    n = len(x)
    nodes = jnp.zeros((2 * n, 3), x.dtype).at[n:, 0].set(x).at[n:, 2].set(z)
    group = jc.Catenaries(
        np.arange(2 * n).reshape(2, n).T, axial_stiffness=stiffness, rest_length=length
    )
    group = copy(group, links=group.links.array)
    state = group.start(nodes[group.links])
    state = copy(state, line_load=jnp.outer(weight, jnp.array([0.0, 0.0, -1.0], x.dtype)))
    still = jnp.zeros_like(nodes)
    force = each("end_forces", group, state, nodes, still)[:, 1]
    return force[:, ::2], each("tension", group, state, nodes, still)


def chord_of(h, v, length, weight, stiffness):
    """Chord of a hanging cable from the tension vector in its middle: Irvine's integrals."""
    low, high = v - weight * length / 2, v + weight * length / 2
    t_low, t_high = mp.hypot(h, low), mp.hypot(h, high)
    arc = (mp.asinh(high / h) - mp.asinh(low / h)) / weight if h else mp.mpf(0)
    return h * (length / stiffness + arc), v * length / stiffness + (t_high - t_low) / weight


def flexibility(h, v, length, weight, stiffness):
    """Derivatives of the chord by (h, v), and by L0, weight and EA, each times its size."""
    low, high = v - weight * length / 2, v + weight * length / 2
    t_low, t_high = mp.hypot(h, low), mp.hypot(h, high)
    arc = (mp.asinh(high / h) - mp.asinh(low / h)) / weight if h else mp.inf
    soft = length / stiffness
    by_h = soft + arc - (high / t_high - low / t_low) / weight if h else mp.inf
    by_v = soft + (high / t_high - low / t_low) / weight
    cross = h * (1 / t_high - 1 / t_low) / weight
    stretched = (h * soft, v * soft)
    own = [
        h * length / 2 * (1 / t_high + 1 / t_low) + stretched[0],
        length / 2 * (high / t_high + low / t_low) + stretched[1],
    ]
    others = mp.hypot(*own) + mp.hypot(*stretched)
    return (by_h, cross, by_v), others


@functools.cache
def drawn():
    values = draw(N_DRAW)
    force, tension = (np.asarray(v) for v in middle_force(*map(jnp.asarray, values)))
    return np.stack(values, 1), force, tension


def test_no_draw_fails():
    values, force, tension = drawn()
    assert np.isfinite(force).all() and np.isfinite(tension).all()
    assert (tension > 0).all()
    ratio = values[:, 4] / tension
    assert ratio.max() > 1e8 and ratio.min() < 1
    # at least half of the load on it hangs at the ends together
    assert (2 * tension >= values[:, 3] * values[:, 2] * (1 - 1e-14)).all()


def test_end_positions_of_ten_thousand_draws():
    """The chord that the computed forces give, in 60 digits, is the chord asked for."""
    values, force, _ = drawn()
    worst = 0
    for (x, z, length, weight, stiffness), (h, v) in zip(values, force, strict=True):
        own = [mp.mpf(a) for a in (h, v, length, weight, stiffness)]
        dx, dz = chord_of(*own)
        worst = max(worst, mp.hypot(dx - x, dz - z) / max(length, np.hypot(x, z)))
    assert worst <= 1e-13


def test_end_forces_of_ten_thousand_draws():
    """Against Newton's method on the two integrals in 60 digits, within what inputs allow."""
    values, force, _ = drawn()
    worst = 0
    for (x, z, length, weight, stiffness), (h0, v0) in zip(values, force, strict=True):
        x, z, length, weight, stiffness = map(mp.mpf, (x, z, length, weight, stiffness))
        h, v = mp.mpf(h0), mp.mpf(v0)
        for _ in range(30):
            dx, dz = chord_of(h, v, length, weight, stiffness)
            (a, b, c), others = flexibility(h, v, length, weight, stiffness)
            if not h:  # vertical: one equation
                step = 0, (z - dz) / c
                inverse = 1 / c
            else:
                det = a * c - b * b
                step = (c * (x - dx) - b * (z - dz)) / det, (a * (z - dz) - b * (x - dx)) / det
                inverse = (a + c) / det
            h, v = h + step[0], v + step[1]
            size = mp.hypot(h, abs(v) + weight * length / 2)
            if mp.hypot(*step) < mp.mpf(10) ** -30 * size:
                break
        else:
            raise AssertionError("the oracle has not converged")
        condition = inverse * (mp.hypot(x, z) + others) / size
        error = mp.hypot(h - h0, v - v0) / size
        worst = max(worst, error / max(1000, condition))
    assert worst <= 1e-13


# name: span, rise, length, weight, stiffness
REGIMES = {
    "shallow": (100.0, 5.0, 101.0, 50.0, 1e7),
    "slack": (10.0, 2.0, 30.0, 3.0, 1e8),
    "deeply slack": (1e-3, 2.0, 30.0, 3.0, 1e8),
    "nearly vertical and slack": (1e-7, 9.0, 10.0, 3.0, 1e8),
    "nearly vertical and taut": (1e-6, 10.01, 10.0, 3.0, 1e6),
    "nearly level": (10.0, 1e-9, 10.0, 3.0, 1e5),
    "taut": (30.0, 40.0, 50.0 / 1.001, 0.1, 1e6),
    "taut and stiff": (30.0, 40.0, 50.0 / (1 + 1e-8), 1e-4, 1e8),
    "heavy and soft": (10.0, 5.0, 10.0, 100.0, 50.0),
    "pulled to twice its length": (10.0, -10.0, 7.0, 1.0, 100.0),
    "at its own length": (3.0, 4.0, 5.0, 1.0, 1e6),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", REGIMES)
def test_taylor_everywhere(name):
    """By span, rise, length, weight and stiffness together; steps relative to the condition."""
    p = jnp.array(REGIMES[name])

    def value(s):
        force, tension = middle_force(*(p * (1 + s))[:, None])
        return (
            jnp.log(jnp.sum(jnp.abs(force)))
            + jnp.log(tension[0])
            + 0.1 * jnp.log(jnp.abs(force[0, 0]))
        )

    gradient = jax.jit(jax.grad(value))(jnp.zeros(5))
    assert jnp.isfinite(gradient).all()
    # directions are multiplied by max|p| = 1 there; a step moves the value by some percent
    # (by more where EA/N = 1e8 leaves it eight digits)
    start = jnp.ones(5)
    size = (100 if "stiff" in name else 20) / float(jnp.abs(gradient).max())

    def shifted(q):
        return value(q - start)

    assert slope(shifted, start, gradient, size) == pytest.approx(2, abs=0.1)
    assert slope(shifted, start, 1.05 * gradient, size) < 1.5


@pytest.mark.slow
def test_higher_derivatives():
    """The Hessian is symmetric, and the derivative of the gradient."""
    p = jnp.array(REGIMES["shallow"])

    def value(s):
        return jnp.log(middle_force(*(p * (1 + s))[:, None])[1][0])

    hessian = jax.jit(jax.hessian(value))(jnp.zeros(5))
    size = jnp.abs(hessian).max()
    assert jnp.abs(hessian - hessian.T).max() < 1e-9 * size
    h = 1e-5  # differences: h^2 of third derivatives (1e4 in places) and eps/h
    direction = jnp.array([1.0, -0.5, 0.001, 0.4, 0.7])
    gradient = jax.jit(jax.grad(value))
    differences = (gradient(h * direction) - gradient(-h * direction)) / (2 * h)
    assert jnp.abs(hessian @ direction - differences).max() < 1e-5 * size


def test_without_weight_it_is_a_straight_cable():
    rng = np.random.default_rng(2)
    x, z, length = 3 + rng.random(50), rng.random(50), 3 + rng.random(50)
    force, tension = middle_force(x, z, length, np.zeros(50), np.full(50, 1e4))
    chord = np.hypot(x, z)
    exact = 1e4 * np.maximum(chord / length - 1, 0)
    assert (exact == 0).any() and (exact > 0).any()
    assert np.abs(tension - exact).max() < 1e-11 * exact.max()
    assert (np.asarray(tension)[exact == 0] == 0).all()
    expected = (exact / chord)[:, None] * np.stack([x, z], 1)
    assert np.abs(force - expected).max() < 1e-11 * exact.max()


def test_without_load_a_scene_has_no_catenary_in_it():
    """The program of unloaded catenaries is that of cables: not one exponential."""
    structure, _ = jc.scenes.flat_net()
    texts = []
    for group in (jc.Catenaries, jc.Cables):
        elements = group(structure.elements.links, axial_stiffness=97.97e3)
        made = jc.replace(structure, elements=elements)
        phase = jc.Phase(pretension=200.0)
        texts.append(
            str(
                jax.make_jaxpr(
                    lambda t, s=made, p=phase: jc.solve(s, [jc.replace(p, pretension=t)]).tension
                )(200.0)
            )
        )
    assert "log1p" not in texts[0]
    assert texts[0].count("\n") == pytest.approx(texts[1].count("\n"), rel=0.02)


def test_single_precision():
    values = [jnp.asarray(v, jnp.float32) for v in draw(3000, seed=4)]
    exact = middle_force(*(v.astype(jnp.float64) for v in values))
    force, tension = middle_force(*values)
    assert force.dtype == jnp.float32 and bool(jnp.isfinite(force).all())
    # where the chord is not that of the taut cable, which float32 cannot tell from its length
    chord = np.hypot(values[0], values[1])
    slack = np.asarray(values[2]) > 1.01 * chord
    error = np.abs(np.asarray(tension) / np.asarray(exact[1]) - 1)
    assert error[slack].max() < 1e-4


# --- in an analysis

FOOT, POUND = 0.3048, 4.4482216152605
INCH2 = 0.0254**2


def isolated(pieces):
    """Isolated cable: catenaries (`pieces` 0), or so many straight elements a span."""
    length = np.array([412.8837, 613.0422]) * FOOT
    corners = np.array([[0.0, 0, 0], [400 * FOOT, 0, -30 * FOOT], [1000 * FOOT, 0, 0]])
    shared = {"axial_stiffness": 0.85 * 19000e3 * POUND, "weight": 3.16 * POUND / FOOT}
    if not pieces:
        group = jc.Catenaries([[0, 1], [1, 2]], rest_length=length, **shared)
        return jc.Structure(corners, group, jc.pinned([0, 2])), 1
    t = np.arange(2 * pieces + 1) / pieces
    nodes = np.stack([np.interp(t, [0, 1, 2], corners[:, k]) for k in range(3)], 1)
    links = np.column_stack([np.arange(2 * pieces), np.arange(1, 2 * pieces + 1)])
    group = jc.Cables(links, rest_length=np.repeat(length / pieces, pieces), **shared)
    return jc.Structure(nodes, group, jc.pinned([0, 2 * pieces])), pieces


def moved(pieces):
    structure, node = isolated(pieces)
    phases = [
        jc.Phase(loads=jc.SelfWeight()),
        jc.Phase(loads=jc.NodalLoads([node], (0, 0, -8000 * POUND))),
    ]
    solution = jc.solve(structure, phases, jc.Newton(tol=1e-12))
    assert int(solution.status) == 0
    return np.asarray(solution.phases[1].displacement[node]) / FOOT


EXACT = np.array([-2.819439381, 0.0, -18.456746888])
"""ft; Michalos and Birnstiel's cable (Jayaraman and Knudson 1981), exact catenaries."""


@pytest.mark.slow
def test_isolated_cable():
    """One element a span gives the exact displacement; ten printed digits are known."""
    error = np.linalg.norm(moved(0) - EXACT) / np.linalg.norm(EXACT)
    assert error < 1e-8 / 20  # half of the last digit is 3e-11


@pytest.mark.slow
def test_straight_elements_converge_to_the_catenary_at_second_order():
    errors = [np.linalg.norm(moved(n) - moved(0)) for n in (4, 8, 16)]
    orders = np.log2(errors[:-1]) - np.log2(errors[1:])
    assert orders == pytest.approx(2, abs=0.05)


def hanging(span=60.0, rise=10.0, stiffness=2e6, weight=40.0, **group):
    return jc.Structure(
        [[0.0, 0, 0], [span, 0, rise]],
        jc.Catenaries([[0, 1]], axial_stiffness=stiffness, weight=weight, **group),
        jc.pinned([0, 1]),
    )


@pytest.mark.slow
@pytest.mark.parametrize("sag", [0.01, 0.5, 8.0, 100.0])
@pytest.mark.parametrize("rise", [0.0, 10.0, -80.0])
def test_sag(sag, rise):
    """The stated sag is that at midspan in the solution, from the equilibrium of one half.

    The part between an end and midspan is a catenary of its own: mpmath's integrals over it.
    """
    structure = hanging(rise=rise)
    solution = jc.solve(structure, [jc.Phase(sag=sag, loads=jc.SelfWeight())])
    assert int(solution.status) == 0
    length, weight, stiffness = mp.mpf(float(solution.rest_length[0])), mp.mpf(40), mp.mpf(2e6)
    end = solution.reactions[1] - np.array([0, 0, 0.5 * 40 * float(length)])
    # reactions balance the weight at the ends: less a half of it, the vector in the middle
    reaction = [mp.mpf(float(v)) for v in (solution.reactions[1, 0], solution.reactions[1, 2])]
    h, v = reaction[0], reaction[1] - weight * length / 2
    assert float(v) == pytest.approx(float(end[2]), rel=1e-12)

    def part(s):
        return chord_of(h, reaction[1] - weight * s / 2, s, weight, stiffness)

    half = mp.findroot(lambda s: part(s)[0] - 30, (length / 100, length), solver="anderson")
    middle = rise - part(half)[1]
    # the reactions have the rounding of the force, which is worth eps of the chord
    assert float(mp.mpf(rise) / 2 - middle) == pytest.approx(sag, rel=1e-13, abs=1e-13)


def test_shallow_limit_is_the_parabola():
    """H = w l^2 / (8 f), L = l + 8 f^2 / 3 l; the next term is of the order (f/l)^2."""
    for sag in (0.6, 0.06):
        structure = hanging(rise=0.0, stiffness=1e12)
        solution = jc.solve(structure, [jc.Phase(sag=sag, loads=jc.SelfWeight())])
        parabola, order = 40 * 60.0**2 / (8 * sag), 10 * (sag / 60) ** 2
        stretched = float(solution.rest_length[0]) * (1 + parabola / 1e12)
        assert abs(float(solution.reactions[1, 0])) == pytest.approx(parabola, rel=order)
        # a difference of lengths: eps 60 beside 2e-4
        assert stretched - 60 == pytest.approx(8 * sag**2 / (3 * 60), rel=order + 1e-9)


def test_curve_and_end_tensions():
    """The curve ends at the ends, hangs by the sag and has the slope of the reactions."""
    structure = hanging()
    solution = jc.solve(structure, [jc.Phase(sag=6.0, loads=jc.SelfWeight())])
    assert int(solution.status) == 0
    group = copy(structure.elements, links=structure.elements.links.array)
    load = np.array([[0, 0, -40.0 * 1]])
    state = copy(solution.last.carry.states[0], line_load=jnp.asarray(load))
    nodes, still = structure.nodes, jnp.zeros((2, 3))
    parts = jnp.linspace(0, 1, 2001)
    one = jax.tree.map(lambda a: a[0], state)
    single = copy(group, **{k: v[0] for k, v in group.properties().items()})
    curve = np.asarray(single.curve(one, nodes, still, parts))
    assert np.abs(curve[[0, -1]] - nodes).max() < 1e-12 * 60
    # between two of 2001 points, 3 cm apart: 1/8 of the curvature 1/75 m times the square of that
    middle = np.interp(30.0, curve[:, 0], curve[:, 2])
    assert nodes[:, 2].mean() - middle == pytest.approx(6.0, abs=2e-6)
    tangent = (curve[1] - curve[0]) / np.linalg.norm(curve[1] - curve[0])
    pull = -np.asarray(solution.reactions[0])
    # a chord of 1/2000 of the length against the tangent at its end
    assert tangent == pytest.approx(pull / np.linalg.norm(pull), abs=1e-3)
    ends = each("end_tensions", group, state, nodes, still)[0]
    assert ends == pytest.approx(np.linalg.norm(solution.reactions, axis=1), rel=1e-12)
    assert float(solution.tension[0]) == pytest.approx(float(ends.mean()), rel=1e-12)


@pytest.mark.slow
def test_line_load_across_and_temperature():
    """Wind across adds to the weight: the plane of the cable turns, nothing else changes."""
    wind, weight = 30.0, 40.0
    both = jc.Phase(loads=[jc.SelfWeight(), jc.LineLoads((0, wind, 0))], rest_length=62.0)
    turned = jc.solve(hanging(rise=0.0), [both])
    plain = jc.solve(
        hanging(rise=0.0, weight=np.hypot(wind, weight)),
        [jc.Phase(loads=jc.SelfWeight(), rest_length=62.0)],
    )
    assert int(turned.status) == int(plain.status) == 0
    assert float(turned.tension[0]) == pytest.approx(float(plain.tension[0]), rel=1e-13)
    warm = jc.solve(
        hanging(rise=0.0, expansion=1e-5),
        [both, jc.Phase(temperature=50.0)],
    )
    assert float(warm.rest_length[0]) == pytest.approx(62.0 * (1 + 5e-4), rel=1e-14)
    assert float(warm.tension[0]) < float(turned.tension[0])
    # heat makes no mass, and no length that loads are per
    assert -warm.load.sum(0) == pytest.approx(62 * np.array([0, -wind, weight]), rel=1e-12)


def test_a_catenary_refuses_laws_and_jacks():
    with pytest.raises(ValueError, match="a catenary is elastic"):
        jc.Catenaries([[0, 1]], area=1.0, law=jc.Elastic(1.0))
    with pytest.raises(ValueError, match="a group of Catenaries has no jack"):
        jc.solve(hanging(), [jc.Phase(jacking=1.0)])
    with pytest.raises(ValueError, match="sag: stated for catenaries with a weight only"):
        jc.solve(hanging(weight=None), [jc.Phase(sag=1.0)])
    with pytest.raises(ValueError, match=r"sag\[0\] = 0.0: a sag must be positive"):
        jc.solve(hanging(), [jc.Phase(sag=0.0)])


def test_plumb_and_collapsed_cables_have_derivatives():
    """A chord along the load, and none at all: the force of one equation, the stiffness finite."""

    def force(p):
        return hang(p[:3], p[:3] @ p[:3] - p[3] ** 2, p[4:7], p[3], p[7])[0]

    rates = jax.jit(jax.jacfwd(force))
    down = [0.0, 0.0, -5.0, 1e5]
    for chord, length in (([0.0, 0, -10], 9.9), ([0.0, 0, -10], 10.0), ([0.0, 0, 0], 15.0)):
        p = jnp.array([*chord, length, *down])
        assert bool(jnp.isfinite(rates(p)).all())
    # taut: EA (l/L0 - 1); across it, T/l less what the spread of tension along it takes (1e-5)
    p = jnp.array([0.0, 0, -10, 9.9, *down])
    exact = 1e5 * (10 / 9.9 - 1)
    assert np.asarray(force(p)) == pytest.approx([0, 0, -exact], rel=1e-12)
    assert float(rates(p)[0, 0]) == pytest.approx(exact / 10, rel=1e-3)


@pytest.mark.slow
def test_a_plumb_hanger():
    """It holds P and its weight: T = P + w L0 / 2 in the middle, l = L0 (1 + T/EA)."""
    structure = jc.Structure(
        [[0.0, 0, 10], [0, 0, 0]],
        jc.Catenaries([[0, 1]], axial_stiffness=1e5, weight=5.0),
        jc.pinned([0]),
    )

    def analyse(load):
        loads = [jc.SelfWeight(), jc.NodalLoads([1], jnp.array([0.0, 0, -1]) * load)]
        # the default, 1e-10 of the forces, ends 8e-11 from the tension
        return jc.solve(structure, [jc.Phase(loads=loads)], jc.Newton(tol=1e-13))

    solution = analyse(50.0)
    assert int(solution.status) == 0
    assert float(solution.tension[0]) == pytest.approx(75.0, rel=1e-12)
    assert float(solution.positions[1, 2]) == pytest.approx(-10 * 75 / 1e5, rel=1e-9)
    assert float(jax.grad(lambda p: analyse(p).positions[1, 2])(50.0)) == pytest.approx(
        -10 / 1e5, rel=1e-9
    )


def test_a_root_outside_of_its_bracket_is_no_number():
    for low, high, expected in ((0.0, 3.0, 2.0), (0.0, 1.0, np.nan), (3.0, 5.0, np.nan)):
        root = rising_root(lambda u: u**3 - 8.0, jnp.array(1.5), jnp.array(low), jnp.array(high))
        assert float(root) == pytest.approx(expected, rel=1e-15, nan_ok=True)
