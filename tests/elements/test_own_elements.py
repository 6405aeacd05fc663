"""What is written against a contract, in test files alone, takes part in all of an analysis."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from extensions.own_elements import GroundSprings, TurningSprings
from extensions.own_laws import Maxwell, Prager
from numpy.testing import assert_allclose

import jaxcable as jc
from jaxcable.common import status
from jaxcable.elements.element import Result
from jaxcable.mechanics.assembly import System

NODES = np.array([[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]])
CABLES = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
K = np.array([[300.0, 200.0, 500.0]])


def sprung(stiffness=K, cables=CABLES):
    elements = {"net": cables, "ground": GroundSprings([[1]], stiffness)}
    return jc.Structure(NODES, elements, jc.pinned([0, 2]))


def analyse(stiffness=K, force=(20.0, 30.0, -400.0), **options):
    push = jc.NodalLoads([1], jnp.asarray(force))
    phases = [
        jc.Phase(pretension={"net": 500.0, "ground": None}),
        jc.Phase(loads=push, increments=3),
    ]
    return jc.solve(sprung(stiffness), phases, **options)


def test_a_spring_balances_what_the_cables_leave():
    """Equilibrium written out in NumPy, from lengths alone."""
    solution = analyse()
    assert solution.status == status.OK
    u = np.asarray(solution.displacement[1])
    total = np.array([20.0, 30.0, -400.0]) - K[0] * u
    for end, rest in zip(NODES[[0, 2]], np.asarray(solution.rest_length["net"]), strict=True):
        way = end - (NODES[1] + u)
        length = np.linalg.norm(way)
        total += 1e5 * (length - rest) / rest * way / length
    assert np.abs(total).max() < 1e-7  # tol 1e-10 of some 1000 N
    assert np.abs(u).max() > 0.01
    assert solution.tension["ground"] is None and solution.rest_length["ground"] is None
    assert solution.phases[1].path.tension["net"].shape == (3, 2)


def test_residual_tangent_and_energy():
    structure, solution = sprung(), analyse()
    tangent = jc.stiffness.tangent_of(structure, solution)
    bare = jc.Structure(NODES, CABLES, jc.pinned([0, 2]))
    alone = jc.solve(bare, jc.Phase(rest_length=solution.rest_length["net"]))
    group = structure.elements["ground"]
    one = jax.tree.map(lambda x: x[0], group.properties())
    spring = GroundSprings(group.links, one["stiffness"])
    u, still = solution.displacement[1:2], jnp.zeros((1, 3))
    force = jax.grad(spring.energy, argnums=2)(None, still, u)
    assert_allclose(force, spring.end_forces(None, still, u), rtol=1e-12)
    assert_allclose(spring.tangent(None, still, u).reshape(3, 3), np.diag(K[0]), rtol=1e-12)
    assert alone.status == status.OK and tangent.shape == (3, 3)
    assert_allclose(tangent, tangent.T, atol=1e-9 * np.abs(tangent).max())


def test_gradient_by_its_stiffness():
    def sag(k):
        return analyse(k).displacement[1, 2]

    there = jax.jit(jax.value_and_grad(sag))
    value, slope = there(K)
    step = 1e-2
    for axis in range(3):
        moved = np.zeros((1, 3))
        moved[0, axis] = step
        between = (there(K + moved)[0] - there(K - moved)[0]) / (2 * step)
        assert_allclose(slope[0, axis], between, rtol=1e-6, atol=1e-12)  # of order step^2
    assert abs(float(slope[0, 2])) > 1e-6
    cases = jax.vmap(sag)(np.stack([K, 2 * K]))
    assert_allclose(cases[0], value, rtol=1e-10)


def test_a_frame_stands_on_it():
    """A clamped cantilever on a spring at its tip: P = (3 EI / L^3 + k) u for a small load."""
    section = jc.Section.rectangle(0.1, 0.1, jc.Elastic(1e9))
    nodes = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    beam, spring = jc.Beams([[0, 1]], section=section), GroundSprings([[1]], [[0.0, 0.0, 4e3]])
    structure = jc.Structure(nodes, [beam, spring], jc.clamped([0]))
    solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -1.0))))
    assert solution.status == status.OK
    stiffness = 3 * 1e9 * 0.1**4 / 12 / 2**3 + 4e3
    assert_allclose(-solution.displacement[1, 2], 1 / stiffness, rtol=1e-8)  # (u / L)^2


def test_a_spring_that_turns_holds_a_beam():
    """A beam on a ball joint that springs hold, up to large rotations: M = k theta at the foot.

    A moment M on the tip bends it to a circle of curvature M / EI; the foot turns by M / k.
    """
    k, EI, L = 2e3, 1e9 * 0.1**4 / 12, 2.0
    section = jc.Section.rectangle(0.1, 0.1, jc.Elastic(1e9))
    n = 8
    nodes = np.linspace([0.0, 0.0, 0.0], [L, 0.0, 0.0], n + 1)
    beam = jc.Beams(np.stack([np.arange(n), np.arange(1, n + 1)], 1), section=section)
    elements = {"beam": beam, "foot": TurningSprings([[0]], np.array([k]))}
    structure = jc.Structure(nodes, elements, jc.pinned([0]))
    moment = 1500.0
    load = jc.NodalLoads([n], (0.0, 0.0, 0.0), moments=(0.0, 0.0, moment))
    solution = jc.solve(structure, jc.Phase(loads=load, increments=5))
    assert solution.status == status.OK
    foot, bow = moment / k, moment * L / EI
    tip = EI / moment * (1j * np.exp(1j * foot) - 1j * np.exp(1j * (foot + bow)))
    # chords of the bow: of order 2 of 0.02 rad an element
    assert_allclose(solution.positions[n, :2], [tip.real, tip.imag], rtol=1e-4)
    turn = solution.rotation[0]
    assert_allclose(2 * np.arctan2(turn[3], turn[0]), foot, rtol=1e-9)
    assert solution.tension["foot"] is None and solution.section_forces["foot"] is None


def test_files_and_pictures(tmp_path):
    structure = sprung()
    phases = [jc.Phase(pretension={"net": 500.0, "ground": None})]
    jc.save_scene(tmp_path / "own.json", (structure, phases))
    again, stated = jc.load_scene(tmp_path / "own.json")
    assert isinstance(again.elements["ground"], GroundSprings)
    found, expected = jc.solve(again, stated), jc.solve(structure, phases)
    assert found.status == status.OK
    assert (np.asarray(found.displacement) == np.asarray(expected.displacement)).all()
    figure = jc.plots.net(found, structure=structure)
    told = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "strength not stated" not in told  # nobody has asked for it
    report = jc.report(structure, found)
    assert len(report.tables["members"].rows) == 2  # springs have no axial force
    jc.files.save_result(tmp_path / "own.npz", structure, found)
    assert "tension.net" in jc.files.load_result(tmp_path / "own.npz")
    jc.files.save_result(tmp_path / "own.csv", structure, found)
    vtk = jc.files.save_vtk(tmp_path / "own.vtk", structure, found)
    assert vtk is None or vtk


# --- a law with memory

LAW = Prager(200e9, 20e9, 300e6)


def test_a_law_with_memory_by_itself():
    rng = np.random.default_rng(3)
    strain, p = rng.uniform(-6e-3, 6e-3, 50), rng.uniform(-3e-3, 3e-3, (50, 1))
    stress = LAW.stress_at(strain, p)
    slope = jax.vmap(jax.grad(LAW.energy_at))(strain, p)
    assert_allclose(slope, stress, atol=1e-6)  # of 1e9 Pa
    assert_allclose(LAW.strain_at(stress, p), strain, atol=1e-15)
    after = LAW.settle(strain, p)
    assert_allclose(LAW.stress_at(strain, after), stress, atol=1e-6)
    assert np.abs(after - p).max() > 1e-4


def test_a_law_with_memory_is_that_of_points_with_elastic_unloading():
    """One part that yields beside an elastic one: the parallel model of the same curve.

    Loaded, unloaded beyond yield and loaded again, as bars and in the fibres of a beam.
    """
    tangent = LAW.E * LAW.H / (LAW.E + LAW.H)
    first = LAW.y / LAW.E
    strain = np.array([-0.05, -first, 0.0, first, 0.05])
    end = LAW.y + tangent * (0.05 - first)
    points = jc.Polygonal(strain, np.array([-end, -LAW.y, 0.0, LAW.y, end]), "elastic")
    loads = jc.NodalLoads([1], (150e3, 0.0, -400e3))
    phases = [jc.Phase(loads=loads.scaled(f), increments=3) for f in (1.0, -1.8, 1.2)]
    found = []
    for law in (LAW, points):
        bars = jc.Bars([[0, 1], [1, 2]], area=1e-3, law=law)
        held = np.array([[True] * 3, [False, True, False], [True] * 3])
        structure = jc.Structure(NODES, bars, jc.Supports(held))
        found.append(jc.solve(structure, phases))
        assert found[-1].status == status.OK
    own, other = found
    scale = float(jnp.abs(other.displacement).max())
    assert_allclose(own.displacement, other.displacement, atol=1e-8 * scale)
    assert_allclose(own.tension, other.tension, rtol=1e-7)
    elastic = 400e3 / (2 * LAW.E * 1e-3 / 5.0 * 0.6**2)
    assert abs(float(own.phases[0].displacement[1, 2])) > 1.2 * elastic  # it has yielded


def test_fibres_of_a_law_with_memory():
    section = jc.Section.rectangle(0.05, 0.1, LAW, shape=(1, 6))
    nodes = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    structure = jc.Structure(nodes, jc.Beams([[0, 1]], section=section), jc.clamped([0]))
    push = jc.NodalLoads([1], (0.0, 0.0, -45e3))
    phases = [jc.Phase(loads=push, increments=4), jc.Phase(loads=push.scaled(-1.0))]

    @jax.jit
    @functools.partial(jax.value_and_grad, has_aux=True)
    def left(y):
        law = Prager(200e9, 20e9, y)
        own = jc.replace(structure.elements, section=jc.replace(section, laws=(law,)))
        solution = jc.solve(jc.replace(structure, elements=own), phases)
        return solution.displacement[1, 2], solution.status

    (value, code), slope = left(300e6)
    assert code == status.OK and -0.1 < value < -1e-3  # plastic strains stay
    step = 1e3
    between = (left(300e6 + step)[0][0] - left(300e6 - step)[0][0]) / (2 * step)
    assert_allclose(slope, between, rtol=1e-5)


def test_increments_of_a_law_with_memory_have_derivatives():
    """Displacements, forces and strains of a path, and not only its end, against differences."""
    held = np.array([[True] * 3, [False, True, False], [True] * 3])
    loads = jc.NodalLoads([1], (50e3, 0.0, -420e3))
    phases = [jc.Phase(loads=loads.scaled(f), increments=3) for f in (1.0, -1.6)]

    def rows(y):
        bars = jc.Bars([[0, 1], [1, 2]], area=1e-3, law=Prager(200e9, 20e9, y))
        structure = jc.Structure(NODES, bars, jc.Supports(held))
        method = jc.Newton(tol=1e-13)
        solution = jc.solve(structure, phases, method, differentiate_path=True)
        path = solution.phases[0].path
        found = jnp.stack([path.displacement[2, 1, 2], path.tension[2, 0], path.strain[2, 0]])
        return found, found

    there = jax.jit(jax.jacfwd(rows, has_aux=True))
    step = 1e3
    slopes = np.asarray(there(300e6)[0])
    between = (there(300e6 + step)[1] - there(300e6 - step)[1]) / (2 * step)
    assert_allclose(slopes, between, rtol=1e-5)
    assert (slopes != 0).all()


@pytest.mark.parametrize("kind", ["bars", "bars of two laws", "beams"])
def test_time_reaches_a_law_that_creeps(kind):
    """A strain of 1e-3 for 50 s creeps by E e t / viscosity; in an analysis no time passes yet."""
    law, links = Maxwell(1e9, 1e11), np.array([[0, 1]])
    section = jc.Section.rectangle(0.1, 0.1, law)
    other = jc.Section.rectangle(0.1, 0.1, jc.Elastic(1e9))
    both = jc.Section.composite([section, other.shifted(y=0.2)])
    group = {
        "bars": lambda: jc.Bars(links, area=1e-2, law=law),
        "bars of two laws": lambda: jc.Bars(links, section=both),
        "beams": lambda: jc.Beams(links, section=section, torsional_stiffness=1.0),
    }[kind]()
    nodes = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    state = group.start(jnp.asarray(nodes[links]))
    strain = jnp.full((1,), 1e-3)
    if kind == "beams":
        strain = jnp.zeros((1, group.points, 3)).at[..., 0].set(1e-3)
    system = System(jnp.asarray(nodes), [group], [state], None, None)
    (after,) = system.settle([strain], duration=50.0)
    crept = 50.0 * 1e9 * 1e-3 / 1e11
    for own in jax.tree.leaves(after):
        assert_allclose(own, crept, rtol=1e-13)
    (still,) = system.settle([strain])
    assert all((np.asarray(own) == 0.0).all() for own in jax.tree.leaves(still))
    held = jc.clamped([0]) if kind == "beams" else jc.Supports([[True] * 3, [False, True, True]])
    structure = jc.Structure(nodes, group, held)
    solution = jc.solve(
        structure, jc.Phase(loads=jc.NodalLoads([1], (100.0, 0.0, 0.0)), increments=2)
    )
    assert solution.status == status.OK
    expected = 100.0 * 2.0 / (1e9 * (2e-2 if "two" in kind else 1e-2))
    assert_allclose(solution.displacement[1, 0], expected, rtol=1e-4)  # first order in the strain


@pytest.mark.parametrize(
    ("result", "message"),
    [
        (Result("displacement", "m"), "'displacement' is the name of another result"),
        (Result("tension", "kN"), "'tension' has another unit, or is kept otherwise, elsewhere"),
    ],
)
def test_names_of_results_mean_one_thing(result, message):
    class Telling(GroundSprings):
        results = (result,)

    ground = object.__new__(Telling)
    for name, value in vars(GroundSprings([[1]], K)).items():
        object.__setattr__(ground, name, value)
    with pytest.raises(ValueError, match=message):
        jc.Structure(NODES, {"net": CABLES, "ground": ground}, jc.pinned([0, 2]))
