"""Wrong input and the answer to it, a row a case: what is called, and what the message begins with.

`REFUSED` is surely wrong: a ValueError names argument, index and rule. `SUSPICIOUS` is legal and
most likely not meant: an `InputWarning`. `ODD` is legal and may be meant: silence. All come before
a program is compiled. Numbers that must keep a rule, also while they are traced, are in `rules.py`,
random ones in `banks/mistakes.py`.
"""

import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import optax  # noqa: F401 - of rows

import jaxcable as jc
from jaxcable import design, materials, reliability
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
HALF = [0.0, 0.5, 1.0]
HANGING = jc.Catenaries(LINKS, axial_stiffness=1e4, weight=1.0)
ROPES = {
    "rope": jc.FrictionCables([[0, 1, 3, 2]], axial_stiffness=1e4, friction=0.2),
    "net": jc.Cables(LINKS, axial_stiffness=1e4),
}
SNOW = design.Action("snow", "snow", jc.NodalLoads([1], UP))
DEAD = design.Action("dead", "permanent", jc.NodalLoads([1], UP), in_phases=True)
WARM = design.Action("warm", "temperature", temperature=20.0)
RULE = {"limit state": "ultimate", "permanent": [1.0], "prestress": [1.0]}
STANDARD = reliability.Normal(0.0, 1.0)
TUBE = jc.catalogue.profile_data("CHS 168.3x8")
STEEL_TUBE = {"profile": TUBE, "yield_strength": 235e6}
BREEZE = jc.WindTable(pressures=500.0)
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


def chain(middle):
    """Two cables from (0, 0, 0) over `middle` to (2, 0, 0)."""
    nodes = [[0, 0, 0], middle, [2, 0, 0]]
    analyse(Phase(), structure=net(nodes, cables(LINKS[:2]), (0, 2)))


def stated(elements=None, **phase_input):
    """A phase of the net, or of one of other elements."""
    analyse(Phase(**phase_input), structure=net(elements=elements))


def loaded(*loads, structure=None):
    analyse(Phase(loads=list(loads)), structure=structure)


def polygon(points, holes=None):
    return jc.Section.polygon(points, holes, STEEL, 0.2)


FAR = np.concatenate([NODES, [[9.0, 0, 0], [9.0, 1, 0]]])
TWO = {"net": cables([[0, 1], [1, 2]]), "tie": jc.Bars([[1, 3]], axial_stiffness=1e4)}
PUSHED = Phase(loads=push())
TIED = net(elements=TWO)

# beams 0-1-2 along x, and a stay from their end up to node 3; node 4 is off their end
BEND = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [2.0, 0, 1.0], [2.0, 0, 1.5]])
BOBS = jc.PointMasses([1, 2], 1.0)
BOX = jc.Section.rectangle(0.1, 0.2, STEEL, (1, 2))
NUMBERS = jc.Section.linear(1e8, 1e5, 1e5, 1e4)
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


FRAMED = jc.Structure(
    BEND[:4], {"beams": beams(), "post": jc.Bars([[2, 3]], axial_stiffness=1e4)}, HELD
)
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
HELD_HUNG = jc.replace(HUNG, supports=jc.pinned([0, 1, 2, 3]))
PAIR = (0, "pretension")
SIMPLEX = jc.scenes.simplex().structure
ONE_VERTICAL = jc.replace(
    SIMPLEX, elements={**SIMPLEX.elements, "verticals": jc.Cables([[0, 3]], 1.0)}
)


@functools.cache
def solution():
    with jax.ensure_compile_time_eval():  # a row may ask for it first while it is traced
        found = jc.solve(HUNG, PHASES)
    assert int(found.status) == 0
    return found


def lost(elements, **options):
    return design.loss_of_cable(HUNG, solution(), elements, **options)


def checked(*rules, **options):
    return design.checks(HUNG, solution(), *rules, **options)


def without_mast():
    """The solution as if a phase had removed the mast, whose group is the first one."""
    last = solution().last
    mast, others = last.restart.states
    states = [jc.replace(mast, present=jnp.array([False])), others]
    restart = jc.replace(last.restart, states=states)
    return jc.replace(solution(), last=jc.replace(last, restart=restart))


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


def rows(table):
    """Pairs of a call, as text, and a pattern of its message; ``...`` stands for anything.

    A row begins at the margin: ``call  # message``; what is indented continues it.
    """
    found = []
    for block in re.split(r"\n+(?=\S)", table.strip()):
        if not block.startswith("##"):
            call, message = re.sub(r"\n\s+", " ", block).split(" # ", 1)
            pattern = re.escape(message.replace(" # ", " ")).replace(r"\.\.\.", ".*")
            found.append((call.strip(), pattern if message.startswith("...") else "^" + pattern))
    return found


def run(call):
    """What a row calls, with the names of this module, and of the package without prefixes."""
    names = (
        {name: getattr(jc, name) for name in jc.__all__}
        | vars(reliability)
        | vars(design)
        | globals()
    )
    return eval(call, names)


