"""The equilibrium matrix of a structure of straight elements, and arrays over all of its elements.

Such arrays have the elements of all groups, group after group in pytree order, [n_elem].
"""

from __future__ import annotations

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks, memory_limit
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..model.structure import Structure
from .input_checks import require_straight_elements

Nodes = TypeVar("Nodes", jax.Array, np.ndarray)
"""Type of positions: results are NumPy arrays for NumPy arrays, and jax arrays for jax arrays."""

_N_DENSE = 4  # dense matrices in memory at once: equilibrium, both singular vectors, workspace


def links_and_tension_only(
    structure: Structure,
) -> tuple[Int[np.ndarray, "n_elem 2"], Bool[np.ndarray, " n_elem"]]:
    """Return the node numbers of all elements, [n_elem, 2], and whether each is a cable, [n_elem].

    Groups follow each other.

    Raises:
        ValueError: a group whose elements are not straight bars or cables.
    """
    require_straight_elements(structure)
    links = np.concatenate([group.links.array for group in structure.groups])
    cable = [np.full(len(group.links), bool(group.tension_only)) for group in structure.groups]
    return links, np.concatenate(cable)


def values_of_all_elements(
    structure: Structure, value: PyTree[Float[ArrayLike, " ..."]], name: str
) -> Float[Array | np.ndarray, " n_elem"]:
    """Return values of all elements of a structure, group after group, as one array [n_elem].

    Args:
        structure: `Structure`.
        value: a scalar, an array [n_elem] of all groups, or a pytree in the shape of the elements.
        name: argument that an error message names.

    Raises:
        ValueError: `value` has none of these shapes.
    """
    sizes = [len(group.links) for group in structure.groups]
    if isinstance(value, list | tuple) and all(np.ndim(v) == 0 for v in value):
        value = np.asarray(value)
    shape = np.shape(value) if hasattr(value, "shape") or np.isscalar(value) else None
    if shape in ((), (sum(sizes),)):
        return (jnp if isinstance(value, jax.Array) else np).broadcast_to(value, (sum(sizes),))
    try:
        parts = jax.tree.leaves(
            jax.tree.map(
                lambda size, v: (jnp if isinstance(v, jax.Array) else np).broadcast_to(v, (size,)),
                structure.arrange(sizes),
                value,
            )
        )
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"{name}: expected [{sum(sizes)}], one value per element of all groups, or the shape "
            "of the structure's elements"
        ) from error
    return (jnp if any(isinstance(p, jax.Array) for p in parts) else np).concatenate(parts)


def arrange_as_elements(
    structure: Structure, values: Float[Array | np.ndarray, "... n_all"]
) -> PyTree[Float[Array | np.ndarray, "... n_elem"]]:
    """Split values of all elements, [..., n_all], by group; return the pytree of the elements."""
    ends = np.cumsum([len(group.links) for group in structure.groups])[:-1]
    parts = np.split(np.arange(values.shape[-1]), ends)
    return structure.arrange([values[..., part] for part in parts])


def nodes_as_numpy(structure: Structure, what: str) -> Float[np.ndarray, "n_node 3"]:
    """Return the nodes as a NumPy array in double precision, [n_node, 3], m.

    Args:
        structure: `Structure`.
        what: name of the calling function, for the error message.

    Raises:
        ValueError: the nodes are traced by jax, or not finite.
    """
    nodes = checks.array_if_known(structure.nodes)
    if nodes is None:
        raise ValueError(
            f"{what}: the nodes are traced by jax, but ranks of matrices need known numbers; call "
            "it outside of jit, grad and vmap"
        )
    finite = np.isfinite(nodes)
    if not finite.all():
        k = int(np.argwhere(~finite)[0][0])
        raise ValueError(f"nodes[{k}] = {nodes[k].tolist()}: must be finite")
    return np.asarray(nodes, float)


def rank_tolerance(structure: Structure, tol: float | None) -> float:
    """Return `tol`, by default 1e-10, or 1e-5 for nodes in single precision.

    Singular values up to `tol` times the largest one count as zero.
    """
    if tol is not None:
        return tol
    return 1e-5 if np.dtype(structure.nodes.dtype) == np.float32 else 1e-10


def incidence_matrix(
    links: Int[np.ndarray, "n_elem 2"], n_node: int
) -> Float[np.ndarray, "n_elem n_node"]:
    """Return the incidence matrix of nodes and elements, [n_elem, n_node].

    The row of an element has -1 at its first node, and 1 at its second node.
    """
    matrix = np.zeros((len(links), n_node))
    every = np.arange(len(links))
    matrix[every, links[:, 0]], matrix[every, links[:, 1]] = -1.0, 1.0
    return matrix


def equilibrium_matrix(
    nodes: Float[Nodes, "n_node 3"], links: Int[np.ndarray, "n_elem 2"]
) -> tuple[Float[Nodes, "3*n_node n_elem"], Float[Nodes, " n_elem"]]:
    """Return the equilibrium matrix of all nodes, [3 n_node, n_elem], and the lengths, [n_elem], m.

    The matrix times the tensions is the load that they balance, with x, y and z of one node after
    the other. It is differentiable in the nodes if they are a jax array.

    Raises:
        ValueError: the matrix and its singular vectors do not fit into memory.
    """
    memory_limit.require_memory(
        _N_DENSE * nodes.dtype.itemsize * max(nodes.size, len(links)) ** 2,
        f"equilibrium matrix: dense, of {len(nodes)} nodes and {len(links)} elements",
        "analyse a part of the structure, or a coarser one",
    )
    xp = jnp if isinstance(nodes, jax.Array) else np
    joins = incidence_matrix(links, len(nodes)).astype(nodes.dtype)
    vector = joins @ nodes
    length = xp.sqrt(xp.sum(vector**2, axis=1))
    unit = vector / length[:, None]
    return xp.einsum("en,ek->nke", -joins, unit).reshape(-1, len(links)), length
