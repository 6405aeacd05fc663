"""Newton's method for unknown lengths, whose equations are results of analyses.

A step is halved if an analysis does not follow, or if the step that the errors at its end would
ask for, with the Jacobian at its beginning, is not shorter (the natural test of Deuflhard, Newton
Methods for Nonlinear Problems, 2004, 3.3): errors of stiff and of soft directions count as lengths.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import linear
from ..common import status
from ..common.types import Array, Float
from ..programs.program_calls import as_program

_MAX_STEPS = 40  # analyses; a mast whose guys nearly let it sway takes 7
_LONGEST_STEP = 0.2  # of logarithms of lengths


def newton_search(
    evaluate: Callable[[Float[np.ndarray, " n"]], tuple[Any, Any, Any]],
    guess: Float[np.ndarray, " n"],
    tol: Float[np.ndarray, ""],
) -> tuple[Float[np.ndarray, " n"], np.int32, Float[np.ndarray, " n"]]:
    """Search for the unknowns at which all errors are zero; on the host.

    Args:
        evaluate: function of unknowns, [n], to errors, [n], their Jacobian, [n, n], and the status
            of the analysis.
        guess: unknowns to begin with, [n].
        tol: errors and steps below it end the search, after a last step.

    Returns:
        The unknowns; OK, NOT_AS_BUILT, or the status of the first analysis if that has failed; and
            the errors at the last unknowns that were better than those before, [n].
    """
    found, step, part, left, before = guess, np.zeros_like(guess), 1.0, guess, np.eye(len(guess))
    for tries in range(_MAX_STEPS):
        tried = found + part * step
        errors, jacobian, code = map(np.asarray, evaluate(tried))
        newton = np.asarray(_newton_step(jacobian, errors))
        longest = abs(newton).max()
        # the step that these errors would ask for with the last Jacobian
        after = abs(np.asarray(_newton_step(before, errors))).max()
        is_shorter = tries == 0 or after <= (1 - part / 4) * abs(step).max()
        if code == status.OK and np.isfinite(longest) and is_shorter:
            # quadratic convergence: what is left after this step is its square
            if max(abs(errors).max(), longest) < tol:
                return tried + newton, np.int32(status.OK), errors
            found, step, left, before = tried, newton, errors, jacobian
            part = min(1.0, _LONGEST_STEP / longest)
        elif tries == 0:
            return found, np.int32(code or status.NOT_AS_BUILT), errors
        else:
            part = part / 2
    return found, np.int32(status.NOT_AS_BUILT), left


@as_program
def _newton_step(jacobian, errors):
    """Return the step ``-J^-1 errors`` of the unknowns, [n]; zero for those of absent cables.

    The Jacobian J, [n, n], has zero rows and columns for them; a program.
    """
    return linear.solve_general(_add_ones_for_absent_cables(jacobian), -errors)[0]


def solve_dense(
    _: object, function: Callable[[Array], Array], rhs: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Return x [n] with ``function(x) = rhs`` for a linear `function`, by its dense matrix.

    The first argument, parameters, is not needed (see `TangentSolver`).
    """
    matrix = jax.vmap(function, out_axes=1)(jnp.eye(len(rhs), dtype=rhs.dtype))
    return linear.solve_general(_add_ones_for_absent_cables(matrix), rhs)[0]


def _add_ones_for_absent_cables(matrix):
    """Return a square matrix with 1 on the diagonal where its row and its column are zero.

    These are the unknowns of cables that are absent in all phases; their solution is then zero.
    """
    idle = jnp.all(matrix == 0, axis=0) & jnp.all(matrix == 0, axis=1)
    return matrix + jnp.diag(idle.astype(matrix.dtype))
