"""Tables of what was analysed: nodes, properties, phases, factors of actions; each by hand."""

import json

import numpy as np
import pytest
from golden_files import assert_golden
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.__main__ import main
from jaxcable.analysis.load_resultants import load_resultants
from jaxcable.cli import file_names
from jaxcable.common.units import as_units
from jaxcable.reporting.document import Heading, make_document
from jaxcable.reporting.load_descriptions import describe_actions, describe_load
from jaxcable.reporting.table import Table

STEEL = 210e9  # Pa
TUBE = jc.Section.rectangle(0.1, 0.2, jc.Elastic(STEEL))
NODES = [[0.0, 0, 0], [3.0, 0, 0], [6.0, 0, 0], [3.0, 0, 4.0]]
GROUPS = {
    "beams": jc.Beams(
        [[0, 1], [1, 2]], TUBE, torsional_stiffness=5e6, hinges=[[False] * 2, [False, True]]
    ),
    "stays": jc.Cables([[3, 0], [3, 1], [3, 2]], axial_stiffness=[1e7, 2e7, 2e7], strength=3e5),
    "strut": jc.Bars([[1, 3]], area=2e-3, law=jc.Elastic(STEEL), weight=150.0),
    "ground": jc.Springs([1], stiffness=5e5),
}
BEFORE = jc.clamped([0]) + jc.pinned([3])
SKEW = jc.restrained([2], "x", axes=(1.0, 0.0, 1.0))
AFTER = BEFORE + SKEW
BRIDGE = jc.Structure(NODES, GROUPS, supports=BEFORE)
PHASES = {
    "stays": jc.Phase(
        jacking={"stays": jc.only([1], 2e4)}, loads=jc.SelfWeight(), removes={"strut": [True]}
    ),
    "bearing": jc.Phase(supports=AFTER, loads=jc.NodalLoads([1], (0.0, 0.0, -500.0)), increments=2),
}


@pytest.fixture(scope="module")
def solution():
    return converged(jc.solve(BRIDGE, list(PHASES.values())))


@pytest.fixture(scope="module")
def written(solution):
    return jc.report(BRIDGE, solution, PHASES, model=True, units="kN, m")


def rows(table):
    """Return the rows of a table as dicts by the name of the column."""
    return [dict(zip(table.columns, row, strict=True)) for row in table.rows]


def test_the_report_says_what_was_analysed(written, tmp_path, capsys):
    """Nodes with supports, properties, phases; all words of it, and of the results.

    Reports that the command writes have them, too, and those on the screen have not.
    """
    assert_golden("bridge.txt", written.text())
    jc.save_scene(tmp_path / "bridge.json", (BRIDGE, list(PHASES.values())), units="kN, m")
    words = ["solve", str(tmp_path / "bridge.json"), "--report"]
    assert main(words) == 0
    assert "Properties of elements" not in capsys.readouterr().out
    assert main([*words, str(tmp_path / "r.json")]) == 0
    tables = json.loads((tmp_path / "r.json").read_text())["tables"]
    assert list(tables)[:3] == ["geometry", "properties", "phases"]
    assert tables["phases"]["rows"][1][3] == "jacking 20 kN on stays (element 1 of 3)"


@pytest.mark.slow
def test_supports_have_their_directions():
    skew = jc.replace(BRIDGE, supports=AFTER)
    solved = converged(jc.solve(skew, PHASES["stays"]))
    found = rows(jc.report(skew, solved, model=True).tables["geometry"])
    assert [row["held"] for row in found] == [
        *("x y z rx ry rz", None, "along (0.707, 0, 0.707)", "x y z")
    ]


