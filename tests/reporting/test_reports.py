"""Reports of nets: what they say is checked against statics and against the solution itself."""

import csv
import io
import json
import warnings

import jax
import numpy as np
import pytest
from golden_files import assert_golden
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.model import result_parts
from jaxcable.reporting.lengths import cable_chains


@pytest.fixture(scope="module")
def net():
    """A saddle with strengths, whose second case leaves cables slack and whose third fails."""
    structure, (prestress, _) = jc.scenes.saddle(3, 3)
    cables = jc.replace(structure.elements, strength=400e3, expansion=1.2e-5)
    structure = jc.replace(structure, elements={"net": cables})
    prestress = jc.replace(prestress, temperature=20.0)
    free = np.flatnonzero(~structure.supports.fixed(structure.n_node)[:, 0])
    forces = np.zeros((3, len(free), 3))
    forces[0, :, 2] = -500.0
    forces[1, :4, 2] = -90e3
    forces[2, 0, 2] = np.nan
    solution = jc.solve(structure, [prestress])
    loads = [jc.NodalLoads(free, force) for force in forces]
    cases = [jc.solve(structure, [jc.Phase(loads=load)], start=solution) for load in loads]
    assert [int(of.status) for of in (solution, *cases)] == [0, 0, 0, 3]
    batch = jax.tree.map(lambda *of: np.stack(of), *cases)
    return structure, prestress, solution, batch


@pytest.fixture(scope="module")
def told(net):
    structure, prestress, solution, batch = net
    names = ["snow", "half", "broken"]
    return jc.report(structure, solution, [prestress], cases=batch, names=names)


@pytest.fixture(scope="module")
def flat():
    structure, phases = jc.scenes.flat_net(load=15.0)
    return structure, converged(jc.solve(structure, phases))


def column(table, name):
    return [row[[c.strip() for c in table.columns].index(name)] for row in table.rows]


# --- equilibrium


def test_reactions_balance_the_loads(net):
    structure, _, _, batch = net
    snow = jax.tree.map(lambda x: np.asarray(x)[0], batch)
    tables = jc.report(structure, snow).tables
    rows = {row[0]: np.array(row[1:]) for row in tables["equilibrium"].rows}
    np.testing.assert_allclose(rows["loads"], [0, 0, -9 * 500.0])
    # the tolerance of the analysis, 1e-10 of the nodal forces, at some 20 nodes
    both = rows["loads"] + rows["reactions"]
    assert np.abs(both).max() < 1e-8 * 20e3
    # the same numbers added in another order: a rounding of their sizes (some ulps of 4500 N)
    rounding = np.finfo(float).eps * (9 * 500.0 + np.abs(snow.reactions[:, 2]).sum())
    np.testing.assert_allclose(rows["sum of forces"], both, rtol=0, atol=rounding)
    held = np.flatnonzero(structure.supports.fixed(structure.n_node)[:, 0])
    assert sorted(column(tables["reactions"], "node")) == held.tolist()
    by_hand = np.array([row[1:4] for row in tables["reactions"].rows]).sum(axis=0)
    np.testing.assert_allclose(by_hand, rows["reactions"], atol=1e-9)


def test_a_report_of_a_state_out_of_balance_says_so(net):
    """The check of equilibrium is not that of the solver: a reaction that is wrong is noticed."""
    structure, _, solution, _ = net
    good = jc.report(structure, solution).tables["equilibrium"].notes[0]
    assert float(good.split(": ")[1].split(" N")[0]) < 1e-6
    last = jc.replace(solution.last, reactions=solution.last.reactions.at[0, 0].add(7.0))
    bad = jc.report(structure, jc.replace(solution, last=last)).tables["equilibrium"].notes[0]
    assert bad.startswith("unbalanced force: 7.0e+00 N")


