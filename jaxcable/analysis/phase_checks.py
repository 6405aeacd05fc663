"""Checks of the method, the supports and the loads of phases; messages name the phase."""

from __future__ import annotations

import contextlib
import functools
import itertools
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from typing import Any

import numpy as np

from ..common import checks
from ..common.tree import index_field
from ..elements.abilities import SecantStiffness
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..loads import as_list
from ..loads.load import FollowerLoad, OnNodes, PersistentLoad, PrescribedMovement
from ..loads.varying import Varying, split_amplitude
from ..model import phase_plausibility
from ..model.structure import Structure
from ..model.supports import FixedDofs
from ..model.torsional_mechanisms import warn_of_torsional_mechanisms
from .phases import Phase
from .solution import Solution, State


@functools.cache
def _default_method():
    """Return Newton's method with its default settings, one object for all analyses."""
    return Newton()


def check_method(structure: Structure, method: Any) -> Newton | Incremental:
    """Return the method of an analysis after checks, or `Newton` with its defaults if it is None.

    Raises:
        ValueError: not a method; or one by secant stiffness, which a group of elements lacks.
    """
    method = _default_method() if method is None else method
    if not isinstance(method, Newton | Incremental):
        raise ValueError(
            f"method: expected Newton or Incremental, got {_describe_wrong_method(method)}"
        )
    if _is_secant(method):
        for where, group in structure.named_groups():
            if not isinstance(group, SecantStiffness):
                raise ValueError(
                    f'stiffness = "secant": elements{where} ({type(group).__name__}) has no secant '
                    'stiffness (ability `SecantStiffness`); use "tangent"'
                )
    return method


def _is_secant(method):
    """Return whether a method is `Incremental` with ``stiffness="secant"``."""
    return isinstance(method, Incremental) and method.stiffness == "secant"


def _describe_wrong_method(method):
    """Return in words what was given in place of a method, and where it belongs."""
    if isinstance(method, Phase):
        return "Phase; phases go into one list: solve(structure, [first, second])"
    if isinstance(method, Solution | State):
        return f"{type(method).__name__}; an earlier solution goes by name: start=..."
    return checks.describe_type(method, "Newton()")


def refuse_secant_with_followers(
    method: Newton | Incremental, phases: Sequence[Phase], followed: bool, earlier: int = 0
) -> None:
    """Raise ValueError for follower loads with the secant scheme, which has no tangent stiffness.

    Args:
        method: of the analysis.
        phases: of the analysis.
        followed: whether the analysis begins under follower loads, those of `start`.
        earlier: number of phases solved before, by which messages number the phases.
    """
    if not _is_secant(method):
        return
    where = "start" if followed else None
    for k, phase in enumerate(phases):
        for j, given in enumerate(as_list(phase.loads)):
            base: Any = given.load if isinstance(given, Varying) else given
            if isinstance(base, FollowerLoad):
                where = where or f"phases[{earlier + k}].loads[{j}]"
    if where is not None:
        raise ValueError(
            f'stiffness = "secant" cannot be used with follower loads ({where}); use "tangent"'
        )


