"""Mistakes of a person who is new here: the answer says what is wrong, where, and what to do.

What is surely wrong is a ValueError, what is legal and most likely not meant an `InputWarning`.
Nothing of this needs a program: both come before one is compiled. `test_errors.py` has the errors
of single arguments, `mistakes.py` those with random values.
"""

import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.analysis.preparation import prepare

NODES = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [1.0, 1.0, 0]])
LINKS = [[0, 1], [1, 2], [1, 3]]
STEEL = jc.Elastic(210e9)
SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
BEAM = jc.Section.rectangle(0.1, 0.2, STEEL, (1, 1))


def cables(links=LINKS, **options):
    return jc.Cables(links, **{"axial_stiffness": 1e4, **options})


def net(nodes=NODES, elements=None, supports=(0, 2, 3)):
    elements = cables() if elements is None else elements
    return jc.Structure(nodes, elements, jc.pinned(supports))


def push(nodes=(1,), force=(0.0, 0.0, -1.0)):
    return jc.NodalLoads(nodes, force)


def analyse(*phases, structure=None):
    """What `solve` does before it computes."""
    prepare(net() if structure is None else structure, list(phases), None, None)


def polygon(points, holes=None):
    return jc.Section.polygon(points, holes, STEEL, 0.2)


TWO = {"net": cables([[0, 1], [1, 2]]), "tie": jc.Bars([[1, 3]], axial_stiffness=1e4)}
FAR = np.array([[9.0, 0, 0], [9.0, 1, 0]])
DOUBLED = np.concatenate([NODES, NODES[1:2]])
PUSHED = jc.Phase(loads=push())

