"""What the tests of files share: scenes, a scene as JSON, networks of compas, what readers tell."""

import copy
import json
import warnings
from pathlib import Path

import jax
import jsonschema
import numpy as np
import scenes

import jaxcable as jc
from jaxcable.files import FileError

SCHEMA = Path(jc.__file__).parent / "files" / "scene.schema.json"
CHECK = jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text()))
GONE = object()
"""As a value for `changed`: the field is left out."""


def at(data, path):
    """The part of JSON data at a path of keys."""
    for key in path:
        data = data[key]
    return data


def changed(data, *changes):
    """A copy of JSON data with other values: pairs (path, value), one after the other."""
    data = copy.deepcopy(data)
    for path, value in changes:
        place = at(data, path[:-1])
        if value is GONE:
            del place[path[-1]]
        else:
            place[path[-1]] = copy.deepcopy(value)
    return data


def outcome(read, *paths, **options):
    """What a reader makes of files: (net, rows as "what (count)"), or (None, the FileError).

    What it leaves out it tells in one warning, row by row; an error is one line about a file.
    """
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            net = read(*paths, **options)
        except FileError as error:
            text = str(error)
            assert any(text.startswith(str(path)) for path in paths) and "\n" not in text
            return None, text
    rows = net.omissions
    assert len(seen) == bool(rows) and all(w.category is jc.InputWarning for w in seen)
    assert all(f"\n  {row}" in str(seen[0].message) for row in rows)
    return net, [f"{row.what} ({row.count})" for row in rows]


# --- scenes

SMALL = {  # sizes of scenes with fewer numbers
    "saddle": {"n_x": 3, "n_y": 3},
    "saddle_net": {"increments": (1, 1), "shape": (3, 3)},
    "hypar_net": {"increments": (1, 1)},
    "guyed_mast": {"levels": 1, "per_level": 2, "increments": (1, 1)},
    "strung_arch": {"n": 4, "increments": (1, 1)},
    "toggle_frame": {"n": 2},
    "lee_frame": {"n": 2},
}


def everything():
    """A scene with what the ready ones lack, in float32 too; and names that mean something."""
    nodes = np.array([[0, 0, 0], [1, 0, 0.1], [2, 0, 0], [1, 1, 0]], np.float32)
    nodes = nodes + np.float32(1 / 3)
    steel = jc.Polygonal([-0.02, 0.0, 0.002, 0.02], [-5e8, 0.0, 4e8, 5e8], unloading="reversible")
    disc = jc.Section.disc(0.02, steel, (3, 2))
    ring = jc.Section.ring(0.03, 0.004, jc.Elastic(1e9), (1, 4))
    section = jc.Section.composite([disc, ring])
    elements = {
        "float32": [
            jc.Cables([[0, 1]], area=1e-4, law=steel, strength=[1e5 * np.pi]),
            jc.Bars([[1, 2], [0, 2]], section=section, expansion=1.2e-5, weight=[1.0, 2.0]),
        ],
        "list": (jc.SlidingCables([[0, 3, 2], [1, 3]], axial_stiffness=[1e5, 2e5]),),
    }
    mask = np.zeros((4, 3), bool)
    mask[[0, 2]] = True
    mask[3, 1] = True
    faces = [[0, 1, 3, 3], [1, 2, 3, 3]]
    phases = [
        jc.Phase(
            pretension={"float32": [100.0, jc.only([1], 50.0)], "list": None},
            loads=[
                jc.SelfWeight(),
                jc.LineLoads((0, 0, -1.0), on="list", per="projected"),
                jc.AreaLoads(faces, (0, 0, -10.0)),
                jc.FacePressure(faces, [1.0, 2.0]),
            ],
        ),
        jc.Phase(
            supports=jc.pinned([0, 2]),
            loads=[],
            temperature={"float32": [None, 20.0], "list": None},
            increments=3,
        ),
        jc.Phase(loads=jc.SupportMovement([2], (0.01, 0.0, 0.0))),
        jc.Phase(loads=jc.Varying(jc.SelfWeight(), [0.0, 0.5, 1.0], [0.0, 0.1, 0.2])),
    ]
    return jc.scenes.Scene(jc.Structure(nodes, elements, jc.Supports(mask)), phases)


