"""The default tolerance of a target is one of the kind of its result: m, N or rad."""

import numpy as np
import pytest

import jaxcable as jc
from jaxcable.analysis.solution import PER_PHASE
from jaxcable.design import Target

LENGTH, FORCE, MOMENT = 1e-3, 1.0, 1.0  # m, N, N m


@pytest.mark.parametrize(
    ("of", "expected"),
    [
        ("positions", LENGTH),
        ("displacement", LENGTH),
        ("rest_length", LENGTH),
        ("tension", FORCE),
        ("peak_tension", FORCE),
        ("reactions", FORCE),
        ("load", FORCE),
        ("section_forces", FORCE),
        ("reaction_moments", MOMENT),
    ],
)
def test_every_kind_of_result_has_its_own(of, expected):
    assert Target(of).within == expected
    assert Target(of, within=0.25).within == 0.25
    assert f'"{of}"' in Target.__doc__


def test_all_results_of_phases_have_one():
    from jaxcable.design import targets

    assert set(targets.WITHIN) == set(PER_PHASE) - {"results"}


def test_that_of_rotations_is_an_angle():
    """A turn by 1e-3 rad about any axis, as a unit quaternion, beside none."""
    half = 0.5e-3
    largest = np.abs(np.array([np.cos(half), 0.0, np.sin(half), 0.0]) - [1, 0, 0, 0]).max()
    np.testing.assert_allclose(Target("rotation").within, largest, rtol=1e-6)


def test_the_unit_of_a_function_is_not_known():
    assert Target(lambda phase: phase.positions[1, 2]).within == 1.0
    for wrong in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(ValueError, match=f"within = {wrong}: must be positive"):
            Target("positions", within=wrong)


def test_targets_that_contradict_each_other_are_weighed_by_it():
    """Two bars of 2 m and EA = 1 MN in a line, held at both ends; one is shortened by s.

    The node between them moves by s / 2, and both pull with EA s / 4 m. The least squares of
    (s / 2 - a) / 1e-3 and (EA s / 4 - b) / 1 are found by hand.
    """
    nodes = [[0.0, 0, 0], [0, 0, -2.0], [0, 0, -4.0]]
    bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e6)
    structure = jc.Structure(nodes, bars, jc.pinned([0, 2]) + jc.restrained([1], "xy"))
    phases = [jc.Phase(shortening=np.array([0.0, 0.0]))]
    a, b = 1e-6, 1.0  # m, N: near zero all is linear
    rise = Target("positions", -2.0 + a, at=(1, 2))
    force = Target("tension", b, at=0)
    # the other bar keeps its length
    bounds = ([np.array([-1.0, 0.0])], [np.array([1.0, 0.0])])
    tuned = jc.design.tune(structure, phases, [(0, "shortening")], [rise, force], bounds)
    columns, wanted = np.array([0.5 / LENGTH, 1e6 / 4 / FORCE]), np.array([a / LENGTH, b / FORCE])
    expected = columns @ wanted / (columns @ columns)
    np.testing.assert_allclose(tuned.values[0][0], expected, rtol=1e-5)
    assert [bool(met) for met in tuned.met] == [True, True]
    off = Target("positions", -2.0 + 0.1, at=(1, 2))  # met to the 1 m of before, not to 1 mm
    tuned = jc.design.tune(structure, phases, [(0, "shortening")], [off, force], bounds)
    assert not tuned.met[0] and abs(float(tuned.deviation[0][0])) > 0.05
