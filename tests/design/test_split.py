"""Searches called from Python run analyses by the program of `solve`; within `jit` they do not."""

import gc
import weakref

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import cross

import jaxcable as jc
from jaxcable.analysis import derivative_programs, phase_loop
from jaxcable.common import status

CROSS = cross()
START = np.full(4, 2.0)
SIDE = np.array([0.6, 0.0, -0.8])


def solved(pretension, load=2e3):
    """Pretensions of the four cables, kN, then a load on the node in the middle, N."""
    phases = [jc.Phase(pretension=1e3 * pretension), jc.Phase(loads=CROSS.load(load, SIDE))]
    return jc.solve(CROSS.structure, phases)


def six_residuals(p):
    """Forces, and two displacements: more than there are parameters, so forward mode."""
    solution = solved(p)
    found = solution.tension / 1e3 - jnp.array([3.0, 2.5, 3.5, 2.5])
    return jnp.append(found, 50 * solution.displacement[0, :2]), solution


def two_residuals(p):
    """Fewer residuals than parameters, so reverse mode."""
    solution = solved(p)
    return 50 * solution.displacement[0, ::2] + jnp.array([0.0, 2.0]), solution


def of_two_cases(p):
    """Two analyses from one prestressed state: one begins where another ends."""
    first = jc.solve(CROSS.structure, jc.Phase(pretension=1e3 * p))
    loads = (CROSS.load(f, SIDE) for f in (1e3, 2e3))
    ends = [jc.solve(CROSS.structure, jc.Phase(loads=load), start=first) for load in loads]
    found = [end.tension / 1e3 - wanted for end, wanted in zip(ends, (2.4, 2.9), strict=True)]
    return found, ends


def to_the_edge(p):
    """The step leads to pretensions below zero, which are no valid input: it is shortened."""
    solution = solved(jnp.ones(4) * p, 200.0)
    return jnp.log(solution.tension[0] / 1e3)[None], solution


def compare_with_one_program(search, known=None):
    """Run a search from Python and within `jax.jit`: the same points, up to rounding."""
    found = search()
    if known is not None:  # nothing but the derivative is compiled
        assert set(phase_loop.analyse.known) == known
    one = jax.jit(search)()
    for name in ("status", "steps"):
        assert int(getattr(found, name)) == int(getattr(one, name))
    for own, other in zip(*map(jax.tree.leaves, (found.history, one.history)), strict=True):
        # sums in another order, and what the points of a search make of it
        np.testing.assert_allclose(own, other, rtol=1e-6, atol=1e-9)
    for own, other in zip(*map(jax.tree.leaves, (found.params, one.params)), strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-7)
    return found


@pytest.mark.parametrize("residuals", [six_residuals, two_residuals, of_two_cases])
def test_fit_is_that_of_one_program(residuals):
    residuals(START)  # plain `solve` compiles
    known = set(phase_loop.analyse.known)
    found = compare_with_one_program(lambda: jc.fit(residuals, START, (0.1, None)), known)
    assert int(found.status) == 0
    h = 1e-4  # kN: error of second order, 1e-8, and 1e-10 of the equilibrium over h
    x = np.asarray(found.params)
    values = [
        np.concatenate([np.ravel(v) for v in jax.tree.leaves(residuals(x + s)[0])])
        for s in (h * np.eye(4)[0], -h * np.eye(4)[0])
    ]
    slope = (values[0] - values[1]) / (2 * h)
    assert np.abs(found.jacobian[:, 0] - slope).max() < 1e-5 * np.abs(slope).max()