def test_properties_are_those_of_the_groups_one_row_for_equal_elements(written):
    """EA = E b h, EIy = E b h^3 / 12 of the rectangle; E A of the strut."""
    found = rows(written.tables["properties"])
    assert [row["elements"] for row in found] == ["0 to 1", "0", "0", "1 to 2", "0"]
    beams, _, first, others, strut = found
    by_hand = [STEEL * 0.1 * 0.2, STEEL * 0.1 * 0.2**3 / 12, STEEL * 0.2 * 0.1**3 / 12, 5e6]
    stated = [beams[name] for name in ("EA", "EIy", "EIz", "GJ")]
    np.testing.assert_allclose(stated, np.array(by_hand) / 1e3, rtol=1e-12)  # kN, kN m2
    assert (first["EA"], others["EA"], first["strength"]) == (1e4, 2e4, 300.0)
    np.testing.assert_allclose([strut["EA"], strut["weight"]], [STEEL * 2e-3 / 1e3, 0.15])


def test_directions_that_are_axes_have_their_names():
    """Two held directions, one of them vertical; without a visible motion no final positions."""
    axes = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    ends = jc.pinned([0]) + jc.restrained([1], "yz", axes=axes[None])
    bar = jc.Structure([[0, 0, 0], [1.0, 0, 0]], jc.Bars([[0, 1]], 1e6), supports=ends)
    found = rows(jc.report(bar, jc.solve(bar, jc.Phase()), model=True).tables["geometry"])
    assert [row["held"] for row in found] == ["x y z", "z, along (-0.8, 0.6, 0)"]
    assert "x end" not in found[0]


def test_names_of_phases_come_with_them_or_apart(solution):
    """A dict names its phases everywhere; without phases there is no table of them."""
    named = jc.report(BRIDGE, solution, PHASES, since="bearing")
    assert any(line.startswith("phase 2, bearing:") for line in named.summary)
    apart = jc.report(BRIDGE, solution, list(PHASES.values()), names=list(PHASES), since="bearing")
    assert named.text() == apart.text()
    assert not {"geometry", "properties", "phases"} & set(named.tables)
    without = jc.report(BRIDGE, solution, model=True).tables
    assert {"geometry", "properties"} <= set(without) and "phases" not in without
    ends = [[row[f"{axis} end"] for axis in "xyz"] for row in rows(without["geometry"])]
    np.testing.assert_allclose(ends, solution.positions, atol=1e-12)
    other = jc.report(BRIDGE, solution, PHASES, names=["a", "b"], model=True).tables["phases"]
    assert {row[1] for row in other.rows} == {"a", "b"}
    with pytest.raises(ValueError, match="phases: 1 of them, the solution has 2"):
        jc.report(BRIDGE, solution, {"stays": PHASES["stays"]})


def test_cases_move_since_a_phase_before_them(solution):
    """Cases that begin at the end of the phases have no phases of their own from before."""
    push = jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -100.0)))
    cases = jc.design.solve_cases(BRIDGE, None, [push], start=solution)
    assert np.asarray(cases.status).tolist() == [0]
    found = jc.report(BRIDGE, solution, PHASES, cases=cases, since="bearing")
    table = found.tables["displacements_since"]
    begin = solution.phases[1].positions - solution.phases[1].displacement_in_phase
    moved = np.asarray(cases.positions[0] - begin)
    for row in table.rows:
        shown = [row[table.columns.index(f"u{axis}")] for axis in "xyz"]
        np.testing.assert_allclose(shown, moved[row[0]], rtol=1e-12, atol=1e-15)
    assert len(table.rows) > 0


def test_cases_move_since_the_end_of_the_phases_before_them(solution):
    """By "last phase", or by the only phase; the first one of two is counted from its beginning."""
    push = jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -100.0)))
    one = jc.solve(BRIDGE, PHASES["stays"])
    for begun, phases, since, before, title in (
        (solution, PHASES, "last phase", solution.displacement, "the end of phase 2, bearing"),
        (solution, PHASES, "stays", 0.0, "the beginning of phase 1, stays"),
        (one, {"stays": PHASES["stays"]}, 0, one.displacement, "the end of phase 1, stays"),
    ):
        cases = jc.design.solve_cases(BRIDGE, None, [push], start=begun)
        assert np.asarray(cases.status).tolist() == [0]
        found = jc.report(BRIDGE, begun, phases, cases=cases, since=since)
        table = found.tables["displacements_since"]
        assert table.title == f"Displacements since {title}, by case"
        moved = np.asarray(cases.displacement[0] - before)
        shown = [row[table.columns.index("uz")] for row in table.rows]
        nodes = [row[0] for row in table.rows]
        np.testing.assert_allclose(shown, moved[nodes, 2], rtol=1e-9, atol=1e-12)
        sizes = np.linalg.norm(moved, axis=1)
        text = f"{sizes.max():.4g} m, node {sizes.argmax()}, case 0"
        assert f"largest displacement since {title}: {text}" in found.summary


