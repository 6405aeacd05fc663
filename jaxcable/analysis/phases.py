"""A phase: loads, supports and prestress that an analysis adds, in a number of increments."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import refuse_if_broken
from ..common.selection import Only, Selection, WholeGroups
from ..common.tree import pytree, replace
from ..common.types import ArrayLike, Bool, Float, PyTree
from ..elements.abilities import (
    STATEMENTS,
    Jacked,
    Prestressable,
    Sagging,
    components_of,
    statements_of,
)
from ..elements.prestress import Stated
from ..loads import as_list
from ..loads.load import Load
from ..model import plausibility
from ..model.structure import Structure
from ..model.supports import Supports
from .by_group import is_scalar, spread
from .prestress_rules import capacity_rules, span_rules, value_rules

ABSOLUTE = ("pretension", "force_density", "prestrain", "rest_length", "sag", "jacking")
"""Statements that replace the prestress of an element."""
INCREMENTS = ("shortening", "temperature")
"""Statements that change the prestress of an element."""

PLACES = "drawn", "attached"
"""Where the nodes that new elements bring are placed."""


@pytree(static=("increments", "placed"))
class Phase:
    """One phase of the analysis: everything in it is scaled by a load factor from 0 to 1.

    Loads with an amplitude are scaled by a function of the load factor (`Varying`).

    A statement of prestress is a scalar (for all bars and cables; for beams only if there are no
    bars and cables, or for a temperature if they have an `expansion`), an array [n_elem],
    ``only(elements, values)`` for some elements of a group, or these by group, in the shape of the
    structure's elements: ``{"guys": 10e3}``. Groups that a dict leaves out, or that have None, have
    no statement. Elements of your own may take several numbers each, [n_elem, n_component], such as
    along warp and weft (`elements.abilities.Prestressable`). Absolute statements refer to the
    initial nodes; an element has one at most:

    - pretension: axial force in the initial geometry, N. In equilibrium it is another one, less
      where beams and struts give way: `jacking` keeps a force, and `design.tune` finds what ends
      in it.
    - force_density: pretension over initial length, N/m.
    - prestrain: strain in the initial geometry, on the unstressed length, without unit.
    - rest_length: unstressed length, m (has only the digits of a length: a relative error of
      eps EA/N in the force).
    - sag: of catenaries, vertical distance from the chord at midspan (half of the horizontal
      distance of the ends), m, under the whole weight of the group along -z, whatever loads act.
    - jacking: force that a jack keeps in the element during this phase whatever its length, N: the
      force in equilibrium. At the end of the phase the jack is anchored: the unstressed length is
      locked in, and the force follows later loads.

    Increments may be combined with absolute statements, and those of all phases add:

    - shortening: by how much a turnbuckle shortens the unstressed length, m.
    - temperature: change of the temperature, K; the group needs `expansion`.

    Changes of temperature lengthen an element to ``L (1 + expansion sum(dt))``, where L is its
    unstressed length at the temperature before the first phase, or at that of the phase that adds
    it: it has seen only changes from this phase on. Within a phase the absolute statement comes
    first, then the shortening, then the temperature. An absolute statement holds at the temperature
    that the element has then, and replaces all earlier statements and shortenings. The element
    stays as warm as it was: cooled again, it is shorter than stated. A shortening is measured at
    the temperature of its phase, too. Heat changes no weight, and no load per unstressed length.

    Classes of elements that you write may know further statements (`elements.stated.Statement`),
    such as the friction of a saddle, or a clamp: ``own={"clamped": {"saddles": 1}}``. They are
    numbers, given in the same ways; the class says whether they are ramped, and how long they last.

    A statement acts on elements that are there (see `adds`). ``only(elements, values)`` for an
    element that is not there, or a statement for a group without any that is, raises ValueError,
    or ends in INVALID_INPUT where the masks are traced. One number for the structure or a group is
    for those that are there. So is an array; a warning says if a phase adds an element, without a
    statement, that an array before has had a number for.

    Args:
        loads: one load or a list; they add to those of earlier phases, which go on acting.
        supports: replaces the set of supports. A freedom that becomes fixed is held where it is,
            and nodal loads on it end (an anchored jack does not also pull). A freedom that becomes
            free begins with its reaction as a load, which is ramped out.
        increments: number of equal steps of the load factor.
        adds: elements that are there from this phase on, and not before: keys of groups, or a
            `Selection` or booleans [n_elem] by group. An element is unstressed where it finds its
            ends, unless it has a `rest_length` or a statement, whose geometry is that of
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
        own: statements of your own classes of elements, by name: ``{"clamped": {"saddles": 1}}``.

    Raises:
        ValueError: `increments` is no positive integer, `loads` has something else than loads,
            `supports` is no `Supports`, `placed` is unknown; in an analysis, two absolute
            statements for one element, a value that an element cannot take, a statement of `own`
            that no element knows, elements that are added twice. The message names statement and
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

    def __post_init__(self):
        for name in ("adds", "removes"):
            object.__setattr__(self, name, by_name(getattr(self, name)))
        if self.placed not in PLACES:
            raise ValueError(f"placed = {self.placed!r}: expected one of {', '.join(PLACES)}")
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
        self._check_own()
        for name, given in all_stated(self).items():
            for leaf in jax.tree.leaves(given):
                checks.as_floats(leaf, name)

    def _check_own(self):
        """Raise ValueError if `own` is no dict of statements that `Phase` does not have itself."""
        if self.own is not None and not isinstance(self.own, Mapping):
            kind = checks.describe_type(self.own, '{"clamped": values}')
            raise ValueError(f"own: expected a dict of statements by name, got {kind}")
        fields = {field.name for field in dataclasses.fields(self)}
        for name in self.own or ():
            if name in fields:
                raise ValueError(f"own: {name!r} is an argument of Phase: Phase({name}=...)")

    def statements(self, structure: Structure) -> list[dict[str, Stated]]:
        """Prestress statements per group: a list of dicts from name to `Stated`."""
        named = structure.named_groups()
        per_group = [{} for _ in named]
        for name, given in all_stated(self).items():
            values = _by_group(given, structure, name)
            for statements, (where, group), value in zip(per_group, named, values, strict=True):
                if value is not None:
                    try:
                        statements[name] = _checked(value, group, name, structure)
                    except ValueError as error:
                        of = f"; in elements{where}" if where else ""
                        raise ValueError(f"{error}{of}") from None
        for statements, (where, group) in zip(per_group, named, strict=True):
            _require_apart(statements, where, group)
            for name, stated in statements.items():
                if not components_of(group, name):
                    plausibility.prestress(name, stated, group, where, structure.nodes)
        return per_group


