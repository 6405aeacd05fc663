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
        x, residual, scale: last accepted point, R(x), and the force that R is compared with, N.
        rounding: error that rounding leaves in the residual, N; None if no element states any.
        elements: what elements give together with their forces at x: `TensionResponses` of a net,
            else tangents (`System.forces_and_tangents`; or `PartialNet.evaluate`) and `Chords`.
        step, search: the step from x, and which fraction of it is tried next (`search.LineSearch`).
        stays_at_x: whether the next evaluation is at x itself: at the start, when the iteration
            starts again, and when no usable step was found.
        has_no_step: whether the reason for `stays_at_x` is that no usable step was found.
        shift: Levenberg shift of the tangent.
        full_steps: phase of full steps, where there is one (`FullStepPhase`), else None.
        tension_unknowns: tensions of a net, or of cables beside other elements, as unknowns; None
            for other structures.
        predicted: predicted axial forces of others; None where no element has a chord.
        start_residual: largest residual at the start of the increment, N.
        stagnant_steps: steps that met the criterion of forces without halving the residual.
        steps: number of Newton steps so far.
        code: status so far; negative before the first evaluation.
        factored: last matrix that a sparse solve has factorised (`linear.solve_reusing_factor`).
        released, start_rounding: residuals that rounding at the first point excuses, N: a structure
            that is released ends with the rounding of the forces that it began with. One for all
            unknowns of a net, or one for each (`System.rounding`) of others; else None.
        stable: whether the tangent at the end is definite.
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
