"""Saddles that rotate with their nodes, and give them the moment of friction or a clamp."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.belt import belt, lengths_to_marks
from oracles.convergence import converged
from oracles.coulomb import relaxed
from oracles.taylor import TIGHT, assert_gradient
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import jaxcable as jc

EA, HEIGHT, STIFFNESS, PRETENSION = 2e7, 8.0, 4e6, 5e5
CENTERS = np.array([[-12.0, 0.0], [0.0, HEIGHT], [15.0, 1.0]])


def on_rigid_pylon(friction=0.2, radius=1.5, stiffness=STIFFNESS, axial_stiffness=EA):
    """A stay over a saddle on a rigid pylon, which turns on a spring at its foot, about y."""
    nodes = np.insert([*CENTERS, [0.0, 0.0]], 1, 0.0, axis=1)
    stay = jc.FrictionCables(
        links=[[0, 1, 2]], axial_stiffness=axial_stiffness, friction=friction, radius=radius
    )
    foot = jc.Springs([3], 0.0, stiffness * jnp.ones(3))
    held = jc.pinned([0, 2]) + jc.restrained([3], "xyz", "xz")
    return jc.Structure(nodes, {"stay": stay, "foot": foot}, held, rigid=[[3, 1]])


MOVES = (0.4, 0.4, -0.6, -0.6)  # of the right anchor along x, m


def moved(clamped=0, moves=MOVES):
    shifts = [jc.SupportMovement([2], (x, 0.0, 0.0)) for x in moves]
    first = jc.Phase(pretension={"stay": PRETENSION}, clamped={"stay": clamped})
    return [first, *(jc.Phase(loads=shift) for shift in shifts)]


class RigidPylon:
    """The same by the balance of moments about the foot, an equation in its angle to the left."""

    def __init__(self, friction, radius):
        self.friction, self.radius = friction, np.array([radius])
        start = self.lengths(0.0, CENTERS[2])[0]
        self.rest, self.angle = start / (1 + PRETENSION / EA), 0.0

    def places(self, angle, anchor):
        top = HEIGHT * np.array([-np.sin(angle), np.cos(angle)])
        return np.array([CENTERS[0], top, anchor])

    def lengths(self, angle, anchor):
        return lengths_to_marks(self.places(angle, anchor), CENTERS, self.radius, [-1], angle)

    def increment(self, anchor):
        """Go on to a place of the right anchor; return angle, tensions, N, and moment, N m."""

        def state(angle):
            length, arc = self.lengths(angle, anchor)
            bound = self.friction * np.abs(arc)
            return length, relaxed(length, self.rest, bound, EA)

        def unbalanced(angle):
            places = self.places(angle, anchor)
            direction = belt(places, self.radius, [-1])[0]
            pull = state(angle)[1][:, None] * np.stack([np.cos(direction), np.sin(direction)], 1)
            # tangent points are to the left of a belt that turns to the right
            side = np.stack([-np.sin(direction), np.cos(direction)], 1)
            points = places[1] + self.radius * side
            moments = points[:, 0] * pull[:, 1] - points[:, 1] * pull[:, 0]
            return moments[1] - moments[0] - STIFFNESS * angle

        near = self.angle + np.array([-0.2, 0.2])
        self.angle = brentq(unbalanced, *near, xtol=1e-15)
        length, tension = state(self.angle)
        self.rest = length / (1 + tension / EA)
        return self.angle, tension, float(self.radius[0] * (tension[1] - tension[0]))


CASES = {"slips": (0.06, 0), "sticks": (1.5, 0), "clamped": (0.0, 1), "no friction": (0.0, 0)}


@pytest.mark.parametrize("case", CASES)
def test_against_a_rigid_pylon(case):
    """Rotation, tensions and the moment of the saddle, over a history that slips back and forth."""
    friction, clamped = CASES[case]
    solution = converged(jc.solve(on_rigid_pylon(friction), moved(clamped), TIGHT))
    oracle = RigidPylon(np.inf if clamped else friction, 1.5)
    anchors = CENTERS[2] + np.outer(np.cumsum([0.0, *MOVES]), [1.0, 0.0])
    used = []
    for phase, anchor in zip(solution.phases, anchors, strict=True):
        angle, tension, moment = oracle.increment(anchor)
        found = np.asarray(phase.element_results["segment_tension"]["stay"][0])
        assert_allclose(found, tension, rtol=1e-8)
        # a rotation to the left, from x to z, is one about -y
        assert_allclose(np.asarray(phase.rotation_vector)[1], [0.0, -angle, 0.0], atol=1e-10)
        own = np.asarray(phase.element_results["saddle_moment"]["stay"][0, 0])
        assert_allclose(own, [0.0, moment, 0.0], atol=1e-8 * 1.5 * tension.max())
        used.append(float(phase.element_results["friction_used"]["stay"][0, 0]))
    used = np.array(used)
    if case == "slips":
        assert used.max() == pytest.approx(1) and used.min() == pytest.approx(-1)
    if case == "sticks":
        assert 0.01 < np.abs(used).max() < 0.99
    if case == "no friction":
        assert abs(moment) < 1e-8 * 1.5 * tension.max()
    else:
        assert abs(moment) > 0.01 * 1.5 * tension.max()
