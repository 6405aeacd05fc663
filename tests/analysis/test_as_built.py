"""Prestress stated as built: tensions and sags that hold in equilibrium, under the loads."""

import re
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged
from oracles.traced import traced
from scipy.optimize import brentq, fsolve

import jaxcable as jc
from tests.oracles import elastic_cable, taylor

SPAN, WEIGHT = 100.0, 10.0  # m, N/m
DOWN = np.array([0.0, 0.0, -1.0])
WIND, ICE = np.array([1.0, 6.0, 0.0]), np.array([0.0, 0.0, -4.0])  # N/m

# rise over span, input, its value in units of w l (N) or l (m), EA in units of w l
CASES = [
    (0.0, "end_tension", 12.0, 5e3),
    (1.0, "end_tension", 6.0, 5e3),
    (-1.0, "end_tension", 2.0, 5e3),
    (0.3, "end_tension", 1.8, 50.0),
    (0.0, "end_tension", 500.0, 1e6),
    (0.0, "horizontal_tension", 12.0, 5e3),
    (1.0, "horizontal_tension", 3.0, 5e3),
    (-0.5, "horizontal_tension", 0.4, 5e3),
    (0.0, "horizontal_tension", 500.0, 1e6),
    (0.0, "built_sag", 0.01, 5e3),
    (0.0, "built_sag", 0.3, 5e3),
    (1.0, "built_sag", 0.05, 5e3),
    (-0.5, "built_sag", 0.3, 50.0),
]


def spans():
    """Spans between fixed ends, each turned in plan; the phase that states all `CASES`."""
    n = len(CASES)
    turn = np.linspace(0.0, 5.0, n)
    nodes = np.zeros((n, 2, 3))
    nodes[:, :, 0] += 300.0 * np.arange(n)[:, None]
    nodes[:, 1] += SPAN * np.stack([np.cos(turn), np.sin(turn), [c[0] for c in CASES]], 1)
    stiffness = np.array([c[3] for c in CASES]) * WEIGHT * SPAN
    links = np.arange(2 * n).reshape(n, 2)
    cables = jc.Catenaries(links, axial_stiffness=stiffness, weight=WEIGHT)
    return jc.Structure(nodes.reshape(-1, 3), cables, jc.pinned(range(2 * n)))


def size_of(case, loads):
    """What is stated of a case, N or m; under wind all forces twice as large, which can be had."""
    if case[1] == "built_sag":
        return case[2] * SPAN
    return case[2] * WEIGHT * SPAN * (2.0 if loads == "wind" else 1.0)


def stated(loads, **others):
    """The phase of `CASES`, with `others` as arguments."""
    values = {}
    for name in dict.fromkeys(c[1] for c in CASES):
        chosen = [k for k, c in enumerate(CASES) if c[1] == name]
        values[name] = jc.only(chosen, [size_of(CASES[k], loads) for k in chosen])
    return jc.Phase(**values, loads=LOADS[loads], **others)


LOADS = {
    "weight": [jc.SelfWeight()],
    "ice": [jc.SelfWeight(), jc.LineLoads(ICE, per="initial")],
    "wind": [jc.SelfWeight(), jc.LineLoads(WIND), jc.LineLoads(ICE, per="initial")],
}


