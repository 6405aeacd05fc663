"""Notebooks: their text sources run, and the notebooks hold the same cells with their outputs.

The first runs in `make test`, the others in `make test-all`.
"""

import importlib.util
import json
import re
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import jax
import matplotlib
import pytest

import jaxcable as jc

FOLDER = Path(__file__).parents[2] / "notebooks"
SOURCES = sorted(FOLDER.glob("*.py"))
PROJECT = tomllib.loads((FOLDER.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
REPOSITORY = PROJECT["urls"]["Source"]
COLAB = "colab.research.google.com/github"
BY_NUMPY = ("03_pretension",)
"""Notebooks with programs that XLA would compile for longer than NumPy needs for all runs."""
LIMIT = 60.0  # seconds that a notebook may take on two cores, compilation included


def cells(path):
    """Pairs (kind, text) of a source in the percent format: code and markdown cells in turn."""
    text = path.read_text()
    text = re.sub(r"\A# ---\n.*?# ---\n", "", text, flags=re.S)  # the header of jupytext
    found = []
    for part in re.split(r"^# %%", text, flags=re.M)[1:]:
        head, _, body = part.partition("\n")
        if "[markdown]" in head:
            lines = [line.removeprefix("#").removeprefix(" ") for line in body.strip().splitlines()]
            found.append(("markdown", "\n".join(lines)))
        else:
            found.append(("code", body.strip()))
    return found


def outputs(path):
    """The outputs of all code cells of a notebook."""
    notebook = json.loads(path.read_text())
    return [out for cell in notebook["cells"] for out in cell.get("outputs", ())]


MACHINE = re.compile(r"(?<![\w./~-])/(root|home|tmp|work|Users|var|mnt|content)/|[A-Z]:\\\\Users")


def test_no_output_or_page_has_a_path_of_a_machine():
    """A folder for programs, a temporary file or the file of a warning would be one."""
    assert MACHINE.search("in /home/anna/.cache/jaxcable") and MACHINE.search("('/tmp/x.npz',)")
    assert not MACHINE.search("see docs/how-to/tmp/x, https://a.org/home/x, ~/home/")
    texts = {}
    for path in SOURCES:
        for out in outputs(path.with_suffix(".ipynb")):
            data = {k: v for k, v in out.get("data", {}).items() if not k.startswith("image/")}
            texts.setdefault(path.name, []).append(json.dumps([out.get("text", ""), data]))
    for path in (FOLDER.parent / "docs").rglob("*.md"):
        texts[path.name] = [
            block for block in re.findall(r"```text\n(.*?)```", path.read_text("utf-8"), re.S)
        ]
    found = {n: [t for t in some if MACHINE.search(t)] for n, some in texts.items()}
    assert {name: some for name, some in found.items() if some} == {}


def test_there_are_eleven():
    assert [path.name[:2] for path in SOURCES] == [f"{k:02d}" for k in range(1, 12)]


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.stem)
def test_a_notebook_has_the_cells_of_its_source_and_their_outputs(path):
    notebook = path.with_suffix(".ipynb")
    kept = json.loads(notebook.read_text())["cells"]
    assert [(c["cell_type"], "".join(c["source"]).strip()) for c in kept] == cells(path)
    assert [c["execution_count"] for c in kept if c["cell_type"] == "code"] == list(
        range(1, 1 + sum(c["cell_type"] == "code" for c in kept))
    )
    made = outputs(notebook)
    assert not [out for out in made if out["output_type"] == "error"]
    assert any("image/png" in out.get("data", {}) for out in made)  # it shows a picture
    assert any(out.get("name") == "stdout" for out in made)  # and prints numbers
    assert notebook.stat().st_size < 1_500_000
    kind, text = cells(path)[0]
    assert kind == "markdown" and text.startswith("# ") and "?" in text  # it opens with a question
    assert re.search(
        r"run takes up to \d minutes on two cores", text
    )  # and says how long one waits
    address = f"{REPOSITORY}/blob/main/notebooks/{notebook.name}"
    assert text.endswith(f"]({address.replace('github.com', COLAB)})")  # the badge opens this one
    last = [text for kind, text in cells(path) if kind == "code"][-1]
    assert "assert " in last  # and ends with a checked number


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.stem)
def test_a_notebook_installs_the_package_where_it_is_missing(path, monkeypatch):
    """Its first cell runs pip then, and nothing where the package is there."""
    [text, *_] = [text for kind, text in cells(path) if kind == "code"]
    called = []
    monkeypatch.setattr(subprocess, "run", lambda words, check: called.append((words, check)))
    exec(compile(text, str(path), "exec"), {})
    assert not called
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    exec(compile(text, str(path), "exec"), {})
    assert called == [([sys.executable, "-m", "pip", "install", "--quiet", "jaxcable"], True)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [p if p.name.startswith("01") else pytest.param(p, marks=pytest.mark.slow) for p in SOURCES],
    ids=lambda p: p.stem,
)
@pytest.mark.filterwarnings("ignore:fuse_loops")  # jax has computed in this process
def test_a_notebook_runs(path, tmp_path, monkeypatch):
    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__"}
    begin = time.monotonic()
    way = "numpy" if path.stem in BY_NUMPY else "auto"
    with jax.enable_x64(jax.config.jax_enable_x64), jc.evaluation(way):
        for kind, text in cells(path):
            if kind == "code":
                exec(compile(text, str(path), "exec"), names)
    assert time.monotonic() - begin < 3 * LIMIT  # of a machine that does other work beside it
