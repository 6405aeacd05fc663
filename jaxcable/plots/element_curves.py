"""Curves of elements that are not straight: bent beams and hanging cables."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from typing import Any, TypeAlias

import jax
import numpy as np

from ..analysis.element_shapes import CATENARIES
from ..analysis.results import result_fields
from ..analysis.solution import Solution, State
from ..common.tree import copy_with
from ..common.types import Bool, Float, Int
from ..elements.abilities import Bending
from ..elements.prestress import single_element
from ..forms import catenary_curves
from ..model.result_parts import end_nodes, straight_pieces, values_per_group
from ..model.structure import Structure
from ..programs.program_calls import as_program
from ..stiffness.tangent import merge_solution_state, split_solution_state
from .views import View

PLACES = 25
"""Places along a beam or a hanging cable, ends included."""
_MANY = 2000  # curves from which on their pieces are shorter than a pixel with fewer places
_FEW = 9  # places of so many

Links: TypeAlias = "tuple[Int[np.ndarray, 'n_piece 2'], Int[np.ndarray, ' n_piece']]"
"""Node numbers of all pieces of elements, and the element of each, as of `straight_pieces`."""


@dataclasses.dataclass(frozen=True, eq=False)
class Curves:
    """Curves of all beams and hanging cables at one instant, beams first.

    A cable that slides over nodes has a curve for each segment.

    Attributes:
        element: index of the element, counted through all groups, [n_curve].
        ends: first and last node of each curve, [n_curve, 2].
        piece: index of the piece that each curve replaces, as of `straight_pieces`, [n_curve].
        bend: for each beam the length of its chord times the slopes of the axis against the chord
            at both ends, which determine a cubic, [n_beam, 2, 3], m.
        axes: axes x, y and z of the sections of the beams, in rows, [n_beam, 3, 3].
        sag: vectors from the chords to the hanging cables at places between their ends, evenly
            along the unstressed length, [n_sag, n_place - 2, 3], m; NaN where they are not known.
    """

    element: Int[np.ndarray, " n_curve"]
    ends: Int[np.ndarray, "n_curve 2"]
    piece: Int[np.ndarray, " n_curve"]
    bend: Float[np.ndarray, "n_beam 2 3"]
    axes: Float[np.ndarray, "n_beam 3 3"]
    sag: Float[np.ndarray, "n_sag n_between 3"]

    @property
    def offsets(self) -> Float[np.ndarray, "n_curve n_place 3"]:
        """Vectors from chord to curve at places along each element, zero at both ends, m."""
        bent = hermite_cubic(self.bend, np.linspace(0.0, 1.0, self.sag.shape[1] + 2))
        return np.concatenate([bent, np.pad(self.sag, ((0, 0), (1, 1), (0, 0)))])

    @property
    def is_known(self) -> Bool[np.ndarray, " n_curve"]:
        """Whether the shape of each curve is known (not so of cables without a sag), [n_curve]."""
        hung = np.isfinite(self.sag).all(axis=(1, 2))
        return np.concatenate([np.ones(len(self.bend), bool), hung])

    def points(self, positions: Float[np.ndarray, "n_node 3"]) -> Float[np.ndarray, "n n_place 3"]:
        """Return points along all curves, m, between nodes at `positions`.

        They are on the chord where no shape is known.
        """
        apart = np.nan_to_num(self.offsets)
        return points_on_chords(positions[self.ends], apart.shape[1]) + apart

    def indices_of_elements(self, elements: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Return the index of the (first) curve of each element, [n], given by their index."""
        order = np.argsort(self.element)
        return order[np.searchsorted(self.element, elements, sorter=order)]

    def magnified(self, origin: Curves, factor: float) -> Curves:
        """Return the curves with their differences from the curves `origin` times a factor."""
        bend = origin.bend + factor * (self.bend - origin.bend)
        sag = origin.sag + factor * (self.sag - origin.sag)
        return dataclasses.replace(
            self, bend=bend, sag=np.where(np.isfinite(origin.sag), sag, self.sag)
        )

    def in_initial_geometry(self) -> Curves:
        """Return the curves before the first phase: straight beams, cables with a sag of NaN."""
        nowhere = np.full_like(self.sag, np.nan)
        return dataclasses.replace(self, bend=np.zeros_like(self.bend), sag=nowhere)