ERRORS = {
    # supports
    "forgot the supports": (
        lambda: jc.Structure(NODES, cables()),
        r"^supports: missing; a structure needs supports=pinned\(nodes\)",
    ),
    "node numbers for supports": (
        lambda: jc.Structure(NODES, cables(), [0, 2, 3]),
        r"^supports: .* needs supports=pinned\(nodes\) or Supports\(mask\), got list",
    ),
    "node numbers for a mask": (
        lambda: jc.Supports([0, 2, 3]),
        r"^supports mask: expected booleans .* use pinned\(nodes\)",
    ),
    "a mask for node numbers": (
        lambda: jc.pinned([True, False, True, True]),
        "^pinned nodes: expected integers, got bool; numpy.flatnonzero",
    ),
    "a part without supports": (
        lambda: net(np.concatenate([NODES, FAR]), cables([*LINKS, [4, 5]])),
        "^supports: node 4 is in a part of 2 nodes .* float away: support it or connect it",
    ),
    "a part without supports later": (
        lambda: analyse(
            jc.Phase(supports=jc.pinned([0, 2])),
            structure=net(np.concatenate([NODES, FAR]), cables([*LINKS, [4, 5]]), (0, 2, 3, 5)),
        ),
        "^supports: node 4 is in a part of 2 nodes .* support it or connect it",
    ),
    # nodes and links
    "links numbered from 1": (
        lambda: net(elements=cables([[1, 2], [2, 3], [2, 4]])),
        r"^elements.links\[2\] = \[2, 4\]: .* nodes 0 to 3; .* from 1: .* start at 0, subtract 1",
    ),
    "links of a dict numbered from 1": (
        lambda: net(elements={"net": cables([[1, 2], [2, 4]])}),
        r"^elements\['net'\].links\[1\] = \[2, 4\]: .* subtract 1",
    ),
    "chains numbered from 1": (
        lambda: net(elements=jc.SlidingCables([[1, 2, 3], [2, 4]], axial_stiffness=1.0)),
        r"^elements.links\[1\] = .* subtract 1",
    ),
    "anchors numbered from 1": (
        lambda: net(supports=[1, 3, 4]),
        r"^pinned nodes\[2\] = 4: .* nodes 0 to 3; .* subtract 1",
    ),
    "loads numbered from 1": (
        lambda: analyse(jc.Phase(loads=push([2, 4]))),
        r"^phases\[0\].loads\[0\]: load nodes\[1\] = 4: .* nodes 0 to 3; .* subtract 1",
    ),
    "faces numbered from 1": (
        lambda: analyse(jc.Phase(loads=jc.AreaLoads([[1, 2, 4]], (0, 0, -1.0)))),
        r"^phases\[0\].loads\[0\]: faces\[0\] = \[1, 2, 4\]: .* subtract 1",
    ),
    "nodes in a plane": (
        lambda: net(NODES[:, :2]),
        r"^nodes: expected shape \[n_node, 3\], got \(4, 2\); a plane structure has z = 0",
    ),
    "nodes in columns": (
        lambda: net(NODES.T),
        r"^nodes: expected shape \[n_node, 3\], got \(3, 4\); transpose",
    ),
    "arguments in another order": (
        lambda: jc.Structure(cables(), NODES, jc.pinned([0])),
        "^nodes: expected numbers, got Cables",
    ),
    "links for elements": (
        lambda: jc.Structure(NODES, np.array(LINKS), jc.pinned([0])),
        r"^elements: ndarray is not an element group such as Cables\(links",
    ),
    # elements and laws
    "a law that is not called": (
        lambda: jc.Cables(LINKS, area=1e-4, law=jc.Elastic),
        "^law: the class Elastic is not a law; call it with its numbers",
    ),
    "a section's law that is not called": (
        lambda: jc.Section.disc(0.1, jc.Elastic),
        r"^laws\[0\]: the class Elastic is not a law; call it",
    ),
    "a modulus for a law": (
        lambda: jc.Section.disc(0.1, 210e9),
        r"^laws\[0\]: float is not a uniaxial law such as Elastic\(E\)",
    ),
    # sections
    "self-crossing polygon": (
        lambda: polygon([[0, 0], [1, 1], [1, 0], [0, 1]]),
        r"^points: the outline crosses itself: the edge from points\[0\] to points\[1\] crosses "
        r"that from points\[2\] to points\[3\]; name its corners in turn",
    ),
    "self-crossing hole": (
        lambda: polygon(SQUARE, [[[0.2, 0.2], [0.6, 0.7], [0.6, 0.2], [0.2, 0.6]]]),
        r"^holes\[0\]: a hole crosses itself: the edge from holes\[0\]\[0\] to holes\[0\]\[1\]",
    ),
    "hole over the edge": (
        lambda: polygon(SQUARE, [[[0.5, 0.5], [1.5, 0.5], [1.5, 0.7], [0.5, 0.7]]]),
        r"^points: a hole crosses it .*: the edge from points\[1\] to points\[2\] crosses that "
        r"from holes\[0\]\[0\] to holes\[0\]\[1\]",
    ),
    "hole outside": (
        lambda: polygon(SQUARE, [[[2, 2], [3, 2], [3, 3]]]),
        r"^holes\[0\]\[0\] = \[2.0, 2.0\]: outside of the outline",
    ),
    "polygon without area": (
        lambda: polygon([[0, 0], [1, 0], [2, 0]]),
        "^points: all on one line, which has no area",
    ),
    "polygon on a slope without area": (
        lambda: polygon([[0, 0], [1, 1], [2, 2], [3, 3]]),
        "^points: all on one line, which has no area",
    ),
    "corner that is no number": (
        lambda: polygon([[0, 0], [1, 0], [np.nan, 1]]),
        r"^points\[2\] = \[nan, 1.0\]: must be finite",
    ),
    # loads
    "a load that is not called": (
        lambda: jc.Phase(loads=jc.SelfWeight),
        r"^loads\[0\]: the class SelfWeight is not a load; call it: SelfWeight\(",
    ),
    "forces of all nodes for loads": (
        lambda: jc.Phase(loads=np.ones((4, 3))),
        r"^loads\[0\]: ndarray is not a load; expected NodalLoads\(nodes, forces\)",
    ),
    "forces in a plane": (
        lambda: push([1, 3], np.ones((2, 2))),
        r"^forces: expected shape \(3,\) or \(2, 3\), got \(2, 2\); give \(x, y, z\)",
    ),
    "one number for a force": (
        lambda: push([1], -15.0),
        r"^forces: expected shape .* got \(\); give \(x, y, z\) for all nodes",
    ),
    "gravity for a direction": (
        lambda: jc.SelfWeight(-9.81),
        r"^direction: expected shape \(3,\) such as \(0, 0, -1\), got \(\)",
    ),
    # phases
    "increments 0": (
        lambda: jc.Phase(increments=0),
        "^increments = 0: a phase has at least 1 increment",
    ),
    "increments of vmap": (
        lambda: jax.vmap(lambda n: jc.Phase(increments=n).increments)(np.arange(1, 3)),
        "^increments = a traced number: expected an integer; .* vmap .* cannot vary it",
    ),
    "prestress without a name": (
        lambda: jc.Phase(200.0),
        r"^loads\[0\]: float is not a load; prestress has a name: Phase\(pretension=",
    ),
    "tension negative": (
        lambda: analyse(jc.Phase(pretension=[10.0, -10.0, 10.0])),
        r"^phases\[0\].pretension\[1\] = -10.0: .* tension only; must not be negative \(use Bars",
    ),
    "tension negative in one group": (
        lambda: analyse(
            jc.Phase(pretension={"net": -1.0, "tie": 5.0}), structure=net(elements=TWO)
        ),
        r"^phases\[0\].pretension\[0\] = -1.0: .* tension only; .* in elements\['net'\]",
    ),
    "a number too many in one group": (
        lambda: analyse(
            jc.Phase(pretension={"net": [1.0, 1, 1], "tie": None}), structure=net(elements=TWO)
        ),
        r"^phases\[0\].pretension: expected .* shape \(2,\), .* shape \(3,\); in elements\['net'",
    ),
    "another name of a group": (
        lambda: analyse(
            jc.Phase(pretension={"nets": 1.0, "tie": None}), structure=net(elements=TWO)
        ),
        r"^phases\[0\].pretension: no group 'nets' .* are 'net', 'tie'; did you mean 'net'\?",
    ),
    # solve
    "a scene in one piece": (
        lambda: jc.solve(jc.scenes.flat_net()),
        r"^structure: got a scene; unpack it: solve\(\*scene\)",
    ),
    "no phases": (
        lambda: jc.solve(net()),
        r"^phases: missing; give a list such as \[Phase\(pretension=",
    ),
    "a path without phases": (
        lambda: jc.trace_path(net()),
        r"^phases: missing; give a list such as \[Phase",
    ),
    "a load for the phases": (
        lambda: jc.solve(net(), push()),
        r"^phases: expected a list of Phase, got NodalLoads; loads go into a phase: \[Phase\(loads",
    ),
    "loads for phases": (
        lambda: jc.solve(net(), [push()]),
        r"^phases\[0\]: expected a Phase, got NodalLoads; loads go into a phase: Phase\(loads",
    ),
    "a phase that is not called": (
        lambda: jc.solve(net(), [jc.Phase]),
        r"^phases\[0\]: expected a Phase, got the class Phase itself; call it, as in Phase\(",
    ),
    "phases one by one": (
        lambda: jc.solve(net(), jc.Phase(pretension=1.0), PUSHED),
        r"^method: .* got Phase; phases go into one list: solve\(structure, \[first, second\]\)",
    ),
    "a method that is not called": (
        lambda: jc.solve(net(), [PUSHED], jc.Newton),
        r"^method: .* got the class Newton itself; call it, as in Newton\(\)",
    ),
    "a tolerance in newtons": (
        lambda: jc.Newton(tol=5.0),
        "^tol = 5.0: relative to the forces: from 1 on any state would pass",
    ),
    # results and design
    "a solution to describe": (
        lambda: jc.describe(jc.design.Design(*[0] * 9)),
        "^code: got a Design; give its status",
    ),
    "many codes to describe": (
        lambda: jc.describe(np.zeros(2, int)),
        r"^code: expected one code, got shape \(2,\); take one",
    ),
    "a code to raise": (
        lambda: jc.raise_if_failed(0),
        r"^raise_if_failed: expected a solution, got int; .* describe\(code\)",
    ),
    "a loss without return": (
        lambda: jc.minimize(lambda T: None, np.ones(2)),
        "^loss: expected a scalar float, .* got None; it needs a return",
    ),
    "the solution before the loss": (
        lambda: jc.minimize(lambda T: (jc.design.Design(*[0] * 9), T.sum()), np.ones(2)),
        r"^loss: expected a scalar float, or \(scalar, solution\), got a Design first",
    ),
    "bounds in pairs": (
        lambda: jc.minimize(lambda T: T.sum(), np.ones(3), bounds=[(0.0, 4.0)] * 3),
        r"^bounds: expected \(lower, upper\), .* not one pair for each parameter",
    ),
}


