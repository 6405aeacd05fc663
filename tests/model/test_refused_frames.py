"""What beams, their supports and loads refuse: a message names argument, index and rule."""

import jax
import numpy as np
import pytest

import jaxcable as jc

NODES = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [2.0, 0, 1.0]])
SECTION = jc.Section.rectangle(0.1, 0.2, jc.Elastic(210e9), (1, 2))
POLYGON = jc.Section.polygon([[0, 0], [0.1, 0], [0, 0.1]], None, jc.Elastic(210e9), 0.05)
YIELDING = jc.Section.rectangle(0.1, 0.2, jc.materials.steel(), (1, 2))


def beams(**options):
    return jc.Beams([[0, 1], [1, 2]], **{"section": SECTION, **options})


def frame(supports=None, group=None):
    cable = jc.Cables([[2, 3]], axial_stiffness=1e6)
    elements = {"beam": beams() if group is None else group, "stay": cable}
    supports = jc.clamped([0]) + jc.pinned([3]) if supports is None else supports
    return jc.Structure(NODES, elements, supports)


def analyse(method=None, structure=None, **phase):
    return jc.solve(frame() if structure is None else structure, [jc.Phase(**phase)], method)


def masked(node, *freedoms):
    mask = np.zeros((4, 6), bool)
    mask[3, :3] = mask[0] = True
    mask[node] = False
    mask[node, list(freedoms)] = True
    return jc.Supports(mask)


