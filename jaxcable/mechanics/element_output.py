"""Output of all elements at a point: each is evaluated once for all of its results."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import copy_with, pytree
from ..common.types import Array, Int
from ..spaces.space import Motion
from .assembly import System
from .elementwise import PerGroup


@pytree(static=("of_ends", "of_increments"))
class ElementOutput:
    """Results of all elements at one point of equilibrium.

    Attributes:
        by_name: by the name of a `Result`, and of ``end_forces``, a list with an array per group;
            None for a group without this result.
        n_slack: number of slack elements.
        n_loose: number of free nodes without stiffness, at which all elements are slack.
        of_ends, of_increments: names of the results that are kept at the ends of phases, and of
            increments.
    """

    by_name: dict[str, PerGroup]
    n_slack: Int[Array, ""]
    n_loose: Int[Array, ""]
    of_ends: tuple[str, ...]
    of_increments: tuple[str, ...]

    @property
    def strains(self) -> PerGroup | None:
        """Section strains: a list with an array per group, or None; None if no group has any."""
        return self.by_name.get("section_strain")

    @property
    def increment_results(self) -> ElementOutput:
        """Output with only those results that an analysis keeps of every increment."""
        return copy_with(self, by_name={name: self.by_name[name] for name in self.of_increments})


def evaluate_output(system: System, motion: Motion) -> ElementOutput:
    """Evaluate all results of elements at a motion of all rows, each element once.

    Return them as `ElementOutput`, with the numbers of slack elements and of loose nodes.
    """
    results = system.results()
    found = system.results_by_name(motion, *results, "end_forces", "is_slack")
    slack = found.pop("is_slack")
    n_slack = sum(jnp.sum(flags) for flags in slack)
    n_loose = jnp.sum(system.nodes_without_stiffness(motion, slack))
    return ElementOutput(
        found,
        n_slack.astype(jnp.int32),
        n_loose.astype(jnp.int32),
        of_ends=tuple(name for name, result in results.items() if result.ends),
        of_increments=tuple(name for name, result in results.items() if result.increments),
    )