class SolutionCurves:
    """The `Curves` of beams and hanging cables at any instant of a solution.

    All methods return None in place of `Curves` without a structure, and if none of its elements
    bends or hangs: then every element is drawn by straight lines.

    Args:
        solution: `Solution`.
        structure: `Structure`, or None.
        places: number of points along every curve; fewer if there are very many curves.
    """

    def __init__(self, solution: Solution, structure: Structure | None, places: int = PLACES):
        self.solution, self.structure = solution, structure
        self.groups = () if structure is None else structure.groups
        curved = [g for g in self.groups if isinstance(g, (Bending, *CATENARIES))]
        self.straight = not curved
        count = len(straight_pieces(curved)[1]) if curved else 0
        self.places = places if count <= _MANY else _FEW
        starts = np.cumsum([0, *(len(group.links) for group in self.groups)])
        self._numbers = [np.arange(a, b) for a, b in itertools.pairwise(starts)]
        self._sag_after_phase = functools.cache(
            lambda phase: self._sag_in_state(self.state_after_phase(phase))
        )

    def at_state(self, state: State) -> Curves | None:
        """Return the curves in a `State`; None if no element is curved."""
        if self.straight:
            return None
        return self._make_curves(np.asarray(state.restart.motion), self._sag_in_state(state))

    def at_increment(self, phase: int, number: int) -> Curves | None:
        """Return the curves in converged increment `number` of a phase; None if none are curved.

        The sag of hanging cables is known at the ends of phases, and at the last state before a
        failure. Between two of these it is interpolated by the load factor; in the first phase it
        is the sag at its end.
        """
        if self.straight:
            return None
        last, path = self.solution.last, self.solution.phases[phase].path
        motion = last.restart.motion if path.motion is None else path.motion[number]
        before, after = self._sag_after_phase(max(phase - 1, 0)), self._sag_after_phase(phase)
        before = np.where(np.isfinite(before), before, after)  # of what this phase has added
        at_end = float(last.load_factor) if phase == int(last.phase) else 1.0
        part = float(path.load_factor[number]) / at_end
        return self._make_curves(np.asarray(motion), before + part * (after - before))

    @functools.cached_property
    def initial_positions(self) -> Float[np.ndarray, "n_node 3"]:
        """Positions from which displacements count in pictures, [n_node, 3], m.

        They are those before the first phase. An analysis with a `start` has left the nodes of the
        input by then; if there are beams, displacements count from the nodes of the input, as the
        rotations of their ends do: that at the start is not known.
        """
        if any(isinstance(group, Bending) for group in self.groups):
            return np.asarray(self.structure.nodes, float)
        return self.nodes + np.asarray(self.solution.phases.moved_before[0])

    @functools.cached_property
    def nodes(self) -> Float[np.ndarray, "n_node 3"]:
        """Initial nodes of the analysis, [n_node, 3], m."""
        return np.asarray(self.solution.last.positions) - np.asarray(
            self.solution.last.displacement
        )

    def state_after_phase(self, phase: int) -> State:
        """Return the `State` at the end of a converged phase, as far as pictures need it.

        Results and motions are those of this phase; the rest of its restart state is the last one.
        """
        last, end = self.solution.last, self.solution.phases[phase]
        if phase == int(last.phase):
            return last
        fields = result_fields(end)
        fields["displacement"] = np.asarray(end.positions) - self.initial_positions
        if not self.straight:
            motion = _motion_after_phase(last, self.structure, end)
            fields["restart"] = copy_with(last.restart, motion=motion)
        return copy_with(last, phase=np.int32(phase), load_factor=np.ones(()), **fields)

    def _make_curves(self, motion, sag):
        """Make the `Curves` for a motion of the nodes and a sag of cables.

        `motion` has displacements and rotations of all rows of motion, and `sag` the shape of
        `Curves.sag`.
        """
        drawn, slopes, axes = [], [np.zeros((0, 2, 3))], [np.zeros((0, 3, 3))]
        if any(isinstance(group, Bending) for group in self.groups):
            found = _deflected_beams(*self._split_structure, motion)
            for group, beams in enumerate(found):
                if beams is not None:
                    slope, turned, length = (np.asarray(x) for x in beams)
                    drawn.append(group)
                    slopes.append(slope * length[:, None, None])
                    axes.append(turned)
        drawn += [k for k, group in enumerate(self.groups) if isinstance(group, CATENARIES)]
        element, ends, piece = self._curves_by_group
        parts = np.concatenate(slopes), np.concatenate(axes), sag
        of_curves = ([of[k] for k in drawn] for of in (element, ends, piece))
        return Curves(*(np.concatenate([own[0][:0], *own]) for own in of_curves), *parts)

    @functools.cached_property
    def _curves_by_group(self):
        """Element, end nodes and piece of every curve, as if all groups were curved, three lists.

        Of cables that slide a curve is a segment, of other groups it is an element.
        """
        pairs, owner, _ = straight_pieces(self.groups)
        found = []
        for number, group in zip(self._numbers, self.groups, strict=True):
            piece = np.searchsorted(owner, number)
            own = number, end_nodes(group), piece
            if group.slides:
                piece = np.flatnonzero(np.isin(owner, number))
                own = owner[piece], pairs[piece], piece
            found.append(own)
        return tuple(zip(*found, strict=True))

    @functools.cached_property
    def _split_structure(self):
        """Traced and static parts of the structure, the first arguments of `_deflected_beams`."""
        return split_solution_state(self.structure, self.solution.last)[:2]

    def _sag_in_state(self, state):
        """Return the vectors from chords to hanging cables in a state, shaped as `Curves.sag`."""
        found, positions = [np.zeros((0, self.places - 2, 3))], np.asarray(state.positions)
        if any(isinstance(group, CATENARIES) for group in self.groups):
            curves = values_per_group(
                self.structure, catenary_curves(self.structure, state, self.places)
            )
            for group, ends, curve in zip(
                self.groups, self._curves_by_group[1], curves, strict=True
            ):
                if curve is not None:
                    own = curve
                    if group.slides:  # without the fillers of shorter cables
                        own = curve[group.links.array[:, 1:] != group.links.array[:, :-1]]
                    chord = points_on_chords(positions[ends], self.places)
                    found.append((own - chord)[:, 1:-1])
        return np.concatenate(found)


