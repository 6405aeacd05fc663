"""Units of nets from files that do not state any: to SI, and doubts about a forgotten unit."""

from __future__ import annotations

import dataclasses
from os import PathLike

import numpy as np

from ..analysis.phases import Phase
from ..common.checks import warn_user
from ..common.units import Units, UnitsLike, as_units
from ..elements import Cables
from .codec import TYPES
from .field_docs import field_units
from .nets import PRESTRESS_INPUTS, Net

LARGEST_EXTENT = 1000.0
"""Extent above which the unit of coordinates is in doubt, m: the largest roofs and most bridges are
smaller. A net of 8 m whose nodes are in mm has 8000."""


def net_in_si(net: Net, units: Units) -> Net:
    """Return a net with all numbers converted to SI from `units`.

    Raise ValueError if a property depends on a unit of temperature that `units` do not state.
    """
    values = {}
    for name, numbers in net.values.items():
        unit = unit_of_net_value(name)
        if unit == "1/K" and units.temperature is None and not units.is_metric:
            raise ValueError(
                f"units = {str(units)!r}: {name} depends on the unit of temperatures; add it, F or "
                f'C, as in "{units}, F"'
            )
        values[name] = units.to_si(numbers, unit)
    loads = None if net.loads is None else units.to_si(net.loads, "N")
    return dataclasses.replace(net, nodes=units.to_si(net.nodes, "m"), loads=loads, values=values)


def unit_of_net_value(name: str) -> str:
    """Return the SI unit of an entry of ``Net.values``, a property of cables or a prestress."""
    return field_units(Phase if name in PRESTRESS_INPUTS else Cables, TYPES)[name]


def net_in_si_or_warn(net: Net, path: str | PathLike[str], units: UnitsLike | None) -> Net:
    """Return a net that was read from a file, with its numbers converted to SI from `units`.

    Without units (None) the numbers are taken as SI; an `InputWarning`, which names the file
    `path`, then asks for the unit of a net that is implausibly large.
    """
    if units is not None:
        return net_in_si(net, as_units(units))
    warn_if_implausibly_large(net, path)
    return net


def warn_if_implausibly_large(net: Net, path: str | PathLike[str]) -> None:
    """Issue an `InputWarning` for a net larger than 1 km: its file may be in millimetres.

    `path` is the file, for the message.
    """
    extent = float(np.ptp(net.nodes, axis=0).max())
    if extent > LARGEST_EXTENT:
        warn_user(
            f"{path}: the net extends over {extent / 1e3:.4g} km if its coordinates are in m; the "
            'file states no unit: give it, such as units="N, mm" (--units "N, mm")'
        )


def metres_per_drawing_unit(units: UnitsLike | None, scale: float | None) -> float | None:
    """Return the length of `units` in metres, or `scale` (metres per unit) if `units` are None.

    Raises:
        ValueError: both are given.
    """
    if units is None:
        return scale
    if scale is not None:
        raise ValueError("scale, units: both are given; scale alone says what coordinates are in")
    return float(as_units(units).factor("m"))
