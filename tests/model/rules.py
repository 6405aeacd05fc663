"""The table of rules: every number that is refused when it is known fails when it is traced.

A row has a good and a bad number for one rule. Known, the bad one is a ValueError with this
message; traced, it is a status or NaN, while the good one passes both ways.
"""

import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
from messages import rows

import jaxcable as jc
from jaxcable import design, forms
from jaxcable.analysis.preparation import prepare, traced_input_status
from jaxcable.analysis.solution import State
from jaxcable.common.tree import merge_indices, split_indices
from jaxcable.mechanics.restart_state import initial_restart_state
from jaxcable.paths.trace import check_path_settings

NODES = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.2], [2.0, 0.0, 0.0]])
LINKS = np.array([[0, 1], [1, 2]])
JOINED = np.array([[1.0], [0.0], [1.0]])
"""Times nodes: the first link has no length."""
FLAT = np.array([[1.0, 1.0, 0.0]])
"""Times nodes: they are on a straight line."""
PULL = jc.NodalLoads([1], (0.0, 0.0, 1.0))
DISC = jc.Section.disc(0.1, jc.Elastic(2e11), shape=(2, 2))
LAW = jc.Polygonal([0.0, 1e-3], [0.0, 1e6])
STOCKY = jc.Polygonal([-1e-3, 0.0, 2e-3], [-1e6, 0.0, 2e6])
AXIS = (0.0, 1.0, 0.0)
RISING = [0.0, 0.5, 1.0]
ROUGH = {"roughness_length": 0.1, "lowest_height": 1.0}
NOWHERE = (0.0, 0.0, 0.0)


def code(structure, phases=None, method=None):
    """The verdict of `solve` on numbers, as its compiled core finds it: no analysis is compiled."""
    phases = jc.Phase(loads=PULL) if phases is None else phases
    task = prepare(structure, phases, method, None)
    return jnp.max(
        traced_input_status(merge_indices(task.without_indices, task.arrays), task.method)[1]
    )


def net(nodes=NODES, kind=jc.Cables, links=LINKS, **numbers):
    if not any(name in numbers for name in ("axial_stiffness", "area", "section")):
        numbers["axial_stiffness"] = 1e3
    return jc.Structure(nodes, kind(links, **numbers), supports=jc.pinned([0, 2]))


def frame(**numbers):
    beams = jc.Beams(LINKS, **{"section": DISC, "up": AXIS} | numbers)
    return jc.Structure(NODES, beams, supports=jc.clamped([0]))


def of_contacts(name, **others):
    return lambda v: code(net(kind=jc.Contacts, **{name: jnp.array([1.0, 1.0]) * v}, **others))


def curved_contacts(v):
    law = jc.Polygonal(1e-3 * jnp.asarray(v), 1e6 * jnp.asarray(v))
    return code(net(kind=jc.Contacts, area=1.0, law=law))


def on_ground(kind, name, **others):
    """A net with a spring or a bearing at its middle node."""

    def make(v):
        elements = {"net": jc.Cables(LINKS, 1e3), "soil": kind([1], **{name: v}, **others)}
        structure = jc.Structure(NODES, elements, supports=jc.pinned([0, 2]))
        return code(structure)

    return make


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


def of_stresses(unloading="reversible"):
    return lambda v: curve([-1e-3, -5e-4, 0.0, 1e-3, 2e-3], v, unloading)


STRAIN, STRESS = [0.0, 1e-3, 2e-3], [-5e5, -5e5, 0.0, 1e6, 1e6]


def fibres(v):
    return code(frame(section=jc.Section([0.0, 0.1], [0.0, 0.1], v, DISC.laws, None, [1.0])))


def numbers(name):
    known = {"EA": 1e8, "EIy": 1e5, "EIz": 1e5, "GJ": 1e5}
    return lambda v: code(frame(section=jc.Section.linear(**known | {name: v})))


def stated(name, kind=jc.Cables, **numbers):
    """A phase's input for one cable of two, so that nothing is said of the other."""
    return lambda v: code(net(kind=kind, **numbers), jc.Phase(**{name: jc.only([1], v)}))


def plumb(v):
    """A stated sag of a cable whose ends are `v` apart in plan, 0.2 m in height."""
    nodes = jnp.asarray(NODES).at[1, 0].set(v)
    phase = jc.Phase(sag=jc.only([0], 0.1), loads=jc.SelfWeight())
    return code(net(nodes, jc.Catenaries, weight=1.0), phase)


def of_method(kind, name):
    return lambda v: code(net(), None, kind(**{name: v}))


def blown(name, kind=None, **numbers):
    """Wind on a net, by one number of the load or, with a `kind`, of its profile."""

    def make(v):
        given = {"direction": AXIS, "drag": 1.2, "diameter": 0.1, "ice": 0.1, "vertical": AXIS}
        if kind is not None:
            wind = jc.WindLoads(profile=kind(**numbers | {name: v}), **given)
        else:
            wind = jc.WindLoads(profile=jc.WindTable(pressures=500.0), **given | {name: v})
        return code(net(), jc.Phase(loads=wind))

    return make


def of_table(name):
    return blown(name, jc.WindTable, heights=[1.0, 2.0], velocities=[1.0, 2.0])