def test_a_failed_analysis_is_reported_as_failed(net):
    structure, prestress, _, _ = net
    heavy = jc.NodalLoads([5], (0.0, 0.0, np.nan))
    phases = [prestress, jc.Phase(loads=heavy, increments=2)]
    failed = jc.report(structure, jc.solve(structure, phases), phases)
    assert failed.status == 3
    assert any(line.startswith("FAILED: what follows is the last") for line in failed.summary)
    # the prestressed state is what converged last; its envelope is that of phase 1
    forces = failed.tables["members"]
    assert column(forces, "force") == column(forces, "highest")
    assert np.isfinite(column(forces, "force")).all()


# --- members and cases


def test_forces_utilisation_and_envelope(net, told):
    _, _, solution, batch = net
    table = told.tables["members"]
    tensions = np.asarray(batch.tension["net"])[:2]
    names = np.array(["snow", "half"])
    assert column(table, "force") == solution.tension["net"].tolist()
    np.testing.assert_array_equal(column(table, "lowest"), tensions.min(axis=0))
    np.testing.assert_array_equal(column(table, "highest"), tensions.max(axis=0))
    assert [row[6] for row in table.rows] == names[tensions.argmin(axis=0)].tolist()
    assert [row[8] for row in table.rows] == names[tensions.argmax(axis=0)].tolist()
    np.testing.assert_allclose(column(table, "used"), solution.tension["net"] / 400e3)
    np.testing.assert_allclose(column(table, "most used"), tensions.max(axis=0) / 400e3)
    # failed cases are named and left out
    (line,) = [line for line in told.summary if line.startswith("left out")]
    assert line.startswith("left out of envelopes: broken (status 3: ")
    assert "nan" not in told.text().replace("broken", "")


def test_slack_cables_and_loose_nodes(net, told):
    _, _, _, batch = net
    slack = np.flatnonzero(np.asarray(batch.tension["net"])[1] == 0)
    assert len(slack) > 0
    assert told.tables["slack"].rows == [["net", k, "half"] for k in slack.tolist()]
    assert "loose" not in told.tables  # no node is: an empty table is left out
    hung = jc.Structure(
        [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]],
        jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5, rest_length=1.2),
        jc.pinned([0, 2]),
    )
    found = converged(jc.report(hung, jc.solve(hung, jc.Phase())))
    assert found.tables["slack"].rows == [["", 0, "phase 1"], ["", 1, "phase 1"]]
    assert found.tables["loose"].rows == [[1, "phase 1"]]
    assert any("2 slack cables (elements 0, 1), 1 node that" in line for line in found.summary)
    named = result_parts.count_and_names_of_slack_elements
    assert named(hung, jc.solve(hung, jc.Phase()), most=1) == (2, "elements 0 and 1 more")
    assert found.tables["members"].notes == ("no group has a strength",)


def test_groups_say_which_element_is_most_used(flat):
    nodes = [[0.0, 0, 0], [0, 0, -1], [0, 0, -2], [1, 0, 0], [1, 0, -1]]
    parts = {
        "rope": jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e6, strength=[1e3, 5e2]),
        "wire": jc.Cables([[3, 4]], axial_stiffness=1e5),
    }
    structure = jc.Structure(nodes, parts, supports=jc.pinned([0, 3]))
    load = jc.NodalLoads([1, 2, 4], [[0, 0, -100.0], [0, 0, -300.0], [0, 0, -50.0]])
    solution = converged(jc.solve(structure, jc.Phase(loads=load)))
    rope, wire = jc.report(structure, solution).tables["groups"].rows
    # 400 N of 1 kN above, 300 N of 500 N below: the lower one is used more
    np.testing.assert_allclose([rope[2], rope[5], rope[8]], [300.0, 400.0, 0.6], rtol=1e-9)
    assert (rope[3], rope[6], rope[9]) == (1, 0, 1)
    assert wire[8:] == [None, None]
    assert "groups" not in jc.report(*flat).tables


# --- lengths


