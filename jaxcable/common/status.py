"""Outcome codes of an analysis, their texts, and the rule that the first failure wins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .types import Array, ArrayLike, Int

OK = 0
NOT_CONVERGED = 1
MECHANISM = 2
NONFINITE = 3
SINGULAR = 4
DRIFTED = 5
MATERIAL_FAILURE = 6
BEYOND_CAPACITY = 7
OUT_OF_STEPS = 8
STALLED = 9
BAD_START = 10
OUTSIDE = 11
LIMIT_POINT = 12
BIFURCATION = 13
INVALID_INPUT = 14
EXCESSIVE_DEFORMATION = 15
AT_ROUNDING = 16
COLLAPSED = 17
OUT_OF_POINTS = 18
OUT_OF_EVENTS = 19
CONSTRAINTS_VIOLATED = 20
OUT_OF_TIME_STEPS = 21
PUSHING_CABLE = 22
PATH_LOST = 23
SECTION_UNBALANCED = 24
BEYOND_PEAK = 25
STATIONARY = 26
NOT_AS_BUILT = 27
NOT_NEAREST = 28
MODES_NOT_FOUND = 29

NAMES: dict[int, str] = {
    code: name
    for name, code in sorted(vars().items(), key=lambda item: str(item[1]).zfill(2))
    if name.isupper() and isinstance(code, int)
}
"""Names of the codes that results have, by code."""

_TEXTS = {
    OK: "converged",
    NOT_CONVERGED: (
        "no equilibrium found within the allowed Newton steps, with forces far from balance: "
        "there may be none near (a load beyond a limit point: look with trace_path), or it is "
        "far away (more increments, a larger max_steps); parts may also slide or turn without "
        "limit: in a frame look at hinges, in a form at equal tensions along a cable"
    ),
    AT_ROUNDING: (
        "the residual falls no more: it is as small as rounding leaves it. EA is too large for "
        "these forces: use float64, begin nearer to the equilibrium (nodes, start), make the "
        "stiffest elements softer, or allow more by tol; or the load is so small beside the forces "
        "that its effect cannot be told from their rounding: apply a larger one"
    ),
    COLLAPSED: (
        "two nodes of an element have met: a rope or a jack draws them together and nothing keeps "
        "them apart; join the nodes, hold one, or lower the force"
    ),
    MECHANISM: (
        "the structure moves without limit under its loads: a part is not held by any taut "
        "element; add supports or elements, or prestress it before it is loaded"
    ),
    NONFINITE: (
        "a number became NaN or infinite; look for NaN in nodes, stiffness, pretension or loads, "
        "for an element whose ends coincide, for a shortening that leaves no length, for a deep "
        "hanging cable that slips without end, or for a segment that ends within the radius of its "
        "saddle"
    ),
    SINGULAR: (
        "the stiffness of an increment is singular, so the incremental scheme cannot step; "
        "use Newton(), or prestress the structure before it is loaded"
    ),
    DRIFTED: (
        "the unbalanced force of the incremental scheme exceeds its tol; use more increments, "
        "more corrections, or a larger tol to see the drifted result"
    ),
    MATERIAL_FAILURE: (
        "a cable or a fibre is strained beyond the end of its stress-strain curve: the material "
        "failed between this increment and the last good one; use more increments to bracket the "
        "load factor, a stronger section or a curve that goes on"
    ),
    BEYOND_CAPACITY: (
        "the section cannot carry these forces: a fibre would be strained beyond the end of its "
        "stress-strain curve; reduce the forces or look at Section.interaction"
    ),
    OUT_OF_STEPS: (
        "maximum number of optimization steps reached before convergence: allow more (`steps`), or "
        "go on from the parameters reached"
    ),
    STALLED: (
        "no step, however short, improves the result: the loss has reached its rounding "
        "level (then raise tol, or lower that of the analysis), has a kink here (a cable at the "
        "point of slackening), no parameter has an influence, or the analysis fails in this "
        "direction (look at failures)"
    ),
    BAD_START: (
        "the loss or its gradient is not finite at the start (as of a square root of zero), or the "
        "analysis fails there (its code is in history.status, or in start_status)"
    ),
    OUTSIDE: "the start is outside its bounds, or a lower bound is above the upper one",
    LIMIT_POINT: (
        "the load has reached a maximum: beyond it there is no equilibrium nearby; the structure "
        "would snap through; trace_path(..., through=True) follows it"
    ),
    BIFURCATION: (
        "the tangent stiffness is no longer positive definite: the structure can leave this path "
        "for another; the event has the mode, an imperfection in its shape shows where it goes"
    ),
    EXCESSIVE_DEFORMATION: (
        "the load has no maximum within the allowed steps, but the structure has given way: along "
        "the path it has less than a twentieth of its stiffness at the start, as in plastic "
        "collapse where bars turn; look at displacement over load_factor, and judge the load by a "
        "displacement that is allowed"
    ),
    OUT_OF_POINTS: (
        "maximum number of path points reached before the path came to its last load factor: allow "
        "more points (steps) or longer steps (largest)"
    ),
    OUT_OF_EVENTS: (
        "maximum number of events of a path reached (limit points, bifurcations, cables that "
        "slacken or tighten, ruptures), so that it ends here: allow more (events)"
    ),
    CONSTRAINTS_VIOLATED: (
        "the constraints are violated at the best parameters found; the result says by how much: "
        "they may contradict each other or the bounds, or need more rounds or another start"
    ),
    OUT_OF_TIME_STEPS: (
        "maximum number of time steps of the relaxation reached before the unbalanced forces fell "
        "to tol: allow more (max_steps), or start nearer to the form"
    ),
    PUSHING_CABLE: (
        "a cable of given length would have to push in this form: give it another length, or make "
        "it one of Bars"
    ),
    PATH_LOST: (
        "the next point of the path was not found, however short the step: the path may end here, "
        "or turn sharply; give trace_path a smaller largest, or its method a larger tol"
    ),
    SECTION_UNBALANCED: (
        "no strains that balance the forces of the section were found within the allowed "
        "iterations: allow more (max_steps), or reduce the forces"
    ),
    BEYOND_PEAK: (
        "there is no equilibrium in which all elements are below the peaks of their stress-strain "
        "curves, and beyond them none was found: the load is more than the structure carries; "
        "reduce it, strengthen the elements with the largest strains, or look with trace_path"
    ),
    STATIONARY: (
        "the start is stationary: the gradient is zero there, so that nothing tells where the loss "
        "falls. That is so at a minimum, but also at a maximum, at a saddle (a symmetric start), "
        "and where no parameter has an influence; compare the loss nearby, or start elsewhere"
    ),
    NOT_AS_BUILT: (
        "no unstressed lengths are found with which the tensions or sags that a phase states as "
        "built hold in equilibrium: there may be none (more tensions than equilibrium leaves free, "
        "a tension below the least that weight alone gives), or they are far from those of the "
        "structure as drawn; state fewer, or lengths of the others (rest_length), or look for "
        "near ones with design.tune"
    ),
    NOT_NEAREST: (
        "the point where the search for a design point ended is not the nearest one that fails: "
        "the distance is not a minimum there, and restarts beside it found none, or a nearer point "
        "fails; begin nearer to that one (start), or allow more steps and points"
    ),
    MODES_NOT_FOUND: (
        "no natural modes were found: the tangent stiffness of the state is not finite (a failed "
        "analysis) or not symmetric (follower loads, nodal moments), or the iteration has not "
        "converged: ask for fewer modes"
    ),
    INVALID_INPUT: (
        "a number is not allowed, such as a negative stiffness, the compression of a cable or a "
        "tol of 1 or more: jax traced it, so that it could not be refused earlier; call with the "
        "same numbers outside of jit, vmap and grad, and a ValueError names the argument"
    ),
}


class AnalysisError(RuntimeError):
    """Raised by `raise_if_failed`: an analysis did not end in equilibrium.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> failed = jc.solve(structure, phases, jc.Newton(max_steps=1))
        >>> try:
        ...     jc.raise_if_failed(failed)
        ... except jc.AnalysisError as error:
        ...     print(str(error)[:45])
        phase 2, increment 1 of 10 (load factor 0.1),
    """


_FORM_CAUSE = (
    "A cable of one tension all along its length cannot hold others that pull along it: they slide "
    "along it. Prescribe force densities or lengths there, or tensions that differ"
)
_FORM_TEXTS = {
    NOT_CONVERGED: (
        "no form was found in which these forces balance; the element that they shorten most is "
        f"that of NODES. {_FORM_CAUSE}; or allow more steps (max_steps)"
    ),
    COLLAPSED: f"these forces balance in no form near: NODES of an element have met. {_FORM_CAUSE}",
    MECHANISM: (
        "these forces balance in no form: loads move nodes without limit. Prescribe larger forces, "
        "smaller loads or lengths; or a part is not held"
    ),
}
"""Texts on forms, whose forces are prescribed, where they differ from those on analyses."""


_MOTION_TEXTS = {
    NOT_CONVERGED: (
        "no balance with inertia found within the allowed Newton steps: parts move too far in a "
        "step. Take a smaller dt, let steps be divided (halvings=3), or a larger max_steps"
    ),
    AT_ROUNDING: (
        "the residual falls no more: it is as small as rounding leaves it. EA is too large for "
        "these forces, or dt too short for these displacements: use float64, a larger dt, softer "
        "elements, or allow more by tol"
    ),
    MECHANISM: (
        "parts move without limit in a step: nothing holds them, and they have no mass; give them "
        "masses, add supports or elements, or take a smaller dt"
    ),
}
"""Texts on motions in time, where they differ from those on analyses."""


def describe(code: Int[ArrayLike, ""]) -> str:
    """Return the text for a status code: what happened and what to do next.

    Args:
        code: status, one integer.

    Returns:
        A string.

    Raises:
        ValueError: `code` is not a single code, or not a code of jaxcable.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> jc.describe(jc.solve(structure, phases).status)
        'converged'
        >>> print(jc.describe(12)[:30])
        the load has reached a maximum
    """
    if hasattr(code, "status"):
        raise ValueError(f"code: got a {type(code).__name__}; give its status")
    if jnp.ndim(code) != 0:
        raise ValueError(f"code: expected one code, got shape {jnp.shape(code)}; take one of them")
    code = int(code)
    if code not in _TEXTS:
        raise ValueError(f"code = {code}: not a jaxcable status; codes are 0 to {max(_TEXTS)}")
    return _TEXTS[code]


def first_failure(earlier: Int[ArrayLike, ""], later: Int[ArrayLike, ""]) -> Int[Array, ""]:
    """Combine two status codes: return `earlier` if it is a failure, else `later`.

    Example:
        >>> int(jc.status.first_failure(jc.status.OK, jc.status.MECHANISM)) == jc.status.MECHANISM
        True
    """
    return jnp.where(earlier != OK, earlier, later)


def raise_if_failed(solution: Any, names: Sequence[str] | None = None) -> None:
    """Raise `AnalysisError` if the solution, or any case of a batch, has failed.

    Results of `design.tune` also fail if a target is missed, although their status is 0 (OK) then.

    Args:
        solution: a result with a status: `Solution`, results of form finding, `minimize`, `fit`,
            `tune`.
        names: of the cases of a batch, such as ``combinations.names``: the message names the case
            that has failed first, in place of its number.

    Raises:
        AnalysisError: the result has failed. For an analysis the message names the phase (from 1),
            the increment, its load factor, the residual in newtons (unless it is zero, as where no
            step was possible) and what to try, for a motion in time the step. For missed targets
            it names them, with `remarks`.
        ValueError: `solution` has no status, or is being traced: a status is known outside of jit
            only; another number of names than cases.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> jc.raise_if_failed(jc.solve(structure, phases))  # returns None
        >>> failed = jc.solve(structure, phases, jc.Newton(max_steps=1))
        >>> int(failed.status)
        1
        >>> try:
        ...     jc.raise_if_failed(failed)
        ... except jc.AnalysisError as error:
        ...     print(str(error)[:45])
        phase 2, increment 1 of 10 (load factor 0.1),
    """
    if not hasattr(solution, "status"):
        raise ValueError(
            f"raise_if_failed: expected a solution, got {type(solution).__name__}; "
            "describe(code) gives the text of a code"
        )
    if isinstance(solution.status, jax.core.Tracer):
        raise ValueError("raise_if_failed: the solution is being traced; call it outside of jit")
    status = np.asarray(solution.status)
    if names is not None and (isinstance(names, str) or status.shape != (len(names),)):
        raise ValueError(
            f"names: expected a name for each case of a batch; the status has shape {status.shape}"
        )
    if (status == OK).all():
        if missed := getattr(solution, "targets_missed", ""):
            raise AnalysisError("; ".join((missed, *solution.remarks)))
        return
    case = tuple(int(i) for i in np.argwhere(status != OK)[0])
    prefix = f"case {case if len(case) > 1 else case[0]}: " if case else ""
    prefix = prefix if names is None else f"{names[case[0]]}: "
    code = int(status[case])
    for number, phase in enumerate(getattr(solution, "phases", ()), 1):
        codes = np.asarray(phase.path.status)[case]
        failed = np.flatnonzero(codes != OK)
        if failed.size:
            k = failed[0]
            factor = np.asarray(phase.path.load_factor)[case][k]
            residual = np.asarray(phase.path.residual)[case][k]
            # the residual of a step that was never taken is zero or NaN, and says nothing
            known = residual != 0 and not np.isnan(residual)
            size = f", residual {residual:.3g} N" if known else ""
            raise AnalysisError(
                f"{prefix}phase {number}, increment {k + 1} of {codes.size} (load factor "
                f"{factor:.6g}){size}: {describe(code)}"
            )
    if (codes := getattr(solution, "step_status", None)) is not None:  # a motion in time
        k = int(np.argmax(np.asarray(codes)[case] != OK))
        time = np.asarray(solution.time)[case][k]
        where = f"step {k} of {np.shape(codes)[-1] - 1}, at {time:.6g} s"
        raise AnalysisError(f"{prefix}{where}: {_MOTION_TEXTS.get(code, describe(code))}")
    before = (
        "the analysis that this one starts from has failed: " if hasattr(solution, "phases") else ""
    )
    text = describe(code)
    if hasattr(solution, "nearest"):  # a form
        ends = "{} and {}".format(*np.asarray(solution.nearest)[case].tolist())
        text = _FORM_TEXTS.get(code, text).replace("NODES", f"nodes {ends}")
    if code == BAD_START and int(getattr(solution, "start_status", OK)) not in (OK, NONFINITE):
        text = f"{text}: {describe(solution.start_status)}"
    raise AnalysisError(f"{prefix}{before}{text}")
