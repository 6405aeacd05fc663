"""What acts on a structure in a phase, one kind a file.

Dead loads keep direction and magnitude: on nodes (`nodal`; `masses` by gravity), along elements
(`along`, `line_loads`), within beams (`points`, `path_loads`), on areas (`areas`; `net_meshes`
finds the faces of a net), wind and ice on members (`wind`, with `wind_profiles` over the height;
`ice`). Follower loads turn with the elements or faces that they press on (`pressure`). Supports may
be moved (`movement`). Loads of elements and areas go on acting in later phases. `Varying` lets any
of them follow an amplitude within its phase. `combine` scales load cases and adds them.

`load` is the contract: `Load` and the ways to act, `OnNodes`, `PrescribedMovement`, `DeadLoad`
(with `LoadPerGeometry`, for loads per length or area of a certain geometry) and `FollowerLoad`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .along import SelfWeight
from .areas import AreaLoads
from .combine import combine
from .ice import IceLoads
from .line_loads import LineLoads
from .load import Load
from .masses import PointMasses
from .movement import SupportMovement
from .net_meshes import net_faces
from .nodal import NodalLoads
from .path_loads import Crowd, Train
from .points import PointLoads
from .pressure import CablePressure, FacePressure
from .varying import Varying
from .wind import WindLoads
from .wind_profiles import EurocodeWind, WindPowerLaw, WindTable

__all__ = [
    "AreaLoads",
    "CablePressure",
    "Crowd",
    "EurocodeWind",
    "FacePressure",
    "IceLoads",
    "LineLoads",
    "NodalLoads",
    "PointLoads",
    "PointMasses",
    "SelfWeight",
    "SupportMovement",
    "Train",
    "Varying",
    "WindLoads",
    "WindPowerLaw",
    "WindTable",
    "as_list",
    "combine",
    "net_faces",
]


def _hint_for_wrong_load(thing):
    """Return advice for an error message about `thing`, which was given as a load but is none."""
    if isinstance(thing, type):
        return f"; call it: {thing.__name__}(...)"
    if isinstance(thing, float | int):
        return "; prestress has a name: Phase(pretension=...)"
    if isinstance(thing, dict):
        return "; a load is an object of a class such as NodalLoads(nodes, forces)"
    return "; expected NodalLoads(nodes, forces), SelfWeight(), LineLoads(...) or a list of such"


def as_list(loads: Load | Sequence[Load] | None) -> list[Load]:
    """Return the loads of a phase as a list.

    Args:
        loads: None, one load, or a list or tuple of loads.

    Returns:
        A list of loads.

    Raises:
        ValueError: an item is no load; the message has its index.

    Example:
        >>> snow = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> [len(jc.loads.as_list(loads)) for loads in (None, snow, [snow, snow])]
        [0, 1, 2]
    """
    if loads is None:
        return []
    items: list[Any] = list(loads) if isinstance(loads, list | tuple) else [loads]
    for k, load in enumerate(items):
        if not isinstance(load, Load):
            is_class = isinstance(load, type)
            kind = f"the class {load.__name__}" if is_class else type(load).__name__
            raise ValueError(f"loads[{k}]: {kind} is not a load{_hint_for_wrong_load(load)}")
    return items