def crossed(n=4):
    """A net of n x n cables with spacing 1 m, elements in no order; nodes and links."""
    places = [(i, j) for i in range(n + 2) for j in range(n + 2)]
    number = {place: k for k, place in enumerate(places)}
    links = [(number[i, j], number[i + 1, j]) for j in range(1, n + 1) for i in range(n + 1)]
    links += [(number[i, j], number[i, j + 1]) for i in range(1, n + 1) for j in range(n + 1)]
    random = np.random.default_rng(3)
    links = np.array(links)[random.permutation(len(links))]
    turned = random.random(len(links)) < 0.5
    links[turned] = links[turned][:, ::-1]
    used, flat = np.unique(links, return_inverse=True)
    nodes = np.array([(i, j, 0.02 * (i * i - j * j)) for i, j in places], float)[used]
    return nodes, flat.reshape(-1, 2)


def test_cables_of_a_net_run_through_all_crossings():
    nodes, links = crossed()
    found = cable_chains(links, nodes)
    assert sorted(len(elements) for elements, _ in found) == [5] * 8
    assert sorted(np.concatenate([elements for elements, _ in found])) == list(range(40))
    for elements, turned in found:
        path = np.where(turned[:, None], links[elements][:, ::-1], links[elements])
        assert (path[1:, 0] == path[:-1, 1]).all()
        along = nodes[path[-1, 1]] - nodes[path[0, 0]]
        assert np.isclose(np.abs(along[:2]).max(), 5.0, rtol=1e-15)  # straight in plan
        assert np.abs(along[:2]).min() == 0.0


def test_a_ring_is_one_cable_and_a_corner_ends_two():
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    links = np.column_stack([np.arange(12), np.roll(np.arange(12), -1)])
    ((elements, turned),) = cable_chains(links, ring)
    assert sorted(elements) == list(range(12)) and not turned.any()
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])  # a right angle: no cable goes on
    assert len(cable_chains(np.array([[0, 1], [1, 2]]), corner)) == 2
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [1.6, 0.8, 0]])  # 53 degrees: it does
    assert len(cable_chains(np.array([[0, 1], [2, 1]]), flat)) == 1


def test_marks_are_sums_of_unstressed_lengths():
    nodes, links = crossed(2)
    edge = np.flatnonzero(np.bincount(links.ravel(), minlength=len(nodes)) == 1)
    cables = {"net": jc.Cables(links, axial_stiffness=1e6), "idle": jc.Bars([[0, 1]], 1e3)}
    structure = jc.Structure(nodes, cables, supports=jc.pinned(edge))
    solution = converged(jc.solve(structure, jc.Phase(pretension={"net": 5e3})))
    report = jc.report(structure, solution)
    length = np.asarray(solution.rest_length["net"])
    pieces, whole = report.tables["cutting_list"], report.tables["cables"]
    assert column(whole, "group") == ["net"] * 4
    totals = column(whole, "unstressed length")
    for number, total in zip(column(whole, "cable"), totals, strict=True):
        own = [row for row in pieces.rows if row[0] == "net" and row[5] == number]
        assert len(own) == 3
        assert np.isclose(total, sum(length[row[1]] for row in own), rtol=1e-14)
        # every node of the cable has one mark, from whichever of its two elements it is read
        marks = {}
        for row in own:
            assert np.isclose(abs(row[7] - row[6]), length[row[1]], rtol=1e-12)
            for node, mark in ((row[2], row[6]), (row[3], row[7])):
                assert np.isclose(marks.setdefault(node, mark), mark, atol=1e-12)
        assert len(marks) == 4 and min(marks.values()) == 0.0
        assert np.isclose(max(marks.values()), total, rtol=1e-14)
    assert [row[5:] for row in pieces.rows if row[0] == "idle"] == [[None] * 3]
    read = list(csv.DictReader(io.StringIO(report.csv()["cables"])))
    assert [float(row["unstressed length (m)"]) for row in read] == totals


