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
    """Dead loads alone are what a phase adds (`convergence`)."""
    package, found = Path(jc.__file__).parent, set()
    for path in [*package.glob("equilibrium/*.py"), *package.glob("paths/*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and ast.unparse(node) == "system.load":
                found.add(path.stem)
    assert found == {"convergence"}


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
STIFFNESS = 3500.0  # EA, N


def hung():
    """A mass between two feet, on cables longer than their distance: its system."""
    cables = jc.Cables([[0, 2], [1, 2]], axial_stiffness=STIFFNESS, weight=10.0, rest_length=REST)
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


def pulls(place):
    """Tensions of both cables, and unit vectors to their feet, at a place of the mass."""
    away = FEET - place
    length = np.linalg.norm(away, axis=1)
    return STIFFNESS * np.maximum(length / REST - 1, 0.0), away / length[:, None]


def energy(place, velocity):
    """Energy of the mass and of the cables, J."""
    tension, _ = pulls(place)
    stored = 0.5 * np.sum(tension**2) * REST / STIFFNESS
    return 0.5 * MASS * velocity @ velocity + MASS * GRAVITY * place[2] + stored


@pytest.mark.slow
def test_cables_go_slack_and_taut_again():
    """A mass thrown up falls into cables, against an adaptive scheme of order 8."""
    system = hung()

    def rate(_, y):
        tension, to_feet = pulls(y[:3])
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
    taut = np.array([pulls(place)[0] > 0 for place in places])
    changes = np.abs(np.diff(taut.astype(int), axis=0)).sum(axis=0)
    assert changes.min() >= 1 and changes.sum() >= 4  # one was taut, slack, and taut again
    # 4 for a smooth force; a step in which a cable goes taut has an error of its own
    assert errors[0] / errors[1] > 3 and errors[1] < 2e-3
    # with average acceleration momentum changes by the mean force of every step exactly
    forces = [np.einsum("n,nj->j", *pulls(place)) for place in places]
    forces = np.array(forces) - [[0, 0, MASS * GRAVITY]]
    impulse = (forces[1:] + forces[:-1]).sum(axis=0) * 0.5 / count
    assert_allclose(MASS * (speeds[-1] - speeds[0]), impulse, rtol=1e-8)
    energies = [energy(*at) for at in zip(places, speeds, strict=True)]
    # the step is a sixtieth of the period of the mass on a taut cable
    assert np.abs(np.array(energies) / energies[0] - 1).max() < 0.02


def test_derivatives_through_steps():
    """By gravity and the velocity at the start, through cables that are slack at first."""
    system, count = hung(), 20

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


def test_derivatives_through_steps_with_memory(yielding):
    """Displacements, and the last by the force: every step depends on what the one before left."""

    @traced
    @partial(jax.value_and_grad, has_aux=True)
    def end(force):
        system, (begun, masses) = pushed(yielding, force)

        def step(restart, _):
            states, begun = restart
            now = copy_with(system, states=states)
            now, ended, code = step_in_time(now, begun, masses, 0.01, method=taylor.TIGHT)
            return (now.states, ended), (code, ended.motion[1, 0])

        _, (codes, moved) = lax.scan(step, (system.states, begun), None, 80)
        return moved[-1], (codes, moved)

    (_, (codes, moved)), gradient = end(PUSH)
    assert not np.any(codes)
    exact = yielded(PUSH, float(yielding[1][1, 0]), 0.01, 80)
    # 1e-13 of the forces over the stiffness, in 80 steps
    assert_allclose(moved, exact, rtol=0, atol=1e-11)
    # the end is linear in the force as long as the bar yields in the same steps
    begin, change = float(yielding[1][1, 0]), 0.1
    ends = [yielded(PUSH + by, begin, 0.01, 80)[-1] for by in (change, -change)]
    assert_allclose(gradient, (ends[0] - ends[1]) / (2 * change), rtol=1e-9)


N_BEAM = 4


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
    half, count = np.pi / frequency, 20
    begun = let_go(system, system.space.at_rest(system.nodes), speed)
    found = gone(system, begun, half / count, count)
    tip = [m.motion[n, 2] * frequency / speed[n, 2] for m in found]
    turned = of_average_acceleration(frequency, half / count) * half
    # four cubic elements: 3e-5 of the frequency, as `dynamics.modes` has it
    assert_allclose(tip[-1], np.sin(turned), atol=2 * 3e-5 * np.pi)
    assert_allclose(tip[count // 2], 1.0, atol=2e-3)  # of the second mode, with the mass at nodes


@pytest.mark.slow
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
