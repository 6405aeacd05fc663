"""Elastic catenaries against the integrals of their equilibrium in 60 digits, and closed forms."""

import functools
import itertools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from oracles.convergence import converged
from oracles.convex_oracle import WIDE, Element, Scene, find
from oracles.taylor import slope
from oracles.traced import traced
from scipy.optimize import brentq

import jaxcable as jc
from jaxcable.common import status
from jaxcable.common.tree import copy_with
from jaxcable.elements.element_state import ElementLoad
from jaxcable.mechanics.elementwise import evaluate_elements

mp = mpmath.mp.clone()
mp.dps = 60
DOWN = np.array([0.0, 0.0, -1.0])

# --- ten thousand draws


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


@traced
def middle_force(x, z, length, weight, stiffness):
    """Tension vectors in the middle, [n, 2], and mean tensions."""
    n = len(x)
    nodes = jnp.zeros((2 * n, 3), x.dtype).at[n:, 0].set(x).at[n:, 2].set(z)
    links = np.arange(2 * n).reshape(2, n).T
    group = jc.Catenaries(links, axial_stiffness=stiffness, rest_length=length)
    group = copy_with(group, links=links)
    state = copy_with(
        group.start(nodes[links]), element_load=ElementLoad(jnp.outer(weight, DOWN.astype(x.dtype)))
    )
    still = jnp.zeros_like(nodes)
    force = evaluate_elements("end_forces", group, state, nodes, still)[:, 1]
    return force[:, ::2], evaluate_elements("tension", group, state, nodes, still)


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
    return (by_h, cross, by_v), mp.hypot(*own) + mp.hypot(*stretched)


DRAWS = {"a part": slice(None, None, 11), "all": slice(None)}  # of `draw`: 11 meets its periods


@functools.cache
def drawn():
    values = draw(10_000)
    force, tension = (np.asarray(v) for v in middle_force(*map(jnp.asarray, values)))
    return np.stack(values, 1), force, tension


@pytest.mark.slow_cases("all")
@pytest.mark.parametrize("part", DRAWS)
def test_end_positions_of_ten_thousand_draws(part):
    """The chord that the computed forces give, in 60 digits, is the chord asked for."""
    values, force, _ = (each[DRAWS[part]] for each in drawn())
    worst = 0
    for (x, z, length, weight, stiffness), (h, v) in zip(values, force, strict=True):
        dx, dz = chord_of(*map(mp.mpf, (h, v, length, weight, stiffness)))
        worst = max(worst, mp.hypot(dx - x, dz - z) / max(length, np.hypot(x, z)))
    assert worst <= 1e-13


@pytest.mark.slow_cases("all")
@pytest.mark.parametrize("part", DRAWS)
def test_end_forces_of_ten_thousand_draws(part):
    """Against Newton's method on the two integrals in 60 digits, within what inputs allow."""
    values, force, _ = (each[DRAWS[part]] for each in drawn())
    worst = 0
    for (x, z, length, weight, stiffness), (h0, v0) in zip(values, force, strict=True):
        x, z, length, weight, stiffness = map(mp.mpf, (x, z, length, weight, stiffness))
        h, v = mp.mpf(h0), mp.mpf(v0)
        for _ in range(30):
            dx, dz = chord_of(h, v, length, weight, stiffness)
            (a, b, c), others = flexibility(h, v, length, weight, stiffness)
            if not h:  # vertical: one equation
                step, inverse = (0, (z - dz) / c), 1 / c
            else:
                det = a * c - b * b
                step = (c * (x - dx) - b * (z - dz)) / det, (a * (z - dz) - b * (x - dx)) / det
                inverse = (a + c) / det
            h, v = h + step[0], v + step[1]
            size = mp.hypot(h, abs(v) + weight * length / 2)
            if mp.hypot(*step) < mp.mpf(10) ** -20 * size:  # squared: what is left
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


@traced
@functools.partial(jax.value_and_grad, argnums=1)
def rated(p, q):
    """Logarithms of force, tension and horizontal force, and derivatives by q; p q is the cable."""
    force, tension = middle_force(*(p * q)[:, None])
    total = jnp.log(jnp.sum(jnp.abs(force))) + jnp.log(tension[0])
    return total + 0.1 * jnp.log(jnp.abs(force[0, 0]))


@pytest.mark.slow_cases("shallow")
@pytest.mark.parametrize("name", REGIMES)
def test_taylor_everywhere(name):
    """By span, rise, length, weight and stiffness together; steps relative to the condition."""
    p, start = jnp.array(REGIMES[name]), jnp.ones(5)
    gradient = rated(p, start)[1]
    assert jnp.isfinite(gradient).all()
    # a step moves the value by some percent (by more where EA/N = 1e8 leaves it eight digits)
    size = (100 if "stiff" in name else 20) / float(jnp.abs(gradient).max())

    def value(q):
        return rated(p, q)[0]

    assert slope(value, start, gradient, size) == pytest.approx(2, abs=0.1)
    assert slope(value, start, 1.05 * gradient, size) < 1.5


