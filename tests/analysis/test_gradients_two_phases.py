"""Derivatives of whole analyses: all kinds of parameters at once, through two phases whose supports
differ, with slack cables; gradients and Hessian-vector products of three nets beside differences.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.taylor import TIGHT, assert_gradient, joined
from oracles.traced import traced

import jaxcable as jc
from jaxcable.scenes.nets import orthogonal_grid

RNG = np.random.default_rng(5)

# --- A saddle of 4 x 4 free nodes. Its cables belong by turns to six groups, each with its own way
# of stating prestress: pretension (law given by points), force density (area and modulus),
# prestrain and cold, unstressed length (stated by the phase; by the group, with a turnbuckle), and
# a jack that phase 2 anchors.

PLACES, LINKS, FREE = orthogonal_grid(4, 4)
ANCHORS = np.setdiff1d(np.arange(len(PLACES)), FREE)
GROUPS = ("curved", "dense", "cold", "cut", "turned", "jacked")
OWN = {name: LINKS[k::6] for k, name in enumerate(GROUPS)}
PROP, HELD = FREE[5], FREE[10]
MOVED = np.append(ANCHORS[:2], HELD)
STRAIN = np.array([0.0, 0.012, 0.024, 0.05])  # corners of the law
INWARD = np.array([[0, 0.02, 0], [0, 0.02, 0], [0, 0, 0]])  # makes cables slack


def lengths(nodes, links):
    return np.linalg.norm(nodes[links[:, 1]] - nodes[links[:, 0]], axis=1)


def around(mean, name):
    return jnp.asarray(mean * RNG.uniform(0.8, 1.2, len(OWN[name])))


X, Y = 2 * PLACES.T / 5 - 1
NODES = np.column_stack([PLACES, 0.75 * (X**2 - Y**2)]) + 0.03 * RNG.normal(size=(32, 3))
EA = 1e5  # N; strains near 0.01, so that slack cables are slack and taut ones taut beyond doubt

# Value of every parameter, and size of its steps (`slope` begins with 4e-4 of the largest entry
# for size 1). Parameters that bend the measure little take large steps, for its remainder to stand
# above rounding (1e-14). Nodes take small ones: size 1 moves them by some 2 mm, over links of 1 m a
# strain of 0.002 and more than the least taut cable has; a step across its slackening shows a kink
# instead of slope 2.
PARAMETERS = {
    "nodes": (jnp.asarray(NODES), 0.05),
    "axial_stiffness": (around(EA, "turned"), 2),
    "area": (around(1e-4, "dense"), 5),
    "modulus of a law": (jnp.float64(EA / 1e-4), 5),
    "stresses of a law": (jnp.asarray([12e6, 18e6, 24e6]), 1),
    "weight": (around(30.0, "turned"), 20),
    "compliance": (around(1e-6, "cold"), 20),
    "expansion": (around(2e-4, "cold"), 5),
    "pretension": (around(1000.0, "curved"), 2),
    "force_density": (around(1000.0, "dense"), 2),
    "prestrain": (around(0.01, "cold"), 5),
    "temperature": (around(-40.0, "cold"), 5),
    "rest_length": (jnp.asarray(0.985 * lengths(NODES, OWN["cut"])), 0.5),
    "rest_length of the group": (jnp.asarray(0.99 * lengths(NODES, OWN["turned"])), 0.5),
    "shortening": (around(0.01, "turned"), 5),
    "jacking": (around(1000.0, "jacked"), 1),
    "nodal loads": (jnp.asarray(30 * RNG.normal(size=(16, 3)) + [0, 0, -400.0]), 1),
    "line load": (jnp.asarray([5.0, 10.0, -40.0]), 25),
    "direction of weight": (jnp.asarray([0.1, 0.05, -1.0]), 10),
    "support movement": (jnp.asarray(0.02 * RNG.normal(size=(3, 3)) + INWARD), 2),
}


def held(node, *axes):
    """Supports: the anchors, and one node along some axes."""
    mask = np.isin(np.arange(len(NODES)), ANCHORS)[:, None] | np.zeros(3, bool)
    mask[node, axes] = True
    return jc.Supports(mask)


def only(**inputs):
    return {**dict.fromkeys(GROUPS), **inputs}


def weighed(*parts):
    """Every number of some trees with a fixed random weight, and a factor for each tree."""
    rng = np.random.default_rng(7)
    leaves = [(leaf, factor) for tree, factor in parts for leaf in jax.tree.leaves(tree)]
    return sum(f * jnp.sum(jnp.asarray(rng.normal(size=x.shape)) * x) for x, f in leaves)


def analyse(p):
    """Phase 2 releases a prop, holds a node that was free, and moves it and two anchors."""
    law = jc.Polygonal(STRAIN, jnp.append(0.0, p["stresses of a law"]))
    properties = {
        "curved": {"area": 1e-4, "law": law},
        "dense": {"area": p["area"], "law": jc.Elastic(p["modulus of a law"])},
        "cold": {"axial_stiffness": EA, "compliance": p["compliance"], "expansion": p["expansion"]},
        "turned": {"axial_stiffness": p["axial_stiffness"], "weight": p["weight"]},
    }
    properties["turned"]["rest_length"] = p["rest_length of the group"]
    linear = {"axial_stiffness": EA}
    groups = {name: jc.Cables(OWN[name], **properties.get(name, linear)) for name in GROUPS}
    prestress = jc.Phase(
        pretension=only(curved=p["pretension"]),
        force_density=only(dense=p["force_density"]),
        prestrain=only(cold=p["prestrain"]),
        temperature=only(cold=p["temperature"]),
        rest_length=only(cut=p["rest_length"]),
        shortening=only(turned=p["shortening"]),
        jacking=only(jacked=p["jacking"]),
        loads=jc.SelfWeight(p["direction of weight"]),
        increments=2,
    )
    loads = [
        jc.NodalLoads(FREE, p["nodal loads"]),
        jc.LineLoads(p["line load"], on="dense"),
        jc.SupportMovement(MOVED, p["support movement"]),
    ]
    loading = jc.Phase(loads=loads, supports=held(HELD, 0, 1, 2), increments=2)
    structure = jc.Structure(p["nodes"], groups, held(PROP, 2))
    return jc.solve(structure, [prestress, loading], TIGHT)


def net_with_everything(p):
    """A number that sees displacements, tensions, reactions and unstressed lengths."""
    solution = analyse(p)
    moved, pulls = (solution.displacement, 10), (solution.tension, 1e-3)
    measure = weighed(moved, pulls, (solution.reactions, 1e-3), (solution.rest_length, 1))
    return measure, solution.status


@pytest.mark.slow
def test_the_net_has_slack_cables_and_none_that_nearly_is():
    solution = analyse({name: value for name, (value, _) in PARAMETERS.items()})
    path = solution.phases[1].path
    assert int(solution.status) == 0
    assert int(path.n_slack[-1]) > 0 and int(path.n_loose[-1]) == 0
    for name in GROUPS:
        length = lengths(np.asarray(solution.positions), OWN[name])
        strain = length / np.asarray(solution.rest_length[name]) - 1
        corners = STRAIN if name == "curved" else np.zeros(1)
        assert np.abs(strain[:, None] - corners).min() > 1e-3, name  # see PARAMETERS


# --- A guyed mast of two beams.

MAST_NODES = np.array(
    [[0, 0, 0], [0.02, 0, 2.0], [0.05, 0.03, 4.0], [2.0, 0, 0], [-1.0, 1.7, 0], [-1.0, -1.7, 0]]
)
MAST_PARAMETERS = {
    "nodes": (jnp.asarray(MAST_NODES), 0.03),
    "height of the section": (jnp.float64(0.08), 2),
    "modulus": (jnp.float64(1e10), 2),
    "pretension of the guys": (jnp.asarray([2000.0, 2200.0, 1800.0]), 2),
    "weight": (jnp.asarray([100.0, 120.0]), 20),  # nearly linear in it
    "loads": (jnp.asarray([[100.0, 30.0, -100.0], [200.0, 50.0, -10.0]]), 2),
    "moments": (jnp.asarray([50.0, 80.0, 30.0]), 2),
}


def mast(p):
    """Phase 2 releases a prop at the top and makes a hinge about y of the clamped foot."""
    law = jc.Elastic(p["modulus"])
    section = jc.Section.rectangle(0.05, p["height of the section"], law, (2, 2))
    groups = {
        "mast": jc.Beams([[0, 1], [1, 2]], section=section, weight=p["weight"], up=(1.0, 0, 0)),
        "guys": jc.Cables([[3, 2], [4, 2], [5, 2]], axial_stiffness=1e6),
    }
    first, second = np.zeros((2, 6, 6), bool)
    first[0] = first[3:, :3] = second[3:, :3] = True
    first[2, 0] = second[0, [0, 1, 2, 3, 5]] = True
    tension = {"mast": None, "guys": p["pretension of the guys"]}
    load = jc.NodalLoads([1, 2], p["loads"], moments=p["moments"])
    phases = [
        jc.Phase(pretension=tension, loads=jc.SelfWeight()),
        jc.Phase(loads=load, supports=jc.Supports(second)),
    ]
    solution = jc.solve(jc.Structure(p["nodes"], groups, jc.Supports(first)), phases, TIGHT)
    moved, pulls = (solution.displacement, solution.rotation), solution.tension["guys"]
    held_by = (solution.reactions, solution.reaction_moments)
    return weighed((moved, 100), (pulls, 0.01), (held_by, 0.01)), solution.status


# --- Taylor tests of both


ALL = "all at once"


def assert_taylor(function, parameters, name):
    """By one parameter, or by every entry of all, each of which takes its own step."""
    values, sizes = ({name: pair[k] for name, pair in parameters.items()} for k in (0, 1))
    if name == ALL:
        gradient = assert_gradient(*joined(function, values, sizes))
    else:
        gradient = assert_gradient(function, values, sizes, [name])[name]
    assert (np.asarray(gradient) != 0).all()  # every entry matters


@pytest.mark.quick_cases(ALL)
@pytest.mark.parametrize("name", [ALL, *PARAMETERS])
def test_taylor_of_a_net(name):
    assert_taylor(net_with_everything, PARAMETERS, name)


@pytest.mark.quick_cases(ALL)
@pytest.mark.parametrize("name", [ALL, *MAST_PARAMETERS])
def test_taylor_of_a_mast(name):
    assert_taylor(mast, MAST_PARAMETERS, name)


# --- Three nets beside central differences.

# Steps of 1e-3 of the largest pretension, extrapolated after Richardson. Tried were 1e-1 to 3e-6:
# plain central differences miss 1e-6 at the hyperbolic paraboloid net unless the step is below
# 3e-4, because jacks that look for a form bend the measure strongly. Extrapolated, gradients are
# within 2e-10 and products within 1e-9 at 1e-3; a step ten times as long is worse at the
# paraboloid (truncation), one ten times as short at the saddle (rounding).
STEP = 1e-3
NETS = {  # and how many pretensions
    "flat": (jc.scenes.flat_net, "pretension", 200.0, 4),
    "hypar": (lambda: jc.scenes.hypar_net(increments=(2, 2)), "jacking", 200.0, 31),
    "saddle": (lambda: jc.scenes.saddle(10, 10), "pretension", 20e3, 12),
}


def derivatives(name):
    """Pretensions, and a program of value, gradient, slope and Hessian times a direction."""
    scene, kind, mean, _ = NETS[name]
    structure, (prestress, loading) = scene()
    factor = np.random.default_rng(0).uniform(0.9, 1.1, len(structure.elements.links))

    def measure(p):
        first = jc.Phase(**{kind: p}, increments=prestress.increments)
        solution = jc.solve(structure, [first, loading], TIGHT)
        moved, pulls = (solution.displacement, 100), (solution.tension, 1 / mean)
        return weighed(moved, pulls), solution.status

    def both(p):
        (value, status), gradient = jax.value_and_grad(measure, has_aux=True)(p)
        return (value, gradient), status

    @traced
    def all_of_them(p, direction):
        (value, gradient), (rate, product), status = jax.jvp(both, (p,), (direction,), has_aux=True)
        return (value, gradient), rate, product, status

    return jnp.asarray(mean * factor), all_of_them


def differences(function, p, direction):
    """Central differences of value and gradient along a direction, extrapolated."""

    def at(h):
        ends = [function(p + sign * h * direction, direction) for sign in (1, -1)]
        assert int(ends[0][3]) == int(ends[1][3]) == 0
        return jax.tree.map(lambda a, b: (a - b) / (2 * h), ends[0][0], ends[1][0])

    h = STEP * float(jnp.abs(p).max())
    return jax.tree.map(lambda whole, half: (4 * half - whole) / 3, at(h), at(h / 2))


LARGE = ("hypar", "saddle")
CASES = [pytest.param(name, marks=[pytest.mark.slow] * (name in LARGE)) for name in NETS]


@pytest.mark.parametrize("name", CASES)
def test_gradients_and_hessian_vector_products_of_nets(name):
    p, function = derivatives(name)
    u, v = jnp.asarray(np.random.default_rng(2).normal(size=(2, len(p))))
    (_, gradient), rate, of_u, status = function(p, u)
    of_v = function(p, v)[2]
    assert int(status) == 0
    largest = jnp.abs(gradient).max()
    chosen = np.random.default_rng(1).choice(len(p), NETS[name][3], replace=False)
    for one in [*jnp.eye(len(p))[chosen], u]:
        # asked is 1e-6; see STEP for why 1e-8 can be had
        assert abs(differences(function, p, one)[0] - gradient @ one) < 1e-8 * largest
    # forward and reverse mode solve two systems of the same matrix
    assert abs(rate - gradient @ u) < 1e-11 * largest * jnp.linalg.norm(u)
    # The stiff saddle is hardly curved: rounding of its gradients, 1e-14, is 1e-9 of the 1e-5 by
    # which this step changes them.
    expected = differences(function, p, v)[1]
    assert jnp.abs(of_v - expected).max() < 1e-8 * jnp.abs(of_v).max()
    size = jnp.linalg.norm(u) * jnp.linalg.norm(of_v)
    assert abs(u @ of_v - v @ of_u) < 1e-10 * size  # no differences: rounding alone
