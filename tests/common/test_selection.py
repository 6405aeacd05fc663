"""`only`: which elements are meant, by numbers or by booleans, with values or without."""

import jax
import numpy as np

import jaxcable as jc

MASK = np.arange(12) % 3 == 0


def test_a_selection_says_which_elements_are_meant():
    assert jc.only([1, 3]).element_mask(5, "elements").tolist() == [False, True, False, True, False]
    assert jc.only(MASK).element_mask(12, "elements").tolist() == MASK.tolist()
    assert jax.tree.leaves(jc.only(MASK)) == []  # topology: nothing in it is traced