@pytest.mark.quick_cases("lower-weight")
@pytest.mark.parametrize("loads", LOADS)
@pytest.mark.parametrize("at", ["lower", "upper", "first"])
def test_spans_are_built_as_stated(loads, at):
    """Level, inclined to 45 degrees, taut and slack, against a cable integrated apart.

    Weight per unstressed length follows the length; ice per initial length does not.
    """
    structure = spans()
    phases = [stated(loads, tension_at=at), jc.Phase()]
    solution = converged(jc.solve(structure, phases))
    ends = np.asarray(structure.nodes).reshape(-1, 2, 3)
    forces = np.asarray(solution.reactions).reshape(-1, 2, 3)
    lengths = np.asarray(solution.rest_length)
    wind = WIND if loads == "wind" else np.zeros(3)
    ice = np.zeros(3) if loads == "weight" else ICE
    for k, case in enumerate(CASES):
        rise, name, *_ = case
        value = size_of(case, loads)
        chord = ends[k, 1] - ends[k, 0]
        kind = {"horizontal_tension": "horizontal", "built_sag": "sag"}.get(name, name)
        if name == "end_tension":
            lower = "first" if rise >= 0 else "second"
            upper = "second" if rise >= 0 else "first"
            kind = {"lower": lower, "upper": upper, "first": "first"}[at]
        given = wind + WEIGHT * DOWN, np.linalg.norm(chord) * ice
        stiffness = float(structure.elements.axial_stiffness[k])
        # the guess is the solution itself: the oracle moves it to the root of its own equations
        guess = np.hypot(*forces[k, 0, :2]), lengths[k]
        length, first, second = elastic_cable.cable(chord, *given, stiffness, kind, value, guess)
        assert abs(lengths[k] / length - 1) < 1e-11
        size = np.linalg.norm(second)
        # EA eps of the length in a stiff cable, and the error of the oracle
        assert np.abs(forces[k] - [first, second]).max() < 1e-9 * size
    assert np.isfinite(forces).all()


# --- a mast that moves: a post with three guys at its top

# feet of three guys, not at one level, and height of the post; m (of the tower: ft and lb)
AROUND = np.radians([0, 120, 240])
FEET = np.stack([56 * np.cos(AROUND), 56 * np.sin(AROUND), [0, -2, 2]], axis=1)
HEIGHT = 70.0


def mast():
    """The mast: node 0 its foot, 1 its top, then the anchors; guys from the anchors upwards.

    Two level bars are its stiffness sideways: three constant tensions alone need not be in balance.
    """
    elements = {
        "mast": jc.Bars([[0, 1], [5, 1], [6, 1]], axial_stiffness=[60e6, 2e6, 2e6]),
        "guys": jc.Catenaries(
            [[2, 1], [3, 1], [4, 1]],
            axial_stiffness=15e6,
            weight=12.0,
            expansion=1.2e-5,
        ),
    }
    sides = [[-10.0, 0.0, HEIGHT], [0.0, 10.0, HEIGHT]]
    nodes = [[0.0, 0.0, 0.0], [0.2, -0.1, HEIGHT], *FEET, *sides]
    return jc.Structure(nodes, elements, jc.pinned([0, 2, 3, 4, 5, 6]))


def end_forces(solution):
    """Force of the lower supports on the guys, [3, 3], N."""
    return np.asarray(solution.reactions)[2:5]


TENSIONS = jnp.array([15e3, 18e3, 16e3])  # N
SIDE = jc.NodalLoads([1], (900.0, 400.0, -5e3))  # N


def built(name, values):
    """Prestress with a stated quantity and loads; then nothing; then warmth, with a wind."""
    first = jc.Phase(**{name: {"guys": values}}, loads=[jc.SelfWeight(), SIDE])
    wind = jc.LineLoads((0.0, 3.0, 0.0), on="guys")
    return [first, jc.Phase(), jc.Phase(temperature={"guys": -25.0}, loads=wind)]


@pytest.mark.slow
def test_a_mast_that_moves_ends_in_the_stated_tension():
    """In equilibrium with all loads, to 1e-10; later phases keep the lengths.

    With the lengths that were found, stated in another analysis, the forces are the same.
    """
    structure = mast()
    solution = converged(jc.solve(structure, built("end_tension", TENSIONS)))
    first, second, third = solution.phases
    size = np.linalg.norm(np.asarray(first.reactions)[2:5], axis=1)
    np.testing.assert_allclose(size, TENSIONS, rtol=1e-10)  # tol of Newton, over the forces
    assert np.abs(first.displacement[1]).max() > 1e-3  # the top has moved
    lengths = first.rest_length["guys"]
    np.testing.assert_array_equal(second.rest_length["guys"], lengths)
    np.testing.assert_allclose(second.reactions[2:5], first.reactions[2:5], atol=1e-6)
    np.testing.assert_allclose(third.rest_length["guys"], lengths * (1 - 25 * 1.2e-5), rtol=1e-14)
    again = converged(jc.solve(structure, built("rest_length", lengths)))
    # EA eps of the lengths
    np.testing.assert_allclose(again.reactions, solution.reactions, atol=1e-6)
    np.testing.assert_allclose(again.displacement, solution.displacement, atol=1e-11)
    # the control: a pretension of this size, which is that of the straight guy as drawn
    plain = jc.solve(structure, built("pretension", TENSIONS)[0])
    other = np.linalg.norm(end_forces(plain), axis=1)
    assert np.abs(other / np.asarray(TENSIONS) - 1).max() > 0.05


