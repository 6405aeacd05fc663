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

    def index(self, k: int) -> tuple[int, ...]:
        """Return the place of chunk `k` along each dimension."""
        return tuple(int(i) for i in np.unravel_index(k, self.counts))

    def slices(self, k: int) -> tuple[slice, ...]:
        """Return the range of cases of chunk `k` along each dimension."""
        return tuple(
            slice(i * size, min((i + 1) * size, n))
            for i, size, n in zip(self.index(k), self.chunks, self.shape, strict=True)
        )

    def numbers(self, k: int) -> Int[np.ndarray, " n"]:
        """Return the numbers of the cases of chunk `k`, [n], the last dimension counting first."""
        axes = np.meshgrid(*(np.arange(s.start, s.stop) for s in self.slices(k)), indexing="ij")
        return np.ravel_multi_index([axis.ravel() for axis in axes], self.shape)


def divide(shape: tuple[int, ...], chunk: int) -> ChunkGrid:
    """Return the grid whose chunks have at most `chunk` cases: whole last dimensions, then parts.

    >>> from jaxcable.studies.grid import divide
    >>> divide((40, 25, 7), 1000).chunks
    (5, 25, 7)
    """
    sizes, left = [], chunk
    for n in reversed(shape):
        size = min(n, max(left, 1))
        sizes.append(size)
        left //= size
    return ChunkGrid(shape, tuple(reversed(sizes)))
