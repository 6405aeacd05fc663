"""Forms of prescribed forces and lengths against closed forms, NumPy and their own analysis."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.problems import pulls_on_nodes
from banks.shapes import pieces
from oracles.convergence import converged
from oracles.traced import traced
from scipy.optimize import brentq

import jaxcable as jc
from jaxcable.common.selection import only
from jaxcable.forms import find_form, prescribed_forces
from jaxcable.forms.form import most_shortened_element

EA = 2e6
TIGHT = jc.Newton(tol=1e-14)
TRIANGLE = [[0.0, 0, 0], [4.0, 0, 0], [1.5, 3.0, 0]]


def star(ends, top=(0.1, 0.2, 0.3), kind=jc.Cables, **options):
    """Elements from supports to one free node, which is the last."""
    ends = np.asarray(ends, float)
    n = len(ends)
    links = np.column_stack([np.arange(n), np.full(n, n)])
    nodes = np.vstack([ends, top])
    options = options or {"axial_stiffness": EA}
    return jc.Structure(nodes, kind(links, **options), jc.pinned(np.arange(n)))


def down(node, force):
    return jc.NodalLoads([node], jnp.array([0.0, 0.0, -1.0]) * force)


def unbalanced(structure, form):
    """Largest unbalanced force at a free freedom, by NumPy."""
    force = pulls_on_nodes(structure, form.positions, form.tension)
    return np.abs(force[~np.asarray(structure.fixed(structure.supports))]).max()


# --- minimal nets

NET, _ = jc.scenes.saddle(4, 4, rise=0.3, axial_stiffness=EA)
FREE = ~np.asarray(NET.fixed(NET.supports))


def test_minimal_net_of_a_saddle_frame():
    """All tensions equal, also by the material law from lengths alone, and in equilibrium."""
    T = 2000.0
    form = converged(find_form(NET, T))
    x, links = np.asarray(form.positions), NET.elements.links.array
    length = np.linalg.norm(x[links[:, 1]] - x[links[:, 0]], axis=1)
    rest = np.asarray(form.rest_length)
    assert np.abs(EA * (length - rest) / rest / T - 1).max() < 1e-10
    # the default tolerance is 1e-10 of the end forces at a node, 4 T
    assert unbalanced(NET, form) < 4e-10 * T
    assert np.abs(form.length - length).max() < 1e-14
    assert np.abs(form.force_density * length / T - 1).max() < 1e-14
    for seed in range(3):
        move = np.random.default_rng(seed).normal(size=x.shape) * FREE
        # least total length: no small move makes it shorter
        moved = x + 1e-3 * move
        assert np.linalg.norm(moved[links[:, 1]] - moved[links[:, 0]], axis=1).sum() > length.sum()
        # any sensible start leads to it
        other = converged(find_form(jc.replace(NET, nodes=NET.nodes + 3 * move), T))
        assert np.abs(form.positions - other.positions).max() < 1e-8


# --- closed forms


def test_hanging_chain_of_equal_links():
    """Angles of the links from the horizontal force, which the span determines."""
    n, P, L, span = 10, 3.0, 0.13, 1.0
    nodes, links = pieces(n, span)
    chain = jc.Structure(nodes, jc.Cables(links, axial_stiffness=EA), jc.pinned([0, n]))
    form = converged(find_form(chain, None, jc.NodalLoads(np.arange(1, n), (0, 0, -P)), length=L))
    shear = P * (np.arange(n) - (n - 1) / 2)  # vertical force in each link

    def excess(H):
        return (L * H / np.hypot(H, shear)).sum() - span

    H = brentq(excess, 1e-3, 1e3, xtol=1e-14)
    assert np.abs(form.tension - np.hypot(H, shear)).max() < 1e-7
    z = np.append(0.0, np.cumsum(L * shear / np.hypot(H, shear)))
    assert np.abs(form.positions[:, 2] - z).max() < 1e-9


def test_triplex_finds_its_twist():
    """Struts of given length, cables of given force: the twist that one equation needs.

    Force densities triangle : vertical : strut = 1/sqrt(3) : 1 : -1; the lower nodes are held.
    """
    exact, start = (
        jc.replace(jc.scenes.simplex(twist=twist)[0], supports=jc.pinned(range(3)))
        for twist in (np.pi / 6, np.pi / 6 + 0.2)
    )
    x, tension, length = np.asarray(exact.nodes), {}, {}
    for name, q in {"struts": -1.0, "triangles": 1 / np.sqrt(3), "verticals": 1.0}.items():
        links = exact.elements[name].links.array
        length[name] = np.linalg.norm(x[links[:, 1]] - x[links[:, 0]], axis=1)
        tension[name] = 1e3 * q * length[name]
    given = {"struts": length["struts"][0], "triangles": None, "verticals": None}
    form = converged(find_form(start, {**tension, "struts": None}, length=given))
    assert np.abs(form.positions - x).max() < 1e-7
    assert np.abs(form.tension["struts"] / tension["struts"] - 1).max() < 1e-7
    assert unbalanced(start, form) < 1e-6


@pytest.mark.slow
def test_stress_of_an_area():
    law = jc.Polygonal([0.0, 0.001, 0.02], [0.0, 200e6, 300e6])
    structure = star(TRIANGLE, area=np.array([1e-5, 2e-5, 3e-5]), law=law)
    form = converged(find_form(structure, stress=np.array([250e6, 180e6, 90e6])))
    assert np.abs(form.tension - np.array([2500, 3600, 2700])).max() < 1e-9
    # by the curve: 0.001 + 50/100 of 0.019; 0.9 and 0.45 of 0.001
    strain = np.array([0.0105, 0.0009, 0.00045])
    assert np.abs(form.length / form.rest_length - 1 - strain).max() < 1e-13
    torn = find_form(structure, only([0], 3001.0), stress=only([1, 2], 90e6))
    assert int(torn.status) == jc.status.MATERIAL_FAILURE
    assert np.isnan(torn.rest_length).all()


# --- derivatives

PULLEYS = star([[-3.0, 0, 0], [3.0, 0, 0]], top=(0.4, 0.0, 0.2))
CIRCLES = jc.Structure(  # a node on two circles, in a plane
    [[0.0, 0, 0], [5.0, 0, 0], [2.0, 0, -1.0]],
    jc.Cables([[0, 2], [1, 2]], axial_stiffness=EA),
    jc.pinned([0, 1]) + jc.restrained([2], "y"),
)
SUPERLU = jc.Newton(tol=1e-14, linear_solver="superlu")


def over_pulleys(p):
    """Depth by equal forces and a load."""
    form = find_form(PULLEYS, p[0], down(2, p[1]), method=TIGHT)
    return form.positions[2, 2], form.positions[2, :2], form.status


def over_pulleys_by_hand(p):
    """Half-span a: ``2 T z / l = P``, z = a P / sqrt(4 T^2 - P^2)."""
    return -3 * p[1] / jnp.sqrt(4 * p[0] ** 2 - p[1] ** 2), jnp.zeros(2), 0


def on_circles(p):
    """The force in one of two cables of given lengths under a load."""
    form = find_form(CIRCLES, None, down(2, p[2]), length=p[:2], method=SUPERLU)
    return form.tension[0], jnp.append(form.positions[2], form.length), form.status


def on_circles_by_hand(p):
    """By the law of sines; ``x`` from the two circles."""
    x = (25 + p[0] ** 2 - p[1] ** 2) / 10
    z = -jnp.sqrt(p[0] ** 2 - x**2)
    force = p[2] * (5 - x) * p[0] / (-5 * z)
    return force, jnp.stack([x, jnp.zeros(()), z, p[0], p[1]]), 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("find", "by_hand", "batch"),
    [
        (over_pulleys, over_pulleys_by_hand, [[50.0, 60.0], [40.0, 10.0], [60.0, 70.0]]),
        (on_circles, on_circles_by_hand, [[3.0, 4.0, 70.0], [3.2, 3.9, 50.0], [2.9, 4.2, 70.0]]),
    ],
    ids=["forces", "lengths"],
)
def test_transformations_against_closed_forms(find, by_hand, batch):
    """jit, vmap, and jacfwd, jacrev and hessian in them."""

    def everything(f):
        def first(p):
            return f(p)[0]

        ways = jax.jacfwd(first), jax.jacrev(first), jax.hessian(first)
        return traced(jax.vmap(lambda p: (*f(p), *(way(p) for way in ways))))(jnp.array(batch))

    (found, places, codes, *slopes), (expected, known, _, *rates) = map(everything, (find, by_hand))
    assert not codes.any()
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    np.testing.assert_allclose(places, known, atol=1e-9)
    for own, other in zip(slopes, rates, strict=True):
        assert np.abs(own - other).max() < 1e-9 * np.abs(other).max()


# --- failures

WEBER = star(TRIANGLE, top=(1.0, 1.0, 0.7))


@traced
def _rest_length(stiffness, T, load, which):
    """Of a batch; the unstressed length of its case `which`, and the statuses."""
    elements = jc.replace(WEBER.elements, axial_stiffness=stiffness)
    made = jc.replace(WEBER, elements=elements)
    forms = jax.vmap(lambda T, P: find_form(made, T, down(3, P)))(T, load)
    return forms.rest_length[which, 0], forms.status


@pytest.mark.slow_cases("tension0-0.0-codes0", "tension1-20.0-codes1")
@pytest.mark.parametrize(
    ("tension", "load", "codes"),
    [
        # the first force is more than both others: it draws the node to its support
        ([30.0, 4.0, 4.5], 0.0, (jc.status.COLLAPSED,)),
        # more load than all forces together: the node goes away
        ([3.0, 4.0, 4.5], 20.0, (jc.status.MECHANISM, jc.status.NOT_CONVERGED)),
        ([np.nan, 4.0, 4.5], 0.0, (jc.status.NONFINITE,)),
    ],
)
def test_no_form_is_a_status(tension, load, codes):
    """Its derivatives are NaN; a sound case beside it in a batch keeps its own."""
    form = find_form(WEBER, np.array(tension), down(3, load))
    assert int(form.status) in codes
    assert np.isnan(form.positions).all() and np.isnan(form.rest_length).all()
    with pytest.raises(jc.AnalysisError):
        jc.raise_if_failed(form)
    good = jnp.array([3.0, 4.0, 4.5])
    given = EA, jnp.stack([jnp.array(tension), good]), jnp.array([load, 0.0])
    rates = traced(jax.grad(_rest_length, argnums=(0, 1), has_aux=True))
    (rate, _), status = rates(*given, 1)
    assert int(status[0]) in codes and int(status[1]) == 0
    length = float(find_form(WEBER, good, down(3, 0.0)).length[0])
    # d/dEA of l / (1 + T/EA)
    assert float(rate) == pytest.approx(length * 3.0 / EA**2 / (1 + 3.0 / EA) ** 2, rel=1e-8)
    assert np.isnan(rates(*given, 0)[0][1][0]).all()


def test_nodes_that_have_met_are_named():
    """Of three cables from one node the third pulls more than both others, to its support."""
    structure = star([[0.0, 0, 0], [4, 0, 0], [2, 3, 0]], top=[2.0, 1, 0])
    form = find_form(structure, np.array([10.0, 10.0, 50.0]), down(3, 0.0))
    assert int(form.status) == jc.status.COLLAPSED and np.isnan(form.positions).any()
    assert form.nearest.tolist() == [2, 3]
    with pytest.raises(jc.AnalysisError, match="nodes 2 and 3 of an element have met"):
        jc.raise_if_failed(form)


@pytest.mark.parametrize(("tensions", "named"), [([0.0, 5.0], [1, 2]), ([0.0, 0.0], [0, 1])])
def test_elements_of_given_length_are_named_last(tensions, named):
    """Of two elements in a row the first is crushed to a tenth, the second to a half."""
    start, end = np.zeros((3, 3)), np.zeros((3, 3))
    start[:, 0], end[:, 0] = [0.0, 1.0, 2.0], [0.0, 0.1, 0.6]
    row = [jc.Cables([[0, 1], [1, 2]], axial_stiffness=EA)]
    ends = most_shortened_element(row, start, end, [np.array(tensions)])
    assert ends.tolist() == named


def test_changing_numbers_is_not_traced_again(monkeypatch):
    assert int(find_form(NET, 1e3).status) == 0
    monkeypatch.setattr(prescribed_forces, "cast_floats", None)  # which tracing calls
    converged(find_form(jc.replace(NET, nodes=np.asarray(NET.nodes) * 1.1), np.full(40, 2e3)))


@pytest.mark.slow
def test_ties_that_slide_along_a_cable_are_named():
    """Ties of 6 kN pull six nodes of a cable of 10 kN sideways: only its last link can resist.

    The balance along the cable asks for other tensions in each of its links; equal ones leave a
    part of the pull. The last node slides to the end of its tie.
    """
    x = np.linspace(0.0, 6.0, 8)
    edge = [(a, 0.6 * (1 - (a / 3 - 1) ** 2), 0.0) for a in x]
    nodes = edge + [(a + 2.0, 3.0, 0.5) for a in x[1:-1]]
    groups = {
        "edge": jc.Cables([[k, k + 1] for k in range(7)], axial_stiffness=1e6),
        "ties": jc.Cables([[k, 7 + k] for k in range(1, 7)], axial_stiffness=1e6),
    }
    net = jc.Structure(nodes, groups, jc.pinned([0, *range(7, 14)]))
    form = jc.find_form(net, {"edge": 10e3, "ties": 6e3}, method=jc.Newton(max_steps=60))
    assert int(form.status) in (jc.status.NOT_CONVERGED, jc.status.COLLAPSED)
    first, last = form.nearest.tolist()
    assert last == first + 7  # a tie
    with pytest.raises(jc.AnalysisError) as told:
        jc.raise_if_failed(form)
    text = str(told.value)
    assert f"nodes {first} and {last}" in text and "slide along it" in text
    assert "hinge" not in text and "beam" not in text
    # the advice
    converged(jc.find_form(net, force_density={"edge": 10e3, "ties": 2e3}))