def moved(v):
    """Displacements of the top in all phases and the last tensions, as one number, and the status.

    One guy has a stated tension, the next one a horizontal tension, and the last one a sag.
    """
    first = jc.Phase(
        end_tension={"guys": jc.only([0], v[:1] * 15e3)},
        horizontal_tension={"guys": jc.only([1], v[1:2] * 11e3)},
        built_sag={"guys": jc.only([2], v[2:] * 0.35)},
        loads=[jc.SelfWeight(), SIDE],
    )
    wind = jc.LineLoads((0.0, 3.0, 0.0), on="guys")
    solution = jc.solve(mast(), [first, jc.Phase(loads=wind)], taylor.TIGHT)
    last = jnp.sum(jnp.array([1.0, 2.0, 3.0]) * solution.tension["guys"]) / 1e5
    way = jnp.sum(jnp.array([3.0, -2.0, 1.0]) * solution.displacement[1])
    return way + last, solution.status


@pytest.mark.slow
def test_derivatives_by_what_is_stated():
    """Through the lengths that are found, and phases after them; a batch has the same numbers."""
    v = jnp.ones(3)
    taylor.assert_gradient(moved, v, 10.0)
    cases = jnp.stack([v, 1.1 * v, -v])
    found, codes = traced(jax.vmap(moved))(cases)
    assert codes.tolist() == [jc.status.OK, jc.status.OK, jc.status.INVALID_INPUT]
    np.testing.assert_allclose(found[:2], [moved(v)[0], moved(1.1 * v)[0]], rtol=1e-9)
    assert np.isnan(found[2])


def level(stiffness):
    """A level span of one cable."""
    cable = jc.Catenaries([[0, 1]], axial_stiffness=stiffness, weight=WEIGHT)
    return jc.Structure([[0.0, 0, 0], [SPAN, 0, 0]], cable, jc.pinned([0, 1]))


@pytest.mark.slow
def test_there_is_no_length_for_a_tension_below_the_least():
    """A level span of an inextensible cable has at least 0.7544 of its weight per span."""

    def code(share):
        phase = jc.Phase(end_tension=share * WEIGHT * SPAN, loads=jc.SelfWeight())
        return int(jc.solve(level(1e9), phase).status)

    # min of cosh(t) / (2 t)
    with pytest.warns(jc.InputWarning, match=r"^phases\[0\].end_tension\[0\] = 754 N: no ") as seen:
        low = code(0.754)
    assert [low, code(0.755)] == [jc.status.NOT_AS_BUILT, jc.status.OK]
    nearest = float(re.search(r"it is ([\d.]+) N", str(seen[0].message)).group(1))
    assert 754.4 < nearest < 1e3  # newtons that the cable can have


@pytest.mark.slow  # such a doubt is in tests/model/messages.py
def test_a_sag_in_millimeters_is_doubted_and_found():
    """A span of 100 m that hangs 3000 m deep: two straight legs, longer by less than 1e-3."""
    structure, phase = level(1e9), jc.Phase(built_sag=3e3, loads=jc.SelfWeight())
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        solution = jc.solve(structure, phase)
    [text] = [str(one.message) for one in seen]
    assert text == "phases[0].built_sag[0] = 3000: its ends are 100 m apart; is the sag in m?"
    assert solution.status == jc.status.OK
    # inextensible catenary
    a = brentq(lambda a: a * (np.cosh(SPAN / 2 / a) - 1) - 3e3, 5.0, 100.0, xtol=1e-12)
    length = 2 * a * np.sinh(SPAN / 2 / a)
    assert abs(solution.rest_length[0] / length - 1) < 1e-4  # EA is 3e4 times the weight
    sag = jc.results.sags(structure, solution).midspan
    np.testing.assert_allclose(sag, 3e3, rtol=1e-9)


