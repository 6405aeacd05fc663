"""Nodes that have a displacement and a rotation: structures with beams.

A row's motion is seven numbers, displacement and unit quaternion, and a step of it up to six,
translation and spin: rotations are turned on and never added. A spin enters the steps [n_free]
times a length, the mean length of the beams (`arm`): an arc. Then all unknowns are lengths, all
residuals forces, and one tolerance judges them.

The residual about ``x`` is the derivative of the energy with respect to a step from ``x``, at that
step. Its own derivative is a Hessian, symmetric also off equilibrium. A nodal moment that keeps its
direction in space has no potential; it enters by its work on the step and makes the tangent
unsymmetric (of the order of the moment). Plain Newton steps and derivatives of the result use all
of it, searched steps the symmetric part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Self

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import linear
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..numerics.rotations import (
    IDENTITY,
    angles,
    conjugate,
    cross,
    inverse,
    middle,
    product,
    rotate,
    stereographic,
    turn_by,
    turned,
)
from .freedoms import Freedoms, along, combined, numbers_of
from .space import Forces, Group, Matrix, Motion, Part, Space, Step, by_numbers, square

_NO_STIFFNESS = 1e-9  # of that of one node's spin, which a free spin may have from rounding


@pytree
class RigidNodes(Space):
    """A row's motion is its displacement and the unit quaternion of its rotation; see `Space`.

    Attributes:
        nodes: initial positions, [n_row, 3], m.
        arm: length by which spins are multiplied, m; it scales unknowns, not results.
        bearing: rotation in which the support of every row was set, [n_row, 4], where some hold
            rotations in directions of their own; None if that is as `prescribed`.
    """

    nodes: Float[Array, "n_row 3"]
    arm: Float[Array, ""]
    bearing: Float[Array, "n_row 4"] | None

    n_motion, n_freedom = 7, 6
    rotates = True
    symmetric = False  # moments

    @classmethod
    def of(
        cls,
        nodes: Float[Array, "n_row 3"],
        groups: Sequence[Group],
        freedoms: Freedoms,
        prescribed: Motion | None,
        bearing: Float[Array, "n_row 4"] | None,
    ) -> Self:
        """The space of a system; its arm is the mean length of what gives nodes rotations."""
        chords = [group.chord(nodes[group.links]) for group in groups if group.rotates]
        lengths = jnp.concatenate(chords)
        arm = lax.stop_gradient(jnp.mean(lengths)) if lengths.size else jnp.ones((), nodes.dtype)
        return cls(freedoms, prescribed, nodes, arm, bearing)

    # --- motions

    @classmethod
    def still(cls, nodes: Float[Array, "n_row 3"]) -> Motion:
        """No displacement, no rotation."""
        turn = jnp.broadcast_to(jnp.asarray(IDENTITY, nodes.dtype), (len(nodes), 4))
        return jnp.concatenate([jnp.zeros_like(nodes), turn], axis=1)

    @classmethod
    def advanced(cls, motion: Motion, step: Forces) -> Motion:
        """Moved on and turned on."""
        return jax.vmap(turned)(motion, step)

    @classmethod
    def between(cls, before: Motion, after: Motion) -> Forces:
        """Displacement, and the rotation vector of the turn."""

        def turn(old, new):
            return angles(stereographic(product(new, inverse(old))))

        shift = (after - before)[:, :3]
        return jnp.concatenate([shift, jax.vmap(turn)(before[:, 3:], after[:, 3:])], axis=1)

    @classmethod
    def rotations(cls, motion: Motion) -> Float[Array, "n_row 4"]:
        """All but displacements."""
        return motion[:, 3:]

    @classmethod
    def moments(cls, force: Float[Array, "... n_freedom"]) -> Float[Array, "... 3"]:
        """All but forces."""
        return force[..., 3:]

    @classmethod
    def kept(
        cls, motion: Float[Array, "n_inc n_row n_motion"]
    ) -> Float[Array, "n_inc n_row n_motion"]:
        """All of it: displacements do not tell rotations."""
        return motion

    # --- points and steps

    def place(self, x: Motion) -> Motion:
        """`x` with held translations and clamped nodes put where their supports are."""
        clamped = jnp.all(self.freedoms.fixed[:, 3:], axis=1, keepdims=True)
        rotation = jnp.where(clamped, self._prescribed[:, 3:], x[:, 3:])
        moved = self._supported(x[:, :3])
        return self._carried_along(jnp.concatenate([moved, rotation], axis=1))

    def carried(self, x: Motion) -> Motion:
        """`x`, a constant, as a function of the rotation in which hinged supports were left."""
        hinged = jnp.any(self.freedoms.fixed[:, 3:], axis=1, keepdims=True)
        support = self._reference()
        relative = jax.vmap(product)(x[:, 3:], jax.vmap(inverse)(lax.stop_gradient(support)))
        rotation = jnp.where(hinged, jax.vmap(product)(relative, support), x[:, 3:])
        return jnp.concatenate([x[:, :3], rotation], axis=1)

    def _reference(self) -> Float[Array, "n_row 4"]:
        """Rotation from which supports that hold some rotations reckon, [n_row, 4]."""
        return self._prescribed[:, 3:] if self.bearing is None else self.bearing

    def move(self, x: Motion, step: Step) -> Motion:
        """The motion after a step [n_free]."""
        return self._carried_along(jax.vmap(turned)(x, self.spread(x, step)))

    def _carried_along(self, x: Motion) -> Motion:
        """`x` with the nodes that others carry put where these take them."""
        if self.freedoms.carried is None:
            return x
        nodes, by = self.freedoms.carried
        arm, turn = self.nodes[nodes] - self.nodes[by], x[by, 3:]
        moved = x[by, :3] + jax.vmap(rotate)(turn, arm) - arm
        return x.at[nodes].set(jnp.concatenate([moved, turn], axis=1))

    def _arms(self, x: Motion) -> Float[Array, "n 3"]:
        """From carriers to the nodes that they carry, as they are turned at `x`, [n, 3], m."""
        nodes, by = self.freedoms.carried  # type: ignore[misc]  # some are
        return jax.vmap(rotate)(x[by, 3:], self.nodes[nodes] - self.nodes[by])

    def spread(self, x: Motion, step: Step) -> Forces:
        """Translation and spin of every row, [n_row, 6], from a step [n_free] from `x`.

        Carried nodes move with their carriers, by the turn of the arm itself.
        """
        full = jnp.append(step, jnp.zeros(1, step.dtype))[self.freedoms.number]
        full = full * self._scaling()
        if self.freedoms.axes is not None:
            shift = combined(self.freedoms.axes, full[:, :3])
            full = jnp.concatenate([shift, combined(self._spin_axes(x), full[:, 3:])], axis=1)
        if self.freedoms.carried is not None:
            nodes, by = self.freedoms.carried
            arm, spin = self._arms(x), full[by, 3:]
            swung = jax.vmap(lambda s, a: rotate(turn_by(s), a))(spin, arm) - arm
            full = full.at[nodes].set(jnp.concatenate([full[by, :3] + swung, spin], axis=1))
        return full

    def _spin_axes(self, x: Motion) -> Float[Array, "n_row 3 3"]:
        """Directions of spins, rows of [n_row, 3, 3].

        Where one rotation is held the node swings, by the shortest way from `_reference`; the spins
        that keep it so are those across the held direction turned halfway along.
        """
        axes = jnp.asarray(self.freedoms.axes, x.dtype)
        alone = jnp.sum(self.freedoms.fixed[:, 3:], axis=1) == 1
        swing = jax.vmap(product)(x[:, 3:], jax.vmap(inverse)(self._reference()))
        still = jnp.asarray(IDENTITY, x.dtype)
        half = jax.vmap(lambda own, q: middle(still, jnp.where(own, q, still)))(alone, swing)
        return jax.vmap(lambda q, rows: jax.vmap(lambda v: rotate(q, v))(rows))(half, axes)

    def _scaling(self):
        arm = self.arm
        return jnp.concatenate([jnp.ones((1, 3), arm.dtype), jnp.full((1, 3), 1 / arm)], axis=1)

    # --- forces

    def size(self, force: Float[Array, "... n_freedom"]) -> Float[Array, " ..."]:
        """Norms of forces, and of moments over the arm."""
        size = _norm(force[..., :3])
        return size + _norm(force[..., 3:]) / self.arm

    def collected(self, force: Forces, x: Motion, spread: Forces | None = None) -> Step:
        """Forces and moments at the unknowns; those on carried nodes at their carriers."""
        n = self.freedoms.free.shape[0]
        force = self._handed_on(force, x, spread)
        if self.freedoms.axes is not None:
            force = jnp.concatenate(
                [along(self.freedoms.axes, force[:, :3]), along(self._spin_axes(x), force[:, 3:])],
                axis=1,
            )
        scaled = force * self._scaling()
        sums = jnp.zeros(n, force.dtype).at[self.freedoms.number].add(scaled, mode="drop")
        return self.freedoms.released(sums)

    def _handed_on(self, force: Forces, x: Motion, spread: Forces | None = None) -> Forces:
        """Forces and moments [n_row, 6] with those on carried nodes handed to their carriers."""
        if self.freedoms.carried is None:
            return force
        nodes, by = self.freedoms.carried
        arm, own = self._arms(x), force[nodes]
        if spread is None:
            turning = jax.vmap(cross)(arm, own[:, :3])
        else:
            spin = spread[by, 3:]
            arm = jax.vmap(lambda s, a: rotate(turn_by(s), a))(spin, arm)
            turning = jax.vmap(conjugate)(spin, jax.vmap(cross)(arm, own[:, :3]))
        force = force.at[nodes].set(0.0).at[by, :3].add(own[:, :3])
        return force.at[by, 3:].add(own[:, 3:] + turning)

    def conjugate(self, load: Forces, spread: Forces) -> Forces:
        """Moments by their work on changes of the spin, see `rotations.conjugate`."""
        moment = jax.vmap(conjugate)(spread[:, 3:], load[:, 3:])
        return jnp.concatenate([load[:, :3], moment], axis=1)

    def reactions(self, unbalanced: Forces, motion: Motion) -> Forces:
        """Forces and moments of the supports on the structure, [n_row, 6]; zero where free."""
        force, freedoms = self._handed_on(unbalanced, motion), self.freedoms
        fixed = freedoms.fixed
        if freedoms.inner is not None:
            fixed = fixed & ~freedoms.inner[:, None]
        if freedoms.axes is None:
            return jnp.where(fixed, force, 0.0)
        spins = self._spin_axes(motion)
        shift = jnp.where(fixed[:, :3], along(freedoms.axes, force[:, :3]), 0.0)
        turn = jnp.where(fixed[:, 3:], along(spins, force[:, 3:]), 0.0)
        return jnp.concatenate([combined(freedoms.axes, shift), combined(spins, turn)], axis=1)

    def directions(self, motion: Motion) -> list[Float[ArrayLike, "n_row 3 3"] | None]:
        """Those of displacements, and of spins."""
        return [self.freedoms.axes, self._spin_axes(motion)]

    # --- matrices

    @classmethod
    def coupled(cls, number: Int[np.ndarray, "n_row 6"]) -> list[Int[np.ndarray, "n_row 3"]]:
        """Spins of a node: moments have entries of their own."""
        return [number[:, 3:]]

    def slopes(self, motion: Motion) -> Float[Array, "n_row 6 6"] | None:
        """Change of a row's motion by its numbers, [n_row, 6, 6]; None if only spins are scaled."""
        freedoms = self.freedoms
        if freedoms.axes is None and freedoms.carried is None:
            return None
        scale = self._scaling()
        slopes = jnp.zeros((len(motion), 6, 6), motion.dtype)
        if freedoms.axes is None:
            slopes = slopes + jnp.eye(6, dtype=motion.dtype)[None]
        else:
            slopes = slopes.at[:, :3, :3].set(jnp.swapaxes(jnp.asarray(freedoms.axes), 1, 2))
            slopes = slopes.at[:, 3:, 3:].set(jnp.swapaxes(self._spin_axes(motion), 1, 2))
        slopes = slopes * scale[None]
        if freedoms.carried is not None:
            nodes, by = freedoms.carried
            own = slopes[by]
            swung = jax.vmap(lambda a, spins: jax.vmap(lambda s: cross(s, a), 1, 1)(spins))(
                self._arms(motion), own[:, 3:]
            )
            slopes = slopes.at[nodes].set(own.at[:, :3].add(swung))
        return slopes

    def part(
        self,
        blocks: Float[Array, "n_elem ..."],
        links: Int[ArrayLike, "n_elem n_end"],
        width: int,
        inner: Sequence[tuple[int, int]],
        x: Motion,
    ) -> Part:
        """Blocks by what their ends' numbers are, which are six at an end that is carried."""
        freedoms, blocks, slopes = self.freedoms, square(blocks), self.slopes(x)
        number = numbers_of(freedoms.number, links, width, inner, freedoms.carried)
        n_end = links.shape[1] - (1 + max((row for row, _ in inner), default=-1))
        if slopes is None:
            if width > 3:
                scale = self._scaling()[0]
                own = jnp.concatenate([jnp.tile(scale, n_end), jnp.ones(len(inner), scale.dtype)])
                blocks = jnp.einsum("eij,i,j->eij", blocks, own, own)
            return blocks, number
        own = slopes[links[:, :n_end], :width]
        if freedoms.carried is None:
            own = own[..., :width]
        return by_numbers(blocks, own, len(inner)), number

    def own_parts(self, load: Forces, unbalanced: Callable[[], Forces], x: Motion) -> list[Part]:
        """What nodal moments, and forces on arms, take from the tangent as nodes turn.

        See `rotations.conjugate`. For one node after the other, by its spins.
        """
        zero = jnp.zeros_like(x[:, :3])
        moment, first = self._handed_on(load, x)[:, 3:], partial(conjugate, order=1)
        change = -jax.vmap(jax.jacfwd(first))(zero, moment)
        if self.freedoms.carried is not None:
            nodes, by = self.freedoms.carried
            pull, arm = unbalanced()[nodes, :3], self._arms(x)
            # the moment of loads on arms is in `moment` already
            own = jax.vmap(jax.jacfwd(first))(zero[by], jax.vmap(cross)(arm, load[nodes, :3]))
            change = change.at[by].add(own)

            def turning(spin, arm, pull):
                return first(spin, cross(rotate(turn_by(spin, order=1), arm), pull))

            change = change.at[by].add(jax.vmap(jax.jacfwd(turning))(zero[by], arm, pull))
        if self.freedoms.axes is not None:
            axes = self._spin_axes(x)
            change = jnp.einsum("nai,nij,nbj->nab", axes, change, axes)
        return [(change / self.arm**2, self.freedoms.number[:, 3:])]

    def regular(self, matrix: Matrix, x: Motion) -> Matrix:
        """The tangent with free spins held at a node each, as far as they are without stiffness.

        A spring on one unknown that a spin z moves, where K z is zero: solutions for loads without
        work on z are those of K, with that unknown at rest.
        """
        if self.freedoms.spins is None:
            return matrix
        rows, piece, ends = self.freedoms.spins
        number = self.freedoms.number[rows, 3:]
        lines = self.nodes[ends[:, 1]] - self.nodes[ends[:, 0]]
        lines = lines / jnp.linalg.norm(lines, axis=1, keepdims=True)
        own = jax.vmap(rotate)(x[rows, 3:], lines[piece])
        if self.freedoms.axes is not None:
            own = along(self._spin_axes(x)[rows], own)
        diagonal = linear.diagonal(matrix)
        for k in range(len(ends)):
            mine = jnp.asarray(piece == k, own.dtype)[:, None]
            spin = jnp.zeros_like(diagonal).at[number].add(own * mine, mode="drop")
            held = jnp.argmax(jnp.abs(spin))
            stiffness = diagonal[held]
            # (a piece that another phase leaves free has no spin here)
            left = jnp.max(jnp.abs(matrix @ spin)) <= _NO_STIFFNESS * stiffness
            left = left & jnp.any(spin != 0)
            matrix = linear.plus_entry(matrix, held, jnp.where(left, stiffness, 0.0))
        return matrix


def _norm(vectors: Float[Array, "... 3"]) -> Float[Array, " ..."]:
    return jnp.sqrt(jnp.sum(vectors**2, axis=-1))
