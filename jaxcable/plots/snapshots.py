"""The structure at an instant of a solution: what all pictures, and the page, show of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from ..analysis.phase_results import Path as Increments
from ..analysis.phase_results import PhaseResult
from ..analysis.solution import Solution, State
from ..common import checks
from ..common.negligible import NEGLIGIBLE
from ..common.types import Bool, Float, Int
from ..design.arguments import require_phase_index
from ..model.phase_plausibility import known_axial_stiffness
from ..model.result_parts import element_faces, result_columns, straight_pieces
from ..model.structure import Structure
from ..model.topology import require_same_topology
from .element_curves import PLACES, Curves, SolutionCurves
from .element_forces import ElementForces
from .symbols import section_axis_tips, support_kinds, supported_nodes

_SEEN = 2e-3  # least visible displacement over the extent: some two pixels of a picture


@dataclasses.dataclass(frozen=True, eq=False)
class Snapshot:
    """The structure at one instant of a solution, as a picture shows it.

    Attributes:
        phase: index of the phase, from 0; -1 before the first one.
        increment: index of the increment in it, from 0; None for the end of a phase or a `State`.
        load_factor: load factor in the phase.
        initial_positions: positions of the nodes before the first phase, [n_node, 3], m; of the
            input if there are beams.
        displacement: displacement from there, [n_node, 3], m.
        element_results: dict from name to results, each in the shape of the elements.
        forces: `ElementForces` at this instant.
        fixed: which degrees of freedom supports hold, [n_node, 3 or 6] bool; none of nodes all of
            whose elements are inactive.
        rotates: which nodes have rotations, [n_node] bool; None if unknown.
        on_ground: which nodes have springs to the ground or bearings, [n_node] bool.
        curves: `Curves` of beams and hanging cables, or None.
        end: `PhaseResult` or `State` of this instant; None for increments, of which only the
            recorded path is known.
    """

    phase: int
    increment: int | None
    load_factor: float
    initial_positions: Float[np.ndarray, "n_node 3"]
    displacement: Float[np.ndarray, "n_node 3"]
    element_results: dict[str, Any]
    forces: ElementForces
    fixed: Bool[np.ndarray, "n_node n_freedom"]
    rotates: Bool[np.ndarray, " n_node"] | None
    on_ground: Bool[np.ndarray, " n_node"]
    curves: Curves | None
    end: PhaseResult | State | None

    @property
    def positions(self) -> Float[np.ndarray, "n_node 3"]:
        """Positions of the nodes, [n_node, 3], m."""
        return self.initial_positions + self.displacement

    def has_known_shape(self) -> Bool[np.ndarray, " n_elem"]:
        """Return for each element whether it is active and its shape is known, [n_elem] bool."""
        found = self.forces.present.copy()
        if self.curves is not None:
            found[self.curves.element[~self.curves.is_known]] = False
        return found

    def points(self, which: Bool[np.ndarray, " n_elem"] | None = None) -> Float[np.ndarray, "n 3"]:
        """Return all points that are drawn, [n, 3], m: nodes, and points along curves.

        Args:
            which: [n_elem] bool, elements whose curves are included; None for all of known shape.
        """
        if self.curves is None:
            return self.positions
        which = self.has_known_shape() if which is None else which
        curved = self.curves.points(self.positions)[which[self.curves.element]]
        return np.concatenate([self.positions, curved.reshape(-1, 3)])

    def displacement_from(self, before: Snapshot) -> Float[np.ndarray, "n 3"]:
        """Return the displacement of all drawn points since another snapshot, [n, 3], m.

        Points are nodes, and points along curves whose shape is known in both snapshots.
        """
        both = self.has_known_shape() & before.has_known_shape()
        return self.points(both) - before.points(both)

    def has_moved_from(self, before: Snapshot) -> bool:
        """Return whether a picture shows that points have moved since another snapshot."""
        extent = np.ptp(np.concatenate([self.points(), before.points()]), axis=0).max()
        return bool(np.abs(self.displacement_from(before)).max() > _SEEN * extent)

    def magnified(self, origin: Snapshot, factor: float) -> Snapshot:
        """Return the snapshot with its displacements since `origin` multiplied by a factor."""
        displacement, curves = (
            origin.displacement + factor * (self.displacement - origin.displacement),
            self.curves,
        )
        if curves is not None and origin.curves is not None:
            curves = curves.magnified(origin.curves, factor)
        return dataclasses.replace(self, displacement=displacement, curves=curves)

    def in_initial_geometry(self) -> Snapshot:
        """Return the snapshot in the geometry before the first phase, with the same forces."""
        curves = None if self.curves is None else self.curves.in_initial_geometry()
        return dataclasses.replace(
            self, displacement=np.zeros_like(self.displacement), curves=curves
        )

    def section_axes(self) -> tuple[Float[np.ndarray, "n_beam 3"], Float[np.ndarray, "n_beam 3 3"]]:
        """Return the middles of the active beams, and the ends of their section axes there, m."""
        if self.curves is None:
            return np.zeros((0, 3)), np.zeros((0, 3, 3))
        points, axes = self.curves.points(self.positions), self.curves.axes
        there = self.forces.present[self.curves.element[: len(axes)]]
        points, axes = points[: len(axes)][there], axes[there]
        chords = np.linalg.norm(points[:, -1] - points[:, 0], axis=1)
        extent = np.ptp(self.positions, axis=0).max()
        middles = points[:, points.shape[1] // 2]
        return middles, section_axis_tips(middles, axes, chords, extent)

    def support_kinds(self, normal: Float[np.ndarray, " 3"] | None) -> Bool[np.ndarray, "4 n_node"]:
        """Return which nodes are clamped, pinned, partially held or on springs, [4, n_node] bool.

        `normal` is the unit normal vector of a plane structure, or None.
        """
        return support_kinds(self.fixed, self.on_ground, self.rotates, normal)


class Snapshots:
    """All instants of a solution that pictures can show, each as a `Snapshot`.

    Args:
        solution: `Solution` of one case.
        structure: `Structure` that was analysed, or None.
        color: values that color elements, as of `net`.
        names: names of the phases, or None.
        places: number of points along every curve.

    Attributes:
        color: `color`, or the first result of elements if it is "tension" and none has a tension.
        parts: `GroupTopology` of every group of elements.
        links: node numbers of all pieces, [n_piece, 2], and the element of each piece.
        faces: node numbers around all faces, [n_face, 4], and the element of each face.

    Raises:
        ValueError: a batch, an unknown color, the links of another structure, or another number of
            names than of phases.
    """

    def __init__(
        self,
        solution: Solution,
        structure: Structure | None = None,
        color: str = "tension",
        names: Sequence[str] | None = None,
        places: int = PLACES,
    ):
        self.solution, self.structure, self.names = solution, structure, names
        require_one_solution(solution)
        self.parts = solution.last.topology.parts
        self.color = _resolve_color(self.parts, solution, color)
        if structure is not None:
            require_same_topology(structure, solution.last.topology, "solution")
        self.titles = titles_of_phases(solution, names)
        self.links, self.faces = straight_pieces(self.parts)[:2], element_faces(self.parts)[:2]
        self._curves = SolutionCurves(solution, structure, places)
        self._rotates = None if structure is None else structure.rotating_nodes()

    def at_state(self, state: State) -> Snapshot:
        """Return the `Snapshot` of a `State`."""
        displacement = np.asarray(state.positions) - self._curves.initial_positions
        place = int(state.phase), None, float(state.load_factor)
        return self._make_snapshot(
            place, displacement, state.element_results, self._curves.at_state(state), state
        )

    def after_phase(self, phase: int) -> Snapshot:
        """Return the `Snapshot` at the end of a phase that has converged."""
        return self.at_state(self._curves.state_after_phase(phase))

    def increments(self, frames: int, ends: bool = False) -> list[Snapshot]:
        """Return the `Snapshot`s of the converged increments of all phases, a list.

        Args:
            frames: largest number of increments, taken evenly, with the last one.
            ends: whether to keep the ends of all phases, even if these are more than `frames`.

        Raises:
            ValueError: no increment has converged, or `frames` is no positive integer.
        """
        checks.require_whole_number(frames, "frames")
        phases = list(self.solution.phases)
        paths: list[Any] = [jax.tree.map(np.asarray, phase.path) for phase in phases]
        good = [(k, int(n)) for k, p in enumerate(paths) for n in np.flatnonzero(p.status == 0)]
        if not good:
            raise ValueError("solution: has no converged increment to show; see raise_if_failed")
        last = [j for j in range(len(good)) if j + 1 == len(good) or good[j + 1][0] != good[j][0]]
        chosen = evenly_spaced_indices(len(good), frames)
        if ends:
            between = np.setdiff1d(np.arange(len(good)), last)
            between = between[evenly_spaced_indices(len(between), max(frames - len(last), 0))]
            chosen = np.union1d(last, between)
        found = []
        for j in chosen.tolist():
            phase, number = good[j]
            path = jax.tree.map(lambda x, n=number: x[n], paths[phase])
            element_results = path.element_results
            displacement = self._curves.nodes - self._curves.initial_positions + path.displacement
            end: PhaseResult | State | None = None
            if j in last:
                end = self.solution.last if j + 1 == len(good) else phases[phase]
                element_results |= end.element_results
            place = phase, number, float(path.load_factor)
            curves = self._curves.at_increment(phase, number)
            found.append(self._make_snapshot(place, displacement, element_results, curves, end))
        return found

    def _make_snapshot(self, place, displacement, element_results, curves, end):
        """Make the `Snapshot` of an instant; arguments are fields of it, where not explained.

        Args:
            place: tuple of phase, increment and load factor.
            displacement: from the initial positions, [n_node, 3], m.
        """
        forces = ElementForces(element_results, self.parts, self.structure, self.color)
        fixed = self.solution.last.fixed[place[0] + 1].array[: len(displacement)]
        fixed, on_ground = supported_nodes(self.parts, forces.present, fixed)
        motion = self._curves.initial_positions, displacement
        supports = fixed, self._rotates, on_ground
        return Snapshot(*place, *motion, element_results, forces, *supports, curves, end)

    def negligible_force(self) -> float:
        """Return the size up to which loads and reactions are rounding errors, N.

        It is the largest of three: 1e-7 of the largest load, reaction or axial force at the end of
        any phase, because what is slack may have been taut; the rounding errors of the residuals;
        and, with a structure, the axial stiffness times the rounding of a strain.
        """
        ends = [*self.solution.phases, self.solution.last]
        forces = [(end.load, end.reactions, end.tension, end.peak_tension) for end in ends]
        rounding = [phase.path.rounding for phase in self.solution.phases]
        groups = () if self.structure is None else self.structure.groups
        stiffness = [known_axial_stiffness(group) for group in groups]
        shares = (NEGLIGIBLE, forces), (1.0, rounding), (np.finfo(float).eps, stiffness)
        return max(
            share * float(np.fmax.reduce(np.abs(values), axis=None, initial=0.0))
            for share, tree in shares
            for values in (0.0, *jax.tree.leaves(tree))
        )

    def state_to_draw(self, state: State | None, phase: int | None = None) -> State:
        """Return the `State` to draw: `state`, else the end of `phase`, else of the solution.

        Raises:
            ValueError: this state has not converged, or both arguments are given.
        """
        solution = self.solution
        if phase is not None:
            if state is not None:
                raise ValueError("state, phase: give only one of them")
            return self._state_after_phase(phase)
        if state is None:
            if int(solution.status) != 0:
                raise ValueError(
                    "solution: the analysis failed (raise_if_failed says why); draw its last "
                    "converged state with state=solution.last"
                )
            return solution.last
        if not hasattr(state, "load_factor") or not np.isfinite(np.asarray(state.positions)).all():
            path = hasattr(state, "path")
            hint = "; for the end of one of its phases give phase=..." if path else ""
            raise ValueError(
                f"state: expected a State with finite positions, such as solution.last{hint}"
            )
        return state

    def _state_after_phase(self, phase):
        """Return the `State` at the end of a phase; ValueError for an unknown or failed phase."""
        count = len(self.solution.phases)
        require_phase_index(phase, count, -count)
        number = range(count)[phase]
        if int(self.solution.phases[number].status) != 0:
            raise ValueError(
                f"phase = {phase}: has not converged; draw the last state with state=solution.last"
            )
        return self._curves.state_after_phase(number)

    def title(self, phase: int, state: State | None = None) -> str:
        """Return the title of a picture of the end of a phase, or of a `State` in this phase.

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


