"""What a report is on: an analysis, and the states that count in envelopes (phases, or cases)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np

from ..analysis.element_shapes import StateOrPhase
from ..analysis.solution import Solution, State
from ..common import status
from ..common.types import Float
from ..common.units import SI, Units
from ..model.structure import Structure
from ..model.supports import FixedDofs


class EnvelopeState(NamedTuple):
    """A state that counts in envelopes: the end of a phase, or of a load case.

    Attributes:
        result: `State` (the last converged one), `PhaseResult` or `Solution`.
        fixed: degrees of freedom that supports fix in this state.
    """

    result: StateOrPhase
    fixed: FixedDofs


class ReportedAnalysis(NamedTuple):
    """Solution, states and cases from which the tables of a report are made.

    Attributes:
        structure, solution: of the analysis.
        envelope: states of which envelopes take extremes, by name: the ends of the converged
            phases, or of the converged cases.
        cases: `Solution` of every converged case, by name; None for envelopes over phases.
        phase_names: names of all phases.
        units: `Units` of numbers in notes; tables are in SI units.
    """

    structure: Structure
    solution: Solution
    envelope: Mapping[str, EnvelopeState]
    cases: Mapping[str, Solution] | None
    phase_names: Sequence[str]
    units: Units = SI

    @property
    def state(self) -> State:
        """The final state, which is the last converged one."""
        return self.solution.last

    @property
    def end(self) -> EnvelopeState:
        """The final state, with the degrees of freedom that supports hold in it."""
        last = self.solution.last
        return EnvelopeState(last, last.fixed[int(last.phase) + 1])

    @property
    def every(self) -> Mapping[str, EnvelopeState]:
        """States of the envelope by name, and the final one as "end" if it is none of them."""
        is_last_phase = self.cases is None and int(self.solution.status) == status.OK
        return self.envelope if is_last_phase else {"end": self.end, **self.envelope}

    @property
    def several(self) -> bool:
        """Whether there are other states than the final one, so that envelopes are of use."""
        return len(self.every) > 1

    @property
    def kind(self) -> str:
        """Kind of the states of the envelope: "phase" or "case"."""
        return "phase" if self.cases is None else "case"

    @property
    def name_of_states(self) -> str:
        """Name of the states of the envelope: "ends of phases" or "cases"."""
        return "ends of phases" if self.cases is None else "cases"

    def values(
        self, function: Callable[[StateOrPhase], Float[np.ndarray, " n"]]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n_state n"]]:
        """Evaluate a function of a state in the final state and in those of the envelope.

        Returns arrays [n] and [n_state, n].
        """
        final = function(self.state)
        each = [function(state.result) for state in self.envelope.values()]
        return final, np.array(each).reshape(len(each), len(final))


def phase_names_or_defaults(solution: Solution, names: Sequence[str] | None) -> list[str]:
    """Return the names of all phases, a list; "phase 1" and so on if `names` is None.

    Raises:
        ValueError: a wrong number of names, or a name that occurs twice.
    """
    return _names_or_defaults(names, len(solution.phases), "phase", 1)


def converged_phases(
    solution: Solution, names: Sequence[str]
) -> tuple[dict[str, EnvelopeState], dict[str, int]]:
    """Return the ends of the converged phases, and the status codes of the others, by name."""
    codes = [int(phase.status) for phase in solution.phases]
    pairs = zip(solution.phases, solution.last.fixed[1:], strict=True)
    return _separate_failed(names, codes, [EnvelopeState(*pair) for pair in pairs])


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
    names = _names_or_defaults(names, len(codes), "case", 0)
    cases = jax.tree.map(np.asarray, cases)
    each = [jax.tree.map(lambda x, k=k: x[k], cases) for k in range(len(codes))]
    return _separate_failed(names, codes.tolist(), each)


def _separate_failed(names, codes, results):
    """Return results with status OK, and the status codes of the others: two dicts by name."""
    every = list(zip(names, codes, results, strict=True))
    good = {name: result for name, code, result in every if code == status.OK}
    return good, {name: code for name, code, _ in every if code != status.OK}


def _names_or_defaults(names, count, kind, first):
    """Return the names of cases or phases, a list; without names "case 0" or "phase 1" and so on.

    Raise ValueError for another number of names than `count`, and for equal names. `kind` is "case"
    or "phase", and `first` the first number of defaults.
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
