"""Equilibrium of a section: strains from forces.

The complementary question to `Section.forces`. With laws that rise the potential
``sum A w(e) - N e0 - My ky - Mz kz`` is convex, and Newton with a line search finds its minimum.
The curves go on elastically beyond their ends, so that every force has strains, and whether a fibre
then lies beyond its curve says that the force is beyond the capacity.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common import status
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..numerics import implicit
from ..numerics.search import search
from .fibres import Fibres, Memory


@pytree
class SectionState:
    """Strains of a section under given forces; NaN, with NaN derivatives, unless the status is OK.

    Attributes:
        strain: ``(e0, ky, kz)``, each of the shape of the forces, -, 1/m, 1/m.
        status: OK; BEYOND_CAPACITY if a fibre of the last iterate is beyond its curve, converged or
            not; NOT_CONVERGED.
        residual: largest unbalanced force, moments over the radius of gyration, N.
        steps: iterations.

    Example:
        >>> law = jc.Polygonal([-1e-3, 0.0, 1e-3], [-100e6, 0.0, 100e6])
        >>> section = jc.Section.rectangle(0.1, 0.2, law, shape=(10, 10))
        >>> state = section.strains(N=0.0, My=13.2e3, Mz=0.0)  # EI is 6.6 MN m2
        >>> e0, ky, kz = state.strain
        >>> print(f"{jc.describe(state.status)}: {ky:.6f} 1/m")
        converged: 0.002000 1/m
    """

    strain: tuple[Float[Array, "*shape"], Float[Array, "*shape"], Float[Array, "*shape"]]
    status: Int[Array, "*shape"]
    residual: Float[Array, "*shape"]
    steps: Int[Array, "*shape"]


def equilibrium(
    section: Fibres,
    N: Float[ArrayLike, "*shape"],
    My: Float[ArrayLike, "*shape"],
    Mz: Float[ArrayLike, "*shape"],
    memory: Memory | None = None,
    tol: Float[ArrayLike, ""] | None = None,
    max_steps: int = 100,
) -> SectionState:
    """Strains ``(e0, ky, kz)`` that balance the forces.

    Forces of any shape are taken in turn, so that none waits for the slowest of them: on a CPU five
    times faster than all at once. For a GPU use `jax.vmap` over single forces.

    Args:
        section: `Section`.
        N, My, Mz: arrays of one shape, N, N m, N m.
        memory: plastic strains of the fibres as from `Section.initial_memory`: one state for
            all forces, or with the axes of the forces in front.
        tol: largest residual, relative to the sum of absolute fibre forces plus the load (moments
            over the radius of gyration); default 64 eps, which costs one iteration more than 1e-4.
        max_steps: iterations allowed.

    Returns:
        `SectionState`, differentiable (implicit function theorem).
    """
    N, My, Mz = jnp.broadcast_arrays(*(jnp.asarray(v, section.area.dtype) for v in (N, My, Mz)))
    if N.ndim:
        return _batch(section, (N, My, Mz), memory, tol, max_steps)
    if memory is None and section.remembers:
        memory = section.initial_memory()
    target, radius = jnp.stack([N, My, Mz]), _radius(section)
    parameters = (section, target, memory)
    frozen = lax.stop_gradient(parameters)
    found, steps, residual, good = _iterate(*frozen, lax.stop_gradient(radius), tol, max_steps)
    broken = section.beyond(*(found / radius))
    code = jnp.where(good, status.OK, status.NOT_CONVERGED)
    code = jnp.where(broken, status.BEYOND_CAPACITY, code).astype(jnp.int32)
    ok = code == status.OK
    section, target, memory = implicit.gate(ok, parameters)
    radius = lax.stop_gradient(radius)  # it scales the unknowns and is no part of the answer

    def unbalanced(v):
        return _forces(section.extended(), v, radius, memory) - target / radius

    def tangent_solve(linearized, rhs):
        matrix = _tangent(frozen[0].extended(), found, radius, frozen[2])
        matrix = jnp.where(ok, matrix, jnp.eye(3, dtype=found.dtype))
        return linear.factorize(matrix).solve(rhs, linearized)

    scaled = lax.custom_root(unbalanced, found, lambda _, start: start, tangent_solve)
    strain = implicit.nan_unless(ok, scaled / radius, parameters)
    return SectionState(tuple(strain), code, residual, steps)


def _batch(section, forces, memory, tol, max_steps):
    """The same for forces of any shape."""
    shape = forces[0].shape
    flat = [v.ravel() for v in forces]
    every = jax.tree.leaves(memory)[0].ndim > 2 if memory is not None else False
    own = jax.tree.map(lambda p: p.reshape(-1, *p.shape[len(shape) :]), memory) if every else None

    def one(item):
        force, p = item
        return equilibrium(section, *force, p if every else memory, tol, max_steps)

    states = lax.map(one, (flat, own))
    return jax.tree.map(lambda v: v.reshape(shape), states)


def _radius(section):
    """Lengths that make the unknowns strains: 1 and the radii of gyration (1 if zero)."""
    inertia = jnp.stack(section.inertia()[:2]) / section.total_area
    flat = inertia <= 0
    radius = jnp.where(flat, 1.0, jnp.sqrt(jnp.where(flat, 1.0, inertia)))
    return jnp.append(jnp.ones(1, radius.dtype), radius)


def _forces(section, scaled, radius, memory):
    """Forces, moments over their radius, [3], N, of strains times their radius [3]."""
    return jnp.stack(section.forces(*(scaled / radius), memory)) / radius


def _tangent(section, scaled, radius, memory):
    """Derivative of `_forces`, [3, 3], N."""
    _, tangent = section.linearized(*(scaled / radius), memory)
    return tangent / jnp.outer(radius, radius)


def _iterate(section, target, memory, radius, tol, max_steps):
    """Newton with line search from zero strain: strains, steps, residual, success."""
    section = section.extended()
    eps = jnp.finfo(target.dtype).eps
    tol = jnp.maximum(64 * eps, jnp.asarray(64 * eps if tol is None else tol))
    load = jnp.max(jnp.abs(target / radius))

    def evaluate(v):
        residual = _forces(section, v, radius, memory) - target / radius
        stress = section.fibre_stress(*(v / radius), memory)
        return residual, jnp.sum(jnp.abs(stress) * section.area) + load

    def unfinished(s):
        _, residual, scale, _, steps = s
        return (jnp.max(jnp.abs(residual)) > tol * scale) & (steps < max_steps)

    def iterate(s):
        v, residual, scale, kappa, steps = s
        matrix = _tangent(section, v, radius, memory)
        shift = kappa * jnp.max(jnp.abs(residual))
        step, definite = linear.solve_definite(
            matrix + shift * jnp.eye(3, dtype=matrix.dtype), -residual
        )
        slope = residual @ step
        # in a batch a finished lane is carried along: it must not make the others wait for a search
        usable = definite & jnp.isfinite(slope) & (slope < 0) & unfinished(s)
        step = jnp.where(usable, step, 0.0)
        a, new_residual, new_scale, found = search(
            lambda a: evaluate(v + a * step), step, slope, usable
        )
        # The shift, residual per strain, keeps a yielded section from being singular and, of the
        # many strains that balance a force on a plateau, leads to small ones. Without it the last
        # step would be exact; with it the residual falls by a thousand, for one more iteration.
        kappa = jnp.where(found, jnp.maximum(0.1 * kappa, 1e-3), 100 * kappa)
        return (
            jnp.where(found, v + a * step, v),
            jnp.where(found, new_residual, residual),
            jnp.where(found, new_scale, scale),
            kappa,
            steps + 1,
        )

    start = jnp.zeros(3, target.dtype)
    s = (start, *evaluate(start), jnp.ones((), target.dtype), jnp.int32(0))
    v, residual, scale, _, steps = lax.while_loop(unfinished, iterate, s)
    largest = jnp.max(jnp.abs(residual))
    return v, steps, largest, largest <= tol * scale
