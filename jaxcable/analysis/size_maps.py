"""Changes and cotangents of an analysis, mapped between its own sizes and common sizes.

Padding (`common_sizes`) is a linear map of the numbers of an analysis: an entry of a padded array
is an entry of an exact one, a part of it (an area of a fibre that is split), or a constant. Cutting
(`cut_results`) takes parts of padded arrays. Both maps are found by padding and cutting the numbers
of the entries in place of the entries. All arrays are those of NumPy: nothing is compiled.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from ..common.compilation import on_forget_programs, program_settings
from ..common.tree import copy_with
from ..common.types import Bool
from .common_sizes import pad_analysis
from .cut_results import cut_on_host
from .preparation import PreparedAnalysis

_MOST_MAPS = 64
_COMPUTED = ".mean_lengths", ".given_steps"  # floats that padding computes; not differentiated
_FAILED = 1  # a status other than OK: results of the solution are its own, not those of `last`
_EVERYTHING = np.ones((), bool)


class ArgumentMap:
    """Padded arguments of an analysis as linear functions of its exact arguments.

    Args:
        sizes: number of entries of each exact leaf.
        sources: for each padded leaf of floats, by index: indices of source entries among all
            entries of exact leaves, -1 for constants; and weights, or None where all are 1.
        sets: sets of indices of padded leaves whose cotangents a program computes together: first
            those of all floats without those of sections, then those of all.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        sources: Mapping[int, tuple[np.ndarray, np.ndarray | None]],
        sets: Sequence[frozenset[int]],
    ):
        self._ends = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
        self._sources, self._sets = sources, sets
        self._places: dict[tuple[int, ...], dict[int, np.ndarray]] = {}

    def _indices(self, moving):
        """Return, by padded leaf, indices into the joined entries of the exact leaves `moving`.

        One past the last entry stands for all others. Leaves without any such entry are left out.
        """
        if moving not in self._places:
            counts = [self._ends[k + 1] - self._ends[k] for k in moving]
            total = sum(counts)
            number, begin = np.full(self._ends[-1] + 1, total), 0
            for k, count in zip(moving, counts, strict=True):
                number[self._ends[k] : self._ends[k + 1]] = np.arange(begin, begin + count)
                begin += count
            found = {k: number[source] for k, (source, _) in self._sources.items()}
            self._places[moving] = {k: own for k, own in found.items() if (own < total).any()}
        return self._places[moving]

    def pad_changes(
        self, moving: tuple[int, ...], changes: Sequence[np.ndarray], lead: tuple[int, ...]
    ) -> dict[int, np.ndarray]:
        """Return changes of padded leaves, by index, for `changes` of the exact leaves `moving`.

        `lead` is the shape of leading axes of a batch, () for none.
        """
        flat = [np.reshape(x, (*lead, -1)) for x in changes]
        joined = np.concatenate([*flat, np.zeros((*lead, 1), flat[0].dtype)], axis=-1)
        found = {}
        for k, places in self._indices(moving).items():
            weights = self._sources[k][1]
            values = joined[..., places]
            found[k] = values if weights is None else (values * weights).astype(values.dtype)
        return found

    def needed(self, moving: tuple[int, ...]) -> tuple[int, ...]:
        """Return indices of the padded leaves whose cotangents give those of the leaves `moving`.

        They are those of nearly all floats, so that derivatives by nodes, by pretension and by
        stiffness share a program, which has up to 2 % more code than one by nodes alone (7 % with
        fibres of sections, which take time, too).
        """
        own = frozenset(self._indices(moving))
        some = next((one for one in self._sets if own <= one), self._sets[-1])
        return tuple(sorted(own | some))

    def cut_cotangents(
        self, moving: tuple[int, ...], cotangents: Mapping[int, np.ndarray], lead: tuple[int, ...]
    ) -> list[np.ndarray]:
        """Return cotangents of the exact leaves `moving`, flat, from those of padded leaves.

        `lead` is as for `pad_changes`.
        """
        counts = [self._ends[k + 1] - self._ends[k] for k in moving]
        total = sum(counts)
        sums = np.zeros((math.prod(lead), total + 1))
        for k, places in self._indices(moving).items():
            weights = self._sources[k][1]
            values = cotangents[k] if weights is None else cotangents[k] * weights
            for row, own in zip(sums, values.reshape(len(sums), -1), strict=True):
                row += np.bincount(places.ravel(), own, total + 1)
        return np.split(sums[:, :total].reshape(*lead, total), np.cumsum(counts)[:-1], axis=-1)