def all_stated(phase: Phase) -> dict[str, Any]:
    """What a phase states of elements, by the names of statements, as it is given."""
    fields = {name: getattr(phase, name) for name in (*ABSOLUTE, *INCREMENTS)}
    return {n: given for n, given in {**fields, **(phase.own or {})}.items() if given is not None}


def restated(phase: Phase, name: str, given: PyTree[Any]) -> Phase:
    """The phase with another value of one statement."""
    if name in STATEMENTS:
        return replace(phase, **{name: given})
    return replace(phase, own={**(phase.own or {}), name: given})


def by_name(value: Any) -> Any:
    """What a phase adds or removes, with keys of groups as `WholeGroups`; None if it is empty."""
    if isinstance(value, list | tuple | dict) and not value:
        return None
    if isinstance(value, str):
        return WholeGroups(value)
    if isinstance(value, list | tuple) and value and all(isinstance(v, str) for v in value):
        return WholeGroups(value)
    return value


def _by_group(given, structure, name):
    """The values of a statement, a list with an entry per group, None if it has none of it."""
    groups = structure.groups
    if name not in STATEMENTS:
        _require_known(name, groups)
    if is_scalar(given):
        return [None if _passes_by(group, name, structure) else given for group in groups]
    return spread(given, structure, name)


def _require_known(name, groups):
    """Raise ValueError if no group has a statement of this name."""
    known = {statement: type(group) for group in groups for statement in statements_of(group)}
    if name not in known:
        own = [f"{s!r} of {kind.__name__}" for s, kind in known.items() if s not in STATEMENTS]
        there = f"; there are {', '.join(own)}" if own else ""
        raise ValueError(f"own: no group of the structure has a statement {name!r}{there}")


