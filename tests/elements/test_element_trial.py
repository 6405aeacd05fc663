"""`jc.elements.check` names what is wrong with a class of elements: each defect has a sentence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from extensions.own_elements import Nothing

import jaxcable as jc
from jaxcable.common.tree import Indices, pytree
from jaxcable.elements.element import Element, Result

NODES = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0]])


class Springs(Element):
    """Springs of no length between two nodes, not yet a pytree: what tests make one of."""

    per_element = ("stiffness",)

    def start(self, ends):
        return Nothing()

    def end_forces(self, state, ends, motion):
        pull = self.stiffness * (ends[1] + motion[1] - ends[0] - motion[0])
        return jnp.stack([-pull, pull])

    def energy(self, state, ends, motion):
        return 0.5 * self.stiffness * jnp.sum((ends[1] + motion[1] - ends[0] - motion[0]) ** 2)


def springs(decorate=None, bare=False, **changes):
    """Two springs of a class with some methods or attributes changed."""

    class Own(Springs):
        links: object
        stiffness: object

        def __post_init__(self):
            if not bare:
                object.__setattr__(self, "links", Indices(self.links))

    for name, value in changes.items():
        setattr(Own, name, value)
    cls = (decorate or pytree(indices=("links",)))(Own)
    return cls([[0, 1], [1, 2]], np.array([2.0, 3.0]))


def said(group, nodes=NODES):
    """What the check says, without the name of the class."""
    with pytest.raises(ValueError, match=r"^Own: ") as raised:
        jc.elements.check(group, nodes)
    return str(raised.value).removeprefix("Own: ")


def test_one_that_is_right_is_not_told():
    jc.elements.check(springs(), NODES)


def root(self, state, ends, motion):
    """Finite where nodes have moved, and without a derivative where they have not."""
    return jnp.sqrt(jnp.abs(motion)) + Springs.end_forces(self, state, ends, motion)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"end_forces": lambda self, *_: jnp.full((2, 3), jnp.nan)},
            "end_forces: expected finite numbers, got nan of element 0",
        ),
        (
            {"end_forces": lambda self, *_: jnp.where(self.stiffness > 2.5, jnp.inf, 1.0) * W},
            "end_forces: expected finite numbers, got inf of element 1",
        ),
        (
            {"energy": lambda self, *_: jnp.log(-self.stiffness)},
            "energy: expected finite numbers, got nan of element 0",
        ),
        ({"end_forces": root}, "tangent before any motion: expected finite numbers, got"),
        (
            {"tangent": lambda self, *_: jnp.full((6, 6), jnp.nan)},
            "tangent: expected finite numbers, got nan of element 0",
        ),
        (
            {"tangent": lambda self, *_: jnp.zeros((2, 3))},
            "tangent: expected an array of shape (2, 3, 2, 3) of floats for an element, got shape "
            "(2, 3)",
        ),
        (
            {"tangent": lambda self, *_: jnp.zeros((3, 3))},
            "tangent: expected an array of shape (2, 3, 2, 3) of floats for an element, got shape "
            "(3, 3)",
        ),
        (
            {"tangent": lambda self, *_: (1.0, 2.0)},
            "tangent: expected an array of shape (2, 3, 2, 3) of floats for an element, got a",
        ),
        (
            {"end_forces": lambda self, *_: jnp.zeros((3, 2))},
            "end_forces: expected an array of shape (2, 3) of floats for an element, got shape "
            "(3, 2)",
        ),
        (
            {"end_forces": lambda self, *_: (jnp.zeros(3), jnp.zeros(3))},
            "end_forces: expected an array of shape (2, 3) of floats for an element, got a tuple",
        ),
        (
            {"end_forces": lambda self, *_: jnp.zeros((2, 3), int)},
            "end_forces: expected an array of shape (2, 3) of floats for an element, got int",
        ),
        (
            {"end_forces": lambda self, state, ends, motion: motion @ jnp.zeros(2)},
            "end_forces: expected an array of shape (2, 3) of floats for an element, got TypeError",
        ),
        (
            {"energy": lambda self, *_: jnp.zeros(1)},
            "energy: expected a scalar of floats for an element, got shape (1,)",
        ),
        ({"energy": lambda self, *_: None}, "energy: expected a scalar of floats for an element"),
        ({"start": lambda self, ends: {}}, "start: expected an `ElementState`, got dict"),
        (
            {"start": lambda self, ends: ends.wobble},
            "start: expected an `ElementState`, got AttributeError: ",
        ),
        (
            {"is_slack": lambda self, *_: jnp.zeros(2, bool)},
            "is_slack: expected a bool of an element, got bool (2,)",
        ),
        (
            {"results": (Result("pull", "N"),), "pull": lambda self, *_: self.wobble},
            "results: pull: expected an array, got AttributeError: ",
        ),
        (
            {"results": (Result("pull", "N"),), "pull": lambda self, *_: "much"},
            "results: pull: expected an array",
        ),
        (
            {"end_forces_about": lambda self, *_: jnp.zeros((1, 3))},
            "end_forces_about: expected an array of shape (2, 3) of floats for an element, got",
        ),
        (
            {"per_element": ("stiffness", "softness"), "softness": None},
            "per_element: expected fields of the class, `name: object` in its body, got 'softness'",
        ),
    ],
)
def test_wrong_methods_are_named(changes, sentence):
    text = said(springs(**changes))
    assert any(part.startswith(sentence) for part in text.split("; ")), text


W = np.ones((2, 3))


def assigned(name, value):
    """A `__post_init__` that keeps an array which is no field."""

    def post_init(self):
        object.__setattr__(self, "links", Indices(self.links))
        object.__setattr__(self, name, value)

    return post_init


@pytest.mark.parametrize("value", [np.ones(2), [np.ones(2)], {"a": np.ones(2)}])
def test_arrays_that_are_no_fields_are_named(value):
    """Which an analysis would lose: jax puts an object together from its fields."""
    group = springs(__post_init__=assigned("softness", value))
    again = jax.tree.unflatten(jax.tree.structure(group), jax.tree.leaves(group))
    assert not hasattr(again, "softness")
    assert said(group).startswith("softness: expected arrays of Own to be fields of the class")


def test_arrays_of_a_state_that_are_no_fields_are_named():
    @pytree
    class Lossy(Nothing):
        def __post_init__(self):
            object.__setattr__(self, "past", jnp.ones(2))

    group = springs(start=lambda self, ends: Lossy())
    assert said(group).startswith("past: expected arrays of Lossy to be fields of the class")


def test_static_fields_with_arrays_are_named():
    group = springs(decorate=pytree(indices=("links",), static=("stiffness",)))
    assert "stiffness: expected static fields without arrays, got an array of shape (2,)" in said(
        group
    )


def test_links_are_checked():
    assert said(springs(bare=True)).startswith(
        "links: expected `Indices` of node numbers [n_elem, n_end] (`Indices(links)` in "
        "`__post_init__`), got a bare "
    )
    for links, sentence in (
        ([0, 1], "links: expected whole numbers [n_elem, n_end], got int64 of shape (2,)"),
        (
            [[0.0, 1.0]],
            "links: expected whole numbers [n_elem, n_end], got float64 of shape (1, 2)",
        ),
        ([[0, 1], [1, 3]], "links: expected node numbers from 0 to 2, got 0 to 3"),
        ([[0, 1], [1, -1]], "links: expected node numbers from 0 to 2, got -1 to 1"),
    ):
        assert said(type(springs())(links, np.array([2.0, 3.0]))) == sentence
    other = pytree(static=("links",))
    assert said(springs(decorate=other)).startswith("links: expected an index field")


def test_a_class_without_the_decorator_is_named():
    class Own(Springs):
        links = Indices([[0, 1]])
        stiffness = np.ones(1)

    assert said(Own()).startswith('class: expected a `@pytree(indices=("links",))` class')


def test_a_second_sentence_is_told_too():
    group = springs(
        tangent=lambda self, *_: jnp.full((6, 6), jnp.inf), is_slack=lambda self, *_: jnp.zeros(2)
    )
    text = said(group)
    assert "tangent: expected finite numbers" in text and "; is_slack: expected a bool" in text
