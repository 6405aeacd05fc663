"""Studies: a function of many named cases, in threads or on a cluster, results in a Zarr store."""

from .cases import Cases, product, samples, table
from .errors import ClusterLostError, StudyError
from .running import ChunkReport
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
