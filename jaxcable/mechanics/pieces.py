"""Straight pieces of the cables of a net: one array [n_piece, ...] over all groups.

A cable over n nodes has n - 1 pieces; if every cable has one, nothing is summed. A piece is void if
it pads a shorter chain (between a node and itself), or if its cable is inactive.
"""

from __future__ import annotations

from itertools import pairwise

import jax.numpy as jnp
import numpy as np
from jax import lax

from ..common.types import Array, Bool, Float
from ..elements.abilities import TensionElement
from ..spaces.space import Forces, Motion
from ..spaces.translations import has_low_part
from .assembly import System

_DIFFERENCE_SQUARED = np.kron(
    [[1.0, -1.0], [-1.0, 1.0]], np.eye(3)
)  # of the square of a difference


def all_suit_cone_solver(system: System) -> bool:
    """Return whether every group is one of cables that `conic_interior_point` can solve.

    These are straight or sliding cables with a linear law (`TensionElement.suits_cone_solver`).
    """
    pairs = zip(system.groups, system.states, strict=True)
    return all(
        isinstance(group, TensionElement) and group.suits_cone_solver(state)
        for group, state in pairs
    )


def chain_differences(values: Float[Array, "n_elem n_end k"]) -> Float[Array, "n_elem n_piece k"]:
    """Return the value at each node of an element minus that before, [n_elem, n_end - 1, k]."""
    return values[:, 1:] - values[:, :-1]  # less code than `jnp.diff`


def piece_differences(system: System, values: Float[Array, "n_row k"]) -> Float[Array, "n_piece k"]:
    """Return `values` [n_row, k] at the second node of each piece minus the first, [n_piece, k].

    A piece is the straight segment of a cable between successive nodes; padding has zeros.
    """
    parts = [chain_differences(values[group.links]) for group in system.groups]
    found = jnp.concatenate([part.reshape(-1, values.shape[1]) for part in parts])
    real = existing_pieces(system)
    return found if real is None else jnp.where(real[:, None], found, 0.0)


def piece_vectors(system: System, x: Motion) -> Float[Array, "n_piece 3"]:
    """Return the vectors from end to end of all pieces at motion `x`, [n_piece, 3], m."""
    parts = piece_differences(system, jnp.concatenate([system.nodes, x], axis=1))
    return parts[:, :3] + (parts[:, 3:6] + parts[:, 6:] if has_low_part(x) else parts[:, 3:])


def existing_pieces(system: System) -> Bool[Array, " n_piece"] | None:
    """Return which pieces belong to active cables and are no padding, [n_piece]; None for all."""
    if all(state.present is None for state in system.states) and _have_single_pieces(system):
        return None
    found = []
    for group, state in zip(system.groups, system.states, strict=True):
        real = group.links[:, 1:] != group.links[:, :-1]
        if state.present is not None:
            real = real & state.present[:, None]
        found.append(real.reshape(-1))
    return jnp.concatenate(found)


def piece_shapes(system: System) -> tuple[tuple[int], tuple[int, int]]:
    """Return the shapes (n_piece,) and (n_piece, 3) of arrays over all pieces."""
    n_piece = sum(group.links[:, 1:].size for group in system.groups)
    return (n_piece,), (n_piece, 3)


def zero_void_pieces(system: System, values: Float[Array, " n_piece"]) -> Float[Array, " n_piece"]:
    """Return `values`, [n_piece], with zeros for padding and for pieces of inactive cables."""
    found = existing_pieces(system)
    return values if found is None else jnp.where(found, values, 0.0)


def mean_over_pieces(system: System, values: Float[Array, " n_piece"]) -> Float[Array, ""]:
    """Return the mean of `values`, [n_piece], over all straight pieces of active cables.

    A piece is the segment of a cable between successive nodes; padding is left out, and every piece
    has the same weight.
    """
    found = existing_pieces(system)
    if found is None:
        return jnp.mean(values)
    return jnp.sum(zero_void_pieces(system, values)) / jnp.maximum(jnp.sum(found), 1)


def sum_per_cable(system: System, values: Float[Array, " n_piece"]) -> Float[Array, " n"]:
    """Return the sums of `values` [n_piece] over the pieces of every cable, [n]."""
    values = zero_void_pieces(system, values)
    if _have_single_pieces(system):
        return values
    return jnp.concatenate([jnp.sum(part, axis=1) for part in _split_by_group(system, values)])


def repeat_per_piece(system: System, values: Float[Array, "... n"]) -> Float[Array, "... n_piece"]:
    """Repeat values of cables, [..., n], for each of their pieces, [..., n_piece]."""
    if _have_single_pieces(system):
        return values
    parts, first = [], 0
    for group in system.groups:
        n, n_end = group.links.shape
        part = values[..., first : first + n, None]
        part = jnp.broadcast_to(part, (*part.shape[:-1], n_end - 1))
        parts.append(part.reshape(*values.shape[:-1], -1))
        first += n
    return jnp.concatenate(parts, axis=-1)


