"""Derivatives of forces beside nodes that only slack cables hold, and where there are none."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc

# it is loose on purpose
pytestmark = pytest.mark.filterwarnings("ignore:nodes.*is (the free end|a free corner) of")

# Four anchors, a node in the middle of a cross, and three further nodes on random cables: most of
# these go slack when the prestress finds its form, and the iteration leaves many at their kinks.
PLACES = [[-1.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0]]
INNER = [[0.05, 0, 0.02], [-0.5, 0.5, 0.3], [0.6, 0.4, 0.1], [0.3, -0.5, 0.2]]
CROSS = [[0, 4], [1, 4], [2, 4], [3, 4]]


class Net:
    """A random net, a measure of its forces in two phases, and random parameters of it."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        nodes = np.array(PLACES + INNER)
        nodes[4:] += 0.08 * rng.normal(size=(4, 3))
        pairs = [[a, b] for a in range(8) for b in range(max(a + 1, 5), 8)]
        chosen = rng.permutation(len(pairs))[: rng.integers(5, 10)]
        links = np.array(CROSS + [pairs[k] for k in chosen])
        used, links = np.unique(links, return_inverse=True)
        self.nodes, self.links = nodes[used], links.reshape(-1, 2)
        n = len(self.links)
        self.params = {
            "EA": jnp.asarray(rng.uniform(0.6, 1.6, n)),
            "T": jnp.asarray(rng.uniform(0.6, 1.6, n)),
            "F": jnp.array([0.1, 0.2, -1.0]),
        }
        self.weights = rng.normal(size=n), rng.normal(size=(1, 3))
        self.change = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), self.params)

    def solve(self, p):
        cables = jc.Cables(self.links, axial_stiffness=1e5 * p["EA"])
        structure = jc.Structure(self.nodes, cables, supports=jc.pinned([0, 1, 2, 3]))
        load = jc.NodalLoads([4], 100 * p["F"])
        return jc.solve(structure, [jc.Phase(pretension=1e3 * p["T"]), jc.Phase(loads=load)])

    def measure(self, p):
        solution, (v, w) = self.solve(p), self.weights
        first, moved = solution.phases[0], solution.displacement[4]
        taut = jnp.sum(v * (first.tension + solution.tension)) + jnp.sum(w * first.reactions[:4])
        return taut + 1e4 * jnp.sum(w[0] * moved)

    def moved(self, step):
        return jax.tree.map(lambda x, dx: x + step * dx, self.params, self.change)

    def difference(self, function, h=3e-6):
        return (function(self.moved(h)) - function(self.moved(-h))) / (2 * h)

    def product(self, gradient):
        pairs = zip(jax.tree.leaves(gradient), jax.tree.leaves(self.change), strict=True)
        return sum(jnp.vdot(a, b) for a, b in pairs)


# kinks up to rounding; tensions below the tolerance of equilibrium; cables that are nearly opposite
SEEDS = [10, 14, 84]


@pytest.mark.quick_cases("10")
@pytest.mark.parametrize("seed", range(100))
def test_both_modes_are_the_difference(seed):
    """To 1e-3 of the derivative: tensions that are rounding leave 1e-6 N in the measure."""
    net = Net(seed)
    solution = net.solve(net.params)
    assert int(solution.status) == 0
    assert (np.asarray(solution.phases[0].tension) < 1e-6).any()
    reverse = net.product(jax.grad(net.measure)(net.params))
    _, forward = jax.jvp(net.measure, (net.params,), (net.change,))
    np.testing.assert_allclose(forward, reverse, rtol=1e-9)
    np.testing.assert_allclose(net.difference(net.measure), reverse, rtol=1e-3, atol=1.0)


@pytest.mark.slow
def test_second_derivatives_and_batches():
    """Gradients of a batch are those alone; a Hessian times a vector is a difference of them."""
    net = Net(14)
    gradient = jax.grad(net.measure)
    along = jax.jvp(gradient, (net.params,), (net.change,))[1]
    beside = jax.tree.map(
        lambda a, b: (a - b) / 2e-4, gradient(net.moved(1e-4)), gradient(net.moved(-1e-4))
    )
    for name, expected in beside.items():
        size = np.abs(expected).max()
        np.testing.assert_allclose(along[name], expected, atol=1e-4 * size, err_msg=name)
    pair = jax.tree.map(lambda a, b: jnp.stack([a, b]), net.params, net.moved(1e-3))
    both = jax.vmap(gradient)(pair)
    for k, alone in enumerate((gradient(net.params), gradient(net.moved(1e-3)))):
        for name, expected in alone.items():
            size = np.abs(expected).max()
            np.testing.assert_allclose(both[name][k], expected, atol=1e-7 * size, err_msg=name)


def test_the_position_of_a_loose_node_has_no_derivative():
    """NaN in both modes; forces beside it have theirs."""
    net = Net(10)
    assert len(net.nodes) == 8

    def place(p):
        return net.solve(p).displacement[6, 2]

    assert np.isnan(jax.jvp(place, (net.params,), (net.change,))[1])
    assert np.isnan(jax.grad(place)(net.params)["EA"]).any()


def test_where_all_cables_are_slack_no_node_has_a_derivative():
    """NaN in both modes, although no cable passes on what is NaN in the adjoint solution.

    The middle finds a place without tension; the load acts in the second phase only.
    """
    net = Net(4)

    def place(p):
        first = net.solve(p).phases[0]
        return first.displacement[4, 2], first.tension

    height, forces = jax.jvp(place, (net.params,), (net.change,))[1]
    gradient, tension = jax.grad(place, has_aux=True)(net.params)
    assert (np.asarray(tension) < 1e-9).all() and not np.asarray(forces).any()
    assert np.isnan(height) and all(np.isnan(gradient[name]).all() for name in ("EA", "T"))
    assert not np.asarray(gradient["F"]).any()


@pytest.mark.parametrize(("bent", "defined"), [(0.0, False), (0.1, True)])
def test_two_cables_that_are_just_taut(bent, defined):
    """In line between supports they are at a kink that no movement of their node can end: NaN.

    Bent, the node can move so that both are slack.
    """

    def tension(e):
        cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=e * jnp.ones(2))
        nodes = [[0.0, 0, 0], [1, 0, bent], [2, 0, 0]]
        structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        return jc.solve(structure, jc.Phase()).tension

    for derivative in (jax.jacfwd(tension)(1e5), jax.jacrev(tension)(1e5)):
        assert np.isfinite(derivative).all() == defined
