"""The commands and their options; `main` runs one of them."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from importlib import metadata

from .. import linear
from ..files.reading import number, whole
from . import convert, demo, form, info, new, optimize, plot, schema, settings, solve, view
from .guard import guarded

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
        return guarded(options.run, options)


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
    text = "print errors only: no results, no warnings, no progress"
    for command in commands.choices.values():
        command.add_argument("--quiet", action="store_true", help=text)
    return top


def _command(commands, name, module, help_, example):
    """Add a command and return its parser."""
    command = commands.add_parser(
        name,
        help=help_,
        description=help_[0].upper() + help_[1:] + ".",
        epilog=f"example: jaxcable {name} {example}\n{_STATUS}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=module.run)
    command._negative_number_matcher = _NEGATIVE
    return command


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
        command.add_argument("--hidden", action="store_true", help=text)
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
    text = "write a small scene that explains itself, to begin with, and the same in Python"
    command = _command(commands, "new", new, text, "bridge --save my_bridge.json")
    text = "; ".join(f"{kind}: {about}" for kind, about in new.KINDS.items())
    command.add_argument("kind", choices=new.KINDS, help=text)
    text = "scene to write (.json; default its kind, in this folder); the script lies beside it"
    command.add_argument("--save", metavar="FILE", help=text)
    text = "replace files that exist; otherwise the command writes nothing and ends with 2"
    command.add_argument("--force", action="store_true", help=text)


def _demo(commands):
    text = "the hyperbolic paraboloid net beside the published deflections"
    command = _command(commands, "demo", demo, text, "--plot hypar.png")
    text = "picture to write (png, pdf, svg; default hypar_net.png)"
    command.add_argument("--plot", metavar="FILE", help=text)


def _solve(commands):
    text = "analyse a scene through its phases"
    example = "net.json --plot net.png --save result.json --save net.vtk --report net.txt"
    command = _command(commands, "solve", solve, text, example)
    _reads(command)
    command.add_argument("--plot", metavar="FILE", help="picture to write (png, pdf, svg)")
    text = (
        "result: .json, .npz, .csv (tables), .vtk (ParaView), .py (OpenSees), .dxf, .compas.json; "
        "can be repeated"
    )
    command.add_argument("--save", metavar="FILE", action="append", default=[], help=text)
    text = "report: reactions, forces, cutting list; a .txt, .csv or .json file, or on the screen"
    command.add_argument("--report", metavar="FILE", nargs="?", const="-", help=text)
    text = "relative residual of the equilibrium (default 1e-10; 1e-5 in float32)"
    command.add_argument("--tol", type=_positive, help=text)
    text = "increments with this many corrections instead of equilibrium iterations"
    command.add_argument("--corrections", type=_few, metavar="N", help=text)
    text = "default: by size"
    command.add_argument("--linear-solver", choices=linear.offered(), help=text)


def _plot(commands):
    text = "analyse a scene and draw it, without a report"
    command = _command(commands, "plot", plot, text, "mast.json --of My --save moments.pdf")
    _reads(command)
    text = "picture to write (png, pdf, svg; default: beside the scene, with its name, .png)"
    command.add_argument("--save", metavar="FILE", help=text)
    text = (
        "what to draw: tension (default), utilisation (force over strength) or another result as "
        "colours; N, Vy, Vz, T, My, Mz as a diagram on beams"
    )
    command.add_argument("--of", default="tension", metavar="RESULT", help=text)
    text = "default: by the shape of the structure"
    command.add_argument("--view", choices=("plan", "elevation", "space"), help=text)
    text = "the end of every phase, beside each other"
    command.add_argument("--sequence", action="store_true", help=text)
    text = "factor on displacements (default 1), not of diagrams"
    command.add_argument("--magnify", type=_positive, metavar="X", help=text)
    text = "draw the reactions of supports, too"
    command.add_argument("--reactions", action="store_true", help=text)


def _view(commands):
    text = "analyse a scene and open a page in which it turns, with its phases and results"
    command = _command(commands, "view", view, text, "net.json --save net.html")
    _reads(command)
    text = "page to write (default: the name of the scene, .html, in this folder)"
    command.add_argument("--save", metavar="FILE", help=text)
    command.add_argument("--no-open", action="store_true", help="write the page, open no browser")


def _form(commands):
    text = (
        "find the form of a net of cables and bars under loads of the scene; other phases are kept"
    )
    command = _command(
        commands, "form", form, text, "net.json --force-density 50 --save formed.json"
    )
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
    command.add_argument("--save", metavar="FILE", help="scene to write (.json)")


def _optimize(commands):
    text = "find the pretension for a purpose, with gradients through all phases"
    example = "net.json --deflection 0.03 --lowest 80 --bounds 0 5000 --save tuned.json"
    command = _command(commands, "optimize", optimize, text, example)
    _reads(command)
    text = "tension that all elements shall have at the end, N (least squares)"
    command.add_argument("--target", type=number, metavar="T", help=text)
    text = "least pretension with which no node of the last phase moves more than this, m"
    command.add_argument("--deflection", type=_positive, metavar="D", help=text)
    text = "least pretension with which no tension at the end is lower than this, N"
    command.add_argument("--lowest", type=_positive, metavar="T", help=text)
    text = "least and greatest pretension, N (default 0 and no limit)"
    command.add_argument(
        "--bounds",
        type=number,
        nargs=2,
        metavar=("LOW", "HIGH"),
        default=(0.0, float("inf")),
        help=text,
    )
    command.add_argument(
        "--one", action="store_true", help="one pretension for each group of elements"
    )
    text = "steps of the search at most (default 100)"
    command.add_argument("--steps", type=_count, default=100, metavar="N", help=text)
    text = "scene to write (.json), if the search comes to its end"
    command.add_argument("--save", metavar="FILE", help=text)
    text = "write the best scene found even if the search does not come to its end (exit status 1)"
    command.add_argument("--keep", action="store_true", help=text)


def _info(commands):
    text = "what is in a scene or a net, and whether it is sound"
    _reads(_command(commands, "info", info, text, "net.json"), scene=False)


def _convert(commands):
    text = (
        "make a scene of a net: OBJ, DXF, JSON of compas or jax_fdm, two CSV tables; or a drawing"
    )
    example = "net.obj --scale 0.001 --anchors ends --axial-stiffness 1e6 --save net.json"
    command = _command(commands, "convert", convert, text, example)
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
    command.add_argument("--save", metavar="FILE", required=True, help=text)


def _schema(commands):
    text = "print the JSON Schema of scene files, with which editors explain and check them"
    command = _command(commands, "schema", schema, text, "--save scene.schema.json")
    command.add_argument("--save", metavar="FILE", help="file to write instead (.json)")


def _positive(word):
    """A positive number."""
    value = number(word)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{word}: expected a positive number")
    return value


def _count(word):
    """A number of steps."""
    value = whole(word)
    if not 0 <= value <= 100_000:
        raise argparse.ArgumentTypeError(f"{word}: expected a whole number from 0 to 100000")
    return value


def _few(word):
    """A number of corrections."""
    value = whole(word)
    if not 0 <= value <= 20:
        raise argparse.ArgumentTypeError(f"{word}: expected a whole number from 0 to 20")
    return value
