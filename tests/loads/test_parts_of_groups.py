"""Loads along some elements of a group, against loads on nodes by hand and statics."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc

NODES = np.array([[0, 0, 3.0], [3, 0, 1.0], [6, 0, 0.0], [9, 0, 1.5], [12, 0, 3.0]])
CHAIN = np.array([[0, 1], [1, 2], [2, 3], [3, 4]])
CHORD = np.linalg.norm(np.diff(NODES, axis=0), axis=1)
PLAN = np.diff(NODES[:, 0])


def chain(elements, kind=jc.Cables):
    groups = {
        name: kind(CHAIN[rows], axial_stiffness=1e6, weight=20.0, rest_length=CHORD[rows])
        for name, rows in elements.items()
    }
    return jc.Structure(NODES, groups, supports=jc.pinned([0, 4]))


def at_ends(amounts):
    """Half of each element's amount at each of its ends, [5]."""
    total = np.zeros(5)
    np.add.at(total, CHAIN, 0.5 * np.asarray(amounts)[:, None])
    return total


CASES = {
    "weight": (lambda chosen: jc.SelfWeight(elements=chosen), 20.0 * CHORD),
    "weight of a key": (lambda chosen: jc.SelfWeight(on="all", elements=chosen), 20.0 * CHORD),
    "unstressed": (lambda chosen: jc.LineLoads((0, 0, -30.0), elements=chosen), 30.0 * CHORD),
    "projected": (
        lambda chosen: jc.LineLoads((0, 0, -30.0), "all", "projected", elements=chosen),
        30.0 * PLAN,
    ),
}


@pytest.mark.filterwarnings("ignore:elements.*no phase has SelfWeight")  # other loads alone
@pytest.mark.parametrize("case", CASES)
def test_loads_of_the_chosen_elements_alone(case):
    make, amounts = CASES[case]
    structure = chain({"all": [0, 1, 2, 3]})
    phase = jc.Phase(loads=[make(jc.only([0, 2])), jc.NodalLoads([2], (0, 0, -200.0))])
    solution = jc.solve(structure, phase)
    assert solution.status == 0
    expected = at_ends(amounts * [1, 0, 1, 0])
    expected[2] += 200.0
    np.testing.assert_allclose(-solution.load[:, 2], expected, rtol=1e-14)


@pytest.mark.slow
def test_a_part_of_a_group_is_as_a_group():
    """Catenaries hang under it: the shape, not only the nodes, knows which ones are loaded."""
    ice = (0.0, 0.0, -30.0)
    whole = chain({"all": [0, 1, 2, 3]}, jc.Catenaries)
    parts = chain({"iced": [1, 2], "bare": [0, 3]}, jc.Catenaries)
    phases = [
        jc.Phase(loads=[jc.SelfWeight(), load])
        for load in (jc.LineLoads(ice, elements=jc.only([1, 2])), jc.LineLoads(ice, on="iced"))
    ]
    one, two = jc.solve(whole, phases[0]), jc.solve(parts, phases[1])
    assert one.status == two.status == 0
    # both at tol 1e-10 of their forces
    np.testing.assert_allclose(one.positions, two.positions, atol=1e-9)
    bare = jc.solve(whole, jc.Phase(loads=jc.SelfWeight()))
    assert bare.status == 0 and np.abs(bare.positions - one.positions).max() > 1e-3


def test_a_beam_is_bent_by_the_load_on_its_outer_half():
    """Cantilever of two elements: the root's moment is q times half the length at its lever."""
    section = jc.Section.rectangle(0.1, 0.1, jc.Elastic(200e9))
    beams = jc.Beams([[0, 1], [1, 2]], section=section)
    nodes = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [4.0, 0.0, 0.0]]
    structure = jc.Structure(nodes, beams, supports=jc.clamped([0]))
    load = jc.LineLoads((0.0, 0.0, -10.0), elements=jc.only([False, True]))
    solution = jc.solve(structure, jc.Phase(loads=load))
    assert solution.status == 0
    # it deflects by 2e-4 of its length: the lever shortens by the square of that
    moments = np.abs(np.asarray(solution.section_forces)[:, :, 4])
    assert moments[0, 0] == pytest.approx(10.0 * 2.0 * 3.0, rel=1e-6)
    assert moments[1, 0] == pytest.approx(10.0 * 2.0 * 1.0, rel=1e-6)
    assert moments[1, -1] < 1e-6  # the free end, which has no moment only if the load bends it


