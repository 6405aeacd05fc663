"""``solve --combinations``: actions of a scene, combined, analysed as one batch, and reported."""

import json
import shlex
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

import jaxcable as jc
from jaxcable.__main__ import main
from jaxcable.cli import combining, inputs, optimize

Action = jc.design.Action
NODES = [[0.0, 0.0, 0.0], [3.0, 0.0, -0.3], [6.0, 0.0, 0.0]]
CABLES = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e6, weight=10.0, strength=4e4)
STRUCTURE = jc.Structure(NODES, CABLES, supports=jc.pinned([0, 2]) + jc.restrained([1], "y"))
LOAD = jc.NodalLoads([1], (0.0, 0.0, -50.0))
PHASES = [jc.Phase(pretension=5e3, loads=jc.SelfWeight())]


def actions(snow=-1000.0):
    return [
        Action("self-weight", "permanent", jc.SelfWeight(), in_phases=True),
        Action("snow", "snow", jc.NodalLoads([1], (0.0, 0.0, snow))),
        Action("wind", "wind", jc.NodalLoads([1], (0.0, 0.0, 300.0))),
    ]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(jc.progress.SHOW, "pause", 1e6)
    jc.save_scene("rope.json", (STRUCTURE, PHASES), units="kN, m", actions=actions())
    jc.save_scene("bare.json", (STRUCTURE, PHASES))
    return tmp_path


def command(words):
    return main(shlex.split(words))


def test_all_combinations_are_in_the_report(folder, capsys):
    pytest.importorskip("typst")
    words = 'solve rope.json --combinations "EN 1990" --which ultimate --report '
    assert command(words + "rope.json.txt") == 0
    told = capsys.readouterr().out
    assert "10 combinations of actions, 10 converged" in told
    found = jc.design.combinations(actions()).select_limit_states("ultimate")
    solutions = jc.design.solve_cases(STRUCTURE, PHASES, found)
    built = jc.solve(STRUCTURE, PHASES).displacement[None]
    for name, begin in (("start", 0.0), ("end of the phases", built)):
        moved = np.linalg.norm(solutions.displacement - begin, axis=2)
        case, node = np.unravel_index(moved.argmax(), moved.shape)
        text = f"{moved.max():.6g} m at node {node} in {found.names[case]}"
        assert f"largest displacement over the combinations from the {name}: {text}" in told
    text = (folder / "rope.json.txt").read_text()
    assert "NodalLoads on 1 node, sum (0, 0, -1) kN" in text and "1.35 self-weight" in text
    assert "envelope over 10 cases" in text and "without loads and factors of the" in text
    assert command("solve rope.json --since 2") == 2
    assert "--since: '2' is no phase; give 1 to 1" in capsys.readouterr().err
    words = words.replace("--report", '--since "last phase" --report')
    assert command(f'{words} rope.pdf --title "A rope" --author A --date 2026-11-27') == 0
    assert (folder / "rope.pdf").read_bytes().startswith(b"%PDF")
    assert command(words + "rope.json") == 2  # the scene itself


def test_rules_are_chosen_by_name_and_from_a_file(folder, capsys):
    rules = jc.design.combination_rules("EN 1990")
    (folder / "own.json").write_text(json.dumps(rules))
    words = "solve rope.json --combinations own.json --which 'SLS frequent' --case-increments 2"
    assert command(f"{words} --report") == 0
    told = capsys.readouterr().out
    assert "SLS frequent-1" in told and "ULS" not in told


def test_several_reports_and_again_over_those_of_before(folder, capsys):
    """Two files and the screen; the tables of combinations are known as those of this program."""
    area = jc.AreaLoads([[0, 1, 2]], (0.0, 0.0, -100.0), "initial")
    more = [*actions(), Action("roof", "snow", area), Action("impact", "accidental", LOAD)]
    jc.save_scene("more.json", (STRUCTURE, PHASES), actions=more)
    words = "solve more.json --combinations 'EN 1990' --which 'SLS characteristic'"
    for _ in range(2):
        assert command(f"{words} --report r.csv --report r.txt --report") == 0
        told = capsys.readouterr().out
        assert "wrote r-displacements.csv" in told and "wrote r.txt" in told
        assert "envelope over" in told and "(per initial area); forces (0, 0, -100)" in told
    assert (folder / "r.txt").read_text().count("envelope over") >= 1
    assert command(f"{words} --report r.txt --report ./r.txt") == 2  # one file twice


