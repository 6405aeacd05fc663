"""A membrane of three-node triangles, written in a test file against the contract of elements."""

import functools
import json
import re

import ezdxf
import jax
import jax.numpy as jnp
import jsonschema
import meshio
import numpy as np
import pytest
from extensions.own_membrane import Cloth, Membranes, sheet
from matplotlib.collections import LineCollection, PolyCollection
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.testing import assert_allclose
from oracles.convergence import converged
from oracles.taylor import assert_gradient

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.common import status

ET, NU = 1e4, 0.3


def rim(nodes):
    """Nodes on the edges of the unit square."""
    return np.flatnonzero(((nodes[:, :2] == 0.0) | (nodes[:, :2] == 1.0)).any(axis=1))


def stiffness(strain):
    """Forces per width of plane stress, [xx, yy, xy], from the textbook's matrix."""
    table = ET / (1 - NU**2) * np.array([[1, NU, 0], [NU, 1, 0], [0, 0, 1 - NU]])
    return table @ np.array([strain[0, 0], strain[1, 1], strain[0, 1]])


def moved_rim(nodes, slope, prestrain=0.0):
    """The square with its rim moved by the constant gradient `slope`, solved."""
    fixed = rim(nodes)
    structure = jc.Structure(nodes, Membranes(TRIANGLES, ET, NU), jc.pinned(fixed))
    movement = jc.SupportMovement(fixed, nodes[fixed] @ np.asarray(slope).T)
    phases = [jc.Phase(prestrain=0.05), jc.Phase(prestrain=prestrain, loads=movement, increments=4)]
    return jc.solve(structure, phases)


NODES, TRIANGLES = sheet(4, warp=0.06)


def turned(solution):
    """Membrane forces along x and y of the square, [n_elem, 3], from those in each triangle."""
    first = NODES[TRIANGLES[:, 1]] - NODES[TRIANGLES[:, 0]]
    angle = np.arctan2(first[:, 1], first[:, 0])
    xx, yy, xy = np.asarray(solution.results["membrane_forces"]).T
    c, s = np.cos(angle), np.sin(angle)
    along = c**2 * xx + s**2 * yy - 2 * s * c * xy
    across = s**2 * xx + c**2 * yy + 2 * s * c * xy
    return np.stack([along, across, s * c * (xx - yy) + (c**2 - s**2) * xy], axis=1)


def test_patch():
    """A constant gradient on the rim of an uneven mesh is one everywhere, exactly, however large.

    It turns, stretches and shears.
    """
    slope = np.zeros((3, 3))
    slope[:2, :2] = [[0.2, 0.15], [-0.1, 0.3]]
    slope[2, :2] = [0.25, -0.1]
    solution = converged(moved_rim(NODES, slope))
    inside = np.setdiff1d(np.arange(len(NODES)), rim(NODES))
    assert len(inside) == 9
    expected = NODES @ slope.T
    # tol 1e-10 of forces over a stiffness of the same order
    assert_allclose(solution.displacement, expected, atol=1e-9)
    gradient = np.eye(3)[:, :2] + slope[:, :2]
    forces = stiffness(0.5 * (gradient.T @ gradient - np.eye(2)))
    assert_allclose(turned(solution), np.tile(forces, (len(TRIANGLES), 1)), rtol=1e-7)


def test_stretched_square_is_its_closed_form():
    """Pulled along x and y by 1.1 and 0.97 after a prestrain: reactions are N F on each edge."""
    stretch, prestrain = np.array([1.1, 0.97]), 0.02
    solution = converged(moved_rim(NODES, np.diag([*(stretch - 1), 0.0]), prestrain))
    strain = np.diag(0.5 * (stretch**2 - 1) + prestrain)
    force = stiffness(strain)[:2] * stretch  # of an edge of length 1, on what was its length
    reactions = np.asarray(solution.reactions)
    for axis in (0, 1):
        edge = NODES[:, axis] == 1.0
        assert_allclose(reactions[edge, axis].sum(), force[axis], rtol=1e-9)
    assert_allclose(reactions.sum(axis=0), 0.0, atol=1e-8 * np.abs(reactions).max())


