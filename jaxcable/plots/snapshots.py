"""How a structure is at an instant of a solution: what all pictures, and the page, show of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from ..analysis.phase_results import PhaseResult
from ..analysis.solution import Solution, State
from ..common.types import Bool, Float, Int
from ..model.parts import columns, faces, pieces
from ..model.structure import Structure
from .forces import Forces
from .glyphs import axis_tips, supports
from .shapes import PLACES, Curves, Shapes

_SEEN = 2e-3  # least visible displacement over the extent


@dataclasses.dataclass(frozen=True, eq=False)
class Snapshot:
    """How a structure is at one instant of a solution.

    Attributes:
        phase: number of the phase, from 0; -1 before the first one.
        number: of the increment in it, from 0; None for the end of a phase or a `State`.
        factor: load factor.
        start: positions of the nodes before the first phase, [n_node, 3], m.
        moved: displacement since then, [n_node, 3], m.
        told: what elements tell, by name, each in the shape of the elements.
        forces: `Forces`.
        fixed: held freedoms, [n_node, 3 or 6].
        rotates: which nodes have rotations, [n_node] bool; None if unknown.
        curves: `Curves`, or None.
        end: `PhaseResult` or `State` that holds all that is known here; None for increments that
            only a path knows.
    """

    phase: int
    number: int | None
    factor: float
    start: Float[np.ndarray, "n_node 3"]
    moved: Float[np.ndarray, "n_node 3"]
    told: dict[str, Any]
    forces: Forces
    fixed: Bool[np.ndarray, "n_node n_freedom"]
    rotates: Bool[np.ndarray, " n_node"] | None
    curves: Curves | None
    end: PhaseResult | State | None

    @property
    def positions(self) -> Float[np.ndarray, "n_node 3"]:
        """Positions of the nodes, [n_node, 3], m."""
        return self.start + self.moved

    def known(self) -> Bool[np.ndarray, " n_elem"]:
        """Which of the elements that are there have a known shape, [n_elem] bool."""
        found = self.forces.present.copy()
        if self.curves is not None:
            found[self.curves.number[~self.curves.known]] = False
        return found

    def points(self, which: Bool[np.ndarray, " n_elem"] | None = None) -> Float[np.ndarray, "n 3"]:
        """All points that are drawn, of the nodes and along curves, [n, 3], m.

        Args:
            which: elements whose curves count; None for those that are `known`.
        """
        if self.curves is None:
            return self.positions
        which = self.known() if which is None else which
        curved = self.curves.points(self.positions)[which[self.curves.number]]
        return np.concatenate([self.positions, curved.reshape(-1, 3)])

    def change(self, before: Snapshot) -> Float[np.ndarray, "n 3"]:
        """Displacement from another instant of all points that both have, [n, 3], m."""
        both = self.known() & before.known()
        return self.points(both) - before.points(both)

    def has_moved(self, before: Snapshot) -> bool:
        """Whether the difference from another instant is visible."""
        extent = np.ptp(np.concatenate([self.points(), before.points()]), axis=0).max()
        return bool(np.abs(self.change(before)).max() > _SEEN * extent)

    def magnified(self, origin: Snapshot, factor: float) -> Snapshot:
        """What differs from another instant times a factor."""
        moved, curves = origin.moved + factor * (self.moved - origin.moved), self.curves
        if curves is not None and origin.curves is not None:
            curves = curves.magnified(origin.curves, factor)
        return dataclasses.replace(self, moved=moved, curves=curves)

    def before(self) -> Snapshot:
        """The geometry before the first phase, with these elements and forces."""
        curves = None if self.curves is None else self.curves.before()
        return dataclasses.replace(self, moved=np.zeros_like(self.moved), curves=curves)

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

    def held(self, normal: Float[np.ndarray, " 3"] | None) -> Bool[np.ndarray, "3 n_node"]:
        """Kinds of supports, [3, n_node] bool, see `glyphs.supports`."""
        return supports(self.fixed, self.rotates, normal)


class Snapshots:
    """The instants of a solution, each as a `Snapshot`.

    Args:
        solution: `Solution` of one case.
        structure: `Structure` that was analysed, or None.
        colour: values that colour elements, as of `net`.
        names: of the phases, or None.
        places: places along every curve.

    Attributes:
        colour: `colour`, or the first result of elements if it is "tension" and none has a tension.
        parts: of the elements.
        links: node numbers of all pieces, [n_piece, 2], and the element of each piece.
        faces: node numbers around all faces, [n_face, 4], and the element of each face.

    Raises:
        ValueError: a batch, an unknown colour, the links of another structure, or another number of
            names than of phases.
    """

    def __init__(
        self,
        solution: Solution,
        structure: Structure | None = None,
        colour: str = "tension",
        names: Sequence[str] | None = None,
        places: int = PLACES,
    ):
        self.solution, self.structure, self.names = solution, structure, names
        refuse_batch(solution)
        self.parts = solution.last.topology.parts
        self.colour = _colour(self.parts, solution, colour)
        _require_links(solution, structure)
        if names is not None and len(names) != len(solution.phases):
            raise ValueError(f"names: {len(names)} of them, but {len(solution.phases)} phases")
        self.links, self.faces = pieces(self.parts)[:2], faces(self.parts)[:2]
        self._shapes = Shapes(solution, structure, places)
        self._rotates = None if structure is None else structure.rotating()

    def of(self, state: State) -> Snapshot:
        """The instant of a `State`."""
        moved = np.asarray(state.positions) - self._shapes.start
        place = int(state.phase), None, float(state.load_factor)
        return self._snapshot(place, moved, state.told, self._shapes.of(state), state)

    def after(self, phase: int) -> Snapshot:
        """The end of a phase that has converged."""
        return self.of(self._shapes.state_after(phase))

    def increments(self, frames: int, ends: bool = False) -> list[Snapshot]:
        """Converged increments of all phases.

        Args:
            frames: largest number of increments, taken evenly, with the last one.
            ends: whether the ends of phases are kept whatever `frames` is.

        Raises:
            ValueError: no increment has converged, or `frames` is no positive integer.
        """
        if isinstance(frames, bool) or not isinstance(frames, int) or frames < 1:
            raise ValueError(f"frames = {frames!r}: must be a positive integer")
        phases = list(self.solution.phases)
        paths: list[Any] = [jax.tree.map(np.asarray, phase.path) for phase in phases]
        good = [(k, int(n)) for k, p in enumerate(paths) for n in np.flatnonzero(p.status == 0)]
        if not good:
            raise ValueError("solution: has no converged increment to show; see raise_if_failed")
        last = [j for j in range(len(good)) if j + 1 == len(good) or good[j + 1][0] != good[j][0]]
        chosen = evenly(len(good), frames)
        if ends:
            between = np.setdiff1d(np.arange(len(good)), last)
            between = between[evenly(len(between), max(frames - len(last), 0))]
            chosen = np.union1d(last, between)
        found = []
        for j in chosen.tolist():
            phase, number = good[j]
            path = jax.tree.map(lambda x, n=number: x[n], paths[phase])
            moved, told = path.displacement, path.told
            if phase > 0:
                moved = np.asarray(phases[phase - 1].positions) - self._shapes.start + moved
            end: PhaseResult | State | None = None
            if j in last:
                end = self.solution.last if j + 1 == len(good) else phases[phase]
                told |= end.told
            place = phase, number, float(path.load_factor)
            curves = self._shapes.along(phase, number)
            found.append(self._snapshot(place, moved, told, curves, end))
        return found

    def _snapshot(self, place, moved, told, curves, end):
        """A `Snapshot` at a place: phase, increment, load factor."""
        forces = Forces(told, self.parts, self.structure, self.colour)
        fixed = self.solution.last.fixed[place[0] + 1].array[: len(moved)]
        within = self._shapes.start, moved, told, forces, fixed, self._rotates, curves, end
        return Snapshot(*place, *within)

    def state(self, state: State | None, phase: int | None = None) -> State:
        """The `State` that is drawn: the stated one, or the end of a phase, or of the solution."""
        solution = self.solution
        if phase is not None:
            if state is not None:
                raise ValueError("state, phase: give one of them")
            return self._state_after(phase)
        if state is None:
            if int(solution.status) != 0:
                raise ValueError(
                    "solution: has failed; draw its last converged state, "
                    "state=solution.last, or call raise_if_failed"
                )
            return solution.last
        if not hasattr(state, "load_factor") or not np.isfinite(np.asarray(state.positions)).all():
            path = hasattr(state, "path")
            hint = "; of one of its phases give the number, phase=..." if path else ""
            raise ValueError(
                f"state: expected a State with finite positions, such as solution.last{hint}"
            )
        return state

    def _state_after(self, phase):
        """The `State` at the end of a phase that a user names."""
        count = len(self.solution.phases)
        if isinstance(phase, bool) or not isinstance(phase, int | np.integer):
            raise ValueError(f"phase = {phase!r}: expected a whole number")
        if not -count <= phase < count:
            raise ValueError(f"phase = {phase}: the solution has phases 0 to {count - 1}")
        number = range(count)[phase]
        if int(self.solution.phases[number].status) != 0:
            raise ValueError(f"phase = {phase}: has not converged; draw state=solution.last")
        return self._shapes.state_after(number)

    def title(self, phase: int, state: State | None = None) -> str:
        """Title of the end of a phase, or of a `State` in it.

        It is the name of the phase, if phases have `names`; else "Before loading" and "After
        loading" of two phases, "At the end" of a single one, and "After phase 3 of 7" of more.
        """
        count = len(self.solution.phases)
        if phase < 0:
            return "Start"
        stopped = ""
        if state is not None and float(state.load_factor) != 1.0:
            stopped = f" at {float(state.load_factor):.3g}"
        number = f"phase {phase + 1}" + (f" of {count}" if count > 2 else "")
        if self.names is not None:
            title = str(self.names[phase])
        elif stopped:
            title = number[0].upper() + number[1:]
        elif count == 1:
            title = "At the end"
        elif count == 2 and (state is None or phase == 1):
            title = ("Before loading", "After loading")[phase]
        else:
            title = f"After {number}"
        ended = self.solution.phases[phase]
        unstable = not stopped and int(ended.status) == 0 and not bool(ended.stable)
        return f"{title}{stopped}" + (", not known to be stable" if unstable else "")


def evenly(n: int, most: int) -> Int[np.ndarray, " n_frame"]:
    """At most `most` of the numbers from 0 to n - 1, evenly spaced, with the last one."""
    return np.round(np.linspace(n - 1, 0, min(most, n))).astype(int)[::-1]


def refuse_batch(solution: Solution) -> None:
    """Raise ValueError for a batch: a picture shows one analysis."""
    if np.ndim(solution.status) != 0:
        raise ValueError(
            "solution: is a batch; draw one of it, jax.tree.map(lambda a: a[k], solution)"
        )


def _colour(parts, solution, colour):
    """The name of the values that colour elements, checked; see `Snapshots`."""
    told = columns(parts, solution.last.told)
    names = [column.label for column in told if any(x is not None for x in column.values)]
    if colour == "tension" and names and "tension" not in names:
        colour = names[0]
    if colour not in ("tension", "utilisation", *names):
        expected = ", ".join(f'"{name}"' for name in dict.fromkeys((*names, "utilisation")))
        raise ValueError(f"colour = {colour!r}: expected one of {expected}")
    return colour


def _require_links(solution, structure):
    """Raise ValueError if a structure has other links than the solution."""
    if structure is None:
        return
    given, solved = ([g.links.array for g in structure.groups], [l.array for l in solution.links])
    if len(given) != len(solved) or not all(map(np.array_equal, given, solved)):
        raise ValueError("structure: its links are not those of the solution")
