"""A net as other programs know it: nodes, links and what they say about them."""

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
    """What a file says about a net; `scene` makes an analysis of it.

    Attributes:
        nodes: [n_node, 3], m.
        links: node numbers, [n_elem, 2].
        fixed: True where a freedom is held, [n_node, 3]; all False if the file names no supports.
        loads: force on every node, [n_node, 3], N, or None.
        values: dict from the name of a property of `Cables` or of a prestress of `Phase` to
            [n_elem]; NaN where the file gives none.
        kinds: "cable" or "bar" for every element, a tuple.
        groups: name of its group for every element, a tuple, or None.
        names: what the file calls the nodes, a tuple.

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
            anchors: numbers of nodes that are held, [n]; besides those that the file names. "ends":
                nodes with one link.
            increments: of the two phases.
            given: properties of `Cables` (``axial_stiffness=...``) and prestress of `Phase`
                (``pretension=...``, ``force_density=...``), scalars, where the file gives none.

        Raises:
            ValueError: an unknown property, one missing, no supports.

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
            row = self._filled(name, given.get(name))
            if row is not None:
                values[name] = row
        if "axial_stiffness" not in values:
            raise ValueError("axial_stiffness: the file has none; give axial_stiffness=..., N")
        labels = self.groups
        if labels is None:
            labels = self.kinds if len(set(self.kinds)) > 1 else ("",) * len(self.links)
        chosen = {label: np.array([g == label for g in labels]) for label in dict.fromkeys(labels)}
        elements = {label: self._group(label, own, values) for label, own in chosen.items()}
        stated: dict[str, Any] = {
            name: {label: values[name][own] for label, own in chosen.items()}
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
        own = self.values.get(name)
        if own is None and given is None:
            return None
        own = np.full(len(self.links), np.nan) if own is None else np.asarray(own, float)
        if given is not None:
            own = np.where(np.isnan(own), float(given), own)
        if np.isnan(own).any():
            k = int(np.isnan(own).argmax())
            raise ValueError(f"{name}: link {k} has none; give {name}=... for those without")
        return own

    def _group(self, label, own, values):
        kinds = {self.kinds[k] for k in np.flatnonzero(own)} if self.kinds else {"cable"}
        if len(kinds) > 1:
            raise ValueError(f"groups: {label!r} has cables and bars; give them different groups")
        properties = {name: values[name][own] for name in PROPERTIES if name in values}
        return KINDS[kinds.pop()](self.links[own], **properties)

    def _supports(self, anchors):
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
