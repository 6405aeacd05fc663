"""What the schema of scene files says of fields where docstrings speak Python, or of several."""

from __future__ import annotations

_LOADED = 'the elements of that group that are loaded: {"type": "Selection", "elements": [4, 5]}'
_ON = (
    'key of the loaded group in `elements` of the structure, such as "guys", or its place from 0 '
    "where these are a list; left out or null: all groups"
)
_NOT_HERE = "a catenary is elastic: left out, or null"
_AREA = "cross-section, scalar or [n_elem], m2; together with `law`"
_LAW = "uniaxial law of all elements of the group, such as Elastic; together with `area`"
_GROUPS = (
    'One number for all groups that can take it, or by group, {"guys": 1.0}, or for some elements '
    'of a group, {"guys": {"type": "Only", "elements": [0], "values": 1.0}}; groups that are left '
    "out have none."
)
_SKIPS = (
    "One number for all passes by beams where there are cables or bars; name the group to state "
    "it of beams."
)
_HELD = (
    'the key of a group, a list of keys, or elements of groups, {"deck": {"type": "Selection", '
    '"elements": [0, 1]}}'
)

FIELDS: dict[tuple[str, str], str] = {
    ("Structure", "elements"): (
        "one group of elements (Cables, Bars, Beams, ...), or several: an object whose keys are "
        "the names of the groups, or a list; at any depth"
    ),
    ("Structure", "supports"): "which nodes are held, and how",
    ("Supports", "mask"): (
        "true where a displacement is held, [n_node, 3] along x, y, z, or [n_node, 6] with the "
        "rotations about x, y, z"
    ),
    ("Supports", "nodes"): "numbers of the nodes whose position is held (pinned), [n]",
    ("Supports", "clamps"): "numbers of the nodes whose position and rotation are held, [n]",
    ("Supports", "chosen"): (
        "numbers of nodes of which single displacements or rotations are held, [n]; they may be "
        "in `nodes`, too: what either holds is held"
    ),
    ("Supports", "held"): (
        "of each of the `chosen` nodes, what is held: the displacements along x, y, z, then the "
        "rotations about x, y, z, true or false, [n, 6]"
    ),
    ("Supports", "axes"): (
        "of each of the `chosen` nodes: the three directions that replace x, y, z there, of "
        "length 1 and at right angles, one in each row of a matrix, [n, 3, 3]; left out: x, y, z"
    ),
    ("Phase", "loads"): (
        "one load or a list; they add to those of earlier phases, which go on acting"
    ),
    ("Phase", "pretension"): (
        "axial force in the initial geometry, N. The force after equilibrium differs, because "
        "nodes move: `jacking` prescribes that one. Prestress stays in later phases. "
        f"{_GROUPS} {_SKIPS}"
    ),
    ("Phase", "force_density"): f"pretension over initial length, N/m. {_GROUPS} {_SKIPS}",
    ("Phase", "prestrain"): (
        "strain in the initial geometry, on the unstressed length, without unit. "
        f"{_GROUPS} {_SKIPS}"
    ),
    ("Phase", "rest_length"): (
        "unstressed length, m (has only the digits of a length: a relative error of eps EA/N in "
        f"the force). {_GROUPS} {_SKIPS}"
    ),
    ("Phase", "sag"): (
        "of catenaries with a weight: vertical distance from the chord at midspan under the whole "
        "weight along -z, m. "
        f"{_GROUPS}"
    ),
    ("Phase", "jacking"): (
        "force that a jack keeps in the element during this phase whatever its length, N: the "
        "force after equilibrium. At the end of the phase the jack is anchored: the unstressed "
        f"length is locked in, and the force follows later loads. {_GROUPS}"
    ),
    ("Phase", "shortening"): (
        f"by how much a turnbuckle shortens the unstressed length, m. {_GROUPS} {_SKIPS}"
    ),
    ("Phase", "temperature"): (
        "change of the temperature, K; the group needs `expansion`. Changes of all phases add. "
        f"{_GROUPS} One number for all passes by groups without `expansion`, beams among them."
    ),
    ("Phase", "adds"): (
        f"elements that are there from this phase on, and not before: {_HELD}. What no phase adds "
        "is there from the beginning."
    ),
    ("Phase", "removes"): (
        f"elements that go: {_HELD}. Their end forces are ramped out. Loads along them act again "
        "if they are added again."
    ),
    ("Phase", "placed"): (
        'where nodes wait that no element touches: "drawn", where they are, so that new elements '
        'reach from where others have moved; or "attached": they go along with the node that '
        "their first element joins them to, as if rigidly, with its rotation"
    ),
    ("Bars", "area"): _AREA,
    ("Bars", "law"): _LAW,
    ("Beams", "section"): (
        "cross-section of all elements of the group; one fibre with E, A, I, J is enough"
    ),
    ("Beams", "torsional_stiffness"): (
        "GJ, scalar or [n_elem], N m2; needed unless the section has `torsion`, from which it is "
        "taken with Poisson's ratio 0.3"
    ),
    ("Catenaries", "area"): _NOT_HERE,
    ("Catenaries", "law"): _NOT_HERE,
    ("Catenaries", "section"): _NOT_HERE,
    ("AreaLoads", "faces"): (
        "node numbers in order around each face, [n_face, 3] or [n_face, 4]; a triangle among "
        "quadrilaterals repeats a node"
    ),
    ("AreaLoads", "factor"): "factor of the forces, without unit; default 1",
    ("LineLoads", "factor"): "factor of the forces, without unit; default 1",
    ("LineLoads", "on"): _ON,
    ("CablePressure", "on"): f"{_ON}; only cables, bars and beams can be loaded",
    ("SelfWeight", "on"): f"{_ON} that have a `weight`",
    ("FacePressure", "pressure"): (
        "pressure, N/m2, scalar or [n_face]; positive along the normal about which the nodes of a "
        "face are in anticlockwise order"
    ),
    ("LineLoads", "elements"): f"{_LOADED}; left out or null: all",
    ("SelfWeight", "elements"): f"{_LOADED}; left out or null: all",
    ("SelfWeight", "direction"): (
        "direction and factor, [3]; default [0, 0, -1], once the weight downwards. Half of an "
        "element's weight acts at each of its ends; beams bend under it, too"
    ),
    ("SupportMovement", "displacements"): (
        "[3] or [n, 3], m, along what is held in the phase; null if nodes only turn"
    ),
    ("Parallel", "laws"): "the laws, a list",
    ("Parallel", "spring"): (
        "compliance of a spring in series with all laws together, 1/Pa, or null; for laws that "
        "all rise"
    ),
    ("Parallel", "one_sided"): "whether the laws together are slack in compression",
    ("Polygonal", "strain"): (
        "strains of the points, [n], n >= 2, increasing, without unit; as many as `stress`. The "
        "curve passes the origin: [0, 0] is one of the points, or between two of them. Points of "
        "negative strain are compression; without them the law carries tension only, as cables do"
    ),
    ("Polygonal", "stress"): "stresses of the points, [n], Pa; as many as `strain`",
    ("Polygonal", "one_sided"): (
        "whether points of compression are left out: the law is slack in compression, for cables"
    ),
    ("Polygonal", "endless"): "whether the law goes on elastically beyond its ends",
    ("Section", "laws"): "uniaxial laws, a list; fibres of one law follow each other",
    ("Section", "counts"): "number of fibres of each law, a list; left out where there is one law",
    ("Section", "torsion"): (
        "Saint-Venant torsion constant J, the share of each law, [n_law], m4; beams need it, or "
        "a `torsional_stiffness` of their own"
    ),
    ("Section", "points"): "points of a mesh for pictures, [n_point, 2], m",
    ("Section", "cells"): "the four points of each fibre in a mesh for pictures, [n_fibre, 4]",
    ("Section", "own"): (
        "second moments of area of each fibre about its own centroid: of z^2 (Iy, for moments "
        "about y), of y^2 (Iz), of yz, [n_fibre, 3], m4. One fibre without it does not resist "
        "bending. Laws that are not linear are evaluated at the centroids of the fibres"
    ),
    ("Section", "placed"): (
        "of the axis of beams, which goes through the origin of y and z: false if that is merely "
        "the origin of the numbers given; beams then warn unless it is the centroid"
    ),
}
"""By class and field."""
for _key in ("area", "law"):
    FIELDS |= {(_name, _key): FIELDS["Bars", _key] for _name in ("Cables", "SlidingCables")}

CLASSES = {
    "Section": "A cross-section made of fibres: places y and z, an area and a law each.",
    "Supports": "Which displacements and rotations of which nodes are held.",
    "Only": "Values for some elements of one group.",
    "Selection": "Some elements of one group.",
    "SelfWeight": "Self-weight of the elements that have a `weight`.",
    "Elastic": "Linear law: stress is E times strain.",
    "Parallel": "Laws that share one strain: stresses add by their shares of the area.",
}
"""What a class is, where the first line of its docstring speaks Python."""
