"""`sag=`: the vertical distance from the chord at midspan, against closed forms of the catenary."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import jaxcable as jc
from jaxcable.common import status
from jaxcable.elements.hanging_sag import strain_at_sag
from jaxcable.elements.stated import Stated

SPAN, WEIGHT = 100.0, 10.0  # m, N/m
SLOPES, PULLS, SOFT = (0.0, 0.5, -1.0, 2.0, 5.0), (50.0, 1.0, 0.15), (1e-6, 0.1, 1.0)


def spanned(slope, force, stiffness):
    """Unstressed length and sag of a cable under a horizontal force, by Irvine's integrals.

    From the lower end, with the vertical force V there: ``x = H s/EA + H/w (asinh((V + w s)/H) -
    asinh(V/H))``, ``z = (V s + w s^2/2)/EA + (sqrt(H^2 + (V + w s)^2) - sqrt(H^2 + V^2))/w``.
    """
    H, w, EA = force, WEIGHT, stiffness

    def x(s, V):
        return H * s / EA + H / w * (np.arcsinh((V + w * s) / H) - np.arcsinh(V / H))

    def z(s, V):
        return (V * s + w * s**2 / 2) / EA + (np.hypot(H, V + w * s) - np.hypot(H, V)) / w

    def length(V, part=1.0):
        far = SPAN * np.exp(20.0)
        return brentq(lambda s: x(s, V) - part * SPAN, 0.0, far, xtol=1e-12, rtol=1e-15)

    def rise(V):
        return z(length(V), V) - slope * SPAN

    wide = 4 * (abs(slope) + 1) * force + 100 * w * SPAN
    V = brentq(rise, -wide, wide, xtol=1e-13 * force, rtol=1e-15)
    return length(V), 0.5 * slope * SPAN - z(length(V, 0.5), V)


@pytest.fixture(scope="module")
def spans():
    """Slope, horizontal force, EA, unstressed length and sag of every span, [n, 5]."""
    found = []
    for slope, pull, soft in itertools.product(SLOPES, PULLS, SOFT):
        force = pull * WEIGHT * SPAN
        stiffness = force * np.hypot(1, slope) / soft
        found.append([slope, force, stiffness, *spanned(slope, force, stiffness)])
    return np.array(found)


def test_spans_hang_by_the_force_that_belongs_to_their_sag(spans):
    """From level to 79 degrees, from sag/l = 1/400 to 1, from EA/N = 1e6 to 1; in one analysis."""
    slope, force, stiffness, length, sag = spans.T
    assert sag.min() < 0.0026 * SPAN and sag.max() > SPAN
    n = len(spans)
    nodes = np.zeros((n, 2, 3))
    nodes[:, 1, 0], nodes[:, 1, 2] = SPAN, slope * SPAN
    nodes[:, :, 1] = np.arange(n)[:, None]
    links = np.arange(2 * n).reshape(n, 2)
    cables = jc.Catenaries(links, axial_stiffness=stiffness, weight=WEIGHT)
    structure = jc.Structure(nodes.reshape(-1, 3), cables, supports=jc.pinned(range(2 * n)))
    solution = jc.solve(structure, jc.Phase(sag=sag, loads=jc.SelfWeight()))
    assert int(solution.status) == 0
    np.testing.assert_allclose(solution.rest_length, length, rtol=1e-11)
    # the sags of `spanned` are right to some 1e-12 m; the least is 0.25 m
    np.testing.assert_allclose(-solution.reactions[links[:, 0], 0], force, rtol=1e-10)
    said = jc.forms.statements(structure, solution).sag
    np.testing.assert_allclose(said, sag, rtol=1e-12)
    # the control: the middle of the unstressed length hangs elsewhere
    curves = jc.forms.catenary_curves(structure, solution, 3)
    middle = 0.5 * slope * SPAN - np.asarray(curves)[:, 1, 2]
    level = slope == 0
    np.testing.assert_allclose(middle[level], sag[level], rtol=1e-12)
    assert np.abs(middle / sag - 1)[~level].max() > 0.2


def test_derivatives_by_sag_weight_stiffness_and_ends(spans):
    slope, _, stiffness, _, sag = spans[::4].T
    chord = np.stack([SPAN + 0 * slope, 3.0 + 0 * slope, slope * SPAN], axis=1)
    load = np.tile([0.0, 0.0, -WEIGHT], (len(sag), 1))
    at = chord, load, np.log(stiffness), np.log(sag)

    def one(chord, load, stiffness, sag):
        return strain_at_sag(chord, load, jnp.exp(stiffness), jnp.exp(sag))

    run = jax.jit(jax.vmap(one))
    rates = jax.jit(jax.vmap(lambda at, ways: jax.jvp(one, at, ways)[1]))
    random = np.random.default_rng(1)
    for k, size in enumerate((1e-2, 1e-4, 1e-4, 1e-4)):
        way = random.normal(size=at[k].shape) * size
        if k == 1:
            way[:, :2] = 0.0  # along -z
        ways = tuple(way if j == k else np.zeros_like(v) for j, v in enumerate(at))
        exact = np.asarray(rates(at, ways))
        values = {}
        for h in (-2, -1, 1, 2):
            values[h] = run(*[v + h * w for v, w in zip(at, ways, strict=True)])
        found = (8 * (values[1] - values[-1]) - (values[2] - values[-2])) / 12
        # differences of strains rounded to 1e-16; the steps change them by 1e-8 and more
        np.testing.assert_allclose(found, exact, rtol=1e-6, atol=1e-15)
        assert np.abs(found - 1.001 * exact).max() > 1e-4 * np.abs(exact).max()  # can fail


def upright(nodes, sag=1.0):
    cable = jc.Catenaries([[0, 1], [0, 2]], axial_stiffness=1e6, weight=WEIGHT)
    structure = jc.Structure(nodes, cable, supports=jc.pinned([0, 1, 2]))
    return jc.solve(structure, jc.Phase(sag=jc.only([0], sag), loads=jc.SelfWeight()))


def test_a_plumb_span_has_no_midspan():
    """Refused where it is known, INVALID_INPUT where nodes are traced; one that is not stated may.

    Ends that are out of plumb by 1e-8 of their distance already have a midspan.
    """
    nodes = np.array([[0.0, 0, 0], [0, 0, 50.0], [30.0, 0, 0]])
    with pytest.raises(ValueError, match=r"sag\[0\]: the nodes of the element lie above each"):
        upright(nodes)
    run = jax.jit(lambda nodes: (upright(nodes).status, upright(nodes).rest_length))
    assert int(run(nodes)[0]) == status.INVALID_INPUT
    nodes[1, 0] = 5e-7
    code, length = run(nodes)
    # the parabola along its chord of d = 50 m, without an excess of length: N = w d^2 / (8 sag)
    assert int(code) == 0
    assert float(length[0]) == pytest.approx(50.0 / (1 + 10.0 * 50.0**2 / 8 / 1e6), rel=2e-5)
    assert int(run(nodes[[0, 2, 1]])[0]) == 0
    # one that is plumb and not stated has no part in the derivatives
    cable = jc.Catenaries([[0, 1], [0, 2]], axial_stiffness=1e6, weight=WEIGHT)
    stated = {"sag": Stated(np.array([0.0, 1.0]), np.array([False, True]))}

    def rest(ends):
        return jnp.sum(cable.restate(cable.start(ends), ends, stated).rest_length)

    ends = jnp.array([[[0.0, 0, 0], [0, 0, 50]], [[0.0, 0, 0], [30, 0, 0]]])
    slope = jax.jit(jax.grad(rest))(ends)
    assert np.isfinite(slope).all() and float(slope[0, 1, 2]) == pytest.approx(1.0)
    with pytest.raises(ValueError, match="first, second: the ends lie above each other"):
        jc.forms.hanging_chain((0, 0, 0), (0, 0, 1.0), 4, 1.0, 1.0, 1e3)


def test_a_chain_hangs_by_its_sag():
    """At midspan, wherever its nodes are; in equilibrium under its own weight, by NumPy."""
    n = 7
    first, second = np.array([1.0, 2.0, 0.0]), np.array([41.0, 32.0, 48.0])
    nodes, rest = map(np.asarray, jc.forms.hanging_chain(first, second, n, 5.0, 25.0, 1e6))
    plan = np.linalg.norm(nodes[:, :2] - first[:2], axis=1)
    assert plan[-1] == pytest.approx(50.0, rel=1e-13)
    at_midspan = np.interp(25.0, plan, nodes[:, 2])
    assert 24.0 - at_midspan == pytest.approx(5.0, rel=1e-12)
    pieces = np.diff(nodes, axis=0)
    length = np.linalg.norm(pieces, axis=1)
    pull = (1e6 * (length - rest) / rest / length)[:, None] * pieces
    weight = np.zeros((n - 1, 3))
    weight[:, 2] = -25.0 * rest[0]
    # EA eps of lengths that are subtracted here
    np.testing.assert_allclose(np.diff(pull, axis=0) + weight, 0.0, atol=2e-8)
