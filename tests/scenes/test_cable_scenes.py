"""Scenes of single cables and of the edge of a tent: they start in equilibrium, and hold."""

import numpy as np
import pytest
from banks import problems

import jaxcable as jc
from jaxcable.model.parts import pieces


@pytest.mark.slow
@pytest.mark.parametrize("n", [pytest.param(0, marks=pytest.mark.slow), 12])
def test_suspended_cable_hangs_by_its_sag(n):
    scene = jc.scenes.suspended_cable(n=n)
    solution = jc.solve(*scene)
    assert int(solution.status) == 0
    problems.assert_balanced(solution)
    if n:
        first = np.asarray(solution.phases[0].positions)
        # the chain starts in equilibrium: at most the tolerance over its stiffness
        assert np.abs(np.asarray(solution.phases[0].displacement)).max() < 1e-6
        assert 6.0 - first[n // 2, 2] == pytest.approx(9.0, abs=1e-6)
        middle = np.asarray(solution.positions)[n // 2, 2]
    else:
        curve = np.asarray(jc.forms.catenary_curves(scene.structure, solution, 3))[0]
        said = jc.forms.statements(scene.structure, solution)
        middle = curve[1, 2]
        assert 6.0 - middle == pytest.approx(float(said.sag[0]), rel=1e-12)
    assert 6.0 - middle > 9.0  # ice stretches it


def test_isolated_cable_of_straight_elements():
    """The work-precision study has the convergence; here that both variants are one scene."""
    moved = []
    for n in (0, 8):
        solution = jc.solve(*jc.scenes.isolated_cable(n))
        assert int(solution.status) == 0
        problems.assert_balanced(solution)
        moved.append(np.asarray(solution.phases[1].displacement)[max(n, 1)])
    # 8 elements a span are 6 cm off the 5.7 m
    assert np.abs(moved[1] - moved[0]).max() == pytest.approx(0.06, abs=0.01)


def test_tent_edge():
    """The given geometry is in equilibrium; in gusts the pylons still push and the guys pull."""
    solution = jc.solve(*jc.scenes.tent_edge(increments=(1, 2)))
    assert int(solution.status) == 0
    first = solution.phases[0]
    assert int(first.path.iterations[0]) == 0
    assert np.abs(np.asarray(first.displacement)).max() == 0.0
    edge = np.asarray(first.tension["edge"])
    assert np.ptp(edge) < 1e-9 * edge.max()
    problems.assert_balanced(solution)
    assert (np.asarray(solution.tension["pylons"]) < 0).all()
    assert (np.asarray(solution.tension["guys"]) > 0).all()
    moved = np.asarray(solution.displacement)
    # symmetric about x = 0; the middle rises with the uplift
    assert np.abs(moved[:17, 2] - moved[16::-1, 2]).max() < 1e-7
    assert moved[8, 2] > 0.1


def test_wrong_scenes_are_refused():
    with pytest.raises(ValueError, match="lean, reach: guys would push"):
        jc.scenes.tent_edge(reach=-6.0)
    with pytest.raises(ValueError, match="n = -1"):
        jc.scenes.isolated_cable(-1)


def test_picture_of_a_running_rope(tmp_path):
    """A chain of pieces is drawn piece by piece, each in the colour of its cable."""
    nodes = [[0.0, 0, 0], [3.0, 0, -2.5], [8.0, 0, 1.5]]
    rope = jc.SlidingCables([[0, 1, 2], [0, 1]], axial_stiffness=1e6)
    structure = jc.Structure(nodes, rope, jc.pinned([0, 2]))
    solution = jc.solve(
        structure, [jc.Phase(prestrain=0.01), jc.Phase(loads=jc.NodalLoads([1], (0, 0, -100.0)))]
    )
    assert int(solution.status) == 0
    pairs, element, _ = pieces(solution.last.topology.parts)
    assert pairs.tolist() == [[0, 1], [1, 2], [0, 1]] and element.tolist() == [0, 0, 1]
    jc.plots.net(solution, tmp_path / "rope.png")
    assert (tmp_path / "rope.png").stat().st_size > 20_000
