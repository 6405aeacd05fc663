"""Geometry, forces and supports of a solution, before and after loading, for pictures."""

from __future__ import annotations

import numpy as np

from ..analysis.solution import Path, PhaseResult, Solution, State
from ..common.types import Bool, Float, Int
from ..model.parts import columns, pieces
from ..model.structure import Structure
from .glyphs import supports
from .members import Forces
from .views import View

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
    """

    def __init__(
        self,
        title: str,
        positions: Float[np.ndarray, "n_node 3"],
        ghost: Float[np.ndarray, "n_node 3"],
        forces: Forces,
        fixed: Bool[np.ndarray, "n_node n_freedom"],
        before: Bool[np.ndarray, " n_elem"],
    ):
        self.title, self.positions, self.ghost = title, positions, ghost
        self.forces, self.fixed, self.before = forces, fixed, before

    def places(self) -> tuple[Float[np.ndarray, "n_node 3"], Float[np.ndarray, "n_node 3"]]:
        """All positions that are drawn, two arrays [n_node, 3]."""
        return self.ghost, self.positions

    def moved(self) -> bool:
        """Whether the difference from the earlier geometry is visible."""
        extent = np.ptp(np.concatenate(self.places()), axis=0).max()
        return bool(np.abs(self.positions - self.ghost).max() > _SEEN * extent)

    def held(self, structure: Structure | None, view: View) -> Bool[np.ndarray, "3 n_node"]:
        """Kinds of supports, [3, n_node] bool, see `glyphs.supports`."""
        rotates = None if structure is None else structure.rotating()
        return supports(self.fixed, rotates, view.normal)


def stages_of(
    solution: Solution,
    structure: Structure | None = None,
    state: State | None = None,
    magnify: float | None = 1.0,
    colour: str = "tension",
) -> tuple[tuple[Int[np.ndarray, "n_piece 2"], Int[np.ndarray, " n_piece"]], list[Stage], State]:
    """What a picture of a solution shows.

    Returns:
        links: node numbers of all pieces of elements, [n_piece, 2], and the element of each piece.
        stages: the stages before and after loading, a list of two.
        state: the `State` after loading.
    """
    colour = shown(solution, structure, colour)
    if state is None:
        if int(solution.status) != 0:
            raise ValueError(
                "solution: has failed; draw its last converged state, "
                "state=solution.last, or call raise_if_failed"
            )
        state = solution.last
    elif not hasattr(state, "load_factor") or not np.isfinite(np.asarray(state.positions)).all():
        raise ValueError("state: expected a State with finite positions, such as solution.last")
    end, begin, first = np.asarray(state.positions), start_of(solution, state), solution.phases[0]
    number = int(state.phase)
    n_node = len(end)

    def fixed(phase):
        return state.fixed[phase + 1].array[:n_node]

    def factor(origin):
        return (
            round_factor(end - origin, np.concatenate([end, begin])) if magnify is None else magnify
        )

    forces = forces_of(state, solution, structure, colour)
    stopped = "" if float(state.load_factor) == 1.0 else f" at {float(state.load_factor):.3g}"
    unstable = [", unstable" if _unstable(phase) else "" for phase in solution.phases]
    at_end = "" if stopped or number < 0 else unstable[number]
    if number < 1:  # a single phase: both pictures are of its end
        last = "At the end" if len(solution.phases) == 1 else "After phase 1"
        name = f"{last}{stopped}{at_end}" if number == 0 else "Start"
        factor = factor(begin)
        moved = begin + factor * (end - begin)
        stages = [
            Stage(name, end, begin, forces, fixed(number), forces.present),
            Stage(name + _times(factor), moved, begin, forces, fixed(number), forces.present),
        ]
        return pieces(solution.last.topology.parts)[:2], stages, state
    middle = np.asarray(first.positions)
    name = f"Phase {number + 1}{stopped}" if stopped else f"After loading{at_end}"
    factor = factor(middle)
    moved = middle + factor * (end - middle)
    before = forces_of(first, solution, structure, colour)
    stages = [
        Stage(f"Before loading{unstable[0]}", middle, begin, before, fixed(0), before.present),
        Stage(name + _times(factor), moved, middle, forces, fixed(number), before.present),
    ]
    return pieces(solution.last.topology.parts)[:2], stages, state


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
