"""Motion in time by a `System` with inertia (`extensions/own_motion.py`), against other models.

The solvers of equilibrium bring it to the end of every step as they bring any other system.
"""

import ast
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import pieces
from extensions.own_links import Dampers
from extensions.own_motion import GRAVITY, at_rest, history, let_go, moving, step_in_time
from jax import lax
from numpy.testing import assert_allclose
from oracles import taylor
from oracles.convergence import converged
from oracles.traced import traced
from scenes.frames import in_plane, solid
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jaxcable as jc
from jaxcable.common.tree import copy_with
from jaxcable.spaces.dof_map import make_dof_map

# weights are masses
pytestmark = pytest.mark.filterwarnings("ignore:elements.*no phase has SelfWeight")


def chain(n):
    return pieces(n)[1]


def along_x(length, n):
    return pieces(n, length)[0]


def gone(system, start, duration, count, damping=0.0, rho=None):
    """All `InMotion` of a motion whose steps all have converged."""
    found, codes = history(system, start, duration, count, damping, rho)
    assert codes == [0] * count
    return found


def of_average_acceleration(frequency, step):
    """Circular frequency that the method makes of one: ``tan(w' h / 2) = w h / 2``."""
    return 2 / step * np.arctan(0.5 * frequency * step)


def test_solvers_ask_the_system_for_all_forces():
    """Dead loads alone are a scale of forces (`predicted`), or what a phase adds (`balance`)."""
    package, found = Path(jc.__file__).parent, set()
    for path in [*package.glob("equilibrium/*.py"), *package.glob("paths/*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and ast.unparse(node) == "system.load":
                found.add(path.stem)
    assert found == {"convergence", "predicted_forces"}


# --- a plucked string

LENGTH, WEIGHT, EA, PULL, N_STRING = 10.0, 5.0, 1e5, 1000.0, 8


@pytest.fixture(scope="module")
def string():
    """A taut string, its system, and its motion plucked to half a sine of 10 um."""
    cables = jc.Cables(chain(N_STRING), axial_stiffness=EA, weight=WEIGHT)
    supports = jc.pinned([0, N_STRING])
    structure = jc.Structure(along_x(LENGTH, N_STRING), cables, supports)
    solution = converged(jc.solve(structure, jc.Phase(pretension=PULL)))
    system, x = at_rest(structure, solution)
    assert system.is_net
    return structure, system, x.at[:, 2].add(1e-5 * np.sin(np.pi * structure.nodes[:, 0] / LENGTH))


@pytest.mark.slow
def test_a_plucked_string(string):
    """Second order in the time step, about the frequency of the chain, near that of the string."""
    _, system, x = string
    mass, turn = WEIGHT / GRAVITY / (1 + PULL / EA), np.pi / N_STRING  # per length as it is
    exact = np.pi / LENGTH * np.sqrt(PULL / mass)
    # masses of elements are the mean of lumped and consistent ones
    chain_of = (2 - 2 * np.cos(turn)) / (5 / 6 + np.cos(turn) / 6)
    frequency = N_STRING / LENGTH * np.sqrt(PULL / mass * chain_of)
    assert abs(frequency / exact - 1) < 1.1 * turn**4 / 480  # its order is 4
    quarter, left = 0.5 * np.pi / exact, []
    for count in (4, 8, 16):
        begun = let_go(system, x, jnp.zeros_like(x))
        end = gone(system, begun, quarter / count, count)[-1]
        middle = end.motion[N_STRING // 2, 2] / 1e-5
        turned = of_average_acceleration(frequency, quarter / count) * quarter
        # the amplitude over the length, squared, times EA / N is 1e-10; rounding is 1e-16 / 1e-5
        assert_allclose(middle, np.cos(turned), atol=1e-8)
        left.append(middle - np.cos(frequency * quarter))
    assert abs(np.log2(left[0] / left[1]) - 2) < 0.03
    assert abs(np.log2(left[1] / left[2]) - 2) < 0.01


@pytest.mark.slow_cases("paired0")
@pytest.mark.parametrize("paired", [(), (True,)])
def test_a_sparse_tangent_has_places_for_inertia(string, paired):
    """The links of the elements once more, after all that the pattern has places for."""
    structure, system, x = string
    links = structure.elements.links, 3, ()
    fixed = structure.fixed(structure.supports)
    dof_map = make_dof_map(fixed, None, (links, links), "superlu", paired=paired)
    sparse = copy_with(system, space=copy_with(system.space, dof_map=dof_map))
    begun = let_go(system, x, jnp.zeros_like(x))
    ends = [gone(one, begun, 0.02, 1)[-1].motion for one in (system, sparse)]
    assert np.abs(np.asarray(ends[0] - x)).max() > 1e-7
    assert_allclose(ends[1], ends[0], rtol=0, atol=1e-15)


# --- a mass on cables that go slack

SPAN, REST, FALL, VELOCITY = 3.0, 3.5, (0.3, 0.0, 1.0), (1.0, 0.5, 2.0)
FEET = np.array([[-SPAN, 0.0, 0.0], [SPAN, 0.0, 0.0]])
BENT = jc.materials.Polygonal([-1.0, 0.0, 0.01, 1.0], [-1e6, 0.0, 3.5e5, 5.3e6], "reversible")
LAWS = {  # of cables, and their force at a strain that is not negative, N
    "straight": ({"axial_stiffness": 3500.0}, lambda e: 3500.0 * e),
    "bent": (
        {"section": jc.Section([0.0], [0.0], [1e-4], [BENT])},
        lambda e: np.interp(e, [0.0, 0.01, 1.0], [0.0, 35.0, 530.0]),
    ),
}


def hung(law):
    """A mass between two feet, on cables longer than their distance: its system."""
    cables = jc.Cables([[0, 2], [1, 2]], weight=10.0, rest_length=[REST, REST], **LAWS[law][0])
    structure = jc.Structure([*FEET, [0.0, 0.0, 0.0]], cables, jc.pinned([0, 1]))
    solution = converged(jc.solve(structure, jc.Phase(loads=jc.SelfWeight())))
    system, _ = at_rest(structure, solution)
    assert system.is_net
    return system


def thrown(system, velocity=VELOCITY):
    place, rate = (jnp.zeros((3, 3)).at[2].set(jnp.asarray(v)) for v in (FALL, velocity))
    return let_go(system, place, rate, distribution="lumped")


def of_mass(found):
    """Places and velocities of the mass, which begins at the origin, [n, 3] each."""
    return [np.array([getattr(m, name)[2] for m in found]) for name in ("motion", "velocity")]


MASS = 10.0 * REST / GRAVITY  # half of each cable


def pulls(place, force):
    """Tensions of both cables, and unit vectors to their feet, at a place of the mass."""
    away = FEET - place
    length = np.linalg.norm(away, axis=1)
    return force(np.maximum(length / REST - 1, 0.0)), away / length[:, None]


def energy(place, velocity, force):
    """Energy of the mass and of linear cables, J."""
    tension, _ = pulls(place, force)
    stored = 0.5 * np.sum(tension**2) * REST / 3500.0
    return 0.5 * MASS * velocity @ velocity + MASS * GRAVITY * place[2] + stored


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_cables_go_slack_and_taut_again(law):
    """A mass thrown up falls into cables, against an adaptive scheme of order 8 (both solvers)."""
    system, force = hung(law), LAWS[law][1]

    def rate(_, y):
        tension, to_feet = pulls(y[:3], force)
        return np.r_[y[3:], tension @ to_feet / MASS + [0, 0, -GRAVITY]]

    start = np.r_[FALL, VELOCITY]
    exact = solve_ivp(*(rate, (0, 1.0), start, "DOP853"), rtol=1e-10, atol=1e-11, max_step=2e-3).y[
        :, -1
    ]
    errors = []
    for count in (100, 200):
        found = gone(system, thrown(system), 1.0 / count, count)
        errors.append(np.linalg.norm(np.asarray(found[-1].motion[2]) - exact[:3]))
    places, speeds = of_mass(found)
    taut = np.array([pulls(place, force)[0] > 0 for place in places])
    changes = np.abs(np.diff(taut.astype(int), axis=0)).sum(axis=0)
    assert changes.min() >= 1 and changes.sum() >= 4  # one was taut, slack, and taut again
    # 4 for a smooth force; a step in which a cable goes taut has an error of its own
    assert errors[0] / errors[1] > 3 and errors[1] < 2e-3
    # with average acceleration momentum changes by the mean force of every step exactly
    forces = [np.einsum("n,nj->j", *pulls(place, force)) for place in places]
    forces = np.array(forces) - [[0, 0, MASS * GRAVITY]]
    impulse = (forces[1:] + forces[:-1]).sum(axis=0) * 0.5 / count
    assert_allclose(MASS * (speeds[-1] - speeds[0]), impulse, rtol=1e-8)
    if law == "straight":
        energies = [energy(*at, force) for at in zip(places, speeds, strict=True)]
        # the step is a sixtieth of the period of the mass on a taut cable
        assert np.abs(np.array(energies) / energies[0] - 1).max() < 0.02


@pytest.mark.slow
def test_short_waves_are_damped():
    """With rho = 0 the motion along a stiff cable dies, and the swing of the mass goes on."""
    system = hung("straight")
    found = gone(system, thrown(system), 0.05, 40, rho=0.0)
    force = LAWS["straight"][1]
    energies = np.array([energy(*at, force) for at in zip(*of_mass(found), strict=True)])
    assert energies.max() < 1.01 * energies[0]
    assert energies[-1] < 0.9 * energies[0]


@pytest.mark.slow
def test_a_pendulum_of_one_cable():
    """Let go from the horizontal; errors of second order against an adaptive scheme of order 8."""
    length, weight, stiffness = 2.0, 20.0, 8000.0
    cable = jc.Cables([[0, 1]], axial_stiffness=stiffness, weight=weight)
    structure = jc.Structure(along_x(length, 1), cable, jc.pinned([0]))
    solution = converged(jc.solve(structure, jc.Phase(loads=jc.SelfWeight())))
    system, _ = at_rest(structure, solution)
    mass = 0.5 * weight * length / GRAVITY

    def rate(_, y):
        away = np.linalg.norm(y[:3])
        pull = stiffness * max(away / length - 1, 0.0)
        return np.r_[y[3:], -pull / mass * y[:3] / away + [0, 0, -GRAVITY]]

    start = [length, 0, 0, 0, 0, 0]
    exact = solve_ivp(rate, (0, 1.0), start, "DOP853", rtol=1e-11, atol=1e-12).y[:3, -1]
    assert exact[0] < -0.3 * length  # it has passed the lowest point
    places = []
    for count in (100, 200, 400):
        still = jnp.zeros((2, 3))
        begun = let_go(system, still, still, distribution="lumped")
        found = gone(system, begun, 1.0 / count, count)
        places.append(structure.nodes[1] + found[-1].motion[1])
    errors = [np.linalg.norm(place - exact) for place in places]
    assert errors[1] < 3e-4
    assert_allclose(np.divide(errors[:-1], errors[1:]), 4, atol=0.15)
    # what is left of order 4
    assert_allclose((4 * places[2] - places[1]) / 3, exact, atol=1e-6)


@pytest.mark.slow
def test_a_stiff_rope_whips():
    """A slack chain falls; EA is 1e5 times its tensions, and parts of it are slack for long."""
    n, stiffness, weight, radius, count = 10, 1e7, 10.0, 1.2, 100
    angle = np.linspace(0.0, np.pi, n + 1)
    nodes = radius * np.column_stack([1 - np.cos(angle), 0 * angle, -np.sin(angle)])
    rest = 1.05 * np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    cables = jc.Cables(chain(n), axial_stiffness=stiffness, weight=weight, rest_length=rest)
    structure = jc.Structure(nodes, cables, jc.pinned([0]))
    solution = converged(jc.solve(structure, jc.Phase(loads=jc.SelfWeight())))
    system, _ = at_rest(structure, solution)
    still = jnp.zeros((n + 1, 3))
    begun = let_go(system, still, still, distribution="lumped")
    found = gone(system, begun, 1.0 / count, count, rho=0.0)
    lumps = 0.5 * weight * (np.r_[rest, 0.0] + np.r_[0.0, rest])  # N
    places, speeds = (np.stack([getattr(m, k) for m in found]) for k in ("motion", "velocity"))
    places = places + nodes
    lengths = np.linalg.norm(np.diff(places, axis=1), axis=2)
    strains = np.maximum(lengths / rest - 1, 0.0)
    tensions = stiffness * strains
    assert (tensions[1:] == 0).any(axis=1).mean() > 0.4
    assert 1.0 < np.median(tensions[tensions > 0]) < 100.0
    energies = places[..., 2] @ lumps + 0.5 * (speeds**2).sum(axis=2) @ lumps / GRAVITY
    energies = energies + 0.5 * (tensions * strains) @ rest
    fallen = energies[0] - lumps @ places[..., 2].min(axis=0)
    # the method takes energy, mainly of waves along the rope, and gives none back
    assert energies.max() < energies[0] + 1e-3 * fallen


def test_derivatives_through_steps():
    """By gravity and the velocity at the start, through cables that are slack at first."""
    system, count = hung("straight"), 20

    @traced
    def end(p):
        pulled = copy_with(system, load=p[0] * system.load)
        begun, masses = thrown(system, p[1:])

        def step(begun, _):
            given = pulled, begun, masses, 0.04
            _, ended, code = step_in_time(*given, method=taylor.TIGHT)
            return ended, code

        ended, codes = lax.scan(step, begun, None, count)
        return ended.motion[2] @ jnp.array([1.0, 2.0, 3.0]), codes

    p = np.array([1.0, *VELOCITY])
    (_, codes), gradient = traced(jax.value_and_grad(end, has_aux=True))(p)
    assert not np.any(codes)

    # steps so small that no cable goes slack in another time step
    def value(p):
        return end(p)[0]

    found = [taylor.slope(value, p, g, 0.05) for g in (gradient, 1.01 * gradient)]
    assert found[0] > 1.9 and found[1] < 1.1


# --- bars, beams, and elements that remember


@pytest.mark.parametrize("rho", [None, 0.5])
@pytest.mark.parametrize("damping", [0.0, 3.0])
def test_a_linear_chain(rho, damping):
    """Bars along x: the recurrence of the method for matrices, and its energy."""
    stiffness, weight, n = 3000.0, 200.0, 3
    bars = jc.Bars(chain(n), axial_stiffness=stiffness, weight=weight)
    supports = jc.pinned([0]) + jc.restrained(range(1, n + 1), "yz")
    structure = jc.Structure(along_x(float(n), n), bars, supports)
    load = np.array([0.0, 0.0, 30.0])
    solution = converged(jc.solve(structure, jc.Phase(loads=jc.NodalLoads([n], (30.0, 0.0, 0.0)))))
    system, x = at_rest(structure, solution)
    system = copy_with(system, load=0.0 * system.load)  # let go

    stiff = stiffness * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    mass = weight / GRAVITY * (5 / 6 * np.eye(n) + (np.eye(n, k=1) + np.eye(n, k=-1)) / 12)
    stiff[-1, -1], mass[-1, -1] = stiffness, mass[-1, -1] / 2
    m, f = (0.0, 0.0) if rho is None else ((2 * rho - 1) / (rho + 1), rho / (rho + 1))
    beta, gamma, h = 0.25 * (1 - m + f) ** 2, 0.5 - m + f, 0.05
    u, v = np.linalg.solve(stiff, load), np.zeros(n)
    a = np.linalg.solve(mass, -stiff @ u)
    found = gone(system, let_go(system, x, jnp.zeros_like(x), damping), h, 30, damping, rho=rho)
    energies = []
    for ended in found[1:]:
        # by the acceleration at the end, as in the paper
        ahead = u + h * v + h**2 * (0.5 - beta) * a
        faster = v + h * (1 - gamma) * a
        whole = (1 - m) * mass + (1 - f) * (h * gamma * damping * mass + h**2 * beta * stiff)
        rest = m * mass @ a + damping * mass @ ((1 - f) * faster + f * v)
        new = np.linalg.solve(whole, -rest - stiff @ ((1 - f) * ahead + f * u))
        u, v, a = ahead + h**2 * beta * new, faster + h * gamma * new, new
        # residuals are up to 1e-10 of the forces, 30 N
        assert_allclose(ended.motion[1:, 0], u, rtol=0, atol=1e-10)
        speed = np.asarray(ended.velocity[1:, 0])
        energies.append(0.5 * (speed @ mass @ speed + u @ stiff @ u))
    if rho is None and damping == 0.0:
        assert_allclose(energies, 0.5 * load @ np.linalg.solve(stiff, load), rtol=1e-8)
    else:
        assert energies[-1] < 0.9 * energies[0]


@pytest.fixture(scope="module")
def yielding():
    """A mass on a bar that yields, beside a damper: its system, and its motion."""
    steel = jc.materials.steel(235e6, 210e9, 0.1)
    section = jc.Section([0.0], [0.0], [1e-6], [steel])
    bar = jc.Bars([[0, 1]], section=section, weight=4000.0)
    elements = {"bar": bar, "damper": Dampers([[0, 1]], 2e4)}
    supports = jc.pinned([0]) + jc.restrained([1], "yz")
    structure = jc.Structure(along_x(1.0, 1), elements, supports)
    solution = converged(jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], (1e-3, 0.0, 0.0)))))
    return at_rest(structure, solution)


