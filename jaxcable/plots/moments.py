"""Moments of a solution that `view` can show: its converged increments, and the ends of phases."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from .. import design
from ..analysis.phase_results import PhaseResult
from ..analysis.solution import Solution, State
from ..common.types import Bool, Float
from ..elements.element import PRESENT
from ..model.parts import columns, slack_cables
from ..model.structure import Structure
from .animation import evenly
from .stages import start_of

_NOTHING = 1e-9  # compression over the largest force up to which it is rounding


class Moment:
    """One converged increment of a phase.

    Attributes:
        phase, number: of the phase and of the increment in it, from 0.
        factor: load factor.
        moved: displacement since the start of the first phase, [n_node, 3], m.
        end: `PhaseResult` or `State` that holds all that is known here; None for increments that
            only a path knows.
    """

    def __init__(
        self,
        phase: int,
        number: int,
        factor: float,
        moved: Float[np.ndarray, "n_node 3"],
        end: PhaseResult | State | None,
    ):
        self.phase, self.number, self.factor = phase, number, factor
        self.moved, self.end = moved, end


class Moments:
    """All moments that are shown, and what elements tell in each of them.

    Args:
        solution: `Solution` of one case; of a failed one what has converged.
        structure: `Structure` that was analysed, or None.
        frames: largest number of increments; the ends of phases are kept whatever it is.

    Attributes:
        start: positions before the first phase, [n_node, 3], m.
        shots: the moments, a list of `Moment`.
        paths: path of every phase in NumPy, a list.

    Raises:
        ValueError: no increment has converged.
    """

    def __init__(self, solution: Solution, structure: Structure | None, frames: int):
        self.solution, self.structure = solution, structure
        self.parts = solution.last.topology.parts
        self.counts = [len(part.links.array) for part in self.parts]
        phases = list(solution.phases)
        self.paths: list[Any] = [jax.tree.map(np.asarray, phase.path) for phase in phases]
        good = [(k, n) for k, p in enumerate(self.paths) for n in np.flatnonzero(p.status == 0)]
        if not good:
            raise ValueError("solution: has no converged increment to show; see raise_if_failed")
        self.start = start_of(solution, solution.last)
        last = [j for j in range(len(good)) if j + 1 == len(good) or good[j + 1][0] != good[j][0]]
        between = np.setdiff1d(np.arange(len(good)), last)
        room = max(frames - len(last), 0)
        between = between[evenly(len(between), room)] if room and len(between) else between[:0]
        self.shots = []
        for j in sorted({*last, *between.tolist()}):
            k, number = good[j]
            base = self.start if k == 0 else np.asarray(phases[k - 1].positions)
            path, moved = self.paths[k], base - self.start + self.paths[k].displacement[number]
            end: PhaseResult | State | None = None
            if j == len(good) - 1:
                end = solution.last
            elif j in last:
                end = phases[k]
            self.shots.append(Moment(k, int(number), float(path.load_factor[number]), moved, end))

    def joined(self, values: list[Any]) -> Float[np.ndarray, " n_elem"]:
        """Values of every group, arrays or None, as one array [n_elem], NaN for None."""
        pairs = zip(values, self.counts, strict=True)
        return np.concatenate(
            [np.full(n, np.nan) if x is None else np.asarray(x, float) for x, n in pairs]
        )

    def told(self, shot: Moment) -> dict[str, Any]:
        """What elements tell at a moment, by name, each in the shape of the elements."""
        path = self.paths[shot.phase]
        found = {
            name: jax.tree.map(lambda x: np.asarray(x)[shot.number], result)
            for name, result in path.told.items()
        }
        if shot.end is not None:
            found |= shot.end.told
        return found

    def columns(self) -> dict[str, tuple[str, Float[np.ndarray, "n_shot n_elem"]]]:
        """Every result with one number per element: its unit, and its values, by label.

        NaN where a result is not known, such as moments of beams between the ends of phases.
        """
        found: dict[str, tuple[str, np.ndarray]] = {}

        def put(label, unit, at, values):
            shape = len(self.shots), sum(self.counts)
            if label not in found:
                found[label] = unit, np.full(shape, np.nan, np.float32)
            found[label][1][at] = values

        for at, shot in enumerate(self.shots):
            told = self.told(shot)
            others = {name: tree for name, tree in told.items() if name != PRESENT.name}
            for column in columns(self.parts, others):
                put(column.label, column.unit, at, self.joined(column.values))
            if self.structure is not None and self.has_strength():
                used = design.utilisation(self.structure, told.get("peak_tension", told["tension"]))
                put("utilisation", "-", at, self.joined(leaves(used)))
            if shot.end is not None and shot.end.section_forces is not None:
                forces = [
                    None if x is None else np.asarray(x) for x in leaves(told["section_forces"])
                ]
                for k, name in ((4, "My"), (5, "Mz")):
                    most = [None if x is None else _extreme(x[..., k]) for x in forces]
                    put(f"largest {name}", "N m", at, self.joined(most))
        same = "peak_tension" in found and "tension" in found
        if same and np.array_equal(found["peak_tension"][1], found["tension"][1], equal_nan=True):
            del found["peak_tension"]
        return {name: pair for name, pair in found.items() if np.isfinite(pair[1]).any()}

    def has_strength(self) -> bool:
        """Whether a utilisation is known: a structure is given, and a group has a strength."""
        if self.structure is None:
            return False
        try:
            design.utilisation(self.structure, self.solution.last.peak_tension)
        except ValueError:
            return False
        return True

    def looks(self) -> tuple[Bool[np.ndarray, "n_shot n_elem"], ...]:
        """Which elements are slack, in compression, and absent: three arrays [n_shot, n_elem]."""
        slack, pressed, absent = [], [], []
        for shot in self.shots:
            told = self.told(shot)
            force = self.joined(leaves(told["tension"])) if "tension" in told else None
            if force is None:
                force = np.full(sum(self.counts), np.nan)
            gone = np.zeros(len(force), bool)
            if PRESENT.name in told:
                gone = self.joined(leaves(told[PRESENT.name])) == 0.0
            loose = (force == 0.0) & ~gone
            if self.structure is not None:
                ends = np.cumsum([0, *self.counts])
                pairs = zip(self.structure.groups, ends[:-1], ends[1:], strict=True)
                parts = [slack_cables(g, force[a:b], ~gone[a:b]) for g, a, b in pairs]
                loose = np.concatenate(parts)
            largest = np.nanmax(np.abs(force), initial=0.0)
            slack.append(loose)
            pressed.append(~loose & ~gone & (force < -_NOTHING * largest))
            absent.append(gone)
        return np.stack(slack), np.stack(pressed), np.stack(absent)


def leaves(tree: Any) -> list[Any]:
    """What a pytree in the shape of the elements has for every group, arrays or None; a list."""
    return jax.tree.leaves(tree, is_leaf=lambda x: x is None)


def _extreme(values):
    """The number of largest size in each row [n_elem, n_point], with its sign, [n_elem]."""
    at = np.abs(values).argmax(axis=1)
    return np.take_along_axis(values, at[:, None], axis=1)[:, 0]
