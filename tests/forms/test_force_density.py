"""The force density method against closed forms, dense algebra in NumPy and differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.problems import INSTALLED as SOLVERS
from oracles.traced import traced

import jaxcable as jc
from jaxcable.forms import force_density
from jaxcable.forms.force_density import AxisEquilibrium

# compiled anew for each solver: one that solves inside of the program, and one that it calls
TWO = [pytest.param("dense", marks=pytest.mark.slow), SOLVERS[-1]]


def random_net(seed=0, n=8, negative=False, mask=None):
    """Bars between random nodes, random force densities and loads."""
    rng = np.random.default_rng(seed)
    links = np.array([(i, j) for i in range(n) for j in range(i + 1, n) if (i + j) % 3])
    held = mask if mask is not None else np.repeat(np.arange(n)[:, None] < 3, 3, axis=1)
    structure = jc.Structure(
        rng.normal(size=(n, 3)), jc.Bars(links, axial_stiffness=1e4), jc.Supports(held)
    )
    q = rng.uniform(1, 3, len(links))
    if negative:
        q[::4] *= -0.3
    return structure, q, rng.normal(size=(n, 3))


def loads(force):
    return jc.NodalLoads(np.arange(8), force)


def by_dense_algebra(structure, q, load):
    """The same in NumPy with the incidence matrix, direction by direction."""
    links, nodes = structure.elements.links.array, np.asarray(structure.nodes)
    fixed = structure.fixed(structure.supports)
    C = np.zeros((len(links), len(nodes)))
    C[np.arange(len(links)), links[:, 0]], C[np.arange(len(links)), links[:, 1]] = 1, -1
    D, x = C.T @ np.diag(q) @ C, nodes.copy()
    for axis in range(3):
        f, s = ~fixed[:, axis], fixed[:, axis]
        x[f, axis] = np.linalg.solve(D[np.ix_(f, f)], load[f, axis] - D[np.ix_(f, s)] @ x[s, axis])
    return x


def test_constant_force_density_gives_a_harmonic_surface():
    """z = x^2 - y^2 is harmonic for differences too: the saddle's nodes come back."""
    structure, _ = jc.scenes.saddle(7, 7)
    start = np.array(structure.nodes)
    free = ~np.asarray(structure.fixed(structure.supports))[:, 0]
    start[free] += 1.0  # coordinates of free nodes do not count
    x = force_density(jc.replace(structure, nodes=start), 3.7)
    # rounding of 49 unknowns, condition about 30
    assert np.abs(x - structure.nodes).max() < 1e-13


@pytest.mark.parametrize("solver", SOLVERS)
def test_against_dense_algebra(solver):
    """Tensions, some struts, and sliding supports: each direction has its own unknowns."""
    mask = np.zeros((8, 3), bool)
    mask[:2] = True
    mask[2] = [True, False, False]
    mask[3, 2] = True
    for given in ({}, {"negative": True}, {"seed": 1, "mask": mask}):
        structure, q, load = random_net(**given)
        x = force_density(structure, q, loads(load), solver)
        expected = by_dense_algebra(structure, q, load)
        # rounding: conditions below 100
        assert np.abs(x - expected).max() < 1e-12 * np.abs(expected).max()
        held = structure.held_displacements()
        assert (np.asarray(x)[held] == np.asarray(structure.nodes)[held]).all()


@pytest.mark.parametrize("solver", TWO)
def test_transformations(solver):
    """jit, vmap, grad, jvp, jacfwd, jacrev, hessian agree, and with dense algebra in jax."""
    structure, q, load = random_net(negative=True)
    nodes, links = jnp.asarray(structure.nodes), structure.elements.links.array
    free = np.flatnonzero(~structure.fixed(structure.supports)[:, 0])
    held = np.setdiff1d(np.arange(8), free)
    C = np.zeros((len(links), 8))
    C[np.arange(len(links)), links[:, 0]], C[np.arange(len(links)), links[:, 1]] = 1, -1
    weights = jnp.asarray(np.random.default_rng(5).normal(size=(8, 3)))

    def ours(p):
        moved = jc.replace(structure, nodes=nodes * p[-1])
        return force_density(moved, p[:-2], loads(p[-2] * load), solver)

    def plain(p):
        D, x = C.T @ (p[:-2, None] * C), nodes * p[-1]
        right = p[-2] * load[free] - D[np.ix_(free, held)] @ x[held]
        return x.at[free].set(jnp.linalg.solve(D[np.ix_(free, free)], right))

    def measure(f):
        return lambda p: jnp.sum(weights * f(p)) ** 2

    p = jnp.append(jnp.asarray(q), jnp.array([1.5, 0.7]))
    direction = jnp.asarray(np.random.default_rng(6).normal(size=p.shape))
    batch = jnp.stack([p, 1.1 * p, p + 0.01])

    def everything(f):
        """Value, Jacobians, tangent, gradient, gradients of a batch, Hessian."""
        return (
            f(p),
            jax.jacfwd(f)(p),
            jax.jacrev(f)(p),
            jax.jvp(f, (p,), (direction,))[1],
            jax.grad(measure(f))(p),
            jax.vmap(jax.grad(measure(f)))(batch),
            jax.hessian(measure(f))(p),
        )

    found, expected = (traced(lambda f=f: everything(f))() for f in (ours, plain))
    for own, other in zip(found, expected, strict=True):
        # rounding times a condition below 100, twice
        assert np.abs(own - other).max() < 1e-11 * np.abs(other).max()
    assert np.abs(ours(p) - found[0]).max() < 1e-13  # without jit


