"""The class `Report`: tables and sentences on a result, as text, CSV, dicts, and in files."""

from __future__ import annotations

import dataclasses
import datetime
import json
import math
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from ..common import checks
from ..common.units import SI, Units
from ..common.writing import atomic_write_together
from ..files.results import format_csv
from .document import Heading, make_document
from .plain_text import table_text
from .spreadsheet import workbook_bytes
from .table import Table, common_scales, csv_header
from .typesetting import pdf_bytes
from .web_page import page_text

_MOST = 1000  # rows of a table that PDF and HTML show: 15 pages of a report
_LONG = 30  # rows of a table up to which its text shows all of them: half a printed page

SUFFIXES = (".txt", ".json", ".csv", ".xlsx", ".pdf", ".html", ".htm")
"""Suffixes of names of files that `Report.save` writes."""


def require_writer(path: str | PathLike[str]) -> None:
    """Raise ValueError if a report cannot be written: another suffix, or a missing library."""
    libraries = {".xlsx": ("xlsxwriter", "XLSX"), ".pdf": ("typst", "PDF")}
    needed = libraries.get(_kind_of_file(Path(path)))
    if needed is not None:
        checks.import_library(*needed, "reports")


def _kind_of_file(path):
    """Return the suffix of a path in lower case; ValueError if it is none of `SUFFIXES`."""
    kind = path.suffix.lower()
    if kind not in SUFFIXES:
        known = f"{', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
        raise ValueError(f"path = {str(path)!r}: expected a name with {known}")
    return kind


