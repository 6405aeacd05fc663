"""Form finding with given lengths: the forces of these elements are unknown multipliers.

The form is a stationary point of the Lagrangian ``sum T l + sum N (l - L) - p.x``, whose unknowns
are the free displacements x and the forces N of the elements of given length L. It is a saddle: its
Hessian, by autodiff, is symmetric and indefinite. Newton's method halves steps until the residual
falls; it starts from a form in which stiff springs keep the lengths nearly (`prescribed`).
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
from ..numerics import scaled
from ..spaces.freedoms import number_freedoms

_HALVINGS = 12  # how often a step is tried: whole, then halved


@pytree
class Numbering:
    """Unknowns of the saddle: free displacements first, then forces of elements of given length.

    Attributes:
        number: unknown of every freedom, [n_node, 3]; n_all if it is held.
        elements: per group the numbers of its elements of given length, or None.
        ends: per group the unknowns of both ends and of the force of these elements, [n_given, 7],
            or None.
        pattern: `linear.Pattern` of the Hessian.
        zero: n_all zeros; the shape is the number of unknowns.
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
    """The `Numbering`; cached.

    Args:
        fixed: True where a coordinate is held, `Indices` [n_node, 3].
        links: links of every group, a tuple of `Indices`.
        sought: whether the length of an element is given, a tuple of `Indices`, [n_elem] bool.
        solver: name of a linear solver, or None.

    Raises:
        ValueError: the named solver does not exchange distant rows of the matrix, as zeros on the
            diagonal need.
    """
    linear.check(solver, exchanges_rows=True)
    freedoms = number_freedoms(fixed)
    n_free = len(freedoms.free)
    n_all = n_free + sum(int(mask.array.sum()) for mask in sought)
    of_freedom = np.where(freedoms.number == n_free, n_all, freedoms.number).astype(np.int32)
    elements, ends, count = [], [], n_free
    for group_links, mask in zip(links, sought, strict=True):
        chosen = np.flatnonzero(mask.array).astype(np.int32)
        moving = of_freedom[group_links.array[chosen]].reshape(-1, 6)
        force = np.arange(count, count + len(chosen), dtype=np.int32)
        count += len(chosen)
        elements.append(chosen if len(chosen) else None)
        ends.append(np.column_stack([moving, force]) if len(chosen) else None)
    numbers = [of_freedom[group_links.array].reshape(-1, 6) for group_links in links]
    numbers += [unknowns for unknowns in ends if unknowns is not None]
    pattern = linear.make_pattern(numbers, n_all, True, solver, exchanges_rows=True)
    return Numbering(of_freedom, elements, ends, pattern, np.zeros(n_all))


