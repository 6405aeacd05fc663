"""The benchmarks: commands that the texts name exist, and every case is measured at two sizes."""

import ast
import re
from pathlib import Path

import benchmark
import pytest
from benchmarks import cases

ROOT = Path(__file__).parents[2]
TEXTS = "README.md", "CONTRIBUTING.md", "Makefile", "experiments/README.md"


@pytest.mark.parametrize("text", TEXTS)
def test_commands_that_a_text_names_exist(text):
    named = re.findall(r"experiments/benchmark\.py ([a-z]\w+)", (ROOT / text).read_text())
    assert named and set(named) <= set(benchmark.NAMES)


def test_every_benchmark_says_what_it_measures():
    """Its question, reference, error and results; its function, which takes cases and parts."""
    for module, function, _ in benchmark.NAMES.values():
        tree = ast.parse((ROOT / f"experiments/benchmarks/{module}.py").read_text())
        for word in ("Question ", "Reference ", "Error ", "Results "):
            assert f"\n{word}" in f"\n{ast.get_docstring(tree)}", (module, word)
        (found,) = (n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == function)
        assert len(found.args.args) == 2


def test_cases_are_fewer_where_they_are_only_tried():
    for name, few, all_ in zip(cases.Cases._fields, cases.QUICK, cases.FULL, strict=True):
        if hasattr(few, "__len__"):
            assert len(few) <= len(all_), name
        else:
            assert few <= all_, name


def test_a_name_that_is_unknown_lists_those_that_are_there(capsys):
    assert benchmark.main(["scalling"]) == 2
    told = capsys.readouterr().out
    assert all(f"\n  {name} " in told for name in benchmark.NAMES)