def test_the_cutting_list_is_at_the_reference_temperature(net, told):
    """20 K with 1.2e-5/K lengthen the cables by 2.4e-4 of what is cut."""
    _, _, solution, _ = net
    table = told.tables["cutting_list"]
    cut = np.array(column(table, "unstressed length"))
    np.testing.assert_allclose(cut * (1 + 2.4e-4), solution.rest_length["net"], rtol=1e-15)
    assert table.notes[0].endswith("at the reference temperature (before the first phase)")
    assert f"net: 24 pieces, {cut.sum():.3f} m in total" in table.notes
    alone = jc.report(net[0], solution).tables["cutting_list"]  # the state knows how warm it is
    assert column(alone, "unstressed length") == cut.tolist()


# --- texts, files, arguments


def test_text_csv_and_dict_say_the_same(told, tmp_path):
    data = json.loads(json.dumps(told.dict(), allow_nan=False))
    assert data["status"] == 0 and set(data["tables"]) == set(told.tables)
    texts = told.csv()
    assert "left out of envelopes: broken" in texts.pop("summary")
    for name, text in texts.items():
        head, *rows = list(csv.reader(io.StringIO(text)))
        table = told.tables[name]
        assert len(head) == len({*head}) == len(table.columns)
        assert len(rows) == len(table.rows)
        for row, meant in zip(rows, table.rows, strict=True):
            assert row == ["" if v is None else str(v) for v in meant]
    assert "force (N)" in texts["members"] and "u in phase (m)" not in texts["displacements"]
    paths = told.save(tmp_path / "net.csv")
    assert sorted(p.name for p in paths)[0] == "net-cables.csv"
    assert json.loads(told.save(tmp_path / "net.json")[0].read_text()) == data
    assert told.save(tmp_path / "net.txt")[0].read_text() == told.text(rows=10**9)  # all rows
    assert str(told) == told.text()
    with pytest.raises(ValueError, match=r"path = .*expected a name with .txt, .json, .csv"):
        told.save(tmp_path / "net.doc")


def test_the_text_shows_what_governs_in_fitting_units(told):
    """Cases, one of which fails: words, units, and of long tables the rows that govern."""
    assert_golden("net_with_cases.txt", told.text(rows=100))
    text = told.text(rows=5)  # not kept: which one of equal forces is larger is rounding
    part = text.split("Axial forces (largest along each element)")[1].split("Displacements")[0]
    shown = [line for line in part.splitlines() if line.startswith("    net")]
    used = [float(line.split()[-1]) for line in shown]
    assert len(used) == 5 and used == sorted(used, reverse=True)
    assert used[0] == pytest.approx(max(column(told.tables["members"], "most used")), abs=5e-4)
    assert max(map(len, text.splitlines()[4:])) < 120  # fits a page


def test_a_cable_net_has_no_tables_of_sections(flat):
    """Two phases, in pounds and feet."""
    assert_golden("flat_net.txt", jc.report(*flat, units="kip, ft").text())


# --- what an engineer must not overlook


def strung(strength, load):
    """The report of a taut cable of 2 m and 1 kN, with a load in the middle."""
    cable = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e6, strength=strength)
    nodes = [[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]]
    structure = jc.Structure(nodes, {"stay": cable}, jc.pinned([0, 2]))
    phases = [jc.Phase(pretension=1e3), jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, load)))]
    return structure, jc.solve(structure, phases), phases


def summary_of(strength, load, words):
    """Lines with `words` in the summary of `strung`, and its solution."""
    structure, solution, _ = strung(strength, load)
    assert int(solution.status) == 0
    return [line for line in jc.report(structure, solution).summary if words in line], solution


