"""Moved supports and loads along elements, in nets: closed forms and derivatives."""

import functools

import jax
import numpy as np
import pytest
from banks import problems
from banks.shapes import pieces
from oracles.convergence import converged
from oracles.taylor import assert_gradient
from oracles.traced import traced

import jaxcable as jc
from jaxcable.common import status

EA, REST = 1e5, 0.99


def two_links(phases):
    nodes = np.array([[-1.0, 0, 0], [0, 0, 0], [1.0, 0, 0]])
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=EA)
    return jc.solve(jc.Structure(nodes, cables, jc.pinned([0, 2])), phases)


MOVE = np.array([[-0.01, 0.0, -0.1], [0.02, 0.0, 0.3]])


def spread(move, more):
    """Two prestressed links whose supports are moved along x and z, and once `more`."""
    phases = [
        jc.Phase(rest_length=REST, increments=1),
        jc.Phase(loads=jc.SupportMovement([0, 2], move), increments=2),
        jc.Phase(loads=jc.SupportMovement([0, 2], more)),
    ]
    solution = two_links(phases)
    moved = solution.phases[1]
    return moved.tension[0] / EA + moved.reactions[2, 2] / EA, solution


@pytest.mark.slow
def test_moved_supports_stretch_the_links():
    """Also in a second phase, which keeps what was moved before."""
    _, solution = spread(MOVE, 0.5 * MOVE)
    assert int(solution.status) == 0
    for phase, move in zip(solution.phases[1:], (MOVE, 1.5 * MOVE), strict=True):
        ends = np.array([[-1.0, 0, 0], [1.0, 0, 0]]) + move
        assert np.abs(np.asarray(phase.positions)[[0, 2]] - ends).max() < 1e-15
        length = np.linalg.norm(ends[1] - ends[0]) / 2  # no load: straight, halved
        force = EA * (length - REST) / REST
        assert np.abs(np.asarray(phase.tension) - force).max() < 1e-9 * force
    # half of the movement after the first of two increments
    path = np.asarray(solution.phases[1].path.displacement_in_phase)
    assert np.abs(path[0, [0, 2]] - 0.5 * MOVE).max() < 1e-15
    problems.assert_balanced(solution)


@pytest.mark.parametrize(("angle", "held"), [(0.0, "xyz"), (0.0, "xz"), (0.5, "xz")])
def test_a_structure_that_is_carried_away_has_not_collapsed(angle, held):
    """By ten times its size, rigidly, along one of the directions in which its ends are held.

    No warning; the force is EA (1 - L0) / L0, to 1e-9.
    """
    c, s = np.cos(angle), np.sin(angle)
    axes = [[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]
    ends = jc.restrained([0, 2], held, axes=axes)
    if held == "xz":
        ends += jc.restrained([1], "y")
    nodes = np.array([[-c, 0, s], [0, 0, 0], [c, 0, -s]])
    structure = jc.Structure(nodes, jc.Cables([[0, 1], [1, 2]], axial_stiffness=EA), ends)
    move = np.array([20 * s, 0.0, 20 * c])
    carried = jc.Phase(rest_length=REST, loads=jc.SupportMovement([0, 2], move))
    solution = converged(jc.solve(structure, carried))
    np.testing.assert_allclose(solution.displacement[1], move, atol=20e-9)
    assert solution.tension == pytest.approx(EA * (1 - REST) / REST, rel=1e-9)


def test_a_beam_that_a_support_turns_by_half_a_turn_has_not_collapsed():
    """Its free end, which moves by twice its length of 2 m, to 1e-9; nothing is bent."""
    beam = jc.Beams([[0, 1]], section=jc.Section.linear(EA=1e8, EIy=1e6, EIz=1e6, GJ=1e6))
    structure = jc.Structure([[0.0, 0, 0], [2.0, 0, 0]], beam, jc.clamped([0]))
    turn = jc.SupportMovement([0], (0.0, 0.0, 0.0), rotations=(0.0, 0.0, np.pi))
    solution = converged(jc.solve(structure, jc.Phase(loads=turn, increments=8)))
    np.testing.assert_allclose(solution.displacement[1], [-4.0, 0.0, 0.0], atol=4e-9)


def test_a_roller_that_runs_away_is_no_moved_support():
    """A bar on a track along x, pushed: its far end turns over, and the track holds z alone."""
    bar = jc.Bars([[0, 1]], axial_stiffness=1e6)
    supports = jc.restrained([0], "yz") + jc.restrained([1], "y")
    structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], bar, supports)
    spring = jc.Springs([0], stiffness=(10.0, 0.0, 0.0))
    structure = jc.replace(structure, elements={"bar": bar, "track": spring})
    push = jc.NodalLoads([0, 1], [[30.0, 0, 0], [0.0, 0, -10.0]])
    with pytest.warns(jc.InputWarning, match="it has fallen over"):
        solution = jc.solve(structure, jc.Phase(loads=push, increments=10))
    assert int(solution.status) == 0


def test_gradient_by_the_movement():
    def value(move):
        force, solution = spread(move, 0.5 * MOVE)
        return force, solution.status

    gradient = assert_gradient(value, MOVE)
    along = np.array([[-1.0, 0, 0], [1.0, 0, 0]]) + MOVE
    length = np.linalg.norm(along[1] - along[0])
    normal = (along[1] - along[0]) / length
    force = 0.5 * length / REST - 1  # over EA
    expected = normal[0] / (2 * REST)  # tension, and the reaction's force and turn
    # reaction = tension times direction, pulling outwards
    expected += normal[2] * normal[0] / (2 * REST) - force * normal[0] * normal[2] / length
    assert float(gradient[1, 0]) == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
def test_traced_movements_of_partly_held_nodes():
    """Which components are zero is not known while tracing; a free one that moves has no state."""
    held = jc.pinned([0, 2]) + jc.restrained([1], "xy")
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e4)
    structure = jc.Structure(pieces(2, 2.0)[0], cables, held)

    @traced
    @functools.partial(jax.value_and_grad, has_aux=True)
    def moved(move):
        phases = [jc.Phase(pretension=100.0), jc.Phase(loads=jc.SupportMovement([1], move))]
        solution = jc.solve(structure, phases)
        return solution.tension[0], solution.status

    (_, code), rate = moved(np.array([0.0, 0.1, 0.0]))
    assert int(code) == 0
    rest = 1 / (1 + 100 / 1e4)
    assert float(rate[1]) == pytest.approx(1e4 / rest * 0.1 / np.hypot(1, 0.1), rel=1e-10)
    assert int(moved(np.array([0.0, 0.0, 0.1]))[0][1]) == status.NONFINITE