def test_a_tension_without_weight_is_that_of_a_straight_cable():
    """The weight acts from the second phase on, which says so."""
    phases = [jc.Phase(end_tension=2e3), jc.Phase(loads=jc.SelfWeight())]
    solution = converged(jc.solve(level(1e6), phases))
    np.testing.assert_allclose(solution.rest_length, SPAN / (1 + 2e3 / 1e6), rtol=1e-12)


def test_warnings_name_what_the_user_states():
    """Each comes once, with the phase and the input of the user, however often it is solved."""
    cable = jc.Catenaries([[0, 1]], axial_stiffness=5e3, weight=WEIGHT)
    bar = jc.Bars([[1, 2]], axial_stiffness=1e5)
    nodes = [[0.0, 0, 0], [SPAN, 0, 0], [SPAN + 1.0, 0, 0]]
    structure = jc.Structure(nodes, {"guy": cable, "bar": bar}, jc.pinned([0, 2]))
    aside = jc.Phase(loads=jc.NodalLoads([0], (0.0, 0.0, 1.0)))
    stated = jc.Phase(end_tension={"guy": 2e3}, loads=jc.SelfWeight())
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        jc.solve(structure, [jc.Phase(pretension={"bar": 10.0}), stated, aside])
    texts = sorted(str(one.message) for one in seen)
    assert [text[: text.index(":")] for text in texts] == [
        "phases[1].end_tension['guy'][0] = 2000",
        "phases[2].loads",
    ]


def test_straight_elements_take_an_end_tension_as_a_jack():
    """Bit by bit what `jacking` is; both in one phase for different elements; also on a path."""
    nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
    structure = jc.Structure(nodes, cables, jc.pinned([0, 2]))
    load = jc.NodalLoads([1], (0.0, 0.0, -600.0))
    jacked, stated, both = (
        jc.Phase(**given, loads=load)
        for given in (
            {"jacking": 500.0},
            {"end_tension": 500.0},
            {"jacking": jc.only([0], 500.0), "end_tension": jc.only([1], 500.0)},
        )
    )
    jack = jc.solve(structure, jacked)
    for phase in (stated, both):
        other = converged(jc.solve(structure, phase))
        np.testing.assert_array_equal(other.rest_length, jack.rest_length)
        np.testing.assert_array_equal(other.tension, [500.0, 500.0])
    jack, end = (jc.trace_path(structure, phase) for phase in (jacked, stated))
    assert jack.status == end.status == jc.status.OK
    np.testing.assert_array_equal(jack.tension, end.tension)


def tower(kind):
    """A tower on a hinge, node 0, with guys from their feet to its top, node 1."""
    nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, HEIGHT], *FEET]
    guys = kind([[2, 1], [3, 1], [4, 1]], axial_stiffness=1e6)
    elements = {"tower": jc.Bars([[0, 1]], axial_stiffness=1e12), "guys": guys}
    return jc.Structure(nodes, elements, jc.pinned([0, 2, 3, 4]))


def top_by_statics(tensions):
    """Where the moments of three tensions about the foot are zero; the tower is rigid."""

    def top(p):
        return np.array([*p, np.sqrt(HEIGHT**2 - p @ p)])

    def moments(p):
        along = FEET - top(p)
        pulls = tensions[:, None] * along / np.linalg.norm(along, axis=1)[:, None]
        return np.cross(top(p), pulls.sum(axis=0))[:2]

    return top(fsolve(moments, [0.1, 0.1], xtol=1e-14))


