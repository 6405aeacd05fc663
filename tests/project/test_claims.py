"""Figures in README.md and experiments/README.md are those of the result files."""

import ast
import importlib.util
import json
import re
from pathlib import Path

import pytest

_PATH = Path(__file__).parents[2] / "experiments" / "claims.py"
_SPEC = importlib.util.spec_from_file_location("claims", _PATH)
claims = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(claims)


def test_figures_are_those_of_the_results():
    """`python experiments/claims.py` puts them right."""
    for claim in claims.CLAIMS:
        text = (claims.ROOT / claim.file).read_text()
        assert claims.corrected(claim, text) == text, claim.pattern


def test_a_changed_result_is_seen(tmp_path, monkeypatch):
    """A figure more in a result file, and one less in the text."""
    for path in claims.RESULTS.glob("*.*"):
        if path.suffix in (".txt", ".json"):
            (tmp_path / path.name).write_bytes(path.read_bytes())
    found = json.loads((tmp_path / "evaluation.json").read_text())
    found["flat_net"]["plain"] += 100.0
    (tmp_path / "evaluation.json").write_text(json.dumps(found))
    monkeypatch.setattr(claims, "RESULTS", tmp_path)
    text = (claims.ROOT / "README.md").read_text()
    readme = (c for c in claims.CLAIMS if c.file == "README.md")
    (own,) = (c for c in readme if "a gradient after it" in c.pattern)
    assert claims.corrected(own, text) != text
    with pytest.raises(ValueError, match="0 places match"):
        claims.corrected(own, text.replace("a gradient after it", "a gradient"))


NAMED = re.findall(
    r"`(tests/[\w/]+\.py)::(\w+)`", (claims.ROOT / "experiments/README.md").read_text()
)


def test_tests_behind_claims_run_by_default():
    """Not marked slow as a whole; single cases of it may be, at larger sizes."""
    assert len(NAMED) > 30
    for file, name in NAMED:
        tree = ast.parse((claims.ROOT / file).read_text())
        (found,) = (n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == name)
        whole = [n for n in tree.body if ast.unparse(n).startswith("pytestmark")]
        marks = [ast.unparse(own) for own in found.decorator_list] + [
            ast.unparse(n.value) for n in whole
        ]
        assert "pytest.mark.slow" not in marks, (file, name)


def test_every_row_of_the_validation_names_what_shows_it():
    text = (claims.ROOT / "experiments/README.md").read_text()
    table = text.split("| check | result | shown by |")[1].split("\n\n")[0]
    rows = [row for row in table.splitlines()[2:] if row]
    assert len(rows) > 30
    for row in rows:
        shown = row.rsplit("|", 2)[1]
        assert re.search(r"`tests/[\w/]+\.py::\w+`|`experiments/\w+\.py`", shown), row
