"""An element written outside of the package, against its contract: a rope over a saddle.

It slides with Coulomb friction, or is held by a clamp; phases state which, by inputs of its
own. Source of the friction: Euler (1769), ``N1 <= N2 exp(mu alpha)``.
"""

import jax.numpy as jnp
import numpy as np

from jaxcable.extend import (
    ElementState,
    Indices,
    PhaseInput,
    Prestressable,
    Result,
    Rule,
    copy_with,
    floats_per_element,
    not_negative,
    positive,
    pytree,
    refuse_if_broken,
    register,
    set_fields,
)


def _open_or_closed(name, values):
    return Rule(name, values, lambda v: (v != 0) & (v != 1), "a clamp is open, 0, or closed, 1")


@pytree
class Laid(ElementState):
    """A rope on its saddle; arrays [n_elem].

    Attributes:
        friction, clamped: as they are stated.
        rest_length: unstressed length of the whole rope, m.
        memory: what part of it has slid onto the first side.
    """

    friction: object
    clamped: object
    rest_length: object = None  # `ElementState` gives it this default
    memory: object = None
    present: object = None


@register
@pytree(indices=("links",))
class Saddles(Prestressable):
    """Taut ropes that go over a saddle, which is a node: each has a force on either side.

    Args:
        links: one end, the saddle, the other end, [n_elem, 3].
        stiffness: EA, scalar or [n_elem], N.
    """

    links: object
    stiffness: object

    per_element = ("stiffness",)
    results = (Result("rope_forces", "N", ("first", "last")),)
    has_memory = True
    symmetric = False  # where it slides, one side has the force of the other times a number
    phase_inputs = (
        "pretension",
        PhaseInput("friction", "-", ramped=False, rules=(not_negative,)),
        PhaseInput("clamped", "-", ramped=False, rules=(_open_or_closed,)),
    )

    def __post_init__(self):
        if not isinstance(self.links, Indices):
            set_fields(self, links=Indices(np.asarray(self.links, np.int32)))
        own = floats_per_element(self.stiffness, len(self.links), "stiffness")
        set_fields(self, stiffness=own)
        refuse_if_broken(self.rules())

    def rules(self):
        return [positive("stiffness", self.stiffness)]

    # --- the group

    def start(self, ends):
        length = jnp.sum(_sides(ends)[1], axis=-1)
        zero = jnp.zeros_like(length)
        return Laid(zero, zero, length, self.initial_memory())

    def initial_memory(self):
        return jnp.zeros(len(self.links))

    def apply_phase_inputs(self, state, ends, inputs):
        changes = {
            name: inputs[name].select(inputs[name].values, getattr(state, name))
            for name in ("friction", "clamped")
            if name in inputs
        }
        if "pretension" in inputs:
            stated = inputs["pretension"]
            length = jnp.sum(_sides(ends)[1], axis=-1)
            rest = length / (1 + stated.values / self.stiffness)
            changes["rest_length"] = stated.select(rest, state.rest_length)
        return copy_with(state, **changes)

    # --- one element

    def _first(self, state, ends, motion):
        """Unstressed length on the first side, which friction or a clamp allows, m."""
        before, (way, length) = _sides(ends)[1], _sides(ends + motion)
        lies = state.rest_length * (before[0] / jnp.sum(before) + state.memory)
        one, other = way / length[:, None]
        across = jnp.cross(one, other)
        turn = jnp.arctan2(jnp.sqrt(across @ across), one @ other)
        most = jnp.exp(state.friction * turn)
        first, last = self._forces(state, length, lies)
        onto = jnp.where(first > most * last, _balanced(length, state.rest_length, most), lies)
        off = _balanced(length, state.rest_length, 1 / most)
        slid = jnp.where(last > most * first, off, onto)
        return jnp.where(state.clamped > 0, lies, slid), length, way

    def _forces(self, state, length, first):
        rest = jnp.stack([first, state.rest_length - first])
        return self.stiffness * (length - rest) / rest

    def rope_forces(self, state, ends, motion):
        """Forces of the rope on its first and its last side, [2], N."""
        first, length, _ = self._first(state, ends, motion)
        return self._forces(state, length, first)

    def end_forces(self, state, ends, motion):
        first, length, way = self._first(state, ends, motion)
        one, other = (self._forces(state, length, first) / length)[:, None] * way
        return jnp.stack([-one, one - other, other])

    def energy(self, state, ends, motion):
        first, length, _ = self._first(state, ends, motion)
        rest = jnp.stack([first, state.rest_length - first])
        return 0.5 * jnp.sum(self._forces(state, length, first) ** 2 * rest) / self.stiffness

    def absolute_force(self, state, ends, motion):
        return jnp.sum(jnp.abs(self.rope_forces(state, ends, motion)))

    def committed_memory(self, state, ends, motion, duration=0.0):
        before = _sides(ends)[1]
        first = self._first(state, ends, motion)[0]
        return first / state.rest_length - before[0] / jnp.sum(before)

    def state_at_activation(self, state, ends, motion):
        before, length = _sides(ends)[1], _sides(ends + motion)[1]
        memory = length[0] / jnp.sum(length) - before[0] / jnp.sum(before)
        return copy_with(state, rest_length=jnp.sum(length), memory=memory)


def _sides(places):
    """Vectors and lengths of the two sides of ropes at positions [..., 3, 3]."""
    way = places[..., 1:, :] - places[..., :-1, :]
    return way, jnp.sqrt(jnp.sum(way**2, axis=-1))


def _balanced(length, rest, ratio):
    """The unstressed length on the first side where its force is `ratio` times the other one.

    The root of ``(1 - k) s^2 - b s + l1 L0 = 0`` with ``b = l1 + L0 + k (l2 - L0)``.
    """
    b, c = length[0] + rest + ratio * (length[1] - rest), length[0] * rest
    return 2 * c / (b + jnp.sqrt(b**2 - 4 * (1 - ratio) * c))
