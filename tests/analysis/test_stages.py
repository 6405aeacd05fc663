"""Elements that come and go (`Phase(adds=..., removes=...)`), against closed forms and by hand."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import beam, pieces
from numpy.polynomial.legendre import leggauss
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient
from oracles.traced import traced
from scipy.optimize import brentq

import jaxcable as jc

SECTION = jc.Section.rectangle(0.1, 0.3, jc.Elastic(200e9))
EI = 200e9 * 0.1 * 0.3**3 / 12  # N m2, for bending in the plane of z
NODES = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, 0]])
PUSH = jc.NodalLoads([4], (20.0, 10.0, -300.0))
BASE = [jc.Phase(pretension=1000.0), jc.Phase(loads=PUSH)]
GUIDED = jc.pinned([0]) + jc.restrained([1], "xy")


def cross(links=((0, 4), (1, 4), (2, 4), (3, 4)), **options):
    cables = jc.Cables(list(links), axial_stiffness=100e3, **options)
    return jc.Structure(NODES, cables, supports=jc.pinned([0, 1, 2, 3]))


def solved(*arguments, **options):
    solution = converged(jc.solve(*arguments, **options))
    return solution


# --- closed forms


@pytest.mark.slow_cases("drawn")
@pytest.mark.parametrize("placed", ["attached", "drawn"])
def test_a_chain_grows_downwards(placed):
    """Bars that are attached have their 1 m; those that reach to where a node waits have less."""
    n, push, stiffness = 4, 2e3, 1e6
    nodes, links = pieces(n, n, (0.0, 0.0, -1.0))
    bars = jc.Bars(links, axial_stiffness=stiffness)
    guide = jc.restrained(range(1, n + 1), "xy")
    structure = jc.Structure(nodes, bars, supports=jc.pinned([0]) + guide)
    stages = [
        jc.Phase(adds=jc.only([k]), placed=placed, loads=jc.NodalLoads([k + 1], (0.0, 0.0, -push)))
        for k in range(n)
    ]
    solution = solved(structure, stages, TIGHT)
    at, rest = [0.0], []
    for k in range(n):
        start = at[k] - 1.0 if placed == "attached" else -(k + 1.0)
        rest.append(at[k] - start)
        at.append(start)
        for j in range(k + 1):
            at[j + 1] = at[j] - rest[j] * (1 + (k - j + 1) * push / stiffness)
        # every phase is seen from where it begins, with the new node in its place
        moved = solution.phases[k].displacement_in_phase[k + 1, 2]
        assert float(moved) == pytest.approx(at[k + 1] - start, abs=1e-13)
    np.testing.assert_allclose(solution.positions[:, 2], at, atol=1e-13)
    np.testing.assert_allclose(solution.rest_length, rest, atol=1e-13)


def erected(n, length, weight, attached):
    """Deflections of a cantilever built segment by segment, by integrals over point loads."""
    x = length * np.arange(n + 1)
    place, share = leggauss(4)  # exact for the cubics below
    w, turn = np.zeros(n + 1), np.zeros(n + 1)
    for k in range(n):
        if attached:
            w[k + 1], turn[k + 1] = w[k] + turn[k] * length, turn[k]
        at = x[k] + length * (place + 1) / 2
        load = weight * length / 2 * share
        for j in range(k + 1):
            w[j] += load @ (x[j] ** 2 * (3 * at - x[j])) / (6 * EI)
            turn[j] += load @ (x[j] * (2 * at - x[j])) / (2 * EI)
        end = x[k + 1]
        w[k + 1] += load @ (at**2 * (3 * end - at)) / (6 * EI)
        turn[k + 1] += load @ at**2 / (2 * EI)
    return -w


@pytest.mark.slow_cases("attached")
@pytest.mark.parametrize("placed", ["attached", "drawn"])
def test_a_cantilever_is_built_segment_by_segment(placed):
    n, length, weight = 5, 2.0, 50.0
    structure = beam(n, SECTION, n * length, weight=weight)
    stages = [
        jc.Phase(adds=jc.only([k]), placed=placed, loads=jc.SelfWeight() if k == 0 else None)
        for k in range(n)
    ]
    solution = solved(structure, stages)
    sag = solution.displacement[:, 2]
    # turned by 2e-4 at most: what is not linear is a part of 1e-7 of 1.4 mm
    np.testing.assert_allclose(sag, erected(n, length, weight, placed == "attached"), atol=1e-10)
    assert np.abs(sag - erected(n, length, weight, placed == "drawn")).max() > 1e-4  # the control
    from_tip = n * length - structure.nodes[:-1, 0]
    moments = solution.section_forces[:, 0, 4]
    np.testing.assert_allclose(moments, weight * from_tip**2 / 2, rtol=1e-7)
    assert float(solution.reactions[0, 2]) == pytest.approx(weight * n * length, rel=1e-8)


@pytest.mark.slow
def test_a_segment_attached_to_a_turned_end_goes_on_straight():
    """A weightless segment on a cantilever bent into a quarter circle: rigid, in space."""
    n = 8
    thin = jc.Section.rectangle(0.02, 0.01, jc.Elastic(200e9))  # does not bend alike
    structure = beam(n + 1, thin, n + 1.0)
    bend = 200e9 * 0.02 * 0.01**3 / 12 * (np.pi / 2) / n
    moment = jc.NodalLoads([n], (0.0, 0.0, 0.0), moments=(0.0, -bend, 0.0))
    stages = [
        jc.Phase(removes=jc.only([n]), loads=moment, increments=5),
        jc.Phase(adds=jc.only([n]), placed="attached"),
    ]
    solution = solved(structure, stages)
    segment = np.diff(np.asarray(solution.positions[n:]), axis=0)[0]
    np.testing.assert_allclose(segment, [0.0, 0.0, 1.0], atol=2e-3)  # chords of a circle
    last = solution.phases[0].positions[n] - solution.positions[n]
    np.testing.assert_allclose(last, 0.0, atol=1e-9)
    np.testing.assert_allclose(solution.section_forces[n], 0.0, atol=1e-6 * bend)
    # drawn, it reaches back to where it was drawn, and is as unstressed there
    stages[1] = jc.Phase(adds=jc.only([n]))
    drawn = solved(structure, stages)
    np.testing.assert_allclose(drawn.positions[n + 1], structure.nodes[n + 1], atol=1e-8)
    np.testing.assert_allclose(drawn.section_forces[n], 0.0, atol=1e-6 * bend)


@pytest.mark.slow_cases("0")
@pytest.mark.parametrize("first", [0, 1])
def test_two_spans_one_after_the_other(first):
    """The weight of the first span makes no moment at the support, that of the second q L^2/16."""
    n, length, weight = 4, 4.0, 100.0
    supports = jc.restrained([0, 2 * n], "yz") + jc.restrained([n], "xyz", "x")
    structure = beam(2 * n, SECTION, 2 * length, supports, weight=weight)
    spans = [jc.only(range(n)), jc.only(range(n, 2 * n))]
    own = [jc.Phase(adds=spans[first], loads=jc.SelfWeight()), jc.Phase(adds=spans[1 - first])]
    at_support = solved(structure, own).section_forces[n, 0, 4]
    assert float(at_support) == pytest.approx(weight * length**2 / 16, rel=1e-8)


# --- comes and goes


def test_what_went_and_came_back_is_as_before():
    """With its unstressed length: without it, a new one is unstressed where it finds its ends."""
    structure, gone = cross(), [*BASE, jc.Phase(removes=jc.only([3]))]
    length = jc.only([3], 1.0 / (1 + 1000.0 / 100e3))
    back = jc.Phase(adds=jc.only([3]), rest_length=length)
    after = solved(structure, [*gone, back], TIGHT)
    before = after.phases[1]
    np.testing.assert_allclose(after.tension, before.tension, rtol=1e-12)
    np.testing.assert_allclose(after.positions, before.positions, atol=1e-13)
    np.testing.assert_allclose(after.reactions, before.reactions, rtol=0, atol=1e-9)
    slack = solved(structure, [*gone, jc.Phase(adds=jc.only([3]))], TIGHT)
    np.testing.assert_allclose(slack.tension[3], 0.0, atol=1e-9)
    np.testing.assert_allclose(slack.tension, slack.phases[2].tension, atol=1e-9)


def test_a_structure_without_what_went_is_the_same():
    """Elastic equilibrium knows no history: not even that there were more cables once."""
    went = solved(cross(), [*BASE, jc.Phase(removes=jc.only([1]), increments=3)], TIGHT)
    never = cross(links=[(0, 4), (2, 4), (3, 4)])
    alone = solved(never, BASE, TIGHT)
    np.testing.assert_allclose(went.tension[jnp.array([0, 2, 3])], alone.tension, rtol=1e-11)
    np.testing.assert_allclose(went.displacement, alone.displacement, atol=1e-13)
    assert float(went.tension[1]) == 0.0 and float(alone.tension[1]) > 0


def test_the_order_has_no_influence_where_nothing_is_locked_in():
    """Unstressed lengths that are given, and not found: one end, by all ways."""
    structure = cross(rest_length=[0.98, 0.985, 0.99, 0.995])

    def end(order):
        stages = [jc.Phase(adds=order == k, loads=PUSH if k == 0 else None) for k in range(4)]
        solution = jc.solve(structure, stages, TIGHT)
        return solution.status, solution.tension, solution.displacement

    orders = np.array(list(itertools.permutations(range(4))))
    codes, tensions, moved = traced(jax.vmap(end))(jnp.asarray(orders))
    assert codes.shape == (24,) and not codes.any()
    at_once = solved(structure, jc.Phase(loads=PUSH), TIGHT)
    assert float(at_once.tension.min()) > 100
    np.testing.assert_allclose(tensions, np.tile(at_once.tension, (24, 1)), rtol=1e-11)
    np.testing.assert_allclose(moved, np.tile(at_once.displacement, (24, 1, 1)), atol=1e-13)
    code, *alone = end(orders[7])  # with known masks
    assert int(code) == 0
    np.testing.assert_allclose(alone[0], tensions[7], rtol=1e-11)


def test_what_has_yielded_comes_back_as_new():
    """Beside an elastic bar: unstressed where it finds its ends, without its plastic strains."""
    EA, push, length = 1e6, 3e3, 2.0
    law = jc.Polygonal([-0.1, -1e-3, 0, 1e-3, 0.1], [-2e3, -1e3, 0, 1e3, 2e3], "elastic")
    groups = {
        "elastic": jc.Bars([[0, 1]], axial_stiffness=EA),
        "yields": jc.Bars([[0, 1]], area=1.0, law=law),
    }
    structure = jc.Structure([[0, 0, 0], [0, 0, -length]], groups, GUIDED)
    load, less = (jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -p))) for p in (push, 0.3 * push))
    stages = [load, jc.Phase(removes="yields"), jc.Phase(adds="yields"), less]
    solution = solved(structure, stages, TIGHT)
    loaded, alone, back, more = [phase.tension["yields"][0] for phase in solution.phases]
    strain = (push - 1e3 * (1 - 1 / 99)) / (EA + 1e3 / 0.099)  # the law beyond its corner
    assert float(loaded) == pytest.approx(push - EA * strain, rel=1e-11)
    assert abs(float(alone)) == 0.0 and abs(float(back)) < 1e-8
    longer = 1 + push / EA  # its new length, over that of the other bar
    assert float(more) == pytest.approx(0.3 * push / (1 + longer), rel=1e-9)


# --- what waits


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hinged", "sprung", "rigid"])
def test_ends_of_all_kinds_come_and_go(kind):
    """A portal whose beam comes after the columns have bent: as if it had never been there."""
    nodes = [[0.0, 0, 0], [0, 0, 3], [4, 0, 3], [4, 0, 0], [0, 0, 3.5]]
    up, options, rigid = (1.0, 0.0, 0.0), {}, None
    if kind == "hinged":
        options = {"hinges": np.array([[True, False]])}
    elif kind == "sprung":
        options = {
            "hinges": np.array([[[False, True, False]] * 2]),
            "springs": np.array([[[0.0, 1e5, 0.0]] * 2]),
        }
    columns = jc.Beams([[0, 1], [3, 2]], section=SECTION, up=up)
    beam = jc.Beams([[4 if kind == "rigid" else 1, 2]], section=SECTION, up=(0, 0, 1.0), **options)
    if kind == "rigid":
        rigid = [[1, 4]]
    else:
        nodes = nodes[:4]
    structure = jc.Structure(
        nodes, {"columns": columns, "beam": beam}, supports=jc.clamped([0, 3]), rigid=rigid
    )
    wind = jc.NodalLoads([1], (2e4, 0.0, 0.0))
    stages = [jc.Phase(loads=wind), jc.Phase(adds="beam"), jc.Phase(loads=wind)]
    gone = solved(structure, [*stages, jc.Phase(removes="beam")])
    bare, joined, both, _ = gone.phases
    tip = 2e4 * 3.0**3 / 3 / EI
    assert float(bare.displacement[1, 0]) == pytest.approx(tip, rel=1e-4)
    np.testing.assert_allclose(joined.displacement_in_phase, 0.0, atol=1e-9)
    np.testing.assert_allclose(joined.section_forces["beam"], 0.0, atol=1e-3)
    assert float(both.tension["beam"][0]) < -1e3
    np.testing.assert_allclose(gone.section_forces["beam"], 0.0)
    assert float(gone.displacement[1, 0]) == pytest.approx(2 * tip, rel=1e-4)
    np.testing.assert_allclose(gone.displacement[2], 0.0, atol=1e-7)


@pytest.mark.slow
def test_hanging_and_sliding_cables_come():
    nodes = np.array([[0.0, 0, 0], [10, 0, 0], [5, 0, 0], [5, 4, 0.0]])
    groups = {
        "held": jc.Cables([[2, 3], [2, 0], [2, 1]], axial_stiffness=1e6),
        "hung": jc.Catenaries([[0, 1]], axial_stiffness=1e6, weight=5.0),
        "rope": jc.SlidingCables([[0, 2, 1]], axial_stiffness=1e5, weight=2.0),
    }
    structure = jc.Structure(nodes, groups, supports=jc.pinned([0, 1, 3]))
    tense = {"held": 500.0, "hung": None, "rope": None}
    stages = [
        jc.Phase(pretension=tense, loads=jc.NodalLoads([2], (0.0, -100.0, 0.0))),
        jc.Phase(adds=["hung", "rope"], loads=jc.SelfWeight()),
        jc.Phase(loads=jc.NodalLoads([2], (900.0, 150.0, 0.0))),
    ]
    solution = solved(structure, stages, TIGHT)
    # the cable as long as its chord hangs by itself: the elastic catenary of EA, w, L0 = span
    EA, w, L0 = 1e6, 5.0, 10.0

    def span(H):
        return H * L0 / EA + 2 * H / w * np.arcsinh(w * L0 / 2 / H)

    H = brentq(lambda H: span(H) - L0, 1.0, EA, xtol=1e-10)
    ends = np.hypot(H, w * L0 / 2)
    np.testing.assert_allclose(jc.forms.end_tensions(structure, solution)["hung"], ends, rtol=1e-9)
    found, end = (solution.phases[k].positions[2] for k in (0, 2))
    lengths = [sum(np.linalg.norm(np.asarray(p) - nodes[k]) for k in (0, 1)) for p in (found, end)]
    strain = lengths[1] / lengths[0] - 1
    assert strain > 1e-6
    assert float(solution.tension["rope"][0]) == pytest.approx(1e5 * strain, rel=1e-7)
    assert float(solution.rest_length["rope"][0]) == pytest.approx(lengths[0], rel=1e-12)
    # the weight of the rope is where the rope is: moments balance
    moments = np.cross(solution.positions, solution.load + solution.reactions)
    np.testing.assert_allclose(moments.sum(axis=0), 0.0, atol=1e-8)


# --- transformations and programs


@pytest.mark.slow
def test_derivatives_go_through_all_stages():
    structure = cross(weight=2.0)

    def measure(tension):
        """Of a cable that goes, without a trace; of one that goes and comes back."""
        stages = [
            jc.Phase(pretension=tension, removes=jc.only([3]), loads=jc.SelfWeight()),
            jc.Phase(loads=PUSH),
            jc.Phase(adds=jc.only([3]), pretension=jc.only([3], tension[3])),
            jc.Phase(removes=jc.only([1])),
        ]
        solution = jc.solve(structure, stages, TIGHT)
        return 1e3 * solution.displacement[4] @ jnp.array([0.3, 0.7, 1.0]), solution.status

    gradient = assert_gradient(measure, [1000.0, 1100.0, 900.0, 800.0], 10.0)
    assert abs(float(gradient[1])) < 1e-10 * np.abs(gradient).max()


# --- input


def test_no_energy_balance_where_elements_come_and_go():
    stages = [*BASE, jc.Phase(removes=jc.only([3]))]
    solution = solved(cross(), stages)
    with pytest.raises(ValueError, match="no energy balance where phases add or remove"):
        jc.energy_balance(cross(), stages, solution)


def test_scenes_with_stages_are_files(tmp_path):
    net = cross()
    structure = jc.replace(net, elements={"net": net.elements, "more": net.elements})
    stages = [
        jc.Phase(pretension=900.0, removes={"net": jc.only([3]), "more": None}),
        jc.Phase(adds={"net": np.eye(4, dtype=bool)[3], "more": None}, placed="attached"),
        jc.Phase(removes=["net", "more"]),
    ]
    path = tmp_path / "stages.json"
    jc.save_scene(path, (structure, stages))
    loaded = jc.load_scene(path)
    assert [phase.placed for phase in loaded.phases] == ["drawn", "attached", "drawn"]
    own, read = solved(structure, stages), solved(*loaded)
    np.testing.assert_array_equal(own.tension["net"], read.tension["net"])
    assert not read.tension["net"].any()


def test_traced_masks_that_contradict_themselves_fail():
    """What is refused where it is known has a status where it is traced."""
    structure = cross()

    def codes(masks):
        stages = [jc.Phase(pretension=900.0), *(jc.Phase(removes=mask) for mask in masks)]
        return [phase.status for phase in jc.solve(structure, stages).phases]

    last, other = np.eye(4, dtype=bool)[3], np.eye(4, dtype=bool)[2]
    good = traced(codes)([last, other])
    twice = traced(codes)([last, last])
    assert [int(code) for code in good] == [0, 0, 0]
    assert [int(code) for code in twice] == [0, 0, jc.status.INVALID_INPUT]
