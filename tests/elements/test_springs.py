"""Springs to the ground and bearings that lift off; against Winkler's beam, statics and NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import pieces
from numpy.testing import assert_allclose
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient, joined
from scipy.spatial.transform import Rotation

import jaxcable as jc
from jaxcable.common import status

SIDE, E = 0.1, 10e9
INERTIA = SIDE**4 / 12


def beam(n, span, springs, loads):
    """A beam of `n` elements along x, in the plane x z, and its solution under nodal loads."""
    nodes, links = pieces(n, span)
    # two by two fibres have the inertia of the whole, as fibres have their own
    section = jc.Section.rectangle(SIDE, SIDE, jc.Elastic(E), shape=(2, 2))
    elements = {"beam": jc.Beams(links, section=section), **springs}
    supports = jc.restrained(range(n + 1), "y", "xz") + jc.restrained([0], "x")
    structure = jc.Structure(nodes, elements, supports)
    return structure, jc.solve(structure, jc.Phase(loads=loads))


@pytest.mark.slow
def test_beams_on_an_elastic_foundation_converge_to_winkler():
    """A point load at the middle of a long beam: ``w = P lambda / 2k``, of second order.

    Source: Hetenyi, "Beams on elastic foundation" (1946), section 2, infinite beam:
    ``w(x) = P lambda / (2 k) exp(-lambda x) (cos lambda x + sin lambda x)``,
    ``lambda = (k / 4 E I)^(1/4)``. The foundation is springs of k h at nodes of distance h. The
    load is small, so that deflections (some 1e-8 m) are linear.
    """
    k, load = 1e5, 1e-2
    wave = (k / (4 * E * INERTIA)) ** 0.25
    span = 16 / wave  # the ends have exp(-8) = 3e-4 of the deflection, and change w by its square
    errors, away = [], []
    for n in (16, 32, 64):
        share = np.full(n + 1, k * span / n)
        share[[0, -1]] /= 2
        springs = jc.Springs(range(n + 1), np.outer(share, [0.0, 0.0, 1.0]))
        force = jc.NodalLoads([n // 2], (0.0, 0.0, -load))
        _, solution = beam(n, span, {"soil": springs}, force)
        assert int(solution.status) == 0
        exact = load * wave / (2 * k)
        errors.append(abs(-float(solution.displacement[n // 2, 2]) / exact - 1))
        at = n // 2 + n // 16  # lambda x = 1
        other = exact * np.exp(-1.0) * (np.cos(1.0) + np.sin(1.0))
        away.append(abs(-float(solution.displacement[at, 2]) / other - 1))
        soil = solution.element_results["spring_force"]["soil"]
        assert abs(float(soil[:, 2].sum()) - load) < 1e-9 * load  # all of the load
    rates = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    # h lambda is 1, 0.5, 0.25: the last rate is near its limit 2, or above (the trapezoidal rule)
    assert rates[-1] > 1.9 and errors[-1] < 1e-3, (errors, rates)
    assert away[-1] < 1e-3, away


def test_a_beam_lifts_off_one_of_three_bearings():
    """Ends on bearings, and a gap of 5 mm in the middle that closes under load or does not."""
    span, load, firm = 4.0, 600.0, 1e8
    bearings = jc.GroundContacts([0, 2, 4], firm, gap=np.array([0.0, 0.005, 0.0]))
    for force in (0.4 * load, load):
        _, solution = beam(4, span, {"ground": bearings}, jc.NodalLoads([2], (0.0, 0.0, -force)))
        assert int(solution.status) == 0
        stiff = 48 * E * INERTIA / span**3
        # (F - M) / s + (F - M) / 2 k = gap + M / k, where the middle presses with M
        soft = 1 / stiff + 0.5 / firm
        middle = max((force * soft - 0.005) / (soft + 1 / firm), 0.0)
        expected = [-(force - middle) / 2, -middle, -(force - middle) / 2]
        # slopes of 5e-3: geometry changes forces by their square
        assert np.abs(np.asarray(solution.tension["ground"]) - expected).max() < 1e-3 * force
        pressed = np.asarray(solution.element_results["spring_force"]["ground"])
        assert np.abs(pressed[:, 2].sum() - force) < 1e-6 * force
        assert np.abs(pressed[:, :2]).max() == 0.0
    # a load beyond the second bearing lifts the first off, up to where the weight of 1 N holds it
    bearings = jc.GroundContacts([0, 2], 1e8)
    loads = jc.NodalLoads([0, 4], [(0.0, 0.0, -200.0), (0.0, 0.0, -150.0)])
    _, solution = beam(4, span, {"ground": bearings}, loads)
    assert int(solution.status) == 0
    assert np.abs(np.asarray(solution.tension["ground"]) - [-50.0, -300.0]).max() < 0.1


def test_a_beam_that_loses_its_ground_is_a_mechanism():
    bearings = jc.GroundContacts([0, 2], 1e9)
    _, solution = beam(4, 4.0, {"ground": bearings}, jc.NodalLoads([2], (0.0, 0.0, 10.0)))
    assert int(solution.status) in (status.MECHANISM, status.NOT_CONVERGED)
    assert np.isnan(np.asarray(solution.displacement)).all()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:node .* has moved")  # far, as it is meant to
def test_large_rotations_of_a_spring():
    """A moment turns an end by 1.5 rad: the same stiffness about all axes gives ``k theta``."""
    axis = np.array([1.0, 2.0, 2.0]) / 3
    elements = {
        "arm": jc.Beams([[0, 1]], section=jc.Section.disc(0.1, jc.Elastic(1e9), (2, 2))),
        "spring": jc.Springs([0], 0.0, rotational_stiffness=200.0),
    }
    structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], elements, jc.pinned([0]))
    load = jc.NodalLoads([0], (0.0, 0.0, 0.0), moments=300.0 * axis)
    solution = converged(jc.solve(structure, jc.Phase(loads=load, increments=4)))
    turned = Rotation.from_quat(solution.rotation[0], scalar_first=True).as_rotvec()
    assert np.abs(turned - 1.5 * axis).max() < 1e-9
    moment = np.asarray(solution.element_results["spring_moment"]["spring"][0])
    assert np.abs(moment + 300.0 * axis).max() < 1e-6


def test_forces_are_differences_of_an_independent_energy():
    """Axes of its own, a preload, different stiffness about three axes, large rotation."""
    rng = np.random.default_rng(3)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    firm, turning, ahead = np.array([3.0, 0.5, 8.0]), np.array([2.0, 9.0, 4.0]), rng.normal(size=3)
    springs = jc.Springs([0], firm, turning, axes, ahead)
    one = jc.common.tree.copy_with(
        springs, links=None, stiffness=firm, rotational_stiffness=turning, axes=axes, preload=ahead
    )
    state = jax.tree.map(lambda x: x[0], springs.start(jnp.zeros((1, 1, 3))))
    turn, moved = Rotation.random(rng=rng), rng.normal(size=3)
    motion = np.append(moved, turn.as_quat(scalar_first=True))[None]

    def energy(step):
        u = axes @ (moved + step[:3])
        theta = axes @ (Rotation.from_rotvec(step[3:]) * turn).as_rotvec()
        return (firm * u**2).sum() / 2 - ahead @ u + (turning * theta**2).sum() / 2

    steps = 1e-5 * np.eye(6)
    slopes = [(energy(step) - energy(-step)) / 2e-5 for step in steps]
    found = one.end_forces(state, jnp.zeros((1, 3)), jnp.asarray(motion))
    # truncation 1e-10, rounding 1e-16 / 1e-5 of an energy of order 10
    assert np.abs(np.asarray(found)[0] - slopes).max() < 1e-8
    assert abs(float(one.energy(state, None, jnp.asarray(motion))) - energy(np.zeros(6))) < 1e-12


ROOF = [[-2.0, 0, 0], [0, 0, 0.5], [2.0, 0, 0]]


def on_soft_ground(p):
    """A cable over a node on a spring, and a bearing beside it; displacement of the middle."""
    elements = {
        "cable": jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5),
        "spring": jc.Springs([1], p[0] * jnp.array([1.0, 2.0, 3.0]), preload=(0.0, 0.0, 20.0)),
        "ground": jc.GroundContacts([1], 5e3, (p[1], 0.0, 1.0), gap=p[2]),
    }
    structure = jc.Structure(ROOF, elements, jc.pinned([0, 2]))
    tension = {"cable": 1000.0}
    load = jc.NodalLoads([1], (30.0, 0.0, -900.0))
    phases = [jc.Phase(pretension=tension), jc.Phase(loads=load)]
    return jc.solve(structure, phases, TIGHT)


def test_gradients_by_numbers_of_springs():
    def moved(p):
        solution = on_soft_ground([p["stiffness"], p["normal"], p["gap"]])
        pressed = solution.tension["ground"][0] < -100
        code = jnp.where(pressed, solution.status, status.MECHANISM)
        return solution.displacement[1] @ jnp.array([1.0, 0.3, -2.0]), code

    sizes = {"stiffness": 100.0, "normal": 20.0, "gap": 100.0}
    assert_gradient(*joined(moved, {"stiffness": 2e3, "normal": 0.3, "gap": 0.02}, sizes))


def test_springs_that_a_phase_adds_are_unstressed():
    elements = {
        "bars": jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e5),
        "spring": jc.Springs([1], 1e3),
        "ground": jc.GroundContacts([1], 1e3, gap=-0.01),
    }
    held = jc.pinned([0, 2]) + jc.restrained([1], "y")
    structure = jc.Structure(ROOF, elements, held)
    load = jc.NodalLoads([1], (0.0, 0.0, -300.0))
    later = jc.Phase(adds={"spring": True, "ground": True})
    solution = converged(jc.solve(structure, [jc.Phase(loads=load), later]))
    first, last = (np.asarray(phase.positions[1]) for phase in solution.phases)
    rise = last[2] - first[2]
    force = np.asarray(solution.element_results["spring_force"]["spring"][0])
    assert np.abs(force + 1e3 * (last - first)).max() < 1e-9
    # the bearing is pressed in by 1 cm less than its node has risen
    assert abs(float(solution.tension["ground"][0]) + 1e3 * (0.01 - rise)) < 1e-9


def test_reports_files_and_pictures(tmp_path):
    bearings = jc.GroundContacts([0, 2, 4], 1e8, gap=np.array([0.0, 0.005, 0.0]))
    structure, solution = beam(4, 4.0, {"ground": bearings}, jc.NodalLoads([2], (0.0, 0.0, -300.0)))
    tables = jc.report(structure, solution).tables
    slack = tables["slack"]
    assert slack.title == "Slack cables, open contacts" and len(slack.rows) == 1
    total = tables["equilibrium"].rows[-1]
    assert max(abs(number) for number in total if isinstance(number, float)) < 1e-6 * 300
    figure = jc.plots.net(solution, structure=structure)
    texts = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    texts += [
        t.get_text() for a in figure.axes if a.get_legend() for t in a.get_legend().get_texts()
    ]
    assert "on a spring or bearing" in texts
    path = tmp_path / "scene.json"
    phases = [jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -300.0)))]
    jc.save_scene(path, (structure, phases))
    again, _ = jc.load_scene(path)
    assert np.array_equal(again.elements["ground"].gap, bearings.gap)
    jc.files.save_vtk(tmp_path / "scene.vtk", structure, solution)


def test_a_single_node_on_springs_is_no_mechanism():
    """A structure without extent: its movement is measured by nothing but the springs."""
    structure = jc.Structure(
        [[0.0, 0, 0]], jc.Springs([0], (1e3, 1e3, 1e3)), jc.restrained([0], "x")
    )
    load = jc.NodalLoads([0], (0.0, 0.0, -100.0))
    solution = converged(jc.solve(structure, jc.Phase(loads=load)))
    assert_allclose(solution.displacement, [[0, 0, -0.1]], atol=1e-12)
