"""Two-phase analysis of prestressed cable structures in JAX, with exact gradients.

All examples in these pages assume double precision and four names:

>>> import jax; jax.config.update("jax_enable_x64", True)
>>> import jax.numpy as jnp
>>> import numpy as np
>>> import jaxcable as jc

A net is prestressed, then loaded:

>>> structure, phases = jc.scenes.flat_net(load=15.0)
>>> solution = jc.solve(structure, phases)
>>> jc.describe(solution.status)
'converged'
>>> print(f"{solution.displacement[3, 2]:.9f} m")
-0.012838093 m
"""

import importlib as _importlib
from typing import TYPE_CHECKING as _TYPE_CHECKING

from .common import interrupt as _interrupt  # noqa: F401, isort: skip - before jax, which loads for seconds
from . import forms, loads, materials, results, sections, stiffness
from .analysis.batches import batched
from .analysis.phases import Phase
from .analysis.solution import Solution
from .analysis.solver import solve
from .common import progress, status
from .common.checks import InputWarning, UnstableWarning
from .common.compilation import forget_programs
from .common.fusion import fuse_loops
from .common.selection import only
from .common.status import AnalysisError, describe, raise_if_failed
from .common.tree import replace
from .elements import (
    Bars,
    Beams,
    Cables,
    Catenaries,
    Contacts,
    FrictionCables,
    GroundContacts,
    SlidingCables,
    SlidingCatenaries,
    Springs,
)
from .equilibrium.incremental import Incremental
from .equilibrium.newton import Newton
from .forms import find_form, force_density
from .loads import (
    AreaLoads,
    CablePressure,
    EurocodeWind,
    FacePressure,
    IceLoads,
    LineLoads,
    NodalLoads,
    PointLoads,
    PointMasses,
    SelfWeight,
    SupportMovement,
    Varying,
    WindLoads,
    WindPowerLaw,
    WindTable,
    combine,
    net_faces,
)
from .materials import Elastic, Polygonal
from .model.structure import Structure
from .model.supports import Supports, clamped, pinned, restrained
from .programs.decision import evaluation
from .results import energy_balance, fibre_stress, section_forces
from .sections import Section

__version__ = "0.2.0.dev0"

if _TYPE_CHECKING:  # `__getattr__` imports them
    from . import (
        catalogue,
        design,
        dynamics,
        extend,
        files,
        lines,
        masts,
        paths,
        plots,
        reliability,
        reporting,
        scenes,
        standards,
        studies,
    )
    from .design import fit, influence, minimize
    from .files import load_scene, save_scene
    from .paths import trace_path
    from .reporting import report
    from .studies.study import study


__all__ = [
    "AnalysisError",
    "AreaLoads",
    "Bars",
    "Beams",
    "CablePressure",
    "Cables",
    "Catenaries",
    "Contacts",
    "Elastic",
    "EurocodeWind",
    "FacePressure",
    "FrictionCables",
    "GroundContacts",
    "IceLoads",
    "Incremental",
    "InputWarning",
    "LineLoads",
    "Newton",
    "NodalLoads",
    "Phase",
    "PointLoads",
    "PointMasses",
    "Polygonal",
    "Section",
    "SelfWeight",
    "SlidingCables",
    "SlidingCatenaries",
    "Solution",
    "Springs",
    "Structure",
    "SupportMovement",
    "Supports",
    "UnstableWarning",
    "Varying",
    "WindLoads",
    "WindPowerLaw",
    "WindTable",
    "batched",
    "catalogue",
    "clamped",
    "combine",
    "describe",
    "design",
    "dynamics",
    "energy_balance",
    "evaluation",
    "extend",
    "fibre_stress",
    "files",
    "find_form",
    "fit",
    "force_density",
    "forget_programs",
    "forms",
    "fuse_loops",
    "influence",
    "lines",
    "load_scene",
    "loads",
    "masts",
    "materials",
    "minimize",
    "net_faces",
    "only",
    "paths",
    "pinned",
    "plots",
    "progress",
    "raise_if_failed",
    "reliability",
    "replace",
    "report",
    "reporting",
    "restrained",
    "results",
    "save_scene",
    "scenes",
    "section_forces",
    "sections",
    "solve",
    "standards",
    "status",
    "stiffness",
    "studies",
    "study",
    "trace_path",
]


# Rooms that an analysis does not need, and names from them: a third of the time of the import.
_ROOMS_WHEN_USED = (
    "catalogue design dynamics extend files lines masts paths plots reliability reporting scenes "
    "standards studies"
).split()
_NAMES_WHEN_USED = {
    **dict.fromkeys(("fit", "influence", "minimize"), "design"),
    **dict.fromkeys(("load_scene", "save_scene"), "files"),
    **{"report": "reporting", "study": "studies.study", "trace_path": "paths"},
}


def __getattr__(name: str) -> object:
    """Import a room, or what a name stands for, when it is first used."""
    if name in _ROOMS_WHEN_USED:
        return _importlib.import_module(f".{name}", __name__)
    if name in _NAMES_WHEN_USED:
        value = getattr(_importlib.import_module(f".{_NAMES_WHEN_USED[name]}", __name__), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return all public names, imported or not."""
    return sorted({*globals(), *__all__})
