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
from jaxcable import dynamics
from jaxcable.common.tree import merge_indices, split_indices
from jaxcable.elements import check
from jaxcable.elements.rotating_saddles import with_rotating_saddles
from jaxcable.mechanics.elementwise import evaluate_elements

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


# --- one cable in space


NODES = np.array([[-4.0, 0.0, 0.0], [0.0, 0.3, 3.0], [3.0, -0.2, 2.0], [5.0, 0.0, -1.0]])
SPATIAL = jc.FrictionCables(  # the second one has fillers
    links=[[0, 1, 2, 3], [0, 2, 3]],
    axial_stiffness=1e5,
    friction=[[0.2, 0.02], [0.3, 0.0]],
    radius=[[0.5, 0.3], [0.4, 0.2]],
    axis=(0.0, 1.0, 0.1),
    rest_length=[8.5, 6.9],
)


def in_space():
    """The cables on saddles that all rotate, and a motion of the nodes."""
    (group,) = with_rotating_saddles([SPATIAL], np.ones(4, bool), float)
    shift, turn = np.random.default_rng(3).uniform(-0.1, 0.1, (2, 4, 3))
    return group, (shift, Rotation.from_rotvec(turn))


def evaluate(name, group, motions):
    """Evaluate a method at several motions, pairs of displacements and rotations of SciPy."""
    state = group.start(jnp.asarray(NODES)[group.links.array])
    known = merge_indices(*split_indices(group))
    rows = jnp.stack([np.hstack([u, r.as_quat(scalar_first=True)]) for u, r in motions])

    def one(motion):
        return evaluate_elements(name, known, state, jnp.asarray(NODES), motion)

    return np.array(jax.vmap(one)(rows))


def test_contract():
    """Tangent and end forces after a step, in the plane of no saddle; also with fillers."""
    group, _ = in_space()
    assert check(group, NODES) is None


def test_a_cable_is_in_equilibrium_and_rotates_as_a_whole():
    """Forces and moments of one cable balance; turned with all saddles, it has them turned."""
    group, (shift, rotation) = in_space()
    whole = Rotation.from_rotvec([0.4, 1.1, -0.3])
    away = whole.apply(NODES + shift) - NODES
    found, turned = evaluate("end_forces", group, [(shift, rotation), (away, whole * rotation)])
    size = np.abs(found[..., :3]).max()
    assert (np.abs(found[0, 1:-1, 3:]).max(axis=1) > 1e-3 * size).all()
    moments = np.cross((NODES + shift)[group.links.array], found[..., :3]) + found[..., 3:]
    for sums in (found[..., :3].sum(1), moments.sum(1)):
        assert np.abs(sums).max() < 1e-12 * size * np.abs(NODES).max()
    for part in (slice(3), slice(3, 6)):
        expected = whole.apply(found[..., part].reshape(-1, 3)).reshape(2, 4, 3)
        # lengths are rounded by some eps of 5 m, and tensions by EA eps
        assert_allclose(turned[..., part], expected, atol=1e-10 * size)


def test_tangent_by_differences():
    """Rotations are composed by SciPy; a moment that stays is conjugate to ``m - spin x m / 2``."""
    group, (shift, rotation) = in_space()
    steps, h = np.eye(24).reshape(24, 4, 6), 1e-6
    motions = [
        (shift + h * s[:, :3], Rotation.from_rotvec(h * s[:, 3:]) * rotation)
        for s in (*steps, *-steps)
    ]
    ahead, behind = np.split(evaluate("end_forces", group, motions)[:, 0], 2)  # without fillers
    expected = (ahead - behind) / (2 * h)
    expected[..., 3:] -= 0.5 * np.cross(steps[..., 3:], 0.5 * (ahead + behind)[..., 3:])
    found = evaluate("tangent", group, [(shift, rotation)])[0, 0].reshape(24, 24)
    # differences of forces have an error of eps / h, and of h^2
    assert_allclose(found, expected.reshape(24, 24).T, atol=1e-8 * np.abs(found).max())


# --- beams


def on_beam_pylon(axial_stiffness=1.2e9):
    """A newcomer's bridge: a clamped saddle of 3 m on a pylon of 40 m, of four beams."""
    section = jc.Section.rectangle(3.0, 4.0, jc.Elastic(35e9), (4, 4))
    up = [[0.0, 0.0, z] for z in np.linspace(0.0, 40.0, 5)]
    stay = jc.FrictionCables(
        links=[[0, 6, 1]], axial_stiffness=axial_stiffness, friction=0.25, radius=3.0
    )
    pylon = jc.Beams([[k, k + 1] for k in range(2, 6)], section=section)
    held = jc.pinned([0, 1]) + jc.clamped([2])
    nodes = [[-60.0, 0.0, 0.0], [80.0, 0.0, 0.0], *up]
    return jc.Structure(nodes, {"stay": stay, "pylon": pylon}, held)


