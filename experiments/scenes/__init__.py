"""Scenes of the studies and tests, beside those of `jaxcable.scenes`: ``jc.solve(*scene)``.

Studies import them as `scenes`, as this folder is beside them; the tests find it by `pythonpath` in
pyproject.toml.
"""

import jaxcable as jc

from .arches import strung_arch
from .bridges import cable_stayed_bridge
from .cables import isolated_cable, suspended_cable
from .domes import geiger_dome, levy_dome
from .frames import lee_frame, toggle_frame
from .friction import block_and_tackle, dome_hoop, post_tensioned_beam, ropeway, saddle_stay
from .tents import tent_edge
from .trusses import cable_truss

__all__ = [
    "block_and_tackle",
    "cable_stayed_bridge",
    "cable_truss",
    "dome_hoop",
    "geiger_dome",
    "isolated_cable",
    "lee_frame",
    "levy_dome",
    "post_tensioned_beam",
    "ropeway",
    "saddle_stay",
    "strung_arch",
    "suspended_cable",
    "tent_edge",
    "toggle_frame",
]
EVERY = {name: getattr(jc.scenes, name) for name in jc.scenes.__all__ if name != "Scene"}
EVERY |= {name: globals()[name] for name in __all__}
"""All ready scenes by name, those of the package first: functions that make them."""
