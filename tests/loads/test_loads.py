"""Dead loads along elements, on areas and on parts of groups, and combinations of all kinds."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks import shapes
from banks.shapes import SPOKES, SQUARE, load_at_rest
from oracles.convergence import converged
from oracles.traced import traced

import jaxcable as jc

hub = functools.partial(shapes.hub, weight=20.0)


def at_ends(links, amounts, n_node=5):
    """Half of each element's amount at each of its ends, [n_node]."""
    total = np.zeros(n_node)
    np.add.at(total, links, 0.5 * np.asarray(amounts)[:, None])
    return total


CHORD = np.linalg.norm(SQUARE[SPOKES[:, 1]] - SQUARE[SPOKES[:, 0]], axis=1)
PLAN = np.linalg.norm((SQUARE[SPOKES[:, 1]] - SQUARE[SPOKES[:, 0]])[:, :2], axis=1)
REST = CHORD / 1.02
FACE, DOWN = [[0, 1, 2, 3]], (0.0, 0.0, -50.0)
BY_HAND = [
    (jc.SelfWeight(), at_ends(SPOKES, 20.0 * REST)),
    (jc.SelfWeight(on="back", elements=jc.only([1])), at_ends(SPOKES, 20.0 * REST * [0, 0, 0, 1])),
    (jc.LineLoads(DOWN), at_ends(SPOKES, 50.0 * REST)),
    (jc.LineLoads(DOWN, on="back"), at_ends(SPOKES, 50.0 * REST * [0, 0, 1, 1])),
    (jc.LineLoads(DOWN, per="initial"), at_ends(SPOKES, 50.0 * CHORD)),
    (
        jc.LineLoads(DOWN, "front", "projected", elements=jc.only([0])),
        at_ends(SPOKES, 50.0 * PLAN * [1, 0, 0, 0]),
    ),
    # plan area of the square 12 m2, its surface 15 m2: a quarter to each corner
    (jc.AreaLoads(FACE, DOWN), 50.0 * 12 / 4 * np.array([1, 1, 1, 1, 0])),
    (jc.AreaLoads([[3, 2, 1, 0]], DOWN), 50.0 * 12 / 4 * np.array([1, 1, 1, 1, 0])),
    (jc.AreaLoads(FACE, DOWN, per="initial"), 50.0 * 15 / 4 * np.array([1, 1, 1, 1, 0])),
    (jc.NodalLoads([4, 4], [[0.0, 0, -3], [0, 0, -4]]), np.array([0, 0, 0, 0, 7.0])),
]


def test_loads_go_to_nodes_as_by_hand():
    """One load a phase: what each adds per unstressed length, chord, plan area, surface."""
    phases = [jc.Phase(prestrain=0.02), *(jc.Phase(loads=load) for load, _ in BY_HAND)]
    solution = converged(jc.solve(hub(), phases))
    loads = np.stack([phase.load for phase in solution.phases])
    expected = np.cumsum([np.zeros(5), *(own for _, own in BY_HAND)], axis=0)
    # eps of the sums
    np.testing.assert_allclose(-loads[..., 2], expected, rtol=1e-13)
    assert (loads[..., :2] == 0).all()


def test_a_line_load_along_an_element_has_no_projected_length_and_no_bad_derivative():
    def on_top(z):
        nodes = jnp.asarray(SQUARE).at[4].set(jnp.array([0.0, 0.0, 1.0]) * z)
        upright = jc.LineLoads(DOWN, "front", "projected", elements=jc.only([0]))
        return load_at_rest(upright, hub(nodes))[4, 2]

    value, rate = jax.value_and_grad(on_top)(4.0)
    assert float(value) == 0.0 and float(rate) == 0.0


def test_snow_on_a_saddle_net():
    """All plan area is loaded once; an inner node has a square of the spacing."""
    structure, _ = jc.scenes.saddle(4, 3, spacing=2.0, rise=0.2)
    faces = jc.net_faces(structure.nodes, structure.elements.links, border="ends")
    load = load_at_rest(jc.AreaLoads(faces, (0, 0, -700.0)), structure)
    # the rectangle of 10 x 8 m without its corners (a triangle of half a mesh each)
    assert float(load[:, 2].sum()) == pytest.approx(-700 * (80 - 4 * 2), rel=1e-12)
    inner = np.argmin(np.linalg.norm(np.asarray(structure.nodes)[:, :2] - [4.0, 4.0], axis=1))
    assert float(load[inner, 2]) == pytest.approx(-700 * 4.0, rel=1e-12)


def test_projected_loads_on_a_running_rope_go_to_the_pieces_that_have_a_projection():
    nodes = [[0.0, 0, 0], [0.0, 0, 3.0], [4.0, 0, 3.0]]
    rope = jc.SlidingCables([[0, 1, 2]], axial_stiffness=1e5)
    structure = jc.Structure(nodes, rope, jc.pinned([0, 1, 2]))
    load = load_at_rest(jc.LineLoads((0, 0, -10.0), per="projected"), structure)
    assert np.asarray(load[:, 2]) == pytest.approx([0, -20, -20], abs=1e-14)