def test_foot_of_a_beam_pylon():
    """Tensions from the rotation of the top, and their moment about the foot at tangent points."""
    pull = jc.Phase(pretension={"stay": 2e6}, clamped={"stay": 1})
    anchor = jc.Phase(loads=jc.SupportMovement([1], (1.5, 0.0, 0.0)), increments=2)
    structure = on_beam_pylon()
    solution = converged(jc.solve(structure, [pull, anchor], TIGHT))
    radius, initial = np.array([3.0]), np.array([[-60.0, 0.0], [0.0, 40.0], [80.0, 0.0]])
    places = np.asarray(solution.positions)[[0, 6, 1]][:, [0, 2]]
    angle = -float(solution.rotation_vector[6, 1])
    start = lengths_to_marks(initial, initial, radius, [-1])[0]
    length = lengths_to_marks(places, initial, radius, [-1], angle)[0]
    tension = 1.2e9 * (length * (1 + 2e6 / 1.2e9) / start - 1)
    # the first phase deforms the pylon, so that the stay loses some of its pretension
    found = np.asarray(solution.element_results["segment_tension"]["stay"][0])
    assert_allclose(found, tension, rtol=1e-9)
    direction = belt(places, radius, [-1])[0]
    points = places[1] + 3.0 * np.stack([-np.sin(direction), np.cos(direction)], 1)
    pull = tension[:, None] * np.stack([np.cos(direction), np.sin(direction)], 1)
    moments = points[:, 0] * pull[:, 1] - points[:, 1] * pull[:, 0]
    foot = np.asarray(solution.reaction_moments)[2]
    # the moment of supports about -y holds that of the stay
    assert_allclose(foot, [0.0, moments[1] - moments[0], 0.0], atol=1e-9 * abs(foot[1]))
    moment = 3.0 * (tension[1] - tension[0])
    assert moment > 0.05 * abs(foot[1])
    # the loss of the stay takes its moment away
    lost = jc.design.loss_of_cable(structure, solution, {"stay": [0]}).loads
    (at_top,) = (load.moments for load in lost if load.has_moments)
    assert_allclose(at_top, [[0.0, -moment, 0.0]], atol=1e-9 * moment)


# --- beams that spin about their own line


STIFF = jc.Section.linear(EA=1e9, EIy=1e9, EIz=1e9, GJ=1e9)


def on_spinning_mast(rigid):
    """A cable from 6 m over a saddle on a mast on a ball joint, whose top is held, to 6 m."""
    nodes = [[0.0, 0, 0], [0, 0, 4.0], [-6.0, 0, 0], [6.0, 0, 0], [0, 0, 3.5]]
    cable = jc.FrictionCables(links=[[2, 1, 3]], axial_stiffness=1e9, radius=0.5)
    mast = jc.Beams([[0, 4 if rigid else 1]], section=STIFF)
    held = jc.pinned([0, 2, 3]) + jc.restrained([4 if rigid else 1], "xy")
    nodes, link = (nodes, [[4, 1]]) if rigid else (nodes[:4], None)
    return jc.Structure(nodes, {"mast": mast, "cable": cable}, held, rigid=link)


