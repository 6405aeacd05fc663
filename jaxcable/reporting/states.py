"""The states that count in the envelopes of a report: ends of phases, or cases."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from ..analysis.results import Results
from ..analysis.solution import Solution
from ..common import status
from ..model.supports import FixedDofs


class EnvelopeState(NamedTuple):
    """A state that counts in envelopes: the end of a phase, or of a load case.

    Attributes:
        result: `State` (the last converged one), `PhaseResult` or `Solution`.
        fixed: degrees of freedom that supports fix in this state.
    """

    result: Results
    fixed: FixedDofs


def last_state(solution: Solution) -> EnvelopeState:
    """Return the last converged state of an analysis as an `EnvelopeState`."""
    return EnvelopeState(solution.last, solution.last.fixed[int(solution.last.phase) + 1])


def check_phase_names(solution: Solution, names: Sequence[str] | None) -> list[str]:
    """Return the names of all phases, a list; "phase 1" and so on if `names` is None.

    Raises:
        ValueError: a wrong number of names, or a name that occurs twice.
    """
    return _checked_names(names, len(solution.phases), "phase", 1)


def converged_phases(
    solution: Solution, names: Sequence[str] | None
) -> tuple[dict[str, EnvelopeState], dict[str, int]]:
    """Return the ends of the converged phases, and the status codes of the others, by name.

    Raises:
        ValueError: a wrong number of names, or a name that occurs twice.
    """
    names, phases = check_phase_names(solution, names), list(solution.phases)
    codes = [int(phase.status) for phase in phases]
    ends = [EnvelopeState(phase, solution.last.fixed[k]) for k, phase in enumerate(phases, 1)]
    return _separate_failed(names, codes, ends)


def converged_cases(
    cases: Solution, names: Sequence[str] | None
) -> tuple[dict[str, Solution], dict[str, int]]:
    """Return the converged load cases, and the status codes of the others, by name: two dicts.

    Args:
        cases: `Solution` with a leading axis [n_case].
        names: names of the cases; None for "case 0" and so on.

    Raises:
        ValueError: no leading axis of cases; a wrong number of names, or a name that occurs twice.
    """
    codes = np.asarray(cases.status)
    if codes.ndim != 1:
        raise ValueError(f"cases: expected a leading axis [n_case], got shape {codes.shape}")
    names = _checked_names(names, len(codes), "case", 0)
    cases = jax.tree.map(np.asarray, cases)
    each = [jax.tree.map(lambda x, k=k: x[k], cases) for k in range(len(codes))]
    return _separate_failed(names, codes.tolist(), each)


def _separate_failed(names, codes, results):
    """Return the results with status OK, and the status codes of the others: two dicts by name."""
    good, failed = {}, {}
    for name, code, result in zip(names, codes, results, strict=True):
        if code == status.OK:
            good[name] = result
        else:
            failed[name] = code
    return good, failed


def _checked_names(names, count, kind, first):
    """Return the names of cases or phases, a list; ValueError for a wrong number of names.

    Without names they are "case 0" or "phase 1" and so on, by `kind` and the number of the `first`.
    """
    if names is None:
        return [f"{kind} {k}" for k in range(first, first + count)]
    names = list(map(str, names))
    if len(names) != count:
        raise ValueError(f"names: {len(names)} of them, but {count} {kind}s")
    if len({*names, "end"}) <= len(names):
        raise ValueError(f'names: each {kind} needs a name of its own, other than "end"')
    return names


def envelope_states_of_cases(cases: dict[str, Solution]) -> dict[str, EnvelopeState]:
    """Return the end of each converged load case as an `EnvelopeState`, by name."""
    return {name: EnvelopeState(case, case.last.fixed[-1]) for name, case in cases.items()}
