"""Records along a path: points and events, in arrays of fixed size."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from ..common.tree import select_tree
from ..common.types import Array, Bool, Int, PyTree
from ..mechanics.element_output import evaluate_output
from ..mechanics.load_ramp import LoadRamp
from . import events
from .negative_eigenvalues import count_eigenvalue_sign_changes
from .path_state import PathPoint
from .step_decision import StepDecision


def record_point(step: StepDecision) -> tuple[dict[str, PyTree[Array]], Int[Array, ""]]:
    """Write the end of a step into the point records if wanted; return them and their number."""
    current, corrected = step.current, step.corrected
    shown = select_tree(step.ends_in_failure, current.anchor, step.point)
    row = make_point_record(step.problem.ramp, shown, current.anchor.memory)
    row |= {"iterations": corrected.steps, "residual": corrected.residual}
    row |= {"scale": corrected.scale, "rounding": corrected.rounding}
    records = _write_record(current.point_records, current.n_point, row, step.records_point)
    return records, current.n_point + step.records_point


def make_point_record(
    ramp: LoadRamp, p: PathPoint, memory: list[PyTree[Array]] | None
) -> dict[str, PyTree[Array]]:
    """Return the record of a point `p`: its load factor, displacements, element results and so on.

    `memory` has the history variables at the last accepted point. Residual and iterations of the
    corrector are added by `record_point`.
    """
    seen = evaluate_output(ramp.system_at(p.load_factor, memory), p.x)
    return {
        "load_factor": p.load_factor,
        "displacement": p.x[:, :3],
        "found": seen.increment_results.by_name,
        "n_slack": seen.n_slack,
        "n_loose": seen.n_loose,
        "n_negative": p.n_negative,
        "stiffness": p.stiffness,
        "rise": p.rise,
    }


def record_events(step: StepDecision) -> tuple[dict[str, PyTree[Array]], Int[Array, ""]]:
    """Write the events that were located in a step into the records of events.

    Returns the records, a dict of arrays, and the number of events, which can exceed their length.
    """
    current, a, p = step.current, step.current.anchor, step.point
    event_records, count, whole = current.event_records, current.n_event, ~step.has_failure
    fork = (step.has_bifurcation | step.on_other_branch) & ~step.has_limit_point & whole
    beside = select_tree(step.on_other_branch, current.bracket_end, step.bracket_end)
    crossing, at_limit = count_eigenvalue_sign_changes(beside, a, step.is_first)
    zero = jnp.where(step.interpolated, _factor_at_zero_stiffness(a, p), p.load_factor)
    none, no_element = jnp.int32(0), jnp.zeros_like(p.is_slack)
    event = {
        "lower": a.load_factor,
        "upper": p.load_factor,
        "row": current.n_point,
        "point": p,
        "null": step.has_null_vector,
    }
    slips = [(step.has_slip, events.SLIP, p.load_factor, none, step.newly_slipping)]
    for happened, kind, factor, number, elements in (
        (step.has_limit_point & whole, events.LIMIT_POINT, p.load_factor, at_limit, no_element),
        (fork, events.BIFURCATION, zero, crossing, no_element),
        (step.has_slackening, events.SLACKENING, p.load_factor, none, step.newly_slack),
        (step.has_tightening, events.TIGHTENING, p.load_factor, none, step.newly_taut),
        *([] if p.slipping is None else slips),
        (step.has_failure, events.MATERIAL_FAILURE, p.load_factor, none, step.ruptured),
    ):
        event |= {"kind": jnp.int32(kind), "load_factor": factor}
        event |= {"multiplicity": number, "elements": elements}
        event_records = _write_record(event_records, count, event, step.located & happened)
        count = count + (step.located & happened)
    return event_records, count


def _factor_at_zero_stiffness(a, p):
    """Return the load factor at which the stiffness is zero between points `a` and `p` (linear)."""
    part = a.stiffness / jnp.where(a.stiffness == p.stiffness, 1.0, a.stiffness - p.stiffness)
    return a.load_factor + part * (p.load_factor - a.load_factor)


def allocate_records(count: int, record: PyTree[Any]) -> PyTree[Array]:
    """Return zeros for `count` records of points or events: [count, ...] per array of `record`."""
    return jax.tree.map(lambda a: jnp.zeros((count, *a.shape), a.dtype), record)


def _write_record(
    rows: PyTree[Array], index: Int[Array, ""], row: PyTree[Array], wanted: Bool[Array, ""]
) -> PyTree[Array]:
    """Return the records `rows` with `row` at `index`, if `wanted` and if there is room."""

    def one(column, value):
        at = jnp.where(wanted, index, len(column))  # beyond the end: dropped
        return column.at[at].set(value, mode="drop")

    return jax.tree.map(one, rows, row)
