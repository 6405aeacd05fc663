"""Wrong elements, inputs of phases and arguments, and the answer: rows as in `model/messages.py`.

Own elements are those of `extensions`, which take part in everything that does not ask for more
than they can.
"""

import re

import numpy as np
import pytest
from extensions import own_links
from extensions.own_elements import GroundSprings
from extensions.own_membrane import Cloth, Membranes, sheet
from extensions.own_saddle import Saddles
from model.messages import rows

import jaxcable as jc
from jaxcable import extend
from jaxcable.analysis.preparation import prepare
from jaxcable.files import opensees

Phase, only = jc.Phase, jc.only
NODES = np.array([[-4.0, 0, 3], [0, 0, 0], [4, 0, 3], [0, 4, 3]])  # the second one is free
PAIRS, ROPE = [[0, 1], [1, 2], [1, 3]], [[0, 1, 2]]
NET = jc.Cables(PAIRS, axial_stiffness=1e5, expansion=1e-5)
OWN = {
    "net": NET,
    "hooks": own_links.Hooks([[0, 1]], 1e3, 0.5),
    "rods": own_links.Brittle([[3, 1]], 1e3, 5.0),
}
THRUSTERS = own_links.Thrusters([[0, 1]], 9.0, 3.0)
SHEET, TRIANGLES = sheet(2)
CLOTH = {"cloth": Cloth(TRIANGLES, 1e4), "edge": jc.Cables([[0, 1]], axial_stiffness=1e4)}
ROPES = {"ropes": Saddles(ROPE, 1e6), "wire": jc.Cables([[1, 2]], axial_stiffness=1e6)}
GUYS = {"guys": jc.Catenaries(PAIRS, axial_stiffness=1e6, weight=10.0)}
SPAN = [[0.0, 0, 0], [60.0, 0, 0]]
PLASTIC = jc.Polygonal([0.0, 1e-3, 0.1], [0.0, 2e8, 4e8], "elastic")
STOCKY = jc.Bars(PAIRS, area=1.0, law=jc.Polygonal([-0.1, 0, 0.1], [-1e3, 0, 2e3]))
BASE = [Phase(pretension=1000.0), Phase(loads=jc.NodalLoads([1], (0.0, 0, -300.0)))]


def made(elements=NET):
    return jc.Structure(NODES, elements, jc.pinned([0, 2, 3]))


def analyse(*phases, of=NET, method=None):
    """What `solve` does before it computes; phases as such, or as the inputs of one."""
    prepare(made(of), [Phase(**p) if isinstance(p, dict) else p for p in phases], method, None)


def loaded(*loads, of=OWN):
    analyse({"loads": list(loads)}, of=of)


def own(value):
    analyse({"own": value}, of=ROPES)


def cloth(values):
    prepare(jc.Structure(SHEET, CLOTH, jc.pinned([0])), [Phase(pretension=values)], None, None)


def hung(weight=40.0, **phase):
    cable = jc.Catenaries([[0, 1]], axial_stiffness=2e6, weight=weight)
    prepare(jc.Structure(SPAN, cable, jc.pinned([0, 1])), [Phase(**phase)], None, None)


def with_result(result):
    """A structure with ground springs that tell a result."""
    kind = type("Telling", (GroundSprings,), {"results": (result,)})
    ground = object.__new__(kind)
    vars(ground).update(vars(GroundSprings([[1]], np.ones((1, 3)))))
    made({"net": NET, "ground": ground})


def with_input(phase_input):
    """A structure with membranes that take an input."""
    kind = type("Taking", (Membranes,), {"phase_inputs": (phase_input,)})
    jc.Structure(SHEET, extend.pytree(indices=("links",))(kind)(TRIANGLES, 1e4), jc.pinned([0]))


def friction(kind=jc.FrictionCables, links=((0, 1, 2, 3),), **numbers):
    given = {} if "law" in numbers else {"axial_stiffness": 1e6}
    return kind(links=links, **given | {"friction": 0.1} | numbers)


def exported(structure):
    """Only some elements can go to OpenSees."""
    opensees.require_exportable(structure)


