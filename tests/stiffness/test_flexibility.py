"""Flexibility about loaded states, against differences."""

import functools

import jax.numpy as jnp
import numpy as np
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.stiffness import flexibility


@functools.cache
def net():
    structure, phases = jc.scenes.flat_net(increments=(1, 1))
    solution = converged(jc.solve(structure, phases))
    return structure, solution


def test_flexibility_against_a_small_load():
    structure, solution = net()
    matrix = flexibility(structure, solution, [3, 0, 4], axes="xz")
    assert matrix.shape == (6, 6) and np.allclose(matrix, matrix.T, rtol=1e-12, atol=1e-18)
    assert (np.asarray(matrix)[2:4] == 0).all()  # node 0 is an anchor

    def moved(force):
        load = jc.NodalLoads([3], force * jnp.array([1.0, 0, 0]))
        end = converged(jc.solve(structure, [jc.Phase(loads=load)], start=solution))
        return end.positions[jnp.array([3, 4])][:, jnp.array([0, 2])].ravel()

    column = (moved(1e-2) - moved(-1e-2)) / 2e-2
    assert np.allclose(column, np.asarray(matrix)[[0, 1, 4, 5], 0], rtol=1e-7, atol=1e-14)