def test_checks_of_the_scene_are_made(folder, capsys):
    """By its own standard of combinations; the force that governs is that of the library.

    A check for which none of the chosen combinations counts is not made; the report says so.
    """
    still = jc.design.DisplacementLimit(0.1)
    checks = ["EN 1993-1-11", jc.design.TensionLimit(lower=1.0, of=()), still]
    more = {"actions": actions(), "combinations": "EN 1990", "checks": checks}
    jc.save_scene("checked.json", (STRUCTURE, PHASES), **more)
    assert command("solve checked.json --which 'ULS 6.10' --report r.txt") == 0
    told = capsys.readouterr().out
    found = jc.design.combinations(actions(), which=["ULS 6.10"])
    solutions = jc.design.solve_cases(STRUCTURE, PHASES, found)
    assert (np.asarray(solutions.status) == 0).all()
    case, element = np.unravel_index(np.argmax(solutions.tension), solutions.tension.shape)
    used = float(solutions.tension[case, element]) / (4e4 / 1.5)
    line = f"cable resistance: utilization {used:.3f}, element {element}, {found.names[case]}, EN"
    assert line in told and "all 2 checks passed" in told
    assert "NOT MADE: cable service stress" in told
    assert "; displacement, without serviceability or allowable stress" in told
    alone, ended = Namespace(checks=[still]), Namespace(status=0)
    assert combining.make_checks(alone, ended, solutions, found, ["ULS 6.10"]) is None
    report = (folder / "r.txt").read_text()
    assert "Checks, largest utilization of each" in report and f"{used:.3f}"[:4] in report
    assert command("info checked.json") == 0
    told = capsys.readouterr().out
    assert "combinations by EN 1990\ncheck EN 1993-1-11\ncheck tension that remains" in told


def test_nodes_without_active_elements_do_not_count_as_moved():
    bars = {name: jc.Bars([[0, k]], 1e6) for k, name in enumerate(("stay", "prop"), 1)}
    structure = jc.Structure([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], bars, jc.pinned([0]))
    moved, present = [[0, 0, 0], [0, 0, 1e-3], [0, 0, 5.0]], {"stay": [1.0], "prop": [0.0]}
    largest = inputs.largest_displacement
    assert largest(structure, moved, present, None) == (1e-3, "0.001 m at node 1")
    assert largest(structure, moved, None, None) == (5.0, "5 m at node 2")


def test_checks_without_combinations_are_those_of_the_end(folder, capsys):
    """Also of an analysis that fails, of which nothing is known."""
    names = {"lift": PHASES[0], "load": jc.Phase(loads=LOAD)}
    taut = jc.design.TensionLimit(lower=1e6)
    jc.save_scene("end.json", (STRUCTURE, names), checks=[taut])
    assert command("solve end.json") == 3
    told, err = capsys.readouterr()
    assert err == "jaxcable: end.json: checks are not passed\n"
    lowest = float(jc.solve(STRUCTURE, [*names.values()]).tension.min())
    assert f"that remains: FAILS: utilization {1e6 / lowest:.3f}, element" in told
    assert ", load, given limit" in told and "1 of 1 checks NOT passed" in told
    pull = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -6e4)))
    jc.save_scene("weak.json", (weak_rope(), pull), checks=[taut])
    assert command("solve weak.json") == 1
    assert "NOT CHECKED, because the analysis failed" in capsys.readouterr().out


NEEDED = 10e3 / 1.2
"""Pretension of both stays of `stayed_mast` with which a pull of 10 kN at the top slackens none."""


