"""Studies: a function of many named cases, in threads or on a cluster, results in a Zarr store."""

from .cases import Cases, product, samples, table
from .engines import ClusterLostError
from .running import ChunkReport, StudyError
from .study import Study

__all__ = [
    "Cases",
    "ChunkReport",
    "ClusterLostError",
    "Study",
    "StudyError",
    "product",
    "samples",
    "table",
]
