"""Forms beside other elements: bearings in any direction, densities, free groups, any loads.

References are closed forms, node balances and integrals by NumPy, the analysis of what was found,
and the same problem turned in space or stated for `solve`.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.problems import pulls_on_nodes
from banks.shapes import pieces
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import jaxcable as jc

EA = 2e6


def turned(angles=(0.3, -0.7, 1.1)):
    """A rotation matrix, [3, 3]."""
    return Rotation.from_euler("XYZ", angles).as_matrix()


def stays_where_found(structure, form, loads=None):
    """Whether an analysis that begins with the form has nothing to do."""
    formed = jc.replace(structure, nodes=form.positions)
    begun = converged(jc.solve(formed, jc.Phase(pretension=form.tension, loads=loads)))
    # the form is found to 1e-10 of its forces, over the stiffness of the elements
    return float(jnp.abs(begun.displacement).max()) < 1e-9


# --- bearings in any direction

N = 8
ROUND = 2 * np.pi * np.arange(N) / N
RADIAL = np.column_stack([np.cos(ROUND), np.sin(ROUND), 0 * ROUND])
AXES = np.stack(
    [RADIAL, np.column_stack([-RADIAL[:, 1], RADIAL[:, 0], 0 * ROUND]), [[0, 0, 1.0]] * N], 1
)
RING = jc.Structure(  # eight stays of 5 m to a ring on radial bearings, drawn with 3 m
    np.vstack([3 * RADIAL, 5 * RADIAL]),
    {
        "ring": jc.Cables(np.column_stack([range(N), np.roll(range(N), -1)]), EA),
        "stays": jc.Cables(np.column_stack([range(N), range(N, 2 * N)]), EA),
    },
    jc.restrained(range(N), "yz", axes=AXES) + jc.pinned(range(N, 2 * N)),
)


def test_ring_on_radial_bearings():
    """``2 T sin(pi/n) = q (R - r)`` at each node of the ring; r and its slope by T."""

    def radius(T):
        form = jc.find_form(RING, {"ring": T}, force_density={"stays": 80.0})
        return jnp.linalg.norm(form.positions[0]), form

    (_, form), rate = jax.value_and_grad(radius, has_aux=True)(200.0)
    assert int(form.status) == 0
    exact = 5 - 2 * 200 * np.sin(np.pi / N) / 80
    assert np.abs(np.linalg.norm(form.positions[:N], axis=1) - exact).max() < 1e-9
    assert float(rate) == pytest.approx(-2 * np.sin(np.pi / N) / 80, rel=1e-9)
    assert np.abs(form.tension["ring"] - 200).max() < 1e-11
    assert np.abs(form.force_density["stays"] - 80).max() < 1e-11
    assert stays_where_found(RING, form)


def test_force_density_on_radial_bearings():
    """``2 q_r r (1 - cos 2 pi/n) = q_s (R - r)``; linear, to rounding."""
    q = {"ring": 100.0, "stays": 80.0}
    places = jc.force_density(RING, q)
    exact = 80 * 5 / (80 + 200 * (1 - np.cos(2 * np.pi / N)))
    assert np.abs(places[:N] - exact * RADIAL).max() < 1e-12
    assert np.abs(jc.find_form(RING, force_density=q).positions - places).max() < 1e-12
    free = jc.force_density(RING, {"ring": 0.0, "stays": 0.0})
    assert np.isnan(free).any()


SADDLE, _ = jc.scenes.saddle(2, 2, rise=0.3, axial_stiffness=EA)
PART = [n for n in range(SADDLE.n_node) if SADDLE.fixed(SADDLE.supports).array[n].all()]
FREE = np.setdiff1d(range(SADDLE.n_node), PART)
Q = np.random.default_rng(0).uniform(500, 900, 12)


@pytest.mark.slow
def test_a_form_turned_in_space_is_the_turned_form():
    """Two bearings slide along y; turned, they slide along an inclined line, by other code."""
    slides = PART[:2]
    turn = turned()
    push = np.random.default_rng(1).normal(size=(len(FREE), 3)) * 20

    def find(nodes, axes, force):
        held = jc.pinned(PART[2:]) + jc.restrained(slides, "xz", axes=axes)
        structure = jc.replace(SADDLE, nodes=nodes, supports=held)
        loads = [jc.NodalLoads(FREE, force)]
        form = converged(jc.find_form(structure, force_density=Q, loads=loads, method=TIGHT))
        return np.asarray(form.positions), structure, loads

    straight, structure, loads = find(SADDLE.nodes, np.eye(3), push)
    places, inclined, turned_loads = find(SADDLE.nodes @ turn.T, turn.T, push @ turn.T)
    assert np.abs(straight[slides, 1] - SADDLE.nodes[slides, 1]).max() > 0.1
    assert np.abs(places - straight @ turn.T).max() < 1e-12
    by_density = jc.force_density(inclined, Q, turned_loads)
    assert np.abs(by_density - straight @ turn.T).max() < 1e-12
    assert np.abs(jc.force_density(structure, Q, loads) - straight).max() < 1e-12


# --- densities, forces and lengths in one problem


@pytest.mark.slow
def test_three_statements_in_one_problem():
    """Each holds, and the nodes balance by NumPy."""
    kinds = np.arange(12) % 3
    q, T, L = (np.flatnonzero(kinds == k) for k in range(3))
    length = np.linalg.norm(
        np.diff(SADDLE.nodes[SADDLE.elements.links.array], axis=1)[:, 0], axis=1
    )
    given = {
        "force_density": jc.only(q, Q[q]),
        "tension": jc.only(T, Q[T] * length[T]),
        "length": jc.only(L, 1.02 * length[L]),
    }
    loads = jc.NodalLoads(FREE, (3.0, -5.0, -40.0))
    form = converged(jc.find_form(SADDLE, loads=loads, method=jc.Newton(tol=1e-12), **given))
    x = np.asarray(form.positions)
    found = np.linalg.norm(np.diff(x[SADDLE.elements.links.array], axis=1)[:, 0], axis=1)
    assert np.abs(found[L] / (1.02 * length[L]) - 1).max() < 1e-10
    assert np.abs(np.asarray(form.tension)[q] / found[q] / Q[q] - 1).max() < 1e-10
    assert np.abs(np.asarray(form.tension)[T] / (Q[T] * length[T]) - 1).max() < 1e-10
    left = pulls_on_nodes(SADDLE, form.positions, form.tension)[FREE] + [3.0, -5.0, -40.0]
    assert np.abs(left).max() < 1e-10 * np.abs(form.tension).max()
    # the same where a support holds another direction, by the method of multipliers
    held = jc.pinned(PART[1:]) + jc.restrained(PART[:1], "xyz", axes=turned())
    other = converged(
        jc.find_form(
            jc.replace(SADDLE, supports=held), loads=loads, method=jc.Newton(tol=1e-12), **given
        )
    )
    assert np.abs(other.positions - x).max() < 1e-10
    assert np.abs(other.tension - form.tension).max() < 1e-8 * np.abs(form.tension).max()


# --- elements that keep their law

MAST_EA, HEIGHT, FOOT = 1e6, 3.0, 4.0
GUYED = jc.Structure(  # a mast between two guys, its head guided along z
    [[0.0, 0, 0], [0, 0, HEIGHT], [-FOOT, 0, 0], [FOOT, 0, 0]],
    {
        "guys": jc.Cables([[1, 2], [1, 3]], axial_stiffness=EA, weight=30.0),
        "mast": jc.Bars([[0, 1]], axial_stiffness=MAST_EA, weight=50.0),
    },
    jc.pinned([0, 2, 3]) + jc.restrained([1], "xy"),
)


@pytest.mark.slow
def test_an_elastic_mast_under_guys_of_given_force():
    """Its shortening by one equation; both ways to build what was found."""
    T = 20e3
    form = converged(jc.find_form(GUYED, tension={"guys": T}))

    def unbalanced(z):
        return MAST_EA * (z - HEIGHT) / HEIGHT + 2 * T * z / np.hypot(z, FOOT)

    z = brentq(unbalanced, 0.5 * HEIGHT, HEIGHT, xtol=1e-14)
    assert float(form.positions[1, 2]) == pytest.approx(z, abs=1e-9)
    assert float(form.tension["mast"][0]) == pytest.approx(MAST_EA * (z / HEIGHT - 1), rel=1e-8)
    assert np.abs(form.tension["guys"] - T).max() == 0
    assert float(form.rest_length["mast"][0]) == HEIGHT
    assert np.abs(form.length["guys"] - np.hypot(z, FOOT)).max() < 1e-9
    assert np.abs(form.rest_length["guys"] * (1 + T / EA) - np.hypot(z, FOOT)).max() < 1e-9
    assert stays_where_found(GUYED, form)
    built = converged(jc.solve(GUYED, jc.Phase(rest_length={"guys": form.rest_length["guys"]})))
    assert np.abs(built.positions - form.positions).max() < 1e-9


LEAN = 4
POST = jc.Structure(  # a cantilever of beams, and a cable to a far anchor
    np.vstack([pieces(LEAN, 6.0, (0.0, 0.0, 1.0))[0], [[-1e5, 0, 6.0]]]),
    {
        "cable": jc.Cables([[LEAN, LEAN + 1]], axial_stiffness=1e7),
        "post": jc.Beams(pieces(LEAN)[1], section=jc.Section.linear(1e9, 2e6, 2e6, 1e6)),
    },
    jc.clamped([0]) + jc.pinned([LEAN + 1]),
)


@pytest.mark.slow
def test_a_cantilever_under_a_cable_of_given_force():
    """``w = F h^3 / 3 EI + P a^2 (3 h - a) / 6 EI``, a load P within a beam at the height a.

    Bent beams are built from the drawn shape with the lengths found, or by a jack.
    """
    push = jc.PointLoads([1], 0.5, (-50.0, 0.0, 0.0), on="post")
    form = converged(jc.find_form(POST, tension={"cable": 100.0}, loads=push))
    height, a = 6.0, 2.25
    exact = (100 * height**3 / 3 + 50 * a**2 * (3 * height - a) / 6) / 2e6
    # to the square of the slope F h^2 / 2 EI, 1e-6
    assert float(-form.positions[LEAN, 0]) == pytest.approx(exact, rel=1e-5)
    jacked = jc.solve(POST, jc.Phase(jacking={"cable": 100.0}, loads=push))
    rest = {"cable": form.rest_length["cable"]}
    built = jc.solve(POST, jc.Phase(rest_length=rest, loads=push))
    for other in (jacked, built):
        assert int(other.status) == 0
        # the unstressed length of the cable has its digits only: eps 1e5 m
        assert np.abs(other.positions - form.positions).max() < 1e-9
    assert np.abs(form.length["post"] - 1.5).max() < 1e-5
    assert float(form.tension["post"][0]) == pytest.approx(
        float(jacked.tension["post"][0]), abs=1e-6
    )


# --- loads

NET = jc.replace(
    SADDLE,
    elements=jc.Cables(SADDLE.elements.links, axial_stiffness=EA, weight=30.0),
    supports=jc.pinned(PART[1:]) + jc.restrained(PART[:1], "xy", axes=turned()),
)
FACES = jc.net_faces(NET.nodes, NET.elements.links, border="ends")
BREEZE = jc.WindTable(heights=[0.0, 2.0], pressures=[300.0, 600.0])


@pytest.mark.slow
def test_all_loads_that_an_analysis_takes():
    """An analysis of the form begins in equilibrium, and without the wind it moves."""
    loads = [
        jc.SelfWeight(),
        jc.LineLoads((40.0, 0, -60.0), per="projected", elements=jc.only([1, 4, 5]), on=None),
        jc.AreaLoads(FACES, (0.0, 0, -30.0)),
        jc.WindLoads((1.0, 0.5, 0.0), BREEZE, drag=1.2, diameter=0.02, geometry="begun"),
        jc.IceLoads(thickness=0.01, diameter=0.02),
        jc.FacePressure(FACES, 50.0),
        jc.CablePressure(20.0, axis=(0.0, 1.0, 0.0)),
        jc.NodalLoads(FREE, (0.0, 20.0, -100.0)),
    ]
    form = converged(jc.find_form(NET, tension=2e3, loads=loads))
    assert stays_where_found(NET, form, loads)
    formed = jc.replace(NET, nodes=form.positions)
    calm = [load for load in loads if not isinstance(load, jc.WindLoads)]
    other = converged(jc.solve(formed, jc.Phase(pretension=form.tension, loads=calm)))
    assert float(jnp.abs(other.displacement).max()) > 1e-6


def test_polygon_under_pressure():
    """Equal forces under pressure: chords of a circle, ``T = p R cos(t/2)``, each of angle t."""
    n, radius, p, angle = 6, 2.0, 300.0, 1.5
    T = p * radius * np.cos(angle / n / 2)
    around = np.linspace(-angle / 2, angle / 2, n + 1)
    exact = radius * np.column_stack([np.sin(around), 0 * around, np.cos(around)])
    nodes = exact.copy()
    nodes[1:n, 2] -= 0.1
    nodes[2, 0] += 0.1
    held = jc.pinned([0, n]) + jc.restrained(range(1, n), "y")
    chain = jc.Structure(nodes, jc.Cables(pieces(n)[1], EA), held)
    form = converged(jc.find_form(chain, T, jc.CablePressure(p, axis=(0.0, -1.0, 0.0))))
    assert np.abs(form.positions - exact).max() < 1e-8
    assert stays_where_found(chain, form, jc.CablePressure(p, axis=(0.0, -1.0, 0.0)))


TENT = jc.Structure(  # four cables from the corners of a square of 4 m to a node, under pressure
    [[2.0, 2, 0], [-2, 2, 0], [-2, -2, 0], [2, -2, 0], [0.1, 0.2, 1.0]],
    jc.Cables([[0, 4], [1, 4], [2, 4], [3, 4]], axial_stiffness=EA),
    jc.pinned(range(4)),
)


SIDES = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]


def tent(q, pressure, shift):
    loads = [
        jc.FacePressure(SIDES, pressure),
        jc.SupportMovement([0], shift * jnp.array([1.0, 0.0, 2.0])),
    ]
    form = jc.find_form(TENT, force_density=q, loads=loads)
    return form.positions[4, 2], form.status


@pytest.mark.slow
def test_inner_pressure_and_a_moved_support():
    """``4 q (z - mean height of corners) = p A / 3`` of the plan; in a batch, with gradients."""
    q, p, shift = jnp.array([[100.0, 150, 90], [30, 20, 10], [0.0, 0, 0.4]])
    found = jax.vmap(jax.value_and_grad(tent, argnums=(0, 1), has_aux=True))(q, p, shift)
    (z, status), (by_q, by_p) = found
    assert not status.any()
    # the plan with a corner moved by d along x: 4 x 4 and a triangle of d and 4
    area = 16 + 2 * shift
    exact = p * area / 12 / q + shift / 2
    assert np.abs(z - exact).max() < 1e-9
    assert np.abs(by_p - area / 12 / q).max() < 1e-9
    assert np.abs(by_q + p * area / 12 / q**2).max() < 1e-9


# --- derivatives, batches, failures


def bay(p, lengths=False):
    """A guided mast under a loaded cable: a force, a density, EA, a load, a length, and its span.

    The span is that of all supports, in plan.
    """
    nodes = np.array([[0.0, 0, 0], [0, 0, 3], [-4, 0, 0], [3, 1, 3.0], [6, 0, 2.0], [3, -4, 1.0]])
    nodes = nodes * jnp.stack([p[5], 1.0, 1.0])[None]
    elements = {
        "guy": jc.Cables([[1, 2]], EA, weight=30.0),
        "cables": jc.Cables([[1, 3], [3, 4]], EA, weight=20.0),
        "tie": jc.Cables([[3, 5]], EA),
        "mast": jc.Bars([[0, 1]], 1e6 * p[2], weight=50.0),
    }
    held = jc.pinned([0, 2, 4, 5]) + jc.restrained([1], "y", axes=turned((0.1, 0.2, 0.0)))
    structure = jc.Structure(nodes, elements, held)
    loads = [jc.SelfWeight(), jc.NodalLoads([3], p[3] * jnp.array([0.0, 0.0, -300.0]))]
    given = {"tension": {"guy": 8e3 * p[0]}, "force_density": {"cables": 2e3 * p[1]}}
    if lengths:
        given["length"] = {"tie": 3.9 * p[4]}
    else:
        given["tension"]["tie"] = 900.0 * p[4]
    return jc.find_form(structure, loads=loads, method=TIGHT, **given)


@pytest.mark.slow
@pytest.mark.parametrize("lengths", [False, True])
def test_gradient(lengths):
    """By force, density, EA of the mast, load, force or length of the tie, places of supports."""

    def number(p):
        form = bay(p, lengths)
        rests = sum(jnp.sum(jnp.cos(rest)) for rest in form.rest_length.values())
        total = jnp.sum(jnp.sin(form.positions[3] + jnp.arange(3.0))) + form.positions[1, 2]
        return total + rests + 1e-3 * form.tension["tie"][0], form.status

    gradient = assert_gradient(number, jnp.ones(6), 20.0)
    assert (np.abs(gradient) > 1e-6).all()  # each number counts


def test_unknown_lengths_are_a_status():
    """A cable longer than its ends can be apart would push; none is as short as a node is far."""
    short = jc.find_form(GUYED, length={"guys": jnp.array([3.9, 3.9])})
    assert int(short.status) != 0 and np.isnan(short.positions).all()
    long = jc.find_form(GUYED, length={"guys": jnp.array([5.2, 5.2])})
    assert int(long.status) == jc.status.PUSHING_CABLE and np.isnan(long.positions).all()
