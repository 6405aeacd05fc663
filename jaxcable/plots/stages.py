"""Geometry, forces and supports of a solution, before and after loading, for pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from ..analysis.phase_results import Path, PhaseResult
from ..analysis.results import common_fields
from ..analysis.solution import Solution, State
from ..common.tree import copy
from ..common.types import Bool, Float, Int
from ..model.parts import columns, pieces
from ..model.structure import Structure
from .glyphs import axis_tips, supports
from .members import Forces
from .shapes import Curves, Shapes
from .views import View

Links: TypeAlias = "tuple[Int[np.ndarray, 'n_piece 2'], Int[np.ndarray, ' n_piece']]"
"""Node numbers of all pieces of elements, and the element of each piece."""

_ROUND = (5.0, 2.0, 1.0)  # round factors are powers of ten times these
_SEEN = 2e-3  # least visible displacement over the extent


class Stage:
    """One geometry with its forces.

    Attributes:
        title: title of its picture.
        positions: positions of the nodes, [n_node, 3], m.
        ghost: positions in an earlier geometry, which is drawn behind, [n_node, 3], m.
        forces: `Forces`.
        fixed: held freedoms, [n_node, 3 or 6].
        before: elements that are there in the earlier geometry, [n_elem] bool.
        curves, ghost_curves: `Curves` in both geometries, or None.
    """

    def __init__(
        self,
        title: str,
        positions: Float[np.ndarray, "n_node 3"],
        ghost: Float[np.ndarray, "n_node 3"],
        forces: Forces,
        fixed: Bool[np.ndarray, "n_node n_freedom"],
        before: Bool[np.ndarray, " n_elem"],
        curves: Curves | None = None,
        ghost_curves: Curves | None = None,
    ):
        self.title, self.positions, self.ghost = title, positions, ghost
        self.forces, self.fixed, self.before = forces, fixed, before
        self.curves, self.ghost_curves = curves, ghost_curves

    def places(self) -> list[Float[np.ndarray, "n 3"]]:
        """All positions that are drawn: of the nodes, and of points of curves, arrays [n, 3]."""
        both = (self.ghost, self.ghost_curves, self.before), self.now()
        return [points for geometry in both for points in drawn(*geometry)]

    def now(
        self,
    ) -> tuple[Float[np.ndarray, "n_node 3"], Curves | None, Bool[np.ndarray, " n_elem"]]:
        """Positions, curves, and which elements are there; of the later geometry."""
        return self.positions, self.curves, self.forces.present

    def moved(self) -> bool:
        """Whether the difference from the earlier geometry is visible."""
        extent = np.ptp(np.concatenate(self.places()), axis=0).max()
        here, there = self.positions, self.ghost
        if self.curves is not None and self.ghost_curves is not None:
            both = self.before & self.forces.present
            kept = self.ghost_curves.known & both[self.curves.number]
            here = np.concatenate([here, self.curves.points(here)[kept].reshape(-1, 3)])
            there = np.concatenate([there, self.ghost_curves.points(there)[kept].reshape(-1, 3)])
        return bool(np.abs(here - there).max() > _SEEN * extent)

    def section_axes(self) -> tuple[Float[np.ndarray, "n_beam 3"], Float[np.ndarray, "n_beam 3 3"]]:
        """Middles of the beams that are there, and the tips of the axes of their sections, m."""
        if self.curves is None:
            return np.zeros((0, 3)), np.zeros((0, 3, 3))
        points, axes = self.curves.points(self.positions), self.curves.axes
        there = self.forces.present[self.curves.number[: len(axes)]]
        points, axes = points[: len(axes)][there], axes[there]
        chords = np.linalg.norm(points[:, -1] - points[:, 0], axis=1)
        extent = np.ptp(self.positions, axis=0).max()
        middles = points[:, points.shape[1] // 2]
        return middles, axis_tips(middles, axes, chords, extent)

    def held(self, structure: Structure | None, view: View) -> Bool[np.ndarray, "3 n_node"]:
        """Kinds of supports, [3, n_node] bool, see `glyphs.supports`."""
        rotates = None if structure is None else structure.rotating()
        return supports(self.fixed, rotates, view.normal)


def drawn(
    positions: Float[np.ndarray, "n_node 3"],
    curves: Curves | None,
    present: Bool[np.ndarray, " n_elem"],
) -> list[Float[np.ndarray, "n 3"]]:
    """Points of one geometry: its nodes, and those of the curves of elements that are there."""
    return [positions] if curves is None else [positions, curves.drawn(positions, present)]


def stages_of(
    solution: Solution,
    structure: Structure | None = None,
    state: State | None = None,
    magnify: float | None = 1.0,
    colour: str = "tension",
    names: Sequence[str] | None = None,
    phase: int | None = None,
) -> tuple[Links, list[Stage], State]:
    """What a picture of a solution shows.

    Returns:
        links: node numbers of all pieces of elements, [n_piece, 2], and the element of each piece.
        stages: the stages before and after loading, a list of two.
        state: the `State` after loading.
    """
    colour = shown(solution, structure, colour)
    state = state_of(solution, state, phase, structure)
    end, begin, first = np.asarray(state.positions), start_of(solution, state), solution.phases[0]
    number = int(state.phase)
    forces = forces_of(state, solution, structure, colour)
    shapes = Shapes(solution, structure)
    curves = shapes.of(state)
    if number < 1:  # a single phase: both pictures are of its end
        origin, origin_curves, present = begin, shapes.start(curves), forces.present
        titles = [title_of(solution, number, names, state)] * 2
        plain = end, begin, forces, curves, origin_curves
    else:
        origin, origin_curves = np.asarray(first.positions), shapes.after(0)
        before = forces_of(first, solution, structure, colour)
        present = before.present
        titles = [title_of(solution, 0, names), title_of(solution, number, names, state)]
        plain = origin, origin, before, origin_curves, origin_curves
    factor = magnify
    if factor is None:
        places = drawn(end, curves, forces.present & present)
        were = drawn(origin, origin_curves, forces.present & present)
        change = [a - b for a, b in zip(places, were, strict=True) if a.shape == b.shape]
        factor = round_factor(np.concatenate(change), np.concatenate([end, begin]))
    bent = None
    if curves is not None and origin_curves is not None:
        bent = curves.magnified(origin_curves, factor)
    place = origin + factor * (end - origin)
    held = [state.fixed[k + 1].array[: len(end)] for k in (min(number, 0), number)]
    stages = [
        Stage(titles[0], *plain[:3], held[0], present, *plain[3:]),
        Stage(
            titles[1] + _times(factor), place, origin, forces, held[1], present, bent, origin_curves
        ),
    ]
    return pieces(solution.last.topology.parts)[:2], stages, state


def state_of(
    solution: Solution,
    state: State | None,
    phase: int | None = None,
    structure: Structure | None = None,
) -> State:
    """The `State` that is drawn: the stated one, or the end of a phase, or of the solution."""
    if phase is not None:
        if state is not None:
            raise ValueError("state, phase: give one of them")
        return _after(solution, structure, phase)
    if state is None:
        if int(solution.status) != 0:
            raise ValueError(
                "solution: has failed; draw its last converged state, "
                "state=solution.last, or call raise_if_failed"
            )
        return solution.last
    if not hasattr(state, "load_factor") or not np.isfinite(np.asarray(state.positions)).all():
        hint = "; of one of its phases give the number, phase=..." if hasattr(state, "path") else ""
        raise ValueError(
            f"state: expected a State with finite positions, such as solution.last{hint}"
        )
    return state


def _after(solution, structure, phase):
    """The `State` at the end of a phase, as far as pictures show it."""
    count = len(solution.phases)
    if isinstance(phase, bool) or not isinstance(phase, int | np.integer):
        raise ValueError(f"phase = {phase!r}: expected a whole number")
    if not -count <= phase < count:
        raise ValueError(f"phase = {phase}: the solution has phases 0 to {count - 1}")
    number = range(count)[phase]
    end, last = solution.phases[number], solution.last
    if int(end.status) != 0:
        raise ValueError(f"phase = {phase}: has not converged; draw state=solution.last")
    if number == int(last.phase):
        return last
    state = Shapes(solution, structure).state_after(number)
    results = common_fields(end)
    results["displacement"] = np.asarray(end.positions) - start_of(solution, last)
    return copy(state, phase=np.int32(number), load_factor=np.ones(()), **results)


def title_of(
    solution: Solution, phase: int, names: Sequence[str] | None, state: State | None = None
) -> str:
    """Title of the end of a phase, or of a `State` in it.

    It is the name of the phase, if phases have `names`; else "Before loading" and "After loading"
    of two phases, "At the end" of a single one, and "After phase 3 of 7" of more.

    Raises:
        ValueError: another number of names than of phases.
    """
    named(solution, names)
    count = len(solution.phases)
    if phase < 0:
        return "Start"
    stopped = ""
    if state is not None and float(state.load_factor) != 1.0:
        stopped = f" at {float(state.load_factor):.3g}"
    number = f"phase {phase + 1}" + (f" of {count}" if count > 2 else "")
    if names is not None:
        title = str(names[phase])
    elif stopped:
        title = number[0].upper() + number[1:]
    elif count == 1:
        title = "At the end"
    elif count == 2 and (state is None or phase == 1):
        title = ("Before loading", "After loading")[phase]
    else:
        title = f"After {number}"
    unstable = not stopped and _unstable(solution.phases[phase])
    return f"{title}{stopped}" + (", unstable" if unstable else "")


def named(solution: Solution, names: Sequence[str] | None) -> None:
    """Raise ValueError if there is not one name for each phase."""
    if names is not None and len(names) != len(solution.phases):
        raise ValueError(f"names: {len(names)} of them, but {len(solution.phases)} phases")


def _unstable(phase):
    """Whether a phase has converged and ended in an unstable equilibrium."""
    return int(phase.status) == 0 and not bool(phase.stable)


def forces_of(
    part: State | PhaseResult | Path, solution: Solution, structure: Structure | None, colour: str
) -> Forces:
    """`Forces` of a state, of the end of a phase, or of an increment."""
    told = columns(solution.last.topology.parts, part.told)
    column = None
    if colour not in ("tension", "utilisation"):
        column = next(c for c in told if c.label == colour)
    return Forces(
        part.tension, solution.links, structure, colour, part.peak_tension, column, part.present
    )


def shown(solution: Solution, structure: Structure | None, colour: str) -> str:
    """The name of the values that colour elements, checked.

    It is `colour`, or the first result of elements if `colour` is "tension" and none has a tension.

    Raises:
        ValueError: a batch, an unknown colour, or the links of another structure.
    """
    refuse_batch(solution)
    told = columns(solution.last.topology.parts, solution.last.told)
    names = [column.label for column in told if any(x is not None for x in column.values)]
    if colour == "tension" and names and "tension" not in names:
        colour = names[0]
    if colour not in ("tension", "utilisation", *names):
        expected = ", ".join(f'"{name}"' for name in dict.fromkeys((*names, "utilisation")))
        raise ValueError(f"colour = {colour!r}: expected one of {expected}")
    if structure is None:
        return colour
    given, solved = ([g.links.array for g in structure.groups], [l.array for l in solution.links])
    if len(given) != len(solved) or not all(map(np.array_equal, given, solved)):
        raise ValueError("structure: its links are not those of the solution")
    return colour


def refuse_batch(solution: Solution) -> None:
    """Raise ValueError for a batch: a picture shows one analysis."""
    if np.ndim(solution.status) != 0:
        raise ValueError(
            "solution: is a batch; draw one of it, jax.tree.map(lambda a: a[k], solution)"
        )


def start_of(solution: Solution, state: State) -> Float[np.ndarray, "n_node 3"]:
    """Positions at the start of the first phase, [n_node, 3], m."""
    first = solution.phases[0]
    begin = np.asarray(first.positions) - np.asarray(first.displacement)
    if np.isfinite(begin).all():
        return begin
    return np.asarray(state.positions) - np.asarray(state.displacement)


def round_factor(moved: Float[np.ndarray, "n_node 3"], places: Float[np.ndarray, "n 3"]) -> float:
    """A round factor, at least 1; magnified displacements are at most a tenth of the structure."""
    largest = np.linalg.norm(moved, axis=1).max()
    wanted = 0.1 * np.ptp(places, axis=0).max() / max(largest, 1e-300)
    if wanted < 2.0 or largest == 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * next(r for r in _ROUND if r * power <= wanted * (1 + 1e-9)))


def _times(factor):
    """The end of a title that says how deflections are magnified; empty for a factor of 1."""
    return "" if factor == 1 else f", deflection x {factor:g}"
