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
from . import (
    catalogue,
    design,
    dynamics,
    extend,
    files,
    forms,
    lines,
    loads,
    masts,
    materials,
    paths,
    reliability,
    reporting,
    results,
    scenes,
    sections,
    standards,
    stiffness,
    studies,
)
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
from .design import fit, influence, minimize
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
from .files import load_scene, save_scene
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
from .paths import trace_path
from .programs.decision import evaluation
from .reporting import report
from .results import energy_balance, fibre_stress, section_forces
from .sections import Section
from .studies.study import study

__version__ = "0.2.0.dev0"

if _TYPE_CHECKING:
    from . import plots


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


def __getattr__(name: str) -> object:
    """Import `plots` when it is first used: matplotlib is slow to import."""
    if name == "plots":
        return _importlib.import_module(".plots", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