REFUSED = rows("""
## elements
cables([[0, 1, 2]])  # links: expected shape [n, 2]
cables([[0.0, 1.0]])  # links: expected integers
cables(np.zeros((0, 2), int))  # links: a group needs at least one
cables([[0, 1], [-1, 2]])  # links[1] = [-1  2]: node numbers start at 0
cables([[0, 1], [2, 2]])  # links[1] = [2, 2]: the two ends
cables([[0, 1], [1, 2], [1, 0]])  # links[2] = ...repeats links[0]
traced(lambda v: cables(v).axial_stiffness, np.array([[0, 1]]))  # links: ...indices are topology
cables(axial_stiffness=[1.0, 1])  # axial_stiffness: expected a scalar or shape (3,)
cables(axial_stiffness="stiff")  # axial_stiffness: expected numbers
cables(area=1.0)  # axial_stiffness, area: give either
Cables(LINKS)  # axial_stiffness: missing

## contacts and springs to the ground
Contacts(LINKS, axial_stiffness=1.0, gap=0.1, rest_length=1.0)  # gap: give either gap or rest
Springs([0], [1.0, 2.0])  # stiffness: expected a scalar or shape (3,) or (1, 3), got (2,)
Springs([], 1.0)  # links: a group needs at least one element
Springs([0], 1.0, axes=np.eye(2))  # axes: expected shape (3, 3) or (1, 3, 3), got (2, 2)
GroundContacts([[0, 1]], 1.0)  # links: expected shape [n, 1], got (1, 2)
forms.self_stress(net(elements=Contacts(LINKS, axial_stiffness=1.0)))
    # elements (Contacts) only presses; form finding takes Bars

## laws
Elastic("soft")  # E: expected numbers
Elastic([1.0, 2.0])  # E: expected a scalar ... got shape (2,)
Cables(LINKS, area=1e-4, law=Elastic)
    # law: the class Elastic is not a law; call it with its numbers
Cables(LINKS, area=1.0, law=210e9)  # law: float is not a uniaxial law
Bars([[0, 1]], section=STEEL)  # section: Elastic is not a Section
Polygonal([0.0], [0.0])  # strain: expected shape [n] with n >= 2, got (1,)
Polygonal([0, 1], [0, 1, 2])  # stress: expected shape (2,) as strain, got (3,)
Polygonal([0, 1e-3], ["a", "b"])  # stress: expected numbers
Polygonal([0, 1e-3j], [0, 1e8])  # strain: expected real numbers
Polygonal([[0], [1, 2]], [0, 1e8])  # strain: not a rectangular array
Polygonal([0, 1e-3], [0, 1e8], "memory")  # unloading = 'memory': expected
Polygonal([-2e-3, -1e-3], [-2e8, -1e8])  # strain: goes from -0.002 to -0.001
Polygonal([0, 1e-3, 2e-3], [0, 1e8, 0.5e8], "elastic")
    # stress[1]: elastic unloading needs ... use unloading="reversible"
materials.steel(ultimate_strain=1e-3)  # strain[1] ... must be above strain[0]
materials.steel(hardening=-0.01)  # stress[0]: elastic unloading needs
materials.strand(ultimate_strain=5e-3)  # strain[2] = 0.005: must be above

## nodes and links of a structure
Structure(cables(), NODES, pinned([0]))  # nodes: expected numbers, got Cables
net(NODES[:, :2])  # nodes: expected shape [n_node, 3], got (4, 2); a plane structure has z = 0
net(NODES.T)  # nodes: expected shape [n_node, 3], got (3, 4); transpose
net(NODES[[0, 1, 1, 3]])  # elements.links[1] = [1, 2]: zero length
net(FAR[:5])  # nodes[4]: no element touches this node
net(elements=np.eye(2))  # elements: ndarray is not an element group such as Cables
net(elements={"net": [1.0]})  # elements['net'][0]: float is not an element group
net(elements=cables([[1, 2], [2, 3], [2, 4]]))
    # elements.links[2] = [2, 4]: ... nodes 0 to 3; ... from 1: ... at 0, subtract 1
net(elements=SlidingCables([[1, 2, 3], [2, 4]], axial_stiffness=1.0))
    # elements.links[1] = [2, 4, 4]: ... subtract 1
replace(net(), node=1)  # replace: Structure has no field 'node'
scenes.accuracy_cable(7)  # ...n_elements = 7
scenes.saddle(0, 3)  # n_x, n_y = 0, 3

## supports
Structure(NODES, cables())  # supports: missing; a structure needs supports=pinned(nodes)
Structure(NODES, cables(), [0, 2, 3])
    # supports: expected pinned(nodes) or Supports(mask), got list; write supports=pinned([
Supports([0, 2, 3])  # supports mask: expected booleans ... use pinned(nodes)
net(supports=Supports(np.ones((2, 3), bool)))  # supports mask: has 2 rows
net(supports=Supports(np.ones((4, 6), bool)))
    # supports: hold rotations, but no element of the structure has rotations
net(supports=Supports(np.zeros((4, 3), bool)))  # supports: no node is held
Supports(np.ones((3, 3), bool)) + Supports(np.ones((4, 3), bool))
    # supports: masks of 3 and 4 nodes cannot be added; both must have
Phase(supports=[0])  # supports: expected pinned
pinned([True, False])  # pinned nodes: expected integers, got bool; numpy.flatnonzero
net(supports=[1, 3, 4])  # pinned nodes[2] = 4: ... nodes 0 to 3; ... subtract 1
frame(clamped([0, 9]))  # clamped nodes[1] = 9: the structure has nodes 0 to 3
frame(HELD + restrained([8], "x"))  # restrained nodes[0] = 8: the structure has nodes 0 to 3
net(FAR, cables([*LINKS, [4, 5]]))
    # supports: node 4 is in a part of 2 nodes ... float away: support one of its nodes
analyse(Phase(supports=pinned([0, 2])), structure=net(FAR, cables([*LINKS, [4, 5]]), (0, 2, 3,
        5)))
    # phases[0].supports: node 4 is in a part of 2 nodes ... or connect it
restrained([0], "xq")  # along = 'xq': expected some of
restrained([0])  # along, about: nothing is held
restrained([0], "x", axes=[[1.0, 0, 0], [1.0, 1.0, 0], [0, 0, 1.0]])
    # axes[0]: expected three directions of length 1 at right angles
restrained([0], "x", axes=(0.0, 0, 0))  # ...no direction
frame(SKEW + OTHER_SKEW)  # supports: node 2 is held along two sets of directions
analyse(Phase(loads=push([2])), Phase(supports=HELD + OTHER_SKEW), structure=frame(SKEW))
    # phases[1].supports: node 2 is held along other directions than in phases[0]; put a phase
frame(n_node=5, rigid=[[3, 4]])  # rigid[0] = [3, 4]: node 3 has no rotation
frame(stay=(4, 3), n_node=5, rigid=[[2, 4], [1, 4]])  # rigid[1] = [1, 4]: node 4 is carried twice
frame(HELD + pinned([4]), stay=(4, 3), n_node=5, rigid=[[2, 4]])
    # supports: node 4 is carried by another node

## beams and sections
Beams([[0, 1]])  # section: missing; a group of beams needs a Section
Beams([[0, 1]], "HEA 200")  # section = 'HEA 200': expected a Section; ... catalogue.profile(
Beams([[0, 1]], catalogue.profile_data("HEA 200"))
    # section: expected a Section, got ProfileData; make one by its .section(law)
Bars([[0, 1]], section=catalogue.profile_data("HEA 200"))
    # section: expected a Section, got ProfileData; make one by its .section(law)
beams(section=ANGLE)  # torsional_stiffness: missing; this section has
beams(up=[0.0, 1.0])  # up: expected shape (3,) or (2, 3)
Structure([[0, 0, 0], [2e-3, 0, 1.0]], Beams([[0, 1]], section=BOX), clamped([0]))
    # up: missing; element 0 leans by 0.115 degrees
beams(points=2)  # points = 2: expected an integer from 3 to 1000
beams(hinges=[True, False])  # hinges: expected booleans [2, 2] (beams, ends)
beams(hinges=[[False, False], [True, True]])  # hinges[1]: both ends are released
beams(hinges=np.array([[[True, False, False]] * 2] * 2))
    # hinges[0]: both ends are released, the element could spin
beams(springs=1000.0)  # springs: give hinges, too, True where an end turns
beams(hinges=[[True, False]] * 2, springs=[1.0, 2.0])
    # springs: expected a scalar or shape (2, 3) or (2, 2, 3), got (2,)
Section.linear(1e8, 1e5, None, 1e4)  # EIz: missing; a section by its stiffnesses needs
Section.linear([1e8, 1e8], 1e5, 1e5, 1e4)  # EA: expected a scalar, got shape (2,)
NUMBERS.fibre_stress(0.0, 0.0, 0.0)  # fibre_stress: this section is given by its stiffnesses
NUMBERS.interaction()  # interaction: this section is given by its stiffnesses and has no fibres
plots.section(NUMBERS)  # section: is given by its stiffnesses; it has no fibres to draw
Cables([[0, 1]], section=NUMBERS)  # section: its stiffnesses are for Beams; give axial_stiffness
BOX.with_shear([1e6, 1e6])  # GAy: expected a scalar, got shape (2,)
Section.composite([BOX, BOX.with_shear(1e6)])
    # sections[1]: has a shear stiffness, and shear stiffnesses of parts do not add up
sections.shear_coefficient("ring")  # inner: missing; give inner over outer diameter
sections.shear_coefficient("disc", inner=0.5)  # inner: of a ring only
sections.shear_coefficient("box")  # shape = 'box': expected one of
sections.lattice(5, 1.0, 1.0, 1e8, 1e7)  # sides = 5: expected 3 or 4
sections.lattice(4, 1.0, 1.0, 1e8, 1e7, pattern="V")  # pattern = 'V': expected one of
sections.lattice(4, 1.0, 1.0, 1e8, 1e7, pattern="K")  # EA_strut: missing; bracing 'K' needs
Section.disc(0.1, Elastic)  # laws[0]: the class Elastic is not a law; call it
Section.disc(0.1, 210e9)  # laws[0]: float is not a uniaxial law such as Elastic
catalogue.profile("HEA 210", STEEL)  # name = 'HEA 210': is in no table; near it are HEA 220
catalogue.profile("HEA 200", 210e9)  # laws[0]: float is not a uniaxial law such as Elastic
catalogue.profile("HEA 200", STEEL, size=0.0)  # size = 0.0: must be positive and finite
catalogue.profile("CHS 20x10", STEEL)  # name = 'CHS 20x10': the wall is too thick
catalogue.profile("RHS 200x8", STEEL)  # name = 'RHS 200x8': 2 numbers; expected as in
catalogue.profile("SHS 100x5", STEEL, manufacture="welded")  # manufacture = 'welded': expected
catalogue.profile_names("INP")  # family = 'INP': expected one of IPE
catalogue.cable("Galfan 20")
    # name = 'Galfan 20': is in no table; near it are Galfan spiral strand 20
catalogue.cable("Drakke")  # name = 'Drakke': is in no table; near it are Drake
catalogue.cable("Drake", count=0)  # count = 0: expected a whole number
catalogue.cable_names("chain")  # kind = 'chain': expected one of
catalogue.rope("6x36", 0.02)  # construction = '6x36': expected one of
catalogue.rope("6x36 IWRC", -0.02)  # diameter = -0.02: must be positive
catalogue.rope("6x36 IWRC", 0.02, grade=0.0)  # grade = 0: must be positive
catalogue.rope("6x36 IWRC", 20.0)  # diameter = 20: is in m
catalogue.rope("6x36 IWRC", 0.02, grade=1770.0)  # grade = 1770: is in Pa
catalogue.rope("6x36 IWRC", 0.02, layers=2)  # layers: are those of spiral strands
catalogue.rope("spiral strand", 0.02)  # layers = None: expected a whole number
catalogue.rope("spiral strand", 0.02, layers=2, grade=1e9)  # grade: the formulas of a spiral
polygon([[0, 0], [1, 1], [1, 0], [0, 1]])
    # points: the outline crosses itself: the edge from points[0] to points[1] crosses that from
    # points[2] to points[3]; list its corners in order
polygon(SQUARE, [[[0.2, 0.2], [0.6, 0.7], [0.6, 0.2], [0.2, 0.6]]])
    # holes[0]: a hole crosses itself: ... holes[0][0] to holes[0][1]
polygon(SQUARE, [[[0.5, 0.5], [1.5, 0.5], [1.5, 0.7], [0.5, 0.7]]])
    # points: a hole crosses it ...: the edge from points[1] to points[2] crosses that from
    # holes[0][0] to holes[0][1]
Section.disc(0.1, STEEL, (0, 5))  # shape = (0, 5): expected 2 integers
Section.disc([0.1, 0.2], STEEL)  # ...dimension: expected a scalar, got shape (2,)
Section.disc(0.1, STEEL, (2, 2), "hex")  # cells = 'hex': expected one of
Section.ring(0.3, 0.0, STEEL)  # thickness = 0.0: must be positive
Section.ring(0.3, 0.01, STEEL, (1, 2))  # shape = (1, 2): ... at least (1, 3)
Section.rectangle(0.0, 1.0, STEEL)  # width = 0.0: must be positive
Section.rectangle(1.0, 1.0, STEEL, (2.0, 2))  # shape = (2.0, 2): expected 2 integers
Section.i_shape(0.4, 0.2, 0.0, 0.01, STEEL)  # web = 0.0: must be positive
Section.i_shape(0.4, 0.2, 0.01, 0.2, STEEL)  # flange = 0.2: twice is too thick
Section.i_shape(0.4, 0.2, 0.01, 0.01, STEEL, (4, 4))  # shape = (4, 4): ...3 integers
Section.box(0.2, 0.4, 0.1, STEEL)  # thickness = 0.1: twice is too thick
Section.box(0.4, 0.2, 0.01, STEEL, 0.1)  # flange = 0.1: twice is too thick
Section.box(0.4, 0.0, 0.01, STEEL)  # height = 0.0: must be positive
polygon([[0, 0], [1, 1]])  # points: ... n >= 3, got (2, 2)
polygon(SQUARE, [[[0, 0, 0]]])  # holes[0]: expected shape [n, 2]
Section.polygon(SQUARE, None, STEEL, 0.0)  # size = 0.0: must be positive
Section.polygon(SQUARE, None, STEEL, np.inf)  # size = inf: must be finite
traced(lambda p: polygon(p).area, np.array(SQUARE, float))  # points: cannot be traced; use
Section.mesh(SQUARE, [[0, 1]], STEEL)  # cells: expected ... [n_cell, 4], got (1, 2)
Section.mesh(SQUARE, [[0, 1, 2], [0, 2, 4]], STEEL)  # cells[1] = ...4...: there are 4
Section.mesh(SQUARE, [[0, 1, 2.5]], STEEL)  # cells: expected integers, got float64
Section.mesh(PLAN, [[0, 1, 2]], STEEL)  # points: ...[n_point, 2], got (4, 3)
Section.mesh(SQUARE, [[0, 1, 2]], [STEEL, STEEL])  # laws: expected one, or 1, one per cell, got 2
Section.mesh([[0, 0], [1, 0], [2, 0]], [[0, 1, 2]], STEEL)  # area[0] = ...positive
Section.composite([BOX, YIELDING], 1)  # torsion: expected shape (2,)
Section.composite([])  # sections: is empty; a composite needs
sections.bredt_torsion(SQUARE, [0.1, 0.1])  # thickness: ...shape (4,), ... got shape (2,)
sections.bredt_torsion([[0, 0], [1, 1], [2, 2]], 0.1)  # points: all on one straight line
Section([[0.0]], [0.0], [1.0], STEEL)  # y: expected shape [n_fibre]
Section([0.0], [0.0], [1.0], (STEEL, STEEL), (1,))  # counts = (1,): ..., 2 numbers with the sum 1
replace(BOX, own=[[1.0, 1.0]])  # own: expected shape [n_fibre, 3]
YIELDING.interaction(16, 1)  # n_axial = 1: expected at least 2
BOX.interaction()  # interaction: ... no law of it has a rupture strain
ANGLE.torsional_stiffness()  # ...torsional_stiffness: missing
polygon(SQUARE, [[[2, 2], [3, 2], [3, 3]]])  # holes[0][0] = [2.0, 2.0]: outside of the outline
polygon([[0, 0], [1, 1], [2, 2], [3, 3]])
    # points: all on one straight line, which encloses no area
polygon([[0, 0], [1, 0], [np.nan, 1]])  # points[2] = [nan, 1.0]: must be finite

## loads
Phase(loads=[3])  # loads[0]: int is not a load
Phase(200.0)  # loads[0]: float is not a load; prestress has a name: Phase
Phase(loads=SelfWeight)  # loads[0]: the class SelfWeight is not a load; call it: SelfWeight(
Phase(loads=np.ones((4, 3)))  # loads[0]: ndarray is not a load; expected NodalLoads(nodes, forces)
loaded(push([2, 4]))  # phases[0].loads[0]: load nodes[1] = 4: ... nodes 0 to 3; ... subtract 1
push([1, 3], np.ones((2, 2)))  # forces: expected shape ... got (2, 2); give (x, y, z)
push([1], -15.0)  # forces: expected shape ... got (); give (x, y, z) for all nodes
push([1], UP, moments=(0, 1.0))  # moments: expected shape (3,) or (1, 3)
loaded(push([1], UP, UP))  # ...moments: node 1 has no rotation
loaded(SelfWeight())  # ...SelfWeight: no element group has
SelfWeight(-9.81)  # direction: expected shape (3,) such as (0, 0, -1), got ()
loaded(SelfWeight(on="net"), structure=TIED)
    # ...SelfWeight: on = 'net': no such group has a weight
SelfWeight(on="three").check(TIED)  # ...on = 'three': no such key
SelfWeight(elements=only([0])).check(TIED)  # ...on = None means 2 groups
SelfWeight(elements=only([0], 1.0))
    # elements: expected a selection of elements ... without values, got Only
LineLoads(UP, elements=[0])  # elements: expected a selection of elements such as only
LineLoads(UP, on="net", elements=only([2])).check(TIED)
    # elements of elements['net']: elements[0] = 2: the group has elements 0 to 1
LineLoads((0, 1.0))  # forces: expected shape (3,), got (2,)
framed(LineLoads(UP, on="mast"))  # ...on = 'mast': no such key in the structure's elements
loaded(LineLoads(UP, on="soil"), structure=net(elements={"net": cables(), "soil":
        GroundContacts([1], 1e9)}))
    # ...on = 'soil': elements['soil'] (GroundContacts) has no length to load; loads per length act
LineLoads([UP, UP], factor=[1.0])  # factor: expected a scalar or shape (2,), got (1,)
loaded(LineLoads([UP, UP]))  # ...forces: has values for 2 elements; elements has 3
loaded(LineLoads(UP, factor=[1.0, 2.0], elements=only([1])))
    # ...factor: has values for 2 elements; elements has 1 chosen of 3
loaded(LineLoads(UP, factor=[1.0, 2.0]), structure=TIED)
    # ...factor: has a value for each element, but on = None means 2 groups
PointLoads([-1], 0.5, UP)  # elements[0] = -1: element numbers start at 0
PointLoads([0], [0.5, 0.6], UP)  # places: expected a scalar or shape (1,), got (2,)
PointLoads([0], 0.5, 1.0)  # forces: expected shape (3,) or (1, 3), got ()
framed(PointLoads([9], 0.5, UP))  # ...elements[0] = 9: elements['beam'] has elements 0 to 1
framed(PointLoads([0], 0.5, UP, on="mast"))  # ...on = 'mast': no such key
loaded(PointLoads([0], 0.5, UP))  # ...on = None means 0 groups of beams
loaded(PointLoads([0], 0.5, UP, on="net"), structure=TIED)
    # ...on = 'net': elements['net'] (Cables) takes no loads within its elements; give it a node
loads.Train([], 0.0, UP)  # path: expected at least one element
loads.Train([1, 1], 0.0, UP)  # path: element 1 is twice
loads.Train([0], [0.0], UP)  # position: expected a scalar, got shape (1,)
loads.Train([0], 0.0, [UP], spacings=[1.0])  # forces: expected shape (3,) or (2, 3), got (1, 3)
framed(loads.Train([9], 0.0, UP))  # ...path[0] = 9: elements['beam'] has elements 0 to 1
loads.Crowd([0], UP, [0.0], [1.0, 2.0])  # end: expected shape (1,), got (2,)
influence_line(net(), Phase(), [0], "tension", breaks=[0.0, 1.0])
    # on = None means 0 groups of beams
influence_line(frame(), Phase(), [0], "tension", breaks=[0.0, 0.5])  # breaks: must increase
moving_load(net(), Phase(), Loads([1], UP), [1.0])  # train: expected loads.Train
LineLoads(UP, per="current")  # per = 'current': expected one of
WindLoads(UP, 500.0, 1.2, 0.1)  # profile: expected a wind profile such as ... got float
WindLoads(UP, WindTable, 1.2, 0.1)
    # ...got the class WindTable itself; call it, as in WindTable(pressures=500.0)
WindLoads((1, 0), BREEZE, 1.2, 0.1)  # direction: expected shape (3,), got (2,)
WindLoads(UP, BREEZE, np.ones((2, 2)), 0.1)  # drag: expected a scalar or shape [n_elem], got (2, 2)
WindLoads(UP, BREEZE, [1.0, 1.2], [0.1] * 3)
    # drag, diameter: have different numbers of elements: drag [2], diameter [3]
WindLoads(UP, BREEZE, 1.2, 0.1, ground=[0.0])  # ground: expected a scalar
WindLoads(UP, BREEZE, 1.2, 0.1, geometry="current")  # geometry = 'current': expected one of
WindLoads(UP, BREEZE, 1.2, 0.1, elements=[0])  # elements: expected a selection of elem
loaded(WindLoads(UP, BREEZE, 1.2, 0.1, factor=[1.0, 1.2]))
    # ...factor: expected shape (3,), got (2,); elements has 3 elements
WindTable([1.0, 2.0])  # velocities, pressures: give one of them
WindTable(5.0, 1.0)  # heights: expected shape [n], got ()
WindTable([1.0, 2.0], [1.0])  # velocities: expected shape (2,), got (1,)
WindTable(pressures=[1.0])  # pressures: expected a scalar, got shape (1,)
WindPowerLaw([1.0], 0.2)  # velocity: expected a scalar, got shape (1,)
EurocodeWind(25.0)  # terrain: give a category such as "II", or both roughness_length and
EurocodeWind(25.0, "VI")  # terrain = 'VI': expected one of 0, I, II, III, IV
EurocodeWind(25.0, "II", "gust")  # pressure = 'gust': expected one of peak, mean
IceLoads(np.ones((1, 1)), 0.1)  # thickness: expected a scalar or shape [n_elem], got (1, 1)
IceLoads(0.1, 0.1, [900.0])  # density: expected a scalar
framed(IceLoads([0.1] * 3, 0.1, on="beam"))
    # ...thickness: expected shape (2,), got (3,); elements['beam'] has 2 elements
IceLoads(0.1, 0.1, direction=-1.0)  # direction: expected shape (3,), got ()
PointMasses([1, 2], [1.0])  # masses: expected a scalar or shape (2,), got (1,)
PointMasses([1], 1.0, -1.0)  # direction: expected shape (3,), got ()
loaded(PointMasses([4], 1.0))
    # phases[0].loads[0]: load nodes[0] = 4: the structure has nodes 0 to 3; ... subtract 1
AreaLoads([[0, 1, 2]], UP, per="x")  # per = 'x'
AreaLoads([[0, 1, 2]], 1.0)  # forces: expected shape (3,) or (1, 3), got ()
loaded(AreaLoads([[1, 2, 4]], UP))  # phases[0].loads[0]: faces[0] = [1, 2, 4]: ... subtract 1
AreaLoads([[0, 1, 2]])  # forces: missing; give AreaLoads(forces=
AreaLoads(forces=(1.0, 2.0))  # forces: expected shape (3,) or (2, 3), got (2,)
AreaLoads([[0, 1, 2]], UP, elements=only([0]))  # faces, elements: both are given
AreaLoads(forces=UP, on="net", elements=[0])  # elements: expected a selection of elem
framed(AreaLoads(forces=UP, on="beam"))  # ...on = 'beam': elements['beam'] (Beams) has no faces
loaded(FacePressure(pressure=1.0))  # ...faces: missing: elements (Cables) has no faces; give
FacePressure([[0, 1, 2]], 1.0, on="net")  # faces, on: both are given
FacePressure([[0, 1]], 1.0)  # faces: expected node numbers [n, 3]
FacePressure([[0, 1, 2], [0, 1, 0]], 1.0)  # faces[1] = [0, 1, 0]: a face has at least 3
loaded(FacePressure([[0, 1, 9]], 1.0))  # ...faces[0] = [0, 1, 9]: the structure has nodes 0 to 3
CablePressure(1.0, (0, 0))  # axis: expected shape (3,)
CablePressure(1.0, AXIS, per="initial")  # per = 'initial': expected one of
framed(CablePressure(np.ones(3), AXIS, on="beam"))  # ...pressure: expected a scalar or shape (2,)
loaded(CablePressure(1.0, AXIS), structure=net(elements=Catenaries(LINKS,
        axial_stiffness=1e5)))
    # ...only cables and bars of two nodes, and beams
analyse(Phase(loads=CablePressure(1.0, AXIS)), method=Incremental(stiffness="secant"))
    # stiffness = "secant" cannot be used with follower loads (phases[0].loads[0]); use
analyse(Phase(loads=LineLoads(UP)), structure=frame(), method=Incremental(0, "secant"))
    # ...(Beams) has no secant stiffness
loaded(SupportMovement([7], UP))  # ...moved nodes[0] = 7: the structure has nodes 0 to 3
loaded(SupportMovement([0, 1], UP))
    # ...displacements[1]: node 1 is free along z; only what is held can be moved
SupportMovement([0, 3], np.zeros((3, 3)))  # displacements: expected shape (3,) or (2, 3)
framed(SupportMovement([0], None, rotations=(0, 0.1, 0)), supports=pinned([0, 2, 3]) +
        restrained([0], about="x"))
    # ...rotations[0]: node 0 is not clamped
framed(SupportMovement([3], None, rotations=(0, 0.1, 0)))  # ...rotations: node 3 has no rotation
Varying([push()], HALF, HALF)  # load: expected one load without an amplitude, got list
Varying(push(), [0.0], [1.0])  # parameters: expected shape [n] with n >= 2, got (1,)
Varying(push(), HALF, [0.0, 1.0])  # factors: expected shape (3,), got (2,)
loaded(Varying(SupportMovement([1], UP), HALF, HALF))
    # phases[0].loads[0]: displacements[0]: node 1 is free along z
trace_path(net(), [Phase(loads=[push(), Varying(push(), HALF, HALF)])])
    # phases[0].loads[1]: has an amplitude; the path of the last phase is

## faces of nets
net_faces(PLAN, ROUND, border="hull")  # border = 'hull': expected None, 'ends' or 'links'
net_faces(NODES, LINKS[:2])  # ...they enclose no mesh
net_faces(SPIRAL, [[k, k + 1] for k in range(6)], border="ends")
    # ...free end 0 to 6 would cross link [1, 2]; add links
net_faces(PLAN, [*ROUND, [0, 2], [1, 3]])  # ...links: some cross in plan
net_faces(PLAN, ROUND, largest=5)  # largest = 5: expected 3 or 4 corners
net_faces(PLAN, [*ROUND, [1, 5]])  # links[4] = [1, 5]: ... nodes 0 to 3
net_faces(PLAN, [0, 1, 2, 3])  # links: expected shape [n, 2], got (4,)
net_faces(PLAN, [[0.0, 1.0]])  # links: expected integers, got float64
net_faces(PLAN, [[0, -1]])  # links[0] = ... node numbers start at 0

## combinations
combine([push(), push()], [[1.0, 2.0, 3.0]])  # ...shape [n_combination, 2]
combine([], [[]])  # ...at least one load case
combine([3.0], [1.0])  # cases[0]: float is not a load

## choices of elements
only([7]).element_mask(5, "elements")  # elements: elements[0] = 7...elements 0 to 4
only(np.ones(12, bool)).element_mask(5, "elements")  # elements: ...each of 5 elements, got 12
only([[True, False]])  # elements: ...booleans [n_elem], got shape
only([0, True])  # elements: expected integers, got some booleans among them
only([-1])  # elements[0] = -1: element numbers start at 0
only([1, 1])  # elements: element 1 is named twice
traced(only, jnp.array([0, 1]))  # elements: ...topology and cannot be traced
traced(only, jnp.array([True]))  # elements: ...topology and cannot be traced
solve(net(), Phase(pretension=only([0])))  # phases[0].pretension: only... has no values
find_form(net(), only([0]))  # tension: only... has no values
solve(net(), Phase(shortening=np.ones(3, bool)))  # shortening: expected numbers, got bool
influence(net(), Phase(), wrt=np.ones(3, bool))  # wrt: expected a name such as 'shortening'
NodalLoads(np.ones(3, bool), (0.0, 0.0, 1.0))  # load nodes: expected integers, got bool
cables([[0, True]])  # links: ... booleans among them

## phases
Phase(increments=0)  # increments = 0: a phase has at least 1 increment
Phase(increments=1.5)  # increments = 1.5: expected an integer
jax.vmap(lambda n: Phase(increments=n).increments)(np.arange(1, 3))
    # increments = a traced number: expected an integer; ... vmap ... cannot vary it
stated(pretension=1.0, rest_length=1.0)
    # phases[0].pretension, rest_length: both state the prestress of elements;
stated(jacking=1.0, shortening=0.1)
    # phases[0].jacking, shortening: a jack keeps the force of elements in
stated(horizontal_tension=1.0)
    # phases[0].horizontal_tension: only catenaries have a stated horizontal tension
stated(built_sag=1.0)  # phases[0].built_sag: only catenaries with a weight can have a stated sag
stated(HANGING, built_sag=results.Sag(*7 * [np.ones(3)]))
    # phases[0].built_sag: got a Sag of results.sags; give the `midspan` of it
solve(net(elements={"net": HANGING}), Phase(built_sag={"net": 0.1}, loads=push()))
    # phases[0].built_sag['net']: no load acts along the cables in this phase, and without
solve(net(elements=HANGING), Phase(horizontal_tension=1e-30, loads=SelfWeight()))
    # phases[0].horizontal_tension[0] = 1e-30: the cable would be 2.9e+29 times as long as its
stated(ROPES, clamped={"rope": [1, 0, 0]})
    # phases[0].clamped['rope']: expected one number, or shape (1, 2) or (2,) ... got shape (3,)
stated(ROPES, clamped={"rope": [[1], [0]]})  # phases[0].clamped['rope']: ... got shape (2, 1)
stated(ROPES, clamped={"rope": [1, 0.5]})  # phases[0].clamped['rope'][0, 1] = 0.5: a clamp is open
stated(ROPES, clamped={"net": 1})
    # phases[0].clamped['net']: an input of FrictionCables; this group is made of Cables
stated(clamped=1)  # phases[0].clamped: no group of the structure has an input 'clamped'
Phase(end_tension=1.0, tension_at="top")
    # tension_at = 'top': expected one of lower, upper, first, second
stated(pretension=[10.0, -10.0, 10.0])
    # phases[0].pretension[1] = -10.0: ... tension only; must not be negative (use Bars
stated(TWO, pretension={"net": [1.0, 1, 1], "tie": None})
    # phases[0].pretension['net']: expected ... shape (2,), ... got shape (3,)
stated(pretension={"net": 1.0})  # phases[0].pretension: expected one number
stated(TWO, pretension={"nets": 1.0, "tie": None})
    # phases[0].pretension: no group 'nets' ... are 'net', 'tie'; did you mean 'net'?
stated(temperature=10.0)
    # phases[0].temperature: the group has no coefficient of expansion; give Cables(exp
analyse(Phase(pretension={"beam": 1e9, "stay": None}),
        structure=frame(group=beams(section=YIELDING)))
    # phases[0].pretension['beam'][0] = 1000000000.0: more than the law of the element can

## solve
solve(NODES, [])  # structure: expected a Structure, got ndarray
solve(scenes.flat_net())  # structure: got a scene; unpack it: solve(*scene)
solve(net(), [])  # phases: an analysis needs at least one
solve(net())  # phases: missing; give a list such as [Phase(pretension=
trace_path(net())  # phases: missing; give a list such as [Phase
trace_path(net(), PUSHED, steps=1)  # steps = 1: expected a whole number
trace_path(net(), PUSHED, method=Incremental())  # method: expected Newton, got Incremental
solve(net(), push())
    # phases: expected a list of Phase, got NodalLoads; loads go into a phase: [Phase(loads
solve(net(), [push()])
    # phases[0]: expected a Phase, got NodalLoads; loads go into a phase: Phase(loads
solve(net(), [1])  # phases[0]: expected a Phase, got int
solve(net(), [Phase])
    # phases[0]: expected a Phase, got the class Phase itself; call it, as in Phase(
solve(net(), Phase(pretension=1.0), PUSHED)
    # method: ... got Phase; phases go into one list: solve(structure, [first, second])
solve(net(), [PUSHED], Newton)  # method: ... got the class Newton itself; call it, as in Newton()
solve(net(), [PUSHED], "newton")  # method: expected Newton
solve(net(), [PUSHED], start=1)  # start: expected a Solution
Incremental(-1)  # corrections = -1: expected a whole number >= 0
Incremental(stiffness="x")  # stiffness = 'x': expected
Newton(linear_solver="lu")  # linear_solver = 'lu'

## results
dynamics.modes(HUNG, solution(), masses=np.ones(7))
    # masses: expected a scalar or shape (4,), got (7,); one mass for each node
dynamics.modes(HUNG, solution(), masses=[PointMasses([1], 1.0), 2.0])
    # masses[1]: expected PointMasses, got float
dynamics.modes(HUNG, solution(), n=0)  # n = 0: expected a whole number
dynamics.modes(HUNG, solution())  # masses: no element group has a weight
dynamics.modes(HUNG, solution(), masses=1.0, distribution="even")  # distribution = 'even'
stiffness.flexibility(HUNG, solution(), [99])  # nodes[0] = 99: the structure has nodes
stiffness.flexibility(HUNG, solution(), [1], axes="w")  # axes = 'w'
stiffness.imperfect(HUNG, np.zeros((2, 6, 3)), 0.0)  # shapes: expected [k, 4
stiffness.imperfect(HUNG, np.zeros((2, 4, 3)), [0.1] * 3)  # amplitudes: expected a scalar
stiffness.modes(HUNG, None, n=0)  # n = 0: expected a whole number
stiffness.modes(HUNG, None)  # state: expected a Solution or its .last
stiffness.tangent_stiffness(HUNG, HUNG)  # state: expected a Solution ... got Structure
stiffness.tangent_stiffness(HUNG, solution(), fixed=np.zeros((2, 3), bool))
    # fixed: expected booleans of shape (4, 3), got (2, 3); ... supports.fixed(4)[:, :3]
describe(Design(*[0] * 9))  # code: got a Design; give its status
describe(np.zeros(2, int))  # code: expected one code, got shape (2,); take one
raise_if_failed(0)  # raise_if_failed: expected a solution, got int; describe(code)
raise_if_failed(solution(), ["a"])  # names: expected a name for each case of a batch; ... ()
traced(raise_if_failed, solution())  # ...the solution is being traced
energy_balance(HUNG, PHASES[:1], solution())  # phases: got 1, the solution has 2
energy_balance(HUNG, [PHASES[0], replace(PHASES[1], increments=3)], solution())
    # phases[1]: has 3 increments, in the solution 1
energy_balance(HUNG, PHASES, twice(solution()))  # solution: is a batch
report(HUNG, solution(), energy=True)  # energy: the balance needs the phases
report(HUNG, twice(solution()))  # solution: is a batch
report(HUNG, solution(), cases=twice(solution()), names=["a"])  # names: 1 of them, but 2 cases
report(HUNG, solution(), cases=solution())  # cases: expected a leading axis
report(HUNG, solution(), cases=twice(solution()), names=["a", "a"])  # names: each case
report(HUNG, solution(), cases=twice(solution()), names=["a", "end"])  # names: each case
report(HUNG, solution(), PHASES[:1])  # phases: 1 of them, the solution has 2
report(HUNG, PHASES, solution())  # solution: expected a Solution, got list
report(HELD_HUNG, solution(), PHASES)  # solution: ...supports
energy_balance(HELD_HUNG, PHASES, solution())  # solution: ...supports
## pictures
plots.net(solution(), state=solution().phases[0])  # state: expected a State
plots.net(twice(solution()))  # solution: is a batch
plots.diagram(twice(solution()), structure=HUNG)  # solution: is a batch
plots.increments(twice(solution()))  # solution: is a batch
plots.increments(solution(), tol=0)  # tol = 0: must be positive
plots.increments(solution(), names=["snow"])  # names: 1 of them, but 2 phases
plots.net(solution(), color="stress")  # color = 'stress'
plots.net(solution(), structure=net())  # solution: element groups: one
plots.net(solution(), color="utilization")  # structure: needed for color
plots.net(solution(), color="utilization", structure=HUNG)  # strength: no group has one
plots.net(solution(), axes=True)  # structure: needed for axes
plots.net(solution(), heights=0)  # heights = 0: must be positive
plots.net(solution(), names=["snow"])  # names: 1 of them, but 2 phases
plots.sequence(solution(), names=["snow"])  # names: 1 of them, but 2 phases
plots.sequence(solution(), columns=0)  # columns = 0: expected a whole number
plots.animation(solution(), "net.gif", names=["snow"])  # names: 1 of them, but 2 phases
plots.animation(solution(), "net.mp4")  # ...expected the suffix
plots.animation(solution(), "net.gif", frames=0)  # frames = 0
plots.model(HUNG, view="front")  # view = 'front': expected
plots.diagram(solution(), "Q", structure=HUNG)  # of = 'Q': expected one of N, Vy
plots.diagram(solution(), high=0.0, structure=HUNG)  # high = 0.0: must be
plots.diagram(solution(), structure=HUNG)  # ...has no beams
plots.view(solution(), "net.png")  # path = ....html
plots.view(solution(), None, frames=2.5)  # frames =
plots.view(solution().last, None)  # ...got State; pass the solution
plots.view(solution().phases[1].path, None)  # ...got Path; ...plots.path
plots.view(twice(solution()), None)  # solution: is a batch
plots.convergence([1, 2], [1, 2, 3])  # errors: expected shape (2,)
plots.convergence([1, 0], {"a": [1, 2]})  # sizes['a']: must be positive
plots.convergence([1, 2], [1, -2])  # errors: must not be negative
plots.convergence([1], {})  # errors: expected at least one
plots.work_precision({"a": [1]}, {"b": [1]})  # times: expected the labels
plots.work_precision([-1], [1])  # times: must be positive
plots.history(object())  # design: a object has no history
plots.section(BOX, np.zeros(3))  # stress: expected shape (2,), got (3,)
plots.section(Section([0.0], [0.0], [1.0], STEEL))  # section: has no mesh to draw

results.sags(net(), 0)  # structure: has no catenaries; for the sag of a chain
results.sags(net(), 0, {"x": [0, 1]})  # state: expected a Solution, its .last or one
results.sags(net(), solve(net(), Phase(pretension=1.0)), {"x": [0, 2]})
    # chains['x']: no element joins the nodes 0 and 2
results.sags(net(), 0, [0, 1])  # chains: expected a dict of node numbers by the name of each
results.nodes_along(net(), [0, 2, 1])  # elements: element 1 has the nodes [1, 2]
results.nodes_along(net(), [3])  # elements: no element 3; the group has 3
results.nodes_along(net(), [0], on="net")  # on = 'net': no such key
results.clearance_to_plane(net(), 0, (0, 0))  # point: expected shape (3,), got (2,)
results.clearance_over_ground(net(), 0, [[0.0, 0, 0]])  # profile: expected shape [n, 3] with at
results.distance_to_line(net(), 0, [[0.0, 0], [1.0, 0]])  # points: expected shape [n, 3] with at
results.rotation_vectors(net(), None)  # state: expected a Solution, its .last or one of its
results.node_tilts(net(), None, (0.0, 0.0))  # axis: expected shape (3,), got (2,)
## forms
find_form(1.0, 5.0)  # structure: expected a Structure, got float
find_form(net())  # tension: nothing is prescribed; give tension, stress, force_density or length
find_form(net(), stress=1.0)  # stress: elements has no area; give tension
find_form(net(), 1.0, method=Incremental())  # method: expected Newton, got Incremental
find_form(net(), only([7], 1.0))  # ...elements[0] = 7: the group has elements 0 to 2
find_form(TIED, {"net": only([0], 5.0)})
    # tension: element 1 of elements['net'] has neither tension, stress, force_density nor length
find_form(TIED, 5.0, force_density={"tie": 2.0})
    # tension, force_density: element 0 of elements['tie'] has more than one of them; give one
find_form(TIED, force_density={"net": [1.0, -5.0]})
    # force_density['net'][1] = -5.0: a cable carries tension only
find_form(frame(), {"beam": 5.0})  # elements['beam'] (Beams) is not made of straight elements
find_form(net(), 5.0, Varying(push(), HALF, HALF))  # loads[0]: Varying follows the load
find_form(TIED, {"net": 5.0}, CablePressure(1.0, AXIS, per="unstressed"))
    # loads[0]: CablePressure per "unstressed" length is not known on elements of given force
find_form(net(elements={"all": TWO}), {"all": {"net": 5.0}}, LineLoads(UP, on="all"))
    # loads[0]: on = 'all' means groups with prescribed values and groups without
find_form(frame(), {"stay": 5.0}, SupportMovement([2], UP))  # phases[0].loads[0]: ...
force_density(frame(), 5.0)  # elements['beam'] (Beams) is not made of straight elements
force_density(TIED, {"net": 1.0, "tie": None})
    # q: element 0 of elements['tie'] has no force density
force_density(net(), np.ones(4))  # q: expected a scalar or shape
force_density(1.0, 1.0)  # structure: expected a Structure, got float
force_density(net(), 1.0, None, "lu")  # linear_solver = 'lu'
force_density(net(), 1.0, SelfWeight())  # SelfWeight: no element group has a weight
forms.symmetric_groups(SIMPLEX, 4)  # nodes[...]: its image ... from any node
forms.symmetric_groups(SIMPLEX, 0)  # fold = 0
forms.symmetric_groups(ONE_VERTICAL, 3)  # links: no element of elements['verticals'] joins nodes
forms.self_stress(frame())  # elements['beam'] (Beams) is not made of straight elements
forms.self_stress(replace(SIMPLEX, nodes=SIMPLEX.nodes * np.nan))  # nodes[0] = ...finite
forms.self_stress(replace(SIMPLEX, supports=pinned(range(6))))
    # supports: they hold every degree of freedom
traced(lambda v: forms.self_stress(replace(SIMPLEX, nodes=v)).tensions, SIMPLEX.nodes)
    # self_stress: the nodes are traced by jax
forms.feasible_prestress(SIMPLEX, [0, 1])  # groups: expected
forms.feasible_prestress(SIMPLEX, np.zeros(12))  # groups: expected integers
forms.feasible_prestress(SIMPLEX, np.full(12, -1))  # groups[0] = -1: group numbers start at 0
forms.feasible_prestress(SIMPLEX, 3 * np.eye(12, dtype=int)[0])  # groups: no element is in
forms.feasible_prestress(SIMPLEX, np.arange(12), group=12)  # ...there are groups 0 to 11
forms.dynamic_relaxation(net(supports=restrained([0, 2, 3], "x", axes=(1.0, 1.0, 0))), 5.0)
    # supports: this function takes supports along x, y, z only
forms.dynamic_relaxation(net(), 1.0, only([1], 1.0))
    # tension, rest_length: element 1 of elements has both
forms.dynamic_relaxation(net(), 1.0, start=np.zeros((2, 3)))  # start: expected shape (4, 3), got
forms.dynamic_relaxation(net(), loads=SelfWeight())
    # loads[0]: SelfWeight is not known ... takes NodalLoads

## design
minimize(lambda T: None, np.ones(2))
    # loss: expected a scalar float, ... got None; it needs a return
minimize(lambda T: (Design(*[0] * 9), T.sum()), np.ones(2))
    # loss: expected a scalar float, or (scalar, solution), got a Design first
minimize(lambda T: T.sum(), np.ones(3), bounds=[(0.0, 4.0)] * 3)
    # bounds: expected (lower, upper), ... not one pair for each parameter
minimize(lambda x: jnp.sum(x ** 2), jnp.ones(2), scale=np.nan)
    # scale = nan: must be positive and finite
fit(lambda p: solution(), jnp.ones(2))
    # residuals: expected floats, or (floats, solution), got a Solution
fit(lambda p: p, jnp.ones(2), tol=1.0)  # tol = 1.0: must be at least 0 and below 1
fit(NODES, jnp.ones(2))  # residuals: expected a function
fit(lambda p: jnp.zeros(0), jnp.ones(2))  # residuals: expected arrays of floats
fit(lambda p: p, jnp.ones(2), (jnp.array([-2.0, 2.0]), None))
    # params[1] = 1: the start is below its lower
fit(lambda p: p, jnp.ones(2), steps=0)  # steps = 0
minimize(jnp.sum, jnp.ones(2), optimizer="adam")  # optimizer: expected an optax transformation
minimize(jnp.sum, jnp.ones(2), optimizer=optax.adam)  # optimizer: expected an optax transform
minimize(jnp.sum, jnp.ones(2), (2.0, 1.0))  # lower bound[0] = 2: above the upper bound, 1
minimize(jnp.sum, jnp.ones(2), (None, jnp.array([5.0, 0.5])))
    # params[1] = 1: the start is above its upper bound, 0.5
minimize(jnp.sum, jnp.ones(2), (None, jnp.array([5.0, jnp.nan])))  # upper bound[1]: is NaN
minimize(jnp.sum, jnp.ones(2), 3.0)  # bounds: expected (lower, upper)
minimize(jnp.sum, jnp.ones(2), (jnp.zeros(3), None))  # lower bound: expected a scalar or shape (2,)
minimize(jnp.sum, jnp.ones(2), (None, {"a": 1.0}))
    # upper bound: expected a scalar, an array or a prefix
minimize(jnp.sum, jnp.ones(2), args=jnp.ones(1))  # args: expected a tuple
minimize(jnp.sum, jnp.ones(2), steps=0)  # steps = 0
minimize(jnp.sum, jnp.ones(2), scale=-1.0)  # scale = -1.0: must be positive and finite
minimize(lambda x: x, jnp.ones(2))  # loss: expected a scalar float...float64[2]
minimize(lambda x: (jnp.sum(x), 1.5), jnp.ones(2))  # loss: expected solutions or status codes
minimize(3.0, jnp.ones(2))  # loss: expected a function
minimize(jnp.sum, {})  # params: there are no parameters
minimize(jnp.sum, jnp.zeros(0))  # params: there are no parameters
minimize_subject_to(lambda p: (p @ p, p), jnp.ones(2), solver="cobyla")
    # solver = 'cobyla': expected one of slsqp, trust-constr
minimize_subject_to(lambda p: p[0], jnp.ones(2))  # problem: expected
minimize_subject_to(lambda p: (p, -p), jnp.ones(2))  # loss: expected a scalar float
minimize_subject_to(lambda p: (p[0], p[0]), jnp.ones(2))  # constraints: expected floats [n]
minimize(lambda p: p @ p, jnp.ones(2), tol=np.ones(2))  # tol: expected a scalar, got shape (2,)
minimize_subject_to(lambda p: (p @ p, p), jnp.ones(2), rounds=0)
    # rounds = 0: expected a whole number
Target(3)  # of: expected the name of a result or a function, got int
Target("tension", within=[1.0])  # within: expected a scalar
Target("tension", within=-1.0)  # within = -1.0: must be positive
Target("tension", within=np.inf)  # within = inf: must be positive
Target("tension", within=np.nan)  # within = nan: must be positive
Target("tension", phase=1.0)  # phase = 1.0: expected the number of a phase
Target("tension", "level")  # value: expected numbers
Target("tension", at=0.5)  # at = 0.5: expected an index
Target("tension", at="all")  # at = 'all': expected an index
Target("tension", at=[[0.0, 1.0]])  # at = [[0.0, 1.0]]: expected an index
aimed(Target("tension", 1.0))  # targets[1]: of = 'tension': there are several groups
aimed(Target("tension", on="nett"))  # ...on = 'nett': not a group...mean 'net'
aimed(Target("positions", on="net"))  # ...on = 'net': the result of = 'positions' is not
aimed(Target("tensions"))  # ...of = 'tensions': a phase has no such...mean 'tension'
aimed(Target("status"))  # ...of = 'status': a phase has no such result
aimed(Target("section_forces"))  # ...of = 'section_forces': this structure has no such
aimed(Target("tension", [1.0, 2, 3], on="net"))  # ...value: has 3 numbers, but ... select 2
aimed(Target("positions", np.eye(2), at=(1, 2)))  # ...value: has 4 numbers, but ... select 1
aimed(Target("tension", on="net", at=5))  # ...at: index 5 is out of bounds...shape [2]
aimed(Target("tension", on="net", at=np.zeros(2, bool)))  # ...at: selects no entry
aimed(Target(lambda result: "a"))  # ...of: expected an array of floats, got str
aimed(Target(lambda result: result.status))  # ...of: expected an array of floats, got int32
tuned([PAIR, PAIR], Target("tension"))  # unknowns[1] = (0, 'pretension'): is there twice
tuned([(0, "pretensions")], Target("tension"))  # ...did you mean 'pretension'
tuned(5, Target("tension"))  # unknowns: expected a list of pairs
tuned([], Target("tension"))  # unknowns: none
tuned([PAIR], [])  # targets: there are none
tuned([(7, "pretension")], Target("tension"))  # unknowns[0]: phase 7; there are phases 0 to 1
tuned([(0, "tension")], Target("tension"))
    # unknowns[0] = 'tension': not a prestress input; ...'pretension'
tuned([(0, "shortening")], Target("tension"))  # unknowns[0]: phases[0] has no shortening
tuned(["pretension"], Target("tension"))  # unknowns[0] = 'pretension': expected (phase, prestress
tuned([PAIR], [3.0])  # targets[0]: expected a Target, got float
tuned([PAIR], [Target("tension", phase=3)])  # targets[0].phase = 3: there are
tuned([PAIR], 5)  # targets: expected a list of Target, got int
influence(HUNG, PHASES, of="tensions")  # of = 'tensions': ...did you mean 'tension'
influence(HUNG, PHASES, wrt="shortenings")  # wrt = 'shortenings': ...did you mean 'shortening'
influence(HUNG, PHASES, phase=0.5)  # phase = 0.5: there are phases 0 to 1
influence(HUNG, PHASES, wrt="jacking")  # wrt = 'jacking': no phase states a jacking
influence(HUNG, PHASES, wrt="pretension", phase=1)  # ...phase 1 does not state a pretension
influence(HUNG, PHASES, wrt="temperature", phase=0)  # ...'temperature': no group
influence(HUNG, [])  # phases: there are none, and no start
solve_cases(HUNG, PHASES[0], [PUSHED, Phase(loads=push([1, 1]))])  # cases[1]: differs from cases[0]
solve_cases(HUNG, PHASES[0], [])  # cases: expected at least one
adjustment(jnp.eye(2), jnp.ones(3))  # jacobian: has shape [2, 2], which does not end with 3 inputs
propagate_tolerances(jnp.eye(2), jnp.ones(3))
    # tolerance: expected shape (2,), as the inputs have, got (3,)
propagate_tolerances({"a": jnp.eye(2)}, {"a": jnp.ones(3)})  # tolerance['a']: expected shape (2,)
propagate_tolerances({"a": jnp.eye(2)}, 1e-5)  # tolerance: expected arrays
confidence(3)  # fit: expected the result of fit, got int
confidence(twice(a_fit()))  # fit: a batch of shape (2,)
confidence(a_fit(), level=2)  # level = 2
confidence(fit(lambda p: jnp.log(p - 2.0), jnp.array([1.0])))
    # fit: has failed (the loss or its gradient is not
confidence(a_fit(), deviation=0.0)  # deviation = 0.0: must be posi
largest_deflection(solution(), 1e-3, phase=7)  # phase = 7: there are phases 0 to 1
shape_distance(solution(), np.zeros((1, 3)), nodes=[9])
    # nodes[0] = 9: the structure has nodes 0 to 3
shape_distance(solution(), np.zeros((2, 3)), nodes=[1])
    # positions: expected shape (1, 3), one per node, got (2, 3)
tension_distance(solution(), {"net": np.ones(3), "mast": 1.0})
    # tension['net']: expected a number or shape (2,), one value per element
tension_distance(solution(), {"nett": 1.0, "mast": 1.0})
    # tension: expected a number, or a pytree like the elements
envelope(3.0)  # values: expected arrays with the cases
envelope(HUNG)  # solutions: missing; give envelope(structure, solutions)
envelope(HUNG, solution())  # solutions: expected a Solution with a leading axis
checks(HUNG, push())  # solutions: expected a Solution, got NodalLoads
checked("EN 1993-1-1")  # rules: expected EN 1993-1-11 or ASCE 19 (cables), or a check
checked([5])  # rules[0]: expected EN 1993-1-11 or ASCE 19
checked()  # cable resistance: no group of the structure has cables with a
checked(CableResistance("net"))  # cable resistance: elements of 'net' have no strength
checked(TensionLimit(lower=1.0, elements="nett"))
    # tension that remains: elements = 'nett': no such key
checked(2 * [TensionLimit(lower=1.0)])
    # rules[1]: 'tension that remains' is the name of rules[0], too
checked(TensionLimit(lower=1.0), names=["a", "b"])  # names: expected 1 different ones
checked(ReactionLimit([99], upper=1.0))  # reaction: nodes
TensionLimit()  # tension that remains: lower: missing
TensionLimit(lower=0.0)  # tension that remains: lower = 0.0: expected a positive tension
DisplacementLimit(-0.1)  # displacement: upper = -0.1: expected a positive limit
DisplacementLimit(0.1, direction=(0, 0, 0))  # displacement: direction = (0, 0, 0)
ReactionLimit([0])  # reaction: lower, upper: missing
ReactionLimit([0], lower=2.0, upper=1.0)  # reaction: lower = 2.0: expected below upper
OwnCheck("own", 5)  # function: expected a function, got int
CableResistance(termination="swaged")  # termination = 'swaged': expected one of metal filled
CableResistance(gamma_r=0.0)  # gamma_r = 0.0: must be positive
CableService(fraction="use")  # fraction = 'use': expected one of service
CableFatigue(category="rope")  # category = 'rope': expected one of prestressing bar
MemberSection()  # cross-section: profile, yield_strength: missing
MemberSection(profile={"A": 1.0}, yield_strength=235e6)  # profile: expected a dict with A
MemberSection(profile=5, yield_strength=235e6)  # profile: expected catalogue.profile_data
MemberSection(profile="CHS 168.3x8", yield_strength=235e6)
    # profile = 'CHS 168.3x8': expected catalogue.profile_data('CHS 168.3x8')
MemberSection(**STEEL_TUBE).checked_elements(FRAMED)
    # ...elements: missing; say which of 'beams', 'post'
MemberSection(**STEEL_TUBE, section_class=4)  # section_class = 4: expected 1, 2 or 3
MemberSection(profile=catalogue.profile_data("L 100x100x10"), yield_strength=235e6)
    # profile: L 100x10 is an angle
MemberBuckling(**STEEL_TUBE)  # lengths, factors: give one of them
MemberBuckling(**STEEL_TUBE, lengths=[1.0, 2.0, 3.0])
    # lengths = [1.0, 2.0, 3.0]: expected one number, or two
OwnCheck("own", lambda solution: 0.0)  # own: function: expected two arguments
checked(OwnCheck("own", lambda s, x: "a"))  # own: function: expected numbers, [n_item], got str
checked(combinations=["a"])  # combinations: expected Combinations, got list
checked(combinations=combinations([SNOW]))  # combinations: there are 7 of them, and 1 solutions
checked(ReactionLimit([1], upper=1.0))  # reaction: nodes: node 1 has no support
MemberBuckling(**STEEL_TUBE, lengths=0.0)  # lengths = 0.0: expected positive lengths
MemberBuckling(**STEEL_TUBE, lengths=1.0, curves="e")  # curves = 'e': expected one of a0
checked(OwnCheck("own", lambda s, x: x.displacement))  # own: function: expected [n_item], got shape
Action(" ", "snow", push())  # name = ' ': expected a text that is not empty
Action("snow", 5, push())  # kind = 5: expected a text that is not empty
Action("snow", "snow")  # 'snow' has no loads and no changes
Action("snow", "snow", push(), needs=[5])  # needs = (5,): expected names of actions
Action("lost", "accidental", removes=only([0]))
    # removes: expected booleans [n_elem], by group, and neither names nor only()
loss_of_cable(5, solution(), "net")  # structure: expected a Structure, got int
loss_of_cable(HUNG, PHASES, "net")  # solution: expected a Solution or its .last, got list
loss_of_cable(HUNG, twice(solution()), "net")  # solution: is a batch; take one case k
loss_of_cable(HUNG, replace(solution(), status=jnp.int32(1)), "net")
    # solution: has failed (no equilibrium found
loss_of_cable(net(), solution(), [0])  # solution: ...structure
lost("nett")  # elements = 'nett': no such key
lost({"nett": [0]})  # elements: no group 'nett' in the
lost({"net": [2]})  # elements['net']: elements[0] = 2: the group has elements 0 to 1
lost({"net": [-1]})  # elements['net'][0] = -1: element numbers
lost({"net": [0, 0]})  # elements: element 0 is named twice
lost({"net": [1.0]})  # elements['net']: expected integers
lost({"net": [True]})  # elements['net']: ...2 booleans
lost({"net": only([1], 2.0)})
    # elements['net']: expected indices such as [1], booleans [n_elem], only(elements) or True
lost([0])  # elements: expected a choice by group
lost({"net": []})  # elements: no element is lost; name at least
traced(lambda k: lost({"net": k}).loads, jnp.array([0]))
    # elements: are topology and cannot be traced
loss_of_cable(HUNG, without_mast(), "mast")
    # elements: element 0 of elements['mast'] is not there in the solution
lost("net", dynamic_factor=[2.0])  # dynamic_factor: expected a scalar, got shape
lost("net", name=" ")  # name = ' ': expected a text
combinations([SNOW], {"combinations": {}, "kinds": {"snow": {"psi": 0.7}}})
    # rules: kinds['snow']['psi']: expected [psi0, psi1, psi2]
combinations([SNOW], {"combinations": {}, "kinds": {"snow": {"psi": [60, 20, 0]}}})
    # rules: kinds['snow']['psi'] = 60: expected a number from 0 to 1
combinations([])  # actions: expected a list of Action, got list
combinations([push()])  # actions[0]: expected an Action, got NodalLoads
combinations([SNOW, SNOW])  # actions[1]: 'snow' is the name of actions[0], too
combinations([replace(SNOW, needs="ice")])
    # actions[0]: needs = 'ice': is no other action; there are 'snow'
combinations([replace(SNOW, kind="sno")])
    # actions[0]: kind = 'sno': the rules do not have it; ...did you mean 'snow'
combinations([replace(SNOW, kind="accidental", source="steel")])
    # actions[0]: source: 'snow' is neither a permanent nor a variable action
combinations([DEAD, replace(SNOW, kind="prestress", exclusive="a")])
    # actions[1]: exclusive: 'snow' is no variable action
combinations([SNOW], which=["ULS"])  # which: 'ULS': is no rule and no limit state; there are
combinations([SNOW], which=[])  # which: no rule; there are
combinations([SNOW], which=["ACC 6.11"])  # actions: the rules ACC 6.11 make no combination
combinations([replace(SNOW, kind="imposed H")], which=["SLS frequent"])
    # actions: 'snow' is in no combination of these rules
combinations([SNOW], increments=0)  # increments = 0
combinations([SNOW], "EN 1991")  # rules = 'EN 1991': ...did you mean 'EN 1990'
combinations([SNOW], {"combinations": {}, "kind": {}})  # rules: unknown entry 'kind'
combinations([SNOW], {})  # rules: expected a dict with the entry 'combinations'
combinations([SNOW], {"combinations": {"A": {}}})
    # rules: combinations['A']: expected a dict with 'limit state'
combinations([SNOW], {"combinations": {"A": {"limit state": "u", "permanent": [-1.0]}}})
    # rules: combinations['A']['permanent'] = -1.0: expected a number from 0 to 10
combinations([SNOW], {"combinations": {"A": {**RULE, "leading": ["psi"]}}})
    # rules: combinations['A']['leading'] = 'psi': expected one of gamma, psi0
combinations([SNOW], {"combinations": {"A": {**RULE, "terms": {"snow": 1.0}}}})
    # rules: combinations['A']: terms: 'snow' is none of 'kinds'
combinations([replace(SNOW, name=str(k)) for k in range(16)])
    # actions: make more than 20000 combinations
combinations([replace(DEAD, loads=None)]).cases
    # actions: 'dead' has factor 1.35 in combination 'ULS 6.10-1', but is in the phases
combinations([SNOW]).select_rules("ULS")  # rules = 'ULS': no combination is of it
combinations([WARM, replace(WARM, name="cold", temperature={"net": 1.0})]).cases
    # actions: temperature of 'cold' has another form than that of 'warm'
report(HUNG, solution(), checks=[1])  # checks: expected the Checks of design.checks, got list
report(HUNG, solution(), combinations=5)  # combinations: expected Combinations, got int
report(HUNG, solution(), combinations=combinations([SNOW]))
    # combinations: come with cases=..., their results
utilization(HUNG, {"net": np.ones(3), "mast": np.ones(1)})  # tension: group 1 has 2 elements
utilization(HUNG, np.ones(2))  # tension: has 1 arrays, the structure 2 groups
utilization(3, 1.0)  # structure: expected a Structure, got int
slack_distance(net(), solution())  # state: element groups: one without a name
nearest_kink(3, jnp.ones(2), jnp.ones(2))  # distance: expected a function, got int
nearest_kink(lambda x: x, jnp.ones(2), jnp.ones(3))
    # direction: expected a scalar or shape (2,), got (3,)

## reliability
Normal(1.0)  # deviation: give either a standard deviation or a variation
Normal(1.0, 0.1, 0.1)  # deviation: give either a standard deviation or a variation
Normal(np.ones(2), np.ones(3))  # mean: has shape (2,), its scatter (3,)
Quantities({})  # quantities: expected a dict of distributions by name
Quantities({"a": 3.0})  # quantities['a']: expected a distribution, got float
Quantities({"wind": STANDARD}, {("wind", "wnd"): 0.1})
    # correlation[('wind', 'wnd')]: no quantity 'wnd'; there are 'wind'; did you mean 'wind'
Quantities({"a": Normal(np.ones(2), 1.0), "b": STANDARD}, {("a", "b"): 0.1})
    # correlation[('a', 'b')]: 'a' is an array
Quantities({"a": STANDARD}, {("a", "a"): 0.1})  # correlation[('a', 'a')]: expected two quantities
Quantities({"a": STANDARD}, np.eye(2))  # correlation: expected shape (1, 1)
normal_correlation({"a": STANDARD}, np.eye(1))  # quantities: expected Quantities, got dict
first_order(3, {"a": STANDARD})  # limit_state: expected a function
first_order(lambda x: x, {"a": STANDARD}, start={"b": 1.0})  # values: no quantity 'b'
first_order(lambda x: None, {"a": STANDARD})
    # limit_state: expected a scalar float, a vector [m], or a dict of scalars, got NoneType
first_order(lambda x: {}, {"a": STANDARD})  # limit_state: ...got an empty one
first_order(lambda x: x["a"], {"a": STANDARD}, steps=0)  # steps = 0
first_order(lambda x: x["a"], {"a": STANDARD}, points=0)  # points = 0
importance_sampling(lambda x: x["a"], {"a": STANDARD}, 3.0)
    # center: expected the result of first_order, or a list, got float
importance_sampling(lambda x: x["a"], {"a": STANDARD}, samples=1)  # samples = 1
importance_sampling(lambda x: x["a"], {"a": STANDARD}, spread=0.0)  # spread = 0.0
importance_sampling(lambda x: x["a"], {"a": STANDARD}, key=-1)  # key = -1
series_system([3.0])  # results[0]: expected the result of first_order, got float
tolerance_budget(np.eye(2), 1.0, np.ones(2), choice="best")  # choice = 'best'
tolerance_budget(np.eye(2), 1.0, np.ones(2), adding="rss")  # adding = 'rss'
tolerance_budget(np.eye(2), 0.0, np.ones(2))  # allowed: must be positive
tolerance_budget(np.eye(2), np.ones(3), np.ones(2))  # allowed: expected shape (2,)
tolerance_budget(np.eye(2), 1.0, np.ones(2), cost=-1.0)  # cost: must be positive
tolerance_budget(np.nan * np.eye(2), 1.0, np.ones(2))  # jacobian: is NaN
tolerance_budget(np.eye(2), np.inf, np.ones(2))  # jacobian: no input affects a result
""")

