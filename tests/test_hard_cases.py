"""Hard cases at small size: expected status, independent balance, a figure from elsewhere."""

import dataclasses

import hard_cases
import numpy as np
import pytest
from hard_cases import CASES
from independent import verdict

import jaxcable as jc
from jaxcable import status


def _parameters():
    for case in CASES:
        for dtype in ("float64", "float32"):
            marks = [pytest.mark.slow] if dtype in case.slow else []
            yield pytest.param(case, dtype, marks=marks, id=f"{case.name}, {dtype}")


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


@pytest.mark.parametrize("name", ["displacement", "tension", "reactions", "rest_length", "load"])
def test_the_check_sees_a_wrong_result(name):
    """Control: one number off by a part in a million is found, in each of the results."""
    problem = hard_cases._net(1e-3, 1e-5)(False, "float64")
    solution = problem.solve()
    assert problem.verdict(solution).passed
    values = np.asarray(getattr(solution, name)).copy()
    where = np.unravel_index(np.abs(values).argmax(), values.shape)
    values[where] *= 1 + 1e-6
    wrong = _with(solution, **{name: values})
    assert not verdict(problem.structure, problem.phases, wrong).passed


def test_figures_see_a_wrong_result():
    """Control: a displacement off by a thousandth is beyond the limit of the closed form."""
    problem = hard_cases._two_links(1e-3, 1e-6)(False, "float64")
    solution = problem.solve()
    error, limit = problem.figure(solution)
    assert error <= limit
    error, limit = problem.figure(_with(solution, displacement=1.001 * solution.displacement))
    assert error > limit


@pytest.mark.slow
def test_the_check_sees_what_the_method_was_not_asked_for():
    """Control: equilibrium to 1e-3 does not pass for one to 1e-10."""
    problem = hard_cases._net(1e-3, 1e-5)(False, "float64")
    loose = jc.solve(problem.structure, problem.phases, jc.Newton(tol=1e-3))
    assert verdict(problem.structure, problem.phases, loose, tol=1e-3).passed
    assert not verdict(problem.structure, problem.phases, loose).passed


def _with(solution, **changes):
    """The solution with some results replaced."""
    return dataclasses.replace(solution, **changes)
