"""Rotation vectors, tilt and twist, against SciPy's rotations; displacements by their geometry."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient
from scipy.spatial.transform import Rotation

import jaxcable as jc
from jaxcable import results
from jaxcable.common.tree import copy_with

SECTION = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
NODES = [[0.0, 0, 0], [2.0, 0, 0], [2.0, 3.0, 0]]
FRAME = jc.Structure(
    NODES,
    {"beam": jc.Beams([[0, 1]], section=SECTION), "tie": jc.Cables([[1, 2]], axial_stiffness=1e4)},
    supports=jc.clamped([0]) + jc.pinned([2]),
)
BEAM = np.array([1.0, 0, 0])


@functools.cache
def bent():
    load = jc.NodalLoads([1], (0.0, 0.0, -200.0), moments=(900.0, 0.0, 0.0))
    return converged(jc.solve(FRAME, [jc.Phase(), jc.Phase(loads=load)]))


def placed(turns, positions=NODES):
    """A state with given rotations of the nodes, as far as these functions read it."""
    x, y, z, w = Rotation.from_matrix([turn.as_matrix() for turn in turns]).as_quat().T
    quaternions = jnp.asarray(np.column_stack([w, x, y, z]))
    return copy_with(bent().last, rotation=quaternions, positions=jnp.asarray(positions))


TILTS = np.radians([1e-6, 20.0, 89.0, 91.0, 135.0, 179.0])
TWISTS = np.radians([0.0, -30.0, 95.0, -120.0, 170.0, 1e-6])


@pytest.mark.parametrize(("tilt", "twist"), list(zip(TILTS, TWISTS, strict=True)))
def test_tilt_and_twist_of_rotations_composed_by_hand(tilt, twist):
    """First a twist about the axis, then a tilt about an axis across it; also beyond 90 degrees.

    Of nodes, and of a member that moves as a rigid body but for its twist.
    """
    axis = np.array([2.0, -1.0, 2.0]) / 3
    across = np.cross(axis, [0.3, 0.7, -0.2])
    across /= np.linalg.norm(across)
    whole = Rotation.from_rotvec(tilt * across) * Rotation.from_rotvec(twist * axis)
    state = placed([whole, Rotation.identity(), Rotation.from_rotvec(twist * axis)])
    found = results.node_tilts(FRAME, state, 5.0 * axis)
    # the tilt of 1e-6 is a difference of numbers of 1
    np.testing.assert_allclose(found.tilt, [tilt, 0.0, 0.0], atol=1e-14, rtol=1e-9)
    np.testing.assert_allclose(found.twist, [twist, 0.0, twist], atol=1e-13)
    vectors = results.rotation_vectors(FRAME, state)
    np.testing.assert_allclose(vectors[0], whole.as_rotvec(), atol=1e-12)
    # sums in another order, by NumPy and by XLA
    np.testing.assert_allclose(vectors, state.rotation_vector, rtol=1e-15, atol=1e-15)
    chord = Rotation.from_rotvec(tilt * np.array([0.0, 0.6, -0.8]))
    ends = [chord * Rotation.from_rotvec(part * BEAM) for part in (twist, 0.5 * twist)]
    moved = np.array(NODES)
    moved[1] = moved[0] + 1.1 * chord.apply(np.array(NODES[1]))
    found = results.element_tilts(FRAME, placed([*ends, Rotation.identity()], moved))
    np.testing.assert_allclose(found["beam"].tilt[0], tilt, rtol=1e-9)
    np.testing.assert_allclose(found["beam"].twist[0], [twist, 0.5 * twist], atol=1e-12)
    assert found["tie"].twist is None
    tie = np.arccos((moved[2] - moved[1])[1] / np.linalg.norm(moved[2] - moved[1]))
    np.testing.assert_allclose(found["tie"].tilt[0], tie, atol=1e-7)  # arccos of nearly 1


def test_an_analysis_its_phases_and_a_batch():
    solution = bent()
    first, second = solution.phases
    assert not np.asarray(first.rotation_vector).any()
    np.testing.assert_array_equal(second.rotation_vector, solution.rotation_vector)
    twist = results.element_tilts(FRAME, second)["beam"].twist[0]
    # torsion M L / GJ of a rectangle 0.1 x 0.2 (Roark: J = 0.229 a b^3), linear
    stiffness = float(SECTION.torsional_stiffness())
    assert float(twist[1]) == pytest.approx(900.0 * 2.0 / stiffness, rel=2e-3)
    batch = jax.tree.map(lambda x: jnp.stack([x, x]), second)
    twists = results.element_tilts(FRAME, batch)["beam"].twist
    np.testing.assert_allclose(twists[1, 0], twist, rtol=1e-15)  # one rounding, with later jax
    assert results.node_tilts(FRAME, batch).tilt.shape == (2, 3)


@pytest.mark.slow
def test_derivatives_of_tilt_and_twist():
    def value(p):
        force = jnp.stack([0.0 * p[0], 0.0 * p[0], p[0]])
        moment = jnp.stack([p[1], 0.0 * p[0], 0.0 * p[0]])
        load = jc.NodalLoads([1], force, moments=moment)
        solution = jc.solve(FRAME, [jc.Phase(), jc.Phase(loads=load)], TIGHT)
        found = results.element_tilts(FRAME, solution)["beam"]
        node = results.node_tilts(FRAME, solution, (0.6, 0.0, 0.8))
        vector = results.rotation_vectors(FRAME, solution)[1]
        turned = 10 * found.tilt[0] + found.twist[0, 1] + node.tilt[1] - node.twist[1]
        return turned + vector[1], solution.status

    # rotations of 5 degrees and more; steps of 0.1 % to 5 % of the loads
    assert_gradient(value, [-2e4, 9e3], 30.0)


def test_displacements_by_their_geometry():
    """Three phases in one analysis and the last two started from the first."""
    structure, phases = jc.scenes.flat_net(load=15.0)
    phases = [*phases, jc.Phase(shortening=1e-4)]
    whole = jc.solve(structure, phases)
    begun = jc.solve(structure, phases[:1])
    later = jc.solve(structure, phases[1:], start=begun)
    assert int(whole.status) == int(later.status) == 0
    np.testing.assert_array_equal(whole.phases[2].displacement, whole.displacement)
    near = {"atol": 1e-12}  # two programs; positions of 1 m
    np.testing.assert_allclose(whole.displacement_since(1), later.displacement_since(0), **near)
    np.testing.assert_allclose(whole.displacement_since(0), whole.displacement, **near)
    for name in ("displacement", "displacement_in_phase"):
        for one, other in zip(whole.phases[1:], later.phases, strict=True):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), **near)
            np.testing.assert_array_equal(getattr(one.path, name)[-1], getattr(one, name))
    own = whole.phases[2].displacement_in_phase
    moved = np.asarray(whole.positions - whole.phases[1].positions)
    np.testing.assert_allclose(moved, own, **near)
    assert np.abs(np.asarray(whole.displacement - own)).max() > 1e-3


def test_displacements_since_a_phase_count_nodes_put_into_place():
    """A chain to which a phase attaches a further bar: the same as the report's."""
    nodes = [[0.0, 0, 0], [0, 0, -1], [0, 0, -2]]
    chain = {"upper": jc.Bars([[0, 1]], 1e3), "lower": jc.Bars([[1, 2]], 1e3)}
    held = jc.pinned([0]) + jc.restrained([1, 2], "xy")
    structure = jc.Structure(nodes, chain, held)
    pull = jc.NodalLoads([1], (0.0, 0.0, -10.0))
    phases = [jc.Phase(loads=pull), jc.Phase(adds="lower", placed="attached")]
    solution = converged(jc.solve(structure, phases))
    for k in (0, 1):
        begun = solution.phases[k].positions - solution.phases[k].displacement_in_phase
        np.testing.assert_allclose(solution.displacement_since(k), solution.positions - begun)
    np.testing.assert_allclose(solution.displacement_since(0)[1:, 2], [-0.01, -0.01], rtol=1e-9)