SUSPICIOUS = rows("""
## units
stated(cables(axial_stiffness=98.0), pretension=[0.0, 200.0, 0.0])
    # phases[0].pretension[1] = 200: a strain of 204 % with EA = 98 N, and steel breaks ...
        forces in N
stated(Cables(LINKS, area=1e-4, law=Elastic(2.1e6)), pretension=2e3)
    # phases[0].pretension[0] = 2000: a strain of 952 % with EA = 210 N, ... moduli in Pa
stated(cables(axial_stiffness=98.0), force_density=200.0)
    # phases[0].force_density[0] = 200: a strain of 204 %
stated(cables(axial_stiffness=0.5), loads=push())
    # phases[0].loads: 1 N on node 1 strains its elements by 66.7 % or more: ... EA is 1.5 N; ...
analyse(Phase(pretension=0.01), PUSHED, structure=net(elements=cables(axial_stiffness=0.5)))
    # phases[1].loads: 1 N on node 1
stated(prestrain=only([2], 0.2))
    # phases[0].prestrain[2] = 0.2: a strain of 20 %, ... a ratio, not a percentage
CableFatigue(area=479.0)  # area = 479: is the area in m2?
CableFatigue(category=150.0)  # category = 150: is the range in Pa?
MemberSection(profile=TUBE, yield_strength=355.0)  # yield_strength = 355: is it in Pa?
MemberBuckling(profile=TUBE, yield_strength=355e6, lengths=8000.0)  # lengths = 8000: are they in m?
DisplacementLimit(53.0)  # displacement: upper = 53: is the limit in m?
find_form(net(elements=HANGING), force_density=1.0, loads=SelfWeight())
    # elements (Catenaries): with given values they are straight in the form
stated(HANGING, end_tension=2.0)  # elements.weight: no phase has SelfWeight
stated({"a": HANGING, "b": HANGING}, end_tension=2.0)
    # elements['a'].weight, elements['b'].weight: no phase has SelfWeight
analyse(Phase(pretension=2.0), structure=net(NODES[:3], cables(LINKS[:2]), (0,)))
    # nodes[2] is the free end of elements.links[1]: no phase supports it
analyse(Phase(pretension=2.0), structure=net(PLAN, cables(ROUND), (0, 1, 2)))
    # nodes[3] is a free corner of elements.links[2]: no phase supports it
stated(HANGING, built_sag=150.0, loads=SelfWeight())
    # phases[0].built_sag[0] = 150: its ends are 1 m apart; is the sag in m?
materials.steel(355)
    # yield_stress = 355: Pa, and E is 2.1e+11 Pa: a strain of 1.7e-09, ... is it in MPa?
materials.strand(1860.0)  # strength = 1860: Pa, and E is 1.95e+11 Pa: ... is it in MPa?
materials.tension_only(165e9, 1500.0, 0.02)
    # strength = 1500: Pa, and E is 1.65e+11 Pa: ... is it in MPa?
Polygonal([0, 0.2, 5.0], [0, 4e8, 5e8])
    # strain[2] = 5: more than 1; it is a ratio, not a percentage
Polygonal([0, 4e8, 5e8], [0, 2e-3, 0.05])  # strain[2] = 5e+08: more than 1
stated(shortening=[0.1, -1.5, 0.1])
    # phases[0].shortening[1] = -1.5: the element has 1 m; is it in m, and can a turnbuckle do it?
stated(rest_length=[1.0, 999.0, 1.0])
    # phases[0].rest_length[1] = 999: its nodes are 1 m apart; is the length in m
net(1000.0 * NODES, {"net": cables(rest_length=0.999)})
    # elements['net'].rest_length[0] = 0.999: its nodes are 1e+03 m apart; is the length in m
net(elements=Cables(LINKS, area=[1e-4, 314.0, 1e-4], law=STEEL))
    # elements.area[1] = 314: thicker than the element is long; is the area in m2
net(elements={"mast": Beams(LINKS, section=Section.linear(1e5, 1e8, 1e8, 1e4))})
    # elements['mast'].section: the radius of gyration, the root of EI / EA, is 31.6 m, more
net(elements={"mast": Beams(LINKS, section=Section.rectangle(100.0, 200.0, STEEL))})
    # elements['mast'].section: 180 m from fibre to fibre is more than ... coordinates in m
stated(cables(expansion=12.0), temperature=30.0)
    # phases[0].temperature[0] = 30: a strain of 3.6e+04 %, ... is the expansion in 1/K
stated({"net": cables(strength=[20.0, 5.0, 20.0])}, pretension=10.0)
    # phases[0].pretension['net'][1] = 10: 2 times its strength, 5 N
stated({"net": cables(strength=[20.0, 5.0, 20.0])}, force_density=8.0)
    # phases[0].force_density['net'][1] = 8: 1.6 times its strength, 5 N

## what no increment sees
loaded(Varying(push(), HALF, [0.0, 1.0, 0.0]))
    # phases[0].loads[0]: factors[1] = 1 is not reached: ... 0 to 0; ... load factor 0.5

## what acts on nothing
loaded(push([2, 3]))  # phases[0].loads: all of them act on supports (node 2) ... check the numbers
analyse(Phase(pretension=1.0), structure=net(supports=range(4)))
    # phases[0].supports: every node is held, ... of the anchors only
net(NODES[[0, 1, 2, 3, 1]], cables([[0, 1], [4, 2], [1, 3]]))
    # nodes[1] and nodes[4] are at the same place but not joined; ... one number for it in links
""")

