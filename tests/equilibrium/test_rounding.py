"""`path.rounding`: the residual that the rounding of displacements leaves, as it is documented."""

import json

import numpy as np
import pytest
from banks import shapes
from extensions.own_membrane import Membranes, sheet
from oracles.convergence import converged

import jaxcable as jc

EPS = 2.0**-52
EA, FORCE, LENGTH, RISE = 1e5, 1e3, 5.0, 3.0  # N, N, m, m: two links of 3-4-5 triangles
L0 = LENGTH / (1 + FORCE / EA)
SINK = np.array([0.1, 0.2, 0.3])  # m
TOL = 1e-10


def two_links(kind=jc.Cables):
    """A node between two supports, 3 m below them, that moves in the plane of the links."""
    nodes = [[-4.0, 0.0, RISE], [0.0, 0.0, 0.0], [4.0, 0.0, RISE]]
    held = np.array([[True] * 3, [False, True, False], [True] * 3])
    group = kind([[0, 1], [1, 2]], axial_stiffness=EA)
    return jc.Structure(nodes, group, supports=jc.Supports(held))


def length_and_load(sink):
    """Return the lengths of the links of a node that has sunk, m, and the load that sinks it, N."""
    length = np.hypot(4.0, RISE + sink)
    return length, 2 * EA * (length - L0) / L0 * (RISE + sink) / length


def rounding_by_hand(sink):
    """Return the documented rounding, N: 8 eps u EA/L0 along each link, in its larger component."""
    return 8 * EPS * sink * EA / L0 * 2 * np.maximum(4.0, RISE + sink) / length_and_load(sink)[0]


def solve_to_sinks(sink, kind=jc.Cables):
    """Solve a prestress that a load balances, and three loads by which the node sinks, m."""
    whole = length_and_load(np.append(0.0, sink))[1]
    first, *more = (jc.NodalLoads([1], (0.0, 0.0, -f)) for f in np.diff(whole, prepend=0.0))
    phases = [jc.Phase(pretension=FORCE, loads=first), *(jc.Phase(loads=load) for load in more)]
    return converged(jc.solve(two_links(kind), phases))


def residuals_of(path):
    """Return residual, relative residual and rounding of a path, all [n_inc]."""
    names = "residual", "relative_residual", "rounding"
    return [np.asarray(getattr(path, name)) for name in names]


@pytest.mark.parametrize(
    "kind", [jc.Cables, jc.Bars, pytest.param(jc.SlidingCables, marks=pytest.mark.slow)]
)
def test_rounding_of_two_links_is_that_of_a_formula(kind):
    solution = solve_to_sinks(SINK, kind=kind)
    # nets carry a fine part of the displacements: what is left is eps of eps of them
    fine = 1.0 if kind is jc.Bars else EPS
    begin, *ends = (float(phase.path.rounding[0]) / fine for phase in solution.phases)
    for phase in solution.phases:
        residual, relative, rounding = residuals_of(phase.path)
        assert ((relative <= TOL) | (residual <= rounding)).all()
    # nothing has moved but by the tolerance, 1e-10 of some 1e4 N, over some 1e4 N/m
    assert begin <= rounding_by_hand(1e-10)
    # the tolerance leaves 1e-10 of some 1e4 N, over some 1e4 N/m, of 0.1 m
    np.testing.assert_allclose(ends, rounding_by_hand(SINK), rtol=1e-9)
    # control: neither of another stiffness (1 % less), nor that of the other freedom
    assert (np.abs(ends / (rounding_by_hand(SINK) * L0 / LENGTH) - 1) > 5e-3).all()
    assert (ends > 1.1 * rounding_by_hand(SINK) * (RISE + SINK) / 4.0).all()


def test_a_released_structure_keeps_the_rounding_of_its_start():
    """Bars come back to the start, where the displacements are zero and have no rounding."""
    solution = solve_to_sinks(np.array([0.3, 0.15, 0.0]), kind=jc.Bars)
    assert float(solution.displacement[1, 2]) == pytest.approx(0.0, abs=1e-9)
    # the last two have that of their start, which is more than that of their end
    rounding = [float(phase.path.rounding[0]) for phase in solution.phases[2:]]
    np.testing.assert_allclose(rounding, rounding_by_hand(np.array([0.3, 0.15])), rtol=1e-9)


# --- converged means below the larger of tolerance and rounding


def tripod():
    """Bars without any force, one shortened: all that is there is rounding."""
    phase = jc.Phase(shortening=np.array([0.01, 0.0, 0.0]), increments=4)
    return shapes.tripod(stiffness=2e7).structure, [phase]


def cantilever():
    shape = shapes.cantilever(2, length=2.0, side=0.05)
    return shape.structure, [
        jc.Phase(loads=shape.load(force), increments=2) for force in (500.0, -500.0)
    ]


