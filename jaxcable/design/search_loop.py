"""The loop of a search: in Python where numbers are known, else a loop within a program."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jax import lax

from ..common.jax_internals import is_untransformed
from ..common.progress import Step, Trial, report_progress
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


def make_report(
    listen: Callable[[Any], object] | None,
    kind: type[Step] | type[Trial],
    steps: int,
    is_news: Callable[[Any, Any], Any],
    numbers: Callable[[Any], dict[str, Any]],
) -> Callable[[Any, Any], object] | None:
    """Return the function of two states that reports progress from either loop; None without.

    Args:
        listen: function of a report, or None.
        kind: class of the report.
        steps: its field ``count``.
        is_news: function of a state and the next one: whether to report.
        numbers: function of the next state to the other fields of the report by name, scalars.
    """
    if listen is None:
        return None

    def report(before, after):
        if isinstance(after.running, jax.core.Tracer):
            known = {"count": steps}
            news = is_news(before, after)
            lax.cond(news, lambda: report_progress(listen, kind, known, numbers(after)), _nothing)
            return
        before, after = jax.tree.map(np.asarray, (before, after))
        if is_news(before, after):
            fields = {name: value.item() for name, value in numbers(after).items()}
            listen(kind(count=steps, **fields))

    return report


def _nothing():
    """Do nothing."""