def _require_apart(statements, where, group):
    """Raise ValueError if two statements for an element of the group contradict each other.

    `where` is the key of the group in the elements, as text.
    """
    absolute = [name for name in statements if name in ABSOLUTE]
    for number, name in enumerate(absolute):
        for other in absolute[:number]:
            if (both := _shared(statements[name], statements[other], where, group)) is not None:
                raise ValueError(
                    f"{other}, {name}: both state the prestress of {both}; "
                    "give one absolute statement per element"
                )
    for name in (name for name in statements if name in INCREMENTS and "jacking" in statements):
        if (both := _shared(statements[name], statements["jacking"], where, group)) is not None:
            raise ValueError(
                f"jacking: {both} has its force held in this phase; {name} must go into another "
                "phase"
            )


def _shared(one, other, where, group):
    """The first element that two statements concern, in words; None if there is none."""
    if one.chosen is None and other.chosen is None:
        return f"elements{where}"
    both = _meant(one, group) & _meant(other, group)
    return f"element {int(both.argmax())} of elements{where}" if both.any() else None


def _meant(stated, group):
    """The elements that a statement concerns, [n_elem] bool, NumPy."""
    return np.ones(len(group.links), bool) if stated.chosen is None else stated.chosen


def _passes_by(group, name, structure):
    """Whether a scalar stated for the whole structure leaves out `group`.

    It leaves out groups that cannot take it, if another group can; and beams, and groups that take
    several components, beside cables or bars.
    """

    def takes(any_group):
        return name in statements_of(any_group)

    def differs(any_group):  # its numbers mean something else than those of cables and bars
        return any_group.rotates or bool(components_of(any_group, name))

    if not takes(group):
        return any(map(takes, structure.groups))
    if name not in STATEMENTS:
        return False
    mixed = any(takes(other) and not differs(other) for other in structure.groups)
    warms = name == "temperature" and group.expansion is not None
    return differs(group) and mixed and not warms


def _checked(value, group, name, structure):
    """The value of a statement for a group as `Stated`; ValueError if the group cannot take it."""
    if isinstance(value, Selection):
        raise ValueError(f"{name}: only(...) has no values here; give only(elements, values)")
    known = statements_of(group)
    if name not in known and name not in STATEMENTS:
        having = [type(g).__name__ for g in structure.groups if name in statements_of(g)]
        kinds = ", ".join(dict.fromkeys(having))
        raise ValueError(f"{name}: a statement of {kinds}, not of {type(group).__name__}")
    if not isinstance(group, Prestressable):
        raise ValueError(f"{name}: a group of {type(group).__name__} cannot be prestressed")
    if name not in known:
        possible = ", ".join(known)
        raise ValueError(f"{name}: of a group of {type(group).__name__} state {possible}")
    if name == "sag" and (not isinstance(group, Sagging) or group.weight is None):
        raise ValueError(
            "sag: stated for catenaries with a weight only; for a chain of straight elements "
            "use forms.hanging_chain"
        )
    if name == "jacking" and not isinstance(group, Jacked):
        raise ValueError(f"jacking: a group of {type(group).__name__} has no jack")
    if name == "temperature" and group.expansion is None:
        raise ValueError("temperature: the group has no expansion coefficient; give expansion=...")
    count, components = len(group.links), components_of(group, name)
    if isinstance(value, Only):
        chosen = value.element_mask(count, name)
        given = _per_element(value.values, len(value.elements), name, components)
        value = value.merged_with(np.zeros((count, *given.shape[1:])))
    else:
        chosen = None
        value = given = _per_element(value, count, name, components)
    refuse_if_broken(value_rules(name, given, group))
    refuse_if_broken(capacity_rules(name, value, group, group.capacity))
    refuse_if_broken(span_rules(name, group, structure.nodes, chosen))
    return Stated(value, chosen)


def _per_element(value, count, name, components):
    """Values as floats [n_elem], or [n_elem, n_component]; one number is for all of them."""
    if not components:
        return checks.floats_per_element(value, count, name)
    array, shape = checks.as_floats(value, name), (count, len(components))
    if array.shape not in ((), shape):
        raise ValueError(
            f"{name}: expected a scalar or shape {shape}, for every element "
            f"{', '.join(components)}, got shape {array.shape}"
        )
    pack = jnp if isinstance(array, jax.Array) else np
    return pack.broadcast_to(array, shape)


def as_phases(structure: Structure, phases: Phase | Sequence[Phase] | None) -> list[Phase]:
    """The phases of an analysis as a list; ValueError for a wrong structure or wrong phases."""
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
