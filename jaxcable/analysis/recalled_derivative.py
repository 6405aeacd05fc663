"""Derivatives of a solution outside of `jit`: programs of their own, without the iteration.

Where `jax.grad` and its like see the numbers of an analysis, it is solved first, by the program
that `solve` has without derivatives. The derivative of its converged points is another program,
much smaller than one that iterates once more, for the results that are asked for. Within `jax.jit`
there is one program.
"""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from ..common import jax_internals as internals
from ..common.types import PyTree
from ..mechanics.bundles import Bundles
from ..programs.program_calls import as_program
from .one_phase import ConvergedPoints
from .phase_loop import recall_solution
from .solution import Solution


@functools.partial(as_program, static=("bundles", "wanted"))
def recalled_results(core, points, bundles, wanted):
    """Return results of a solved analysis, a list of floats, to be differentiated.

    Args:
        core: arguments of `phase_loop.analyse`.
        points: its `ConvergedPoints`.
        bundles: as for `analyse`.
        wanted: indices of the results among the leaves of the `Solution`.
    """
    found = jax.tree.leaves(recall_solution(*core, points, bundles))
    return [found[k] for k in wanted]


def attach_recalled_derivative(
    solution: Solution, core: PyTree[Any], points: ConvergedPoints, bundles: Bundles
) -> Solution:
    """Return a known solution with its derivatives by the arguments of the analysis.

    Args:
        solution: `Solution` of the compiled core.
        core: arguments of `phase_loop.analyse` that are differentiated, of which it was computed.
        points: `ConvergedPoints` of the analysis.
        bundles: as for `analyse`.
    """
    tree: Any
    leaves, tree = jax.tree.flatten(solution)
    wanted = tuple(k for k, x in enumerate(leaves) if jnp.issubdtype(x.dtype, jnp.inexact))
    known = [leaves[k] for k in wanted]
    found = recalled_results(core, points, bundles=bundles, wanted=wanted, value=known)
    for k, x in zip(wanted, found, strict=True):
        leaves[k] = x
    return tree.unflatten(leaves)


def arguments_if_known(core: PyTree[Any]) -> PyTree[Any] | None:
    """Return the arguments `core` of an analysis as known numbers, without derivatives.

    None if no derivative is being taken, or if it is taken within `jit`, where none are known.
    """
    if not internals.is_differentiating():
        return None
    known = without_derivatives(core)
    traced = any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves(known))
    return None if traced else known


def without_derivatives(core: PyTree[Any]) -> PyTree[Any]:
    """Return a pytree of arguments with derivatives stopped (zero) where it is traced."""

    def without(x):
        return lax.stop_gradient(x) if isinstance(x, jax.core.Tracer) else x

    return jax.tree.map(without, core)
