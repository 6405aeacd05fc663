"""What is written against a contract, in test files alone, takes part in all of an analysis."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from extensions.own_elements import GroundSprings
from extensions.own_laws import Maxwell, Prager
from extensions.own_links import Brittle, Dampers, Hooks, Lying, Series, Thrusters
from numpy.testing import assert_allclose
from oracles.convergence import converged
from oracles.traced import traced

import jaxcable as jc
from jaxcable.common import memory_limit, status
from jaxcable.mechanics.assembly import System

NODES = np.array([[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0], [0.0, 4.0, 3.0]])
LINKS = [[0, 1], [1, 2], [1, 3]]
K, LOAD = np.array([[300.0, 200.0, 500.0]]), np.array([3.0, 5.0, -40.0])
LOADS = [
    jc.NodalLoads([1], LOAD),
    jc.LineLoads((0.0, 0.0, -2.0), on="rods"),
    jc.SelfWeight(),
]
PHASES = [
    jc.Phase(pretension={"net": 500.0, "ground": None}),
    jc.Phase(loads=LOADS, increments=4),
]


def mixed():
    """Cables, a spring to the ground, hooks that are slack and a rod, which meet in node 1."""
    elements = {
        "net": jc.Cables(LINKS, axial_stiffness=1e5),
        "ground": GroundSprings([[1]], K),
        "hooks": Hooks([[0, 1], [2, 1]], 1e3, 0.5),
        "rods": Brittle([[3, 1]], 1e3, 5.0),
    }
    return jc.Structure(NODES, elements, jc.pinned([0, 2, 3]))


@functools.cache
def own():
    return mixed(), jc.solve(mixed(), PHASES)


@pytest.mark.slow
def test_own_elements_balance_what_the_cables_leave():
    """Equilibrium written out in NumPy, from lengths alone."""
    solution = own()[1]
    assert solution.status == status.OK
    u = np.asarray(solution.displacement[1])
    along = [0.0, 0.0, -0.5 * (2.0 + 5.0) * 5.0]  # half of line load and weight of the rod
    assert_allclose(solution.load[1], LOAD + along, rtol=1e-12)
    total = LOAD + along - K[0] * u
    for k, rest in enumerate(np.asarray(solution.rest_length["net"])):
        way = NODES[[0, 2, 3][k]] - NODES[1] - u
        length = np.linalg.norm(way)
        force = max(0.0, 1e5 * (length - rest) / rest) + (k == 2) * 1e3 * (length / 5 - 1)
        total += force * way / length
    assert np.abs(total).max() < 1e-7  # tol 1e-10 of some 1000 N
    assert np.abs(u).max() > 1e-3
    assert solution.tension["ground"] is None and solution.rest_length["ground"] is None
    assert (np.asarray(solution.tension["hooks"]) == 0).all()
    assert solution.phases[1].path.tension["net"].shape == (4, 3)


def test_own_elements_in_every_result(tmp_path):
    structure, solution = own()
    told = jc.forms.equivalent_prestress(structure, solution)
    assert np.isnan(told.rest_length["hooks"]).all() and np.isnan(told.pretension["rods"]).all()
    assert_allclose(told.rest_length["rods"], 5.0)  # a 3-4-5 triangle
    assert_allclose(told.pretension["net"], solution.tension["net"], rtol=1e-10)
    assert jc.fibre_stress(structure, solution.phases[1])["rods"] is None
    report = jc.report(structure, solution, names=["prestress", "wind"])
    assert "phase 2, wind: 4 of 4 increments converged" in str(report)
    cells = [str(cell) for table in report.tables.values() for row in table.rows for cell in row]
    assert not [cell for cell in cells if cell.startswith("phase")]  # by their names in all tables
    assert len(report.tables["members"].rows) == 6  # springs have no axial force
    relative = jc.energy_balance(structure, PHASES, solution).relative_imbalance
    assert_allclose(relative[1], 0.0, atol=0.02)  # increments^2
    jc.files.save_result(tmp_path / "own.npz", structure, solution)
    assert "tension.hooks" in jc.files.load_result(tmp_path / "own.npz")
    jc.files.save_result(tmp_path / "own.csv", structure, solution)
    jc.files.save_vtk(tmp_path / "own.vtk", structure, solution)
    figure = jc.plots.net(solution, structure=structure, phase=0)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "strength not stated" not in texts  # nobody has asked for it
    jc.save_scene(tmp_path / "own.json", (structure, PHASES))
    again, phases = jc.load_scene(tmp_path / "own.json")
    assert isinstance(again.elements["ground"], GroundSprings)
    found = converged(jc.solve(again, phases))
    assert (np.asarray(found.displacement) == np.asarray(solution.displacement)).all()


def test_what_cannot_be_said_of_their_state_is_refused_by_name():
    """What needs no state is in `tests/analysis/test_refused.py`."""
    structure, solution = own()
    plain = jc.replace(structure, elements={k: structure.elements[k] for k in ("net", "hooks")})
    with pytest.raises(ValueError, match=r"'hooks'\] \(Hooks\) has no strain along an axis \(abil"):
        jc.design.slack_distance(plain, solution)
    with pytest.raises(ValueError, match=r"'hooks'\] \(Hooks\) has slack elements, whose unst"):
        jc.stiffness.buckling_factor(structure, solution)


@pytest.mark.slow
def test_paths_of_own_elements_to_their_failure():
    """A rod breaks at a strain of 1 %, at 1 % of EA; a slack hook takes part from 5 mm on."""
    nodes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    elements = {"rod": Brittle([[0, 1]], 1e3), "hook": Hooks([[0, 1]], 1e3, 0.005)}
    structure = jc.Structure(nodes, elements, jc.pinned([0]) + jc.restrained([1], "xy"))
    load = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -20.0)))
    path = jc.trace_path(structure, load, step=0.2)
    assert path.status == status.MATERIAL_FAILURE
    assert path.events.names == ["tightening", "material failure"]
    # 5 N at 5 mm; 10 N and 5 N at 10 mm
    assert_allclose(path.events.load_factor, [5.0 / 20.0, 15.0 / 20.0], atol=1e-4)


# --- unsymmetric elements

PUSH, D = 10.0, 2.0


def thrown(thrust, kind=Thrusters, **options):
    """Position of the end of a thruster, which stands on x, in the plane."""
    nodes = np.array([[0.0, 0.0, 0.0], [D, 0.0, 0.0]])
    elements = {"push": kind([[0, 1]], PUSH, thrust)}
    structure = jc.Structure(nodes, elements, jc.pinned([0]) + jc.restrained([1], "z"))
    return structure, jc.solve(structure, jc.Phase(increments=3), **options)


def exact(thrust):
    size = np.sqrt(D**2 - (thrust / PUSH) ** 2)
    z = PUSH * D / (PUSH - 1j * thrust / size)
    return np.array([z.real, z.imag])


@pytest.mark.slow
@pytest.mark.parametrize("solver", [pytest.param(None, marks=pytest.mark.slow), "superlu"])
def test_a_follower_force_of_an_element(solver):
    """Against its closed form; derivatives forward, backward and by differences agree.

    A tangent that is taken as symmetric gives another adjoint: the control.
    """
    method, h = jc.Newton(linear_solver=solver), 1e-4
    structure, solution = thrown(7.0, method=method)
    assert solution.status == status.OK and solution.stable
    assert_allclose(solution.positions[1, :2], exact(7.0), rtol=1e-10)
    tangent = jc.stiffness.tangent_stiffness(structure, solution)
    assert np.abs(tangent - tangent.T).max() > 1.0

    def end(p, kind=Thrusters):
        return thrown(p, kind, method=method)[1].positions[1, :2]

    _, forward = jax.jvp(end, (7.0,), (1.0,))
    backward = jnp.stack([jax.vjp(end, 7.0)[1](row)[0] for row in jnp.eye(2)])
    slope = (exact(7.0 + h) - exact(7.0 - h)) / (2 * h)  # of order h^2
    assert_allclose(forward, slope, rtol=1e-7)
    assert_allclose(backward, forward, rtol=1e-10)
    if solver is None:
        wrong = jax.grad(lambda p: end(p, Lying)[0])(7.0)
        assert abs(wrong - slope[0]) > 1e-3


def test_flexibility_of_an_unsymmetric_tangent():
    structure, solution = thrown(3.0)
    given = jc.stiffness.flexibility(structure, solution, [1], "xy")
    tangent = np.asarray(jc.stiffness.tangent_stiffness(structure, solution))
    assert_allclose(given, np.linalg.inv(tangent), rtol=1e-10)


# --- laws with memory


def two_bars(law):
    """Two bars in a plane, which meet in a node that is free in it."""
    bars = jc.Bars([[0, 1], [1, 2]], area=1e-3, law=law)
    held = np.array([[True] * 3, [False, True, False], [True] * 3])
    return jc.Structure(NODES[:3], bars, jc.Supports(held))


def loaded(force, factors):
    loads = jc.NodalLoads([1], force)
    return [jc.Phase(loads=loads.scaled(f), increments=3) for f in factors]


def test_increments_of_a_law_with_memory_have_derivatives():
    """Displacements, forces and strains of a path, and not only its end, against differences."""
    phases, method = loaded((50e3, 0.0, -420e3), (1.0, -1.6)), jc.Newton(tol=1e-13)

    def rows(y):
        law = Prager(200e9, 20e9, y)
        solution = jc.solve(two_bars(law), phases, method, differentiate_path=True)
        path = solution.phases[0].path
        found = jnp.stack([path.displacement[2, 1, 2], path.tension[2, 0], path.strain[2, 0]])
        return found, (found, solution.status)

    there = traced(jax.jacfwd(rows, has_aux=True))
    step = 1e3
    slopes, (_, code) = there(300e6)
    assert code == status.OK
    between = (there(300e6 + step)[1][0] - there(300e6 - step)[1][0]) / (2 * step)
    assert_allclose(slopes, between, rtol=1e-5)
    assert (np.asarray(slopes) != 0).all()


@pytest.mark.slow
def test_inner_unknowns_without_rotations():
    """Two springs one behind the other, by their statics and the derivative of them."""

    def analysed(first):
        structure = jc.Structure(
            [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]],
            Series([[0, 1]], first, 500.0),
            jc.pinned([0]) + jc.restrained([1], "yz"),
        )
        load = jc.NodalLoads([1], (10.0, 0.0, 0.0))
        solution = jc.solve(structure, jc.Phase(loads=load, increments=2))
        return solution.displacement[1, 0], (solution.status, solution.tension)

    rate, (code, tension) = jax.grad(analysed, has_aux=True)(300.0)
    assert code == status.OK
    # residuals are up to 1e-10 of the force
    assert_allclose(tension, 10.0, rtol=1e-9)
    assert_allclose(analysed(300.0)[0], 10.0 / 300.0 + 10.0 / 500.0, rtol=1e-9)
    assert_allclose(rate, -10.0 / 300.0**2, rtol=1e-9)


@pytest.mark.slow_cases("increments")
@pytest.mark.parametrize("method", [jc.Newton(), jc.Incremental()], ids=["newton", "increments"])
def test_a_memory_of_where_an_element_was(method):
    """A damper beside a spring: ``(k + c) u = load + c u_before`` in every increment."""
    increments = (4, 3)

    def analysed(damping):
        elements = {"ground": GroundSprings([[1]], K), "damper": Dampers([[0, 1]], damping)}
        structure = jc.Structure(NODES[:2], elements, jc.pinned([0]))
        phases = [
            jc.Phase(loads=jc.NodalLoads([1], LOAD), increments=increments[0]),
            jc.Phase(increments=increments[1]),
        ]
        solution = jc.solve(structure, phases, method)
        return solution.displacement[1], (solution.phases, solution.status)

    def followed(damping):
        moved = [np.zeros(3)]
        for factor in (*np.arange(1, 1 + increments[0]) / increments[0], *increments[1] * (1.0,)):
            moved.append((factor * LOAD + damping * moved[-1]) / (K[0] + damping))
        return np.array(moved[1:])

    moved, (phases, code) = analysed(150.0)
    assert code == status.OK
    first, second = followed(150.0)[:4], followed(150.0)[4:]
    # residuals are up to 1e-10 of the forces, which every increment hands on
    assert_allclose(phases[0].path.displacement[:, 1], first, rtol=1e-9)
    assert_allclose(phases[1].path.displacement_in_phase[:, 1], second - first[-1], rtol=1e-8)
    assert_allclose(moved, second[-1], rtol=1e-9)
    slope = jax.jacfwd(analysed, has_aux=True)(150.0)[0]
    step = 1e-3  # of order step^2
    between = (followed(150.0 + step)[-1] - followed(150.0 - step)[-1]) / (2 * step)
    assert_allclose(slope, between, rtol=1e-6)
    assert np.abs(first[0] - LOAD / 4 / K[0]).min() > 1e-4  # without damper


@pytest.mark.slow
def test_time_reaches_a_law_that_creeps():
    """A strain of 1e-3 for 50 s creeps by E e t / viscosity; in an analysis no time passes yet."""
    law, links = Maxwell(1e9, 1e11), np.array([[0, 1]])
    section = jc.Section.rectangle(0.1, 0.1, law)
    beside = jc.Section.rectangle(0.1, 0.1, jc.Elastic(1e9)).shifted(y=0.2)
    both = jc.Section.composite([section, beside])
    nodes = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    groups = {
        "bars": jc.Bars(links, area=1e-2, law=law),
        "bars of two laws": jc.Bars(links, section=both),
        "beams": jc.Beams(links, section=section, torsional_stiffness=1.0),
    }
    for kind, group in groups.items():
        state, strain = group.start(jnp.asarray(nodes[links])), jnp.full((1,), 1e-3)
        if kind == "beams":
            strain = jnp.zeros((1, group.points, 3)).at[..., 0].set(1e-3)
        system = System(jnp.asarray(nodes), [group], [state], None, None)
        (after,), (still,) = (system.commit_memory(None, [strain], t) for t in (50.0, 0.0))
        for crept, kept in zip(jax.tree.leaves(after), jax.tree.leaves(still), strict=True):
            assert_allclose(crept, 50.0 * 1e9 * 1e-3 / 1e11, rtol=1e-13)
            assert (np.asarray(kept) == 0.0).all()
    structure = jc.Structure(
        nodes, groups["bars of two laws"], jc.Supports([[True] * 3, [False, True, True]])
    )
    load = jc.NodalLoads([1], (100.0, 0.0, 0.0))
    solution = converged(jc.solve(structure, jc.Phase(loads=load, increments=2)))
    # first order in the strain
    assert_allclose(solution.displacement[1, 0], 100.0 * 2.0 / (1e9 * 2e-2), rtol=1e-4)


# --- moments without a potential, memory, warnings


def test_dense_matrices_that_do_not_fit_are_refused(monkeypatch):
    assert 2**20 < memory_limit.available_bytes() < 2**50
    memory_limit.require_memory(1.0, "nothing", "")
    structure, phases = jc.scenes.flat_net()
    solution = jc.solve(structure, phases)
    monkeypatch.setattr(memory_limit, "available_bytes", lambda: 2000)
    monkeypatch.setattr(memory_limit, "_NEVER_REFUSED", 0)  # the net of this test is small
    for call in (
        jc.stiffness.tangent_stiffness,
        jc.stiffness.modes,
        jc.stiffness.buckling_factor,
        lambda *at: jc.dynamics.modes(*at, masses=1.0),
        lambda *at: jc.stiffness.flexibility(*at, [3]),
        lambda *at: jc.forms.self_stress(structure),
        lambda *at: jc.influence(structure, phases, of="displacement", wrt="load"),
        lambda *at: jc.solve(structure, phases, jc.Newton(linear_solver="dense", max_steps=99)),
    ):
        with pytest.raises(
            ValueError, match=r"needs about .* MiB of .*, and 0.00191 MiB are left; "
        ):
            call(structure, solution)
