"""What a group of elements is: a base with what all have, and what some can do beside it.

An `Element` is a group; inside of vmap over its `properties` it is one element
(`prestress.element`). It knows nothing about nodes, numbering or solvers. Positions and motions are
those of its ends: ``ends`` the initial positions [n_end, 3], m; ``motion`` their displacements
[n_end, 3], or with rotations [n_end, 7], unit quaternions after them. A ``state`` is what phases
change.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Sequence
from typing import Any, ClassVar, Self, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..common.rules import Rule
from ..common.tree import Each
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..sections import Section

Scalar: TypeAlias = 'Float[Array, ""]'
Ends: TypeAlias = 'Float[Array, "n_end 3"]'
"""Initial positions of the ends of one element, m."""
Motion: TypeAlias = 'Float[Array, "n_end n_motion"]'
"""What one element sees of the motion."""
Forces: TypeAlias = 'Float[Array, "n_end n_freedom"]'
"""Forces at the ends of one element, and steps of these."""
OwnState: TypeAlias = Any
"""An `ElementState` of the element's own class. To a type checker it is anything: a class that
asks for its own state stands where any element may, as one that takes all states would."""


@dataclasses.dataclass(frozen=True)
class Result:
    """What an element tells of itself: the method of this name, of its state, ends and motion.

    Solutions, files, pictures and reports have it under this name.

    Attributes:
        name: of the method.
        unit: of its numbers.
        components: names of the numbers on its last axis; none if it is one number an element.
        ends, increments: whether it is kept at the ends of phases, and of every increment.
    """

    name: str
    unit: str
    components: tuple[str, ...] = ()
    ends: bool = True
    increments: bool = True


TENSION = Result("tension", "N")
"""Axial force; of an element along which it varies the mean."""
PEAK_TENSION = Result("peak_tension", "N")
"""Axial force of largest size along an element, where that is another one."""
SECTION_STRAIN = Result("section_strain", "-, 1/m", ends=False)
"""Strains of what has fibres, or a law that ends or remembers."""
SECTION_FORCES = Result(
    "section_forces", "N, N m", ("N", "Vy", "Vz", "T", "My", "Mz"), increments=False
)
"""Forces at places along an element, [n, 6]."""


Pressures: TypeAlias = 'dict[str, list[tuple[Float[Array, " n_elem"], Float[Array, "n_elem 3"]]]]'
"""What presses on beams: by the name of the length that it is per, pressures and unit axes."""


class ElementState:
    """What phases change in a group: a pytree, its arrays with an axis [n_elem].

    What a kind of element has not is None; see `prestress.AxialState` for what these are.
    """

    rest_length: Float[Array, " n_elem"] | None = None
    jack_force: Float[Array, " n_elem"] | None = None
    jacked: Bool[Array, " n_elem"] | None = None
    warmth: Float[Array, " n_elem"] | None = None
    memory: PyTree[Float[Array, "n_elem ..."]] | None = None
    line_load: Float[Array, "n_elem 3"] | None = None
    pressed: Pressures | None = None


class Element(abc.ABC):
    """A group of elements of one kind: a pytree with ``links`` in its index fields.

    Attributes:
        links: node numbers, [n_elem, n_end].
        per_element: names of the arrays that have a value for every element, [n_elem, ...].
        results: what an analysis records of it, a tuple of `Result`.
        outline: ends through which pictures draw it, by number; default one after the other.
        rotates: whether it gives its nodes rotations.
        inner, n_inner_row: unknowns of its own, as (row, column), and the rows of motion that they
            take after those of the ends (`inner`).
        weight, expansion, strength, area, section, rest_length: as of `Bars`; None if it has none.
            A weight may be per area; it is there where `weights` has any.
        hinges, springs: as of `Beams`; None if it has none.
        has_length: whether loads per length act along it; its state then has `rest_length` and
            `loaded`, the length that these are per.
        tension_only, rising: whether it holds only in tension; whether its force is known not to
            fall with strain. Of groups of which both hold the energy is convex.
        remembers: whether its state has a `memory`, of laws that know what has happened to them;
            then it has `settle(strain, memory, duration=0.0)`, `size` and `fibre_stress(strain,
            memory)`, and tells `SECTION_STRAIN`.
        breaks: whether a curve of its law can end; then it has `beyond(strain)`, a bool.
        shaped_by_load: whether its state has the load along it; `slides`: whether that load goes
            from node to node with it (then `slid` says how much does).
    """

    links: Int[ArrayLike, "n_elem n_end"]
    per_element: ClassVar[tuple[str, ...]] = ()
    results: ClassVar[tuple[Result, ...]] = ()
    outline: tuple[int, ...] | None = None
    rotates: bool = False
    inner: tuple[tuple[int, int], ...] = ()
    n_inner_row: int = 0
    weight: Float[ArrayLike, " n_elem"] | None = None
    expansion: Float[ArrayLike, " n_elem"] | None = None
    strength: Float[ArrayLike, " n_elem"] | None = None
    area: Float[ArrayLike, " n_elem"] | None = None
    section: Section | None = None
    rest_length: Float[ArrayLike, " n_elem"] | None = None
    hinges: Bool[ArrayLike, "n_elem 2 3"] | None = None
    springs: Float[ArrayLike, "n_elem 2 3"] | None = None
    has_length: bool = False
    tension_only: bool = False
    rising: bool = False
    remembers: bool = False
    breaks: bool = False
    shaped_by_load: bool = False
    slides: bool = False

    @property
    def n_freedom(self) -> int:
        """Columns of its end forces: forces, and moments if it gives its nodes rotations."""
        return 6 if self.rotates else 3

    @property
    def n_motion(self) -> int:
        """Columns of the motion that it sees: displacements, and unit quaternions likewise."""
        return 7 if self.rotates else 3

    # --- the group

    def rules(self) -> list[Rule]:
        """What its numbers keep, see `common.rules`."""
        return []

    def rules_at(self, nodes: Float[ArrayLike, "n_node 3"]) -> list[Rule]:
        """What they and the initial positions [n_node, 3] keep together."""
        return []

    def check(self, nodes: Float[np.ndarray, "n_node 3"]) -> None:
        """Raise ValueError where known positions [n_node, 3] leave something open."""
        return None

    def properties(self) -> dict[str, PyTree[Float[ArrayLike, "n_elem ..."]]]:
        """What has one value for every element, by name."""
        values = {name: getattr(self, name) for name in self.per_element}
        values = {name: value for name, value in values.items() if value is not None}
        fields = dataclasses.fields(self)  # type: ignore[arg-type]  # a group is a `pytree`
        others = {field.name: getattr(self, field.name) for field in fields}
        return values | {name: x.every for name, x in others.items() if isinstance(x, Each)}

    @abc.abstractmethod
    def start(self, ends: Float[Array, "n_elem n_end 3"]) -> ElementState:
        """`ElementState` before the first phase, from initial positions [n_elem, n_end, 3]."""

    def chord(self, ends: Float[Array, "n_elem n_end 3"]) -> Float[Array, " n_elem"]:
        """Length between the first two ends [n_elem, n_end, 3], [n_elem], m.

        A size to measure steps by; none, [0], of elements with one end.
        """
        if ends.shape[1] < 2:
            return jnp.zeros(0, ends.dtype)
        return jnp.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)

    def at_ends(
        self, amount: Float[Array, " n_elem"], ends: Float[Array, "n_elem n_end 3"]
    ) -> Float[Array, "n_elem n_end"]:
        """Shares of the ends [n_elem, n_end, 3] in `amount` [n_elem] along it, [n_elem, n_end]."""
        n_end = ends.shape[1]
        return jnp.repeat((amount / n_end)[:, None], n_end, axis=1)

    def weights(self, state: OwnState) -> Float[Array, " n_elem"] | None:
        """Weight of every element, [n_elem], N; None if the group has none."""
        return None

    def oriented(self, nodes: Float[ArrayLike, "n_node 3"]) -> Self:
        """The group with its axes kept as they are at initial positions [n_node, 3]."""
        return self

    def hinged_ends(self) -> Bool[np.ndarray, "n_elem 2"] | None:
        """Ends with a rotation of their own, [n_elem, 2] bool, or None."""
        return None

    def unused_columns(self) -> Bool[np.ndarray, "n_elem n_inner_row 3"]:
        """Columns of its inner rows that no number stands in, [n_elem, n_inner_row, 3] bool."""
        return np.zeros((len(self.links), self.n_inner_row, 3), bool)

    def initial_memory(self) -> PyTree[Float[Array, "n_elem ..."]] | None:
        """Memory of unused elements, or None."""
        return None

    def extended(self) -> Self:
        """The group for an iteration, whose laws have no ends."""
        return self

    def softened(self, compliance: Scalar) -> Self:
        """The group with a spring in series with every element, strain per force, 1/N."""
        return self

    def capacity(self) -> tuple[float | Float[Array, " n_elem"], float | Float[Array, " n_elem"]]:
        """Smallest and largest axial force, N."""
        return -jnp.inf, jnp.inf

    def stiffness_along(self) -> Float[ArrayLike, " n_elem"] | None:
        """Axial stiffness EA where its law is a line, [n_elem], N; None if it is not."""
        return None

    # --- one element

    @abc.abstractmethod
    def end_forces(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Internal force at each end, [n_end, 3], N, or with moments [n_end, 6].

        Of inner numbers in the rows after them.
        """

    def end_forces_about(self, state: OwnState, ends: Ends, motion: Motion, step: Forces) -> Forces:
        """End forces conjugate to a step from a motion, both [n_end, n_freedom].

        Where there are rotations a step has spins, which are not added.
        """
        return self.end_forces(state, ends, motion + step)

    @abc.abstractmethod
    def energy(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Stored energy, J, written apart from the forces: they must be its gradient."""

    def tangent(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, "n_end 3 n_end 3"] | Float[Array, "n n"]:
        """Tangent stiffness [n_end, 3, n_end, 3], N/m: autodiff of the end forces."""
        return jax.jacfwd(lambda moved: self.end_forces(state, ends, moved))(motion)

    def finds_both(self, state: OwnState) -> bool:
        """Whether an iteration gets forces and tangent of a group by one evaluation, `linearized`.

        That compiles in less time, and computes tangents of points that may be rejected.
        """
        return False

    def linearized(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> tuple[Forces, Float[Array, "n_end 3 n_end 3"] | Float[Array, "n n"]]:
        """End forces and tangent."""
        return self.end_forces(state, ends, motion), self.tangent(state, ends, motion)

    def mass_matrix(
        self,
        state: OwnState,
        ends: Ends,
        motion: Motion,
        mass: Scalar,
        distribution: str | None = None,
    ) -> Float[Array, "n n"]:
        """Of an element of so much `mass`, kg, a matrix as its `tangent`, kg.

        Args:
            state, ends, motion: as of `end_forces`.
            mass: scalar, kg.
            distribution: "lumped", "consistent", "mean" of both, or None for the one of highest
                order, as far as it knows them; this one has shares at its ends (`at_ends`) where
                these are, in any case.
        """
        places = ends + motion[:, :3]
        shares = self.at_ends(mass[None], places[None])[0]
        return jnp.diag(jnp.repeat(shares, 3))

    def is_slack(self, state: OwnState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Whether it has gone slack and holds nothing."""
        return jnp.zeros((), bool)

    def at_kink(self, state: OwnState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Whether it is between taut and slack, where its force has no derivative."""
        return jnp.zeros((), bool)

    def reading(
        self, state: OwnState, ends: Ends, motion: Motion, names: Sequence[str]
    ) -> dict[str, Array]:
        """Results by the names of its methods, a dict; what they share may be found once."""
        return {name: getattr(self, name)(state, ends, motion) for name in names}

    def has_result(self, name: str, state: OwnState) -> bool:
        """Whether it has a result of a name, with a state of the group."""
        return name in ("end_forces", "is_slack", *(result.name for result in self.results))
