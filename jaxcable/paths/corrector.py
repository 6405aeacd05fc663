"""The corrector: Newton's method for equilibrium and one linear condition, onto the path.

Unknowns are the degrees of freedom u and the load factor f. With the residual R(u, f) and a
condition ``row . (u - u0) + rise (f - f0) = target`` each iteration solves

    [ K    R_f  ] [du]   [ -R                           ]
    [ row  rise ] [df] = [ target - (left side so far)  ]

A condition along the tangent of the path is the arc-length method (Riks 1979, Wempner 1971, in the
form of Keller 1977), a condition on f alone is load control. The last iteration, at the solution,
gives the tangent there with the same matrix.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common.tree import pytree
from ..common.types import Array, Bool, Float, Int, PyTree
from ..equilibrium.newton_step import max_abs
from ..mechanics.assembly import System
from ..mechanics.load_ramp import LoadRamp

# A guess whose residual is below this part of the allowed one is taken as it is: a correction would
# be below rounding, and could not be judged.
_EXACT_GUESS = 1e-3
# Most iterations: near the path quadratic convergence needs 3 to 6, and a shorter step is cheaper
# than more of them.
_MAX_ITERATIONS = 12


@pytree
class CorrectorState:
    """State of the corrector's iteration onto the path; after the last iteration, its result.

    Attributes:
        x: displacement, and rotation where there is one, of each node, [n_row, n_motion].
        moved: sum of the increments since the origin of the condition, u - u0, [n_free].
        load_factor: load factor f.
        direction, rise: tangent of the path, du [n_free] and df, scaled so that ``row . du + rise
            df = 1`` with `row` and `rise` of the condition.
        residual_by_factor: derivative of the residual by the load factor, [n_free], N.
        matrix: tangent stiffness, dense or `linear.SparseMatrix`.
        converged: whether x is in equilibrium.
        regular: whether the bordered matrix is regular, so that there is a tangent.
        failed: whether the iteration has broken down.
        steps: number of iterations without the last one, which gives the tangent.
        residual, scale: largest residual force, and the force that it is compared with, N.
        rounding: largest residual that rounding of the displacements can cause, N; 0 if no element
            estimates it.
    """

    x: Float[Array, "n_row n_motion"]
    moved: Float[Array, " n_free"]
    load_factor: Float[Array, ""]
    direction: Float[Array, " n_free"]
    rise: Float[Array, ""]
    residual_by_factor: Float[Array, " n_free"]
    matrix: Float[Array, "n_free n_free"] | linear.SparseMatrix
    converged: Bool[Array, ""]
    regular: Bool[Array, ""]
    failed: Bool[Array, ""]
    steps: Int[Array, ""]
    residual: Float[Array, ""]
    scale: Float[Array, ""]
    rounding: Float[Array, ""]


def correct_onto_path(
    ramp: LoadRamp,
    memory: list[PyTree[Array]] | None,
    guess: tuple[Float[Array, "n_row n_motion"], Float[Array, " n_free"], Float[Array, ""]],
    origin: Float[Array, ""],
    condition: tuple[Float[Array, " n_free"], Float[Array, ""], Float[Array, ""]],
    tol: Float[Array, ""],
    active: Bool[Array, ""],
) -> CorrectorState:
    """Correct a guess onto the equilibrium path, by Newton's method with one linear condition.

    The condition is ``row . (u - u0) + rise (f - f0) = target`` for unknowns u and load factor f.

    Args:
        ramp: the phase as a function of its load factor; not differentiated.
        memory: history variables at the last accepted point, or None.
        guess: guessed motion [n_row, n_motion], its increment u - u0 [n_free], and load factor.
        origin: load factor f0.
        condition: (row [n_free], rise, target).
        tol: relative residual that counts as equilibrium.
        active: False to return at once.

    Returns:
        The point on the path, with its tangent.
    """
    x, moved, factor = guess
    row, rise, target = condition
    zero = jnp.zeros((), x.dtype)
    begin = ramp.system_at(factor, memory)
    came_from = begin.rounding_error(begin.impose_supports(x))

    def unfinished(it):
        return active & ~it.converged & ~it.failed & (it.steps <= _MAX_ITERATIONS)

    def iterate(it):
        system = ramp.system_at(it.load_factor, memory)
        x = system.impose_supports(it.x)

        def unbalanced(f):
            system = ramp.system_at(f, memory)
            return system.residual_and_scale(system.impose_supports(x))

        unit = zero + 1
        residual, residual_by_factor, scale = jax.jvp(
            unbalanced, (it.load_factor,), (unit,), has_aux=True
        )
        # an unloaded start has no forces to judge by: take the load that the phase adds
        scale = jnp.maximum(scale, max_abs(residual_by_factor))
        rounding = jnp.maximum(system.rounding_error(x), came_from)
        allowed = jnp.maximum(tol * scale, rounding)
        small = jnp.all(jnp.abs(residual) <= allowed)
        # after a short step the guess is nearly in equilibrium: make one correction at least
        settled = small & ((it.steps > 0) | jnp.all(jnp.abs(residual) <= _EXACT_GUESS * allowed))
        matrix = system.tangent(x)
        lacks = target - row @ it.moved - rise * (it.load_factor - origin)
        rhs = jnp.where(settled, 0.0, -residual), jnp.where(settled, 1.0, lacks)
        du, df, regular = linear.solve_bordered(
            matrix, residual_by_factor, row, rise, *rhs, unknowns_without_stiffness(system, x)
        )
        usable = regular & jnp.all(jnp.isfinite(du)) & jnp.isfinite(df)
        converged = settled | (small & ~usable)
        onward = usable & ~converged
        step = jnp.where(onward, du, 0.0)
        return CorrectorState(
            x=jnp.where(onward, system.move(x, step), x),
            moved=it.moved + step,
            load_factor=it.load_factor + jnp.where(onward, df, 0.0),
            direction=jnp.where(settled, du, it.direction),
            rise=jnp.where(settled, df, it.rise),
            residual_by_factor=residual_by_factor,
            matrix=matrix,
            converged=converged,
            regular=usable,
            failed=~converged & ~(usable & jnp.isfinite(scale)),
            steps=it.steps + ~converged,
            residual=max_abs(residual),
            scale=scale,
            rounding=max_abs(rounding),
        )

    no, count = jnp.zeros((), bool), jnp.int32(0)
    still = jnp.zeros_like(moved)
    matrix = jax.eval_shape(lambda: begin.tangent(x))
    matrix = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), matrix)
    begun = still, zero, still, matrix, no, no, no, count, zero, zero, zero
    return lax.while_loop(unfinished, iterate, CorrectorState(*guess, *begun))


def unknowns_without_stiffness(
    system: System, x: Float[Array, "n_row n_motion"]
) -> Bool[Array, " n_free"]:
    """Return which unknowns belong to nodes that have only slack elements, [n_free] bool."""
    return system.nodes_without_stiffness(x)[system.dof_map.row_of_unknown]
