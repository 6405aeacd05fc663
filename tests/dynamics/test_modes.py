"""Natural modes about loaded states, against closed forms, SciPy and differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import beam, pieces
from oracles.convergence import converged
from oracles.traced import traced
from scenes.frames import in_plane

import jaxcable as jc
from jaxcable.dynamics import mode_warnings, modes
from jaxcable.model.supports import FixedDofs
from jaxcable.spaces.dof_map import make_dof_map

# weights are masses
pytestmark = pytest.mark.filterwarnings("ignore:elements.*no phase has SelfWeight")

LENGTH, WEIGHT, EA = 10.0, 5.0, 1e7
MASS = WEIGHT / 9.80665  # kg/m


def string(n, pretension=1000.0, plane=False):
    nodes, links = pieces(n, LENGTH)
    cables = jc.Cables(links, axial_stiffness=EA, weight=WEIGHT)
    supports = jc.pinned([0, n])
    if plane:
        supports = supports + jc.restrained(range(1, n), "y")
    structure = jc.Structure(nodes, cables, supports)
    solution = jc.solve(structure, [jc.Phase(pretension=pretension)])
    assert isinstance(solution.status, jax.core.Tracer) or int(solution.status) == 0
    return structure, solution


def string_frequency(k, pretension=1000.0):
    """``k/2L sqrt(T/m)``, m the mass of a metre of the stretched string."""
    return k / (2 * LENGTH) * np.sqrt(pretension * (1 + pretension / EA) / MASS)


def test_taut_string_of_fifty_elements():
    found = modes(*string(50), n=8)
    pairs = np.asarray(found.frequency).reshape(4, 2)  # across the string, both ways
    exact = string_frequency(np.arange(1, 5))
    assert np.abs(pairs / exact[:, None] - 1).max() < 1e-5  # asked for: 1e-3
    sine = np.sin(np.pi * np.linspace(0, 1, 51))
    assert np.allclose(np.linalg.norm(np.asarray(found.shape)[0], axis=1), sine, atol=1e-5)


def test_order_of_the_mass_matrices():
    strings = [string(n) for n in (5, 10)]
    for distribution, order in (("lumped", 2), ("consistent", 2), ("mean", 4), (None, 4)):
        found = [modes(*own, 1, distribution=distribution).frequency[0] for own in strings]
        errors = np.abs(np.array(found) / string_frequency(1) - 1)
        assert abs(np.log2(errors[0] / errors[1]) - order) < 0.1, distribution
    light = modes(*strings[0], 1, gravity=4 * 9.80665)  # a quarter of the mass
    assert float(light.frequency[0]) == pytest.approx(2 * float(found[0]), rel=1e-9)


@pytest.mark.slow
def test_derivative_by_the_pretension():
    """f^2 is proportional to T (1 + T/EA), whatever the number of elements."""

    def frequency(pretension):
        return modes(*string(3, pretension, plane=True), n=1).frequency[0]

    value, rate = jax.value_and_grad(frequency)(1000.0)
    share = 0.5 / 1000.0 + 0.5 / EA / (1 + 1000.0 / EA)
    assert abs(float(rate / value) / share - 1) < 1e-8


def test_derivative_of_a_shape_by_a_mass():
    """Two masses on a string, 1 and m > 1: ``(1 / (2 - k), 1)``, k the root of ``det(K - k M)``."""
    structure, solution = string(3, plane=True)

    def shape(mass):
        masses = jnp.array([0.0, 1e3, 1e3, 0.0]) * jnp.stack([1.0, 1.0, mass, 1.0])
        return modes(structure, solution, n=1, masses=masses).shape[0, :, 2]

    def exact(mass):
        half = 1 + mass
        least = (half - jnp.sqrt(half**2 - 3 * mass)) / mass
        return jnp.stack([jnp.zeros(()), 1 / (2 - least), jnp.ones(()), jnp.zeros(())])

    mass = jnp.asarray(2.0)
    wanted = jax.jacfwd(exact)(mass)
    assert abs(wanted[1]) > 0.1
    ways = (shape, jax.jacfwd(shape), jax.jacrev(shape))
    found, *slopes = traced(lambda mass: [way(mass) for way in ways])(mass)
    # the string itself has a mass of 1.7e-3 of those on it
    assert np.allclose(found, exact(mass), atol=1e-3)
    for slope in slopes:
        assert np.allclose(slope, wanted, atol=1e-3)


@pytest.mark.filterwarnings("ignore:fixed. leaves free")
def test_added_masses_and_an_unstable_state():
    structure, phases = jc.scenes.von_mises_truss(load=100.0)
    solution = converged(jc.solve(structure, phases))
    found = modes(structure, solution, masses=10.0)
    stiffness = float(jc.stiffness.tangent_stiffness(structure, solution)[0, 0])
    assert abs(float(found.frequency[0]) * 2 * np.pi - np.sqrt(stiffness / 10)) < 1e-9
    held = jc.replace(structure, supports=jc.pinned(range(3)))
    down = converged(jc.solve(held, [jc.Phase(loads=jc.SupportMovement([1], (0, 0, -0.1)))]))
    free = np.ones((3, 3), bool)
    free[1, 2] = False
    found = modes(held, down, masses=10.0, fixed=free)
    assert float(found.squared[0]) < 0 and np.isnan(found.frequency[0])


def cantilever(law, points=4, ei=2100.0, weight=77.0, n=1):
    """Slowest mode of a beam of 4 m in its plane, clamped at one end, squared, 1/s2."""
    side = (12 * ei / 210e9) ** 0.25
    section = jc.Section.rectangle(side, side, law)
    numbers = {"torsional_stiffness": 1e5, "weight": weight, "points": points}
    structure = beam(n, section, 4.0, in_plane(n + 1, clamped=[0]), **numbers)
    solution = converged(jc.solve(structure, jc.Phase()))
    return float(modes(structure, solution, n=1).squared[0])


@pytest.mark.slow
def test_one_beam_swings_as_its_cubic():
    """The textbook's stiffness and consistent mass of one beam, by NumPy."""
    mass = 77.0 / 9.80665 * 4.0
    stiffness = 2100.0 / 4.0**3 * np.array([[12, -6 * 4.0], [-6 * 4.0, 4 * 4.0**2]])
    inertia = mass / 420 * np.array([[156, -22 * 4.0], [-22 * 4.0, 4 * 4.0**2]])
    expected = np.linalg.eigvals(np.linalg.solve(inertia, stiffness)).min()
    # the section's fibres have the second moment of area of the rectangle, to rounding
    assert cantilever(jc.Elastic(210e9)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
def test_mass_on_a_rigid_arm_swings():
    """A beam of 2 m with 1 kg on its end and 10 kg on an arm of 3 m: two modes in each plane.

    The exact problem of the end's deflection and turn; held there, the turn alone.
    """
    stiff = jc.Section.rectangle(0.1, 0.1, jc.Elastic(1e9))
    nodes = [[0.0, 0, 0], [0, 0, 2.0], [0, 0, 5.0]]
    mast = jc.Beams([[0, 1]], section=stiff, up=(1.0, 0, 0))
    structure = jc.Structure(nodes, mast, supports=jc.clamped([0]), rigid=[[1, 2]])
    solution = converged(jc.solve(structure, jc.Phase(loads=jc.NodalLoads([2], (0.0, 0, 0)))))
    masses = np.array([0.0, 1.0, 10.0])

    def squared(*held):
        fixed = np.zeros((3, 6), bool)
        fixed[0] = True
        fixed[1, list(held)] = True
        return modes(structure, solution, 9, masses=masses, fixed=fixed).squared

    bend, arm = 1e9 * 0.1**4 / 12, 3.0
    stiffness = bend / 2.0**3 * np.array([[12, -12.0], [-12.0, 16.0]])
    inertia = np.array([[11.0, 10 * arm], [10 * arm, 10 * arm**2]])
    across = np.sort(np.linalg.eigvals(np.linalg.solve(inertia, stiffness)))
    along = 1e9 * 0.01 / 2.0 / 11.0  # the arm turns about itself without mass: no mode
    expected = np.sort([*across, *across, along])
    np.testing.assert_allclose(squared(), expected, rtol=1e-9)
    turn = 4 * bend / 2.0 / (10 * arm**2)
    np.testing.assert_allclose(squared(0, 1), [turn, turn, along], rtol=1e-9)
    np.testing.assert_allclose(squared(0, 1, 2), [turn, turn], rtol=1e-9)


def test_ropes_have_their_mass_where_they_have_slid():
    """Masses by the pieces of the moment, with a stiffness of its own: generalized by NumPy."""
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [4, 0, 0], [6, 0, 0]])
    rope = jc.SlidingCables([[0, 1, 2, 3]], axial_stiffness=1e5, weight=10.0)
    supports = jc.pinned([0, 3]) + jc.restrained([1, 2], "xy")
    structure = jc.Structure(nodes, rope, supports=supports)
    loads = [jc.NodalLoads([1, 2], np.array([[0, 0, -600.0], [0, 0, -5.0]])), jc.SelfWeight()]
    solution = jc.solve(
        structure, jc.Phase(pretension=500.0, shortening=-3.0, increments=10, loads=loads)
    )
    assert int(solution.status) == 0
    piece = np.linalg.norm(np.diff(solution.positions, axis=0), axis=1)
    part = 10.0 * float(solution.rest_length[0]) / 9.80665 * piece / piece.sum()
    inertia = np.diag(0.5 * (part[:-1] + part[1:]))
    stiffness = np.asarray(jc.stiffness.tangent_stiffness(structure, solution))
    expected = np.sort(np.linalg.eigvals(np.linalg.solve(inertia, stiffness)))
    found = modes(structure, solution, 2, masses=0.0).squared
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.slow
def test_beams_of_curves_swing_in_one_element():
    """Its deflection has a number of its own within; ten layers bend with 1 - 1/10^2 of EI.

    Bernoulli's cantilever, in squares: 6e-4 away, a cubic alone 1 %.
    """
    law = jc.Polygonal([-0.01, 0.0, 0.01], [-2.1e9, 0.0, 2.1e9], "elastic")
    exact = 1.8751040687119611**4 * 2100.0 / (77.0 / 9.80665 * 4.0**4)
    assert cantilever(law) == pytest.approx(0.99 * exact, rel=1e-3)
    assert cantilever(jc.Elastic(210e9)) > 1.009 * exact


