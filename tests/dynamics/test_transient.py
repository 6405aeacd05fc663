"""Motion in time, against closed forms and integrations of the same equations by SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from extensions.own_links import Dampers
from numpy.testing import assert_allclose
from oracles import taylor
from oracles.convergence import converged
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jaxcable as jc
from jaxcable.dynamics import (
    Dashpots,
    EnergyBalance,
    ModalDamping,
    Rayleigh,
    Removal,
    motion_program,
    transient,
)
from jaxcable.programs.program_calls import as_program

# weights are masses
pytestmark = pytest.mark.filterwarnings("ignore:elements.*no phase has SelfWeight")

GRAVITY = 9.80665


# --- one degree of freedom

STIFFNESS, MASS, PULL = 8e3, 2.0, 16.0
FREQUENCY = np.sqrt(STIFFNESS / MASS)  # rad/s
PERIOD = 2 * np.pi / FREQUENCY


def one_mass(**options):
    """A mass on a bar along x, which is linear."""
    bar = jc.Bars([[0, 1]], axial_stiffness=STIFFNESS)
    guide = jc.pinned([0]) + jc.restrained([1], "yz")
    structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], bar, supports=guide)
    given = {"dt": PERIOD / 100, "steps": 100, "masses": np.array([0.0, MASS])} | options
    return converged(transient(structure, given.pop("loads", None), **given))


def test_a_sudden_load_deflects_twice_as_far():
    """A load at once, and a moving support, by every way to state them."""
    nodal = jc.NodalLoads([1], (PULL, 0, 0))
    array = np.zeros((101, 2, 3))
    array[:, 1, 0] = PULL
    ways = nodal, array, lambda t: array[0], jc.Varying(nodal, [0.0, 1.0], [1.0, 1.0])
    found = [one_mass(loads=loads).displacement[:, 1, 0] for loads in ways]
    for moved in found:  # the method shortens the step by (w h)^2 / 12, and w h = 0.06
        assert_allclose(np.max(moved), 2 * PULL / STIFFNESS, rtol=1e-3)
        assert_allclose(moved, found[0], rtol=1e-12)
    base = one_mass(base_acceleration=lambda t: jnp.array([-PULL / MASS, 0, 0]))
    assert_allclose(base.displacement[:, 1, 0], found[0], rtol=1e-9)
    energy = base.energy
    assert_allclose(energy.error, 0, atol=1e-12)
    assert_allclose(np.max(energy.kinetic), PULL**2 / (2 * STIFFNESS), rtol=1e-3)


def test_short_steps_in_single_precision():
    """Displacements are rounded by 1e-7, which the rates of a short step must not amplify."""
    nodes = np.array([[0.0, 0, 0], [1.0, 0, 0]], np.float32)
    guide = jc.pinned([0]) + jc.restrained([1], "yz")
    cable, bar = (
        jc.Structure(nodes, kind([[0, 1]], axial_stiffness=np.float32(STIFFNESS)), supports=guide)
        for kind in (jc.Cables, jc.Bars)
    )
    pull = jc.NodalLoads([1], np.array([PULL, 0, 0], np.float32))
    step = np.float32(PERIOD / 2000)
    moved = converged(transient(cable, pull, dt=step, steps=600, masses=np.float32(MASS)))
    assert moved.displacement.dtype == moved.energy.work.dtype == np.float32
    exact = PULL / STIFFNESS * (1 - np.cos(FREQUENCY * float(step) * np.arange(601)))
    assert_allclose(moved.displacement[:, 1, 0], exact, rtol=0, atol=1e-4 * exact.max())
    # from where nothing is displaced, and without load
    thrown = {
        "velocity": np.array([[0, 0, 0], [0.1, 0, 0]], np.float32),
        "masses": np.float32(MASS),
    }
    moved = converged(transient(bar, dt=np.float32(PERIOD / 100), steps=50, **thrown))
    assert_allclose(moved.displacement[25, 1, 0], 0.1 / FREQUENCY, rtol=1e-3)


@pytest.mark.parametrize("kind", ["ground", "between", "mass", "stiffness", "modal"])
def test_damping_has_the_overshoot_of_its_ratio(kind):
    ratio = 0.1
    c = 2 * ratio * MASS * FREQUENCY
    damping = {
        "ground": Dashpots([1], c),
        "between": Dashpots([[0, 1]], c),
        "mass": Rayleigh(mass=2 * ratio * FREQUENCY),
        "stiffness": Rayleigh(stiffness=2 * ratio / FREQUENCY),
        "modal": ModalDamping([1 / PERIOD], [[[0, 0, 0], [3.0, 0, 0]]], ratio),
    }[kind]
    moved = one_mass(loads=jc.NodalLoads([1], (PULL, 0, 0)), damping=[damping])
    peak = 1 + np.exp(-ratio * np.pi / np.sqrt(1 - ratio**2))
    assert_allclose(np.max(moved.displacement[:, 1, 0]), peak * PULL / STIFFNESS, rtol=1e-3)
    # what is dissipated is what is missing, up to the mean of both ends of steps
    assert_allclose(moved.energy.error, 0, atol=1e-4 * PULL**2 / STIFFNESS)
    # at the peak, the work of a constant force
    assert_allclose(moved.energy.largest, PULL * np.max(moved.displacement[:, 1, 0]), rtol=1e-9)


@pytest.mark.filterwarnings("ignore:dt. from t = .* the steps lose")
@pytest.mark.parametrize("radius", [0.0, 0.5, 0.9])
def test_the_spectral_radius_is_what_a_step_leaves_of_fast_oscillations(radius):
    """By a step of a thousand periods, minus the radius is a triple root: what is left of it after
    k steps is a polynomial of second order in k, whose third differences are zero."""
    moved = one_mass(
        dt=1e3 * PERIOD,
        steps=12,
        velocity=[[0, 0, 0], [1.0, 0, 0]],
        spectral_radius=radius,
        histories=["acceleration"],
    )
    left = np.asarray(moved.acceleration)[:, 1, 0]
    assert np.abs(left).max() > 1e-3
    if radius == 0:
        assert_allclose(left[4:], 0, atol=1e-4 * np.abs(left).max())
    else:
        polynomial = left[1:] / (-radius) ** np.arange(1, 13)
        differences = np.diff(polynomial, 3)
        assert_allclose(differences, 0, atol=1e-5 * np.abs(polynomial).max())
        wrong = np.diff(left[1:] / (-0.9 * radius) ** np.arange(1, 13), 3)
        assert np.abs(wrong).max() > 1e-3 * np.abs(polynomial).max()


# --- pendulums


def pendulum(stiffness, step, time=1.5, kind=jc.Cables, **options):
    """Position of a bob on an elastic rope of 1 m, released at half a radian, and the motion."""
    place = np.array([np.sin(0.5), 0.0, -np.cos(0.5)])
    rope = kind([[0, 1]], axial_stiffness=stiffness)
    structure = jc.Structure([[0.0, 0, 0], place], rope, supports=jc.pinned([0]))
    bob = jc.PointMasses([1], 2.0)
    steps = round(time / step)
    moved = transient(structure, bob, dt=step, steps=steps, masses=bob, **options)
    return place + np.asarray(converged(moved).displacement)[:, 1], moved


def integrated(stiffness, time=1.5):
    """The same by SciPy."""
    start = [np.sin(0.5), -np.cos(0.5), 0.0, 0.0]

    def rates(_, y):
        length = np.hypot(*y[:2])
        force = max(stiffness * (length - 1), 0.0) / 2.0
        return [*y[2:], -force * y[0] / length, -force * y[1] / length - GRAVITY]

    found = solve_ivp(rates, (0, time), start, rtol=1e-11, atol=1e-12, method="DOP853")
    return found.y[[0, 1], -1]


@pytest.mark.parametrize("scheme", ["generalized-alpha", "energy-momentum"])
def test_an_elastic_pendulum_converges_at_second_order(scheme):
    """A quarter of the step; bars, so that no kink of slack is passed."""
    stiffness, apart = 400.0, []
    exact = integrated(stiffness, 0.6)
    for step in (0.02, 0.005):
        place, _ = pendulum(stiffness, step, 0.6, jc.Bars, scheme=scheme)
        apart.append(np.abs(place[-1, [0, 2]] - exact).max())
    assert_allclose(0.5 * np.log2(apart[0] / apart[1]), 2, atol=0.15)


def test_energy_and_angular_momentum_stay():
    """A chain of two that goes slack and taut, by steps of twice the period of its links."""
    nodes = [[0.0, 0, 0], [0.4, 0.1, -0.9], [0.9, 0, -1.4]]
    ropes = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
    structure = jc.Structure(nodes, ropes, supports=jc.pinned([0]))
    options = {"dt": 0.04, "steps": 300, "scheme": "energy-momentum"}
    moved = transient(
        structure,
        jc.NodalLoads([1, 2], (0, 0, -GRAVITY)),
        masses=np.array([0.0, 1.0, 1.0]),
        histories=["displacement", "velocity", "tension"],
        **options,
    )
    assert int(moved.status) == 0
    assert np.sum(np.diff(np.asarray(moved.tension) > 0, axis=0)) >= 20
    assert_allclose(moved.energy.error, 0, atol=1e-9)
    place = np.asarray(nodes) + np.asarray(moved.displacement)
    spin = np.cross(place[:, 1:], np.asarray(moved.velocity)[:, 1:]).sum(axis=1)
    assert_allclose(spin[:, 2], 0, atol=1e-9)  # gravity has no moment about z


# --- what breaks


def test_a_bar_that_breaks():
    """The bar that stays swings to twice the change, or by the closed form of a ramp."""
    nodes = [[0.0, 0, 0], [0.5, 0, 0], [0.0, 0, -2.0]]
    bars = {
        "stays": jc.Bars([[0, 2]], axial_stiffness=1e6),
        "goes": jc.Bars([[1, 2]], axial_stiffness=5e5),
    }
    held = jc.pinned([0, 1]) + jc.restrained([2], "xy")
    structure = jc.Structure(nodes, bars, supports=held)
    before = converged(jc.solve(structure, jc.Phase(loads=jc.NodalLoads([2], (0, 0, -1e3)))))
    mass, period = 100.0, 2 * np.pi * np.sqrt(100.0 * 2.0 / 1e6)
    for time, ramp, factor in ((0.0, 0.0, 2.0), (0.25, 0.0, 2.0), (0.0, 0.5, 1 + 2 / np.pi)):
        gone = Removal("goes", time=time * period, duration=ramp * period)
        moved = transient(
            *(structure, None),
            start=before,
            dt=period / 200,
            steps=300,
            masses=np.array([0.0, 0.0, mass]),
            removes=gone,
        )
        assert int(moved.status) == 0
        force = np.asarray(moved.tension["stays"])[:, 0]
        first, last = float(before.tension["stays"][0]), 1e3  # it hangs plumb
        assert_allclose((force.max() - first) / (last - first), factor, rtol=1e-4)
        steps = round(200 * time)
        assert_allclose(force[: steps + 1], first, rtol=1e-9)
        assert not np.asarray(moved.tension["goes"])[steps + 1 :].any()
        assert_allclose(moved.energy.error, 0, atol=1e-9)


@pytest.mark.parametrize(("after", "largest"), [(4.0, 2.0), (10.0, 6.0)])
def test_energy_of_what_is_removed_is_not_the_largest(after, largest):
    """A removal takes 6 J away, or deformation does; of failed motions it is NaN, but for parts."""
    stored, total = np.array([10.0, 4.0, 4.0, np.nan]), np.array([10.0, after, after, after])
    kinetic, zero = np.array([0.0, 1.0, 2.0, np.nan]), np.zeros(4)
    balance = EnergyBalance(kinetic, stored, zero, zero, total)
    assert np.isnan(balance.largest)
    assert balance.largest_so_far()[-1] == largest
    assert jax.tree.map(lambda x: x[:3], balance).largest == largest


def test_the_part_of_a_chain_that_breaks_off_falls_freely():
    """Its momentum grows by its weight, and its center of mass is where a thrown body would be."""
    place = np.array([[0.0, 0, 0], [0.5, 0, -0.8], [1.2, 0, -1.4], [1.9, 0.2, -1.9]])
    ropes = jc.Cables([[0, 1], [1, 2], [2, 3]], axial_stiffness=5e3)
    structure = jc.Structure(place, ropes, supports=jc.pinned([0]))
    masses = np.array([0.0, 1.0, 2.0, 3.0])
    moved = transient(
        structure,
        jc.PointMasses(range(4), masses),
        dt=0.01,
        steps=90,
        masses=masses,
        velocity=[[0, 0, 0], [0, 1.0, 0], [1.0, 3.0, 1.0], [0, -3.0, 2.0]],
        removes=Removal(jc.only([1]), time=0.2),
        histories=["displacement", "velocity", "tension"],
    )
    assert int(moved.status) == 0 and not np.asarray(moved.tension)[21:, 1].any()
    assert np.asarray(moved.tension)[21:, 2].max() > 10  # the part swings on
    weights, time = masses[2:] / 5.0, np.asarray(moved.time)[20:] - 0.2
    center = (place + np.asarray(moved.displacement))[20:, 2:].transpose(0, 2, 1) @ weights
    speed = np.asarray(moved.velocity)[20:, 2:].transpose(0, 2, 1) @ weights
    fall = np.array([0.0, 0.0, -GRAVITY])
    # up to 1e-10 of the forces in every step
    assert_allclose(speed, speed[0] + time[:, None] * fall, rtol=0, atol=1e-8)
    thrown = center[0] + time[:, None] * speed[0] + 0.5 * time[:, None] ** 2 * fall
    assert_allclose(center, thrown, rtol=0, atol=1e-8)


def test_a_removal_leaves_the_damping_of_what_stays():
    """Of two bobs that swing apart, each by stiffness as it was at the start of the motion."""
    nodes = [[0.0, 0, 0], [1.0, 0, 0], [5.0, 0, 0], [6.0, 0, 0], [5.5, 0, -1.0]]
    ropes = jc.Cables([[0, 1], [2, 3], [3, 4]], axial_stiffness=1e3)
    structure = jc.Structure(nodes, ropes, supports=jc.pinned([0, 2, 4]))
    masses = np.array([0.0, 1.0, 0.0, 1.0, 0.0])
    weight, damping = jc.PointMasses(range(5), masses), Rayleigh(stiffness=0.02)
    times = {"dt": 0.02, "steps": 20, "masses": masses, "damping": damping}
    early, late = (
        converged(transient(structure, weight, **times, removes=Removal(jc.only([2]), time=time)))
        for time in (0.1, 0.38)
    )
    difference = np.abs(np.asarray(early.displacement - late.displacement)).max(axis=(0, 2))
    assert difference[1] < 1e-9 and difference[3] > 1e-2  # steps solve to 1e-10 of all forces


@pytest.mark.slow
def test_a_cable_that_is_slack_at_the_end_has_a_dynamic_factor():
    """And one whose group has no tensions beside it, as with the springs, does no harm."""
    nodes = [[0.0, 0, 0], [2.0, 0, 0], [1.0, 0, 0], [1.0, 0, -1.0]]
    cables = jc.Cables([[0, 2], [1, 2], [2, 3]], axial_stiffness=1e4)
    parts = {"cables": cables, "springs": jc.Springs([3], (50.0, 0.0, 0.0))}
    held = jc.pinned([0, 1]) + jc.restrained([3], "yz") + jc.restrained([2], "y")
    structure = jc.Structure(nodes, parts, supports=held)
    pull = jc.NodalLoads([2], (0.0, 0.0, 30.0))
    before = converged(jc.solve(structure, jc.Phase(pretension=100.0, loads=pull)))
    gone = {"cables": jc.only([1])}
    after = converged(jc.solve(structure, jc.Phase(removes=gone), start=before))
    first, last = (np.asarray(state.tension["cables"]) for state in (before, after))
    tensions = np.stack([first, 2 * last - first, first * np.array([0.0, 1.0, 1.0])])
    moved = transient(structure, start=before, dt=1e-3, steps=2, masses=1.0)
    moved = jc.replace(moved, histories={"tension": {"cables": tensions, "springs": None}})
    factors = jc.dynamics.dynamic_factors(moved, before, after)["cables"]
    assert_allclose(np.asarray(factors)[[0, 2]], 2.0, rtol=1e-9)
    assert np.isnan(factors[1])


# --- history variables


def yielded(push, h, count):
    """Displacements of a mass on a bar that yields beside a damper, by bisection in every step."""
    mass, area, u, v, path = 5 / 12 * 4000.0 / GRAVITY, 1e-6, 0.0, 0.0, []
    # a spring that hardens, beside one that yields and has slipped
    hard, soft, most, slipped = 0.1 * 210e9 * area, 0.9 * 210e9 * area, 0.9 * 235.0, 0.0
    a = push / mass
    for _ in range(count):

        def ended(new, u=u, v=v, a=a):
            return 4 * ((new - u) / h - v) / h - a

        def unbalanced(new, u=u, ended=ended, slipped=slipped):
            force = hard * new + np.clip(soft * (new - slipped), -most, most)
            return mass * ended(new) + force + 2e4 * (new - u) - push

        new = brentq(unbalanced, u - 0.01, u + 0.01, xtol=1e-16)
        u, v, a = new, v + 0.5 * h * (a + ended(new)), ended(new)
        slipped = u - np.clip(soft * (u - slipped), -most, most) / soft
        path.append(u)
    assert slipped > 1e-4
    return np.array(path)


def test_a_bar_that_yields():
    """A law with history variables, and a damper that remembers where it was."""
    steel = jc.materials.steel(235e6, 210e9, 0.1)
    section = jc.Section([0.0], [0.0], [1e-6], [steel])
    bar = jc.Bars([[0, 1]], section=section, weight=4000.0)
    elements = {"bar": bar, "damper": Dampers([[0, 1]], 2e4)}
    supports = jc.pinned([0]) + jc.restrained([1], "yz")
    structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], elements, supports)
    push = jc.NodalLoads([1], (200.0, 0, 0))
    moved = transient(structure, push, dt=0.02, steps=30)
    assert int(moved.status) == 0
    # up to 1e-10 of the forces, over the stiffness, in every step
    assert_allclose(moved.displacement[1:, 1, 0], yielded(200.0, 0.02, 30), atol=1e-11, rtol=1e-8)


# --- derivatives


def swinging(p):
    """Where two masses on ropes are at the end, and the status, by what a user could vary."""
    nodes = [[0.0, 0, 0], [0.4, 0, -0.9], [0.9, 0, -1.4]]
    ropes = jc.Cables([[0, 1], [1, 2]], axial_stiffness=2e3 * p[0], weight=3.0)
    structure = jc.Structure(nodes, ropes, supports=jc.pinned([0]))
    moved = transient(
        structure,
        jc.NodalLoads([1, 2], p[1] * np.array([0.0, 0.0, -20.0])),
        dt=0.01,
        steps=12,
        masses=p[2] * np.array([0.0, 1.0, 1.0]),
        damping=[Rayleigh(p[3], 1e-3), Dashpots([[0, 2]], p[4])],
        spectral_radius=0.9,
        method=taylor.TIGHT,
    )
    return moved.displacement[-1, 2, 0] + moved.tension[7, 0] / 1e3, moved.status


def test_a_gradient_of_a_history():
    taylor.assert_gradient(swinging, [1.0, 1.0, 2.0, 0.5, 1.0])


def broken_pendulum(p, steps=70):
    """Two masses on ropes, the lower one gone after 40 steps: sum of places at the end, status."""
    nodes = [[0.0, 0, 0], [0.4, 0, -0.9], [0.9, 0, -1.4]]
    ropes = jc.Cables([[0, 1], [1, 2]], axial_stiffness=2e3, weight=3.0)
    structure = jc.Structure(nodes, ropes, supports=jc.pinned([0]))
    moved = transient(
        structure,
        [jc.NodalLoads([2], (0.0, 0.0, -30.0)), lambda t: p * jnp.sin(t) * jnp.ones((3, 3))],
        dt=0.01,
        steps=steps,
        masses=[0.0, 2.0, 2.0],
        spectral_radius=0.9,
        removes=Removal(jc.only([1]), time=0.4, duration=0.1),
        method=taylor.TIGHT,
    )
    return moved.displacement[-1, 1:].sum(), moved.status


# node 2 falls freely in all of these motions; one of them asserts the warning
@pytest.mark.filterwarnings("ignore:removes.elements. no element is left")
def test_motions_outside_and_inside_of_other_programs_agree():
    """Blocks by a loop on the host, and by `lax.scan`: values, derivatives, and a batch."""

    def value(p):
        return broken_pendulum(p)[0]

    def within(p):
        return jnp.stack(jax.jvp(value, (p,), (jnp.ones_like(p),)))

    p = jnp.asarray(1.5)
    inside = np.asarray(as_program(within)(p))
    with pytest.warns(jc.InputWarning, match="no element is left at 1 node .* such as node 2: "):
        found, status = broken_pendulum(p)
    assert int(status) == 0
    assert_allclose(found, inside[0], rtol=1e-11)
    batch = np.asarray(jax.vmap(value)(jnp.array([0.5, 1.5])))
    assert_allclose(batch[1], inside[0], rtol=1e-11)
    assert np.abs(batch[0] - batch[1]).max() > 1e-3
    assert_allclose(jax.grad(value)(p), inside[1], rtol=1e-8)  # both solve to 1e-13


def test_motions_of_any_length_share_programs():
    """Also those of derivatives, of which no block has its own."""
    bar = jc.Bars([[0, 1]], axial_stiffness=STIFFNESS)
    guide = jc.pinned([0]) + jc.restrained([1], "yz")
    structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], bar, supports=guide)

    def thrown(steps, masses=2.0):
        velocity = [[0, 0, 0], [1.0, 0, 0]]
        moved = transient(structure, velocity=velocity, dt=1e-3, steps=steps, masses=masses)
        return converged(moved)

    jc.forget_programs()
    moved = {steps: thrown(steps) for steps in (1, 31, 32, 33, 100)}
    for steps, one in moved.items():  # the same path, as far as it goes
        assert one.displacement.shape == (steps + 1, 2, 3)
        assert_allclose(one.displacement, moved[100].displacement[: steps + 1], rtol=0, atol=1e-15)
        assert_allclose(one.energy.kinetic, moved[100].energy.kinetic[: steps + 1], rtol=1e-12)
    programs = motion_program._run_block, motion_program._begin_motion
    assert [len(one.known) for one in programs] == [1, 1]
    slopes = [
        float(jax.grad(lambda m, steps=steps: thrown(steps, m).displacement[20, 1, 0])(2.0))
        for steps in (20, 70)
    ]
    assert slopes[0] != 0
    assert_allclose(slopes[1], slopes[0], rtol=1e-12)
    (block,) = programs[0].known.values()
    (derived,) = block.known.programs.values()
    assert len(derived.linear.known.programs) == 1


@pytest.mark.compiled
def test_another_length_compiles_nothing():
    compiled = []

    def hear(event, *_, **__):
        compiled.extend([event] if "backend_compile" in event else [])

    one_mass(steps=3, loads=np.zeros((4, 2, 3)))
    jax.monitoring.register_event_duration_secs_listener(hear)
    one_mass(steps=4, loads=np.zeros((5, 2, 3)))
    jax.monitoring.unregister_event_duration_listener(hear)
    assert not compiled


# --- failures, and what is refused


def test_a_step_that_fails_is_halved_or_ends_the_motion():
    rope = jc.Bars([[0, 1]], axial_stiffness=1e4)
    structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], rope, supports=jc.pinned([0]))
    given = {"dt": 0.05, "steps": 6, "masses": 2.0, "velocity": [[0, 0, 0], [40.0, 9.0, 0]]}
    method = jc.Newton(max_steps=5)
    failed = transient(structure, None, **given, method=method)
    assert int(failed.status) == jc.status.NOT_CONVERGED
    first = int(np.argmax(np.asarray(failed.step_status) > 0))
    assert first > 0 and (np.asarray(failed.step_status)[first:] > 0).all()
    assert np.isfinite(failed.displacement[:first]).all()
    assert (
        np.isnan(failed.displacement[first:]).all() and np.isnan(failed.energy.work[first:]).all()
    )
    halved = transient(structure, None, **given, method=method, halvings=4)
    assert int(halved.status) == 0 and np.isfinite(halved.displacement).all()
    parts = np.asarray(halved.parts)
    assert parts[first] > 1 and set(parts) <= {1, 2, 4, 8, 16}


def test_refused():
    bar = jc.Bars([[0, 1]], axial_stiffness=1e3)
    structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], bar, supports=jc.pinned([0]))
    given = {"dt": 0.1, "steps": 2, "masses": 1.0}
    for options, text in (
        ({"dt": -0.1}, r"dt = -0.1: must be positive"),
        ({"steps": 0}, "steps = 0: expected a whole number"),
        ({"spectral_radius": 1.1}, r"spectral_radius = 1.1: must be from 0 to 1"),
        ({"scheme": "newmark"}, "scheme = 'newmark'"),
        ({"histories": ["tensions"]}, "histories: 'tensions' is unknown"),
        ({"nodes": [2]}, "nodes"),
        ({"damping": 0.02}, r"damping\[0\]: expected a damping of jc.dynamics"),
        ({"damping": Dashpots([[0, 2]], 1.0)}, "dashpot nodes"),
        ({"removes": Removal(True, time=0.15)}, "removes.time = 0.15: expected a whole number"),
        ({"velocity": [1.0, 0, 0]}, "velocity"),
    ):
        with pytest.raises(ValueError, match=text):
            transient(structure, None, **given | options)
    with pytest.raises(ValueError, match=r"loads\[0\]: expected shape \(3, 2, 3\)"):
        transient(structure, np.zeros((2, 2, 3)), **given)
    with pytest.raises(ValueError, match="histories: has no 'velocity'"):
        _ = transient(structure, None, **given).velocity


def test_a_batch_of_load_histories():
    bar = jc.Bars([[0, 1]], axial_stiffness=STIFFNESS)
    guide = jc.pinned([0]) + jc.restrained([1], "yz")
    structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], bar, supports=guide)
    forces = np.zeros((2, 11, 2, 3))
    forces[0, :, 1, 0], forces[1, 5:, 1, 0] = PULL, -PULL
    given = {"dt": PERIOD / 20, "steps": 10, "masses": MASS}

    def end(loads):
        moved = transient(structure, loads, **given)
        return moved.displacement[-1, 1, 0], moved.status

    moved, codes = jax.vmap(end)(forces)
    assert (np.asarray(codes) == 0).all()
    for k in range(2):
        assert_allclose(moved[k], end(forces[k])[0], rtol=1e-10)
