"""Results for ParaView and OpenSees."""

import functools
import os
import runpy
import subprocess
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest
import scenes
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.model.result_parts import straight_pieces

PEERS = Path(__file__).parents[2] / "experiments" / "peers"


@pytest.fixture(scope="module")
def solved():
    structure, phases = jc.scenes.flat_net(load=15.0)
    return structure, phases, converged(jc.solve(structure, phases))


# --- ParaView


def test_vtk_opens_in_another_program(solved, tmp_path):
    structure, _, solution = solved
    jc.files.save_vtk(tmp_path / "net.vtk", structure, solution)
    mesh = meshio.read(tmp_path / "net.vtk")
    np.testing.assert_array_equal(mesh.points, solution.positions)
    (block,) = mesh.cells
    assert block.type == "line"
    np.testing.assert_array_equal(block.data, structure.elements.links.array)
    np.testing.assert_array_equal(mesh.point_data["displacement"], solution.displacement)
    np.testing.assert_array_equal(mesh.point_data["reaction"], solution.reactions)
    np.testing.assert_array_equal(mesh.cell_data["tension"][0].ravel(), solution.tension)
    with pytest.raises(ValueError, match=r"ends with .vtk"):
        jc.files.save_vtk(tmp_path / "net.vtu", structure, solution)


def test_a_series_begins_where_its_analysis_began(solved, tmp_path):
    """All increments; those of an analysis that goes on; up to where a failed one got."""
    structure, phases, first = solved
    more = jc.solve(structure, phases[1:], start=first)
    failed = jc.solve(structure, phases, jc.Newton(max_steps=2))
    assert (int(more.status), int(failed.status)) == (0, 1)
    for solution in (first, more, failed):
        done = [int((np.asarray(p.path.status) == 0).sum()) for p in solution.phases]
        paths = jc.files.save_vtk(tmp_path / "net.vtk", structure, solution, increments=True)
        assert len(paths) == sum(done) and paths[-1].name == f"net-{sum(done):04}.vtk"
        last = meshio.read(paths[-1]).points
        np.testing.assert_allclose(last, solution.last.positions, atol=1e-15)  # a sum's rounding


@pytest.mark.filterwarnings("ignore::jaxcable.UnstableWarning")  # the tie is pushed sideways
def test_vtk_of_a_rope_over_pulleys_and_of_groups(tmp_path):
    """Piece by piece, as pictures show it, each with the number and the force of its rope."""
    nodes = np.array([[0.0, 0, 0], [1, 0, -1], [2, 0, 0], [1, 0, 1]])
    elements = {
        "rope": jc.SlidingCables([[0, 1, 2], [0, 3]], axial_stiffness=1e5),
        "tie é\n": jc.Bars([[1, 3]], axial_stiffness=1e5),
    }
    structure = jc.Structure(nodes, elements, jc.pinned([0, 2, 3]))
    solution = jc.solve(structure, jc.Phase(rest_length={"rope": [2.7, 1.4], "tie é\n": 2.0}))
    assert int(solution.status) == 0
    jc.files.save_vtk(tmp_path / "rope.vtk", structure, solution)
    mesh = meshio.read(tmp_path / "rope.vtk")
    assert mesh.cells[0].data.tolist() == [[0, 1], [1, 2], [0, 3], [1, 3]]
    assert mesh.cell_data["element"][0].ravel().tolist() == [0, 0, 1, 2]
    assert mesh.cell_data["group"][0].ravel().tolist() == [0, 0, 0, 1]
    force = mesh.cell_data["tension"][0].ravel()
    assert force[0] == force[1] == solution.tension["rope"][0]
    pairs, element, group = straight_pieces(solution.last.topology.parts)
    assert pairs.tolist() == mesh.cells[0].data.tolist()
    assert (element.tolist(), group.tolist()) == ([0, 0, 1, 2], [0, 0, 0, 1])
    jc.plots.net(solution, tmp_path / "rope.png")
    assert (tmp_path / "rope.png").stat().st_size > 20_000


# --- OpenSees


def tie_of_points():
    """Bars whose law of points has no compression branch, one of which is pressed."""
    law = jc.Polygonal([0.0, 0.001, 0.004, 0.02], [0.0, 1e8, 2e8, 2.5e8])
    nodes = np.array([[0.0, 0, 0], [2, 0, 0], [1, 0, 0.5], [1, 1, 0.2], [1, -1, 0.2]])
    ties = jc.Bars([[0, 2], [1, 2], [3, 2], [4, 2], [0, 3]], area=5e-6, law=law)
    structure = jc.Structure(nodes, ties, jc.pinned([0, 1, 3, 4]))
    load = jc.NodalLoads([2], (300.0, 0.0, 200.0))
    return jc.scenes.Scene(structure, [jc.Phase(pretension=50.0), jc.Phase(loads=load)])


