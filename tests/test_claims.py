"""Figures in README.md and experiments/README.md are those of the result files."""

import importlib.util
import json
from pathlib import Path

import pytest

_PATH = Path(__file__).parent.parent / "experiments" / "claims.py"
_SPEC = importlib.util.spec_from_file_location("claims", _PATH)
claims = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(claims)


@pytest.mark.parametrize("claim", claims.CLAIMS, ids=lambda own: own.pattern[:40])
def test_figures_are_those_of_the_results(claim):
    """`python experiments/claims.py` puts them right."""
    text = (claims.ROOT / claim.file).read_text()
    assert claims.corrected(claim, text) == text


def test_a_changed_result_is_seen(tmp_path, monkeypatch):
    """A figure more in a result file, and one less in the text."""
    for path in claims.RESULTS.glob("*.*"):
        if path.suffix in (".txt", ".json"):
            (tmp_path / path.name).write_bytes(path.read_bytes())
    found = json.loads((tmp_path / "first_call.json").read_text())
    found["flat net"]["plain"]["first"] += 100.0
    (tmp_path / "first_call.json").write_text(json.dumps(found))
    monkeypatch.setattr(claims, "RESULTS", tmp_path)
    text = (claims.ROOT / "README.md").read_text()
    (own,) = (c for c in claims.CLAIMS if "first call takes" in c.pattern)
    assert claims.corrected(own, text) != text
    with pytest.raises(ValueError, match="0 places match"):
        claims.corrected(own, text.replace("first call takes", "first call needs"))
