"""The table of rules: every number that is refused when it is known fails when it is traced.

A row has a good and a bad number for one rule. Known, the bad one is a ValueError with this
message; traced, it is a status or NaN, while the good one passes both ways.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

import jaxcable as jc
from jaxcable import design, forms
from jaxcable.analysis.preparation import prepare, verdicts
from jaxcable.analysis.solution import State
from jaxcable.common.tree import fill, thaw
from jaxcable.design.arguments import is_tolerance, tolerance, width_of
from jaxcable.design.box import spread
from jaxcable.mechanics.carry import unloaded
from jaxcable.paths.trace import _settings

NODES = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.2], [2.0, 0.0, 0.0]])
LINKS = np.array([[0, 1], [1, 2]])
JOINED = np.array([[1.0], [0.0], [1.0]])
"""Times nodes: the first link has no length."""
PULL = jc.NodalLoads([1], (0.0, 0.0, 1.0))
DISC = jc.Section.disc(0.1, jc.Elastic(2e11), shape=(2, 2))
LAW = jc.Polygonal([0.0, 1e-3], [0.0, 1e6])
AXIS = (0.0, 1.0, 0.0)


def code(structure, phases=None, method=None):
    """The verdict of `solve` on numbers, as its compiled core finds it: no analysis is compiled."""
    phases = jc.Phase(loads=PULL) if phases is None else phases
    task = prepare(structure, phases, method, None)
    return jnp.max(verdicts(fill(task.thawed, task.arrays), task.method)[1])


def net(nodes=NODES, kind=jc.Cables, links=LINKS, **numbers):
    if not any(name in numbers for name in ("axial_stiffness", "area", "section")):
        numbers["axial_stiffness"] = 1e3
    return jc.Structure(nodes, kind(links, **numbers), supports=jc.pinned([0, 2]))


def rope(v):
    return code(net(NODES * v, jc.SlidingCables, [[0, 1, 2]]))


def frame(**numbers):
    beams = jc.Beams(LINKS, **{"section": DISC, "up": AXIS} | numbers)
    return jc.Structure(NODES, beams, supports=jc.clamped([0]))


def of_cables(name, **others):
    return lambda v: code(net(**{name: jnp.array([1.0, 1.0]) * v}, **others))


def of_beams(name, **others):
    return lambda v: code(frame(**{name: v}, **others))


def softened(v):
    """A spring in series with a section of two laws, one of stresses `v`."""
    law = jc.Polygonal([-1.0, 0.0, 1e-3, 2e-3], v)
    parts = [DISC, jc.Section.disc(0.1, law, shape=(2, 2))]
    section = jc.Section.composite(parts, torsion=jnp.ones(2))
    return code(net(kind=jc.Bars, compliance=1e-12, section=section))


def spun(v):
    """Both ends of the first element are hinges about its axis; a spring holds one of them."""
    turns = np.zeros((2, 2, 3), bool)
    turns[0, :, 0] = True
    return frame(hinges=turns, springs=jnp.zeros((2, 2, 3)) + v).elements.springs


def curve(strain, stress, unloading="reversible"):
    law = jc.Polygonal(jnp.asarray(strain), jnp.asarray(stress), unloading)
    return code(net(kind=jc.Bars, area=1.0, law=law))


def of_strains(v):
    return curve(v, [0.0, 1e6, 1.5e6])


def through_origin(v):
    return curve([-1e-3, 1e-3], v)


def of_stresses(unloading):
    return lambda v: curve([-1e-3, -5e-4, 0.0, 1e-3, 2e-3], v, unloading)


STRESS = [-5e5, -5e5, 0.0, 1e6, 1e6]


def fibres(v):
    return code(frame(section=jc.Section([0.0, 0.1], [0.0, 0.1], v, DISC.laws, None, [1.0])))


def thickness(v):
    return jc.sections.bredt_torsion(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]), v)


def composed(v):
    return jc.Section.composite([DISC, DISC.shifted(z=0.2)], torsion=v).torsion


def drawn_steel(v):
    return code(net(area=1.0, law=jc.materials.steel(v)))


def stated(name, kind=jc.Cables, **numbers):
    """A phase's statement for one cable of two, so that nothing is said of the other."""
    return lambda v: code(net(kind=kind, **numbers), jc.Phase(**{name: jc.only([1], v)}))