REFUSED = rows("""
## own elements: what they cannot
jc.find_form(made(OWN), tension={"hooks": 1.0})  # elements['hooks'] (Hooks) is not made of straight
jc.forms.self_stress(made(OWN))  # elements['hooks'] (Hooks) is not made of straight
loaded(jc.CablePressure(1.0, (0.0, 1.0, 0.0), on="hooks", per="unstressed"))
    # ...elements['hooks'] (Hooks) has no unstressed length; give per
loaded(jc.LineLoads((1.0, 0, 0), on="hooks"))  # ...elements['hooks'] (Hooks) has no length to load
analyse({"removes": "rods"}, of=OWN)  # ...elements['hooks'] (Hooks) cannot be added or removed
analyse({}, of=OWN, method=jc.Incremental(stiffness="secant"))  # ...secant...elements['hooks']
analyse({"pretension": {"hooks": 1.0}}, of=OWN)
    # ...pretension['hooks']: a group of Hooks cannot be prestressed
analyse({"pretension": {"net": 1.0}, "prestrain": {"net": 1e-3}}, of=OWN)
    # ...both state the prestress of elements['net']
jc.solve(made(own_links.Jacks([[0, 1]], 1e3)), Phase(jacking=10.0))
    # ...Long: a state of elements without the field `jack_force`
with_result(extend.Result("displacement", "m"))
    # ...'displacement' is the name of a result of nodes
with_result(extend.Result("tension", "kN"))
    # ...'tension' is a result of another group with another unit
with_input("stress")  # ...phase_inputs: 'stress' is none of ...; give a `PhaseInput`
with_input(extend.PhaseInput("sag", "m"))
    # ...phase_inputs: 'sag' is one of `Phase`; give the name alone
jc.stiffness.buckling_factor(made(THRUSTERS), None)
    # buckling_factor: elements (Thrusters) has symmetric = False
jc.stiffness.modes(made(THRUSTERS), None)
    # modes: elements (Thrusters) has symmetric = False
jc.dynamics.modes(made(THRUSTERS), None)
    # modes: elements (Thrusters) has symmetric = False

## inputs of own elements
own({"clamp": 1.0})
    # ...own['clamp']: no group of the structure has an input 'clamp'; there are 'friction'
own({"pretension": 1.0})  # ...own: 'pretension' is an argument of Phase: Phase(pretension=
own({"increments": 1.0})  # ...own: 'increments' is an argument
own({"clamped": 1.0})  # ...own: 'clamped' is an argument of Phase: Phase(clamped=
own(3.0)  # ...own: expected a dict of inputs by name, got
own({"friction": True})  # ...friction: expected numbers, got bool
own({"friction": {"ropes": -0.1}})  # ...['ropes'][0] = -0.1: must not be negative
own({"friction": {"wire": 0.1}})
    # ...['wire']: an input of Saddles; this group is made of Cables
own({"friction": {"rope": 0.1}})
    # ...own['friction']: no group 'rope' in ... did you mean 'ropes'
own({"friction": {"ropes": [0.1, 0.2]}})
    # ...own['friction']['ropes']: expected a scalar or shape (1,)
Saddles(ROPE, -1.0)  # ...stiffness[0] = -1.0: must be positive

## inputs of several components
cloth({"cloth": np.full(8, 300.0)})  # ...pretension...one number, or shape (8, 2)
cloth({"cloth": np.full(2, 300.0)})  # ...pretension...one number, or shape (8, 2)
cloth({"cloth": np.ones((8, 3))})  # ...pretension...one number, or shape (8, 2)
cloth({"cloth": {"warp": 300.0, "weft": 120.0}})  # ...the columns warp, weft
analyse({"pretension": only([0], [[1.0, 2.0]])})  # ...pretension: expected a scalar or shape
only([0, 1], np.ones((3, 2)))  # values: expected a scalar or shape (2,)
jc.force_density(made(), only([0, 1], np.ones((2, 2))))  # ...q: expected a scalar or shape (2,)
analyse({"jacking": {"sheet": 9.0}}, of={"sheet": Membranes(ROPE, 1e4)})
    # ...Membranes have no jacking; they take prestrain
analyse({"pretension": {"sheet": 9.0}}, of={"sheet": Membranes(ROPE, 1e4)})
    # ...Membranes have no pretension; they take prestrain
loaded(jc.LineLoads((0.0, 0.0, -1.0)), of=Membranes(ROPE, 1e4))
    # ...elements (Membranes) has no length to load

## cables that hang, slide and rub
jc.Catenaries([[0, 1]], area=1.0, law=jc.Elastic(1.0))  # ...a catenary is elastic
hung(jacking=0.0)  # ...jacking[0] = 0.0: must be positive: a cable that hangs
hung(None, sag=1.0)  # phases[0].sag: only catenaries with a weight can
hung(sag=0.0)  # ...sag[0] = 0.0: a sag must be positive
jc.SlidingCables([[0]], 1.0)  # ...at least two nodes
jc.SlidingCables([], 1.0)  # ...at least one element
jc.SlidingCables([[0, 1], [0, 1, 1, 2]], 1.0)  # ...links[1] = [0, 1, 1, 2]: node 1 twice in
analyse({}, of=jc.SlidingCables(ROPE, 1.0), method=jc.Incremental(stiffness="secant"))
    # ...elements (SlidingCables) has no secant
friction(friction=[[0.1, -0.1]])  # ...friction[0, 1] = -0.1: must not be negative
friction(friction=np.nan)  # ...friction... = nan: must not be negative
friction(friction=[0.1] * 3)  # ...friction: expected ...shape (1,) or (2,) or (1, 2), got (3,)
friction(links=[[0, 1]])  # ...links: no cable has a node between its ends
friction(law=PLASTIC, area=1e-4)  # ...law: has history variables
friction(jc.SlidingCatenaries, law=jc.Elastic(2e11), area=1e-4)
    # law, area, section: a catenary is elastic
friction(jc.SlidingCatenaries, area=1e-4)  # law, area, section: a catenary is elastic
friction(jc.SlidingCatenaries, links=[[0, 1]])  # ...links: no cable has a node between its ends

## laws, springs
jc.Bars(PAIRS, section=jc.Section.disc(0.01, jc.materials.steel()), compliance=1e-8)
    # ...beside a law of points only in groups of one element
exported(made({"bars": jc.Bars(PAIRS, 1e5), "soil": jc.GroundContacts([1], 1.0)}))
    # ...soil are GroundContacts; only Cables, Bars and Contacts can

## inputs of phases
analyse({"pretension": only([7], 1.0)})
    # ...pretension: elements[0] = 7: the group has elements 0 to 2
analyse({"pretension": only([True, False], 1.0)})
    # ...pretension: expected a boolean for each of 3 elements, got 2
analyse({"pretension": only([0, 2], 1.0), "rest_length": only([1, 2], 1.0)})
    # ...pretension, rest_length: both state the prestress of element 2 of elements
analyse({"jacking": only([1], 1.0), "shortening": 0.1})
    # ...jacking, shortening: a jack keeps the force of element 1 of elements
analyse({"pretension": -1001.0}, of=STOCKY)
    # ...pretension[0] = -1001.0: more than the law of the element can
only([1, 1], 2.0)  # ...element 1 is named twice
only([1, 2], [1.0, 2.0, 3.0])  # ...values: expected a scalar or shape (2,)
jc.forms.hanging_chain([0, 0, 0], [1, 0, 0], 1, 1.0, 1.0, 1.0)  # ...n = 1
jc.forms.catenary_curves(made(), None)  # ...structure: has no catenaries
jc.trace_path(made(GUYS), Phase(jacking={"guys": 1.0}))
    # phases[0].jacking['guys']: trace_path takes no prestress
jc.trace_path(made(GUYS), Phase(end_tension={"guys": 1.0}))
    # phases[0].end_tension['guys']: trace_path takes no prestress
jc.trace_path(made(GUYS), Phase(horizontal_tension={"guys": 1.0}))
    # phases[0].horizontal_tension['guys']: trace_path takes no prestress

## elements that come and go
analyse({"adds": "net"})  # phases[0].adds = 'net': no such key ... there are none
analyse({"adds": only([7])})  # phases[0].adds: elements[0] = 7: the group has elements 0
analyse({"adds": only([1], 3.0)})  # ...adds: only(...) has values here
analyse({"adds": [1.0, 0.0, 0.0]})  # ...expected keys of groups, only(elements), or 3 b
analyse({"adds": np.array([True, False])})  # ...or 3 booleans, got bool of shape (2,)
analyse({}, {"adds": only([1])}, {"adds": only([1])})
    # phases[2].adds: element 1 of elements is there already
analyse({"removes": only([1])}, {"removes": only([1])})
    # phases[1].removes: element 1 of elements is not there
analyse({"removes": only([1]), "adds": only([1, 2])})
    # ...adds, removes: element 1 of elements is in both
Phase(placed="here")  # placed = 'here': expected one of drawn, attached
analyse({"adds": [only([0]), None]}, of=[NET, GroundSprings([[1]], np.ones((1, 3)))])
    # ...(GroundSprings) cannot be added or removed
jc.trace_path(made(), [*BASE, Phase(removes=only([2]))])
    # ...path is followed, must not add or remove elements

## loads, batches
jc.LineLoads((0, 0, -1.0), geometry="begun")  # ...unstressed lengths have no
jc.LineLoads((0, 0, -1.0), per="initial", geometry="now")  # ...geometry = 'now'
jc.AreaLoads([[0, 1, 2]], (0, 0, -1.0), geometry="now")  # ...geometry = 'now'
jc.batched(abs, 0)  # chunk = 0: expected a whole number
jc.batched(abs, -1)  # chunk = -1: expected a whole number
jc.batched(abs, 2.5)  # chunk = 2.5: expected a whole number
jc.batched(abs, True)  # chunk = True: expected a whole number
jc.batched(abs, devices=[])  # devices: expected at least one
jc.batched(abs)(1.0)  # cases: expected arrays with one common leading axis
jc.batched(max)(np.ones(3), np.ones(2))  # cases: expected arrays with one common leading axis
jc.batched(abs)(np.ones((0, 3)))  # cases: expected arrays with one common leading axis
jc.evaluation("fast")  # way = 'fast': expected
""")


