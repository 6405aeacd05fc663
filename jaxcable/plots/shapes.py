"""Shapes of elements that are no straight lines: bent beams and hanging cables."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, TypeAlias

import jax
import numpy as np

from ..analysis.phase_results import PhaseResult
from ..analysis.solution import Solution, State
from ..common.tree import copy
from ..common.types import Bool, Float, Int
from ..elements.abilities import Bending, Sagging
from ..elements.prestress import element
from ..forms import catenary_curves
from ..model.parts import first_and_last, per_group, there
from ..model.structure import Structure
from ..stiffness.tangent import filled, prepared
from .views import View

_MANY = 2000  # curves from which on their pieces are shorter than a pixel anyway


class Curves:
    """Curves of beams and hanging cables in one geometry, beams first.

    Attributes:
        number: of the elements, counted through all groups, [n_curve].
        ends: first and last node of each, [n_curve, 2].
        apart: distances from the chord at places along the element, ends included, where they are
            zero, [n_curve, n_place, 3], m; NaN where the shape is not known.
        axes: axes x, y and z of the sections of the beams, in rows, [n_beam, 3, 3].
    """

    def __init__(
        self,
        number: Int[np.ndarray, " n_curve"],
        ends: Int[np.ndarray, "n_curve 2"],
        apart: Float[np.ndarray, "n_curve n_place 3"],
        axes: Float[np.ndarray, "n_beam 3 3"],
    ):
        self.number, self.ends, self.apart, self.axes = number, ends, apart, axes

    @property
    def known(self) -> Bool[np.ndarray, " n_curve"]:
        """Which shapes are known."""
        return np.isfinite(self.apart).all(axis=(1, 2))

    def points(
        self, positions: Float[np.ndarray, "n_node 3"], n: int | None = None
    ) -> Float[np.ndarray, "n_curve n_place 3"]:
        """Points along the curves between node positions, at `n` places or those of `apart`.

        They are on the chord where the shape is not known.
        """
        apart, count = np.nan_to_num(self.apart), self.apart.shape[1]
        if n is not None and n != count:
            at = np.linspace(0, count - 1, n)
            low = np.minimum(at.astype(int), count - 2)
            part = (at - low)[:, None]
            apart = (1 - part) * apart[:, low] + part * apart[:, low + 1]
        a, b = (positions[nodes][:, None] for nodes in self.ends.T)
        parts = np.linspace(0.0, 1.0, apart.shape[1])[:, None]
        return (1 - parts) * a + parts * b + apart

    def rows(self, number: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Which curves belong to elements with these numbers, [n]."""
        order = np.argsort(self.number)
        return order[np.searchsorted(self.number, number, sorter=order)]

    def magnified(self, origin: Curves, factor: float) -> Curves:
        """What differs from the curves of `origin` times a factor, as nodes are magnified."""
        change = factor * (self.apart - origin.apart)
        apart = np.where(origin.known[:, None, None], origin.apart + change, self.apart)
        return Curves(self.number, self.ends, apart, self.axes)

    def drawn(
        self, positions: Float[np.ndarray, "n_node 3"], present: Bool[np.ndarray, " n_elem"]
    ) -> Float[np.ndarray, "n 3"]:
        """All points of the known curves of elements that are there, [n, 3]."""
        return self.points(positions)[self.known & present[self.number]].reshape(-1, 3)


