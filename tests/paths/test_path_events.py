"""Events of paths where they are easily missed, invented or misnamed."""

import importlib
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.problems import HEAVY, INSTALLED

import jaxcable as jc
from jaxcable.common import status
from jaxcable.scenes import von_mises_truss
from jaxcable.scenes.snapping import in_plane, solid


@pytest.fixture(scope="module", params=HEAVY)
def newton(request):
    """The method, with every linear solver; by default only the dense one."""
    return jc.Newton(linear_solver=request.param)


def ok(path, code=0):
    assert int(path.status) == code, jc.describe(path.status)
    return path


@pytest.mark.slow
def test_a_path_may_end_where_the_load_has_fallen(newton):
    path = ok(jc.trace_path(*von_mises_truss(), down_to=-0.5, method=newton))
    assert float(path.load_factor[-1]) == -0.5 and float(path.rise[-1]) < 0
    assert path.events.names == ["limit point"]


@pytest.mark.slow
def test_a_start_that_is_unstable_already(newton):
    """The truss is pushed down into its unstable range by supports, and let go there."""
    structure, _ = von_mises_truss()
    held = jc.replace(structure, supports=jc.Supports(np.ones((3, 3), bool)))
    free = np.ones((3, 3), bool)
    free[1, 2] = False
    push = jc.Phase(loads=jc.SupportMovement([1], (0, 0, -0.1)))
    load = jc.NodalLoads([1], (0, 0, -100.0))
    release = jc.Phase(supports=jc.Supports(free), loads=load)
    path = ok(jc.trace_path(held, [push, release], through=False, method=newton), 13)
    assert path.events.names == ["bifurcation"]
    assert float(path.failure_load) == 0.0


@pytest.mark.slow
def test_a_load_that_follows_makes_no_bifurcation(newton):
    """A pressed face makes the tangent unsymmetric; its symmetric part is singular elsewhere."""
    nodes = np.array([[0, 0, 1], [-1, 0, 0], [1, 0, 0], [-0.2, -1, 0.9], [0.2, 1, 1.1]])
    held = np.ones((5, 3), bool)
    held[0, [0, 2]] = False
    bars = jc.Bars([[0, 1], [0, 2]], axial_stiffness=1e4)
    structure = jc.Structure(nodes, bars, supports=jc.Supports(held))
    phases = [
        jc.Phase(loads=jc.FacePressure([[0, 3, 4]], 6000.0)),
        jc.Phase(loads=jc.NodalLoads([0], (0, 0, -4000.0))),
    ]
    path = ok(jc.trace_path(structure, phases, method=newton))
    kinds = path.events.names
    assert kinds == ["limit point"] * 2
    # at a limit point no load above is carried near by: the path itself is the witness
    top = float(path.events.load_factor[0])
    assert abs(top - float(path.load_factor[:30].max())) < 1e-12 and abs(top - 0.52729) < 1e-4
    assert set(np.asarray(path.n_negative).tolist()) == {0, 1}


