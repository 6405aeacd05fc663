"""Building blocks of scenes: the record `Scene`, links, points, loads, steel sections, phases."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..analysis.phases import Phase
from ..common.types import ArrayLike, Float, Int
from ..common.units import Units, UnitsLike, as_units
from ..loads import NodalLoads
from ..loads.load import Load
from ..materials import Elastic
from ..model.structure import Structure
from ..sections import Section, bredt_torsion

STEEL = 210e9  # modulus of elasticity of steel, N/m2
STRAND = 195e9  # modulus of elasticity of parallel strands, N/m2
STRAND_STRESS = 500e6  # stress in strands under dead load, N/m2; their strength is 1860e6
STEEL_WEIGHT = 77e3  # N/m3 (7 850 kg/m3)


class Scene(NamedTuple):
    """A structure and the phases of its analysis: ``jc.solve(*scene)``.

    Attributes:
        structure: `Structure`.
        phases: list of `Phase`.

    Example:
        >>> scene = jc.scenes.flat_net(load=15.0)
        >>> structure, phases = scene
        >>> int(jc.solve(*scene).status), structure.n_node, len(phases)
        (0, 12, 2)

    A scene from a file that states its units has them as `units`; its numbers are in SI all the
    same. Pass them on: ``jc.report(structure, solution, units=scene.units)``. A file may also have
    actions to combine, which the scene has as `actions`, by the rules `combination_rules`, the
    `checks` of their results, and names of its phases, `phase_names`.
    """

    structure: Structure
    phases: list[Phase]

    @property
    def units(self) -> Units | None:
        """The `Units` that the file of the scene states; None for SI."""
        return getattr(self, "_units", None)

    def with_units(self, units: UnitsLike | None) -> Scene:
        """Return the same scene, in SI, with other `units` to write and to show it in."""
        return self._with_file_values(units=None if units is None else as_units(units))

    @property
    def actions(self) -> list[Any]:
        """The actions (`design.Action`) that the file of the scene has, to combine; a list."""
        return list(getattr(self, "_actions", ()))

    @property
    def phase_names(self) -> tuple[str, ...] | None:
        """The names of the phases that the file of the scene has; None without names."""
        return getattr(self, "_phase_names", None)

    def with_phase_names(self, names: Sequence[str] | None) -> Scene:
        """Return the same scene with other `phase_names`, as many as there are phases, or None."""
        return self._with_file_values(phase_names=None if names is None else tuple(names))

    def with_actions(self, actions: Sequence[Any]) -> Scene:
        """Return the same scene with other `actions`, a list of `design.Action`."""
        return self._with_file_values(actions=tuple(actions))

    @property
    def combination_rules(self) -> str | dict[str, Any] | None:
        """The standard by whose rules the file combines the actions, or rules; None for none."""
        return getattr(self, "_combination_rules", None)

    def with_combination_rules(self, rules: str | dict[str, Any] | None) -> Scene:
        """Return the same scene with other `combination_rules`, such as "EN 1990"."""
        return self._with_file_values(combination_rules=rules)

    @property
    def checks(self) -> list[Any]:
        """The checks that the file has, a list as `design.checks` takes it."""
        return list(getattr(self, "_checks", ()))

    def with_checks(self, checks: Sequence[Any]) -> Scene:
        """Return the same scene with other `checks`."""
        return self._with_file_values(checks=tuple(checks))

    def _with_file_values(self, **values):
        """Return the same scene with other values of units, actions, checks and so on, by name."""
        scene = _SceneOfFile(*self)
        own = {f"_{name}": value for name, value in values.items()}
        vars(scene).update(getattr(self, "__dict__", {}), **own)
        return scene


class _SceneOfFile(Scene):
    """A `Scene` that can have what a file has beside structure and phases."""

    def _replace(self, **changes):
        """Return the scene with another structure or phases, and all else that the file has."""
        scene = super()._replace(**changes)
        vars(scene).update(vars(self))
        return scene


def two_phase_scene(
    structure: Structure, increments: tuple[int, int], then: Load | list[Load], **first: Any
) -> Scene:
    """Make a scene of two phases: `first` are the fields of phase 0; phase 1 adds the loads `then`.

    `increments` are the numbers of increments of both.
    """
    phases = Phase(increments=increments[0], **first), Phase(loads=then, increments=increments[1])
    return Scene(structure, list(phases))


def downward_loads(nodes: ArrayLike, load: ArrayLike) -> NodalLoads:
    """Return `NodalLoads` that act downward on nodes: `load` is one force for all, or [n], N."""
    if np.ndim(load) == 0:
        return NodalLoads(nodes, (0.0, 0.0, -load))
    return NodalLoads(nodes, np.outer(load, [0.0, 0.0, -1.0]))


def chain_links(nodes: ArrayLike, closed: bool = False) -> Int[np.ndarray, "n_elem 2"]:
    """Return the links from each node to the next, [n_elem, 2]; if closed, also last to first."""
    nodes = np.asarray(nodes)
    return np.column_stack([nodes, np.roll(nodes, -1)])[: None if closed else -1]


def points_on_circle(
    radius: float, angle: Float[ArrayLike, " n"], height: float
) -> Float[np.ndarray, "n 3"]:
    """Return the points of a horizontal circle about the z axis, [n, 3], m, at angles in rad."""
    return np.column_stack(
        [radius * np.cos(angle), radius * np.sin(angle), np.full(np.shape(angle), height)]
    )


def require_positive(**values: float) -> None:
    """Raise ValueError, with its name, if one of the values, given as keywords, is not positive."""
    for name, value in values.items():
        if not value > 0:
            raise ValueError(f"{name} = {value}: must be positive")


def hollow_steel_section(width: float, height: float, wall: float) -> dict[str, Any]:
    """Return section and torsional stiffness of a rectangular steel tube, as arguments of `Beams`.

    Args:
        width, height: outer sizes, m.
        wall: thickness of the wall, m.
    """

    def outline(y, z):
        return 0.5 * np.array([[-y, -z], [y, -z], [y, z], [-y, z]])

    inside = width - 2 * wall, height - 2 * wall
    section = Section.polygon(outline(width, height), [outline(*inside)], Elastic(STEEL), size=0.25)
    torsion = bredt_torsion(outline(width - wall, height - wall), wall)
    return {"section": section.centred(), "torsional_stiffness": STEEL / 2.6 * float(torsion)}
