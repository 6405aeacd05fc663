"""The state of a continuation, `PathState`, with its settings and points."""

from __future__ import annotations

from ..common.rules import Rule
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree


@pytree
class PathSettings:
    """Options of `trace_path` that the compiled program takes.

    Attributes:
        until, down_to: load factors at which the path ends.
        step, largest: first and largest step, as changes of the load factor.
        tol: length of path within which events are located.
        through: whether to go on beyond limit points and bifurcations.
    """

    until: Float[ArrayLike, ""]
    down_to: Float[ArrayLike, ""]
    step: Float[ArrayLike, ""]
    largest: Float[ArrayLike, ""]
    tol: Float[ArrayLike, ""]
    through: Bool[ArrayLike, ""]

    def rules(self) -> list[Rule]:
        """Return the rules of the settings; NaN breaks them, too (no path would end).

        `down_to` is negative, all others are positive.
        """
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
class PathPoint:
    """A point of the equilibrium path, with its tangent.

    Attributes:
        x, load_factor: displacements (and rotations) of the nodes, and load factor.
        direction, rise: unit tangent of the path: its part in the unknowns, [n_free], over
            `PathState.displacement_scale`, and its part in the load factor.
        memory: history variables with which a step from here begins, or None.
        n_negative: number of negative eigenvalues of the tangent stiffness.
        stiffness, phi, left_phi: eigenvalue nearest to zero, and its right and left eigenvectors,
            [n_free].
        residual_by_factor: derivative of the residual by the load factor, [n_free], N.
        is_slack: which elements are slack, those of all groups one after the other, bool.
        slipping: where elements slip with friction (`slipping_places`), or None.
    """

    x: Float[Array, "n_row n_motion"]
    load_factor: Float[Array, ""]
    direction: Float[Array, " n_free"]
    rise: Float[Array, ""]
    memory: list[PyTree[Array]] | None
    n_negative: Int[Array, ""]
    stiffness: Float[Array, ""]
    phi: Float[Array, " n_free"]
    left_phi: Float[Array, " n_free"]
    residual_by_factor: Float[Array, " n_free"]
    is_slack: Bool[Array, " n_elem"]
    slipping: Bool[Array, " n_place"] | None


@pytree
class BracketEnd:
    """Values at the far end of the bracket: of the step that contains an event to be located.

    Attributes:
        rise, stiffness, n_negative: as of a `PathPoint`.
        smooth: whether the event is smooth: no element goes slack, becomes taut, slips or fails.
        has_bifurcation: whether the event is a bifurcation, as far as known.
    """

    rise: Float[Array, ""]
    stiffness: Float[Array, ""]
    n_negative: Int[Array, ""]
    smooth: Bool[Array, ""]
    has_bifurcation: Bool[Array, ""]


@pytree
class PathState:
    """State of the continuation between two steps.

    Attributes:
        anchor: the last point that was accepted, `PathPoint`.
        step_kind: kind of the next step: ARC, FINISH or LOAD of `trial_step`.
        ds, nominal_ds: length of the next step, and of an ordinary step.
        first_stiffness: larger `stiffness` at both ends of the step in which an event was first
            seen, N/m.
        displacement_scale: displacement that counts as much as a unit of the load factor, m; 0
            before it is known.
        locating: whether an event is being located.
        bracket: length of the step from the anchor that contains this event.
        bracket_end: `BracketEnd` of this step: values at its end, beyond the event.
        tol: length of a step within which an event counts as located; enlarged after rounding has
            moved an event out of its bracket.
        n_tried: number of steps tried so far.
        point_records, n_point: records of points, by the names of fields of `TracedPath` (`found`:
            results of elements; `scale`: the force that the residual is compared with), and their
            number.
        event_records, n_event: records of events, by the names of fields of `Events`, with the
            `point` behind each event and whether its `phi` is a `null` vector; and their number,
            including those that there is no room for.
        code, done: status, and whether the path has ended.
    """

    anchor: PathPoint
    step_kind: Int[Array, ""]
    ds: Float[Array, ""]
    nominal_ds: Float[Array, ""]
    first_stiffness: Float[Array, ""]
    displacement_scale: Float[Array, ""]
    locating: Bool[Array, ""]
    bracket: Float[Array, ""]
    bracket_end: BracketEnd
    tol: Float[Array, ""]
    n_tried: Int[Array, ""]
    point_records: dict[str, PyTree[Array]]
    n_point: Int[Array, ""]
    event_records: dict[str, PyTree[Array]]
    n_event: Int[Array, ""]
    code: Int[Array, ""]
    done: Bool[Array, ""]
