"""Outside of `jit`, a derivative is a program that starts from the known solution."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.traced import traced

import jaxcable as jc

POINTS = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0], [0.0, 3.0, 2.0]]
DOWN = jnp.array([0.0, 0.0, -1.0])


def cables():
    return jc.Cables([[0, 1], [1, 2], [1, 3]], axial_stiffness=1e5)


def yielding():
    curve = [-0.1, -0.001, 0.001, 0.1], [-300e6, -200e6, 200e6, 300e6]
    law = jc.Polygonal(*curve, unloading="elastic")
    return jc.Bars([[0, 1], [1, 2], [1, 3]], area=1e-5, law=law)


def measured(elements, stages=None):
    """A function of a load and of the nodes: one number of each kind of result."""

    def measure(load, nodes):
        structure = jc.Structure(nodes, elements, supports=jc.pinned([0, 2, 3]))
        loads = jc.NodalLoads([1], load * DOWN)
        phases = [
            jc.Phase(loads=loads, increments=3),
            jc.Phase(loads=jc.combine([loads], [-0.5])[0]),
        ]
        solution = jc.solve(structure, phases if stages is None else stages(loads))
        found = jnp.sum(solution.displacement[1] ** 3) * 1e3 + solution.phases[0].tension[0] / 1e3
        return found + jnp.sum(solution.reactions * jnp.arange(12.0).reshape(4, 3)) / 1e4

    return measure


def added(loads):
    """The third element comes in the second phase, prestressed."""
    return [
        jc.Phase(pretension=jc.only([0, 1], 500.0), loads=loads),
        jc.Phase(adds=jc.only([2]), pretension=jc.only([2], 200.0)),
    ]


KINDS = {
    "net": (measured(cables()), 600.0),
    "history": (measured(yielding()), 3000.0),
    "stages": (measured(cables(), added), 600.0),
    "catenaries": (
        measured(
            jc.Catenaries([[0, 1], [1, 2], [1, 3]], axial_stiffness=1e5, weight=10.0),
            lambda loads: jc.Phase(pretension=400.0, loads=[loads, jc.SelfWeight()]),
        ),
        600.0,
    ),
}


# modes and orders of derivatives, beside the gradient; each one is traced for seconds
ORDERS = {"net": [jax.jacrev, lambda f: jax.grad(jax.grad(f)), jax.hessian]}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_are_those_within_jit(kind):
    """Of any mode and order: the iteration has the same derivative, by another program."""
    measure, load = KINDS[kind]
    nodes = jnp.asarray(POINTS)
    assert np.isfinite(measure(load, nodes))
    both = jax.value_and_grad(measure, (0, 1))
    close = {"rtol": 1e-9, "atol": 1e-12}  # a solve of a tangent, in another order of sums
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, **close),
        both(load, nodes),
        traced(both)(load, nodes),
    )
    for order in ORDERS.get(kind, [jax.jacfwd]):
        derivative = order(lambda load: measure(load, nodes))
        inside = traced(derivative)(load)
        assert abs(inside) > 0
        np.testing.assert_allclose(derivative(load), inside, rtol=1e-8)


NET, (PRESTRESS, LOADING) = jc.scenes.saddle(2, 3, load=200.0)[:2]
FREE = np.setdiff1d(np.arange(NET.n_node), NET.supports.nodes.array)


def scaled_net(scale):
    """Displacement of a net whose nodes and pretension are scaled."""
    moved = jc.replace(NET, nodes=NET.nodes * (1 + scale[0] * np.array([[0.0, 0.0, 1.0]])))
    phases = [jc.replace(PRESTRESS, pretension=1e3 * (1 + scale[1])), LOADING]
    return jc.solve(moved, phases).displacement[FREE]


SCALE, CHANGE = np.array([0.1, 0.2]), np.array([1.0, 0.5])
ONES = np.ones((6, 3))  # as the displacements of the net
LINEAR = {  # of both linear maps: part of the Jacobian, and what computes it
    "push": ("along", lambda push, _: push(CHANGE)),
    "jit of push": ("along", lambda push, _: jax.jit(push)(CHANGE)),
    "batch of batches": ("rows", lambda push, _: jax.vmap(jax.vmap(push))(np.eye(2)[None])[0]),
    "pull": ("sums", lambda _, pull: pull(ONES)[0]),
    "jit of pull": ("sums", lambda _, pull: jax.jit(pull)(ONES)[0]),
    "transpose of push": ("sums", lambda push, _: jax.linear_transpose(push, SCALE)(ONES)[0]),
    "gradient of pull": ("along", lambda _, pull: jax.grad(lambda x: pull(x)[0] @ CHANGE)(ONES)),
    "gradient of batch": (
        "twice",
        lambda push, _: jax.grad(lambda x: jax.vmap(push)(x).sum())(np.eye(2)),
    ),
    "jacrev": ("all", lambda *_: jax.jacrev(scaled_net)(SCALE)),
}


@pytest.fixture(scope="module")
def linear_maps():
    """Parts of the Jacobian of the net, and what `jax.linearize` and `jax.vjp` return of it."""
    J = traced(jax.jacfwd(scaled_net))(SCALE)
    sums = J.sum((0, 1))
    parts = {"all": J, "along": J @ CHANGE, "rows": np.moveaxis(J, -1, 0), "sums": sums}
    maps = jax.linearize(scaled_net, SCALE)[1], jax.vjp(scaled_net, SCALE)[1]
    jc.forget_programs()
    return parts | {"twice": np.tile(sums, (2, 1))}, maps


@pytest.mark.quick_cases("push", "pull", "transpose of push")
@pytest.mark.parametrize("name", LINEAR)
def test_transformations_of_linear_maps(linear_maps, name):
    """They are called later, when their programs have been forgotten."""
    (parts, maps), (part, compute) = linear_maps, LINEAR[name]
    size = 1e-9 * np.abs(parts[part]).max()
    np.testing.assert_allclose(compute(*maps), parts[part], rtol=0, atol=size)


def test_a_failed_analysis_has_no_derivative():
    nodes = np.array(POINTS)
    structure = jc.Structure(nodes, cables(), supports=jc.pinned([0, 2, 3]))

    def tension(load):
        loads = jc.NodalLoads([1], load * DOWN)
        solution = jc.solve(structure, jc.Phase(loads=loads), jc.Newton(max_steps=1))
        return solution.tension[0], solution.status

    (value, code), rate = jax.value_and_grad(tension, has_aux=True)(600.0)
    assert int(code) == jc.status.NOT_CONVERGED and np.isnan(value) and np.isnan(rate)


def test_derivatives_of_the_path_are_nan_or_given():
    structure = jc.Structure(POINTS, cables(), supports=jc.pinned([0, 2, 3]))

    def lowest(load, **options):
        loads = jc.NodalLoads([1], load * DOWN)
        solution = jc.solve(structure, jc.Phase(loads=loads, increments=2), **options)
        return solution.phases[0].path.displacement[0, 1, 2], solution.status

    rate, code = jax.grad(lowest, has_aux=True)(600.0)
    assert int(code) == 0 and np.isnan(rate)
    known = jax.grad(lowest, has_aux=True)(600.0, differentiate_path=True)[0]
    # of a difference over a three-hundredth of the load, squared
    difference = (lowest(601.0)[0] - lowest(599.0)[0]) / 2
    np.testing.assert_allclose(known, difference, rtol=2e-5)


@pytest.mark.slow_cases("True")
@pytest.mark.parametrize("inside", [False, True])
def test_the_last_state_has_no_derivative_where_nothing_has_converged(inside):
    law = jc.Polygonal([0.0, 0.01, 0.02], [0.0, 200e6, 300e6])
    elements = jc.Cables([[0, 1], [1, 2], [1, 3]], area=1e-5, law=law)

    def measured(load):
        structure = jc.Structure(POINTS, elements, supports=jc.pinned([0, 2, 3]))
        solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], load * DOWN)))
        return jnp.sum(solution.last.tension), solution.status

    run = jax.value_and_grad(measured, has_aux=True)
    (value, code), found = (jax.jit(run) if inside else run)(3e6)
    assert int(code) == jc.status.MATERIAL_FAILURE
    assert value == 0.0  # as at the beginning
    assert np.isnan(found)
