"""Lattice masts of bars, built panel by panel, against the beam that replaces them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.traced import traced

import jaxcable as jc

WIDTH, PANEL, LEG, DIAGONAL, STRUT = 0.6, 0.7, 2e8, 4e7, 3e7


def mast(sides, panels, pattern):
    """Nodes, links and axial stiffnesses of a mast along z; nodes of a level follow each other."""
    radius = WIDTH / (2 * np.sin(np.pi / sides))
    angle = 2 * np.pi * np.arange(sides) / sides + np.pi / sides
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    nodes = [[*at, k * PANEL] for k in range(panels + 1) for at in ring]
    links, stiffness = [], []

    def add(value, *pairs):
        links.extend(pairs)
        stiffness.extend([value] * len(pairs))

    for k in range(panels):
        below, above = k * sides + np.arange(sides), (k + 1) * sides + np.arange(sides)
        add(LEG, *zip(below, above, strict=True))
        middles = len(nodes) + np.arange(sides)
        for i, j in zip(range(sides), np.roll(range(sides), -1), strict=True):
            rising, falling = (below[i], above[j]), (below[j], above[i])
            if pattern == "K":  # apex at the strut's middle, which bars in plan hold
                nodes.append([*(0.5 * (ring[i] + ring[j])), (k + 1) * PANEL])
                add(DIAGONAL, (below[i], middles[i]), (below[j], middles[i]))
                add(STRUT, (above[i], middles[i]), (middles[i], above[j]))
                add(STRUT, (middles[i], middles[j]))
                continue
            add(STRUT, (above[i], above[j]))
            first = (i + (k if pattern == "W" else 0)) % 2 == 0
            add(DIAGONAL, *{"X": (rising, falling)}.get(pattern, (rising if first else falling,)))
    return np.array(nodes), np.array(links), np.array(stiffness), ring


def truss_matrix(nodes, links, stiffness):
    """Stiffness matrix of pinned bars, first order, [3 n, 3 n]."""
    count = len(nodes)
    matrix = np.zeros((count, 3, count, 3))
    for (i, j), ea in zip(links, stiffness, strict=True):
        vector = nodes[j] - nodes[i]
        length = np.linalg.norm(vector)
        part = ea / length**3 * np.outer(vector, vector)
        for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            matrix[a, :, b] += sign * part
    return matrix.reshape(3 * count, 3 * count)


CASES = [(4, "X", 24), (3, "X", 24), (4, "N", 24), (4, "W", 24), (3, "K", 80)]


@pytest.mark.parametrize(("sides", "pattern", "panels"), CASES)
def test_a_mast_of_bars_moves_as_its_beam(sides, pattern, panels):
    """Tip deflection and rotation, twist, and shortening, within 2 % (one panel of many).

    Legs of "K" have the moment at the level of the apex, half a panel off the middle: 1/panels.
    """
    nodes, links, stiffness, ring = mast(sides, panels, pattern)
    matrix = truss_matrix(nodes, links, stiffness)
    top, held = panels * sides + np.arange(sides), 3 * sides
    around = np.column_stack([-ring[:, 1], ring[:, 0]]) / (ring[0] @ ring[0])

    def moved(forces):
        load = np.zeros((len(nodes), 3))
        load[top] = forces / sides
        found = np.zeros(3 * len(nodes))
        found[held:] = np.linalg.solve(matrix[held:, held:], load.ravel()[held:])
        return found.reshape(-1, 3)[top]

    bent = moved(np.array([1.0, 0.0, 0.0]))
    twisted = moved(np.column_stack([around, np.zeros(sides)]))
    pulled = moved(np.array([0.0, 0.0, 1.0]))
    section = jc.sections.lattice(sides, WIDTH, PANEL, LEG, DIAGONAL, STRUT, pattern)
    height = panels * PANEL
    tip = height**3 / 3 / section.EIy + height / section.GAy
    assert bent[:, 0].mean() == pytest.approx(tip, rel=0.02)
    rotation = -np.polyfit(ring[:, 0], bent[:, 2], 1)[0]
    assert rotation == pytest.approx(height**2 / 2 / section.EIy, rel=0.02)
    twist = (twisted[:, :2] * around).sum(axis=1).mean()
    assert twist == pytest.approx(height / section.GJ, rel=0.02)
    assert pulled[:, 2].mean() == pytest.approx(height / section.EA, rel=0.02)


@pytest.mark.parametrize("pattern", ["N", "W"])
def test_three_faces_with_one_diagonal_twist_more(pattern):
    """Their diagonals cannot mirror each other: GJ is an upper bound, to 5 % of the twist."""
    nodes, links, stiffness, ring = mast(3, 24, pattern)
    matrix = truss_matrix(nodes, links, stiffness)
    around = np.column_stack([-ring[:, 1], ring[:, 0]]) / (ring[0] @ ring[0])
    load = np.zeros((len(nodes), 3))
    load[72:75, :2] = around / 3
    moved = np.linalg.solve(matrix[9:, 9:], load.ravel()[9:]).reshape(-1, 3)[69:72]
    twist = (moved[:, :2] * around).sum(axis=1).mean()
    section = jc.sections.lattice(3, WIDTH, PANEL, LEG, DIAGONAL, STRUT, pattern)
    assert 1.0 < twist * section.GJ / (24 * PANEL) < 1.05


@pytest.mark.parametrize(("sides", "pattern"), [(4, "X"), (3, "X"), (4, "N"), (4, "W"), (3, "K")])
def test_shear_of_a_stocky_mast(sides, pattern):
    """With legs that hardly shorten, shear is all of the deflection.

    From the first to the fifth level: the strut at the top has half of the shear force.
    """
    nodes, links, stiffness, _ = mast(sides, 6, pattern)
    matrix = truss_matrix(nodes, links, np.where(stiffness == LEG, 1e5 * LEG, stiffness))
    load = np.zeros((len(nodes), 3))
    load[6 * sides : 7 * sides, 0] = 1 / sides
    moved = np.linalg.solve(matrix[3 * sides :, 3 * sides :], load.ravel()[3 * sides :])
    section = jc.sections.lattice(sides, WIDTH, PANEL, LEG, DIAGONAL, STRUT, pattern)
    first, fifth = (moved.reshape(-1, 3)[k * sides : (k + 1) * sides, 0].mean() for k in (0, 4))
    assert fifth - first == pytest.approx(4 * PANEL / section.GAy, rel=0.02)


def test_a_lattice_section_has_derivatives():
    def stiffness(leg, diagonal):
        section = jc.sections.lattice(3, WIDTH, PANEL, leg, diagonal)
        return section.EIy, section.GAz

    by_leg, by_diagonal = jax.jacfwd(stiffness, argnums=(0, 1))(LEG, DIAGONAL)
    assert float(by_leg[1]) == float(by_diagonal[0]) == 0.0
    bending, shear = stiffness(LEG, DIAGONAL)
    assert float(by_leg[0]) == pytest.approx(float(bending) / LEG)
    assert float(by_diagonal[1]) == pytest.approx(float(shear) / DIAGONAL)
    assert bool(jnp.isnan(traced(stiffness)(-1.0, DIAGONAL)[0]))


def test_cowpers_shear_coefficients():
    """Usual values at Poisson's ratio 0 and 0.3, with the digits of textbooks."""
    usual = {"rectangle": (0.833, 0.850), "disc": (0.857, 0.886), "ring": (0.500, 0.531)}
    for shape, values in usual.items():
        inner = 0.9999 if shape == "ring" else None  # thin walls
        found = [float(jc.sections.shear_coefficient(shape, v, inner)) for v in (0.0, 0.3)]
        assert found == pytest.approx(values, abs=6e-4)
    same = jc.sections.shear_coefficient("ring", 0.3, 0.0)
    assert float(same) == pytest.approx(float(jc.sections.shear_coefficient("disc", 0.3)))
