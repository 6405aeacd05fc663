"""Names of files that a command makes from another name: tables beside each other, pictures.

Nobody has named such a file, so that one of somebody else can be there. It is replaced if it is one
that this program has written, which a table shows by its first line.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from .guard import Refused

RESULT = {
    "nodes": "node,support,x (m)",
    "elements": "group,element,first,last,",
    "increments": "phase,increment,load_factor,status,",
}
"""Tables of a result (`files.save_result`) by name, and how the first line of each begins."""

_FORCES = "group,element,first,last,at first ("
REPORT = {
    "summary": "of,note",
    "groups": "group,elements,lowest (N),",
    "reactions": "node,R",
    "equilibrium": "of,x (N),",
    "members": "group,element,first,last,force (N),",
    **dict.fromkeys(("N", "Vy", "Vz", "T", "My", "Mz"), _FORCES),
    "stresses": "group,element,lowest (Pa),",
    "stress_envelope": "group,element,lowest (Pa),",
    "cutting_list": "group,element,first,last,unstressed length (m)",
    "cables": "group,cable,elements,first,last,unstressed length (m)",
    "slack": "group,element,in",
    "loose": "node,in",
    "energy": "phase,",
}
"""Tables of a report (`reporting.Report.save`), likewise."""

_UNITLESS = "summary", "slack", "loose"  # no column has a unit: the whole line must be that


def beside(path: str, suffix: str) -> Path:
    """The path with another suffix, for a file beside that of a scene.

    Raises:
        Refused: the path has no name, as "." has none.
    """
    try:
        return Path(path).with_suffix(suffix)
    except ValueError:
        raise Refused(f"{path or 'scene'}: is no name of a file") from None


def files(path: str | None, tables: Mapping[str, str]) -> list[Path]:
    """Files that are written for a path: itself, or the tables that are made of the name of a CSV.

    Args:
        path: as on the command line; None is no file.
        tables: `RESULT` or `REPORT`.

    Raises:
        Refused: a table would take the place of a file that this program has not written.
    """
    if path is None:
        return []
    named = Path(path)
    if named.suffix.lower() != ".csv":
        return [named]
    found = {name: named.with_name(f"{named.stem}-{name}.csv") for name in tables}
    for name, file in found.items():
        if file.is_file() and not _is_ours(file, tables[name], name in _UNITLESS):
            raise Refused(
                f"{file}: there already, and no table of this program; {path} would replace it: "
                "give another name"
            )
    return list(found.values())


def _is_ours(file, begin, whole):
    """Whether the first line of a file is that of a table, which has columns with units."""
    with file.open("rb") as stream:
        line = stream.readline(10_000).decode("utf-8", "replace").rstrip("\r\n")
    return line == begin if whole else line.startswith(begin) and " (" in line
