"""Derivatives of natural modes, of large ones by Lanczos's method, and of repeated ones: NaN."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import pieces
from oracles import taylor
from oracles.convergence import converged
from oracles.traced import traced

import jaxcable as jc
from jaxcable.dynamics import modes

pytestmark = pytest.mark.filterwarnings("ignore:elements.*no phase has SelfWeight")

LENGTH, MASS = 10.0, 0.5  # m, kg/m


def string(n, tension, held="y"):
    """A string of n pieces with `tension`, N, that moves in a plane, unless `held` is ""."""
    nodes, links = pieces(n, LENGTH)
    cables = jc.Cables(links, axial_stiffness=1e7, weight=9.80665 * MASS)
    supports = jc.pinned([0, n])
    supports = supports + jc.restrained(range(1, n), held) if held else supports
    structure = jc.Structure(nodes, cables, supports)
    return structure, jc.solve(structure, jc.Phase(pretension=tension), taylor.TIGHT)


def test_gradients_of_frequency_shape_and_effective_mass():
    """By tension and masses at the nodes, all at once; sums in which the scale of modes counts."""
    weights = np.random.default_rng(3).normal(size=(3, 7))

    def value(p):
        structure, solution = string(6, p["tension"])
        found = modes(structure, solution, 3, masses=p["masses"])
        total = jnp.sum(found.shape[:, :, 2] * weights) + jnp.sum(found.frequency) / 10
        total += jnp.sum(found.effective_mass[:, 2]) + found.modal_mass[1]
        return total, jnp.maximum(solution.status, found.status)

    masses = np.array([0.0, 0.3, 0.5, 0.2, 0.9, 0.4, 0.0])
    function, ones = taylor.joined(value, {"tension": 900.0, "masses": masses})
    taylor.assert_gradient(function, ones)


def test_second_derivatives_and_batches():
    """Frequencies of light cables go with ``m^-1/2``; a batch, forward and reverse."""
    nodes, links = pieces(3, LENGTH)
    supports = jc.pinned([0, 3]) + jc.restrained([1, 2], "y")
    structure = jc.Structure(nodes, jc.Cables(links, axial_stiffness=1e7), supports)
    solution = converged(jc.solve(structure, jc.Phase(pretension=1000.0)))

    def frequency(mass):
        return modes(structure, solution, 1, masses=mass).frequency[0]

    first, masses = jax.jacfwd(frequency), jnp.array([2.0, 5.0])
    ways = frequency, first, jax.grad(frequency), jax.grad(first)
    f, slope, back, second = traced(jax.vmap(lambda m: [way(m) for way in ways]))(masses)
    np.testing.assert_allclose(slope, -0.5 * f / masses, rtol=1e-10)
    np.testing.assert_allclose(back, slope, rtol=1e-10)
    np.testing.assert_allclose(second, 0.75 * f / masses**2, rtol=1e-9)


def test_lanczos_has_the_modes_of_dense_matrices():
    """399 unknowns, sparse and dense; frequencies by tension in closed form, shapes both ways."""
    n = 200

    def both(solver, tension):
        found = modes(*string(n, tension), 4, linear_solver=solver)
        return found.frequency, found.shape[:, n // 7, 2], found.effective_mass, found.status

    (found, slopes), (dense, dense_slopes) = (
        jax.jvp(lambda t, name=name: both(name, t)[:3], (1000.0,), (1.0,))
        for name in (None, "dense")
    )
    exact = np.arange(1, 5) / (2 * LENGTH) * np.sqrt(1000.0 * (1 + 1e-4) / MASS)
    np.testing.assert_allclose(found[0], exact, rtol=1e-7)
    np.testing.assert_allclose(slopes[0], exact * (0.5 / 1000.0 + 0.5e-7), rtol=1e-6)
    for ours, theirs in zip((found, slopes), (dense, dense_slopes), strict=True):
        for a, b, size in zip(ours, theirs, (1e-2, 1e-6, 1e-5), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-8 * size)


def test_repeated_frequencies_say_so():
    """A string vibrates alike in two planes: NaN by what moves them, and only for these modes."""
    masses = np.array([0.0, 1.0, 1.0, 1.0, 0.0])
    structure, solution = string(4, 1000.0, held="")
    converged(solution)
    found = converged(modes(structure, solution, 7, masses=masses))
    assert list(found.repeated) == [True] * 6 + [False]
    assert list(modes(structure, solution, 1, masses=masses).repeated) == [True]

    def squared(factor):
        return modes(structure, solution, 7, masses=factor * masses).squared

    value, change = jax.jvp(squared, (1.0,), (1.0,))
    assert np.isnan(change[:6]).all() and np.isfinite(value).all()
    difference = (squared(1.001) - squared(0.999))[6] / 2e-3
    assert float(change[6]) == pytest.approx(float(difference), rel=1e-5)  # step squared
    alone = jax.grad(lambda factor: squared(factor)[6])(1.0)
    assert float(alone) == pytest.approx(float(change[6]), rel=1e-9)
    assert np.isnan(jax.grad(lambda factor: squared(factor)[0])(1.0))


@pytest.mark.parametrize("name", ["superlu", "cholmod", "pardiso"])
def test_every_solver_gives_the_same(name):
    if not jc.linear.solver_named(name).is_installed():
        pytest.skip(f"{name} is not installed")
    structure, solution = string(120, 1000.0, held="")
    found = converged(modes(structure, solution, 4, linear_solver=name))
    exact = np.repeat([1, 2], 2) / (2 * LENGTH) * np.sqrt(1000.0 * (1 + 1e-4) / MASS)
    np.testing.assert_allclose(found.frequency, exact, rtol=1e-6)
    assert found.repeated.all()


def test_modes_of_a_stage():
    """The first phase's end has the first tension; `State`s are taken as solutions are."""
    structure, solution = string(5, 1000.0)
    later = jc.solve(structure, jc.Phase(pretension=2000.0), start=solution)
    first, second = (modes(structure, state, 1).squared[0] for state in (solution, later.last))
    assert float(second / first) == pytest.approx(2.0, rel=2e-4)
