"""A net from a file of another program: nodes, links, and properties and loads if there are any."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

import numpy as np

from ..analysis.phases import Phase
from ..common import checks
from ..common.types import ArrayLike, Bool, Float, Int
from ..elements import Bars, Cables
from ..loads import NodalLoads
from ..model.structure import Structure
from ..model.supports import Supports, pinned
from ..scenes import Scene

PROPERTIES = ("axial_stiffness", "rest_length", "weight", "strength", "expansion")
STATEMENTS = ("pretension", "force_density", "prestrain")
KINDS = {"cable": Cables, "bar": Bars}


@dataclasses.dataclass(frozen=True)
class Net:
    """A net as read from a file of another program; `scene` completes it to a `Scene`.

    Attributes:
        nodes: positions, [n_node, 3], m.
        links: node numbers, [n_elem, 2].
        fixed: True where a freedom is held, [n_node, 3]; all False if the file has no supports.
        loads: force on every node, [n_node, 3], N, or None.
        values: dict from the name of a property of `Cables` or of a prestress of `Phase` to
            [n_elem]; NaN for elements without a value in the file.
        kinds: "cable" or "bar" for every element, a tuple.
        groups: name of the group of every element, a tuple, or None.
        names: names of the nodes in the file, a tuple.

    Example:
        >>> nodes, links = np.array([[0.0, 0, 0], [1, 0, 0]]), np.array([[0, 1]])
        >>> net = jc.files.Net(nodes, links, np.ones((2, 3), bool), kinds=("bar",))
        >>> type(net.scene(axial_stiffness=1e6).structure.elements).__name__
        'Bars'
    """

    nodes: Float[np.ndarray, "n_node 3"]
    links: Int[np.ndarray, "n_elem 2"]
    fixed: Bool[np.ndarray, "n_node 3"]
    loads: Float[np.ndarray, "n_node 3"] | None = None
    values: dict[str, Float[np.ndarray, " n_elem"]] = dataclasses.field(default_factory=dict)
    kinds: tuple[str, ...] = ()
    groups: tuple[str, ...] | None = None
    names: tuple[str, ...] = ()

    def scene(
        self,
        anchors: Int[ArrayLike, " n"] | Literal["ends"] | None = None,
        increments: tuple[int, int] = (1, 1),
        **given: float,
    ) -> Scene:
        """The `Scene` of the net: prestress in a first phase, the loads in a second.

        Args:
            anchors: numbers of nodes that are pinned, [n], in addition to the supports in the file;
                or "ends" for all nodes with one link.
            increments: number of increments of both phases.
            given: properties of `Cables` (``axial_stiffness=...``) and prestress of `Phase`
                (``pretension=...``, ``force_density=...``), scalars, for elements without a value
                in the file.

        Returns:
            `Scene`.

        Raises:
            ValueError: an unknown property, a missing one, no supports.

        Example:
            >>> net = jc.files.Net(
            ...     np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]),
            ...     np.array([[0, 1], [1, 2]]),
            ...     np.zeros((3, 3), bool),
            ... )
            >>> structure, phases = net.scene("ends", axial_stiffness=1e5, pretension=100.0)
            >>> structure.supports.fixed(3)[:, 0].tolist()
            [True, False, True]
        """
        unknown = given.keys() - {*PROPERTIES, *STATEMENTS}
        if unknown:
            known = ", ".join((*PROPERTIES, *STATEMENTS))
            raise ValueError(f"{min(unknown)}: not a property of a net; known are {known}")
        values = {}
        for name in (*PROPERTIES, *STATEMENTS):
            filled = self._filled(name, given.get(name))
            if filled is not None:
                values[name] = filled
        if "axial_stiffness" not in values:
            raise ValueError("axial_stiffness: the file has none; give axial_stiffness=..., N")
        labels = self.groups
        if labels is None:
            labels = self.kinds if len(set(self.kinds)) > 1 else ("",) * len(self.links)
        chosen = {label: np.array([g == label for g in labels]) for label in dict.fromkeys(labels)}
        elements = {label: self._group(label, mask, values) for label, mask in chosen.items()}
        stated: dict[str, Any] = {
            name: {label: values[name][mask] for label, mask in chosen.items()}
            for name in STATEMENTS
            if name in values
        }
        if list(elements) == [""]:
            elements = elements[""]
            stated = {name: value[""] for name, value in stated.items()}
        phases = [Phase(**stated, increments=increments[0])] if stated else []
        if self.loads is not None:
            loaded = np.flatnonzero(np.any(self.loads != 0, axis=1))
            if len(loaded):
                loads = NodalLoads(loaded, self.loads[loaded])
                phases.append(Phase(loads=loads, increments=increments[1]))
        structure = Structure(self.nodes, elements, self._supports(anchors))
        return Scene(structure, phases or [Phase()])

    def _filled(self, name, given):
        """Values of a property, [n_elem]: from the file, else `given`; None if there are none."""
        values = self.values.get(name)
        if values is None and given is None:
            return None
        values = np.full(len(self.links), np.nan) if values is None else np.asarray(values, float)
        if given is not None:
            values = np.where(np.isnan(values), float(given), values)
        if np.isnan(values).any():
            k = int(np.isnan(values).argmax())
            raise ValueError(f"{name}: link {k} has none; give {name}=... for those without")
        return values

    def _group(self, label, mask, values):
        """The element group of a label: `Cables` or `Bars` of the elements in a mask, [n_elem]."""
        kinds = {self.kinds[k] for k in np.flatnonzero(mask)} if self.kinds else {"cable"}
        if len(kinds) > 1:
            raise ValueError(f"groups: {label!r} has cables and bars; give them different groups")
        properties = {name: values[name][mask] for name in PROPERTIES if name in values}
        return KINDS[kinds.pop()](self.links[mask], **properties)

    def _supports(self, anchors):
        """`Supports`: those of the file, and anchors."""
        fixed = self.fixed.copy()
        if isinstance(anchors, str):
            if anchors != "ends":
                raise ValueError(f'anchors = {anchors!r}: expected node numbers or "ends"')
            fixed[np.bincount(self.links.ravel(), minlength=len(self.nodes)) == 1] = True
        elif anchors is not None:
            fixed |= pinned(checks.integers(anchors, "anchors")).fixed(len(self.nodes))[:, :3]
        if not fixed.any():
            raise ValueError('anchors: the file names no supports; give node numbers or "ends"')
        if (fixed.all(axis=1) == fixed.any(axis=1)).all():
            return pinned(np.flatnonzero(fixed.any(axis=1)))
        return Supports(mask=fixed)