def evenly_spaced_indices(n: int, most: int) -> Int[np.ndarray, " n_frame"]:
    """Return at most `most` evenly spaced indices from 0 to n - 1, with the last one."""
    return np.round(np.linspace(n - 1, 0, min(most, n))).astype(int)[::-1]


def titles_of_phases(solution: Solution, names: Sequence[str] | None) -> list[str]:
    """Return the names of all phases; "phase 1", "phase 2" and so on if `names` is None.

    Raises:
        ValueError: another number of names than of phases.
    """
    count = len(solution.phases)
    if names is None:
        return [f"phase {k + 1}" for k in range(count)]
    if len(names) != count:
        raise ValueError(f"names: {len(names)} of them, but {count} phases")
    return [str(name) for name in names]


def require_one_solution(solution: Solution) -> None:
    """Raise ValueError unless `solution` is a `Solution` of a single analysis, not a batch."""
    if not isinstance(solution, Solution):
        hint = ""
        if isinstance(solution, State):
            hint = (
                "; pass the solution that the state belongs to: a page ends at solution.last, and "
                "pictures show it by state=solution.last"
            )
        elif isinstance(solution, Increments):
            hint = (
                "; draw a traced path by plots.path, or pass the solution of the phases up to a "
                "load factor on it, failed or not"
            )
        raise ValueError(f"solution: expected a Solution, got {type(solution).__name__}{hint}")
    if np.ndim(solution.status) != 0:
        raise ValueError(
            "solution: is a batch; draw one analysis of it, jax.tree.map(lambda a: a[k], solution)"
        )


def _resolve_color(parts, solution, color):
    """Return the name of the values that color elements; ValueError for an unknown one.

    If no element has a tension, "tension" stands for the first result that elements have. `parts`
    are `GroupTopology` of all groups.
    """
    known = result_columns(parts, solution.last.element_results)
    names = [column.label for column in known if any(x is not None for x in column.values)]
    if color == "tension" and names and "tension" not in names:
        color = names[0]
    if color not in ("tension", "utilization", *names):
        expected = ", ".join(f'"{name}"' for name in dict.fromkeys((*names, "utilization")))
        raise ValueError(f"color = {color!r}: expected one of {expected}")
    return color