def stretched(*pretensions):
    """Reactions on two edges of a square of cloth whose rim is held, [x, y], N; phase by phase."""
    nodes, triangles = sheet(3)
    half = len(triangles) // 2
    elements = {"one": Cloth(triangles[:half], ET, NU), "two": Cloth(triangles[half:], ET, NU)}
    structure = jc.Structure(nodes, elements, jc.pinned(rim(nodes)))
    solution = jc.solve(structure, [jc.Phase(pretension=given) for given in pretensions])
    sums = [
        jnp.stack([phase.reactions[nodes[:, k] == 1.0, k].sum() for k in (0, 1)])
        for phase in solution.phases
    ]
    return jnp.stack(sums), solution.status


@pytest.mark.slow
def test_a_pretension_of_two_components():
    """Warp and weft over the width of 1 m are the reactions; stated by group and by element."""
    both = np.array([300.0, 120.0])
    every = np.tile(both, (9, 1))
    found, code = stretched({"one": every, "two": every})
    assert code == status.OK
    assert_allclose(found, [both], rtol=1e-12)
    found, code = stretched(200.0, {"one": every}, {"two": jc.only(range(9), every)})
    assert code == status.OK
    assert_allclose(found[::2], [[200.0, 200.0], both], rtol=1e-12)

    def warp(value):
        return stretched({"one": every * value, "two": every * value})[0][0, 0]

    assert_allclose(jax.grad(warp)(1.0), 300.0, rtol=1e-12)


def test_files_and_commands_know_components(tmp_path, capsys):
    nodes, triangles = sheet(1)
    structure = jc.Structure(nodes, {"cloth": Cloth(triangles, ET, NU)}, jc.pinned(range(4)))
    stated = np.array([[300.0, 120.0], [280.0, 120.0]])
    path = tmp_path / "cloth.json"
    jc.save_scene(path, (structure, [jc.Phase(pretension={"cloth": stated})]))
    read, phases = jc.load_scene(path)
    assert_allclose(phases[0].inputs(read)[0]["pretension"].values, stated, rtol=0)
    jsonschema.validate(json.loads(path.read_text()), jc.files.scene_schema())
    main(["info", str(path)])
    assert "pretension 120 to 300 N" in capsys.readouterr().out


def roof():
    """A warped square between edge cables, four corners held, under weight on the free nodes."""
    nodes, triangles = sheet(4)
    nodes[:, 2] = 0.3 * (2 * nodes[:, 0] - 1) * (2 * nodes[:, 1] - 1)
    n = np.arange(25).reshape(5, 5)
    edges = [n[0], n[-1], n[:, 0], n[:, -1]]
    links = np.concatenate([np.stack([edge[:-1], edge[1:]], axis=1) for edge in edges])
    elements = {
        "sheet": Membranes(triangles, ET, NU),
        "edges": jc.Cables(links, axial_stiffness=1e5),
    }
    corners = [0, 4, 20, 24]
    free = np.setdiff1d(np.arange(25), corners)
    load = jc.NodalLoads(free, np.tile([0.0, 0.0, -3.0], (len(free), 1)))
    return jc.Structure(nodes, elements, jc.pinned(corners)), load


def hung(prestrain=0.01, load=1.0):
    """Prestress of cloth and edges (a scalar is that of all that can have it), then load."""
    structure, weight = roof()
    phases = [
        jc.Phase(pretension=400.0, prestrain={"sheet": prestrain, "edges": None}),
        jc.Phase(loads=weight.scaled(load), increments=3),
    ]
    return structure, phases, jc.solve(structure, phases)


once = functools.cache(hung)