SCENES = {
    "tie_of_points": tie_of_points,
    "flat_net": functools.partial(jc.scenes.flat_net, load=15.0),
    "hypar_net": functools.partial(jc.scenes.hypar_net, increments=(1, 1)),  # with locked jacks
    "cable_truss": scenes.cable_truss,
    "geiger_dome": scenes.geiger_dome,
    "levy_dome": scenes.levy_dome,
    "simplex": jc.scenes.simplex,
    "saddle": functools.partial(jc.scenes.saddle, 4, 4, load=30e3),  # with slack cables
    "saddle_net": functools.partial(jc.scenes.saddle_net, increments=(1, 10)),  # a law of points
    "tent_edge": scenes.tent_edge,  # with loads that follow
    "accuracy_cable": jc.scenes.accuracy_cable,
    "von_mises_truss": functools.partial(jc.scenes.von_mises_truss, load=300.0),
}


@functools.cache
def opensees():
    """Python with openseespy, or None: ``OPENSEES_PYTHON``, or this one if it has it."""
    python = os.environ.get("OPENSEES_PYTHON", sys.executable)
    probe = f"import sys; sys.path.insert(0, {str(PEERS)!r}); import opensees_cantilever as o; "
    probe += "sys.exit(o.import_opensees()[0] is None)"
    found = subprocess.run([python, "-c", probe], capture_output=True, check=False)
    return python if found.returncode == 0 else None


@pytest.mark.parametrize("name", SCENES)
def test_opensees_finds_the_same_displacements(name, tmp_path):
    if opensees() is None:
        pytest.skip("openseespy is not installed; set OPENSEES_PYTHON to a Python that has it")
    structure, phases = SCENES[name]()
    solution = converged(jc.solve(structure, phases))
    (path,) = jc.files.save_opensees(tmp_path / "net.py", structure, solution)
    out = tmp_path / "out.csv"
    start = (
        f"import sys, runpy; sys.path.insert(0, {str(PEERS)!r}); import opensees_cantilever as o; "
        f"o.import_opensees(); sys.argv = [{str(path)!r}, {str(out)!r}]; "
        f"runpy.run_path({str(path)!r}, run_name='__main__')"
    )
    done = subprocess.run([opensees(), "-c", start], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    found = np.loadtxt(out, delimiter=",", skiprows=1)
    # 1e-8 m is what is asked for; OpenSees iterates to 1e-10 m, with a quadratic last step
    assert np.abs(found - solution.displacement).max() < 1e-10
    assert float(np.abs(solution.displacement).max()) > 1e-4  # there was something to find


def test_the_script_for_opensees_holds_the_problem(solved, tmp_path, monkeypatch):
    """Forces of its curves at the displacements that were found balance its loads."""
    structure, _, solution = solved
    (path,) = jc.files.save_opensees(tmp_path / "net.py", structure, solution)
    for name in ("openseespy", "openseespy.opensees"):
        monkeypatch.setitem(sys.modules, name, type(sys)(name))
    script = runpy.run_path(str(path))
    nodes, moved = np.array(script["NODES"]), np.array(script["EXPECTED"])
    balance = np.array(script["LOADS"])
    for i, j, strain, force in script["ELEMENTS"]:
        chord, bar = nodes[j] - nodes[i], nodes[j] + moved[j] - nodes[i] - moved[i]
        length = np.linalg.norm(bar)
        pull = np.interp(length / np.linalg.norm(chord) - 1, strain, force) * bar / length
        balance[i] += pull
        balance[j] -= pull
    free = ~np.array(script["FIXED"], bool)
    # strains by subtraction of lengths: rounding of EA
    assert np.abs(balance[free]).max() < 1e-15 * 97.97e3 * 20


def test_what_opensees_cannot_do_is_refused(solved, tmp_path):
    structure, phases, solution = solved
    path = tmp_path / "net.py"
    failed = jc.solve(structure, phases, jc.Newton(max_steps=2))
    assert int(failed.status) == 1
    hanging = jc.Catenaries(structure.elements.links, axial_stiffness=97.97e3)
    for name, of, result, options, message in (
        (path, structure, failed, {}, "solution: the analysis has failed"),
        (tmp_path / "net.tcl", structure, solution, {}, r"ends with .py"),
        (path, structure, solution, {"steps": 0}, "steps = 0"),
        (path, jc.replace(structure, elements=hanging), solution, {}, "only Cables, Bars and"),
    ):
        with pytest.raises(ValueError, match=message):
            jc.files.save_opensees(name, of, result, **options)
        assert not name.exists()
