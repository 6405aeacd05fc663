"""States of self-stress and mechanisms of a cable-strut structure in its geometry.

The equilibrium matrix ``A`` gives the loads that tensions ``t`` balance, ``A t = f``. Its transpose
gives the elongations of small displacements, ``A^T d = e``. If ``r`` is its rank, there are
``s = n_elem - r`` states of self-stress (``A t = 0``) and ``m = n_free - r`` motions without
elongation (``A^T d = 0``). A prestress ``t`` stiffens a mechanism ``d`` if

    sum over elements of  q |d_j - d_i|^2 > 0,    q = t / length,

and stiffens all mechanisms if this quadratic form is positive definite on their space: they are
then infinitesimal of first order, and the structure is stable for a prestress much less than EA.

Source: Pellegrino and Calladine (1986), Pellegrino (1993); the quadratic form is that of the
product forces of Calladine and Pellegrino (1991), written with the force density matrix.

Ranks are discrete: everything here is NumPy on the host and has no derivatives.
"""

from __future__ import annotations

import jax
import numpy as np

from ..common.tree import pytree
from ..common.types import ArrayLike, Bool, Float, Int, PyTree
from ..model.structure import Structure
from .equilibrium_matrix import (
    arrange_as_elements,
    equilibrium_matrix,
    incidence_matrix,
    links_and_tension_only,
    nodes_as_numpy,
    rank_tolerance,
    values_of_all_elements,
)

KINDS = {
    (False, False): "I",
    (False, True): "II",
    (True, False): "III",
    (True, True): "IV",
}
"""Kinds of Pellegrino and Calladine, by (has states of self-stress, has mechanisms)."""

_WORDS = {False: "determinate", True: "indeterminate"}