def test_stages_have_their_forces_and_reactions():
    """Of three phases, by their solutions: forces of active elements, reactions and their sum."""
    third = jc.Phase(adds={"strut": [True]}, loads=jc.NodalLoads([2], (0.0, 0.0, -300.0)))
    stages = {**PHASES, "strut": third}
    built = converged(jc.solve(BRIDGE, list(stages.values())))
    begin = jc.report(BRIDGE, built, stages).tables
    table = begin["forces_by_phase"]
    assert table.columns[4:] == tuple(stages) and table.units[4:] == ("N",) * 3
    forces = {(row[0], row[1]): row[4:] for row in table.rows}
    for k, phase in enumerate(built.phases):
        for name, force in phase.peak_tension.items():
            if force is None:
                continue
            for number, value in enumerate(np.asarray(force)):
                shown = forces[name, number][k]
                absent = name == "strut" and k < 2
                # a force of 1e-7 of the largest one is zero in tables
                assert (shown is None) if absent else shown == pytest.approx(float(value), abs=1e-2)
    table = begin["reactions_by_phase"]
    at = {(row[0], row[1]): row[2:5] for row in table.rows}
    for phase, name in zip(built.phases, stages, strict=True):
        reactions = np.asarray(phase.reactions)
        np.testing.assert_allclose(at[3, name], reactions[3], atol=1e-6)
        spring = np.asarray(phase.element_results["spring_force"]["ground"]).sum(axis=0)
        np.testing.assert_allclose(at["sum", name], reactions.sum(axis=0) + spring, atol=1e-6)
    assert (2, "stays") not in at and (2, "strut") in at  # held from the second phase on
    assert (
        "displacements_by_phase" not in begin
        and "forces_by_phase"
        not in jc.report(BRIDGE, jc.solve(BRIDGE, list(PHASES.values())), PHASES).tables
    )
    cases = [jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, p))) for p in (-200.0, 200.0)]
    solutions = jc.design.solve_cases(BRIDGE, None, cases, start=built)
    over = jc.report(BRIDGE, built, stages, cases=solutions)
    assert over.tables["displacements_by_phase"].rows == begin["displacements"].rows
    titles = [table.title for table in over.tables.values()]
    assert len({*titles}) == len(titles)
    first = {name: text.partition("\n")[0].rstrip() for name, text in over.csv().items()}
    for name in ("forces_by_phase", "reactions_by_phase", "displacements_by_phase"):
        assert first[name].startswith(file_names.REPORT[name]) and " (" in first[name]


def test_nodes_without_active_elements_have_no_values():
    """Bars of 1 m and 1 MN in a row, under 1 kN each; the lower one is there in phase 2 alone.

    Each kN makes each bar longer by 1 mm; 0.5 %: bars are added in the deformed geometry.
    """
    bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e6)
    guide = jc.pinned([0]) + jc.restrained([1, 2], "xy")
    chain = jc.Structure([[0.0, 0, 0], [0.0, 0, -1.0], [0.0, 0, -2.0]], bars, supports=guide)
    phases = [
        jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -1e3))),
        jc.Phase(loads=jc.NodalLoads([2], (5.0, 0.0, -1e3)), adds=jc.only([1])),  # on the guide
        jc.Phase(removes=jc.only([1])),
    ]
    tables = jc.report(chain, converged(jc.solve(chain, phases))).tables
    shown = [row[4] for row in tables["displacements"].rows]
    np.testing.assert_allclose(shown, [-1e-3, -2e-3, -1e-3, -2e-3], rtol=5e-3)
    (lower,) = [row for row in rows(tables["displacement_envelope"]) if row["node"] == 2]
    assert lower["min uz"] == lower["max uz"] == shown[3]
    held = {(row[0], row[1]): row[2] for row in tables["reactions_by_phase"].rows}
    assert (2, "phase 1") not in held and held[2, "phase 2"] == pytest.approx(-5.0)


