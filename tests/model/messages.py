"""Wrong input and the answer to it, a row a case: a pattern of the message, and what is called.

`REFUSED` is surely wrong: a ValueError names argument, index and rule. `SUSPICIOUS` is legal and
most likely not meant: an `InputWarning`. `ODD` is legal and may be meant: silence. All come before
a program is compiled. Numbers that must keep a rule, also while they are traced, are in `rules.py`,
random ones in `banks/mistakes.py`.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np

import jaxcable as jc
from jaxcable import design, materials
from jaxcable.analysis.preparation import prepare
from jaxcable.design.targets import deviations

NODES = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [1.0, 1.0, 0]])
LINKS = [[0, 1], [1, 2], [1, 3]]
STEEL = jc.Elastic(210e9)
SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
PLAN = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
ROUND = [[0, 1], [1, 2], [2, 3], [3, 0]]
SPIRAL = [[2.0, 2, 0], [0, 2, 0], [0, 0, 0], [4, 0, 0], [4, 4, 0], [-2, 4, 0], [-2, 1, 0]]
UP, AXIS = (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)
Loads, Phase, Target = jc.NodalLoads, jc.Phase, design.Target


def cables(links=LINKS, **options):
    return jc.Cables(links, **{"axial_stiffness": 1e4, **options})


def net(nodes=NODES, elements=None, supports=(0, 2, 3)):
    elements = cables() if elements is None else elements
    held = supports if isinstance(supports, jc.Supports) else jc.pinned(supports)
    return jc.Structure(nodes, elements, held)


def push(nodes=(1,), force=(0.0, 0.0, -1.0), moments=None):
    return jc.NodalLoads(nodes, force, moments)


def analyse(*phases, structure=None, method=None):
    """What `solve` does before it computes."""
    prepare(net() if structure is None else structure, list(phases), method, None)


def stated(elements=None, **statement):
    """A phase of the net, or of one of other elements."""
    analyse(Phase(**statement), structure=net(elements=elements))


def loaded(*loads, structure=None):
    analyse(Phase(loads=list(loads)), structure=structure)


def polygon(points, holes=None):
    return jc.Section.polygon(points, holes, STEEL, 0.2)


FAR = np.concatenate([NODES, [[9.0, 0, 0], [9.0, 1, 0]]])
TWO = {"net": cables([[0, 1], [1, 2]]), "tie": jc.Bars([[1, 3]], axial_stiffness=1e4)}
PUSHED = Phase(loads=push())

# beams 0-1-2 along x, and a stay from their end up to node 3; node 4 is off their end
BEND = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [2.0, 0, 1.0], [2.0, 0, 1.5]])
BOX = jc.Section.rectangle(0.1, 0.2, STEEL, (1, 2))
ANGLE = jc.Section.polygon([[0, 0], [0.1, 0], [0, 0.1]], None, STEEL, 0.05)
YIELDING = jc.Section.rectangle(0.1, 0.2, materials.steel(), (1, 2))
HELD = jc.clamped([0]) + jc.pinned([3])
SKEW = HELD + jc.restrained([2], "x", axes=(1.0, 1.0, 0))
OTHER_SKEW = jc.restrained([2], "x", axes=(1.0, 0.0, 1.0))


def beams(**options):
    return jc.Beams([[0, 1], [1, 2]], **{"section": BOX, **options})


def frame(supports=HELD, group=None, stay=(2, 3), n_node=4, **options):
    elements = {"beam": beams() if group is None else group, "stay": cables([stay])}
    return jc.Structure(BEND[:n_node], elements, supports, **options)


def framed(*loads, supports=HELD):
    loaded(*loads, structure=frame(supports))


HUNG = jc.Structure(
    [[-4.0, 0, 3], [1.0, 0, 2], [4.0, 0, 3], [1.0, 0, 0]],
    {
        "net": jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5),
        "mast": jc.Bars([[1, 3]], axial_stiffness=1e4),
    },
    supports=jc.pinned([0, 2, 3]),
)
PHASES = [
    Phase(pretension={"net": 500.0, "mast": None}),
    Phase(loads=jc.NodalLoads([1], (0, 0, -100.0))),
]
PAIR = (0, "pretension")


@functools.cache
def solution():
    found = jc.solve(HUNG, PHASES)
    assert int(found.status) == 0
    return found


@functools.cache
def a_fit():
    return design.fit(lambda p: p - 1.0, jnp.zeros(2))


def twice(tree):
    return jax.tree.map(lambda x: jnp.stack([x, x]), tree)


def aimed(target):
    return deviations([Target("positions"), target], solution())


def tuned(unknowns, targets):
    return design.tune(HUNG, PHASES, unknowns, targets)


def traced(function, *arguments):
    return jax.jit(function)(*arguments)


REFUSED = {
    # elements
    r"^links: expected shape \[n, 2\]": lambda: cables([[0, 1, 2]]),
    "^links: expected integers": lambda: cables([[0.0, 1.0]]),
    "^links: a group needs at least one": lambda: cables(np.zeros((0, 2), int)),
    r"^links\[1\] = \[-1  2\]: node numbers start at 0": lambda: cables([[0, 1], [-1, 2]]),
    r"^links\[1\] = \[2, 2\]: the two ends": lambda: cables([[0, 1], [2, 2]]),
    r"^links\[2\] = .*repeats links\[0\]": lambda: cables([[0, 1], [1, 2], [1, 0]]),
    "^links: .*indices are topology": lambda: traced(
        lambda v: cables(v).axial_stiffness, np.array([[0, 1]])
    ),
    r"^axial_stiffness: expected a scalar or shape \(3,\)": lambda: cables(
        axial_stiffness=[1.0, 1]
    ),
    "^axial_stiffness: expected numbers": lambda: cables(axial_stiffness="stiff"),
    "^axial_stiffness, area: give either": lambda: cables(area=1.0),
    "^axial_stiffness: missing": lambda: jc.Cables(LINKS),
    "^axial_stiffness: missing.*law": lambda: jc.Cables(LINKS, area=1.0),
    # laws
    "^E: expected numbers": lambda: jc.Elastic("soft"),
    r"^E: expected a scalar .* got shape \(2,\)": lambda: jc.Elastic([1.0, 2.0]),
    "^law: the class Elastic is not a law; call it with its numbers": lambda: jc.Cables(
        LINKS, area=1e-4, law=jc.Elastic
    ),
    "^law: float is not a uniaxial law": lambda: jc.Cables(LINKS, area=1.0, law=210e9),
    "^law: Section is not a uniaxial law": lambda: jc.Bars([[0, 1]], area=1.0, law=BOX),
    "^section: Elastic is not a Section": lambda: jc.Bars([[0, 1]], section=STEEL),
    r"^strain: expected shape \[n\] with n >= 2, got \(1,\)": lambda: jc.Polygonal([0.0], [0.0]),
    r"^strain: expected shape \[n\] .* got \(1, 2\)": lambda: jc.Polygonal([[0.0, 1]], [[0.0, 1]]),
    r"^stress: expected shape \(2,\) as strain, got \(3,\)": lambda: jc.Polygonal(
        [0, 1], [0, 1, 2]
    ),
    "^stress: expected numbers": lambda: jc.Polygonal([0, 1e-3], ["a", "b"]),
    "^strain: expected real numbers": lambda: jc.Polygonal([0, 1e-3j], [0, 1e8]),
    "^strain: not a rectangular array": lambda: jc.Polygonal([[0], [1, 2]], [0, 1e8]),
    "^unloading = 'memory': expected": lambda: jc.Polygonal([0, 1e-3], [0, 1e8], "memory"),
    "^strain: goes from -0.002 to -0.001": lambda: jc.Polygonal([-2e-3, -1e-3], [-2e8, -1e8]),
    "^strain: goes from -0.002 to 0.0; .* origin": lambda: jc.Polygonal([-2e-3, 0], [-2e8, 0]),
    "slope at the origin, -1e.11 Pa, must": lambda: jc.Polygonal([0, 1e-3, 2e-3], [0, -1e8, 1e8]),
    "slope at the origin, -2e.11 Pa": lambda: jc.Polygonal([-1e-3, 0, 1e-3], [2e8, 0, 1e8]),
    r"^stress\[1\]: elastic .* a concave curve: slopes that fall away from the origin": (
        lambda: jc.Polygonal([-3, -2, -1, 0, 1], [-3e8, -1.5e8, -1e8, 0, 1e8], "elastic")
    ),
    r'^stress\[1\]: elastic unloading needs .* use unloading="reversible"': lambda: jc.Polygonal(
        [0, 1e-3, 2e-3], [0, 1e8, 0.5e8], "elastic"
    ),
    "segment 1 from the origin has 2e.10 and 5e.10 Pa": lambda: jc.Polygonal(
        [-2e-3, -1e-3, 0, 1e-3, 2e-3], [-1.5e8, -1e8, 0, 1e8, 1.2e8], "elastic"
    ),
    r"^strain\[1\] .* must be above strain\[0\]": lambda: materials.steel(ultimate_strain=1e-3),
    r"^stress\[0\]: elastic unloading needs": lambda: materials.steel(hardening=-0.01),
    r"^strain\[2\] = 0.005: must be above": lambda: materials.strand(ultimate_strain=5e-3),
    # nodes and links of a structure
    "^nodes: expected numbers, got Cables": lambda: jc.Structure(cables(), NODES, jc.pinned([0])),
    r"^nodes: expected shape \[n_node, 3\], got \(4, 2\); a plane structure has z = 0": lambda: net(
        NODES[:, :2]
    ),
    r"^nodes: expected shape \[n_node, 3\], got \(3, 4\); transpose": lambda: net(NODES.T),
    r"^nodes: expected shape \[n_node, 3\], got \(4, 1\)": lambda: traced(
        lambda v: net(v).nodes, NODES[:, :1]
    ),
    r"^elements.links\[1\] = \[1, 2\]: zero length": lambda: net(NODES[[0, 1, 1, 3]]),
    r"^nodes\[4\]: no element touches this node": lambda: net(FAR[:5]),
    "^elements: ndarray is not an element group such as Cables": lambda: net(elements=np.eye(2)),
    r"^elements\['net'\]\[0\]: float is not an element group": lambda: net(elements={"net": [1.0]}),
    r"^elements.links\[2\] = \[2, 4\]: .* nodes 0 to 3; .* from 1: .* at 0, subtract 1": lambda: (
        net(elements=cables([[1, 2], [2, 3], [2, 4]]))
    ),
    r"^elements\['net'\].links\[1\] = \[2, 4\]: .* subtract 1": lambda: net(
        elements={"net": cables([[1, 2], [2, 4]])}
    ),
    r"^elements.links\[1\] = \[2, 4, 4\]: .* subtract 1": lambda: net(
        elements=jc.SlidingCables([[1, 2, 3], [2, 4]], axial_stiffness=1.0)
    ),
    "^replace: Structure has no field 'node'": lambda: jc.replace(net(), node=1),
    "n_elements = 7": lambda: jc.scenes.accuracy_cable(7),
    "^n_x, n_y = 0, 3": lambda: jc.scenes.saddle(0, 3),
    # supports
    r"^supports: missing; a structure needs supports=pinned\(nodes\)": lambda: jc.Structure(
        NODES, cables()
    ),
    r"^supports: .* needs supports=pinned\(nodes\) or Supports\(mask\), got list": (
        lambda: jc.Structure(NODES, cables(), [0, 2, 3])
    ),
    r"^supports mask: expected booleans .* use pinned\(nodes\)": lambda: jc.Supports([0, 2, 3]),
    r"^supports mask: expected booleans \[n_node, 3\]": lambda: jc.Supports(np.zeros((3, 2), bool)),
    "^supports mask: has 2 rows": lambda: net(supports=jc.Supports(np.ones((2, 3), bool))),
    r"^supports mask: expected \[n_node, 3\]; no element of the structure has rotations": lambda: (
        net(supports=jc.Supports(np.ones((4, 6), bool)))
    ),
    "^supports: no freedom is fixed": lambda: net(supports=jc.Supports(np.zeros((4, 3), bool))),
    "^supports: masks of 3 and 4 nodes cannot be joined": lambda: (
        jc.Supports(np.ones((3, 3), bool)) + jc.Supports(np.ones((4, 3), bool))
    ),
    "^supports: expected pinned": lambda: Phase(supports=[0]),
    "^pinned nodes: expected integers, got bool; numpy.flatnonzero": lambda: jc.pinned(
        [True, False]
    ),
    r"^pinned nodes\[2\] = 4: .* nodes 0 to 3; .* subtract 1": lambda: net(supports=[1, 3, 4]),
    r"^pinned nodes\[1\] = 7: the structure has nodes 0 to 3": lambda: net(supports=[0, 7]),
    r"^clamped nodes\[1\] = 9: the structure has nodes 0 to 3": lambda: frame(jc.clamped([0, 9])),
    r"^restrained nodes\[0\] = 8: the structure has nodes 0 to 3": lambda: frame(
        HELD + jc.restrained([8], "x")
    ),
    "^supports: node 4 is in a part of 2 nodes .* float away: support it or connect it": lambda: (
        net(FAR, cables([*LINKS, [4, 5]]))
    ),
    "^supports: node 4 is in a part of 2 nodes .* support it or connect it": lambda: analyse(
        Phase(supports=jc.pinned([0, 2])),
        structure=net(FAR, cables([*LINKS, [4, 5]]), (0, 2, 3, 5)),
    ),
    "^along = 'xq': expected some of": lambda: jc.restrained([0], "xq"),
    "^along, about: nothing is held": lambda: jc.restrained([0]),
    r"^axes\[0\]: expected three directions of length 1 at right angles": lambda: jc.restrained(
        [0], "x", axes=[[1.0, 0, 0], [1.0, 1.0, 0], [0, 0, 1.0]]
    ),
    "no direction": lambda: jc.restrained([0], "x", axes=(0.0, 0, 0)),
    "^supports of node 2: held along two sets of directions": lambda: frame(SKEW + OTHER_SKEW),
    "^supports of node 2: held in part along other directions than in the phase before": (
        lambda: analyse(
            Phase(loads=push([2])), Phase(supports=HELD + OTHER_SKEW), structure=frame(SKEW)
        )
    ),
    "no element of the structure has rotations": lambda: net(
        supports=jc.pinned([0, 2]) + jc.restrained([0], about="x")
    ),
    r"^rigid\[0\] = \[3, 4\]: node 3 has no rotation": lambda: frame(n_node=5, rigid=[[3, 4]]),
    r"^rigid\[1\] = \[1, 4\]: node 4 is carried twice": lambda: frame(
        stay=(4, 3), n_node=5, rigid=[[2, 4], [1, 4]]
    ),
    "^supports of node 4: another node carries it": lambda: frame(
        HELD + jc.pinned([4]), stay=(4, 3), n_node=5, rigid=[[2, 4]]
    ),
    # beams and sections
    "^section: missing; a group of beams needs a Section": lambda: jc.Beams([[0, 1]]),
    "^section: missing; a group": lambda: jc.Beams([[0, 1]], section=1e-4),
    "^torsional_stiffness: missing; this section has": lambda: beams(section=ANGLE),
    r"^up: expected shape \(3,\) or \(2, 3\)": lambda: beams(up=[0.0, 1.0]),
    "^up: missing; element 0 leans by 0.115 degrees": lambda: jc.Structure(
        [[0, 0, 0], [0.002, 0, 1.0]], jc.Beams([[0, 1]], section=BOX), jc.clamped([0])
    ),
    "^points = 2: expected an integer from 3 to 1000": lambda: beams(points=2),
    "^points = 1001: expected an integer from 3": lambda: beams(points=1001),
    r"^hinges: expected booleans \[2, 2\]": lambda: beams(hinges=[True, False]),
    r"^hinges: expected booleans \[2, 2\] or \[2, 2, 3\]": lambda: beams(
        hinges=np.zeros((2, 3, 2), bool)
    ),
    r"^hinges\[1\]: both ends are released": lambda: beams(hinges=[[False, False], [True, True]]),
    r"^hinges\[0\]: both ends are released, the element could spin": lambda: beams(
        hinges=np.array([[[True, False, False]] * 2] * 2)
    ),
    "^springs: give hinges, too, True where an end turns": lambda: beams(springs=1e3),
    r"^springs: expected a scalar or shape \(2, 3\) or \(2, 2, 3\), got \(2,\)": lambda: beams(
        hinges=[[True, False]] * 2, springs=[1.0, 2.0]
    ),
    r"^laws\[0\]: the class Elastic is not a law; call it": lambda: jc.Section.disc(
        0.1, jc.Elastic
    ),
    r"^laws\[0\]: float is not a uniaxial law such as Elastic": lambda: jc.Section.disc(0.1, 210e9),
    r"^points: the outline crosses itself: the edge from points\[0\] to points\[1\] crosses that "
    r"from points\[2\] to points\[3\]; name its corners in turn": lambda: polygon(
        [[0, 0], [1, 1], [1, 0], [0, 1]]
    ),
    r"^holes\[0\]: a hole crosses itself: .* holes\[0\]\[0\] to holes\[0\]\[1\]": lambda: polygon(
        SQUARE, [[[0.2, 0.2], [0.6, 0.7], [0.6, 0.2], [0.2, 0.6]]]
    ),
    r"^points: a hole crosses it .*: the edge from points\[1\] to points\[2\] crosses that from "
    r"holes\[0\]\[0\] to holes\[0\]\[1\]": lambda: polygon(
        SQUARE, [[[0.5, 0.5], [1.5, 0.5], [1.5, 0.7], [0.5, 0.7]]]
    ),
    r"^holes\[0\]\[0\] = \[2.0, 2.0\]: outside of the outline": lambda: polygon(
        SQUARE, [[[2, 2], [3, 2], [3, 3]]]
    ),
    "^points: all on one line, which has no area": lambda: polygon(
        [[0, 0], [1, 1], [2, 2], [3, 3]]
    ),
    r"^points\[2\] = \[nan, 1.0\]: must be finite": lambda: polygon([[0, 0], [1, 0], [np.nan, 1]]),
    # loads
    r"^loads\[0\]: int is not a load": lambda: Phase(loads=[3]),
    r"^loads\[0\]: float is not a load; prestress has a name: Phase": lambda: Phase(200.0),
    r"^loads\[0\]: the class SelfWeight is not a load; call it: SelfWeight\(": lambda: Phase(
        loads=jc.SelfWeight
    ),
    r"^loads\[0\]: ndarray is not a load; expected NodalLoads\(nodes, forces\)": lambda: Phase(
        loads=np.ones((4, 3))
    ),
    r"^phases\[0\].loads\[0\]: load nodes\[1\] = 4: .* nodes 0 to 3; .* subtract 1": lambda: loaded(
        push([2, 4])
    ),
    r"^forces: expected shape \(3,\) or \(2, 3\), got \(3, 3\)": lambda: push(
        [1, 2], np.ones((3, 3))
    ),
    r"^forces: expected shape .* got \(2, 2\); give \(x, y, z\)": lambda: push(
        [1, 3], np.ones((2, 2))
    ),
    r"^forces: expected shape .* got \(\); give \(x, y, z\) for all nodes": lambda: push(
        [1], -15.0
    ),
    r"^moments: expected shape \(3,\) or \(1, 3\)": lambda: push([1], UP, moments=(0, 1.0)),
    "moments: node 1 has no rotation": lambda: loaded(push([1], UP, UP)),
    "moments: node 3 has no rotation": lambda: framed(push([3], UP, UP)),
    "SelfWeight: no element group has": lambda: loaded(jc.SelfWeight()),
    r"^direction: expected shape \(3,\) such as \(0, 0, -1\), got \(\)": lambda: jc.SelfWeight(
        -9.81
    ),
    r"^direction: expected shape \(3,\).* got \(2,\)": lambda: jc.SelfWeight((0, -1)),
    "SelfWeight: on = 'net': no such group has a weight": lambda: loaded(
        jc.SelfWeight(on="net"), structure=net(elements=TWO)
    ),
    "on = 'three': no such key": lambda: jc.SelfWeight(on="three").check(net(elements=TWO)),
    "on = None means 2 groups": lambda: jc.SelfWeight(elements=jc.only([0])).check(
        net(elements=TWO)
    ),
    "^elements: expected a selection.*got Only": lambda: jc.SelfWeight(elements=jc.only([0], 1.0)),
    "^elements: expected a selection such as only": lambda: jc.LineLoads(UP, elements=[0]),
    r"elements\[0\] = 2: the group has elements 0 to 1": lambda: jc.LineLoads(
        UP, on="net", elements=jc.only([2])
    ).check(net(elements=TWO)),
    r"^forces: expected shape \(3,\), got \(2,\)": lambda: jc.LineLoads((0, 1.0)),
    "on = 'mast': no such key in the structure's elements": lambda: framed(
        jc.LineLoads(UP, on="mast")
    ),
    "^per = 'current': expected one of": lambda: jc.LineLoads(UP, per="current"),
    "^per = 'x'": lambda: jc.AreaLoads([[0, 1, 2]], UP, per="x"),
    r"^forces: expected shape \(3,\) or \(1, 3\), got \(\)": lambda: jc.AreaLoads([[0, 1, 2]], 1.0),
    r"^phases\[0\].loads\[0\]: faces\[0\] = \[1, 2, 4\]: .* subtract 1": lambda: loaded(
        jc.AreaLoads([[1, 2, 4]], UP)
    ),
    r"^faces: expected node numbers \[n, 3\]": lambda: jc.FacePressure([[0, 1]], 1.0),
    r"^faces\[1\] = \[0, 1, 0\]: a face has at least 3": lambda: jc.FacePressure(
        [[0, 1, 2], [0, 1, 0]], 1.0
    ),
    r"faces\[0\] = \[0, 1, 9\]: the structure has nodes 0 to 3": lambda: loaded(
        jc.FacePressure([[0, 1, 9]], 1.0)
    ),
    r"^axis: expected shape \(3,\)": lambda: jc.CablePressure(1.0, (0, 0)),
    "^per = 'initial': expected one of": lambda: jc.CablePressure(1.0, AXIS, per="initial"),
    "on = 'x': no such key": lambda: framed(jc.CablePressure(1.0, AXIS, on="x")),
    r"pressure: expected a scalar or shape \(2,\)": lambda: framed(
        jc.CablePressure(np.ones(3), AXIS, on="beam")
    ),
    "only cables and bars of two nodes, and beams": lambda: loaded(
        jc.CablePressure(1.0, AXIS),
        structure=net(elements=jc.Catenaries(LINKS, axial_stiffness=1e5)),
    ),
    "not with loads that follow": lambda: analyse(
        Phase(loads=jc.CablePressure(1.0, AXIS)), method=jc.Incremental(stiffness="secant")
    ),
    r"\(Beams\) has no secant stiffness": lambda: analyse(
        Phase(loads=jc.LineLoads(UP)), structure=frame(), method=jc.Incremental(0, "secant")
    ),
    r"moved nodes\[0\] = 7: the structure has nodes 0 to 3": lambda: loaded(
        jc.SupportMovement([7], UP)
    ),
    r"displacements\[1\]: node 1 is free along z; only what is held can be moved": lambda: loaded(
        jc.SupportMovement([0, 1], UP)
    ),
    r"^displacements: expected shape \(3,\) or \(2, 3\)": lambda: jc.SupportMovement(
        [0, 3], np.zeros((3, 3))
    ),
    r"rotations\[0\]: node 0 is not clamped": lambda: framed(
        jc.SupportMovement([0], None, rotations=(0, 0.1, 0)),
        supports=jc.pinned([0, 2, 3]) + jc.restrained([0], about="x"),
    ),
    "rotations: node 3 has no rotation": lambda: framed(
        jc.SupportMovement([3], None, rotations=(0, 0.1, 0))
    ),
    # faces of nets
    "^border = 'hull': expected None, 'ends' or 'links'": lambda: jc.net_faces(
        PLAN, ROUND, border="hull"
    ),
    "they enclose no mesh": lambda: jc.net_faces(NODES, LINKS[:2]),
    r"free end 0 to 6 would cross \[1, 2\]": lambda: jc.net_faces(
        SPIRAL, [[k, k + 1] for k in range(6)], border="ends"
    ),
    "links: some cross in plan": lambda: jc.net_faces(PLAN, [*ROUND, [0, 2], [1, 3]]),
    "^largest = 5: expected 3 or 4 corners": lambda: jc.net_faces(PLAN, ROUND, largest=5),
    r"^links\[4\] = \[1, 5\]: .* nodes 0 to 3": lambda: jc.net_faces(PLAN, [*ROUND, [1, 5]]),
    r"^links: expected shape \[n, 2\], got \(4,\)": lambda: jc.net_faces(PLAN, [0, 1, 2, 3]),
    "^links: expected integers, got float64$": lambda: jc.net_faces(PLAN, [[0.0, 1.0]]),
    r"^links\[0\] = .* node numbers start at 0": lambda: jc.net_faces(PLAN, [[0, -1]]),
    # combinations
    r"shape \[n_combination, 2\]": lambda: jc.combine([push(), push()], [[1.0, 2.0, 3.0]]),
    "at least one load case": lambda: jc.combine([], [[]]),
    r"^cases\[0\]: float is not a load": lambda: jc.combine([3.0], [1.0]),
    # phases
    "^increments = 0: a phase has at least 1 increment": lambda: Phase(increments=0),
    "^increments = 1.5: expected an integer": lambda: Phase(increments=1.5),
    "^increments = a traced number: expected an integer; .* vmap .* cannot vary it": lambda: (
        jax.vmap(lambda n: Phase(increments=n).increments)(np.arange(1, 3))
    ),
    r"^phases\[0\].pretension, rest_length: both state the prestress of elements;": lambda: stated(
        pretension=1.0, rest_length=1.0
    ),
    r"^phases\[0\].jacking: elements has": lambda: stated(jacking=1.0, shortening=0.1),
    r"^phases\[0\].pretension\[1\] = -10.0: .* tension only; must not be negative \(use Bars": (
        lambda: stated(pretension=[10.0, -10.0, 10.0])
    ),
    r"^phases\[0\].pretension\[0\] = -1.0: .* tension only; .* in elements\['net'\]": lambda: (
        stated(TWO, pretension={"net": -1.0, "tie": 5.0})
    ),
    r"^phases\[0\].pretension: expected a scalar or shape \(3,\)": lambda: stated(
        pretension=[1.0, 2]
    ),
    r"^phases\[0\].pretension: expected .* shape \(2,\), .* shape \(3,\); in elements\['net'": (
        lambda: stated(TWO, pretension={"net": [1.0, 1, 1], "tie": None})
    ),
    r"^phases\[0\].pretension: expected one number": lambda: stated(pretension={"net": 1.0}),
    r"^phases\[0\].pretension: no group 'nets' .* are 'net', 'tie'; did you mean 'net'\?": (
        lambda: stated(TWO, pretension={"nets": 1.0, "tie": None})
    ),
    r"^phases\[0\].temperature: the group has no expansion": lambda: stated(temperature=10.0),
    r"pretension\[0\] = 1000000000.0: above what its law can carry; .* within the curve": (
        lambda: analyse(
            Phase(pretension={"beam": 1e9, "stay": None}),
            structure=frame(group=beams(section=YIELDING)),
        )
    ),
    # solve
    "^structure: expected a Structure, got ndarray": lambda: jc.solve(NODES, []),
    r"^structure: got a scene; unpack it: solve\(\*scene\)": lambda: jc.solve(jc.scenes.flat_net()),
    "^phases: an analysis needs at least one": lambda: jc.solve(net(), []),
    r"^phases: missing; give a list such as \[Phase\(pretension=": lambda: jc.solve(net()),
    r"^phases: missing; give a list such as \[Phase": lambda: jc.trace_path(net()),
    r"^phases: expected a list of Phase, got NodalLoads; loads go into a phase: \[Phase\(loads": (
        lambda: jc.solve(net(), push())
    ),
    r"^phases\[0\]: expected a Phase, got NodalLoads; loads go into a phase: Phase\(loads": (
        lambda: jc.solve(net(), [push()])
    ),
    r"^phases\[0\]: expected a Phase, got int": lambda: jc.solve(net(), [1]),
    r"^phases\[0\]: expected a Phase, got the class Phase itself; call it, as in Phase\(": (
        lambda: jc.solve(net(), [Phase])
    ),
    r"^method: .* got Phase; phases go into one list: solve\(structure, \[first, second\]\)": (
        lambda: jc.solve(net(), Phase(pretension=1.0), PUSHED)
    ),
    r"^method: .* got the class Newton itself; call it, as in Newton\(\)": lambda: jc.solve(
        net(), [PUSHED], jc.Newton
    ),
    "^method: expected Newton": lambda: jc.solve(net(), [PUSHED], "newton"),
    "^start: expected a Solution": lambda: jc.solve(net(), [PUSHED], start=1),
    "^corrections = -1: expected an integer >= 0": lambda: jc.Incremental(-1),
    "^stiffness = 'x': expected": lambda: jc.Incremental(stiffness="x"),
    "^linear_solver = 'lu'": lambda: jc.Newton(linear_solver="lu"),
    # results
    "^code: got a Design; give its status": lambda: jc.describe(design.Design(*[0] * 9)),
    r"^code: expected one code, got shape \(2,\); take one": lambda: jc.describe(np.zeros(2, int)),
    r"^raise_if_failed: expected a solution, got int; .* describe\(code\)": (
        lambda: jc.raise_if_failed(0)
    ),
    "the solution is being traced": lambda: traced(jc.raise_if_failed, solution()),
    "^phases: 1 of them, the solution has 2": lambda: jc.energy_balance(
        HUNG, PHASES[:1], solution()
    ),
    r"^phases\[1\]: 3 increments, in the solution 1": lambda: jc.energy_balance(
        HUNG, [PHASES[0], jc.replace(PHASES[1], increments=3)], solution()
    ),
    "^solution: is a batch": lambda: jc.energy_balance(HUNG, PHASES, twice(solution())),
    "^energy: the balance needs the phases": lambda: jc.report(HUNG, solution(), energy=True),
    # design
    "^loss: expected a scalar float, .* got None; it needs a return": lambda: jc.minimize(
        lambda T: None, np.ones(2)
    ),
    r"^loss: expected a scalar float, or \(scalar, solution\), got a Design first": (
        lambda: jc.minimize(lambda T: (design.Design(*[0] * 9), T.sum()), np.ones(2))
    ),
    r"^bounds: expected \(lower, upper\), .* not one pair for each parameter": lambda: jc.minimize(
        lambda T: T.sum(), np.ones(3), bounds=[(0.0, 4.0)] * 3
    ),
    "^scale = nan: must be positive and finite": lambda: jc.minimize(
        lambda x: jnp.sum(x**2), jnp.ones(2), scale=np.nan
    ),
    "^residuals: expected floats, or .floats, solution., got a Solution": lambda: jc.fit(
        lambda p: solution(), jnp.ones(2)
    ),
    "^rounds = 0: expected a whole number": lambda: design.minimize_subject_to(
        lambda p: (p @ p, p), jnp.ones(2), rounds=0
    ),
    "^of: expected the name of a result or a function, got int": lambda: Target(3),
    "^within: expected a scalar": lambda: Target("tension", within=[1.0]),
    r"^targets\[1\]: of = 'tension': there are several groups": lambda: aimed(
        Target("tension", 1.0)
    ),
    "on = 'nett': not a group.*mean 'net'": lambda: aimed(Target("tension", on="nett")),
    "on = 'net': the result of = 'positions' is not": lambda: aimed(Target("positions", on="net")),
    "of = 'tensions': a phase has no such.*mean 'tension'": lambda: aimed(Target("tensions")),
    "of = 'status': a phase has no such result": lambda: aimed(Target("status")),
    "of = 'section_forces': this structure has no such": lambda: aimed(Target("section_forces")),
    "value: has 3 numbers, but 2 numbers": lambda: aimed(Target("tension", [1.0, 2, 3], on="net")),
    "value: has 4 numbers, but 1 num": lambda: aimed(Target("positions", np.eye(2), at=(1, 2))),
    r"at: index 5 is out of bounds.*shape \[2\]": lambda: aimed(Target("tension", on="net", at=5)),
    "at: means no number": lambda: aimed(Target("tension", on="net", at=np.zeros(2, bool))),
    "of: expected an array of floats, got str": lambda: aimed(Target(lambda result: "a")),
    "of: expected an array of floats, got int32": lambda: aimed(
        Target(lambda result: result.status)
    ),
    r"^targets\[0\]: of = 'tension': there are several groups": lambda: tuned(
        [PAIR], Target("tension", 500.0)
    ),
    r"^unknowns\[1\] = \(0, 'pretension'\): is there twice": lambda: tuned(
        [PAIR, PAIR], Target("tension")
    ),
    "not a statement; .* did you mean 'pretension'": lambda: tuned(
        [(0, "pretensions")], Target("tension")
    ),
    "^unknowns: expected a list of pairs": lambda: tuned(5, Target("tension")),
    "^targets: expected a list of Target, got int": lambda: tuned([PAIR], 5),
    "^of = 'tensions': .*did you mean 'tension'": lambda: jc.influence(HUNG, PHASES, of="tensions"),
    "^wrt = 'shortenings': .*did you mean 'shortening'": lambda: jc.influence(
        HUNG, PHASES, wrt="shortenings"
    ),
    "^phase = 0.5: there are phases 0 to 1": lambda: jc.influence(HUNG, PHASES, phase=0.5),
    r"^jacobian: has shape \[2, 2\], which is not one by 3 inputs": lambda: design.adjustment(
        jnp.eye(2), jnp.ones(3)
    ),
    r"^tolerance: expected shape \(2,\), that of the inputs, got \(3,\)": lambda: design.scatter(
        jnp.eye(2), jnp.ones(3)
    ),
    "^fit: expected the result of fit, got int": lambda: design.confidence(3),
    r"^fit: a batch of shape \(2,\)": lambda: design.confidence(twice(a_fit())),
    "^deviation = 0.0: must be posi": lambda: design.confidence(a_fit(), deviation=0.0),
    "^phase = 7: there are phases 0 to 1": lambda: design.largest_deflection(
        solution(), 1e-3, phase=7
    ),
    r"^nodes\[0\] = 9: the structure has nodes 0 to 3": lambda: design.shape_distance(
        solution(), np.zeros((1, 3)), nodes=[9]
    ),
    r"^positions: expected shape \(1, 3\), one per node, got \(2, 3\)": lambda: (
        design.shape_distance(solution(), np.zeros((2, 3)), nodes=[1])
    ),
    r"^tension\['net'\]: expected a number or shape \(2,\), one value per element": (
        lambda: design.tension_distance(solution(), {"net": np.ones(3), "mast": 1.0})
    ),
    "^tension: expected a number, or the shape of the elements": lambda: design.tension_distance(
        solution(), {"nett": 1.0, "mast": 1.0}
    ),
    "^values: expected arrays with the cases": lambda: design.envelope(3.0),
    "^tension: group 1 has 2 elements": lambda: design.utilisation(
        HUNG, {"net": np.ones(3), "mast": np.ones(1)}
    ),
    "^tension: has 1 arrays, the structure 2 groups": lambda: design.utilisation(HUNG, np.ones(2)),
    "^structure: expected a Structure, got int": lambda: design.utilisation(3, 1.0),
    "^solution: is of another structure": lambda: design.slack_distance(net(), solution()),
    "^distance: expected a function, got int": lambda: design.nearest_kink(
        3, jnp.ones(2), jnp.ones(2)
    ),
    r"^direction: expected a scalar or shape \(2,\), got \(3,\)": lambda: design.nearest_kink(
        lambda x: x, jnp.ones(2), jnp.ones(3)
    ),
}

SUSPICIOUS = {
    # units
    r"^pretension\[1\] = 200: a strain of 204 %, and steel breaks .* stiffness and forces in N": (
        lambda: stated(cables(axial_stiffness=98.0), pretension=[0.0, 200.0, 0.0])
    ),
    r"^pretension\[0\] = 200: a strain of 952 %, .* moduli in Pa": lambda: stated(
        jc.Cables(LINKS, area=1e-4, law=jc.Elastic(210e3)), pretension=200.0
    ),
    r"^force_density\[0\] = 200: a strain of 204 %": lambda: stated(
        cables(axial_stiffness=98.0), force_density=200.0
    ),
    r"^loads of phases\[0\]: 1 N on node 1, .* 1.5 N together: strained by 66.7 % .* in N": (
        lambda: stated(cables(axial_stiffness=0.5), loads=push())
    ),
    r"^loads of phases\[1\]: 1 N on node 1": lambda: analyse(
        Phase(pretension=0.01), PUSHED, structure=net(elements=cables(axial_stiffness=0.5))
    ),
    r"^prestrain\[2\] = 0.2: a strain of 20 %, .* a ratio, not a percentage": lambda: stated(
        prestrain=jc.only([2], 0.2)
    ),
    r"^strain\[2\] = 5: more than 1; it is a ratio, not a percentage": lambda: jc.Polygonal(
        [0, 0.2, 5.0], [0, 4e8, 5e8]
    ),
    r"^strain\[2\] = 5e\+08: more than 1": lambda: jc.Polygonal([0, 4e8, 5e8], [0, 0.002, 0.05]),
    r"^rest_length\[1\] = 999: its nodes are 1 m apart; is it in m": lambda: stated(
        rest_length=[1.0, 999.0, 1.0]
    ),
    r"^elements\['net'\].rest_length\[0\] = 0.999: its nodes are 1e\+03 m apart; is it in m": (
        lambda: net(1e3 * NODES, {"net": cables(rest_length=0.999)})
    ),
    r"^elements.area\[1\] = 314: thicker than the element is long; is it in m2": lambda: net(
        elements=jc.Cables(LINKS, area=[1e-4, 314.0, 1e-4], law=STEEL)
    ),
    r"^elements\['mast'\].section: fibres 180 m apart, further than all nodes; is it in m": (
        lambda: net(
            elements={"mast": jc.Beams(LINKS, section=jc.Section.rectangle(100.0, 200.0, STEEL))}
        )
    ),
    r"^temperature\[0\] = 30: a strain of 3.6e\+04 %, .* is expansion in 1/K": lambda: stated(
        cables(expansion=12.0), temperature=30.0
    ),
    r"^pretension\['net'\]\[1\] = 10: more than the strength of the element": lambda: stated(
        {"net": cables(strength=[20.0, 5.0, 20.0])}, pretension=10.0
    ),
    # what acts on nothing
    r"^loads of phases\[0\]: all of them act on supports \(node 2\) .* look at the numbers": (
        lambda: loaded(push([2, 3]))
    ),
    r"^supports of phases\[0\]: every node is held, .* names the anchors only": lambda: analyse(
        Phase(pretension=1.0), structure=net(supports=range(4))
    ),
    r"^nodes\[4\]: at the place of nodes\[1\] and not joined to it; .* one number in links": (
        lambda: net(NODES[[0, 1, 2, 3, 1]], cables([[0, 1], [4, 2], [1, 3]]))
    ),
}

ODD = {
    "loads on supports as well": lambda: loaded(push([1, 2])),
    "loads on supports beside prestress": lambda: stated(pretension=1.0, loads=push([2])),
    "no load at all": lambda: loaded(push([2], (0.0, 0, 0))),
    "all held, one moved": lambda: loaded(
        jc.SupportMovement([1], (0.001, 0, 0)), structure=net(supports=range(4))
    ),
    "two anchors at one place": lambda: net(
        NODES[[0, 1, 2, 3, 0]], cables([[0, 1], [1, 2], [4, 3]]), (0, 2, 4)
    ),
    "much slack": lambda: stated(rest_length=50.0),
    "slack by its strain": lambda: stated(prestrain=-0.3),
    "catenaries between anchors": lambda: analyse(
        Phase(), structure=net(elements=jc.Catenaries(LINKS, 1e4, weight=1.0), supports=range(4))
    ),
    "weights between anchors": lambda: loaded(
        jc.SelfWeight(), structure=net(elements=cables(weight=1.0), supports=range(4))
    ),
    "numbers that become a status": lambda: stated(
        pretension=[1.0, np.inf, np.nan], loads=push(force=(np.inf, 0, np.nan))
    ),
    "gravity upwards": lambda: stated(cables(weight=1.0), loads=jc.SelfWeight((0, 0, 9.81))),
    "stiff elements beside soft ones": lambda: stated(
        cables(axial_stiffness=[1e-3, 1e-3, 1e4]), loads=push()
    ),
    "a load that beams bear": lambda: stated(
        {"stay": cables(axial_stiffness=10.0), "beam": jc.Beams([[0, 3], [3, 1]], section=BOX)},
        loads=push([1], (0, 0, -1e4)),
    ),
}