class _Part(NamedTuple):
    """Where a result of exact size comes from.

    Attributes:
        shape: its shape.
        padded: index of the padded result whose part it is; None if it is none.
        slices: which part.
        argument: index of the argument that it is (loads of a `RestartState`), or None.
        mask: which of its entries are those of the argument, the others being zero.
    """

    shape: tuple[int, ...]
    padded: int | None = None
    slices: tuple[slice, ...] = ()
    argument: int | None = None
    mask: Bool[np.ndarray, " ..."] = _EVERYTHING

    @property
    def place(self) -> Any:
        """The slices as an index of arrays that may have leading axes."""
        return (..., *self.slices)


class ResultMap:
    """Exact results of an analysis as parts of its padded results.

    Args:
        parts: `_Part` for each exact result of floats, by its index in the leaves of the solution.
        shapes: shape and dtype of each padded result.
    """

    def __init__(self, parts: Mapping[int, _Part], shapes: Sequence[jax.ShapeDtypeStruct]):
        self._parts, self._shapes = parts, shapes

    def sources(self, wanted: Sequence[int]) -> tuple[int, ...]:
        """Return indices of the padded results that contain the exact results `wanted`."""
        found = {self._parts[k].padded for k in wanted}
        return tuple(sorted(k for k in found if k is not None))

    def cut_changes(
        self,
        wanted: Sequence[int],
        changes: Mapping[int, np.ndarray],
        of_arguments: Mapping[int, np.ndarray],
        lead: tuple[int, ...],
    ) -> list[np.ndarray]:
        """Return changes of the exact results `wanted`.

        Args:
            wanted: their indices.
            changes: changes of padded results, by index.
            of_arguments: changes of exact arguments, by index.
            lead: shape of leading axes of a batch, () for none.
        """
        found = []
        for k in wanted:
            part = self._parts[k]
            if part.padded is not None:
                found.append(changes[part.padded][part.place])
            elif part.argument is not None and part.argument in of_arguments:
                values = of_arguments[part.argument]
                found.append(np.where(part.mask, values, np.zeros((), values.dtype)))
            else:
                found.append(np.zeros((*lead, *part.shape)))
        return found

    def pad_cotangents(
        self, wanted: Sequence[int], cotangents: Sequence[np.ndarray], lead: tuple[int, ...]
    ) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
        """Return cotangents of padded results, and of exact arguments that are results, by index.

        Args:
            wanted: indices of exact results.
            cotangents: their cotangents.
            lead: as for `cut_changes`.
        """
        padded: dict[int, np.ndarray] = {}
        direct: dict[int, np.ndarray] = {}
        for k, x in zip(wanted, cotangents, strict=True):
            part = self._parts[k]
            if part.padded is not None:
                if part.padded not in padded:
                    shape = self._shapes[part.padded]
                    padded[part.padded] = np.zeros((*lead, *shape.shape), shape.dtype)
                padded[part.padded][part.place] += x
            elif part.argument is not None:
                own = np.where(part.mask, x, np.zeros((), x.dtype))
                direct[part.argument] = direct.get(part.argument, 0.0) + own
        return dict(sorted(padded.items())), direct


_maps: OrderedDict[Any, tuple[ArgumentMap, ResultMap]] = OrderedDict()
on_forget_programs(_maps.clear)


def size_maps(
    task: PreparedAnalysis,
    core: tuple[Any, ...],
    padded_result_shapes: Any,
    listens: bool,
    phase: int,
) -> tuple[ArgumentMap, ResultMap]:
    """Return the maps of an analysis that can be padded; cached by its shapes.

    Args:
        task, listens: as for `pad_analysis`.
        core: its arguments, arrays of NumPy.
        padded_result_shapes: function to the shapes of what `analyse` returns for the padded
            arguments; called if the maps are not known yet.
        phase: index of the last phase in which an increment has converged, -1 for none.
    """
    leaves, tree = jax.tree.flatten(core)
    _, _, restart, schedule = core[0]
    stacks = [*(() if restart is None else restart.loads), *schedule.loads]
    late: tuple[Any, ...] = tuple(
        np.asarray(stack.phase).tobytes() for stack in stacks if stack.late
    )
    shapes = tuple((x.shape, x.dtype) for x in leaves)
    about = task.bundles, listens, program_settings()
    key = tree, shapes, about, late and (phase, *late)
    found = _maps.pop(key, None)
    if found is None:
        arguments, numbered = _map_arguments(task, core, listens)
        solution, _ = padded_result_shapes()
        found = arguments, _map_results(task, numbered, solution, phase)
    _maps[key] = found  # as the last one
    while len(_maps) > _MOST_MAPS:
        _maps.popitem(last=False)
    return found


