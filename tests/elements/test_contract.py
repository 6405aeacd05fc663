"""The contract of elements: what keeps it, and what `jc.elements.check` says of what does not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from extensions.own_elements import GroundSprings, Nothing, TurningSprings
from extensions.own_links import Brittle, Dampers, Hooks, Jacks, Lying, Thrusters
from extensions.own_membrane import Cloth, Membranes
from extensions.own_saddle import Saddles

import jaxcable as jc
from jaxcable.common.tree import Indices, copy_with, pytree
from jaxcable.elements import abilities, check
from jaxcable.elements.element import Element, Result

# --- classes that keep the contract, and those that do not

NODES = np.array([[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0], [0.0, 4.0, 3.0]])


@pytest.mark.quick_cases("GroundContacts", "Contacts", "SlidingCables")
@pytest.mark.parametrize(
    "group",
    [
        GroundSprings([[1], [2]], np.array([[3.0, 2.0, 5.0]] * 2)),
        TurningSprings([[1], [2]], np.array([3.0, 4.0])),
        Membranes([[0, 1, 2], [1, 2, 3]], 1e4, 0.3, weight=3.0),
        Hooks([[0, 1], [2, 1]], 1e3, -0.2),
        Brittle([[0, 1]], 1e3, 2.0),
        Thrusters([[0, 1]], 10.0, 3.0),
        Dampers([[0, 1], [1, 2]], 10.0),
        Cloth([[0, 1, 2]], 1e4, 0.3),
        Saddles([[0, 1, 2]], 1e4),
        jc.SlidingCables([[0, 1, 2]], axial_stiffness=1e3, rest_length=9.9, expansion=1e-5),
        jc.Catenaries([[0, 2]], axial_stiffness=1e5, weight=2.0, rest_length=8.5),
        jc.Beams([[0, 1]], section=jc.Section.rectangle(0.1, 0.1, jc.Elastic(1e9))),
        jc.Cables([[0, 1]], axial_stiffness=1e3, rest_length=0.9),
        jc.Contacts([[0, 1]], axial_stiffness=1e3, gap=-0.1),
        jc.Springs([1, 2], (3.0, 2.0, 5.0), (4.0, 7.0, 1.0), preload=(1.0, 2.0, 3.0)),
        jc.GroundContacts([1, 2], 5.0, (1.0, 2.0, 3.0), gap=-0.1),
    ],
    ids=lambda g: type(g).__name__,
)
def test_elements_keep_their_contract(group):
    """What does not keep it raises ValueError, as the tests below show."""
    assert check(group, NODES) is None


def test_what_does_not_keep_the_contract_is_told():
    with pytest.raises(ValueError, match="energy: the end forces are not its gradient") as raised:
        check(Lying([[0, 1]], 10.0, 3.0), NODES)
    assert raised.match(r"Lying: symmetric: its tangent is not .* symmetric = F")
    with pytest.raises(ValueError, match="Jacks: Jackable: its state needs a field `jack_force`"):
        check(Jacks([[0, 1]], 1e3), NODES)

    class Careless(Brittle):
        is_ruptured = Element.is_ruptured

    group, text = (
        Careless([[0, 1]], 1e3),
        r"elements\['own'\] \(Careless\): has_rupture = True needs .*`is",
    )
    with pytest.raises(ValueError, match=text):
        jc.Structure(NODES[:2], {"own": group}, jc.pinned([0]))


def test_an_ability_has_abstract_methods():
    with pytest.raises(TypeError, match=r"abstract method '?tension"):

        class Untold(abilities.Jackable):
            start = apply_phase_inputs = lock_off = end_forces = energy = None

        Untold()


# --- each defect has a sentence


PAIRS = [[0, 1], [1, 2]]


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


def springs(decorate=None, bare=False, links=PAIRS, **changes):
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
    return cls(links, np.array([2.0, 3.0]))


def said(group):
    """What the check says, without the name of the class."""
    with pytest.raises(ValueError, match=r"^Own: ") as raised:
        check(group, NODES[:3])
    return str(raised.value).removeprefix("Own: ")


@pytest.mark.slow
def test_one_that_is_right_is_not_told():
    assert check(springs(), NODES[:3]) is None
    field = springs(results=PULL, pull=lambda self, *_: self.stiffness)
    assert check(field, NODES[:3]) is None


def returns(value):
    """A method that returns this."""
    return lambda self, *_: value


def root(self, state, ends, motion):
    """Finite where nodes have moved, and without a derivative where they have not."""
    return jnp.sqrt(jnp.abs(motion)) + Springs.end_forces(self, state, ends, motion)


def wobbly(self, *_):
    """A method that asks for what is not there."""
    return self.wobble


FINITE, ARRAY = "expected finite numbers, got", "expected an array of shape"
FORCES = f"end_forces: {ARRAY} (2, 3) of floats for an element, got"
TANGENT = f"tangent: {ARRAY} (2, 3, 2, 3) of floats for an element, got"
STATE = "start: expected an `ElementState`, got"
PULL = (Result("pull", "N"),)
NAN = jnp.full((6, 6), jnp.nan)
DEFECTS = [
    ({"end_forces": returns(NAN[:2, :3])}, f"end_forces: {FINITE} nan of element 0"),
    (
        {"end_forces": lambda self, *_: jnp.where(self.stiffness > 2.5, jnp.inf, jnp.ones((2, 3)))},
        f"end_forces: {FINITE} inf of element 1",
    ),
    ({"energy": returns(NAN[0, 0])}, f"energy: {FINITE} nan of element 0"),
    ({"end_forces": root}, f"tangent before any motion: {FINITE}"),
    ({"tangent": returns(NAN)}, f"tangent: {FINITE} nan of element 0"),
    ({"tangent": returns(jnp.zeros((3, 3)))}, f"{TANGENT} shape (3, 3)"),
    ({"tangent": returns((1.0, 2.0))}, f"{TANGENT} a"),
    ({"end_forces": returns(jnp.zeros((3, 2)))}, f"{FORCES} shape (3, 2)"),
    ({"end_forces": returns(jnp.zeros((2, 3), int))}, f"{FORCES} int"),
    ({"end_forces": lambda self, s, e, motion: motion @ jnp.zeros(2)}, f"{FORCES} TypeError"),
    ({"energy": returns(jnp.zeros(1))}, "energy: expected a scalar of floats for an element, got"),
    ({"energy": returns(None)}, "energy: expected a scalar of floats for an element"),
    ({"start": returns({})}, f"{STATE} dict"),
    ({"start": wobbly}, f"{STATE} AttributeError: "),
    ({"is_slack": returns(jnp.zeros(2, bool))}, "is_slack: expected a bool of an element, got boo"),
    ({"results": PULL, "pull": wobbly}, "results: pull: expected an array, got AttributeError: "),
    ({"results": PULL, "pull": returns("much")}, "results: pull: expected an array"),
    (
        {"end_forces_after_step": returns(jnp.zeros((1, 3)))},
        f"end_forces_after_step: {ARRAY} (2, 3) of",
    ),
    (
        {"per_element": ("stiffness", "softness"), "softness": None},
        "per_element: expected fields of the class, `name: object` in its body, got 'softness'",
    ),
]


def stressed_by(values):
    """How cloth applies inputs, by a function of them."""
    return {"apply_phase_inputs": lambda self, state, ends, s: copy_with(state, stress=values(s))}


def two_sided_moment(self, motion):
    """A moment that has the sign of the quaternion."""
    return self.stiffness * 2 * motion[0, 4:]


MEMORY = "committed_memory: expected a memory like that of the state"
STATED = "apply_phase_inputs: pretension: .* got"
ADDED = "state_at_activation: expected a state like .*`start`, got"
CHANGED = {  # of the contract: a class, members of it that are changed, and the sentence
    "no memory": (
        Dampers,
        {"has_memory": False},
        "committed_memory: it is only asked where has_memory = True",
    ),
    "memory of another shape": (
        Dampers,
        {"committed_memory": lambda self, state, ends, motion, duration=0.0: motion},
        MEMORY,
    ),
    "no duration": (
        Dampers,
        {"committed_memory": lambda self, state, ends, motion: state.memory},
        f"{MEMORY}, got TypeError",
    ),
    "added with a memory of another shape": (
        Dampers,
        {"state_at_activation": lambda self, state, ends, motion: copy_with(state, memory=motion)},
        rf"{ADDED} `memory` .* \(1, 2, 3\)",
    ),
    "added without a state": (Dampers, {"state_at_activation": returns(None)}, f"{ADDED} None"),
    "values of some for all": (
        Cloth,
        stressed_by(lambda s: s["pretension"].values),
        f"{STATED} other numbers; take `stated.select",
    ),
    "one component": (
        Cloth,
        stressed_by(lambda s: s["pretension"].values[:, 0]),
        rf"{STATED} `stress` float64 of shape \(1,\)",
    ),
    "another name": (
        Cloth,
        stressed_by(lambda s: s["stress"].values),
        f"{STATED} KeyError: 'stress'",
    ),
    "quaternions of two signs": (
        TurningSprings,
        {"_moment": two_sided_moment},
        "end_forces: other forces for the quaternions q and -q",
    ),
}
MADE = {
    Dampers: ([[0, 1]], 10.0),
    Cloth: ([[0, 1, 2]], 1e4),
    TurningSprings: ([[1]], np.array([3.0])),
}


@pytest.mark.slow_cases("values of some for all", "quaternions of two signs")
@pytest.mark.parametrize("name", CHANGED)
def test_what_a_class_changes_is_tried(name):
    base, members, sentence = CHANGED[name]
    group = pytree(indices=("links",))(type("Own", (base,), members))(*MADE[base])
    states = []
    if base is Cloth:
        stress = jnp.array([[3.0, 2.0]])
        states = [copy_with(group.start(NODES[None, :3]), stress=stress)]
    with pytest.raises(ValueError, match=sentence):
        check(group, NODES, *states)


def test_results_are_objects():
    with pytest.raises(ValueError, match=r"results: expected `Result`, got 'tension'"):
        check(springs(results=("tension",)), NODES[:3])


@pytest.mark.slow_cases("changes3-tangent before any motion: expected finite numbers, got")
@pytest.mark.parametrize(("changes", "sentence"), DEFECTS)
def test_wrong_methods_are_named(changes, sentence):
    parts = said(springs(**changes)).split("; ")
    assert any(part.startswith(sentence) for part in parts), parts


def test_a_second_sentence_is_told_too():
    text = said(springs(tangent=returns(NAN), is_slack=returns(jnp.zeros(2))))
    assert f"tangent: {FINITE}" in text and "; is_slack: expected a bool" in text


def keeping(value):
    """A `__post_init__` that keeps an array which is no field."""

    def post_init(self):
        object.__setattr__(self, "past", value)
        if hasattr(self, "links"):
            object.__setattr__(self, "links", Indices(self.links))

    return post_init


@pytest.mark.parametrize("value", [np.ones(2), [np.ones(2)], {"a": np.ones(2)}])
def test_arrays_that_are_no_fields_are_named(value):
    """Which an analysis would lose: jax puts an object together from its fields."""
    group = springs(__post_init__=keeping(value))
    again = jax.tree.unflatten(jax.tree.structure(group), jax.tree.leaves(group))
    assert not hasattr(again, "past")
    assert said(group).startswith("past: expected arrays of Own to be fields of the class")
    lossy = pytree(type("Lossy", (Nothing,), {"__post_init__": keeping(value)}))
    found = said(springs(start=lambda self, ends: lossy()))
    assert found.startswith("past: expected arrays of Lossy to be fields of the class")


def test_fields_of_the_wrong_kind_are_named():
    static = springs(decorate=pytree(indices=("links",), static=("stiffness",)))
    assert "stiffness: expected static fields without arrays, got an array of shape (2,)" in said(
        static
    )
    plain = type("Own", (Springs,), {"links": Indices([[0, 1]]), "stiffness": np.ones(1)})
    assert said(plain()).startswith('class: expected a `@pytree(indices=("links",))` class')
    other = springs(decorate=pytree(static=("links",)))
    assert said(other).startswith("links: expected an index field")
    wanted = "links: expected `Indices` of node numbers [n_elem, n_end] (`Indices(links)` in "
    assert said(springs(bare=True)).startswith(f"{wanted}`__post_init__`), got a bare ")


@pytest.mark.parametrize(
    ("links", "sentence"),
    [
        ([0, 1], "whole numbers [n_elem, n_end], got int64 of shape (2,)"),
        ([[0.0, 1.0]], "whole numbers [n_elem, n_end], got float64 of shape (1, 2)"),
        ([[0, 1], [1, 3]], "node numbers from 0 to 2, got 0 to 3"),
        ([[0, 1], [1, -1]], "node numbers from 0 to 2, got -1 to 1"),
    ],
)
def test_links_are_checked(links, sentence):
    assert said(springs(links=links)) == f"links: expected {sentence}"
