"""The largest force along an element: catenaries by quadrature, and everywhere it is judged."""

import jax
import jax.numpy as jnp
import meshio
import numpy as np
import pytest
import scipy.optimize
from banks.shapes import pieces
from oracles.convergence import converged
from oracles.taylor import assert_gradient

import jaxcable as jc
from jaxcable.cli.solve import describe_largest_values
from jaxcable.common.tree import copy_with
from jaxcable.elements.element_state import ElementLoad
from jaxcable.mechanics.elementwise import evaluate_elements
from jaxcable.plots.element_forces import ElementForces
from jaxcable.plots.snapshots import Snapshots

EA, WEIGHT, STRENGTH = 80e6, 500.0, 1e6
NODES = np.array([[0.0, 0, 0], [200.0, 0, 300.0], [0.0, 0, 300.0]])


def guy():
    """A guy up to 300 m, beside a straight cable and a bar, all between supports."""
    parts = {
        "guy": jc.Catenaries([[0, 1]], axial_stiffness=EA, weight=WEIGHT, strength=STRENGTH),
        "mast": jc.Bars([[0, 2]], axial_stiffness=1e9, strength=2e6),
        "tie": jc.Cables([[1, 2]], axial_stiffness=1e7, weight=10.0),
    }
    return jc.Structure(NODES, parts, jc.pinned([0, 1, 2]))


HUNG = jc.Phase(
    sag={"guy": 40.0, "mast": None, "tie": None},
    pretension={"guy": None, "mast": -1e5, "tie": 2e4},
    loads=jc.SelfWeight(),
    increments=2,
)


@pytest.fixture(scope="module")
def hung():
    structure = guy()
    solution = converged(jc.solve(structure, HUNG))
    return structure, solution


def by_quadrature(length, stiffness, weight):
    """End tensions, N, low and high: places by Gauss's rule along the unstressed length."""
    points, shares = np.polynomial.legendre.leggauss(200)
    s, ds = 0.5 * length * (points + 1), 0.5 * length * shares

    def ends(force):
        v = force[1] + weight * s
        stretched = (1 + np.hypot(force[0], v) / stiffness) / np.hypot(force[0], v) * ds
        return np.array([force[0] * stretched.sum(), (v * stretched).sum()])

    found = scipy.optimize.root(lambda f: ends(f) - NODES[1, ::2], [5e4, 1e4], tol=1e-13)
    assert np.abs(ends(found.x) - NODES[1, ::2]).max() < 1e-9
    h, v = found.x
    return np.hypot(h, v), np.hypot(h, v + weight * length)


def test_a_guy_of_300_metres(hung):
    """The top has 0.29 of its strength where the mean of both ends says 0.22."""
    structure, solution = hung
    low, high = by_quadrature(float(solution.rest_length["guy"][0]), EA, WEIGHT)
    # the quadrature of 200 points and its root are good to 1e-12
    assert float(solution.peak_tension["guy"][0]) == pytest.approx(high, rel=1e-10)
    assert float(solution.tension["guy"][0]) == pytest.approx((low + high) / 2, rel=1e-10)
    used = jc.design.utilization(structure, solution)
    assert float(used["guy"][0]) == pytest.approx(high / STRENGTH, rel=1e-10)
    mean = jc.design.utilization(structure, solution.tension)["guy"][0]
    assert used["guy"][0] > 0.29 and mean < 0.22
    # the weight of the height, from the mean and the peak alone: w dz = (1 + T / EA) dT
    low, high = 2 * solution.tension["guy"][0] - high, solution.peak_tension["guy"][0]
    assert high - low + (high**2 - low**2) / (2 * EA) == pytest.approx(WEIGHT * 300, rel=1e-9)


def test_utilisation_of_all_that_has_peaks(hung):
    structure, solution = hung
    peak = solution.peak_tension
    used = jc.design.utilization(structure, peak)
    assert used["tie"] is None and float(used["mast"][0]) == pytest.approx(1e5 / 2e6, rel=1e-12)
    for given in (solution, solution.last, solution.phases[0]):
        found = jc.design.utilization(structure, given)
        assert jax.tree.all(jax.tree.map(lambda a, b: bool((a == b).all()), found, used))
    path = jc.design.utilization(structure, solution.phases[0].path)
    assert path["guy"].shape == (2, 1) and path["guy"][-1] == used["guy"]
    batch = jax.tree.map(lambda a: jnp.stack([a, a]), solution)
    assert jc.design.utilization(structure, batch)["guy"].shape == (2, 1)


def test_who_has_one_force_shares_it(hung):
    """Neither computed nor kept twice: the same arrays, and nothing of it in the program."""
    _, solution = hung
    for part in (solution, solution.last, *solution.phases, solution.phases[0].path):
        for name in ("mast", "tie"):
            assert part.peak_tension[name] is part.tension[name]
        assert part.peak_tension["guy"] is not part.tension["guy"]
    structure, phases = jc.scenes.flat_net(load=15.0)
    net = jc.solve(structure, phases)
    assert int(net.status) == 0 and net.peak_tension is net.tension
    bare = jc.Structure(NODES[:2], jc.Catenaries([[0, 1]], axial_stiffness=EA), jc.pinned([0, 1]))
    without = jc.solve(bare, jc.Phase(pretension=1e4))
    assert int(without.status) == 0 and without.peak_tension is without.tension


