"""The contract of element groups: the base class `Element`, its state and its results.

An `Element` is a group of elements of one kind. Inside vmap over its `properties` the same object
stands for one element (`prestress.single_element`). It knows nothing about nodes, degrees of
freedom or solvers. Methods of one element take ``ends``, the initial positions of its ends [n_end,
3], m, and ``motion``, the displacements of its ends [n_end, 3], or with rotations their
displacements and unit quaternions [n_end, 7]. (Displacements of nets may have a low-order part;
such elements are rebased to their present positions first, see `abilities.TensionElement`.) A
``state`` contains what phases change. Base classes for what only some elements can do are in
`abilities`.
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
"""Forces at the ends of one element, or a step (translations, spins) of these ends."""


@dataclasses.dataclass(frozen=True)
class Result:
    """Declaration of a result of elements; the method `name` computes it for one element.

    Attributes:
        name: name of the method; solutions, files, pictures and reports use it, too.
        unit: unit of its numbers.
        components: names of the entries of its last axis; empty if it has no components.
        ends, increments: whether the result is kept at the end of every phase, and of every
            increment.
        places: names of the places in the element, along the axis before the components, or the
            last axis if there are none; empty: places are numbered from 0. A result at a single
            place has no such axis.
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
"""Axial force of largest absolute value along an element, if it differs from `TENSION`."""
SECTION_STRAIN = Result("section_strain", "-, 1/m", ends=False)
"""Strains of elements with fibres, or of a law with a rupture strain or history variables."""
SECTION_FORCES = Result(
    "section_forces", "N, N m", ("N", "Vy", "Vz", "T", "My", "Mz"), increments=False
)
"""Section forces at positions along an element, [n, 6]."""
PRESENT = Result("present", "-")
"""1 for an active element, 0 for an inactive one, in analyses that activate or deactivate elements.
It comes from `ElementState`; groups do not list it among their results."""


