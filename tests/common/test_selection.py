"""`only`: which elements are meant, by numbers or by booleans, with values or without."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc

MASK = np.arange(12) % 3 == 0


def test_a_selection_says_which_elements_are_meant():
    assert jc.only([1, 3]).element_mask(5, "elements").tolist() == [False, True, False, True, False]
    assert jc.only(MASK).element_mask(12, "elements").tolist() == MASK.tolist()
    assert jax.tree.leaves(jc.only(MASK)) == []  # topology: nothing in it is traced


@pytest.mark.slow
def test_booleans_are_the_numbers_where_they_are_true():
    structure, (prestress, _) = jc.scenes.flat_net()
    lengths = np.linspace(1e-4, 2e-4, MASK.sum())
    one, two = (
        jc.solve(structure, [prestress, jc.Phase(shortening=jc.only(elements, lengths))])
        for elements in (MASK, np.flatnonzero(MASK))
    )
    assert one.status == two.status == 0
    np.testing.assert_array_equal(one.tension, two.tension)
    assert np.ptp(one.tension) > 1.0  # the lengths did something


NET = jc.scenes.flat_net().structure
REFUSED = [
    (lambda: jc.only([7]).element_mask(5, "elements"), r"elements\[0\] = 7.*elements 0 to 4"),
    (lambda: jc.only(MASK).element_mask(5, "elements"), "each of 5 elements, got 12"),
    (lambda: jc.only([[True, False]]), r"booleans \[n_elem\], got shape"),
    (lambda: jc.only([0, True]), "elements: expected integers, got some booleans among them"),
    (lambda: jc.only([-1]), "element numbers start at 0"),
    (lambda: jc.only([1, 1]), "element 1 is named twice"),
    (lambda: jax.jit(jc.only)(jnp.array([0, 1])), "elements:.*topology and cannot be traced"),
    (lambda: jax.jit(jc.only)(jnp.array([True])), "elements:.*topology and cannot be traced"),
    (lambda: jc.solve(NET, jc.Phase(pretension=jc.only([0]))), "pretension: only.* has no values"),
    (lambda: jc.find_form(NET, jc.only([0])), "tension: only.* has no values"),
    (lambda: jc.solve(NET, jc.Phase(shortening=MASK)), "shortening: expected numbers, got bool"),
    (lambda: jc.influence(NET, jc.Phase(), wrt=MASK), "wrt: expected a name such as 'shortening'"),
    (lambda: jc.pinned(MASK), "pinned nodes: expected integers, got bool; numpy.flatnonzero"),
    (lambda: jc.NodalLoads(MASK, (0.0, 0.0, 1.0)), "load nodes: expected integers, got bool"),
    (lambda: jc.Cables([[0, True]], axial_stiffness=1.0), "links: .* booleans among them"),
]


@pytest.mark.parametrize(("make", "text"), REFUSED, ids=[text[:40] for _, text in REFUSED])
def test_what_is_no_selection_is_refused_by_name(make, text):
    with pytest.raises(ValueError, match=text):
        make()