def of_power_law(name):
    return blown(name, jc.WindPowerLaw, velocity=1.0, exponent=0.2)


def of_eurocode(name, **numbers):
    return blown(name, jc.EurocodeWind, velocity=1.0, **numbers or {"terrain": "II"})


def iced(name):
    numbers = {"thickness": 0.02, "diameter": 0.02, "density": 900.0}
    return lambda v: code(net(), jc.Phase(loads=jc.IceLoads(**numbers | {name: v})))


def of_train(v):
    axles = jnp.array([1.0]) * v if isinstance(v, jax.core.Tracer) else np.array([1.0]) * v
    return code(frame(), jc.Phase(loads=jc.loads.Train([0], 0.5, AXIS, axles)))


def varying(load):
    """A load by parameters `v` in the second phase, of which the first knows nothing."""

    def make(v):
        more = jc.Phase(loads=[PULL, jc.Varying(load, v, [0.0, 0.2, 1.0])], increments=2)
        return code(net(weight=1.0), [jc.Phase(loads=jc.SelfWeight()), more])

    return make


def of_path(name):
    def make(v):
        numbers = {"until": 1.0, "down_to": -1.0, "step": 0.1, "largest": 0.1, "tol": 1e-9}
        own = check_path_settings(net(), *(numbers | {name: v}).values(), True)
        task = prepare(net(), jc.Phase(loads=PULL), None, None)
        return traced_input_status(
            merge_indices(task.without_indices, task.arrays), task.method, own
        )[1][0]

    return make


def unstrained(structure):
    """A state of a structure that nothing has happened to, without an analysis."""
    rows, groups = structure.motion_rows()
    assert rows is None
    zero, fixed = jnp.zeros((3, 3)), structure.fixed(structure.supports)
    restart = initial_restart_state(
        jnp.asarray(structure.nodes), merge_indices(*split_indices(groups))
    )
    named = {"rotation": restart.motion[:, 3:]} if restart.motion.shape[1] == 7 else {}
    still = {"displacement": zero, "positions": structure.nodes, "reactions": zero, "load": zero}
    still |= {"tension": None, "rest_length": None, "phase": 0, "load_factor": 1.0}
    return State(**still, restart=restart, fixed=(fixed,), **named)


def lost(v):
    """Forces of the sudden loss of an element, by its dynamic factor."""
    return design.loss_of_cable(net(), unstrained(net()), [0], dynamic_factor=v).loads[0].forces


def above(v):
    plane = jc.results.clearance_to_plane
    return plane(frame(), unstrained(frame()), np.zeros(3), v).least


def over(v):
    ground = jnp.array([[-1.0, 0.0, -1.0], [0.0, 0.0, -1.0], [3.0, 0.0, -1.0]])
    ground = ground * jnp.asarray(v)[None]
    return jc.results.clearance_over_ground(frame(), unstrained(frame()), ground).least


def swinging(v):
    structure = net(weight=1.0)
    state = unstrained(structure)
    found = jc.dynamics.modes(structure, state, gravity=v[0], masses=v[1:])
    return found.squared


def moving(name, make=lambda v: v):
    """Displacements after a step in time, with one number of it."""

    def run(v):
        given = {"dt": 0.01, "masses": 1.0, name: make(v)}
        return jc.dynamics.transient(net(weight=1.0), PULL, steps=1, **given).displacement

    return run


def removed(name):
    def make(v):
        return jc.dynamics.Removal(jc.only([0]), **{name: v})

    return moving("removes", make)


def damped(kind, *numbers):
    return moving("damping", lambda v: kind(*(v if x is None else x for x in numbers)))


def turbulent(name):
    """Spectral density of the velocity at a point, by one number of the wind."""

    def run(v):
        steady, numbers = jc.WindTable(velocities=20.0), {"deviation": 3.0, "length_scale": 150.0}
        wind = jc.dynamics.Turbulence(steady, **numbers | {name: v})
        points = np.array([[0.0, 0.0, 10.0], [0.0, 5.0, 10.0]])
        return jc.dynamics.wind_velocities(wind, points, dt=0.5, steps=2, key=jax.random.key(0))

    return run


def gusty(name):
    def run(v):
        parts = {"pole": jc.Bars([[0, 1]], 1e8), "clamp": jc.Springs([1], (2e3, 2e3, 0.0))}
        mast = jc.Structure([[0.0, 0, 0], [0, 0, 10]], parts, jc.pinned([0]))
        still, masses = jc.solve(mast, jc.Phase()), np.array([0.0, 40.0])
        found = jc.dynamics.modes(mast, still, masses=masses)
        wind = jc.dynamics.Turbulence(jc.WindTable(velocities=20.0), 3.0, 150.0)
        given = mast, still, found, np.array([[0.0, 0.0, 0.0], [60.0, 0.0, 0.0]]), wind
        return jc.dynamics.gust_response(*given, **{name: v}).peak_factor

    return run


def rubbed(name, **others):
    """A cable over a saddle, by one of its coefficients."""
    links = np.array([[0, 1, 2]])
    return lambda v: code(net(kind=jc.FrictionCables, links=links, **others | {name: v}))


def softening_over_saddle(v):
    law = jc.Polygonal([0.0, 1e-3, 2e-3], jnp.asarray(v))
    return code(net(kind=jc.FrictionCables, links=np.array([[0, 1, 2]]), area=1.0, law=law))