def test_without_load_a_scene_has_no_catenary_in_it():
    """The program of unloaded catenaries is that of cables: not one exponential."""
    structure, _ = jc.scenes.flat_net()
    texts = []
    for group in (jc.Catenaries, jc.Cables):
        elements = group(structure.elements.links, axial_stiffness=97.97e3)
        made = jc.replace(structure, elements=elements)

        def solve(tension, made=made):
            return jc.solve(made, [jc.Phase(pretension=tension)]).tension

        texts.append(str(jax.make_jaxpr(solve)(200.0)))
    assert "log1p" not in texts[0]
    assert texts[0].count("\n") == pytest.approx(texts[1].count("\n"), rel=0.02)


def test_single_precision():
    values = [jnp.asarray(v, jnp.float32) for v in draw(3000, seed=4)]
    exact = middle_force(*(v.astype(jnp.float64) for v in values))
    force, tension = middle_force(*values)
    assert force.dtype == jnp.float32 and bool(jnp.isfinite(force).all())
    # where the chord is not that of the taut cable, which float32 cannot tell from its length
    slack = np.asarray(values[2]) > 1.01 * np.hypot(values[0], values[1])
    error = np.abs(np.asarray(tension) / np.asarray(exact[1]) - 1)
    assert error[slack].max() < 1e-4


# --- under a stated tension: the unknown that lets nets of catenaries converge


@pytest.mark.slow_cases("lengths0-1000000.0", "lengths0-10000000000.0")
@pytest.mark.parametrize("stiffness", [1e6, 1e10, 1e14])
@pytest.mark.parametrize("lengths", [(10.2, 9.9), (10.002, 9.999)])
def test_stiff_spans_of_which_one_starts_slack(lengths, stiffness):
    """Two spans, one too long, one too short at the start: few steps whatever the stiffness."""
    nodes = np.array([[0.0, 0, 0], [10, 0, 0], [20, 0, 0]])
    cables = jc.Catenaries(
        [[0, 1], [1, 2]], axial_stiffness=stiffness, weight=30.0, rest_length=lengths
    )
    structure = jc.Structure(nodes, cables, jc.pinned([0, 2]))
    loads = jc.NodalLoads([1], (0.0, 0.0, -3e3))
    solution = converged(
        jc.solve(structure, [jc.Phase(loads=jc.SelfWeight()), jc.Phase(loads=loads)])
    )
    assert max(int(jnp.max(phase.path.iterations)) for phase in solution.phases) <= 30

    elements = [
        Element("catenary", (k, k + 1), stiffness, WIDE(length), load=(0.0, 0.0, -30.0))
        for k, length in enumerate(lengths)
    ]
    free, load = np.zeros((3, 3), bool), np.zeros((3, 3))
    free[1], load[1, 2] = True, -3e3
    found = find(Scene(nodes, free, load, elements))
    assert found.found
    # tensions follow from the chord, whose rounding leaves EA eps u/L in them, beside the tolerance
    moved = float(np.abs(found.displacement).max())
    floor = 1e-9 * float(found.scale) + 16 * stiffness * np.finfo(float).eps * (moved / 10 + 1)
    assert np.abs(solution.tension - np.array(found.tension, float)).max() <= floor


# --- `sag=`: the vertical distance from the chord at midspan

SPAN, WEIGHT, WARMTH = 100.0, 10.0, 1 + 1e-5 * 50.0  # m, N/m
SLOPES, PULLS, SOFT = (0.0, 0.5, -1.0, 5.0), (50.0, 1.0, 0.15), (1e-6, 1.0)


def spanned(steep, force, stiffness):
    """Unstressed length and sag of a cable under a horizontal force, by Irvine's integrals.

    From the lower end, with the vertical force V there: ``x = H s/EA + H/w (asinh((V + w s)/H) -
    asinh(V/H))``, ``z = (V s + w s^2/2)/EA + (sqrt(H^2 + (V + w s)^2) - sqrt(H^2 + V^2))/w``. Heat
    has lengthened the cable, which weighs less per length.
    """
    H, w, EA = force, WEIGHT / WARMTH, stiffness

    def x(s, V):
        return H * s / EA + H / w * (np.arcsinh((V + w * s) / H) - np.arcsinh(V / H))

    def z(s, V):
        return (V * s + w * s**2 / 2) / EA + (np.hypot(H, V + w * s) - np.hypot(H, V)) / w

    def length(V, part=1.0):
        far = SPAN * np.exp(20.0)
        return brentq(lambda s: x(s, V) - part * SPAN, 0.0, far, xtol=1e-12, rtol=1e-15)

    def rise(V):
        return z(length(V), V) - steep * SPAN

    wide = 4 * (abs(steep) + 1) * force + 100 * w * SPAN
    V = brentq(rise, -wide, wide, xtol=1e-13 * force, rtol=1e-15)
    return length(V), 0.5 * steep * SPAN - z(length(V, 0.5), V)


@functools.cache
def spans():
    """Slope, horizontal force, EA, unstressed length and sag of every span, [5, n]."""
    found = []
    for steep, pull, soft in itertools.product(SLOPES, PULLS, SOFT):
        force = pull * WEIGHT * SPAN
        stiffness = force * np.hypot(1, steep) / soft
        found.append([steep, force, stiffness, *spanned(steep, force, stiffness)])
    return np.array(found).T


