"""Form finding with given lengths: their forces are unknowns, multipliers of these conditions.

The form is stationary for the Lagrangian ``sum T l + sum N (l - L) - p.x``, whose unknowns are the
free displacements x and the forces N of the elements of given length L: a saddle, symmetric and
indefinite. Its matrix comes from the Lagrangian by autodiff. Newton's method on it, with steps
halved until the residual falls, starts from elements that keep their lengths nearly by stiff
springs (`prescribed`).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import linear
from ..common import status
from ..common.tree import Indices, copy, pytree
from ..common.types import Array, Bool, Float, Int
from ..elements.prestress import stretch
from ..mechanics.assembly import System
from ..spaces.freedoms import number_freedoms

_HALVINGS = 12


@pytree
class Numbering:
    """Unknowns of the saddle: free displacements first, then forces of elements of given length.

    Attributes:
        number: unknown of every freedom, [n_node, 3]; n_all if it is held.
        elements: per group the numbers of its elements of given length, or None.
        ends: per such group the unknowns of both ends and of the force, [n_given, 7].
        pattern: `linear.Pattern`.
        zero: of n_all zeros, whose shape tells the number of unknowns.
    """

    number: Int[Array | np.ndarray, "n_node 3"]
    elements: Sequence[Int[Array | np.ndarray, " n_given"] | None]
    ends: Sequence[Int[Array | np.ndarray, "n_given 7"] | None]
    pattern: linear.Pattern
    zero: Float[Array | np.ndarray, " n_all"]


@functools.lru_cache(maxsize=16)
def number(
    fixed: Indices, links: tuple[Indices, ...], sought: tuple[Indices, ...], solver: str | None
) -> Numbering:
    """The `Numbering`; kept for the next call.

    Args:
        fixed: True where a coordinate is held, `Indices` [n_node, 3].
        links: of every group, a tuple of `Indices`.
        sought: whether the length of an element is given, a tuple of `Indices`, [n_elem] bool.
        solver: name or None.

    Raises:
        ValueError: a solver is named that does not exchange rows far apart, which zeros on the
            diagonal need.
    """
    linear.check(solver, exchanges_rows=True)
    freedoms = number_freedoms(fixed)
    n_free = len(freedoms.free)
    n_all = n_free + sum(int(own.array.sum()) for own in sought)
    own_number = np.where(freedoms.number == n_free, n_all, freedoms.number).astype(np.int32)
    elements, ends, count = [], [], n_free
    for own, among in zip(links, sought, strict=True):
        chosen = np.flatnonzero(among.array).astype(np.int32)
        rows = own_number[own.array[chosen]].reshape(-1, 6)
        force = np.arange(count, count + len(chosen), dtype=np.int32)
        count += len(chosen)
        elements.append(chosen if len(chosen) else None)
        ends.append(np.column_stack([rows, force]) if len(chosen) else None)
    numbers = [own_number[own.array].reshape(-1, 6) for own in links]
    numbers += [rows for rows in ends if rows is not None]
    pattern = linear.make_pattern(numbers, n_all, True, solver, exchanges_rows=True)
    return Numbering(own_number, elements, ends, pattern, np.zeros(n_all))


@pytree
class Saddle:
    """Equilibrium with given lengths.

    Attributes:
        system: `System` of members that hold their forces; zero where the length is given.
        given: per group L of all elements, one of any value where it is not given; None without, m.
        unit: force that an unknown of 1 stands for, N; keeps the two kinds of rows alike.
        numbering: `Numbering`.
    """

    system: System
    given: list[Float[Array, " n_elem"] | None]
    unit: Float[Array, ""]
    numbering: Numbering

    def split(
        self, z: Float[Array, " n_all"]
    ) -> tuple[Float[Array, " n_free"], list[Float[Array, " n_given"]]]:
        """Displacements [n_free] and forces of the elements of given length per group, N."""
        n_free = self.system.freedoms.free.shape[0]
        parts, at = [], n_free
        for chosen in self.numbering.elements:
            size = 0 if chosen is None else chosen.shape[0]
            parts.append(self.unit * z[at : at + size])
            at += size
        return z[:n_free], parts

    def motion(self, z: Float[Array, " n_all"]) -> Float[Array, "n_node 3"]:
        """Displacements of all nodes, [n_node, 3], m."""
        held: Any = self.system.space.prescribed  # there always is one
        return self.system.move(held, self.split(z)[0])

    def join(
        self, motion: Float[Array, "n_node 3"], forces: Sequence[Float[Array, " n_elem"]]
    ) -> Float[Array, " n_all"]:
        """The unknowns [n_all] of displacements [n_node, 3] and of all forces per group, N."""
        x = motion.reshape(-1)[self.system.freedoms.free]
        pairs = zip(forces, self.numbering.elements, strict=True)
        own = [force[chosen] / self.unit for force, chosen in pairs if chosen is not None]
        return jnp.concatenate([x, *own])

    def forces(self, z: Float[Array, " n_all"]) -> list[Float[Array, " n_elem"]]:
        """Axial forces, per group [n_elem], N."""
        states: Sequence[Any] = self.system.states  # of `strings.StringState`
        pairs = zip(states, self.numbering.elements, self.split(z)[1], strict=True)
        return [
            state.force if chosen is None else state.force.at[chosen].set(own)
            for state, chosen, own in pairs
        ]

    def filled(self, z: Float[Array, " n_all"]) -> tuple[System, Float[Array, "n_node 3"]]:
        """The system with all forces, and the motion of its nodes."""
        pairs = zip(self.system.states, self.forces(z), strict=True)
        system = copy(self.system, states=[copy(state, force=force) for state, force in pairs])
        return system, self.motion(z)

    def _given(self, motion):
        """Initial ends, motion of the ends, L and unknowns, of each group with given lengths."""
        n = self.numbering
        for group, chosen, rows, own in zip(
            self.system.groups, n.elements, n.ends, self.given, strict=True
        ):
            if chosen is not None:
                links = group.links[chosen]
                yield self.system.nodes[links], motion[links], own[chosen], rows

    def residual(self, z: Float[Array, " n_all"]) -> Float[Array, " n_all"]:
        """Gradient of the Lagrangian, [n_all]: unbalanced forces, then gaps times the unit."""
        system, motion = self.filled(z)
        gaps = [self.unit * jax.vmap(_gap)(*own) for *own, _ in self._given(motion)]
        return jnp.concatenate([system.residual(motion), *gaps])

    def judged(
        self, z: Float[Array, " n_all"]
    ) -> tuple[Float[Array, " n_free"], Float[Array, ""], Float[Array, " n_given"]]:
        """Unbalanced forces [n_free], their scale, and gaps over lengths, [n_given]."""
        system, motion = self.filled(z)
        gaps = [jax.vmap(_gap)(*own) / own[2] for *own, _ in self._given(motion)]
        return *system.residual_and_scale(motion), jnp.concatenate(gaps)

    def tangent(self, z: Float[Array, " n_all"]) -> Float[Array, "n_all n_all"] | linear.Sparse:
        """Hessian of the Lagrangian, a matrix of `linear`."""
        system, motion = self.filled(z)
        freedoms = copy(system.freedoms, number=self.numbering.number)
        system = copy(system, space=copy(system.space, freedoms=freedoms))
        parts = system.parts(system.tangents(motion), motion)
        return self._assemble(parts, motion)

    def _assemble(self, parts, motion):
        """Matrix of blocks of the displacements, and the couplings with the forces."""
        couple = jax.vmap(functools.partial(_coupling, self.unit))
        parts = parts + [(couple(*own), rows) for *own, rows in self._given(motion)]
        return linear.assemble(parts, len(self.numbering.zero), self.numbering.pattern)

    def balanced(self, motion: Float[Array, "n_node 3"]) -> Float[Array, " n_all"]:
        """Unknowns with displacements [n_node, 3] and the forces that leave least of the residual.

        Weighted least squares: the saddle with a matrix of ones on the diagonal for the stiffness.
        """
        states: Sequence[Any] = self.system.states
        none = [jnp.zeros_like(state.force) for state in states]
        z, n_free = self.join(motion, none), self.system.freedoms.free.shape[0]
        blocks = []
        for group in self.system.groups:
            rows = self.numbering.number[group.links].reshape(-1, 6)
            ones = jnp.broadcast_to(jnp.eye(6, dtype=z.dtype), (len(rows), 6, 6))
            blocks.append((ones, rows))
        matrix = self._assemble(blocks, motion)
        rhs = -self.residual(z).at[n_free:].set(0.0)
        found, regular = linear.solve_general(matrix, rhs)
        return z.at[n_free:].set(jnp.where(regular, found[n_free:], 0.0))


def _gap(ends, moved, length):
    """``l - L`` without the difference of two nearly equal lengths, if L is the initial one."""
    _, _, change, start = stretch(ends, moved)
    return (start - length) + change


def _coupling(unit, ends, moved, length):
    """Hessian of ``N (l - L)`` at N = 0 by both ends and N over the unit, [7, 7].

    What it is at another N is in the tangent of an element that holds this force.
    """

    def lagrangian(u):
        return unit * u[6] * _gap(ends, u[:6].reshape(2, 3), length)

    return jax.hessian(lagrangian)(jnp.append(moved.reshape(-1), 0.0))


def settle(
    saddle: Saddle,
    z: Float[Array, " n_all"],
    tol: Float[Array, ""],
    limit: Int[Array, ""] | int,
    active: Bool[Array, ""],
) -> tuple[
    Float[Array, " n_all"],
    Int[Array, ""],
    Int[Array, ""],
    Float[Array, " n_free"],
    Float[Array, ""],
]:
    """Newton's method from `z`; not differentiable.

    Steps are halved until the largest relative residual falls.

    Args:
        saddle: `Saddle`.
        z: start, [n_all].
        tol: relative residual of forces and of lengths.
        limit: steps allowed.
        active: False to return at once.

    Returns:
        The point, its status, steps, unbalanced forces, scale.
    """

    def worst(z):
        residual, scale, gaps = saddle.judged(z)
        forces = jnp.max(jnp.abs(residual), initial=0.0) / jnp.where(scale > 0, scale, 1.0)
        return jnp.maximum(forces, jnp.max(jnp.abs(gaps), initial=0.0))

    def iterate(state):
        z, size, steps, _ = state
        step, _ = linear.solve_general(saddle.tangent(z), -saddle.residual(z))

        def shorter(search):
            a, _, tried = search
            a = jnp.where(tried == 0, 1.0, 0.5 * a)
            return a, worst(z + a * step), tried + 1

        def going(search):
            _, new, tried = search
            return ~(new < size) & (tried < _HALVINGS)

        a, new, _ = lax.while_loop(going, shorter, (jnp.ones_like(size), size, jnp.int32(0)))
        better = new < size
        return (
            jnp.where(better, z + a * step, z),
            jnp.where(better, new, size),
            steps + 1,
            better,
        )

    def unfinished(state):
        _, size, steps, better = state
        return active & better & (steps < limit) & ~(size <= tol)

    begin = (z, worst(z), jnp.int32(0), jnp.ones((), bool))
    z, size, steps, _ = lax.while_loop(unfinished, iterate, begin)
    code = jnp.where(jnp.isfinite(size), status.NOT_CONVERGED, status.NONFINITE)
    code = jnp.where(size <= tol, status.OK, code).astype(jnp.int32)
    residual, scale, _ = saddle.judged(z)
    return z, code, steps, residual, scale


def attach(
    saddle: Saddle, z: Float[Array, " n_all"], valid: Bool[Array, ""]
) -> Float[Array, " n_all"]:
    """`z` with the derivative of the saddle, as `implicit.attach`; `saddle` is gated already."""
    z = lax.stop_gradient(z)
    frozen = lax.stop_gradient(saddle)
    factor = linear.factorize(linear.or_identity(frozen.tangent(z), valid))
    saddle = copy(saddle, unit=frozen.unit)

    def tangent_solve(linearized, rhs):
        return factor.solve(rhs, linearized)

    return lax.custom_root(saddle.residual, z, lambda _, z: z, tangent_solve)
