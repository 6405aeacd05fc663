"""What is left when an element has gone: shapes of the phases before, tensions, buckling."""

import re

import numpy as np
import pytest
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.plots.element_curves import SolutionCurves

WEIGHT, STIFFNESS, SPAN, SAG = 15.0, 30e6, 300.0, 6.75  # N/m, N, m, m


@pytest.fixture(scope="module")
def line():
    """Three spans between strings of 3 m that swing; ice comes, the middle conductor breaks."""
    at = SPAN * np.arange(4)
    nodes = [[x, 0.0, 0.0] for x in at] + [[x, 0.0, 3.0] for x in at[1:3]]
    groups = {
        "conductor": jc.Catenaries([[0, 1], [1, 2], [2, 3]], STIFFNESS, weight=WEIGHT),
        "string": jc.Bars([[4, 1], [5, 2]], axial_stiffness=1e8),
    }
    structure = jc.Structure(nodes, groups, supports=jc.pinned([0, 3, 4, 5]))
    phases = [
        jc.Phase(sag={"conductor": SAG}, loads=jc.SelfWeight()),
        jc.Phase(loads=jc.LineLoads((0.0, 0.0, -10.0), on="conductor")),
        jc.Phase(removes={"conductor": jc.only([1])}),
    ]
    solution = converged(jc.solve(structure, phases))
    return structure, phases, solution


@pytest.mark.slow
def test_a_conductor_that_breaks_hangs_before(line):
    """w L^2 / 8 H below its chord when strung; the same shapes as of the analysis so far."""
    structure, phases, solution = line
    shapes = SolutionCurves(solution, structure)
    for k in (0, 1):
        curves = shapes.at_state(shapes.state_after_phase(k))
        count = curves.offsets.shape[1]
        assert curves.offsets[1, count // 2, 2] < -0.9 * SAG
    so_far = converged(jc.solve(structure, phases[:2]))
    expected = np.asarray(jc.forms.catenary_curves(structure, so_far, count)["conductor"])
    found = curves.points(np.asarray(solution.phases[1].positions))
    np.testing.assert_allclose(found, expected, atol=1e-6)  # of sags of metres
    known = shapes.at_state(shapes.state_after_phase(2)).is_known
    assert not known[1] and known[[0, 2]].all()


def test_what_has_gone_has_no_tension_and_no_curve(line):
    structure, _, solution = line
    ends = np.asarray(jc.forms.end_tensions(structure, solution)["conductor"])
    assert (ends[1] == 0.0).all() and (ends[[0, 2]] > 1e4).all()
    curves = np.asarray(jc.forms.catenary_curves(structure, solution)["conductor"])
    assert np.isnan(curves[1]).all() and np.isfinite(curves[[0, 2]]).all()
    mean = np.asarray(solution.tension["conductor"])
    np.testing.assert_allclose(ends.mean(axis=1), mean, rtol=1e-10, atol=0.0)


def test_the_page_names_its_phases_and_has_numbers_only(line):
    structure, _, solution = line
    page = jc.plots.view(solution, None, structure=structure, names=["strung", "ice", "broken"])
    assert '"phases":["strung","ice","broken"]' in re.sub(r'": ', '":', page.html).replace(
        ", ", ","
    )
    with pytest.raises(ValueError, match="names: 1 of them, but 3 phases"):
        jc.plots.view(solution, None, structure=structure, names=["strung"])
