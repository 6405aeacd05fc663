"""Loads that stand anywhere on a path of beams: a train of axles, a crowd on parts of the path."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import Rule, not_negative, refuse_if_broken
from ..common.tree import Indices, pytree, set_fields
from ..common.types import ArrayLike, Bool, Float, Int
from ..model.result_parts import group_path
from ..model.structure import Structure
from .groups import Key, scatter_to_elements
from .points import ActingPoints, WithinElements

_GAUSS = np.polynomial.legendre.leggauss(4)
"""Places and weights of the forces that stand for a load on a part of an element."""


class BeamPath(NamedTuple):
    """A path along beams of one group.

    Attributes:
        group: index of the group.
        elements: indices of its elements, in order, [n].
        backwards: whether each element is passed from its second end to its first, [n].
        stations: distances of the ends of its elements from its beginning, [n + 1], m: lengths of
            chords of the structure as drawn.
    """

    group: int
    elements: Int[np.ndarray, " n"]
    backwards: Bool[np.ndarray, " n"]
    stations: Float[ArrayLike, " n+1"]

    def local_places(
        self, distances: Float[ArrayLike, " k"]
    ) -> tuple[Float[ArrayLike, "n k"], Bool[ArrayLike, "n k"]]:
        """Return places on all elements of points at distances from the beginning, m.

        A point at a node between two elements is on the second one. One that is beyond an end of
        the path by rounding is at this end.

        Returns:
            Places from 0 to 1, [n, k], 0 for points that are not on the element; and whether a
            point is on it.
        """
        pack = checks.numpy_or_jax(distances, self.stations)
        distances = pack.reshape(distances, (1, -1))
        begin, end = self.stations[:-1, None], self.stations[1:, None]
        number = np.arange(len(self.elements))[:, None]
        near = ROUNDING * np.finfo(self.stations.dtype).eps * self.stations[-1]
        first, last = number == 0, number == len(self.elements) - 1
        after = (distances >= begin) | (first & (distances >= -near))
        inside = after & ((distances < end) | (last & (distances <= end + near)))
        place = pack.where(inside, (distances - begin) / (end - begin), 0.0)
        place = pack.minimum(pack.maximum(place, 0.0), 1.0)  # by rounding only
        back = self.backwards[:, None]
        return pack.where(inside & back, 1 - place, place), inside


def path_along_elements(
    structure: Structure, path: Int[ArrayLike, " n"], group: int, name: str = "path"
) -> BeamPath:
    """Return the `BeamPath` along elements with indices `path`, [n], of the group of index `group`.

    Raises:
        ValueError: an unknown or repeated element, or elements that do not meet end to end; the
            message begins with `name`.
    """
    elements = np.asarray(path)
    own, where = structure.groups[group], group_path(structure, group)
    links = own.links.array[:, :2]
    unknown = elements >= len(links)
    if unknown.any():
        k = int(unknown.argmax())
        raise ValueError(f"{name}[{k}] = {elements[k]}: {where} has elements 0 to {len(links) - 1}")
    ends = links[elements]
    backwards = np.zeros(len(elements), bool)
    if len(elements) > 1:
        backwards[0] = ends[0, 0] in ends[1] and ends[0, 1] not in ends[1]
    for k in range(1, len(elements)):
        at = ends[k - 1, 0 if backwards[k - 1] else 1]
        if at not in ends[k]:
            raise ValueError(
                f"{name}[{k}] = {elements[k]}: does not begin where element {elements[k - 1]} ends "
                f"(node {at})"
            )
        backwards[k] = ends[k, 1] == at
    nodes = checks.as_numpy_if_known(structure.nodes)
    pack = checks.numpy_or_jax(nodes)
    chord = nodes[ends[:, 1]] - nodes[ends[:, 0]]
    lengths = pack.sqrt((chord * chord).sum(axis=1))
    stations = pack.concatenate([pack.zeros(1, lengths.dtype), pack.cumsum(lengths)])
    return BeamPath(group, elements, backwards, stations)


ROUNDING = 64
"""Roundings of the length of a path by which a point may be beyond its ends."""


class OnPath(WithinElements):
    """Base of loads on a path of beams.

    Attributes:
        path: indices of its elements, in order.
    """

    path: Int[ArrayLike, " n"]

    def _set_path(self):
        """Convert the field `path` to `Indices`; ValueError for no or repeated elements."""
        if isinstance(self.path, Indices):
            return
        path = checks.as_indices(self.path, "path", things="element")
        if not len(path):
            raise ValueError("path: expected at least one element")
        if len(np.unique(path)) < len(path):
            raise ValueError(f"path: element {np.flatnonzero(np.bincount(path) > 1)[0]} is twice")
        set_fields(self, path=Indices(path))

    def check(self, structure: Structure) -> None:
        """Raise ValueError if a structure lacks the group, or its elements form no such path."""
        self._path_in(structure)

    def _path_in(self, structure):
        """Return the `BeamPath` of the load in a structure; ValueError if there is none."""
        return path_along_elements(structure, self.path.array, self.group_index(structure))


@pytree(static=("on",), indices=("path",))
class Train(OnPath):
    """A train of axles on a path of beams: concentrated dead loads at any position.

    The position is a number of the analysis: `jax.vmap` over positions is one program, derivatives
    by it exist (where an axle is at a node they are those of the element beyond it). Axles beyond
    the ends of the path do not act. The same vehicle the other way round is another train, with
    forces and spacings in the opposite order.

    Args:
        path: indices of the elements of one group of beams, in the order in which they are passed,
            end to end, [n]; they may point either way.
        position: distance of the first axle from the beginning of the path, m, along the chords of
            the structure as drawn.
        forces: force of each axle, [3] or [n_axle, 3], N.
        spacings: distances from each axle to the next one behind it, [n_axle - 1], m; default: a
            single axle.
        on: key of the group of beams; None means the only one.

    Raises:
        ValueError: wrong shapes, negative spacings, no or repeated elements; where a phase is
            analysed, elements that the structure does not have or that are no path, several groups
            of beams.

    Example:
        Two axles of 100 kN, 2 m apart, in the middle of a beam of 10 m: ``-P (L - a) / 2``

        >>> section = jc.Section.rectangle(0.4, 0.8, jc.Elastic(30e9))
        >>> beam = jc.Beams([[0, 1], [1, 2]], section=section)
        >>> ends = jc.restrained([0], "xyz", "x") + jc.restrained([2], "yz")
        >>> structure = jc.Structure([[0, 0, 0], [5.0, 0, 0], [10.0, 0, 0]], beam, supports=ends)
        >>> train = jc.loads.Train([0, 1], 6.0, (0.0, 0.0, -100e3), spacings=[2.0])
        >>> solution = jc.solve(structure, jc.Phase(loads=train))
        >>> print(f"{solution.status} {solution.section_forces[1, 0, 4] / 1e3:.1f} kN m")
        0 -400.0 kN m
    """

    path: Int[ArrayLike, " n"]
    position: Float[ArrayLike, ""]
    forces: Float[ArrayLike, "... 3"]
    spacings: Float[ArrayLike, " n_axle-1"] = ()
    on: Key = None

    scales = ("forces",)

    def __post_init__(self):
        self._set_path()
        spacings = checks.as_floats(self.spacings, "spacings")
        if spacings.ndim != 1:
            raise ValueError(f"spacings: expected shape [n_axle - 1], got {spacings.shape}")
        count = len(spacings) + 1
        hint = f"; {count} axles have {count - 1} spacings"
        forces = checks.floats_of_shape(self.forces, "forces", (3,), (count, 3), hint=hint)
        position = checks.as_scalar(self.position, "position")
        set_fields(self, spacings=spacings, forces=forces, position=position)
        refuse_if_broken(self.rules())

    def __str__(self) -> str:
        return f"Train of {len(self.spacings) + 1} axles on {len(self.path)} elements"

    def rules(self) -> list[Rule]:
        """Return the rule that spacings are not negative, a list of `Rule`."""
        return [not_negative("spacings", self.spacings)]

    def with_group_indices(self, structure: Structure) -> ActingPoints:
        """Return the axles in the form of an analysis: `ActingPoints`, zero off the path."""
        path = self._path_in(structure)
        position, forces, spacings = map(
            checks.as_numpy_if_known, (self.position, self.forces, self.spacings)
        )
        pack = checks.numpy_or_jax(position, spacings)
        zero = pack.zeros(1, spacings.dtype)
        behind = pack.concatenate([zero, pack.cumsum(spacings)])
        place, inside = path.local_places(position - behind)
        pack = checks.numpy_or_jax(place, forces, spacings)
        # traced spacings that break their rule break that of places
        place = pack.where((spacings < 0).any(), -1.0, place)
        acting = pack.where(inside[..., None], pack.reshape(forces, (1, -1, 3)), 0.0)
        acting = acting + 0.0 * (position + spacings.sum())  # NaN is nowhere on the path
        table = pack.concatenate([place[..., None], acting], axis=-1)
        return _acting_points(structure, path, table, "Train")


@pytree(static=("on",), indices=("path",))
class Crowd(OnPath):
    """A uniform dead load on parts of a path of beams, which may begin and end within elements.

    Both ends of each part are numbers of the analysis, as the position of a `Train` is. Elements
    that are loaded along all of their length have a line load. On a part of an element four forces
    stand for the load: forces and moments at the ends of the element are those of the load in
    linear theory, and section forces between its ends are those of the four forces.

    Args:
        path: indices of the elements of one group of beams, in order, as of `Train`.
        forces: force per length along the path, [3], N/m.
        begin, end: distances of both ends of each part from the beginning of the path, [n_part] or
            scalar, m. A part that ends before it begins has no load.
        on: key of the group of beams; None means the only one.

    Raises:
        ValueError: wrong shapes; otherwise as of `Train`.

    Example:
        2 kN/m on 1 m to 4 m of a beam of 6 m on two supports, in one element:

        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
        >>> ends = jc.restrained([0], "xyz", "x") + jc.restrained([1], "yz")
        >>> beam = jc.Beams([[0, 1]], section=section)
        >>> structure = jc.Structure([[0.0, 0, 0], [6.0, 0, 0]], beam, supports=ends)
        >>> crowd = jc.loads.Crowd([0], (0.0, 0.0, -2e3), 1.0, 4.0)
        >>> solution = jc.solve(structure, jc.Phase(loads=crowd))
        >>> print(solution.status, solution.reactions[:, 2].round(6))  # 6 kN at 2.5 m
        0 [3500. 2500.]
    """

    path: Int[ArrayLike, " n"]
    forces: Float[ArrayLike, " 3"]
    begin: Float[ArrayLike, ""] | Float[ArrayLike, " n_part"]
    end: Float[ArrayLike, ""] | Float[ArrayLike, " n_part"]
    on: Key = None

    scales = ("forces",)

    def __post_init__(self):
        self._set_path()
        set_fields(self, forces=checks.floats_of_shape(self.forces, "forces", (3,)))
        begin = checks.as_floats(self.begin, "begin")
        if begin.ndim > 1:
            raise ValueError(f"begin: expected a scalar or shape [n_part], got {begin.shape}")
        set_fields(self, begin=begin, end=checks.floats_of_shape(self.end, "end", begin.shape))

    def __str__(self) -> str:
        parts = "1 part" if jnp.ndim(self.begin) == 0 else f"{len(self.begin)} parts"
        return f"Crowd on {parts} of {len(self.path)} elements"

    def with_group_indices(self, structure: Structure) -> ActingPoints:
        """Return the load in the form of an analysis: `ActingPoints`, four forces for each part.

        Elements that are loaded all along have a line load, as the last one in the table.
        """
        path = self._path_in(structure)
        forces, begin, end = map(checks.as_numpy_if_known, (self.forces, self.begin, self.end))
        pack = checks.numpy_or_jax(forces, begin, end, path.stations)
        start, stop = path.stations[:-1, None], path.stations[1:, None]
        low = pack.maximum(start, pack.reshape(begin, (1, -1)))
        high = pack.minimum(stop, pack.reshape(end, (1, -1)))
        loaded = pack.maximum(high - low, 0.0)
        whole = loaded >= stop - start
        # 0.5 (1 + x) of the part, and of that the place on the element
        at, weight = ((0.5 * x)[None, None] for x in (1 + _GAUSS[0], _GAUSS[1]))
        place = (low - start)[..., None] + loaded[..., None] * at
        place = place / (stop - start)[..., None]
        partly = (loaded > 0) & ~whole
        place = pack.where(partly[..., None], place, 0.0)
        place = pack.where(partly[..., None] & path.backwards[:, None, None], 1 - place, place)
        amount = pack.where(partly, loaded, 0.0)[..., None] * weight
        n = len(path.elements)
        points = pack.concatenate(
            [place.reshape(n, -1, 1), amount.reshape(n, -1, 1) * forces[None, None]], axis=-1
        )
        amount = amount + 0.0 * (begin.sum() + end.sum())  # NaN is nowhere on the path
        total = pack.where(whole, loaded, 0.0).sum(axis=1)[:, None] * forces[None]
        line = pack.concatenate([pack.full((n, 1), 0.5), total], axis=-1)
        table = pack.concatenate([points, line[:, None]], axis=1)
        return _acting_points(structure, path, table, "Crowd", has_line=True)


def _acting_points(structure, path, table, name, has_line=False):
    """Return the `ActingPoints` of loads on elements of a `BeamPath`, zero on others of its group.

    Args:
        table: loads of each element of the path, [n, k, 4]: place from 0 to 1, force, N.
        name: name of the class of the user's load.
        has_line: whether the last load of each element is one along the whole element.
    """
    n_elem = len(structure.groups[path.group].links)
    whole = scatter_to_elements(n_elem, path.elements, table)
    return ActingPoints((path.group,), {path.group: whole}, has_line=has_line, name=name)
