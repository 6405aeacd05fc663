"""Records along a path: points and events, in arrays of fixed size."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from ..common.tree import where
from ..common.types import Array, Bool, Int, PyTree
from ..mechanics.ramp import Ramp
from ..mechanics.reading import read
from . import events
from .decision import Decision
from .inertia import multiplicity
from .run import Point


def record(step: Decision) -> tuple[dict[str, PyTree[Array]], Int[Array, ""]]:
    """Recorded points (`Run.rows`) and their number after a step."""
    run, found = step.run, step.found
    shown = where(step.fatal, run.anchor, step.point)
    row = row_of(step.course.ramp, shown, run.anchor.memory)
    row |= {"iterations": found.steps, "residual": found.residual}
    row |= {"scale": found.scale, "rounding": found.rounding}
    return _put(run.rows, run.n_row, row, step.record), run.n_row + step.record


def row_of(ramp: Ramp, p: Point, memory: list[PyTree[Array]] | None) -> dict[str, PyTree[Array]]:
    """The record of a point, but for the numbers of its correction."""
    seen = read(ramp.at(p.factor, memory), p.x)
    return {
        "load_factor": p.factor,
        "displacement": (p.x - ramp.begin.motion)[:, :3],
        "found": seen.of_path.found,
        "n_slack": seen.n_slack,
        "n_loose": seen.n_loose,
        "n_negative": p.negative,
        "stiffness": p.stiffness,
        "rise": p.rise,
    }


def note(step: Decision) -> tuple[dict[str, PyTree[Array]], Int[Array, ""]]:
    """Recorded events after a step, and their number, including those there is no room for."""
    run, a, p = step.run, step.run.anchor, step.point
    noted, count, whole = run.noted, run.n_event, ~step.failed
    fork = (step.branch | step.astray) & ~step.limit & whole
    beside = where(step.astray, run.beyond, step.beyond)
    crossing, at_limit = multiplicity(beside, a, step.fresh)
    zero = jnp.where(step.line, _zero_between(a, p), p.factor)
    none, no_element = jnp.int32(0), jnp.zeros_like(p.slack)
    event = {"lower": a.factor, "upper": p.factor, "row": run.n_row, "point": p, "null": step.null}
    for happened, kind, factor, number, elements in (
        (step.limit & whole, events.LIMIT_POINT, p.factor, at_limit, no_element),
        (fork, events.BIFURCATION, zero, crossing, no_element),
        (step.slackened, events.SLACKENING, p.factor, none, step.gone_slack),
        (step.tightened, events.TIGHTENING, p.factor, none, step.gone_taut),
        (step.failed, events.MATERIAL_FAILURE, p.factor, none, step.broken),
    ):
        event |= {"kind": jnp.int32(kind), "load_factor": factor}
        event |= {"multiplicity": number, "elements": elements}
        noted = _put(noted, count, event, step.hit & happened)
        count = count + (step.hit & happened)
    return noted, count


def _zero_between(a, p):
    """Load factor at which the stiffness is zero, on the line between two points."""
    part = a.stiffness / jnp.where(a.stiffness == p.stiffness, 1.0, a.stiffness - p.stiffness)
    return a.factor + part * (p.factor - a.factor)


def room_for(count: int, record: PyTree[Any]) -> PyTree[Array]:
    """Arrays of zeros for a number of records like one, of which only the shapes matter."""
    return jax.tree.map(lambda a: jnp.zeros((count, *a.shape), a.dtype), record)


def _put(
    rows: PyTree[Array], number: Int[Array, ""], row: PyTree[Array], wanted: Bool[Array, ""]
) -> PyTree[Array]:
    """Write the record `row` at index `number` of `rows` if it is `wanted` and there is room."""

    def one(column, value):
        at = jnp.where(wanted, number, len(column))  # beyond the end: dropped
        return column.at[at].set(value, mode="drop")

    return jax.tree.map(one, rows, row)
