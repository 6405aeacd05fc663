"""Energy, residual and tangent belong together, for every element law and state."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.traced import traced

import jaxcable as jc
from jaxcable.common.tree import copy_with, merge_indices, split_indices
from jaxcable.elements import AxialState
from jaxcable.elements.element_state import ElementLoad
from jaxcable.mechanics.assembly import System
from jaxcable.spaces import space_class
from jaxcable.spaces.dof_map import make_dof_map

CURVE = jc.Polygonal([-0.2, -0.1, 0.0, 0.05, 0.3], [-5e3, -3e3, 0.0, 1.5e3, 4e3])
YIELDING = jc.Polygonal([-0.9, -0.1, 0.0, 0.1, 0.9], [-11e3, -3e3, 0.0, 3e3, 11e3], "elastic")
CORED = jc.Section.composite(
    [jc.Section.disc(0.04, CURVE, (2, 2)), jc.Section.ring(0.06, 0.01, jc.Elastic(3e4), (1, 8))]
)
YIELDING_CORE = jc.Section.composite(
    [jc.Section.disc(0.04, YIELDING, (2, 2)), jc.Section.ring(0.06, 0.01, jc.Elastic(3e4), (1, 8))]
)
YIELDING_BEAM = jc.Section.composite(
    [jc.Section.rectangle(0.2, 0.3, YIELDING, (1, 4)), jc.Section.ring(0.4, 0.01, CURVE, (1, 6))]
)
DISC = jc.Section.disc(0.3, jc.Elastic(3e4), (2, 2))
OFF_AXIS = DISC.shifted(0.1, 0.2)
WEAK = {"up": (0.1, 0.2, 1.0), "torsional_stiffness": 5.0}


def beams(section, **options):
    return lambda links: jc.Beams(links, section=section, **options)


LAWS = {
    "bar": lambda links: jc.Bars(links, axial_stiffness=np.linspace(50, 100, len(links))),
    "cable": lambda links: jc.Cables(links, axial_stiffness=80.0),
    "cable with law": lambda links: jc.Cables(links, area=2e-3, law=jc.Elastic(3e4)),
    "compliant cable": lambda links: jc.Cables(links, axial_stiffness=80.0, compliance=1e-2),
    "compliant law": lambda links: jc.Bars(links, area=2e-3, law=jc.Elastic(3e4), compliance=1e-2),
    "bar of points": lambda links: jc.Bars(links, area=2e-3, law=CURVE),
    "cable of points": lambda links: jc.Cables(links, area=2e-3, law=CURVE),
    "bar that yields": lambda links: jc.Bars(links, area=2e-3, law=YIELDING),
    "cable that yields": lambda links: jc.Cables(links, area=2e-3, law=YIELDING),
    "contact": lambda links: jc.Contacts(links, axial_stiffness=80.0),
    "contact that yields": lambda links: jc.Contacts(links, area=2e-3, law=YIELDING),
    "composite bar": lambda links: jc.Bars(links, section=CORED),
    "composite cable": lambda links: jc.Cables(links, section=CORED),
    "composite cable that yields": lambda links: jc.Cables(links, section=YIELDING_CORE),
    "compliant composite": lambda links: jc.Cables(
        links, section=YIELDING_CORE, compliance=np.linspace(1e-3, 1e-2, len(links))
    ),
    "catenary": lambda links: jc.Catenaries(links, axial_stiffness=80.0),
    "sliding cable": lambda links: jc.SlidingCables(
        [[*pair, (pair[1] + 2) % 7] for pair in links[::2]] + [[4, 5, 6, 4]], axial_stiffness=80.0
    ),
    "beam": beams(DISC),
    "beam off its axis": beams(OFF_AXIS),
    "beam with loads within": beams(OFF_AXIS),
    "sheared beam with loads within": beams(OFF_AXIS.with_shear(2e3, 9e2)),
    "sheared beam that yields with loads within": beams(YIELDING_BEAM.with_shear(2e3, 9e2), **WEAK),
    "beam that yields with loads within": beams(YIELDING_BEAM, **WEAK),
    "jointed beam": lambda links: jc.Beams(
        links,
        section=DISC,
        hinges=np.array([[[False, True, True], [True, False, True]]] * len(links)),
        springs=[[5.0, 20.0, 0.0], [30.0, 7.0, 10.0]],
    ),
    "beam flexible in shear": beams(
        jc.Section.linear(2e3, 12.0, 8.0, 5.0, 90.0, 60.0, EIyz=4.0).shifted(0.1, 0.2)
    ),
    "beam that yields, flexible in shear": beams(
        YIELDING_BEAM.with_shear(900.0, 600.0), torsional_stiffness=5.0
    ),
    "composite beam that yields": beams(YIELDING_BEAM, points=3, **WEAK),
}
"""Every element law by name: a new law is added here and is tested by everything below."""


LINEAR = ["bar", "cable", "cable with law", "compliant cable", "compliant law", "contact"]
JACKED = ["bar", "cable", "compliant composite", "sliding cable"]


def system(name, held=False):
    """A system of random nodes and states (some elements slack), and a random point of it."""
    rng = np.random.default_rng(0)
    n = 7
    links = np.array([(i, j) for i in range(n) for j in range(i + 1, n) if (i + j) % 3])
    nodes = rng.normal(size=(n, 3))
    group = LAWS[name](links)
    chord = np.asarray(group.chord(nodes[group.links.array]))
    rest = chord * rng.uniform(0.8, 1.2, len(chord))
    force = jnp.asarray(rng.uniform(1, 2, len(chord))) if held else None
    memory = jax.tree.map(lambda p: 0.05 * rng.normal(size=p.shape), group.initial_memory())
    state = AxialState(jnp.asarray(rest), jnp.asarray(chord - rest), force, memory=memory)
    fixed = np.zeros((n, group.n_freedom), bool)
    fixed[:2] = True
    fixed[3, 1] = True
    structure = jc.Structure(nodes, group, jc.Supports(fixed))
    rows, (group,) = structure.motion_rows()
    dof_map = make_dof_map(structure.fixed(structure.supports), rows)
    count = n if rows is None else len(rows)
    nodes = jnp.asarray(nodes if rows is None else nodes[rows.node_of_row])
    load, held_at = rng.normal(size=(2, count, 3))
    load[n:] = 0.0
    group = copy_with(group, links=group.links.array).extrapolated()
    if group.rotates or name in ("catenary", "sliding cable"):
        along = rng.normal(size=(len(chord), 3))
        if name == "catenary":
            along[::4] = 0.0  # there it is a straight cable, or a slack one without force
        points = None
        if name.endswith("within"):  # two of them: force and moment at a place
            points = rng.normal(size=(len(chord), 2, 7))
            points[..., 0] = rng.uniform(size=points.shape[:2])
            points[0, :, 0] = 0.4  # both at one place
            points = jnp.asarray(points)
        state = copy_with(state, element_load=ElementLoad(jnp.asarray(along), points=points))
    held_at[n:] = 0.0
    held_at, size = jnp.asarray(0.01 * held_at), 0.1
    if group.rotates:
        still = np.tile([1.0, 0, 0, 0], (count, 1))
        held_at = jnp.concatenate([held_at, still], axis=1)
    kind = space_class([group])
    space = kind.build(nodes, [group], dof_map, held_at, None)
    if group.rotates:
        size = 0.3 * space.rotation_length
    load = kind.pad_moments(jnp.asarray(load))  # without moments, which have no potential
    made = System(nodes, [group], [state], load, space)
    step = size * rng.normal(size=len(dof_map.free))
    return made, made.move(made.impose_supports(kind.at_rest(nodes)), jnp.asarray(step))


@traced
def figures(without_indices, arrays, x):
    """Residual twice, slope of the energy, tangent, Jacobian; the arrays are indices."""
    made = merge_indices(without_indices, arrays)
    residual, numbers, back = made.local_residual(x)

    def twice(v):
        about = residual(v)
        return about, about

    gradient = jax.grad(lambda v: made.potential(back(v)))(numbers)
    jacobian, about = jax.jacfwd(twice, has_aux=True)(numbers)
    return made.residual(x), about, gradient, made.tangent(x), jacobian


CASES = [*((name, False) for name in LAWS), *((name, True) for name in JACKED)]


@pytest.mark.quick_cases(
    "catenary-False",
    "sliding cable-False",
    "cable-True",
    "compliant composite-False",
    "compliant composite-True",
)
@pytest.mark.parametrize(("name", "held"), CASES)
def test_energy_residual_and_tangent_belong_together(name, held):
    """The residual is the gradient of the energy, the tangent its symmetric Jacobian."""
    made, x = system(name, held)
    found = figures(*split_indices(made), x)
    residual, about, gradient, tangent, jacobian = map(np.asarray, found)
    size = np.abs(residual).max()
    assert np.abs(gradient - residual).max() < 1e-12 * size
    assert np.abs(about - residual).max() < 1e-12 * size
    size = np.abs(tangent).max()
    assert np.abs(tangent - jacobian).max() < 1e-13 * size
    assert np.abs(tangent - tangent.T).max() < 1e-13 * size


@pytest.mark.slow_cases("bar")
@pytest.mark.parametrize("name", LINEAR)
def test_residual_agrees_with_differences_of_an_independent_energy(name):
    """Energy from lengths alone, in NumPy, by central differences."""
    made, x = system(name)
    group, state = made.groups[0], made.states[0]
    links, rest = np.asarray(group.links), np.asarray(state.rest_length)
    stiffness = group.area * group.law.E if group.law else np.asarray(group.axial_stiffness)
    if group.compliance is not None:
        stiffness = 1 / (1 / stiffness + np.asarray(group.compliance))

    def energy(step):
        u = np.asarray(made.move(x, jnp.asarray(step)))
        p = np.asarray(made.nodes) + u
        strain = np.linalg.norm(p[links[:, 1]] - p[links[:, 0]], axis=1) / rest - 1
        if group.tension_only:
            strain = np.maximum(strain, 0)
        if group.compression_only:
            strain = np.minimum(strain, 0)
        return (0.5 * stiffness * rest * strain**2).sum() - (np.asarray(made.load) * u).sum()

    h = 1e-6
    steps = h * np.eye(len(made.dof_map.free))
    differences = [(energy(step) - energy(-step)) / (2 * h) for step in steps]
    # truncation h^2 and rounding eps/h of an energy of order 10: both near 1e-9
    assert np.abs(np.asarray(made.residual(x)) - differences).max() < 1e-7


def test_a_slack_cable_has_exactly_no_force_and_no_stiffness():
    made, x = system("cable")
    slack = np.asarray(made.slack(x)[0])
    tension = np.asarray(made.tensions(x)[0])
    assert 0 < slack.sum() < len(slack)
    assert (tension[slack] == 0.0).all() and (tension[~slack] > 0).all()


def test_tangent_at_zero_strain_is_that_of_the_taut_side():
    one = copy_with(jc.Cables([[0, 1]], axial_stiffness=7.0), links=None, axial_stiffness=7.0)
    assert float(jax.grad(one.force)(0.0)) == 7.0
    assert float(jax.grad(one.force)(-1e-300)) == 0.0
    assert np.isnan(one.force(jnp.nan))  # a NaN is not slack
