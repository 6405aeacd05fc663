"""The table of rules: every number that is refused when it is known fails when it is traced.

A row has a good and a bad number for one rule. Known, the bad one is a ValueError that names the
argument; traced, it is a status or NaN, while the good one passes both ways. The test that reads
the source fails for a new rule without a row.
"""

import ast
import functools
from collections import Counter, namedtuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rooms import PACKAGE

import jaxcable as jc
from jaxcable import forms
from jaxcable.analysis.preparation import prepare, verdicts
from jaxcable.analysis.solution import State
from jaxcable.common import status
from jaxcable.common.tree import fill, thaw
from jaxcable.design.arguments import is_tolerance, tolerance, width_of
from jaxcable.design.box import spread
from jaxcable.mechanics.carry import unloaded
from jaxcable.paths.trace import _settings

NODES = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.2], [2.0, 0.0, 0.0]])
LINKS = np.array([[0, 1], [1, 2]])
PULL = jc.NodalLoads([1], (0.0, 0.0, 1.0))
DISC = jc.Section.disc(0.1, jc.Elastic(2e11), shape=(2, 2))
SOFTENING = jc.Polygonal([-1.0, 0.0, 1e-3, 2e-3], [-1e9, 0.0, 1e6, 5e5])
LAW = jc.Polygonal([0.0, 1e-3], [0.0, 1e6])


def code(structure, phases=None, method=None):
    """The verdict of `solve` on numbers, as its compiled core finds it: no analysis is compiled."""
    phases = jc.Phase(loads=PULL) if phases is None else phases
    task = prepare(structure, phases, method, None)
    return jnp.max(verdicts(fill(task.thawed, task.arrays), task.method)[1])


def net(nodes=NODES, kind=jc.Cables, links=LINKS, **numbers):
    if not any(name in numbers for name in ("axial_stiffness", "area", "section")):
        numbers["axial_stiffness"] = 1e3
    return jc.Structure(nodes, kind(links, **numbers), supports=jc.pinned([0, 2]))


def of_group(name, kind=jc.Cables, **others):
    return lambda v: code(net(kind=kind, **{name: jnp.array([1.0, 1.0]) * v}, **others))


def frame(**numbers):
    beams = jc.Beams(LINKS, **{"section": DISC, "up": (0.0, 1.0, 0.0)} | numbers)
    return jc.Structure(NODES, beams, supports=jc.clamped([0]))


def law(strain, stress, unloading="reversible"):
    own = jc.Polygonal(jnp.asarray(strain), jnp.asarray(stress), unloading)
    return code(net(kind=jc.Bars, area=1.0, law=own))


def stated(name, kind=jc.Cables, **numbers):
    """A phase's statement for one cable of two, so that nothing is said of the other."""
    return lambda v: code(net(kind=kind, **numbers), jc.Phase(**{name: jc.only([1], v)}))


def plumb(v):
    """A stated sag of a cable whose ends are `v` apart in plan, 0.2 m in height."""
    nodes = jnp.asarray(NODES).at[1, 0].set(v)
    phase = jc.Phase(sag=jc.only([0], 0.1), loads=jc.SelfWeight())
    return code(net(nodes, jc.Catenaries, weight=1.0), phase)


def section(make):
    return lambda v: make(v).area


def settings(name):
    def make(v):
        numbers = {"until": 1.0, "down_to": -1.0, "step": 0.1, "largest": 0.1, "tol": 1e-9}
        own = _settings(net(), *(numbers | {name: v}).values(), True)
        task = prepare(net(), jc.Phase(loads=PULL), None, None)
        return verdicts(fill(task.thawed, task.arrays), task.method, own)[1][0]

    return make


BARS = jc.Structure(NODES, jc.Bars(LINKS, axial_stiffness=1e3), supports=jc.pinned([0, 2]))
PRISM = jc.scenes.simplex()[0]
STRESSED = jc.solve(net(), jc.Phase(pretension=1.0))


def relaxed(v):
    """Form of two cables, one of a tension, one of a length, to a tolerance; NaN if not found."""
    tension, rest_length = jc.only([0], v[0]), jc.only([1], v[1])
    found = forms.dynamic_relaxation(net(), tension, rest_length, loads=PULL, tol=v[2])
    return jnp.where(found.status == 0, found.positions, jnp.nan)


def formed(name, structure=None, **others):
    structure = net() if structure is None else structure
    return lambda v: forms.prescribed.statements(
        structure, **{"tension": None, "stress": None, "length": None} | others | {name: v}
    )[0 if name != "length" else 2]


