"""Beam: two nodes with displacements and finite rotations, fibre sections along the axis.

The formulation is corotational (Crisfield 1990; Battini and Pacoste 2002). `corotation` has the
frame of the element, which follows its chord and the mean of the rotations of its ends, and the
statics of forces in this frame. `bending` has the strains along the axis: from cubic deflections
(Bernoulli), and from a load or a neutral axis off the node axis. A rigid motion of any size changes
no strain. Warping is not modelled; `shear` has the shear flexibility of sections that state it.

An end is connected to its node rigidly, by a hinge, or semi-rigidly. A hinge releases all
rotations; the end then has a further row of motion for its rotation (see `Structure.motion_rows`).
A semi-rigid connection releases some rotations, or restrains them by springs; the rotation of the
end against its node is then an inner unknown of the element (`inner_unknowns`).
"""

from __future__ import annotations

from typing import Self

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import Rule, nan_if_broken, not_negative, positive, refuse_if_broken
from ..common.tree import (
    Indices,
    copy_with,
    index_array,
    map_over_elements,
    pytree,
    replace,
    shared_or_stacked,
)
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..numerics.rotations import cross
from ..numerics.vectors import scalar_product
from ..programs.program_calls import as_program
from ..sections import LinearSection, Section
from ..sections.section import section_hint
from . import bending
from .abilities import BEAM_RESULTS, Bending, RoundingEstimate
from .beam_axes import LEANING_SINE, VERTICAL_SINE, is_isotropic, is_known_anisotropic
from .beam_element import BeamElement
from .element import Ends, Motion, Scalar
from .prestress import AxialState, Prestressed, call_each_element, checked_links

_MAX_POINTS = 1000  # integration points: all fibres are evaluated at each, so that more is a slip