@pytree
class Saddle:
    """Equilibrium with given lengths.

    Attributes:
        system: `System` of members that keep their forces; zero where the length is given.
        given: per group the lengths L of all elements, with any value where none is given, m; None
            for a group without given lengths.
        unit: force for an unknown of 1, N; it gives displacements and forces matrix entries of like
            size.
        numbering: `Numbering`.
    """

    system: System
    given: list[Float[Array, " n_elem"] | None]
    unit: Float[Array, ""]
    numbering: Numbering

    def split(
        self, z: Float[Array, " n_all"]
    ) -> tuple[Float[Array, " n_free"], list[Float[Array, " n_given"]]]:
        """Displacements [n_free] and, per group, forces of the elements of given length, N."""
        n_free = self.system.freedoms.free.shape[0]
        parts, at = [], n_free
        for chosen in self.numbering.elements:
            size = 0 if chosen is None else chosen.shape[0]
            parts.append(self.unit * z[at : at + size])
            at += size
        return z[:n_free], parts

    def motion(self, z: Float[Array, " n_all"]) -> Float[Array, "n_node 3"]:
        """Displacements of all nodes, [n_node, 3], m."""
        prescribed: Any = self.system.space.prescribed  # never None here
        return self.system.move(prescribed, self.split(z)[0])

    def join(
        self, motion: Float[Array, "n_node 3"], forces: Sequence[Float[Array, " n_elem"]]
    ) -> Float[Array, " n_all"]:
        """The unknowns [n_all] from displacements [n_node, 3] and all forces per group, N."""
        x = motion.reshape(-1)[self.system.freedoms.free]
        pairs = zip(forces, self.numbering.elements, strict=True)
        given = [force[chosen] / self.unit for force, chosen in pairs if chosen is not None]
        return jnp.concatenate([x, *given])

    def forces(self, z: Float[Array, " n_all"]) -> list[Float[Array, " n_elem"]]:
        """Axial forces, per group [n_elem], N."""
        states: Sequence[Any] = self.system.states  # of `strings.StringState`
        pairs = zip(states, self.numbering.elements, self.split(z)[1], strict=True)
        return [
            state.force if chosen is None else state.force.at[chosen].set(given)
            for state, chosen, given in pairs
        ]

    def filled(self, z: Float[Array, " n_all"]) -> tuple[System, Float[Array, "n_node 3"]]:
        """The system with all forces in its states, and the displacements of its nodes."""
        pairs = zip(self.system.states, self.forces(z), strict=True)
        system = copy(self.system, states=[copy(state, force=force) for state, force in pairs])
        return system, self.motion(z)

    def _given(self, motion):
        """Generate (initial ends, motion of the ends, L, unknowns) of groups with given lengths."""
        n = self.numbering
        for group, chosen, unknowns, lengths in zip(
            self.system.groups, n.elements, n.ends, self.given, strict=True
        ):
            if chosen is not None:
                links = group.links[chosen]
                yield self.system.nodes[links], motion[links], lengths[chosen], unknowns

    def residual(self, z: Float[Array, " n_all"]) -> Float[Array, " n_all"]:
        """Gradient of the Lagrangian, [n_all]: unbalanced forces, then gaps times the unit."""
        system, motion = self.filled(z)
        gaps = [self.unit * jax.vmap(_gap)(*data) for *data, _ in self._given(motion)]
        return jnp.concatenate([system.residual(motion), *gaps])

    def judged(
        self, z: Float[Array, " n_all"]
    ) -> tuple[Float[Array, " n_free"], Float[Array, ""], Float[Array, " n_given"]]:
        """Unbalanced forces [n_free], their scale, and gaps over lengths, [n_given]."""
        system, motion = self.filled(z)
        gaps = [jax.vmap(_gap)(*data) / data[2] for *data, _ in self._given(motion)]
        return *system.residual_and_scale(motion), jnp.concatenate(gaps)

    def tangent(self, z: Float[Array, " n_all"]) -> Float[Array, "n_all n_all"] | linear.Sparse:
        """Hessian of the Lagrangian, a matrix of `linear`."""
        system, motion = self.filled(z)
        freedoms = copy(system.freedoms, number=self.numbering.number)
        system = copy(system, space=copy(system.space, freedoms=freedoms))
        parts = system.parts(system.tangents(motion), motion)
        return self._assemble(parts, motion)

    def _assemble(self, parts, motion):
        """Matrix of blocks of the displacements, and their couplings with the forces."""
        couple = jax.vmap(functools.partial(_coupling, self.unit))
        parts = parts + [(couple(*data), unknowns) for *data, unknowns in self._given(motion)]
        return linear.assemble(parts, len(self.numbering.zero), self.numbering.pattern)

    def balanced(self, motion: Float[Array, "n_node 3"]) -> Float[Array, " n_all"]:
        """Unknowns with displacements [n_node, 3] and the forces of least unbalanced forces.

        Weighted least squares, by the matrix of the saddle with identity blocks in place of the
        stiffness of elements.
        """
        states: Sequence[Any] = self.system.states
        none = [jnp.zeros_like(state.force) for state in states]
        z, n_free = self.join(motion, none), self.system.freedoms.free.shape[0]
        blocks = []
        for group in self.system.groups:
            unknowns = self.numbering.number[group.links].reshape(-1, 6)
            ones = jnp.broadcast_to(jnp.eye(6, dtype=z.dtype), (len(unknowns), 6, 6))
            blocks.append((ones, unknowns))
        matrix = self._assemble(blocks, motion)
        rhs = -self.residual(z).at[n_free:].set(0.0)
        found, regular = linear.solve_general(matrix, rhs)
        return z.at[n_free:].set(jnp.where(regular, found[n_free:], 0.0))


def _gap(ends, moved, length):
    """``l - L``, without a difference of nearly equal lengths if L is the initial length."""
    _, _, change, start = stretch(ends, moved)
    return (start - length) + change


def _coupling(unit, ends, moved, length):
    """Hessian of ``N (l - L)`` at N = 0 by both ends and N over the unit, [7, 7].

    The part that grows with N is in the tangent of the members, which keep this force.
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
        tol: relative residual of forces and of lengths at convergence.
        limit: largest number of steps.
        active: False to return at once.

    Returns:
        The last point, its status, the number of steps, unbalanced forces and their scale.
    """

    def worst(z):
        residual, scale, gaps = saddle.judged(z)
        forces = scaled.relative(jnp.max(jnp.abs(residual), initial=0.0), scale)
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
    """`z` with the derivative of the saddle, as by `implicit.attach`; expects a gated `saddle`."""
    z = lax.stop_gradient(z)
    frozen = lax.stop_gradient(saddle)
    factor = linear.factorize(linear.or_identity(frozen.tangent(z), valid))
    saddle = copy(saddle, unit=frozen.unit)

    def tangent_solve(linearized, rhs):
        return factor.solve(rhs, linearized)

    return lax.custom_root(saddle.residual, z, lambda _, z: z, tangent_solve)