def plumb(v):
    """A stated sag of a cable whose ends are `v` apart in plan, 0.2 m in height."""
    nodes = jnp.asarray(NODES).at[1, 0].set(v)
    phase = jc.Phase(sag=jc.only([0], 0.1), loads=jc.SelfWeight())
    return code(net(nodes, jc.Catenaries, weight=1.0), phase)


def of_method(kind, name):
    return lambda v: code(net(), None, kind(**{name: v}))


def pressed(axis):
    return code(net(), jc.Phase(loads=jc.CablePressure(1.0, axis)))


def of_path(name):
    def make(v):
        numbers = {"until": 1.0, "down_to": -1.0, "step": 0.1, "largest": 0.1, "tol": 1e-9}
        own = _settings(net(), *(numbers | {name: v}).values(), True)
        task = prepare(net(), jc.Phase(loads=PULL), None, None)
        return verdicts(fill(task.thawed, task.arrays), task.method, own)[1][0]

    return make


def unstrained(structure):
    """A state of a structure that nothing has happened to, without an analysis."""
    rows, groups = structure.rows()
    assert rows is None
    zero, fixed = jnp.zeros((3, 3)), structure.fixed(structure.supports)
    carry = unloaded(jnp.asarray(structure.nodes), fill(*thaw(groups)))
    named = {"rotation": carry.motion[:, 3:]} if carry.motion.shape[1] == 7 else {}
    return State(zero, structure.nodes, None, None, zero, zero, 0, 1.0, carry, (fixed,), **named)


def swinging(v):
    structure = net(weight=1.0)
    state = unstrained(structure)
    found = jc.stiffness.natural_frequencies(structure, state, gravity=v[0], masses=v[1:])
    return found.squared


def relaxed(v):
    """Form of two cables, one of a tension, one of a length, to a tolerance; NaN if not found."""
    tension, rest_length = jc.only([0], v[0]), jc.only([1], v[1])
    found = forms.dynamic_relaxation(net(), tension, rest_length, loads=PULL, tol=v[2])
    return jnp.where(found.status == 0, found.positions, jnp.nan)


def formed(name, **numbers):
    nothing = {"tension": None, "stress": None, "length": None}
    which = 2 if name == "length" else 0
    return lambda v: forms.prescribed.statements(net(**numbers), **nothing | {name: v})[which]


