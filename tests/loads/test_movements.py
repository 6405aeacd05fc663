"""Moved supports and loads along elements, in nets: closed forms and derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks import problems
from oracles.taylor import slope

import jaxcable as jc
from jaxcable.common import status

EA, REST = 1e5, 0.99


def two_links(phases):
    nodes = np.array([[-1.0, 0, 0], [0, 0, 0], [1.0, 0, 0]])
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=EA)
    return jc.solve(jc.Structure(nodes, cables, jc.pinned([0, 2])), phases)


@jax.jit
def spread(move):
    """Two links whose supports are moved along x and z; prestressed before."""
    phases = [
        jc.Phase(rest_length=REST, increments=1),
        jc.Phase(loads=jc.SupportMovement([0, 2], move), increments=2),
    ]
    return two_links(phases)


MOVE = np.array([[-0.01, 0.0, -0.1], [0.02, 0.0, 0.3]])


def test_moved_supports_stretch_the_links():
    solution = spread(MOVE)
    assert int(solution.status) == 0
    ends = np.array([[-1.0, 0, 0], [1.0, 0, 0]]) + MOVE
    assert np.abs(np.asarray(solution.positions)[[0, 2]] - ends).max() == 0
    length = np.linalg.norm(ends[1] - ends[0]) / 2  # no load: straight, halved
    force = EA * (length - REST) / REST
    assert np.abs(np.asarray(solution.tension) - force).max() < 1e-9 * force
    # half of the movement after the first of two increments
    path = np.asarray(solution.phases[1].path.displacement)
    assert np.abs(path[0, [0, 2]] - 0.5 * MOVE).max() < 1e-15
    problems.assert_balanced(solution)


def test_movements_keep_what_was_moved_before():
    move = jc.SupportMovement([2], (0.01, 0.0, 0.0))
    once = two_links([jc.Phase(rest_length=REST), jc.Phase(loads=move)])
    twice = two_links([jc.Phase(rest_length=REST), jc.Phase(loads=move), jc.Phase(loads=move)])
    assert int(once.status) == int(twice.status) == 0
    assert float(once.positions[2, 0]) == 1.01 and float(twice.positions[2, 0]) == 1.02


def test_gradient_by_the_movement():
    @jax.jit
    @jax.value_and_grad
    def there(move):
        solution = spread(move)
        return solution.tension[0] / EA + solution.reactions[2, 2] / EA

    def value(move):
        return there(move)[0]

    gradient = there(MOVE)[1]
    assert abs(slope(value, MOVE, gradient) - 2) < 0.05
    assert slope(value, MOVE, gradient.at[1, 0].multiply(1.01)) < 1.5
    along = np.array([[-1.0, 0, 0], [1.0, 0, 0]]) + MOVE
    length = np.linalg.norm(along[1] - along[0])
    normal = (along[1] - along[0]) / length
    force = 0.5 * length / REST - 1  # over EA
    expected = normal[0] / (2 * REST)  # tension, and the reaction's force and turn
    # reaction = tension times direction, pulling outwards
    expected += normal[2] * normal[0] / (2 * REST) - force * normal[0] * normal[2] / length
    assert float(gradient[1, 0]) == pytest.approx(expected, rel=1e-9)


def test_line_loads_on_cables_go_to_their_ends():
    nodes = np.array([[-1.0, 0, 0], [0, 0, 0], [2.0, 0, 0]])
    cables = {
        "left": jc.Cables([[0, 1]], axial_stiffness=EA),
        "right": jc.Cables([[1, 2]], axial_stiffness=EA),
    }
    structure = jc.Structure(nodes, cables, jc.pinned([0, 2]))
    load = jc.LineLoads((0.0, 0.0, -30.0), on="right")
    solution = jc.solve(structure, [jc.Phase(rest_length={"left": 0.9, "right": 1.8}, loads=load)])
    assert int(solution.status) == 0
    # per unstressed length, half to each end
    expected = np.zeros((3, 3))
    expected[1:, 2] = -0.5 * 30.0 * 1.8
    assert np.abs(np.asarray(solution.load) - expected).max() < 1e-12
    both = jc.solve(
        structure,
        [jc.Phase(rest_length={"left": 0.9, "right": 1.8}, loads=jc.LineLoads((0, 0, -30.0)))],
    )
    assert float(both.load[0, 2]) == pytest.approx(-0.5 * 30.0 * 0.9, rel=1e-14)
    problems.assert_balanced(both)


def test_a_batch_of_movements():
    scale = jnp.array([0.5, 1.0, -1.0])
    batch = jax.vmap(lambda s: spread(s * MOVE))(scale)
    assert (np.asarray(batch.status) == 0).all()
    single = spread(MOVE)
    assert np.abs(np.asarray(batch.tension[1] - single.tension)).max() < 1e-9 * EA


def test_traced_movements_of_partly_held_nodes():
    """Which components are zero is not known while tracing; a free one that moves has no state."""
    mask = np.zeros((3, 3), bool)
    mask[[0, 2]] = True
    mask[1] = [True, True, False]
    nodes = [[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]]
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e4)
    structure = jc.Structure(nodes, cables, jc.Supports(mask))

    def tension(d):
        movement = jc.SupportMovement([1], jnp.array([0.0, 1.0, 0.0]) * d)
        phases = [jc.Phase(pretension=100.0), jc.Phase(loads=movement)]
        return jc.solve(structure, phases).tension[0]

    d, rest = 0.1, 1 / (1 + 100 / 1e4)
    exact = 1e4 / rest * d / np.hypot(1, d)
    assert float(jax.grad(tension)(d)) == pytest.approx(exact, rel=1e-10)

    def lifted(d):
        movement = jc.SupportMovement([1], jnp.array([0.0, 0.0, 1.0]) * d)
        return jc.solve(structure, [jc.Phase(pretension=100.0), jc.Phase(loads=movement)]).status

    with pytest.raises(ValueError, match="node 1 is free along z"):
        lifted(0.1)
    assert int(jax.jit(lifted)(0.1)) == status.NONFINITE


def mover(kind):
    """A structure of cables or of beams whose supports move, and its phases as a function."""
    if kind == "cables":
        nodes = np.array([[-4.0, 0, 3], [0, 0, 0], [4.0, 0, 3]])
        group = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        structure, own = jc.Structure(nodes, group, jc.pinned([0, 2])), {"pretension": 500.0}
        force = (0.0, 0.0, -600.0)
    else:
        section = jc.Section.rectangle(0.05, 0.08, jc.Elastic(1e8))
        nodes = np.array([[0.0, 0, 0], [2.0, 0, 0.2], [4.0, 0, 0]])
        beams = jc.Beams([[0, 1], [1, 2]], section=section)
        structure, own, force = (
            jc.Structure(nodes, beams, jc.clamped([0, 2])),
            {},
            (0.0, 5.0, -10.0),
        )
    load = jc.Phase(loads=jc.NodalLoads([1], force), **own)

    def end(amount, corrections, increments):
        move = jc.SupportMovement([2], jnp.array([0.3, 0.0, 0.1]) * amount)
        phases = [load, jc.Phase(loads=move, increments=increments)]
        solution = jc.solve(structure, phases, jc.Incremental(corrections, tol=np.inf))
        return solution.displacement[1, 2]

    return end


@pytest.mark.parametrize("kind", ["cables", "beams"])
def test_the_scheme_of_the_paper_moves_supports_as_its_derivative_says(kind):
    """One tangent an increment, at the place of the supports of that increment.

    Without corrections in reverse mode, with them in forward mode, which compiles in less time.
    """
    end = mover(kind)
    for corrections, increments in ((0, 1), (1, 2)):

        def reach(m, a=(corrections, increments)):
            return end(m, *a)

        def forward(m, reach=reach):
            return jax.jvp(reach, (m,), (1.0,))

        there = jax.jit(forward if corrections else jax.value_and_grad(reach))
        h = 1e-5
        (place, slope), between = there(1.0), there(1 + h)[0] - there(1 - h)[0]
        assert float(slope) == pytest.approx(float(between) / (2 * h), rel=1e-7, abs=1e-10)
        if kind == "cables" and corrections == 0:  # by the tangent with the support moved, in NumPy
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
