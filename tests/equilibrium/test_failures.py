"""Every failure has a status, a place, NaN derivatives, and a usable last state."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks import shapes
from banks.problems import two_links, two_links_exact, unbalanced
from oracles.traced import traced

import jaxcable as jc
from jaxcable.common import status

STRUCTURE, _ = jc.scenes.flat_net()
FREE = np.array([3, 4, 7, 8])
STIFF, TENSION, LOAD = np.full(12, 97.97e3), np.full(12, 200.0), np.array([0, 1.0, -75.0])


def solve_flat_net(stiffness=STIFF, tension=TENSION, load=LOAD, method=None, nodes=STRUCTURE.nodes):
    """Prestress of the flat net in two increments, loads in four: one program for most tests."""
    cables = jc.replace(STRUCTURE.elements, axial_stiffness=stiffness)
    structure = jc.replace(STRUCTURE, nodes=nodes, elements=cables)
    phases = [
        jc.Phase(pretension=tension, increments=2),
        jc.Phase(loads=jc.NodalLoads(FREE, load), increments=4),
    ]
    return jc.solve(structure, phases, method)


def all_nan(x):
    return bool(np.isnan(np.asarray(x)).all())


def check_failed(solution, code, phase, increment):
    """Right code, phase (from 0) and increment (from 0); NaN from there on."""
    assert int(solution.status) == code, jc.describe(solution.status)
    for k, result in enumerate(solution.phases):
        codes = np.asarray(result.path.status)
        expected = [code if (k, i) >= (phase, increment) else 0 for i in range(len(codes))]
        assert codes.tolist() == expected
        missing = np.isnan(np.asarray(result.path.displacement)).all(axis=(1, 2))
        assert missing.tolist() == [c != 0 for c in expected]
        assert all_nan(result.displacement) == (expected[-1] != 0)
        later = [(k, i) > (phase, increment) for i in range(len(codes))]
        assert not np.asarray(result.path.iterations)[later].any()
    for name in ("displacement", "positions", "tension", "rest_length", "reactions", "load"):
        assert all_nan(getattr(solution, name))
    with pytest.raises(jc.AnalysisError) as error:
        jc.raise_if_failed(solution)
    text = str(error.value)
    assert f"phase {phase + 1}, increment {increment + 1}" in text
    # no step, no unbalanced force; a residual that is no number is not printed
    residual = np.asarray(solution.phases[phase].path.residual)[increment]
    assert (" N: " in text) == (np.isfinite(residual) and residual != 0)
    assert jc.describe(code) in text


def test_a_bar_that_slides_freely_is_a_mechanism():
    """Bars that slide along x, pulled where only the first one is held: in the second phase."""
    bars = jc.Bars([[0, 1], [2, 3]], axial_stiffness=100.0)
    held = jc.pinned([0]) + jc.restrained([2, 3], "yz")
    structure = jc.Structure(shapes.pieces(3, 3)[0], bars, held)
    safe = jc.Phase(loads=jc.NodalLoads([1], (5.0, 0, 0)))
    push = jc.Phase(loads=jc.NodalLoads([3], (1.0, 0, 0)), increments=3)
    with pytest.warns(jc.UnstableWarning, match=r"phases\[0\]"):  # nothing holds them before it
        solution = jc.solve(structure, [safe, push])
    check_failed(solution, status.MECHANISM, 1, 0)
    assert int(solution.last.phase) == 0 and float(solution.last.load_factor) == 1.0
    assert float(solution.last.tension[0]) == pytest.approx(5.0, rel=1e-9)


def test_cable_net_that_nothing_holds_is_a_mechanism():
    nodes, links = shapes.pieces(2, 2)
    cables = jc.Cables(links, axial_stiffness=100.0)
    structure = jc.Structure(nodes, cables, jc.restrained([0, 2], "z"))  # rollers only
    load = jc.NodalLoads([1], (0, 1.0, -1.0))
    check_failed(jc.solve(structure, jc.Phase(loads=load)), status.MECHANISM, 0, 0)


def test_too_few_steps():
    plain = solve_flat_net()
    assert int(plain.status) == status.OK
    steps = np.asarray(plain.phases[1].path.iterations)
    assert steps[0] > 3
    solution = solve_flat_net(method=jc.Newton(max_steps=3))
    check_failed(solution, status.NOT_CONVERGED, 1, 0)
    path = solution.phases[1].path
    assert path.iterations.tolist() == [3, 0, 0, 0] and path.residual[0] > 0
    assert solution.last.phase == 0
    np.testing.assert_array_equal(solution.last.tension, plain.phases[0].tension)


@pytest.mark.parametrize("where", ["nodes", "stiffness", "tension", "load"])
@pytest.mark.parametrize("method", [None, jc.Incremental(1)], ids=["newton", "incremental"])
def test_nan_input(where, method):
    usual = {"nodes": STRUCTURE.nodes, "stiffness": STIFF, "tension": TENSION, "load": LOAD}
    spoilt = np.array(usual[where])
    spoilt.flat[1] = np.nan
    solution = solve_flat_net(**{where: spoilt}, method=method)
    check_failed(solution, status.NONFINITE, int(where == "load"), 0)
    assert int(solution.last.phase) == (0 if where == "load" else -1)


def test_drift_of_the_incremental_scheme():
    """What explicit steps leave is judged by the load so far, in Euclidean norms, as by NumPy."""
    plain, drifted = solve_flat_net(), solve_flat_net(method=jc.Incremental(1, tol=np.inf))
    jc.raise_if_failed(plain)
    jc.raise_if_failed(drifted)
    error = np.abs(np.asarray(drifted.displacement - plain.displacement)).max()
    assert 1e-6 < error < 1e-2  # of 34 mm
    ratios, links = [], STRUCTURE.elements.links.array
    for k, displacement in enumerate(np.asarray(drifted.phases[1].path.displacement_in_phase), 1):
        load = np.zeros((12, 3))
        load[FREE] = LOAD * k / 4
        positions = np.asarray(STRUCTURE.nodes) + displacement
        rest = np.asarray(drifted.rest_length)
        left, _ = unbalanced(STRUCTURE.nodes, links, STIFF, rest, positions, load)
        ratios.append(np.linalg.norm(left[FREE]) / np.linalg.norm(load))
    assert max(ratios) > 1e-2
    jc.raise_if_failed(solve_flat_net(method=jc.Incremental(1, tol=1.001 * max(ratios))))
    coarse = solve_flat_net(method=jc.Incremental(1, tol=0.999 * max(ratios)))
    check_failed(coarse, status.DRIFTED, 1, int(np.argmax(ratios)))


def test_singular_stiffness_of_the_incremental_scheme():
    """Two links lose their tension in the second of four increments."""
    structure, _ = two_links(1e3, 5.0, 0.0)
    slacken = jc.Phase(shortening=-0.016, increments=4)
    phases = [jc.Phase(pretension=5.0), slacken]
    solution = jc.solve(structure, phases, jc.Incremental(0))
    check_failed(solution, status.SINGULAR, 1, 1)
    assert not solution.phases[1].path.residual[1]


def test_a_cable_shortened_by_more_than_its_length():
    """0.5 m out of 0.4 m: fails at the increment where no length is left."""
    with pytest.warns(jc.InputWarning, match="the element has 0.4 m"):
        solution = jc.solve(STRUCTURE, [jc.Phase(shortening=0.5, increments=10)])
    check_failed(solution, status.NONFINITE, 0, 7)
    assert float(solution.last.load_factor) == pytest.approx(0.7)
    path = solution.phases[0].path
    np.testing.assert_array_equal(solution.last.displacement, path.displacement[6])


# --- gradients of failures


@traced
def derivatives_of_cases(stiffness, tensions, loads, counts):
    """Derivatives of two results of every case, and of a sum over the cases that count.

    The sum is computed from `last`, and selected by status.
    """

    def results(stiffness, tensions, loads):
        def one(tension, load):
            s = solve_flat_net(stiffness * np.ones(12), tension * np.ones(12), load)
            value = s.last.displacement[3, 2] ** 2 + s.last.tension[0] / 1e6
            return jnp.where(s.status == status.OK, value, 0.0), s

        values, solution = jax.vmap(one)(tensions, loads)
        return (jnp.sum(counts * values), solution.displacement[:, 3, 2]), solution

    return jax.jacrev(results, argnums=(0, 1, 2), has_aux=True)(stiffness, tensions, loads)


@pytest.mark.slow
def test_gradients_of_failed_cases_are_nan_and_of_others_right():
    tensions, loads = np.array([200.0, np.nan, 225.0, 250.0]), np.tile(LOAD, (4, 1))
    loads[2, 0] = np.nan  # fails in the second phase, case 1 in the first one
    (total, each), solution = derivatives_of_cases(97.97e3, tensions, loads, np.ones(4))
    assert solution.status.tolist() == [0, status.NONFINITE, status.NONFINITE, 0]
    assert np.isnan(np.asarray(solution.displacement)).all(axis=(1, 2)).tolist() == [
        *(False, True, True, False)
    ]
    with pytest.raises(jc.AnalysisError, match="case 1: phase 1, increment 1"):
        jc.raise_if_failed(solution)
    with pytest.raises(jc.AnalysisError, match=r"^snow: phase 1, increment 1"):
        jc.raise_if_failed(solution, ["calm", "snow", "wind", "ice"])
    by_stiffness, by_tension, by_load = each
    for k, fails in enumerate([False, True, True, False]):
        for gradient in (by_stiffness[k], by_tension[k, k], by_load[k, k]):
            assert np.isnan(gradient).all() == fails and np.isnan(gradient).any() == fails
    whole = np.array([200.0, 225.0, 225.0, 250.0]), np.tile(LOAD, (4, 1))
    (alone, one_by_one), _ = derivatives_of_cases(97.97e3, *whole, np.array([1.0, 0.0, 0.0, 1.0]))
    # a good case is not spoilt by its failed neighbours, nor is the sum
    assert np.isfinite(total[0]) and abs(total[0] / alone[0] - 1) < 1e-10
    good = np.array([0, 3])
    np.testing.assert_allclose(by_stiffness[good], one_by_one[0][good], rtol=1e-10)


@pytest.mark.slow
def test_the_last_state_keeps_its_whole_derivative():
    """With respect to what it depends on directly too: stiffness and nodes."""
    bad = jc.Phase(loads=jc.NodalLoads([3], (0, 0, np.nan)))
    load = jc.Phase(loads=jc.NodalLoads(FREE, (0, 0, -10.0)))

    @traced
    @functools.partial(jax.jacrev, has_aux=True)
    def both(structure):
        short = jc.solve(structure, [jc.Phase(pretension=200.0), load])
        failed = jc.solve(structure, [jc.Phase(pretension=200.0), load, bad])

        def value(s):
            return s.last.tension[3] + 1e4 * s.last.positions[3, 0] + s.last.reactions[0, 1]

        return jnp.stack([value(failed) - value(short), value(short)]), failed.status

    gradient, code = both(STRUCTURE)
    assert int(code) == status.NONFINITE
    # the two derivatives cancel: each is of order 1e4 for the nodes, 1e-3 for the stiffness
    difference, plain = jnp.abs(gradient.nodes).max(axis=(1, 2))
    assert difference < 1e-6 and plain > 1e3
    assert jnp.abs(gradient.elements.axial_stiffness[0]).max() < 1e-12


@pytest.mark.slow
def test_the_last_state_has_the_reactions_of_its_own_supports():
    """And an analysis that starts from its failed solution stays failed."""
    mask = np.asarray(STRUCTURE.fixed(STRUCTURE.supports)).copy()
    mask[0, 1:] = False
    prestress = jc.Phase(pretension=200.0)
    bad = jc.Phase(supports=jc.Supports(mask), loads=jc.NodalLoads([3], (0, 0, np.nan)))
    failed = jc.solve(STRUCTURE, [prestress, bad])
    check_failed(failed, status.NONFINITE, 1, 0)
    assert int(failed.last.phase) == 0 and float(failed.last.load_factor) == 1.0
    # in the plane a support takes the 200 N of its cable, and rounding of that
    expected = np.asarray(failed.last.reactions)
    assert np.linalg.norm(expected[0]) == pytest.approx(200.0, rel=1e-12)
    again = jc.solve(STRUCTURE, [prestress], start=failed)
    assert int(again.status) == status.NONFINITE and all_nan(again.displacement)


@pytest.mark.slow
def test_a_singular_matrix_on_the_way_does_not_spoil_the_gradient():
    """An empty phase of two unstressed links in line is singular; what follows is not."""

    def end(stiffness, loaded):
        structure, normal = two_links(stiffness, 0.0, 1.0)
        load = jc.Phase(loads=jc.NodalLoads([1], normal))
        solution = jc.solve(structure, [jc.Phase(), load][: 1 + loaded])
        return solution.displacement[1] @ normal, solution.status

    rate = jax.jit(jax.grad(end, has_aux=True), static_argnums=1)
    (singular, first), (slope, code) = rate(100.0, False), rate(100.0, True)
    assert int(first) == int(code) == status.OK and np.isnan(singular)
    high, low = (two_links_exact(100.0 + h, 0.0, 1.0)[0] for h in (1e-3, -1e-3))
    assert float(slope) == pytest.approx((high - low) / 2e-3, rel=1e-8)


def test_describe_knows_every_code_and_no_other():
    codes = list(status.NAMES)
    assert len({jc.describe(c) for c in codes}) == len(codes) == 30
    assert all(getattr(status, name) == code for code, name in status.NAMES.items())
    with pytest.raises(ValueError, match="code = 99"):
        jc.describe(99)


# --- little or no force


def test_bars_without_force_are_in_balance():
    """A tripod has no self-stress: shortened, warmed or strained it stands in its new place.

    What the rounding of EA leaves of its forces is then all that there is; it counts as balanced.
    By the shortening of its legs its top moves as ``l^2 = |top - foot|^2`` says.
    """
    structure = shapes.tripod(stiffness=2e7).structure
    legs = jc.replace(structure.elements, expansion=1e-5, rest_length=None)
    structure = jc.replace(structure, elements=legs)
    feet = np.asarray(structure.nodes)[1:]

    @traced
    @functools.partial(jax.jacfwd, has_aux=True)
    def top(shortening, temperature, prestrain):
        phase = jc.Phase(shortening=shortening, temperature=temperature, prestrain=prestrain)
        solution = jc.solve(structure, phase)
        return solution.positions[0], solution

    none = np.zeros(3)
    cases = {
        "nothing": (none, none, none),
        "shortening": (np.array([0.01, 0.0, 0.0]), none, none),
        "temperature": (none, np.array([40.0, 10.0, 0.0]), none),
        "prestrain": (none, none, np.full(3, -0.02)),
    }
    for name, case in cases.items():
        rate, solution = top(*case)
        assert int(solution.status) == status.OK, name
        ways = np.asarray(solution.positions[0]) - feet
        length = np.linalg.norm(ways, axis=1)
        assert length == pytest.approx(np.asarray(solution.rest_length), rel=1e-14)
        assert np.abs(solution.tension).max() < 1e-6  # eps EA, some times
        if name == "nothing":
            exact = np.linalg.solve(ways, -np.diag(length))
            assert np.asarray(rate) == pytest.approx(exact, abs=1e-12)


def test_two_nodes_that_meet_end_as_collapsed():
    """A jack draws a node onto its support: the text says what helps."""
    cable = jc.Cables([[0, 1]], axial_stiffness=1e4)
    structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], cable, jc.pinned([0]))
    phase = jc.Phase(jacking=0.9, loads=jc.NodalLoads([1], (0.5, 0, 0)))
    solution = jc.solve(structure, phase)
    check_failed(solution, status.COLLAPSED, 0, 0)
    assert "join the nodes" in jc.describe(solution.status)
    # with a load above the force of the jack it runs away instead
    away = jc.replace(phase, loads=jc.NodalLoads([1], (1.5, 0, 0)))
    away = jc.solve(structure, away, jc.Newton(max_steps=50))
    assert int(away.status) in (status.MECHANISM, status.NOT_CONVERGED)


@pytest.mark.slow
def test_forces_below_rounding_end_as_at_rounding():
    """A slack chain in float32: its forces are known above EA times the *square* of eps."""
    n = 8
    nodes = np.array([[k, 0.3 * np.sin(k), 0] for k in range(n + 1)])
    forces = np.random.default_rng(1).normal(size=(n - 1, 3))

    def analysed(dtype, stiffness):
        links = [[k, k + 1] for k in range(n)]
        cables = jc.Cables(links, axial_stiffness=dtype(stiffness), rest_length=dtype(1.3))
        structure = jc.Structure(nodes.astype(dtype), cables, jc.pinned([0, n]))
        loads = jc.NodalLoads(range(1, n), forces.astype(dtype))
        return jc.solve(structure, jc.Phase(loads=loads))

    single, double = (analysed(dtype, 1e9) for dtype in (np.float32, np.float64))
    assert int(single.status) == int(double.status) == status.OK
    # the rounding of displacements of 1 m alone is a force of EA eps = 100 N
    assert np.abs(single.tension - double.tension).max() < 1e-4
    hidden = analysed(np.float32, 1e15)
    assert int(hidden.status) == status.AT_ROUNDING and "float64" in jc.describe(hidden.status)
    assert int(analysed(np.float64, 1e15).status) == status.OK
    # residual and rounding are alike, and both are more than 1 % of the forces
    path = hidden.phases[0].path
    residual, relative, rounding = path.residual[0], path.relative_residual[0], path.rounding[0]
    assert rounding.dtype == np.float32
    assert residual <= 8 * rounding  # the status is told from NOT_CONVERGED by a factor of 8
    assert relative > 1e-2 and rounding > 1e-2 * residual / relative
    # by hand: 8 eps^2 EA/L0 times the largest move (8 x 1.3 m over 8 m), two links a node
    assert rounding < 2 * 8 * 2.0**-46 * 1e15 / 1.3 * 8.0
