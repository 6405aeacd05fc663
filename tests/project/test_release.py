"""What an index and a hosting service get: metadata, workflows, citation, and other systems."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import jaxcable as jc

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def run(*words, **options):
    done = subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, encoding="utf-8", **options
    )
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
    return done.stdout


def test_metadata_say_what_is_tested():
    named = re.findall(r":: (3\.\d+)", " ".join(PROJECT["classifiers"]))
    assert PROJECT["requires-python"] == f">={named[0]}"
    checks = (ROOT / ".github/workflows/checks.yml").read_text(encoding="utf-8")
    assert f'python: ["{named[0]}", "{named[-1]}"]' in checks
    extras = PROJECT["optional-dependencies"]
    of_all = re.search(r"\[(.*)\]", extras["all"][0])[1].split(",")
    own = "test", "site", "notebooks", "experiments", "release", "all"
    assert sorted(of_all) == sorted(extras.keys() - set(own))


def test_the_changelog_is_by_release():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    versions = re.findall(r"^## \[(.*?)\] - (.*)$", text, re.M)
    assert versions[0] == (jc.__version__.removesuffix(".dev0"), "unreleased") or (
        versions[0][0] == jc.__version__
    )
    numbers = [tuple(map(int, version.split("."))) for version, _ in versions]
    assert numbers == sorted(numbers, reverse=True) and len(set(numbers)) == len(numbers)
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\d", date) for _, date in versions[1:])


def test_workflows_are_valid_and_call_make():
    assert WORKFLOWS
    run("-m", "check_jsonschema", "--builtin-schema", "vendor.github-workflows", *WORKFLOWS)
    targets = set(re.findall(r"^([a-z-]+):", MAKEFILE, re.M))
    for path in WORKFLOWS:
        steps = re.findall(r"^\s*(?:- )?run: (.*)$", path.read_text(encoding="utf-8"), re.M)
        for step in steps:
            words = step.split()
            assert words[0] == "make" and words[1] in targets, f"{path.name}: {step}"


def test_an_invalid_workflow_is_found(tmp_path):
    """A control: the validator knows the keys of a job."""
    text = WORKFLOWS[0].read_text(encoding="utf-8").replace("runs-on:", "runs_on:")
    (tmp_path / "wrong.yml").write_text(text, encoding="utf-8")
    words = "-m", "check_jsonschema", "--builtin-schema", "vendor.github-workflows"
    done = subprocess.run([sys.executable, *words, tmp_path / "wrong.yml"], capture_output=True)
    assert done.returncode == 1


def test_the_citation_is_valid():
    run("-m", "check_jsonschema", "--builtin-schema", "vendor.citation-file-format", "CITATION.cff")


@pytest.mark.slow
def test_nothing_needs_a_name_of_linux(tmp_path):
    script = ROOT / "tests" / "banks" / "other_systems.py"
    said = run("-X", "warn_default_encoding", script, tmp_path, timeout=900)
    assert said.splitlines()[-1] == "ran calls"