def stages():
    """A scene with what comes and goes: hinges, moments, rigid links, sags, skew supports."""
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, -1], [1, 1, 0]]
    section = jc.Section.rectangle(0.1, 0.1, jc.Elastic(1e9))
    joints = {"hinges": [[False, False], [False, True]], "springs": [[0.0, 0, 0], [0.0, 5.0, 7.0]]}
    elements = {
        "deck": jc.Beams([[0, 1], [1, 2]], section, up=(0, 0, 1.0), **joints),
        "stay": jc.Cables([[1, 4]], axial_stiffness=1e6, expansion=1e-5, weight=1.0),
        "rope": jc.Catenaries([[0, 4], [2, 4]], axial_stiffness=1e6, weight=5.0),
    }
    held = jc.clamped([0, 2]) + jc.restrained([4], "xyz", "x", axes=(1.0, 1.0, 0.5))
    structure = jc.Structure(nodes, elements, held, rigid=[[1, 3]])
    down = (0, 0, -1.0)
    phases = [
        jc.Phase(
            sag={"deck": None, "stay": None, "rope": 0.1},
            loads=jc.SelfWeight(on="stay", elements=jc.only([0])),
        ),
        jc.Phase(removes="stay", loads=jc.NodalLoads([3], down, (0, 1.0, 0))),
        jc.Phase(
            adds={"deck": None, "stay": jc.only([0]), "rope": None},
            removes={"deck": None, "stay": None, "rope": [True, False]},
            placed="attached",
            shortening={"deck": None, "stay": 0.01, "rope": None},
            loads=[
                jc.LineLoads(down, on="deck", elements=jc.only([1]), per="initial"),
                jc.LineLoads([down] * 2, "deck", "initial", geometry="begun", factor=[1.0, 0.5]),
                jc.CablePressure(1.0, (0, 1.0, 0), on="deck", per="unstressed"),
            ],
        ),
        jc.Phase(
            supports=held + jc.restrained([1], "y"),
            temperature={"deck": None, "stay": 5.0, "rope": None},
            loads=jc.SupportMovement([0], None, (0.0, 0.001, 0.0)),
        ),
    ]
    return jc.scenes.Scene(structure, phases)


def blown():
    """A mast on springs with guys, under wind, ice, masses, and loads within its beams."""
    nodes = [[0.0, 0, 0], [0, 0, 12], [0, 0, 24], [15, 0, 0], [-8, 13, 0], [-8, -13, 0]]
    section = jc.Section.linear(EA=8e8, EIy=6e7, EIz=6e7, GJ=5e6, GAy=3e7, GAz=3e7)
    elements = {
        "mast": jc.Beams([[0, 1], [1, 2]], section=section, weight=900.0),
        "guys": jc.Catenaries([[3, 2], [4, 2], [5, 2]], axial_stiffness=2e7, weight=12.0),
        "soil": jc.Springs([0], 5e8, rotational_stiffness=2e7, preload=(0.0, 0.0, 4e4)),
        "bearing": jc.GroundContacts([0], 2e8, gap=0.001),
    }
    structure = jc.Structure(nodes, elements, jc.pinned([3, 4, 5]))
    storm = jc.EurocodeWind(24.0, roughness_length=0.06, lowest_height=3.0)
    breeze = jc.WindTable([5.0, 20.0], pressures=[200.0, 350.0])
    loads = [
        jc.WindLoads((1.0, 0.3, 0.0), storm, drag=1.1, diameter=0.4, on="mast", ground=-1.0),
        jc.WindLoads((1.0, 0.0, 0.0), breeze, drag=1.2, diameter=0.02, on="guys", ice=0.01),
        jc.WindLoads((0.0, 1.0, 0.0), jc.WindPowerLaw(9.0, 0.16), 1.0, 0.3, on="mast"),
        jc.IceLoads(0.01, 0.02, on="guys"), jc.PointMasses([2], 120.0), jc.SelfWeight(),
        jc.PointLoads([1], 0.25, (2e3, 0.0, 0.0), moments=(0.0, 300.0, 0.0), on="mast"),
        jc.loads.Train([0, 1], 8.0, (100.0, 0.0, 0.0), spacings=[1.5], on="mast"),
        jc.loads.Crowd([0, 1], (20.0, 0.0, 0.0), 3.0, 15.0, on="mast"),
    ]  # fmt: skip
    return structure, [jc.Phase(pretension={"guys": 2e4}), jc.Phase(loads=loads, increments=3)]


