"""Problems with known solutions, and an equilibrium check written apart from the package."""

import json
from decimal import Decimal, getcontext
from pathlib import Path

import numpy as np
import pytest

import jaxcable as jc
from jaxcable import linear

getcontext().prec = 60

_NAMES = ("dense", "superlu", "cholmod", "pardiso")
INSTALLED = [name for name in _NAMES if linear.solver_named(name).is_installed()]
"""Linear solvers that are there."""
_THERE = pytest.mark.skipif("pardiso" not in INSTALLED, reason="pypardiso not installed")
PARDISO = pytest.param("pardiso", marks=_THERE)
CHOLMOD = pytest.param(
    "cholmod", marks=pytest.mark.skipif("cholmod" not in INSTALLED, reason="cvxopt not installed")
)
SOLVERS = ["dense", "superlu", pytest.param("pardiso", marks=[pytest.mark.slow, _THERE])]
"""Linear solvers for a cheap test of a small structure."""


def reference(name):
    """Reference numbers with their source, tests/reference/NAME.json."""
    return json.loads((Path(__file__).parents[1] / "reference" / f"{name}.json").read_text())


# --- two links: mid node of two bars in line, prestressed by T, pulled sideways by P


def two_links(axial_stiffness, pretension, load, angle=0.0, half_span=1.0, group=jc.Cables):
    """Structure and the unit normal along which the mid node is pulled."""
    along = half_span * np.array([np.cos(angle), 0.0, np.sin(angle)])
    normal = np.array([np.sin(angle), 0.0, -np.cos(angle)])
    nodes = np.stack([-along, np.zeros(3), along])
    structure = jc.Structure(
        nodes, group([[0, 1], [1, 2]], axial_stiffness=axial_stiffness), jc.pinned([0, 2])
    )
    return structure, normal


def two_links_exact(axial_stiffness, pretension, load, half_span=1.0):
    """Deflection w and force N from ``2 N w / l = P``, to 50 digits (Kwan 1998)."""
    ea, t, p, a = (Decimal(float(v)) for v in (axial_stiffness, pretension, load, half_span))
    rest = a / (1 + t / ea)

    def force(w):
        return ea * ((a * a + w * w).sqrt() - rest) / rest

    low, high = Decimal(0), a * 100
    for _ in range(190):
        w = (low + high) / 2
        if 2 * force(w) * w / (a * a + w * w).sqrt() < p:
            low = w
        else:
            high = w
    return float(w), float(force(w))


# --- independent equilibrium check


def unbalanced(nodes, links, axial_stiffness, rest_length, positions, load, tension_only=True):
    """Load minus internal force [n_node, 3] and forces [n_elem], NumPy, from lengths alone."""
    vector = positions[links[:, 1]] - positions[links[:, 0]]
    length = np.linalg.norm(vector, axis=1)
    force = axial_stiffness * (length - rest_length) / rest_length
    if tension_only:
        force = np.maximum(force, 0.0)
    pull = (force / length)[:, None] * vector
    out = np.array(load, float)
    for (i, j), f in zip(links, pull, strict=True):
        out[i] += f
        out[j] -= f
    return out, force


def pulls_on_nodes(structure, positions, tension):
    """Forces of elements of two ends on the nodes, [n_node, 3], N, from positions and tensions."""
    x = np.asarray(positions)
    total = np.zeros_like(x)
    forces = structure.group_tree.flatten_up_to(tension)
    for group, force in zip(structure.groups, forces, strict=True):
        chord = x[group.links.array[:, 1]] - x[group.links.array[:, 0]]
        pull = np.asarray(force)[:, None] * chord / np.linalg.norm(chord, axis=1, keepdims=True)
        np.add.at(total, group.links.array, np.stack([pull, -pull], axis=1))
    return total


def assert_balanced(solution):
    """Reactions and loads cancel as far as the residual of the last increment allows."""
    forces = np.abs(np.asarray(solution.reactions)).sum() + np.abs(np.asarray(solution.load)).sum()
    path = solution.phases[-1].path
    n_free = solution.displacement.size
    total = np.abs((np.asarray(solution.reactions) + np.asarray(solution.load)).sum(0)).max()
    assert total <= n_free * float(path.residual[-1]) + 64 * np.finfo(float).eps * forces