class Element(abc.ABC):
    """A group of elements of one kind: a pytree with ``links`` in its index fields.

    Attributes:
        links: node indices, [n_elem, n_end].
        per_element: names of the arrays that have a value for every element, [n_elem, ...].
        results: results that an analysis records, a tuple of `Result`.
        face: the three or four ends in order around the face of an element, such as (0, 1, 2);
            None if it has none. Area loads can then act on the group (`on`), and pictures and files
            draw the face. A face of four ends that names a node twice is a triangle.
        outline: the ends through which pictures draw an element; default: its face, or all ends.
        rotates: whether motions and end forces of the elements have rotations and moments.
        inner_unknowns, n_inner_row: indices (row, column) of the inner unknowns of an element
            (degrees of freedom of its own), and the number of rows of motion that they take after
            its ends.
        weight, expansion, strength, area, section, rest_length: as of `Bars`; None if the group has
            none. A weight may be per area; it is present where `weights` returns something.
        hinges, springs: as of `Beams`; None if the group has none.
        has_length: whether loads per length act along the elements; their state then has
            `rest_length`, and `load_bearing_length`, the length that these loads are per.
        symmetric: whether the tangent of an element is symmetric, as where its end forces are the
            gradient of its energy. Where it is False (forces that follow the element without a
            potential) the tangent is solved by LU, its transpose in derivatives; then the analysis
            warns of no unstable state, `stable` means that the symmetric part of the tangent is
            definite (see `PhaseResult`), and `dynamics.modes`, `buckling_factor` and `modes`
            raise ValueError.
        tension_only, compression_only: whether an element carries only tension, or compression.
        monotone: whether its force is known not to fall with strain (no softening). The energy of
            groups that are `tension_only` and `monotone` is convex.
        has_memory: whether its state has history variables (`memory`), because its laws depend on
            earlier increments; then it has `absolute_force`, `initial_memory`, and either
            `commit_memory` and `SECTION_STRAIN` among its results, or `committed_memory`.
        has_rupture: whether its law has a rupture strain; then it has `is_ruptured`, and
            `SECTION_STRAIN` among its results.
        shaped_by_load: whether its state contains the `ElementLoad` along it.
        paired: whether its forces depend on the relative displacement of its two ends only, so that
            its tangent is ``[[B, -B], [-B, B]]``.
        slides: whether the load along it slides from node to node with the element;
            `sliding_load_forces` then returns the resulting change of the nodal forces.
        is_chain: whether its ends are those of straight segments with axial forces in a row.
    """

    links: Int[ArrayLike, "n_elem n_end"]
    per_element: ClassVar[tuple[str, ...]] = ()
    results: ClassVar[tuple[Result, ...]] = ()
    face: tuple[int, ...] | None = None
    outline: tuple[int, ...] | None = None
    rotates: bool = False
    inner_unknowns: tuple[tuple[int, int], ...] = ()
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
    compression_only: bool = False
    monotone: bool = False
    has_memory: bool = False
    has_rupture: bool = False
    shaped_by_load: bool = False
    paired: bool = False
    slides: bool = False
    is_chain: bool = False

    @property
    def n_freedom(self) -> int:
        """Number of columns of end forces: 3 forces, and 3 moments if the nodes have rotations."""
        return 6 if self.rotates else 3

    @property
    def n_motion(self) -> int:
        """Number of columns of a motion: 3 displacements, and a quaternion's 4 with rotations."""
        return 7 if self.rotates else 3

    @property
    def gives_rotations(self) -> bool:
        """Whether the elements give their nodes rotations; default: if they have rotations."""
        return self.rotates

    # --- the group

    def rules(self) -> list[Rule]:
        """Return conditions on numbers of the group, such as positive areas; by default none."""
        return []

    def rules_at(self, nodes: Float[ArrayLike, "n_node 3"]) -> list[Rule]:
        """Return conditions on numbers at initial positions `nodes`, m; by default none."""
        return []

    def check(self, nodes: Float[np.ndarray, "n_node 3"]) -> None:
        """Raise ValueError if initial positions `nodes` (known, m) do not define the elements."""
        return None

    def properties(self) -> dict[str, PyTree[Float[ArrayLike, "n_elem ..."]]]:
        """Return all fields that have a value for every element, by name, each [n_elem, ...]."""
        values = {name: getattr(self, name) for name in self.per_element}
        values = {name: value for name, value in values.items() if value is not None}
        fields = dataclasses.fields(self)  # type: ignore[arg-type]  # a group is a `pytree`
        others = {field.name: getattr(self, field.name) for field in fields}
        return values | {name: x.every for name, x in others.items() if isinstance(x, PerElement)}

    @abc.abstractmethod
    def start(self, ends: Float[Array, "n_elem n_end 3"]) -> ElementState:
        """Return the state of the group before the first phase, for initial positions `ends`, m."""

    def chord(self, ends: Float[Array, "n_elem n_end 3"]) -> Float[Array, " n_elem"]:
        """Return the distance of the first two ends of every element, [n_elem], m.

        Solvers measure steps by this length. It is empty, [0], for elements with one end.
        """
        return chord_lengths(ends) if ends.shape[1] > 1 else jnp.zeros(0, ends.dtype)

    def split_among_ends(
        self, amount: Float[Array, " n_elem"], ends: Float[Array, "n_elem n_end 3"]
    ) -> Float[Array, "n_elem n_end"]:
        """Split an `amount`, such as a weight, among the ends of each element, [n_elem, n_end].

        `ends` are their initial positions, m. The shares of an element add up to its amount.
        """
        return jnp.repeat(amount[:, None] / ends.shape[1], ends.shape[1], axis=1)

    def weights(self, state: OwnState) -> Float[Array, " n_elem"] | None:
        """Return the weight of every element, [n_elem], N; None if the group has no weight."""
        return None

    def with_fixed_axes(self, nodes: Float[ArrayLike, "n_node 3"]) -> Self:
        """Return the group with its axes fixed as they are at initial positions `nodes`, m."""
        return self

    def hinged_ends(self) -> Bool[np.ndarray, "n_elem 2"] | None:
        """Return which ends do not rotate with their node, [n_elem, 2] bool; None: all rotate."""
        return None

    def unused_columns(self) -> Bool[np.ndarray, "n_elem n_inner_row 3"]:
        """Return which entries hold no unknown in the rows of motion that an element adds, bool."""
        return np.zeros((len(self.links), self.n_inner_row, 3), bool)

    def initial_memory(self) -> PyTree[Float[Array, "n_elem ..."]] | None:
        """Return the history variables of unstrained elements, [n_elem, ...]; None: it has none."""
        return None

    def extrapolated(self) -> Self:
        """Return the group with stress-strain curves extended beyond rupture, for an iteration."""
        return self

    def without_softening(self) -> Self:
        """Return the group with laws that do not soften, with which an iteration begins."""
        return self

    def with_activation(self, state: OwnState, present: Bool[Array, " n_elem"]) -> ElementState:
        """Return the state with the mask of active elements, [n_elem], in its field `present`."""
        return with_fields(state, present=present)

    def unstressed_state(
        self, ends: Float[Array, "n_elem n_end 3"], slack: Bool[Array, " n_elem"]
    ) -> ElementState:
        """Return a state without stress between initial positions [n_elem, n_end, 3].

        Elements that are `slack`, [n_elem] bool, are slack in it, too. Default: the state before
        the first phase, in which no element is slack.
        """
        return self.start(ends)

    def capacity(self) -> tuple[float | Float[Array, " n_elem"], float | Float[Array, " n_elem"]]:
        """Return the smallest and the largest axial force that elements can carry, N."""
        return -jnp.inf, jnp.inf

    def linear_axial_stiffness(self) -> Float[ArrayLike, " n_elem"] | None:
        """Return the axial stiffness EA, [n_elem], N; None if the law is not linear."""
        return None

    # --- one element

    def state_at_activation(self, state: OwnState, ends: Ends, motion: Motion) -> ElementState:
        """Return the state of an element activated at this motion: without stress between its ends.

        The given `state` has the history variables of elements that have not been strained yet.

        Raises:
            ValueError: elements of this kind cannot be added.
        """
        raise ValueError(f"adds: a group of {type(self).__name__} cannot be added in a phase")

    @abc.abstractmethod
    def end_forces(self, state: OwnState, ends: Ends, motion: Motion) -> Forces:
        """Return the internal force at each end, N, [n_end, 3], or [n_end, 6] with moments, N m.

        Signs are those of derivatives of the energy by displacements: a tension gives forces that
        point outwards. The rows after the ends contain the forces conjugate to inner unknowns.
        """

    def end_forces_after_step(
        self, state: OwnState, ends: Ends, motion: Motion, step: Forces
    ) -> Forces:
        """Return end forces after a `step` from a motion, work-conjugate to this step.

        Elements with rotations override it, because spins cannot be added to quaternions.
        """
        return self.end_forces(state, ends, motion + step)

    @abc.abstractmethod
    def energy(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the stored energy of one element, J, whose gradient `end_forces` must be."""

    def tangent(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, "n_end 3 n_end 3"] | Float[Array, "n n"]:
        """Return the tangent stiffness, [n_end, 3, n_end, 3], N/m, by autodiff of the end forces.

        For elements with rotations it is the derivative by a step, [n_end, 6, n_end, 6]. For
        elements with inner unknowns it is [n, n]: degrees of freedom of the ends, then inner ones.
        """
        if self.rotates:
            still = jnp.zeros((len(motion), self.n_freedom), motion.dtype)
            matrix = jax.jacfwd(lambda s: self.end_forces_after_step(state, ends, motion, s))(still)
        else:
            matrix = jax.jacfwd(lambda moved: self.end_forces(state, ends, moved))(motion)
        if not self.inner_unknowns:
            return matrix
        rows, columns = np.array(self.inner_unknowns).T
        n_end = len(motion) - self.n_inner_row
        own = (n_end + rows) * self.n_freedom + columns
        kept = np.append(np.arange(n_end * self.n_freedom), own)
        return matrix.reshape(len(motion) * self.n_freedom, -1)[np.ix_(kept, kept)]

    def evaluates_forces_with_tangent(self, state: OwnState) -> bool:
        """Return whether iterations call `forces_and_tangent`, for both in one evaluation.

        This compiles faster, but computes tangents also at points that may be rejected.
        """
        return False

    def forces_and_tangent(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> tuple[Forces, Float[Array, "n_end 3 n_end 3"] | Float[Array, "n n"]]:
        """Return `end_forces` and `tangent` of one element, a pair."""
        return self.end_forces(state, ends, motion), self.tangent(state, ends, motion)

    def mass_matrix(
        self,
        state: OwnState,
        ends: Ends,
        motion: Motion,
        mass: Scalar,
        distribution: str | None = None,
    ) -> Float[Array, "n n"]:
        """Return the mass matrix of an element of the given `mass`, in the shape of `tangent`, kg.

        Args:
            state, ends, motion: as for `end_forces`.
            mass: scalar, kg.
            distribution: "lumped", "consistent", "mean" of both, or None for the kind of highest
                order that the element has. This base class always lumps the mass at the ends, by
                the shares of `split_among_ends` in the current positions.
        """
        places = ends + motion[:, :3]
        shares = self.split_among_ends(mass[None], places[None])[0]
        return jnp.diag(jnp.repeat(shares, 3))

    def is_slack(self, state: OwnState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether one element is slack: without force, because it is too short, or open."""
        return jnp.zeros((), bool)

    def at_kink(self, state: OwnState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether one element is just between taut and slack: no derivative of its force."""
        return jnp.zeros((), bool)

    # --- rupture, history variables, and loads that slide: see the table in `abilities`

    def absolute_force(self, state: OwnState, ends: Ends, motion: Motion) -> Scalar:
        """Return the sum of absolute forces of an element's parts, N: the scale of rounding."""
        return jnp.zeros((), motion.dtype)

    def commit_memory(
        self, strain: Array, memory: PyTree[Array], duration: float = 0.0
    ) -> PyTree[Array]:
        """Return the history variables after an increment of a `duration`, s, ended at a strain."""
        return memory

    def committed_memory(
        self, state: OwnState, ends: Ends, motion: Motion, duration: float = 0.0
    ) -> PyTree[Array]:
        """Return the history variables after an increment of a `duration`, s, ended at a motion.

        The default commits those of a law, which depend on the section strain only. Elements whose
        history depends on more (how far a cable has slid, where a damper was) override it. It is
        called once after every increment that has converged. The state then has the history
        variables of the beginning of the increment, as it has where results of the increment are
        evaluated. `energy` is that of the increment: its gradient are the end forces with these
        history variables.
        """
        strain = self.section_strain(state, ends, motion)  # type: ignore[attr-defined]  # a result
        return self.commit_memory(strain, state.memory, duration)

    def is_ruptured(self, strain: Array) -> Bool[Array, ""]:
        """Return whether the section strain of an element is beyond the rupture of its law."""
        return jnp.zeros((), bool)

    def fibre_stress(self, strain: Array, memory: PyTree[Array] | None = None) -> Array | None:
        """Return the stress of the fibres of one element at a strain, Pa; None if it has none."""
        return None

    def sliding_load_forces(
        self, state: OwnState, ends: Ends, motion: Motion
    ) -> Float[Array, "n_end 3"]:
        """Return the change of end forces because the load slides along the element, N."""
        return jnp.zeros((len(motion), 3), motion.dtype)

    def results_by_name(
        self, state: OwnState, ends: Ends, motion: Motion, names: Sequence[str]
    ) -> dict[str, Array]:
        """Return results of one element by name; overriding methods compute shared parts once."""
        return {name: getattr(self, name)(state, ends, motion) for name in names}

    def has_result(self, name: str, state: OwnState) -> bool:
        """Return whether the method `name` gives a result in this state, with its loads."""
        return name in ("end_forces", "is_slack", *(result.name for result in self.results))