@pytree(indices=("links", "hinges"), static=("points",))
class Beams(BeamElement, Prestressed, Bending, RoundingEstimate):
    """A group of beam elements; their nodes have rotations.

    Elements are initially straight. A curved member takes several of them even between its loads:
    the moment of the axial force times the rise of the arc within an element is missing.

    Args:
        links: node indices, [n_elem, 2].
        section: `Section` of all elements of the group, or its stiffnesses (`Section.linear`). A
            shear stiffness of the section makes the elements flexible in shear.
        up: vector without unit in the plane of the element's axis and the section's z, [3] or
            [n_elem, 3]; default the global z, for vertical elements (within 0.06 degrees) the
            global x. An element that leans by up to 6 degrees has no default, unless its bending
            stiffness is the same in all directions: its axes would jump by 90 degrees.
        torsional_stiffness: GJ, scalar or [n_elem], N m2; needed unless the section has `torsion`,
            from which it is taken with Poisson's ratio 0.3.
        rest_length, weight, expansion, strength: as for `Bars`. Weight bends the element.
        hinges: True where an end turns against its node, [n_elem, 2] in all directions (ball and
            socket), or [n_elem, 2, 3] about the axes of the element: along it (torsion), and the
            section's y and z as they are initially, carried along by the node.
        points: number of positions along an element, ends included, at which results are given:
            Gauss-Lobatto points, which are the ends and the middle of 3, and not evenly spaced of
            more; also the number of integration points of sections that are not linear. Default 3,
            or 5 for sections that are not linear. With 3 the fibres of such sections see linear
            curvatures, without the effect of loads along the element.
        springs: rotational stiffness of a semi-rigid connection where `hinges` is True, scalar,
            [2, 3] or [n_elem, 2, 3], N m/rad; default none. It has no effect where `hinges` is
            False. Ends with springs, or with hinges in some directions only, must turn against
            their nodes by less than a full turn.

    Raises:
        ValueError: wrong shapes, values that are not positive, `up` along an element or missing
            near the vertical, torsion released at both ends.

    Source: Crisfield (1990); Battini and Pacoste (2002).

    Example:
        Cantilever of 2 m with 100 N at its tip: ``P L^3 / 3 EI`` = 4 mm.

        >>> section = jc.Section.rectangle(0.04, 0.1, jc.Elastic(20e9))
        >>> nodes = np.linspace([0.0, 0.0, 0.0], [2.0, 0.0, 0.0], 3)
        >>> beam = jc.Beams([[0, 1], [1, 2]], section=section)
        >>> structure = jc.Structure(nodes, beam, supports=jc.clamped([0]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -100.0))))
        >>> print(f"{jc.describe(solution.status)}: {1e3 * solution.displacement[2, 2]:.2f} mm")
        converged: -4.00 mm
        >>> print(f"{solution.reaction_moments[0, 1]:.1f} N m")  # about y, at the clamp
        -200.0 N m
    """

    links: Int[ArrayLike, "n_elem 2"]
    section: Section | LinearSection = None  # type: ignore[assignment]  # checked below
    up: Float[ArrayLike, "... 3"] | None = None
    torsional_stiffness: Float[ArrayLike, " n_elem"] | None = None
    rest_length: Float[ArrayLike, " n_elem"] | None = None
    weight: Float[ArrayLike, " n_elem"] | None = None
    expansion: Float[ArrayLike, " n_elem"] | None = None
    strength: Float[ArrayLike, " n_elem"] | None = None
    hinges: Bool[ArrayLike, "n_elem 2"] | Bool[ArrayLike, "n_elem 2 3"] | None = None
    points: int = None  # type: ignore[assignment]  # the constructor puts it in
    springs: (
        Float[ArrayLike, ""] | Float[ArrayLike, "2 3"] | Float[ArrayLike, "n_elem 2 3"] | None
    ) = None

    shaped_by_load = True
    results = BEAM_RESULTS
    per_element = (
        "torsional_stiffness",
        "up",
        "rest_length",
        "weight",
        "expansion",
        "strength",
        "springs",
    )

    def __post_init__(self):
        put = object.__setattr__
        put(self, "links", checked_links(self.links))
        n_elem = len(self.links)
        if not isinstance(self.section, Section | LinearSection):
            text = section_hint(self.section) or ": missing; a group of beams needs a Section"
            raise ValueError(f"section{text}")
        for name in ("torsional_stiffness", "rest_length", "weight", "expansion", "strength"):
            put(self, name, checks.floats_per_element(getattr(self, name), n_elem, name))
        if self.torsional_stiffness is None and self.section.torsion is None:
            raise ValueError(
                "torsional_stiffness: missing; this section has no known torsion constant"
            )
        if self.up is not None:
            up = checks.as_floats(self.up, "up")
            if up.shape not in ((3,), (n_elem, 3)):
                raise ValueError(f"up: expected shape (3,) or ({n_elem}, 3), got {up.shape}")
            pack = jnp if isinstance(up, jax.Array) else np
            put(self, "up", pack.broadcast_to(up, (n_elem, 3)))
        if self.points is None:
            put(self, "points", 3 if self.section.is_elastic else 5)
        whole = isinstance(self.points, int | np.integer) and not isinstance(self.points, bool)
        if not whole or not 3 <= self.points <= _MAX_POINTS:
            raise ValueError(
                f"points = {self.points!r}: expected an integer from 3 to {_MAX_POINTS}"
            )
        self._check_and_broadcast_hinges()
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rules: stiffness, length, strength positive; weight, springs not negative."""
        above = ("torsional_stiffness", "rest_length", "strength")
        rules = [positive(name, getattr(self, name)) for name in above]
        return rules + [not_negative(name, getattr(self, name)) for name in ("weight", "springs")]

    def rules_at(self, nodes: Float[ArrayLike, "n_node 3"]) -> list[Rule]:
        """Return the condition that `up` is not along an element; `nodes`: initial positions, m."""
        if self.up is None:
            return []
        links = index_array(self.links)
        chord = nodes[links[:, 1]] - nodes[links[:, 0]]

        def along(up, chord):
            across = [up[:, k] * chord[:, k - 1] - up[:, k - 1] * chord[:, k] for k in range(3)]
            off = sum(part**2 for part in across)
            near = max(1e-9, 4 * np.finfo(chord.dtype).eps) ** 2
            return off <= near * (up**2).sum(axis=1) * (chord**2).sum(axis=1)

        def text(index, up, _):
            return f"up[{index[0]}] = {up[index].tolist()}: must not be along the element"

        return [Rule("up", (self.up, chord), along, text)]

    def _check_and_broadcast_hinges(self):
        """Check `hinges` and `springs`, and broadcast both to [n_elem, 2, 3]; ValueError if wrong.

        Without springs, and with all hinges in all directions, `springs` becomes None.
        """
        count, put = len(self.links), object.__setattr__
        if self.hinges is not None and not isinstance(self.hinges, Indices):
            hinges = np.asarray(self.hinges)
            if hinges.dtype != bool or hinges.shape not in ((count, 2), (count, 2, 3)):
                raise ValueError(
                    f"hinges: expected booleans [{count}, 2] (beams, ends) or [{count}, 2, 3] (and "
                    f"axes), got {hinges.dtype} {hinges.shape}"
                )
            hinges = hinges if hinges.ndim == 3 else np.repeat(hinges[:, :, None], 3, axis=2)
            put(self, "hinges", Indices(hinges) if hinges.any() else None)
        if self.hinges is None:
            if self.springs is not None:
                raise ValueError("springs: give hinges, too, True where an end turns")
            return
        hinges, springs = self.hinges.array, self.springs
        if springs is None:
            springs = np.zeros((count, 2, 3))
            partly = (hinges.any(axis=2) != hinges.all(axis=2)).any()
        else:
            springs, partly = checks.as_floats(springs, "springs"), True
            if springs.shape not in ((), (2, 3), (count, 2, 3)):
                raise ValueError(
                    f"springs: expected a scalar or shape (2, 3) or ({count}, 2, 3), "
                    f"got {springs.shape}"
                )
            pack = jnp if isinstance(springs, jax.Array) else np
            springs = pack.broadcast_to(springs, (count, 2, 3))
        rule = _rule_one_end_keeps_torsion(springs, hinges)
        put(self, "springs", nan_if_broken(rule) if partly else None)
        if not partly:
            refuse_if_broken([rule])

    def check(self, nodes: Float[np.ndarray, "n_node 3"]) -> None:
        """Raise ValueError if `up` is missing where an element is nearly vertical, but not quite.

        The default axes jump there, which only a section of equal bending stiffness in all
        directions allows. `nodes` are initial positions, [n_node, 3], m.
        """
        chord = nodes[self.links.array[:, 1]] - nodes[self.links.array[:, 0]]
        length = np.linalg.norm(chord, axis=1)
        if self.up is None:
            sine = np.linalg.norm(chord[:, :2], axis=1) / length
            leaning = (sine >= VERTICAL_SINE) & (sine < LEANING_SINE)
            if leaning.any() and is_known_anisotropic(self.section):
                k = int(leaning.argmax())
                raise ValueError(
                    f"up: missing; element {k} leans by {np.degrees(np.arcsin(sine[k])):.3g} "
                    "degrees, and its section does not bend alike in all directions: say where "
                    "its z axis points, such as up=(1.0, 0.0, 0.0)"
                )

    def start(self, ends: Float[Array, "n_elem n_end 3"]) -> AxialState:
        """Return the state of the group before the first phase, for initial ends, m.

        Unstressed lengths are NaN where `check`, for known numbers, would raise ValueError.
        """
        state = super().start(ends)
        if self.up is not None:
            return state
        chord = ends[:, 1] - ends[:, 0]
        sine = jnp.sqrt(jnp.sum(chord[:, :2] ** 2, axis=1) / jnp.sum(chord**2, axis=1))
        leaning = (sine >= VERTICAL_SINE) & (sine < LEANING_SINE)
        unknown = leaning & ~call_each_element("bends_isotropically", self)
        return copy_with(state, rest_length=jnp.where(unknown, jnp.nan, state.rest_length))

    def with_activation(self, state: AxialState, present: Bool[Array, " n_elem"]) -> AxialState:
        """Return the state with the mask `present` of active elements, and with zero kinks.

        Kinks are the unstressed rotations of beams that are activated between rotated nodes.
        """
        kinks = state.kinks
        if kinks is None:
            kinks = jnp.zeros((len(state.rest_length), 2, 3), state.rest_length.dtype)
        return copy_with(state, present=present, kinks=kinks)

    def state_at_activation(self, state: AxialState, ends: Ends, motion: Motion) -> AxialState:
        """Return the state of one beam activated here: unstressed between its rotated nodes."""
        state = super().state_at_activation(state, ends, motion)
        _, pose = self._axes_and_pose(copy_with(state, kinks=None), ends, motion)
        return copy_with(state, kinks=pose.rotations)

    def split_among_ends(
        self, amount: Float[Array, " n_elem"], ends: Float[Array, "n_elem n_end 3"]
    ) -> Float[Array, "n_elem n_end"]:
        """Return half of each `amount` at both ends, [n_elem, n_end]; zeros for inner unknowns."""
        halves = jnp.repeat((0.5 * amount)[:, None], 2, axis=1)
        return jnp.pad(halves, ((0, 0), (0, self.n_inner_row)))

    # --- the group

    def hinged_ends(self) -> Bool[np.ndarray, "n_elem 2"] | None:
        """Return which ends have a hinge that releases all rotations, [n_elem, 2] bool, or None.

        The rotation of such an end is a row of motion of its own. Ends with springs, or with hinges
        in some directions only, have inner unknowns instead and are not among them.
        """
        if self.hinges is None or self.springs is not None:
            return None
        return self.hinges.array.all(axis=2)

    def element_axes(self, nodes: Float[ArrayLike, "n_node 3"]) -> Float[Array, "n_elem 3 3"]:
        """Return the axes of all elements at initial positions [n_node, 3], m: [n_elem, 3, 3].

        Rows are the unit vectors along the element, and of the section's y and z.

        Example:
            >>> section = jc.Section.rectangle(0.04, 0.1, jc.Elastic(20e9))
            >>> beam = jc.Beams([[0, 1]], section=section)
            >>> print(beam.element_axes(np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]]))[0].round(6))
            [[ 0.  1.  0.]
             [-1.  0.  0.]
             [ 0.  0.  1.]]
        """
        xp = checks.numpy_or_jax(nodes)
        return _axes_of_elements(self.up, xp.asarray(nodes)[self.links.array[:, :2]])

    def with_fixed_axes(self, nodes: Float[ArrayLike, "n_node 3"]) -> Self:
        """Return the group with `up` given, so that its axes stay those at initial positions, m."""
        return self if self.up is not None else replace(self, up=self.element_axes(nodes)[:, 2])

    @property
    def has_memory(self) -> bool:  # type: ignore[override]  # read only
        """Whether a law of the section has history variables, such as plastic strains."""
        return shared_or_stacked(self.section).has_memory

    @property
    def has_rupture(self) -> bool:  # type: ignore[override]  # read only
        """Whether a law of the section has a rupture strain."""
        return shared_or_stacked(self.section).has_rupture

    def initial_memory(self) -> PyTree[Float[Array, "n_elem n_point n_fibre n_memory"]] | None:
        """Return the history variables of unstrained beams, an array for each law; None without."""
        if not self.has_memory:
            return None
        return shared_or_stacked(self.section).initial_memory((len(self.links), self.points))

    def extrapolated(self) -> Self:
        """Return the group with stress-strain curves extended beyond rupture, for an iteration."""
        return copy_with(
            self, section=map_over_elements(lambda section: section.for_analysis(), self.section)
        )

    def capacity(self) -> tuple[float | Scalar, float | Scalar]:
        """Return the smallest and the largest axial force of the section without bending, N."""
        area, law = self.section.uniaxial()
        low, high = law.capacity
        return low * area, high * area

    def strain_at(
        self, force: Scalar, memory: PyTree[Float[Array, " ..."]] | None = None
    ) -> Scalar:
        """Return the strain at an axial force, N, without bending; ValueError with `memory`."""
        if memory is not None:
            raise ValueError("pretension: state that of an elastic-plastic beam as prestrain")
        area, law = self.section.uniaxial()
        return law.strain_at(force / area)

    # --- one element

    def bends_isotropically(self) -> Bool[Array, ""]:
        """Return whether the bending stiffness of one element is the same in all directions."""
        return is_isotropic(self.section)

    def axes(self, ends: Ends) -> Float[Array, "3 3"]:
        """Return the initial axes of one element in rows: along it, the section's y and z."""
        return _beam_axes(self.up, ends)

    def end_slopes_and_axes(
        self, state: AxialState, ends: Ends, motion: Motion
    ) -> tuple[Float[Array, "2 3"], Float[Array, "3 3"]]:
        """Return end slopes of the axis against the chord, [2, 3], and rotated axes, [3, 3]."""
        _, pose = self._axes_and_pose(state, ends, motion)
        rotations = pose.rotations
        if (self.section.GAy, self.section.GAz) != (None, None):
            field = self._deformation(state, ends, motion)[2]
            rotations = bending.axis_slopes(field, rotations)
        _, about_y, about_z = rotations.T
        slopes = jnp.stack([jnp.zeros_like(about_y), about_z, -about_y], axis=1)
        return slopes @ pose.axes, pose.axes


