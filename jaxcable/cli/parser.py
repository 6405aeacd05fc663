"""The commands and their options; `main` runs one of them.

`options.toml` beside this module has the options of each command, and says what is in it.
"""

from __future__ import annotations

import argparse
import functools
import importlib
import re
import sys
import tomllib
from collections.abc import Callable, Sequence
from importlib import metadata, resources
from pathlib import Path
from typing import Any

from .. import linear
from . import (
    convert,
    demo,
    form,
    info,
    line,
    mast,
    new,
    optimize,
    plot,
    schema,
    settings,
    solve,
    view,
)
from .guard import BadInput, run_guarded
from .option_values import parse_any, parse_positive, whole_number_up_to

_NEGATIVE = re.compile(r"^-(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
"""Negative numbers, which are no options; Python's own pattern has no exponents (-4e3)."""

_EXAMPLES = {
    new: "bridge --save my_bridge.json",
    info: "net.json",
    solve: "net.json --plot net.png --save result.json --save net.vtk --report net.txt",
    plot: "mast.json --of My --save moments.pdf",
    view: "net.json --save net.html",
    form: "net.json --force-density 50 --save formed.json",
    optimize: "net.json --deflection 0.03 --lowest 80 --bounds 0 5000 --save tuned.json",
    line: "section.csv --states states.csv --conductor Drake --parameter 1500 --report line.pdf",
    mast: "mast.json --report mast.pdf --plot mast.png",
    convert: "net.obj --scale 0.001 --anchors ends --axial-stiffness 1e6 --save net.json",
    schema: "--save scene.schema.json",
    demo: "--plot hypar.png",
}
"""The commands, modules of this room, in the order of the help, and an example of each."""
_CHOICES: dict[str, Callable[[], Sequence[str]]] = {
    "kinds of scenes": lambda: list(new.KINDS),
    "solvers": linear.selectable_solver_names,
}
"""Lists of choices that options can name."""

_STATUS = (
    "exit status: 0 done, 1 the analysis failed, 2 bad input, 3 checks not passed,\n"
    "130 interrupted (Ctrl-C)"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return the exit status.

    Args:
        arguments: words after the name of the program; None for those of this process. If another
            program gives arguments, its settings are restored at the end.
    """
    options = parser().parse_args(arguments)
    with settings.command_settings(whole_process=arguments is None):
        return run_guarded(_import_user_modules_and_run, options)


def _import_user_modules_and_run(options):
    """Import the user's modules (--import), which register classes, and run the command."""
    sys.path.insert(0, str(Path.cwd()))  # where scripts, unlike `python -m`, do not look
    try:
        for name in options.modules:
            importlib.import_module(name)
    except ImportError as error:
        raise BadInput(f"--import: {error}") from None
    finally:
        sys.path.remove(str(Path.cwd()))
    return options.run(options)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line, with all commands."""
    top = argparse.ArgumentParser(
        prog="jaxcable",
        description="Prestressed cable structures: form, analysis in phases, prestress. SI units,\n"
        'or those that a scene states: {"units": "kN, m", ...}. Options have those of the scene.\n'
        "A scene is a JSON file with a structure and its phases; `jaxcable new net` writes one,\n"
        "with comments, to begin with. `jaxcable COMMAND --help` explains a command.",
        epilog=f"example: jaxcable solve net.json --plot net.png --report\n{_STATUS}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    version = f"jaxcable {metadata.version('jaxcable')}"
    top.add_argument("--version", action="version", version=version)
    commands = top.add_subparsers(
        title="commands", dest="command", required=True, metavar="COMMAND"
    )
    for module, example in _EXAMPLES.items():
        _add_command(commands, module, example)
    return top


def _add_command(commands, module, example):
    """Add the command of a module with its options.

    Its help is the first paragraph of the docstring of the module, and `example` is what follows
    the name of the command in an example.
    """
    name = module.__name__.split(".")[-1]
    text = " ".join((module.__doc__ or "").split("\n\n")[0].split()).removeprefix(f"``{name}``: ")
    command = commands.add_parser(
        name,
        help=text.removesuffix("."),
        description=text[:1].upper() + text[1:],
        epilog=f"example: jaxcable {name} {example}\n{_STATUS}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=module.run)
    command._negative_number_matcher = _NEGATIVE
    _add_options(command, name, {})
    _add_options(command, "all", {})


@functools.cache
def _stated_options() -> dict[str, list[dict[str, Any]]]:
    """Return the options in `options.toml`, lists of dicts by the name of a command or of a set."""
    return tomllib.loads((resources.files(__package__) / "options.toml").read_text("utf-8"))


def _add_options(command, name, words):
    """Add the options listed under `name` in `options.toml` to the parser of a command.

    `words` replace placeholders in the help texts.
    """
    for stated in _stated_options()[name]:
        if "use" in stated:
            _add_options(command, stated["use"], stated)
            continue
        settings = {key: value for key, value in stated.items() if key != "names"}
        kinds = "; ".join(f"{kind}: {about}" for kind, about in new.KINDS.items())
        settings["help"] = settings["help"].format(kinds=kinds, **words)
        if isinstance(settings.get("metavar"), list):
            settings["metavar"] = tuple(settings["metavar"])  # argparse takes no list
        if "type" in settings:
            settings["type"] = _value_parser(settings["type"])
        if isinstance(choices := settings.get("choices"), str):
            settings["choices"] = _CHOICES[choices]()
        command.add_argument(*stated["names"].split(), **settings)


def _value_parser(words):
    """Return the function that parses values of a kind, such as "a whole number from 0 to 20"."""
    known = {"a number": parse_any, "a positive number": parse_positive}
    whole = words.removeprefix("a whole number from 0 to ")
    return known.get(words) or whole_number_up_to(int(whole))