PUSH = 200.0  # reached at once: the bar yields at 235 N


def pushed(yielding, force):
    """The system under a force along the bar, and its start."""
    system, x = yielding
    system = copy_with(system, load=jnp.zeros((2, 3)).at[1, 0].set(force))
    return system, let_go(system, x, jnp.zeros((2, 3)))


def yielded(push, u, h, count):
    """Displacements of the mass, one after each step, by one equation a step and bisection."""
    mass, area, v, path = 5 / 12 * 4000.0 / GRAVITY, 1e-6, 0.0, []
    # a spring that hardens, beside one that yields and has slipped
    hard, soft, most, slipped = 0.1 * 210e9 * area, 0.9 * 210e9 * area, 0.9 * 235.0, 0.0

    def force(u, slipped):
        return hard * u + np.clip(soft * (u - slipped), -most, most)

    a = (push - force(u, slipped)) / mass
    for _ in range(count):

        def ended(new, u=u, v=v, a=a):
            return 4 * ((new - u) / h - v) / h - a

        def unbalanced(new, u=u, ended=ended, slipped=slipped):
            return mass * ended(new) + force(new, slipped) + 2e4 * (new - u) - push

        new = brentq(unbalanced, u - 0.01, u + 0.01, xtol=1e-16)
        u, v, a = new, v + 0.5 * h * (a + ended(new)), ended(new)
        slipped = u - np.clip(soft * (u - slipped), -most, most) / soft
        path.append(u)
    assert slipped > 1e-4
    return np.array(path)