def hanging():
    nodes = [[0.0, 0, 0], [10.0, 0, -2.0], [20.0, 0, 0]]
    cables = jc.Catenaries([[0, 1], [1, 2]], axial_stiffness=1e7, weight=10.0, rest_length=11.0)
    structure = jc.Structure(nodes, cables, jc.pinned([0, 2]))
    loads = [jc.SelfWeight(), jc.NodalLoads([1], (0.0, 0.0, -100.0))]
    return structure, [jc.Phase(loads=loads, increments=2)]


def membrane():
    nodes, triangles = sheet(2, warp=0.06)
    rim = np.flatnonzero(((nodes[:, :2] == 0.0) | (nodes[:, :2] == 1.0)).any(axis=1))
    structure = jc.Structure(nodes, Membranes(triangles, 1e4, 0.3), jc.pinned(rim))
    inside = np.setdiff1d(np.arange(len(nodes)), rim)
    load = jc.NodalLoads(inside, (0.0, 0.0, -10.0))
    return structure, [jc.Phase(prestrain=0.05, loads=load, increments=2)]


SCENES = {
    "net": lambda: jc.scenes.flat_net(load=15.0),
    "tripod": tripod,
    "cantilever": cantilever,
    "catenaries": hanging,
    "membrane": membrane,
}
BY_ROUNDING = ("tripod", "cantilever")  # 1e-10 of their forces is not reached


@pytest.mark.quick_cases("membrane")
@pytest.mark.parametrize("name", SCENES)
def test_converged_means_below_tolerance_or_rounding(name):
    structure, phases = SCENES[name]()
    solution = converged(jc.solve(structure, phases))
    paths = [residuals_of(phase.path) for phase in solution.phases]
    residual, relative, rounding = np.concatenate(paths, axis=1)
    assert (np.isfinite(rounding) & (rounding >= 0)).all()
    assert ((relative <= TOL) | (residual <= rounding)).all()
    if name in BY_ROUNDING:  # control: of the tolerance alone it would not be true
        assert (relative > TOL).any()
    if name == "cantilever":  # rests at exactly no load, up to rounding of where it came from
        moved = (np.abs(phase.displacement).max() for phase in solution.phases)
        assert np.abs(solution.displacement).max() < 1e-11 * max(moved)
    if name == "membrane":  # its element states none
        assert (rounding == 0).all() and (residual > 0).any()
        assert "rounding" not in jc.report(structure, solution).text()


def test_rounding_of_a_failed_increment():
    """An increment that fails has that of where it ended; after it there is none."""
    structure, phases = jc.scenes.flat_net(load=15.0)
    failed = jc.solve(structure, phases, jc.Newton(max_steps=1))
    assert int(failed.status) == jc.status.NOT_CONVERGED
    residual, relative, rounding = residuals_of(failed.phases[1].path)
    assert relative[0] > TOL and residual[0] > rounding[0]  # control: no equilibrium
    assert np.isfinite(rounding[0]) and np.isnan(rounding[1:]).all() and len(rounding) == 10


# --- it goes where the residual goes


@pytest.mark.slow_cases(".npz")
@pytest.mark.parametrize("suffix", [".npz", ".json"])
def test_files_have_the_rounding_and_older_ones_are_read(suffix, tmp_path):
    solution = solve_to_sinks(SINK)
    (path,) = jc.files.save_result(tmp_path / f"r{suffix}", two_links(), solution)
    read = jc.files.load_result(path)
    for number, phase in enumerate(solution.phases, 1):
        np.testing.assert_array_equal(read[f"phase{number}.rounding"], phase.path.rounding)
    # what was written before this field was: the same without it
    older = {name: value for name, value in read.items() if not name.endswith(".rounding")}
    assert len(older) == len(read) - len(solution.phases)
    if suffix == ".npz":
        np.savez_compressed(path, **older)
    else:
        data = json.loads(path.read_text())
        path.write_text(json.dumps({k: v for k, v in data.items() if not k.endswith(".rounding")}))
    again = jc.files.load_result(path)
    assert again.keys() == older.keys()
    np.testing.assert_array_equal(again["phase2.residual"], solution.phases[1].path.residual)


def test_tables_and_reports_have_the_rounding(tmp_path):
    solution = solve_to_sinks(SINK)
    paths = jc.files.save_result(tmp_path / "r.csv", two_links(), solution)
    header, *rows = (line.split(",") for line in paths[2].read_text().splitlines())
    column = [float(row[header.index("rounding (N)")]) for row in rows]
    assert column == [float(phase.path.rounding[0]) for phase in solution.phases]
    text = jc.report(two_links(), solution).text()
    relative = [float(phase.path.relative_residual[0]) for phase in solution.phases]
    assert text.count("(limited by rounding)") == sum(value > TOL for value in relative)