def stayed_mast():
    """A hinged mast with two stays at 0.6 to the horizontal, and winds that pull 10 and 6 kN.

    A pull H changes the forces of the stays by H / (2 0.6) while both are taut; the moment of the
    mast's force in the deflected shape is 1 in 2000 of it.
    """
    nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, 20.0], [-15.0, 0.0, 0.0], [15.0, 0.0, 0.0]]
    mast = jc.Bars([[0, 1]], axial_stiffness=1e13)
    stays = jc.Cables([[2, 1], [3, 1]], axial_stiffness=5e7, strength=1e6)
    supports = jc.pinned([0, 2, 3]) + jc.restrained([1], "y")
    structure = jc.Structure(nodes, {"mast": mast, "stays": stays}, supports)
    winds = [
        Action(name, "wind", jc.NodalLoads([1], (pull, 0.0, 0.0)), exclusive="wind")
        for name, pull in (("west", -10e3), ("east", 6e3))
    ]
    return structure, jc.Phase(pretension={"stays": 20e3}), winds


@pytest.mark.parametrize(
    ("multipliers", "upper", "expected"),
    [
        ([0.0, 1.0, 0.0, 0.0], 10.0, True),
        ([0.0, 1.0, 0.0, 0.0], 5.0, False),  # a pretension is at its bound, such as the strength
        ([0.5, 1.0, 0.0, 0.0], 10.0, False),  # displacement
        ([0.0, 1.0, 0.0, 0.5], 10.0, False),  # strength
        ([0.0, 0.0, 0.0, 0.0], 10.0, False),
    ],
)
def test_slack_governs_where_no_other_limit_is_active(multipliers, upper, expected):
    found = Namespace(status=0, params=np.array([5.0, 3.0]), multipliers=np.array(multipliers))
    options = Namespace(target=None, lowest=None, allow_slack=False, deflection=0.1)
    given = found, stayed_mast()[0], options, upper, 1
    assert optimize._only_slack_governs(*given) == expected


def test_optimize_keeps_cables_taut_unless_they_may_be_slack(folder, capsys):
    structure, prestress, winds = stayed_mast()
    jc.save_scene("mast.json", (structure, [prestress, jc.Phase(loads=winds[0].loads)]))
    words = "optimize mast.json --same-in-group --deflection 0.1"
    assert command(f"{words} --save best.json") == 0
    told = capsys.readouterr().out
    assert "SLACK" not in told and "differ by a factor" not in told
    assert "of 'stays': met, BUT ONLY JUST: 1 of 2 cables have less than 1% of the " in told
    assert "slack in practice; --lowest FORCE keeps more; no other limit governs\n" in told
    found = np.unique(np.asarray(jc.load_scene("best.json").phases[0].pretension["stays"]))
    np.testing.assert_allclose(found, NEEDED, rtol=1e-3)
    assert command(f"{words} --bounds 100 1e5 --allow-slack") == 0
    told = capsys.readouterr().out
    assert "sum of the pretensions 200 N" in told  # of two stays
    assert "SLACK at the end: 1 of 2 elements of 'stays': 0\n" in told
    assert command(f"{words} --bounds 0 100") == 1
    told = capsys.readouterr().out
    limit = "limit on slack: no cable may be slack, lowest tension 0 N, element 0 of 'stays'"
    assert f"{limit}: violated\n" in told and "no other limit governs" not in told
    assert command("optimize mast.json --lowest 500 --same-in-group --save best.json") == 0
    told = capsys.readouterr().out  # of cables: the mast is compressed
    assert "limit on the lowest tension at the end: 500 N" in told and ": met" in told
    assert "ONLY JUST" not in told
    found = np.unique(np.asarray(jc.load_scene("best.json").phases[0].pretension["stays"]))
    np.testing.assert_allclose(found, NEEDED + 500.0, rtol=1e-3)
    for words, message in (
        ("--lowest 10 --allow-slack", "--allow-slack: contradicts --lowest"),
        ("--target 10 --allow-slack", "--allow-slack: is for --deflection and --lowest"),
        ("--target 10 --combinations 'EN 1990'", "--combinations: is for --deflection and"),
    ):
        assert command(f"optimize mast.json {words}") == 2
        assert message in capsys.readouterr().err