def chain(v):
    return forms.hanging_chain((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2, v[0], v[1], v[2])


def hung_to(end):
    return forms.hanging_chain((0.0, 0.0, 0.0), end, 3, 0.1, 1.0, 1e6)[0]


PRISM = jc.scenes.simplex()[0]


def prestressed(v):
    groups = forms.symmetric_groups(PRISM, fold=3)
    verticals = int(groups["verticals"][0])
    return forms.feasible_prestress(PRISM, groups, group=verticals, tension=v).group_tension


STRESSED = jc.solve(net(), jc.Phase(pretension=1.0))


class Row(NamedTuple):
    """A rule: of what, the message, a function of the number, a good number and a bad one."""

    argument: str
    message: str
    run: Any
    good: Any = 1.0
    bad: Any = -1.0


RULES = {
    "elements/straight.py": [
        Row("axial_stiffness", "ss.* = 0.0: must be pos", of_cables("axial_stiffness"), 1.0, 0.0),
        Row("area", r"area\[0\] = -1.0", of_cables("area", law=jc.Elastic(1e3))),
        Row("rest_length", r"rest_length\[0\] = 0.0", of_cables("rest_length"), 1.0, 0.0),
        Row("strength", r"strength\[0\] = -1.0", of_cables("strength")),
        Row("weight", r"weight\[0\] = -1.0: must not be negative", of_cables("weight")),
        Row("compliance", r"compliance\[0\] = -1.0: must not", of_cables("compliance")),
        Row(
            "compliance",
            "section.laws.* falls",
            softened,
            [-1e9, 0.0, 1e6, 2e6],
            [-1e9, 0.0, 1e6, 5e5],
        ),
    ],
    "elements/beam.py": [
        *(
            Row(name, f"{name}.* = -1.0", of_beams(name))
            for name in ("torsional_stiffness", "rest_length", "strength", "weight")
        ),
        Row(
            "springs",
            r"springs\[0, 0, 0\] = -1.0: must not",
            of_beams("springs", hinges=[[True, False]] * 2),
        ),
        Row("springs", r"hinges\[0\]: both ends", spun, 1.0, 0.0),
        Row("up", r"up\[0\].*must not be along the element", of_beams("up"), AXIS, (5.0, 0.0, 1.0)),
    ],
    "elements/sliding.py": [
        Row("nodes", r"links\[0\]: its nodes \[0, 1\] coincide", rope, 1.0, JOINED)
    ],
    "model/structure.py": [
        Row(
            "nodes",
            r"links\[0\] = \[0, 1\]: zero length",
            lambda v: code(net(NODES * v)),
            1.0,
            JOINED,
        )
    ],
    "materials/elastic.py": [
        Row("E", f"E = {bad}: Young's", lambda v: code(net(area=1.0, law=jc.Elastic(v))), 1.0, bad)
        for bad in (-1.0, 0.0)
    ],
    "materials/points.py": [
        *(
            Row("strain", message, of_strains, [0.0, 1e-3, 2e-3], bad)
            for message, bad in {
                r"strain\[2\] = inf: must be finite": [0.0, 1e-3, np.inf],
                r"strain\[2\] = 0.001: must be above strain\[1\]": [0.0, 1e-3, 1e-3],
                "strain: goes from 0.001": [1e-3, 2e-3, 3e-3],
            }.items()
        ),
        *(
            Row("stress", message, of_stresses(unloading), STRESS, bad)
            for message, unloading, bad in (
                (r"stress\[2\] = 5.0: at zero", "reversible", [-1e6, -5e5, 5.0, 1e6, 1e6]),
                ("slope at the origin, -1e", "reversible", [-1e6, -5e5, 0.0, -1e6, 1e6]),
                (r"stress\[4\] = -1.0: of the other", "reversible", [-1e6, -5e5, 0, 1e6, -1.0]),
                (r"stress\[3\]: elastic .* concave", "elastic", [-5e5, -5e5, 0.0, 1e6, 3e6]),
                (r"stress\[3\]: elastic .* concave", "elastic", [-5e5, -5e5, 0.0, 1e6, 5e5]),
                ("segment 0 from the origin has", "elastic", [-6e5, -6e5, 0.0, 1e6, 1e6]),
            )
        ),
        Row("stress", "has 500000 Pa at zero strain", through_origin, [-1e6, 1e6], [-1e6, 2e6]),
    ],
    "materials/presets.py": [Row("_positive", "yield_stress = -1.0", drawn_steel, 1e8)],
    "sections/section.py": [Row("area", r"area\[0\] = -1.0", fibres, [1.0, 1.0], [-1.0, 1.0])],
    "sections/shapes.py": [
        Row("_positive", "diameter = -1", lambda v: jc.Section.disc(v, LAW).area),
        Row("_within", "0.6: twice", lambda v: jc.Section.ring(1.0, v, LAW).area, 0.1, 0.6),
    ],
    "sections/torsion.py": [Row("thickness", "thickness = -1.0", thickness)],
    "sections/composites.py": [Row("torsion", "torsion = -1.0", composed)],
    "analysis/prestress_rules.py": [
        *(
            Row("value_rules", rf"{name}\[0\] = {bad}: .*{text}", stated(name), good, bad)
            for name, text, good, bad in (
                ("rest_length", "must be positive", 1.0, -1.0),
                ("prestrain", "must be above -1", 0.1, -1.0),
                ("pretension", "a cable carries tension only", 1.0, -1.0),
                ("force_density", "", 1.0, -1.0),
                ("jacking", "", 100.0, -100.0),
            )
        ),
        Row("value_rules", r"sag\[0\] = -0.1", stated("sag", jc.Catenaries, weight=1.0), 0.1, -0.1),
        *(
            Row(
                "capacity_rules",
                rf"{name}\[1\] = 1000001.0: above what its law",
                stated(name, area=1.0, law=LAW),
                1e6,
                1000001.0,
            )
            for name in ("pretension", "jacking")
        ),
        Row("span_rules", r"sag\[0\]: the nodes of the element lie", plumb, 1.0, 0.0),
    ],
    "loads/pressure.py": [Row("axis", "axis: is zero", pressed, AXIS, (0, 0, 0))],
    "equilibrium/newton.py": [
        Row("tol", "tol = -1.0: must be pos", of_method(jc.Newton, "tol"), 1e-9, -1.0),
        Row("tol", "tol = 1.0: relative to", of_method(jc.Newton, "tol"), 1e-9, 1.0),
        *(
            Row("max_steps", f"max_steps = {text}", of_method(jc.Newton, "max_steps"), 3.0, bad)
            for text, bad in (("0.0: must be pos", 0.0), ("2.5: expected a whole", 2.5))
        ),
    ],
    "equilibrium/incremental.py": [
        Row("tol", "tol = nan", of_method(jc.Incremental, "tol"), 0.1, np.nan)
    ],
    "paths/run.py": [
        Row("until", "until = -1.0", of_path("until")),
        Row("down_to", "down_to = 1.0", of_path("down_to"), -1.0, 1.0),
        Row("step", "step = -0.1", of_path("step"), 0.1, -0.1),
        Row("largest", "largest = -0.1", of_path("largest"), 0.1, -0.1),
        Row("tol", "tol = -1e-09", of_path("tol"), 1e-9, -1e-9),
    ],
    "stiffness/vibration.py": [
        Row("gravity", "gravity.* = -1.0", swinging, [1.0] * 4, [-1.0, 1.0, 1.0, 1.0]),
        Row("masses", "masses.* = -1.0", swinging, [1.0] * 4, [1.0, 1.0, -1.0, 1.0]),
    ],
    "results/internal_forces.py": [
        Row(
            "places",
            r"places\[0\] = 1.5",
            lambda v: jc.section_forces(frame(), unstrained(frame()), v),
            [0.5],
            [1.5],
        )
    ],
    "forms/relaxation.py": [
        Row("tension", "tension.* = -1.0", relaxed, [5.0, 1.0, 1e-9], [-1.0, 1.0, 1e-9]),
        Row("rest_length", "rest_length.* = -1.0", relaxed, [5.0, 1.0, 1e-9], [5.0, -1.0, 1e-9]),
        Row("tol", "tol.* = -1.0", relaxed, [5.0, 1.0, 1e-9], [5.0, 1.0, -1.0]),
    ],
    "forms/prescribed.py": [
        Row("_pulling", r"tension\[0\] = -1.0", formed("tension")),
        Row("_pulling", r"stress\[0\] = -1.0", formed("stress", area=1.0, law=jc.Elastic(1e3))),
        Row("statements", r"length\[0\] = -1.0", formed("length")),
    ],
    "forms/force_density.py": [
        Row("force_density", r"q\[0\] = -1.0", lambda v: jc.force_density(net(), v, PULL))
    ],
    "forms/hanging.py": [
        Row("hanging_chain", "sag = -1.0", chain, [0.1, 1.0, 1e6], [-1.0, 1.0, 1e6]),
        Row("hanging_chain", "weight = -1.0", chain, [0.1, 1.0, 1e6], [0.1, -1.0, 1e6]),
        Row("hanging_chain", "axial_stiffness = -1.0", chain, [0.1, 1.0, 1e6], [0.1, 1.0, -1.0]),
        Row("second", "first, second: the ends lie above", hung_to, (1.0, 0.0, 0.2), (0, 0, 0.2)),
    ],
    "forms/feasible.py": [Row("tension", r"tension = -1.0: with group \d so", prestressed)],
    "design/box.py": [
        Row(
            "fill",
            r"scale\[1\] = -1.0",
            lambda v: spread(v, jnp.ones(2), "scale", positive=True),
            [1.0, 1.0],
            [1.0, -1.0],
        )
    ],
    "design/arguments.py": [
        Row(
            "tol",
            "tol = 1.0",
            lambda v: jnp.where(is_tolerance(tolerance(v, 1e-3)), 1.0, jnp.nan),
            0.5,
            1.0,
        ),
        Row("width", "width = 0.0: must be positive", width_of, 0.1, 0.0),
    ],
    "design/targets.py": [
        Row("value", "value = nan", lambda v: design.Target("tension", v).value, 1.0, np.nan),
        Row("within", "in = 0.0", lambda v: design.Target("tension", within=v).within, 1.0, 0.0),
    ],
    "design/influence.py": [
        *(
            Row(
                "rcond",
                f"rcond = {bad}: must",
                lambda v: design.adjustment(jnp.eye(2), jnp.ones(2), rcond=v),
                0.1,
                bad,
            )
            for bad in (1.0, -1.0)
        ),
        Row(
            "tolerance",
            r"tolerance\[1\] = -1.0: must not be negative",
            lambda v: design.scatter(jnp.eye(2), v)[0],
            [1.0, 1.0],
            [1.0, -1.0],
        ),
    ],
    "design/objectives.py": [
        Row(
            "material_use",
            f"stress = {bad}: must be positive",
            lambda v: design.material_use(STRESSED, v),
            1.0,
            bad,
        )
        for bad in (-1.0, 0.0)
    ],
}

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
