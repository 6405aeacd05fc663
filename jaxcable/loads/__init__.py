"""What acts on a structure in a phase, one kind a file.

Dead loads keep direction and magnitude: on nodes (`nodal`), along elements (`along`), on areas
(`areas`; `meshes` finds the faces of a net). Following loads turn with what they press on
(`pressure`). Supports may be moved (`movement`). Loads of elements and areas go on acting in later
phases; `combine` scales and adds load cases.

A load is a pytree class with ``check(structure)`` and ``scaled(factor)``, and one of

- ``nodal_forces(shape, dtype)``, on nodes: it leaves freedoms that become fixed;
- ``element_forces(groups, states, nodes, shape, dtype)``, dead, evaluated at every load factor, and
  ``per_length(number, group, state, nodes)``: what of it shapes the elements of a group, or None;
- ``following_forces(groups, states, nodes, moved)`` and ``following_blocks``, their derivatives;
  ``touches(groups)``, the nodes that these couple; ``pressing(number, group)``, if it bends beams;
- ``steps(shape, dtype)``, of supports.
"""

from .along import LineLoads, SelfWeight
from .areas import AreaLoads
from .combine import combine
from .meshes import net_faces
from .movement import SupportMovement
from .nodal import NodalLoads
from .pressure import CablePressure, FacePressure

__all__ = [
    "AreaLoads",
    "CablePressure",
    "FacePressure",
    "LineLoads",
    "NodalLoads",
    "SelfWeight",
    "SupportMovement",
    "as_list",
    "combine",
    "net_faces",
]

_MEMBERS = ("nodal_forces", "element_forces", "following_forces", "steps")


def _hint(thing):
    """What to do with what is no load."""
    if isinstance(thing, type):
        return f"; call it: {thing.__name__}(...)"
    if isinstance(thing, float | int):
        return "; prestress has a name: Phase(pretension=...)"
    return "; expected NodalLoads(nodes, forces), SelfWeight(), LineLoads(...) or a list of such"


def as_list(loads):
    """Loads of a phase as a list.

    Args:
        loads: None, one load, or a list or tuple of loads.

    Returns:
        A list of loads.

    Raises:
        ValueError: something in it is no load; names its place.

    Example:
        >>> snow = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> [len(jc.loads.as_list(loads)) for loads in (None, snow, [snow, snow])]
        [0, 1, 2]
    """
    if loads is None:
        return []
    items = list(loads) if isinstance(loads, list | tuple) else [loads]
    for k, load in enumerate(items):
        if isinstance(load, type) or not any(hasattr(load, name) for name in _MEMBERS):
            raise ValueError(f"loads[{k}]: {type(load).__name__} is not a load{_hint(load)}")
    return items
