"""Tables of cables with friction: a row for each segment and each deviator names its nodes."""

import numpy as np
from banks import hung_lines
from oracles.convergence import converged

import jaxcable as jc

NODES = [[0, 0, 0], [2, 0, 1.0], [4, 0, 1.5], [6, 0, 0], [4, 0, -1.0]]


def report(**changes):
    """A report on two ropes over springs, one of them with a node less."""
    ropes = jc.FrictionCables([[0, 1, 2, 3], [0, 4, 3]], axial_stiffness=1e6, friction=0.1)
    springs = jc.Springs([1, 2, 4], (1e5, 1e5, 1e5))
    structure = jc.Structure(NODES, {"ropes": ropes, "springs": springs}, jc.pinned([0, 3]))
    solution = converged(jc.solve(structure, jc.Phase(pretension={"ropes": 1e3}, **changes)))
    return jc.report(structure, solution), solution


def columns(table, *names):
    at = [table.columns.index(name) for name in names]
    return [tuple(row[k] for k in at) for row in table.rows]


def test_rows_are_segments_and_deviators():
    made, solution = report()
    rows = columns(made.tables["segment_tension"], "element", "place", "segment_tension")
    assert [row[:2] for row in rows] == [
        *((0, "0 to 1"), (0, "1 to 2"), (0, "2 to 3"), (1, "0 to 4"), (1, "4 to 3"))
    ]
    tensions = np.asarray(solution.element_results["segment_tension"]["ropes"])
    np.testing.assert_allclose([row[2] for row in rows], tensions.ravel()[:5], rtol=1e-12)
    at = [(0, "node 1"), (0, "node 2"), (1, "node 4")]
    assert columns(made.tables["slip"], "element", "place") == at
    assert columns(made.tables["friction_used"], "element", "place") == at
    assert "clamp_force" not in made.tables


def test_clamps_have_a_table():
    made, solution = report(clamped={"ropes": [[1, 0], [1, 0]]})
    forces = np.asarray(solution.element_results["clamp_force"]["ropes"])
    assert forces[0, 0] != 0 == forces[0, 1]
    rows = columns(made.tables["clamp_force"], "place", "clamp_force")
    assert rows[:2] == [("node 1", float(forces[0, 0])), ("node 2", 0.0)]


def test_what_cables_and_phases_state_is_listed_by_nodes():
    """One saddle: its results name the node, too; the table of properties has what friction has."""
    nodes = [[-8.0, 0, 0], [0, 0, 6], [9, 0, 0], [9, 0, 2]]
    stay = jc.FrictionCables(
        [[0, 1, 2]], axial_stiffness=2e7, friction=0.2, wobble=1e-3, radius=1.5, axis=(0, 1, 0)
    )
    tendon = jc.FrictionCables([[0, 3, 1, 2]], axial_stiffness=2e7, axle_friction=[0.1, 0.2])
    springs = jc.Springs([1, 3], (1e8, 1e8, 1e8))
    groups = {"stay": stay, "tendon": tendon, "springs": springs}
    structure = jc.Structure(nodes, groups, jc.pinned([0, 2]))
    phase = jc.Phase(pretension={"stay": 1e5, "tendon": 1e5}, clamped={"tendon": [0, 1]})
    made = jc.report(structure, converged(jc.solve(structure, phase)), [phase], model=True)
    also = dict(columns(made.tables["properties"], "group", "also"))
    assert also["stay"] == "friction 0.2; wobble 0.001 1/m; radius 1.5 m; axis (0, 1, 0)"
    assert also["tendon"] == "axle friction 0.1 to 0.2"
    texts = [text for (text,) in columns(made.tables["phases"], "text")]
    assert "clamped at 1, open at 3 (nodes) on tendon" in texts
    arc = columns(made.tables["contact_arc"], "group", "place")
    assert arc == [("stay", "node 1")]


def test_hanging_segments_have_sags_and_end_tensions():
    structure, solution = hung_lines.solved()
    made = jc.report(structure, solution)
    cables = hung_lines.integrated(solution)
    rows = columns(made.tables["sags"], "element", "first", "last", "sag")
    at = [(k, *nodes) for (k, _), nodes in hung_lines.SEGMENTS.items()]
    assert [row[:3] for row in rows] == at
    sags = [cable.sag_at_midspan() for cable in cables.values()]
    # tensions are found to 1e-10 of the largest
    np.testing.assert_allclose([row[3] for row in rows], sags, atol=1e-8)
    ends = columns(made.tables["end_tensions"], "element", "place", "first", "last")
    assert [row[:2] for row in ends] == [(k, f"{a} to {b}") for k, a, b in at]
