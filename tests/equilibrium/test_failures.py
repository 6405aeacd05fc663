"""Every failure has a status, a place, NaN derivatives, and a usable last state."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.problems import two_links

import jaxcable as jc
from jaxcable.common import status

STRUCTURE, (PRESTRESS, LOADING) = jc.scenes.flat_net(load=75.0, increments=(2, 4))
FREE = np.array([3, 4, 7, 8])
PLAIN = jc.solve(STRUCTURE, [PRESTRESS, LOADING])


def all_nan(x):
    return bool(np.isnan(np.asarray(x)).all())


def check_failed(solution, code, phase, increment):
    """Right code, phase (from 0) and increment (from 0); NaN from there on."""
    assert int(solution.status) == code, jc.describe(solution.status)
    for k, result in enumerate(solution.phases):
        codes = np.asarray(result.path.status)
        expected = [code if (k, i) >= (phase, increment) else 0 for i in range(len(codes))]
        assert codes.tolist() == expected
        assert np.isnan(np.asarray(result.path.displacement)).all(axis=(1, 2)).tolist() == [
            c != 0 for c in expected
        ]
        assert all_nan(result.displacement) == (expected[-1] != 0)
    for value in (
        solution.displacement,
        solution.positions,
        solution.tension,
        solution.rest_length,
        solution.reactions,
        solution.load,
    ):
        assert all_nan(value)
    with pytest.raises(jc.AnalysisError) as error:
        jc.raise_if_failed(solution)
    text = str(error.value)
    assert f"phase {phase + 1}, increment {increment + 1}" in text
    assert " N: " in text and jc.describe(code) in text


def test_mechanism():
    """A link with one free end, pulled where nothing holds it: two islands of a structure."""
    nodes = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]])
    mask = np.zeros((4, 3), bool)
    mask[0] = True
    mask[2:, 1:] = True  # the second island slides along x
    structure = jc.Structure(
        nodes, jc.Bars([[0, 1], [2, 3]], axial_stiffness=100.0), jc.Supports(mask)
    )
    safe = jc.Phase(loads=jc.NodalLoads([1], (5.0, 0, 0)))
    push = jc.Phase(loads=jc.NodalLoads([3], (1.0, 0, 0)), increments=3)
    solution = jc.solve(structure, [safe, push])
    check_failed(solution, status.MECHANISM, 1, 0)
    assert int(solution.last.phase) == 0 and float(solution.last.load_factor) == 1.0
    assert float(solution.last.tension[0]) == pytest.approx(5.0, rel=1e-9)


def test_cable_net_that_nothing_holds_is_a_mechanism():
    nodes = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    mask = np.zeros((3, 3), bool)
    mask[0, 2] = mask[2, 2] = True  # rollers only
    structure = jc.Structure(
        nodes, jc.Cables([[0, 1], [1, 2]], axial_stiffness=100.0), jc.Supports(mask)
    )
    solution = jc.solve(structure, [jc.Phase(loads=jc.NodalLoads([1], (0, 1.0, -1.0)))])
    check_failed(solution, status.MECHANISM, 0, 0)


def test_too_few_steps():
    solution = jc.solve(STRUCTURE, [PRESTRESS, LOADING], jc.Newton(max_steps=3))
    codes = np.asarray(solution.phases[1].path.status)
    k = int((codes != 0).argmax())
    check_failed(solution, status.NOT_CONVERGED, 1, k)
    assert int(solution.phases[1].path.iterations[k]) == 3
    assert (np.asarray(solution.phases[1].path.iterations)[k + 1 :] == 0).all()
    assert np.asarray(solution.phases[1].path.residual)[k] > 0


def test_last_state_is_where_it_stopped():
    """A few increments converge, then a step too large: the last state is exact at its factor."""
    # with 4 increments of 75 N the first needs 5 steps, the later ones fewer
    loads = jnp.array([0.0, 0.0, -300.0])
    phases = [PRESTRESS, jc.Phase(loads=jc.NodalLoads(FREE, loads), increments=40)]
    whole = jc.solve(STRUCTURE, phases)
    steps = np.asarray(whole.phases[1].path.iterations)
    limit = int(steps.max()) - 1
    k = int((steps > limit).argmax())
    stopped = jc.solve(STRUCTURE, phases, jc.Newton(max_steps=limit))
    check_failed(stopped, status.NOT_CONVERGED, 1, k)
    if k:
        assert float(stopped.last.load_factor) == pytest.approx(k / 40)
        assert np.array_equal(stopped.last.displacement, whole.phases[1].path.displacement[k - 1])


@pytest.mark.parametrize("where", ["nodes", "axial_stiffness", "pretension", "load"])
def test_nan_input(where):
    nan = jnp.nan
    structure, tension, load = STRUCTURE, np.full(12, 200.0), np.array([0, 0, -75.0])
    if where == "nodes":
        structure = jc.replace(structure, nodes=structure.nodes + np.eye(12, 3) * nan)
    elif where == "axial_stiffness":
        stiff = np.r_[nan, np.full(11, 97.97e3)]
        structure = jc.replace(
            structure, elements=jc.replace(structure.elements, axial_stiffness=stiff)
        )
    elif where == "pretension":
        tension[5] = nan
    else:
        load[1] = nan
    load = jc.Phase(loads=jc.NodalLoads(FREE, load), increments=2)
    solution = jc.solve(structure, [jc.Phase(pretension=tension), load])
    check_failed(solution, status.NONFINITE, int(where == "load"), 0)
    assert int(solution.last.phase) == (0 if where == "load" else -1)


def test_nan_in_the_incremental_scheme():
    solution = jc.solve(
        STRUCTURE,
        [jc.Phase(pretension=np.r_[np.nan, np.full(11, 200.0)]), LOADING],
        jc.Incremental(1),
    )
    check_failed(solution, status.NONFINITE, 0, 0)


@pytest.mark.slow
def test_drift_of_the_incremental_scheme():
    """One big explicit step drifts; the same with corrections does not."""
    coarse = [PRESTRESS, jc.Phase(loads=LOADING.loads, increments=2)]
    check_failed(jc.solve(STRUCTURE, coarse, jc.Incremental(0)), status.DRIFTED, 1, 0)
    fine = jc.solve(STRUCTURE, coarse, jc.Incremental(8))
    jc.raise_if_failed(fine)
    drifted = jc.solve(STRUCTURE, coarse, jc.Incremental(0, tol=np.inf))
    jc.raise_if_failed(drifted)
    error = np.abs(np.asarray(drifted.displacement - PLAIN.displacement)).max()
    assert 1e-4 < error < 1e-2  # of 34 mm
    assert np.abs(np.asarray(fine.displacement - PLAIN.displacement)).max() < 1e-9


def test_singular_stiffness_of_the_incremental_scheme():
    """Two links lose their tension in the second of four increments."""
    structure, _ = two_links(1e3, 5.0, 0.0)
    slacken = jc.Phase(shortening=-0.016, increments=4)
    phases = [jc.Phase(pretension=5.0), slacken]
    check_failed(jc.solve(structure, phases, jc.Incremental(0)), status.SINGULAR, 1, 1)
    jc.raise_if_failed(jc.solve(structure, phases))  # an equilibrium with a loose node


# --- loose nodes


def loose_scene(slack):
    """Two links in line, prestressed, and a third node hung on with slack cables."""
    nodes = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [1.0, 1.0, 0], [1.0, 2.0, 0]])
    links = [[0, 1], [1, 2], [1, 3], [3, 4]]
    return jc.Structure(
        nodes,
        jc.Cables(links, axial_stiffness=1e3, rest_length=[0.99, 0.99, slack, slack]),
        jc.pinned([0, 2, 4]),
    )


def loose_solution(load, slack=1.2):
    phases = [jc.Phase(), jc.Phase(loads=jc.NodalLoads([1], load))]
    return jc.solve(loose_scene(slack), phases)


def test_a_loose_node_is_counted_and_no_failure():
    solution = loose_solution((0.0, 0.0, -1.0))
    jc.raise_if_failed(solution)
    path = solution.phases[1].path
    assert int(path.n_slack[0]) == 2 and int(path.n_loose[0]) == 1
    assert np.asarray(solution.tension)[2:].tolist() == [0.0, 0.0]
    assert np.asarray(solution.displacement)[3].tolist() == [0.0, 0.0, 0.0]


@pytest.mark.slow
def test_derivatives_beside_a_loose_node():
    """Exact where they do not depend on it, NaN where they do; in both modes."""
    load = jnp.array([0.1, 0.0, -1.0])

    def end(load, node):
        return loose_solution(load).displacement[node]

    structure = loose_scene(1.2)
    alone = jc.Structure(
        structure.nodes[:3],
        jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e3, rest_length=0.99),
        jc.pinned([0, 2]),
    )

    def without(load):
        phases = [jc.Phase(), jc.Phase(loads=jc.NodalLoads([1], load))]
        return jc.solve(alone, phases).displacement[1]

    expected = jax.jacfwd(without)(load)
    for mode in (jax.jacfwd, jax.jacrev):
        got = mode(lambda p: end(p, 1))(load)
        assert jnp.abs(got - expected).max() < 1e-9 * jnp.abs(expected).max()
        assert all_nan(mode(lambda p: end(p, 3))(load))


# --- gradients of failures


def analysis(stiffness, tension, load):
    structure = jc.replace(
        STRUCTURE, elements=jc.replace(STRUCTURE.elements, axial_stiffness=stiffness)
    )
    phases = [
        jc.Phase(pretension=tension, increments=2),
        jc.Phase(loads=jc.NodalLoads(FREE, load), increments=2),
    ]
    return jc.solve(structure, phases, jc.Newton(max_steps=30))


LOAD = jnp.array([0.0, 1.0, -75.0])


@jax.jit
@functools.partial(jax.grad, argnums=(0, 1, 2))
def rates(*parameters):
    return analysis(*parameters).displacement[3, 2]


@pytest.mark.parametrize(
    ("tension", "load"),
    [(np.nan, LOAD), (200.0, LOAD.at[0].set(jnp.nan))],
    ids=["phase 1", "phase 2"],
)
def test_gradients_of_a_failed_solution_are_nan(tension, load):
    assert all(np.isfinite(g).all() for g in rates(97.97e3, 200.0, LOAD))
    for g in rates(97.97e3, tension, load):
        assert all_nan(g)


@pytest.mark.slow
def test_the_last_state_of_a_failed_analysis_is_differentiable():
    bad = LOAD.at[0].set(jnp.nan)

    def last(tension):
        return analysis(97.97e3, tension, bad).last.tension[3]

    def plain(tension):
        return jc.solve(STRUCTURE, [jc.Phase(pretension=tension)]).tension[3]

    tension = 200.0 + jnp.arange(12.0)
    got, expected = jax.grad(last)(tension), jax.grad(plain)(tension)
    assert jnp.abs(expected).max() > 0.1
    assert jnp.abs(got - expected).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    "method",
    [None, pytest.param(jc.Incremental(1, tol=9.0), marks=pytest.mark.slow)],
    ids=["newton", "tangent"],
)
def test_the_last_state_keeps_its_whole_derivative(method):
    """With respect to what it depends on directly too: stiffness and nodes."""
    bad = jc.Phase(loads=jc.NodalLoads([3], (0, 0, np.nan)))
    load = jc.Phase(loads=jc.NodalLoads(FREE, (0, 0, -10.0)))

    @jax.jit
    @functools.partial(jax.grad, has_aux=True)
    def both(structure):
        short = jc.solve(structure, [jc.Phase(pretension=200.0), load], method)
        failed = jc.solve(structure, [jc.Phase(pretension=200.0), load, bad], method)

        def value(s):
            return s.last.tension[3] + 1e4 * s.last.positions[3, 0] + s.last.reactions[0, 1]

        return value(failed) - value(short), (failed.status, value(short))

    gradient, (code, _) = both(STRUCTURE)
    assert int(code) == status.NONFINITE
    # the two derivatives cancel: each is of order 1e4 for the nodes, 1e-3 for the stiffness
    assert jnp.abs(gradient.nodes).max() < 1e-6
    assert jnp.abs(gradient.elements.axial_stiffness).max() < 1e-12


def test_the_last_state_has_the_reactions_of_its_own_supports():
    mask = np.asarray(STRUCTURE.fixed(STRUCTURE.supports)).copy()
    mask[0, 1:] = False
    bad = jc.Phase(supports=jc.Supports(mask), loads=jc.NodalLoads([3], (0, 0, np.nan)))
    last = jc.solve(STRUCTURE, [PRESTRESS, LOADING, bad]).last
    plain = jc.solve(STRUCTURE, [PRESTRESS, LOADING]).last
    assert int(last.phase) == 1 and float(last.load_factor) == 1.0
    # two programs: in one of them a later phase frees what these hold; a rounding of 438 N, 6e-14
    assert np.asarray(last.reactions) == pytest.approx(np.asarray(plain.reactions), abs=2e-13)
    assert float(last.reactions[0, 2]) > 1


@pytest.mark.slow
def test_singular_on_the_way_does_not_spoil_the_gradient():
    """An empty phase of an unstressed flat net is singular; what follows is not."""
    load = jc.Phase(loads=jc.NodalLoads(FREE, (0, 0, -15.0)))

    def end(stiffness, phases):
        elements = jc.replace(STRUCTURE.elements, axial_stiffness=stiffness)
        return jc.solve(jc.replace(STRUCTURE, elements=elements), phases).displacement[3, 2]

    alone = jax.grad(lambda p: end(p, [load]))(97.97e3)
    after = jax.grad(lambda p: end(p, [jc.Phase(), load]))(97.97e3)
    assert float(after) == pytest.approx(float(alone), rel=1e-9)
    singular = jax.grad(lambda p: end(p, [jc.Phase()]))(97.97e3)
    assert np.isnan(singular)


def test_a_cable_taken_in_altogether():
    """0.5 m out of 0.4 m: fails at the increment where no length is left."""
    solution = jc.solve(STRUCTURE, [jc.Phase(shortening=0.5, increments=10)])
    check_failed(solution, status.NONFINITE, 0, 7)
    assert float(solution.last.load_factor) == pytest.approx(0.7)


def test_one_failed_case_leaves_the_others_and_the_shared_gradient_finite():
    """The mask idiom: compute from `last`, then select by status."""
    tensions = np.array([200.0, np.nan, 250.0])

    @jax.jit
    @functools.partial(jax.jacrev, has_aux=True)
    def slopes(stiffness, tensions, counts):
        """Of the sum over the cases that count, and of what the first two of them displace."""

        def one(tension):
            s = analysis(stiffness, tension, LOAD)
            value = s.last.displacement[3, 2] ** 2 + s.last.tension[0] / 1e6
            return jnp.where(s.status == status.OK, value, 0.0), s.displacement[3, 2]

        values, displacement = jax.vmap(one)(tensions)
        return jnp.append(jnp.sum(counts * values), displacement[:2]), displacement

    (gradient, good, bad), displacement = slopes(97.97e3, tensions, np.ones(3))
    (alone, *_), _ = slopes(97.97e3, np.array([200.0, 225.0, 250.0]), np.array([1.0, 0.0, 1.0]))
    assert np.isfinite(gradient) and abs(gradient / alone - 1) < 1e-10
    assert np.isnan(displacement).tolist() == [False, True, False]
    # one good case of the batch alone: its gradient is not spoilt by its failed neighbour
    assert np.isfinite(good)
    assert np.isnan(bad)


def test_a_batch_names_its_failed_case():
    solution = jax.vmap(lambda t: analysis(97.97e3, t, LOAD))(jnp.array([200.0, jnp.nan]))
    assert solution.status.tolist() == [0, status.NONFINITE]
    with pytest.raises(jc.AnalysisError, match="case 1: phase 1, increment 1"):
        jc.raise_if_failed(solution)


def test_starting_from_a_failed_solution_stays_failed():
    failed = analysis(97.97e3, jnp.nan, LOAD)
    again = jc.solve(STRUCTURE, [LOADING], start=failed)
    assert int(again.status) == status.NONFINITE and all_nan(again.displacement)


def test_describe_knows_every_code_and_no_other():
    codes = [getattr(status, n) for n in dir(status) if n.isupper() and not n.startswith("_")]
    assert len({jc.describe(c) for c in codes}) == len(codes) == 27
    with pytest.raises(ValueError, match="code = 99"):
        jc.describe(99)


def test_bars_without_force_are_in_balance():
    """A tripod has no self-stress: shortened, warmed or moved it stands in its new place, unloaded.

    What the rounding of EA leaves of its forces is then all that there is; it counts as balanced.
    """
    angle = 2 * np.pi * np.arange(3) / 3
    feet = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    nodes = np.concatenate([feet, [[0.0, 0, 1.0]]])
    legs = jc.Bars([[k, 3] for k in range(3)], axial_stiffness=2e7, expansion=1e-5)
    structure = jc.Structure(nodes, legs, jc.pinned([0, 1, 2]))
    cases = {
        "shortening": np.array([0.01, 0.0, 0.0]),
        "temperature": np.array([40.0, 10.0, 0.0]),
        "prestrain": np.full(3, -0.02),
    }
    none = dict.fromkeys(cases, np.zeros(3))
    for name, value in cases.items():
        solution = jc.solve(structure, [jc.Phase(**none | {name: value})])
        assert int(solution.status) == 0, name
        ways = np.asarray(solution.positions[3]) - feet
        length = np.linalg.norm(ways, axis=1)
        assert length == pytest.approx(np.asarray(solution.rest_length), rel=1e-14)
        assert np.abs(solution.tension).max() < 1e-6  # eps EA, some times


def test_derivative_of_bars_without_force():
    """The tripod of before, by the shortening of one leg: its top moves as geometry says.

    ``l^2 = |top - foot|^2`` for three legs, differentiated by the first l.
    """
    angle = 2 * np.pi * np.arange(3) / 3
    feet = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    legs = jc.Bars([[k, 3] for k in range(3)], axial_stiffness=2e7)
    nodes = np.concatenate([feet, [[0.0, 0, 1.0]]])
    structure = jc.Structure(nodes, legs, jc.pinned([0, 1, 2]))

    def top(v):
        return jc.solve(structure, [jc.Phase(shortening=v)]).positions[3]

    found = jax.jit(jax.jacfwd(top))(jnp.zeros(3))
    ways = np.array([0, 0, 1.0]) - feet
    exact = np.linalg.solve(ways, -np.diag(np.linalg.norm(ways, axis=1)))
    assert np.asarray(found) == pytest.approx(exact, abs=1e-12)


def test_two_nodes_that_meet():
    """A jack draws a node onto its support: the text says what helps."""
    cable = jc.Cables([[0, 1]], axial_stiffness=1e4)
    structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], cable, jc.pinned([0]))
    phase = jc.Phase(jacking=0.9, loads=jc.NodalLoads([1], (0.5, 0, 0)))
    solution = jc.solve(structure, phase)
    check_failed(solution, status.COLLAPSED, 0, 0)
    assert "join the nodes" in jc.describe(solution.status)
    # with a load above the force of the jack it runs away instead
    away = jc.solve(
        structure, jc.replace(phase, loads=jc.NodalLoads([1], (1.5, 0, 0))), jc.Newton(max_steps=50)
    )
    assert int(away.status) in (status.MECHANISM, status.NOT_CONVERGED)


def test_forces_that_rounding_hides():
    """A slack chain in float32: its forces are known above EA times the *square* of eps."""
    n = 8
    nodes = np.array([[k, 0.3 * np.sin(k), 0] for k in range(n + 1)])
    forces = np.random.default_rng(1).normal(size=(n - 1, 3))

    def analysed(dtype, stiffness):
        cables = jc.Cables(
            [[k, k + 1] for k in range(n)], axial_stiffness=dtype(stiffness), rest_length=dtype(1.3)
        )
        structure = jc.Structure(nodes.astype(dtype), cables, jc.pinned([0, n]))
        loads = jc.NodalLoads(range(1, n), forces.astype(dtype))
        return jc.solve(structure, jc.Phase(loads=loads))

    single, double = (analysed(dtype, 1e9) for dtype in (np.float32, np.float64))
    assert int(single.status) == int(double.status) == status.OK
    # the rounding of displacements of 1 m alone is a force of EA eps = 100 N
    assert np.abs(single.tension - double.tension).max() < 1e-4
    codes = [int(analysed(dtype, 1e15).status) for dtype in (np.float32, np.float64)]
    assert codes == [status.AT_ROUNDING, status.OK]
    assert "float64" in jc.describe(codes[0])
