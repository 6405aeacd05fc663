"""Form finding under self-weight, line and area loads: a catenary, nodes in balance by NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc


def chain(n, stiffness):
    """Cables between two level points 40 m apart, n of equal length in plan."""
    x = np.linspace(-20, 20, n + 1)
    links = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    cables = jc.Cables(links, axial_stiffness=stiffness, weight=20.0)
    return jc.Structure(np.column_stack([x, 0 * x, 0 * x]), cables, jc.pinned([0, n]))


def test_a_chain_under_its_weight_is_a_catenary():
    """q = H / dx keeps the plan even; z = a cosh(x/a), a = H/w, at the second order in dx."""
    errors = []
    for n in (8, 16):
        places = np.asarray(jc.force_density(chain(n, 1e14), 1000.0 * n / 40, jc.SelfWeight()))
        assert places[:, 0] == pytest.approx(np.linspace(-20, 20, n + 1), abs=1e-12)
        exact = 50 * (np.cosh(places[:, 0] / 50) - np.cosh(20 / 50))
        errors.append(np.abs(places[:, 2] - exact).max())
    assert 1e-4 < errors[1] < 2e-3  # dx^2 / 8a of the sag of 4 m, about
    assert 1.95 < np.log2(errors[0] / errors[1]) < 2.05


def net(stiffness=2e6):
    """Saddle of 12 cables with weight, its faces, and what acts on it."""
    structure, _ = jc.scenes.saddle(2, 2, spacing=2.0, rise=0.15)
    links = structure.elements.links
    cables = jc.Cables(links, axial_stiffness=stiffness, weight=30.0)
    structure = jc.replace(structure, elements=cables)
    return structure, jc.net_faces(structure.nodes, links, border="ends")


def acting(faces, scale=1.0):
    return [
        jc.SelfWeight((0, 0, -scale)),
        jc.LineLoads(scale * jnp.array([40.0, 0, -60.0]), per="projected"),
        jc.AreaLoads(faces, scale * jnp.array([0.0, 0, -300.0]), per="initial"),
        jc.NodalLoads([4], scale * jnp.array([0.0, 20.0, -100.0])),
    ]


def unbalanced(structure, faces, places, tension):
    """Forces at the free nodes, from places and tensions alone; faces are quads and triangles."""
    total = np.zeros_like(places)
    total[4] += [0, 20, -100]
    force = np.array([40.0, 0, -60.0])
    for (i, j), axial in zip(structure.elements.links.array, tension, strict=True):
        way = places[j] - places[i]
        length = np.linalg.norm(way)
        total[i] += axial * way / length
        total[j] -= axial * way / length
        weight = np.array([0, 0, -30.0]) * length / (1 + axial / 2e6)
        seen = np.linalg.norm(np.cross(way, force)) / np.linalg.norm(force)
        for end in (i, j):
            total[end] += 0.5 * (weight + force * seen)
    for face in faces:
        corners = list(face)
        splits = [((0, 1, 2), 1.0)]
        if len(set(corners)) == 4:
            splits = [((0, 1, 2), 0.5), ((0, 2, 3), 0.5), ((0, 1, 3), 0.5), ((1, 2, 3), 0.5)]
        for numbers, share in splits:
            a, b, c = (places[corners[k]] for k in numbers)
            area = 0.5 * share * np.linalg.norm(np.cross(b - a, c - a))
            for k in numbers:
                total[corners[k]] += [0, 0, -300.0 * area / 3]
    return total[~structure.held().any(axis=1)]


def test_a_net_under_all_loads_is_in_balance():
    """Every node by NumPy, of prescribed forces and of densities; an analysis begins there."""
    structure, faces = net()
    loads = acting(faces)
    form = jc.find_form(structure, tension=8e3, loads=loads)
    assert int(form.status) == 0
    places = np.asarray(form.positions)
    assert np.abs(places - structure.nodes).max() > 0.05
    left = unbalanced(structure, faces, places, np.full(12, 8e3))
    assert np.abs(left).max() < 1e-9 * 4 * 8e3  # tol 1e-10 of four forces and some loads
    begun = jc.solve(
        jc.replace(structure, nodes=form.positions),
        jc.Phase(pretension=form.tension, loads=loads),
    )
    assert int(begun.status) == 0 and float(jnp.abs(begun.displacement).max()) < 1e-9
    places = np.asarray(jc.force_density(structure, 4e3, loads))
    links = structure.elements.links.array
    length = np.linalg.norm(places[links[:, 1]] - places[links[:, 0]], axis=1)
    left = unbalanced(structure, faces, places, 4e3 * length)
    assert np.abs(left).max() < 1e-9 * 4 * 8e3


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["dense", "superlu"])
@pytest.mark.parametrize("find", ["forces", "densities"])
def test_gradient(find, solver):
    structure, faces = net(2e5)
    free = np.flatnonzero(~structure.held().any(axis=1))

    @jax.jit
    def value(p):
        loads = acting(faces, p[0])
        if find == "densities":
            return jc.force_density(structure, p[1], loads, solver)[free[1], 2]
        method = jc.Newton(tol=1e-13, linear_solver=solver)
        return jc.find_form(structure, 2 * p[1], loads, method=method).positions[free[1], 2]

    p = jnp.array([1.0, 2e3])
    gradient = jax.grad(value)(p)
    direction = jnp.array([1.0, -700.0])
    rate, start = float(gradient @ direction), value(p)

    def remainders(rate):
        steps = 0.1 * 0.5 ** np.arange(4)
        left = [abs(float(value(p + h * direction) - start - h * rate)) for h in steps]
        return np.polyfit(np.log(steps), np.log(left), 1)[0]

    assert 1.9 < remainders(rate) < 2.1
    assert remainders(1.02 * rate) < 1.5


def test_refused_and_failed():
    structure, faces = net()
    with pytest.raises(ValueError, match=r"loads\[1\]: FacePressure is not known before the form"):
        jc.force_density(structure, 1e3, [jc.SelfWeight(), jc.FacePressure(faces, 1.0)])
    with pytest.raises(ValueError, match="SelfWeight depends on unstressed lengths and places"):
        jc.find_form(structure, length=2.0, loads=jc.SelfWeight())
    with pytest.raises(
        ValueError, match=r"loads\[0\]: SelfWeight is not known .* takes NodalLoads"
    ):
        jc.forms.dynamic_relaxation(structure, loads=jc.SelfWeight())
    with pytest.raises(ValueError, match="SelfWeight: no element group has a weight"):
        jc.force_density(jc.scenes.flat_net()[0], 1e3, jc.SelfWeight())