@pytest.mark.parametrize(("call", "message"), REFUSED, ids=[call[:60] for call, _ in REFUSED])
def test_what_is_refused(call, message):
    with pytest.raises(ValueError, match=re.compile(message, re.DOTALL)):
        eval(call, globals())


FAR = np.array([3512345.12, 5411111.0, 400.0])


def turned(rotation):
    turns = [[0.0, 0.1, 0.0], [0.0, rotation, 0.0]]
    return jc.SupportMovement([0, 1], None, rotations=turns)


def placed(offset):
    jc.Structure((NODES + offset).astype(np.float32), {"net": NET}, jc.pinned([0, 2, 3]))


def one(kind=jc.Bars, **numbers):
    jc.Structure(NODES[:2], kind([[0, 1]], **numbers), jc.pinned([0]))


def heavy(weight, **numbers):
    one(weight=weight, **{"area": 1e-3, "law": jc.Elastic(210e9)} | numbers)


SUSPICIOUS = rows("""
turned(5.0)  # ...rotations[1]: a rotation of 5 rad is 286.479 degrees
placed(FAR)  # ...resolution of 0.5 m in float32, ...['net'], which are 5 m
heavy(0.077)  # ...weight[0] = 0.077: less than 100 N/m3 with its area..."units"
heavy(0.0077, axial_stiffness=2.1e7, area=None, law=None)
    # ...weight[0] = 0.0077: the stiffness EA is more than 1e9 m times this
one(area=1e-4, law=jc.Elastic(2.1e5))
    # ...law: its modulus is 210000 Pa, softer than rubber; is it in MPa
""")


@pytest.mark.parametrize(("call", "message"), SUSPICIOUS, ids=[call[:60] for call, _ in SUSPICIOUS])
def test_numbers_in_other_units_are_suspected(call, message):
    with pytest.warns(jc.InputWarning, match=message):
        eval(call, globals())


def test_numbers_in_their_units_are_not_suspected():
    """Warnings are errors."""
    turned(np.pi), placed(0.0), heavy(77.0), one(area=1e-4, law=jc.Elastic(2.1e11))
    heavy(7.7, axial_stiffness=2.1e7, area=None, law=None)
