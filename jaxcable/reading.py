"""What is read off a point of equilibrium: every element evaluated once for all that is asked."""

import jax.numpy as jnp

from ._tree import copy, pytree


@pytree
class Reading:
    """Results of all elements at one point, lists with an item a group, None where it has none.

    Attributes:
        tension, peak_tension, section_strain, end_forces, section_forces: see `elements`.
        n_slack: number of slack elements.
        n_loose: number of nodes that only slack elements touch.
    """

    tension: object
    peak_tension: object
    section_strain: object
    end_forces: object
    section_forces: object
    n_slack: object
    n_loose: object

    @property
    def of_path(self):
        """What is kept of every increment."""
        return copy(self, end_forces=None, section_forces=None)


RESULTS = ("tension", "peak_tension", "section_strain", "end_forces", "section_forces")


def read(system, motion):
    """The `Reading` of a system in a motion of all rows."""
    names = RESULTS if system.space.rotates else RESULTS[:-1]
    found = system.reading(motion, *names, "is_slack")
    slack = found.pop("is_slack")
    found.setdefault("section_forces", [None] * len(slack))
    n_slack = sum(jnp.sum(own) for own in slack)
    n_loose = jnp.sum(system.loose_nodes(motion, slack))
    return Reading(**found, n_slack=n_slack.astype(jnp.int32), n_loose=n_loose.astype(jnp.int32))
