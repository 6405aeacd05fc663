"""Check that a class of elements keeps the contract of `element` and `abilities`.

`require_abilities` checks the attributes of every group of a structure. `check` is for authors of
elements: it also calls the methods of a group, and compares forces, tangent and energy.
"""

from __future__ import annotations

import numpy as np

from ..common.types import ArrayLike, Float
from . import trial
from .abilities import PHASE_INPUTS, Hanging, Jackable, Prestressable
from .element import SECTION_STRAIN, Element, Result
from .element_state import ElementState
from .phase_input import PhaseInput

REQUIRED_METHODS = {
    "has_memory": ("absolute_force", "initial_memory"),
    "has_rupture": ("is_ruptured",),
    "tension_only": ("is_slack", "at_kink"),
    "compression_only": ("is_slack", "at_kink"),
    "rotates": ("end_forces_after_step",),
    "slides": ("sliding_load_forces",),
}
"""Methods that a group must define where an attribute is True; see the table in `abilities`."""


def require_abilities(group: Element, name: str) -> None:
    """Raise ValueError if a group lacks methods or results that its attributes require.

    The attribute ``has_memory = True``, for example, requires a method `initial_memory`.

    Args:
        group: element group.
        name: name of the group in messages.
    """
    for text in _missing_ability_faults(group):
        raise ValueError(f"{name} ({type(group).__name__}): {text}")


def _missing_ability_faults(group):
    """Yield a sentence for each method or result that a group lacks, or declares wrongly.

    What it must have follows from its attributes and base classes, see `abilities`.
    """
    kind = type(group)
    for attribute, methods in REQUIRED_METHODS.items():
        for method in methods:
            if getattr(group, attribute) and _inherits_default(kind, method):
                yield f"{attribute} = True needs a method `{method}`"
    wrong = [result for result in group.results if not isinstance(result, Result)]
    if wrong:
        yield f"results: expected `Result`, got {wrong[0]!r}"
        return
    face, ends = group.face, range(group.links.shape[1] - group.n_inner_row)
    known = isinstance(face, tuple) and len({*ends} & {*face}) == len(face) in (3, 4)
    if face is not None and not known:
        yield f"face: expected a tuple of 3 or 4 ends of 0 to {len(ends) - 1}, got {face!r}"
    names = [result.name for result in group.results]
    if not group.has_memory and not _inherits_default(kind, "committed_memory"):
        yield "committed_memory: it is only asked where has_memory = True"
    by_strain = group.has_memory and _inherits_default(kind, "committed_memory")
    if by_strain and _inherits_default(kind, "commit_memory"):
        yield "has_memory = True needs a method `commit_memory`, or `committed_memory`"
    for attribute, needs in (("has_memory", by_strain), ("has_rupture", group.has_rupture)):
        if needs and SECTION_STRAIN.name not in names:
            yield f"{attribute} = True needs the result `{SECTION_STRAIN.name}`"
    for name in names:
        if not callable(getattr(group, name, None)):
            yield f"results: {name!r} is not a method of the group"
    if isinstance(group, Prestressable):
        for one in group.phase_inputs:
            if isinstance(one, str) and one not in PHASE_INPUTS:
                yield (
                    f"phase_inputs: {one!r} is none of {', '.join(PHASE_INPUTS)}; give a "
                    "`PhaseInput` for one of its own"
                )
            if isinstance(one, PhaseInput) and one.name in PHASE_INPUTS:
                yield f"phase_inputs: {one.name!r} is one of `Phase`; give the name alone"
        names = [one if isinstance(one, str) else one.name for one in group.phase_inputs]
        for name in group.components:
            if name not in names:
                yield f"components: {name!r} is none of its inputs"
        for name, ability in (("jacking", Jackable), ("sag", Hanging)):
            # groups that derive from `Prestressed` list all inputs, and refuse these
            own = "phase_inputs" in vars(kind)
            if own and name in group.phase_inputs and not isinstance(group, ability):
                yield f"phase_inputs: {name!r} needs the ability `{ability.__name__}`"


def _inherits_default(kind, method):
    """Return whether the class `kind` inherits `method`, a name, from `Element` itself."""
    return getattr(kind, method) is getattr(Element, method)


def check(
    group: Element,
    nodes: Float[ArrayLike, "n_node 3"],
    state: ElementState | None = None,
    motion: Float[ArrayLike, "n_row n_motion"] | None = None,
    *,
    tol: float = 1e-6,
    conservative: bool | None = None,
) -> None:
    """Test a class of elements of your own: shapes of all methods, forces against energy.

    The end forces must be the gradient of the energy and the tangent symmetric, unless the group
    says ``symmetric = False``; the tangent must be the derivative of the end forces in any case.
    Forces, tangent and energy must be finite, also before any motion. Arrays must be fields of the
    pytree, since others are lost where jax takes it apart. An input that selects no element must
    not change the state, and an element that is added must get a state of the same fields and
    shapes. Where elements rotate, the quaternions q and -q must give the same forces.

    Args:
        group: element group, with some elements.
        nodes: initial positions, [n_node, 3], m. Elements with inner unknowns need further rows
            after the nodes, at any position, and links to these rows.
        state: state of the group; default: the state before the first phase.
        motion: motion of all rows, [n_row, 3], or [n_row, 7] with rotations; default: random, of
            1 % of the mean distance of the ends (1 cm for elements of one end). It should strain
            the elements, and no force may have a kink there.

    Options:
        tol: largest allowed difference, relative to the largest entry; it must allow for the
            rounding of forces (use double precision).
        conservative: whether to compare forces with the energy; default: `symmetric`.

    Raises:
        ValueError: the group does not keep the contract; the message lists all faults.

    Example:
        >>> nodes = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0]]
        >>> bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e6)
        >>> jc.elements.check(bars, nodes)  # no message: no fault
    """
    found = [*trial.declaration_faults(group, len(np.asarray(nodes)))]
    if not found:  # calling methods needs a sound declaration
        conservative = group.symmetric if conservative is None else conservative
        found = [
            *_missing_ability_faults(group),
            *trial.method_faults(group, nodes, state, motion, tol, conservative),
        ]
    if found:
        raise ValueError(f"{type(group).__name__}: " + "; ".join(found))