def test_a_report_has_rotations_and_both_displacements():
    told = jc.report(FRAME, bent(), names=["bare", "loaded"], since="loaded")
    rows = {row[0]: row for row in told.tables["rotations"].rows if row[1] == "loaded"}
    np.testing.assert_allclose(rows[1][2:5], np.degrees(bent().rotation_vector[1]), atol=1e-12)
    (tilt,) = told.tables["tilts"].rows
    found = results.element_tilts(FRAME, bent())["beam"]
    np.testing.assert_allclose(tilt[4:7], np.degrees([found.tilt[0], *found.twist[0]]), atol=1e-12)
    table = told.tables["displacements_since"]
    (row,) = (row for row in table.rows if row[0] == 1)
    np.testing.assert_allclose(row[2:5], bent().phases[1].displacement_in_phase[1], atol=1e-15)
    text = told.text()
    for title in (
        "Displacements from the start, by phase",
        "Displacements since the beginning of phase 2, loaded",
        "Rotations from the start (deg)",
        "Tilt and twist of beams and bars (deg)",
    ):
        assert title in text
    assert "rx (deg)" in told.csv()["rotations"]
    assert list(told.tables).index("displacements_since") < list(told.tables).index("rotations")
    with pytest.raises(ValueError, match="since = 'wind': no such phase; give 0 to 1, or one of"):
        jc.report(FRAME, bent(), since="wind")
    push = jc.NodalLoads([1], (0.0, 0.0, -200.0))
    later = jc.Phase(loads=push, removes="tie")  # an element that is absent has no tilt
    assert "tilts" in jc.report(FRAME, jc.solve(FRAME, later)).tables
