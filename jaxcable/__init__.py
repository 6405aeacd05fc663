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

from . import _interrupt as _interrupt  # isort: skip - before jax, which loads for seconds
from . import design, files, forms, materials, paths, plots, progress, reports, scenes
from ._check import InputWarning, UnstableWarning
from ._tree import replace
from .batches import batched
from .design import fit, influence, minimize
from .elements import Bars, Beams, Cables, Catenaries, SlidingCables
from .equilibrium import Newton
from .files import load_scene, save_scene
from .forms import find_form, force_density
from .incremental import Incremental
from .internal_forces import section_forces
from .loads import (
    AreaLoads,
    CablePressure,
    FacePressure,
    LineLoads,
    NodalLoads,
    SelfWeight,
    SupportMovement,
    combine,
    net_faces,
)
from .materials import Elastic, Polygonal
from .paths import trace_path
from .phases import Phase
from .reports import report
from .sections import Section, SectionState
from .selection import only
from .solution import Path, PhaseResult, Solution, State
from .solver import solve
from .status import AnalysisError, describe, raise_if_failed
from .stresses import fibre_stress
from .structure import Structure
from .supports import Supports, clamped, pinned, restrained

__version__ = "0.1.0"

__all__ = [
    "AnalysisError",
    "AreaLoads",
    "Bars",
    "Beams",
    "CablePressure",
    "Cables",
    "Catenaries",
    "Elastic",
    "FacePressure",
    "Incremental",
    "InputWarning",
    "LineLoads",
    "Newton",
    "NodalLoads",
    "Path",
    "Phase",
    "PhaseResult",
    "Polygonal",
    "Section",
    "SectionState",
    "SelfWeight",
    "SlidingCables",
    "Solution",
    "State",
    "Structure",
    "SupportMovement",
    "Supports",
    "UnstableWarning",
    "batched",
    "clamped",
    "combine",
    "describe",
    "design",
    "fibre_stress",
    "files",
    "find_form",
    "fit",
    "force_density",
    "forms",
    "influence",
    "load_scene",
    "materials",
    "minimize",
    "net_faces",
    "only",
    "paths",
    "pinned",
    "plots",
    "progress",
    "raise_if_failed",
    "replace",
    "report",
    "reports",
    "restrained",
    "save_scene",
    "scenes",
    "section_forces",
    "solve",
    "trace_path",
]