@pytest.mark.slow
def test_gradient_by_prestrain_and_load():
    def sag(p):
        solution = hung(0.01 * p[0], p[1])[2]
        return solution.displacement[12, 2], solution.status

    assert_gradient(sag, np.ones(2), 25.0)


def test_files_pictures_and_reports(tmp_path):
    structure, phases, solution = once()
    assert list(solution.element_results) == ["tension", "peak_tension", "membrane_forces"]
    jc.save_scene(tmp_path / "roof.json", (structure, phases))
    again = converged(jc.solve(*jc.load_scene(tmp_path / "roof.json")))
    told = np.asarray(solution.results["membrane_forces"]["sheet"])
    assert (np.asarray(again.results["membrane_forces"]["sheet"]) == told).all()
    for name in ("roof.npz", "result.json"):
        jc.files.save_result(tmp_path / name, structure, solution)
        read = jc.files.load_result(tmp_path / name)
        assert (read["membrane_forces.sheet"] == told).all()
        assert read["phase2.membrane_forces.sheet"].shape == (3, 32, 3)
    jc.files.save_result(tmp_path / "roof.csv", structure, solution)
    head, first, *_ = (tmp_path / "roof-elements.csv").read_text().splitlines()
    assert head.endswith(
        "membrane forces xx (N/m),membrane forces yy (N/m),membrane forces xy (N/m)"
    )
    assert first.startswith("edges,0,")
    jc.files.save_vtk(tmp_path / "roof.vtk", structure, solution)
    lines = (tmp_path / "roof.vtk").read_text()
    assert "SCALARS membrane_forces_xy double 1" in lines
    assert f"CELLS {16 + 32} " in lines
    table = jc.report(structure, solution).tables["membrane_forces"]
    assert {"xx", "yy", "xy", "lowest xx"} < {*table.columns} and len(table.rows) == 32
    row = dict(zip(table.columns, table.rows[5], strict=True))
    assert [row[name] for name in ("xx", "yy", "xy")] == told[5].tolist()
    figure = jc.plots.net(solution, structure=structure, color="membrane_forces yy")
    texts = [axes.get_xlabel() for axes in figure.axes]
    assert "membrane forces yy (N/m)" in texts
    figure = jc.plots.net(moved_rim(NODES, np.diag([0.1, 0.0, 0.0])))  # of a sheet alone
    assert "membrane forces xx (N/m)" in [axes.get_xlabel() for axes in figure.axes]
    with pytest.raises(ValueError, match='expected one of "tension", "peak_tension", "membrane'):
        jc.plots.net(solution, color="membrane_forces zz")


def test_faces_in_files(tmp_path):
    """Lines of cables and faces of triangles, which other programs read."""
    structure, _, solution = once()
    jc.files.save_vtk(tmp_path / "roof.vtk", structure, solution)
    mesh = meshio.read(tmp_path / "roof.vtk")
    cells = {block.type: block.data for block in mesh.cells}
    assert (cells["triangle"] == structure.elements["sheet"].links.array).all()
    assert (cells["line"] == structure.elements["edges"].links.array).all()
    told = np.asarray(solution.results["membrane_forces"]["sheet"])
    assert (mesh.cell_data["membrane_forces_yy"][1].ravel() == told[:, 1]).all()
    jc.files.save_dxf(tmp_path / "roof.dxf", structure, solution)
    drawn = ezdxf.readfile(tmp_path / "roof.dxf").modelspace().query('3DFACE[layer=="sheet"]')
    corners = np.array([[*face.wcs_vertices()] for face in drawn])
    assert_allclose(corners[:, :3], np.asarray(solution.positions)[cells["triangle"]], rtol=1e-14)
    with pytest.warns(jc.common.checks.InputWarning, match="3DFACE .32., layer 'sheet'"):
        assert len(jc.files.read_dxf(tmp_path / "roof.dxf").links) == 16


