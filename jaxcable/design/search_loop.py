"""The loop of a search: in Python where numbers are known, else a loop within a program."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
from jax import lax

from ..common.jax_internals import is_untransformed
from ..common.types import PyTree
from .no_derivative import warn_of_undefined_derivative


def is_plain_call(arguments: PyTree[Any]) -> bool:
    """Tell whether a call with these arguments comes from Python, and sees numbers only.

    It does not while jax traces, differentiates or batches: a function of the user could then
    capture what is traced.
    """
    known = not any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves(arguments))
    return known and is_untransformed()


def search_on_host(
    evaluate: Callable[[Any], Any],
    advance: Callable[[Any, Any], Any],
    state: Any,
    report: Callable[[Any, Any], object] | None = None,
    *,
    params: PyTree[Any],
) -> Any:
    """Search in a Python loop, for known numbers: every iteration is two short programs.

    Args:
        evaluate: function of a state to what is known at its trial point.
        advance: function of a state and this to the next state.
        state: first state; states have a field ``running``.
        report: function of a state and the next one, to report progress; or None.

    Options:
        params: pytree of the parameters, to name those by which the start has no derivative.

    Returns:
        The first state that is not running.
    """
    first = True
    while state.running:
        found = evaluate(state)
        if first:
            warn_of_undefined_derivative(*found, params=params)
        before, state, first = state, advance(state, found), False
        if report is not None:
            report(before, state)
    return state


def search_in_program(
    evaluate: Callable[[Any], Any],
    advance: Callable[[Any, Any], Any],
    state: Any,
    report: Callable[[Any, Any], object] | None = None,
) -> Any:
    """Search as `search_on_host` does, in a loop of the program that is being traced."""

    def iterate(before):
        after = advance(before, evaluate(before))
        if report is not None:
            report(before, after)
        return after

    return lax.while_loop(lambda state: state.running, iterate, state)