@pytest.mark.parametrize("name", ERRORS)
def test_what_is_wrong(name):
    make, text = ERRORS[name]
    with pytest.raises(ValueError) as error:
        make()
    assert re.search(text, str(error.value)), error.value


def stated(elements=None, **statement):
    analyse(jc.Phase(**statement), structure=net(elements=elements))


WARNINGS = {
    # units
    "stiffness in kN": (
        lambda: stated(cables(axial_stiffness=98.0), pretension=[0.0, 200.0, 0.0]),
        r"^pretension\[1\] = 200: a strain of 204 %, and steel breaks .* stiffness and forces in N",
    ),
    "modulus in MPa": (
        lambda: stated(jc.Cables(LINKS, area=1e-4, law=jc.Elastic(210e3)), pretension=200.0),
        r"^pretension\[0\] = 200: a strain of 952 %, .* moduli in Pa",
    ),
    "stiffness in kN and a force density": (
        lambda: stated(cables(axial_stiffness=98.0), force_density=200.0),
        r"^force_density\[0\] = 200: a strain of 204 %",
    ),
    "stiffness in kN and a load": (
        lambda: analyse(PUSHED, structure=net(elements=cables(axial_stiffness=0.5))),
        r"^loads of phases\[0\]: 1 N on node 1, .* 1.5 N together: strained by 66.7 % .* in N",
    ),
    "load in another phase": (
        lambda: analyse(
            jc.Phase(pretension=0.01), PUSHED, structure=net(elements=cables(axial_stiffness=0.5))
        ),
        r"^loads of phases\[1\]: 1 N on node 1",
    ),
    "prestrain in per cent": (
        lambda: stated(prestrain=jc.only([2], 0.2)),
        r"^prestrain\[2\] = 0.2: a strain of 20 %, .* a ratio, not a percentage",
    ),
    "strain of a curve in per cent": (
        lambda: jc.Polygonal([0, 0.2, 5.0], [0, 4e8, 5e8]),
        r"^strain\[2\] = 5: more than 1; it is a ratio, not a percentage",
    ),
    "strain and stress exchanged": (
        lambda: jc.Polygonal([0, 4e8, 5e8], [0, 0.002, 0.05]),
        r"^strain\[2\] = 5e\+08: more than 1",
    ),
    "unstressed length in mm": (
        lambda: stated(rest_length=[1.0, 999.0, 1.0]),
        r"^rest_length\[1\] = 999: its nodes are 1 m apart; is it in m",
    ),
    "nodes in mm beside an unstressed length": (
        lambda: net(1e3 * NODES, {"net": cables(rest_length=0.999)}),
        r"^elements\['net'\].rest_length\[0\] = 0.999: its nodes are 1e\+03 m apart; is it in m",
    ),
    "area in mm2": (
        lambda: net(elements=jc.Cables(LINKS, area=[1e-4, 314.0, 1e-4], law=STEEL)),
        r"^elements.area\[1\] = 314: thicker than the element is long; is it in m2",
    ),
    "section in mm": (
        lambda: net(
            elements={"mast": jc.Beams(LINKS, section=jc.Section.rectangle(100.0, 200.0, STEEL))}
        ),
        r"^elements\['mast'\].section: fibres 180 m apart, further than all nodes; is it in m",
    ),
    "expansion in 1e-6": (
        lambda: stated(cables(expansion=12.0), temperature=30.0),
        r"^temperature\[0\] = 30: a strain of 3.6e\+04 %, .* is expansion in 1/K",
    ),
    "more than the strength": (
        lambda: stated({"net": cables(strength=[20.0, 5.0, 20.0])}, pretension=10.0),
        r"^pretension\['net'\]\[1\] = 10: more than the strength of the element",
    ),
    # what acts on nothing
    "loads on fixed nodes": (
        lambda: analyse(jc.Phase(loads=push([2, 3]))),
        r"^loads of phases\[0\]: all of them act on supports \(node 2\) .* look at the numbers",
    ),
    "supports on all nodes": (
        lambda: analyse(jc.Phase(pretension=1.0), structure=net(supports=range(4))),
        r"^supports of phases\[0\]: every node is held, .* names the anchors only",
    ),
    "two nodes that should be one": (
        lambda: net(DOUBLED, cables([[0, 1], [4, 2], [1, 3]])),
        r"^nodes\[4\]: at the place of nodes\[1\] and not joined to it; .* one number in links",
    ),
}