@pytest.mark.slow
def test_modes_within_catenaries_are_not_passed_over_in_silence():
    """A mast on a ball joint between catenaries in its plane, its top held across."""
    nodes = [[0.0, 0, 0], [0.0, 0, 10], [-20.0, 0, 0], [20.0, 0, 0]]
    parts = {
        "guys": jc.Catenaries([[2, 1], [3, 1]], axial_stiffness=1e7, weight=20.0),
        "mast": jc.Bars([[0, 1]], axial_stiffness=1e9, weight=100.0),
    }
    supports = jc.pinned([0, 2, 3]) + jc.restrained([1], "y")
    structure = jc.Structure(nodes, parts, supports=supports)
    phase = jc.Phase(pretension={"guys": 5e3, "mast": None}, loads=jc.SelfWeight())
    solution = converged(jc.solve(structure, phase))
    own = np.sqrt(float(solution.tension["guys"][0]) / (20.0 / 9.80665)) / 2 / np.hypot(20, 10)
    words = rf"catenary [01] of elements\['guys'\] vibrates within its span at about {own:.2f} Hz"
    with pytest.warns(jc.InputWarning, match=words):
        found = modes(structure, solution, n=1)
    assert 1.0 < own < 1.5 < float(found.frequency[0])
    with pytest.raises(ValueError, match="no node that is free to move has mass; catenaries have"):
        modes(structure, solution, fixed=np.ones((4, 3), bool))
    with pytest.raises(
        ValueError, match="reference: missing; loads change the stiffness of catenaries"
    ):
        jc.stiffness.buckling_factor(structure, solution)