def _rule_one_end_keeps_torsion(springs, hinges):
    """Return the `Rule` that torsion is restrained at one end of each element at least.

    Only the constructor can check it: in the compiled program hinges are rows of motion instead.
    """

    def broken(springs, hinges):
        free = (hinges & ~(springs > 0))[:, :, 0].all(axis=1)
        return free[:, None, None] & hinges & ~(springs != springs)

    def text(index, *_):
        return (
            f"hinges[{index[0]}]: both ends are released, the element could spin about its axis; "
            "make it a bar, or keep the torsion of one end"
        )

    return Rule("springs", (springs, hinges), broken, text)


def _beam_axes(up, ends):
    """Return unit axes of a beam in rows, [3, 3]: chord, y, z towards `up` [3] (None: upwards)."""
    chord = ends[1] - ends[0]
    along = chord / jnp.sqrt(scalar_product(chord, chord))
    if up is None:
        upright = along[0] ** 2 + along[1] ** 2 < VERTICAL_SINE**2
        up = jnp.where(upright, *jnp.eye(3, dtype=along.dtype)[jnp.array([0, 2])])
    z = up - scalar_product(up, along) * along
    z = z / jnp.sqrt(scalar_product(z, z))
    return jnp.stack([along, cross(z, along), z])


@as_program
def _axes_of_elements(up, ends):
    """Return `_beam_axes` of all elements, [n_elem, 3, 3]; a program."""
    return jax.vmap(_beam_axes)(up, ends)
