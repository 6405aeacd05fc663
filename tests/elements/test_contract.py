"""The contract of elements: what keeps it, and what `jc.elements.check` says of what does not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from extensions import own_links
from extensions.own_elements import GroundSprings, Nothing, TurningSprings
from extensions.own_links import Brittle, Dampers
from extensions.own_membrane import Cloth, Membranes
from extensions.own_saddle import Saddles
from model.messages import rows

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
        own_links.Hooks([[0, 1], [2, 1]], 1e3, -0.2),
        Brittle([[0, 1]], 1e3, 2.0),
        own_links.Thrusters([[0, 1]], 10.0, 3.0),
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


PULL = (Result("pull", "N"),)
NAN = jnp.full((6, 6), jnp.nan)


def changed(base, states=(), **members):
    """What the check says of a class of `extensions` of which some members are changed."""
    given = {Dampers: ([[0, 1]], 10.0), Cloth: ([[0, 1, 2]], 1e4)}
    made = given.get(base, ([[1]], np.array([3.0])))
    check(pytree(indices=("links",))(type("Own", (base,), members))(*made), NODES, *states)


def cloth(values):
    """Cloth that applies inputs by a function of them."""
    stress = copy_with(Cloth([[0, 1, 2]], 1e4).start(NODES[None, :3]), stress=jnp.ones((1, 2)))

    def apply(self, state, ends, stated):
        return copy_with(state, stress=values(stated))

    changed(Cloth, [stress], apply_phase_inputs=apply)


def tried(**changes):
    check(springs(**changes), NODES[:3])


DEFECTS = rows("""
tried(end_forces=returns(NAN[:2, :3]))
    # ...end_forces: expected finite numbers, got nan of element 0
tried(end_forces=lambda self, *_: jnp.where(self.stiffness > 2.5, jnp.inf, jnp.ones((2, 3))))
    # ...end_forces: expected finite numbers, got inf of element 1
tried(energy=returns(NAN[0, 0]))  # ...energy: expected finite numbers, got nan of element 0
tried(end_forces=root)  # ...tangent before any motion: expected finite numbers, got
tried(tangent=returns(NAN))  # ...tangent: expected finite numbers, got nan of element 0
tried(tangent=returns(jnp.zeros((3, 3))))
    # ...tangent: expected an array of shape (2, 3, 2, 3) of floats for an element, got shape (3, 3)
tried(tangent=returns((1.0, 2.0)))
    # ...tangent: expected an array of shape (2, 3, 2, 3) of floats for an element, got a
tried(end_forces=returns(jnp.zeros((3, 2))))
    # ...end_forces: expected an array of shape (2, 3) of floats for an element, got shape (3, 2)
tried(end_forces=returns(jnp.zeros((2, 3), int)))
    # ...end_forces: expected an array of shape (2, 3) of floats for an element, got int
tried(end_forces=lambda self, s, e, motion: motion @ jnp.zeros(2))
    # ...end_forces: expected an array of shape (2, 3) of floats for an element, got TypeError
tried(energy=returns(jnp.zeros(1)))  # ...energy: expected a scalar of floats for an element, got
tried(energy=returns(None))  # ...energy: expected a scalar of floats for an element
tried(start=returns({}))  # ...start: expected an `ElementState`, got dict
tried(start=wobbly)  # ...start: expected an `ElementState`, got AttributeError:
tried(is_slack=returns(jnp.zeros(2, bool)))  # ...is_slack: expected a bool of an element, got boo
tried(tangent=returns(NAN), is_slack=returns(jnp.zeros(2)))
    # ...tangent: expected finite numbers...; is_slack: expected a bool
tried(results=("tension",))  # ...results: expected `Result`, got 'tension'
tried(results=PULL, pull=wobbly)  # ...results: pull: expected an array, got AttributeError:
tried(results=PULL, pull=returns("much"))  # ...results: pull: expected an array
tried(end_forces_after_step=returns(jnp.zeros((1, 3))))
    # ...end_forces_after_step: expected an array of shape (2, 3) of
tried(per_element=("stiffness", "softness"), softness=None)
    # ...per_element: expected fields of the class, `name: object` in its body, got 'softness'
tried(decorate=pytree(indices=("links",), static=("stiffness",)))
    # ...stiffness: expected static fields without arrays, got an array of shape (2,)
tried(decorate=pytree(static=("links",)))  # Own: links: expected an index field
tried(bare=True)
    # Own: links: expected `Indices` of node numbers [n_elem, n_end] (`Indices(links)` in
    `__post_init__`), got a bare
tried(links=[0, 1])  # Own: links: expected whole numbers [n_elem, n_end], got int64 of shape (2,)
tried(links=[[0.0, 1.0]])
    # Own: links: expected whole numbers [n_elem, n_end], got float64 of shape (1, 2)
tried(links=[[0, 1], [1, 3]])  # Own: links: expected node numbers from 0 to 2, got 0 to 3
tried(links=[[0, 1], [1, -1]])  # Own: links: expected node numbers from 0 to 2, got -1 to 1
check(type("Own", (Springs,), {"links": None, "stiffness": np.ones(1)})(), NODES[:3])
    # Own: class: expected a `@pytree(indices=("links",))` class
check(own_links.Lying([[0, 1]], 10.0, 3.0), NODES)
    # Lying: ...energy: the end forces are not its gradient
check(own_links.Lying([[0, 1]], 10.0, 3.0), NODES)
    # Lying: symmetric: its tangent is not ... symmetric = F
check(own_links.Jacks([[0, 1]], 1e3), NODES)
    # Jacks: Jackable: its state needs a field `jack_force`
jc.Structure(NODES, {"own": careless()}, jc.pinned([0]))
    # elements['own'] (Careless): has_rupture = True needs ...`is

changed(Dampers, has_memory=False)
    # ...committed_memory: it is only asked where has_memory = True
changed(Dampers, committed_memory=lambda self, state, ends, motion, duration=0.0: motion)
    # ...committed_memory: expected a memory like that of the state
changed(Dampers, committed_memory=lambda self, state, ends, motion: state.memory)
    # ...committed_memory: expected a memory like that of the state, got TypeError
changed(Dampers, state_at_activation=lambda self, s, ends, motion: copy_with(s, memory=motion))
    # ...state_at_activation: expected a state like ...`start`, got `memory` ... (1, 2, 3)
changed(Dampers, state_at_activation=returns(None))
    # ...state_at_activation: expected a state like ...`start`, got None
cloth(lambda s: s["pretension"].values)
    # ...apply_phase_inputs: pretension: ... got other numbers; take `stated.select
cloth(lambda s: s["pretension"].values[:, 0])
    # ...apply_phase_inputs: pretension: ... got `stress` float64 of shape (1,)
cloth(lambda s: s["stress"].values)  # ...apply_phase_inputs: pretension: ... got KeyError: 'stress'
changed(TurningSprings, _moment=lambda self, motion: self.stiffness * 2 * motion[0, 4:])
    # ...end_forces: other forces for the quaternions q and -q
""")


def careless():
    class Careless(Brittle):
        is_ruptured = Element.is_ruptured

    return Careless([[0, 1]], 1e3)


@pytest.mark.parametrize(("call", "message"), DEFECTS, ids=[call[:60] for call, _ in DEFECTS])
def test_each_defect_has_a_sentence(call, message):
    with pytest.raises(ValueError, match=message):
        eval(call, globals())


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