CASES = {
    "no section": (
        lambda: jc.Beams([[0, 1]]),
        "section: missing; a group of beams needs a Section",
    ),
    "section kind": (lambda: jc.Beams([[0, 1]], section=1e-4), "section: missing"),
    "torsion": (lambda: beams(section=POLYGON), "torsional_stiffness: missing; this section has"),
    "torsion sign": (
        lambda: beams(torsional_stiffness=[1.0, -1.0]),
        r"torsional_stiffness\[1\] = -1.0",
    ),
    "up shape": (lambda: beams(up=[0.0, 1.0]), r"up: expected shape \(3,\) or \(2, 3\)"),
    "up along": (
        lambda: analyse(structure=frame(group=beams(up=[2.0, 0.0, 0.0]))),
        r"up\[0\] = .*: must not be along the element",
    ),
    "a section for a law": (
        lambda: jc.Bars([[0, 1]], area=1.0, law=SECTION),
        "law: Section is not a uniaxial law",
    ),
    "a number for a law": (
        lambda: jc.Cables([[0, 1]], area=1.0, law=210e9),
        "law: float is not a uniaxial law",
    ),
    "a law for a section": (
        lambda: jc.Bars([[0, 1]], section=jc.Elastic(1.0)),
        "section: Elastic is not a Section",
    ),
    "points": (lambda: beams(points=2), "points = 2: expected an integer from 3 to 1000"),
    "many points": (lambda: beams(points=10**9), "points = 1000000000: expected an integer from 3"),
    "hinges": (lambda: beams(hinges=[True, False]), r"hinges: expected booleans \[2, 2\]"),
    "two hinges": (
        lambda: beams(hinges=[[False, False], [True, True]]),
        r"hinges\[1\]: both ends are released",
    ),
    "hinges of three axes": (
        lambda: beams(hinges=np.zeros((2, 3, 2), bool)),
        r"hinges: expected booleans \[2, 2\] or \[2, 2, 3\]",
    ),
    "torsion at both ends": (
        lambda: beams(hinges=np.array([[[True, False, False]] * 2] * 2)),
        r"hinges\[0\]: both ends are released, the element could spin",
    ),
    "springs without hinges": (
        lambda: beams(springs=1e3),
        "springs: give hinges, too, True where an end turns",
    ),
    "springs shape": (
        lambda: beams(hinges=[[True, False]] * 2, springs=[1.0, 2.0]),
        r"springs: expected a scalar or shape \(2, 3\) or \(2, 2, 3\), got \(2,\)",
    ),
    "springs sign": (
        lambda: beams(hinges=[[True, False]] * 2, springs=-1.0),
        r"springs\[0, 0, 0\] = -1.0: must not be negative",
    ),
    "axes near the vertical": (
        lambda: jc.Structure(
            [[0, 0, 0], [0.002, 0, 1.0]], jc.Beams([[0, 1]], section=SECTION), jc.clamped([0])
        ),
        "up: missing; element 0 leans by 0.115 degrees",
    ),
    "restrained letters": (lambda: jc.restrained([0], "xq"), "along = 'xq': expected some of"),
    "restrained nothing": (lambda: jc.restrained([0]), "along, about: nothing is held"),
    "restrained unknown": (
        lambda: frame(jc.clamped([0]) + jc.pinned([3]) + jc.restrained([8], "x")),
        r"restrained nodes\[0\] = 8: the structure has nodes 0 to 3",
    ),
    "restrained axes": (
        lambda: jc.restrained([0], "x", axes=[[1.0, 0, 0], [1.0, 1.0, 0], [0, 0, 1.0]]),
        r"axes\[0\]: expected three directions of length 1 at right angles",
    ),
    "no direction": (lambda: jc.restrained([0], "x", axes=(0.0, 0, 0)), "no direction"),
    "two sets of directions": (
        lambda: frame(
            jc.clamped([0])
            + jc.pinned([3])
            + jc.restrained([2], "x", axes=(1.0, 1.0, 0))
            + jc.restrained([2], "x", axes=(1.0, 0.0, 1.0))
        ),
        "supports of node 2: held along two sets of directions",
    ),
    "directions that change": (
        lambda: jc.solve(
            frame(jc.clamped([0]) + jc.pinned([3]) + jc.restrained([2], "x", axes=(1.0, 1.0, 0))),
            [
                jc.Phase(loads=jc.NodalLoads([2], (0, 0, 1.0))),
                jc.Phase(
                    supports=jc.clamped([0])
                    + jc.pinned([3])
                    + jc.restrained([2], "x", axes=(1.0, 0.0, 1.0))
                ),
            ],
        ),
        "supports of node 2: held in part along other directions than in the phase before",
    ),
    "rotations of a net": (
        lambda: jc.Structure(
            NODES[:3],
            jc.Cables([[0, 1], [1, 2]], axial_stiffness=1.0),
            jc.pinned([0, 2]) + jc.restrained([0], about="x"),
        ),
        "no element of the structure has rotations",
    ),
    "carried by a cable's end": (
        lambda: jc.Structure(
            np.vstack([NODES, [[2.0, 0, 1.5]]]),
            {"beam": beams(), "stay": jc.Cables([[2, 3]], axial_stiffness=1e6)},
            jc.clamped([0]) + jc.pinned([3]),
            rigid=[[3, 4]],
        ),
        r"rigid\[0\] = \[3, 4\]: node 3 has no rotation",
    ),
    "carried twice": (
        lambda: jc.Structure(
            np.vstack([NODES, [[2.0, 0, 1.5]]]),
            {"beam": beams(), "stay": jc.Cables([[4, 3]], axial_stiffness=1e6)},
            jc.clamped([0]) + jc.pinned([3]),
            rigid=[[2, 4], [1, 4]],
        ),
        r"rigid\[1\] = \[1, 4\]: node 4 is carried twice",
    ),
    "a support on an arm": (
        lambda: jc.Structure(
            np.vstack([NODES, [[2.0, 0, 1.5]]]),
            {"beam": beams(), "stay": jc.Cables([[4, 3]], axial_stiffness=1e6)},
            jc.clamped([0]) + jc.pinned([3, 4]),
            rigid=[[2, 4]],
        ),
        "supports of node 4: another node carries it",
    ),
    "mask without rotations": (
        lambda: jc.Structure(
            NODES[:3],
            jc.Cables([[0, 1], [1, 2]], axial_stiffness=1.0),
            jc.Supports(np.ones((3, 6), bool)),
        ),
        r"supports mask: expected \[n_node, 3\]; no element of the structure has rotations",
    ),
    "joined masks": (
        lambda: jc.Supports(np.ones((3, 3), bool)) + jc.Supports(np.ones((4, 3), bool)),
        "supports: masks of 3 and 4 nodes cannot be joined",
    ),
    "clamped unknown": (
        lambda: frame(jc.clamped([0, 9])),
        r"clamped nodes\[1\] = 9: the structure has nodes 0 to 3",
    ),
    "moment on a cable's end": (
        lambda: analyse(loads=jc.NodalLoads([3], (0, 0, 0.0), moments=(0, 0, 1.0))),
        "moments: node 3 has no rotation",
    ),
    "moments shape": (
        lambda: jc.NodalLoads([1], (0, 0, 0.0), moments=(0, 1.0)),
        r"moments: expected shape \(3,\) or \(1, 3\)",
    ),
    "line load": (lambda: jc.LineLoads((0, 1.0)), r"forces: expected shape \(3,\), got \(2,\)"),
    "line load's group": (
        lambda: analyse(loads=jc.LineLoads((0, 0, 1.0), on="mast")),
        "on = 'mast': no such key in the structure's elements",
    ),
    "moved node": (
        lambda: analyse(loads=jc.SupportMovement([7], (0, 0, 0.1))),
        r"moved nodes\[0\] = 7: the structure has nodes 0 to 3",
    ),
    "moved free node": (
        lambda: analyse(loads=jc.SupportMovement([0, 1], (0.0, 0, 0.1))),
        r"displacements\[1\]: node 1 is free along z; only what is held can be moved",
    ),
    "moved shape": (
        lambda: jc.SupportMovement([0, 3], np.zeros((3, 3))),
        r"displacements: expected shape \(3,\) or \(2, 3\)",
    ),
    "turned pin": (
        lambda: analyse(
            structure=frame(jc.pinned([0, 2, 3]) + jc.restrained([0], about="x")),
            loads=jc.SupportMovement([0], (0, 0, 0.0), rotations=(0, 0.1, 0)),
        ),
        r"rotations\[0\]: node 0 is not clamped",
    ),
    "turned cable end": (
        lambda: analyse(loads=jc.SupportMovement([3], (0, 0, 0.0), rotations=(0, 0.1, 0))),
        "rotations: node 3 has no rotation",
    ),
    "secant": (
        lambda: analyse(jc.Incremental(0, "secant"), loads=jc.LineLoads((0, 0, -1.0))),
        "secant",
    ),
    "pretension of a yielding beam": (
        lambda: analyse(
            structure=frame(group=beams(section=YIELDING)),
            pretension={"beam": 1e9, "stay": None},
        ),
        r"pretension\[0\] = 1000000000.0: above what its law can carry; .* within the curve",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_wrong_argument(name):
    make, text = CASES[name]
    with pytest.raises(ValueError, match=text):
        make()


def test_topology_of_beams_cannot_be_traced():
    with pytest.raises(ValueError, match="indices are topology"):
        jax.jit(lambda links: jc.Beams(links, section=SECTION).torsional_stiffness)(
            np.array([[0, 1]])
        )