def test_groups_and_prefixes():
    structure, _ = jc.scenes.saddle(2, 2)
    links = structure.elements.links.array
    groups = {
        "rows": jc.Cables(links[:6], axial_stiffness=1e5),
        "columns": jc.Bars(links[6:], axial_stiffness=1e5),
    }
    both = jc.replace(structure, elements=groups)
    x = force_density(both, {"rows": 2.0, "columns": np.full(6, 3.0)})
    expected = force_density(structure, np.repeat([2.0, 3.0], 6))
    assert np.abs(x - expected).max() < 1e-14


@pytest.mark.parametrize("solver", TWO)
def test_singular_matrix_is_nan_with_nan_derivatives(solver):
    """Struts and cables that cancel; beside it in a batch a sound case stays exact."""
    x = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 1.0]])
    structure = jc.Structure(x, jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e4), jc.pinned([0, 2]))

    @traced
    def place(q):
        return force_density(structure, q, None, solver)

    q = jnp.array([1.0, -1.0])
    assert np.isnan(place(q)[1]).all() and np.isfinite(np.asarray(place(q))[[0, 2]]).all()
    assert np.isnan(traced(jax.grad(lambda q: place(q)[1, 2]))(q)).all()
    assert np.isnan(traced(jax.jacfwd(place))(q)[1]).all()
    batch = jnp.stack([q, jnp.array([1.0, 3.0])])
    assert np.abs(traced(jax.vmap(place))(batch)[1, 1] - np.array([1.5, 0, 0.75])).max() < 1e-15

    def shared(scale):  # of the second case only
        return jax.vmap(place)(scale * batch + jnp.array([[0.0, 0], [0, 1.0]]))[1, 1, 2]

    # z = q2 / (q1 + q2) with q2 = 3 s + 1, q1 = s
    assert abs(traced(jax.grad(shared))(1.0) - (3 * 5 - 4 * 4) / 25) < 1e-14
    assert np.isnan(place(jnp.array([jnp.nan, 1.0]))[1]).all()


def test_changing_numbers_is_not_traced_again_and_equal_shapes_share(monkeypatch):
    structure, _ = jc.scenes.saddle(3, 2)
    load = jc.NodalLoads([4], (0.0, 0.0, -1.0))
    force_density(structure, 1.0, load)
    traced, build = [], AxisEquilibrium.build
    monkeypatch.setattr(AxisEquilibrium, "build", lambda *a: traced.append(1) or build(*a))
    force_density(jc.replace(structure, nodes=np.asarray(structure.nodes) * 2), 2.0, load)
    order = np.random.default_rng(0).permutation(structure.n_node)
    back = np.argsort(order)
    renumbered = jc.Structure(
        np.asarray(structure.nodes)[order],
        jc.Cables(back[structure.elements.links.array], axial_stiffness=1.0),
        jc.pinned(back[structure.supports.nodes.array]),
    )
    x = force_density(renumbered, np.full(17, 3.0), jc.NodalLoads([7], (0.0, 0.0, 0.0)))
    assert not traced
    assert np.abs(x[back] - force_density(structure, 1.0)).max() < 1e-14


def test_single_precision():
    structure, q, load = random_net()
    single = jax.tree.map(lambda v: np.asarray(v, np.float32), structure)
    x = force_density(single, q, loads(load))
    assert x.dtype == jnp.float32
    assert np.abs(x - by_dense_algebra(structure, q, load)).max() < 1e-5