def test_actions_have_the_factors_of_their_kinds(solution):
    """Factors of EN 1990, tables A1.1, A1.2(B), A2.2 and A2.4(B); ASCE 7 has none by kind."""
    load = jc.NodalLoads([1], (0.0, 0.0, -1e3))
    kinds = {"dead": "permanent", "snow": "snow", "crowd": "imposed C"}
    kinds["walkers"] = "footbridge crowd"
    actions = [jc.design.Action(name, kind, load) for name, kind in kinds.items()]
    chosen = jc.design.combinations(actions).select_rules("ULS 6.10")
    cases = jc.design.solve_cases(BRIDGE, None, chosen, start=solution)
    assert not np.asarray(cases.status).any()
    written = jc.report(BRIDGE, solution, cases=cases, combinations=chosen).tables
    factors = ("gamma", "psi0", "psi1", "psi2")
    found = {row["action"]: [row[name] for name in factors] for row in rows(written["actions"])}
    assert found == {
        "dead": [None] * 4,
        "snow": [1.5, 0.5, 0.2, 0.0],
        "crowd": [1.5, 0.7, 0.7, 0.6],
        "walkers": [1.35, 0.4, 0.4, 0.0],
    }
    notes = written["combinations"].notes
    text = "ULS 6.10: permanent 1.35 or 1, prestress 1, leading gamma, accompanying gamma psi0"
    assert any(note.startswith(text) for note in notes)
    assert not any("SLS" in note for note in notes)
    american = jc.design.combinations(actions[:2], "ASCE 7-16")
    assert american.kind_factors == ()
    assert american.rule_factors[0] == "permanent 1.4, prestress 1, temperature 1"
    assert any("one of (roof live 1.6, snow 1.6, rain 1.6)" in of for of in american.rule_factors)


