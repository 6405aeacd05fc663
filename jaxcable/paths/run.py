"""The state of a continuation: its settings, points, events, and `Run`."""

from __future__ import annotations

from ..common.rules import Rule
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree


@pytree
class Settings:
    """Numbers that steer the continuation; see `trace_path`."""

    until: Float[ArrayLike, ""]
    down_to: Float[ArrayLike, ""]
    step: Float[ArrayLike, ""]
    largest: Float[ArrayLike, ""]
    tol: Float[ArrayLike, ""]
    through: Bool[ArrayLike, ""]

    def rules(self) -> list[Rule]:
        """Rules of the settings, see `common.rules`; a NaN breaks them: the path would not end."""
        text = "must be positive; the path starts at 0"
        below = "must be negative; the path starts at 0"
        steps = [
            Rule(name, getattr(self, name), lambda v: ~(v > 0), "must be positive")
            for name in ("step", "largest", "tol")
        ]
        return [
            Rule("until", self.until, lambda v: ~(v > 0), text),
            Rule("down_to", self.down_to, lambda v: ~(v < 0), below),
            *steps,
        ]


@pytree
class Point:
    """A point of the path.

    Attributes:
        x, factor: motion of all rows, and load factor.
        direction, rise: unit tangent: unknowns over `Run.weight`, and load factor.
        memory: memory of laws with which a step from here begins, or None.
        negative, stiffness, phi, left: number, value, right and left vector of `linear.spectrum`.
        pull: derivative of the residual by the load factor, [n_free], N.
        slack: slack elements, all groups one after the other, bool.
    """

    x: Float[Array, "n_row n_motion"]
    factor: Float[Array, ""]
    direction: Float[Array, " n_free"]
    rise: Float[Array, ""]
    memory: list[PyTree[Array]] | None
    negative: Int[Array, ""]
    stiffness: Float[Array, ""]
    phi: Float[Array, " n_free"]
    left: Float[Array, " n_free"]
    pull: Float[Array, " n_free"]
    slack: Bool[Array, " n_elem"]


@pytree
class Beyond:
    """Values beyond an event, by which it is located.

    Attributes:
        rise, stiffness, negative: as of a `Point`.
        smooth: whether only rise and inertia change at the event.
        branch: whether the event is a bifurcation, as far as known.
    """

    rise: Float[Array, ""]
    stiffness: Float[Array, ""]
    negative: Int[Array, ""]
    smooth: Bool[Array, ""]
    branch: Bool[Array, ""]


@pytree
class Run:
    """Where the continuation stands.

    Attributes:
        anchor: the last point that was accepted, `Point`.
        mode: kind of the next step, see `attempt`.
        ds, nominal: length of the next step, and of an ordinary step.
        reference: larger stiffness at the ends of the step in which an event was first seen, N/m.
        weight: displacement that counts as much as a unit of the load factor, m; 0 before it is
            known.
        hunting: whether an event is being located.
        bracket: length of the step from the anchor that contains this event.
        beyond: `Beyond` at the far end of this step.
        tol: length of a step within which an event counts as located; enlarged after rounding has
            moved an event out of its bracket.
        tries: number of steps tried so far.
        rows, n_row: records of points, by the names of fields of `TracedPath` (`found`: results of
            elements; `scale`: the force that the residual is judged by), and their number.
        noted, n_event: records of events, by the names of fields of `Events`, with the `point`
            beyond each event and whether its `phi` is a `null` vector; and their number, including
            those that there is no room for.
        code, done: status, and whether the path has ended.
    """

    anchor: Point
    mode: Int[Array, ""]
    ds: Float[Array, ""]
    nominal: Float[Array, ""]
    reference: Float[Array, ""]
    weight: Float[Array, ""]
    hunting: Bool[Array, ""]
    bracket: Float[Array, ""]
    beyond: Beyond
    tol: Float[Array, ""]
    tries: Int[Array, ""]
    rows: dict[str, PyTree[Array]]
    n_row: Int[Array, ""]
    noted: dict[str, PyTree[Array]]
    n_event: Int[Array, ""]
    code: Int[Array, ""]
    done: Bool[Array, ""]