def points_on_chords(
    ends: Float[np.ndarray, "n 2 3"], n_place: int
) -> Float[np.ndarray, "n n_place 3"]:
    """Return evenly spaced points on the straight lines between two ends each, m."""
    parts = np.linspace(0.0, 1.0, n_place)[:, None]
    return (1 - parts) * ends[:, :1] + parts * ends[:, 1:]


Lines: TypeAlias = (
    "Float[np.ndarray, 'n_line n_place 2or3'] | list[Float[np.ndarray, 'n_place 2or3']]"
)


def picture_lines(
    view: View, positions: Float[np.ndarray, "n_node 3"], links: Links, curves: Curves | None
) -> Lines:
    """Return the line of each piece of an element, in coordinates of the picture.

    If all lines are straight, the result is an array [n_line, 2, 2 or 3]; else it is a list of
    arrays [n_point, 2 or 3], in which beams and hanging cables are curves. `positions` are those of
    the nodes, m; `links` are the node numbers of all pieces, and the element of each.
    """
    straight = view.project(positions)[links[0]]
    if curves is None:
        return straight
    found, points = list(straight), view.project(curves.points(positions))
    for piece, line in zip(curves.piece, points, strict=True):
        found[piece] = line
    return found


def select_lines(found: Lines, which: Bool[np.ndarray, " n_line"]) -> Any:
    """Return the lines, an array or a list, for which `which` is True."""
    if isinstance(found, np.ndarray):
        return found[which]
    return [found[k] for k in np.flatnonzero(which)]


