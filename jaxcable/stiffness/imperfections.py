"""Eigenmodes of the tangent stiffness, and structures with imperfections of such shapes.

A structure buckles in the lowest eigenmodes of its tangent stiffness; its initial imperfections are
therefore taken in the shape of these modes, with the amplitudes that workmanship allows.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.solution import Solution, State
from ..common import checks
from ..common.tree import pytree, replace
from ..common.types import ArrayLike, Bool, Float
from ..model.structure import Structure
from ..numerics.scaled import normalize_mode_shapes
from ..programs.program_calls import as_program
from .tangent import (
    require_dense_memory,
    require_symmetric_elements,
    split_solution_state,
    tangent_and_displacements,
)

# dense matrices in memory at once, measured: displacements by unknowns, eigenvectors, work space
_DENSE_MATRICES = 10
_normalized = as_program(normalize_mode_shapes)


@pytree
class Modes:
    """Eigenmodes of the tangent stiffness, softest first: the result of `modes`.

    Attributes:
        stiffness: eigenvalues of the tangent stiffness, [n], N/m. If all are positive, the state is
            stable.
        shapes: displacements, scaled to 1 at the node that moves most, [n, n_node, 3].

    Example:
        Two bars of 1.25 m at a slope of 3 to 4: ``2 EA/l 0.6^2`` and ``2 EA/l 0.8^2``.

        >>> structure, _ = jc.scenes.von_mises_truss(rise=0.75, half_span=1.0, sway=True)
        >>> solution = jc.solve(structure, jc.Phase())
        >>> found = jc.stiffness.modes(structure, solution)
        >>> print(solution.status, np.round(found.stiffness, 3), found.shapes[:, 1].round(6))
        0 [ 576000. 1024000.] [[0. 0. 1.]
         [1. 0. 0.]]
    """

    stiffness: Float[np.ndarray, " n"]
    shapes: Float[np.ndarray, "n n_node 3"]


def modes(
    structure: Structure,
    state: Solution | State,
    n: int = 6,
    fixed: Bool[ArrayLike, "n_row n_freedom"] | None = None,
) -> Modes:
    """Find the lowest eigenmodes of the tangent stiffness at the state of a solution.

    Symmetric structures have equal eigenvalues. Their modes are one basis of many, and small
    changes of the structure select another one; therefore modes have no derivatives. The largest
    component of every shape is positive. Dense, meant for some hundred unknowns.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (NaN if it has failed) or `State`.
        n: number of modes; fewer if there are fewer unknowns.
        fixed: degrees of freedom to leave out, as in `tangent_stiffness`.

    Follower loads without a potential and nodal moments make the tangent unsymmetric: then an
    `InputWarning` is issued, and the modes are those of its symmetric part.

    Returns:
        `Modes`. With beams the shapes are the displacements of the modes, without rotations; the
        shape of a mode that only rotates nodes is zero.

    Raises:
        ValueError: `n` below 1, a traced state, or one that is not finite; elements that are not
            `symmetric`; too many unknowns for dense matrices in the memory there is.

    Example:
        A flat net of four nodes with 200 N in links of 0.4 m is softest across its plane, where it
        has ``N / l`` times 2, 4, 4 and 6:

        >>> structure, phases = jc.scenes.flat_net()
        >>> solution = jc.solve(structure, phases[:1])
        >>> found = jc.stiffness.modes(structure, solution, n=4)
        >>> print(solution.status, np.round(found.stiffness, 3))
        0 [1000. 2000. 2000. 3000.]
    """
    checks.require_whole_number(n, "n")
    if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves((structure, state))):
        raise ValueError(
            "state: is traced; eigenmodes have no derivatives: compute them outside of jax.grad "
            "and jax.jit"
        )
    require_symmetric_elements(structure, "modes")
    at = split_solution_state(structure, state, fixed)
    require_dense_memory(at[2], _DENSE_MATRICES, "modes")
    tangent, symmetric, moved = map(np.asarray, tangent_and_displacements(*at))
    moved = moved[: structure.n_node]
    if not np.isfinite(tangent).all():
        raise ValueError("state: its tangent stiffness is not finite; the analysis has failed")
    if not symmetric:
        checks.warn_user(
            "state: follower loads or nodal moments make its tangent stiffness unsymmetric; "
            "these are modes of its symmetric part"
        )
    values, vectors = np.linalg.eigh(0.5 * (tangent + tangent.T))
    values, vectors = values[:n], vectors[:, :n]
    shapes = _normalized(np.moveaxis(moved @ vectors, -1, 0), vectors.T)
    return Modes(values, np.asarray(shapes))


def imperfect(
    structure: Structure,
    shapes: Float[ArrayLike, "k n_node 3"] | Float[ArrayLike, "n_node 3"],
    amplitudes: Float[ArrayLike, " k"] | Float[ArrayLike, ""],
) -> Structure:
    """Return a structure with geometric imperfections: ``nodes + sum_k amplitudes[k] shapes[k]``.

    Differentiable in amplitudes and shapes. Elements are made to fit the new geometry: the
    unstressed length of elements without a given `rest_length` is the new chord, and a pretension
    is reached in the new geometry. For elements made to fit the perfect geometry, give the
    `rest_length` that they have there. If a mode is a mechanism stiffened by prestress, its shape
    hardly changes the lengths of elements (only by its square), and the structure springs back: use
    errors of length as imperfections instead (`Phase(shortening=...)`). Beams keep the directions
    of their sections: their `up` becomes the z axis that they have in the perfect geometry.
    Otherwise a slight inclination of a vertical beam could rotate its section by 90 degrees.

    Args:
        structure: `Structure`.
        shapes: displacements of all nodes, [k, n_node, 3], or a single shape, [n_node, 3], such as
            `modes(...).shapes`.
        amplitudes: of each shape, [k], or one amplitude for all, m.

    Returns:
        `Structure`.

    Raises:
        ValueError: wrong shapes.

    Example:
        >>> structure, _ = jc.scenes.von_mises_truss(sway=True)
        >>> sway = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        >>> leaning = jc.stiffness.imperfect(structure, sway, 0.01)
        >>> print(leaning.nodes[1])
        [0.01 0.   0.1 ]
    """
    shapes = checks.as_floats(shapes, "shapes")
    if shapes.ndim == 2:
        shapes = shapes[None]
    if shapes.ndim != 3 or shapes.shape[1:] != (structure.n_node, 3):
        raise ValueError(
            f"shapes: expected [k, {structure.n_node}, 3], displacements of every node, got "
            f"{shapes.shape}"
        )
    amplitudes = checks.floats_per_element(amplitudes, len(shapes), "amplitudes")
    moved = jnp.tensordot(jnp.asarray(amplitudes), jnp.asarray(shapes), axes=1)
    nodes = jnp.asarray(structure.nodes)
    upright = [group.with_fixed_axes(nodes) for group in structure.groups]
    elements = structure.arrange(upright)
    return replace(structure, nodes=nodes + moved.astype(nodes.dtype), elements=elements)
