"""The state of an iteration of Newton's method, which `iteration` changes step by step."""

from __future__ import annotations

from ..common.tree import pytree
from ..common.types import Array, Bool, Float, Int, PyTree
from ..linear.sparse import FactoredMatrix
from ..numerics.line_search import LineSearch
from .globalization import FullStepPhase, LevenbergShift
from .predicted_forces import PredictedForces
from .tension_unknowns import TensionUnknowns


@pytree
class NewtonState:
    """The state of an iteration: the last accepted point, the next step, and the globalization.

    Attributes:
        x: motion at the last accepted point.
        residual: residual there, [n_free], N.
        scale: the force that the residual is compared with, N.
        rounding: error that rounding leaves in the residual, N; None if no element estimates any.
        elements: what elements give together with their forces at x: `TensionResponses` of a net,
            else tangents (`System.forces_and_tangents`, or with cables beside other elements
            `PartialNet.evaluate`) and `Chords`.
        step, search: the step from x, and which fraction of it is tried next
            (`line_search.LineSearch`).
        stays_at_x: whether the next evaluation is at x itself: at the start, when the iteration
            starts again, and when no usable step was found.
        has_no_step: whether the reason for `stays_at_x` is that no usable step was found.
        shift: Levenberg shift of the tangent.
        full_steps: `FullStepPhase` of structures that begin with full steps, else None.
        tension_unknowns: tensions as unknowns: of a net, or of the cables of a structure with other
            elements, too; None for structures without such cables.
        predicted: predicted axial forces of structures other than nets; None where no element has a
            chord.
        start_residual: largest residual at the start of the increment, N.
        stagnant_steps: steps that met the criterion of forces without halving the residual.
        steps: number of Newton steps so far.
        code: status so far; negative before the first evaluation.
        factored: last matrix that a sparse solve has factorised (`linear.solve_reusing_factor`).
        released: residual that is allowed in a net without load, N: a structure that is released
            ends with the rounding of the forces that it began with. None for other structures.
        start_rounding: `rounding` at the first point, which is allowed, too; None for nets.
        stable: whether the tangent at the end is positive definite.
        done: whether the iteration has ended.
    """

    x: Float[Array, "n_row n_motion"]
    residual: Float[Array, " n_free"]
    scale: Float[Array, ""]
    rounding: Float[Array, " n_free"] | None
    elements: PyTree[Float[Array, "n_elem ..."]]
    step: Float[Array, " n_free"]
    search: LineSearch
    stays_at_x: Bool[Array, ""]
    has_no_step: Bool[Array, ""]
    shift: LevenbergShift
    full_steps: FullStepPhase | None
    tension_unknowns: TensionUnknowns | None
    predicted: PredictedForces | None
    start_residual: Float[Array, ""]
    stagnant_steps: Int[Array, ""]
    steps: Int[Array, ""]
    code: Int[Array, ""]
    factored: FactoredMatrix | None
    released: Float[Array, ""] | None
    start_rounding: Float[Array, " n_free"] | None
    stable: Bool[Array, ""]
    done: Bool[Array, ""]
