"""The rooms stay within their budget of code lines, which may only fall."""

import tomllib

import pytest
import rooms

BUDGETS = tomllib.loads((rooms.ROOT / "tests" / "budgets.toml").read_text())["code lines"]
TO_SPARE = 10
"""Lines that a room may have fewer than its budget: then the budget falls, too."""


def test_every_room_has_a_budget():
    assert list(BUDGETS) == list(rooms.code_lines())


@pytest.mark.parametrize("room", BUDGETS)
def test_code_lines_are_those_of_the_budget(room):
    assert BUDGETS[room] - TO_SPARE <= rooms.code_lines()[room] <= BUDGETS[room]


def forget_trees():
    """Have the files read and counted anew."""
    rooms.trees.cache_clear()
    rooms.code_lines.cache_clear()


def test_what_counts_as_code(tmp_path, monkeypatch):
    """No docstrings, texts that explain attributes, comments, imports, empty lines."""
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "__init__.py").write_text('"""Docstring."""\n')
    (tmp_path / "room" / "module.py").write_text(
        '"""Docstring,\n\nof three lines."""\n\nfrom os import (\n    path,\n)\n\n'
        'LIMIT = 3  # m\n"""What it is."""\n\n\ndef f(x):\n    """Docstring."""\n    # why\n'
        '    text = """two\n    lines"""\n    return text\n'
    )
    monkeypatch.setattr(rooms, "PACKAGE", tmp_path)
    forget_trees()
    try:
        assert rooms.code_lines() == {"package": 0, "room": 5}
    finally:
        forget_trees()
