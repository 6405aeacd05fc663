"""``line``: string a section of an overhead line, analyse its states, report tables, clearances and
loads on towers.
"""

from __future__ import annotations

from argparse import Namespace

from .. import lines
from ..common import status
from . import outputs
from .guard import FAILED, BadInput, refuse_value_errors


def run(options: Namespace) -> int | None:
    """Study the line in `options.line`, print what governs and its sags, and write the files."""
    inputs = [options.line, options.states, options.ground, options.crossings]
    outputs.check_study_files(options, (".dxf", ".json"), inputs)
    with refuse_value_errors(options.line):
        line = lines.load_line(
            options.line,
            states=options.states,
            ground=options.ground,
            crossings=options.crossings,
            conductor_name=options.conductor,
            stringing=_stringing(options),
        )
        if not line.states:
            raise BadInput(f"{options.line}: no states; give some in the file or by --states")
        study = lines.study_line(line)
    wrote = []
    if options.save is not None and options.save.lower().endswith(".json"):
        wrote.append(lines.save_line(options.save, line))
    elif options.save is not None:
        with refuse_value_errors(options.save):
            wrote.append(
                lines.save_profile(
                    options.save, line.section, study.results, heights=options.heights
                )
            )

    def draw():
        return {"Profile": lines.plot_profile(line.section, study.results)}

    title = f"Line {options.line}"
    outputs.print_study(options, study.report(), title, draw, wrote, shown=("spans",))
    return None if study.status == status.OK else FAILED


def _stringing(options):
    """Return the arguments of `lines.string` that options give; None for those of the file."""
    names = {"parameter": "parameter", "tension": "horizontal_tension", "sag": "sag"}
    given = {
        name: getattr(options, option)
        for option, name in names.items()
        if getattr(options, option) is not None
    }
    if len(given) > 1:
        raise BadInput("--parameter, --tension, --sag: give one of them")
    return {**given, "temperature": options.at} if given else None
