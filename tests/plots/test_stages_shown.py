"""Elements that come and go, as results, reports and pictures show them."""

import numpy as np
import pytest
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.__main__ import main
from jaxcable.model.topology import topology_of
from jaxcable.plots.element_forces import ElementForces, all_result_columns
from jaxcable.plots.snapshots import Snapshots


@pytest.fixture(scope="module")
def hung():
    """Two cables in a row, of which the second comes, and a third beside the first that goes."""
    nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, -2.0]]
    groups = {
        "row": jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e6),
        "aid": jc.Cables([[0, 1]], axial_stiffness=3e6, strength=2e3),
    }
    structure = jc.Structure(nodes, groups, supports=jc.pinned([0]))
    load = jc.NodalLoads([1], (0.0, 0.0, -1e3))
    later = jc.NodalLoads([2], (0.0, 0.0, -500.0))
    phases = [
        jc.Phase(loads=load),
        jc.Phase(adds={"row": jc.only([1]), "aid": None}, loads=later),
        jc.Phase(removes="aid"),
    ]
    solution = converged(jc.solve(structure, phases))
    return structure, phases, solution


def test_a_failed_analysis_does_not_know(hung):
    structure, phases, _ = hung
    push = jc.Phase(loads=jc.NodalLoads([1], (1e3, 0.0, 0.0)))  # more than one step
    failed = jc.solve(structure, [push, *phases[1:]], jc.Newton(max_steps=1))
    assert int(failed.status) != 0
    assert np.isnan(np.asarray(failed.present["row"])).all()
    with pytest.raises(ValueError, match="no phase has converged"):
        jc.plots.sequence(failed)


def test_files_results_and_the_command_line_say_it(hung, tmp_path, capsys):
    structure, phases, solution = hung
    names = ("row", "aid")
    found = [[np.asarray(p.present[name]).tolist() for name in names] for p in solution.phases]
    assert found == [[[1, 0], [1]], [[1, 1], [1]], [[1, 1], [0]]]
    assert np.asarray(solution.phases[0].path.present["row"]).tolist() == [[1, 0]]
    jc.files.save_result(tmp_path / "hung.csv", structure, solution)
    text = (tmp_path / "hung-elements.csv").read_text().splitlines()
    column = text[0].split(",").index("present (-)")
    assert [float(line.split(",")[column]) for line in text[1:]] == [0.0, 1.0, 1.0]
    jc.save_scene(tmp_path / "hung.json", (structure, phases))
    main(["info", str(tmp_path / "hung.json")])
    text = capsys.readouterr().out
    assert "adds row (element 1 of 2)" in text and "removes aid\n" in text
    assert text.count("3 of 3 elements active") == 1


def test_pictures_draw_what_is_there(hung):
    structure, _, solution = hung
    forces = Snapshots(solution, structure).after_phase(0).forces
    assert forces.present.tolist() == [True, True, False]  # aid, row: sorted by name
    assert not forces.slack.any()
    told = {"tension": solution.phases[0].tension}
    without = ElementForces(told, topology_of(structure).parts, structure)
    assert without.slack.tolist() == [False, False, True]  # the control: as if it were slack
    figure = jc.plots.sequence(solution, structure=structure, names="abc", columns=3)
    drawn = [axes.collections[1:4] for axes in figure.axes[:3]]  # after the ghost
    counts = [[len(lines.get_segments()) for lines in parts] for parts in drawn]
    assert counts == [[0, 2, 0], [0, 3, 0], [0, 2, 0]]  # casing, taut, slack
    assert [axes.get_title() for axes in figure.axes[:3]] == ["a", "b", "c"]
    boxes = np.array([axes.get_position().bounds[2:] for axes in figure.axes[:3]])
    np.testing.assert_allclose(boxes, boxes[:1].repeat(3, axis=0), rtol=1e-6)


def test_the_view_tells_them_apart(hung):
    structure, _, solution = hung
    found = Snapshots(solution, structure)
    shots = found.increments(40, ends=True)
    absent = [(~shot.forces.present).tolist() for shot in shots]
    assert absent == [[False, False, True], [False] * 3, [True, False, False]]
    assert not any(shot.forces.slack.any() or shot.forces.compressed.any() for shot in shots)
    columns = all_result_columns(shots[0].element_results, found.parts, structure)
    labels = [column.label for column in columns]
    assert "tension" in labels and "present" not in labels


def test_supports_of_elements_that_are_not_there_are_not_marked():
    """A prop that is added, and a stay that is removed then."""
    nodes = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 0.0, -3.0], [0.0, 0.0, 5.0]]
    links = {"stay": [[1, 3]], "deck": [[0, 1]], "prop": [[1, 2]]}
    bars = {name: jc.Bars(own, axial_stiffness=1e8) for name, own in links.items()}
    structure = jc.Structure(nodes, bars, jc.pinned([0, 2, 3]) + jc.restrained([1], "y"))
    load = jc.NodalLoads([1], (0.0, 0.0, -1e3))
    phases = [jc.Phase(loads=load), jc.Phase(adds="prop"), jc.Phase(removes="stay")]
    shots = Snapshots(converged(jc.solve(structure, phases)), structure)
    pinned = [np.flatnonzero(shots.after_phase(k).support_kinds(None)[1]) for k in range(3)]
    assert [nodes.tolist() for nodes in pinned] == [[0, 3], [0, 2, 3], [0, 2]]
