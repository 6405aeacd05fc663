"""A run beyond its budget fails, and says which tests are dear."""

import re
from pathlib import Path

import pytest

pytest_plugins = "pytester"

CONFTEST = """
import sys
import time
sys.path.insert(0, {tests!r})
import budget

def measure():
    "A unit of 0.05 s, whose measurement takes 10 units."
    end = time.process_time() + 0.5
    while time.process_time() < end:
        pass
    return 0.05

def pytest_configure(config):
    config.pluginmanager.register(budget.Budget({allowed!r}, measure))
"""
TESTS = """
import time

def test_dear():
    end = time.process_time() + 0.2
    while time.process_time() < end:
        pass

def test_cheap():
    pass
"""


MUCH = 10**6


@pytest.mark.parametrize(
    ("allowed", "wrong", "workers"),
    [
        ({"run": 12, "test": MUCH}, [], 0),
        ({"run": 1, "test": MUCH}, [r"the run took \d+ units, and may take 1"], 0),
        (
            {"run": MUCH, "test": 2},
            [r"test_a_run\S+::test_dear took \d\.\d, and a test may take 2"],
            0,
        ),
        pytest.param(
            *({"run": 10, "test": 2}, [r"the run took", r"::test_dear took"], 2),
            marks=pytest.mark.slow,  # every run of all tests has workers
        ),
    ],
    ids=["within", "run", "test", "workers"],
)
def test_a_run_beyond_its_budget_fails(pytester, allowed, wrong, workers):
    tests = str(Path(__file__).parents[1])
    pytester.makeconftest(CONFTEST.format(tests=tests, allowed=allowed))
    pytester.makepyfile(TESTS)
    if workers:
        run = pytester.runpytest_subprocess("-n", str(workers), "-p", "no:cacheprovider")
    else:
        run = pytester.runpytest_inprocess("-p", "no:xdist", "-p", "no:cacheprovider")
    assert run.ret == (pytest.ExitCode.TESTS_FAILED if wrong else pytest.ExitCode.OK)
    text = run.stdout.str()
    assert re.search(r"\d+ of \d+ units of 0\.05 s of processor time", text)
    for line in wrong:
        assert re.search(line, text)
    shown = re.findall(r"^ +[\d.]+ +\d+ +\S+::(test_\w+)$", text, re.M)
    assert shown == (["test_dear", "test_cheap"] if wrong else [])
