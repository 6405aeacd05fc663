"""Reports: what they say is checked against statics and against the solution itself."""

import csv
import io
import json

import jax
import numpy as np
import pytest

import jaxcable as jc


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

    def case(force):
        loads = jc.NodalLoads(free, force)
        return jc.solve(structure, [jc.Phase(loads=loads)], start=solution)

    batch = jax.vmap(case)(forces)
    assert int(solution.status) == 0 and batch.status.tolist()[:2] == [0, 0]
    return structure, prestress, solution, batch


@pytest.fixture(scope="module")
def written(net):
    structure, prestress, solution, batch = net
    names = ["snow", "half", "broken"]
    return jc.report(structure, solution, [prestress], cases=batch, names=names)


def column(table, name, skip=0):
    k = [c.strip() for c in table.columns].index(name)
    return [row[k] for row in table.rows]


def test_reactions_balance_the_loads(net):
    structure, _, _, batch = net
    snow = jax.tree.map(lambda x: np.asarray(x)[0], batch)
    table = jc.report(structure, snow).tables["equilibrium"]
    rows = {row[0]: np.array(row[1:]) for row in table.rows}
    np.testing.assert_allclose(rows["loads"], [0, 0, -9 * 500.0])
    # the tolerance of the analysis, 1e-10 of the nodal forces, at some 20 nodes
    assert np.abs(rows["loads"] + rows["reactions"]).max() < 1e-8 * 20e3
    # the same numbers added in another order: a rounding of their sizes (some ulps of 4500 N)
    rounding = np.finfo(float).eps * (9 * 500.0 + np.abs(snow.reactions[:, 2]).sum())
    np.testing.assert_allclose(
        rows["sum of forces"], rows["loads"] + rows["reactions"], rtol=0, atol=rounding
    )
    reactions = jc.report(structure, snow).tables["reactions"]
    assert (
        sorted(column(reactions, "node"))
        == np.flatnonzero(structure.supports.fixed(structure.n_node)[:, 0]).tolist()
    )
    by_hand = np.array([row[1:4] for row in reactions.rows]).sum(axis=0)
    np.testing.assert_allclose(by_hand, rows["reactions"], atol=1e-9)


def test_a_report_of_a_state_out_of_balance_says_so(net):
    """The check of equilibrium is not that of the solver: a reaction that is wrong is noticed."""
    structure, _, solution, _ = net
    good = jc.report(structure, solution).tables["equilibrium"].notes[0]
    assert float(good.split(": ")[1].split(" N")[0]) < 1e-6
    last = jc.replace(solution.last, reactions=solution.last.reactions.at[0, 0].add(7.0))
    bad = jc.report(structure, jc.replace(solution, last=last)).tables["equilibrium"].notes[0]
    assert bad.startswith("forces out of balance: 7.0e+00 N")


def test_forces_utilisation_and_envelope(net, written):
    _, _, solution, batch = net
    table = written.tables["members"]
    tensions = np.asarray(batch.tension["net"])[:2]
    assert column(table, "force") == solution.tension["net"].tolist()
    np.testing.assert_array_equal(column(table, "lowest"), tensions.min(axis=0))
    np.testing.assert_array_equal(column(table, "highest"), tensions.max(axis=0))
    governs = [("snow", "half")[k] for k in tensions.argmax(axis=0)]
    assert [row[8] for row in table.rows] == governs
    np.testing.assert_allclose(column(table, "used"), solution.tension["net"] / 400e3)
    np.testing.assert_allclose(column(table, "most used"), tensions.max(axis=0) / 400e3)


def test_failed_cases_are_named_and_left_out(written):
    (line,) = [line for line in written.summary if line.startswith("left out")]
    assert line.startswith("left out of envelopes: broken (status 3: ")
    text = written.text()
    assert "nan" not in text.replace("broken", "")


def test_the_cutting_list_is_at_the_reference_temperature(net, written):
    """20 K with 1.2e-5/K lengthen the cables by 2.4e-4 of what is cut."""
    _, _, solution, _ = net
    table = written.tables["cutting_list"]
    cut = np.array(column(table, "unstressed length"))
    np.testing.assert_allclose(cut * (1 + 2.4e-4), solution.rest_length["net"], rtol=1e-15)
    assert table.notes[0] == "at the temperature before the first phase"
    assert f"net: 24 pieces, {cut.sum():.3f} m in total" in table.notes
    alone = jc.report(net[0], solution).tables["cutting_list"]  # the state knows how warm it is
    assert column(alone, "unstressed length") == cut.tolist()


def test_slack_cables_and_loose_nodes(net, written):
    _, _, _, batch = net
    slack = np.flatnonzero(np.asarray(batch.tension["net"])[1] == 0)
    assert len(slack) > 0
    assert written.tables["slack"].rows == [["net", k, "half"] for k in slack.tolist()]
    assert written.tables["loose"].rows == [] and written.tables["loose"].notes == ("none",)
    hung = jc.Structure(
        [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]],
        jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5, rest_length=1.2),
        jc.pinned([0, 2]),
    )
    found = jc.report(hung, jc.solve(hung, jc.Phase()))
    assert found.status == 0
    assert found.tables["slack"].rows == [["", 0, "phase 1"], ["", 1, "phase 1"]]
    assert found.tables["loose"].rows == [[1, "phase 1"]]
    assert found.tables["members"].notes == ("no group has a strength: no utilisation",)