OWN = {"everything": everything, "stages": stages, "blown": blown}
SCENES = [*scenes.EVERY, *OWN]


def scene_of(name):
    make = OWN.get(name) or scenes.EVERY[name]
    return jc.scenes.Scene(*make(**SMALL.get(name, {})))


def require_same(one, other):
    """Equal trees with equal leaves, bit by bit and in dtype."""
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        a, b = np.asarray(a), np.asarray(b)
        assert a.dtype == b.dtype and a.shape == b.shape
        assert a.tobytes() == b.tobytes()


# --- a scene as a person writes it: a mast of one beam with three guys

NODES = [[0, 0, 0], [0, 0, 3], [4, 0, 0], [-2, 3, 0], [-2, -3, 0]]
MAST = {
    "format": "jaxcable scene",
    "version": 1,
    "structure": {
        "nodes": NODES,
        "elements": {
            "guys": {"type": "Cables", "links": [[1, 2], [1, 3], [1, 4]], "axial_stiffness": 1e6},
            "mast": {
                "type": "Beams",
                "links": [[0, 1]],
                "section": {
                    "y": [0],
                    "z": [0],
                    "area": [0.0014],
                    "own": [[2e-6, 2e-6, 0]],
                    "torsion": [4e-6],
                    "laws": [{"type": "Elastic", "E": 210e9}],
                },
            },
        },
        "supports": {"clamps": [0], "nodes": [2, 3, 4]},
    },
    "phases": [
        {"pretension": {"guys": 10e3}},
        {"loads": [{"type": "NodalLoads", "nodes": [1], "forces": [100, 0, 0]}]},
    ],
}


def read_scene(data, folder):
    """`load_scene` of JSON data, or of a text."""
    path = folder / "scene.json"
    path.write_text(data if isinstance(data, str) else json.dumps(data))
    return jc.load_scene(path)


# --- nets of compas and jax_fdm

NODE, EDGE = ("data", "node"), ("data", "edge")


def network(*edges, **attributes):
    """A network of two cables of 1 m as jax_fdm 0.14 on compas 2.15 writes it.

    Args:
        edges: attributes of the edges between nodes 0 and 1, and 1 and 2; force densities of 1 N/m
            where none are given.
        attributes: more attributes of the first edge.
    """
    first, second = edges or ({"q": 1.0}, {"q": 1.0})
    zero = dict.fromkeys(("px", "py", "pz"), 0.0)
    places = dict.fromkeys("xyz", 0.0) | zero | dict.fromkeys(("rx", "ry", "rz"), 0.0)
    return {
        "dtype": "jax_fdm.datastructures/FDNetwork",
        "data": {
            "attributes": {"name": "FDNetwork"},
            "default_node_attributes": {**places, "is_support": False},
            "default_edge_attributes": {"q": 0.0, "length": 0.0, "force": 0.0, **zero},
            "node": {
                "0": {"x": 0, "is_support": True},
                "1": {"x": 1, "pz": -1.0},
                "2": {"x": 2, "is_support": True},
            },
            "edge": {"0": {"1": {**first, **attributes}}, "1": {"2": second}, "2": {}},
            "max_node": 2,
        },
        "inheritance": ["compas.datastructures/Graph"],
        "guid": "17bcc62f-c06e-4212-be07-742509e72830",
    }