MAST = jc.Structure(
    [[0.0, 0, 0], [0.0, 0, 10.0], [6.0, 0, 0], [0.0, 0, 2.0]],
    {
        "guys": jc.Cables([[1, 2]], axial_stiffness=1e7),
        "mast": jc.Beams([[0, 3], [3, 1]], TUBE, torsional_stiffness=5e6, weight=300.0),
    },
    supports=jc.clamped([0]) + jc.pinned([2]),
)
PEAK = (1 + 7 / np.log(200.0)) * 0.5 * 1.25 * (25.0 * 0.19 * np.log(200.0)) ** 2  # EN 1991-1-4, 4.8
WIND = jc.EurocodeWind(25.0, "II")
LOADS = [  # what is said of a load, the load, and its resultant by hand
    (
        "WindLoads on guys towards (0, 1, 0): wind table of 1 heights; drag 1.2, diameter 0.02 m, "
        "factor 1.5, velocity pressure 500 N/m2 at its nodes",
        jc.WindLoads((0, 1, 0), jc.WindTable(pressures=500.0), 1.2, 0.02, "guys", factor=1.5),
        (0.0, 500.0 * 1.2 * 0.02 * 1.5 * np.hypot(6.0, 10.0), 0.0),
    ),
    (
        "CablePressure on guys (per current length); pressure 10 N/m, axis (0, 1, 0)",
        jc.CablePressure(10.0, (0.0, 1.0, 0.0), on="guys"),
        (-100.0, 0.0, -60.0),  # axis x chord, (0, 1, 0) x (6, 0, -10)
    ),
    (
        "FacePressure on 1 faces; pressure 20 N/m2",
        *(jc.FacePressure([[0, 2, 1]], 20.0), (0.0, -600.0, 0.0)),  # 30 m2
    ),
    (
        "AreaLoads on 1 faces (per initial area); forces (0, -1, 0) N/m2",
        *(jc.AreaLoads([[0, 2, 1]], (0.0, -1.0, 0.0), per="initial"), (0.0, -30.0, 0.0)),
    ),
    (
        "PointLoads at 1 places, sum (0, 3, 0) N; places 0.5",
        *(jc.PointLoads([1], 0.5, (0.0, 3.0, 0.0), on="mast"), (0.0, 3.0, 0.0)),
    ),
    (
        "Train of 2 axles on 2 elements; position 6 m, forces (5, 0, 0) N, spacings 2 m",
        *(jc.loads.Train([0, 1], 6.0, (5.0, 0.0, 0.0), spacings=[2.0]), (10.0, 0.0, 0.0)),
    ),
    (
        "Crowd on 1 part of 2 elements; forces (5, 0, 0) N/m, begin 1 m, end 4 m",
        *(jc.loads.Crowd([0, 1], (5.0, 0.0, 0.0), 1.0, 4.0), (10.0, 0.0, 0.0)),  # 2 m are active
    ),
    (
        "SelfWeight; amplitude: 0 at 0, 0.5 at 1",
        *(jc.Varying(jc.SelfWeight(), [0.0, 1.0], [0.0, 0.5]), (0.0, 0.0, -300.0 * 8.0)),
    ),
    (
        "SupportMovement of node 2; displacements (0.01, 0, 0) m",
        *(jc.SupportMovement([2], (0.01, 0.0, 0.0)), (np.nan,) * 3),
    ),
]


def test_loads_have_their_numbers_and_their_resultants():
    """What a checking engineer needs, by hand; the lower 2 m of the mast are not active."""
    present = [np.ones(1, bool), np.array([False, True])]
    texts, loads, sums = zip(*LOADS, strict=True)
    found = load_resultants(MAST, loads, present)
    np.testing.assert_allclose(found, sums, rtol=1e-12, atol=1e-9)
    assert [describe_load(load, MAST, None) for load in loads] == list(texts)
    wind = jc.WindLoads((1, 0, 0), WIND, drag=1.2, diameter=0.2, on="mast", elements=jc.only([1]))
    told = describe_load(wind, MAST, as_units("kN, m"))
    assert "(element 1)" in told and f" to {PEAK / 1e3:.6g} kN/m2 at its nodes" in told
    winds = [loads[0], jc.replace(loads[0], direction=(1.0, 0, 0)), jc.replace(loads[0], drag=0.8)]
    actions = [jc.design.Action(f"wind {k}", "wind", load) for k, load in enumerate(winds)]
    texts = describe_actions(actions, MAST, None)
    assert texts[1] == "WindLoads on guys towards (1, 0, 0), as wind 0" and "0.8" in texts[2]


@pytest.mark.parametrize(
    ("letters", "count", "turned"), [("w ", 9, 0), ("w", 9, 1), ("w ", 12, 1), (7 * "w ", 9, 1)]
)
def test_a_table_with_a_text_that_wraps_stays_on_an_upright_page(letters, count, turned):
    """Of the 470 points of a page each number takes 36; a text that wraps needs 20 characters.

    One of more than eight lines, as that of a wind on many groups, gets a page in landscape format.
    """
    names = ("group", *(f"f{k}" for k in range(count)), "also")
    units = ("", *["N"] * count, "")
    rows = [["ties", *[1e6] * count, 60 * letters]] * 16  # of up to 15 rows it would be in parts
    table = Table("T", names, units, rows)
    (table,) = make_document([], {"t": table}, None, Heading(), {}, 100).tables
    assert len(table.parts) == 1 and table.landscape == bool(turned)
