"""Every kind of step leads to equilibrium in the scene that stands for those that need it."""

import dataclasses
import re
from pathlib import Path

import jax
import modes
import pytest
from banks import bar_bank, net_bank, unsymmetric_bank
from modes import LISTENER, STEPS

import jaxcable as jc
from jaxcable.equilibrium import tension_unknowns
from jaxcable.equilibrium.iteration import NewtonIteration
from jaxcable.equilibrium.newton_state import NewtonState

ROOT = Path(__file__).parents[2]

NEEDED_BY = {  # kinds of steps: bank, kind of scene, seed
    ("mixed",): (net_bank, "net", 0),
    ("cones", "cones' finish"): (net_bank, "far", 0),
    ("bounds", "bounds' finish"): (bar_bank, "rope", 0),
    ("search",): (net_bank, "sliding", 13),
    ("full",): (unsymmetric_bank, "thrown", 0),
    ("uphill",): (unsymmetric_bank, "towed", 0),
    ("predicted",): (bar_bank, "turning", 0),
}


@pytest.fixture
def listening(monkeypatch):
    monkeypatch.setattr(NewtonIteration, "iterate", NewtonIteration.iterate)
    jc.forget_programs()  # they would not tell
    modes.listen()
    LISTENER.forget()
    yield
    monkeypatch.undo()
    jc.forget_programs()


@pytest.mark.quick_cases("full")  # each has its programs compiled anew
@pytest.mark.filterwarnings("ignore:node .* has moved", "ignore::jaxcable.UnstableWarning")
@pytest.mark.parametrize("kinds", NEEDED_BY, ids=" and ".join)
def test_kinds_of_steps_are_taken_where_they_are_needed(kinds, listening):
    bank, scene, seed = NEEDED_BY[kinds]
    one = bank.drawn(scene, seed)
    solution = jc.solve(one.structure, one.phases)
    jax.effects_barrier()
    assert int(solution.status) == jc.status.OK and not LISTENER.failed
    assert all(LISTENER.ran[kind] for kind in kinds)


def test_every_kind_is_needed_somewhere():
    # Newton's steps by true forces: tests/equilibrium/test_peaks.py
    assert {"Newton", *(kind for kinds in NEEDED_BY for kind in kinds)} == set(STEPS)


def test_the_page_has_the_counts_of_the_study():
    page = (ROOT / "docs" / "theory" / "equilibrium.md").read_text()
    study = (ROOT / "experiments" / "results" / "modes.txt").read_text()
    stated = re.findall(r"^\| [^|]+ \| (\d+) \| (\d+) \|", page, re.MULTILINE)
    counted = re.search(r"^all .*", study, re.MULTILINE)[0]
    assert stated == re.findall(r"(\d+) */ *(\d+)", counted) and len(stated) == len(STEPS)
    modes_of_cables = tension_unknowns.LINE_SEARCH + 1
    words = rf"{len(dataclasses.fields(NewtonState))} fields.* {modes_of_cables} modes"
    assert re.search(rf"{words}.*\s.*\b{len(STEPS)} kinds of steps", page)
