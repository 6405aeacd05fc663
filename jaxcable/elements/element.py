"""The contract of element groups: the base class `Element`, its state and its results.

An `Element` is a group of elements of one kind. Inside vmap over its `properties` the same object
stands for one element (`prestress.element`). It knows nothing about nodes, numbering or solvers.
Methods of one element take ``ends``, the initial positions of its ends [n_end, 3], m, and
``motion``, the displacements of its ends [n_end, 3], or with rotations their displacements and unit
quaternions [n_end, 7]. (Elements of nets that move with a fine part are brought to where they are,
see `abilities.Pulling`, and have not moved from there.) A ``state`` contains what phases change.
Base classes for what only some elements can do are in `abilities`.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Sequence
from typing import ClassVar, Self, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..common.rules import Rule
from ..common.tree import PerElement
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..numerics.vectors import chord_lengths
from ..sections import Section
from .element_state import ElementState, OwnState, with_fields

Scalar: TypeAlias = 'Float[Array, ""]'
Ends: TypeAlias = 'Float[Array, "n_end 3"]'
"""Initial positions of the ends of one element, m."""
Motion: TypeAlias = 'Float[Array, "n_end n_motion"]'
"""Motion of the ends of one element: displacements, and unit quaternions if it has rotations."""
Forces: TypeAlias = 'Float[Array, "n_end n_freedom"]'
"""Forces at the ends of one element, or a step of these ends."""


@dataclasses.dataclass(frozen=True)
class Result:
    """A result of an element: its method `name`, called with a state, ends and motion.

    Attributes:
        name: of the method; solutions, files, pictures and reports use it, too.
        unit: of its numbers.
        components: names of the entries of its last axis; empty if there are none to name.
        ends, increments: whether the result is kept at the end of every phase, and of every
            increment.
        places: names of the places in the element, along the axis before that of components, or the
            last one without components; empty to number them from 0. A result at a single place has
            no such axis.
    """

    name: str
    unit: str
    components: tuple[str, ...] = ()
    ends: bool = True
    increments: bool = True
    places: tuple[str, ...] = ()


TENSION = Result("tension", "N")
"""Axial force; its mean, if it varies along the element."""
PEAK_TENSION = Result("peak_tension", "N")
"""Axial force of largest size along an element, where this differs from `TENSION`."""
SECTION_STRAIN = Result("section_strain", "-, 1/m", ends=False)
"""Strains of elements with fibres, or with a law that ends or remembers."""
SECTION_FORCES = Result(
    "section_forces", "N, N m", ("N", "Vy", "Vz", "T", "My", "Mz"), increments=False
)
"""Section forces at positions along an element, [n, 6]."""
PRESENT = Result("present", "-")
"""1 for an element that is there, 0 for one that is not; of analyses in which elements come and go.
Groups do not name it among their results: an `ElementState` has it."""


class Element(abc.ABC):
    """A group of elements of one kind: a pytree with ``links`` in its index fields.

    Attributes:
        links: node numbers, [n_elem, n_end].
        per_element: names of the arrays that have a value for every element, [n_elem, ...].
        results: the results that an analysis records, a tuple of `Result`.
        face: numbers of the three or four ends in order around the face of an element, such as
            (0, 1, 2); None if it has none. Loads on areas name its group then (`on`), pictures and
            files draw it. A face of four ends that names a node twice is a triangle.
        outline: numbers of the ends through which pictures draw an element; default around its
            face, or all in order.
        rotates: whether the elements give their nodes rotations.
        inner, n_inner_row: indices (row, column) of the inner numbers of an element, and how many
            rows of motion they take after those of the ends (`inner`).
        weight, expansion, strength, area, section, rest_length: as of `Bars`; None if the group has
            none. A weight may be per area; it is present where `weights` returns something.
        hinges, springs: as of `Beams`; None if the group has none.
        has_length: whether loads per length act along the elements; their state then has
            `rest_length`, and `loaded`, the length that these loads are per.
        symmetric: whether the tangent of an element is symmetric, as where its end forces are the
            gradient of its energy. Where it is False (forces that follow the element without a
            potential) the tangent is solved by LU, its transpose in derivatives; then the analysis
            warns of no unstable state, `stable` means that the symmetric part of the tangent is
            definite (see `PhaseResult`), and `natural_frequencies`, `buckling_factor` and `modes`
            raise ValueError.
        tension_only: whether an element carries tension only.
        monotone: whether its force is known not to fall with strain. The energy of groups that are
            `tension_only` and `monotone` is convex.
        remembers: whether its state has a `memory`, because its laws depend on earlier increments;
            then it has `size`, `initial_memory`, and either `commit_memory` and `SECTION_STRAIN`
            among its results, or `settled`.
        has_rupture: whether a curve of its law can end; then it has `is_ruptured`, and
            `SECTION_STRAIN` among its results.
        shaped_by_load: whether its state contains the `ElementLoad` along it.
        paired: whether its forces depend on the displacement of its two ends relative to each other
            only, so that its tangent is ``[[B, -B], [-B, B]]``.
        slides: whether this load slides from node to node with the element; then `slid` returns
            the forces that this makes.
    """

    links: Int[ArrayLike, "n_elem n_end"]
    per_element: ClassVar[tuple[str, ...]] = ()
    results: ClassVar[tuple[Result, ...]] = ()
    face: tuple[int, ...] | None = None
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
    symmetric: bool = True
    tension_only: bool = False
    monotone: bool = False
    remembers: bool = False
    has_rupture: bool = False
    shaped_by_load: bool = False
    paired: bool = False
    slides: bool = False

    @property
    def n_freedom(self) -> int:
        """Columns of the end forces: 3 forces, and 3 moments if its nodes rotate."""
        return 6 if self.rotates else 3

    @property
    def n_motion(self) -> int:
        """Columns of the motion: 3 displacements, and a unit quaternion if its nodes rotate."""
        return 7 if self.rotates else 3

    # --- the group

    def rules(self) -> list[Rule]:
        """Rules that the numbers of the group keep, see `common.rules`."""
        return []

    def rules_at(self, nodes: Float[ArrayLike, "n_node 3"]) -> list[Rule]:
        """Rules that its numbers keep together with the initial positions [n_node, 3]."""
        return []

    def check(self, nodes: Float[np.ndarray, "n_node 3"]) -> None:
        """Raise ValueError if known initial positions [n_node, 3] do not define the elements."""
        return None

    def properties(self) -> dict[str, PyTree[Float[ArrayLike, "n_elem ..."]]]:
        """All values that differ from element to element, by name, each [n_elem, ...]."""
        values = {name: getattr(self, name) for name in self.per_element}
        values = {name: value for name, value in values.items() if value is not None}
        fields = dataclasses.fields(self)  # type: ignore[arg-type]  # a group is a `pytree`
        others = {field.name: getattr(self, field.name) for field in fields}
        return values | {name: x.every for name, x in others.items() if isinstance(x, PerElement)}

    @abc.abstractmethod
    def start(self, ends: Float[Array, "n_elem n_end 3"]) -> ElementState:
        """`ElementState` before the first phase, from initial positions [n_elem, n_end, 3]."""

    def chord(self, ends: Float[Array, "n_elem n_end 3"]) -> Float[Array, " n_elem"]:
        """Distance of the first two ends [n_elem, n_end, 3], [n_elem], m.

        Steps are measured by this length. For elements with one end the array is empty, [0].
        """
        if ends.shape[1] < 2:
            return jnp.zeros(0, ends.dtype)
        return chord_lengths(ends)

    def at_ends(
        self, amount: Float[Array, " n_elem"], ends: Float[Array, "n_elem n_end 3"]
    ) -> Float[Array, "n_elem n_end"]:
        """Shares of the ends [n_elem, n_end, 3] in an `amount` [n_elem], [n_elem, n_end]."""
        n_end = ends.shape[1]
        return jnp.repeat((amount / n_end)[:, None], n_end, axis=1)

    def weights(self, state: OwnState) -> Float[Array, " n_elem"] | None:
        """Weight of every element, [n_elem], N; None if the group has none."""
        return None

    def oriented(self, nodes: Float[ArrayLike, "n_node 3"]) -> Self:
        """The group with its axes kept as they are at initial positions [n_node, 3]."""
        return self

    def hinged_ends(self) -> Bool[np.ndarray, "n_elem 2"] | None:
        """Ends whose rotation is not that of their node, [n_elem, 2] bool, or None."""
        return None

    def unused_columns(self) -> Bool[np.ndarray, "n_elem n_inner_row 3"]:
        """Columns of the inner rows that contain no number, [n_elem, n_inner_row, 3] bool."""
        return np.zeros((len(self.links), self.n_inner_row, 3), bool)

    def initial_memory(self) -> PyTree[Float[Array, "n_elem ..."]] | None:
        """Memory of elements that have not been strained yet, or None."""
        return None

    def extrapolated(self) -> Self:
        """The group for an iteration, with laws that go on beyond their ends."""
        return self

    def without_softening(self) -> Self:
        """The group for the beginning of an iteration, whose force does not fall with strain."""
        return self

    def partly(self, state: OwnState, present: Bool[Array, " n_elem"]) -> ElementState:
        """State of a group whose elements come and go; those that are `present` are there now."""
        return with_fields(state, present=present)

    def unstressed(
        self, ends: Float[Array, "n_elem n_end 3"], slack: Bool[Array, " n_elem"]
    ) -> ElementState:
        """State without stress between initial positions [n_elem, n_end, 3].

        Elements that are `slack`, [n_elem] bool, are slack in it, too. By default the state before
        the first phase, which has no slack elements.
        """
        return self.start(ends)

    def capacity(self) -> tuple[float | Float[Array, " n_elem"], float | Float[Array, " n_elem"]]:
        """Smallest and largest axial force, N."""
        return -jnp.inf, jnp.inf

    def stiffness_along(self) -> Float[ArrayLike, " n_elem"] | None:
        """Axial stiffness EA if the law is linear, [n_elem], N; None otherwise."""
        return None

    # --- one element

    def found(self, state: OwnState, ends: Ends, motion: Motion) -> ElementState:
        """State of an element that is added here, unstressed where it finds its ends.

        The `state` that it gets has the memory of elements that have not been strained yet.

        Raises:
            ValueError: elements of this kind cannot be added.
        """
        raise ValueError(f"adds: a group of {type(self).__name__} cannot be added in a phase")

    @abc.abstractmethod
    def end_forces(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Internal force at each end, N, [n_end, 3], or [n_end, 6] with moments, N m.

        The rows after the ends contain the forces of inner numbers.
        """

    def end_forces_about(self, state: OwnState, ends: Ends, motion: Motion, step: Forces) -> Forces:
        """End forces conjugate to a step from a motion, both [n_end, n_freedom].

        Elements with rotations override it, because spins cannot be added to quaternions.
        """
        return self.end_forces(state, ends, motion + step)

    @abc.abstractmethod
    def energy(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Stored energy, J. It is not used by `end_forces`, which must be its gradient."""

    def tangent(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, "n_end 3 n_end 3"] | Float[Array, "n n"]:
        """Tangent stiffness [n_end, 3, n_end, 3], N/m: autodiff of the end forces.

        Of elements with rotations by a step from the motion, [n_end, 6, n_end, 6]. The matrix of an
        element with inner numbers is [n, n], for the freedoms of its ends and then these numbers.
        """
        if self.rotates:
            still = jnp.zeros((len(motion), self.n_freedom), motion.dtype)
            matrix = jax.jacfwd(lambda step: self.end_forces_about(state, ends, motion, step))(
                still
            )
        else:
            matrix = jax.jacfwd(lambda moved: self.end_forces(state, ends, moved))(motion)
        if not self.inner:
            return matrix
        rows, columns = np.array(self.inner).T
        n_end = len(motion) - self.n_inner_row
        at = (n_end + rows) * self.n_freedom + columns
        at = np.concatenate([np.arange(n_end * self.n_freedom), at])
        return matrix.reshape(len(motion) * self.n_freedom, -1)[np.ix_(at, at)]

    def finds_both(self, state: OwnState) -> bool:
        """Whether an iteration gets forces and tangent of a group by one evaluation, `linearized`.

        This takes less time to compile, but also computes tangents at points that may be rejected.
        """
        return False

    def linearized(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> tuple[Forces, Float[Array, "n_end 3 n_end 3"] | Float[Array, "n n"]]:
        """End forces and tangent of one element."""
        return self.end_forces(state, ends, motion), self.tangent(state, ends, motion)

    def mass_matrix(
        self,
        state: OwnState,
        ends: Ends,
        motion: Motion,
        mass: Scalar,
        distribution: str | None = None,
    ) -> Float[Array, "n n"]:
        """Mass matrix of an element of the given `mass`, in the shape of its `tangent`, kg.

        Args:
            state, ends, motion: as of `end_forces`.
            mass: scalar, kg.
            distribution: "lumped", "consistent", "mean" of both, or None for the kind of highest
                order that the element has. This base class always lumps the mass: at its ends, by
                the shares of `at_ends` in the current positions.
        """
        places = ends + motion[:, :3]
        shares = self.at_ends(mass[None], places[None])[0]
        return jnp.diag(jnp.repeat(shares, 3))

    def is_slack(self, state: OwnState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Whether the element is slack and carries no force."""
        return jnp.zeros((), bool)

    def at_kink(self, state: OwnState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Whether the element is exactly unstressed, where its force has no derivative."""
        return jnp.zeros((), bool)

    # --- laws that end or remember, and loads that slide: see the table in `abilities`

    def size(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Sum of the absolute forces of the parts of an element, N; of one that `remembers`."""
        return jnp.zeros((), motion.dtype)

    def commit_memory(
        self, strain: Array, memory: PyTree[Array], duration: float = 0.0
    ) -> PyTree[Array]:
        """Memory after an increment of a `duration`, s, that ended at a `strain`."""
        return memory

    def settled(
        self, state: OwnState, ends: Ends, motion: Motion, duration: float = 0.0
    ) -> PyTree[Array]:
        """Memory after an increment of a `duration`, s, that ended at a motion.

        By default that of a law, which sees the section strain only. Elements whose memory depends
        on more (how far a cable has slid, where a damper was) override it. It is asked once for
        every increment that has converged, at its end, with the memory of its beginning in the
        state; results of the increment are read with that, too. `energy` then is that of the
        increment: its gradient are the end forces at the memory of the beginning.
        """
        strain = self.section_strain(state, ends, motion)  # type: ignore[attr-defined]  # a result
        return self.commit_memory(strain, state.memory, duration)

    def is_ruptured(self, strain: Array) -> Bool[Array, ""]:
        """Whether a strain is beyond the curve of the law."""
        return jnp.zeros((), bool)

    def fibre_stress(self, strain: Array, memory: PyTree[Array] | None = None) -> Array | None:
        """Stress of the fibres, Pa, at a strain; None if the element tells none."""
        return None

    def slid(self, state: OwnState, ends: Ends, motion: Motion) -> Float[Array, "n_end 3"]:
        """Forces at the ends by which a load along the element acts elsewhere as it slides, N."""
        return jnp.zeros((len(motion), 3), motion.dtype)

    def reading(
        self, state: OwnState, ends: Ends, motion: Motion, names: Sequence[str]
    ) -> dict[str, Array]:
        """Results by the names of methods, a dict; overriding methods compute shared parts once."""
        return {name: getattr(self, name)(state, ends, motion) for name in names}

    def has_result(self, name: str, state: OwnState) -> bool:
        """Whether the group has the result `name` in this state."""
        return name in ("end_forces", "is_slack", *(result.name for result in self.results))
