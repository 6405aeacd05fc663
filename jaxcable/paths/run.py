"""What a continuation carries from step to step."""

from ..common.rules import Rule
from ..common.tree import pytree


@pytree
class Settings:
    """Numbers that steer the continuation; see `trace_path`."""

    until: object
    down_to: object
    step: object
    largest: object
    tol: object
    through: object

    def rules(self):
        """What they keep, see `_rules`; a NaN keeps none, and the path would have no end."""
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

    x: object
    factor: object
    direction: object
    rise: object
    memory: object
    negative: object
    stiffness: object
    phi: object
    left: object
    pull: object
    slack: object


@pytree
class Noted:
    """Events as they are noted, with the point beyond.

    Attributes:
        kind, factor, lower, upper, row, changed: as of `Events`.
        point: beyond it.
        null: whether phi is a null vector there.
        crossed: eigenvalues that change their sign.
    """

    kind: object
    factor: object
    lower: object
    upper: object
    row: object
    point: Point
    changed: object
    null: object
    crossed: object


@pytree
class Beyond:
    """Beyond an event: what guesses its place, and what goes on from there.

    Attributes:
        rise, stiffness, negative: as of a `Point`.
        smooth: whether nothing but rise and inertia changes.
        branch: whether it is a bifurcation, so far as can be seen.
    """

    rise: object
    stiffness: object
    negative: object
    smooth: object
    branch: object


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
    mode: object
    ds: object
    nominal: object
    reference: object
    weight: object
    hunting: object
    bracket: object
    beyond: object
    tol: object
    tries: object
    rows: object
    n_row: object
    noted: Noted
    n_event: object
    code: object
    done: object
