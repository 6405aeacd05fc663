"""The sentences of a report on the whole analysis: status, size, phases, what failed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..analysis.solution import Solution, State
from ..common import status
from ..model.result_parts import (
    count_and_names_of_slack_elements,
    named_groups_of,
    present_elements,
)
from ..model.structure import Structure
from ..model.torsional_mechanisms import describe_torsional_mechanisms

_TOLERANCE = 1e-10  # default of `Newton.tol`; a larger residual is explained


def has_no_result(solution: Solution) -> bool:
    """Return whether an analysis has failed before its first increment has converged."""
    return int(solution.status) != status.OK and int(solution.last.phase) < 0


def summary_sentences(
    structure: Structure, solution: Solution, heads: Sequence[str], failed: Mapping[str, int]
) -> list[str]:
    """Return the sentences on status, size, phases and failed cases of an analysis, a list.

    Args:
        structure: `Structure`.
        solution: `Solution`.
        heads: what the sentences call the phases, such as "phase 1, prestress".
        failed: status codes of the phases or cases that have failed, by name.
    """
    code = int(solution.status)
    named = named_groups_of(structure)
    counts = [f"{len(g.links)} {type(g).__name__} {name}".strip() for name, g in named]
    lines = [f"status {code}: {status.describe(code)}"]
    lines.append(f"{structure.n_node} nodes; {', '.join(counts)}")
    for head, phase in zip(heads, solution.phases, strict=True):
        lines.append(_phase_sentence(structure, solution.last, head, phase))
    if has_no_result(solution):
        first = next(h for h, p in zip(heads, solution.phases, strict=True) if int(p.status) != 0)
        return [*lines, f"FAILED: no results: {first} did not converge in its first increment"]
    last = solution.last
    mechanisms = describe_torsional_mechanisms(structure, last.fixed[int(last.phase) + 1])
    lines += [f"NOT HELD, though counted as stable: {sentence}" for sentence, _ in mechanisms]
    if code != status.OK:
        lines.append(
            "FAILED: what follows is the last converged state, "
            f"{heads[max(int(last.phase), 0)]}, load factor {float(last.load_factor):.6g}"
        )
    for other in dict.fromkeys(failed.values()):
        names = ", ".join(name for name, cause in failed.items() if cause == other)
        why = f"status {other}" if other == code else f"status {other}: {status.describe(other)}"
        lines.append(f"left out of envelopes: {names} ({why})")
    return lines


def _phase_sentence(structure, last, head, phase):
    """Return the sentence on a phase: increments, residual, slack cables, activation, stability.

    Args:
        structure: `Structure`.
        last: last `State` of the solution.
        head: begin of the sentence, "phase 1".
        phase: `PhaseResult`.
    """
    path = phase.path
    good = np.asarray(path.status) == status.OK
    text = f"{head}: {int(good.sum())} of {good.size} increments converged"
    if good.any():
        k = np.flatnonzero(good)[-1]
        count, names = int(np.asarray(path.n_slack)[k]), ""
        if int(phase.status) == status.OK:  # those without tension: as in the table of them
            count, names = count_and_names_of_slack_elements(structure, phase)
        slack = f"{count or 'no'} slack cable{'s' * (count != 1)}"
        if any(group.compression_only for group in structure.groups):
            slack = f"{count or 'no'} slack cables or open contacts"
        slack += f" ({names})" * bool(names)
        loose = int(np.asarray(path.n_loose)[k])
        if loose > 0:
            nodes, have = ("node", "has") if loose == 1 else ("nodes", "have")
            slack += f", {loose} {nodes} that nothing else holds and that {have} no definite place"
        relative = float(np.asarray(path.relative_residual)[k])
        residual, rounding = np.asarray(path.residual)[k], np.asarray(path.rounding)[k]
        by_rounding = relative > _TOLERANCE and bool(residual <= rounding)
        text += f", relative residual {relative:.1e}{' (limited by rounding)' * by_rounding}"
        text += f"; {slack}"
    if int(phase.status) != status.OK:
        return text
    if phase.present is not None:
        masks = present_elements(structure, phase.present)
        text += f"; {sum(int(m.sum()) for m in masks)} of {sum(map(len, masks))} elements active"
    if not bool(phase.stable):
        text += "; UNSTABLE at its end: tangent stiffness with an eigenvalue below zero, or of zero"
        if _tangent_may_be_unsymmetric(structure, last):
            text += " of its symmetric part (the state may be stable all the same: moments, "
            text += "follower loads or unsymmetric elements act)"
    return text


def _tangent_may_be_unsymmetric(structure: Structure, last: State) -> bool:
    """Return whether nodal moments, follower loads or elements can make the tangent unsymmetric.

    Stability is then judged by its symmetric part, whose negative eigenvalue proves no instability.
    """
    moments = np.asarray(last.restart.nodal_load)[:, 3:]
    follows = any(stack.follows for stack in last.restart.loads)
    return follows or bool(moments.any()) or not all(g.symmetric for g in structure.groups)
