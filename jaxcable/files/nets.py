"""A net from a file of another program: nodes, links, and properties and loads if there are any."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..analysis.phases import Phase
from ..common import checks
from ..common.owned import owned_copy
from ..common.summary import summarize
from ..common.types import ArrayLike, Bool, Float, Int
from ..elements import Bars, Cables
from ..loads import NodalLoads
from ..model.structure import Structure
from ..model.supports import Supports, pinned
from ..scenes import Scene
from . import crossings, net_doubts
from .omissions import Omission

GROUP_PROPERTIES = ("axial_stiffness", "rest_length", "weight", "strength", "expansion")
PRESTRESS_INPUTS = ("pretension", "force_density", "prestrain")
ELEMENT_CLASSES = {"cable": Cables, "bar": Bars}


@dataclasses.dataclass(frozen=True)
class Net:
    """A net as read from a file of another program; `scene` completes it to a `Scene`.

    Attributes:
        nodes: positions, [n_node, 3], m.
        links: node numbers, [n_elem, 2].
        fixed: True where a displacement is held, [n_node, 3]; all False without supports.
        loads: force on every node, [n_node, 3], N, or None.
        values: dict from the name of a property of `Cables` or of a prestress of `Phase` to
            [n_elem]; NaN for elements without a value in the file.
        kinds: "cable" or "bar" for every element, a tuple.
        groups: name of the group of every element, a tuple, or None.
        names: names of the nodes in the file, a tuple; "" for nodes that `split` has made.
        marks: dict from the name of a layer to the numbers of the nodes at which it has points;
            of drawings only.
        omissions: what the file holds and the net does not, a tuple of `Omission`; the reader has
            shown it in an `InputWarning`.

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
    marks: dict[str, Int[np.ndarray, " n"]] = dataclasses.field(default_factory=dict)
    omissions: tuple[Omission, ...] = ()
    _shown = "nodes, links, fixed, loads, values, omissions"
    __repr__ = summarize

    def __post_init__(self):
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, owned_copy(getattr(self, field.name)))

    def scene(
        self,
        anchors: Int[ArrayLike, " n"] | Sequence[int | str] | Literal["ends"] | None = None,
        increments: tuple[int, int] = (1, 1),
        bars: Sequence[str] = (),
        **given: float | Mapping[str, float],
    ) -> Scene:
        """Complete the net to a `Scene`: prestress in a first phase, the loads in a second.

        An `InputWarning` names each kind of likely mistake in the drawing: pairs of nodes closer
        than 1 % of the shortest link at them; links that cross or touch in plan without a node
        (`split` joins them).

        Args:
            anchors: numbers of nodes that are pinned, [n], in addition to the supports in the file;
                or "ends" for all nodes with one link; or a list with both, ``["ends", 0, 5]``.
            increments: number of increments of both phases.
            bars: names of groups that are `Bars`, such as masts.
            given: properties of `Cables` (``axial_stiffness=...``) and prestress of `Phase`
                (``pretension=...``, ``force_density=...``), for elements without a value in the
                file: a scalar, or a dict from names of groups to scalars. Every group needs an
                axial stiffness; other values may be missing.

        Returns:
            `Scene`.

        Raises:
            ValueError: an unknown property or group, a missing one, no supports, a part of the net
                without a support; an end that is closer to another node or link than 1 % of the
                shortest link there, and is neither named by its number nor a support in the file:
                this is a gap in the drawing rather than an anchor.

        Example:
            Two cables and a tie, by groups:

            >>> net = jc.files.Net(
            ...     np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, -1]]),
            ...     np.array([[0, 1], [1, 2], [1, 3]]),
            ...     np.zeros((4, 3), bool),
            ...     groups=("NET", "NET", "TIE"),
            ... )
            >>> structure, phases = net.scene(
            ...     "ends",
            ...     bars=["TIE"],
            ...     axial_stiffness={"NET": 1e5, "TIE": 4e6},
            ...     pretension={"NET": 100.0},
            ... )
            >>> structure.supports.fixed(4)[:, 0].tolist()
            [True, False, True, True]
            >>> type(structure.elements["TIE"]).__name__, phases[0].pretension["TIE"]
            ('Bars', None)
        """
        unknown = given.keys() - {*GROUP_PROPERTIES, *PRESTRESS_INPUTS}
        if unknown:
            known = ", ".join((*GROUP_PROPERTIES, *PRESTRESS_INPUTS))
            raise ValueError(f"{min(unknown)}: not a property of a net; known are {known}")
        labels = self.groups
        if labels is None:
            labels = self.kinds if len(set(self.kinds)) > 1 else ("",) * len(self.links)
        chosen = {label: np.array([g == label for g in labels]) for label in dict.fromkeys(labels)}
        _require_known_groups(bars, chosen, "bars")
        values = {
            name: self._values_by_group(name, given.get(name), chosen)
            for name in (*GROUP_PROPERTIES, *PRESTRESS_INPUTS)
        }
        missing = [label for label in chosen if label not in values["axial_stiffness"]]
        if missing:
            whose = f"group {missing[0]!r}" if values["axial_stiffness"] else "the file"
            raise ValueError(f"axial_stiffness: {whose} has none; give axial_stiffness=..., N")
        elements: Any = {
            label: self._make_group(label, mask, values, label in bars)
            for label, mask in chosen.items()
        }
        stated: dict[str, Any] = {
            name: {label: values[name].get(label) for label in chosen}
            for name in PRESTRESS_INPUTS
            if values[name]
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
        structure = Structure(self.nodes, elements, self._supports_with_anchors(anchors))
        return Scene(structure, phases or [Phase()])

    def split(
        self,
        groups: Sequence[str] | None = None,
        *,
        tolerance: float = 1e-6,
        gap: float = crossings.LARGEST_GAP,
    ) -> Net:
        """Return the net with nodes where its links cross in plan, and where a node lies on a link.

        - The node of a crossing has the mean height of all links there.
        - A node on a link (T-joint) stays where it is, and the link is led through it. If it is
          above or below the link, it is joined only if it is the free end of a single link.
        - Pieces keep group, kind, properties, pretension and prestrain of their link. They share
          its unstressed length, and their force density is higher, so that the force stays.
        - Of pieces that coincide, the one of the first link stays.
        - Nodes keep their numbers; new ones follow, free and without load.

        Args:
            groups: names of the groups that take part; None for all. Leave out what crosses in plan
                without being joined, such as stays below a net.

        Options:
            tolerance: distance in plan within which a node lies on a link, m; if arcs were replaced
                by chords, at least their sagitta.
            gap: largest height between two links that are joined, over the length of the shorter
                one (of a node, the shortest link at it). An `InputWarning` counts places that are
                not joined.

        Returns:
            `Net`.

        Raises:
            ValueError: an unknown group, a negative number.

        Example:
            Two cables of 2 m, one 0.2 m above the other where they cross:

            >>> net = jc.files.Net(
            ...     np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 0.2], [0, 1, 0.2]]),
            ...     np.array([[0, 1], [2, 3]]),
            ...     np.zeros((4, 3), bool),
            ... )
            >>> found = net.split()
            >>> found.links.tolist(), found.nodes[4].tolist()
            ([[0, 4], [4, 1], [2, 4], [4, 3]], [0.0, 0.0, 0.1])
        """
        if not 0 <= tolerance < np.inf or not 0 <= gap < np.inf:
            raise ValueError(f"tolerance = {tolerance}, gap = {gap}: expected positive numbers")
        part = np.ones(len(self.links), bool)
        if groups is not None:
            names = self.groups or ()
            _require_known_groups(groups, dict.fromkeys(names), "groups")
            part = np.array([name in groups for name in names])
        if not part.any():
            return self
        chosen, rest = np.flatnonzero(part), np.flatnonzero(~part)
        # a node that others hold, too, has its height for a reason
        held: np.ndarray = np.array(np.any(self.fixed, axis=1))
        held[self.links[rest].ravel()] = True
        found = crossings.find_crossings(self.nodes, self.links[chosen], held, tolerance, gap)
        if found.n_apart:
            checks.warn_user(
                f"split: {found.n_apart} places where links cross or touch in plan are not joined: "
                f"their heights differ by more than {gap:g} of the shorter link"
            )
        made = crossings.split_links(self.nodes, self.links[chosen], found, tolerance)
        origin = np.concatenate([chosen[made.original_link], rest])
        order = np.argsort(origin, kind="stable")
        links = np.concatenate([made.links, self.links[rest]])[order]
        share, origin = (
            np.concatenate([made.length_fraction, np.ones(len(rest))])[order],
            origin[order],
        )
        values = {name: value[origin] for name, value in self.values.items()}
        for name, power in (("rest_length", 1.0), ("force_density", -1.0)):
            if name in values:
                values[name] = values[name] * share**power
        more = len(made.nodes) - len(self.nodes)
        zero = np.zeros((more, 3))
        return dataclasses.replace(
            self,
            nodes=made.nodes,
            links=links,
            fixed=np.concatenate([self.fixed, zero > 0]),
            loads=None if self.loads is None else np.concatenate([self.loads, zero]),
            values=values,
            kinds=tuple(self.kinds[k] for k in origin) if self.kinds else (),
            groups=None if self.groups is None else tuple(self.groups[k] for k in origin),
            names=(*self.names, *[""] * more) if self.names else (),
        )

    def _values_by_group(self, name, given, chosen):
        """Return the values of a property by group, a dict of arrays [n_elem of the group].

        Values in the file come first; the user's `given`, a scalar or a dict by group, replace
        missing ones. Groups without any value are not in the dict. `name` is the property, and
        `chosen` has the elements of each group, [n_elem] bool, by name. Raise ValueError if some
        elements of a group have a value and others do not.
        """
        values = self.values.get(name)
        values = np.full(len(self.links), np.nan) if values is None else np.asarray(values, float)
        if isinstance(given, Mapping):
            _require_known_groups(given, chosen, name)
        by_group = given if isinstance(given, Mapping) else dict.fromkeys(chosen, given)
        found = {}
        for label, mask in chosen.items():
            own, number = values[mask], by_group.get(label)
            if number is not None:
                own = np.where(np.isnan(own), float(number), own)
            missing = np.isnan(own)
            if missing.any() and not missing.all():
                k = int(np.flatnonzero(mask)[missing.argmax()])
                raise ValueError(f"{name}: link {k} has none; give {name}=... for those without")
            if not missing.any():
                found[label] = own
        return found

    def _make_group(self, label, mask, values, bars):
        """Make the `Cables`, or with `bars` the `Bars`, of the group with the name `label`.

        `mask` are its elements, [n_elem] bool, and `values` the values by group of each property.
        """
        kinds = {self.kinds[k] for k in np.flatnonzero(mask)} if self.kinds else {"cable"}
        kinds = {"bar"} if bars else kinds
        if len(kinds) > 1:
            raise ValueError(
                f"groups: {label!r} has cables and bars; put them into different groups"
            )
        properties = {
            name: values[name][label] for name in GROUP_PROPERTIES if label in values[name]
        }
        return ELEMENT_CLASSES[kinds.pop()](self.links[mask], **properties)

    def _supports_with_anchors(self, anchors):
        """Return the `Supports` of the file and of the user's `anchors` (as of `scene`) together.

        An `InputWarning` names likely mistakes. Raise ValueError if there are no supports, an end
        is a gap in the drawing, or a part of the net is not connected to a support.
        """
        fixed = self.fixed.copy()
        words = [anchors] if isinstance(anchors, str) else anchors
        ends = False
        if isinstance(words, list | tuple):
            for word in words:
                if isinstance(word, str) and word != "ends":
                    raise ValueError(f'anchors = {word!r}: expected node numbers or "ends"')
            numbers = [word for word in words if not isinstance(word, str)]
            words, ends = numbers, len(numbers) < len(words)
        if words is not None:
            fixed |= pinned(checks.as_indices(words, "anchors")).fixed(len(self.nodes))[:, :3]
        if ends:
            self._refuse_unjoined_ends(fixed)
            fixed[np.bincount(self.links.ravel(), minlength=len(self.nodes)) == 1] = True
        if not fixed.any():
            raise ValueError('anchors: the file names no supports; give node numbers or "ends"')
        self._require_connection_to_supports(fixed.any(axis=1))
        if (fixed.all(axis=1) == fixed.any(axis=1)).all():
            return pinned(np.flatnonzero(fixed.any(axis=1)))
        return Supports(mask=fixed)

    def _refuse_unjoined_ends(self, fixed):
        """Raise ValueError for an end that touches another node or link, unless a support holds it.

        `fixed` says which displacements are held, [n_node, 3] bool.
        """
        gaps = net_doubts.unjoined_ends(self.nodes, self.links)
        gaps = [gap for gap in gaps if not fixed[gap.node].any()]
        if gaps:
            gap = min(gaps, key=lambda gap: gap.distance)
            where = net_doubts.format_position(self.nodes[gap.node])
            raise ValueError(
                f"anchors: {len(gaps)} of the ends touch, or nearly touch, another node or link, "
                f"which looks like a gap in the drawing: node {gap.node} at {where} is "
                f"{1e3 * gap.distance:.3g} mm from {gap.other}; join them (larger tolerance, "
                '--tol; Net.split, --split), or list the numbers of anchors beside "ends"'
            )

    def _require_connection_to_supports(self, held):
        """Raise ValueError if a part of the net has no supported node; warn of likely mistakes.

        These are nodes close to each other, links that cross without a node, and ends that almost
        touch a link; an error has them as its hint. Nodes without links do not count. `held` says
        which nodes are supported, [n_node] bool.
        """
        told = net_doubts.describe_likely_mistakes(self.nodes, self.links, held)
        graph = coo_matrix((np.ones(len(self.links)), self.links.T), shape=(len(self.nodes),) * 2)
        part = connected_components(graph, directed=False)[1]
        adrift = ~np.isin(part, part[held])
        adrift &= np.bincount(self.links.ravel(), minlength=len(held)) > 0
        if adrift.any():
            node = int(adrift.argmax())
            hint = "; ".join(told) or "support it, or join it to the rest"
            where = net_doubts.format_position(self.nodes[node])
            raise ValueError(
                f"anchors: {int((part == part[node]).sum())} nodes, with node {node} at {where}, "
                f"are not connected to a support: {hint}"
            )
        for text in told:
            checks.warn_user(text)


def _require_known_groups(names, groups, what):
    """Raise ValueError if one of `names` is no group; `what` names the argument in the message."""
    for name in names:
        if name not in groups:
            raise ValueError(f"{what}: no group {name!r}; there are {', '.join(groups) or 'none'}")
