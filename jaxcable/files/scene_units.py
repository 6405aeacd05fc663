"""Numbers of scene files in units that the file states: to SI when it is read, and back.

What is converted are plain data, before objects are made of them and after objects have become
such: rules of numbers then see SI units only. The unit of a field is that of its docstring
(`field_units`), and the unit of what a phase states that of its `PhaseInput`.
"""

from __future__ import annotations

import dataclasses
from fractions import Fraction
from typing import Any

import numpy as np

from ..analysis.phases import Phase
from ..common.checks import holds_boolean
from ..common.units import Units, convert_array, dimensions, scale_exactly
from ..design.actions import Action
from ..elements.abilities import PHASE_INPUTS, accepted_inputs, component_names
from ..model.structure import Structure, is_group
from . import codec
from .field_docs import OF_PHASE_INPUT, field_units, may_have_unit
from .reading import FileError

_CONTAINERS = {"float32": "values", "list": "items", "tuple": "items"}
"""Fields with the contents of containers, by the text under "type"."""


class UnitError(FileError):
    """The unit of a number is not known: the file, or a docstring, does not state it."""


class SceneConverter:
    """Convert the numbers in parts of a scene, as plain data, between units and SI.

    Args:
        units: `Units` of the file.
        to_si: whether data of the file become SI; otherwise data in SI become those of the file,
            and `units` get one of mass if there are masses and they have none.
    """

    def __init__(self, units: Units, to_si: bool):
        self.units, self.to_si = units, to_si

    def __call__(
        self, data: Any, where: str, cls: type | None = None, structure: Structure | None = None
    ) -> Any:
        """Return the data of an object with converted numbers.

        Args:
            data: plain data of the object.
            where: its place in the scene, for messages.
            cls: its class, unless the data name it.
            structure: for a `Phase` or an `Action`, which state changes of elements.
        """
        found = self._convert_object(data, where, cls, 0)
        if structure is None or not isinstance(data, dict):
            return found
        for name in PHASE_INPUTS.keys() & data.keys():
            found[name] = self._convert_phase_input(name, data[name], f"{where}.{name}", structure)
        if isinstance(own := data.get("own"), dict):
            places = {name: f"{where}.own[{name!r}]" for name in own}
            found["own"] = {
                name: self._convert_phase_input(name, value, places[name], structure)
                for name, value in own.items()
            }
        return found

    def _conversion_factor(self, unit, where):
        """Return the exact factor of the conversion for numbers in an SI unit; None if it is 1.

        Raise UnitError, which names the place `where`, for quantities whose unit the file has to
        state (masses, temperatures), and does not.
        """
        try:
            powers = dimensions(unit)
        except ValueError as error:
            raise UnitError(f"{where}: {error}") from None
        if "kg" in powers and not self.to_si:  # the unit of reports, which the file then states
            self.units = dataclasses.replace(self.units, mass=self.units.symbol("kg"))
        units, what = self.units, None
        if "kg" in powers and units.mass is None:
            what, names, one = "is a mass", "", "kg"
        elif "K" in powers and units.temperature is None and not units.is_metric:
            what, names, one = "depends on the unit of temperatures", ", F or C", "F"
        if what is not None:
            raise UnitError(
                f"{where}: {what}, and the units {units} have none; add it{names}, as in "
                f'"{units}, {one}"'
            )
        factor = units.factor(unit)
        return None if factor == 1 else factor if self.to_si else 1 / factor

    def _convert_object(self, data, where, implied, depth):
        """Return the data of an object of a class in `TYPES` with converted numbers.

        `implied` is its class unless the data name it, `where` its place in the scene and `depth`
        the level of nesting. Unknown classes and fields stay as they are: reading refuses them.
        """
        name = data.get("type") if isinstance(data, dict) else None
        cls = codec.TYPES.get(name) if isinstance(name, str) else implied
        if not isinstance(data, dict) or cls is None or depth > codec.MOST_LEVELS:
            return data
        units = field_units(cls, codec.TYPES)
        kinds = {field.name: str(field.type) for field in codec.user_fields(cls)}
        found = dict(data)
        for key, value in data.items():
            if key not in kinds or (cls in (Phase, Action) and key in (*PHASE_INPUTS, "own")):
                continue
            place, unit = f"{where}.{key}", units.get(key)
            if unit is None and may_have_unit(cls, key, kinds[key]) and _has_numbers(value):
                raise UnitError(
                    f"{place}: the docstring of {cls.__name__} does not state the unit of {key}, "
                    "so that numbers in other units than SI cannot be read or written; add it, "
                    f'as in "{key}: ..., N/m." or "{key}: ..., without unit."'
                )
            if unit != OF_PHASE_INPUT:
                implied = codec.IMPLIED_CLASSES.get(key)
                found[key] = self._convert(value, unit, place, implied, depth + 1)
        return found

    def _convert(self, data, unit, where, implied=None, depth=0):
        """Return the data of a field with converted numbers, in the SI unit `unit` (None: no unit).

        Objects in the data have units of their own, except `Only`, which holds numbers in this
        unit. `where`, `implied` and `depth` are as of `_convert_object`.
        """
        factor = None if unit is None or data is None else self._conversion_factor(unit, where)

        def convert(value, place, level):
            if level > codec.MOST_LEVELS:
                return value
            if isinstance(value, list) and any(isinstance(item, dict) for item in value):
                return [convert(v, f"{place}[{k}]", level + 1) for k, v in enumerate(value)]
            if not isinstance(value, dict):
                return value if factor is None else _scale_numbers(value, factor)
            name = value.get("type")
            if isinstance(name, str) and name in _CONTAINERS and implied is None:
                found, inner = dict(value), _CONTAINERS[name]
            elif isinstance(name, str) or implied is not None:
                found, inner = self._convert_object(value, place, implied, level), "values"
                if name != "Only" or factor is None:
                    return found
            else:
                return {k: convert(v, f"{place}[{k!r}]", level + 1) for k, v in value.items()}
            if inner in value:
                found[inner] = convert(value[inner], place, level + 1)
            return found

        return convert(data, where, depth)

    def _convert_phase_input(self, name, data, where, structure):
        """Return what a phase states of elements in the field `name`, with converted numbers.

        The unit is that of the `PhaseInput` of each group. Raise UnitError where
        groups take it in different units and `data` do not tell groups apart; `where` is the place
        in the scene.
        """
        taken = [accepted_inputs(group).get(name) for group in structure.groups]
        units = {phase_input.unit for phase_input in taken if phase_input is not None}
        several = [g for g in structure.groups if name in PHASE_INPUTS and component_names(g, name)]
        if several and data is not None and self.units.factor(PHASE_INPUTS[name].unit) != 1:
            raise UnitError(
                f"{where}: {type(several[0]).__name__} takes several numbers of {name}, whose unit "
                "is not known; files with these are in SI only"
            )
        if name in PHASE_INPUTS or len(units) == 1:  # one that no group takes an analysis refuses
            return self._convert(data, units.pop() if units else PHASE_INPUTS[name].unit, where)

        def convert(value, elements, place):
            if value is None or elements is None:
                return value
            if is_group(elements):
                own = accepted_inputs(elements).get(name)
                return value if own is None else self._convert(value, own.unit, place)
            if isinstance(value, dict) and value.get("type") in ("list", "tuple"):
                return {**value, "items": convert(value.get("items"), elements, place)}
            parts = elements if isinstance(elements, dict) else dict(enumerate(elements))
            if isinstance(value, dict) and "type" not in value:
                return {k: convert(v, parts.get(k), f"{place}[{k!r}]") for k, v in value.items()}
            if isinstance(value, list) and not isinstance(elements, dict):
                return [convert(v, parts.get(k), f"{place}[{k}]") for k, v in enumerate(value)]
            raise UnitError(
                f"{place}: groups take {name} in different units ({', '.join(sorted(units))}); "
                "give a value for each group"
            )

        return convert(data, structure.elements, where) if units else data


def _has_numbers(value):
    """Return whether plain data are a number or contain one in lists; true and false are none."""
    if isinstance(value, dict):
        return any(_has_numbers(value.get(key)) for key in ("values", "items"))
    if isinstance(value, list):
        return any(map(_has_numbers, value))
    return isinstance(value, int | float) and not isinstance(value, bool)


def _scale_numbers(value: Any, factor: Fraction, depth: int = 0) -> Any:
    """Return a number, or nested lists of numbers, times a factor; anything else stays."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return scale_exactly(float(value), factor) if abs(value) < 1e300 else value
    if not isinstance(value, list) or depth > codec.MOST_LEVELS:
        return value
    try:
        array = np.array(value)
    except (ValueError, OverflowError):
        array = np.array(None)
    if array.dtype.kind in "if" and not holds_boolean(value):
        return convert_array(array, factor).tolist()
    return [_scale_numbers(item, factor, depth + 1) for item in value]
