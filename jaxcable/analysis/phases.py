"""A phase: loads, supports and prestress that an analysis adds, in a number of increments."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import jax
import numpy as np

from ..common import checks
from ..common.selection import Only, Selection, WholeGroups
from ..common.tree import pytree, replace
from ..common.types import ArrayLike, Bool, Float, PyTree
from ..elements.abilities import PHASE_INPUTS
from ..elements.prestress import InputValues
from ..loads import as_list
from ..loads.load import Load
from ..model.structure import Structure
from ..model.supports import Supports
from .phase_inputs import ABSOLUTE_INPUTS as ABSOLUTE_INPUTS
from .phase_inputs import CLASS_INPUTS, check_phase_inputs
from .phase_inputs import INCREMENTAL_INPUTS as INCREMENTAL_INPUTS

PLACEMENTS = "drawn", "attached"
"""Where the nodes that new elements bring are placed."""
TENSION_ENDS = "lower", "upper", "first", "second"
"""Ends at which `Phase(tension_at=...)` can say that an end tension is."""


@pytree(static=("increments", "placed", "tension_at"))
class Phase:
    """One phase of the analysis: everything in it is scaled by a load factor from 0 to 1.

    Loads with an amplitude are scaled by a function of the load factor (`Varying`).

    A prestress input is a scalar (for all bars and cables; for beams only if there are no
    bars and cables, or for a temperature if they have an `expansion`), an array [n_elem],
    ``only(elements, values)`` for some elements of a group, or these by group, in the shape of the
    structure's elements: ``{"guys": 10e3}``. Groups that a dict leaves out, or that have None, have
    no input. Elements of your own may take several numbers each, [n_elem, n_component], such as
    along warp and weft (`elements.abilities.Prestressable`). Absolute inputs refer to the
    initial nodes; an element has one at most:

    - pretension: axial force in the initial geometry, N. In equilibrium it is another one, less
      where beams and struts give way: `end_tension` and `jacking` state that one.
    - force_density: pretension over initial length, N/m.
    - prestrain: strain in the initial geometry, on the unstressed length, without unit.
    - rest_length: unstressed length, m (has only the digits of a length: a relative error of
      eps EA/N in the force).
    - sag: of catenaries, vertical distance from the chord at midspan (half of the horizontal
      distance of the ends), m, under the whole weight of the group along -z, whatever loads act.
    - jacking: force that a jack keeps in the element during this phase whatever its length, N: the
      force in equilibrium. At the end of the phase the jack is anchored: the unstressed length is
      locked in, and the force follows later loads. For catenaries the same as `end_tension`.

    As-built inputs hold in equilibrium, at the end of this phase, with all loads and
    temperatures that there are then, wherever nodes have moved to. The unstressed length with which
    this is so is found by Newton's method, which analyses the phases some times; the phase applies
    it as it does a prestrain, and later phases keep it:

    - end_tension: tension at one end of a catenary, N: at its lower end, where guys and stays are
      jacked and measured, or at the end that `tension_at` names. For straight cables, bars and
      sliding cables, which have one force, the same as `jacking`.
    - horizontal_tension: of catenaries, horizontal force H, N: the part of the tension in the
      middle of the unstressed length along the chord in plan (`results.horizontal_tensions`).
    - built_sag: of catenaries with a weight, vertical distance below the chord at midspan, m, under
      all loads along the cable (`results.sags`).

    Increments may be combined with absolute inputs, and those of all phases add:

    - shortening: by how much a turnbuckle shortens the unstressed length, m.
    - temperature: change of the temperature, K; the group needs `expansion`.

    Changes of temperature lengthen an element to ``L (1 + expansion sum(dt))``, where L is its
    unstressed length at the temperature before the first phase, or at that of the phase that adds
    it: it has seen only changes from this phase on. Within a phase the absolute input comes
    first, then the shortening, then the temperature. An absolute input holds at the temperature
    that the element has then, and replaces all earlier inputs and shortenings. The element
    stays as warm as it was: cooled again, it is shorter than stated. A shortening is measured at
    the temperature of its phase, too. Heat changes no weight, and no load per unstressed length.

    Classes of elements that you write may know further inputs (`elements.phase_input.PhaseInput`),
    such as the friction of a saddle: ``own={"friction": {"saddles": 0.1}}``. They are numbers,
    given in the same ways; the class says whether they are ramped, and how long they last.

    An input acts on elements that are there (see `adds`). ``only(elements, values)`` for an
    element that is not there, or an input for a group without any that is, raises ValueError,
    or ends in INVALID_INPUT where the masks are traced. One number for the structure or a group is
    for those that are there. So is an array; a warning says if a phase adds an element, without a
    input, that an array before has had a number for.

    Args:
        loads: one load or a list; they add to those of earlier phases, which go on acting.
        supports: replaces the set of supports. A freedom that becomes fixed is held where it is,
            and nodal loads on it end (an anchored jack does not also pull). A freedom that becomes
            free begins with its reaction as a load, which is ramped out.
        increments: number of equal steps of the load factor.
        adds: elements that are there from this phase on, and not before: keys of groups, or a
            `Selection` or booleans [n_elem] by group. An element is unstressed where it finds its
            ends, unless it has a `rest_length` or an input, whose geometry is that of
            the structure's nodes. What no phase of an analysis adds is there from its beginning: an
            analysis of the first stages alone has to remove in its first phase what comes later.
            An empty list means None.
        removes: elements that go, likewise; their end forces are ramped out. One that is added
            again is new: what was stated for it before, and its temperature, are forgotten.

            Loads belong to nodes and elements, and stay: self-weight and loads along an element act
            whenever it is there, ramped in when it is added, also again, and ramped out when it is
            removed. A load on a node that no element touches is held there, and acts from the phase
            on in which an element is added to the node. Add the opposite load to end one.
        placed: where nodes wait that no element touches: "drawn", where they are, so that new
            elements reach from where others have moved; or "attached": they go along with the node
            that their first element joins them to, as if rigidly, with its rotation.
        own: inputs of your own classes of elements, by name: ``{"friction": {"saddles": 0.1}}``;
            each in the unit of what is stated, that of its `PhaseInput`.
        tension_at: where `end_tension` and the `jacking` of catenaries are: at the "lower" or the
            "upper" end of each element in the geometry as drawn (of ends at one level the first is
            the lower one), or at its "first" or "second" end, in the order of its nodes.
        clamped: where cables with friction are clamped to their deviators, without unit: 1 closes
            a clamp at the beginning of the phase, 0 opens it; what is not stated stays as it is.
            One number for all deviators, or [n_elem, n_deviator] by group (for one cable also
            [n_deviator]); the first deviator is the second node of the cable.
        stressed_ends: at which ends of cables with friction jacks pull and shortenings are taken
            out, without unit: 1 for an end, else 0, for the first and the last end by group,
            [n_elem, 2] (for one cable also [2]); 1 alone: both. What is not stated stays as it is;
            before it is stated, the first end. Both ends have the force of the jack, and half of
            a shortening each.

    Raises:
        ValueError: `increments` is no positive integer, `loads` has something else than loads,
            `supports` is no `Supports`, `placed` is unknown; in an analysis, two absolute
            inputs for one element, a value that an element cannot take, an input of `own`
            that no element knows, elements that are added twice. The message names input and
            element.

    Example:
        A flat net with 200 N in every cable, then loads on its free nodes in ten increments:

        >>> structure = jc.scenes.flat_net().structure
        >>> prestress = jc.Phase(pretension=200.0)
        >>> loads = jc.NodalLoads([3, 4, 7, 8], (0.0, 0.0, -15.0))
        >>> loading = jc.Phase(loads=loads, increments=10)
        >>> solution = jc.solve(structure, [prestress, loading])
        >>> print(f"{jc.describe(solution.status)}: {solution.displacement[3, 2]:.9f} m")
        converged: -0.012838093 m

        A bar under 1 kN, which a second one helps to carry from the second kN on:

        >>> bars = {n: jc.Bars([[0, 1]], axial_stiffness=1e6) for n in ("first", "second")}
        >>> nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, -2.0]]
        >>> guide = jc.restrained([1], "xy")
        >>> structure = jc.Structure(nodes, bars, supports=jc.pinned([0]) + guide)
        >>> load = jc.NodalLoads([1], (0.0, 0.0, -1e3))
        >>> stages = [jc.Phase(loads=load), jc.Phase(adds="second", loads=load)]
        >>> solution = jc.solve(structure, stages)
        >>> print({name: float(force[0].round(2)) for name, force in solution.tension.items()})
        {'first': 1500.25, 'second': 499.75}
    """

    loads: Load | Sequence[Load] | None = None
    increments: int = 1
    supports: Supports | None = None
    pretension: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | Only] | None = None
    force_density: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | Only] | None = None
    prestrain: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | Only] | None = None
    rest_length: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | Only] | None = None
    sag: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | Only] | None = None
    jacking: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | Only] | None = None
    shortening: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | Only] | None = None
    temperature: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | Only] | None = None
    adds: str | Sequence[str] | PyTree[Bool[ArrayLike, " n_elem"] | Selection] | None = None
    removes: str | Sequence[str] | PyTree[Bool[ArrayLike, " n_elem"] | Selection] | None = None
    placed: Literal["drawn", "attached"] = "drawn"
    own: Mapping[str, PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | Only]] | None = (
        None
    )
    end_tension: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | Only] | None = None
    horizontal_tension: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | Only] | None = (
        None
    )
    built_sag: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, " n_elem"] | Only] | None = None
    tension_at: Literal["lower", "upper", "first", "second"] = "lower"
    clamped: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, "n_elem n_deviator"] | Only] | None = (
        None
    )
    stressed_ends: PyTree[Float[ArrayLike, ""] | Float[ArrayLike, "n_elem 2"] | Only] | None = None

    def __post_init__(self):
        for name in ("adds", "removes"):
            object.__setattr__(self, name, keys_as_whole_groups(getattr(self, name)))
        if self.placed not in PLACEMENTS:
            raise ValueError(f"placed = {self.placed!r}: expected one of {', '.join(PLACEMENTS)}")
        checks.require_one_of(self.tension_at, "tension_at", TENSION_ENDS)
        if isinstance(self.increments, bool) or not isinstance(self.increments, int | np.integer):
            if isinstance(self.increments, jax.core.Tracer):
                raise ValueError(
                    "increments = a traced number: expected an integer; it sets the size of the "
                    "program, so that jit, vmap and grad cannot vary it"
                )
            raise ValueError(f"increments = {self.increments!r}: expected an integer")
        if self.increments < 1:
            raise ValueError(f"increments = {self.increments}: a phase has at least 1 increment")
        if self.supports is not None and not isinstance(self.supports, Supports):
            kind = checks.describe_type(self.supports, "pinned(nodes)")
            raise ValueError(f"supports: expected pinned(nodes) or Supports(mask), got {kind}")
        as_list(self.loads)
        self._check_own_inputs()
        for name, given in all_phase_inputs(self).items():
            for leaf in jax.tree.leaves(given):
                checks.as_floats(leaf, name)

    def _check_own_inputs(self):
        """Raise ValueError unless `own` is a dict whose names are no other arguments of `Phase`."""
        if self.own is not None and not isinstance(self.own, Mapping):
            kind = checks.describe_type(self.own, '{"friction": values}')
            raise ValueError(f"own: expected a dict of inputs by name, got {kind}")
        fields = {field.name for field in dataclasses.fields(self)}
        for name in self.own or ():
            if name in fields:
                raise ValueError(f"own: {name!r} is an argument of Phase: Phase({name}=...)")

    def inputs(self, structure: Structure, where: str = "") -> list[dict[str, InputValues]]:
        """Check what the phase states of elements, such as pretension, and assign it to the groups.

        Messages begin with `where`, such as "phases[0].", and the name of the input.

        Returns:
            For every group a dict from the name of an input to `InputValues`.
        """
        return check_phase_inputs(all_phase_inputs(self), structure, where)


def all_phase_inputs(phase: Phase) -> dict[str, Any]:
    """Return what a phase states of elements, as given: a dict by name (pretension, ..., `own`)."""
    names = (*ABSOLUTE_INPUTS, *INCREMENTAL_INPUTS, *CLASS_INPUTS)
    fields = {name: getattr(phase, name) for name in names}
    return {n: given for n, given in {**fields, **(phase.own or {})}.items() if given is not None}


def with_phase_input(phase: Phase, name: str, given: PyTree[Any]) -> Phase:
    """Return a copy of a phase with another value of pretension or another input `name`."""
    if name in (*PHASE_INPUTS, *CLASS_INPUTS):
        return replace(phase, **{name: given})
    return replace(phase, own={**(phase.own or {}), name: given})


def keys_as_whole_groups(value: Any) -> Any:
    """Convert what a phase adds or removes: keys become `WholeGroups`, empty lists None."""
    if isinstance(value, list | tuple | dict) and not value:
        return None
    if isinstance(value, str):
        return WholeGroups(value)
    if isinstance(value, list | tuple) and value and all(isinstance(v, str) for v in value):
        return WholeGroups(value)
    return value


def as_phases(structure: Structure, phases: Phase | Sequence[Phase] | None) -> list[Phase]:
    """Return the phases of an analysis as a list; ValueError for wrong structures or phases."""
    if isinstance(structure, tuple) and structure and isinstance(structure[0], Structure):
        raise ValueError("structure: got a scene; unpack it: solve(*scene)")
    if not isinstance(structure, Structure):
        kind = checks.describe_type(structure, "Structure(nodes, elements, supports)")
        raise ValueError(f"structure: expected a Structure, got {kind}")
    if phases is None:
        raise ValueError("phases: missing; give a list such as [Phase(pretension=200.0)]")
    if not isinstance(phases, Phase | list | tuple):
        hint = "; loads go into a phase: [Phase(loads=...)]" if isinstance(phases, Load) else ""
        raise ValueError(f"phases: expected a list of Phase, got {type(phases).__name__}{hint}")
    phases = [phases] if isinstance(phases, Phase) else list(phases)
    for k, phase in enumerate(phases):
        if not isinstance(phase, Phase):
            hint = "; loads go into a phase: Phase(loads=...)" if isinstance(phase, Load) else ""
            kind = checks.describe_type(phase, "Phase(...)")
            raise ValueError(f"phases[{k}]: expected a Phase, got {kind}{hint}")
    if not phases:
        raise ValueError("phases: an analysis needs at least one phase")
    return phases