def test_loads_that_follow_without_a_potential_are_refused():
    nodes = np.array([[0, 0, 1], [-1, 0, 0], [1, 0, 0], [-0.2, -1, 0.9], [0.2, 1, 1.1]])
    bars = jc.Bars([[0, 1], [0, 2], [0, 3]], axial_stiffness=1e4)
    structure = jc.Structure(nodes, bars, supports=jc.pinned([1, 2, 3, 4]))
    pressed = jc.Phase(loads=jc.FacePressure([[0, 3, 4]], 60.0))
    solution = converged(jc.solve(structure, pressed))
    with pytest.raises(ValueError, match="state: follower loads or nodal moments make"):
        modes(structure, solution, masses=1.0)

    def slowest(pressure):
        load = jc.FacePressure([[0, 3, 4]], pressure)
        state = jc.solve(structure, jc.Phase(loads=load))
        return modes(structure, state, masses=jnp.ones(5)).squared

    assert np.isnan(traced(slowest)(60.0)).all()
    assert not np.isnan(traced(slowest)(0.0)).any()


def test_masses_whose_weight_was_a_load():
    """A pendulum of a second: two bobs in a list, or one that is forgotten, which is said.

    ``sqrt(g / l) / 2 pi`` = 1/2 Hz; the rope has a millionth of the mass. It hangs from a heavy
    beam that is held at both ends: neither its weight nor a load on a held end counts.
    """
    gravity = 9.80665
    length = gravity / np.pi**2
    rope = jc.Cables([[0, 1]], axial_stiffness=1e6, weight=1e-6 * gravity)
    beam = jc.Bars([[0, 2]], axial_stiffness=1e9, weight=1e3)
    parts, nodes = {"rope": rope, "beam": beam}, [[0.0, 0, 0], [0, 0, -length], [1.0, 0, 0]]
    structure = jc.Structure(nodes, parts, jc.pinned([0, 2]))
    bobs = [jc.PointMasses([1], 0.5), jc.PointMasses([1], 1.5)]
    loads = [*bobs, jc.NodalLoads([2], (0.0, 0.0, -50.0))]
    pulled = jc.Phase(pretension={"rope": 2 * gravity}, loads=loads)
    solution = converged(jc.solve(structure, pulled))
    found = modes(structure, solution, n=2, masses=bobs)
    assert np.asarray(found.frequency) == pytest.approx(0.5, rel=1e-5)
    with pytest.warns(jc.InputWarning, match="nodal loads of 19.61 N downwards have no mass here"):
        modes(structure, solution, n=2)
    modes(structure, solution, n=2, masses=0.0)  # silent