def hermite_cubic(
    bend: Float[np.ndarray, "... 2 3"], places: Float[np.ndarray, " n_place"]
) -> Float[np.ndarray, "... n_place 3"]:
    """Return the vectors from the chords to bent beams at `places`, m: Hermite cubics.

    Args:
        bend: the length of the chord times the slopes against it at both ends, [..., 2, 3], m.
        places: places along the chord over its length, from 0 to 1, [n_place].
    """
    first, second = places * (1 - places) ** 2, -(places**2) * (1 - places)
    return np.einsum("px,...xk->...pk", np.stack([first, second], axis=1), bend)


@as_program
def _deflected_beams(without_indices, arrays, motion):
    """Return (slopes, section axes, chord lengths) of the beams by group; None for other groups.

    Slopes are against the chord at both ends, [n_elem, 2, 3]; section axes are in rows, [n_elem, 3,
    3]; lengths are in m, [n_elem]. `without_indices` and `arrays` are the parts of the structure
    from `split_solution_state`, and `motion` has the displacements and rotations of all nodes.
    """
    nodes, groups, restart = merge_solution_state(without_indices, arrays)
    motion = motion.astype(nodes.dtype)

    def one(group, properties, state, ends, motion):
        found = single_element(group, properties).end_slopes_and_axes(state, ends, motion)
        if found is None:
            return None
        chord = ends[1] + motion[1, :3] - ends[0] - motion[0, :3]
        return *found, (chord * chord).sum() ** 0.5

    def along(group, state):
        at = group.properties(), state, nodes[group.links], motion[group.links]
        return jax.vmap(functools.partial(one, group))(*at)

    pairs = zip(groups, restart.states, strict=True)
    return [along(*pair) if isinstance(pair[0], Bending) else None for pair in pairs]


def _motion_after_phase(last, structure, end):
    """Return displacements, from the initial nodes, and rotations of nodes at the end of a phase.

    `last` is the last `State` of the solution, and `end` the `PhaseResult`. Rotations are those of
    `last` if the phase has not recorded any.
    """
    if end.path.motion is not None:
        return np.asarray(end.path.motion[-1])
    # from the initial nodes, which an earlier analysis may have left
    moved = np.asarray(end.positions) - np.asarray(structure.nodes)
    return np.concatenate([moved, np.asarray(last.restart.motion)[len(moved) :]])


def curves_from_reference(
    structure: Structure,
    solutions: Solution | None,
    number: int,
    factor: float,
    since: Solution | State | None,
) -> tuple[Curves | None, Curves | None]:
    """Return the `Curves` of a case, magnified from those of a reference state, and the latter.

    Args:
        structure: `Structure`.
        solutions: `Solution` of all cases, [n_case]; without it there are no curves.
        number: index of the case.
        factor: factor on the differences from the reference state.
        since: the reference state; None for the initial geometry, whose curves are None, too.
    """
    if solutions is None:
        return None, None
    case = jax.tree.map(lambda x: np.asarray(x)[number], solutions)
    shapes = SolutionCurves(case, structure)
    curves, origin = shapes.at_state(case.last), None
    if curves is not None and since is not None:
        origin = shapes.at_state(since.last if isinstance(since, Solution) else since)
    if curves is not None:
        curves = curves.magnified(origin or curves.in_initial_geometry(), factor)
    return curves, origin
