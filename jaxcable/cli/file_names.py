"""Names of files that a command derives from another name: tables of a CSV, pictures of a scene.

The user has not given these names, so that a file of somebody else may be there. It is replaced
only if this program has written it, which the first line of a table shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from .guard import BadInput

RESULT = {
    "nodes": "node,support,x (",
    "elements": "group,element,first,last,",
    "increments": "phase,increment,load_factor,status,",
}
"""Tables of a result (`files.save_result`) by name, and how the first line of each begins.

A text that ends with a comma or a bracket is the beginning of a line in which a unit follows, any
other one the whole line."""

_FORCES = "group,element,first,last,at first ("
REPORT: dict[str, str | tuple[str, ...]] = {
    "summary": "of,note",
    "geometry": "node,x (",
    "properties": "group,kind,elements,EA (",
    "phases": "phase,name,what,text,sum Fx (",
    "displacements": ("node,phase,ux (", "node,case,ux ("),
    "displacement_envelope": "node,min ux (",
    "groups": "group,elements,lowest (",
    "reactions": ("node,Rx (", "node,by,Rx ("),
    "reaction_envelope": ("node,extreme,", "node,by,extreme,"),
    "actions": "action,kind,acts,sum Fx (",
    "combinations": "combination,limit state,actions,status,named,sum Rx (",
    "equilibrium": "of,x (",
    "rotations": ("node,phase,rx (", "node,case,rx ("),
    "tilts": "group,element,first,last,tilt (",
    "sags": "group,element,first,last,span (",
    "members": "group,element,first,last,force (",
    **dict.fromkeys(("N", "Vy", "Vz", "T", "My", "Mz"), _FORCES),
    "stresses": "group,element,lowest (",
    "stress_envelope": "group,element,lowest (",
    "cutting_list": "group,element,first,last,unstressed length (",
    "cables": "group,cable,elements,first,last,unstressed length (",
    "slack": "group,element,in",
    "loose": "node,in",
    "energy": "phase,",
    "forces_by_phase": "group,element,first,last,",
    "reactions_by_phase": "node,phase,Rx (",
    "displacements_by_phase": "node,phase,ux (",
}
"""Tables of a report (`reporting.Report.save`), likewise."""


def path_beside(path: str, suffix: str) -> Path:
    """Return the path of a file beside a scene, with the same name and another suffix.

    Raises:
        BadInput: the path has no file name, as "." has none.
    """
    try:
        return Path(path).with_suffix(suffix)
    except ValueError:
        raise BadInput(f"{path or 'scene'}: is not the name of a file") from None


def files_to_write(path: str | None, tables: Mapping[str, str | tuple[str, ...]]) -> list[Path]:
    """Return the files that are written for a path: itself, or of a CSV path one for each table.

    Args:
        path: path on the command line; None writes no file.
        tables: `RESULT` or `REPORT`, dicts from the name of a table to how its first line begins,
            or to several ways.

    Raises:
        BadInput: a table would replace a file that this program has not written.
    """
    if path is None:
        return []
    named = Path(path)
    if named.suffix.lower() != ".csv":
        return [named]
    found = {name: named.with_name(f"{named.stem}-{name}.csv") for name in tables}
    for name, file in found.items():
        if file.is_file() and not _was_written_by_jaxcable(file, tables[name]):
            raise BadInput(
                f"{file}: exists and was not written by jaxcable; {path} would replace it: give "
                "another name"
            )
    return list(found.values())


def _was_written_by_jaxcable(path, line_starts):
    """Return whether the first line of a file is that of a table of this program.

    `line_starts` is one text or several, as in `RESULT`.
    """
    with path.open("rb") as stream:
        line = stream.readline(10_000).decode("utf-8", "replace").rstrip("\r\n")
    starts = [line_starts] if isinstance(line_starts, str) else line_starts
    return any(
        line.startswith(start) and " (" in line if start.endswith((",", "(")) else line == start
        for start in starts
    )
