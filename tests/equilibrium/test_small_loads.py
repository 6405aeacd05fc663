"""Loads that are small beside the prestress: right to 1e-8 of their effect, or a status."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import jaxcable as jc
from jaxcable import status

STIFFNESS, HEIGHT = 1e8, 0.3
DECADES = range(13)


def two_links(kind, tension, supports_at):
    """Two links from supports at +-1 m, at a height, to a node at the origin, prestressed."""
    nodes = [[-1.0, 0.0, supports_at], [0.0, 0.0, 0.0], [1.0, 0.0, supports_at]]
    links = kind([[0, 1], [1, 2]], axial_stiffness=STIFFNESS)
    return jc.Structure(nodes, links, jc.pinned([0, 2])), jc.Phase(pretension=tension)


def moved_by(tension, height, force):
    """How a force (0.3, 0, -1) `force` moves the node from its place without it, in 50 digits."""
    with mpmath.workdps(50):
        start = mpmath.sqrt(1 + mpmath.mpf(height) ** 2)
        rest = start / (1 + mpmath.mpf(tension) / mpmath.mpf(STIFFNESS))

        def unbalanced(x, z, across, down):
            found = [across, -down]
            for side in (-1, 1):
                to = side - x, mpmath.mpf(height) - z
                length = mpmath.sqrt(to[0] ** 2 + to[1] ** 2)
                pull = STIFFNESS * (length - rest) / rest
                found = [f + pull * t / length for f, t in zip(found, to, strict=True)]
            return found

        def balanced(guess, across, down):
            return mpmath.findroot(lambda x, z: unbalanced(x, z, across, down), guess)

        before = balanced((0, mpmath.mpf(height) / 2), 0, 0)
        across, down = mpmath.mpf(0.3 * force), mpmath.mpf(force)
        after = balanced(tuple(before), across, down)
        return np.array([float(after[k] - before[k]) for k in (0, 1)])


def answer(kind, tension, height, force, increments=1):
    """Status, and how far the second phase moves the node, [2], m."""
    structure, prestress = two_links(kind, tension, height)
    load = jc.NodalLoads([1], (0.3 * force, 0.0, -force))
    phases = [prestress, jc.Phase(loads=load, increments=increments)]
    solution = jc.solve(structure, phases)
    return int(solution.status), np.asarray(solution.phases[1].displacement[1])[[0, 2]]


@pytest.mark.parametrize("kind", [jc.Cables, jc.Bars])
@pytest.mark.parametrize("height", [0.0, HEIGHT])
def test_twelve_decades(kind, height):
    tension, right = 1e7, 0
    for decade in DECADES:
        force = tension * 10.0**-decade
        code, moved = answer(kind, tension, height, force)
        if code == status.AT_ROUNDING:
            assert decade >= 8  # of 1e-8 of the forces, rounding leaves less than half the digits
            assert np.isnan(moved).all()
            continue
        assert code == status.OK
        exact = moved_by(tension, height, force)
        assert np.abs(moved - exact).max() <= 1e-8 * np.abs(exact).max(), decade
        right += 1
    assert right >= 8


def test_the_reproducer():
    """1 mN on two links at 10 MN: 1 mm^-3 of a sag, which the residual alone would not see."""
    structure, prestress = two_links(jc.Cables, 1e7, 0.0)
    for force in (1e3, 1.0, 0.5):
        load = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -force)))
        solution = jc.solve(structure, [prestress, load])
        assert int(solution.status) == status.OK
        # two links of 1 m at a tension N: w = F / 2 N, up to w^2
        assert float(solution.displacement[1, 2]) == pytest.approx(-force / 2e7, rel=1e-8)


@pytest.mark.parametrize("kind", [jc.Cables, jc.Bars])
def test_in_increments(kind):
    """Each increment keeps what those before have left, so that the sum is as good."""
    code, moved = answer(kind, 1e7, HEIGHT, 100.0, increments=10)
    assert code == status.OK
    exact = moved_by(1e7, HEIGHT, 100.0)
    assert np.abs(moved - exact).max() <= 1e-8 * np.abs(exact).max()


def test_a_batch_of_decades_with_gradients():
    structure, prestress = two_links(jc.Cables, 1e7, HEIGHT)

    def sag(force):
        load = jc.Phase(loads=jc.NodalLoads([1], force * jnp.array([0.3, 0.0, -1.0])))
        solution = jc.solve(structure, [prestress, load])
        return solution.phases[1].displacement[1, 2], solution.status

    forces = 1e7 * 10.0 ** -jnp.arange(1.0, 12.0)
    (moved, codes), slopes = jax.vmap(jax.value_and_grad(sag, has_aux=True))(forces)
    good = np.asarray(codes) == status.OK
    assert good[:7].all() and not good[-2:].any()  # where rounding hides the load depends on sums
    assert np.isnan(slopes[~good]).all()  # a failed analysis has no derivative
    exact = np.array([moved_by(1e7, HEIGHT, float(force))[1] for force in forces[good]])
    np.testing.assert_allclose(moved[good], exact, rtol=1e-8)
    # linear for small forces: the slope is the quotient
    np.testing.assert_allclose(
        slopes[good][3:], exact[3:] / np.asarray(forces[good][3:]), rtol=1e-3
    )


def test_a_node_that_goes_slack_is_not_held_by_what_is_left():
    """Nothing balances a leftover at a node whose cables a small load slackens."""
    nodes = [[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [1.0, 0, -1.0]]
    cables = jc.Cables([[0, 1], [1, 2], [1, 3]], axial_stiffness=1e6)
    structure = jc.Structure(nodes, cables, jc.pinned([0, 2]))
    prestress = jc.Phase(pretension=jc.only([True, True, False], 1e4))
    for force in (1.0, -1.0):  # pulled down, then pushed up: it ends hanging upwards
        load = jc.Phase(loads=jc.NodalLoads([3], (0.0, 0.0, -force)))
        solution = jc.solve(structure, [prestress, load])
        assert int(solution.status) == status.OK
        assert float(solution.tension[2]) == pytest.approx(1.0, abs=1e-6)
        assert np.sign(solution.positions[3, 2]) == -np.sign(force)


def test_movements_need_not_show_a_tiny_load():
    """A phase with a movement is judged by it, although a tiny load comes along."""
    structure, prestress = two_links(jc.Cables, 1e6, HEIGHT)
    both = [jc.SupportMovement([2], (0.01, 0.0, 0.0)), jc.NodalLoads([1], (0.0, 0.0, -1e-3))]
    assert int(jc.solve(structure, [prestress, jc.Phase(loads=both)]).status) == status.OK


def test_float32_is_judged_by_forces_only():
    structure, prestress = two_links(jc.Cables, np.float32(1e3), np.float32(HEIGHT))
    nodes = np.asarray(structure.nodes, np.float32)
    load = jc.NodalLoads([1], np.array([0.0, 0.0, -1e-4], np.float32))
    solution = jc.solve(jc.replace(structure, nodes=nodes), [prestress, jc.Phase(loads=load)])
    assert solution.displacement.dtype == np.float32 and int(solution.status) == status.OK
