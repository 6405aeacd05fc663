"""Taylor tests: the remainder of the linearisation falls with slope 2; a wrong one does not."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.taylor import TIGHT, slope

import jaxcable as jc

FREE = np.array([3, 4, 7, 8])
STRUCTURE, _ = jc.scenes.flat_net()
RNG = np.random.default_rng(3)
TENSION = jnp.asarray(RNG.uniform(150, 250, 12))
FORCES = jnp.asarray(RNG.normal(size=(4, 3)) * 5 + [0, 0, -60])
WEIGHTS = jnp.asarray(RNG.normal(size=(12, 3)))


def measure(solution):
    """One number that sees every displacement, tension, reaction and unstressed length."""
    return (
        100 * jnp.sum(WEIGHTS * solution.displacement)
        + jnp.sum(jnp.sin(jnp.arange(12.0)) * solution.tension) / 100
        + jnp.sum(WEIGHTS * solution.reactions) / 100
        + jnp.sum(jnp.cos(jnp.arange(12.0)) * solution.rest_length)
    )


def two_phases(structure, prestress, forces=FORCES, method=TIGHT, supports=None):
    phases = [
        prestress,
        jc.Phase(loads=jc.NodalLoads(FREE, forces), increments=2, supports=supports),
    ]
    return jc.solve(structure, phases, method)


def with_elements(**changes):
    return jc.replace(STRUCTURE, elements=jc.replace(STRUCTURE.elements, **changes))


PRESTRESS = jc.Phase(pretension=TENSION, increments=2)
REST = 0.4 / (1 + TENSION / 97.97e3)
MASK = np.asarray(STRUCTURE.fixed(STRUCTURE.supports)).copy()
MASK[4, 2] = True  # a prop that phase 2 removes
PROPPED = jc.replace(STRUCTURE, supports=jc.Supports(MASK))

PARAMETERS = {
    "nodes": (STRUCTURE.nodes, lambda p: two_phases(jc.replace(STRUCTURE, nodes=p), PRESTRESS)),
    "axial_stiffness": (
        jnp.full(12, 97.97e3),
        lambda p: two_phases(with_elements(axial_stiffness=p), PRESTRESS),
    ),
    "rest_length": (REST, lambda p: two_phases(with_elements(rest_length=p), jc.Phase())),
    "pretension": (TENSION, lambda p: two_phases(STRUCTURE, jc.Phase(pretension=p, increments=2))),
    "shortening": (0.4 - REST, lambda p: two_phases(STRUCTURE, jc.Phase(shortening=p))),
    "loads": (FORCES, lambda p: two_phases(STRUCTURE, PRESTRESS, p)),
    "jacking": (
        TENSION,
        lambda p: two_phases(STRUCTURE, jc.Phase(jacking=p, increments=2)),
    ),
    "jacked nodes": (
        STRUCTURE.nodes,
        lambda p: two_phases(jc.replace(STRUCTURE, nodes=p), jc.Phase(jacking=TENSION)),
    ),
    "weight": (
        jnp.full(12, 40.0),
        lambda p: two_phases(
            with_elements(weight=p), jc.Phase(pretension=TENSION, loads=jc.SelfWeight())
        ),
    ),
    "released prop": (
        TENSION,
        lambda p: two_phases(
            PROPPED,
            jc.Phase(pretension=p, loads=jc.NodalLoads([4], FORCES[1])),
            supports=STRUCTURE.supports,
        ),
    ),
    "incremental tangent": (
        TENSION,
        lambda p: two_phases(STRUCTURE, jc.Phase(pretension=p), method=jc.Incremental(1, tol=9.0)),
    ),
    "incremental secant": (
        TENSION,
        lambda p: two_phases(
            STRUCTURE,
            jc.Phase(pretension=p),
            FORCES / 10,  # Picard steps diverge where hardening is strong
            method=jc.Incremental(0, "secant", tol=9.0),
        ),
    ),
}


# all kinds of parameters are tested at once in test_gradients_two_phases; here one by one, apart
# from all else, in `make test-all`
ALONE = ("jacked nodes", "released prop", "incremental secant")
NAMES = [pytest.param(n, marks=[] if n in ALONE else pytest.mark.slow) for n in PARAMETERS]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_taylor(name):
    p, solve = PARAMETERS[name]

    @jax.jit
    @functools.partial(jax.value_and_grad, has_aux=True)
    def f(p):
        solution = solve(p)
        return measure(solution), solution.status

    (_, status), gradient = f(p)
    assert int(status) == 0

    def value(p):
        return f(p)[0][0]

    assert abs(slope(value, p, gradient) - 2) < 0.1
    # negative control: one entry off by a hundredth of the largest
    wrong = gradient.at[(-1,) * gradient.ndim].add(1e-2 * jnp.abs(gradient).max())
    assert slope(value, p, wrong) < 1.5


@pytest.mark.slow
def test_taylor_with_slack_cables():
    """A cable net of which some cables are slack at the end."""
    structure, _ = jc.scenes.saddle(3, 3, axial_stiffness=1e6, pretension=50.0)
    n = len(structure.elements.links)

    def end(p):
        load = jc.NodalLoads(np.arange(structure.n_node), (0, 0, -2000.0))
        return jc.solve(structure, [jc.Phase(pretension=p), jc.Phase(loads=load)], TIGHT)

    p = jnp.full(n, 50.0) + jnp.arange(n)
    weights = 1e3 * jnp.sin(jnp.arange(structure.n_node))

    @jax.jit
    @functools.partial(jax.value_and_grad, has_aux=True)
    def f(p):
        solution = end(p)
        found = solution.status, solution.phases[1].path.n_slack[0]
        return jnp.sum(weights * solution.displacement[:, 2]), found

    (start, (status, n_slack)), gradient = f(p)
    assert int(status) == 0 and int(n_slack) > 0
    # Some tensions are below 0.03 N here: larger steps cross a kink (slope near 1 above 2 N),
    # smaller ones leave nothing but rounding, because the function is hardly curved.
    direction = jnp.asarray(np.random.default_rng(1).normal(size=n))
    steps = 0.5 * 0.6 ** np.arange(4)
    rest = [
        abs(float(f(p + h * direction)[0][0] - start - h * jnp.sum(gradient * direction)))
        for h in steps
    ]
    assert abs(np.polyfit(np.log(steps), np.log(rest), 1)[0] - 2) < 0.1


@pytest.mark.slow
def test_derivatives_of_the_path():
    """NaN unless asked for; exact when asked for."""

    def third(p, differentiate):
        solution = jc.solve(
            STRUCTURE,
            [jc.Phase(pretension=p), jc.Phase(loads=jc.NodalLoads(FREE, FORCES), increments=3)],
            TIGHT,
            differentiate_path=differentiate,
        )
        return solution.phases[1].path.displacement[0, 3, 2]

    assert jnp.isnan(jax.grad(lambda p: third(p, False))(TENSION)).all()

    def direct(p):  # the analysis that ends at a third of the load
        load = jc.Phase(loads=jc.NodalLoads(FREE, FORCES / 3))
        return jc.solve(STRUCTURE, [jc.Phase(pretension=p), load], TIGHT).displacement[3, 2]

    expected = jax.grad(direct)(TENSION)
    got = jax.grad(lambda p: third(p, True))(TENSION)
    assert jnp.abs(got - expected).max() < 1e-10 * jnp.abs(expected).max()


def test_gradient_does_not_depend_on_the_increments():
    def end(p, increments):
        phases = [
            jc.Phase(pretension=p, increments=increments),
            jc.Phase(loads=jc.NodalLoads(FREE, FORCES), increments=increments),
        ]
        return measure(jc.solve(STRUCTURE, phases, TIGHT))

    one, many = (jax.jit(jax.grad(lambda p, n=n: end(p, n)))(TENSION) for n in (1, 20))
    assert jnp.abs(one - many).max() < 1e-9 * jnp.abs(one).max()