class Shapes:
    """The `Curves` of a solution at its ends of phases, and of beams in all increments.

    They are None without a structure, and if none of its elements bends or hangs: then every piece
    of an element is a straight line.
    """

    def __init__(self, solution: Solution, structure: Structure | None):
        groups = () if structure is None else structure.groups
        self.bends = any(isinstance(group, Bending) for group in groups)
        self.hangs = any(isinstance(group, Sagging) for group in groups)
        self.solution, self.structure = solution, structure

    def of(self, state: State) -> Curves | None:
        """The curves in a `State`."""
        if not (self.bends or self.hangs):
            return None
        motion = np.asarray(state.carry.motion)[None]
        return self._curves(motion, [(state, np.asarray(state.positions))])[0]

    def after(self, phase: int) -> Curves | None:
        """The curves at the end of a phase that has converged."""
        if not (self.bends or self.hangs):
            return None
        state = self.state_after(phase)
        place = np.asarray(self.solution.phases[phase].positions)
        return self._curves(np.asarray(state.carry.motion)[None], [(state, place)])[0]

    def start(self, like: Curves | None) -> Curves | None:
        """The curves before the first phase, of which hanging cables are not known: NaN."""
        if like is None:
            return None
        apart = np.full_like(like.apart, np.nan)
        apart[: len(like.axes)] = 0.0
        return Curves(like.number, like.ends, apart, like.axes)

    def along(self, places: Sequence[tuple[int, int]]) -> Sequence[Curves | None]:
        """The curves in increments, pairs of a phase and a converged increment of it.

        Hanging cables are known at ends of phases, and at a last state before a failure: between
        them their distances from the chord are interpolated, in the first phase those of its end.
        """
        if not (self.bends or self.hangs):
            return [None] * len(places)
        last, phases = self.solution.last, self.solution.phases
        paths: dict[int, Any] = {k: phases[k].path for k, _ in places}
        motion = [paths[k].motion[n] for k, n in places] if self.bends else last.carry.motion[None]
        hanging: list[Any] = []
        if self.hangs:
            for k in range(int(last.phase) + 1):
                at = last if k == int(last.phase) else phases[k]
                hanging.append((self.state_after(k), np.asarray(at.positions)))
        bent, hung = self._parts(np.asarray(motion), hanging)
        found: list[Curves | None] = []
        for j, (k, n) in enumerate(places):
            parts = [] if bent is None else [bent[j]]
            if hung:
                at_end = float(last.load_factor) if k == int(last.phase) else 1.0
                part = float(paths[k].load_factor[n]) / at_end
                before, after = hung[max(k - 1, 0)], hung[k]
                apart = before.apart + part * (after.apart - before.apart)
                parts.append(Curves(after.number, after.ends, apart, after.axes))
            found.append(_joined(parts))
        return found

    def state_after(self, phase: int) -> State:
        """The `State` at the end of a phase, as far as shapes depend on it."""
        last, end = self.solution.last, self.solution.phases[phase]
        if phase == int(last.phase) or self.structure is None:
            return last
        path = end.path
        motion = None if path.motion is None else np.asarray(path.motion[-1])
        return state_at(last, self.structure, phase, end, motion)

    def _curves(self, motion, hanging):
        """`Curves` at some motions, and in the same number of states with their positions."""
        bent, hung = self._parts(motion, hanging)
        pairs = itertools.zip_longest(bent or [], hung)
        return [_joined([part for part in pair if part is not None]) for pair in pairs]

    def _parts(self, motion, hanging):
        """`Curves` of the beams at all motions, or None, and of hanging cables in all states."""
        structure = self.structure
        ends = np.concatenate([first_and_last(group) for group in structure.groups])
        kept = [group for group in structure.groups if isinstance(group, Bending | Sagging)]
        n = 25 if sum(len(group.links) for group in kept) <= _MANY else 9
        bent = None
        found = bends(structure, self.solution.last, motion) if self.bends else None
        if found is not None:
            number, slopes, axes = found
            apart = cubic(slopes, np.linspace(0.0, 1.0, n))
            bent = [Curves(number, ends[number], *pair) for pair in zip(apart, axes, strict=True)]
        hung = []
        for state, place in hanging if self.hangs else ():
            number, apart = sags(structure, state, place, n)
            apart = np.pad(apart, ((0, 0), (1, 1), (0, 0)))
            hung.append(Curves(number, ends[number], apart, np.zeros((0, 3, 3))))
        return bent, hung


def lines(
    positions: Float[np.ndarray, "n_node 3"],
    links: tuple[Int[np.ndarray, "n_piece 2"], Int[np.ndarray, " n_piece"]],
    curves: Curves | None,
) -> Float[np.ndarray, "n_piece 2 3"] | list[Float[np.ndarray, "n_place 3"]]:
    """The line of every piece: an array of straight ones, or a list if some are curves."""
    pairs, owner = links
    straight = positions[pairs]
    if curves is None:
        return straight
    found, points = list(straight), curves.points(positions)
    row = np.full(1 + max(owner.max(initial=0), curves.number.max(initial=0)), -1)
    row[curves.number] = np.arange(len(points))
    for piece in np.flatnonzero(row[owner] >= 0):
        found[piece] = points[row[owner[piece]]]
    return found


Lines: TypeAlias = (
    "Float[np.ndarray, 'n_line n_place 2or3'] | list[Float[np.ndarray, 'n_place 2or3']]"
)


def projected(view: View, found: Lines) -> Lines:
    """Lines, an array or a list, in a picture."""
    if isinstance(found, np.ndarray):
        return view.project(found)
    return [view.project(line) for line in found]


def chosen(found: Lines, which: Bool[np.ndarray, " n_line"]) -> Any:
    """The lines, an array or a list, that are chosen by booleans, in the same form."""
    if isinstance(found, np.ndarray):
        return found[which]
    return [found[k] for k in np.flatnonzero(which)]


def known(
    curves: Curves | None, present: Bool[np.ndarray, " n_elem"]
) -> Bool[np.ndarray, " n_elem"]:
    """Which of the elements that are there have a known shape, [n_elem] bool."""
    if curves is None:
        return present
    found = present.copy()
    found[curves.number[~curves.known]] = False
    return found


def cubic(
    bend: Float[np.ndarray, "... 2 3"], places: Float[np.ndarray, " n_place"]
) -> Float[np.ndarray, "... n_place 3"]:
    """Distance of beams from their chords, Hermite's cubic, at `places` from 0 to 1, m.

    Args:
        bend: the chord's length times the slopes against it at both ends, [..., 2, 3], m.
        places: places along the chord over its length, [n_place].
    """
    first, second = places * (1 - places) ** 2, -(places**2) * (1 - places)
    return np.einsum("px,...xk->...pk", np.stack([first, second], axis=1), bend)