@pytest.mark.slow
def test_faces_in_pictures():
    """Filled with their result; what is absent is not drawn; edge cables stay above the faces."""
    structure, phases, solution = once()
    color = "membrane_forces xx"
    plan = jc.plots.net(solution, structure=structure, color=color, view="plan").axes[0]
    (drawn,) = (kind for kind in plan.collections if isinstance(kind, PolyCollection))
    triangles = structure.elements["sheet"].links.array
    places = np.asarray(solution.phases[0].positions)[triangles][..., :2]
    assert_allclose([path.vertices[:3] for path in drawn.get_paths()], places, rtol=1e-14)
    told = solution.phases[0].path.results["membrane_forces"]["sheet"][-1, :, 0]
    assert_allclose(drawn.get_array(), told, rtol=1e-14)
    lines = [kind for kind in plan.collections if isinstance(kind, LineCollection)]
    assert max(len(kind.get_segments()) for kind in lines if kind.zorder > 1) == 16
    assert all(kind.zorder > drawn.zorder for kind in lines if len(kind.get_segments()) == 16)
    gone = jc.Phase(removes={"sheet": jc.only([2, 5]), "edges": None})
    fewer = converged(jc.solve(structure, [*phases, gone]))
    space = jc.plots.net(fewer, structure=structure, color=color).axes[1]
    (drawn,) = (kind for kind in space.collections if isinstance(kind, Poly3DCollection))
    assert len(drawn.get_array()) == 30
    page = jc.plots.view(solution, None, structure=structure)
    told = json.loads(re.search(r'id="data">(.*?)</script>', page.html, re.S)[1])
    assert told["arrays"]["triangles"][2] == [32, 3] and told["arrays"]["face"][2] == [32]


def test_areas_in_reports_and_info(tmp_path, capsys):
    structure, phase = taut(4, weight=2 * 9.80665)
    solution = converged(jc.solve(structure, [phase, jc.Phase(removes=jc.only([0, 1]))]))
    (row,) = jc.report(structure, solution).tables["surfaces"].rows
    assert row[:2] == ["", 30]
    a, b, c = np.asarray(solution.positions)[structure.elements.links.array[2:]].swapaxes(0, 1)
    area = 0.5 * np.cross(b - a, c - a)[:, 2].sum()  # beside the hole they have become smaller
    assert_allclose(row[2:], [30 / 32, area, 2 * 9.80665 * 30 / 32, 2.0], rtol=1e-12)
    path = tmp_path / "drum.json"
    jc.save_scene(path, (structure, [phase]))
    main(["info", str(path)])
    told = capsys.readouterr().out
    assert "Membranes: 32 elements, areas 0.03125 m2, 1 m2 in total" in told
    assert "weighs 19.6133 N in total, 2 kg/m2" in told


def taut(n, weight=9.80665):
    """A flat unit square of n x n, prestressed to 100 N/m, that weighs 1 kg/m2."""
    nodes, triangles = sheet(n)
    group = Membranes(triangles, ET, 0.0, weight)
    return jc.Structure(nodes, group, jc.pinned(rim(nodes))), jc.Phase(prestrain=0.01)


def test_its_weight_acts_and_swings():
    """A drum: f = sqrt(2 N / m) / 2 a; and of second order in the size of the elements."""
    exact, errors = np.sqrt(2 * 100.0) / 2, []
    for n in (4, 8):
        structure, phase = taut(n)
        flat, hung = (
            jc.solve(structure, [phase, jc.Phase(loads=jc.SelfWeight((0.0, 0.0, g)))])
            for g in (0.0, -1.0)
        )
        assert flat.status == hung.status == status.OK
        assert_allclose(hung.reactions[:, 2].sum(), 9.80665, rtol=1e-9)
        assert hung.displacement[:, 2].min() < -1e-3
        found = jc.dynamics.modes(structure, flat, 1)
        errors.append(abs(float(found.frequency[0]) / exact - 1))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)