@pytree
class SelfStress:
    """States of self-stress and mechanisms of a structure: the result of `self_stress`.

    Values of elements have the shape of the structure's elements, as in all results; the columns of
    `matrix` are the elements of all groups, one group after the other.

    Attributes:
        tensions: states of self-stress, in the shape of the elements, each [s, n_elem]; a basis
            that is orthonormal over the elements of all groups.
        force_densities: `tensions` over the lengths, in the shape of the elements, 1/m.
        mechanisms: infinitesimal mechanisms, which are displacements without elongation; without
            rigid motions, an orthonormal basis, [m, n_node, 3].
        rigid: rigid motions that the supports allow, an orthonormal basis, [n_rigid, n_node, 3].
        singular_values: singular values of the equilibrium matrix in descending order,
            [min(n_free, n_elem of all groups)].
        rank: number of singular values that do not count as zero.
        matrix: equilibrium matrix of the free degrees of freedom, [n_free, n_elem of all groups].
        length: lengths of the elements, in their shape, each [n_elem], m.
        tension_only: which elements are cables, in their shape, each [n_elem] bool.
        links: node numbers, in the shape of the elements, each [n_elem, 2].
        structure: the `Structure`.

    Example:
        >>> structure, _ = jc.scenes.simplex()
        >>> found = jc.forms.self_stress(structure)
        >>> found.s, found.m, found.kind
        (1, 1, 'IV')
        >>> density = {kind: states[0, 0] for kind, states in found.force_densities.items()}
        >>> print({kind: round(float(q / density["verticals"]), 6) for kind, q in density.items()})
        {'struts': -1.0, 'triangles': 0.57735, 'verticals': 1.0}
    """

    tensions: PyTree[Float[np.ndarray, "s n_elem"]]
    force_densities: PyTree[Float[np.ndarray, "s n_elem"]]
    mechanisms: Float[np.ndarray, "m n_node 3"]
    rigid: Float[np.ndarray, "n_rigid n_node 3"]
    singular_values: Float[np.ndarray, " n_value"]
    rank: int
    matrix: Float[np.ndarray, "n_free n_all"]
    length: PyTree[Float[np.ndarray, " n_elem"]]
    tension_only: PyTree[Bool[np.ndarray, " n_elem"]]
    links: PyTree[Int[np.ndarray, "n_elem 2"]]
    structure: Structure

    @property
    def s(self) -> int:
        """Number of independent states of self-stress."""
        return self.matrix.shape[1] - self.rank

    @property
    def m(self) -> int:
        """Number of independent infinitesimal mechanisms, without rigid motions."""
        return len(self.mechanisms)

    @property
    def kind(self) -> str:
        """Kind "I" to "IV" of the structure by s and m, after Pellegrino and Calladine: `KINDS`."""
        return KINDS[self.s > 0, self.m > 0]

    @property
    def rank_gap(self) -> tuple[float, float]:
        """The smallest nonzero singular value and the largest zero one, over the largest of all.

        The rank is certain if they are far apart. The second is 0 if no singular value counts as
        zero.
        """
        values = self.singular_values
        below = float(values[self.rank]) if self.rank < len(values) else 0.0
        top = float(values[0])
        return float(values[self.rank - 1]) / top, below / top

    def describe(self) -> str:
        """Describe the kind of structure, s and m in words.

        Returns:
            The text.

        Example:
            >>> print(jc.forms.self_stress(jc.scenes.simplex().structure).describe())
            kind IV: statically indeterminate (s = 1), kinematically indeterminate (m = 1)
        """
        return (
            f"kind {self.kind}: statically {_WORDS[self.s > 0]} (s = {self.s}), "
            f"kinematically {_WORDS[self.m > 0]} (m = {self.m})"
        )

    def unbalanced(self, tension: PyTree[Float[ArrayLike, " ..."]]) -> float:
        """Return by how much a prestress is not in equilibrium: unbalanced force over tension.

        These are the largest ones, each in absolute value.

        Args:
            tension: tensions, N, of all elements group after group [n_elem], or in the shape of the
                elements.

        Returns:
            A number; of the order of rounding for a state of self-stress. Only free degrees of
            freedom count.

        Example:
            >>> structure, _ = jc.scenes.simplex()
            >>> found = jc.forms.self_stress(structure)
            >>> found.unbalanced(jax.tree.map(lambda states: states[0], found.tensions)) < 1e-12
            True
        """
        tension = self._tensions_of_all(tension)
        largest = np.abs(tension).max()
        return float(np.abs(self.matrix @ tension).max(initial=0.0) / (largest or 1.0))

    def mechanism_stiffness(
        self, tension: PyTree[Float[ArrayLike, " ..."]]
    ) -> Float[np.ndarray, " m"]:
        """Return the stiffness that a prestress gives to the mechanisms: its eigenvalues.

        It is the geometric stiffness, restricted to displacements that are combinations of the m
        mechanisms. The prestress stiffens every mechanism if all eigenvalues are positive.

        Args:
            tension: tensions, N, of all elements group after group [n_elem], or in the shape of the
                elements.

        Returns:
            Eigenvalues [m] in ascending order, N/m.

        Example:
            >>> structure, _ = jc.scenes.simplex()
            >>> found = jc.forms.self_stress(structure)
            >>> taut = np.sign(found.tensions["verticals"][0, 0])
            >>> tension = jax.tree.map(lambda states: taut * states[0], found.tensions)
            >>> (found.mechanism_stiffness(tension) > 0).tolist()
            [True]
        """
        density = self._force_densities_of_all(tension)
        links, _ = links_and_tension_only(self.structure)
        joins = incidence_matrix(links, self.mechanisms.shape[1])
        apart = np.einsum("en,mnk->mek", joins, self.mechanisms)
        return np.linalg.eigvalsh(np.einsum("mek,e,nek->mn", apart, density, apart))

    def stiffens(self, tension: PyTree[Float[ArrayLike, " ..."]], tol: float = 1e-9) -> bool:
        """Return whether a prestress stiffens every mechanism.

        Args:
            tension: tensions, N, of all elements group after group [n_elem], or in the shape of the
                elements.
            tol: eigenvalues up to `tol` times the largest force density count as zero.

        Returns:
            True if all eigenvalues of `mechanism_stiffness` are above this limit.

        Example:
            >>> structure, _ = jc.scenes.simplex()
            >>> found = jc.forms.self_stress(structure)
            >>> taut = np.sign(found.tensions["verticals"][0, 0])
            >>> tension = jax.tree.map(lambda states: taut * states[0], found.tensions)
            >>> found.stiffens(tension), found.stiffens(jax.tree.map(np.negative, tension))
            (True, False)
        """
        density = np.abs(self._force_densities_of_all(tension)).max()
        return bool((self.mechanism_stiffness(tension) > tol * density).all())

    def _force_densities_of_all(self, tension):
        """Return force densities [n_elem], N/m, of all groups; input as for `unbalanced`."""
        length = np.concatenate([np.asarray(leaf) for leaf in jax.tree.leaves(self.length)])
        return self._tensions_of_all(tension) / length

    def _tensions_of_all(self, tension):
        """Return tensions as one array [n_elem], N, of all groups; input as for `unbalanced`."""
        return np.asarray(values_of_all_elements(self.structure, tension, "tension"), float)


