"""Examples in the schema of scene files: what a person types most often, in JSON.

Editors offer them, and a test reads every one of them in a scene that it fits.
"""

from __future__ import annotations

from typing import Any

_FIBRE = {  # of a tube of 114.3 x 4 mm
    "y": [0],
    "z": [0],
    "area": [0.001386],
    "own": [[2.11e-6, 2.11e-6, 0]],
    "torsion": [4.22e-6],
    "laws": [{"type": "Elastic", "E": 210e9}],
}
_MESH = {  # of a rectangle of 0.1 x 0.2 m
    "y": [-0.025, -0.025, 0.025, 0.025],
    "z": [-0.05, 0.05, -0.05, 0.05],
    "area": [0.005, 0.005, 0.005, 0.005],
    "own": [[4.1667e-6, 1.0417e-6, 0]] * 4,
    "torsion": [4.578e-5],
    "laws": [
        {
            "type": "Polygonal",
            "strain": [-0.02, -0.00112, 0, 0.00112, 0.02],
            "stress": [-240e6, -235e6, 0, 235e6, 240e6],
            "unloading": "elastic",
        }
    ],
}

CLASSES: dict[str, dict[str, Any]] = {
    "Cables": {
        "cables by EA": {"type": "Cables", "links": [[0, 1], [1, 2]], "axial_stiffness": 15e6},
        "cables by area and law, with weight": {
            "type": "Cables",
            "links": [[0, 1]],
            "area": 1e-4,
            "law": {"type": "Elastic", "E": 160e9},
            "weight": 8.2,
            "expansion": 1.2e-5,
        },
    },
    "Bars": {"bars by EA": {"type": "Bars", "links": [[0, 1]], "axial_stiffness": 300e6}},
    "Beams": {
        "beams by E, A, I, J": {"type": "Beams", "links": [[0, 1]], "section": _FIBRE},
        "beams with a ball joint at their first end": {
            "type": "Beams",
            "links": [[0, 1]],
            "hinges": [[True, False]],
            "section": _FIBRE,
        },
    },
    "Catenaries": {
        "hanging cables": {
            "type": "Catenaries",
            "links": [[0, 1]],
            "axial_stiffness": 15e6,
            "weight": 8.2,
            "rest_length": 10.2,
        },
    },
    "SlidingCables": {
        "cables that slide over their nodes": {
            "type": "SlidingCables",
            "links": [[0, 1, 2]],
            "axial_stiffness": 15e6,
        },
    },
    "Section": {
        "one fibre: E, A, Iy, Iz, J": _FIBRE,
        "a mesh: four fibres of an elastic-plastic law": _MESH,
    },
    "Supports": {
        "nodes held in place": {"nodes": [0, 2]},
        "a clamped foot": {"clamps": [0]},
        "a pinned foot that cannot spin about z": {
            "nodes": [0],
            "chosen": [0],
            "held": [[False, False, False, False, False, True]],
        },
        "a roller that moves along x and y": {
            "nodes": [0],
            "chosen": [2],
            "held": [[False, False, True, False, False, False]],
        },
        "a roller on a plane that rises by 45 degrees": {
            "nodes": [0],
            "chosen": [2],
            "held": [[True, False, False, False, False, False]],
            "axes": [
                [
                    [-0.7071067811865476, 0, 0.7071067811865476],
                    [0, 1, 0],
                    [0.7071067811865476, 0, 0.7071067811865476],
                ]
            ],
        },
    },
    "Phase": {
        "prestress": {"pretension": {"guys": 10e3}},
        "loads in ten increments": {
            "loads": [{"type": "NodalLoads", "nodes": [2], "forces": [0, 0, -1000]}],
            "increments": 10,
        },
        "elements that come": {"adds": "guys", "jacking": {"guys": 12e3}},
        "elements that go": {"removes": "guys"},
    },
    "NodalLoads": {
        "a force on nodes": {"type": "NodalLoads", "nodes": [1, 2], "forces": [0, 0, -1000]},
    },
    "SelfWeight": {"the weight of all elements that have one": {"type": "SelfWeight"}},
    "LineLoads": {
        "snow on one group, per length in plan": {
            "type": "LineLoads",
            "forces": [0, 0, -500],
            "on": "mast",
            "per": "projected",
        },
        "a load on some elements of one group": {
            "type": "LineLoads",
            "forces": [200, 0, 0],
            "on": "mast",
            "elements": {"type": "Selection", "elements": [0]},
            "per": "initial",
        },
    },
    "AreaLoads": {
        "snow on faces, per area in plan": {
            "type": "AreaLoads",
            "faces": [[0, 1, 2]],
            "forces": [0, 0, -750],
        },
    },
    "CablePressure": {
        "pressure on one group": {
            "type": "CablePressure",
            "pressure": 150,
            "axis": [0, 1, 0],
            "on": "guys",
        },
    },
    "FacePressure": {
        "pressure on faces": {"type": "FacePressure", "faces": [[0, 1, 2]], "pressure": 400},
    },
    "SupportMovement": {
        "a support that settles": {
            "type": "SupportMovement",
            "nodes": [0],
            "displacements": [0, 0, -0.01],
        },
    },
    "Elastic": {"steel": {"type": "Elastic", "E": 210e9}},
    "Polygonal": {
        "for cables: tension only": {
            "type": "Polygonal",
            "strain": [0, 0.008, 0.04],
            "stress": [0, 1.28e9, 1.57e9],
        },
        "steel that yields in tension and compression": {
            "type": "Polygonal",
            "strain": [-0.02, -0.00112, 0, 0.00112, 0.02],
            "stress": [-240e6, -235e6, 0, 235e6, 240e6],
            "unloading": "elastic",
        },
    },
    "Only": {"some elements": {"type": "Only", "elements": [0, 1], "values": 10e3}},
    "Selection": {"some elements": {"type": "Selection", "elements": [0, 1]}},
}
"""Objects of classes: by name of the class, what each is, and the object."""

_STATED = {
    "pretension": 10e3,
    "force_density": 500.0,
    "prestrain": 5e-4,
    "rest_length": 3.6,
    "sag": 0.5,
    "jacking": 12e3,
    "shortening": 0.002,
    "temperature": -30.0,
}
_SOME = {"type": "Selection", "elements": [0]}

FIELDS: dict[tuple[str, str], list[Any]] = {
    **{
        ("Phase", name): [
            {"guys": value},
            {"guys": {"type": "Only", "elements": [0], "values": value}},
            value,
        ]
        for name, value in _STATED.items()
    },
    ("Phase", "adds"): ["guys", ["guys", "mast"], {"guys": _SOME}],
    ("Phase", "removes"): ["guys", {"guys": _SOME}],
}
"""Values of fields, by class and field; "guys" and "mast" are the keys of groups there."""


def of_classes(names: list[str]) -> list[dict[str, Any]]:
    """Snippets for editors, the examples of some classes, a list."""
    return [
        {"label": label, "body": example}
        for name in names
        for label, example in CLASSES.get(name, {}).items()
    ]


SCENE: dict[str, Any] = {
    "format": "jaxcable scene",
    "version": 1,
    "structure": {
        "nodes": [[-4, 0, 3], [0, 0, 0], [4, 0, 3]],
        "elements": {"guys": {"type": "Cables", "links": [[0, 1], [1, 2]], "axial_stiffness": 1e5}},
        "supports": {"nodes": [0, 2]},
    },
    "phases": [
        {"pretension": {"guys": 500}},
        {"loads": [{"type": "NodalLoads", "nodes": [1], "forces": [0, 0, -600]}]},
    ],
}
"""A whole scene: two cables, prestressed and loaded."""
