"""Dynamic relaxation against closed forms, and as the cross-check of `find_form` and `solve`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged
from oracles.traced import traced

import jaxcable as jc
from jaxcable.common.selection import only
from jaxcable.forms import dynamic_relaxation, find_form

EA = 2e4


def two_links(**options):
    nodes = np.array([[-1.0, 0, 0], [1.0, 0, 0], [0.0, 0, 0]])
    options = options or {"axial_stiffness": EA}
    return jc.Structure(nodes, jc.Cables([[0, 2], [1, 2]], **options), jc.pinned([0, 1]))


LINKS = two_links()


def down(force):
    return jc.NodalLoads([2], jnp.array([0.0, 0.0, -1.0]) * force)


def test_minimal_net_of_a_saddle_frame_as_by_newton():
    structure, _ = jc.scenes.saddle(4, 4, rise=0.3)
    start = structure.nodes + 0.5 * np.random.default_rng(1).normal(size=structure.nodes.shape)
    newton, relaxed = find_form(structure, 1e3), dynamic_relaxation(structure, 1e3, start=start)
    assert int(newton.status) == int(relaxed.status) == 0
    # both within 1e-10 of 4 T over a stiffness of about T/l
    assert np.abs(newton.positions - relaxed.positions).max() < 1e-8
    assert np.abs(relaxed.rest_length - newton.rest_length).max() < 1e-8
    assert (np.asarray(relaxed.tension) == 1e3).all()
    assert float(relaxed.relative_residual) <= 1e-10


def test_two_links_closed_form():
    """Kwan: ``P = 2 N w / l``, N = EA (l - L0)/L0 (half-span 1, deflection w)."""
    w, rest = 0.2, 0.99
    length = np.hypot(1, w)
    N = EA * (length - rest) / rest
    form = converged(dynamic_relaxation(LINKS, rest_length=rest, loads=down(2 * N * w / length)))
    assert abs(float(form.positions[2, 2]) + w) < 1e-9
    assert np.abs(form.tension / N - 1).max() < 1e-9
    assert np.abs(form.rest_length - rest).max() == 0


@pytest.mark.slow
def test_elastic_net_as_by_solve():
    """With cables that go slack."""
    structure, (first, _) = jc.scenes.saddle(3, 3, axial_stiffness=1e6, pretension=50.0)
    load = jc.NodalLoads(np.arange(structure.n_node), (0, 0, -2000.0))
    solution = jc.solve(structure, [first, jc.Phase(loads=load)])
    form = dynamic_relaxation(structure, rest_length=solution.rest_length, loads=load, tol=1e-11)
    assert int(solution.status) == int(form.status) == 0
    slack = np.asarray(form.tension) == 0
    assert slack.any() and slack.sum() == int(solution.phases[1].path.n_slack[0])
    assert np.abs(form.positions - solution.positions).max() < 1e-8
    apart = np.abs(form.tension - solution.tension).max()
    assert apart < 1e-8 * np.abs(solution.tension).max()


def test_a_law_of_points_and_default_lengths():
    """Without an input the chord is the unstressed length; forces follow the curve.

    A node that sinks by w: strain ``sqrt(1 + w^2) - 1`` and ``P = 2 N w / l``.
    """
    law = jc.Polygonal([0.0, 0.001, 0.05], [0.0, 200e6, 300e6])
    structure, w = two_links(area=1e-5, law=law), 0.2
    length = np.hypot(1.0, w)
    N = 1e-5 * (200e6 + 100e6 * (length - 1.001) / 0.049)
    form = converged(dynamic_relaxation(structure, loads=down(2 * N * w / length)))
    assert abs(float(form.positions[2, 2]) + w) < 1e-9
    assert np.abs(form.tension / N - 1).max() < 1e-9
    torn = dynamic_relaxation(structure, loads=down(6000.0))
    assert int(torn.status) == jc.status.MATERIAL_FAILURE and np.isnan(torn.tension).all()


def test_held_and_elastic_in_one_group():
    """Given force on one side, given unstressed length on the other: by the law of the other."""
    T, rest = 100.0, 0.8
    form = converged(dynamic_relaxation(LINKS, only([0], T), only([1], rest)))
    assert np.abs(form.tension - T).max() < 1e-7
    assert abs(float(form.length[1]) - rest * (1 + T / EA)) < 1e-9
    assert abs(float(form.rest_length[0]) * (1 + T / EA) - float(form.length[0])) < 1e-12


@pytest.mark.parametrize("find", [find_form, dynamic_relaxation])
def test_held_strut_under_guys(find):
    """A strut of given thrust, its top free to rise: ``N = 3 T z / l``; groups by name."""
    nodes = np.array([[-1.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0], [0, 0, -1.0], [0.0, 0, 0.5]])
    elements = {
        "guys": jc.Cables([[0, 4], [1, 4], [2, 4]], axial_stiffness=EA),
        "strut": jc.Bars([[3, 4]], axial_stiffness=EA),
    }
    supports = jc.pinned(range(4)) + jc.restrained([4], "xy")
    form = find(jc.Structure(nodes, elements, supports), {"guys": 100.0, "strut": -200.0})
    assert int(form.status) == 0
    sine = 200 / 300
    assert abs(float(form.positions[4, 2]) - sine / np.sqrt(1 - sine**2)) < 1e-8
    assert float(form.rest_length["strut"][0]) > float(form.length["strut"][0])


def test_transformations():
    """jit and vmap give the same; derivatives are NaN, not zero."""

    @traced
    def low(P, T):
        form = dynamic_relaxation(LINKS, T, loads=down(P))
        return form.positions[2, 2], form.status

    P, T = jnp.array([60.0, 20.0, 500.0]), 100.0
    depth, status = traced(jax.vmap(low, (0, None)))(P, T)
    assert status.tolist()[:2] == [0, 0] and int(status[2]) != 0
    expected = -P / jnp.sqrt(4 * T**2 - P**2)  # 2 T z / l = P
    assert np.abs(depth[:2] - expected[:2]).max() < 1e-8 and np.isnan(depth[2])
    assert abs(low(60.0, T)[0] - depth[0]) < 1e-8
    assert np.isnan(jax.grad(lambda T: low(60.0, T)[0])(T))
    assert np.isnan(jax.jvp(lambda P: low(P, T)[0], (60.0,), (1.0,))[1])


def test_failures_are_statuses():
    away = dynamic_relaxation(LINKS, 10.0, loads=down(500.0))
    assert int(away.status) == jc.status.MECHANISM
    with pytest.raises(jc.AnalysisError, match="move nodes without limit"):
        jc.raise_if_failed(away)
    early = dynamic_relaxation(LINKS, 10.0, loads=down(5.0), max_steps=3)
    assert int(early.status) == jc.status.OUT_OF_TIME_STEPS and int(early.iterations) == 3
    drawn = dynamic_relaxation(LINKS, np.array([10.0, 20.0]), loads=down(0.0), max_steps=2000)
    assert int(drawn.status) in (jc.status.OUT_OF_TIME_STEPS, jc.status.NONFINITE)
    lost = dynamic_relaxation(LINKS, jnp.nan, loads=down(0.0))
    assert int(lost.status) == jc.status.NONFINITE
    for form in (away, early, drawn, lost):
        assert np.isnan(form.positions).all() and np.isnan(form.rest_length).all()
