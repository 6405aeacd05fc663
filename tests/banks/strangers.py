"""A folder with files of strangers, and calls of everything in the package that writes to one."""

import contextlib
import io
import os
import warnings
from pathlib import Path

import jax
import numpy as np

import jaxcable as jc
from jaxcable.cli import parser
from jaxcable.common.status import AnalysisError

SCENE = jc.scenes.flat_net(increments=(1, 1))
NAMES = (
    *("letter.txt", "net.json", "net.html", "net.png", "net.py", "net.csv", "net-nodes.csv"),
    *("net.vtk", "net-0001.vtk", "net.npz", "net.dxf", "net.gif", "net.svg", "net.compas.json"),
    *("hypar_net.png", "scene.schema.json", "study.json", "chunk-000000.npz", "data.bin"),
    *(".net.json.probe", ".net.png.probe", "abc.program", "abc.cache", "tmp1.new", "no suffix"),
    *("readonly.json", "link.json", "dangling.json", "folder", "folder/net.json", "empty"),
)


def fill(folder, seed=0):
    """Put the files there: texts, bytes, folders, links, a read-only file."""
    rng = np.random.default_rng(seed)
    for name in ("folder", "empty", "elsewhere", "study"):
        (folder / name).mkdir()
    for name in NAMES:
        if name not in ("folder", "empty", "link.json", "dangling.json"):
            content = rng.bytes(300) if "." in name[-5:] else b"a letter, and nothing else\n"
            (folder / name).write_bytes(content)
    (folder / "elsewhere" / "real.json").write_text("the file at the end of a link")
    (folder / "study" / "thesis.pdf").write_bytes(rng.bytes(5000))
    (folder / "link.json").symlink_to(Path("elsewhere") / "real.json")
    (folder / "dangling.json").symlink_to(Path("elsewhere") / "nothing.json")
    (folder / "readonly.json").chmod(0o444)
    jc.save_scene(folder / "scene.json", SCENE)  # for the command line to read


def seen(folder):
    """All that is in a folder, by name: kind, permissions, and bytes or target."""
    found = {}
    for path in sorted(folder.rglob("*")):
        kind = os.lstat(path).st_mode
        if path.is_symlink():
            content = os.readlink(path)
        else:
            content = path.read_bytes() if path.is_file() else None
        found[str(path.relative_to(folder))] = kind, content
    return found


def _tables(*names):
    return lambda path: [path.with_name(f"{path.stem}-{name}.csv") for name in names]


def _report(solution):
    tables = _tables(
        *jc.report(SCENE.structure, solution, SCENE.phases, model=True).csv(), "energy"
    )
    one = (".json", ".txt", ".html", ".xlsx", ".pdf")
    suffixes = {".csv": tables, **dict.fromkeys(one, lambda p: [p])}
    return lambda path: suffixes.get(path.suffix, lambda _: [])(path)


def _picture(path):
    return [path if path.suffix else path.with_name(path.name + ".png")]


def _increments(path):
    return [path.with_name(f"{path.stem}-{k:04d}.vtk") for k in (1, 2)]


def _study(path):
    parts = [path / name for name in ("file", "cause", "completed")]
    files = [part / name for part in parts for name in ("zarr.json", "c", "c/0", "c/1")]
    return [path, path / "zarr.json", *parts, *files]


def _new(path):
    return [path, path.with_suffix(".py"), path.with_name("scene.schema.json")]