@pytest.mark.slow
def test_memory_settles_after_every_step(yielding):
    """A bar that yields, beside a damper."""
    system, start = pushed(yielding, PUSH)
    found = gone(system, start, 0.01, 80)
    moved = [ended.motion[1, 0] for ended in found[1:]]
    exact = yielded(PUSH, float(yielding[1][1, 0]), 0.01, 80)
    assert_allclose(moved, exact, rtol=0, atol=1e-11)  # 1e-10 of the forces over the stiffness


def test_derivatives_through_steps_with_memory(yielding):
    """By the force: every step depends on what the one before has left."""

    @traced
    @partial(jax.value_and_grad, has_aux=True)
    def end(force):
        system, (begun, masses) = pushed(yielding, force)

        def step(restart, _):
            states, begun = restart
            now = copy_with(system, states=states)
            now, ended, code = step_in_time(now, begun, masses, 0.01, method=taylor.TIGHT)
            return (now.states, ended), code

        (_, ended), codes = lax.scan(step, (system.states, begun), None, 80)
        return ended.motion[1, 0], codes

    (_, codes), gradient = end(PUSH)
    assert not np.any(codes)
    # the end is linear in the force as long as the bar yields in the same steps
    begin, change = float(yielding[1][1, 0]), 0.1
    ends = [yielded(PUSH + by, begin, 0.01, 80)[-1] for by in (change, -change)]
    assert_allclose(gradient, (ends[0] - ends[1]) / (2 * change), rtol=1e-9)