@pytest.mark.parametrize("name", WARNINGS)
def test_what_is_suspicious(name):
    make, text = WARNINGS[name]
    with pytest.warns(jc.InputWarning) as seen:
        make()
    assert len(seen) == 1
    assert re.search(text, str(seen[0].message)), seen[0].message
    assert seen[0].filename == __file__  # where the person can change it


ODD = {
    "loads on supports as well": lambda: analyse(jc.Phase(loads=push([1, 2]))),
    "loads on supports beside prestress": lambda: analyse(
        jc.Phase(pretension=1.0, loads=push([2]))
    ),
    "no load at all": lambda: analyse(jc.Phase(loads=push([2], (0.0, 0, 0)))),
    "all held, one moved": lambda: analyse(
        jc.Phase(loads=jc.SupportMovement([1], (0.001, 0, 0))), structure=net(supports=range(4))
    ),
    "two anchors at one place": lambda: net(
        NODES[[0, 1, 2, 3, 0]], cables([[0, 1], [1, 2], [4, 3]]), (0, 2, 4)
    ),
    "much slack": lambda: stated(rest_length=50.0),
    "slack by its strain": lambda: stated(prestrain=-0.3),
    "catenaries between anchors": lambda: analyse(
        jc.Phase(),
        structure=net(
            elements=jc.Catenaries(LINKS, axial_stiffness=1e4, weight=1.0), supports=range(4)
        ),
    ),
    "weights between anchors": lambda: analyse(
        jc.Phase(loads=jc.SelfWeight()),
        structure=net(elements=cables(weight=1.0), supports=range(4)),
    ),
    "numbers that become a status": lambda: analyse(
        jc.Phase(pretension=[1.0, np.inf, np.nan], loads=push(force=(np.inf, 0, np.nan)))
    ),
    "gravity upwards": lambda: analyse(
        jc.Phase(loads=jc.SelfWeight((0, 0, 9.81))), structure=net(elements=cables(weight=1.0))
    ),
    "stiff elements beside soft ones": lambda: analyse(
        PUSHED, structure=net(elements=cables(axial_stiffness=[1e-3, 1e-3, 1e4]))
    ),
    "a load that beams bear": lambda: analyse(
        jc.Phase(loads=push([1], (0, 0, -1e4))),
        structure=net(
            elements={
                "stay": cables(axial_stiffness=10.0),
                "beam": jc.Beams([[0, 3], [3, 1]], section=BEAM),
            }
        ),
    ),
}