def test_a_failed_analysis_is_reported_as_failed(net):
    structure, prestress, _, _ = net
    heavy = jc.NodalLoads([5], (0.0, 0.0, np.nan))
    phases = [prestress, jc.Phase(loads=heavy, increments=2)]
    solution = jc.solve(structure, phases)
    told = jc.report(structure, solution, phases)
    assert told.status == 3
    assert any(line.startswith("FAILED: what follows is the last") for line in told.summary)
    # the prestressed state is what converged last; its envelope is that of phase 1
    forces = told.tables["members"]
    assert column(forces, "force") == column(forces, "highest")
    assert np.isfinite(column(forces, "force")).all()


def test_text_csv_and_dict_say_the_same(written, tmp_path):
    data = json.loads(json.dumps(written.dict(), allow_nan=False))
    assert data["status"] == 0 and set(data["tables"]) == set(written.tables)
    texts = written.csv()
    assert "left out of envelopes: broken" in texts.pop("summary")
    for name, text in texts.items():
        head, *rows = list(csv.reader(io.StringIO(text)))
        table = written.tables[name]
        assert len(head) == len(table.columns) and len(rows) == len(table.rows)
        for row, meant in zip(rows, table.rows, strict=True):
            assert row == ["" if v is None else str(v) for v in meant]
    assert "force (N)" in written.csv()["members"]
    paths = written.save(tmp_path / "net.csv")
    assert sorted(p.name for p in paths)[0] == "net-cables.csv"
    assert json.loads(written.save(tmp_path / "net.json")[0].read_text()) == data
    assert written.save(tmp_path / "net.txt")[0].read_text() == written.text() == str(written)
    with pytest.raises(ValueError, match=r"path = .*expected a name with .txt, .csv or .json"):
        written.save(tmp_path / "net.pdf")


def test_the_text_shows_what_governs_in_fitting_units(written):
    text = written.text(rows=5)
    assert "force (kN)" in text and "most used (-)" in text
    assert "the largest 5 of 24; the tables have all" in text
    shown = text.split("Forces, tension positive")[1].split("Cutting list")[0].splitlines()[2:7]
    used = [float(line.split()[-1]) for line in shown]
    assert used == sorted(used, reverse=True)
    assert used[0] == pytest.approx(max(column(written.tables["members"], "most used")), abs=5e-4)
    assert max(map(len, text.splitlines()[4:])) < 120  # fits a page


def test_wrong_arguments_are_named(net):
    structure, _, solution, batch = net
    with pytest.raises(ValueError, match="solution: is a batch"):
        jc.report(structure, batch)
    with pytest.raises(ValueError, match="names: 1 of them, but 3 cases"):
        jc.report(structure, solution, cases=batch, names=["a"])
    with pytest.raises(ValueError, match="cases: expected a leading axis"):
        jc.report(structure, solution, cases=solution)
    for names in (["a", "a", "b"], ["a", "end", "b"]):
        with pytest.raises(ValueError, match="names: each case needs a name of its own"):
            jc.report(structure, solution, cases=batch, names=names)
    with pytest.raises(ValueError, match="phases: 2 of them, the solution has 1"):
        jc.report(structure, solution, [jc.Phase(), jc.Phase()])
    with pytest.raises(ValueError, match="solution: expected a Solution, got list"):
        jc.report(structure, [jc.Phase()], solution)
    free = int(np.flatnonzero(~structure.held().any(axis=1))[0])
    other = jc.replace(structure, supports=structure.supports + jc.pinned([free]))
    with pytest.raises(ValueError, match=r"solution: .*supports"):
        jc.report(other, solution)
    with pytest.raises(ValueError, match=r"solution: .*supports"):
        jc.energy_balance(other, jc.Phase(), solution)


def test_a_support_that_is_taken_away_keeps_its_largest_reaction():
    """A prop, then released: who built it needs to know what it has carried."""
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]
    cables = jc.Cables([[0, 1], [1, 2], [2, 3]], axial_stiffness=1e5)
    structure = jc.Structure(nodes, cables, jc.pinned([0, 1, 3]))
    loaded = jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -50.0)))
    phases = [jc.Phase(pretension=100.0), loaded, jc.Phase(supports=jc.pinned([0, 3]))]
    solution = jc.solve(structure, phases)
    told = jc.report(structure, solution, phases)
    assert told.status == 0
    rows = {row[0]: row for row in told.tables["reactions"].rows}
    assert list(rows) == [0, 1, 3]
    carried = np.asarray(solution.phases[1].reactions)
    assert carried[:, 2].sum() == pytest.approx(50.0, abs=1e-6)
    assert rows[1][1:5] == [None] * 4 and rows[1][6] == "phase 2"  # nothing holds it at the end
    assert rows[1][5] == pytest.approx(np.linalg.norm(carried[1])) and carried[1, 2] > 20.0


@pytest.mark.slow
def test_moments_at_the_foot_of_a_mast():
    """Base moments and the sum over the guys balance wind and weight about the foot."""
    structure, phases = jc.scenes.guyed_mast(levels=1, per_level=2, increments=(1, 2))
    solution = jc.solve(structure, phases)
    told = jc.report(structure, solution, phases)
    assert told.status == 0
    table = told.tables["reactions"]
    assert table.columns[5:8] == ("Mx", "My", "Mz") and table.units[5] == "N m"
    rows = {row[0]: row[1] for row in told.tables["equilibrium"].rows}
    forces, nodes = np.asarray(phases[1].loads.forces), phases[1].loads.nodes
    wind = np.broadcast_to(forces, (len(nodes), 3))[:, 0].sum()
    assert wind > 0 and rows["reactions"] == pytest.approx(-wind, rel=1e-8)
