"""Forces and lengths, stated in any phases, at which results of any phases meet their targets."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from types import EllipsisType
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.phase_results import PhaseResult
from ..analysis.phases import ABSOLUTE, INCREMENTS, Phase
from ..analysis.solution import Solution, State
from ..analysis.solver import solve
from ..common import checks, status
from ..common.tree import copy, pytree, replace
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..elements import Bars, Cables
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..model.structure import Structure
from .fit import fit

Part: TypeAlias = "int | slice | Int[ArrayLike, ' n']"
Index: TypeAlias = "Part | EllipsisType | tuple[Part, ...]"
"""Index of an array: a number, a slice, numbers, or a tuple of these."""

_SAME = 1e-3  # of what a target allows
_STATEMENTS = (*ABSOLUTE, *INCREMENTS)


@dataclasses.dataclass(frozen=True)
class Target:
    """What a result of a phase shall be; see `tune`.

    Args:
        of: name of a result of a phase: "positions", "displacement", "tension", "reactions",
            "section_forces" and so on; or a function of the result of the phase,
            `results.PhaseResult`, to an array.
        value: what it shall be, a number or an array, m, N or N m.
        at: index of the numbers that are meant, as of a NumPy array: ``(slice(1, 9), 2)`` or
            ``np.s_[1:9, 2]`` are the z of nodes 1 to 8. Default all.
        on: key of the group in the structure's elements, for results of elements.
        phase: number of the phase, from 0, or from the end as -1, the default.
        within: deviation that is as good as none, in the unit of the result; targets that cannot be
            met all at once are weighed by it.

    Raises:
        ValueError: `within` is not positive, `phase` is no integer, the value is no number.

    Example:
        >>> level = jc.design.Target("positions", 0.0, at=np.s_[1:9, 2], within=1e-4)
        >>> level.phase
        -1
    """

    of: str | Callable[[PhaseResult], Array]
    value: Float[ArrayLike, " ..."] = 0.0
    at: Index = ...
    on: str | int | None = None
    phase: int = -1
    within: float = 1.0

    def __post_init__(self):
        checks.floats(self.value, "value")
        if isinstance(self.phase, bool) or not isinstance(self.phase, int | np.integer):
            raise ValueError(f"phase = {self.phase!r}: expected the number of a phase")
        if not self.within > 0:
            raise ValueError(f"within = {self.within!r}: must be positive")

    def measured(self, solution: Solution) -> Float[Array, " n"]:
        """The numbers that are meant, of a solution, [n]."""
        result = solution.phases[self.phase]
        found = self.of(result) if callable(self.of) else getattr(result, self.of)
        found = found if self.on is None else found[self.on]
        return jnp.ravel(jnp.asarray(found)[self.at])

    def deviation(self, solution: Solution) -> Float[Array, " n"]:
        """How much more than the value these numbers are, [n]."""
        measured = self.measured(solution)
        value = jnp.ravel(jnp.asarray(self.value, measured.dtype))
        return measured - (value if value.size > 1 else value.reshape(()))


@pytree
class Tuned:
    """Result of `tune`.

    Attributes:
        phases: the phases with the values found.
        values: the values, a list with the statement of every unknown.
        solution: the `Solution` of these phases.
        deviation: of every target, a list of arrays [n], m, N or N m.
        met: whether each target is met within what it allows, list of bool.
        influence: derivative of all targets, one after the other, by all unknowns, one after the
            other, [n_target, n_unknown].
        free: which values no bound stops, in the shape of `values`.
        status: 0 if it has converged; `describe` has the texts.
        steps: number of trial points after the start, of both searches if there were two.

    Example:
        By how much a bar of 2 m is to be shortened so that its end rises by 1 mm:

        >>> bar = jc.Bars([[0, 1]], axial_stiffness=1e6)
        >>> guide = jc.pinned([0]) + jc.restrained([1], "xy")
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, -2.0]], bar, supports=guide)
        >>> lifted = jc.design.Target("positions", -1.999, at=(1, 2), within=1e-6)
        >>> phases = [jc.Phase(shortening=0.0)]
        >>> tuned = jc.design.tune(structure, phases, [(0, "shortening")], lifted)
        >>> print(tuned.values[0].round(6), tuned.influence.round(6))
        0.001 [[1.]]
    """

    phases: list[Phase]
    values: list[PyTree[Float[Array, " ..."]]]
    solution: Solution
    deviation: list[Float[Array, " n"]]
    met: list[Bool[Array, ""]]
    influence: Float[Array, "n_target n_unknown"]
    free: list[PyTree[Bool[Array, " ..."]]]
    status: Int[Array, ""]
    steps: Int[Array, ""]


def tune(
    structure: Structure,
    phases: Phase | Sequence[Phase],
    unknowns: Sequence[tuple[int, str]],
    targets: Target | Sequence[Target],
    bounds: tuple[PyTree[Any] | None, PyTree[Any] | None] | None = None,
    *,
    method: Newton | Incremental | None = None,
    start: Solution | State | None = None,
    smooth: bool = True,
    steps: int = 100,
    tol: float | None = None,
) -> Tuned:
    """Find prestress, stated in any phases, at which results of any phases are as they shall be.

    Targets are met exactly where that is possible, else in the sense of least squares, weighed by
    what they allow (`Target.within`). With fewer targets than unknowns the values stay near those
    that the phases state, which are the start. This is `fit` with exact derivatives through all
    phases, and hence through stages in which elements come and go.

    Args:
        structure, phases: as for `solve`.
        unknowns: pairs (number of a phase, name of a statement in it) such as ``(0, "pretension")``
            or ``(3, "jacking")``. Every number that the statement has is an unknown: one for all
            elements if it is a scalar, those of some elements by ``only(elements, values)``.
        targets: one `Target`, or a list.
        bounds: (lower, upper) of the unknowns, each None, a number, or a prefix pytree of the list
            of statements.

    Options:
        method, start: as for `solve`.
        smooth: whether to begin with cables that also press, where beams or bars are beside them.
            Where cables go slack results have kinks, at which a search that starts from far ends;
            from where all cables are taut at last, it is the same without them.
        steps, tol: as for `fit`.

    Returns:
        `Tuned`.

    Raises:
        ValueError: no unknown or target, a phase or a statement that is not there, a start outside
            of the bounds.

    Example:
        A mast held by two stays, which shall stand upright under a pull of 10 kN at its top with
        60 kN in the stay that the pull relieves:

        >>> nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, 20.0], [-15.0, 0.0, 0.0], [15.0, 0.0, 0.0]]
        >>> mast = jc.Bars([[0, 1]], axial_stiffness=1e9)
        >>> stays = jc.Cables([[2, 1], [3, 1]], axial_stiffness=5e7)
        >>> supports = jc.pinned([0, 2, 3]) + jc.restrained([1], "y")
        >>> structure = jc.Structure(nodes, {"mast": mast, "stays": stays}, supports=supports)
        >>> pull = jc.NodalLoads([1], (10e3, 0.0, 0.0))
        >>> forces = {"mast": None, "stays": np.array([50e3, 50e3])}
        >>> phases = [jc.Phase(pretension=forces, loads=pull)]
        >>> upright = jc.design.Target("positions", 0.0, at=(1, 0), within=1e-3)
        >>> enough = jc.design.Target("tension", 60e3, at=1, on="stays", within=100.0)
        >>> tuned = jc.design.tune(structure, phases, [(0, "pretension")], [upright, enough])
        >>> print(jc.describe(tuned.status), [bool(met) for met in tuned.met])
        converged [True, True]
        >>> print(tuned.solution.tension["stays"].round(1))  # N
        [76665.5 60000. ]
    """
    phases = [phases] if isinstance(phases, Phase) else list(phases)
    targets = [targets] if isinstance(targets, Target) else list(targets)
    values = _stated(phases, unknowns)
    _require_targets(targets, len(phases))

    def put(values):
        found = list(phases)
        for (k, name), value in zip(unknowns, values, strict=True):
            found[k] = replace(found[k], **{name: value})
        return found

    def residuals(structure, values):
        solution = solve(structure, put(values), method, start=start)
        return [t.deviation(solution) / t.within for t in targets], solution

    found, spent = None, jnp.int32(0)
    pressing = _pressing(structure) if smooth and start is None else None
    if pressing is not None:
        found = fit(functools.partial(residuals, pressing), values, bounds, steps=steps, tol=tol)
        reached, spent = found.status == status.OK, found.steps
        values = jax.tree.map(lambda a, b: jnp.where(reached, a, b), found.params, values)
    solution = None if found is None else solve(structure, put(values), method, start=start)
    if solution is None or not _same(targets, solution, found):
        own = functools.partial(residuals, structure)
        found = fit(own, values, bounds, steps=steps, tol=tol)
        found = copy(found, steps=spent + found.steps)
        solution = solve(structure, put(found.params), method, start=start)
    tuned = put(found.params)
    deviation = [target.deviation(solution) for target in targets]
    within = np.concatenate(
        [np.full(len(own), target.within) for own, target in zip(deviation, targets, strict=True)]
    )
    return Tuned(
        phases=tuned,
        values=found.params,
        solution=solution,
        deviation=deviation,
        met=[
            jnp.all(jnp.abs(own) <= target.within)
            for own, target in zip(deviation, targets, strict=True)
        ],
        influence=found.jacobian * within[:, None],
        free=found.free,
        status=found.status,
        steps=found.steps,
    )


def _pressing(structure):
    """The structure with bars in place of its cables; None if it would not stand, or has none."""
    kinds = {type(group) for group in structure.groups}
    if Cables not in kinds or all(group.tension_only for group in structure.groups):
        return None
    groups = [
        Bars(**{name: getattr(group, name) for name in Bars._all_fields})
        if type(group) is Cables
        else group
        for group in structure.groups
    ]
    return replace(structure, elements=structure.arrange(groups))


def _same(targets, solution, found):
    """Whether cables do what bars in their place have done, as far as it is known.

    They end there, and none is slack at the end of any phase: the influence matrix is theirs, too.
    """
    apart = [target.deviation(solution) / target.within for target in targets]
    apart = jnp.concatenate(apart) - found.residual
    slack = jnp.stack([phase.path.n_slack[-1] for phase in solution.phases])
    good = (solution.status == status.OK) & jnp.all(jnp.abs(apart) <= _SAME) & jnp.all(slack == 0)
    return not isinstance(good, jax.core.Tracer) and bool(good)


def _stated(phases, unknowns):
    """The statements that are unknown, a list of pytrees of floats."""
    if not unknowns:
        raise ValueError("unknowns: none; give pairs such as (0, 'pretension')")
    values = []
    for number, unknown in enumerate(unknowns):
        if not isinstance(unknown, tuple) or len(unknown) != 2:
            raise ValueError(f"unknowns[{number}] = {unknown!r}: expected (phase, statement)")
        k, name = unknown
        if isinstance(k, bool) or not isinstance(k, int | np.integer) or not 0 <= k < len(phases):
            raise ValueError(
                f"unknowns[{number}]: phase {k!r}; there are phases 0 to {len(phases) - 1}"
            )
        if name not in _STATEMENTS:
            known = ", ".join(_STATEMENTS)
            raise ValueError(f"unknowns[{number}] = {name!r}: expected one of {known}")
        value = getattr(phases[k], name)
        if value is None:
            raise ValueError(
                f"unknowns[{number}]: phases[{k}] states no {name}; its values are the start"
            )
        values.append(jax.tree.map(lambda x: jnp.asarray(x, float), value))
    return values


def _require_targets(targets, count):
    """Raise ValueError for something else than targets of phases that there are."""
    if not targets:
        raise ValueError("targets: none")
    for number, target in enumerate(targets):
        if not isinstance(target, Target):
            raise ValueError(
                f"targets[{number}]: expected a Target, got {checks.kind(target, 'Target(...)')}"
            )
        if not -count <= target.phase < count:
            raise ValueError(
                f"targets[{number}].phase = {target.phase}: there are phases 0 to {count - 1}"
            )