@pytest.mark.slow
# the stiffest spans, with EA/N = 1e6, are doubted as if numbers were in other units: they are meant
@pytest.mark.filterwarnings("ignore:elements.weight:jaxcable.InputWarning")
def test_spans_hang_by_the_force_that_belongs_to_their_sag():
    """From level to 79 degrees, from sag/l = 1/400 to 1, from EA/N = 1e6 to 1; in one analysis.

    Curves end at the ends, with the slopes of the reactions.
    """
    steep, force, stiffness, length, sag = spans()
    assert sag.min() < 0.0026 * SPAN and sag.max() > SPAN
    n = len(sag)
    nodes = np.zeros((n, 2, 3))
    nodes[:, 1, 0], nodes[:, 1, 2] = SPAN, steep * SPAN
    nodes[:, :, 1] = np.arange(n)[:, None]
    links = np.arange(2 * n).reshape(n, 2)
    cables = jc.Catenaries(links, axial_stiffness=stiffness, weight=WEIGHT, expansion=1e-5)
    structure = jc.Structure(nodes.reshape(-1, 3), cables, supports=jc.pinned(range(2 * n)))
    phases = [jc.Phase(temperature=50.0), jc.Phase(sag=sag, loads=jc.SelfWeight())]
    solution = converged(jc.solve(structure, phases))
    np.testing.assert_allclose(solution.rest_length, length, rtol=1e-11)
    # the sags of `spanned` are right to some 1e-12 m; the least is 0.25 m
    pull = -np.asarray(solution.reactions)[links]
    np.testing.assert_allclose(pull[:, 0, 0], force, rtol=1e-10)
    ends = np.linalg.norm(pull, axis=2)
    np.testing.assert_allclose(solution.tension, ends.mean(axis=1), rtol=1e-12)
    np.testing.assert_allclose(solution.peak_tension, ends.max(axis=1), rtol=1e-12)
    state, own = solution.last.restart.states[0], copy_with(cables, links=links)
    state = copy_with(
        state, element_load=ElementLoad(jnp.asarray(np.tile(WEIGHT / WARMTH * DOWN, (n, 1))))
    )
    told = evaluate_elements("end_tensions", own, state, structure.nodes, jnp.zeros((2 * n, 3)))
    np.testing.assert_allclose(told, ends, rtol=1e-12)
    said = jc.forms.equivalent_prestress(structure, solution).sag
    np.testing.assert_allclose(said, sag, rtol=1e-12)
    curves = np.asarray(jc.forms.catenary_curves(structure, solution, 2001))
    np.testing.assert_allclose(curves[:, [0, -1]], nodes, atol=1e-9)  # of 500 m that are added
    tangent = curves[:, 1] - curves[:, 0]
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    # a chord of 1/2000 of the length against the tangent at its end
    assert np.abs(tangent - pull[:, 0] / ends[:, :1]).max() < 5e-3
    # the control: the middle of the unstressed length hangs elsewhere
    middle, level = 0.5 * steep * SPAN - curves[:, 1000, 2], steep == 0
    np.testing.assert_allclose(middle[level], sag[level], rtol=1e-12)
    assert np.abs(middle / sag - 1)[~level].max() > 0.2


PLUMB = np.array([[0.0, 0, 0], [0, 0, 50.0], [30.0, 0, 0]])


def upright(nodes):
    """Two cables from one node, the first of which has a stated sag."""
    cable = jc.Catenaries([[0, 1], [0, 2]], axial_stiffness=1e6, weight=WEIGHT)
    structure = jc.Structure(nodes, cable, supports=jc.pinned([0, 1, 2]))
    solution = jc.solve(structure, jc.Phase(sag=jc.only([0], 1.0), loads=jc.SelfWeight()))
    return solution.status, solution.rest_length


@pytest.mark.slow
def test_a_plumb_span_has_no_midspan():
    """Refused where it is known, INVALID_INPUT where nodes are traced; one that is not stated may.

    Ends that are out of plumb by 1e-8 of their distance already have a midspan.
    """
    with pytest.raises(ValueError, match=r"sag\[0\]: the nodes of the element lie above each"):
        upright(PLUMB)
    run = traced(upright)
    assert int(run(PLUMB)[0]) == status.INVALID_INPUT
    nodes = PLUMB + np.array([[0.0, 0, 0], [5e-7, 0, 0], [0, 0, 0]])
    code, length = run(nodes)
    # the parabola along its chord of d = 50 m, without an excess of length: N = w d^2 / (8 sag)
    assert int(code) == 0
    assert float(length[0]) == pytest.approx(50.0 / (1 + 10.0 * 50.0**2 / 8 / 1e6), rel=2e-5)
    assert int(run(nodes[[0, 2, 1]])[0]) == 0
    with pytest.raises(ValueError, match="first, second: the ends lie above each other"):
        jc.forms.hanging_chain((0, 0, 0), (0, 0, 1.0), 4, 1.0, 1.0, 1e3)


# --- in an analysis
