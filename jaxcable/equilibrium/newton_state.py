"""The state of an iteration of Newton's method, which `iteration` changes step by step."""

from __future__ import annotations

from ..common.tree import copy_with, pytree
from ..common.types import Array, Bool, Float, Int, PyTree
from ..linear.sparse import FactorRecord
from .convergence import Progress


@pytree
class Evaluation:
    """Forces of a structure at one point of the iteration.

    Attributes:
        x: motion.
        residual: residual, less the one that is carried along (`convergence`), [n_free], N.
        scale: the force that the residual is compared with, N.
        rounding: error that rounding leaves in the residual, [n_free], N; None if no element
            estimates any.
        elements: what elements give together with their forces, for the matrix of the next step;
            the method of the steps knows its content.
        exact: whether the low-order part of displacements was counted in full; None in structures
            that have none.
    """

    x: Float[Array, "n_row n_motion"]
    residual: Float[Array, " n_free"]
    scale: Float[Array, ""]
    rounding: Float[Array, " n_free"] | None
    elements: PyTree[Float[Array, "n_elem ..."]]
    exact: Bool[Array, ""] | None = None


@pytree
class NewtonState:
    """State of Newton's iteration: the last accepted point, the next step, and how it was found.

    Two bools say what the next iteration does: try the `step`; if `stays_at_point`, evaluate the
    point itself, before a step is made from there, once more or for the first time; and if it also
    `has_no_step`, go on as after a step that was refused, with a larger shift or steps of another
    kind.

    Attributes:
        point: `Evaluation` of the last accepted point.
        step: the step from there, [n_free]; zeros where `stays_at_point`.
        stays_at_point: whether the next evaluation is at the point itself: at the start, when the
            iteration goes on from another point, and when no usable step was found.
        has_no_step: whether the reason for that is that no usable step was found, and the method
            did not ask to repeat it (`step_method.NextStep`).
        strategy: state of the method that makes the steps (`step_method`).
        progress: `Progress` towards convergence.
        steps: number of Newton steps so far.
        code: status so far.
        factored: last matrix that a sparse solve has factorised (`linear.solve_reusing_factor`).
        stable: whether the tangent at the end is positive definite.
        done: whether the iteration has ended.
    """

    point: Evaluation
    step: Float[Array, " n_free"]
    stays_at_point: Bool[Array, ""]
    has_no_step: Bool[Array, ""]
    strategy: PyTree[Array]
    progress: Progress
    steps: Int[Array, ""]
    code: Int[Array, ""]
    factored: FactorRecord | None
    stable: Bool[Array, ""]
    done: Bool[Array, ""]

    def with_point(self, **changes: Array) -> NewtonState:
        """Return a copy in which `changes`, by name, replace fields of the `Evaluation` `point`."""
        return copy_with(self, point=copy_with(self.point, **changes))
