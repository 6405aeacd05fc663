"""The phase from whose beginning displacements count, of phases and of cases after them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..analysis.solution import Solution

LAST_PHASE = "last phase"
"""The last phase of an analysis: of a case the case itself."""


def begin_at_end(cases: Solution, solution: Solution) -> bool:
    """Return whether cases, [n_case], begin at the end of `solution`, rather than at its start."""
    before = np.nan_to_num(np.asarray(cases.phases.moved_before)[..., 0, :, :])  # NaN: failed
    return bool(before.any()) or not np.any(solution.displacement)


def reference_phase(
    since: int | str,
    labels: Sequence[str],
    solution: Solution,
    cases: Solution | None = None,
) -> int:
    """Return the index of the phase from whose beginning displacements count.

    Args:
        since: index of a phase of `solution`, its name among `labels`, or "last phase": of cases
            that begin at the end of `solution` the phase of these. It is theirs, too, if `since`
            is the only phase of `solution`: since its beginning there is the whole displacement.
        labels: names of the phases of `solution`.
        solution: `Solution`.
        cases: `Solution` of cases, [n_case], or None.

    Returns:
        The index, from 0; the number of labels for the phase of cases that begin after them.

    Raises:
        ValueError: there is no such phase.
    """
    count = len(labels)
    after = count if cases is not None and begin_at_end(cases, solution) else count - 1
    if isinstance(since, str) and since in labels:
        found = list(labels).index(since)
    elif since == LAST_PHASE:
        found = after
    elif isinstance(since, int) and not isinstance(since, bool) and -count <= since < count:
        found = since % count
    else:
        names = ", ".join(map(repr, [*labels, LAST_PHASE]))
        raise ValueError(
            f"since = {since!r}: no such phase; give 0 to {count - 1}, or one of {names}"
        )
    return after if count == 1 else found


def reference_words(phase: int, heads: Sequence[str]) -> str:
    """Return from where displacements count: "the beginning of phase 2, wind", or an end.

    `phase` is that of `reference_phase`, and `heads` say what the phases are called.
    """
    if phase == len(heads):
        return f"the end of {heads[-1]}"
    return f"the beginning of {heads[phase]}"
