"""How cases along several dimensions are divided into chunks, the unit of computing and writing."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..common.types import Int


@dataclasses.dataclass(frozen=True)
class ChunkGrid:
    """A grid of cases, divided into equal chunks; those at the ends may be smaller.

    Attributes:
        shape: number of cases along each dimension.
        chunks: number of cases of a chunk along each dimension.
    """

    shape: tuple[int, ...]
    chunks: tuple[int, ...]

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of chunks along each dimension."""
        return tuple(-(-n // size) for n, size in zip(self.shape, self.chunks, strict=True))

    @property
    def n_chunk(self) -> int:
        """Number of chunks."""
        return math.prod(self.counts)

    @property
    def chunk_size(self) -> int:
        """Number of cases of a whole chunk."""
        return math.prod(self.chunks)

    def slices(self, k: int) -> tuple[slice, ...]:
        """Return the range of cases of chunk `k` along each dimension, a tuple of slices."""
        place = map(int, np.unravel_index(k, self.counts))
        return tuple(
            slice(i * size, min((i + 1) * size, n))
            for i, size, n in zip(place, self.chunks, self.shape, strict=True)
        )

    def numbers(self, k: int) -> Int[np.ndarray, " n"]:
        """Return the indices of the cases of chunk `k`, [n], the last dimension counting first."""
        return np.ravel_multi_index(np.ogrid[self.slices(k)], self.shape).ravel()


def divide_into_chunks(shape: tuple[int, ...], chunk: int) -> ChunkGrid:
    """Return the grid whose chunks have at most `chunk` cases: whole last dimensions, then parts.

    >>> from jaxcable.studies.grid import divide_into_chunks
    >>> divide_into_chunks((40, 25, 7), 1000).chunks
    (5, 25, 7)
    """
    sizes: list[int] = []
    for n in reversed(shape):
        sizes.insert(0, min(n, max(chunk, 1)))
        chunk //= sizes[0]
    return ChunkGrid(shape, tuple(sizes))
