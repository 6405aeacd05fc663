"""The states that count in the envelopes of a report: ends of phases, or cases."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from ..analysis import solution as results
from ..common import status
from ..common.types import ArrayLike, Float, PyTree
from ..model.supports import Fixed


class State(NamedTuple):
    """A state that counts in envelopes: the end of a phase, or a case.

    Attributes:
        tension: axial forces in the shape of the elements, N.
        peak_tension: largest force along each element, likewise, N.
        section_forces: of beams, [n_elem, n_point, 6] in the shape of the elements; None without.
        positions: of the nodes, [n_node, 3], m.
        reactions: reactions at all nodes, [n_node, 3], N.
        present: 1 for elements that are there, in the shape of the elements; None if all are.
        fixed: freedoms that supports hold in this state.
    """

    tension: PyTree[Float[ArrayLike, " n_elem"]]
    peak_tension: PyTree[Float[ArrayLike, " n_elem"]]
    section_forces: PyTree[Float[ArrayLike, "n_elem n_point 6"]] | None
    positions: Float[ArrayLike, "n_node 3"]
    reactions: Float[ArrayLike, "n_node 3"]
    present: PyTree[Float[ArrayLike, " n_elem"]] | None
    fixed: Fixed


def state_of(part: Any, fixed: Fixed) -> State:
    """The `State` of a result, such as a phase, under the supports `fixed`."""
    fields = {name: getattr(part, name) for name in State._fields if name != "fixed"}
    return State(**fields, fixed=fixed)


def last_of(solution: results.Solution) -> State:
    """The last converged state."""
    return state_of(solution.last, solution.last.fixed[int(solution.last.phase) + 1])


def phase_names(solution: results.Solution, names: Sequence[str] | None) -> list[str]:
    """The names of all phases; ValueError for a wrong number of names, or names not apart."""
    return _checked(names, len(solution.phases), "phase", 1)


def of_phases(
    solution: results.Solution, names: Sequence[str] | None
) -> tuple[dict[str, State], dict[str, int]]:
    """Ends of phases that have converged, and status codes of the others, dicts by name.

    Raises:
        ValueError: a wrong number of names, or names that are not apart.
    """
    names = phase_names(solution, names)
    good, failed = {}, {}
    pairs = zip(solution.phases, solution.last.fixed[1:], strict=True)
    for name, (phase, fixed) in zip(names, pairs, strict=True):
        code = int(phase.status)
        if code == status.OK:
            good[name] = state_of(phase, fixed)
        else:
            failed[name] = code
    return good, failed


def each_case(
    cases: results.Solution, names: Sequence[str] | None
) -> tuple[dict[str, results.Solution], dict[str, int]]:
    """Cases that have converged, one `Solution` each, and status codes of the others, by name.

    Raises:
        ValueError: no leading axis of cases; a wrong number of names, or names that are not apart.
    """
    codes = np.asarray(cases.status)
    if codes.ndim != 1:
        raise ValueError(f"cases: expected a leading axis [n_case], got shape {codes.shape}")
    names = _checked(names, len(codes), "case", 0)
    cases = jax.tree.map(np.asarray, cases)
    good, failed = {}, {}
    for k, (name, code) in enumerate(zip(names, codes.tolist(), strict=True)):
        if code == status.OK:
            good[name] = jax.tree.map(lambda x, k=k: x[k], cases)
        else:
            failed[name] = code
    return good, failed


def _checked(names, count, kind, first):
    """The names of cases or phases, a list; those by number if there are none."""
    if names is None:
        return [f"{kind} {k}" for k in range(first, first + count)]
    names = list(map(str, names))
    if len(names) != count:
        raise ValueError(f"names: {len(names)} of them, but {count} {kind}s")
    if len({*names, "end"}) <= len(names):
        raise ValueError(f'names: each {kind} needs a name of its own, other than "end"')
    return names


def of_cases(cases: dict[str, results.Solution]) -> dict[str, State]:
    """Ends of cases, a dict by name."""
    return {name: state_of(case, case.last.fixed[-1]) for name, case in cases.items()}