@pytest.mark.parametrize("name", ODD)
def test_what_is_odd_and_legitimate_is_silent(name):
    """Warnings are errors in this suite."""
    ODD[name]()


def test_results_are_computed_all_the_same():
    structure = net(NODES[:3], cables(LINKS[:2], axial_stiffness=98.0), (0, 2))
    with pytest.warns(jc.InputWarning, match="a strain of 204 %"):
        solution = jc.solve(structure, [jc.Phase(pretension=200.0)])
    assert jc.describe(solution.status) == "converged"
    assert solution.tension == pytest.approx(200.0, rel=1e-12)  # straight: nothing moves


def test_traced_numbers_are_not_looked_at():
    """A batch may hold anything: it ends in statuses, case by case."""

    def judged(number):
        group = cables(axial_stiffness=number, rest_length=number, area=None, strength=number)
        structure = net(number * NODES, group)
        phase = jc.Phase(pretension=1e6 * number, loads=push([2], number * jnp.ones(3)))
        prepare(structure, [phase], None, None)
        prepare(structure, [jc.Phase(loads=push([2], number * jnp.ones(3)))], None, None)
        return number

    assert jax.eval_shape(judged, 1e-6).shape == ()
    with pytest.warns(jc.InputWarning):  # control
        judged(jnp.asarray(1e-6))


SINGLE = """
import warnings
import jax
import numpy as np
import jaxcable as jc
from jaxcable.analysis.preparation import prepare

def structure(nodes):
    return jc.Structure(nodes, jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e4), jc.pinned([0, 2]))

def count(function, nodes):
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        function(structure(nodes))
    return [str(w.message) for w in seen if w.category is jc.InputWarning]

def analyse(structure):
    prepare(structure, [jc.Phase(pretension=10.0)], None, None)

def form(structure):
    jax.eval_shape(lambda q: jc.force_density(structure, q), 1.0)

nodes = [[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]]
print(count(analyse, nodes), count(analyse, np.array(nodes, np.float32)))
print(len(count(form, nodes)))
"""


def test_float32_by_accident():
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    environment.pop("JAX_ENABLE_X64", None)
    run = subprocess.run(
        [sys.executable, "-c", SINGLE], env=environment, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    told, forms = run.stdout.splitlines()
    assert re.match(
        r"\['nodes: float64, but jax works in float32 .*jax_enable_x64\", True\) .*"
        r"nodes.astype\(numpy.float32\).*'\] \[\]$",
        told,
    ), told
    assert forms == "1"


def test_warnings_can_be_silenced_by_their_category():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jc.InputWarning)
        analyse(jc.Phase(loads=push([2])))
    assert issubclass(jc.InputWarning, UserWarning)