def share_among_pieces(system: System, values: Float[Array, " n"]) -> Float[Array, " n_piece"]:
    """Divide values of cables, [n], equally among their pieces, [n_piece]."""
    found = existing_pieces(system)
    if found is None:
        return values
    count = sum_per_cable(system, jnp.ones(found.shape, values.dtype))
    return repeat_per_piece(system, values / jnp.maximum(count, 1.0))


def sum_piece_forces(system: System, tensions: Float[Array, "n_piece 3"]) -> Forces:
    """Assemble tension vectors of pieces, [n_piece, 3], as internal forces on rows, [n_row, 3], N.

    The vector t of a piece points from its first end to its second; -t acts at the first end, and t
    at the second.
    """
    return system.sum_at_rows(
        [_end_forces_of_pieces(part) for part in _split_by_group(system, tensions)]
    )


def cable_matrices(
    system: System,
    slope: Float[Array, " n"],
    stiff: Float[Array, " n_piece"],
    axis: Float[Array, "n_piece 3"],
    ratio: Float[Array, " n_piece"],
) -> list[Float[Array, "n_elem d d"]]:
    """Return the stiffness matrices of all cables, per group [n_elem, d, d], N/m.

    That of a cable is ``slope g g' + sum over pieces of stiff (I - c c')``, where ``g`` is the
    derivative, by the cable's nodes, of the sum over its pieces of ``ratio c . vector``.

    Args:
        system: net of cables.
        slope: derivative of the tension by the length, [n], N/m.
        stiff: stiffness of pieces at right angles to c, [n_piece], N/m.
        axis: the unit vector (or shorter vector) c of every piece, [n_piece, 3].
        ratio: factor of c in g, [n_piece].
    """
    found, first, stiff = [], 0, zero_void_pieces(system, stiff)
    for q, c, r in zip(*(_split_by_group(system, v) for v in (stiff, axis, ratio)), strict=True):
        n, width = q.shape
        k = slope[first : first + n, None]
        first += n
        if width == 1:
            found.append(_single_piece_matrices(q, k * r**2 - q, c[:, 0]))
            continue
        blocks = [
            _single_piece_matrices(q[:, i : i + 1], -q[:, i : i + 1], c[:, i]) for i in range(width)
        ]
        placed = [(3 * i, 3 * (width - 1 - i), 0) for i in range(width)]
        whole = sum(
            lax.pad(block, jnp.zeros((), q.dtype), [(0, 0, 0), at, at])
            for block, at in zip(blocks, placed, strict=True)
        )
        g = _end_forces_of_pieces(r[:, :, None] * c).reshape(n, -1)
        found.append(whole + k[:, :, None] * g[:, :, None] * g[:, None, :])
    return found


def _single_piece_matrices(stiff, more, axis):
    """Return matrices ``stiff I + more c c'`` of pieces by their two ends, [n, 6, 6].

    `axis` are the vectors c, [n, 3]; `stiff` and `more` are [n, 1], N/m.
    """
    c = jnp.concatenate([-axis, axis], axis=1)
    same = stiff[:, :, None] * _DIFFERENCE_SQUARED[None].astype(stiff.dtype)
    return same + (more * c)[:, :, None] * c[:, None, :]


def _end_forces_of_pieces(tensions):
    """Return end forces [n_elem, n_end, 3] of tension vectors of pieces, [n_elem, n_end - 1, 3].

    The vector of a piece is the force at its second end, and minus that at its first.
    """
    if tensions.shape[1] == 1:
        return jnp.concatenate([-tensions, tensions], axis=1)
    return _pad_with_zeros(tensions, 1, 0) - _pad_with_zeros(tensions, 0, 1)


def _pad_with_zeros(values, before, after):
    """Pad values [n_elem, n, ...] on axis 1 with `before` and `after` zeros."""
    return jnp.pad(values, ((0, 0), (before, after), *((0, 0),) * (values.ndim - 2)))


def _have_single_pieces(system):
    """Return whether every cable has two nodes, hence one piece."""
    return all(group.links.shape[1] == 2 for group in system.groups)


def _split_by_group(system, values):
    """Split an array over all pieces into a list with [n_elem, n_end - 1, ...] per group."""
    sizes = [(len(group.links), group.links.shape[1] - 1) for group in system.groups]
    ends = [0]
    for n, width in sizes:
        ends.append(ends[-1] + n * width)
    parts = [values[i:j] for i, j in pairwise(ends)]
    return [p.reshape(*size, *p.shape[1:]) for p, size in zip(parts, sizes, strict=True)]
