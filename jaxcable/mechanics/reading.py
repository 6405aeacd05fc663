"""What is read off a point of equilibrium: every element evaluated once for all that is asked."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import copy, pytree
from ..common.types import Array, Int
from ..spaces.space import Motion
from .assembly import System
from .elementwise import PerGroup


@pytree(static=("of_ends", "of_increments"))
class Reading:
    """Results of all elements at one point.

    Attributes:
        found: by name of `elements.element.Result` a list with an item a group, None where it has
            no such result; and ``end_forces``.
        n_slack: number of slack elements.
        n_loose: number of nodes that only slack elements touch.
        of_ends, of_increments: names of what is kept at the ends of phases, and of increments.
    """

    found: dict[str, PerGroup]
    n_slack: Int[Array, ""]
    n_loose: Int[Array, ""]
    of_ends: tuple[str, ...]
    of_increments: tuple[str, ...]

    @property
    def strains(self) -> PerGroup:
        """Strains of what has fibres or a law, a list with an item a group."""
        return self.found["section_strain"]

    @property
    def of_path(self) -> Reading:
        """What is kept of every increment."""
        return copy(self, found={name: self.found[name] for name in self.of_increments})


def read(system: System, motion: Motion) -> Reading:
    """The `Reading` of a system in a motion of all rows."""
    results = system.results()
    found = system.reading(motion, *results, "end_forces", "is_slack")
    slack = found.pop("is_slack")
    n_slack = sum(jnp.sum(own) for own in slack)
    n_loose = jnp.sum(system.loose_nodes(motion, slack))
    return Reading(
        found,
        n_slack.astype(jnp.int32),
        n_loose.astype(jnp.int32),
        of_ends=tuple(name for name, own in results.items() if own.ends),
        of_increments=tuple(name for name, own in results.items() if own.increments),
    )
