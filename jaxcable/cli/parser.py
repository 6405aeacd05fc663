"""The commands and their options; `main` runs one of them."""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from .. import linear
from ..files.reading import number, whole
from . import convert, demo, form, info, new, optimize, plot, schema, settings, solve, view
from .guard import Refused, guarded

_NEGATIVE = re.compile(r"^-(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
"""Negative numbers, which are no options; Python's own pattern has no exponents (-4e3)."""

_STATUS = "exit status: 0 done, 1 the analysis failed, 2 bad input, 130 interrupted (Ctrl-C)"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status.

    Args:
        arguments: words after the name of the program; None for those that this process was started
            with. It is the command's own then, and keeps the flag of XLA that fuses loops. Where
            another program gives arguments, all of its settings are as before at the end.
    """
    options = parser().parse_args(arguments)
    with settings.of_command(options.quiet, whole_process=arguments is None):
        return guarded(_run, options)


def _run(options):
    """Import the modules of the user's own classes that `options` name, then run the command."""
    sys.path.insert(0, str(Path.cwd()))  # where scripts, unlike `python -m`, do not look
    try:
        for name in options.modules:
            importlib.import_module(name)
    except ImportError as error:
        raise Refused(f"--import: {error}") from None
    finally:
        sys.path.remove(str(Path.cwd()))
    return options.run(options)


def parser() -> argparse.ArgumentParser:
    """The parser of the command line, with all commands."""
    top = argparse.ArgumentParser(
        prog="jaxcable",
        description="Prestressed cable structures: form, analysis in phases, prestress. SI units.\n"
        "A scene is a JSON file with a structure and its phases: `jaxcable new net` writes one to\n"
        "begin with, which explains itself. `jaxcable COMMAND --help` explains a command.",
        epilog=f"example: jaxcable solve net.json --plot net.png --report\n{_STATUS}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    version = f"jaxcable {metadata.version('jaxcable')}"
    top.add_argument("--version", action="version", version=version)
    commands = top.add_subparsers(
        title="commands", dest="command", required=True, metavar="COMMAND"
    )
    _new(commands)
    _info(commands)
    _solve(commands)
    _plot(commands)
    _view(commands)
    _form(commands)
    _optimize(commands)
    _convert(commands)
    _schema(commands)
    _demo(commands)
    for command in commands.choices.values():
        _flag(command, "--quiet", "print errors only: no results, no warnings, no progress")
        text = "module to run first, installed or in this folder, that registers your own classes"
        command.add_argument(
            "--import", dest="modules", action="append", default=[], metavar="MODULE", help=text
        )
    return top


def _command(commands, module, example):
    """Add the command of a module, whose docstring begins with the help, and return its parser."""
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
    return command


def _saves(command, text, **settings):
    """Add the option that names the file to write."""
    command.add_argument("--save", metavar="FILE", help=text, **settings)


def _flag(command, name, text):
    """Add an option without a value."""
    command.add_argument(name, action="store_true", help=text)


def _reads(command, scene=True):
    """Add the arguments of a command that reads a scene, or else a scene or a net."""
    if scene:
        text = "scene, JSON (written by save_scene or by hand; `jaxcable schema` describes it)"
        command.add_argument("scene", help=text)
    else:
        text = (
            "scene (.json), net of compas or jax_fdm (.json), .obj, .dxf, or two .csv: nodes, links"
        )
        command.add_argument("files", nargs="+", metavar="file", help=text)
        text = (
            "metres per unit of an OBJ file (default 1) or DXF file (default: its own unit); of "
            "the drawing if one is made of a scene (default 1)"
        )
        command.add_argument("--scale", type=_positive, metavar="S", help=text)
        text = "of DXF and OBJ: largest distance of points that become one node, m (default 1e-6)"
        command.add_argument("--tol", type=_positive, metavar="D", help=text)
        text = 'of a DXF file: layer whose points are supports, "*" for all points'
        command.add_argument("--supports", metavar="LAYER", help=text)
        text = "of a DXF file: largest distance of arcs from chords in their place, m"
        command.add_argument("--sagitta", type=_positive, metavar="D", help=text)
        text = "of a DXF file: read layers that are off or frozen, and invisible entities, too"
        _flag(command, "--hidden", text)
        text = (
            "of CSV tables: what the files call the columns node, x, y, z, support, fx, first, "
            "last, kind, group and others, as x=X_COORD support=Fixed; free=NAME for a column in "
            "which 1 means free"
        )
        command.add_argument("--columns", nargs="+", metavar="COLUMN=NAME", help=text)
        text = "make nodes where links cross in plan or touch, of these groups (default: of all)"
        command.add_argument("--split", nargs="*", metavar="GROUP", help=text)
    text = "largest file that is read, MB (default 64)"
    command.add_argument("--largest", type=_positive, default=64.0, metavar="MB", help=text)


def _new(commands):
    command = _command(commands, new, "bridge --save my_bridge.json")
    text = "; ".join(f"{kind}: {about}" for kind, about in new.KINDS.items())
    command.add_argument("kind", choices=new.KINDS, help=text)
    text = "scene to write (.json; default its kind, in this folder); the script lies beside it"
    _saves(command, text)
    text = "replace files that exist; otherwise the command writes nothing and ends with 2"
    _flag(command, "--force", text)


def _demo(commands):
    command = _command(commands, demo, "--plot hypar.png")
    text = "picture to write (png, pdf, svg; default hypar_net.png)"
    command.add_argument("--plot", metavar="FILE", help=text)


def _solve(commands):
    example = "net.json --plot net.png --save result.json --save net.vtk --report net.txt"
    command = _command(commands, solve, example)
    _reads(command)
    command.add_argument("--plot", metavar="FILE", help="picture to write (png, pdf, svg)")
    text = (
        "result: .json, .npz, .csv (tables), .vtk (ParaView), .py (OpenSees), .dxf, .compas.json; "
        "can be repeated"
    )
    _saves(command, text, action="append", default=[])
    text = "report: reactions, forces, cutting list; a .txt, .csv or .json file, or on the screen"
    command.add_argument("--report", metavar="FILE", nargs="?", const="-", help=text)
    text = "relative residual of the equilibrium (default 1e-10; 1e-5 in float32)"
    command.add_argument("--tol", type=_positive, help=text)
    text = "increments with this many corrections instead of equilibrium iterations"
    command.add_argument("--corrections", type=_up_to(20), metavar="N", help=text)
    text = "default: by size"
    command.add_argument("--linear-solver", choices=linear.selectable_solver_names(), help=text)


def _plot(commands):
    command = _command(commands, plot, "mast.json --of My --save moments.pdf")
    _reads(command)
    text = "picture to write (png, pdf, svg; default: beside the scene, with its name, .png)"
    _saves(command, text)
    text = (
        "what to draw: tension (default), utilisation (force over strength) or another result as "
        "colours; N, Vy, Vz, T, My, Mz as a diagram on beams"
    )
    command.add_argument("--of", default="tension", metavar="RESULT", help=text)
    text = "default: by the shape of the structure"
    command.add_argument("--view", choices=("plan", "elevation", "space"), help=text)
    _flag(command, "--sequence", "the end of every phase, beside each other")
    text = "factor on displacements (default 1), not of diagrams"
    command.add_argument("--magnify", type=_positive, metavar="X", help=text)
    _flag(command, "--reactions", "draw the reactions of supports, too")


def _view(commands):
    command = _command(commands, view, "net.json --save net.html")
    _reads(command)
    _saves(command, "page to write (default: the name of the scene, .html, in this folder)")
    _flag(command, "--no-open", "write the page, open no browser")


def _form(commands):
    command = _command(commands, form, "net.json --force-density 50 --save formed.json")
    _reads(command)
    method = command.add_mutually_exclusive_group()
    text = (
        "force density, N/m: a number, or group=number for each group (default: what the first "
        "phase with force densities states)"
    )
    method.add_argument("--force-density", nargs="+", metavar="Q", help=text)
    text = "tension of all cables in the form, N; likewise"
    method.add_argument("--tension", nargs="+", metavar="T", help=text)
    text = (
        "length in the form of groups without force density or tension, as masts and guys: "
        "group=drawn for that in the scene, or group=number, m; their forces are found"
    )
    command.add_argument("--length", nargs="+", metavar="L", help=text)
    text = (
        "phases whose loads act in the form, from 1, or none (default: the first phase that has "
        "loads)"
    )
    command.add_argument("--loads", nargs="+", metavar="PHASE", help=text)
    _saves(command, "scene to write (.json)")


def _optimize(commands):
    example = "net.json --deflection 0.03 --lowest 80 --bounds 0 5000 --save tuned.json"
    command = _command(commands, optimize, example)
    _reads(command)
    text = "tension that all elements shall have at the end, N (least squares)"
    command.add_argument("--target", type=number, metavar="T", help=text)
    text = "least pretension with which no node of the last phase moves more than this, m"
    command.add_argument("--deflection", type=_positive, metavar="D", help=text)
    text = "least pretension with which no tension at the end is lower than this, N"
    command.add_argument("--lowest", type=_positive, metavar="T", help=text)
    text = "least and greatest pretension, N (default 0 and no limit)"
    names, whole_range = ("LOW", "HIGH"), (0.0, float("inf"))
    command.add_argument(
        "--bounds", type=number, nargs=2, metavar=names, default=whole_range, help=text
    )
    _flag(command, "--one", "one pretension for each group of elements")
    text = "steps of the search at most (default 100)"
    command.add_argument("--steps", type=_up_to(100_000), default=100, metavar="N", help=text)
    _saves(command, "scene to write (.json), if the search comes to its end")
    text = "write the best scene found even if the search does not come to its end (exit status 1)"
    _flag(command, "--keep", text)


def _info(commands):
    _reads(_command(commands, info, "net.json"), scene=False)


def _convert(commands):
    example = "net.obj --scale 0.001 --anchors ends --axial-stiffness 1e6 --save net.json"
    command = _command(commands, convert, example)
    _reads(command, scene=False)
    text = 'supported nodes: numbers, ranges as 5-8, "ends" (nodes with one link), or both'
    command.add_argument("--anchors", nargs="+", metavar="NODE", help=text)
    for name, unit in (
        ("axial-stiffness", "EA, N"),
        ("weight", "N/m"),
        ("strength", "N"),
        ("expansion", "1/K"),
        ("pretension", "N"),
        ("force-density", "N/m"),
    ):
        text = f"{unit}, where the file gives none: a number, or group=number for each group"
        command.add_argument(f"--{name}", nargs="+", metavar="X", help=text)
    text = "groups that are bars, such as masts"
    command.add_argument("--bars", nargs="+", metavar="GROUP", default=(), help=text)
    text = "scene to write (.json), or of a scene or net: a drawing (.dxf), a graph (.compas.json)"
    _saves(command, text, required=True)


def _schema(commands):
    command = _command(commands, schema, "--save scene.schema.json")
    _saves(command, "file to write instead (.json)")


def _positive(word):
    """A positive number."""
    value = number(word)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{word}: expected a positive number")
    return value


def _up_to(most):
    """A function that reads a whole number from 0 to `most`."""

    def whole_number(word):
        value = whole(word)
        if not 0 <= value <= most:
            raise argparse.ArgumentTypeError(f"{word}: expected a whole number from 0 to {most}")
        return value

    return whole_number