def clamped_over_saddle(v):
    rope = {"kind": jc.FrictionCables, "links": np.array([[0, 1, 2]])}
    return code(net(**rope), jc.Phase(clamped=v, loads=PULL))


def stressed_over_saddle(v):
    rope = {"kind": jc.FrictionCables, "links": np.array([[0, 1, 2]])}
    stressed = jc.Phase(stressed_ends=jnp.asarray(v)[None], jacking=1.0, loads=PULL)
    return code(net(**rope), stressed)


def relaxed(v):
    """Form of two cables, one of a tension, one of a length, to a tolerance; NaN if not found."""
    tension, rest_length = jc.only([0], v[0]), jc.only([1], v[1])
    found = forms.dynamic_relaxation(net(), tension, rest_length, loads=PULL, tol=v[2])
    return jnp.where(found.status == 0, found.positions, jnp.nan)


def formed(name, **numbers):
    which = {"length": "lengths", "force_density": "densities"}.get(name, "forces")
    nothing = {"tension": None}

    def read(v):
        found = forms.prescribed_values.read_prescribed_values(
            net(**numbers), **nothing | {name: v}
        )
        return getattr(found, which)

    return read


def chain(v):
    return forms.hanging_chain((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2, v[0], v[1], v[2])


PRISM = jc.scenes.simplex()[0]


def prestressed(v):
    groups = forms.symmetric_groups(PRISM, fold=3)
    verticals = int(groups["verticals"][0])
    return forms.feasible_prestress(PRISM, groups, group=verticals, tension=v).group_tension


def scattered_by(name, kind=jc.reliability.Normal, **others):
    """A value of a distribution."""
    return lambda v: kind(**{"mean": 2.0, name: v, **others}).value_at_normal(1.0)


def correlated(v):
    normal = jc.reliability.Normal(0.0, 1.0)
    matrix = np.eye(2) + v * np.array([[0.0, 1.0], [1.0, 0.0]])
    own = jc.reliability.Quantities({"a": normal, "b": normal}, matrix)
    return own.values_at_normals(jnp.ones(2))["b"]


def tolerated(v):
    arguments = design.arguments
    valid = arguments.is_valid_tolerance(arguments.check_tolerance(v, 1e-3))
    return jnp.where(valid, 1.0, jnp.nan)


def limited(v, **others):
    """Utilization of an own check by its limits."""
    own = design.OwnCheck("own", lambda *_: jnp.ones(1), **others | v)
    return own.evaluate(None, None)["utilization"]


@functools.cache
def stressed():
    """A net with a pretension, solved when a row asks for it."""
    return jc.solve(net(), jc.Phase(pretension=1.0))


def read(table):
    """Rules by row: file, argument, pattern of the message, function, good number, bad one."""
    found = []
    for part in re.split(r"^## ", table.strip(), flags=re.M)[1:]:
        file, _, body = part.partition("\n")
        for call, message in rows(body):
            argument, _, pattern = message.lstrip("^").partition(":\\ ")
            function, *numbers = eval(call, globals())
            found.append((file, argument, pattern, function, *(numbers or (1.0, -1.0))))
    return found


# of a file: function, good and bad number (1 and -1 where none are given)  # argument: message
RULES = read("""
## elements/straight.py
of_cables("axial_stiffness"), 1.0, 0.0  # axial_stiffness: axial_stiffness[0] = 0.0: must be pos
of_cables("area", law=jc.Elastic(1e3)),  # area: area[0] = -1.0
of_cables("rest_length"), 1.0, 0.0  # rest_length: rest_length[0] = 0.0
of_cables("strength"),  # strength: strength[0] = -1.0
of_cables("weight"),  # weight: weight[0] = -1.0: must not be negative
of_cables("compliance"),  # compliance: compliance[0] = -1.0: must not
softened, [-1e9, 0.0, 1e6, 2e6], [-1e9, 0.0, 1e6, 5e5]  # compliance: section.laws...softens
## elements/contact.py
of_contacts("gap"), 0.1, 2.0  # gap: gap[0] = 2.0: must be less than the initial distance
curved_contacts, [-1.0, 0.0, 1.0], [0.0, 1.0, 2.0]  # law: law = 0.0: the law has no branch
## elements/spring.py
on_ground(jc.Springs, "stiffness"),  # stiffness: stiffness[0, 0] = -1.0: must not be negative
on_ground(jc.Springs, "rotational_stiffness", stiffness=1.0),
    # rotational_stiffness: rotational_stiffness[0, 0] = -1.0: must not be negative
on_ground(jc.Springs, "axes", stiffness=1.0), np.eye(3), np.ones((3, 3))
    # axes: axes[0]: expected three unit vectors
on_ground(jc.GroundContacts, "stiffness"), 1.0, 0.0  # stiffness: stiffness[0] = 0.0: must be
on_ground(jc.GroundContacts, "normal", stiffness=1.0), AXIS, (0.0, 0.0, 0.0)
    # normal: normal[0]: a bearing needs a direction
## elements/beam.py
of_beams("torsional_stiffness"),  # torsional_stiffness: torsional_stiffness... = -1.0
of_beams("rest_length"),  # rest_length: rest_length... = -1.0
of_beams("strength"),  # strength: strength... = -1.0
of_beams("weight"),  # weight: weight... = -1.0
of_beams("springs", hinges=[[True, False]] * 2),  # springs: springs[0, 0, 0] = -1.0: must not be
spun, 1.0, 0.0  # springs: hinges[0]: both ends
of_beams("up"), AXIS, (5.0, 0.0, 1.0)  # up: up[0]...must not be along the element
## elements/sliding.py
lambda v: code(net(NODES * v, jc.SlidingCables, [[0, 1, 2]])), 1.0, JOINED
    # nodes: links[0]: its nodes [0, 1] coincide
## elements/friction_cables.py
rubbed("radius"), 0.01, -1.0  # radius: radius... = -1.0: must not be negative
## elements/cable_path.py
lambda v: code(net(NODES * v, jc.FrictionCables, [[0, 1, 2]], radius=0.01)), 1.0, FLAT
    # radius: radius...the polygon of the nodes is straight there
rubbed("axis", radius=0.01), (0.0, 1.0, 0.3), (0.0, 0.0, 0.0)  # radius: radius...`axis` is zero
rubbed("axis", radius=0.01), (0.0, 1.0, 0.3), (0.0, -1.0, 0.3)  # radius: ...turns against `axis`
rubbed("radius"), 0.01, 100.0  # radius: radius... = 100.0: must not be larger than half
## elements/friction.py
rubbed("friction"),  # rules: friction... = -1.0: must not be negative
rubbed("axle_friction"), 0.1, 1.0  # axle_friction: axle_friction... = 1.0: must be from 0 to
softening_over_saddle, [0.0, 2e6, 3e6], [0.0, 2e6, 1e6]
    # law: law...softens; a cable with friction
clamped_over_saddle, 1.0, 0.5  # clamp_rule: ...clamped... = 0.5: a clamp is open, 0, or
stressed_over_saddle, [1.0, 1.0], [0.0, 0.0]  # stressed_ends_rule: ...stressed_ends...at least one
## model/structure.py
lambda v: code(net(NODES * v)), 1.0, JOINED  # nodes: links[0] = [0, 1]: zero length
## materials/elastic.py
lambda v: code(net(area=1.0, law=jc.Elastic(v))),  # E: E = -1.0: Young's modulus must be positive
lambda v: code(net(area=1.0, law=jc.Elastic(v))), 1.0, 0.0  # E: E = 0.0: Young's
## materials/point_rules.py
lambda v: curve(v, [0.0, 1e6, 1.5e6]), STRAIN, [0.0, 1e-3, np.inf]
    # strain: strain[2] = inf: must be finite
lambda v: curve(v, [0.0, 1e6, 1.5e6]), STRAIN, [0.0, 1e-3, 1e-3]
    # strain: strain[2] = 0.001: must be above strain[1]
lambda v: curve(v, [0.0, 1e6, 1.5e6]), STRAIN, [1e-3, 2e-3, 3e-3]  # strain: strain: goes from 0.001
of_stresses(), STRESS, [-1e6, -5e5, 5.0, 1e6, 1e6]  # stress: stress[2] = 5.0: at zero strain
of_stresses(), STRESS, [-1e6, -5e5, 0.0, -1e6, 1e6]  # stress: ...slope at the origin, -1e
of_stresses(), STRESS, [-1e6, -5e5, 0.0, 1e6, -1.0]  # stress: stress[4] = -1.0: of the other sign
of_stresses("elastic"), STRESS, [-5e5, -5e5, 0.0, 1e6, 3e6]  # stress: stress[3]: ...concave
of_stresses("elastic"), STRESS, [-5e5, -5e5, 0.0, 1e6, 5e5]  # stress: stress[3]: ...concave
of_stresses("elastic"), STRESS, [-6e5, -6e5, 0.0, 1e6, 1e6]  # stress: ...segment 0 from the origin
lambda v: curve([-1e-3, 1e-3], v), [-1e6, 1e6], [-1e6, 2e6]
    # stress: ...the curve has 500000 Pa at zero strain
## materials/presets.py
lambda v: code(net(area=1.0, law=jc.materials.steel(v))), 1e8, -1.0
    # _require_positive: yield_stress = -1.0
## sections/section.py
fibres, [1.0, 1.0], [-1.0, 1.0]  # area: area[0] = -1.0
lambda v: code(frame(section=DISC.with_shear(v, 1e7))),  # GAy: GAy = -1.0: must be positive
lambda v: code(frame(section=DISC.with_shear(GAz=v))), 1.0, 0.0  # GAz: GAz = 0.0: must be positive
## sections/linear_section.py
numbers("EA"),  # EA: EA = -1.0: must be positive
numbers("EIy"),  # EIy: EIy = -1.0
numbers("EIz"),  # EIz: EIz = -1.0
numbers("GJ"), 1.0, 0.0  # GJ: GJ = 0.0
numbers("GAy"),  # GAy: GAy = -1.0
numbers("GAz"),  # GAz: GAz = -1.0
numbers("EIyz"), -9e4, -1e5  # EIyz: EIyz = -100000.0: must be less than the root of EIy EIz
## sections/shear.py
lambda v: jc.sections.shear_coefficient("disc", v), 0.5, 0.6  # poisson: poisson = 0.6: must be from
lambda v: jc.sections.shear_coefficient("ring", 0.3, v), 0.9, 1.0  # inner: inner = 1.0: must be
## sections/lattices.py
lambda v: jc.sections.lattice(4, v, 1.0, 1.0, 1.0).EIy,  # _positive_number: width = -1.0
## sections/shapes.py
lambda v: jc.Section.disc(v, LAW).area,  # _positive_length: diameter = -1
lambda v: jc.Section.ring(1.0, v, LAW).area, 0.1, 0.6  # _length_if_allowed: twice
## sections/torsion.py
lambda v: jc.sections.bredt_torsion(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]), v),
    # thickness: thickness = -1.0
## sections/composites.py
lambda v: jc.Section.composite([DISC, DISC.shifted(z=0.2)], torsion=v).torsion,
    # torsion: torsion = -1.0
## analysis/prestress_rules.py
stated("rest_length"),  # sign_rules: ...rest_length[1] = -1.0: ... must be positive
stated("prestrain"), 0.1, -1.0  # sign_rules: ...prestrain[1] = -1.0: a prestrain must be above -1
stated("pretension"),  # sign_rules: ...pretension[1] = -1.0: a cable carries tension only
stated("force_density"),  # sign_rules: ...force_density[1] = -1.0
stated("jacking"), 100.0, -100.0  # sign_rules: ...jacking[1] = -100.0
stated("pretension", jc.Contacts), -1.0, 1.0
    # sign_rules: ...pretension[1] = 1.0: a contact carries compression only
stated("sag", jc.Catenaries, weight=1.0), 0.1, -0.1  # sign_rules: ...sag[1] = -0.1
stated("end_tension"), 100.0, -100.0  # sign_rules: ...end_tension[1] = -100.0: a cable carries
stated("end_tension", jc.Catenaries), 1.0, 0.0
    # sign_rules: ...end_tension[1] = 0.0: must be positive: a cable that hangs has
stated("horizontal_tension", jc.Catenaries), 1.0, -1.0
    # sign_rules: ...horizontal_tension[1] = -1.0: must be positive
stated("built_sag", jc.Catenaries, weight=1.0), 0.1, -0.1  # sign_rules: ...built_sag[1] = -0.1
stated("pretension", area=1.0, law=LAW), 1e6, 1000001.0
    # capacity_rules: ...pretension[1] = 1000001.0: more than the law
stated("jacking", area=1.0, law=LAW), 1e6, 1000001.0
    # capacity_rules: ...jacking[1] = 1000001.0: more than the law
stated("pretension", jc.Bars, area=1.0, law=STOCKY), -1e6, -1000001.0
    # capacity_rules: ...pretension[1] = -1000001.0: ...law of the element can
plumb, 1.0, 0.0  # span_rules: ...sag[0]: the nodes of the element lie
## loads/pressure.py
lambda v: code(net(), jc.Phase(loads=jc.CablePressure(1.0, v))), AXIS, NOWHERE
    # axis: axis: is zero
## loads/wind.py
blown("direction"), AXIS, NOWHERE  # direction: direction: is zero; give the direction towards
blown("vertical"), AXIS, NOWHERE  # vertical: vertical: is zero
blown("drag"), [1.2, 1.0], [1.2, -1.0]  # drag: drag[1] = -1.0: must not be negative
blown("diameter"),  # diameter: diameter = -1.0: must not be negative
blown("ice"),  # ice: ice = -1.0: must not be negative
## loads/wind_profiles.py
of_table("heights"), [1.0, 2.0], [1.0, 1.0]  # heights: heights[1] = 1.0: must be above heights[0]
of_table("velocities"), [1.0, 2.0], [1.0, -2.0]  # velocities: velocities[1] = -2.0: must not be
blown("pressures", jc.WindTable),  # pressures: pressures = -1.0: must not be neg
of_table("density"),  # density: density = -1.0: must be positive
of_power_law("velocity"),  # velocity: velocity = -1.0: must not be negative
of_power_law("exponent"),  # exponent: exponent = -1.0: must not be negative
of_power_law("reference_height"), 1.0, 0.0  # reference_height: reference_height = 0.0: must be pos
of_power_law("lowest_height"),  # lowest_height: lowest_height = -1.0: must not be negative
of_power_law("density"), 1.0, 0.0  # density: density = 0.0: must be positive
of_power_law("highest_height"), 9.0, 0.0  # highest_height: highest_height = 0.0: must be positive
of_eurocode("velocity"),  # velocity: velocity = -1.0: must not be negative
of_eurocode("orography"),  # orography: orography = -1.0: must be positive
of_eurocode("turbulence"),  # turbulence: turbulence = -1.0: must not be negative
of_eurocode("roughness_length", **ROUGH), 0.5, 0.0  # roughness_length: ...= 0.0: must be positive
of_eurocode("lowest_height", **ROUGH), 0.2, 0.1  # lowest_height: ...= 0.1: must exceed roughness
of_eurocode("density"), 1.0, 0.0  # density: density = 0.0: must be positive
## loads/ice.py
iced("thickness"), [0.1, 0.0], [0.1, -0.1]  # thickness: thickness[1] = -0.1: must not be negative
iced("diameter"),  # diameter: diameter = -1.0: must not be negative
iced("density"),  # density: density = -1.0: must not be negative
## loads/masses.py
lambda v: jc.PointMasses([1], v).nodal_forces((3, 3), float),
    # masses: masses = -1.0: must not be negative
## loads/points.py
lambda v: code(frame(), jc.Phase(loads=jc.PointLoads([0], v, AXIS))), 0.5, 1.5
    # places: places = 1.5: must be from 0 to 1
## loads/path_loads.py
of_train, 1.0, -1.0  # spacings: spacings[0] = -1.0
## loads/varying.py
varying(PULL), RISING, [0.1, 0.5, 1.0]  # parameters: parameters[0] = 0.1: must be 0
varying(PULL), RISING, [0.0, 0.5, 0.9]  # parameters: parameters[2] = 0.9: must be 1
varying(jc.SelfWeight()), RISING, [0.0, 1.0, 1.0]
    # parameters: parameters[2] = 1.0: must be above parameters[1] = 1.0
varying(jc.SupportMovement([2], AXIS)), RISING, [0.0, -0.1, 1.0]
    # parameters: parameters[1] = -0.1: must be above parameters[0] = 0.0
## equilibrium/newton.py
of_method(jc.Newton, "tol"), 1e-9, -1.0  # tol: tol = -1.0: must be pos
of_method(jc.Newton, "tol"), 1e-9, 1.0  # tol: tol = 1.0: must be below 1: it is ... to the forces
of_method(jc.Newton, "max_steps"), 3.0, 0.0  # max_steps: max_steps = 0.0: must be pos
of_method(jc.Newton, "max_steps"), 3.0, 2.5  # max_steps: max_steps = 2.5: expected a whole
## equilibrium/incremental.py
of_method(jc.Incremental, "tol"), 0.1, np.nan  # tol: tol = nan
## paths/path_state.py
of_path("until"),  # until: until = -1.0
of_path("down_to"), -1.0, 1.0  # down_to: down_to = 1.0
of_path("step"), 0.1, -0.1  # step: step = -0.1
of_path("largest"), 0.1, -0.1  # largest: largest = -0.1
of_path("tol"), 1e-9, -1e-9  # tol: tol = -1e-09
## dynamics/damping.py
damped(jc.dynamics.Rayleigh, None),  # mass: mass = -1.0: must not be negative
damped(jc.dynamics.Rayleigh, 0.0, None),  # stiffness: stiffness = -1.0: must not be negative
damped(jc.dynamics.ModalDamping, [1.0], np.ones((1, 3, 3)), None),
    # ratios: ratios = -1.0: must not be negative
lambda v: jc.dynamics.Rayleigh.from_ratios((v, 0.01), (5.0, 0.01)).stiffness, 1.0, 0.0
    # first_frequency: first_frequency = 0.0: must be positive
lambda v: jc.dynamics.Rayleigh.from_ratios((1.0, 0.01), (v, 0.01)).stiffness, 5.0, 0.0
    # second_frequency: second_frequency = 0.0: must be positive
damped(jc.dynamics.Dashpots, [[0, 1]], None),  # coefficient: coefficient... = -1.0: must not be
## dynamics/gust_response.py
gusty("damping"), 0.01, 0.0  # damping: damping = 0.0: must be positive
gusty("duration"), 600.0, 0.0  # duration: duration = 0.0: must be positive
## dynamics/transient.py
moving("dt"), 0.01, 0.0  # dt: dt = 0.0: must be positive
moving("spectral_radius"), 1.0, 1.5  # spectral_radius: spectral_radius = 1.5: must be from 0 to 1
moving("gravity"), 9.81, -1.0  # gravity: gravity = -1.0: must be positive
removed("duration"), 0.0, -1.0  # duration: duration = -1.0: must not be negative
## dynamics/turbulence.py
turbulent("deviation"), 3.0, -1.0  # deviation: deviation = -1.0: must not be negative
turbulent("length_scale"), 150.0, 0.0  # length_scale: length_scale = 0.0: must be positive
turbulent("decay"), (3.0, 10.0, 10.0), (3.0, -1.0, 10.0)  # decay: decay[1] = -1.0: must not be
turbulent("direction"), AXIS, NOWHERE  # direction: direction: is zero
turbulent("vertical"), (0.0, 0.0, 1.0), NOWHERE  # vertical: vertical: is zero
## dynamics/modes.py
swinging, [1.0] * 4, [-1.0, 1.0, 1.0, 1.0]  # gravity: gravity... = -1.0
## dynamics/inertia.py
swinging, [1.0] * 4, [1.0, 1.0, -1.0, 1.0]  # masses: masses... = -1.0
## results/internal_forces.py
lambda v: jc.section_forces(frame(), unstrained(frame()), v), [0.5], [1.5]
    # places: places[0] = 1.5
## results/clearances.py
above, [0.0, 0.6, 0.8], [0.0, 0.0, 0.0]  # normal: expected a vector of length above zero
over, [1.0, 1.0, 1.0], [0.0, 0.0, 1.0]  # profile: profile[1]: lies above or below profile[0]
## results/rotations.py
lambda v: jc.results.node_tilts(frame(), unstrained(frame()), v).tilt, [0.0, 0.6, 0.8], NOWHERE
    # axis: expected a vector of length above zero
## forms/relaxation.py
relaxed, [5.0, 1.0, 1e-9], [5.0, 1.0, -1.0]  # tol: tol... = -1.0
## forms/input_checks.py
relaxed, [5.0, 1.0, 1e-9], [-1.0, 1.0, 1e-9]  # values_by_group: tension... = -1.0
relaxed, [5.0, 1.0, 1e-9], [5.0, -1.0, 1e-9]  # values_by_group: rest_length... = -1.0
formed("tension"),  # values_by_group: tension[0] = -1.0
formed("stress", area=1.0, law=jc.Elastic(1e3)),  # values_by_group: stress[0] = -1.0
formed("length"),  # values_by_group: length[0] = -1.0
formed("force_density"),  # values_by_group: force_density[0] = -1.0
lambda v: jc.force_density(net(), v, PULL),  # values_by_group: q[0] = -1.0
## forms/hanging_cables.py
chain, [0.1, 1.0, 1e6], [-1.0, 1.0, 1e6]  # hanging_chain: sag = -1.0
chain, [0.1, 1.0, 1e6], [0.1, -1.0, 1e6]  # hanging_chain: weight = -1.0
chain, [0.1, 1.0, 1e6], [0.1, 1.0, -1.0]  # hanging_chain: axial_stiffness = -1.0
lambda v: forms.hanging_chain(NOWHERE, v, 3, 0.1, 1.0, 1e6)[0], (1.0, 0.0, 0.2), (0.0, 0.0, 0.2)
    # second: first, second: the ends lie above each other
## forms/feasible_prestress.py
prestressed,  # tension: tension = -1.0: with this tension in group
## design/bounds.py
lambda v: design.bounds.broadcast_to_params(v, jnp.ones(2), "scale", positive=True),
    [1.0, 1.0], [1.0, -1.0]
    # fill: scale[1] = -1.0
## design/arguments.py
tolerated, 0.5, 1.0  # tol: tol = 1.0
design.arguments.checked_smoothing_width, 0.1, 0.0  # width: width = 0.0: must be positive
## design/targets.py
lambda v: jc.design.Target("tension", v).value, 1.0, np.nan  # value: value = nan: must be finite
lambda v: jc.design.Target("tension", within=v).within, 1.0, 0.0  # within: within = 0.0
## design/cable_loss.py
lost, 2.0, 0.5  # dynamic_factor: dynamic_factor = 0.5: expected a finite number of at least 1
lost, 2.0, np.inf  # dynamic_factor: dynamic_factor = inf: expected a finite number
lost, 2.0, np.nan  # dynamic_factor: dynamic_factor = nan: expected a finite number
## design/influence.py
lambda v: design.adjustment(jnp.eye(2), jnp.ones(2), rcond=v), 0.1, 1.0  # rcond: rcond = 1.0
lambda v: design.adjustment(jnp.eye(2), jnp.ones(2), rcond=v), 0.1, -1.0
    # rcond: rcond = -1.0: must
lambda v: design.propagate_tolerances(jnp.eye(2), v)[0], [1.0, 1.0], [1.0, -1.0]
    # propagate_tolerances: tolerance[1] = -1.0: must not be negative
## design/influence_line.py
lambda v: design.influence_line(frame(), jc.Phase(), [0], "reactions", direction=v).coefficients,
    AXIS, NOWHERE  # direction: direction: is zero; give the direction of the unit force
## design/objectives.py
lambda v: design.material_use(stressed(), v),  # material_use: ...stress = -1.0
lambda v: design.material_use(stressed(), v), 1.0, 0.0  # material_use: ...stress = 0.0: must be pos
## design/limit_checks.py
lambda v: limited({"upper": v}),  # _validate_limits: own: upper = -1.0: expected a positive limit
lambda v: limited({"lower": v}, upper=2.0), 1.0, 3.0
    # _validate_limits: own: lower = 3.0: expected below upper = 2.0
lambda v: design.TensionLimit(lower=v).evaluate(net(), stressed())["utilization"], 1.0, 0.0
    # __post_init__: tension that remains: lower = 0.0: expected a positive tension
## standards/cables.py
lambda v: jc.standards.cables.cable_resistance(v), 1.0, 0.0
    # _positive: breaking_force = 0.0: must be positive
## reliability/distributions.py
scattered_by("deviation"),  # deviation: deviation = -1.0: must be positive
scattered_by("variation"),  # variation: variation = -1.0: must be positive
scattered_by("mean", variation=0.1), 1.0, 0.0  # mean: mean = 0.0: is zero, which a coefficient
scattered_by("mean", jc.reliability.Lognormal, deviation=0.1),  # mean: mean = -1.0: must be pos
## reliability/quantities.py
correlated, 0.5, 1.5  # correlation: correlation: must be symmetric and positive definite
""")

OTHERWISE = {
    "analysis/absent_elements.py:_is_zero_increment": "traced: it may be other than zero",
    "analysis/absent_elements.py:_warn_of_lost_value": "a warning",
    "analysis/absent_elements.py:_is_loaded": "a warning",
    "analysis/preparation.py:_can_prove_instability": "no rule: whether a warning can be given",
    "analysis/phase_checks.py:_is_known_to_be_zero": "no rule: whether a load can be left out",
    "loads/groups.py:scatter_to_nodes": "no rule: which library computes",
    "loads/nodal.py:describe": "no rule: what is said of it",
    "reporting/load_descriptions.py:_numbers_of_load": "no rule: what is said of it",
    "loads/wind.py:describe": "no rule: what is said of it",
    "loads/wind_profiles.py:_describe_number": "no rule: what is said of it",
    "loads/ice.py:warn_of_thick_ice": "a warning: most likely in millimeters",
    "loads/masses.py:describe": "no rule: what is said of it",
    "loads/points.py:describe": "no rule: what is said of it",
    "design/cable_loss.py:loss_of_cable": "no rule: whether there are forces",
    "design/cable_loss.py:_checked_state": "NaN where it is traced",
    "design/cable_loss.py:_require_active": "traced: the case ends in INVALID_INPUT",
    "design/influence_line.py:known_stations_and_coefficients": "traced ones are refused",
    "design/influence_line.py:_checked_breaks": "traced ones are refused",
    "design/moving_loads.py:worst_position": "traced ones are refused",
    "loads/varying.py:describe": "no rule: what is said of it",
    "loads/varying.py:split_amplitude": "a warning",
    "elements/inner_unknowns.py:unused_columns": "no rule: layers on one line",
    "elements/beam_axes.py:is_known_anisotropic": "a lean without `up` is NaN in `Beams.start`",
    "materials/polygonal.py:__post_init__": "no rule: puts the origin among known points",
    "sections/torsion.py:bredt_torsion": "a traced outline is not asked whether it crosses itself",
    "sections/torsion.py:are_concentric_circles": "no rule: which library computes",
    "sections/shapes.py:_float_if_known": "no rule: which library computes",
    "sections/outlines.py:checked_corners": "traced outlines are refused",
    "sections/composites.py:_sum_torsion_constants": "NaN where it is traced",
    "model/structure.py:__post_init__": "warnings; the rules of places are asked in any case",
    "design/bounds.py:check": "bounds that are traced end in the status OUTSIDE",
    "dynamics/modes.py:_without_massless_modes": "no rule: how many modes have mass",
    "dynamics/modes.py:modes": "NaN where it is traced: an unsymmetric tangent",
    "dynamics/mode_warnings.py:warn_of_modes_within_spans": "no rule: a warning",
    "dynamics/mode_warnings.py:warn_of_nodes_without_stiffness": "no rule: a warning",
    "dynamics/mode_warnings.py:warn_of_weights_without_mass": "no rule: a warning",
    "stiffness/buckling.py:buckling_factor": "NaN where it is traced",
    "model/supports.py:_orthonormal_axes": "traced directions are refused",
    "model/torsional_mechanisms.py:find_torsional_mechanisms": "a warning",
    "model/torsional_mechanisms.py:describe_torsional_mechanisms": "a warning",
    "elements/rotating_saddles.py:resists_spin": "no rule: whether a warning can be given",
    "elements/rotating_saddles.py:is_positive": "no rule: whether a warning can be given",
    "model/plausibility.py:array_or_none": "warnings",
    "loads/movement.py:__post_init__": "a warning",
    "loads/movement.py:check_supported": "NaN where it is traced (`ramp`), status NONFINITE",
    "forms/feasible_prestress.py:feasible_prestress": "NaN where a cable is not taut",
    "forms/equilibrium_matrix.py:nodes_as_numpy": "traced nodes are refused",
    "analysis/as_built.py:_first_phases": "no rule: known masks that are empty need no change",
    "design/actions.py:__post_init__": "no rule of numbers: shape and dtype, which are known",
    "design/check.py:warn_if_unusual": "a warning",
    "design/load_cases.py:_warn_of_unstable_cases": "a warning",
    "forms/input_checks.py:warn_of_hanging_elements": "a warning",
    "materials/presets.py:_warn_of_weak_material": "a warning",
    "stiffness/buckling.py:_pairs_that_forbid_slack": "NaN where it is traced",
    "dynamics/transient.py:__post_init__": "traced times of a removal are refused",
    "dynamics/motion_checks.py:step_of_removal": "traced times of a removal are refused",
    "dynamics/motion_checks.py:removal_masks": "traced masks: what is gone has no force",
    "dynamics/motion_checks.py:initial_velocity": "NaN where it is traced",
    "dynamics/motion_checks.py:require_mass": "traced: without mass accelerations are not finite",
    "dynamics/motion_checks.py:require_finite": "no rule: NaN gives NaN",
    "dynamics/damping.py:warn_of_large_damping_ratios": "no rule: a warning",
    "dynamics/mode_warnings.py:warn_of_freed_supports": "no rule: a warning",
    "dynamics/motion_checks.py:warn_of_nodes_without_elements": "no rule: a warning",
    "dynamics/time_loads.py:times_of_steps": "no rule: times of traced durations, too",
    "dynamics/inertia.py:nodal_masses": "no rule: which library computes",
    "dynamics/damping.py:from_ratios": "traced: equal frequencies give factors that are not finite",
    "dynamics/load_histories.py:nodes_with_mean_force": "traced mean forces are refused",
    "dynamics/load_histories.py:wind_velocities": "NaN where it is traced: frequencies of no steps",
    "analysis/solution.py:last_state_or_nan": "no rule: whether an analysis has failed",
}
"""Where else values are looked at when they are known, and what becomes of traced ones."""
