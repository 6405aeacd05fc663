"""Cables over saddles and pulleys with a radius: tangents, arcs, friction, contact pressure."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.belt import belt, lengths_to_marks
from oracles.convergence import converged
from oracles.coulomb import relaxed
from oracles.taylor import TIGHT, assert_gradient

import jaxcable as jc

EA = 2e6


def of_rope(phase, name):
    return np.asarray(phase.element_results[name]["rope"][0])


@pytest.mark.slow
def test_capstan():
    """exp(mu theta) over the arc that the tangents leave, and T / r on the saddle."""
    nodes = [[-3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.5, 0.0, -4.0]]
    rope = jc.SlidingCables([[0, 1, 2]], axial_stiffness=EA, friction=0.2, radius=0.5)
    held = jc.pinned([0, 1]) + jc.restrained([2], "xy")
    structure = jc.Structure(nodes, {"rope": rope}, held)
    pull = jc.NodalLoads([2], (0.0, 0.0, -1000.0))
    solution = converged(jc.solve(structure, jc.Phase(loads=pull), TIGHT))
    places = np.asarray(solution.positions)[:, [0, 2]]
    direction, _, angle = belt(places, [0.5], [-1])
    # no end is vertical, so that the load is not quite the tension
    tension = 1000 / -np.sin(direction[1]) * np.array([np.exp(-0.2 * angle[0]), 1.0])
    assert_allclose(of_rope(solution, "segment_tension"), tension, rtol=1e-10)
    assert_allclose(of_rope(solution, "contact_arc"), 0.5 * angle, rtol=1e-12)
    assert_allclose(of_rope(solution, "contact_pressure"), tension[1:] / 0.5, rtol=1e-10)
    # the force on the node is that of both tensions
    pull = tension[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    assert_allclose(np.asarray(solution.reactions)[1, [0, 2]], pull[0] - pull[1], rtol=1e-9)


RADII, TURNS = np.array([0.8, 0.3, 0.0]), np.array([-1, 1, 1])
CENTERS = np.array([[-8.0, 0.0], [0.0, 6.0], [5.0, 2.5], [8.0, 1.5], [10.0, 4.0]])


def over_saddles(friction, radii=RADII, **options):
    """A rope over a saddle on springs, a pulley on springs that turns it back, and a clip."""
    nodes = np.insert(CENTERS, 1, 0.0, axis=1)
    radius = None if radii is None else [radii]
    rope = jc.SlidingCables(
        [range(5)], axial_stiffness=EA, friction=friction, radius=radius, **options
    )
    springs = jc.Springs([1, 2], [[1e6, 1e6, 1e7], [4e5, 1e6, 4e5]])
    held = jc.pinned([0, 4]) + jc.restrained([3], "y")
    return jc.Structure(nodes, {"rope": rope, "springs": springs}, held)


def histories():
    loads = [jc.NodalLoads([3], (0.0, 0.0, f)) for f in (-8e3, -6e3, 9e3, -7e3)]
    clamped = {"rope": [0, 0, 1]}
    start = jc.Phase(pretension={"rope": 20e3}, clamped=clamped, loads=loads[0])
    return [start, *(jc.Phase(loads=load, increments=2) for load in loads[1:])]


@pytest.mark.parametrize("friction", [0.15, pytest.param(0.0, marks=pytest.mark.slow)])
def test_against_circles_in_numpy(friction):
    """Tensions from lengths between marks on circles, by complementarity; forces at free nodes."""
    structure = over_saddles(friction)
    solution = converged(jc.solve(structure, histories(), TIGHT))
    start = lengths_to_marks(CENTERS, CENTERS, RADII, TURNS)[0]
    slid = []
    for phase in solution.phases:
        places = np.asarray(phase.positions)[:, [0, 2]]
        length, angle = lengths_to_marks(places, CENTERS, RADII, TURNS)
        slips = np.asarray(phase.path.element_results["slip"]["rope"])[:, 0]
        before = slips[-2] if len(slips) > 1 else np.zeros(3)
        rest = start / start.sum() * float(phase.rest_length["rope"][0])
        rest = rest - np.diff(before, prepend=0, append=0)
        bound = np.append(friction * np.abs(angle[:2]), np.inf)
        tension = relaxed(length, rest, bound, EA)
        assert_allclose(of_rope(phase, "segment_tension"), tension, rtol=1e-8)
        assert_allclose(of_rope(phase, "contact_arc"), RADII * angle, rtol=1e-10)
        pressure = np.maximum(tension[:2], tension[1:3]) / RADII[:2]
        assert_allclose(of_rope(phase, "contact_pressure")[:2], pressure, rtol=1e-8)
        slid += [*(slips[-1] - before)[:2]]
        direction = belt(places, RADII, TURNS)[0]
        pull = tension[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
        moved = np.asarray(phase.displacement)[1:3][:, [0, 2]]
        springs = moved * [[1e6, 1e7], [4e5, 4e5]]
        assert_allclose((pull[1:] - pull[:-1])[:2], springs, atol=1e-8 * tension.max())
    slid = np.array(slid)
    assert (slid > 1e-4).any() and (slid < -1e-4).any()
    assert friction == 0 or (slid == 0).any()  # some stick


@pytest.mark.slow
def test_without_radius():
    """Radii that vanish are those of points, to first order in the radius."""
    points = jc.solve(over_saddles(0.15, None), histories(), TIGHT)
    exact = of_rope(converged(points), "segment_tension")
    apart = []
    for radius in (1e-3, 1e-4):
        found = converged(jc.solve(over_saddles(0.15, [radius, radius, 0.0]), histories(), TIGHT))
        apart.append(np.abs(of_rope(found, "segment_tension") - exact).max())
    assert apart[0] / apart[1] == pytest.approx(10, rel=0.1)


@pytest.mark.slow
def test_parallel_parts_of_a_tackle():
    """Half a circle on both blocks: the hand needs W r^2 / (1 + r), with the ratio r of an axle."""
    nodes = [[0.2, 0.0, -2.0], [0.0, 0.0, 0.0], [-0.4, 0.0, -4.0], [-0.6, 0.0, 0.0]]
    rope = jc.FrictionCables(
        links=[range(4)],
        axial_stiffness=2e5,
        axle_friction=0.05,
        radius=0.2,
        axis=[[[0, -1.0, 0], [0, 2.0, 0]]],
    )
    held = jc.pinned([0, 1, 3]) + jc.restrained([2], "y")
    structure = jc.Structure(nodes, {"rope": rope}, held)
    hung = jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -3e3)))
    up = jc.Phase(loads=jc.SupportMovement([0], (0.0, 0.0, -1.0)), increments=2)
    solution = converged(jc.solve(structure, [hung, up], TIGHT))
    ratio = 1.05 / 0.95
    tension = of_rope(solution, "segment_tension")
    # two tensions shift the block by 2 mm, so that its parts are not quite parallel
    assert tension[0] == pytest.approx(3e3 * ratio**2 / (1 + ratio), rel=1e-4)
    assert_allclose(tension[:-1] / tension[1:], ratio, rtol=1e-6)
    assert_allclose(of_rope(solution, "contact_arc"), 0.2 * np.pi, rtol=1e-2)


@pytest.mark.slow
def test_derivatives():
    """By radius, friction, and the load; beside a longer chain, so that the rope has fillers."""
    nodes = np.array([[-3.0, 0, 0], [0.0, 0, 0], [0.3, 0.4, -4.0], [-5.0, 0, 0]])
    more = [[-1.0, 1, 0], [0.0, 1, 0], [1.0, 1, -1], [2.0, 1, 0]]
    held = jc.pinned([1, 3, 4, 5, 6, 7]) + jc.restrained([0], "yz")

    def lowest(p):
        rope = jc.FrictionCables(
            links=[[0, 1, 2], [4, 5, 6, 7]],
            axial_stiffness=1e5,
            friction=p["mu"],
            radius=p["radius"] * jnp.array([[1.0, 0.0], [0.5, 0.25]]),
        )
        groups = {"rope": rope, "spring": jc.Cables([[3, 0]], axial_stiffness=3e4)}
        structure = jc.Structure(jnp.asarray(np.vstack([nodes, more])), groups, held)
        loads = jc.NodalLoads([2], p["load"])
        first = jc.Phase(pretension={"rope": 900.0, "spring": 900.0}, loads=loads)
        solution = jc.solve(structure, [first, jc.Phase(loads=loads)], TIGHT)
        return solution.displacement[2, 2] + 0.1 * solution.displacement[2, 1], solution.status

    point = {
        "mu": jnp.array(0.2),
        "radius": jnp.array(0.4),
        "load": jnp.array([0.0, 60.0, -600.0]),
    }
    gradient = assert_gradient(lowest, point)
    assert abs(float(gradient["radius"])) > 1e-3
    values = jax.vmap(lambda r: lowest({**point, "radius": r})[0])(jnp.array([0.2, 0.4]))
    assert_allclose(values[1], lowest(point)[0], rtol=1e-9)


@pytest.mark.slow
def test_lifts_off():
    """A saddle that a load pulls down past the line of its cable would have to pull."""
    nodes = [[-4.0, 0.0, 0.0], [0.0, 0.0, 0.5], [4.0, 0.0, 0.0]]
    rope = jc.FrictionCables(links=[[0, 1, 2]], axial_stiffness=1e6, radius=0.3)
    mast = jc.Springs([1], (1e6, 1e6, 1e4))
    structure = jc.Structure(nodes, {"rope": rope, "mast": mast}, jc.pinned([0, 2]))
    start = jc.Phase(pretension={"rope": 2e4})
    sinks = jc.Phase(loads=jc.NodalLoads([1], (0, 0, -2e4)), increments=4)
    solution = converged(jc.solve(structure, [start, sinks], TIGHT))
    before, after = (of_rope(phase, "contact_pressure")[0] for phase in solution.phases)
    assert after < 0 < before
    assert of_rope(solution, "contact_arc")[0] < 0


@pytest.mark.parametrize(
    ("text", "changes"),
    [
        (r"radius\[0, 0\] = -1.0: must not be negative", {"radius": -1.0}),
        (r"radius\[0, 0\] = 0.6: must not be larger than half", {"radius": [[0.6, 0.1]]}),
        (r"radius\[0, 1\] = 0.1: the polygon of the nodes is straight", {"radius": 0.1}),
        (r"radius\[0, 0\] = 0.1: `axis` is zero", {"radius": 0.1, "axis": (0.0, 0.0, 0.0)}),
        (r"axis: expected .*shape \(3,\) or \(1, 2, 3\), got \(2,\)", {"axis": [1.0, 0.0]}),
        (
            r"radius\[0, 0\] = 0.1: `axis` is zero there, or more",
            {"radius": 0.1, "axis": (1, 1, 0)},
        ),
        (r"radius\[0, 0\] = 0.1: the cable turns against", {"radius": 0.1, "axis": (0, 1, 0)}),
        (r"axis: of saddles and pulleys with a `radius`", {"axis": (0, 1, 0)}),
    ],
)
def test_messages(text, changes):
    nodes = [[0.0, 0, 0], [1.0, 0, 0], [1.0, 0, 1], [1.0, 0, 3]]
    nodes[3][0] += 1e-3 * ("straight" not in text)
    given = {"links": [[0, 1, 2, 3]], "axial_stiffness": EA} | changes
    with pytest.raises(ValueError, match=text):
        jc.Structure(nodes, jc.FrictionCables(**given), jc.pinned([0, 3]))
    with pytest.raises(ValueError, match="radius: hanging cables bend at their nodes"):
        jc.SlidingCatenaries(links=[[0, 1, 2]], axial_stiffness=EA, radius=0.1)
