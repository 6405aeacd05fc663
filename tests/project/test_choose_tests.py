"""Which tests `make test` runs: the rule of `choose_tests`, on records written by hand."""

import json

import choose_tests
import pytest

FILE = "project/test_choose_tests.py"


def written(path, *records):
    """A file of records: (name, seconds, lines of a module)."""
    lines = [
        {"id": f"tests/{FILE}::{name}", "wall": cost, "cpu": cost, "lines": {"solver.py": ran}}
        for name, cost, ran in records
    ]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return choose_tests.recorded([path])


def short(names):
    return {name.removeprefix(f"{FILE}::") for name in names}


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        (0.0, {"test_cheap"}),
        # the lines that the cheap one has not run, per second: 6 in 2 s before 10 in 5 s
        (2.5, {"test_cheap", "test_half"}),
        (99.0, {"test_cheap", "test_half", "test_all", "test_again[1]", "test_again[2]"}),
    ],
)
def test_what_adds_most_per_second_stays(tmp_path, seconds, expected):
    tests, worth = written(
        tmp_path / "records",
        ("test_cheap", 0.2, [1, 2]),
        ("test_half", 2.0, [1, 2, 3, 4, 5, 6, 7, 8]),
        ("test_all", 5.0, [*range(1, 13)]),
        ("test_again[1]", 1.9, [3, 4]),
        ("test_again[2]", 2.9, [3, 4]),  # a second case of its function
        ("test_again[3]", 5.9, [3, 4]),  # adds nothing: all of it is there twice by then
    )
    stay, spent = choose_tests.chosen(tests, worth, seconds, [])
    assert short(stay) == expected
    assert spent == pytest.approx(sum(tests[name][0] for name in stay))


def test_what_is_cited_stays(tmp_path):
    tests, worth = written(tmp_path / "records", ("test_a[1]", 9.0, [1]), ("test_a[2]", 8.0, [1]))
    stay, _ = choose_tests.chosen(tests, worth, 0.0, [f"{FILE}::test_a"])
    assert short(stay) == {"test_a[2]"}


def test_the_dearest_record_of_a_test_counts(tmp_path):
    tests, _ = written(tmp_path / "records", ("test_a", 0.1, [1]), ("test_a", 3.0, [2]))
    cost, shows = tests[f"{FILE}::test_a"]
    assert cost == 3.0
    assert len(shows) == 4  # two lines, the file, the function


def test_names_and_whole_functions_are_left_out():
    names = {f"{FILE}::test_a", f"{FILE}::test_b[2]"}
    assert choose_tests.is_left_out(f"{FILE}::test_a[1]", names)
    assert choose_tests.is_left_out(f"{FILE}::test_b[2]", names)
    assert not choose_tests.is_left_out(f"{FILE}::test_b[1]", names)


def test_what_nothing_has_recorded_stays_in_the_list(tmp_path, monkeypatch):
    """A record of `make test` alone: of a function whose cases are all out by now, one line."""
    path = tmp_path / "list.txt"
    before = "never", "some[1]", "every[1]", "again"
    path.write_text("# header\n" + "".join(f"{FILE}::test_{name}\n" for name in before))
    monkeypatch.setattr(choose_tests, "LIST", path)
    tests = {
        f"{FILE}::test_{name}": (1.0, ()) for name in ("some[2]", "some[3]", "every[2]", "again")
    }
    choose_tests.write(tests, {f"{FILE}::test_{name}" for name in ("some[3]", "again")})
    assert short(choose_tests.left_out()) == {
        "test_never",
        "test_some[1]",
        "test_some[2]",
        "test_every",
    }


def test_what_texts_cite_is_in_make_test():
    cited, out = choose_tests.cited(), choose_tests.left_out()
    assert len(cited) > 30
    assert not cited & out


def test_the_list_names_tests(request):
    """`python tests/choose_tests.py` writes it anew; a line whose test is gone may be deleted."""
    unknown = request.config.stash[choose_tests.UNKNOWN]
    if unknown is None:
        pytest.skip("only where all tests are collected")
    assert unknown == set()
