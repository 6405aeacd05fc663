"""Closed forms: two links, their order of convergence, a strut, a hanging weight."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.problems import assert_balanced, two_links, two_links_exact

import jaxcable as jc


def pull(stiffness, pretension, load, method=None, angle=0.0, increments=(5, 3)):
    structure, normal = two_links(stiffness, pretension, load, angle)
    phases = [
        jc.Phase(pretension=pretension, increments=increments[0]),
        jc.Phase(loads=jc.NodalLoads([1], load * normal), increments=increments[1]),
    ]
    return jc.solve(structure, phases, method), normal


@pytest.mark.parametrize("angle", [0.0, 0.5])
@pytest.mark.parametrize("ratio", [1e2, 1e4, 1e6, 1e8])
def test_two_links_keep_their_digits_at_any_stiffness(ratio, angle):
    """From no stiffness at all (unstressed, in line) up to T with EA/T = ratio."""
    solution, normal = pull(ratio, 1.0, 0.2, jc.Newton(tol=1e-13), angle)
    jc.raise_if_failed(solution)
    assert_balanced(solution)
    w, force = two_links_exact(ratio, 1.0, 0.2)
    assert abs(solution.displacement[1] @ normal - w) <= 1e-11 * w
    assert np.abs(np.asarray(solution.tension) - force).max() <= 1e-11 * force


@pytest.mark.parametrize("angle", [0.0, 0.5])
@pytest.mark.parametrize("ratio", [1e2, 1e3, 1e5])
def test_two_links_in_single_precision(ratio, angle):
    structure, normal = two_links(ratio, 1.0, 0.2, angle)
    structure = jc.replace(structure, nodes=jnp.asarray(structure.nodes, jnp.float32))
    load = jc.NodalLoads([1], 0.2 * normal)
    solution = jc.solve(
        structure, [jc.Phase(pretension=1.0, increments=5), jc.Phase(loads=load, increments=3)]
    )
    jc.raise_if_failed(solution)
    assert solution.displacement.dtype == jnp.float32
    # the coordinates as float32 has them, so that the error is that of the analysis
    half_span = np.linalg.norm(np.asarray(structure.nodes[2], float))
    w, force = two_links_exact(ratio, 1.0, 0.2, half_span)
    assert abs(np.asarray(solution.displacement[1], float) @ normal - w) <= 1e-5 * w
    assert np.abs(np.asarray(solution.tension, float) - force).max() <= 1e-5 * force


@pytest.mark.parametrize(
    ("method", "increments", "order"),
    [
        (jc.Incremental(corrections=0, tol=np.inf), (40, 80), 2),
        (jc.Incremental(corrections=1, tol=np.inf), (40, 80), 4),
        (jc.Incremental(corrections=2, tol=np.inf), (8, 16), 8),
        (jc.Incremental(corrections=0, stiffness="secant", tol=np.inf), (40, 80), 1),
    ],
    ids=["tangent-0", "tangent-1", "tangent-2", "secant"],
)
def test_order_of_the_incremental_scheme(method, increments, order):
    w, _ = two_links_exact(100.0, 10.0, 10.0)
    errors = []
    for n in increments:
        solution, normal = pull(100.0, 10.0, 10.0, method, increments=(2, n))
        jc.raise_if_failed(solution)
        errors.append(abs(float(solution.displacement[1] @ normal) - w) / w)
    rate = np.log2(errors[0] / errors[1])
    # 10 percent: at these increments the rate has come down to 2.007, 4.04, 8.40 and 1.005
    assert abs(rate - order) < 0.1 * order, (errors, rate)


def test_secant_scheme_has_the_known_errors():
    """2.5 %, 0.25 % and 0.025 % at 10, 100 and 1000 increments on two links."""
    w, _ = two_links_exact(100.0, 10.0, 10.0)
    method = jc.Incremental(stiffness="secant", tol=np.inf)
    for n, expected in ((10, 0.025), (100, 0.0025), (1000, 0.00025)):
        solution, normal = pull(100.0, 10.0, 10.0, method, increments=(2, n))
        jc.raise_if_failed(solution)
        error = abs(float(solution.displacement[1] @ normal) - w) / w
        assert abs(error - expected) < 0.1 * expected


def test_secant_stiffness_is_exact():
    """K (u - u0) = f(u) - f(u0), for taut, slackening and held elements."""
    from jaxcable.elements import AxialState

    rng = np.random.default_rng(5)
    for group in (jc.Bars, jc.Cables):
        law = group([[0, 1]], axial_stiffness=50.0)
        one = jc.common.tree.copy(law, links=None, axial_stiffness=50.0)
        for held in (None, 3.0):
            for _ in range(20):
                ends, before, after = rng.normal(size=(3, 2, 3))
                chord = np.linalg.norm(ends[1] - ends[0])
                state = AxialState(0.9 * chord, 0.1 * chord, held)
                matrix = one.secant(state, ends, before, after)
                difference = one.end_forces(state, ends, after) - one.end_forces(
                    state, ends, before
                )
                got = jnp.tensordot(matrix, after - before, 2)
                # rounding of forces of some 100 N
                assert np.abs(got - difference).max() < 1e-11
                assert np.abs(matrix - matrix.transpose(2, 3, 0, 1)).max() < 1e-12


def test_first_increment_of_an_unstressed_mechanism_is_solved_to_equilibrium():
    structure, normal = two_links(100.0, 0.0, 1.0)
    phase = jc.Phase(loads=jc.NodalLoads([1], normal), increments=20)
    solution = jc.solve(structure, [phase], jc.Incremental(corrections=1))
    jc.raise_if_failed(solution)
    path = solution.phases[0].path
    assert path.equilibrated.tolist() == [True] + [False] * 19
    w, _ = two_links_exact(100.0, 0.0, 1.0)
    assert abs(float(solution.displacement[1] @ normal) - w) < 1e-4 * w


def test_bars_carry_compression_where_cables_go_slack():
    """Vertical pair, loaded down at mid height: the lower bar is in compression."""
    nodes = np.array([[0, 0, 0], [0, 0, 1.0], [0, 0, 2.0]])
    mask = np.ones((3, 3), bool)
    mask[1, 2] = False  # guided: moves vertically only
    load = jc.Phase(loads=jc.NodalLoads([1], (0, 0, -2.0)))
    for group, share in ((jc.Bars, 0.5), (jc.Cables, 1.0)):
        structure = jc.Structure(
            nodes, group([[0, 1], [1, 2]], axial_stiffness=1e3), jc.Supports(mask)
        )
        solution = jc.solve(structure, [load])
        jc.raise_if_failed(solution)
        lower, upper = (float(t) for t in solution.tension)
        assert upper == pytest.approx(2.0 * share, rel=1e-9)
        assert lower == pytest.approx(-2.0 * (1 - share), rel=1e-9, abs=0)
        assert int(solution.phases[0].path.n_slack[0]) == (0 if group is jc.Bars else 1)


def test_elastic_law_and_area_equal_axial_stiffness():
    phase = jc.Phase(pretension=10.0)
    nodes = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    results = []
    for section in ({"axial_stiffness": 1e3}, {"area": 2e-3, "law": jc.Elastic(5e5)}):
        structure = jc.Structure(nodes, jc.Cables([[0, 1], [1, 2]], **section), jc.pinned([0, 2]))
        load = jc.Phase(loads=jc.NodalLoads([1], (0, 0, -3.0)))
        results.append(jc.solve(structure, [phase, load]))
        jc.raise_if_failed(results[-1])
    assert np.allclose(results[0].displacement, results[1].displacement, rtol=1e-12, atol=1e-15)


def test_series_compliance_adds_to_that_of_the_cable():
    nodes = np.array([[0.0, 0, 0], [0, 0, -1.0]])
    cable = jc.Cables([[0, 1]], axial_stiffness=100.0, compliance=0.03)
    solution = jc.solve(
        jc.Structure(nodes, cable, jc.pinned([0])),
        [jc.Phase(loads=jc.NodalLoads([1], (0, 0, -2.0)))],
    )
    jc.raise_if_failed(solution)
    assert float(solution.displacement[1, 2]) == pytest.approx(-2.0 * (0.01 + 0.03), rel=1e-9)


def test_hanging_weight_with_self_weight():
    """A vertical chain of n links: tension at the top of link k from all that hangs below."""
    n, weight, load, stiffness = 4, 2.0, 5.0, 1e4
    nodes = np.column_stack([np.zeros((n + 1, 2)), -np.arange(n + 1.0)])
    links = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    structure = jc.Structure(
        nodes, jc.Cables(links, axial_stiffness=stiffness, weight=weight), jc.pinned([0])
    )
    loads = [jc.NodalLoads([n], (0, 0, -load)), jc.SelfWeight()]
    solution = jc.solve(structure, [jc.Phase(loads=loads, increments=2)])
    jc.raise_if_failed(solution)
    assert_balanced(solution)
    expected = load + weight * (n - np.arange(n) - 0.5)
    assert np.allclose(solution.tension, expected, rtol=1e-10)
    assert float(solution.reactions[0, 2]) == pytest.approx(load + n * weight, rel=1e-10)


def test_float32_structure_does_not_become_float64():
    structure, phases = jc.scenes.flat_net(load=15.0)
    small = jc.replace(structure, nodes=jnp.asarray(structure.nodes, jnp.float32))
    solution = jc.solve(small, phases)
    jc.raise_if_failed(solution)
    floats = [x for x in jax.tree.leaves(solution) if jnp.issubdtype(x.dtype, jnp.floating)]
    assert {x.dtype for x in floats} == {jnp.dtype("float32")}
