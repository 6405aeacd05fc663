"""Bars that turn, of any stiffness, and derivatives of a string of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged

import jaxcable as jc

pytestmark = pytest.mark.filterwarnings("ignore:node .* has moved")  # far, as it is meant to


@pytest.mark.parametrize("increments", [1, 20])
def test_steps_do_not_grow_with_the_stiffness_of_a_bar_that_turns(increments):
    """The bar ends along its load: angle by atan2, length by Hooke's law."""
    for stiffness in 10.0 ** np.arange(4, 15, 2):
        bar = jc.Bars([[0, 1]], axial_stiffness=stiffness)
        supports = jc.pinned([0]) + jc.restrained([1], "y")
        structure = jc.Structure([[0.0, 0, 0], [3.0, 0, 0]], bar, supports)
        load = jc.NodalLoads([1], (1e3, 0.0, -1e4))
        solution = converged(jc.solve(structure, jc.Phase(loads=load, increments=increments)))
        assert int(solution.phases[0].path.iterations.max()) <= 10
        x, _, z = solution.positions[1]
        force = np.hypot(1e3, 1e4)
        # a stiff bar turns freely within the rounding of its length, eps EA, beside the load
        loose = 1e-9 + 8 * np.finfo(float).eps * stiffness / force
        assert np.arctan2(z, x) == pytest.approx(np.arctan2(-1e4, 1e3), abs=loose)
        length = 3 * (1 + force / stiffness)
        assert np.hypot(x, z) == pytest.approx(length, rel=1e-10 * force / stiffness + 1e-15)
        rounded = 1e-9 + 1e-15 * stiffness / force
        assert float(solution.tension[0]) == pytest.approx(force, rel=rounded)


@pytest.mark.slow
def test_derivatives_of_a_string_of_stiff_bars():
    """The end of a string under one load lies in its direction: its length grows by P l / EA."""
    rng = np.random.default_rng(5)
    nodes = np.concatenate([np.zeros((1, 3)), np.cumsum(rng.uniform(0.1, 0.3, (5, 3)), axis=0)])
    length = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    bars = jc.Bars(np.stack([np.arange(5), np.arange(5) + 1], 1), axial_stiffness=1e7)
    structure = jc.Structure(nodes, bars, jc.pinned([0]))

    def reach(force):
        load = jc.NodalLoads([5], force * jnp.array([0.6, 0.0, -0.8]))
        solution = jc.solve(structure, jc.Phase(loads=load))
        return solution.positions[5] @ jnp.array([0.6, 0.0, -0.8]), solution.status

    (value, code), slope = jax.value_and_grad(reach, has_aux=True)(2.0)
    assert int(code) == jc.status.OK
    assert value == pytest.approx(length.sum() * (1 + 2.0 / 1e7), rel=1e-12)
    assert slope == pytest.approx(length.sum() / 1e7, rel=1e-6)