def _finite_or_none(value):
    """Return a value for JSON: None for a number that is not finite, others as they are."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclasses.dataclass(frozen=True)
class Report:
    """Tables and sentences on a result, from `report`; as text, CSV, dicts, or written to files.

    Attributes:
        status: status code of the analysis.
        summary: sentences on the whole analysis.
        tables: dict from name to `Table`; empty if nothing has converged:

            - ``geometry``, ``properties``, ``phases``: what was analysed, if asked for by `model`;
            - ``reactions``: of supports on the structure, along x, y, z; ``equilibrium``: their
              sum, and that of the loads;
            - ``reaction_envelope``: smallest and largest value of every component over cases, with
              the others of the same case;
            - ``checks``, and one table for each of them (``check_`` and its name), if given;
            - ``actions``: what each is; ``combinations`` of them, if they are given;
            - ``groups``: smallest and largest force of every group, if there are several;
            - ``members``: axial force, force / strength and envelope of every element;
            - ``displacements``: of every node that moves, from the start, after every phase (in
              every case), and ``displacement_envelope``; ``displacements_since`` and
              ``displacement_since_envelope`` from the beginning of the phase `since`;
            - ``rotations`` of nodes, from the start, and ``tilts``: tilt and twist of beams and
              bars, in degrees;
            - ``sags``: sag, deflection, lowest point and horizontal tension of catenaries and of
              chains;
            - ``N``, ``Vy``, ``Vz``, ``T``, ``My``, ``Mz``: section forces of beams, with the signs
              of `section_forces`; without those that are zero everywhere;
            - ``stresses``, ``stress_envelope``: smallest and largest stress of fibres, and of bars
              and cables with an area, in the final state and over all load steps;
            - ``cutting_list``, of all elements; ``cables``, of chains of them, if there are any;
            - ``surfaces``: areas and weights of groups whose elements have faces;
            - ``slack``, ``loose``: cables without tension; nodes attached to such cables only; each
              if there are any;
            - ``results``: smallest and largest value of other results that elements have, and by
              the name of each its values in all elements, at all places;
            - ``forces_by_phase``, ``reactions_by_phase``: at the ends of three phases or more, and
              ``displacements_by_phase`` where ``displacements`` is on cases;
            - ``modes``: frequencies, periods and effective masses, if they are given;
            - ``motion_forces``, ``motion_displacements``: extremes of a motion in time, from its
              start, and when they occur, if it is given;
            - ``energy`` if it was asked for.

        units: the `Units` of all tables and sentences that were asked for; None for SI units.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> written = jc.report(structure, jc.solve(structure, phases))
        >>> written.tables["cutting_list"].rows[0][:2]
        ['', 0]
    """

    status: int
    summary: tuple[str, ...]
    tables: Mapping[str, Table]
    units: Units | None = None

    def text(self, rows: int = _LONG) -> str:
        """Return the report as text, with at most `rows` rows of each table.

        Of a longer table these are the rows with the largest values, or the first ones.
        """
        parts = ["\n".join(self.summary)]
        scales = common_scales(list(self.tables.values()), self.units)
        units = self.units or SI
        parts += [table_text(table, rows, scales, units) for table in self.tables.values()]
        return "\n\n".join(parts) + "\n"

    def csv(self) -> Mapping[str, str]:
        """Return every table as CSV with all digits, a dict from its name to the text.

        Numbers are in SI units, or in the `units` that were asked for.

        ``summary`` has the sentences on the whole analysis, and the notes of each table.
        """
        sentences = [["of", "note"], *(["all", line] for line in self.summary)]
        sentences += [[name, note] for name, table in self.tables.items() for note in table.notes]
        return {
            "summary": format_csv(sentences),
            **{
                name: format_csv([csv_header(table), *table.rows])  # None is an empty field
                for name, table in self.tables.items()
            },
        }

    def dict(self) -> Mapping[str, Any]:
        """Return everything as dicts, lists, numbers and texts, ready for JSON."""
        tables = {name: dataclasses.asdict(table) for name, table in self.tables.items()}
        for table in tables.values():
            table["rows"] = [[_finite_or_none(value) for value in row] for row in table["rows"]]
        stated = {} if self.units is None else {"units": self.units.as_dict()}
        return {"status": self.status, **stated, "summary": list(self.summary), "tables": tables}

    def save(
        self,
        path: str | PathLike[str],
        *,
        title: str | None = None,
        author: str | None = None,
        date: str | datetime.date | None = None,
        details: Mapping[str, str] | None = None,
        pictures: Mapping[str, Any] | None = None,
        rows: int | None = None,
    ) -> list[Path]:
        """Write the report to a file, in the format of its suffix, completely or not at all.

        - ``.txt`` is the `text`, ``.json`` the `dict`, ``.csv`` are files ``name-table.csv``.
        - ``.xlsx`` is a workbook with a sheet for each table: numbers with all digits, filters,
          units and notes. It needs XlsxWriter.
        - ``.pdf`` has pages A4 with title, contents, page numbers and headings that are repeated on
          each page; wide tables are in landscape format, or in parts. It needs Typst. ``.html`` is
          the same as one page that asks no other host for anything; a browser prints it.

        ``pip install 'jaxcable[reports]'`` installs XlsxWriter and Typst. The same report gives the
        same bytes.

        Args:
            path: path of the file.

        Options:
            title, author: of the project, on the first page of PDF and HTML, and in a workbook.
            date: of the document there, a text or a date; default: none.
            details: further lines below the title, by their words: ``{"project": "12-345",
                "revision": "A", "checked by": "B. Frey"}``.
            pictures: matplotlib figures by their captions, for PDF and HTML, such as those of
                `plots.for_report`.
            rows: largest number of rows of each table: default all in a text, 1000 in PDF and HTML,
                where a note says that there are more. A table of every case with more rows than
                that is only named there.

        Returns:
            Paths of the files written, a list.

        Raises:
            ValueError: another suffix, a library that is not installed, something else than
                figures, or a number of rows that is not positive. OSError: a file cannot be
                written.

        Example:
            >>> import tempfile, pathlib
            >>> structure, phases = jc.scenes.flat_net(load=15.0)
            >>> written = jc.report(structure, jc.solve(structure, phases), units="kN, m")
            >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.html"
            >>> [path.name for path in written.save(path, title="Net", author="A. Meier")]
            ['net.html']
        """
        path, heading = Path(path), Heading(title, author, date, dict(details or {}))
        if rows is not None:
            checks.require_whole_number(rows, "rows")
        kind = _kind_of_file(path)
        content: Mapping[Path, str | bytes]
        if kind == ".csv":
            content = {path.with_name(f"{path.stem}-{k}.csv"): v for k, v in self.csv().items()}
        elif kind == ".json":
            content = {path: json.dumps(self.dict(), indent=1, allow_nan=False) + "\n"}
        elif kind == ".txt":
            content = {path: self.text(rows=10**9 if rows is None else rows)}
        elif kind == ".xlsx":
            facts = heading.facts(self.units or "SI")
            content = {path: workbook_bytes(self.summary, self.tables, heading, facts)}
        else:
            require_writer(path)
            found = make_document(
                self.summary, self.tables, self.units, heading, pictures or {}, rows or _MOST
            )
            content = {path: pdf_bytes(found) if kind == ".pdf" else page_text(found)}
        with atomic_write_together() as begin:
            for name, own in content.items():
                begin(name, "wb" if isinstance(own, bytes) else "w").write(own)
        return list(content)

    def __str__(self) -> str:
        return self.text()
