"""Studies on clusters: equal to the undisturbed study, whatever is killed.

Each scene of `banks/clusters.py` runs in a process of its own, under a time limit.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "banks" / "clusters.py"
LIMIT = 900  # seconds: workers start and die many times, on a machine that does other work
GOOD = {"equal": True, "failures": True, "failed": [123], "missing": []}

pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")]


def found(scene, folder):
    words = [sys.executable, str(SCRIPT), scene, str(folder)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=LIMIT)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("cluster")


@pytest.fixture(scope="module")
def living_workers(folder):
    """Results of scenes in which no worker dies, by their names."""
    return found("living_workers", folder)


@pytest.fixture
def beside_local(living_workers, folder, tmp_path):
    """A folder with the undisturbed study of one process, which a scene compares its own with."""
    shutil.copytree(folder / "undisturbed" / "local", tmp_path / "local")
    return tmp_path


def test_workers_compute_what_this_process_does(living_workers):
    assert living_workers["undisturbed"] == {"samples": GOOD, "table": GOOD}


def test_workers_that_are_killed_lose_nothing(beside_local):
    assert found("workers_killed", beside_local) == GOOD | {"killed": [3]}


def test_a_killed_scheduler_is_told_and_another_one_goes_on(beside_local):
    result = found("scheduler_killed", beside_local)
    assert "call jc.study again, with a new client" in result.pop("said")
    assert result.pop("seconds") < 120 and 0 < result.pop("n_missing") < 38
    assert result == GOOD


def test_a_case_that_kills_its_workers_is_named_and_all_others_are_there(tmp_path):
    result = found("deadly_case", tmp_path)
    assert result["missing"] == [20]
    assert "chunk 20 (cases 200 to 209): KilledWorker" in result["said"]


def test_workers_with_other_modules_compute_nothing(living_workers):
    result = living_workers["other_module"]
    assert "this worker has another function" in result["said"]
    assert result["missing"] == [0, 1, 2, 3]


def test_studies_of_two_precisions_do_not_meet(living_workers):
    assert living_workers["two_precisions"] == ["float64", "float32", "float64"]


def test_a_cluster_without_workers_is_told(tmp_path):
    result = found("without_workers", tmp_path)
    assert "no worker for 2 s" in result["said"] and result["seconds"] < 60


def test_an_interrupted_study_goes_on(beside_local):
    result = found("interrupted", beside_local)
    assert result.pop("stopped") and 0 < result.pop("n_missing") < 38
    assert result == GOOD