def _cables():
    return int(forms.symmetric_groups(PRISM, fold=3)["verticals"][0])


def chain(v):
    return forms.hanging_chain((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2, v[0], v[1], v[2])


def swinging(v):
    structure = net(weight=1.0)
    found = jc.stiffness.natural_frequencies(
        structure, unstrained(structure), gravity=v[0], masses=v[1:]
    )
    return found.squared


def unstrained(structure):
    """A state of a structure that nothing has happened to, without an analysis."""
    rows, groups = structure.rows()
    assert rows is None
    zero, fixed = jnp.zeros((3, 3)), structure.fixed(structure.supports)
    carry = unloaded(jnp.asarray(structure.nodes), fill(*thaw(groups)))
    named = {"rotation": carry.motion[:, 3:]} if carry.motion.shape[1] == 7 else {}
    return State(zero, structure.nodes, None, None, zero, zero, 0, 1.0, carry, (fixed,), **named)


def thickness(v):
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return jc.sections.bredt_torsion(square, v)


def composed(v):
    return jc.Section.composite([DISC, DISC.shifted(z=0.2)], torsion=v).torsion


def spun(v):
    """Both ends of the first element are hinges about its axis; a spring holds one of them."""
    turns = np.zeros((2, 2, 3), bool)
    turns[0, :, 0] = True
    own = frame(hinges=turns, springs=jnp.zeros((2, 2, 3)) + v).elements.springs
    return own


Row = namedtuple("Row", "site argument run good bad")
GROUP, BEAM, POINTS = "elements/straight.py", "elements/beam.py", "materials/points.py"
PHASE, SHAPES, RUN = "analysis/prestress_rules.py", "sections/shapes.py", "paths/run.py"
AXIS = (0.0, 1.0, 0.0)

TABLE = [
    *[
        Row(f"{GROUP}:{name}", rf"{name}\[0\] = -1.0", of_group(name, **more), 1.0, -1.0)
        for name, more in {
            "axial_stiffness": {},
            "area": {"law": jc.Elastic(1e3)},
            "rest_length": {},
            "strength": {},
            "weight": {},
            "compliance": {},
        }.items()
    ],
    Row(
        f"{GROUP}:compliance",
        "compliance: section.laws.* falls",
        lambda v: code(
            net(
                kind=jc.Bars,
                compliance=1e-12,
                section=jc.Section.composite(
                    [
                        DISC,
                        jc.Section.disc(
                            0.1, jc.Polygonal([-1.0, 0.0, 1e-3, 2e-3], v), shape=(2, 2)
                        ),
                    ],
                    torsion=jnp.ones(2),
                ),
            )
        ),
        [-1e9, 0.0, 1e6, 2e6],
        [-1e9, 0.0, 1e6, 5e5],
    ),
    *[
        Row(
            f"{BEAM}:{name}", f"{name}.* = -1.0", lambda v, n=name: code(frame(**{n: v})), 1.0, -1.0
        )
        for name in ("torsional_stiffness", "rest_length", "strength", "weight")
    ],
    Row(
        f"{BEAM}:springs",
        "springs.* = -1.0",
        lambda v: code(frame(springs=v, hinges=[[True, False]] * 2)),
        1.0,
        -1.0,
    ),
    Row(f"{BEAM}:springs", r"hinges\[0\]: both ends", spun, 1.0, 0.0),
    Row(
        f"{BEAM}:up",
        r"up\[0\].*must not be along",
        lambda v: code(frame(up=v)),
        AXIS,
        (5.0, 0.0, 1.0),
    ),
    Row(
        "elements/sliding.py:nodes",
        r"links\[0\]: its nodes \[0, 1\] coincide",
        lambda v: code(net(NODES * v, jc.SlidingCables, [[0, 1, 2]])),
        1.0,
        np.array([[1.0], [0.0], [1.0]]),
    ),
    Row(
        "model/structure.py:nodes",
        r"links\[0\] = \[0, 1\]: zero length",
        lambda v: code(net(NODES * v)),
        1.0,
        np.array([[1.0], [0.0], [1.0]]),
    ),
    # laws
    Row(
        "materials/elastic.py:E",
        "E = -1.0",
        lambda v: code(net(area=1.0, law=jc.Elastic(v))),
        1.0,
        -1.0,
    ),
    *[
        Row(f"{POINTS}:strain", text, lambda v: law(v, [0.0, 1e6, 1.5e6]), [0.0, 1e-3, 2e-3], bad)
        for text, bad in {
            r"strain\[2\] = inf: must be finite": [0.0, 1e-3, np.inf],
            r"strain\[2\] = 0.001: must be above": [0.0, 1e-3, 1e-3],
            "strain: goes from 0.001": [1e-3, 2e-3, 3e-3],
        }.items()
    ],
    *[
        Row(
            f"{POINTS}:stress",
            text,
            lambda v, how=how: law([-1e-3, -5e-4, 0.0, 1e-3, 2e-3], v, how),
            [-5e5, -5e5, 0.0, 1e6, 1e6],
            bad,
        )
        for text, how, bad in (
            (r"stress\[2\] = 5.0: at zero", "reversible", [-1e6, -5e5, 5.0, 1e6, 1e6]),
            ("slope at the origin, -1e", "reversible", [-1e6, -5e5, 0.0, -1e6, 1e6]),
            (r"stress\[4\] = -1.0: of the other", "reversible", [-1e6, -5e5, 0.0, 1e6, -1.0]),
            (r"stress\[3\]: elastic .* concave", "elastic", [-5e5, -5e5, 0.0, 1e6, 3e6]),
            (r"stress\[3\]: elastic .* concave", "elastic", [-5e5, -5e5, 0.0, 1e6, 5e5]),
            ("segment 0 from the origin", "elastic", [-6e5, -6e5, 0.0, 1e6, 1e6]),
        )
    ],
    Row(
        f"{POINTS}:stress",
        "the curve has 500000 Pa at zero strain",
        lambda v: law([-1e-3, 1e-3], v),
        [-1e6, 1e6],
        [-1e6, 2e6],
    ),
    # sections
    Row(
        "sections/section.py:area",
        r"area\[0\] = -1.0",
        lambda v: code(
            frame(section=jc.Section([0.0, 0.1], [0.0, 0.1], v, DISC.laws, None, [1.0]))
        ),
        [1.0, 1.0],
        [-1.0, 1.0],
    ),
    Row(
        f"{SHAPES}:_positive", "diameter = -1", section(lambda v: jc.Section.disc(v, LAW)), 1.0, -1
    ),
    Row(
        f"{SHAPES}:_within",
        "thickness = 0.6: twice",
        section(lambda v: jc.Section.ring(1.0, v, LAW)),
        0.1,
        0.6,
    ),
    Row("sections/torsion.py:thickness", "thickness = -1.0", thickness, 1.0, -1.0),
    Row("sections/composites.py:torsion", "torsion = -1.0", composed, 1.0, -1.0),
    # phases and loads
    *[
        Row(f"{PHASE}:value_rules", rf"{name}\[0\] = {bad}", stated(name, kind, **more), good, bad)
        for name, kind, more, good, bad in (
            ("rest_length", jc.Cables, {}, 1.0, -1.0),
            ("prestrain", jc.Cables, {}, 0.1, -1.0),
            ("sag", jc.Catenaries, {"weight": 1.0}, 0.1, -0.1),
            ("pretension", jc.Cables, {}, 1.0, -1.0),
            ("force_density", jc.Cables, {}, 1.0, -1.0),
            ("jacking", jc.Cables, {}, 100.0, -100.0),
        )
    ],
    *[
        Row(
            f"{PHASE}:capacity_rules",
            rf"{name}\[1\] = 1000001.0: above what its law",
            stated(name, area=1.0, law=LAW),
            1e6,
            1e6 + 1.0,
        )
        for name in ("pretension", "jacking")
    ],
    Row(f"{PHASE}:span_rules", r"sag\[0\]: the nodes of the element lie", plumb, 1.0, 0.0),
    Row(
        "loads/pressure.py:axis",
        "axis: is zero",
        lambda v: code(net(), jc.Phase(loads=jc.CablePressure(1.0, v))),
        AXIS,
        (0.0, 0.0, 0.0),
    ),
    # methods
    *[
        Row(
            f"equilibrium/newton.py:{name}",
            text,
            lambda v, n=name: code(net(), None, jc.Newton(**{n: v})),
            good,
            bad,
        )
        for name, text, good, bad in (
            ("tol", "tol = -1.0: must be pos", 1e-9, -1.0),
            ("tol", "tol = 1000.0: relative", 1e-9, 1e3),
            ("max_steps", "max_steps = 0.0: must be pos", 3.0, 0.0),
            ("max_steps", "max_steps = 2.5: expected a whole", 3.0, 2.5),
        )
    ],
    Row(
        "equilibrium/incremental.py:tol",
        "tol = nan",
        lambda v: code(net(), None, jc.Incremental(tol=v)),
        0.1,
        np.nan,
    ),
    *[
        Row(f"{RUN}:{name}", f"{name} = {bad}", settings(name), -bad, bad)
        for name, bad in {
            "until": -1.0,
            "down_to": 1.0,
            "step": -0.1,
            "largest": -0.1,
            "tol": -1e-9,
        }.items()
    ],
    # what is asked of states
    *[
        Row(f"stiffness/vibration.py:{name}", f"{name}.* = -1.0", swinging, [1.0] * 4, bad)
        for name, bad in {
            "gravity": [-1.0, 1.0, 1.0, 1.0],
            "masses": [1.0, 1.0, -1.0, 1.0],
        }.items()
    ],
    Row(
        "results/internal_forces.py:places",
        r"places\[0\] = 1.5",
        lambda v: jc.section_forces(frame(), unstrained(frame()), v),
        [0.5],
        [1.5],
    ),
    # form finding
    *[
        Row(f"forms/relaxation.py:{name}", f"{name}.* = -1.0", relaxed, [5.0, 1.0, 1e-9], bad)
        for name, bad in {
            "tension": [-1.0, 1.0, 1e-9],
            "rest_length": [5.0, -1.0, 1e-9],
            "tol": [5.0, 1.0, -1.0],
        }.items()
    ],
    Row("forms/prescribed.py:_pulling", r"tension\[0\] = -1.0", formed("tension"), 1.0, -1.0),
    Row(
        "forms/prescribed.py:_pulling",
        r"stress\[0\] = -1.0",
        formed("stress", net(area=1.0, law=jc.Elastic(1e3))),
        1.0,
        -1.0,
    ),
    Row("forms/prescribed.py:statements", r"length\[0\] = -1.0", formed("length"), 1.0, -1.0),
    Row(
        "forms/force_density.py:force_density",
        r"q\[0\] = -1.0",
        lambda v: jc.force_density(net(), v, PULL),
        1.0,
        -1.0,
    ),
    *[
        Row("forms/hanging.py:hanging_chain", f"{name} = -1.0", chain, [0.1, 1.0, 1e6], bad)
        for name, bad in {
            "sag": [-1.0, 1.0, 1e6],
            "weight": [0.1, -1.0, 1e6],
            "axial_stiffness": [0.1, 1.0, -1.0],
        }.items()
    ],
    Row(
        "forms/hanging.py:second",
        "first, second: the ends lie above each other",
        lambda v: forms.hanging_chain((0.0, 0.0, 0.0), v, 3, 0.1, 1.0, 1e6)[0],
        (1.0, 0.0, 0.2),
        (0.0, 0.0, 0.2),
    ),
    Row(
        "design/box.py:fill",
        r"scale\[1\] = -1.0",
        lambda v: spread(v, jnp.ones(2), "scale", positive=True),
        [1.0, 1.0],
        [1.0, -1.0],
    ),
    Row(
        "design/arguments.py:tol",
        "tol = 1.0",
        lambda v: jnp.where(is_tolerance(tolerance(v, 1e-3)), 1.0, jnp.nan),
        0.5,
        1.0,
    ),
    Row("design/arguments.py:width", "width = 0.0", width_of, 0.1, 0.0),
    Row(
        "design/targets.py:value",
        "value = nan",
        lambda v: jc.design.Target("tension", v).value,
        1.0,
        np.nan,
    ),
    Row(
        "design/targets.py:within",
        "within = 0.0",
        lambda v: jc.design.Target("tension", within=v).within,
        1.0,
        0.0,
    ),
    Row(
        "design/influence.py:rcond",
        "rcond = 1.0",
        lambda v: jc.design.adjustment(jnp.eye(2), jnp.ones(2), rcond=v),
        0.1,
        1.0,
    ),
    Row(
        "design/influence.py:tolerance",
        r"tolerance\[1\] = -1.0",
        lambda v: jc.design.scatter(jnp.eye(2), v)[0],
        [1.0, 1.0],
        [1.0, -1.0],
    ),
    Row(
        "design/objectives.py:material_use",
        "stress = -1.0",
        lambda v: jc.design.material_use(STRESSED, v),
        1.0,
        -1.0,
    ),
    Row(
        "forms/feasible.py:tension",
        r"tension = -1.0: with group \d so",
        lambda v: (
            forms.feasible_prestress(
                PRISM, forms.symmetric_groups(PRISM, fold=3), group=_cables(), tension=v
            ).group_tension
        ),
        1.0,
        -1.0,
    ),
    Row(
        "materials/presets.py:_positive",
        "yield_stress = -1.0",
        lambda v: code(net(area=1.0, law=jc.materials.steel(v))),
        1e8,
        -1.0,
    ),
]


def fails(outcome):
    """Whether an outcome says that it is none: a status, or NaN in numbers."""
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(outcome)]
    codes = [leaf for leaf in leaves if leaf.dtype == np.int32]
    if codes:
        assert set(np.unique(codes)) <= {status.OK, status.INVALID_INPUT}
        return codes[0] == status.INVALID_INPUT
    return any(np.isnan(leaf).any() for leaf in leaves if leaf.dtype == float)


