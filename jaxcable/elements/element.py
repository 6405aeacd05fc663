"""What a group of elements is: a base with what all have, and what some can do beside it.

An `Element` is a group; inside of vmap over its `properties` it is one element
(`prestress.element`). It knows nothing about nodes, numbering or solvers. Positions and motions are
those of its ends: ``ends`` the initial positions [n_end, 3], m; ``motion`` their displacements
[n_end, 3], or with rotations [n_end, 7], unit quaternions after them. A ``state`` is what phases
change.
"""

import abc
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import Each


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
    components: tuple = ()
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


class ElementState:
    """What phases change in a group: a pytree, its arrays with an axis [n_elem].

    What a kind of element has not is None; see `prestress.AxialState` for what these are.
    """

    rest_length = jack_force = jacked = warmth = memory = line_load = pressed = None


class Element(abc.ABC):
    """A group of elements of one kind: a pytree with ``links`` in its index fields.

    Attributes:
        links: node numbers, [n_elem, n_end].
        per_element: names of the arrays that have a value for every element, [n_elem, ...].
        results: what an analysis records of it, a tuple of `Result`.
        outline: ends through which pictures draw it, by number; default one after the other.
        rotates: whether it gives its nodes rotations.
        n_freedom, n_motion: columns of its end forces, and of the motion that it sees.
        inner, n_inner_row: unknowns of its own, as (row, column), and the rows of motion that they
            take after those of the ends (`member`).
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

    per_element = ()
    results = ()
    outline = None
    hinges = springs = None
    rotates = False
    n_freedom = n_motion = 3
    inner = ()
    n_inner_row = 0
    weight = expansion = strength = area = section = rest_length = None
    tension_only = rising = remembers = breaks = shaped_by_load = slides = False
    has_length = False

    # --- the group

    def rules(self):
        """What its numbers keep, see `_rules`."""
        return []

    def rules_at(self, nodes):
        """What they and the initial positions [n_node, 3] keep together."""
        return []

    def check(self, nodes):
        """Raise ValueError where known positions [n_node, 3] leave something open."""
        return None

    def properties(self):
        """What has one value for every element, by name."""
        values = {name: getattr(self, name) for name in self.per_element}
        values = {name: value for name, value in values.items() if value is not None}
        others = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return values | {name: x.every for name, x in others.items() if isinstance(x, Each)}

    @abc.abstractmethod
    def start(self, ends):
        """`ElementState` before the first phase, from initial positions [n_elem, n_end, 3]."""

    def chord(self, ends):
        """Length between the first two ends [n_elem, n_end, 3], [n_elem], m.

        A size to measure steps by; none, [0], of elements with one end.
        """
        if ends.shape[1] < 2:
            return jnp.zeros(0, ends.dtype)
        return jnp.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)

    def at_ends(self, amount, ends):
        """Shares of the ends [n_elem, n_end, 3] in `amount` [n_elem] along it, [n_elem, n_end]."""
        n_end = ends.shape[1]
        return jnp.repeat((amount / n_end)[:, None], n_end, axis=1)

    def weights(self, state):
        """Weight of every element, [n_elem], N; None if the group has none."""
        return None

    def oriented(self, nodes):
        """The group with its axes kept as they are at initial positions [n_node, 3]."""
        return self

    def balls(self):
        """Ends with a rotation of their own, [n_elem, 2] bool, or None."""
        return None

    def idle(self):
        """Columns of its inner rows that no number stands in, [n_elem, n_inner_row, 3] bool."""
        return np.zeros((len(self.links), self.n_inner_row, 3), bool)

    def virgin(self):
        """Memory of unused elements, or None."""
        return None

    def continued(self):
        """The group for an iteration, whose laws have no ends."""
        return self

    def softened(self, compliance):
        """The group with a spring in series with every element, strain per force, 1/N."""
        return self

    def capacity(self):
        """Smallest and largest axial force, N."""
        return -jnp.inf, jnp.inf

    def stiffness_along(self):
        """Axial stiffness EA where its law is a line, [n_elem], N; None if it is not."""
        return None

    # --- one element

    @abc.abstractmethod
    def end_forces(self, state, ends, motion):
        """Internal force at each end, [n_end, 3], N, or with moments [n_end, 6].

        Of inner numbers in the rows after them.
        """

    def end_forces_about(self, state, ends, motion, step):
        """End forces conjugate to a step from a motion, both [n_end, n_freedom].

        Where there are rotations a step has spins, which are not added.
        """
        return self.end_forces(state, ends, motion + step)

    @abc.abstractmethod
    def energy(self, state, ends, motion):
        """Stored energy, J, written apart from the forces: they must be its gradient."""

    def tangent(self, state, ends, motion):
        """Tangent stiffness [n_end, 3, n_end, 3], N/m: autodiff of the end forces."""
        return jax.jacfwd(lambda moved: self.end_forces(state, ends, moved))(motion)

    def finds_both(self, state):
        """Whether an iteration gets forces and tangent of a group by one evaluation, `linearized`.

        That compiles in less time, and computes tangents of points that may be rejected.
        """
        return False

    def linearized(self, state, ends, motion):
        """End forces and tangent."""
        return self.end_forces(state, ends, motion), self.tangent(state, ends, motion)

    def mass_matrix(self, state, ends, motion, mass, distribution=None):
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

    def is_slack(self, state, ends, motion):
        """Whether it has gone slack and holds nothing."""
        return jnp.zeros((), bool)

    def at_kink(self, state, ends, motion):
        """Whether it is between taut and slack, where its force has no derivative."""
        return jnp.zeros((), bool)

    def reading(self, state, ends, motion, names):
        """Results by the names of its methods, a dict; what they share may be found once."""
        return {name: getattr(self, name)(state, ends, motion) for name in names}

    def has_result(self, name, state):
        """Whether it has a result of a name, with a state of the group."""
        return name in ("end_forces", "is_slack", *(result.name for result in self.results))


class Prestressable(Element):
    """Its state can be changed by what a phase states (`Phase`).

    Attributes:
        statements: names of what can be stated for it.
    """

    statements = ()

    @abc.abstractmethod
    def restate(self, state, ends, inputs):
        """State of the group after statements, names to `prestress.Stated`; ends [n_elem, ...]."""

    def between(self, start, end, factor):
        """State of the group in a phase that takes it from one to another.

        What does not change keeps every digit, and the end is met.
        """
        return jax.tree.map(lambda a, b: b - (1 - factor) * (b - a), start, end)


class Jacked(Prestressable):
    """Its force can be held by a jack, by the statement "jacking".

    The state then has `jack_force` and `jacked`.
    """

    @abc.abstractmethod
    def lock(self, state, ends, motion):
        """State of one anchored jack: what gives the held force here."""


class Sagging(Prestressable):
    """It hangs under its weight, by the statement "sag"."""

    @abc.abstractmethod
    def strain_at_sag(self, ends, sag, warmth=1.0):
        """Strains of the initial chords with which a group hangs by `sag`, [n_elem], m."""

    @abc.abstractmethod
    def depth(self, state, ends, motion):
        """How far its middle hangs below that of its chord, m."""

    @abc.abstractmethod
    def end_tensions(self, state, ends, motion):
        """Tensions at the first and the second end, [2], N."""

    @abc.abstractmethod
    def curve(self, state, ends, motion, parts):
        """Places along it, [n, 3], m, at parts [n] of its unstressed length."""


class Secant(Element):
    """It has a stiffness between two states, which the secant scheme takes."""

    @abc.abstractmethod
    def secant(self, state, ends, before, motion):
        """Symmetric matrix, as `tangent`, with ``K (u - u0) = f(u) - f(u0)``."""


class Rounding(Element):
    """It may be without force and yet have the rounding of its stiffness."""

    @abc.abstractmethod
    def rounding(self, state, ends, motion):
        """What the rounding of displacements leaves of the end forces, as these."""


class Bending(Element):
    """It gives its nodes rotations and has section forces."""

    rotates = True
    n_freedom, n_motion = 6, 7

    @abc.abstractmethod
    def section_forces(self, state, ends, motion, places=None):
        """``N, Vy, Vz, T, My, Mz`` at places from 0 to 1, [n, 6], N and N m."""
