"""Equilibrium of a section: strains from forces, the inverse of `Section.forces`.

With monotone laws the potential ``sum A w(e) - N e0 - My ky - Mz kz`` is convex, and Newton's
method with a line search finds its minimum. The stress-strain curves are extrapolated elastically
beyond rupture, so that strains exist for every force. If a fibre is then beyond its rupture strain,
the force is beyond the capacity.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common import status
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int
from ..materials.law import Numbers, Values
from ..numerics import implicit
from ..numerics.line_search import line_search
from ..programs.program_calls import as_program
from .fibres import FibreMemory, Fibres


@pytree
class SectionState:
    """Strains of a section under given forces; NaN, with NaN derivatives, unless the status is OK.

    Attributes:
        strain: ``(e0, ky, kz)``, each of the shape of the forces, -, 1/m, 1/m.
        status: OK; BEYOND_CAPACITY if a fibre of the last iterate is beyond its rupture strain,
            whether converged or not; else SECTION_UNBALANCED.
        residual: largest unbalanced force; moments divided by the radius of gyration, N.
        steps: number of iterations.

    Example:
        >>> law = jc.Polygonal([-1e-3, 0.0, 1e-3], [-100e6, 0.0, 100e6])
        >>> section = jc.Section.rectangle(0.1, 0.2, law, shape=(10, 10))
        >>> state = section.strains(N=0.0, My=13.2e3, Mz=0.0)  # EI is 6.6 MN m2
        >>> e0, ky, kz = state.strain
        >>> print(f"{jc.describe(state.status)}: {ky:.6f} 1/m")
        converged: 0.002000 1/m
    """

    strain: tuple[Values, Values, Values]
    status: Int[Array, "*shape"]
    residual: Values
    steps: Int[Array, "*shape"]


def solve_strains(
    section: Fibres,
    N: Numbers,
    My: Numbers,
    Mz: Numbers,
    memory: FibreMemory | None = None,
    tol: Float[ArrayLike, ""] | None = None,
    max_steps: int = 100,
) -> SectionState:
    """Find the strains ``(e0, ky, kz)`` at which the section is in equilibrium with given forces.

    Forces of any shape are treated one after the other, each with as many iterations as it needs:
    on a CPU this is five times faster than a batch, which iterates until the slowest has converged.
    For a GPU use `jax.vmap` over single forces.

    Args:
        section: `Section`.
        N, My, Mz: arrays of one shape, N, N m, N m.
        memory: history variables, as from `Section.initial_memory`: the same for all forces, or
            with the axes of the forces in front; None for a section not strained yet.
        tol: largest residual, relative to the sum of absolute fibre forces plus the load (moments
            over the radius of gyration); default 64 eps, which costs one iteration more than 1e-4.
        max_steps: iterations allowed.

    Returns:
        `SectionState`, differentiable (implicit function theorem); its status is BEYOND_CAPACITY
        where the section cannot carry the forces.

    Example:
        The section can carry 2 MN. Half of that causes half of the strain at failure; 3 MN is
        too much:

        >>> law = jc.Polygonal([-1e-3, 0.0, 1e-3], [-100e6, 0.0, 100e6])
        >>> section = jc.Section.rectangle(0.1, 0.2, law, shape=(10, 10))
        >>> state = section.strains(N=1e6, My=0.0, Mz=0.0)
        >>> print(f"{jc.describe(state.status)}: {state.strain[0]:.6f}")
        converged: 0.000500
        >>> print(jc.describe(section.strains(N=3e6, My=0.0, Mz=0.0).status)[:37])
        the section cannot carry these forces
    """
    forces = tuple(jnp.asarray(v, section.area.dtype) for v in (N, My, Mz))
    return _solve_strains(section, forces, memory, tol, max_steps)


@as_program
def _solve_strains(section, forces, memory, tol, max_steps):
    """Return the `SectionState` of forces N, My and Mz: `solve_strains`, a program."""
    N, My, Mz = jnp.broadcast_arrays(*forces)
    if N.ndim:
        return _solve_one_by_one(section, (N, My, Mz), memory, tol, max_steps)
    if memory is None and section.has_memory:
        memory = section.initial_memory()
    target, radius = jnp.stack([N, My, Mz]), _strain_scales(section)
    parameters = (section, target, memory)
    frozen = lax.stop_gradient(parameters)
    found, steps, residual, good = _iterate_strains(
        *frozen, lax.stop_gradient(radius), tol, max_steps
    )
    broken = section.is_ruptured(*(found / radius))
    code = jnp.where(good, status.OK, status.SECTION_UNBALANCED)
    code = jnp.where(broken, status.BEYOND_CAPACITY, code).astype(jnp.int32)
    ok = code == status.OK
    section, target, memory = implicit.stop_gradient_unless(ok, parameters)
    radius = lax.stop_gradient(radius)  # it scales the unknowns and has no effect on the strains

    def unbalanced(v):
        return _scaled_forces(section.extrapolated(), v, radius, memory) - target / radius

    def tangent_solve(linearized, rhs):
        matrix = _scaled_tangent(frozen[0].extrapolated(), found, radius, frozen[2])
        matrix = jnp.where(ok, matrix, jnp.eye(3, dtype=found.dtype))
        return linear.factorize(matrix).solve(rhs, linearized)

    scaled = lax.custom_root(unbalanced, found, lambda _, start: start, tangent_solve)
    strain = implicit.nan_unless(ok, scaled / radius, parameters)
    return SectionState(tuple(strain), code, residual, steps)


def _solve_one_by_one(section, forces, memory, tol, max_steps):
    """Return the `SectionState` of forces N, My, Mz of one shape, solved one after the other.

    Arguments are those of `solve_strains`, `forces` a tuple of three arrays.
    """
    shape = forces[0].shape
    flat = [v.ravel() for v in forces]
    by_force = jax.tree.leaves(memory)[0].ndim > 2 if memory is not None else False
    memories = None
    if by_force:
        memories = jax.tree.map(lambda x: x.reshape(-1, *x.shape[len(shape) :]), memory)

    def of_one(item):
        force, remembered = item
        return _solve_strains(section, force, remembered if by_force else memory, tol, max_steps)

    states = lax.map(of_one, (flat, memories))
    return jax.tree.map(lambda v: v.reshape(shape), states)


def _strain_scales(section):
    """Return the lengths by which (e0, ky, kz) are multiplied to strains: 1, and both radii, [3].

    They are the radii of gyration about y and z, m; 1 m about an axis without inertia.
    """
    inertia = jnp.stack(section.inertia()[:2]) / section.total_area
    flat = inertia <= 0
    radius = jnp.where(flat, 1.0, jnp.sqrt(jnp.where(flat, 1.0, inertia)))
    return jnp.append(jnp.ones(1, radius.dtype), radius)


def _scaled_forces(section, scaled, radius, memory):
    """Return N and moments over radii of gyration, [3], N, at scaled strains.

    `scaled` is (e0, ky, kz) times `radius`, which `_strain_scales` returns.
    """
    return jnp.stack(section.forces(*(scaled / radius), memory)) / radius


def _scaled_tangent(section, scaled, radius, memory):
    """Return the derivative of `_scaled_forces` by `scaled`, [3, 3], N."""
    _, tangent = section.forces_and_tangent(*(scaled / radius), memory)
    return tangent / jnp.outer(radius, radius)


def _iterate_strains(section, target, memory, radius, tol, max_steps):
    """Iterate to the strains of given forces, by Newton's method with a line search from zero.

    Args:
        section, memory, tol, max_steps: as for `solve_strains`.
        target: N, My, Mz, [3], N and N m.
        radius: as of `_strain_scales`.

    Returns:
        Scaled strains [3], number of iterations, largest residual, N, and whether it converged.
    """
    section = section.extrapolated()
    eps = jnp.finfo(target.dtype).eps
    tol = jnp.maximum(64 * eps, jnp.asarray(64 * eps if tol is None else tol))
    load = jnp.max(jnp.abs(target / radius))

    def evaluate(v):
        residual = _scaled_forces(section, v, radius, memory) - target / radius
        stress = section.fibre_stress(*(v / radius), memory)
        return residual, jnp.sum(jnp.abs(stress) * section.area) + load

    def unfinished(s):
        _, residual, scale, _, steps = s
        return (jnp.max(jnp.abs(residual)) > tol * scale) & (steps < max_steps)

    def iterate(s):
        v, residual, scale, kappa, steps = s
        matrix = _scaled_tangent(section, v, radius, memory)
        shift = kappa * jnp.max(jnp.abs(residual))
        step, definite = linear.solve_definite(
            matrix + shift * jnp.eye(3, dtype=matrix.dtype), -residual
        )
        slope = residual @ step
        # under `jax.vmap` finished cases stay in the loop: they must not prolong the line search
        usable = definite & jnp.isfinite(slope) & (slope < 0) & unfinished(s)
        step = jnp.where(usable, step, 0.0)
        a, new_residual, new_scale, found = line_search(
            lambda a: evaluate(v + a * step), step, slope, usable
        )
        # The shift, a residual per strain, keeps the tangent of a yielded section regular. Where
        # many strains balance the force, on a plateau, it leads to small ones. Without the shift
        # the last step would be exact; with it the residual falls by a factor of a thousand, which
        # costs one more iteration.
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
