"""Supports in any direction, forks, rigid arms, joints, torsional mechanisms: by other statics."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import beam, pieces
from oracles import stiffness_method as oracle
from oracles.convergence import converged
from oracles.taylor import assert_gradient
from oracles.traced import traced

import jaxcable as jc
from jaxcable.analysis.preparation import prepare

LAW = jc.Elastic(210e9)
BOX = jc.Section.rectangle(0.05, 0.1, LAW)
GJ = float(BOX.torsional_stiffness())
STIFFNESS = np.asarray(BOX.stiffness())
UP = np.array([0.0, 0.0, 1.0])


# --- skew supports


def test_a_skew_support_that_moves_and_is_released():
    """Moved along its direction, held in another phase, then let go: its reaction is ramped out."""
    normal = np.array([0.6, 0.0, 0.8])
    nodes = [[0.0, 0, 0], [4.0, 0, 0], [0.0, 3.0, 0], [1.0, 1.0, 2.0]]
    bars = jc.Bars([[0, 3], [1, 3], [2, 3]], axial_stiffness=np.array([1e6, 2e6, 3e6]))
    held = jc.pinned([0, 1, 2]) + jc.restrained([3], "x", axes=normal)
    structure = jc.Structure(nodes, bars, held)
    move = jc.Phase(loads=jc.SupportMovement([3], 1e-3 * normal))
    free = jc.Phase(supports=jc.pinned([0, 1, 2]))
    solution = converged(jc.solve(structure, [move, free]))
    first = solution.phases[0]
    assert np.asarray(first.displacement)[3] @ normal == pytest.approx(1e-3, rel=1e-12)
    push = np.asarray(first.reactions)[3]
    assert abs(float(push @ normal)) > 1.0
    assert np.abs(np.cross(push, normal)).max() < 1e-9 * np.abs(push).max()
    # nothing acts any more; the residual is 1e-10 of bar forces of 1e3 N over 1e5 N/m
    assert np.abs(np.asarray(solution.displacement)).max() < 1e-11
    with pytest.raises(ValueError, match="node 3 is free along its own"):
        jc.solve(structure, jc.Phase(loads=jc.SupportMovement([3], (1e-3, 0.0, 0.0))))


@pytest.mark.slow
def test_a_swing_keeps_no_twist_whatever_the_way():
    """An end that one rotation holds, led round by large moments in one phase or in three."""
    structure = beam(2, BOX, 4.0, jc.restrained([0], "xyz", "x") + jc.pinned([2]))
    moments = [(0.0, 4e4, 0.0), (0.0, 0.0, 2e4), (0.0, -1e4, 5e3)]
    total = np.sum(moments, axis=0)

    def load(moment):
        return jc.Phase(loads=jc.NodalLoads([0], (0.0, 0, 0), moment), increments=2)

    ways = [load(total)], [load(m) for m in moments]
    ends = [jc.solve(structure, way) for way in ways]
    for solution in ends:
        assert int(solution.status) == 0
        turn = np.asarray(solution.rotation)[0]
        assert np.linalg.norm(turn[1:]) > 0.03  # it has swung
        assert abs(turn[1]) < 1e-14  # the quaternion has nothing of the held direction
    a, b = (np.asarray(s.rotation) for s in ends)
    # the residual: 1e-10 of forces of 1e5 N, on stiffnesses of 1e5 N m
    assert np.abs(a - b).max() < 1e-8


# --- rigid arms


def bracket(arm):
    """Mast clamped at its foot; a guy and a load at the end of a bracket of `arm` at its top."""
    nodes = np.array([[0.0, 0, 0], [0, 0, 3.0], [0, 0, 3.0], [3.0, 1.0, 0.5]])
    nodes[2] += arm
    elements = {
        "mast": jc.Beams([[0, 1]], section=BOX, up=(1.0, 0.0, 0.0)),
        "guy": jc.Bars([[3, 2]], axial_stiffness=1e5),
    }
    return jc.Structure(nodes, elements, jc.clamped([0]) + jc.pinned([3]), rigid=[[1, 2]])


def test_a_bracket_of_a_guy():
    """Small loads and moments by rigid ends of the stiffness method; large ones in equilibrium."""
    arm, load = np.array([0.4, 0.2, 0.1]), np.array([3.0, -2.0, 1.0])
    moment = np.array([0.5, 1.0, -0.3])
    structure = bracket(arm)

    @traced
    def solved(factor):
        loads = jc.NodalLoads([2], factor * load, moments=factor * moment)
        return jc.solve(structure, jc.Phase(loads=loads))

    solution = converged(solved(1e-3))
    # the joint is the arm's end, the member ends at the mast's top, `-arm` from it
    ends = ((0, 0, 0), tuple(-arm))
    members = [
        oracle.Member(0, 1, D=STIFFNESS, GJ=GJ, up=(1.0, 0, 0), offsets=ends),
        oracle.Member(2, 1, EA=1e5, axial=True),
    ]
    nodes = np.asarray(structure.nodes)
    held = [(k, v, "translation") for k in (0, 2) for v in np.eye(3)]
    held += [(0, v, "rotation") for v in np.eye(3)]
    loads = np.zeros((3, 6))
    loads[1] = 1e-3 * np.append(load, moment)
    found = oracle.solve_frame(nodes[[0, 2, 3]], members, held, loads)
    moved = np.asarray(solution.displacement)[2]
    # second order in displacements of 1e-7 m
    assert np.abs(moved - found.displacements[1, :3]).max() < 1e-5 * np.abs(moved).max()
    solution = converged(solved(2e3))
    places, push = np.asarray(solution.positions), np.asarray(solution.reactions)
    assert np.linalg.norm(places[2] - places[1]) == pytest.approx(np.linalg.norm(arm), rel=1e-13)
    assert np.linalg.norm(np.asarray(solution.displacement)[2]) > 0.1
    forces = push.copy()
    forces[2] += 2e3 * load
    assert np.abs(forces.sum(axis=0)).max() < 1e-8 * 6e3
    turning = np.cross(places, forces).sum(axis=0) + np.asarray(solution.reaction_moments)[0]
    turning += 2e3 * moment
    assert np.abs(turning).max() < 1e-8 * 6e3 * 3.0


@pytest.mark.slow
def test_a_cable_about_to_slacken_at_a_carried_node_has_no_derivative():
    """It moves with its carrier: the derivative of one side only would be silently wrong."""
    arms = bracket(np.array([0.4, 0.2, 0.1]))
    guy = jc.Cables([[3, 2]], axial_stiffness=1e5)
    structure = jc.replace(arms, elements={**arms.elements, "guy": guy})

    @traced
    @jax.value_and_grad
    def pushed(force):
        loads = jc.NodalLoads([1], jnp.array([1.0, 0.0, 0.0]) * force)
        return jc.solve(structure, jc.Phase(loads=loads)).displacement[1, 0]

    for force in (-10.0, 10.0):  # taut, and slack
        h = 1e-3
        difference = (pushed(force + h)[0] - pushed(force - h)[0]) / (2 * h)
        # central differences: errors of 1e-10 by h^2 and the tolerance over h
        assert float(pushed(force)[1]) == pytest.approx(float(difference), rel=1e-6)
    moved, rate = pushed(0.0)
    assert moved == 0 and np.isnan(rate)


@pytest.mark.slow
def test_gradients_through_arms_forks_and_springs():
    """By springs, places and loads."""
    arm = np.array([0.4, 0.2, 0.1])
    base = bracket(arm)
    hinges = np.array([[[False, True, True], [False, False, False]]])

    def top(p):
        springs = 1e4 * p["springs"]
        mast = jc.Beams([[0, 1]], section=BOX, up=(1.0, 0, 0), hinges=hinges, springs=springs)
        nodes = jnp.asarray(base.nodes).at[2, 0].add(p["place"] - 1)
        supports = jc.restrained([0], "xyz", "z") + jc.restrained([0], "", "y") + jc.pinned([3])
        elements = {"mast": mast, "guy": base.elements["guy"]}
        structure = jc.Structure(nodes, elements, supports, rigid=[[1, 2]])
        load = jc.NodalLoads([2], 300.0 * p["load"] * jnp.array([3.0, -2.0, 1.0]))
        solution = jc.solve(structure, jc.Phase(pretension={"mast": None, "guy": 2e3}, loads=load))
        return jnp.sum(solution.positions[2] * jnp.array([1.0, 2.0, 3.0])), solution.status

    assert_gradient(top, {"springs": 1.0, "place": 1.0, "load": 1.0}, 50.0, corrupted=1.1)


# --- joints


FREE = [[False] * 3] * 2
JOINTS = {  # of the first of two beams: hinges at its ends about x, y, z, and springs in them
    "fork": (FREE, np.inf),
    "one axis": ([[False, True, False], [False, False, False]], 0.0),
    "two ends": ([[False, False, True], [False, True, True]], 0.0),
    "semi-rigid": ([[True, True, True], [False, True, False]], [[3e3, 2e4, 5e4], [0.0, 1e4, 0.0]]),
    "torsion": ([[True, False, False], [False, False, False]], 0.0),
}


@pytest.mark.slow
def test_forks_and_joints_in_linear_theory():
    """Hinges about single axes and springs, by the stiffness method: pairs of beams, not joined."""
    load, moment = 1e-3 * np.array([1.0, 2.0, -3.0]), 1e-3 * np.array([2.0, -1.0, 1.0])
    one = np.array([[0.0, 0, 0], [2.0, 0.5, 0.3], [3.0, 2.0, 0.0]])
    count = len(JOINTS)
    nodes = np.concatenate([one + 5.0 * k * UP for k in range(count)])
    links = np.concatenate([3 * k + pieces(2)[1] for k in range(count)])
    hinges = np.array([(own, FREE) for own, _ in JOINTS.values()]).reshape(-1, 2, 3)
    given = [(np.broadcast_to(springs, (2, 3)), np.zeros((2, 3))) for _, springs in JOINTS.values()]
    springs = np.where(hinges, np.array(given).reshape(-1, 2, 3), 0.0)
    group = jc.Beams(links, section=BOX, hinges=hinges, springs=springs, up=(0.1, 0, 1.0))
    held = jc.restrained([0], "xyz") + jc.restrained([0], about="x")  # one node, named twice
    held = held + jc.restrained([2], "yz", "x")
    clamps = [3 * k + end for k in range(1, count) for end in (0, 2)]
    structure = jc.Structure(nodes, group, held + jc.clamped(clamps))
    middles = 3 * np.arange(count) + 1
    loads = jc.NodalLoads(middles, np.tile(load, (count, 1)), np.tile(moment, (count, 1)))
    solution = converged(jc.solve(structure, jc.Phase(loads=loads)))
    stiff = np.where(hinges, springs, np.inf)
    members = [
        oracle.Member(*pair, D=STIFFNESS, GJ=GJ, up=(0.1, 0, 1.0), joints=stiff[k])
        for k, pair in enumerate(links.tolist())
    ]
    axes = np.eye(3)
    fixed = [(0, v, "translation") for v in axes] + [(2, v, "translation") for v in axes[1:]]
    fixed += [(k, axes[0], "rotation") for k in (0, 2)]
    fixed += [(k, v, kind) for k in clamps for v in axes for kind in ("translation", "rotation")]
    nodal = np.zeros((len(nodes), 6))
    nodal[middles] = *load, *moment
    exact = oracle.solve_frame(nodes, members, fixed, nodal)
    moved = np.asarray(solution.displacement)
    forces = np.asarray(jc.section_forces(structure, solution, [0.0, 1.0]))
    of_members = np.stack([exact.internal(k, np.array([0.0, 1.0])) for k in range(len(links))])
    for k in range(count):  # second order: 1e-6 m
        own = slice(3 * k, 3 * k + 3)
        expected = exact.displacements[own, :3]
        assert np.abs(moved[own] - expected).max() < 1e-5 * np.abs(expected).max()
        pair = slice(2 * k, 2 * k + 2)
        size = np.abs(of_members[pair]).max()
        assert np.abs(forces[pair] - of_members[pair]).max() < 1e-5 * size
    # a fork holds the torque and nothing else
    assert np.abs(np.asarray(solution.reaction_moments)[[0, 2], 1:]).max() < 1e-6 * 1e-3


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:node .* has moved")  # by its support
def test_a_hinge_about_one_axis_turns_far():
    """A rigid arm on a door hinge swings by 120 degrees, and does not fall."""
    hinges = np.array([[[False, False, True], [False, False, False]]])
    structure = beam(1, BOX, 1.0, jc.clamped([0]) + jc.restrained([1], "xy"), hinges=hinges)
    angle = np.radians(120)
    way = [
        jc.Phase(loads=jc.SupportMovement([1], (np.cos(b) - np.cos(a), np.sin(b) - np.sin(a), 0)))
        for a, b in zip(angle * np.arange(4) / 4, angle * np.arange(1, 5) / 4, strict=True)
    ]
    solution = jc.solve(structure, [*way, jc.Phase(loads=jc.NodalLoads([1], (0, 0, -10.0)))])
    assert int(solution.status) == 0
    sag = 10.0 / (3 * STIFFNESS[1, 1])
    assert float(solution.displacement[1, 2]) == pytest.approx(-sag, rel=1e-4)
    turn = np.asarray(solution.rotation)[1]
    assert 2 * np.arctan2(turn[3], turn[0]) == pytest.approx(angle, rel=1e-6)


# --- rotations about the axis that nothing holds


def mast(supports, law=LAW):
    """A guyed tube in two storeys."""
    scene = jc.scenes.guyed_mast(levels=2, per_level=1, law=law, increments=(1, 1))
    anchors = jc.pinned(np.arange(3, scene.structure.n_node))
    return jc.replace(scene.structure, supports=anchors + supports), scene.phases


@pytest.mark.slow
def test_a_mast_on_a_ball_joint_spins_and_is_no_worse_for_it():
    """Named in a warning; displacements, gradient, frequencies as where the spin is held."""
    with pytest.warns(jc.InputWarning, match="nodes 0 to 2 can spin about their line, along"):
        free, phases = mast(jc.pinned([0]))
    held, _ = mast(jc.pinned([0]) + jc.restrained([0], about="z"))

    def top(structure, tension):
        first = jc.Phase(pretension=tension, loads=jc.SelfWeight())
        solution = jc.solve(structure, [first, phases[1]])
        return solution.displacement[2, 0], solution

    found = []
    for structure in (free, held):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", jc.InputWarning)
            grad = jax.value_and_grad(lambda t, s=structure: top(s, t), has_aux=True)
            (value, solution), slope = grad(40e3)
            assert int(solution.status) == 0
            frequency = jc.dynamics.modes(structure, solution).frequency
            softness = jc.stiffness.flexibility(structure, solution, [2])
        found.append([np.asarray(v) for v in (value, slope, frequency, softness)])
    for one, other in zip(*found, strict=True):
        assert np.isfinite(one).all()
        # both at residuals of 1e-10 of the forces
        assert np.abs(one - other).max() < 1e-7 * np.abs(other).max()


def test_free_spins_of_phases_are_stacked():
    """A mast that can spin in the first phase, but not in the second one."""
    with pytest.warns(jc.InputWarning, match="can spin"):
        structure, phases = mast(jc.pinned([0]))
    anchors = jc.pinned(np.arange(3, structure.n_node))
    held = jc.replace(phases[1], supports=anchors + jc.clamped([0]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jc.InputWarning)
        schedule = prepare(structure, [phases[0], held], None, None).without_indices[-1]
    rows, piece, ends = schedule.phases.dof_map["torsional_mechanisms"]
    assert piece.tolist() == [[0, 0, 0], [-1, -1, -1]]
    assert rows.tolist() == [[0, 1, 2], [0, 0, 0]]
    assert ends.shape == (2, 1, 2)


def test_spins_are_found_from_the_geometry():
    """A line of beams that balls and hinges about it hold; not what is bent, held or off it."""
    line, links = pieces(3, 3.0)

    def mechanisms(supports, nodes=line, **options):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", jc.InputWarning)
            structure = jc.Structure(nodes, jc.Beams(links, section=BOX), supports, **options)
        return structure.fixed(supports).mechanisms

    ends = jc.pinned([0, 3])
    assert mechanisms(ends).rows.tolist() == [0, 1, 2, 3]
    assert mechanisms(ends + jc.restrained([2], about="yz")) is not None
    assert mechanisms(ends + jc.restrained([2], about="x")) is None
    assert mechanisms(jc.clamped([0])) is None
    bent = line + np.array([[0, 0, 0], [0, 0, 0.1], [0, 0, 0], [0, 0, 0]])
    assert mechanisms(ends, bent) is None
    skew = jc.restrained([1], about="x", axes=(1.0, 1.0, 0.0))
    assert mechanisms(ends + skew) is None


def test_a_clamp_holds_its_node_and_not_the_beam_beyond_a_hinge():
    held = jc.clamped([0]) + jc.restrained([1], about="x")
    structure = beam(1, BOX, 1.0, held, hinges=[[True, False]])
    of_node, _, beyond = structure.fixed(structure.supports).array
    assert of_node.all() and beyond.tolist() == [True] * 3 + [False] * 3
    again = jc.restrained([1], "xz") + jc.restrained([1], "y", "y")  # one node, named twice
    assert again.fixed(2).tolist() == [[False] * 6, [True] * 3 + [False, True, False]]
