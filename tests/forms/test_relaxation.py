"""Dynamic relaxation against closed forms, and as the cross-check of `find_form` and `solve`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.common.selection import only
from jaxcable.forms import dynamic_relaxation, find_form
from jaxcable.forms.relaxation import _relax

EA = 2e4


def two_links(kind=jc.Cables, **options):
    nodes = np.array([[-1.0, 0, 0], [1.0, 0, 0], [0.0, 0, 0]])
    options = options or {"axial_stiffness": EA}
    return jc.Structure(nodes, kind([[0, 2], [1, 2]], **options), jc.pinned([0, 1]))


def test_minimal_net_of_a_saddle_frame_as_by_newton():
    structure, _ = jc.scenes.saddle(6, 6, rise=0.3)
    newton, relaxed = find_form(structure, 1e3), dynamic_relaxation(structure, 1e3)
    assert int(newton.status) == int(relaxed.status) == 0
    # both within 1e-10 of 4 T over a stiffness of about T/l
    assert np.abs(newton.positions - relaxed.positions).max() < 1e-8
    assert np.abs(relaxed.rest_length - newton.rest_length).max() < 1e-8
    assert (np.asarray(relaxed.tension) == 1e3).all()
    assert float(relaxed.relative_residual) <= 1e-10


@pytest.mark.parametrize("seed", [0, 1])
def test_as_by_newton_from_another_start_and_with_loads(seed):
    structure, _ = jc.scenes.saddle(4, 3, rise=0.3)
    rng = np.random.default_rng(seed)
    T = rng.uniform(950, 1050, len(structure.elements.links))
    load = jc.NodalLoads(np.arange(structure.n_node), rng.normal(size=(structure.n_node, 3)) * 30)
    newton = find_form(structure, T, load)
    start = structure.nodes + rng.normal(size=structure.nodes.shape)
    relaxed = dynamic_relaxation(structure, T, loads=load, start=start)
    assert int(newton.status) == int(relaxed.status) == 0
    assert np.abs(newton.positions - relaxed.positions).max() < 1e-8


def test_two_links_closed_form():
    """Kwan: ``P = 2 N w / l``, N = EA (l - L0)/L0 (half-span 1, deflection w)."""
    w, rest = 0.2, 0.99
    length = np.hypot(1, w)
    N = EA * (length - rest) / rest
    load = jc.NodalLoads([2], (0, 0, -2 * N * w / length))
    form = dynamic_relaxation(two_links(), rest_length=rest, loads=load)
    assert int(form.status) == 0
    assert abs(float(form.positions[2, 2]) + w) < 1e-9
    assert np.abs(form.tension / N - 1).max() < 1e-9
    assert np.abs(form.rest_length - rest).max() == 0


@pytest.mark.parametrize("net", [pytest.param("taut", marks=pytest.mark.slow), "slack"])
def test_elastic_net_as_by_solve(net):
    if net == "taut":
        structure, phases = jc.scenes.saddle(3, 3)
    else:
        structure, phases = jc.scenes.saddle(3, 3, axial_stiffness=1e6, pretension=50.0)
        load = jc.NodalLoads(np.arange(structure.n_node), (0, 0, -2000.0))
        phases = [phases[0], jc.Phase(loads=load)]
    solution = jc.solve(structure, phases)
    form = dynamic_relaxation(
        structure, rest_length=solution.rest_length, loads=phases[1].loads, tol=1e-11
    )
    assert int(solution.status) == int(form.status) == 0
    slack = np.asarray(form.tension) == 0
    assert slack.sum() == int(solution.phases[1].path.n_slack[0])
    assert slack.any() == (net == "slack")
    assert np.abs(form.positions - solution.positions).max() < 1e-8
    apart = np.abs(form.tension - solution.tension).max()
    assert apart < 1e-8 * np.abs(solution.tension).max()


def test_a_law_of_points_and_default_lengths():
    """Without a statement the chord is the unstressed length; forces follow the curve."""
    law = jc.Polygonal([0.0, 0.001, 0.05], [0.0, 200e6, 300e6])
    structure = two_links(area=1e-5, law=law)
    load = jc.NodalLoads([2], (0, 0, -600.0))
    form = dynamic_relaxation(structure, loads=load)
    solution = jc.solve(structure, jc.Phase(loads=load))
    assert int(form.status) == int(solution.status) == 0
    assert float(form.length[0]) > 1.001  # beyond the corner
    assert np.abs(form.positions - solution.positions).max() < 1e-9
    torn = dynamic_relaxation(structure, loads=jc.NodalLoads([2], (0, 0, -6000.0)))
    assert int(torn.status) == jc.status.MATERIAL_FAILURE
    assert np.isnan(torn.tension).all()


def test_held_and_elastic_in_one_group():
    """Given force on one side, given unstressed length on the other: by the law of the other."""
    structure = two_links()
    T, rest = 100.0, 0.8
    form = dynamic_relaxation(structure, only([0], T), only([1], rest))
    assert int(form.status) == 0
    assert np.abs(form.tension - T).max() < 1e-7
    assert abs(float(form.length[1]) - rest * (1 + T / EA)) < 1e-9
    assert abs(float(form.rest_length[0]) * (1 + T / EA) - float(form.length[0])) < 1e-12


def test_strut_and_cables_in_a_dict():
    nodes = np.array([[-1.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0], [0, 0, -1.0], [0.0, 0, 0.5]])
    mask = np.ones((5, 3), bool)
    mask[4, 2] = False
    elements = {
        "guys": jc.Cables([[0, 4], [1, 4], [2, 4]], axial_stiffness=EA),
        "strut": jc.Bars([[3, 4]], axial_stiffness=EA),
    }
    structure = jc.Structure(nodes, elements, jc.Supports(mask))
    tension = {"guys": 100.0, "strut": -200.0}
    relaxed, newton = dynamic_relaxation(structure, tension), find_form(structure, tension)
    assert int(relaxed.status) == int(newton.status) == 0
    sine = 200 / 300  # N = 3 T z / l
    assert abs(float(relaxed.positions[4, 2]) - sine / np.sqrt(1 - sine**2)) < 1e-8
    assert np.abs(relaxed.positions - newton.positions).max() < 1e-8


def test_transformations():
    """jit and vmap give the same; derivatives are NaN, not zero."""
    structure = two_links()

    @jax.jit
    def low(P, T):
        form = dynamic_relaxation(
            structure, T, loads=jc.NodalLoads([2], jnp.array([0, 0, -1.0]) * P)
        )
        return form.positions[2, 2], form.status

    P, T = jnp.array([60.0, 20.0, 500.0]), 100.0
    depth, status = jax.jit(jax.vmap(low, (0, None)))(P, T)
    assert status.tolist()[:2] == [0, 0] and int(status[2]) != 0
    expected = -P / jnp.sqrt(4 * T**2 - P**2)  # 2 T z / l = P
    assert np.abs(depth[:2] - expected[:2]).max() < 1e-8 and np.isnan(depth[2])
    assert abs(low(60.0, T)[0] - depth[0]) < 1e-8
    assert np.isnan(jax.grad(lambda T: low(60.0, T)[0])(T))
    assert np.isnan(jax.jvp(lambda P: low(P, T)[0], (60.0,), (1.0,))[1])


def test_failures_are_statuses():
    structure = two_links()
    away = dynamic_relaxation(structure, 10.0, loads=jc.NodalLoads([2], (0, 0, -500.0)))
    assert int(away.status) == jc.status.MECHANISM
    with pytest.raises(jc.AnalysisError, match="moves without limit"):
        jc.raise_if_failed(away)
    early = dynamic_relaxation(structure, 10.0, loads=jc.NodalLoads([2], (0, 0, -5.0)), max_steps=3)
    assert int(early.status) == jc.status.OUT_OF_TIME_STEPS and int(early.iterations) == 3
    drawn = dynamic_relaxation(structure, np.array([10.0, 20.0]), max_steps=2000)
    assert int(drawn.status) in (jc.status.OUT_OF_TIME_STEPS, jc.status.NONFINITE)
    lost = dynamic_relaxation(structure, jnp.nan)
    assert int(lost.status) == jc.status.NONFINITE
    for form in (away, early, drawn, lost):
        assert np.isnan(form.positions).all() and np.isnan(form.rest_length).all()


def test_changing_numbers_does_not_recompile():
    structure = two_links()
    dynamic_relaxation(structure, 10.0, loads=jc.NodalLoads([2], (0, 0, -5.0)))
    before = _relax._cache_size()
    dynamic_relaxation(
        jc.replace(structure, nodes=np.asarray(structure.nodes) * 2),
        20.0,
        loads=jc.NodalLoads([2], (0, 1.0, -5.0)),
        tol=1e-9,
        max_steps=50_000,
    )
    assert _relax._cache_size() == before


def test_refused():
    structure = two_links()
    with pytest.raises(ValueError, match="tension, rest_length: element 1 of elements has both"):
        dynamic_relaxation(structure, 1.0, only([1], 1.0))
    with pytest.raises(ValueError, match=r"tension\[0\] = -1.0: a cable carries tension only"):
        dynamic_relaxation(structure, -1.0)
    with pytest.raises(ValueError, match=r"rest_length\[0\] = 0.0: must be positive"):
        dynamic_relaxation(structure, rest_length=0.0)
    with pytest.raises(ValueError, match=r"start: expected shape \(3, 3\), got \(2, 3\)"):
        dynamic_relaxation(structure, 1.0, start=np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"loads\[0\]: SelfWeight is not known"):
        dynamic_relaxation(structure, 1.0, loads=jc.SelfWeight())
    with pytest.raises(ValueError, match=r"tol = 0\.0: must be positive"):
        dynamic_relaxation(structure, 1.0, tol=0.0)
