"""Tables of a motion in time in reports: a mass on a bar under a sudden load, by closed form."""

import numpy as np
import pytest

import jaxcable as jc

STIFFNESS, MASS, FORCE = 8e3, 2.0, 16.0  # N/m, kg, N
PERIOD = 2 * np.pi * np.sqrt(MASS / STIFFNESS)


@pytest.fixture(scope="module")
def moved():
    bar = jc.Bars([[0, 1]], axial_stiffness=STIFFNESS)
    guide = jc.pinned([0]) + jc.restrained([1], "yz")
    structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], {"bar": bar}, supports=guide)
    rest = jc.solve(structure, jc.Phase())
    times = {"dt": PERIOD / 200, "steps": 150, "masses": MASS}
    motion = jc.dynamics.transient(structure, jc.NodalLoads([1], (FORCE, 0, 0)), **times)
    assert int(rest.status) == int(motion.status) == 0
    return structure, rest, motion


def test_extremes_and_their_times(moved):
    """The mass goes to twice the static displacement in half a period, and back."""
    structure, rest, motion = moved
    made = jc.report(structure, rest, motion=motion)
    forces, ways = made.tables["motion_forces"], made.tables["motion_displacements"]
    assert forces.columns[4:] == ("start", "min. N", "at", "max. N", "at ")
    start, low, low_at, high, high_at = forces.rows[0][4:]
    # the scheme is of second order: its period is 1e-4 longer by 200 steps
    assert (start, low, low_at) == (0, 0, 0) and high == pytest.approx(2 * FORCE, rel=1e-3)
    assert high_at == pytest.approx(PERIOD / 2, rel=1e-9)
    [row] = ways.rows
    assert row[0] == 1 and row[1:7] == pytest.approx([0, 2 * FORCE / STIFFNESS, 0, 0, 0, 0], 1e-3)
    assert row[7:] == pytest.approx([2 * FORCE / STIFFNESS, PERIOD / 2], rel=1e-3)
    assert "extremes over 150 steps" in ways.notes[0] and "at most" in ways.notes[1]
    text = made.text()
    assert "Axial forces in motion" in text and "4.00" in text.partition("in motion, from its")[2]
    other = jc.report(structure, rest, motion=motion, units="kip, in").tables
    found = other["motion_forces"].rows[0][7]
    assert found == pytest.approx(2 * FORCE / 4448.2216152605, rel=1e-3)


def test_what_is_no_motion_of_the_structure_is_refused(moved):
    structure, rest, motion = moved
    with pytest.raises(ValueError, match="motion: expected a Transient, got "):
        jc.report(structure, rest, motion=rest)
    with pytest.raises(ValueError, match="motion: has failed, or is a batch"):
        jc.report(structure, rest, motion=jc.replace(motion, status=np.array(1)))
    net, phases = jc.scenes.flat_net()
    hung = jc.solve(net, phases)
    assert int(hung.status) == 0
    short = jc.replace(motion, histories={"displacement": motion.displacement})
    with pytest.raises(ValueError, match="motion: belongs to another structure"):
        jc.report(net, hung, motion=short)
    assert "motion_forces" not in jc.report(structure, rest, motion=short).tables