def is_of_section(path: tuple[Any, ...]) -> bool:
    """Tell whether an argument of an analysis, known by its path in the tree, is of a section."""
    return ".section" in jax.tree_util.keystr(path)


def _map_arguments(task, core, listens):
    """Return the `ArgumentMap`, and the arguments with the numbers of their entries from 1 on."""
    tree: Any
    leaves, tree = jax.tree.flatten(core)
    sizes = [x.size for x in leaves]
    ends = np.cumsum([0, *sizes])

    def with_floats(value):
        pairs = enumerate(leaves)
        return tree.unflatten(
            [value(k, x) if np.issubdtype(x.dtype, np.floating) else x for k, x in pairs]
        )

    def padded(arguments):
        return jax.tree.leaves(pad_analysis(task, arguments, listens)[0])

    constants = with_floats(lambda k, x: np.zeros(x.shape))
    ones = with_floats(lambda k, x: np.ones(x.shape))
    numbered = with_floats(lambda k, x: ends[k] + np.arange(1.0, x.size + 1).reshape(x.shape))
    named = jax.tree_util.tree_leaves_with_path(pad_analysis(task, constants, listens)[0])
    sources: dict[int, Any] = {}
    sets: list[set[int]] = [set(), set()]
    triples = zip(named, padded(ones), padded(numbered), strict=True)
    for k, ((path, zero), one, number) in enumerate(triples):
        name = jax.tree_util.keystr(path)
        if not np.issubdtype(np.asarray(zero).dtype, np.floating):
            continue
        if any(word in name for word in _COMPUTED):
            continue
        if name.startswith("[0]"):  # the others are numbers of the method
            sets[1].add(k)
            if not is_of_section(path):
                sets[0].add(k)
        weights = np.asarray(one) - zero
        there = weights != 0
        if there.any():
            source = np.rint((number - zero) / np.where(there, weights, 1.0)).astype(int) - 1
            source = np.where(there, source, -1)
            sources[k] = source, None if (weights[there] == 1).all() else weights
    return ArgumentMap(sizes, sources, [frozenset(one) for one in sets]), numbered


def _map_results(task, numbered, shapes, phase):
    """Return the `ResultMap`; `numbered` are the arguments with the numbers of their entries.

    `shapes` are those of the solution of the padded analysis, `phase` is as for `size_maps`.
    """
    tree: Any
    flat, tree = jax.tree.flatten(shapes)
    above = 1 + sum(x.size for x in jax.tree.leaves(numbered))  # of numbers of arguments
    ends = above + np.cumsum([0, *(math.prod(x.shape) for x in flat)])
    entries = [
        first + np.arange(last - first).reshape(x.shape)
        if np.issubdtype(x.dtype, np.floating)
        else np.full(x.shape, _FAILED)
        for first, last, x in zip(ends[:-1], ends[1:], flat, strict=True)
    ]
    solution = tree.unflatten(entries)
    solution = copy_with(solution, last=copy_with(solution.last, phase=np.asarray(phase)))
    found = jax.tree.leaves(cut_on_host(solution, numbered, task.bundles))
    of_arguments = np.cumsum([0, *(x.size for x in jax.tree.leaves(numbered))])
    real = [np.issubdtype(x.dtype, np.floating) for x in flat]
    parts = {}
    for k, values in enumerate(found):
        values, most = np.asarray(values), np.max(values, initial=0)
        if most < above:
            if np.issubdtype(values.dtype, np.floating):
                parts[k] = _part_of_argument(values, of_arguments, int(most))
            continue
        own = int(np.searchsorted(ends, most, "right")) - 1
        if real[own]:
            first = np.unravel_index(int(values.flat[0]) - ends[own], flat[own].shape)
            slices = tuple(
                slice(int(at), int(at) + n) for at, n in zip(first, values.shape, strict=True)
            )
            parts[k] = _Part(values.shape, own, slices)
    return ResultMap(parts, flat)


def _part_of_argument(values, ends, most):
    """Return the `_Part` of a result with the numbers of entries of an argument, or zeros."""
    if most == 0:
        return _Part(values.shape)
    return _Part(
        values.shape, argument=int(np.searchsorted(ends, most, "left")) - 1, mask=values > 0
    )
