"""Every transformation of jax runs on `solve` and agrees with plain evaluation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.problems import INSTALLED

import jaxcable as jc

STRUCTURE, _ = jc.scenes.flat_net()
FREE = np.array([3, 4, 7, 8])
METHODS = {
    "newton": jc.Newton(tol=1e-13),
    "tangent": jc.Incremental(1, tol=9.0),
    "superlu": jc.Newton(tol=1e-13, linear_solver="superlu"),
    "tangent, superlu": jc.Incremental(1, tol=9.0, linear_solver="superlu"),
}
for name in [name for name in ("cholmod", "pardiso") if name in INSTALLED]:
    METHODS[name] = jc.Newton(tol=1e-13, linear_solver=name)

# compiled anew for every method, and alike: one is enough but for `make test-all`
NAMES = [pytest.param(n, marks=pytest.mark.slow if n != "newton" else []) for n in METHODS]
NEWTONS = [name for name in NAMES if "tangent" not in name.values[0]]
P = jnp.array([180.0, 220.0, -5.0])  # pretension of rows and of columns, load


def make(method):
    def end(p):
        tension = jnp.repeat(p[:2], 6, total_repeat_length=12)
        load = jc.NodalLoads(FREE, jnp.stack([3.0, 1.0, p[2]]))
        phases = [jc.Phase(pretension=tension, increments=2), jc.Phase(loads=load, increments=2)]
        solution = jc.solve(STRUCTURE, phases, method)
        return 1e3 * solution.displacement[3]

    return end


def differences(f, p, h):
    return jnp.stack([(f(p + h * e) - f(p - h * e)) / (2 * h) for e in jnp.eye(len(p))], axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_first_derivatives(name):
    end = make(METHODS[name])
    value = end(P)
    assert jnp.isfinite(value).all()
    assert jnp.abs(jax.jit(end)(P) - value).max() < 1e-12
    expected = differences(end, P, 1e-2)
    # central differences with h = 1e-2 of 100 N: relative truncation near 1e-8
    size = jnp.abs(expected).max()
    forward, backward = jax.jacfwd(end)(P), jax.jacrev(end)(P)
    assert jnp.abs(forward - expected).max() < 1e-6 * size
    assert jnp.abs(forward - backward).max() < 1e-12 * size


@pytest.mark.parametrize("name", NEWTONS)
def test_jvp(name):
    end, vector = make(METHODS[name]), jnp.array([0.3, -1.0, 2.0])
    value, tangent = jax.jvp(end, (P,), (vector,))
    assert jnp.abs(value - end(P)).max() < 1e-12
    expected = (end(P + 1e-3 * vector) - end(P - 1e-3 * vector)) / 2e-3
    assert jnp.abs(tangent - expected).max() < 1e-6 * jnp.abs(expected).max()


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_batches(name):
    end = make(METHODS[name])
    batch = jnp.stack([P, 1.1 * P, 0.7 * P])
    values = jax.vmap(end)(batch)
    both = jax.jit(jax.value_and_grad(lambda p: end(p)[2]))
    twins, gradients = jax.vmap(both)(batch)
    assert jnp.abs(twins - values[:, 2]).max() < 1e-10
    for p, value, g in zip(batch, values, gradients, strict=True):
        alone, gradient = both(p)
        assert abs(alone - value[2]) < 1e-10
        assert jnp.abs(gradient - g).max() < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("name", NEWTONS)
def test_second_derivatives(name):
    end = make(METHODS[name])

    def f(p):
        return end(p)[2]

    hessian = jax.hessian(f)(P)
    expected = differences(jax.grad(f), P, 1e-2)
    assert jnp.abs(hessian - expected).max() < 1e-6 * jnp.abs(expected).max()
    assert jnp.abs(hessian - hessian.T).max() < 1e-10 * jnp.abs(hessian).max()
    vector = jnp.array([0.3, -1.0, 2.0])
    product = jax.jvp(jax.grad(f), (P,), (vector,))[1]
    assert jnp.abs(product - hessian @ vector).max() < 1e-10 * jnp.abs(hessian).max()


@pytest.mark.slow
@pytest.mark.parametrize("name", NEWTONS)
def test_solve_inside_scan_and_of_a_whole_structure_pytree(name):
    end = make(METHODS[name])
    batch = jnp.stack([P, 1.1 * P])
    _, values = jax.lax.scan(lambda c, p: (c, end(p)), 0, batch)
    assert jnp.abs(values - jax.vmap(end)(batch)).max() < 1e-10

    def deflection(structure):
        phases = jc.scenes.flat_net(load=15.0).phases
        return jc.solve(structure, phases, METHODS[name]).displacement[3, 2]

    gradient = jax.grad(deflection)(STRUCTURE)  # a Structure of derivatives
    assert gradient.nodes.shape == (12, 3) and gradient.elements.axial_stiffness.shape == (12,)
    h = 1.0
    elements = STRUCTURE.elements

    def at(stiffness):
        changed = jc.replace(elements, axial_stiffness=stiffness)
        return deflection(jc.replace(STRUCTURE, elements=changed))

    base = np.asarray(elements.axial_stiffness)
    difference = (at(base + h) - at(base - h)) / (2 * h)
    assert float(gradient.elements.axial_stiffness.sum()) == pytest.approx(
        float(difference), rel=1e-5
    )


def test_a_traced_component_of_a_force():
    def end(down):
        load = jc.NodalLoads(FREE, (0.0, 0.0, -down))
        return jc.solve(STRUCTURE, [jc.Phase(pretension=200.0), jc.Phase(loads=load)]).tension[0]

    slope = jax.jit(jax.grad(end))(15.0)
    assert float(slope) == pytest.approx(float(end(15.01) - end(14.99)) / 0.02, rel=1e-5)


def test_loads_as_a_batch():
    """The batch of the interface note: many load cases at once, from one prestressed state."""
    first = jc.solve(STRUCTURE, [jc.Phase(pretension=200.0)])
    cases = jnp.array([[0, 0, -15.0], [0, 0, -18.75], [1.0, 2.0, -30.0]])

    def tension(force):
        load = jc.Phase(loads=jc.NodalLoads(FREE, force))
        return jc.solve(STRUCTURE, [load], start=first).tension

    tensions = jax.vmap(tension)(cases)
    for case, row in zip(cases, tensions, strict=True):
        assert jnp.abs(tension(case) - row).max() < 1e-7