def calls(solution, every):
    """Triples: function of a path; from a path to the files that it may write; usual suffixes."""
    structure, _ = SCENE
    one, none = (lambda path: [path]), (lambda _: [])
    tables = _tables("nodes", "elements", "increments")
    result = {".csv": tables, ".json": one, ".npz": one}
    anything = dict.fromkeys((".vtk", ".py", ".dxf"), one) | result
    report = _report(solution)

    def kinds(path):
        return _by(anything, path)

    def command(*words, suffixes=".json", files=one):
        """A command with --save, or with a path in the place of PATH."""
        words = [*words, "--save", "PATH"] if "PATH" not in words else list(words)

        def run(path):
            given = [str(path) if word == "PATH" else word for word in words]
            with contextlib.redirect_stderr(io.StringIO()), contextlib.suppress(SystemExit):
                parser.main([*given, "--quiet"])

        return run, files, suffixes

    def study(path):
        jc.study(lambda x: {"file": 2 * x}, np.arange(3.0), path, chunk=2).load()

    compiles = [
        command("solve", "scene.json", "--report", "PATH", suffixes=".csv .txt", files=report),
        command("optimize", "scene.json", "--target", "150", "--same-in-group"),
        command("form", "scene.json", "--force-density", "50"),
    ]
    return [
        *(compiles if every else []),
        (lambda path: jc.save_scene(path, SCENE), one, ".json"),
        (
            lambda path: jc.files.save_result(path, structure, solution),
            lambda path: _by(result, path),
            " ".join(result),
        ),
        (lambda path: jc.files.save_vtk(path, structure, solution), one, ".vtk"),
        (
            lambda path: jc.files.save_vtk(path, structure, solution, increments=True),
            _increments,
            ".vtk",
        ),
        (lambda path: jc.files.save_opensees(path, structure, solution), one, ".py"),
        (lambda path: jc.files.save_dxf(path, structure, solution), one, ".dxf"),
        (lambda path: jc.files.save_network(path, structure, solution), one, ".json"),
        (lambda path: jc.report(structure, solution).save(path), report, ".csv .json .txt .html"),
        (lambda path: jc.plots.view(solution, path, structure=structure), one, ".html"),
        (lambda path: jc.plots.convergence([1.0, 2.0], [1.0, 0.5], path), _picture, ".png .svg"),
        (lambda path: jc.plots.animation(solution, path, frames=1, dpi=20), one, ".gif .html"),
        (study, _study, ""),
        command("convert", "scene.json", suffixes=".dxf"),
        command("schema"),
        command("new", "net", files=_new),
        command("new", "mast", "--force", files=_new),
        command("solve", "scene.json", suffixes=" ".join(anything), files=kinds),
        command("plot", "scene.json", suffixes=".png .svg"),
        command("solve", "PATH", "--save", "PATH", files=none),  # a file that strangers have made
        command("convert", "PATH", "--save", "net.json", files=none),
        command("view", "scene.json", "--no-open", suffixes=".html"),
        command("info", "PATH", files=none),
    ]


def _by(kinds, path):
    return kinds.get(path.suffix, lambda _: [])(path)


EXPECTED = (ValueError, OSError, AnalysisError)
"""What a call may raise; anything else is a fault."""


def harm(folder, count, seed, solution, every=False):
    """Call things at random; returns words on all that happened to others' files, and how many
    calls wrote something and how many were refused. Calls that compile are among them if `every`.
    """
    rng = np.random.default_rng(seed)
    faults, wrote, refused, offered = [], 0, 0, calls(solution, every)
    order = [k for _ in range(count) for k in rng.permutation(len(offered))][:count]
    os.chdir(folder)
    for k in order:
        function, files, suffixes = offered[k]
        names = [*NAMES, "new.json", "new.csv", "new.png", "study", "there/is/none.json", ""]
        if rng.random() < 0.7:
            usual = suffixes.split() or [""]
            names = [name for name in names if Path(name).suffix in usual]
        path = folder / str(rng.choice(names))
        before, raised = seen(folder), None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", jc.InputWarning)
            try:
                function(path)
            except EXPECTED as error:
                raised = error
                refused += 1
        after = seen(folder)
        changed = {n for n in before.keys() | after.keys() if before.get(n) != after.get(n)}
        wrote += bool(changed)
        allowed = {Path(os.path.realpath(f)) for f in files(path)} if raised is None else set()
        told = {str(f.relative_to(folder)) for f in allowed if f.is_relative_to(folder)}
        if files is _study:  # which goes on where it can, and replaces nothing
            told = {str(f.relative_to(folder)) for f in files(path)} - before.keys()
        if bad := changed - told:
            faults.append(f"call {k} of {path.name!r}: {sorted(bad)}, {raised!r}")
    jax.effects_barrier()
    return faults, wrote, refused
