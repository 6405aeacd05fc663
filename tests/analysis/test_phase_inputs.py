"""Every way to state prestress has one meaning; a state says its prestress in each of them."""

import functools

import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import in_line
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient

import jaxcable as jc

# copies of a structure are at one place, where they have the same roundings
pytestmark = pytest.mark.filterwarnings("ignore:nodes.*at the same place")

EPS = np.finfo(float).eps
WAYS = (
    *("pretension", "force_density", "prestrain", "rest_length", "shortening", "temperature"),
    "jacking",
)
OF = {"jacking": "pretension"}  # which part of what `inputs` returns, if it has another name


def crossed(stiffness=1e5, nodes=None):
    """A node held by four cables of different lengths; three of them share a plane."""
    if nodes is None:
        nodes = [[0.0, 0, 0], [2.0, 0, 0.3], [-1.5, 0.4, 0], [0, 3.0, -0.2], [0.2, -1.0, -0.4]]
    links = [[0, 1], [0, 2], [0, 3], [0, 4]]
    cables = jc.Cables(links, axial_stiffness=stiffness, expansion=1.2e-5)
    return jc.Structure(nodes, cables, jc.pinned([1, 2, 3, 4]))


def pull(n=1):
    """A phase that loads the held node of every one of `n` copies."""
    return jc.Phase(loads=jc.NodalLoads(5 * np.arange(n), (3.0, -2.0, -40.0)))


@functools.cache
def stated(ratio):
    """The structure in its equilibrium under a pretension, and its prestress in all ways."""
    stiffness = 1e5
    first = converged(jc.solve(crossed(stiffness), [jc.Phase(jacking=stiffness / ratio)], TIGHT))
    said = jc.forms.equivalent_prestress(crossed(stiffness), first)
    return crossed(stiffness, nodes=first.positions), said, first


@functools.cache
def in_all_ways(ratio):
    """As many copies of the structure, in one analysis, as there are ways; then under load."""
    structure, said, _ = stated(ratio)
    n = len(WAYS)
    groups = [
        jc.replace(structure.elements, links=structure.elements.links.array + 5 * k)
        for k in range(n)
    ]
    held = np.concatenate([5 * k + np.arange(1, 5) for k in range(n)])
    copies = jc.Structure(np.tile(structure.nodes, (n, 1)), groups, jc.pinned(held))
    ways = {
        name: [getattr(said, OF.get(name, name)) if k == own else None for own in range(n)]
        for k, name in enumerate(WAYS)
    }
    return converged(jc.solve(copies, [jc.Phase(**ways), pull(n)], TIGHT))


@pytest.mark.slow_cases("100.0")
@pytest.mark.parametrize("ratio", [1e2, 1e5, 1e8])
def test_each_way_gives_the_same_state(ratio):
    """Prestress from the state's own geometry: no movement, the same tensions and lengths.

    A length has eps of its own size, which is eps EA/N of the tension.
    """
    first, solution = stated(ratio)[2], in_all_ways(ratio)
    tol = max(1e-12, 10 * EPS * ratio)
    moved = np.asarray(solution.phases[0].displacement).reshape(-1, 5, 3)
    loaded = np.asarray(solution.positions).reshape(-1, 5, 3)
    sag = np.abs(np.asarray(solution.displacement)).max()
    for k, way in enumerate(WAYS):
        for name in ("tension", "rest_length"):
            found, expected = getattr(solution.phases[0], name)[k], getattr(first, name)
            assert np.asarray(found) == pytest.approx(np.asarray(expected), rel=tol), way
        assert np.abs(moved[k]).max() < tol * 3, way
        # under load a relative error of the tension is one of the deflection
        assert np.abs(loaded[k] - loaded[0]).max() < tol * sag, way
    assert sag > 1e-7  # and more, the slacker it is


@pytest.mark.slow
def test_prestrain_refers_to_the_unstressed_length_and_not_to_the_initial_chord():
    """e0 = (l - L0)/L0: L0 = l/(1 + e0), not l (1 - e0); they differ by e0^2 = 1 %."""
    structure = in_line(jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e4), 0.0, 2.0, 4.0)
    solution = converged(jc.solve(structure, [jc.Phase(prestrain=0.1)]))
    assert np.asarray(solution.rest_length) == pytest.approx(2 / 1.1, rel=1e-15)
    assert np.asarray(solution.tension) == pytest.approx(1e3, rel=1e-14)


CATENARY = jc.Structure(
    [[0.0, 0, 0], [20.0, 0, -4], [50.0, 0, 4.0]],
    jc.Catenaries([[0, 1], [1, 2]], axial_stiffness=1e6, weight=30.0),
    jc.pinned([0, 2]),
)
PULL = jc.NodalLoads([1], (0.0, 20.0, -900.0))


def some_cables(p):
    first = jc.Phase(
        pretension=jc.only([0, 3], 1e3 * p),
        prestrain=jc.only([1], 0.01 * p[0]),
        jacking=jc.only([2], 1e3 * p[1]),
    )
    return jc.solve(stated(1e2)[0], [first, pull()], TIGHT).positions


def sags(p):
    phases = [jc.Phase(sag=p[:2], loads=jc.SelfWeight()), jc.Phase(loads=PULL)]
    structure = jc.replace(CATENARY, nodes=jnp.asarray(CATENARY.nodes) * p[None, 2:])
    return jc.solve(structure, phases, TIGHT).positions


def chain(p):
    nodes, rest = jc.forms.hanging_chain([0.0, 0, 0], [40.0, 3.0, 8.0], 6, p[0], p[1], 1e3 * p[2])
    return jnp.append(jnp.ravel(nodes), rest)


def force_densities(p):
    structure = crossed(nodes=p)
    solution = jc.solve(structure, [jc.Phase(pretension=1e3)], TIGHT)
    return jc.forms.equivalent_prestress(structure, solution).force_density


FUNCTIONS = {  # with their numbers and the size of steps
    some_cables: (jnp.array([1.0, 1.2]), 10),
    sags: (jnp.array([1.0, 2.0, 1.0, 1.1, 0.9]), 1),
    chain: (jnp.array([5.0, 2.5, 1.0]), 10),
    force_densities: (jnp.asarray(crossed().nodes), 0.1),
}


@pytest.mark.slow
@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda own: own.__name__)
def test_taylor(function):
    """A failed analysis has NaN, whose gradient is not finite."""
    p, size = FUNCTIONS[function]
    stated(1e2)  # before it is asked for while a function is traced

    def number(p):
        numbers = function(p).ravel()
        return jnp.sum(jnp.sin(1.0 + jnp.arange(len(numbers))) * numbers)

    assert_gradient(number, p, size, corrupted=1.1)