def bends(
    structure: Structure, state: State, motion: Float[np.ndarray, "n_shot n_row 7"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """How the beams leave their chords at some motions of all rows; None if no element bends.

    Returns:
        Numbers of the beams, counted through all groups, [n_beam]; the length of the chord times
        the slopes against it at both ends, [n_shot, n_beam, 2, 3], m; and the axes x, y and z of
        the sections, in rows, [n_shot, n_beam, 3, 3].
    """
    thawed, arrays, _ = prepared(structure, state)
    numbers, bend, axes = [], [], []
    for number, found in zip(numbered(structure), _bent(thawed, arrays, motion), strict=True):
        if found is not None:
            slopes, turned, length = (np.asarray(x) for x in found)
            numbers.append(number)
            bend.append(slopes * length[..., None, None])
            axes.append(turned)
    if not numbers:
        return None
    return np.concatenate(numbers), np.concatenate(bend, axis=1), np.concatenate(axes, axis=1)


@jax.jit
def _bent(thawed, arrays, motion):
    """Slopes, axes and chords of the beams of every group at some motions of all rows, or None."""
    nodes, groups, carry = filled(thawed, arrays)

    def one(group, properties, state, ends, motion):
        found = element(group, properties).deflected(state, ends, motion)
        if found is None:
            return None
        chord = ends[1] + motion[1, :3] - ends[0] - motion[0, :3]
        return *found, (chord * chord).sum() ** 0.5

    def along(group, state):
        def of(motion):
            at = group.properties(), state, nodes[group.links], motion[group.links]
            return jax.vmap(lambda *x: one(group, *x))(*at)

        return jax.vmap(of)(motion.astype(nodes.dtype))

    pairs = zip(groups, carry.states, strict=True)
    return [along(*pair) if isinstance(pair[0], Bending) else None for pair in pairs]


def sags(
    structure: Structure, state: State, positions: Float[np.ndarray, "n_node 3"], n: int
) -> tuple[Int[np.ndarray, " n_sag"], Float[np.ndarray, "n_sag n_place 3"]]:
    """How catenaries hang below their chords in a state, in which the nodes are at `positions`.

    Returns:
        Numbers of the elements, counted through all groups, [n_sag], and their distances from the
        chord at n - 2 places between its ends, evenly along the unstressed length, m.
    """
    parts = np.linspace(0.0, 1.0, n)[1:-1, None]
    numbers, found = [], []
    curves = per_group(structure, catenary_curves(structure, state, n))
    for number, group, curve in zip(numbered(structure), structure.groups, curves, strict=True):
        if curve is not None:
            a, b = (positions[nodes][:, None] for nodes in first_and_last(group).T)
            numbers.append(number)
            found.append(curve[:, 1:-1] - (1 - parts) * a - parts * b)
    return np.concatenate(numbers), np.concatenate(found)


def state_at(
    last: State,
    structure: Structure,
    phase: int,
    end: PhaseResult | State,
    motion: Float[np.ndarray, "n_row 7"] | None,
) -> State:
    """The `State` of the end of a phase, as far as shapes depend on it.

    Loads of later phases do not act yet, lengths and motions are those of the phase.

    Args:
        last: the last `State` of the analysis.
        structure: the `Structure` that was analysed.
        phase: number of the phase.
        end: its result.
        motion: of all rows at its end; None in structures without beams.
    """
    carry: Any = last.carry
    amounts = [
        copy(amount, factors=amount.factors * (np.asarray(stack.phase) <= phase))
        for stack, amount in zip(carry.loads, carry.amounts, strict=True)
    ]
    then, now = (per_group(structure, x.rest_length) for x in (end, last))
    states = []
    masks = there(structure, end.present)
    for state, a, b, present in zip(carry.states, then, now, masks, strict=True):
        if state.rest_length is not None:  # the sum of length and elongation stays
            length = np.asarray(state.rest_length) * (np.asarray(a) / np.asarray(b))
            longer = None
            if state.elongation is not None:
                longer = np.asarray(state.elongation) + (np.asarray(state.rest_length) - length)
            state = copy(state, rest_length=length, elongation=longer)
        if state.present is not None:
            state = copy(state, present=present)
        states.append(state)
    if motion is None:  # from the initial nodes, which an earlier analysis may have left
        moved = np.asarray(end.positions) - np.asarray(structure.nodes)
        motion = np.concatenate([moved, np.asarray(carry.motion)[len(moved) :]])
    return copy(last, carry=copy(carry, motion=motion, states=states, amounts=amounts))


def numbered(structure: Structure) -> list[Int[np.ndarray, " n_elem"]]:
    """Numbers of the elements of every group, counted through all groups."""
    ends = np.cumsum([0, *(len(group.links) for group in structure.groups)])
    return [np.arange(a, b) for a, b in itertools.pairwise(ends)]


def _joined(parts):
    """Beams and hanging cables as one `Curves`, beams first."""
    if not parts:
        return None
    names = "number", "ends", "apart", "axes"
    return Curves(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