def test_the_larger_end_tension_differentiates():
    """By chord, stiffness, weight and unstressed length."""

    def peak(p):
        group = jc.Catenaries([[0, 1]], axial_stiffness=EA * p[1], rest_length=370.0 * p[3])
        group = copy_with(group, links=group.links.array)
        nodes = p[0] * NODES[:2]
        load = jnp.array([[0.0, 0.0, -WEIGHT]]) * p[2]
        state = copy_with(group.start(nodes[group.links]), element_load=ElementLoad(load))
        return (
            evaluate_elements("peak_tension", group, state, nodes, jnp.zeros_like(nodes))[0]
            / STRENGTH
        )

    expected = by_quadrature(370.0, EA, WEIGHT)[1] / 1e6
    assert float(peak(jnp.ones(4))) == pytest.approx(expected, rel=1e-10)
    assert_gradient(peak, np.ones(4), corrupted=1.02)


# --- where strength is judged


def test_reports_pictures_and_files_use_it(hung, tmp_path):
    structure, solution = hung
    peak, mean = (float(v["guy"][0]) for v in (solution.peak_tension, solution.tension))
    table = jc.report(structure, solution).tables["members"]
    (row,) = [row for row in table.rows if row[0] == "guy"]
    assert row[4] == row[5] == row[7] == peak and row[9] == row[10] == peak / STRENGTH
    assert "force of a catenary: the larger of the tensions at its two ends" in table.notes
    batch = jax.tree.map(lambda a: jnp.stack([a, a]), solution)
    cases = jc.report(structure, solution, cases=batch).tables["members"]
    assert [row[7] for row in cases.rows] == [row[7] for row in table.rows]

    by_use = Snapshots(solution, structure, "utilization").at_state(solution.last).forces
    by_tension = Snapshots(solution, structure).at_state(solution.last).forces
    assert by_use.value[0] == peak / STRENGTH
    assert by_tension.value[0] == mean  # colored by tension it is the mean
    told = {"tension": solution.tension}
    used = ElementForces(told, solution.last.topology.parts, structure, "utilization").value[0]
    assert used == mean / STRENGTH  # forces as they are

    final = f"final axial forces: -100000 to {peak:.6g} N"
    assert describe_largest_values(structure, solution)[1] == final

    for name in ("r.npz", "r.json"):
        jc.files.save_result(tmp_path / name, structure, solution)
        read = jc.files.load_result(tmp_path / name)
        assert read["peak_tension.guy"] == read["last.peak_tension.guy"] == peak
        assert read["phase1.peak_tension.guy"][-1] == peak and read["tension.guy"] == mean
    paths = jc.files.save_result(tmp_path / "r.csv", structure, solution)
    head, first, *_ = (line.split(",") for line in paths[1].read_text().split("\n"))
    assert float(first[head.index("peak tension (N)")]) == peak
    jc.files.save_vtk(tmp_path / "r.vtk", structure, solution)
    cells = meshio.read(tmp_path / "r.vtk").cell_data
    assert cells["peak_tension"][0].ravel()[0] == peak and cells["tension"][0].ravel()[0] == mean
    *_, last = jc.files.save_vtk(tmp_path / "s.vtk", structure, solution, increments=True)
    assert meshio.read(last).cell_data["peak_tension"][0].ravel()[0] == peak


def test_moving_pictures_and_material_use_it(hung):
    structure, solution = hung
    shots = Snapshots(solution, structure, "utilization").increments(60)
    path = solution.phases[0].path.peak_tension["guy"]
    shown = [shot.forces.value[0] for shot in shots]
    # a quotient of NumPy and one of XLA may differ by a rounding
    np.testing.assert_allclose(shown, path[:, 0] / STRENGTH, rtol=4e-16)
    by_hand = sum(
        abs(float(solution.peak_tension[name][0])) * float(solution.rest_length[name][0])
        for name in ("guy", "mast", "tie")
    )
    # floats in another order
    assert float(jc.design.material_use(solution, 1e6)) == pytest.approx(by_hand / 1e6, rel=1e-14)


@pytest.mark.parametrize("up", [1.0, -1.0], ids=["standing", "hanging"])
def test_columns_have_their_largest_force_at_the_support(up):
    """Two beams of 2 m and 300 N/m below or above 1 kN: N is -(P + w L) or P + w L at the foot."""
    nodes, links = pieces(2, 4.0 * up, (0.0, 0.0, 1.0))
    section = jc.Section.rectangle(0.2, 0.2, jc.Elastic(2e11))
    column = jc.Beams(links, section=section, weight=300.0)
    loads = [jc.SelfWeight(), jc.NodalLoads([2], [[0.0, 0.0, -1000.0]])]
    solution = jc.solve(jc.Structure(nodes, column, jc.clamped([0])), jc.Phase(loads=loads))
    assert int(solution.status) == 0
    # to the tolerance of the analysis; the supports give way by 1e-6 of a length
    expected = -up * np.array([2200.0, 1600.0])
    assert np.asarray(solution.peak_tension) == pytest.approx(expected, rel=1e-8)
