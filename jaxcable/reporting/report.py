"""A report of a result for engineers: as text, as CSV tables, as a dict."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..analysis.phases import Phase
from ..analysis.solution import Solution, State
from ..common import status
from ..common.writing import atomic_write_together
from ..files.results import as_csv
from ..model.parts import groups_by_name, one_case, there
from ..model.structure import Structure
from ..model.topology import require_same
from . import stability, states
from .energies import energy as energies
from .internal_forces import internal_forces
from .lengths import cables, cutting_list
from .members import groups, members
from .own_results import own_results
from .reactions import equilibrium, reactions
from .slackness import loose, slack
from .stresses import stresses
from .surfaces import surfaces
from .table import Table, as_text, finite, headed

_LONG = 30  # number of lines of a table up to which its text shows all of them


@dataclasses.dataclass(frozen=True)
class Report:
    """A report: `text()`, `csv()`, `dict()`, `save(path)`; `report` makes it.

    Attributes:
        status: status code of the analysis.
        summary: sentences on the whole analysis.
        tables: dict from name to `Table`:

            - ``reactions`` and ``equilibrium``: of the supports on the structure, along x, y, z;
            - ``groups``: lowest and highest force of every group, if there are several;
            - ``members``: axial force, utilisation and envelope of every element;
            - ``N``, ``Vy``, ``Vz``, ``T``, ``My``, ``Mz``: section forces of beams, with the signs
              of `section_forces`; without those that are zero everywhere;
            - ``stresses``, ``stress_envelope``: lowest and highest stress of fibres, and of bars
              and cables with an area, at the end and over all converged increments;
            - ``cutting_list``, of all elements; ``cables``, of chains of them, if there are any;
            - ``surfaces``: areas and weights of groups whose elements have faces;
            - ``slack``, ``loose``; ``results``, lowest and highest value of other results that
              elements have, and by the name of each its values in all elements, at all places;
            - ``energy`` if it was asked for.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> written = jc.report(structure, jc.solve(structure, phases))
        >>> written.tables["cutting_list"].rows[0][:2]
        ['', 0]
    """

    status: int
    summary: tuple[str, ...]
    tables: Mapping[str, Table]

    def text(self, rows: int = _LONG) -> str:
        """The report as text; of a table with more than `rows` lines those that govern."""
        parts = ["\n".join(self.summary)]
        parts += [as_text(table, rows) for table in self.tables.values()]
        return "\n\n".join(parts) + "\n"

    def csv(self) -> Mapping[str, str]:
        """Every table as CSV with all digits in SI units, a dict from its name to the text.

        ``summary`` has the sentences on the whole analysis, and the notes of each table.
        """
        sentences = [["of", "note"], *(["all", line] for line in self.summary)]
        sentences += [[name, note] for name, table in self.tables.items() for note in table.notes]
        return {
            "summary": as_csv(sentences),
            **{
                name: as_csv([headed(table), *table.rows])  # None is an empty field
                for name, table in self.tables.items()
            },
        }

    def dict(self) -> Mapping[str, Any]:
        """Everything as dicts, lists, numbers and texts, ready for JSON."""
        tables = {name: dataclasses.asdict(table) for name, table in self.tables.items()}
        for table in tables.values():
            table["rows"] = [[finite(value) for value in row] for row in table["rows"]]
        return {"status": self.status, "summary": list(self.summary), "tables": tables}

    def save(self, path: str | PathLike[str]) -> list[Path]:
        """Write the report: ``.txt``, ``.json``, or ``.csv`` (``name-table.csv`` for each table).

        Returns:
            Paths of the files written, a list.

        Raises:
            ValueError: another suffix. OSError: a file cannot be written.
        """
        path = Path(path)
        suffix = path.suffix.lower()
        if suffix == ".csv":
            texts = {path.with_name(f"{path.stem}-{k}.csv"): v for k, v in self.csv().items()}
        elif suffix == ".json":
            texts = {path: json.dumps(self.dict(), indent=1, allow_nan=False) + "\n"}
        elif suffix == ".txt":
            texts = {path: self.text(rows=10**9)}  # all lines
        else:
            raise ValueError(f"path = {str(path)!r}: expected a name with .txt, .csv or .json")
        with atomic_write_together() as begin:
            for name, text in texts.items():
                begin(name).write(text)
        return list(texts)

    def __str__(self) -> str:
        return self.text()


def report(
    structure: Structure,
    solution: Solution,
    phases: Phase | Sequence[Phase] | None = None,
    *,
    cases: Solution | None = None,
    names: Sequence[str] | None = None,
    buckling: bool | Solution | State = False,
    energy: bool | Solution | State = False,
) -> Report:
    """Report a result: reactions, section forces and stresses with envelopes, lengths to cut.

    Args:
        structure: `Structure` that was analysed.
        solution: its `Solution`; if it has failed, the report is on the last converged state, and
            says so.
        phases: the phases of the analysis, as many as the solution has; only `energy` needs them.

    Options:
        cases: `Solution` with a leading axis [n_case], as from `design.solve_cases`, for envelopes
            over these cases, in which `solution` itself does not count; default: envelopes over the
            ends of the phases. Failed cases are named and left out.
        names: names of the cases, default "case 0", "case 1" and so on; without cases those of the
            phases, default "phase 1", "phase 2" and so on.
        buckling: True to add to the summary the factor on its loads at which the state would buckle
            (`stiffness.buckling_factor`, an eigenproblem); or the `Solution` or `State` of the
            prestress, to which the factor does not apply.
        energy: True to add the balance of work and energy of every phase (`energy_balance`; it
            compiles another program, which takes a second for nets and some for beams); or the
            `Solution` or `State` from which the analysis started. It needs `phases`, and is refused
            where they add or remove elements.

    Returns:
        `Report`; `Report` has its tables. Forces and utilisation in ``members`` are by the largest
        force along an element; compression is compared with strength alone. Reactions act on the
        structure; a component that no support holds has no value. Section forces of beams are given
        at both ends, with the lowest and the highest along the element, and their envelope over the
        ends of phases or the cases; stresses over all converged increments of these, because every
        increment records strains. Elements that are not there have no values. Unstressed lengths
        are at the temperature before the first phase.

    Raises:
        ValueError: `solution` is no `Solution`, a batch, or belongs to another structure; another
            number of names than of cases or phases; errors of `stiffness.buckling_factor` and of
            `energy_balance` if these are asked for.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> print(jc.report(structure, jc.solve(structure, phases)).summary[0])
        status 0: converged

        A beam of 6 m on two supports under 1 kN/m: q L^2 / 8 = 4.5 kN m in the middle:

        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
        >>> ends = jc.restrained([0], "xyz", "x") + jc.restrained([1], "yz")
        >>> beam = jc.Beams([[0, 1]], section=section)
        >>> level = jc.Structure([[0.0, 0.0, 0.0], [6.0, 0.0, 0.0]], beam, supports=ends)
        >>> hung = jc.solve(level, jc.Phase(loads=jc.LineLoads((0.0, 0.0, -1e3))))
        >>> moment = jc.report(level, hung).tables["My"]
        >>> for name, value in zip(moment.columns[6:8], moment.rows[0][6:8]):
        ...     print(name, f"{value:.4g}")
        lowest -4500
        at 0.5

        Work of the prestress and of the loads on four nodes, and the stored energy:

        >>> full = jc.report(structure, jc.solve(structure, phases), phases, energy=True)
        >>> table = full.tables["energy"]
        >>> for name in ("dead", "prestress", "stored", "imbalance"):
        ...     k = table.columns.index(name)
        ...     print(name, *(f"{row[k]:.4f}" for row in table.rows), table.units[k])
        dead 0.0000 0.3576 J
        prestress 0.9779 0.0000 J
        stored 0.9779 0.3574 J
        imbalance 0.0000 0.0003 J
    """
    one_case(solution)
    require_same(structure, solution.last.topology, "solution")
    if phases is not None:
        # type checkers take any other sequence for a single phase here
        phases = list(phases) if isinstance(phases, list | tuple) else [phases]  # type: ignore[list-item]
        if len(phases) != len(solution.phases):
            raise ValueError(
                f"phases: {len(phases)} of them, the solution has {len(solution.phases)}; give "
                "those of this analysis, without those that it was started from"
            )
    balanced = energy is not False and energy is not None
    if balanced and phases is None:
        raise ValueError("energy: the balance needs the phases of the analysis, too: phases=...")
    state, end = solution.last, states.last_of(solution)
    own_names = names if cases is None else None
    called = states.phase_names(solution, own_names)
    if cases is None:
        good = None
        counted, failed = states.of_phases(solution, names)
    else:
        good, failed = states.each_case(cases, names)
        counted = states.of_cases(good)
    heads = [f"phase {k}" for k in range(1, len(called) + 1)]
    if own_names is not None:
        heads = [f"{head}, {name}" for head, name in zip(heads, called, strict=True)]
    summary = _summary(structure, solution, failed, heads)
    if buckling is not False and buckling is not None:
        reference = None if buckling is True else buckling
        summary.append(stability.buckling(structure, state, reference))
    ended = cases is None and solution.status == status.OK  # the end is that of the last phase
    every = counted if ended else {"end": end, **counted}
    several = len(every) > 1
    kind = "ends of phases" if cases is None else "cases"
    forces = members(structure, state, counted, several)
    tables = {
        **groups(forces),
        "reactions": reactions(structure, state, end.fixed, counted, several),
        "equilibrium": equilibrium(structure, state),
        "members": forces,
        **internal_forces(structure, end, counted if several else {}, kind),
        **stresses(structure, solution, good, called),
        "cutting_list": cutting_list(structure, solution),
        **cables(structure, solution),
        **surfaces(structure, state),
        "slack": slack(structure, every),
        "loose": loose(structure, every),
        **own_results(structure, state, counted, several),
    }
    if balanced:
        start = None if energy is True else energy
        tables["energy"] = energies(structure, solution, phases, start, own_names)
    return Report(int(solution.status), tuple(summary), tables)


def _summary(structure, solution, failed, heads):
    """Sentences on status, size, phases (with these `heads`) and failed cases, a list."""
    code = int(solution.status)
    groups = groups_by_name(structure)
    counts = [f"{len(g.links)} {type(g).__name__} {n}".strip() for n, g in groups]
    lines = [f"status {code}: {status.describe(code)}"]
    lines.append(f"{structure.n_node} nodes; {', '.join(counts)}")
    for head, phase in zip(heads, solution.phases, strict=True):
        path = phase.path
        good = np.asarray(path.status) == status.OK
        text = f"{head}: {int(good.sum())} of {good.size} increments converged"
        if good.any():
            k = np.flatnonzero(good)[-1]
            rounding = float(path.rounding[k])
            left = f" (rounding leaves up to {rounding:.1e} N)" if rounding > 0 else ""
            text += (
                f", residual {float(path.residual[k]):.1e} N{left}, "
                f"{float(path.relative_residual[k]):.1e} of the largest nodal force; "
                f"{int(path.n_slack[k])} slack"
            )
        if int(phase.status) == status.OK and phase.present is not None:
            masks = there(structure, phase.present)
            text += f"; {sum(int(m.sum()) for m in masks)} of {sum(map(len, masks))} elements there"
        if int(phase.status) == status.OK and not bool(phase.stable):
            text += (
                "; UNSTABLE at its end: the tangent stiffness has a negative eigenvalue (where "
                "moments, following loads or elements make it unsymmetric, its symmetric part has: "
                "then the state may be stable all the same)"
            )
        lines.append(text)
    if code != status.OK:
        last = solution.last
        lines.append(
            "FAILED: what follows is the last converged state, "
            f"{heads[max(int(last.phase), 0)]}, load factor {float(last.load_factor):.6g}"
        )
    for code in dict.fromkeys(failed.values()):
        names = ", ".join(name for name, cause in failed.items() if cause == code)
        lines.append(f"left out of envelopes: {names} (status {code}: {status.describe(code)})")
    return lines
