"""A phase: what is added to the structure, in how many increments."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from ..common import checks
from ..common.rules import Rule, kept, not_negative, positive, refuse
from ..common.selection import Only, Selection
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from ..elements.abilities import Jacked, Prestressable, Sagging
from ..elements.element import Element
from ..elements.prestress import Stated, of_each
from ..loads import as_list
from ..loads.load import Load
from ..model import plausibility
from ..model.structure import Structure
from ..model.supports import Supports

ABSOLUTE = ("pretension", "force_density", "prestrain", "rest_length", "sag", "jacking")
INCREMENTS = ("shortening", "temperature")

_TENSIONS = ("pretension", "force_density", "jacking")


@pytree(static=("increments",))
class Phase:
    """One phase of the analysis: everything is scaled by a load factor that goes from 0 to 1.

    Ways to state prestress, each a scalar (all bars and cables; beams only where these are absent,
    or for a temperature if they have an `expansion`), an array [n_elem], ``only(elements, values)``
    for some elements of a group, or a prefix pytree of these in the structure's elements. Absolute,
    referred to the initial nodes; one per element:

    - pretension: axial force in the initial geometry, N.
    - force_density: pretension over initial length, N/m.
    - prestrain: strain in the initial geometry, on the unstressed length.
    - rest_length: unstressed length, m (has only the digits of a length: a relative error of
      eps EA/N in the force).
    - sag: of catenaries, how far the middle hangs below that of the chord under all weight, m.
    - jacking: force held in the element during this phase whatever its length, N; at the end of the
      phase the jack is anchored: the unstressed length that it left is locked in.

    Increments, which may be combined with them: shortening (turnbuckle), m; temperature (change;
    the group needs `expansion`), K. Within a phase the absolute statement comes first, then the
    shortening, then the temperature. An absolute statement says what an element is at the
    temperature that it then has, so that it takes the place of all earlier statements and
    shortenings; the element stays as warm as it was, and a later change of temperature counts from
    there. Heat changes no weight, and no load per unstressed length.

    Args:
        loads: one load or a list; they add to those of earlier phases.
        supports: replaces the set of supports. A freedom that becomes fixed is held where it is,
            and nodal loads on it end (an anchored jack does not also pull); one that becomes free
            starts with its reaction, which is ramped out.
        increments: number of equal steps of the load factor.

    Raises:
        ValueError: `increments` no positive integer; what is no load, or no supports; in an
            analysis, two absolute statements for one element, or a value that its element cannot
            take; names both.

    Example:
        A flat net with 200 N in every cable, then loads on its free nodes in ten increments:

        >>> structure = jc.scenes.flat_net().structure
        >>> prestress = jc.Phase(pretension=200.0)
        >>> loads = jc.NodalLoads([3, 4, 7, 8], (0.0, 0.0, -15.0))
        >>> loading = jc.Phase(loads=loads, increments=10)
        >>> solution = jc.solve(structure, [prestress, loading])
        >>> print(f"{jc.describe(solution.status)}: {solution.displacement[3, 2]:.9f} m")
        converged: -0.012838093 m
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

    def __post_init__(self):
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
            raise ValueError("supports: expected pinned(nodes) or Supports(mask)")
        as_list(self.loads)
        for name in ABSOLUTE + INCREMENTS:
            for leaf in jax.tree.leaves(getattr(self, name)):
                checks.floats(leaf, name)

    def inputs(self, structure: Structure) -> list[dict[str, Stated]]:
        """Prestress statements per group: a list of dicts from name to `Stated`."""
        named = structure.named_groups()
        per_group = [{} for _ in named]
        for name in ABSOLUTE + INCREMENTS:
            values = spread(getattr(self, name), structure, name)
            if _is_scalar(getattr(self, name)):
                values = [
                    None if _passes_by(group, name, structure) else value
                    for value, group in zip(values, structure.groups, strict=True)
                ]
            for statement, (where, group), value in zip(per_group, named, values, strict=True):
                if value is not None:
                    try:
                        statement[name] = _checked(value, group, name)
                    except ValueError as error:
                        of = f"; in elements{where}" if where else ""
                        raise ValueError(f"{error}{of}") from None
        for k, (statement, (where, group)) in enumerate(zip(per_group, named, strict=True)):
            _require_apart(statement, k, group)
            for name, stated in statement.items():
                plausibility.prestress(name, stated, group, where, structure.nodes)
        return per_group


def _require_apart(statement, k, group):
    """Raise ValueError if two statements for an element of group `k` contradict each other."""
    absolute = [name for name in statement if name in ABSOLUTE]
    for number, name in enumerate(absolute):
        for other in absolute[:number]:
            if (where := _shared(statement[name], statement[other], k, group)) is not None:
                raise ValueError(
                    f"{other}, {name}: both state the prestress of {where}; "
                    "give one absolute statement per element"
                )
    for name in (name for name in statement if name in INCREMENTS and "jacking" in statement):
        if (where := _shared(statement[name], statement["jacking"], k, group)) is not None:
            raise ValueError(
                f"jacking: {where} has its force held in this phase; {name} must go into another "
                "phase"
            )


def _shared(one, other, k, group):
    """What two statements have in common, in words; None if nothing."""
    if one.chosen is None and other.chosen is None:
        return f"group {k}"
    both = _meant(one, group) & _meant(other, group)
    return f"element {int(both.argmax())} of group {k}" if both.any() else None


