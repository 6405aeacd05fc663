"""Uniaxial laws, one a file: stress from strain and history variables (memory).

`law` is the contract: `Law`, with defaults for most of its members.
"""

from .elastic import Elastic
from .parallel import Parallel
from .polygonal import Polygonal
from .presets import steel, strand, tension_only

__all__ = ["Elastic", "Parallel", "Polygonal", "steel", "strand", "tension_only"]