@pytest.mark.parametrize("rigid", [False, True])
def test_a_cable_on_its_saddle_keeps_a_mast_from_spinning(rigid):
    """Without friction: points at s and x from the axis, l apart, resist with T s x / l each."""
    structure = on_spinning_mast(rigid)  # a warning would be an error
    torque = jc.NodalLoads([4 if rigid else 1], (0.0, 0, 0), moments=(0.0, 0, 1.0))
    phase = jc.Phase(pretension={"cable": 1e5}, loads=torque)
    solution = converged(jc.solve(structure, phase, TIGHT))
    tension = np.asarray(solution.element_results["segment_tension"]["cable"][0])
    height = float(solution.positions[1, 2])
    far = np.hypot(6.0, height)  # of the anchor from the center
    length = np.sqrt(far**2 - 0.5**2)
    # the tangent point is r from the center, at acos(r / far) above the line to the anchor
    arm = 0.5 * np.cos(np.arccos(0.5 / far) - np.arctan2(height, 6.0))
    # the square of the angle, 3e-5, is left out
    assert_allclose(solution.rotation_vector[1, 2], 1 / (2 * tension[0] * arm * 6 / length), 1e-8)
    # slack cables hold nothing: the spin stays zero, as of any beam that is free
    slack = jc.Phase(shortening={"cable": -0.1}, loads=jc.NodalLoads([1], (0.0, 0, -1e3)))
    assert_allclose(converged(jc.solve(structure, slack)).rotation_vector, 0.0, atol=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_only_friction_keeps_an_axle_from_spinning(friction):
    """The axis of the saddle is that of the beam: the cable is dragged, ``2 r^2 EA / l``."""
    nodes = [[0.0, -1, 0], [0, 0, 0], [0, 1, 0], [-4.0, 0, -3], [4, 0, -3]]
    cable = jc.FrictionCables(links=[[3, 1, 4]], axial_stiffness=1e6, friction=friction, radius=0.5)
    elements = {"axle": jc.Beams([[0, 1], [1, 2]], section=STIFF), "cable": cable}
    held = jc.pinned(range(5))
    if not friction:
        with pytest.warns(jc.InputWarning, match="nodes 0 to 2 can spin about their line"):
            jc.Structure(nodes, elements, held)
        return
    structure = jc.Structure(nodes, elements, held)
    torque = jc.NodalLoads([1], (0.0, 0, 0), moments=(0.0, 1.0, 0))
    phases = [jc.Phase(pretension={"cable": 1e4}), jc.Phase(loads=torque)]
    solution = converged(jc.solve(structure, phases, TIGHT))
    straight = np.sqrt(25 - 0.5**2)
    arc = 0.5 * (np.pi / 2 + np.arctan2(3, 4) - np.arccos(0.5 / 5))  # half of it
    rest = (straight + arc) / (1 + 1e4 / 1e6)
    # to residuals of 1e-13 of 1e4 N beside a torque of 1 N m
    assert_allclose(solution.rotation_vector[1, 1], rest / (2 * 0.5**2 * 1e6), rtol=1e-8)


# --- with other nodes, in paths, in motions, in reports


def test_saddles_without_rotations_are_the_same_beside_beams():
    """A fixed saddle in a structure with beams gets no rotation; its moment acts on the support."""
    nodes = [[-4.0, 0, 0], [0.0, 0, 3], [3.0, 0, 0], [0.0, 5, 0], [1.0, 5, 0]]
    stay = jc.FrictionCables([[0, 1, 2]], axial_stiffness=EA, friction=0.2, radius=0.5)
    beam = jc.Beams([[3, 4]], section=jc.Section.rectangle(0.1, 0.1, jc.Elastic(1e9), (2, 2)))
    moves = jc.Phase(pretension={"stay": 1e4}, loads=jc.SupportMovement([2], (0.01, 0.02, 0.0)))
    held, found = jc.pinned([0, 1, 2]), []
    for elements, more in (({"stay": stay}, None), ({"stay": stay, "beam": beam}, jc.clamped([3]))):
        used = np.array(nodes[: 3 if more is None else 5])
        structure = jc.Structure(used, elements, held if more is None else held + more)
        solution = converged(jc.solve(structure, moves, TIGHT))
        found.append(solution.element_results)
        if more is not None:
            assert not np.asarray(solution.reaction_moments)[:3].any()
    for name in ("segment_tension", "saddle_moment", "contact_arc"):
        assert_allclose(found[1][name]["stay"], found[0][name]["stay"], rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("rotates", [True, False])
def test_balance_of_moments_in_reports(rotates):
    """The moment of a saddle is in the balance, whatever holds it."""
    structure = on_rigid_pylon()
    if not rotates:
        plain = jc.FrictionCables([[0, 1, 2]], axial_stiffness=EA, friction=0.2, radius=1.5)
        structure = jc.Structure(structure.nodes[:3], {"stay": plain}, jc.pinned([0, 1, 2]))
    solution = converged(jc.solve(structure, moved(moves=[0.4]), TIGHT))
    moment = np.abs(solution.element_results["saddle_moment"]["stay"]).max()
    table = jc.report(structure, solution).tables["equilibrium"]
    (line,) = (note for note in table.notes if note.startswith("unbalanced moment"))
    assert float(line.split(": ")[1].split()[0]) < 1e-9 * moment
    assert any("saddles" in note for note in table.notes) is not rotates


@pytest.mark.slow
def test_derivatives():
    """By radius, friction, and the stiffness of the foot, where the stay slips, then sticks."""

    def top(p):
        structure = on_rigid_pylon(p["mu"], p["radius"], p["foot"])
        solution = jc.solve(structure, moved(moves=[0.4, -0.1]), TIGHT)
        return solution.displacement[1, 0], solution.status

    point = {"mu": jnp.array(0.06), "radius": jnp.array(1.5), "foot": jnp.array(STIFFNESS)}
    assert_gradient(top, point)


@pytest.mark.slow
def test_paths_and_motions():
    """A path has the equilibria of phases; a damped motion under a load ends in the same one."""
    structure = on_rigid_pylon(1.5)
    start = converged(jc.solve(structure, moved(moves=[]), TIGHT))
    load = jc.NodalLoads([1], (3e4, 0.0, 0.0))
    found = converged(jc.solve(structure, jc.Phase(loads=load), TIGHT, start=start))
    path = converged(jc.trace_path(structure, jc.Phase(loads=load, increments=2), start=start))
    assert_allclose(path.displacement[-1], found.displacement, atol=1e-9)
    # a period is some 2 s; damping takes the motion away by exp(-20)
    moving = dynamics.transient(
        structure,
        load,
        start=start,
        dt=0.05,
        steps=600,
        masses=jc.PointMasses([1], 4e4),
        damping=dynamics.Rayleigh(1.5, 0.0),
    )
    assert_allclose(converged(moving).displacement[-1], found.displacement, atol=1e-8)
