"""The README: its blocks run in turn, print what it says, and name what exists."""

import contextlib
import io
import re
import shlex
from pathlib import Path

import matplotlib
import numpy as np
import pytest

from jaxcable.cli import main

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.M | re.S)


def run(blocks, names):
    """Run blocks in turn; pairs (what a block has printed, what the text block after it says)."""
    printed, pairs = "", []
    for kind, text in blocks:
        if kind == "python":
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(text, "README.md", "exec"), names)
            printed = out.getvalue()
        elif kind == "sh":
            for line in text.splitlines():
                program, *words = shlex.split(line, comments=True)
                assert program == "jaxcable"
                assert main(words) == 0, line
        elif kind == "text":
            pairs.append((printed, text))
        else:
            assert kind == ""  # the two commands, which are run before the tests
    return pairs


def check_arrays(solution):
    """Results are arrays of JAX: no list as an index, and they cannot be changed."""
    for array in (solution.reactions, solution.phases[1].tension, solution.last.positions):
        plain = np.asarray(array)
        np.testing.assert_array_equal(array[np.array([0, 2])], plain[[0, 2]])
        np.testing.assert_array_equal(array[np.arange(len(plain)) > 2], plain[3:])
        np.testing.assert_array_equal(array[len(plain) + 5], plain[-1])
        with pytest.raises(TypeError, match="sequence"):
            array[[0, 2]]
        with pytest.raises(TypeError, match="immutable"):
            array[0] = 1.0


@pytest.mark.slow
def test_blocks_run_and_print_what_the_readme_says(tmp_path, monkeypatch):
    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    names = {}
    blocks = BLOCK.findall(README)
    assert [kind for kind, _ in blocks] == ["", "", "python", "text", "python", "sh"]
    ((printed, said),) = run(blocks, names)
    assert printed == said
    assert int(names["solution"].status) == 0
    made = {path.name for path in tmp_path.iterdir()}
    pictures = {f"net.{suffix}" for suffix in ("json", "png", "vtk", "txt", "html")}
    assert made == pictures | {"formed.json", "tuned.json"}
    check_arrays(names["solution"])
    # by hand: four cables carry 300 N, 4 N sin(a) = 300, at the sag that was found
    sag, tension = float(-names["solution"].displacement[4, 2]), float(names["solution"].tension[0])
    assert abs(4 * tension * sag / (1 + sag**2) ** 0.5 - 300.0) < 1e-6


def test_links_lead_to_files_and_commands_exist():
    for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "experiments/README.md"):
        path = ROOT / name
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", path.read_text()):
            if not target.startswith("http"):
                assert (path.parent / target).exists(), f"{name}: {target}"
    makefile = (ROOT / "Makefile").read_text()
    for name in ("README.md", "CONTRIBUTING.md", "experiments/README.md"):
        for target in re.findall(r"`?make (\w+)", (ROOT / name).read_text()):
            if target not in ("it", "a", "of", "scenes", "and"):
                assert re.search(rf"^{target}:", makefile, re.M), f"{name}: make {target}"
    for anchor in re.findall(r"experiments/README.md#([\w-]+)", README):
        heads = re.findall(r"^#+ (.*)$", (ROOT / "experiments/README.md").read_text(), re.M)
        known = [re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads]
        assert anchor in known