def test_minimize_is_that_of_one_program_and_reports():
    def loss(p, wanted):
        solution = solved(p)
        return jc.design.tension_distance(solution, wanted) / 1e6 + 1.0, solution

    wanted, reports = jnp.array([3e3, 2.6e3, 3.2e3, 2.6e3]), []
    loss(START, wanted)
    known = set(phase_loop.analyse.known)
    found = compare_with_one_program(
        lambda: jc.minimize(loss, START, (0.1, None), args=(wanted,)), known
    )
    again = jc.minimize(loss, START, (0.1, None), args=(wanted,), progress=reports.append)
    n = int(found.steps)
    assert int(again.status) == int(found.status) == 0 and n > 2
    assert [news.number for news in reports] == list(range(n + 1))
    assert [news.loss for news in reports] == again.history.loss[: n + 1].tolist()
    counts = again.history.failures[: n + 1].tolist()
    assert [news.failures for news in reports] == counts

    def interrupt(news):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        jc.minimize(loss, START, args=(wanted,), progress=interrupt)


def test_programs_do_not_keep_the_function():
    def make():
        wanted = jnp.array([0.0, 2.0])
        return lambda p: two_residuals(p)[0] + 0.1 * wanted

    residuals = make()
    jc.fit(residuals, START)
    gone = weakref.ref(residuals)
    del residuals
    gc.collect()
    assert gone() is None


def test_failed_trials_and_starts():
    # trial points may need the fallbacks of the iteration, another program
    found = compare_with_one_program(lambda: jc.fit(to_the_edge, jnp.array(5.0)))
    codes = set(np.unique(found.history.status))
    assert int(found.status) == 0 and codes == {-1, 0, status.INVALID_INPUT}
    bad = jc.fit(to_the_edge, jnp.array(-1.0))
    assert int(bad.status) == status.BAD_START
    assert int(bad.history.status[0]) == status.INVALID_INPUT and np.isnan(float(bad.misfit))


def test_the_derivative_is_known_to_another_function():
    jc.fit(two_residuals, START)
    programs = derivative_programs.adjoint_of_solution, derivative_programs.change_of_solution
    before = [set(program.known) for program in programs]
    jc.fit(lambda p: two_residuals(p)[0] * 2.0, 1.1 * START)
    assert [set(program.known) for program in programs] == before


def test_stages_have_the_program_of_solve():
    """Whether loads act where no element is can be told of known loads only; here none do."""

    def residuals(load):
        phases = [
            jc.Phase(pretension=2e3, removes=jc.only([3])),
            jc.Phase(loads=jc.NodalLoads([0], 1e3 * load), adds=jc.only([3])),
        ]
        solution = jc.solve(CROSS.structure, phases)
        return 50 * solution.displacement[0] - jnp.array([0.1, 0.2, -2.0]), solution

    start = np.array([0.1, 0.1, -1.0])
    assert int(residuals(start)[1].status) == 0
    known = set(phase_loop.analyse.known)
    assert int(jc.fit(residuals, start).status) == 0
    assert set(phase_loop.analyse.known) == known


def inside_vmap(p):
    found = jax.vmap(lambda load: solved(p, load).tension)(jnp.array([2e3, 3e3]))
    return found.ravel() / 1e3 - 3.0


def inside_jit(p):
    return jax.jit(lambda p: solved(p).tension)(p) / 1e3 - 3.0


@pytest.mark.parametrize("residuals", [inside_vmap, inside_jit])
def test_analyses_that_the_function_transforms_are_part_of_one_program(residuals):
    known = set(phase_loop.analyse.known)
    compare_with_one_program(lambda: jc.fit(residuals, START, (0.1, None), steps=5), known)


def test_constraints_have_the_program_of_solve():
    def problem(p):
        solution = solved(p)
        return jnp.sum(p), 2.0 - solution.tension / 1e3, solution

    problem(START)
    known = set(phase_loop.analyse.known)
    found = jc.design.minimize_subject_to(problem, START, (0.1, 10.0))
    assert int(found.status) == 0 and set(phase_loop.analyse.known) == known
    tension = np.asarray(solved(found.params).tension)
    # within 2 tol of the limit on the safe side, where a constraint is active
    assert (tension >= 2e3).all() and tension.min() < 2e3 * (1 + 3e-6)