@contextlib.contextmanager
def prefix_errors(where: str) -> Iterator[None]:
    """Context manager that puts `where` in front of the message of a ValueError."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{where}{error}") from None


def check_loads(
    structure: Structure, phase: Phase, fixed: FixedDofs, where: str
) -> tuple[list[Any], ...]:
    """Check the loads of a phase and sort them: nodal loads, movements of supports, element loads.

    Args:
        structure: `Structure`.
        phase: `Phase`.
        fixed: degrees of freedom that are held in the phase.
        where: the phase in messages, such as "phases[0]".

    Returns:
        Three lists of pairs: a load, and its amplitude or None (`loads.varying.split_amplitude`).
    """
    found: tuple[list[Any], ...] = [], [], []
    for j, given in enumerate(as_list(phase.loads)):
        label = f"{where}.loads[{j}]"
        with prefix_errors(f"{label}: "):
            given.check(structure)
            _require_known_nodes(given, structure)
            if isinstance(given, FollowerLoad) and _is_known_to_be_zero(given):
                continue  # it would make the tangent unsymmetric
            load, amplitude = split_amplitude(given, label, phase.increments)
            if isinstance(load, PrescribedMovement):
                load.check_supported(fixed)
            if isinstance(load, PersistentLoad):
                load = load.with_group_indices(structure)
        for pairs, kind in zip(found, (OnNodes, PrescribedMovement, PersistentLoad), strict=True):
            if isinstance(load, kind):
                pairs.append((load, amplitude))
    return found


def _is_known_to_be_zero(load):
    """Return whether the numbers of a load that a factor would multiply are known, and all zero."""
    values = [checks.array_if_known(getattr(load, name)) for name in load.scales]
    return bool(values) and all(value is not None and not np.any(value) for value in values)


def _require_known_nodes(given, structure):
    """Raise ValueError if a load has a node number, in `nodes` or its list of forces, too large.

    Loads of the package have checked theirs; one that somebody has written may not do so.
    """
    load: Any = given.load if isinstance(given, Varying) else given
    kind, found = type(load).__name__, [index_field(load, "nodes")]
    if isinstance(load, OnNodes) and (listed := load.forces_at_nodes()) is not None:
        found.append(listed[0])
    for nodes in found:
        if nodes is not None:
            checks.require_known_nodes(nodes[:], structure.n_node, f"{kind}: nodes")


def without_amplitudes(loads: Sequence[Sequence[tuple[Any, Any]]]) -> list[list[Any]]:
    """Return the loads of every phase, given as pairs (load, amplitude), without amplitudes."""
    return [[load for load, _ in pairs] for pairs in loads]


_PHASES_TO_COME: ContextVar[Sequence[Phase]] = ContextVar("phases to come", default=())


@contextlib.contextmanager
def before_phases(phases: Sequence[Phase]) -> Iterator[None]:
    """Context manager of an analysis that others go on from: no warnings of what `phases` load."""
    token = _PHASES_TO_COME.set(phases)
    try:
        yield
    finally:
        _PHASES_TO_COME.reset(token)


def loads_of_all_phases(phases: Sequence[Phase]) -> list[Any]:
    """Return the loads of an analysis and of the phases that come after it (`before_phases`)."""
    every = *phases, *_PHASES_TO_COME.get()
    return [load for phase in every for load in as_list(phase.loads)]


def warn_of_free_ends(
    structure: Structure, phases: Sequence[Phase], fixed: Sequence[FixedDofs]
) -> None:
    """Warn of free ends of cables and corners of nets, unless loads act on unknown nodes.

    Nodes are not known of loads of one's own. `fixed` are the fixed degrees of freedom before the
    first phase and in each.
    """
    joined = [] if structure.rigid is None else [structure.rigid.array]
    for given in loads_of_all_phases(phases):
        load: Any = given.load if isinstance(given, Varying) else given
        found = [index_field(load, name) for name in ("nodes", "faces")]
        if found[0] is None and isinstance(load, OnNodes):
            return
        joined += [nodes.array.ravel() for nodes in found if nodes is not None]
    held = [own.array[: structure.n_node] for own in fixed]
    phase_plausibility.warn_of_free_ends(structure.nodes, structure.named_groups(), held, joined)


def check_supports(
    structure: Structure, phases: Sequence[Phase], fixed: FixedDofs, earlier: int = 0
) -> list[FixedDofs]:
    """Check the supports of all phases; return the fixed degrees of freedom before and in each.

    All have directions if any of them has some. Nodes that can spin get a warning. `fixed` are
    those before the first phase.

    Raises:
        ValueError: supports of a phase do not fit the structure, or hold a node in part along other
            directions than before.
    """
    sets = [fixed]
    for k, phase in enumerate(phases):
        if phase.supports is None:
            sets.append(sets[-1])
            continue
        with prefix_errors(f"phases[{earlier + k}]."):
            sets.append(_fixed_in_phase(structure, phase.supports))
        if structure.space.rotates:
            warn_of_torsional_mechanisms(structure, sets[-1], f"phases[{earlier + k}].supports")
    if all(fixed.axes is None for fixed in sets):
        return sets
    sets = [fixed.with_directions() for fixed in sets]
    for k, pair in enumerate(itertools.pairwise(sets)):
        _require_same_directions(*pair, earlier + k)
    return sets


def _fixed_in_phase(structure, supports):
    """Return the degrees of freedom that `supports` fix, `FixedDofs`.

    ValueError, whose message begins with "supports", if they do not fit the structure.
    """
    try:
        return structure.fixed(supports)
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith("supports") else f"supports: {text}") from None


def _require_same_directions(before, after, number):
    """Raise ValueError if phase `number` changes the directions in which a node is held in part.

    `before` and `after` are the `FixedDofs` before and in the phase.
    """
    for part in range(0, before.array.shape[1], 3):
        held = [fixed.array[:, part : part + 3] for fixed in (before, after)]
        in_part = [mask.any(axis=1) & ~mask.all(axis=1) for mask in held]
        differs = np.abs(before.axes.array - after.axes.array).max(axis=(1, 2)) > 1e-9
        turned = in_part[0] & in_part[1] & differs
        if turned.any():
            raise ValueError(
                f"phases[{number}].supports: node {int(turned.argmax())} is held along other "
                f"directions than {f'in phases[{number - 1}]' if number else 'before'}; put a "
                "phase between them in which it is free or fully held"
            )
