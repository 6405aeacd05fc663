"""Hanging cables that slide with friction: histories, saddles, limits, jacks, derivatives."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.catenary_chain import catenary, ratios_and_bounds, step
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient, value_and_gradient
from scipy.optimize import brentq

import jaxcable as jc
from jaxcable.analysis.preparation import prepare

EA, WEIGHT = 2e7, 40.0
SPANS = np.array([[0.0, 0, 0], [140.0, 0, 12.0], [300.0, 15.0, 20.0], [390.0, 0, 2.0]])
OWN = jc.SelfWeight()


def line(friction, nodes=SPANS, longer=1.004, kind=jc.SlidingCatenaries, **more):
    """A cable over all `nodes`, `longer` than its chords; with a mast that moves."""
    n = len(nodes)
    chord = np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum()
    numbers = {"axial_stiffness": EA, "weight": WEIGHT, "rest_length": longer * chord} | more
    given = {} if friction is None else {"friction": friction}
    cable = kind(links=[range(n)], **given, **numbers)
    # `solve` needs a node that moves
    nodes = np.vstack([nodes, nodes[-1:] + np.array([0.0, 0.0, 1.0])])
    groups = {"line": cable, "mast": jc.Bars([[n - 1, n]], axial_stiffness=1e9)}
    return jc.Structure(nodes, groups, jc.pinned(range(n)) + jc.restrained([n], "xy"))


def of_segments(state, name="end_tensions"):
    return np.asarray(state.element_results[name]["line"][0])


def lengths_before(structure, rest):
    """Unstressed lengths before the first slip: shares of the chords, [n], m."""
    length = np.linalg.norm(np.diff(structure.nodes[:4], axis=0), axis=1)
    return rest * length / length.sum()


def saddled(friction, kind=jc.SlidingCatenaries, clamped=None, **more):
    """The cable over two saddles on springs; a load on one side of the first, and its removal."""
    chord = np.linalg.norm(np.diff(SPANS, axis=0), axis=1).sum()
    numbers = {"axial_stiffness": EA, "weight": WEIGHT, "rest_length": 1.004 * chord} | more
    given = {} if friction is None else {"friction": friction}
    cable = kind(links=[[0, 1, 2, 3]], **given, **numbers)
    groups = {"line": cable, "saddles": jc.Springs([1, 2], SPRINGS)}
    structure = jc.Structure(SPANS, groups, jc.pinned([0, 3]))
    held = None if clamped is None else {"line": clamped}
    loads = [jc.NodalLoads([2], sign * ONE_SIDED) for sign in (1, -1)]
    return structure, [jc.Phase(loads=OWN, clamped=held), *(jc.Phase(loads=load) for load in loads)]


SPRINGS = np.array([[2e5, 2e5, 1e6], [4e3, 4e3, 1e5]])  # N/m
ONE_SIDED = np.array([9e3, 2e3, -6e3])  # N


def moves(node, *ways):
    return [jc.Phase(loads=jc.SupportMovement([node], way)) for way in ways]


HISTORIES = {
    "an end": ([0.1, 0.25], 0, (-0.9, 0.0, 0.2), (0.5, 0.0, 0.0), (1.2, 0.3, 0.0)),
    "a saddle": ([0.05, 0.15], 1, (0.6, 0.0, 1.0), (-1.4, 0.2, 0.0), (0.8, 0.0, -0.5)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", HISTORIES)
def test_histories(name):
    """Nodes that are moved and moved back: tensions and slips of the oracle, step by step."""
    friction, node, *ways = HISTORIES[name]
    structure = line([friction])
    phases = [jc.Phase(loads=OWN), *moves(node, *ways)]
    solution = converged(jc.solve(structure, phases))
    lengths = lengths_before(structure, float(structure.elements["line"].rest_length[0]))
    slid, signs = np.zeros(2), []
    for phase in solution.phases:
        places = np.asarray(phase.positions)[:-1]
        [(slips, lengths, tensions, _)] = step(places, lengths, WEIGHT, EA, friction)
        slid = slid + slips
        # both are exact to some 1e-13; the issue asks for this
        assert_allclose(of_segments(phase), tensions.astype(float), rtol=1e-10)
        assert_allclose(of_segments(phase, "slip"), slid.astype(float), atol=1e-9)
        assert_allclose(of_segments(phase, "segment_length"), lengths.astype(float), rtol=1e-12)
        signs.append(np.sign(np.where(np.abs(slips) > 1e-9, slips, 0.0)))
    assert {-1, 0, 1} == set(np.concatenate(signs))  # forth, back, and not at all


@pytest.mark.slow
def test_saddle_on_springs():
    """Where the nodes end, the oracle has the same tensions, which balance springs and loads."""
    friction = [0.12, 0.06]
    structure, phases = saddled([friction])
    solution = converged(jc.solve(structure, phases, jc.Newton(tol=1e-13)))
    lengths = lengths_before(structure, float(structure.elements["line"].rest_length[0]))
    slid = []
    for phase, load in zip(solution.phases, (0.0, 1.0, 0.0), strict=True):
        places = np.asarray(phase.positions)
        [(slips, lengths, tensions, vectors)] = step(places, lengths, WEIGHT, EA, friction)
        assert_allclose(of_segments(phase), tensions.astype(float), rtol=1e-8)
        held = SPRINGS * (places - SPANS)[1:3]
        left = vectors[1:, 0] - vectors[:-1, 1] - held
        left[1] += load * ONE_SIDED
        assert np.abs(left).max() < 1e-8 * tensions.max()  # tol is 1e-13 of a node's forces
        slid.append(slips)
    # the first saddle sticks under load, the second one slips towards its load and back
    assert slid[1][0] == 0 and slid[1][1] < -1 and slid[2][1] > 1


@pytest.mark.slow
def test_without_friction_clamped_and_weightless():
    """mu = 0 is one tension at a saddle; clamps are separate catenaries; no weight, straight."""
    free, none = (converged(jc.solve(*saddled(mu))) for mu in (None, 0.0))
    for one, other in zip(free.phases, none.phases, strict=True):
        both = of_segments(one)
        assert_allclose(both[1:, 0], both[:-1, 1], rtol=1e-12)
        assert_allclose(one.displacement, other.displacement, atol=1e-11)
    held = [
        converged(jc.solve(*saddled(*given)))
        for given in ((1e3,), (0.1, jc.SlidingCatenaries, 1.0))
    ]
    assert_allclose(held[0].displacement, held[1].displacement, atol=1e-11)
    structure, phases = saddled(0.1)
    rest = lengths_before(structure, float(structure.elements["line"].rest_length[0]))
    apart = jc.Catenaries(
        [[0, 1], [1, 2], [2, 3]], axial_stiffness=EA, weight=WEIGHT, rest_length=rest
    )
    groups = {"line": apart, "saddles": structure.elements["saddles"]}
    phases = [jc.replace(phase, clamped=None) for phase in phases]
    separate = converged(jc.solve(jc.replace(structure, elements=groups), phases))
    assert_allclose(held[0].displacement, separate.displacement, atol=1e-9)
    light = [
        converged(jc.solve(*saddled(0.1, kind, weight=1e-7, rest_length=0.999 * 393.0)))
        for kind in (jc.SlidingCatenaries, jc.FrictionCables)
    ]
    for one, other in zip(*(solution.phases for solution in light), strict=True):
        assert_allclose(one.displacement, other.displacement, atol=1e-9)
        assert_allclose(*(of_segments(x, "segment_tension") for x in (one, other)), rtol=1e-9)
    used = [of_segments(phase, "friction_used") for phase in light[0].phases]
    assert np.sign(used[1]).tolist() == (-np.sign(used[2])).tolist() == [1, -1]  # all slip


def two_cables(kind):
    """A function of numbers: results of two cables of three and two spans, over one saddle."""
    nodes = np.array([[0.0, 0, 0], [30.0, 0, 6], [70.0, 4, 8], [95.0, 0, 2], [30.0, 30, 0]])
    links = [[0, 1, 2, 3], [4, 1, 0]]
    ways = [np.linalg.norm(np.diff(nodes[way], axis=0), axis=1).sum() for way in links]

    def numbers(p):
        cables = kind(
            links=links,
            axial_stiffness=p["EA"],
            weight=30.0,
            rest_length=p["rest"] * jnp.array(ways),
            friction=p["mu"][:, None] * jnp.array([[1.0, 1.2]]),
        )
        groups = {"line": cables, "saddles": jc.Springs([1, 2], [[1e5, 2e5, 4e5], [1e4, 1e4, 2e5]])}
        structure = jc.Structure(nodes, groups, jc.pinned([0, 3, 4]))
        loads = [jc.NodalLoads([2], part * p["load"]) for part in (1.0, -1.5)]
        phases = [jc.Phase(loads=OWN), *(jc.Phase(loads=load) for load in loads)]
        solution = jc.solve(structure, phases, TIGHT)
        tension = solution.element_results["segment_tension"]["line"]
        used = solution.element_results["friction_used"]["line"]
        value = 1e2 * solution.displacement[2, 2] + 1e-3 * jnp.sum(tension)
        return value + solution.displacement[1, 1], solution.status, used

    return numbers


AT = {"mu": [0.05, 0.3], "EA": 2e7, "rest": [0.9996, 0.9993], "load": [4e3, 5e2, -5e3]}
KINDS = jc.FrictionCables, jc.SlidingCatenaries


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives(kind):
    """By friction, stiffness, lengths and load, of a group with a filler; batches, compiled."""
    function = two_cables(kind)
    point = {name: jnp.array(value) for name, value in AT.items()}
    # strains are some 1e-3: steps of lengths must be small beside them
    assert_gradient(function, point, {"rest": 0.03})
    program = value_and_gradient(function)  # the same one
    (value, (_, used)), _ = program(point)
    used = np.abs(used)
    assert used[0, 1] > 1 - 1e-9 and 0 < used[1, 0] < 0.99 and used[1, 1] == 0  # the filler
    other = jnp.array([0.9994, 0.9995])
    values = [value, program({**point, "rest": other})[0][0]]
    lengths = jnp.stack([point["rest"], other])
    batch = jax.jit(jax.vmap(lambda rest: function({**point, "rest": rest})[0]))(lengths)
    assert_allclose(batch, values, rtol=1e-10)


def lengths_at_tensions(places, tensions):
    """Unstressed lengths of catenaries with these tensions at their first ends, [n], m."""
    chord = np.diff(places, axis=0)
    across = np.hypot(chord[:, 0], chord[:, 1])

    def length(across, up, tension):
        def missed(length):
            return float(catenary(across, up, WEIGHT, EA, length)[0][0]) - tension

        way = np.hypot(across, up)
        return brentq(missed, 0.995 * way, 1.02 * way, xtol=1e-13, rtol=1e-15)

    return np.array([length(*one) for one in zip(across, chord[:, 2], tensions, strict=True)])


@pytest.mark.slow
def test_jack_lock_off_draw_in_and_heat():
    """Losses along the line by the angles of its tangents; the anchor gives way; 30 K more."""
    friction = [0.2, 0.1]
    structure = line([friction], expansion=1.2e-5)
    only = {"jacking": 3e4}, {}, {"shortening": -0.1}, {"temperature": 30.0}
    given = [{name: {"line": x, "mast": None} for name, x in one.items()} for one in only]
    first = {"loads": OWN, "increments": 2}
    phases = [jc.Phase(**one, **(first if k == 0 else {})) for k, one in enumerate(given)]
    solution = converged(jc.solve(structure, phases))
    jacked, locked, drawn, warm = (of_segments(phase) for phase in solution.phases)
    assert_allclose(jacked, locked, rtol=1e-12)
    assert jacked[0, 0] == pytest.approx(3e4, rel=1e-13)
    lengths = lengths_at_tensions(SPANS, locked[:, 0])
    [(slips, _, tensions, vectors)] = step(SPANS, lengths, WEIGHT, EA, friction)
    # EA/T = 700 times the rounding of lengths in brentq, 1e-15
    assert_allclose(locked, tensions.astype(float), rtol=1e-11)
    ratios, bounds = ratios_and_bounds(vectors, friction)
    assert_allclose(ratios.astype(float), -bounds.astype(float), rtol=1e-9)
    rest = float(solution.phases[1].rest_length["line"][0])
    assert rest == pytest.approx(lengths.sum(), rel=1e-13)
    [(slips, lengths, tensions, _)] = step(
        SPANS, lengths + np.array([0.1, 0, 0]), WEIGHT, EA, friction
    )
    assert_allclose(drawn, tensions.astype(float), rtol=1e-10)
    assert slips[0] > 0 == slips[1]  # it reaches the first saddle only
    grown = 1 + 30 * 1.2e-5
    [(_, _, tensions, _)] = step(SPANS, grown * lengths, WEIGHT / grown, EA, friction)
    assert_allclose(warm, tensions.astype(float), rtol=1e-10)


@pytest.mark.slow
def test_added_and_removed():
    """A line that a phase adds has the shares of the chords there; then it is taken away."""
    structure, _ = saddled(0.1)
    load = jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -5e4)), removes="line")
    added = jc.Phase(adds="line", loads=OWN, placed="attached")
    solution = converged(jc.solve(structure, [load, added, jc.Phase(removes="line")]))
    before, during, after = (np.asarray(phase.positions) for phase in solution.phases)
    rest = float(solution.phases[1].rest_length["line"][0])
    chord = np.linalg.norm(np.diff(before, axis=0), axis=1)
    lengths = rest * chord / chord.sum()
    [(slips, _, tensions, _)] = step(during, lengths, WEIGHT, EA, [0.1, 0.1])
    assert_allclose(of_segments(solution.phases[1]), tensions.astype(float), rtol=1e-8)
    assert np.abs(slips).max() > 0.01
    assert_allclose(after, before, atol=1e-9)


@pytest.mark.slow
def test_single_precision():
    """In float32, as far as its digits go: EA/T = 1200 times its rounding of lengths, 6e-8."""
    structure, phases = saddled(0.1)
    exact = converged(jc.solve(structure, phases))
    single = jax.tree.map(lambda x: np.asarray(x, np.float32), (structure, phases))
    solution = converged(jc.solve(*single))
    assert solution.displacement.dtype == np.float32
    assert_allclose(of_segments(solution), of_segments(exact), rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [1e-4, 2e-3, 0.02, 5.0])
def test_deep_segments_slip_without_end(friction):
    """A sag of half a span: where the line sticks it is in equilibrium; where it would slip, none.

    The tension of a deep span rises with its length: what slips towards it makes it pull more.
    """
    nodes = np.array([[0.0, 0, 0], [100.0, 0, 0], [200.0, 0, 0]])
    structure = line(friction, nodes, 1.56)
    phases = [jc.Phase(loads=OWN), *moves(0, (-3.0, 0.0, 0.0))]
    first, second = 0.5 * float(structure.elements["line"].rest_length[0]) * np.ones(2)
    left, right = (
        catenary(across, 0.0, WEIGHT, EA, length)
        for across, length in ((103.0, first), (100.0, second))
    )
    assert left[1] > 0.5 * 103 and left[0][1] > right[0][0]
    shapes = np.float64([left[0], right[0]])
    solution = jc.solve(structure, phases)
    # at the saddle the tangents turn by 2.6 rad, and the tensions differ by 0.9 %
    if friction < 3e-3:
        assert int(solution.status) != jc.status.OK
        assert np.isnan(of_segments(solution)).all()
    else:
        converged(solution)
        assert_allclose(of_segments(solution), shapes, rtol=1e-10)
        assert np.abs(of_segments(solution, "slip")).max() == 0
        assert_allclose(of_segments(solution, "segment_sag"), np.float64([left[1], right[1]]))


def jacked_from_the_straight_line(increments):
    """A cable over a pulley, as drawn, and the phase that jacks it."""
    nodes = [[0.0, 0, 0], [300, 0, 10], [700, 0, 0]]
    line = jc.SlidingCatenaries(links=[[0, 1, 2]], axial_stiffness=33e6, weight=16.0, friction=0.05)
    structure = jc.Structure(nodes, {"line": line}, jc.pinned(range(3)))
    return structure, jc.Phase(jacking=28e3, loads=jc.SelfWeight(), increments=increments)


@pytest.mark.parametrize("increments", [1, 2])
def test_a_jack_that_pays_a_cable_out_is_warned_of(increments):
    """Before anything is solved, and once."""
    structure, jacked = jacked_from_the_straight_line(increments)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        prepare(structure, [jacked], None, None)
    said = [str(one.message) for one in found]
    assert [("paid out" in text) for text in said] == [True] * (increments == 1)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*paid out:jaxcable.InputWarning")  # a test above is of it
@pytest.mark.parametrize("increments", [1, 2])
def test_in_one_increment_the_tension_grows_away_from_the_jack(increments):
    solution = converged(jc.solve(*jacked_from_the_straight_line(increments)))
    used = float(solution.element_results["friction_used"]["line"][0, 0])
    assert used == pytest.approx(1.0 if increments == 1 else -1.0)  # against the slip
