"""Influence, objectives, load cases, distance to slackening, constraints: against NumPy."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable import design
from jaxcable.common import status

TIGHT = jc.Newton(tol=1e-13)
FREE = np.array([3, 4, 7, 8])
FLAT, (PRESTRESS, LOADING) = jc.scenes.flat_net(load=15.0, increments=(1, 1))
N = 12


@functools.cache
def loaded():
    solution = jc.solve(FLAT, [PRESTRESS, LOADING], TIGHT)
    jc.raise_if_failed(solution)
    return solution


@functools.cache
def matrix():
    return jc.influence(FLAT, [PRESTRESS, LOADING], method=TIGHT)


@jax.jit
def turned(shortening):
    """Tensions after turnbuckles are turned in the loaded net."""
    return jc.solve(FLAT, [PRESTRESS, LOADING, jc.Phase(shortening=shortening)], TIGHT).tension


@pytest.mark.slow
def test_influence_of_shortening():
    """Against central differences of 1 um (0.25 N): their error is of third order, and rounding."""
    h = 1e-6
    columns = [(turned(h * e) - turned(-h * e)) / (2 * h) for e in jnp.eye(N)]
    expected = jnp.stack(columns, axis=1)
    assert jnp.abs(matrix() - expected).max() < 1e-6 * jnp.abs(expected).max()


def test_influence_of_an_earlier_phase():
    """Elastic nets do not care in which phase a length changed."""
    before = jc.influence(FLAT, [PRESTRESS, LOADING], phase=0, method=TIGHT)
    assert jnp.abs(before - matrix()).max() < 1e-9 * jnp.abs(matrix()).max()


@pytest.mark.slow
def test_influence_of_load_is_reciprocal():
    """Maxwell: displacement at a by a force at b is that at b by a force at a; both modes agree."""
    phases = [PRESTRESS, LOADING]
    flexibility = jc.influence(FLAT, phases, "displacement", "load", method=TIGHT)
    square = flexibility.reshape(3 * N, 3 * N)
    assert jnp.abs(square - square.T).max() < 1e-12 * jnp.abs(square).max()
    one = jc.influence(  # one number of many: reverse mode
        FLAT, phases, lambda s: s.displacement[3, 2], "load", method=TIGHT
    )
    assert jnp.abs(one - flexibility[3, 2]).max() < 1e-12 * jnp.abs(one).max()
    # Betti: shortening j by d strains it by (1 + e_j) d at fixed nodes; the rest is symmetric
    matrix_, length = matrix(), loaded().rest_length
    symmetric = matrix_ / (1 + loaded().tension / 97.97e3)[None, :]
    assert jnp.abs(symmetric - symmetric.T).max() < 1e-12 * jnp.abs(symmetric).max()
    assert (jnp.diagonal(symmetric) < 97.97e3 / length).all()


LINKS = np.asarray(FLAT.elements.links)
GROUPS = {
    "x": jc.Cables(LINKS[:6], axial_stiffness=97.97e3, expansion=1.2e-5),
    "y": jc.Bars(LINKS[6:], axial_stiffness=97.97e3),
}
IN_GROUPS = jc.replace(FLAT, elements=GROUPS)
STATED = jc.Phase(pretension={"x": 200.0, "y": None}, prestrain={"x": None, "y": 2e-3})


@pytest.mark.slow
def test_influence_of_several_groups():
    matrix = jc.influence(IN_GROUPS, [STATED, LOADING])
    assert matrix["x"]["y"].shape == (6, 6)
    whole = design.flat_matrix(matrix, {"x": jnp.zeros(6), "y": jnp.zeros(6)})
    tension = jc.solve(IN_GROUPS, [STATED, LOADING]).tension
    strain = jnp.concatenate([tension["x"], tension["y"]]) / 97.97e3
    symmetric = whole / (1 + strain)[None, :]  # Betti, as above
    assert jnp.abs(symmetric - symmetric.T).max() < 1e-9 * jnp.abs(whole).max()
    turns = design.adjustment(matrix, {"x": jnp.ones(6), "y": jnp.ones(6)})
    got = whole @ jnp.concatenate([turns["x"], turns["y"]])
    assert jnp.abs(got - 1).max() < 1e-6


@pytest.mark.slow
def test_influence_of_heat_and_of_part_of_the_groups():
    by_length = jc.influence(IN_GROUPS, [STATED, LOADING])
    by_heat = jc.influence(IN_GROUPS, [STATED, LOADING], wrt="temperature")
    assert by_heat["y"]["y"] is None
    # a kelvin is a lengthening by expansion times unstressed length
    length = jc.solve(IN_GROUPS, [STATED, LOADING]).rest_length["x"]
    expected = -1.2e-5 * by_length["y"]["x"] * length[None, :]
    assert jnp.abs(by_heat["y"]["x"] - expected).max() < 1e-8 * jnp.abs(expected).max()
    by_force = jc.influence(IN_GROUPS, [STATED, LOADING], wrt="pretension")
    assert by_force["x"]["y"] is None and by_force["y"]["x"].shape == (6, 6)
    by_strain = jc.influence(IN_GROUPS, [STATED, LOADING], "reactions", "prestrain")
    assert by_strain["x"] is None and by_strain["y"].shape == (N, 3, 6)


def test_influence_refuses():
    for arguments, text in (
        ({"of": "stress"}, "of = 'stress'"),
        ({"wrt": "colour"}, "wrt = 'colour'"),
        ({"wrt": "jacking"}, "wrt = 'jacking': no phase states a jacking"),
        ({"wrt": "pretension", "phase": 1}, "phase 1 does not state a pretension"),
        ({"wrt": "temperature"}, "wrt = 'temperature': no group"),
        ({"phase": 2}, "phase = 2: there are phases 0 to 1"),
    ):
        with pytest.raises(ValueError, match=text):
            jc.influence(FLAT, [PRESTRESS, LOADING], **arguments)
    with pytest.raises(ValueError, match="phases: none, and no start"):
        jc.influence(FLAT, [])
    with pytest.raises(ValueError, match="tolerance: expected arrays"):
        design.scatter(matrix(), 1e-5)
    with pytest.raises(ValueError, match="change: has 3 numbers"):
        design.adjustment(matrix(), jnp.zeros(3), like=jnp.zeros(N))
    failed = jc.influence(FLAT, [PRESTRESS, LOADING], method=jc.Newton(tol=1e-13, max_steps=1))
    assert jnp.isnan(failed).all()


def test_retensioning_converges_quickly():
    """Wrong lengths are undone, with a matrix that is never renewed: linear, but fast."""
    wrong = 1e-4 * np.random.default_rng(0).normal(size=N)
    target, turns, off = loaded().tension, jnp.zeros(N), []
    for _ in range(5):
        tension = turned(turns - wrong)
        off.append(float(jnp.abs(tension / target - 1).max()))
        turns = turns + design.adjustment(matrix(), target - tension)
    assert off[0] > 0.05 and off[2] < 1e-3 and off[4] < 1e-6
    # singular values of the matrix reach down to 1e-3 of its largest one
    assert jnp.abs(turns - wrong).max() < 1e-8


def test_scatter_of_tolerances():
    """Random errors of 10 um: 2000 analyses against first order; their mean square within 10 %.

    (The relative error of a standard deviation from 2000 draws is 1.6 %; curvature adds to it.)
    """
    worst, random = design.scatter(matrix(), 1e-5 * jnp.ones(N))
    assert jnp.abs(worst - 1e-5 * np.abs(matrix()).sum(1)).max() < 1e-12
    draws = 1e-5 * np.random.default_rng(1).normal(size=(2000, N))
    found = jax.vmap(turned)(jnp.asarray(draws)) - loaded().tension[None, :]
    assert np.abs(np.std(np.asarray(found), axis=0) / random - 1).max() < 0.1
    signs = jnp.sign(matrix()[0])
    extreme = turned(1e-5 * signs)[0] - loaded().tension[0]
    assert abs(float(extreme / worst[0]) - 1) < 0.05


CASES = np.random.default_rng(2).normal(size=(3, 4, 3)) * [5, 5, 20]


@functools.cache
def cases():
    return design.solve_cases(
        FLAT, [PRESTRESS], [jc.Phase(loads=jc.NodalLoads(FREE, f)) for f in CASES], TIGHT
    )


@pytest.mark.slow
def test_load_cases_and_envelope():
    solutions = cases()
    assert solutions.status.tolist() == [0, 0, 0]
    for k, force in enumerate(CASES):
        alone = jc.solve(FLAT, [PRESTRESS, jc.Phase(loads=jc.NodalLoads(FREE, force))], TIGHT)
        assert jnp.abs(solutions.tension[k] - alone.tension).max() < 1e-8
    tension = np.asarray(solutions.tension)
    found = design.envelope(solutions.tension)
    assert (found.lowest == tension.min(0)).all() and (found.highest == tension.max(0)).all()
    assert (found.highest_case == tension.argmax(0)).all()
    with pytest.raises(ValueError, match=r"cases\[1\]: differs from cases\[0\]"):
        loads = [jc.NodalLoads(FREE, CASES[0]), jc.NodalLoads(FREE[:2], CASES[1, :2])]
        design.solve_cases(FLAT, [PRESTRESS], [jc.Phase(loads=load) for load in loads])
    with pytest.raises(ValueError, match="cases: expected at least one"):
        design.solve_cases(FLAT, [PRESTRESS], [])


def test_utilisation():
    strong = jc.replace(FLAT, elements=jc.replace(FLAT.elements, strength=1000.0))
    tension = cases().tension
    assert jnp.abs(design.utilisation(strong, tension) - tension / 1000).max() < 1e-15
    with pytest.raises(ValueError, match="strength: no group has one"):
        design.utilisation(FLAT, tension)
    law = jc.Polygonal([-0.01, 0.0, 0.02], [-100e6, 0.0, 400e6])
    groups = [jc.Bars(LINKS[:6], area=1e-6, law=law), jc.Cables(LINKS[6:], axial_stiffness=1e5)]
    mixed = jc.replace(FLAT, elements=groups)
    used, unknown = design.utilisation(mixed, [jnp.array([200.0, -50.0] * 3), jnp.zeros(6)])
    assert unknown is None and np.allclose(used[:2], [0.5, 0.5], rtol=1e-12)
    with pytest.raises(ValueError, match="tension: has 1 arrays"):
        design.utilisation(mixed, jnp.zeros(6))


def test_objectives():
    solution, batch = loaded(), cases()
    positions, tension = np.asarray(solution.positions), np.asarray(solution.tension)
    target = np.asarray(FLAT.nodes)
    gap = ((positions - target) ** 2).sum()
    assert abs(float(design.shape_distance(solution, target)) - gap) < 1e-15
    assert abs(float(design.shape_distance(solution, target[FREE], FREE)) - gap) < 1e-15
    spread = tension.var() / tension.mean() ** 2
    assert abs(float(design.tension_spread(solution)) - spread) < 1e-12
    far = float(design.tension_distance(solution, 200.0))
    assert abs(far / ((tension - 200) ** 2).sum() - 1) < 1e-12
    assert abs(float(design.total_prestress(solution)) - 12 * 200) < 1e-6
    volume = (tension * np.asarray(solution.rest_length)).sum() / 1e9
    assert abs(float(design.material_use(solution, 1e9)) / volume - 1) < 1e-12
    largest = np.asarray(batch.tension).max(0) * np.asarray(batch.rest_length)[0]
    assert abs(float(design.material_use(batch, 1e9)) / (largest.sum() / 1e9) - 1) < 1e-9

    gaps = np.asarray(batch.positions) - target
    assert abs(float(design.shape_distance(batch, target)) / (gaps**2).sum() - 1) < 1e-12
    gaps = np.asarray(batch.tension) - tension
    assert abs(float(design.tension_distance(batch, tension)) / (gaps**2).sum() - 1) < 1e-12

    moved = np.linalg.norm(np.asarray(batch.phases[-1].displacement), axis=-1)
    for width in (1e-3, 1e-4):
        bound = float(design.largest_deflection(batch, width))
        top = np.sqrt(moved.max() ** 2 + width**2 * np.log(moved.size))
        assert moved.max() <= bound <= top * (1 + 1e-12)
    assert float(design.smooth_max(batch.tension, 5.0)) >= float(batch.tension.max())
    assert float(design.smooth_min(batch.tension, 5.0)) <= float(batch.tension.min())
    mean = design.mean_over_cases(batch.tension)
    assert jnp.abs(mean - np.asarray(batch.tension).mean(0)).max() < 1e-9


@pytest.mark.slow
def test_distance_to_slackening():
    """From lengths alone, on a net with slack cables; the step to the next kink by bisection."""
    structure, _ = jc.scenes.saddle(3, 3, axial_stiffness=1e6, pretension=50.0)
    links = np.asarray(structure.elements.links)
    n = len(links)

    def run(tension):
        load = jc.NodalLoads(np.arange(structure.n_node), (0, 0, -2000.0))
        return jc.solve(structure, [jc.Phase(pretension=tension), jc.Phase(loads=load)], TIGHT)

    run = jax.jit(run)
    p = 50.0 + jnp.arange(n)
    solution = run(p)
    assert int(solution.status) == 0
    distance = design.slack_distance(structure, solution)
    ends = np.asarray(solution.positions)[links]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    expected = length / np.asarray(solution.rest_length) - 1
    assert np.abs(np.asarray(distance) - expected).max() < 1e-14  # rounding of the lengths
    slack = np.asarray(solution.tension) == 0
    assert slack.any() and ((np.asarray(distance) < 0) == slack).all()
    margin = float(design.slack_margin(structure, solution, 1e-6))
    assert float(distance.min()) - 1e-6 * np.log(n) - 1e-15 <= margin <= float(distance.min())

    # up: a cable cannot be told to push
    direction = jnp.asarray(np.abs(np.random.default_rng(0).normal(size=n)))
    steps = design.nearest_kink(lambda p: design.slack_distance(structure, run(p)), p, direction)
    k = int(jnp.argmin(steps))
    low, high = 0.0, 2 * float(steps[k])
    assert slack[k] != (float(run(p + high * direction).tension[k]) == 0)
    for _ in range(20):
        middle = 0.5 * (low + high)
        same = (float(run(p + middle * direction).tension[k]) == 0) == slack[k]
        low, high = (middle, high) if same else (low, middle)
    assert abs(low / float(steps[k]) - 1) < 0.05  # first order over a short way

    known = design.nearest_kink(
        lambda x: x,
        jnp.array([0.0, 0.0, 2.0, -1.0, jnp.nan]),
        jnp.array([-1.0, 1.0, -4.0, -1.0, 1]),
    )
    assert known[0] == 0 and known[2] == 0.5 and jnp.isinf(known[jnp.array([1, 3])]).all()
    assert jnp.isnan(known[4])
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), solution)
    for both in (batch, batch.last):
        assert (design.slack_distance(structure, both)[1] == distance).all()
    failed = jc.solve(structure, [jc.Phase(pretension=p)], jc.Newton(max_steps=1, tol=1e-16))
    assert int(failed.status) != 0
    assert jnp.isnan(design.slack_distance(structure, failed)).all()
    assert jnp.isfinite(design.slack_distance(structure, failed.last)).all()


def test_constraints_closed_form():
    """Lowest point of a plane on a disc, with its multiplier; and one that nothing satisfies."""

    def problem(p, radius):
        return p[0] + 2 * p[1], jnp.array([(p @ p) / radius**2 - 1, p[0] - 10.0])

    found = design.minimize_subject_to(problem, jnp.array([0.3, 0.1]), args=(2.0,))
    assert int(found.status) == 0
    expected = -2 * np.array([1.0, 2.0]) / np.sqrt(5)
    assert np.abs(np.asarray(found.params) - expected).max() < 1e-4
    assert (np.asarray(found.constraints) <= 0).all() and found.constraints[0] > -3e-6
    # f = -sqrt(5) r; relaxing c by 1 of (r^2) is dr = r / 2
    assert np.abs(found.multipliers - [np.sqrt(5), 0.0]).max() < 1e-4

    # a loss that is zero, and flat, where it starts
    nearest = design.minimize_subject_to(lambda p: (p @ p, 1 - p[:1]), jnp.zeros(2))
    assert int(nearest.status) == 0
    assert np.abs(np.asarray(nearest.params) - [1, 0]).max() < 1e-5
    assert abs(float(nearest.multipliers[0]) - 2) < 1e-4

    def contradiction(p):
        return p[0] ** 2, jnp.array([1 - p[0], p[0] + 1])

    never = design.minimize_subject_to(contradiction, jnp.array([0.3]), rounds=8)
    assert int(never.status) == status.CONSTRAINTS_VIOLATED and float(never.constraints.max()) > 0.5
    bad = design.minimize_subject_to(lambda p: (jnp.log(p[0]), -p), jnp.array([-1.0]))
    assert int(bad.status) == status.BAD_START
    with pytest.raises(ValueError, match="problem: expected"):
        design.minimize_subject_to(lambda p: p[0], jnp.array([1.0]))
    with pytest.raises(ValueError, match="loss: expected a scalar float"):
        design.minimize_subject_to(lambda p: (p, -p), jnp.array([1.0]))
    with pytest.raises(ValueError, match=r"constraints: expected floats \[n\]"):
        design.minimize_subject_to(lambda p: (p[0], p[0]), jnp.array([1.0]))


@pytest.mark.slow
def test_gradient_of_a_loss_in_a_batch_of_optimizations():
    """Taylor test of the gradients that `minimize` reports, in a batch, with slack cables.

    Two starts at once; the loss takes three load cases from one prestressed state.
    """
    structure, _ = jc.scenes.saddle(3, 3, axial_stiffness=1e6, pretension=50.0)
    n, every = len(structure.elements.links), np.arange(structure.n_node)
    forces = (-2000.0, -1500.0, 800.0)
    loads = [jc.Phase(loads=jc.NodalLoads(every, (0, 0, f))) for f in forces]

    def loss(tension):
        solutions = design.solve_cases(structure, [jc.Phase(pretension=tension)], loads, TIGHT)
        return design.largest_deflection(solutions, 0.02) * 1e3, solutions

    starts = jnp.stack([50.0 + jnp.arange(n), 80.0 - jnp.arange(n)])
    # away from zero: the steps of the Taylor test, 1.5 N at most, must not make a cable push
    designs = jax.jit(jax.vmap(lambda p: jc.minimize(loss, p, (5.0, None), steps=2)))(starts)
    assert (designs.status == status.OUT_OF_STEPS).all() and (designs.failures == 0).all()
    value = jax.jit(loss)
    for k in range(2):
        p, gradient = designs.params[k], designs.gradient[k]
        start, solutions = value(p)
        assert (solutions.status == 0).all() and (solutions.tension == 0).any()
        assert abs(float(start) - float(designs.loss[k])) < 1e-9 * float(start)
        direction = jnp.asarray(np.random.default_rng(k).normal(size=n))
        steps = 0.5 * 0.6 ** np.arange(4)

        def slope(gradient, p=p, start=start, direction=direction, steps=steps):
            rest = [
                abs(float(value(p + h * direction)[0] - start - h * (gradient @ direction)))
                for h in steps
            ]
            return np.polyfit(np.log(steps), np.log(rest), 1)[0]

        assert abs(slope(gradient) - 2) < 0.1
        wrong = gradient.at[0].add(1e-2 * jnp.abs(gradient).max())
        assert slope(wrong) < 1.5
