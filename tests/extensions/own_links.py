"""Elements written outside of the package that use little of its contract; one unsymmetric."""

import jax
import jax.numpy as jnp
import numpy as np
from extensions.own_elements import Nothing

from jaxcable.extend import (
    SECTION_STRAIN,
    TENSION,
    Element,
    ElementState,
    Indices,
    Jackable,
    copy_with,
    floats_per_element,
    pytree,
    register,
    set_fields,
)


@pytree
class Long(ElementState):
    """Only what `has_length` asks for."""

    rest_length: object


class Joined(Element):
    """Two nodes and a stiffness; what `__post_init__` does for all of them."""

    per_element = ("stiffness", "weight")

    def __post_init__(self):
        if not isinstance(self.links, Indices):
            set_fields(self, links=Indices(np.asarray(self.links, np.int32)))
        for name in self.per_element:
            own = floats_per_element(getattr(self, name), len(self.links), name)
            set_fields(self, **{name: own})

    def start(self, ends):
        return Nothing()

    @staticmethod
    def _way(ends, motion):
        """Initial length, present length, present direction."""
        before, after = ends[1] - ends[0], ends[1] - ends[0] + motion[1] - motion[0]
        length = jnp.sqrt(after @ after)
        return jnp.sqrt(before @ before), length, after / length

    def end_forces(self, state, ends, motion):
        pull = self.tension(state, ends, motion) * self._way(ends, motion)[2]
        return jnp.stack([-pull, pull])


@register
@pytree(indices=("links",))
class Hooks(Joined):
    """Cables with a stiffness in N/m that begin with a given slack, m."""

    links: object
    stiffness: object
    slack: object = 0.0
    weight: object = None

    per_element = ("stiffness", "slack", "weight")
    results = (TENSION,)
    tension_only = monotone = True

    def _longer(self, ends, motion):
        before, after, _ = self._way(ends, motion)
        return after - before - self.slack

    def tension(self, state, ends, motion):
        return self.stiffness * jnp.maximum(self._longer(ends, motion), 0.0)

    def energy(self, state, ends, motion):
        return 0.5 * self.stiffness * jnp.maximum(self._longer(ends, motion), 0.0) ** 2

    def is_slack(self, state, ends, motion):
        return self._longer(ends, motion) <= 0

    def at_kink(self, state, ends, motion):
        return self._longer(ends, motion) == 0


@register
@pytree(indices=("links",))
class Brittle(Joined):
    """Bars of a stiffness EA that break at a strain of 1 %; their stress is not told."""

    links: object
    stiffness: object
    weight: object = None

    results = (TENSION, SECTION_STRAIN)
    has_rupture = has_length = True

    def start(self, ends):
        return Long(self.chord(ends))

    def weights(self, state):
        return None if self.weight is None else self.weight * state.rest_length

    def section_strain(self, state, ends, motion):
        before, after, _ = self._way(ends, motion)
        return after / before - 1

    def tension(self, state, ends, motion):
        return self.stiffness * self.section_strain(state, ends, motion)

    def energy(self, state, ends, motion):
        strain = self.section_strain(state, ends, motion)
        return 0.5 * self.stiffness * strain**2 * self._way(ends, motion)[0]

    def is_ruptured(self, strain):
        return strain > 0.01


@pytree(indices=("links",))
class Jacks(Brittle, Jackable):
    """Says that it can be jacked, and has a state without a jack force."""

    phase_inputs = ("jacking",)

    def apply_phase_inputs(self, state, ends, inputs):
        return state

    def lock_off(self, state, ends, motion):
        return state


@pytree(indices=("links",))
class Series(Joined):
    """Two springs, N/m, one behind the other; how long the first has become is an inner number."""

    links: object
    first: object
    second: object
    weight: object = None

    per_element = ("first", "second", "weight")
    results = (TENSION,)
    inner_unknowns = ((0, 0),)
    n_inner_row = 1

    def unused_columns(self):
        unused = np.ones((len(self.links), 1, 3), bool)
        unused[..., 0] = False
        return unused

    def _second(self, ends, motion):
        before, after, _ = self._way(ends, motion)
        return after - before - motion[2, 0]

    def tension(self, state, ends, motion):
        return self.second * self._second(ends, motion)

    def energy(self, state, ends, motion):
        first, second = motion[2, 0], self._second(ends, motion)
        return 0.5 * (self.first * first**2 + self.second * second**2)

    def end_forces(self, state, ends, motion):
        return jax.grad(self.energy, 2)(state, ends, motion)


@pytree
class Moved(ElementState):
    """Where the second end was against the first one, after the last increment."""

    memory: object
    present: object = None


@pytree(indices=("links",))
class Dampers(Joined):
    """Resist what an increment moves the second end against the first, in every direction.

    Their memory is a vector that no strain tells: ``committed_memory`` sees the motion.
    """

    links: object
    damping: object
    weight: object = None

    per_element = ("damping", "weight")
    has_memory = True

    def start(self, ends):
        return Moved(self.initial_memory())

    def initial_memory(self):
        return jnp.zeros((len(self.links), 3))

    def _pull(self, state, motion):
        return self.damping * (motion[1] - motion[0] - state.memory)

    def end_forces(self, state, ends, motion):
        pull = self._pull(state, motion)
        return jnp.stack([-pull, pull])

    def energy(self, state, ends, motion):
        return 0.5 * jnp.sum(self._pull(state, motion) ** 2) / self.damping

    def absolute_force(self, state, ends, motion):
        return jnp.sum(jnp.abs(self._pull(state, motion)))

    def committed_memory(self, state, ends, motion, duration=0.0):
        return motion[1] - motion[0]

    def state_at_activation(self, state, ends, motion):
        return copy_with(state, memory=motion[1] - motion[0])


@pytree(indices=("links",))
class Thrusters(Joined):
    """A spring at the second end in its initial place, and a thrust across the link there.

    The thrust stays in the plane x, y and normal to the link: a follower force without a potential.
    With the position z = x + i y of the second end from the first one, d before, in equilibrium:
    ``stiffness (z - d) = i thrust z / |z|``.
    """

    links: object
    stiffness: object
    thrust: object
    weight: object = None

    per_element = ("stiffness", "thrust", "weight")
    symmetric = False

    def end_forces(self, state, ends, motion):
        along = self._way(ends, motion)[2]
        push = self.thrust * jnp.stack([-along[1], along[0], jnp.zeros_like(along[0])])
        force = self.stiffness * motion[1] - push
        return jnp.stack([-force, force])

    def energy(self, state, ends, motion):
        return 0.5 * self.stiffness * jnp.sum(motion[1] ** 2)


@pytree(indices=("links",))
class Lying(Thrusters):
    """The same, said to be symmetric."""

    symmetric = True
