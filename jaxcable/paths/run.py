"""What a continuation carries from step to step."""

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
        """What they keep, see `common.rules`; a NaN keeps none, and the path would have no end."""
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
    """A point of the path and its state.

    Attributes:
        x, factor: point of the system and load factor.
        direction, rise: unit tangent: unknowns over `Run.weight`, and load factor.
        memory: of laws, that an increment from here begins with, or None.
        negative, stiffness, phi, left: see `linear.spectrum`.
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
class Noted:
    """Events as they are noted, with the point beyond.

    Attributes:
        kind, factor, lower, upper, row, changed: as of `Events`.
        point: beyond it.
        null: whether phi is a null vector there.
        crossed: eigenvalues that change their sign.
    """

    kind: Int[Array, ""]
    factor: Float[Array, ""]
    lower: Float[Array, ""]
    upper: Float[Array, ""]
    row: Int[Array, ""]
    point: Point
    changed: Bool[Array, " n_elem"]
    null: Bool[Array, ""]
    crossed: Int[Array, ""]


@pytree
class Beyond:
    """Beyond an event: what guesses its place, and what goes on from there.

    Attributes:
        rise, stiffness, negative: as of a `Point`.
        smooth: whether nothing but rise and inertia changes.
        branch: whether it is a bifurcation, so far as can be seen.
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
        anchor: last point, `Point`.
        mode: how the next step is tried.
        ds, nominal: length of this step, and of an ordinary one.
        reference: larger stiffness at the ends of the step in which an event was first seen, N/m.
        weight: displacement that counts as much as a unit of the load factor, m; 0 before it is
            known.
        hunting, bracket: whether an event is being closed in on, and the step that contains it.
        beyond: the state at the far end of it, `Beyond`.
        tol: step in which an event counts as caught; larger after one has slipped away.
        tries: steps tried so far.
        rows, n_row: points recorded, and their number.
        noted, n_event: events recorded.
        code: status; done: whether the end is reached.
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
    rows: tuple[PyTree[Array], ...]
    n_row: Int[Array, ""]
    noted: Noted
    n_event: Int[Array, ""]
    code: Int[Array, ""]
    done: Bool[Array, ""]
