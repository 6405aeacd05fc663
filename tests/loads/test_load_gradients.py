"""Derivatives by the numbers of all kinds of loads: Taylor's test, one step of all of them.

A pyramid of cables with dead loads, pressures, ice and a mass; a mast of bars between catenaries in
wind and ice; beams with loads between their nodes; a membrane, some of whose elements are removed.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import SPOKES
from extensions.own_membrane import Membranes, sheet
from oracles.taylor import TIGHT, assert_gradient, joined

import jaxcable as jc


def net(p):
    """Tangents are unsymmetric: the adjoint solves with the transposed matrix."""
    own = {"axial_stiffness": 1e4, "weight": 20.0}
    rest, force, pressure = p["unstressed length"], p["forces"], p["pressure of cables"]
    elements = {
        "front": jc.Cables(SPOKES[:2], rest_length=rest[:2], **own),
        "back": jc.Cables(SPOKES[2:], rest_length=rest[2:], **own),
    }
    faces = [[k, (k + 1) % 4, 4] for k in range(4)]
    cases = [
        jc.SelfWeight(),
        jc.LineLoads(force, on="back"),
        jc.LineLoads(force, per="projected"),
        jc.LineLoads(force, per="initial"),
        jc.AreaLoads(faces, force),
        jc.FacePressure(faces, p["pressure of faces"]),
        jc.AreaLoads(faces, force, per="initial"),
        jc.CablePressure(pressure, p["axis"], on="front"),
        jc.CablePressure(pressure, p["axis"], on="back", per="unstressed"),
        jc.IceLoads(p["thickness"], p["diameter"], p["density"], gravity=p["gravity"]),
        jc.PointMasses([4], p["masses"], gravity=p["gravity"]),
    ]
    phase = jc.Phase(loads=jc.combine(cases, p["factors"]))
    structure = jc.Structure(p["nodes"], elements, jc.pinned([0, 1, 2, 3]))
    solution = jc.solve(structure, phase, TIGHT)
    # a slack cable has no logarithm of its tension
    logarithms = sum(jnp.sum(jnp.log(t)) for t in solution.tension.values())
    place = jnp.sum(jnp.array([0.5, 1.0, 2.0]) * solution.positions[4])
    return place + logarithms, solution.status


def mast(p):
    elements = {
        "mast": jc.Bars([[0, 1]], axial_stiffness=1e8),
        "guys": jc.Catenaries([[k, 1] for k in range(2, 6)], axial_stiffness=5e6, weight=8.0),
    }
    structure = jc.Structure(p["nodes"], elements, jc.pinned([0, 2, 3, 4, 5]))
    lowest = 2.0 + 0 * p["roughness"]
    law = jc.EurocodeWind(p["velocity"], roughness_length=p["roughness"], lowest_height=lowest)
    more = {"ice": p["thickness"], "factor": p["factor"], "ground": p["ground"]}
    size = p["drag"], p["diameter"]
    loads = [
        jc.WindLoads(p["direction"], law, *size, on="guys", geometry="begun", **more),
        jc.WindLoads(p["direction"], law, 1.2, 0.3, on="mast", ground=p["ground"]),
        jc.IceLoads(p["thickness"], p["diameter"], on="guys"),
    ]
    tightened = jc.Phase(sag={"mast": None, "guys": 0.2}, loads=jc.SelfWeight())
    solution = jc.solve(structure, [tightened, jc.Phase(loads=loads)], TIGHT)
    return 1e3 * solution.displacement[1] @ jnp.array([1.0, 0.3, 0.2]), solution.status


def frame(p):
    """By two places, a force, factors of a line load and pressures."""
    beams = jc.Beams([[0, 1], [1, 2]], jc.Section.rectangle(0.05, 0.1, jc.Elastic(210e9)))
    nodes, supports = [[0.0, 0, 0], [2.0, 0, 0.5], [4.0, 0.3, 0]], jc.clamped([0]) + jc.pinned([2])
    loads = [
        jc.PointLoads([0, 1], p["places"], 2e5 * p["force"], (0.0, 1e4, 0.0)),
        jc.LineLoads((0.0, 1e4, -2e4), factor=p["factor"]),
        jc.CablePressure(p["pressure"], (0.0, -1.0, 0.0)),
    ]
    structure = jc.Structure(nodes, beams, supports)
    solution = jc.solve(structure, jc.Phase(loads=loads), TIGHT)
    return 1e2 * solution.displacement[1, 2], solution.status


SHEET, TRIANGLES = sheet(4, warp=0.06)
RIM = np.flatnonzero(((SHEET[:, :2] == 0.0) | (SHEET[:, :2] == 1.0)).any(axis=1))


def membrane(p):
    """Displacement of the middle; what removed elements bear has no influence."""
    elements = {
        "one": Membranes(TRIANGLES[:16], 1e4, 0.3),
        "two": Membranes(TRIANGLES[16:], 1e4, 0.3),
    }
    height = 0.1 * p["height"] * SHEET[:, 0] * (1 - SHEET[:, 1])
    nodes = jnp.asarray(SHEET).at[:, 2].add(height)
    loads = [
        jc.FacePressure(pressure=p["pressure"], on="one"),
        jc.AreaLoads(forces=p["forces"], on="two", geometry="begun"),
    ]
    first = jc.Phase(prestrain=0.01, removes={"one": jc.only([3, 4]), "two": jc.only([5])})
    structure = jc.Structure(nodes, elements, jc.pinned(RIM))
    solution = jc.solve(structure, [first, jc.Phase(loads=loads)], TIGHT)
    return solution.displacement[12, 2], solution.status


ANCHORS = [[15.0, 0, 0], [0, 15.0, 0], [-15.0, 0, 0], [0, -15.0, 0]]
RNG = np.random.default_rng(1)
# function, numbers, sizes of the steps at which remainders are far above rounding
CASES = {
    "net": (
        net,
        {
            "nodes": [[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0.1, 0.05, 0.5]],
            "unstressed length": [1.04, 1.05, 1.05, 1.06],
            **{"forces": [5.0, 10.0, -40.0], "axis": [0.1, -1.0, 0.05], "factors": np.ones(11)},
            **{"pressure of faces": [100.0, 200.0, 300.0, 250.0], "masses": 2.0, "gravity": 9.8},
            **{"pressure of cables": [100.0, 80.0], "thickness": 0.01, "diameter": 0.02},
            "density": 700.0,
        },
        {"nodes": 1.0, "unstressed length": 1.0},
    ),
    "mast": (
        mast,
        {
            **{"direction": [1.0, 0.4, 0.1], "velocity": 25.0, "roughness": 0.05, "ground": -3.0},
            **{"thickness": [0.02, 0.03, 0.02, 0.01], "diameter": [0.02, 0.022, 0.024, 0.02]},
            **{"drag": [1.2, 1.1, 1.2, 1.0], "factor": [1.0, 1.5, 1.0, 1.0]},
            "nodes": [[0.0, 0, 0], [0, 0, 20.0], *ANCHORS],
        },
        {"nodes": 0.1, "roughness": 20.0, "ground": 50.0},
    ),
    "frame": (
        frame,
        {
            **{"places": [0.3, 0.6], "force": [0.2, 0.1, -0.5], "factor": [1.0, 0.4]},
            "pressure": [2e4, 1e4],
        },
        {},
    ),
    "membrane": (
        membrane,
        {
            "pressure": RNG.uniform(40.0, 90.0, 16),
            **{"forces": RNG.uniform(-9.0, 9.0, (16, 3)), "height": 1.0},
        },
        {"pressure": 25.0, "forces": 25.0, "height": 25.0},
    ),
}
STEPS = {"net": 50.0, "mast": 10.0, "frame": 1.0, "membrane": 25.0}  # where no other size is given


@pytest.mark.slow_cases("net", "frame", "membrane")
@pytest.mark.parametrize("name", CASES)
def test_derivatives(name):
    function, p, sizes = CASES[name]
    sizes = dict.fromkeys(p, STEPS[name]) | sizes
    gradient = assert_gradient(*joined(function, p, sizes), corrupted=1.1)
    if name == "membrane":  # of removed elements: sorted by name, forces, height, pressure
        forces, pressure = gradient[:48].reshape(16, 3), gradient[49:]
        assert (forces[5] == 0).all() and (pressure[jnp.array([3, 4])] == 0).all()
