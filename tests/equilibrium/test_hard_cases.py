"""Hard cases at small size: expected status, independent balance, a figure from elsewhere."""

import dataclasses

import numpy as np
import pytest
from banks import hard_nets
from banks.hard_cases import CASES
from oracles.independent import verdict

import jaxcable as jc
from jaxcable.common import status


def _parameters():
    for case in CASES:
        for dtype in ("float64", "float32"):
            marks = [pytest.mark.slow] if dtype in case.slow else []
            yield pytest.param(case, dtype, marks=marks, id=f"{case.name}, {dtype}")


# that float32 is coarse far from the origin is what some of these cases are about
@pytest.mark.filterwarnings("ignore:nodes.* in float32:jaxcable.InputWarning")
@pytest.mark.parametrize(("case", "dtype"), list(_parameters()))
def test_hard_case(case, dtype):
    problem = case.build(False, dtype)
    solution = problem.solve()
    code = int(solution.status)
    assert code in case.allowed(dtype), f"{jc.describe(code)}; {case.reason}"
    if code == status.OK:
        judged = problem.verdict(solution)
        assert judged is None or judged.passed, judged
        assert np.isfinite(np.asarray(solution.displacement)).all()
    if problem.figure is not None and code != status.NOT_CONVERGED:
        error, limit = problem.figure(solution)
        assert error <= limit, case.reason


def test_the_check_sees_a_wrong_result():
    """Controls: one number off by a part in a million, and equilibrium to 1e-3, do not pass."""
    problem = hard_nets.net(1e-3, 1e-5)(False, "float64")
    solution = problem.solve()
    assert problem.verdict(solution).passed
    for name in ("displacement", "tension", "reactions", "rest_length", "load"):
        values = np.asarray(getattr(solution, name)).copy()
        where = np.unravel_index(np.abs(values).argmax(), values.shape)
        values[where] *= 1 + 1e-6
        wrong = dataclasses.replace(solution, **{name: values})
        assert not verdict(problem.structure, problem.phases, wrong).passed, name
    loose = jc.solve(problem.structure, problem.phases, jc.Newton(tol=1e-3))
    assert verdict(problem.structure, problem.phases, loose, tol=1e-3).passed
    assert not verdict(problem.structure, problem.phases, loose).passed


def test_figures_see_a_wrong_result():
    """Control: a displacement off by a thousandth is beyond the limit of the closed form."""
    problem = hard_nets.two_links(1e-3, 1e-6)(False, "float64")
    solution = problem.solve()
    for factor, right in ((1.0, True), (1.001, False)):
        moved = dataclasses.replace(solution, displacement=factor * solution.displacement)
        error, limit = problem.figure(moved)
        assert (error <= limit) == right


@pytest.mark.slow
def test_a_rope_far_from_the_origin():
    """Tensions at 1e6 m from the origin are those at the origin; there straight cables' are."""
    angle = 2 * np.pi * np.arange(3) / 3
    nodes = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    nodes = np.concatenate([nodes, np.zeros((1, 3))])
    nodes = np.ldexp(np.round(np.ldexp(nodes, 20)), -20)  # exact at 2**20 as well
    elements = {
        "rope": jc.SlidingCables([[0, 3, 1]], axial_stiffness=1e6),
        "cable": jc.Cables([[2, 3]], axial_stiffness=1e6),
    }
    phases = [
        jc.Phase(prestrain={"rope": 1e-4, "cable": None}),
        jc.Phase(loads=jc.NodalLoads([3], (3.0, 1.0, -5.0))),
    ]
    near, far = (
        jc.solve(jc.Structure(nodes + offset, elements, jc.pinned([0, 1, 2])), phases)
        for offset in (0.0, 2.0**20)
    )
    assert int(near.status) == int(far.status) == status.OK
    # the same numbers but for the places: a part in 1e12 is rounding, some times
    assert np.allclose(far.tension["rope"], near.tension["rope"], rtol=1e-12, atol=0)