# --- combinations


def test_every_load_can_be_scaled():
    loads = [
        jc.SelfWeight(),
        jc.LineLoads((1.0, 2.0, 3.0)),
        jc.NodalLoads([1], (1.0, 2.0, 3.0), moments=(1.0, 1.0, 1.0)),
        jc.AreaLoads([[0, 1, 2]], (0, 0, -1.0)),
        jc.CablePressure(2.0, (0, 1, 0)),
        jc.FacePressure([[0, 1, 2]], 2.0),
        jc.SupportMovement([0], (0, 0, 1.0), (0.1, 0, 0)),
    ]
    for load in loads:
        (tripled,) = jc.combine([load], [3.0])
        before, after = jax.tree.leaves(load), jax.tree.leaves(tripled)
        # an axis, and forces that keep their direction beside their factor
        kept = isinstance(load, jc.CablePressure | jc.LineLoads | jc.AreaLoads)
        changed = [not np.allclose(a, b) for a, b in zip(before, after, strict=True)]
        assert sum(changed) == len(changed) - kept
    nothing, double = (jc.combine([loads[0]], [f])[0] for f in (0.0, 2.0))
    assert nothing.direction.tolist() == [0, 0, 0] and double.direction[2] == -2.0
    first, second = jc.combine({"a": loads[0], "b": [loads[5]]}, [2.0, 3.0])  # each by its own
    assert first.direction[2] == -2.0 and second.pressure == 6.0


def test_a_factor_of_zero_has_the_derivative_of_the_load():
    """Loads are linear in their factor; the direction to look along does not vanish with it."""
    cases = [
        jc.LineLoads((0, 10.0, -50.0), per="projected"),
        jc.AreaLoads([[0, 1, 2]], (0, 5.0, -500.0)),
    ]

    def total(factors):
        return sum(load_at_rest(load, hub()) for load in jc.combine(cases, factors))

    zero, one = jnp.zeros(2), jnp.ones(2)
    rate = jax.jvp(total, (zero,), (one,))[1]
    assert np.asarray(rate) == pytest.approx(np.asarray(total(one)), rel=1e-12)
    assert float(jnp.abs(total(zero)).max()) == 0.0


# --- parts of groups


def test_elements_bend_and_hang_under_loads_on_some_of_them():
    """What they know of the load between their ends: which of them bear it, and its factor."""
    chain = jc.Catenaries([[0, 4], [1, 4], [2, 4]], axial_stiffness=1e5, weight=20.0)
    elements = {"all": chain, "rest": jc.Cables([[3, 4]], 1e5)}
    structure = jc.Structure(SQUARE, elements, jc.pinned([0, 1, 2, 3]))
    state = chain.start(jnp.asarray(SQUARE)[chain.links.array])
    for load, each in ((jc.SelfWeight, 20.0), (functools.partial(jc.LineLoads, DOWN), 50.0)):
        chosen = load(on="all", elements=jc.only([1, 2]))
        own = jc.combine([chosen], [2.0])[0].with_group_indices(structure)
        along = own.load_per_length(0, chain, state, SQUARE)
        np.testing.assert_allclose(along[:, 2], [0, -2 * each, -2 * each], rtol=1e-14)


def test_a_form_under_loads_on_some_of_its_cables():
    """Balance of every free node by NumPy, and the derivative by the load."""
    nodes = np.array([[0, 0, 3.0], [3, 0, 1.0], [6, 0, 0.0], [9, 0, 1.5], [12, 0, 3.0]])
    links = np.array([[0, 1], [1, 2], [2, 3], [3, 4]])
    structure = jc.Structure(nodes, jc.Cables(links, axial_stiffness=1e6), jc.pinned([0, 4]))
    load = jc.LineLoads((0.0, 0.0, -30.0), per="initial", elements=jc.only([1]))

    @traced
    def found(scale):
        return jc.force_density(structure, 100.0, jc.combine([load], [scale]))

    places = np.asarray(found(1.0))
    pieces = np.diff(places, axis=0)
    length = np.linalg.norm(pieces, axis=1)
    down = at_ends(links, 30.0 * length * [0, 1, 0, 0])
    left = 100.0 * np.diff(pieces, axis=0) - np.outer(down[1:4], [0, 0, 1])
    # forces of 300 N, to the tolerance 1e-10 of the loads' iteration
    assert np.abs(left).max() < 1e-6 and down[3] == 0 and places[1, 2] < places[3, 2] - 0.1
    rate = jax.jvp(found, (1.0,), (1.0,))[1]
    step = 1e-4
    both = found(1 + step) - found(1 - step)
    # central differences: step^2 against rounding over the step
    np.testing.assert_allclose(rate, both / (2 * step), atol=1e-6)