def test_nodes_on_inclined_bearings_move_vertically_in_part():
    """Held along z, along a line 60 degrees off it, along x and y, and not at all."""
    sine, cosine = np.sin(np.pi / 3), 0.5
    inclined = [[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]]
    axes = np.array([np.eye(3), inclined, np.eye(3), np.eye(3)])
    held = np.array([[0, 0, 1], [0, 0, 1], [1, 1, 0], [0, 0, 0]], bool)
    found = mode_warnings.vertical_mobility(make_dof_map(FixedDofs(held, axes)))
    np.testing.assert_allclose(found, [0, sine**2, 1, 1], atol=1e-15)
    found = mode_warnings.vertical_mobility(make_dof_map(FixedDofs(held)))
    np.testing.assert_allclose(found, [0, 0, 1, 1])


def test_fixed_replaces_the_supports():
    """Which a warning says, unless nothing is fixed: a body without supports."""
    structure, solution = string(3)
    held = np.array(solution.last.fixed[-1].array)
    for freed in (held, np.zeros_like(held)):
        modes(structure, solution, n=1, fixed=freed)
    held[0, 2] = False
    with pytest.warns(jc.InputWarning, match="fixed: leaves free what .* node 0 along z"):
        modes(structure, solution, n=1, fixed=held)
