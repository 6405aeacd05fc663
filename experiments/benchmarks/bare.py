"""A bare analysis whose first call is the unit in which first calls are measured.

A net of 48 unknowns: tension-only elastic links, Newton steps by a dense Cholesky factorisation,
two phases in one `lax.scan`. It serves no other purpose: no statuses, no line search, one kind of
element.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

import jaxcable as jc


def bare():
    """Return the bare analysis, a function of prestress and load, and values of both."""

    structure, _ = jc.scenes.saddle(4, 4)
    nodes, links = np.asarray(structure.nodes), structure.elements.links.array
    free = np.flatnonzero(~structure.fixed(structure.supports).array.ravel())
    number = np.full(nodes.size, len(free))
    number[free] = np.arange(len(free))
    place = number.reshape(-1, 3)[links].reshape(-1, 6)
    ends, stiffness = jnp.asarray(nodes[links].reshape(-1, 6)), 16e6
    length = jnp.linalg.norm(ends[:, 3:] - ends[:, :3], axis=1)
    down = jnp.asarray(np.where(free % 3 == 2, -1.0, 0.0))

    def end_forces(ends, motion, rest):
        vector = ends[3:] - ends[:3] + motion[3:] - motion[:3]
        now = jnp.sqrt(jnp.sum(vector**2))
        pull = stiffness * jnp.maximum(now - rest, 0.0) / rest * vector / now
        return jnp.concatenate([-pull, pull])

    def assembled(x, rest, load):
        motion = jnp.append(x, 0.0)[place]
        force = jax.vmap(end_forces)(ends, motion, rest)
        blocks = jax.vmap(jax.jacfwd(end_forces, 1))(ends, motion, rest)
        residual = jnp.zeros(len(free) + 1).at[place].add(force)[:-1] - load
        matrix = jnp.zeros((len(free) + 1,) * 2).at[place[:, :, None], place[:, None, :]]
        return residual, matrix.add(blocks)[:-1, :-1]

    def analyse(prestress, load):
        rest = length / (1 + prestress / stiffness)

        def phase(x, part):
            def turn(run):
                x, _, count = run
                residual, matrix = assembled(x, rest, part * load * down)
                factor = jax.scipy.linalg.cho_factor(matrix)
                x = x - jax.scipy.linalg.cho_solve(factor, residual)
                return x, jnp.max(jnp.abs(residual)), count + 1

            x, _, count = lax.while_loop(
                lambda run: (run[1] > 1e-6 * prestress) & (run[2] < 30), turn, (x, jnp.inf, 0)
            )
            return x, count

        return lax.scan(phase, jnp.zeros(len(free)), jnp.arange(2.0))

    return analyse, (20e3, 1000.0)