def _meant(stated, group):
    """The elements that a statement concerns, [n_elem] bool, NumPy."""
    return np.ones(len(group.links), bool) if stated.chosen is None else stated.chosen


def _is_scalar(value):
    leaf = jax.tree_util.treedef_is_leaf(jax.tree.structure(value))
    return leaf and value is not None and np.ndim(value) == 0


def _passes_by(group, name, structure):
    """Whether a scalar for the whole structure leaves out `group`.

    What it cannot be stated for, beside what it can; beams beside cables or bars.
    """

    def takes(own):
        return isinstance(own, Prestressable) and name in own.statements

    if not takes(group):
        return any(map(takes, structure.groups))
    mixed = any(takes(other) and not other.rotates for other in structure.groups)
    warms = name == "temperature" and group.expansion is not None
    return group.rotates and mixed and not warms


def spread(value: PyTree[Any], structure: Structure, name: str) -> list[Any]:
    """A prefix pytree of the elements as a list with one entry per group."""
    if value is None:
        return [None] * len(structure.groups)
    numbers = structure.arrange(list(range(len(structure.groups))))
    if isinstance(numbers, int) and isinstance(value, list | tuple):
        return [value]  # the values of the only group

    def is_row(x):
        return isinstance(x, list | tuple) and not any(
            isinstance(v, list | tuple | dict | Only | Selection) for v in x
        )

    def is_one(x):
        return x is None or isinstance(x, Only | Selection)

    # a list may be a branch of the tree of groups, or else the values of one group
    for is_leaf in (is_one, lambda x: is_one(x) or is_row(x)):
        values = [None] * len(structure.groups)

        def assign(v, subtree, values=values):
            for number in jax.tree.leaves(subtree):
                values[number] = v

        try:
            jax.tree.map(assign, value, numbers, is_leaf=is_leaf)
        except (ValueError, TypeError, KeyError):
            continue
        return values
    raise ValueError(
        f"{name}: expected a scalar, an array [n_elem], or a prefix pytree of the structure's "
        f"elements (None where a group has none), got {_shape(value)} for {_shape(numbers)}"
    )


def _shape(tree):
    """The shape of a pytree as text, without the name of its type."""
    shape = jax.tree.structure(tree, is_leaf=lambda x: x is None)
    return str(shape).removeprefix("PyTreeDef(").removesuffix(")")


def _checked(value, group, name):
    if isinstance(value, Selection):
        raise ValueError(f"{name}: only(...) has no values here; give only(elements, values)")
    if not isinstance(group, Prestressable):
        raise ValueError(f"{name}: a group of {type(group).__name__} cannot be prestressed")
    if name not in group.statements:
        told = ", ".join(group.statements)
        raise ValueError(f"{name}: of a group of {type(group).__name__} state {told}")
    if name == "sag" and (not isinstance(group, Sagging) or group.weight is None):
        raise ValueError(
            "sag: stated for catenaries with a weight only; for a chain of straight elements "
            "use forms.hanging_chain"
        )
    if name == "jacking" and not isinstance(group, Jacked):
        raise ValueError(f"jacking: a group of {type(group).__name__} has no jack")
    if name == "temperature" and group.expansion is None:
        raise ValueError("temperature: the group has no expansion coefficient; give expansion=...")
    count = len(group.links)
    if isinstance(value, Only):
        chosen = value.chosen(count, name)
        given, value = value.values, value.spread(np.zeros(count))
    else:
        chosen = None
        value = given = checks.per_element(value, count, name)
    refuse(_sign_rules(name, given, group))
    refuse(_capacity_rules(name, value, group, group.capacity))
    return Stated(value, chosen)


def keeps_rules(inputs: Sequence[dict[str, Stated]], groups: Sequence[Element]) -> Bool[Array, ""]:
    """Whether the prestress statements of a phase keep their rules, scalar bool, traced.

    Args:
        inputs: per group a dict from name to `Stated`.
        groups: element groups, as handed over.
    """
    whole = kept([])
    for group, own in zip(groups, inputs, strict=True):
        for name, stated in own.items():
            rules = _sign_rules(name, stated.values, group)
            each = functools.partial(of_each, "capacity", group)
            rules += _capacity_rules(name, stated.values, group, each)
            whole = whole & kept(rules, stated.chosen)
    return whole


def _sign_rules(name, values, group):
    """Rules of a statement of prestress by themselves, see `common.rules`."""
    if name == "rest_length":
        return [positive(name, values, "an unstressed length must be positive")]
    if name == "prestrain":
        return [Rule(name, values, lambda v: v <= -1, "a prestrain must be above -1")]
    if name == "sag":
        text = "a sag must be positive; a straight cable has no length of its own"
        return [positive(name, values, text)]
    if name in _TENSIONS and group.tension_only:
        text = "a cable carries tension only; must not be negative (use Bars)"
        return [not_negative(name, values, text)]
    return []


def _capacity_rules(name, values, group, capacity):
    """The rule that a law can carry what is stated for every element of its group, [n_elem].

    `capacity` gives the smallest and largest forces between which they can be.
    """
    if name not in ("pretension", "jacking") or not group.breaks:
        return []
    text = "above what its law can carry; a pretension must lie within the curve"

    def beyond(force, low, high):  # of a curve with NaN in it nothing is known: it passes
        more = 1 + 8 * np.finfo(force.dtype).eps  # a law reaches its own peak
        return (force < low * more) | (force > high * more)

    return [Rule(name, (values, *capacity()), beyond, text)]
