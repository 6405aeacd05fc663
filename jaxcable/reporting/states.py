"""The states that count in the envelopes of a report: ends of phases, or cases."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from ..analysis import solution as results
from ..analysis.results import Results
from ..common import status
from ..model.supports import Fixed


class State(NamedTuple):
    """A state that counts in envelopes: the end of a phase, or a case.

    Attributes:
        result: `State`, `PhaseResult` or `Solution`.
        fixed: freedoms that supports hold in this state.
    """

    result: Results
    fixed: Fixed


def last_of(solution: results.Solution) -> State:
    """The last converged state."""
    return State(solution.last, solution.last.fixed[int(solution.last.phase) + 1])


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
    names, phases = phase_names(solution, names), list(solution.phases)
    codes = [int(phase.status) for phase in phases]
    return _apart(names, codes, lambda k: State(phases[k], solution.last.fixed[k + 1]))


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
    return _apart(names, codes.tolist(), lambda k: jax.tree.map(lambda x: x[k], cases))


def _apart(names, codes, of):
    """What `of` makes of the numbers of those that have converged, and codes of others, by name."""
    coded = dict(zip(names, codes, strict=True))
    good = {name: of(k) for k, name in enumerate(names) if codes[k] == status.OK}
    return good, {name: code for name, code in coded.items() if code != status.OK}


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
    return {name: State(case, case.last.fixed[-1]) for name, case in cases.items()}