@pytest.mark.slow
def test_derivative_of_a_limit_load_with_a_load_that_follows(newton):
    nodes = np.array([[0, 0, 1], [-1, 0, 0], [1, 0, 0], [-0.2, -1, 0.9], [0.2, 1, 1.1]])
    held = np.ones((5, 3), bool)
    held[0, [0, 2]] = False

    @jax.jit
    def value(p):
        bars = jc.Bars([[0, 1], [0, 2]], axial_stiffness=p[0] * 1e4)
        structure = jc.Structure(nodes, bars, supports=jc.Supports(held))
        phases = [
            jc.Phase(loads=jc.FacePressure([[0, 3, 4]], 6000.0 * p[1])),
            jc.Phase(loads=jc.NodalLoads([0], (0, 0, -4000.0))),
        ]
        return jc.trace_path(structure, phases, through=False, method=newton).failure_load

    point = jnp.ones(2)
    gradient = jax.jit(jax.grad(value))(point)
    step = 1e-5 * jnp.eye(2)
    central = jnp.stack([(value(point + h) - value(point - h)) / 2e-5 for h in step])
    # differences of load factors located to 1e-12 are good to 1e-7, and of second order
    assert np.allclose(gradient, central, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
def test_an_unstressed_cable_is_neither_slack_nor_taut(dtype, newton):
    """Four plumb cables and one between their nodes, which all loads leave without strain."""
    d = np.array([1, 0.37, 0.11])
    d = 0.83 * d / np.linalg.norm(d)
    up, down = np.array([0, 0, 2.0]), np.array([0, 0, -2.0])
    nodes = jnp.asarray(np.stack([0 * d, d, up, d + up, down, d + down]), dtype)
    cables = jc.Cables([[2, 0], [3, 1], [4, 0], [5, 1], [0, 1]], axial_stiffness=1.37e5)
    structure = jc.Structure(nodes, cables, supports=jc.pinned([2, 3, 4, 5]))
    phases = [
        jc.Phase(pretension=np.array([100.0, 100, 100, 100, 0])),
        jc.Phase(loads=jc.NodalLoads([0, 1], (7.3, 3.1, -50.0))),
    ]
    path = ok(jc.trace_path(structure, phases, method=newton))
    assert len(path.events) == 0 and float(path.load_factor[-1]) == 1.0


def test_a_corner_is_no_smooth_limit_point_beside_a_stiff_bar(newton):
    """A bar with a falling branch reaches its peak; next to it one of any stiffness."""
    law = jc.Polygonal([0.0, 0.01, 0.03], [0.0, 1e8, 0.4e8])
    held = np.ones((4, 3), bool)
    held[[1, 3], 2] = False

    def load(length, stiffness):
        nodes = jnp.array([[0, 0, 0], [0, 0, 0], [1.0, 0, 0], [1.0, 0, -1.0]])
        elements = {
            "law": jc.Bars([[0, 1]], area=1e-4, law=law),
            "stiff": jc.Bars([[2, 3]], axial_stiffness=stiffness),
        }
        structure = jc.Structure(nodes.at[1, 2].set(-length), elements, jc.Supports(held))
        phase = jc.Phase(loads=jc.NodalLoads([1], (0, 0, -2e4)))
        return jc.trace_path(structure, [phase], through=False, method=newton).failure_load

    value, slope = jax.jit(jax.value_and_grad(load))(2.0, 1e13)
    assert abs(float(value) - 0.5) < 1e-9 and np.isnan(slope)


@pytest.mark.slow
def test_masses_at_some_nodes_only():
    structure, phases = jc.scenes.flat_net()
    solution = jc.solve(structure, phases)
    masses = np.zeros(structure.n_node)
    masses[3] = 10.0
    found = jc.stiffness.natural_frequencies(structure, solution, masses=masses)
    assert found.frequency.shape == (3,)
    # the other nodes follow: one mass on the flexibility of its node
    flexibility = np.asarray(jc.stiffness.flexibility(structure, solution, [3]))
    exact = np.sqrt(np.linalg.eigvalsh(np.linalg.inv(flexibility)) / 10.0) / (2 * np.pi)
    assert np.allclose(found.frequency, exact, rtol=1e-9)


@pytest.fixture
def rods(monkeypatch):
    """Plane extensible rods by shooting, of the experiments."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "experiments"))
    yield importlib.import_module("rods")
    sys.modules.pop("rods", None)


@pytest.mark.slow
def test_williams_toggle(rods, newton):
    exact = [load for load, _ in rods.toggle_limits()]
    path = ok(jc.trace_path(*jc.scenes.toggle_frame(4), method=newton))
    assert path.events.names == ["limit point"] * 2
    # shallow local strain: of order 4 in the element, 7e-4 with four a side
    assert np.allclose(80 * path.events.load_factor, exact, rtol=1e-3)


@pytest.mark.slow
def test_lee_frame(rods, newton):
    guess = np.array([np.pi / 2, 0, -0.1, 0.1])
    for w in np.arange(1, 49.0):
        guess = rods.lee_frame(w, guess)
    limit, _ = rods.lee_limit(48.7, guess)
    path = ok(jc.trace_path(*jc.scenes.lee_frame(2), method=newton))
    assert path.events.names == ["limit point"] * 2
    first = 30 * float(path.events.load_factor[0])
    assert abs(first / limit - 1) < 5e-5  # of order 4; 2.3e-5 with 20 elements
    assert abs(first / 1.8552 - 1) < 5e-4  # published, with shear
    down = -np.asarray(path.displacement)[:, 12, 2]
    assert np.diff(down).min() < -0.1  # it snaps back
    w = 40.0  # on the way up
    k = np.flatnonzero(down > w)[0]
    between = np.interp(w, down[k - 1 : k + 1], 30 * np.asarray(path.load_factor)[k - 1 : k + 1])
    assert abs(between - rods.lee_frame(w, guess)[3]) < 5e-3  # of the chord between two points


@pytest.mark.slow
def test_a_dome_twists(newton):
    """The path goes straight on where corrections could fall onto the twisted branch."""
    path = ok(jc.trace_path(*jc.scenes.geiger_dome(load=500.0), method=newton))
    assert path.events.names == ["bifurcation"] and float(path.events.alignment[0]) < 1e-6
    structure, (prestress, loading) = jc.scenes.geiger_dome(load=500.0)

    @jax.jit
    def lowest(factor):
        forces = factor * jnp.asarray(loading.loads.forces)
        load = jc.replace(loading, loads=jc.replace(loading.loads, forces=forces))
        solution = jc.solve(structure, [prestress, load])
        return jnp.linalg.eigvalsh(jc.stiffness.tangent_of(structure, solution))[0]

    at = float(path.events.load_factor[0])
    assert float(lowest(at * (1 - 1e-6))) > 0 > float(lowest(at * (1 + 1e-6)))


@pytest.mark.slow
def test_an_arch_of_358_unknowns_on_every_solver():
    """A shallow arch of 120 beams under a load beside its crown: the limit load is one."""
    n, radius, side = 120, 10.0, 0.06
    angle = np.linspace(-0.5, 0.5, n + 1)
    rise = np.cos(angle) - np.cos(0.5)
    nodes = radius * np.column_stack([np.sin(angle), 0 * angle, rise])
    links = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    section = solid(side**2, side**4 / 12, 210e9)
    beams = jc.Beams(links, section=section, torsional_stiffness=1e5, up=(0.0, 1.0, 0.0))
    structure = jc.Structure(nodes, beams, supports=in_plane(n + 1, pinned=[0, n]))
    force = 40 * 210e9 * side**4 / 12 / radius**2
    load = jc.NodalLoads([60, 67], [(0, 0, -force), (0, 0, -0.1 * force)])
    loads = []
    for solver in INSTALLED:
        method = jc.Newton(linear_solver=solver)
        path = ok(jc.trace_path(structure, jc.Phase(loads=load), method, through=False), 12)
        loads.append(float(path.failure_load))
    # forces of 40 EI / R^2 in balance to 1e-10 of the largest in the arch
    assert np.ptp(loads) < 1e-8 and abs(loads[0] - 0.50252495) < 1e-7


@pytest.mark.slow
def test_two_columns_that_buckle_together_under_loads_that_follow(newton):
    """An even number of eigenvalues crosses zero: no sign of a determinant tells.

    Rigid struts between springs across; a pressed face beside each top couples both ways across by
    ``-s`` and ``s = p c / 6``, c its edge. With kx, ky of the springs and the load P on the top the
    tangent ``[[kx - P/h, -s], [s, ky - P/h]]`` has closed eigenvalues.
    """
    h, side, kx, ky, s, edge = 2.0, 4.0, 1e3, 2.4e3, 400.0, 1.5
    top = np.array([[0, 0, h]])
    springs = top + side * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    corners = top + np.array([[1, 0, -edge / 2], [1, 0, edge / 2]])
    one = np.concatenate([top, [[0, 0, 0]], springs, corners])
    nodes = np.concatenate([one, one + np.array([20.0, 0, 0])])
    both = np.array([0, 8])
    struts = jc.Bars(both[:, None] + [0, 1], axial_stiffness=1e12)
    links = (both[:, None, None] + [[0, 2], [0, 3], [0, 4], [0, 5]]).reshape(-1, 2)
    soft = jc.Bars(links, axial_stiffness=np.tile(side / 2 * np.array([kx, kx, ky, ky]), 2))
    held = np.ones((16, 3), bool)
    held[both] = False
    parts = {"struts": struts, "springs": soft}
    structure = jc.Structure(nodes, parts, supports=jc.Supports(held))
    pressure = 6 * s / edge
    faces = jc.FacePressure(both[:, None] + [0, 6, 7], pressure)
    area = 0.5 * np.cross(corners[0] - top[0], corners[1] - top[0])
    phases = [
        # what the face pushes in its first place is taken by a dead load
        jc.Phase(loads=[faces, jc.NodalLoads(both, -pressure / 3 * area)]),
        jc.Phase(loads=jc.NodalLoads(both, (0, 0, -5000.0))),
    ]
    path = ok(jc.trace_path(structure, phases, method=newton))
    middle, half = (kx + ky) / 2, np.sqrt(((ky - kx) / 2) ** 2 - s**2)
    assert path.events.names == ["bifurcation"] * 2
    assert np.asarray(path.events.multiplicity).tolist() == [2, 2]
    exact = h * np.array([middle - half, middle + half])
    # the struts are shortened by P / EA = 5e-9, brackets are squares of 1e-5
    assert np.allclose(5000 * path.events.load_factor, exact, rtol=1e-7)
    numbers = np.asarray(path.n_negative)
    assert numbers[0] == 0 and numbers[-1] == 4 and set(numbers.tolist()) == {0, 2, 4}
    # within the bracket, though the struts' stiffness is 5e8 times what its rounding is judged by
    lower, upper = 5000 * np.asarray([path.events.lower, path.events.upper])
    assert (lower < exact).all() and (exact < upper).all() and (upper - lower < 0.1).all()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*unstable")  # it is, beyond the first buckling load
def test_brackets_of_a_column_hold_its_buckling_loads(newton):
    """1, 9 and 25 times Euler's load; separate analyses tell the signs at both ends."""
    n, length, ei = 20, 4.0, 2100.0
    z = np.linspace(0, length, n + 1)
    links = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    section = solid(1e-2, ei / 210e9, 210e9)
    beams = jc.Beams(links, section=section, torsional_stiffness=1e3, up=(0.0, 1.0, 0.0))
    nodes = np.column_stack([0 * z, 0 * z, z])
    structure = jc.Structure(nodes, beams, supports=in_plane(n + 1, clamped=[0]))

    def loaded(factor):
        down = -30 * factor * np.pi**2 * ei / (2 * length) ** 2
        return jc.Phase(loads=jc.NodalLoads([n], (0.0, 0.0, down)))

    path = ok(jc.trace_path(structure, loaded(1.0), method=newton))
    assert path.events.names == ["bifurcation"] * 3
    # order 4 in the element: 2e-5 of the third with 20
    assert np.allclose(30 * path.events.load_factor, [1, 9, 25], rtol=1e-4)
    for k, event in enumerate(path.events):
        assert float(event.lower) < float(event.load_factor) < float(event.upper)
        for factor, number in ((event.lower, k), (event.upper, k + 1)):
            state = jc.solve(structure, loaded(float(factor)))
            assert int(state.status) == 0
            values = np.linalg.eigvalsh(np.asarray(jc.stiffness.tangent_of(structure, state)))
            assert (values < 0).sum() == number


def pressed_ring(n, radius, share, per="current", end=2 * np.pi):
    """Rigidly joined beams with EI = 100, in plane, under ``share 3 EI / R^3`` from outside.

    A soft skin on the same nodes is what is pressed.
    """
    inertia, modulus = 100 / 2e11, 2e11
    at = end * np.arange(n if end > 6 else n + 1) / n
    nodes = radius * np.column_stack([np.cos(at), 0 * at, np.sin(at)])
    links = np.column_stack([np.arange(n), (np.arange(n) + 1) % len(at)])
    section = solid(1e5 * inertia / radius**2, inertia, modulus)
    beams = jc.Beams(links, section=section, torsional_stiffness=1e3, up=(0.0, 1.0, 0.0))
    skin = jc.Bars(links, axial_stiffness=1e-4)
    held = np.zeros((len(at), 6), bool)
    held[:, [1, 3, 5]] = True
    if end > 6:  # statically determinate: nothing of the mode is held
        held[0, [0, 2]] = held[n // 2, 2] = True
    else:  # a quarter, symmetric about its ends
        held[0, [2, 4]] = held[n, [0, 4]] = True
    parts = {"beams": beams, "skin": skin}
    structure = jc.Structure(nodes, parts, supports=jc.Supports(held))
    pressure = -share * 3 * 100 / radius**3
    load = jc.CablePressure(pressure, axis=(0.0, 1.0, 0.0), on="skin", per=per)
    return structure, jc.Phase(loads=load)


@pytest.mark.slow
@pytest.mark.parametrize("per", ["current", "unstressed"])
def test_a_ring_under_pressure_buckles_in_two_modes_at_once(per):
    """``p = 3 EI / R^3`` of an inextensible ring; of this pressure the second has no potential.

    Pressure works on the enclosed area: the polygon of 24 has that of the circle (with its nodes on
    the circle its area is 1.1 % too small, and the pressure is 1.4 % above).
    """
    radius = np.sqrt(2 * np.pi / 24 / np.sin(2 * np.pi / 24))
    structure, phase = pressed_ring(24, radius, 1.2 * radius**3, per)  # of R = 1
    path = ok(jc.trace_path(structure, phase, step=0.2, largest=0.2))
    assert path.events.names == ["bifurcation"] and int(path.events.multiplicity[0]) == 2
    assert set(np.asarray(path.n_negative).tolist()) == {0, 2}
    assert abs(1.2 * float(path.failure_load) - 1) < 5e-3
    mode = np.asarray(path.events.mode[0])[:, [0, 2]]
    at = 2 * np.pi * np.arange(24) / 24
    radial = mode[:, 0] * np.cos(at) + mode[:, 1] * np.sin(at)
    parts = np.abs(np.fft.rfft(radial))
    # two waves round the ring; supports give it a translation, one wave
    assert parts[2] > 100 * np.delete(parts, [1, 2]).max()


@pytest.mark.slow
def test_a_quarter_of_a_ring_starts_from_zero_load():
    """Without a force to be judged by it starts, and has the one mode that is symmetric."""
    radius = np.sqrt(2 * np.pi / 24 / np.sin(2 * np.pi / 24))
    structure, phase = pressed_ring(6, radius, 1.2 * radius**3, end=np.pi / 2)
    path = ok(jc.trace_path(structure, phase, step=0.2, largest=0.2))
    assert float(path.load_factor[0]) == 0 and float(path.load_factor[-1]) == 1
    assert path.events.names == ["bifurcation"] and int(path.events.multiplicity[0]) == 1
    # as the whole ring: of order 2 in the angle of 24 sides
    assert abs(1.2 * float(path.failure_load) - 1) < 5e-3


def plastic_hanger(rise, end):
    """Two bars in a V that yield and turn, loaded with twice what makes them yield."""
    stress, yielded = 235e6, 235e6 / 200e9
    law = jc.Polygonal([-end, -yielded, 0, yielded, end], np.sign(np.arange(-2, 3)) * stress)
    bars = jc.Bars([[0, 1], [1, 2]], area=1e-4, law=law)
    held = np.ones((3, 3), bool)
    held[1, 2] = False
    nodes = [[-1.0, 0.0, rise], [0.0, 0.0, 0.0], [1.0, 0.0, rise]]
    force = 2 * 1e-4 * stress
    load = jc.NodalLoads([1], (0, 0, -2 * force * rise / np.hypot(1, rise)))
    return jc.Structure(nodes, bars, jc.Supports(held)), jc.Phase(loads=load)


def test_collapse_without_limit_point_ends_with_a_reason():
    """Bars that yield and turn carry ever more, by the sine of their angle, and next to nothing.

    Steps by the first stiffness spent 200 rows on an eighth of it and told nothing.
    """
    path = jc.trace_path(*plastic_hanger(0.3, 1.0))
    assert int(path.status) == 0 and len(path.load_factor) < 60
    drop = 0.3 - np.asarray(path.displacement[:, 1, 2])
    memory = np.asarray(path.load_factor) > 0.51
    sines = drop / np.hypot(1, drop)
    expected = 0.5 * sines / (0.3 / np.hypot(1, 0.3))
    assert memory.sum() > 5
    np.testing.assert_allclose(path.load_factor[memory], expected[memory], rtol=1e-8)
    # twice the first load is beyond the sine of a right angle: no equilibrium, and no limit point
    structure, phase = plastic_hanger(1.0, 1.0)
    torn = jc.trace_path(structure, phase)
    assert int(torn.status) == status.MATERIAL_FAILURE and len(torn.load_factor) < 100
    short = jc.trace_path(structure, phase, steps=40)
    assert int(short.status) == status.EXCESSIVE_DEFORMATION
    assert "given way" in jc.describe(short.status) and np.isnan(short.failure_load)
    stiff = jc.trace_path(structure, phase, steps=4)
    assert int(stiff.status) == status.OUT_OF_POINTS  # it is elastic there