def test_optimize_keeps_limits_in_all_combinations(folder, capsys):
    structure, prestress, winds = stayed_mast()
    jc.save_scene("mast.json", (structure, prestress), actions=winds, combinations="EN 1990")
    words = "optimize mast.json --same-in-group --deflection 0.1 --which 'SLS characteristic'"
    assert command(f"{words} --save best.json") == 0
    told = capsys.readouterr().out
    found = np.unique(np.asarray(jc.load_scene("best.json").phases[0].pretension["stays"]))
    np.testing.assert_allclose(found, NEEDED, rtol=1e-3)
    many = jc.design.combinations(winds, which=["SLS characteristic"])
    name = many.names[[many.formula(k) for k in range(len(many))].index("1 west")]
    limit = "limit on displacements of 3 combinations, from the prestressed state: 0.1 m"
    assert limit in told and f" in {name}: met" in told
    phase = jc.Phase(pretension={"stays": found[0]})
    forces = converged_cases(structure, phase, many)
    assert f"axial forces over 3 combinations {forces.min():.6g} to {forces.max():.6g} N" in told


def test_buckling_factors_of_cases_refer_to_the_end_of_the_phases(folder, capsys):
    """As with the solution of the phases in Python: the prestressed mast carries 32 kN."""
    structure, prestress, winds = stayed_mast()
    tube = jc.catalogue.profile_data("CHS 168.3x8")
    steel = {"elements": "mast", "profile": tube, "yield_strength": 355e6, "factors": 3.0}
    rules = [jc.design.MemberBuckling(**steel, reference="last phase")]
    more = {"combinations": "EN 1990", "checks": rules}
    jc.save_scene("mast.json", (structure, prestress), actions=winds, **more)
    assert command("solve mast.json --which 'ULS 6.10'") == 3  # 32 kN is critical
    told = capsys.readouterr().out
    calm = jc.solve(structure, prestress)
    found = jc.design.combinations(winds, which=["ULS 6.10"])
    cases = jc.design.solve_cases(structure, prestress, found)
    assert int(calm.status) == 0 and (np.asarray(cases.status) == 0).all()
    used = []
    for reference in (calm, None):
        own = jc.design.MemberBuckling(**steel, reference=reference)
        used.append(float(jc.design.checks(structure, cases, own, combinations=found).largest))
    assert f"member buckling: FAILS: utilization {used[0]:.3f}" in told and used[1] < 0.5 * used[0]


def converged_cases(structure, phase, many):
    """The axial forces of all elements in all combinations, N, of which none has failed."""
    cases = jc.design.solve_cases(structure, phase, many)
    assert (np.asarray(cases.status) == 0).all()
    return np.concatenate([np.ravel(force) for force in cases.tension.values()])


def test_optimize_keeps_forces_below_the_strength(folder, capsys):
    """Alone, a stay carries the pull of 10 kN by 10 kN / 0.6, whatever its pretension."""
    structure, prestress, winds = stayed_mast()
    stays = jc.replace(structure.elements["stays"], strength=16e3)
    structure = jc.replace(structure, elements={**structure.elements, "stays": stays})
    jc.save_scene("mast.json", (structure, [prestress, jc.Phase(loads=winds[0].loads)]))
    assert command("optimize mast.json --same-in-group --deflection 0.1 --save best.json") == 1
    told, err = capsys.readouterr()
    (line,) = [one for one in told.splitlines() if "limit on force / strength" in one]
    used = float(line.split("reached ")[1].split(",")[0])
    # 3 digits are printed; the mast, which deflects, changes forces by 1 in 2000
    assert used >= 10e3 / 0.6 / 16e3 * (1 - 5e-3)
    assert "element 1 of 'stays': violated by" in line
    assert "best.json: not written: the limits are violated" in err


