"""Tangents that are not symmetric: what `stable` says, and derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from extensions.own_links import Joined

import jaxcable as jc
from jaxcable.common.tree import Indices, pytree

# structures of random forces, some of which move far
pytestmark = pytest.mark.filterwarnings("ignore:node .* has moved")

ONE_SIDED = [[0.0, 5.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]


@pytree(indices=("links",))
class Linear(Joined):
    """Springs of a matrix, [n_elem, 3, 3], N/m, between the second end and its initial place."""

    links: object
    matrix: object

    per_element = ("matrix",)
    symmetric = False

    def __post_init__(self):
        if not isinstance(self.links, Indices):
            object.__setattr__(self, "links", Indices(np.asarray(self.links, np.int32)))

    def end_forces(self, state, ends, motion):
        force = self.matrix @ motion[1]
        return jnp.stack([jnp.zeros(3), force])

    def energy(self, state, ends, motion):
        return jnp.zeros(())


def test_stable_excludes_divergence_and_proves_no_flutter():
    """A spring (k, c) with a skew part: eigenvalues k + i c of the tangent have real parts k > 0.

    Without damping such a node flutters; it does not diverge, and `stable` says no more. With a
    one-sided term (0, c; 0, 0) and c > 2 k the symmetric part is indefinite, while the eigenvalues
    k, k are positive: `stable` is False, and the report does not claim that it is unstable.
    """
    nodes, held = [[0.0, 0, 0], [1.0, 0, 0]], jc.pinned([0])
    load = jc.Phase(loads=jc.NodalLoads([1], (0.3, 0.1, -0.2)))
    for across, stable in (([[0, -3, 0], [3, 0, 0], [0, 0, 0]], True), (ONE_SIDED, False)):
        springs = Linear([[0, 1]], np.array([np.eye(3) + np.array(across)]))
        structure = jc.Structure(nodes, springs, held)
        solution = jc.solve(structure, load)
        assert int(solution.status) == jc.status.OK and bool(solution.stable) == stable
        tangent = np.asarray(jc.stiffness.tangent_stiffness(structure, solution))
        assert (np.linalg.eigvals(tangent).real > 0.5).all()
        exact = np.linalg.solve(np.eye(3) + np.array(across), [0.3, 0.1, -0.2])
        np.testing.assert_allclose(solution.displacement[1], exact, rtol=1e-10)
        text = jc.report(structure, solution).text()
        assert ("may be stable all the same" in text) != stable


@pytest.mark.slow
def test_derivatives_where_the_symmetric_part_is_indefinite():
    """Against those of the linear equations, K u = f, whose tangent has an indefinite part."""
    nodes, load = [[0.0, 0, 0], [1.0, 0, 0]], jnp.array([0.3, 0.1, -0.2])

    def end(size):
        springs = Linear([[0, 1]], (jnp.eye(3) + size * jnp.array(ONE_SIDED))[None])
        structure = jc.Structure(nodes, springs, jc.pinned([0]))
        return jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], load))).displacement[1]

    def exact(size):
        return jnp.linalg.solve(jnp.eye(3) + size * jnp.array(ONE_SIDED), load)

    for way in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(way(end)(1.0), way(exact)(1.0), rtol=1e-9, atol=1e-12)
