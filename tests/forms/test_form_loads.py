"""Form finding under self-weight, line and area loads: a catenary, nodes in balance by NumPy."""

import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import pieces
from oracles.convergence import converged
from oracles.taylor import assert_gradient

import jaxcable as jc


def chain(n):
    """Cables between two level points 40 m apart, n of equal length in plan."""
    nodes, links = pieces(n, 40.0)
    cables = jc.Cables(links, axial_stiffness=1e14, weight=20.0)
    return jc.Structure(nodes - [20.0, 0, 0], cables, jc.pinned([0, n]))


def test_a_chain_under_its_weight_is_a_catenary():
    """q = H / dx keeps the plan even; z = a cosh(x/a), a = H/w, at the second order in dx."""
    errors = []
    for n in (8, 16):
        places = np.asarray(jc.force_density(chain(n), 1000.0 * n / 40, jc.SelfWeight()))
        assert places[:, 0] == pytest.approx(np.linspace(-20, 20, n + 1), abs=1e-12)
        exact = 50 * (np.cosh(places[:, 0] / 50) - np.cosh(20 / 50))
        errors.append(np.abs(places[:, 2] - exact).max())
    assert 1e-4 < errors[1] < 2e-3  # dx^2 / 8a of the sag of 4 m, about
    assert 1.95 < np.log2(errors[0] / errors[1]) < 2.05


# a saddle of 12 cables with weight
BARE, _ = jc.scenes.saddle(2, 2, spacing=2.0, rise=0.15)
LINKS = BARE.elements.links
EA = 2e6
NET = jc.replace(BARE, elements=jc.Cables(LINKS, axial_stiffness=EA, weight=30.0))
FACES = jc.net_faces(NET.nodes, LINKS, border="ends")
FREE = np.flatnonzero(~NET.held_displacements().any(axis=1))


def acting(scale=1.0):
    return [
        jc.SelfWeight((0, 0, -scale)),
        jc.LineLoads(scale * jnp.array([40.0, 0, -60.0]), per="projected"),
        jc.AreaLoads(FACES, scale * jnp.array([0.0, 0, -300.0]), per="initial"),
        jc.NodalLoads([4], scale * jnp.array([0.0, 20.0, -100.0])),
    ]


def unbalanced(places, tension):
    """Forces at the free nodes, from places and tensions alone; faces are quads and triangles."""
    total = np.zeros_like(places)
    total[4] += [0, 20, -100]
    force = np.array([40.0, 0, -60.0])
    for (i, j), axial in zip(LINKS.array, tension, strict=True):
        way = places[j] - places[i]
        length = np.linalg.norm(way)
        total[i] += axial * way / length
        total[j] -= axial * way / length
        weight = np.array([0, 0, -30.0]) * length / (1 + axial / EA)
        seen = np.linalg.norm(np.cross(way, force)) / np.linalg.norm(force)
        for end in (i, j):
            total[end] += 0.5 * (weight + force * seen)
    for face in FACES:
        corners = list(face)
        splits = [((0, 1, 2), 1.0)]
        if len(set(corners)) == 4:
            splits = [((0, 1, 2), 0.5), ((0, 2, 3), 0.5), ((0, 1, 3), 0.5), ((1, 2, 3), 0.5)]
        for numbers, share in splits:
            a, b, c = (places[corners[k]] for k in numbers)
            area = 0.5 * share * np.linalg.norm(np.cross(b - a, c - a))
            for k in numbers:
                total[corners[k]] += [0, 0, -300.0 * area / 3]
    return np.abs(total[FREE]).max()


LEFT = 1e-9 * 4 * 8e3  # N: tol 1e-10 of four forces and some loads


@pytest.mark.slow
def test_a_net_under_all_loads_is_in_balance():
    """Every node by NumPy, of prescribed forces and of densities; an analysis begins there."""
    form = converged(jc.find_form(NET, tension=8e3, loads=acting()))
    places = np.asarray(form.positions)
    assert np.abs(places - NET.nodes).max() > 0.05
    assert unbalanced(places, np.full(12, 8e3)) < LEFT
    formed = jc.replace(NET, nodes=form.positions)
    begun = jc.solve(formed, jc.Phase(pretension=form.tension, loads=acting()))
    assert int(begun.status) == 0 and int(begun.phases[0].path.iterations[0]) == 0
    assert float(jnp.abs(begun.displacement).max()) < 1e-9
    places = np.asarray(jc.force_density(NET, 4e3, acting()))
    length = np.linalg.norm(places[LINKS.array[:, 1]] - places[LINKS.array[:, 0]], axis=1)
    assert unbalanced(places, 4e3 * length) < LEFT


@pytest.mark.slow_cases("densities")
@pytest.mark.parametrize("given", ["forces", "densities"])
def test_gradient(given):
    """By the loads, the prestress, and the stiffness (unstressed lengths weigh)."""

    def value(p):
        structure = jc.replace(NET, elements=jc.replace(NET.elements, axial_stiffness=1e5 * p[2]))
        loads = acting(p[0])
        if given == "densities":
            return jc.force_density(structure, 2e3 * p[1], loads, "superlu")[FREE[1], 2]
        method = jc.Newton(tol=1e-13, linear_solver="dense")
        form = jc.find_form(structure, 4e3 * p[1], loads, method=method)
        return form.positions[FREE[1], 2], form.status

    assert_gradient(value, [1.0, 1.0, 2.0], 200.0, corrupted=1.1)