N_BEAM = 4  # of both tests, which share a program


def test_the_first_period_of_a_cantilever():
    """``3.516 sqrt(EI / m L^4)``, with the exact mode as velocity at the start."""
    n, length, area, inertia, modulus, weight = N_BEAM, 2.0, 1e-3, 1e-8, 210e9, 80.0
    section = solid(area, inertia, modulus)
    beams = jc.Beams(chain(n), section=section, torsional_stiffness=1.0, weight=weight)
    supports = in_plane(n + 1, clamped=[0])
    structure = jc.Structure(along_x(length, n), beams, supports)
    solution = converged(jc.solve(structure, jc.Phase(loads=jc.NodalLoads([n], (0.0, 0.0, 1.0)))))
    system, _ = at_rest(structure, solution)
    system = copy_with(system, load=jnp.zeros_like(system.load))
    k = brentq(lambda kl: np.cosh(kl) * np.cos(kl) + 1, 1.5, 2.0) / length
    s, at = (np.sinh, np.cosh, np.sin, np.cos), k * structure.nodes[:, 0]
    sinh, cosh, sin, cos = (f(at) for f in s)
    ratio = (cosh[-1] + cos[-1]) / (sinh[-1] + sin[-1])
    shape, slope = cosh - cos - ratio * (sinh - sin), k * (sinh + sin - ratio * (cosh - cos))
    speed = 1e-4 * jnp.zeros((n + 1, 6)).at[:, 2].set(shape).at[:, 4].set(-slope)
    frequency = k**2 * np.sqrt(modulus * inertia / (weight / GRAVITY))
    half, count = np.pi / frequency, 40
    begun = let_go(system, system.space.at_rest(system.nodes), speed)
    found = gone(system, begun, half / count, count)
    tip = [m.motion[n, 2] * frequency / speed[n, 2] for m in found]
    turned = of_average_acceleration(frequency, half / count) * half
    # four cubic elements: 3e-5 of the frequency, as `natural_frequencies` has it
    assert_allclose(tip[-1], np.sin(turned), atol=2 * 3e-5 * np.pi)
    assert_allclose(tip[count // 2], 1.0, atol=2e-3)  # of the second mode, with the mass at nodes


def test_beams_turn_over_large_angles():
    """A stiff pendulum of beams with their mass at nodes, and a tangent that is its Jacobian."""
    n, length = N_BEAM, 2.0
    section = solid(1e-2, 1e-4, 1e12)
    beams = jc.Beams(chain(n), section=section, torsional_stiffness=1.0, weight=4.0 * GRAVITY)
    supports = in_plane(n + 1, pinned=[0])
    structure = jc.Structure(along_x(length, n), beams, supports)
    solution = converged(jc.solve(structure, jc.Phase(loads=jc.NodalLoads([n], (1.0, 0.0, 0.0)))))
    system, _ = at_rest(structure, solution)
    masses = 4.0 * length / n * np.r_[0.5, np.ones(n - 1), 0.5]
    system = copy_with(system, load=jnp.zeros((n + 1, 6)).at[:, 2].set(-GRAVITY * masses))
    arms = structure.nodes[:, 0]
    pull = GRAVITY * (masses @ arms) / (masses @ arms**2)

    def rate(_, y):
        return y[1], pull * np.cos(y[0])

    angle = solve_ivp(rate, (0, 1.0), [0.0, 0.0], rtol=1e-10, atol=1e-11).y[0, -1]
    assert angle > 2.0
    exact, errors = length * np.array([np.cos(angle) - 1, 0.0, -np.sin(angle)]), []
    still = system.space.at_rest(system.nodes), jnp.zeros((n + 1, 6))
    for count in (50, 100):
        found = gone(system, let_go(system, *still, distribution="lumped"), 1.0 / count, count)
        errors.append(np.linalg.norm(np.asarray(found[-1].motion[n, :3]) - exact))
    assert errors[1] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(4, abs=0.2)

    @traced
    def tangents(begun, x):  # consistent masses have moments
        end = moving(system, begun, let_go(system, *still)[1], 0.05, damping=2.0, rho=0.6)
        residual, zero, _ = end.local_residual(x)
        return end.tangent(x), jax.jacfwd(residual)(zero)

    matrix, jacobian = tangents(found[-8], found[-1].motion)
    assert_allclose(matrix, jacobian, rtol=0, atol=1e-12 * np.abs(jacobian).max())