def test_a_form_under_loads_on_some_of_its_cables():
    """Balance of every free node by NumPy, and the derivative by the load."""
    structure = chain({"all": [0, 1, 2, 3]})
    load = jc.LineLoads((0.0, 0.0, -30.0), per="initial", elements=jc.only([1]))

    def found(scale):
        return jc.force_density(structure, 100.0, jc.combine([load], [scale]))

    places = np.asarray(found(1.0))
    pieces = np.diff(places, axis=0)
    length = np.linalg.norm(pieces, axis=1)
    down = at_ends(30.0 * length * [0, 1, 0, 0])
    left = 100.0 * np.diff(pieces, axis=0) - np.outer(down[1:4], [0, 0, 1])
    # forces of 300 N, to the tolerance 1e-10 of the loads' iteration
    assert np.abs(left).max() < 1e-6 and down[3] == 0 and places[1, 2] < places[3, 2] - 0.1
    rate = jax.jvp(found, (1.0,), (1.0,))[1]
    step = 1e-4
    both = found(1 + step) - found(1 - step)
    # central differences: step^2 against rounding over the step
    np.testing.assert_allclose(rate, both / (2 * step), atol=1e-6)


def test_it_is_kept_in_files(tmp_path):
    structure = chain({"all": [0, 1, 2, 3]})
    chosen = jc.only([2, 3])
    loads = [jc.SelfWeight(on="all", elements=chosen), jc.LineLoads((0, 0, -1.0), elements=chosen)]
    jc.save_scene(tmp_path / "a.json", (structure, [jc.Phase(loads=loads)]))
    again = jc.load_scene(tmp_path / "a.json")[1][0].loads
    assert [load.elements.elements.array.tolist() for load in again] == [[2, 3], [2, 3]]
    assert again[0].on == "all"


TWO = chain({"one": [0, 1], "two": [2, 3]})
REFUSED = [
    (lambda: jc.LineLoads((0, 0, 1), elements=[0]), "elements: expected a selection such as only"),
    (lambda: jc.SelfWeight(elements=jc.only([0], 1.0)), "elements: expected a selection.*got Only"),
    (lambda: jc.SelfWeight(elements=jc.only([0])).check(TWO), "on = None means 2 groups"),
    (lambda: jc.SelfWeight(on="three").check(TWO), "on = 'three': no such key"),
    (
        lambda: jc.LineLoads((0, 0, 1), on="two", elements=jc.only([2])).check(TWO),
        r"elements\[0\] = 2: the group has elements 0 to 1",
    ),
    (
        lambda: jc.SelfWeight(on="two").check(
            jc.replace(TWO, elements={**TWO.elements, "two": jc.Bars(CHAIN[2:], axial_stiffness=1)})
        ),
        "SelfWeight: on = 'two': no such group has a weight",
    ),
]


@pytest.mark.parametrize(("make", "text"), REFUSED, ids=[text[:40] for _, text in REFUSED])
def test_refused(make, text):
    with pytest.raises(ValueError, match=text):
        make()


def test_elements_do_not_compile_anew():
    """Which elements are loaded is data of the program, not the program."""
    structure = chain({"all": [0, 1, 2, 3]})

    def lowered(elements):
        load = jc.SelfWeight(elements=jc.only(elements))
        return load.among(structure)

    one, two = lowered([0]), lowered([1, 3])
    assert jax.tree.structure(one) == jax.tree.structure(two)
    assert jnp.sum(two.part[0]) == 2
