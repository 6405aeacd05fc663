"""Newton's method for unknown lengths, whose equations are results of analyses.

A step is halved if an analysis does not follow, or if the step that the errors at its end would
ask for, with the Jacobian at its beginning, is not shorter (the natural test of Deuflhard, Newton
Methods for Nonlinear Problems, 2004, 3.3): errors of stiff and of soft directions count as lengths.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import linear
from ..common import status
from ..common.types import Array, Bool, Float, Int
from ..programs.program_calls import as_program

_MAX_STEPS = 40  # analyses; a mast whose guys nearly let it sway takes 7
_LONGEST_STEP = 0.2  # of logarithms of lengths


class Iterate(NamedTuple):
    """State of the search for lengths.

    Attributes:
        unknowns: logarithms of lengths over chords, [n]; the best ones so far.
        step: Newton's step from them, [n].
        part: part of it that is tried next.
        errors: errors there, [n].
        jacobian: their derivative, [n, n].
        code: status, once it has ended.
        tries: number of analyses.
        done: whether the search has ended.
    """

    unknowns: Float[Array, " n"]
    step: Float[Array, " n"]
    part: Float[Array, ""]
    errors: Float[Array, " n"]
    jacobian: Float[Array, "n n"]
    code: Int[Array, ""]
    tries: Int[Array, ""]
    done: Bool[Array, ""]


def search(
    evaluate: Callable[[Float[Array, " n"]], tuple[Array, Array, Array]],
    guess: Float[Array, " n"],
    tol: Float[Array, ""],
    concrete: bool,
) -> tuple[Float[Array, " n"], Int[Array, ""], Float[Array, " n"]]:
    """Search for the unknowns at which all errors are zero.

    Args:
        evaluate: function of unknowns, [n], to errors, [n], their Jacobian, [n, n], and the status
            of the analysis.
        guess: unknowns to begin with, [n].
        tol: errors and steps below it end the search, after a last step.
        concrete: whether all numbers are known: then there is a loop of Python, else of jax.

    Returns:
        The unknowns; OK, NOT_AS_BUILT, or the status of the first analysis if that has failed; and
            the errors at the last unknowns that were better than those before, [n].
    """
    one: Any = np.ones((), guess.dtype)
    still: Any = np.zeros(guess.shape, guess.dtype)
    zero: Any = np.zeros((), np.int32)
    unknown, going_on = still + np.nan, zero != 0
    matrix: Any = np.eye(len(still), dtype=guess.dtype)
    state = Iterate(guess, still, one, unknown, matrix, zero, zero, going_on)

    def advance(state):
        return _advance(state, tol, *evaluate(state.unknowns + state.part * state.step))

    if concrete:
        while not state.done:
            state = jax.tree.map(np.asarray, advance(state))
    else:
        state = lax.while_loop(lambda state: ~state.done, advance, state)
    return state.unknowns, state.code, state.errors


@as_program
def _advance(state, tol, errors, jacobian, code):
    """Return the next `Iterate` after an analysis of unknowns, with its errors and its status.

    Errors and step below `tol` end the search.
    """
    jacobian = _with_idle_unknowns(jacobian)
    newton, _ = linear.solve_general(jacobian, -errors)
    after, _ = linear.solve_general(state.jacobian, -errors)
    size, longest = jnp.max(jnp.abs(errors)), jnp.max(jnp.abs(newton))
    shorter = jnp.max(jnp.abs(after)) <= (1 - state.part / 4) * jnp.max(jnp.abs(state.step))
    good = jnp.isfinite(longest) & (code == status.OK) & (shorter | (state.tries == 0))
    # quadratic convergence: what is left after this step is its square
    close = good & (jnp.maximum(size, longest) < tol)
    failed = ~good & (state.tries == 0)
    tries = state.tries + 1
    wrong = jnp.where(failed & (code != status.OK), code, status.NOT_AS_BUILT)
    done = close | failed | (tries >= _MAX_STEPS)
    tried = state.unknowns + state.part * state.step
    unknowns = jnp.where(good, tried, state.unknowns)
    return Iterate(
        jnp.where(close, tried + newton, unknowns),
        jnp.where(good, newton, state.step),
        jnp.where(good, jnp.minimum(1.0, _LONGEST_STEP / longest), 0.5 * state.part),
        jnp.where(good | (state.tries == 0), errors, state.errors),
        jnp.where(good, jacobian, state.jacobian),
        jnp.where(close, status.OK, jnp.where(done, wrong, state.code)).astype(jnp.int32),
        tries,
        done,
    )


def solve_dense(
    _: object, function: Callable[[Array], Array], rhs: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Return the vector of which a linear `function` is `rhs`, for an implicit root."""
    matrix = jax.vmap(function, out_axes=1)(jnp.eye(len(rhs), dtype=rhs.dtype))
    return linear.solve_general(_with_idle_unknowns(matrix), rhs)[0]


def _with_idle_unknowns(matrix):
    """Return a matrix with ones for the unknowns of cables that are not there: nothing moves them.

    Their rows and columns are zero.
    """
    idle = jnp.all(matrix == 0, axis=0) & jnp.all(matrix == 0, axis=1)
    return matrix + jnp.diag(idle.astype(matrix.dtype))