def ids(rows):
    return [f"{k} {row.site} {row.argument}" for k, row in enumerate(rows)]


@pytest.mark.filterwarnings("ignore::jaxcable.InputWarning")
@pytest.mark.parametrize("row", TABLE, ids=ids(TABLE))
def test_a_number_that_is_refused_when_known_fails_when_traced(row):
    good, bad = (np.asarray(v, float) for v in (row.good, row.bad))
    jax.eval_shape(lambda: row.run(good))  # known, and not refused
    with pytest.raises(ValueError, match=row.argument):
        row.run(bad)
    traced = jax.jit(row.run)
    assert not fails(traced(good))
    assert fails(traced(bad))


# --- no rule without a row

MAKERS = ("Rule", "positive", "not_negative")

OTHERWISE = {
    "analysis/absent.py:_states_nothing": "a traced increment may be other than zero: it counts",
    "analysis/absent.py:_judge_array": "a warning",
    "analysis/preparation.py:_may_warn": "no rule: whether a warning can be given",
    "loads/groups.py:scattered": "no rule: which library computes",
    "loads/nodal.py:__str__": "no rule: what is said of it",
    "elements/beam.py:unused_columns": "no rule: layers on one line have nothing across it",
    "elements/beam.py:_differs": "a lean without `up` is NaN in `Beams.start`",
    "materials/polygonal.py:__post_init__": "no rule: puts the origin among known points",
    "sections/torsion.py:bredt_torsion": "a traced outline is not asked whether it crosses itself",
    "sections/torsion.py:are_round": "no rule: which library computes",
    "sections/arrays.py:stack": "no rule: which library computes",
    "sections/arrays.py:concatenate": "no rule: which library computes",
    "sections/shapes.py:_float": "no rule: which library computes",
    "sections/outlines.py:corners": "traced outlines are refused",
    "sections/composites.py:_summed": "NaN where it is traced",
    "model/structure.py:__post_init__": "warnings; the rules of places are asked in any case",
    "design/box.py:check": "bounds that are traced end in the status OUTSIDE (`Box.holds`)",
    "stiffness/vibration.py:_with_mass": "no rule: how many modes have mass",
    "stiffness/vibration.py:natural_frequencies": "NaN where it is traced: an unsymmetric tangent",
    "stiffness/vibration.py:_suspect_catenaries": "no rule: a warning",
    "stiffness/buckling.py:buckling_factor": "NaN where it is traced",
    "stiffness/buckling.py:_have_unstressed": "NaN where it is traced",
    "model/supports.py:_directions": "traced directions are refused",
    "model/spins.py:free_spins": "a warning",
    "model/spins.py:warn": "a warning",
    "model/plausibility.py:_there": "warnings",
    "loads/movement.py:__post_init__": "a warning",
    "loads/movement.py:check_supported": "NaN where it is traced (`ramp`), status NONFINITE",
    "forms/feasible.py:feasible_prestress": "NaN where a cable is not taut",
    "forms/_balance.py:host_nodes": "traced nodes are refused",
}
"""Where else values are looked at when they are known, and what becomes of traced ones."""