ODD = rows("""
loaded(Varying(push(), HALF, [0.5, 0.7, 1.0]))  # a load step
loaded(push([1, 2]))  # loads on supports as well
loaded(push([1, 2]), structure=net(supports=(0, 3)))  # a load on the free end of a cable
dynamics.transient(net(NODES[:3], cables(LINKS[:2]), (0,)), dt=0.1, steps=1, masses=BOBS)
    # inertia stretches a cable with a free end
analyse(Phase(supports=pinned([0, 2, 3])), structure=net(supports=(0, 3)))  # held later
chain([1, 0.4, 0])  # a flat kink
chain([1, 0, -2.0])  # a node that hangs
stated(pretension=1.0, loads=push([2]))  # loads on supports beside prestress
loaded(push([2], (0.0, 0, 0)))  # no load at all
loaded(SupportMovement([1], (1e-3, 0, 0)), structure=net(supports=range(4)))  # all held, one moved
net(NODES[[0, 1, 2, 3, 0]], cables([[0, 1], [1, 2], [4, 3]]), (0, 2, 4))  # two anchors at one place
stated(rest_length=50.0)  # much slack
stated(prestrain=-0.3)  # slack by its strain
analyse(Phase(), structure=net(elements=Catenaries(LINKS, 1e4, weight=1.0), supports=range(4)))
    # catenaries between anchors
loaded(SelfWeight(), structure=net(elements=cables(weight=1.0), supports=range(4)))
    # weights between anchors
stated(pretension=[1.0, np.inf, np.nan], loads=push(force=(np.inf, 0, np.nan)))
    # numbers that become a status
stated(cables(weight=1.0), loads=SelfWeight((0, 0, 9.81)))  # gravity upwards
stated(cables(axial_stiffness=[1e-3, 1e-3, 1e4]), loads=push())  # stiff elements beside soft ones
stated({"stay": cables(axial_stiffness=10.0), "beam": Beams([[0, 3], [3, 1]], section=BOX)},
        loads=push([1], (0, 0, -1e4)))
    # a load that beams bear
""")