def weak_rope():
    """A hanging rope that yields at 40 kN."""
    law = jc.Polygonal([0.0, 2e-3, 0.1], [0.0, 4e8, 4e8])
    rope = jc.Cables([[0, 1]], area=1e-4, law=law)
    supports = jc.pinned([0]) + jc.restrained([1], "xy")
    return jc.Structure([[0.0, 0.0, 2.0], [0.0, 0.0, 0.0]], rope, supports=supports)


REFUSED = {
    "bare.json --combinations 'EN 1990'": "bare.json: has no actions to combine",
    "rope.json --combinations 'EN 199'": "rules = 'EN 199': expected a name",
    "rope.json --combinations 'EN 1990' --which ULS": "which: 'ULS': is no rule and no limit",
    "rope.json --which 'ULS 6.10'": "--which: is for combinations",
    "rope.json --case-increments 2": "--case-increments: is for combinations",
    "rope.json --combinations none.json": "none.json: No such file",
    "rope.json --report rope.doc": "expected a name that ends with .txt",
}


def test_what_cannot_be_combined_is_refused(folder, capsys):
    for words, message in REFUSED.items():
        assert command(f"solve {words}") == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert line.startswith("jaxcable: ") and message in line


def test_combinations_that_fail_are_named(folder, capsys):
    """A rope yields at 40 kN, and 1.5 times the snow is 60 kN: other cases are reported."""
    phases = [jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -1000.0)))]
    jc.save_scene("weak.json", (weak_rope(), phases), actions=actions(-4e4)[1:])
    words = "solve weak.json --combinations 'EN 1990' --which 'ULS 6.10' --report"
    assert command(words) == 1
    out, err = capsys.readouterr()
    assert "2 of 5 combinations failed: ULS 6.10-" in err
    assert "left out of envelopes: ULS 6.10-" in out


def test_info_shows_actions_and_refuses_what_solve_cannot_combine(folder, capsys):
    assert command("info rope.json") == 0
    told = capsys.readouterr().out
    assert "action self-weight, permanent (in the phases)\n  SelfWeight\n" in told
    assert "action snow, snow\n  NodalLoads on 1 node, sum (0, 0, -1) kN\n" in told
    wrong = jc.replace(actions()[1], kind="winds")
    save = {"actions": [actions()[0], wrong], "combinations": "EN 1990"}
    jc.save_scene("wrong.json", (STRUCTURE, PHASES), **save)
    for name in ("solve", "info"):
        assert command(f"{name} wrong.json") == 2
        assert "wrong.json: actions[1]: kind = 'winds': the rules" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "names"),
    [
        ("form {} --force-density 2", ["prestress", "snow"]),
        ("form {} --force-density 2 --loads 2", ["form of prestress", "prestress"]),
        ("optimize {} --target 6 --same-in-group --steps 1 --keep", ["prestress", "snow"]),
    ],
)
def test_commands_keep_all_that_a_scene_has_beside_structure_and_phases(words, names, folder):
    """All keys of the format, of which comments and $schema are for whoever edits the file."""
    scene = json.loads(Path("rope.json").read_text(encoding="utf-8"))
    snow = {"name": "snow", "loads": {"type": "NodalLoads", "nodes": [1], "forces": [0, 0, -1]}}
    scene["phases"] = [scene["phases"][0] | {"name": "prestress"}, snow]
    scene |= {"combinations": "EN 1990", "checks": ["EN 1993-1-11"]}
    keys = jc.files.scene_schema()["properties"].keys() - {"comment", "$schema"}
    assert scene.keys() == keys, "a new key of the format must be tried here"
    Path("named.json").write_text(json.dumps(scene), encoding="utf-8")
    assert command(words.format("named.json") + " --save kept.json --quiet") in (0, 1)
    kept = json.loads(Path("kept.json").read_text(encoding="utf-8"))
    for key in keys - {"structure", "phases"}:
        assert kept[key] == scene[key], key
    assert [phase["name"] for phase in kept["phases"]] == names