def calls(node, function=None):
    """Calls in a piece of source by name, each with the function that it stands in."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Call) and function is not None:
            yield getattr(child.func, "attr", getattr(child.func, "id", None)), child, function
        yield from calls(child, child if isinstance(child, ast.FunctionDef) else function)


def arguments(call, function):
    """What a call that makes a rule is about: constants, those of a loop, or its function."""
    first = call.args[0]
    if isinstance(first, ast.Constant):
        return [first.value]
    loops = {}
    for node in ast.walk(function):
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple):
            loops[ast.unparse(node.targets[0])] = node.value
    for node in ast.walk(function):
        if isinstance(node, ast.For | ast.ListComp) and call in ast.walk(node):
            loop = node if isinstance(node, ast.For) else node.generators[0]
            over = loops.get(ast.unparse(loop.iter), loop.iter)
            if isinstance(over, ast.Tuple) and isinstance(over.elts[0], ast.Constant):
                return [item.value for item in over.elts]
    return [function.name]


def test_every_rule_has_a_row():
    rules, looks = Counter(), set()
    for path in PACKAGE.rglob("*.py"):
        module = str(path.relative_to(PACKAGE))
        if module in ("common/rules.py", "common/checks.py"):
            continue
        for name, call, function in calls(ast.parse(path.read_text())):
            if name in MAKERS:
                rules.update(f"{module}:{argument}" for argument in arguments(call, function))
            if name == "concrete":
                looks.add(f"{module}:{function.name}")
    rows = Counter(row.site for row in TABLE)
    assert not rules - rows, "rules without a row in TABLE"
    assert not set(rows) - set(rules), "rows of no rule"
    assert looks == set(OTHERWISE)


# --- what a verdict does


@jax.jit
@functools.partial(jax.value_and_grad, has_aux=True)
def moved(load, cases):
    """How far the middle of two cables goes in some cases, those that fail left out."""

    def one(stiffness, area, jack, tol):
        law = jc.Polygonal([0.0, 0.1], [0.0, 0.1 * stiffness])
        phase = jc.Phase(
            jacking=jc.only([0], jack), loads=jc.NodalLoads([1], load * np.array([0.0, 0.0, -1.0]))
        )
        return jc.solve(net(area=area, law=law), phase, jc.Newton(tol=tol))

    solved = jax.vmap(one)(*cases)
    return jnp.sum(jnp.where(solved.status == 0, solved.last.displacement[:, 1, 2], 0.0)), solved


GOOD, COUNT = (1e3, 1.0, 10.0, 1e-10), 5
CASES = [GOOD, (-1e3, 1.0, 10.0, 1e-10), (1e3, -1.0, 10.0, 1e-10), (1e3, 1.0, -10.0, 1e-10)]
CASES.append((1e3, 1.0, 10.0, 1e3))


def test_a_case_with_a_bad_number_fails_alone():
    """In a batch: nothing of it is a number, and what the others share keeps its gradient."""
    (total, solved), gradient = moved(1.0, jnp.array(CASES).T)
    assert solved.status.tolist() == [0] + 4 * [status.INVALID_INPUT]
    assert np.isfinite(solved.tension[0]).all() and np.isnan(solved.tension[1:]).all()
    assert (solved.phases[0].path.status == solved.status[:, None]).all()
    (each, alone), slope = moved(1.0, jnp.array(COUNT * [GOOD]).T)
    assert (alone.status == 0).all() and slope != 0
    np.testing.assert_allclose(total, each / COUNT, rtol=1e-12)  # one program, the same numbers
    np.testing.assert_allclose(gradient, slope / COUNT, rtol=1e-12)
    # where only phase 1 could be judged the last state is that of the structure, else there is none
    last = np.isfinite(solved.last.displacement).all(axis=(1, 2))
    assert last.tolist() == [True, False, False, True, True]


@pytest.mark.slow
@pytest.mark.parametrize(
    "analyse",
    [
        lambda structure, phase: jc.solve(structure, phase, jc.Incremental(tol=np.inf)),
        lambda structure, phase: jc.trace_path(structure, phase),
        lambda structure, phase: jc.find_form(structure, 10.0, PULL),
        lambda structure, phase: forms.dynamic_relaxation(structure, 10.0, loads=PULL),
    ],
    ids=["incremental", "trace_path", "find_form", "relaxation"],
)
def test_other_analyses_fail_likewise(analyse):
    def one(stiffness):
        structure = net(axial_stiffness=stiffness)
        return analyse(structure, jc.Phase(pretension=10.0, loads=PULL)).status

    codes = jax.jit(jax.vmap(one))(jnp.array([1e3, -1e3]))
    assert codes.tolist() == [0, status.INVALID_INPUT]
