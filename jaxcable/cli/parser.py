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
from ..files.reading import number
from . import (
    convert,
    demo,
    form,
    info,
    new,
    optimize,
    plot,
    schema,
    settings,
    solve,
    view,
)
from .guard import BadInput, run_guarded
from .option_values import parse_positive, whole_number_up_to

_NEGATIVE = re.compile(r"^-(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
"""Negative numbers, which are no options; Python's own pattern has no exponents (-4e3)."""

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
        return run_guarded(_import_and_run, options)


def _import_and_run(options):
    """Import the modules in `options.modules`, which register a user's classes; run the command."""
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
    _add_new(commands)
    _add_info(commands)
    _add_solve(commands)
    _add_plot(commands)
    _add_view(commands)
    _add_form(commands)
    _add_optimize(commands)
    _add_convert(commands)
    _add_schema(commands)
    _add_demo(commands)
    for command in commands.choices.values():
        _add_flag(command, "--quiet", "print errors only: no results, no warnings, no progress")
        text = "Python module, installed or in this folder, that registers your own classes"
        command.add_argument(
            "--import", dest="modules", action="append", default=[], metavar="MODULE", help=text
        )
    return top


def _add_command(commands, module, example):
    """Add the command of a module, and return its parser.

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
    return command


def _add_show_units(command):
    """Add the option ``--show-units`` of a command that prints or draws numbers."""
    text = 'units of numbers that are shown, such as "kN, m" (default: those that the scene states)'
    command.add_argument("--show-units", metavar="UNITS", help=text)


def _add_save_option(command, text, **settings):
    """Add the option ``--save`` of the file to write; `text` is its help."""
    command.add_argument("--save", metavar="FILE", help=text, **settings)


def _add_flag(command, name, text):
    """Add an option without a value; `text` is its help."""
    command.add_argument(name, action="store_true", help=text)


def _add_input_files(command, scene=True):
    """Add to a command the files that it reads: a scene, or with ``scene=False`` a scene or a net.

    For nets the options of reading, such as ``--scale``, are added, too.
    """
    if scene:
        text = "scene, JSON (written by save_scene or by hand; `jaxcable schema` describes it)"
        command.add_argument("scene", help=text)
    else:
        text = (
            "scene (.json), net of compas or jax_fdm (.json), session of compas_fofin (.fofin), "
            ".obj, .dxf, or two .csv: nodes, links"
        )
        command.add_argument("files", nargs="+", metavar="file", help=text)
        text = (
            "meters per unit of an OBJ file (default 1) or DXF file (default: the unit in the "
            "file); for a drawing made of a scene: meters per unit of the drawing (default 1)"
        )
        command.add_argument("--scale", type=parse_positive, metavar="S", help=text)
        text = (
            "units of the numbers in a file that states none, and of the forces and lengths in "
            'these options, such as "kN, m" or "kip, ft, F" (default: SI); written scenes have them'
        )
        command.add_argument("--units", metavar="UNITS", help=text)
        text = "DXF and OBJ: points closer than this become one node, m (default 1e-6)"
        command.add_argument("--tol", "--tolerance", type=parse_positive, metavar="D", help=text)
        text = 'DXF: layer whose points are supports, "*" for all points'
        command.add_argument("--supports", metavar="LAYER", help=text)
        text = "DXF: maximum chord error when arcs become straight pieces, m"
        command.add_argument("--sagitta", type=parse_positive, metavar="D", help=text)
        text = "DXF: also read layers that are off or frozen, and invisible entities"
        _add_flag(command, "--hidden", text)
        text = (
            "CSV tables: names in the files of the columns node, x, y, z, support, fx, first, "
            "last, kind, group and others, such as x=X_COORD support=Fixed; free=NAME for a column "
            "in which 1 means free"
        )
        command.add_argument("--columns", nargs="+", metavar="COLUMN=NAME", help=text)
        text = "add nodes where links of these groups (default: all) cross in plan or touch"
        command.add_argument("--split", nargs="*", metavar="GROUP", help=text)
    text = "refuse files larger than this, MB (default 64)"
    command.add_argument("--largest", type=parse_positive, default=64.0, metavar="MB", help=text)


def _add_new(commands):
    """Add the command ``new`` and its options."""
    command = _add_command(commands, new, "bridge --save my_bridge.json")
    text = "; ".join(f"{kind}: {about}" for kind, about in new.KINDS.items())
    command.add_argument("kind", choices=new.KINDS, help=text)
    text = "scene to write (.json; default: KIND.json here); the Python script goes beside it"
    _add_save_option(command, text)
    text = "replace existing files; otherwise nothing is written, and the exit status is 2"
    _add_flag(command, "--force", text)


def _add_demo(commands):
    """Add the command ``demo`` and its options."""
    command = _add_command(commands, demo, "--plot hypar.png")
    text = "picture to write (png, pdf, svg; default hypar_net.png)"
    command.add_argument("--plot", metavar="FILE", help=text)


def _add_solve(commands):
    """Add the command ``solve`` and its options."""
    example = "net.json --plot net.png --save result.json --save net.vtk --report net.txt"
    command = _add_command(commands, solve, example)
    _add_input_files(command)
    _add_show_units(command)
    command.add_argument("--plot", metavar="FILE", help="picture to write (png, pdf, svg)")
    text = (
        "result: .json, .npz, .csv (tables), .vtk (ParaView), .py (OpenSees), .dxf, .compas.json; "
        "can be repeated"
    )
    _add_save_option(command, text, action="append", default=[])
    text = (
        "report: displacements, reactions, forces, cutting list; to a .pdf, .xlsx, .html, .txt, "
        ".csv or .json file, or without FILE on the screen; can be repeated"
    )
    settings = {"nargs": "?", "const": "-", "action": "append", "default": []}
    command.add_argument("--report", metavar="FILE", help=text, **settings)
    for name in ("title", "author", "date"):
        text = f"{name} in the report (.pdf, .html, .xlsx)"
        command.add_argument(f"--{name}", metavar="TEXT", help=text)
    _add_combinations(command, "the report has envelopes")
    text = "largest residual over nodal force at convergence (default 1e-10; 1e-5 in float32)"
    command.add_argument("--tol", type=parse_positive, help=text)
    text = "incremental method with N corrections per increment, without full iteration (research)"
    command.add_argument("--corrections", type=whole_number_up_to(20), metavar="N", help=text)
    text = "solver of linear equations (default: by size)"
    command.add_argument("--linear-solver", choices=linear.selectable_solver_names(), help=text)


def _add_combinations(command, effect):
    """Add the options of combinations of actions; `effect` ends the help of the first."""
    text = (
        'combine the actions of the scene by these rules, "EN 1990", "ASCE 7-16" or a .json file '
        "(default: those that the scene states), and analyse all combinations from the end of the "
        f"phases; {effect}"
    )
    command.add_argument("--combinations", metavar="RULES", help=text)
    text = "only these rules or limit states, such as serviceability (default: all)"
    command.add_argument("--which", nargs="+", metavar="NAME", help=text)
    text = "equal steps in which each combination is applied (default 1)"
    whole = whole_number_up_to(1000)
    command.add_argument("--case-increments", type=whole, metavar="N", help=text)


def _add_plot(commands):
    """Add the command ``plot`` and its options."""
    command = _add_command(commands, plot, "mast.json --of My --save moments.pdf")
    _add_input_files(command)
    _add_show_units(command)
    text = "picture to write (png, pdf, svg; default: beside the scene, with its name, .png)"
    _add_save_option(command, text)
    text = (
        "what to draw: tension (default), utilization (force / breaking force) or another result "
        "as colors; N, Vy, Vz, T, My, Mz as diagrams on beams; model: the structure with numbers "
        "of nodes and elements, without an analysis"
    )
    command.add_argument("--of", default="tension", metavar="RESULT", help=text)
    text = "direction of view (default: by the shape of the structure)"
    command.add_argument("--view", choices=("plan", "elevation", "space"), help=text)
    _add_flag(command, "--sequence", "draw the end of every phase, side by side")
    text = "scale factor of displacements (default 1), not for diagrams"
    command.add_argument("--magnify", type=parse_positive, metavar="X", help=text)
    _add_flag(command, "--reactions", "also draw the support reactions")


def _add_view(commands):
    """Add the command ``view`` and its options."""
    command = _add_command(commands, view, "net.json --save net.html")
    _add_input_files(command)
    _add_show_units(command)
    _add_save_option(
        command, "HTML file to write (default: the name of the scene, .html, in this folder)"
    )
    _add_flag(command, "--no-open", "only write the file, do not open a browser")


def _add_form(commands):
    """Add the command ``form`` and its options."""
    command = _add_command(commands, form, "net.json --force-density 50 --save formed.json")
    _add_input_files(command)
    text = (
        "force density: a number, or group=number for each group, N/m or in the units of the scene "
        "(default: the values in the first phase that has them, unless --tension is given)"
    )
    command.add_argument("--force-density", nargs="+", metavar="Q", help=text)
    text = (
        "tension of all cables in the form: a number, or group=number for each group, N or in the "
        "units of the scene"
    )
    command.add_argument("--tension", nargs="+", metavar="T", help=text)
    text = (
        "length of groups without given force density or tension, such as masts and guys: "
        "group=drawn for the length in the scene, or group=number, m or in the units of the scene; "
        "their forces are found"
    )
    command.add_argument("--length", nargs="+", metavar="L", help=text)
    text = "groups that keep their stiffness, unstressed as drawn, such as beams or a mast of bars"
    command.add_argument("--free", nargs="+", metavar="GROUP", help=text)
    text = (
        "phases (1, 2, ...) whose loads act in the form, or none (default: the first phase with "
        "loads)"
    )
    command.add_argument("--loads", nargs="+", metavar="PHASE", help=text)
    _add_save_option(command, "scene to write (.json)")


def _add_optimize(commands):
    """Add the command ``optimize`` and its options."""
    example = "net.json --deflection 0.03 --lowest 80 --bounds 0 5000 --save tuned.json"
    command = _add_command(commands, optimize, example)
    _add_input_files(command)
    text = "wanted final tension of all elements, N or in the units of the scene (least squares)"
    command.add_argument("--target", type=number, metavar="T", help=text)
    text = (
        "smallest pretension with which no node moves more than this in the last phase (with "
        "combinations: in each of them), no cable is slack, and no force is above the strength; m "
        "or in the units of the scene"
    )
    command.add_argument("--deflection", type=parse_positive, metavar="D", help=text)
    text = (
        "smallest pretension with which no final tension of a cable is lower than this, N or in "
        "the units of the scene"
    )
    command.add_argument("--lowest", type=parse_positive, metavar="T", help=text)
    text = (
        "smallest and largest pretension allowed, N or in the units of the scene (default: 0, and "
        "the strength of elements that have one)"
    )
    names, whole_range = ("LOW", "HIGH"), (0.0, float("inf"))
    command.add_argument(
        "--bounds", type=number, nargs=2, metavar=names, default=whole_range, help=text
    )
    _add_combinations(command, "limits are kept in all of them")
    _add_flag(command, "--allow-slack", "let cables be slack at the end (default: none may be)")
    text = "the same pretension for all elements of a group"
    _add_flag(command, "--same-in-group", text)
    text = "maximum number of steps of the search (default 100)"
    command.add_argument(
        "--steps", type=whole_number_up_to(100_000), default=100, metavar="N", help=text
    )
    _add_save_option(command, "scene to write (.json), if the search converges within the limits")
    text = "write the best scene found even if the search does not converge (exit status 1)"
    _add_flag(command, "--keep", text)
    _add_flag(command, "--details", "also print the optimality residual of the search")


def _add_info(commands):
    """Add the command ``info`` and its options."""
    command = _add_command(commands, info, "net.json")
    _add_input_files(command, scene=False)
    _add_show_units(command)


def _add_convert(commands):
    """Add the command ``convert`` and its options."""
    example = "net.obj --scale 0.001 --anchors ends --axial-stiffness 1e6 --save net.json"
    command = _add_command(commands, convert, example)
    _add_input_files(command, scene=False)
    text = 'supported nodes: numbers, ranges such as 5-8, "ends" (end nodes), or both'
    command.add_argument("--anchors", nargs="+", metavar="NODE", help=text)
    for name, unit in (
        ("axial-stiffness", "EA, N"),
        ("weight", "N/m"),
        ("strength", "N"),
        ("expansion", "1/K"),
        ("pretension", "N"),
        ("force-density", "N/m"),
    ):
        text = f"{unit}; for links without a value in the file: a number, or group=number"
        command.add_argument(f"--{name}", nargs="+", metavar="X", help=text)
    text = "groups that are bars (carry compression), such as masts"
    command.add_argument("--bars", nargs="+", metavar="GROUP", default=(), help=text)
    text = "scene to write (.json), or a drawing (.dxf) or graph (.compas.json) of a scene or net"
    _add_save_option(command, text, required=True)


def _add_schema(commands):
    """Add the command ``schema`` and its options."""
    command = _add_command(commands, schema, "--save scene.schema.json")
    _add_save_option(command, "file to write instead of the screen (.json)")