def self_stress(structure: Structure, tol: float | None = None) -> SelfStress:
    """Find the states of self-stress and the mechanisms of pin-jointed bars and taut cables.

    Args:
        structure: `Structure` of `Bars` and `Cables`; its supports count. Support a free-standing
            structure, such as a tensegrity, in a statically determinate way or with fewer supports:
            remaining rigid motions are separated from the mechanisms.
        tol: singular values up to `tol` times the largest count as zero; default 1e-10, or 1e-5 if
            the nodes are in single precision. Use a larger one if coordinates are rounded.

    Returns:
        `SelfStress`.

    Raises:
        ValueError: other elements, traced or infinite nodes, no free degree of freedom; more nodes
            and elements than dense matrices have memory for.

    Source: Pellegrino and Calladine (1986), Pellegrino (1993).

    Example:
        A prism of three struts and nine cables has one state of self-stress and one mechanism:

        >>> structure, _ = jc.scenes.simplex()
        >>> found = jc.forms.self_stress(structure)
        >>> found.s, found.m
        (1, 1)
    """
    links, cable = links_and_tension_only(structure)
    nodes = nodes_as_numpy(structure, "self_stress")
    free = ~structure.held_displacements().ravel()
    if not free.any():
        raise ValueError(
            "supports: they hold every degree of freedom; self-stress needs a free node"
        )
    tol = rank_tolerance(structure, tol)
    matrix, length = equilibrium_matrix(nodes, links)
    matrix = matrix[free]
    left_vectors, values, right_vectors = np.linalg.svd(matrix)
    rank = int((values > tol * values[0]).sum())
    states, mechanisms = right_vectors[rank:], left_vectors[:, rank:].T

    rigid = _allowed_rigid_motions(nodes, free, tol)
    if len(rigid):  # rigid motions have no elongation, either: take them out of the mechanisms
        mechanisms = _orthogonal_complement(mechanisms, rigid)
    return SelfStress(
        tensions=arrange_as_elements(structure, states),
        force_densities=arrange_as_elements(structure, states / length),
        mechanisms=_nodal_displacements(mechanisms, free),
        rigid=_nodal_displacements(rigid, free),
        singular_values=values,
        rank=rank,
        matrix=matrix,
        length=arrange_as_elements(structure, length),
        tension_only=arrange_as_elements(structure, cable),
        links=structure.arrange([group.links.array for group in structure.groups]),
        structure=structure,
    )


def rigid_motions(nodes: Float[np.ndarray, "n_node 3"]) -> Float[np.ndarray, "n_rigid 3*n_node"]:
    """Return an orthonormal basis of the rigid motions of nodes, [6 (5 if collinear), 3 n_node]."""
    arms = nodes - nodes.mean(axis=0)
    arms = arms / max(np.abs(arms).max(), np.finfo(float).tiny)
    spins = [np.cross(axis, arms).ravel() for axis in np.eye(3)]
    moves = [np.tile(axis, len(nodes)) for axis in np.eye(3)]
    _, values, basis = np.linalg.svd(np.array(moves + spins), full_matrices=False)
    return basis[values > 1e-10 * values[0]]


def _allowed_rigid_motions(nodes, free, tol):
    """Return an orthonormal basis of those rigid motions that supports allow, [n_rigid, n_free].

    `free` says which degrees of freedom are free, [3 n_node]; `tol` is a relative rank
    tolerance.
    """
    basis = rigid_motions(nodes)
    _, values, mixes = np.linalg.svd(basis[:, ~free].T, full_matrices=True)
    n_held = int((values > max(tol, 1e-10)).sum())
    return (mixes[n_held:] @ basis)[:, free]


def _orthogonal_complement(space, part):
    """Return an orthonormal basis of what is orthogonal to a subspace within a space, [k, n_free].

    Args:
        space: orthonormal basis of the space, [n, n_free].
        part: orthonormal basis of the subspace, [n_part, n_free].
    """
    _, _, mixes = np.linalg.svd(part @ space.T, full_matrices=True)
    return mixes[len(part) :] @ space


def _nodal_displacements(motions, free):
    """Expand motions of the free degrees of freedom, [n, n_free], to all nodes, [n, n_node, 3]."""
    full = np.zeros((len(motions), len(free)))
    full[:, free] = motions
    return full.reshape(len(motions), len(free) // 3, 3)
