"""Moved supports and loads along elements, in nets: closed forms and derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks import problems
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
    mask = np.zeros((3, 3), bool)
    mask[[0, 2]] = True
    mask[1] = [True, True, False]
    nodes = [[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]]
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e4)
    structure = jc.Structure(nodes, cables, jc.Supports(mask))

    def tension(move):
        phases = [jc.Phase(pretension=100.0), jc.Phase(loads=jc.SupportMovement([1], move))]
        solution = jc.solve(structure, phases)
        return solution.tension[0], solution.status

    along, up = np.array([0.0, 0.1, 0.0]), np.array([0.0, 0.0, 0.1])
    moved = traced(jax.value_and_grad(tension, has_aux=True))
    rest = 1 / (1 + 100 / 1e4)
    (_, code), rate = moved(along)
    assert int(code) == 0
    assert float(rate[1]) == pytest.approx(1e4 / rest * 0.1 / np.hypot(1, 0.1), rel=1e-10)
    assert int(moved(up)[0][1]) == status.NONFINITE
    with pytest.raises(ValueError, match="node 1 is free along z"):
        tension(up)


def mover(kind):
    """A structure of cables or of beams whose supports move, and its phases as a function."""
    if kind == "cables":
        nodes = [[-4.0, 0, 3], [0, 0, 0], [4.0, 0, 3]]
        group, held = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5), jc.pinned([0, 2])
        own, force = {"pretension": 500.0}, (0.0, 0.0, -600.0)
    else:
        section = jc.Section.rectangle(0.05, 0.08, jc.Elastic(1e8))
        nodes = [[0.0, 0, 0], [2.0, 0, 0.2], [4.0, 0, 0]]
        group, held = jc.Beams([[0, 1], [1, 2]], section=section), jc.clamped([0, 2])
        own, force = {}, (0.0, 5.0, -10.0)
    structure = jc.Structure(nodes, group, held)
    load = jc.Phase(loads=jc.NodalLoads([1], force), **own)

    def end(amount, corrections, increments):
        move = jc.SupportMovement([2], jnp.array([0.3, 0.0, 0.1]) * amount)
        phases = [load, jc.Phase(loads=move, increments=increments)]
        solution = jc.solve(structure, phases, jc.Incremental(corrections, tol=np.inf))
        return solution.displacement[1, 2]

    return end


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "corrections", "increments"), [("cables", 0, 1), ("cables", 1, 2), ("beams", 0, 1)]
)
def test_the_scheme_of_the_paper_moves_supports_as_its_derivative_says(
    kind, corrections, increments
):
    """One tangent an increment, at the place of the supports of that increment.

    By reverse mode once, else by forward mode, which compiles in less time.
    """
    end = mover(kind)

    def reach(m):
        return end(m, corrections, increments)

    def forward(m):
        return jax.jvp(reach, (m,), (1.0,))

    backward = (kind, corrections) == ("cables", 0)
    there = traced(jax.value_and_grad(reach) if backward else forward)
    h = 1e-5
    (place, rate), between = there(1.0), there(1 + h)[0] - there(1 - h)[0]
    assert float(rate) == pytest.approx(float(between) / (2 * h), rel=1e-7, abs=1e-10)
    if backward:  # by the tangent with the support moved, in NumPy
        assert float(place) == pytest.approx(one_step(), rel=1e-9)


def one_step():
    """Both phases by one linear solve each, from lengths in NumPy."""
    rest = 5.0 / (1 + 500.0 / 1e5)

    def forces(u, end):
        total, matrix = np.array([0.0, 0.0, -600.0]), np.zeros((3, 3))
        for place in (np.array([-4.0, 0, 3]), end):
            way = place - u
            length = np.linalg.norm(way)
            pull, along = 1e5 * (length - rest) / rest, way / length
            total = total + pull * along
            across = np.eye(3) - np.outer(along, along)
            matrix = matrix + 1e5 / rest * np.outer(along, along) + pull / length * across
        return total, matrix

    u = np.zeros(3)
    for end in ([4.0, 0, 3], [4.3, 0, 3.1]):  # a solve a phase
        total, matrix = forces(u, np.array(end))
        u = u + np.linalg.solve(matrix, total)
    return u[2]
