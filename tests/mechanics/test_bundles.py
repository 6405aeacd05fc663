"""Groups that are evaluated together: against the same analysis with every group by itself.

The oracle is the program itself without bundles (`_sort` made the number of the group), which all
other tests of groups hold. Sums at nodes go through elements in another order: a few roundings.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.convergence import converged
from oracles.traced import traced

import jaxcable as jc
from jaxcable.common import status
from jaxcable.common.tree import copy_with
from jaxcable.mechanics import bundles
from jaxcable.mechanics.bundles import Bundles

# other loads alone
pytestmark = pytest.mark.filterwarnings("ignore:elements.*no phase has SelfWeight")

NEAR = 1e-9  # of the largest value of its kind: two iterations that end in one equilibrium


@pytest.fixture
def alone(monkeypatch):
    """A function that calls another one with every group evaluated by itself."""

    def call(function, *arguments):
        with monkeypatch.context() as patch:
            patch.setattr(bundles, "_key_of_joinable_groups", lambda group, index: index)
            return function(*arguments)

    return call


def results(solution):
    """A solution without what only the next analysis reads."""
    return copy_with(solution, last=copy_with(solution.last, restart=None))


def assert_same(found, expected):
    """Equal trees to the rounding of two iterations, and not trivially."""
    if isinstance(found, jc.Solution):
        states = [own.last.restart.states for own in (found, expected)]
        for a, b in zip(*states, strict=True):
            assert_allclose(a.rest_length, b.rest_length, rtol=NEAR)
            assert_allclose(a.load_bearing_length, b.load_bearing_length, rtol=NEAR)
        found, expected = results(found), results(expected)
    found, expected = jax.tree.flatten(found), jax.tree.flatten(expected)
    assert found[1] == expected[1]
    count = 0
    for a, b in zip(found[0], expected[0], strict=True):
        a, b = np.asarray(a), np.asarray(b)
        assert a.shape == b.shape
        if a.dtype.kind == "f":
            there = np.isfinite(b)
            scale = np.abs(b[there]).max(initial=0.0)
            assert_allclose(a, b, rtol=0, atol=NEAR * max(scale, 1e-12))
            count += there.sum()
        else:
            assert (a == b).all()
    assert count > 0


def assert_as_alone(alone, structure, phases):
    found, expected = jc.solve(structure, phases), alone(jc.solve, structure, phases)
    assert found.status == expected.status == status.OK
    assert_same(found, expected)
    return found


NODES = np.array(
    [
        *([-4, -4, -0.5], [0, -4, 1], [4, -4, 0], [-4, 0, -1], [0.3, 0.2, 0]),
        *([4, 0, -1], [-4, 4, 0], [0, 4, 1], [4, 4, 0.5], [2, 2, 0.2]),
    ],
    float,
)
EDGE = [0, 1, 2, 3, 5, 6, 7, 8]


def net(law=None, **first):
    """Cables in three groups, bars between the first two of them, and a rope."""

    def own(factor):
        if law is None:
            return {"axial_stiffness": 1e5 * factor}
        return {"area": 1e-4 * factor, "law": law(factor)}

    elements = {
        "a": jc.Cables([[1, 4], [4, 7], [9, 7]], **own(1.0), **first),
        "strut": jc.Bars([[4, 9]], axial_stiffness=3e5, weight=4.0),
        "b": jc.Cables([[3, 4], [4, 5], [9, 5]], **own(2.0), expansion=1e-5),
        "c": jc.Cables([[0, 4], [9, 8]], **own(0.5), weight=7.0),
    }
    return jc.Structure(NODES, elements, supports=jc.pinned(EDGE))


def stages():
    """Inputs that differ from group to group, and loads on some elements of some."""
    first = jc.Phase(
        pretension={"a": 300.0, "b": None, "c": jc.only([1], 250.0), "strut": None},
        prestrain={"a": None, "b": [2e-3, 3e-3, 2.5e-3], "c": None, "strut": None},
        loads=jc.SelfWeight(),
        increments=2,
    )
    second = jc.Phase(
        jacking={"a": jc.only([0], 500.0), "b": None, "c": None, "strut": None},
        temperature={"a": None, "b": 40.0, "c": None, "strut": None},
        loads=[
            jc.LineLoads((0.0, 0.0, -30.0), on="b", elements=jc.only([2]), per="projected"),
            jc.LineLoads((5.0, 0.0, -10.0), on="c", per="initial", geometry="begun"),
            jc.CablePressure(12.0, axis=(0.0, 1.0, 0.0), on="a"),
            jc.CablePressure(np.array([3.0, 0.0, -2.0]), axis=(1.0, 0.0, 0.0), on="b"),
        ],
        increments=3,
    )
    third = jc.Phase(
        shortening={"a": 1e-3, "b": None, "c": [0.0, 2e-3], "strut": None},
        loads=jc.NodalLoads([4], (0.0, 0.0, -200.0)),
    )
    return [first, second, third]


def test_sorts():
    groups = net().motion_rows()[1]
    # dictionaries are in the order of their keys: a, b, c, strut
    assert Bundles.from_groups(groups).group_indices == ((0, 1, 2), (3,))
    other = net(compliance=1e-7).motion_rows()[1]  # a spring, which the others do not have
    assert Bundles.from_groups(other).group_indices == ((0,), (1, 2), (3,))
    one = jc.Structure(NODES[[1, 4, 7]], jc.Cables([[0, 1], [1, 2]], 1e5), jc.pinned([0, 2]))
    assert Bundles.from_groups(one.motion_rows()[1]).are_groups


@pytest.mark.slow
def test_every_statement_and_load(alone):
    found = assert_as_alone(alone, net(), stages())
    assert float(jnp.max(jnp.abs(found.displacement))) > 0.01


def test_a_pressure_for_the_elements_of_several_groups(alone):
    """Given once for groups of as many elements, in two bundles and twice in one of them."""
    links = [[[1, 4]], [[4, 7]], [[3, 4]], [[4, 5]]]
    kinds = jc.Cables, jc.Cables, jc.Bars, jc.Cables
    groups = [kind(own, axial_stiffness=1e5) for kind, own in zip(kinds, links, strict=True)]
    structure = jc.Structure(NODES[:9], groups, jc.pinned(EDGE))
    pressure = jc.CablePressure(np.array([12.0]), axis=(0.0, 1.0, 0.0))
    phases = [jc.Phase(pretension=[200.0, 200.0, None, 300.0]), jc.Phase(loads=pressure)]
    found = assert_as_alone(alone, structure, phases)
    assert float(jnp.abs(found.load).max()) > 5.0


@pytest.mark.slow
def test_goes_on(alone):
    """Continued with groups that cannot be evaluated together any more, and the other way round."""
    structure, phases = net(), stages()
    apart = net(compliance=1e-9)
    for before, after in ((structure, apart), (apart, structure)):
        start = converged(jc.solve(before, phases[:2]))

        def goes_on(start=start, after=after):
            return jc.solve(after, phases[2:], start=start)

        found, expected = goes_on(), alone(goes_on)
        assert found.status == status.OK
        assert_same(found, expected)


def mast(sections):
    """A mast of two kinds of beam, one end of which turns, and its guys."""
    nodes = np.array([[0, 0, z] for z in range(5)] + [[3, 0, 0], [-2, 2, 0], [-2, -2, 0]], float)
    hinges = np.zeros((2, 2), bool)
    hinges[0, 0] = True
    elements = [
        jc.Beams([[0, 1], [1, 2]], section=sections[0], up=(1.0, 0, 0), hinges=hinges),
        jc.Beams([[2, 3], [3, 4]], section=sections[1], up=(1.0, 0, 0), weight=50.0),
        jc.Cables([[j, k] for j in (4, 2) for k in (5, 6, 7)], np.repeat([2e6, 1e6], 3)),
    ]
    held = np.zeros((8, 6), bool)
    held[0], held[1, 5], held[5:] = True, True, True  # the foot turns, but not about z
    return jc.Structure(nodes, elements, jc.Supports(held))


def sections(sort):
    if sort == "elastic":
        laws, shapes = (jc.Elastic(70e9), jc.Elastic(200e9)), ((4, 4), (6, 3))
    else:  # as many fibres: those of what remembers are results
        points, stress = np.array([-0.02, -1e-3, 0.0, 1e-3, 0.02]), np.array([-90, -70, 0, 70, 90])
        laws = [jc.Polygonal(points, f * 1e6 * stress, "elastic") for f in (1, 2)]
        shapes = (3, 4), (3, 4)
    return [
        jc.Section.rectangle(0.05, 0.08 + 0.01 * k, law, shape=shape)
        for k, (law, shape) in enumerate(zip(laws, shapes, strict=True))
    ]


@pytest.mark.slow
@pytest.mark.parametrize("sort", ["elastic", "memory"])
def test_sections_of_one_kind(alone, sort):
    structure = mast(sections(sort))
    assert len(Bundles.from_groups(structure.motion_rows()[1]).group_indices) == 2
    wind = jc.LineLoads((200.0, 50.0, 0.0), on=1, per="initial")
    tip = jc.NodalLoads([4], (900.0, 0.0, -500.0))
    phases = [
        jc.Phase(prestrain=[None, None, np.repeat([1e-4, 2e-4], 3)], loads=jc.SelfWeight()),
        jc.Phase(loads=[wind, tip], increments=2),
    ]
    assert_as_alone(alone, structure, phases)


def test_traced_law_keeps_its_rules():
    """A modulus that is no stiffness, traced, in one group of a bundle: a status and no number."""

    @traced
    def analyse(E):
        laws = iter([jc.Elastic(1e9), jc.Elastic(E), jc.Elastic(2e9)])
        structure = net(lambda factor: next(laws))
        return jc.solve(
            structure, jc.Phase(pretension={"a": 9.0, "b": 9.0, "c": 9.0, "strut": None})
        ).status

    assert analyse(1e9) == status.OK
    assert analyse(-1e9) == status.INVALID_INPUT


def test_what_is_compiled_once():
    """Ten groups of cables are hardly more than one: lines of StableHLO."""

    def lines(structure, phase):
        return jax.jit(lambda own: jc.solve(own, phase)).lower(structure).as_text().count("\n")

    whole = jc.scenes.hypar_net().structure
    links = whole.elements.links.array

    def cut(n):
        parts = np.array_split(links, n)
        cables = [jc.Cables(part, 1e6 * (1 + k), weight=5.0) for k, part in enumerate(parts)]
        return jc.Structure(whole.nodes, cables, supports=whole.supports)

    phase = jc.Phase(pretension=1e3, loads=jc.SelfWeight())
    assert lines(cut(10), phase) < 1.1 * lines(cut(1), phase)
