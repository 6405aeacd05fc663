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
from .attempt import Course, Tried
from .correction import Corrected
from .decision import Decided
from .detection import Seen
from .inertia import multiplicity
from .run import Noted, Point, Run


def record(
    course: Course, run: Run, tried: Tried, seen: Seen, decided: Decided
) -> tuple[tuple[PyTree[Array], ...], Int[Array, ""]]:
    """Recorded points (`Run.rows`) and their number after a step."""
    fatal, a = seen.fatal, run.anchor
    shown = where(fatal, a, tried.point)
    row = row_at(course.ramp, shown, a.memory, tried.found)
    return put(run.rows, run.n_row, row, decided.record), run.n_row + decided.record


def note(course: Course, run: Run, tried: Tried, seen: Seen) -> tuple[Noted, Int[Array, ""]]:
    """Recorded events after a step, and their number, including those there is no room for."""
    a, p = run.anchor, tried.point
    kinds = (
        (seen.limit & ~seen.failed, events.LIMIT_POINT),
        ((seen.branch | seen.astray) & ~seen.limit & ~seen.failed, events.BIFURCATION),
        (seen.slackened, events.SLACKENING),
        (seen.tightened, events.TIGHTENING),
        (seen.failed, events.MATERIAL_FAILURE),
    )
    noted, count = run.noted, run.n_event
    beside = where(seen.astray, run.beyond, seen.now)
    many = multiplicity(beside, a, tried.fresh)
    for happened, kind in kinds:
        changed = _elements(course, kind, a, p)
        on_line = seen.line & (kind == events.BIFURCATION)
        at = jnp.where(on_line, _zero_between(a, p), p.factor)
        number = many[kind == events.LIMIT_POINT] if kind in events.CRITICAL else jnp.int32(0)
        entry = Noted(
            jnp.int32(kind), at, a.factor, p.factor, run.n_row, p, changed, seen.null, number
        )
        noted = put(noted, count, entry, seen.hit & happened & (count < course.capacity[1]))
        count = count + (seen.hit & happened)
    return noted, count


def _elements(course, kind, a, p):
    """The elements that an event of this kind concerns, bool."""
    if kind == events.SLACKENING:
        return p.slack & ~a.slack
    if kind == events.TIGHTENING:
        return a.slack & ~p.slack
    system = course.ramp.at(p.factor, a.memory)
    if kind == events.MATERIAL_FAILURE and system.breaks:
        return system.broken(system.strains(p.x))
    return jnp.zeros_like(p.slack)


def _zero_between(a, p):
    """Load factor at which the stiffness is zero, on the line between two points."""
    part = a.stiffness / jnp.where(a.stiffness == p.stiffness, 1.0, a.stiffness - p.stiffness)
    return a.factor + part * (p.factor - a.factor)


def row_at(
    ramp: Ramp, p: Point, memory: list[PyTree[Array]] | None, found: Corrected
) -> tuple[PyTree[Array], ...]:
    """The record of a point, an entry of `Run.rows`."""
    system = ramp.at(p.factor, memory)
    return (
        p.factor,
        _row_of(ramp, system, p.x),
        p.negative,
        p.stiffness,
        p.rise,
        found.steps,
        found.residual,
        found.scale,
        found.rounding,
    )


def _row_of(ramp, system, x):
    """Displacement since the phase began, results of elements, counts of slack and loose."""
    seen = read(system, x)
    moved = (x - ramp.begin.motion)[:, :3]
    return moved, seen.of_path.found, seen.n_slack, seen.n_loose


def nothing(p: Point) -> Any:
    """Stands for a `Corrected` where only shapes are needed."""
    zero = jnp.zeros((), p.rise.dtype)

    class Shapes:
        steps, residual, scale, rounding = jnp.int32(0), zero, zero, zero

    return Shapes


def put(
    rows: PyTree[Array], number: Int[Array, ""], row: PyTree[Array], wanted: Bool[Array, ""]
) -> PyTree[Array]:
    """Write the record `row` at index `number` of `rows` if `wanted`."""

    def one(column, value):
        at = jnp.minimum(number, len(column) - 1)
        return column.at[at].set(jnp.where(wanted, value, column[at]))

    return jax.tree.map(one, rows, row)