@pytest.mark.slow_cases("Cables")
@pytest.mark.parametrize("kind", [jc.Cables, jc.Catenaries])
def test_equal_guys_hold_a_hinged_tower_by_their_lengths(kind):
    """Under three constant forces it would fall over; by lengths it leans 2.88 ft, and is stable.

    1e-6 of the height: the tensions are met to 1e-8, and a lean is 1e2 times as sensitive.
    """
    tensions, change = np.full(3, 400.0), np.array([1.0, -2.0, 0.5])

    def top(tensions):
        solution = jc.solve(tower(kind), jc.Phase(end_tension={"guys": tensions}))
        return solution.positions[1], (solution.status, solution.stable)

    place, (code, stable) = top(tensions)
    assert int(code) == 0 and bool(stable)
    expected = top_by_statics(tensions)
    np.testing.assert_allclose(place, expected, atol=1e-6 * HEIGHT)
    assert 2.8 < np.hypot(*expected[:2]) < 2.9
    rate = jax.jvp(lambda t: top(t)[0], (jnp.asarray(tensions),), (jnp.asarray(change),))[1]
    near = (
        top_by_statics(tensions + 1e-3 * change) - top_by_statics(tensions - 1e-3 * change)
    ) / 2e-3
    np.testing.assert_allclose(rate, near, rtol=1e-4)


def test_what_falls_over_under_a_jack_is_warned_of():
    """Forces that do not hold the tower: it ends below its foot, in a stable equilibrium."""
    with pytest.warns(jc.InputWarning, match="node 1 has moved by 97.* fallen over"):
        solution = jc.solve(tower(jc.Cables), jc.Phase(jacking={"guys": 400.0}))
    assert int(solution.status) == 0 and float(solution.positions[1, 2]) < 5.0


def test_files_keep_what_is_stated(tmp_path):
    phase = jc.Phase(end_tension={"guys": TENSIONS}, tension_at="upper", loads=jc.SelfWeight())
    jc.save_scene(
        tmp_path / "mast.json", (mast(), [phase, jc.Phase(horizontal_tension={"guys": 1e3})])
    )
    _, (first, second) = jc.load_scene(tmp_path / "mast.json")
    assert (first.tension_at, second.tension_at) == ("upper", "lower")
    np.testing.assert_array_equal(first.end_tension["guys"], TENSIONS)
    assert second.horizontal_tension["guys"] == 1e3


def tied_post():
    """A post with a guy of stated tension, without the tie that a later phase adds, and with it.

    Returns the structure, that without the tie, and both phases.
    """
    nodes = [[-8.0, 0, 0], [0, 0, 10.0], [0, 0, 0], [8.0, 0, 0], [-8.0, 0, 10.0]]
    groups = {
        "guy": jc.Catenaries([[0, 1]], axial_stiffness=4e7, weight=40.0),
        "post": jc.Bars([[2, 1]], axial_stiffness=1e9),
        "back": jc.Cables([[3, 1]], axial_stiffness=1e6),
    }
    held = jc.pinned([0, 2, 3, 4]) + jc.restrained([1], "y")
    tied = groups | {"tie": jc.Bars([[4, 1]], axial_stiffness=1e9)}
    structure = jc.Structure(nodes, tied, supports=held)
    alone = jc.Structure(nodes[:4], groups, jc.pinned([0, 2, 3]) + jc.restrained([1], "y"))
    first = jc.Phase(loads=jc.SelfWeight(), end_tension={"guy": 30e3})
    return structure, alone, [first, jc.Phase(adds="tie", loads=jc.NodalLoads([1], (2e3, 0, 0)))]


@pytest.mark.slow
def test_what_a_later_phase_adds_does_not_hold_the_search():
    """A tension stated in the first phase is that of a structure without the tie that comes later.

    The tie would keep the top from moving: with it in the search the length is another one.
    """
    structure, alone, stages = tied_post()
    built, single = jc.solve(structure, stages), jc.solve(alone, stages[0])
    assert int(built.status) == int(single.status) == jc.status.OK
    pull = np.linalg.norm(built.phases[0].reactions[0])  # at the lower end
    assert pull == pytest.approx(30e3, rel=1e-6)
    np.testing.assert_allclose(built.rest_length["guy"], single.rest_length["guy"], rtol=1e-9)
