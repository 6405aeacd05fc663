"""A script for OpenSees (openseespy) that computes the end state of an analysis again.

Cables, bars and contacts become ``corotTruss`` elements, whose strain is relative to the initial
chord ``c``. A force ``N(e)`` at the strain ``e = (l - L0) / L0`` relative to the unstressed length
is therefore a curve over ``(l - c) / c = (e L0 - (c - L0)) / c``: straight lines stay straight, so
that ``ElasticMultiLinear`` describes prestress, slackness, gaps and laws given by points exactly.
"""

from __future__ import annotations

from importlib import resources
from os import PathLike
from pathlib import Path

import numpy as np

from ..analysis.activation import find_inactive_dofs
from ..analysis.solution import Solution
from ..common import checks
from ..common.writing import atomic_write
from ..elements.straight import Straight
from ..model.result_parts import named_groups_of, require_single_case
from ..model.structure import Structure
from ..model.topology import require_same_topology
from .end_of_analysis import require_suffix

_INPUT = "# the input of the analysis\n"
"""Line of `opensees_script.py.txt`, beside this module, in whose place the numbers are written."""


def save_opensees(
    path: str | PathLike[str], structure: Structure, solution: Solution, steps: int = 1
) -> list[Path]:
    """Write a Python script that finds the same equilibrium with OpenSees.

    The script has the input of the analysis: initial nodes, links, laws, and the unstressed
    lengths, loads and displacements of supports at the end of all phases. The displacements of the
    solution serve for comparison only. The script prints the largest difference between them and
    those of OpenSees, writes the latter to a CSV file if it is called with a name, and ends with
    status 0, or 1 if OpenSees found no equilibrium or another one. It iterates from the initial
    nodes, in one or more load steps, with several algorithms one after the other. It fails if nodes
    have no stiffness at the start or at the end.

    Args:
        path: path of the file, ending with .py.
        structure: `Structure` of cables, bars and contacts that was analysed.
        solution: its `Solution`, with status OK. Following loads become dead loads as at the end.
        steps: number of load steps of the first attempt.

    Returns:
        Paths of the files written, a list of one.

    Raises:
        ValueError: beams, catenaries, sliding cables, springs to the ground; laws with memory; a
            failed analysis.
        OSError: the file cannot be written.

    Example:
        >>> import tempfile, pathlib
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.py"
        >>> _ = jc.files.save_opensees(path, structure, jc.solve(structure, phases))
        >>> "corotTruss" in path.read_text()
        True
    """
    path = require_suffix(path, ".py")
    require_single_case(solution)
    if int(solution.status) != 0:
        raise ValueError("solution: the analysis has failed; there is no end state to export")
    checks.require_whole_number(steps, "steps")
    require_exportable(structure)
    require_same_topology(structure, solution.last.topology, "solution")
    if solution.last.fixed[-1].axes is not None:
        raise ValueError("supports: directions other than x, y, z cannot be exported")
    elements = []
    for group, state in zip(structure.groups, solution.last.restart.states, strict=True):
        elements += _force_strain_curves(structure, group, state)
    fixed = solution.last.fixed[-1].array
    idle = find_inactive_dofs(structure, solution.last.restart.states)
    if idle is not None:  # nodes that wait for elements
        fixed = fixed | idle
    fixed = fixed[: structure.n_node, :3]
    moved = np.where(fixed, np.asarray(solution.displacement), 0.0)
    data = {
        "NODES": np.asarray(structure.nodes, float).tolist(),
        "FIXED": fixed.astype(int).tolist(),
        "MOVED": moved.tolist(),
        "ELEMENTS": elements,
        "LOADS": np.where(fixed, 0.0, np.asarray(solution.load)).tolist(),
        "EXPECTED": np.asarray(solution.displacement).tolist(),
    }
    comments = {
        "NODES": "initial positions, m",
        "FIXED": "1 where a support holds",
        "MOVED": "displacements of supports, m",
        "ELEMENTS": "nodes, strains of the initial chord, forces (N) at them",
        "LOADS": "on nodes at the end of all phases, N",
        "EXPECTED": "displacements that jaxcable found, m; for comparison only",
    }
    script = (resources.files(__package__) / "opensees_script.py.txt").read_text("utf-8")
    head, program = script.split(_INPUT)
    with atomic_write(path) as stream:
        stream.write(head)
        for name, values in data.items():
            stream.write(f"\n# {comments[name]}\n{name} = [\n")
            stream.writelines(f"    {value!r},\n" for value in values)
            stream.write("]\n")
        stream.write(f"STEPS = {int(steps)}\n{program}")
    return [path]


def require_exportable(structure: Structure) -> None:
    """Raise ValueError if elements of a structure have no counterpart in OpenSees.

    It has straight elements of two nodes whose laws have no plastic strains.
    """
    for name, group in named_groups_of(structure):
        name = name or "elements"
        if not isinstance(group, Straight) or group.links.shape[1] != 2 or group.shaped_by_load:
            raise ValueError(
                f"structure: {name} are {type(group).__name__}; only Cables, Bars and "
                "Contacts can be exported to OpenSees"
            )
        if group.has_memory:
            raise ValueError(
                f"structure: the law of {name} has plastic strains, which are not exported"
            )


def _force_strain_curves(structure, group, state):
    """Return the nodes and the force-strain curve of each active element of a group.

    Returns:
        A list for each element: first node, last node, strains over the initial chord, and the
        forces at these strains, N.
    """
    links = group.links.array
    ends = np.asarray(structure.nodes, float)[links]
    chord = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    rest, elongation = (np.asarray(v, float) for v in (state.rest_length, state.elongation))
    elements = []
    there = np.ones(len(links), bool) if state.present is None else np.asarray(state.present)
    for k in np.flatnonzero(there).tolist():
        i, j = links[k].tolist()
        strain, force = _force_strain_curve(group, k)
        chord_strain = (strain * rest[k] - elongation[k]) / chord[k]
        elements.append([i, j, chord_strain.tolist(), force.tolist()])
    return elements


def _force_strain_curve(group, k):
    """Return the corners of the force-strain curve of element `k`: strains, and forces in N.

    A curve of elements that take tension only has no force at negative strains, one of contacts
    none at positive strains.
    """
    softness = 0.0 if group.compliance is None else float(group.compliance[k])
    if group.axial_stiffness is not None:
        stiffness = float(group.axial_stiffness[k])
        strain, force = np.array([-1.0, 0.0, 1.0]), stiffness * np.array([-1.0, 0.0, 1.0])
    else:
        area, law = (group.area, group.law) if group.section is None else group.section.uniaxial()
        area = float(np.broadcast_to(area, len(group.links))[k])
        low, high = (float(v) for v in law.strain_limits)
        strain = np.unique(np.append(np.asarray(law.corner_strains()), [0.0, 1e-3]))
        strain = strain[(strain >= low) & (strain <= high)]
        # OpenSees extrapolates the first and the last line: add a point on each, within the limits
        strain = np.unique([max(low, strain[0] - 1.0), *strain, min(high, strain[-1] + 1.0)])
        force = area * np.asarray(law.stress_at(strain))
    strain = strain + softness * force
    if group.tension_only:
        taut = strain >= 0
        strain, force = np.append(-1.0, strain[taut]), np.append(0.0, force[taut])
    if group.compression_only:
        closed = strain <= 0
        strain, force = np.append(strain[closed], 1.0), np.append(force[closed], 0.0)
    return strain, force
