"""Loads that are small beside the prestress: right to 1e-8 of their effect, or a status."""

import functools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from oracles.convergence import converged
from oracles.traced import traced

import jaxcable as jc
from jaxcable import status

STIFFNESS, HEIGHT = 1e8, 0.3


def two_links(kind, tension, supports_at):
    """Two links from supports at +-1 m, at a height, to a node at the origin, prestressed."""
    nodes = [[-1.0, 0.0, supports_at], [0.0, 0.0, 0.0], [1.0, 0.0, supports_at]]
    links = kind([[0, 1], [1, 2]], axial_stiffness=STIFFNESS)
    return jc.Structure(nodes, links, jc.pinned([0, 2])), jc.Phase(pretension=tension)


def exact_displacement(tension, height, force):
    """How a force (0.3, 0, -1) `force` moves the node from its place without it, in 50 digits."""
    with mpmath.workdps(50):
        start = mpmath.sqrt(1 + mpmath.mpf(height) ** 2)
        rest = start / (1 + mpmath.mpf(tension) / mpmath.mpf(STIFFNESS))

        def unbalanced(x, z, across, down):
            found = [across, -down]
            for side in (-1, 1):
                to = side - x, mpmath.mpf(height) - z
                length = mpmath.sqrt(to[0] ** 2 + to[1] ** 2)
                pull = STIFFNESS * (length - rest) / rest
                found = [f + pull * t / length for f, t in zip(found, to, strict=True)]
            return found

        def balanced(guess, across, down):
            return mpmath.findroot(lambda x, z: unbalanced(x, z, across, down), guess)

        before = balanced((0, mpmath.mpf(height) / 2), 0, 0)
        across, down = mpmath.mpf(0.3 * force), mpmath.mpf(force)
        after = balanced(tuple(before), across, down)
        return np.array([float(after[k] - before[k]) for k in (0, 1)])


@functools.cache
def displacements_by_load(kind):
    """Function of height and forces: displacements [n, 2] by the second phase, status, slopes."""

    def moved(force, height):
        structure, prestress = two_links(kind, 1e7, height)
        load = jc.Phase(loads=jc.NodalLoads([1], force * jnp.array([0.3, 0.0, -1.0])))
        solution = jc.solve(structure, [prestress, load])
        moved = solution.phases[1].displacement_in_phase[1]
        return moved[2], (moved[jnp.array([0, 2])], solution.status)

    return traced(jax.vmap(jax.value_and_grad(moved, has_aux=True), in_axes=(0, None)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [jc.Cables, pytest.param(jc.Bars, marks=pytest.mark.slow)])
@pytest.mark.parametrize("height", [0.0, HEIGHT])
def test_loads_over_twelve_decades(kind, height):
    forces = 1e7 * 10.0 ** -np.arange(13.0)
    (_, (moved, codes)), slopes = displacements_by_load(kind)(forces, height)
    assert set(codes.tolist()) <= {status.OK, status.AT_ROUNDING}
    good = np.asarray(codes) == status.OK
    # of 1e-8 of the forces, rounding leaves less than half the digits
    assert good[:8].all() and not good[-1]
    assert np.isnan(moved[~good]).all() and np.isnan(slopes[~good]).all()
    exact = np.array([exact_displacement(1e7, height, force) for force in forces[good]])
    error = np.abs(moved[good] - exact).max(axis=1)
    assert (error <= 1e-8 * np.abs(exact).max(axis=1)).all(), error
    # linear for small forces: the slope is the quotient
    few = slice(4, None)
    np.testing.assert_allclose(slopes[good][few], (exact[:, 1] / forces[good])[few], rtol=1e-3)


@pytest.mark.slow
def test_a_node_that_goes_slack_is_not_held_by_a_leftover_residual():
    """Nothing balances a leftover at a node whose cables a small load slackens."""
    nodes = [[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [1.0, 0, -1.0]]
    cables = jc.Cables([[0, 1], [1, 2], [1, 3]], axial_stiffness=1e6)
    structure = jc.Structure(nodes, cables, jc.pinned([0, 2]))
    prestress = jc.Phase(pretension=jc.only([True, True, False], 1e4))
    for force in (1.0, -1.0):  # pulled down, then pushed up: it ends hanging upwards
        load = jc.Phase(loads=jc.NodalLoads([3], (0.0, 0.0, -force)))
        solution = converged(jc.solve(structure, [prestress, load]))
        assert float(solution.tension[2]) == pytest.approx(1.0, abs=1e-6)
        assert np.sign(solution.positions[3, 2]) == -np.sign(force)


def test_a_tiny_load_beside_a_movement_need_not_be_resolved():
    """A phase with a movement is judged by it, although a tiny load comes along."""
    structure, prestress = two_links(jc.Cables, 1e6, HEIGHT)
    both = [jc.SupportMovement([2], (0.01, 0.0, 0.0)), jc.NodalLoads([1], (0.0, 0.0, -1e-3))]
    assert int(jc.solve(structure, [prestress, jc.Phase(loads=both)]).status) == status.OK


@pytest.mark.slow
def test_float32_is_judged_by_forces_only():
    structure, prestress = two_links(jc.Cables, np.float32(1e3), np.float32(HEIGHT))
    nodes = np.asarray(structure.nodes, np.float32)
    load = jc.NodalLoads([1], np.array([0.0, 0.0, -1e-4], np.float32))
    solution = jc.solve(jc.replace(structure, nodes=nodes), [prestress, jc.Phase(loads=load)])
    assert solution.displacement.dtype == np.float32 and int(solution.status) == status.OK