def test_forces_above_the_breaking_force_are_said():
    (line,), solution = summary_of([2e3, 5e3], -200.0, "STRENGTH")
    force = float(solution.tension["stay"][0])
    assert 2e3 < force < 5e3
    assert line == (
        "STRENGTH EXCEEDED: 1 element above the breaking force (stay: 1 of 2); largest force "
        f"/ strength {force / 2e3:.3g} (stay, element 0, phase 2)"
    )
    assert summary_of(1e4, -200.0, "STRENGTH")[0] == []


def test_displacements_of_every_phase_and_their_envelope(net):
    structure, solution, _ = strung(1e4, -200.0)
    tables = jc.report(structure, solution).tables
    table, envelope = tables["displacements"], tables["displacement_envelope"]
    assert table.columns == ("node", "phase", "ux", "uy", "uz", "u", "u in phase")
    assert [row[:2] for row in table.rows] == [[1, "phase 1"], [1, "phase 2"]]  # what moves
    last = np.asarray(solution.displacement)[1]
    own = np.asarray(solution.phases[1].displacement_in_phase)[1]
    sizes = [np.linalg.norm(last), np.linalg.norm(own)]
    assert table.rows[1][2:5] == last.tolist()
    assert table.rows[1][5:] == pytest.approx(sizes, rel=1e-15)
    found = dict(zip(envelope.columns, envelope.rows[0], strict=True))
    assert found["min uz"] == last[2] and found["max u"] == table.rows[1][5]
    assert list(found.values())[-1] == "phase 2"
    text = jc.report(structure, solution).text()
    assert f"{1e3 * last[2]:.2f}" in text.split("Displacements from the start, by phase (mm)")[1]
    # of cases, each from the same start
    structure, _, start, batch = net
    table = jc.report(structure, start, cases=batch).tables["displacements"]
    assert table.columns == ("node", "case", "ux", "uy", "uz", "u")
    assert {row[1] for row in table.rows} == {"case 0", "case 1"}


def test_displacements_of_a_tenth_of_the_extent_are_doubted():
    (line,), solution = summary_of(1e9, -5e5, "CHECK")
    moved = float(np.abs(solution.displacement).max())
    assert moved > 0.2
    assert f"node 1 has moved by {moved:.4g} m" in line and "nodes in m" in line
    assert summary_of(1e9, -200.0, "CHECK")[0] == []


def test_a_mast_that_can_spin_is_said_to_be_not_held():
    """On a ball joint, with guys at its axis. The report of a foot that is held is a golden one."""
    around = np.radians([0.0, 120.0, 240.0])
    anchors = [(8.0 * np.cos(a), 8.0 * np.sin(a), 0.0) for a in around]
    groups = {
        "mast": jc.Beams([[0, 1]], jc.Section.rectangle(0.2, 0.2, jc.Elastic(210e9))),
        "guys": jc.Cables([[1, 2], [1, 3], [1, 4]], axial_stiffness=1e7),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jc.InputWarning)
        nodes = [(0.0, 0.0, 0.0), (0.0, 0.0, 10.0), *anchors]
        mast = jc.Structure(nodes, groups, supports=jc.pinned([0, 2, 3, 4]))
        solution = converged(jc.solve(mast, jc.Phase(pretension={"guys": 1e4})))
    (said,) = (line for line in jc.report(mast, solution).summary if "NOT HELD" in line)
    assert "nodes 0 to 1 can spin about their line" in said


def test_nothing_that_converged_means_no_tables(tmp_path):
    """A table of zeros would look like a result."""
    structure, _, phases = strung(1e4, -200.0)
    phases = [jc.replace(phases[0], loads=jc.NodalLoads([1], (0.0, 0.0, np.nan))), phases[1]]
    told = jc.report(structure, jc.solve(structure, phases), phases, buckling=True, energy=True)
    assert told.status == 3 and dict(told.tables) == {}
    assert told.summary[-1] == "FAILED: no results: phase 1 did not converge in its first increment"
    assert not [x for x in told.summary if x.startswith("left out")]
    assert [path.name for path in told.save(tmp_path / "r.csv")] == ["r-summary.csv"]
