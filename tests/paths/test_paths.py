"""Paths by arc length against closed forms: limit points, branch points, slack cables, failure."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.optimize
from banks.problems import HEAVY, SOLVERS, two_links

import jaxcable as jc
from jaxcable import paths
from jaxcable.common import status
from jaxcable.scenes import von_mises_truss


@pytest.fixture(scope="module", params=SOLVERS)
def quick(request):
    """The method, with every linear solver, for tests of two unknowns."""
    return jc.Newton(linear_solver=request.param)


@pytest.fixture(scope="module", params=HEAVY)
def newton(request):
    """The method, with every linear solver; by default only the dense one."""
    return jc.Newton(linear_solver=request.param)


def ok(path, code=0):
    assert int(path.status) == code, jc.describe(path.status)
    return path


def load_at(height, rise=0.1, b=1.0, ea=1e6):
    """Load of the truss of von Mises with its apex at a height over the feet."""
    l0, l = np.hypot(b, rise), np.hypot(b, height)
    return 2 * ea * (l0 - l) / l0 * height / l


def limit_load(rise, b, ea):
    """The same at ``l = (b^2 l0)^(1/3)``, mpmath."""
    l0 = mpmath.sqrt(b * b + rise * rise)
    l = (b * b * l0) ** (mpmath.mpf(1) / 3)
    return 2 * ea * (l0 - l) / l0 * mpmath.sqrt(l * l - b * b) / l


def truss(p, load=500.0):
    """The truss with p = (rise, half-span, EA / 1e6), traced."""
    structure, phases = von_mises_truss(load=load)
    at = jnp.array([[-1.0, 0, 0], [0, 0, 0], [1.0, 0, 0]]) * p[1]
    nodes = at.at[1, 2].set(p[0])
    bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e6 * p[2])
    return jc.replace(structure, nodes=nodes, elements=bars), phases


USUAL = jnp.array([0.1, 1.0, 1.0])


@pytest.fixture(scope="module")
def snapping(quick):
    return ok(jc.trace_path(*truss(USUAL), method=quick))


def test_the_whole_path_of_the_truss(snapping):
    height = 0.1 + np.asarray(snapping.displacement)[:, 1, 2]
    exact = load_at(height)
    # forces of 1e4 N in the bars are in balance to 1e-10: 1e-6 N of 381
    assert np.abs(500 * snapping.load_factor - exact).max() < 1e-8 * 381
    assert (np.diff(height) < 0).all() and height[0] == 0.1 and height[-1] < -0.119
    assert float(snapping.load_factor[-1]) == 1.0  # exactly where it was to end
    # between the limit points, and only there, the tangent is not positive definite
    turn = np.sqrt((1.0 * np.hypot(1, 0.1)) ** (2 / 3) - 1)
    inside = np.abs(height) < turn * (1 - 1e-6)
    assert (np.asarray(snapping.n_negative)[inside] == 1).all()
    assert (np.asarray(snapping.n_negative)[np.abs(height) > turn * (1 + 1e-6)] == 0).all()


def test_limit_points_of_the_truss(snapping):
    events = snapping.events
    assert events.names == ["limit point"] * 2
    loads = 500 * np.asarray(events.load_factor)
    assert abs(loads[0] - 381.0871904181) < 1e-9 * 381  # physics of the truss, in ten digits
    exact = float(limit_load(mpmath.mpf("0.1"), mpmath.mpf(1), mpmath.mpf(10) ** 6))
    assert np.abs(loads - [exact, -exact]).max() < 1e-10 * exact
    w = -np.asarray(events.displacement)[:, 1, 2]
    assert abs(w[0] - 0.0423607465) < 1e-8 and abs(w[1] - (0.2 - 0.0423607465)) < 1e-8
    assert np.allclose(events.alignment, 1.0)  # one freedom: the null vector is the load's
    assert np.abs(500 * (events.lower - events.upper)).max() < 1e-9
    assert float(snapping.failure_load) == float(events.load_factor[0])


def test_picture_of_a_path(snapping, tmp_path):
    figure = jc.plots.path(snapping, 1, axis="-z", path=tmp_path / "path.png", scale=500, unit="N")
    assert (tmp_path / "path.png").stat().st_size > 1e4
    axes = figure.axes[0]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["stable", "unstable", "limit point"]
    assert axes.get_ylabel() == "load (N)" and "node 1" in axes.get_xlabel()
    structure, phases = truss(USUAL, load=100.0)
    increments = jc.solve(structure, phases).phases[0].path  # of a phase: no events, no stability
    assert jc.plots.path(increments, 1, path=tmp_path / "phase.png").axes[0].get_legend() is None
    with pytest.raises(ValueError, match="axis = 'w'"):
        jc.plots.path(snapping, 1, axis="w")
    with pytest.raises(ValueError, match="node = 7: the structure has nodes 0 to 2"):
        jc.plots.path(snapping, 7)


def test_it_ends_at_the_limit_point_if_it_is_to(quick):
    path = ok(jc.trace_path(*truss(USUAL), through=False, method=quick), 12)
    assert len(path.events) == 1
    with pytest.raises(jc.AnalysisError, match="maximum"):
        jc.raise_if_failed(path)


def test_derivative_of_a_failure_load_that_is_none():
    """Up to a tenth of the limit load nothing happens: NaN, and so are its derivatives."""

    def value(p):
        return jc.trace_path(*truss(p), until=0.05, steps=10).failure_load

    def derivatives(p):
        return jax.value_and_grad(value)(p), jax.jvp(value, (p,), (jnp.ones(3),))[1]

    for function in (derivatives, jax.jit(derivatives)):
        (load, gradient), rate = function(USUAL)
        assert np.isnan(load) and np.isnan(gradient).all()
        assert np.isnan(rate)


def test_derivative_of_the_limit_load(newton):
    @jax.jit
    def value(p):
        return 500 * jc.trace_path(*truss(p), through=False, method=newton).failure_load

    gradient = jax.jit(jax.grad(value))(USUAL)
    h, b, ea = mpmath.mpf("0.1"), mpmath.mpf(1), mpmath.mpf(10) ** 6
    exact = [mpmath.diff(limit_load, (h, b, ea), n) for n in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    exact = np.array([float(v) for v in exact]) * [1, 1, 1e6]
    assert np.allclose(gradient, exact, rtol=1e-9)
    direction = np.array([0.01, -0.1, 0.2])
    steps = 0.05 * 0.5 ** np.arange(4)

    def slope(g):
        left = [
            abs(float(value(USUAL + h * direction) - value(USUAL)) - h * g @ direction)
            for h in steps
        ]
        return np.polyfit(np.log(steps), np.log(left), 1)[0]

    assert abs(slope(np.asarray(gradient)) - 2) < 0.1
    assert slope(1.01 * np.asarray(gradient)) < 1.5  # negative control


@pytest.mark.slow
def test_limit_loads_of_a_batch_and_second_derivatives(newton):
    def value(p):
        path = jc.trace_path(*truss(p), through=False, method=newton)
        return 500 * path.failure_load, path.status

    cases = jnp.array([[0.1, 1.0, 1.0], [jnp.nan, 1.0, 1.0], [0.2, 1.0, 0.1]])
    loads, codes = jax.jit(jax.vmap(value))(cases)
    assert list(codes) == [12, 3, 12]
    exact = [float(limit_load(*map(float, (a, b, 1e6 * c)))) for a, b, c in cases[::2]]
    assert np.allclose(loads[::2], exact, rtol=1e-9) and np.isnan(loads[1])
    second = jax.jit(jax.jacfwd(jax.jacrev(lambda p: value(p)[0])))(USUAL)
    assert np.isnan(second).all()  # exact at first order only, and says so


def test_a_bifurcation_is_told_from_a_limit_point(quick):
    scene = von_mises_truss(rise=3.0, load=1e6, sway=True)
    path = ok(jc.trace_path(*scene, method=quick))
    l0 = np.sqrt(10.0)
    lengths = np.real(np.roots([1, -l0, 0, l0]))
    first, second = (load_at(np.sqrt(l * l - 1), rise=3.0) for l in sorted(lengths)[:0:-1])
    top = float(limit_load(3.0, 1.0, 1e6))
    expected = ["bifurcation", "limit point", "bifurcation"]
    assert path.events.names == [*expected, *expected]
    loads = 1e6 * np.asarray(path.events.load_factor)
    assert np.allclose(loads[:3], [first, top, second], rtol=1e-9)
    assert np.allclose(loads[3:], [-second, -top, -first], rtol=1e-9)
    assert np.allclose(path.events.alignment, [0, 1, 0, 0, 1, 0], atol=1e-6)
    mode = np.asarray(path.events.mode)[:2, 1]
    assert np.allclose(np.abs(mode), [[1, 0, 0], [0, 0, 1]], atol=1e-6)  # sideways, and down
    assert set(np.asarray(path.n_negative).tolist()) == {0, 1, 2}
    ended = ok(jc.trace_path(*scene, through=False, method=quick), 13)
    assert float(ended.failure_load) == float(path.failure_load)


def crooked(seed):
    """Two bars of different length under a slanting load, and its numbers in NumPy."""
    r = np.random.default_rng(seed)
    rise, left, right, lift = r.uniform([0.05, 0.5, 0.5, -0.1], [0.5, 2.0, 2.0, 0.1])
    nodes = np.array([[-left, 0, 0], [0, 0, rise], [right, 0, lift * rise]])
    held = np.ones((3, 3), bool)
    held[1, [0, 2]] = False
    ea = 10 ** r.uniform(4, 7)
    bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=ea)
    load = 1.2 * ea * (rise / np.hypot(left, rise)) ** 3 * np.array([0.2, 0.0, -1.0])
    phase = jc.Phase(loads=jc.NodalLoads([1], load))
    structure = jc.Structure(nodes, bars, supports=jc.Supports(held))
    return structure, phase, (nodes[[0, 2]][:, [0, 2]], nodes[1, [0, 2]], ea, load[[0, 2]])


def turning_point(feet, apex, ea, load, at, factor):
    """Load factor where equilibrium and det K = 0 hold together, by SciPy from a guess."""
    rest = np.linalg.norm(feet - apex, axis=1)

    def equations(v):
        arm = v[:2] - feet
        length = np.linalg.norm(arm, axis=1)
        force = ea * (length / rest - 1)
        along = arm / length[:, None]
        out = force @ along - v[2] * load
        stiff = sum(
            ea / r * np.outer(a, a) + n / l * (np.eye(2) - np.outer(a, a))
            for r, a, n, l in zip(rest, along, force, length, strict=True)
        )
        return [*(out / ea), np.linalg.det(stiff) / ea**2]

    found = scipy.optimize.root(equations, [*at, factor], tol=1e-14)
    # the residual of three numbers of order one is at its rounding
    assert np.abs(found.fun).max() < 1e-13
    return found.x[2]


@pytest.mark.parametrize("seed", [2, 3, 8])
def test_limit_points_of_crooked_trusses_on_every_solver(seed, quick):
    """Where a K of two unknowns is singular to the last digits its factors are of no use."""
    structure, phase, numbers = crooked(seed)
    path = ok(jc.trace_path(structure, phase, method=quick))
    assert len(path.events) > 0 and set(path.events.names) == {"limit point"}
    for event in path.events:
        at = numbers[1] + np.asarray(event.displacement)[1, [0, 2]]
        exact = turning_point(*numbers, at, float(event.load_factor))
        # of the square of 1e-9 steps along the path, and the rounding of forces: 1e-10 of them
        assert abs(float(event.load_factor) - exact) < 1e-8


def test_snap_back(newton):
    soft = 2e3
    path = ok(jc.trace_path(*von_mises_truss(hanger=soft), method=newton))
    apex, end = np.asarray(path.displacement)[:, [1, 3], 2].T
    force = 500 * np.asarray(path.load_factor)
    assert np.abs(load_at(0.1 + apex) - force).max() < 1e-8 * 381
    assert np.abs(apex - force / soft - end).max() < 1e-12
    assert np.diff(-end).min() < -0.01  # the end of the hanger goes up on the way down
    assert np.allclose(500 * path.events.load_factor, [381.0871904181, -381.0871904181], rtol=1e-9)


# --- cables


def test_slackening_and_tightening_between_two_cables(newton):
    """A node between two plumb cables, one above and one below."""
    nodes = [[0, 0, 1.0], [0, 0, 0], [0, 0, -1.0]]
    held = np.ones((3, 3), bool)
    held[1, 2] = False
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
    structure = jc.Structure(nodes, cables, supports=jc.Supports(held))
    pull = jc.Phase(pretension=100.0)
    down = jc.Phase(loads=jc.NodalLoads([1], (0, 0, -500.0)))
    path = ok(jc.trace_path(structure, [pull, down], method=newton))
    # both cables have the unstressed length 1/(1 + 1e-3): the lower one is slack when u = 1e-3
    assert path.events.names == ["slackening"]
    assert abs(500 * float(path.events.load_factor[0]) - 200.0) < 1e-6
    assert np.asarray(path.events.elements).tolist() == [[False, True]]
    assert list(np.asarray(path.n_slack)[[0, -1]]) == [0, 1]
    # and back: the load goes, both cables carry again
    loaded = jc.solve(structure, [pull, down])
    up = jc.Phase(loads=jc.NodalLoads([1], (0, 0, 500.0)))
    back = ok(jc.trace_path(structure, [up], start=loaded, method=newton))
    assert back.events.names == ["tightening"]
    assert abs(500 * (1 - float(back.events.load_factor[0])) - 200.0) < 1e-6
    assert np.allclose(np.asarray(back.tension)[-1], 100.0, rtol=1e-9)


@pytest.mark.slow
def test_an_unstressed_net_has_no_tangent_at_first(newton):
    """Two links in line pulled sideways, without prestress: ``P = EA (w/a)^3`` for small w."""
    structure, normal = two_links(1e5, 0.0, 1.0)
    phase = jc.Phase(loads=jc.NodalLoads([1], 50.0 * normal))
    path = ok(jc.trace_path(structure, [phase], method=newton))
    w = np.asarray(path.displacement)[:, 1] @ normal
    length = np.hypot(1.0, w)
    exact = 2e5 * (length - 1) * w / length
    # the links carry up to 700 N, in balance to 1e-10
    assert np.abs(50 * path.load_factor - exact).max() < 1e-7
    bars, _ = two_links(1e5, 0.0, 1.0, group=jc.Bars)
    ok(jc.trace_path(bars, [phase], method=newton), 4)  # its equilibrium is not unique: refused


# --- material


@pytest.mark.slow
def test_a_cable_breaks_where_its_curve_ends(newton):
    law = jc.Polygonal([0.0, 0.01, 0.03], [0.0, 1e8, 1.5e8])
    nodes = [[0, 0, 0], [0, 0, -2.0]]
    held = np.array([[True] * 3, [True, True, False]])
    cables = jc.Cables([[0, 1]], area=1e-4, law=law)
    structure = jc.Structure(nodes, cables, supports=jc.Supports(held))
    phase = jc.Phase(loads=jc.NodalLoads([1], (0, 0, -2e4)))
    path = ok(jc.trace_path(structure, [phase], method=newton), 6)
    assert path.events.names == ["material failure"]
    low, high = float(path.events.lower[0]), float(path.events.upper[0])
    assert low <= 0.75 <= high and high - low < 1e-9  # 1.5e8 Pa of 1e-4 m2
    assert np.asarray(path.events.elements).tolist() == [[True]]
    assert abs(float(path.load_factor[-1]) - 0.75) < 1e-9 and float(path.tension[-1, 0]) <= 1.5e4


@pytest.mark.slow
def test_softening_turns_the_path_at_the_peak_of_the_curve(newton):
    law = jc.Polygonal([0.0, 0.01, 0.03], [0.0, 1e8, 0.4e8])
    nodes = [[0, 0, 0], [0, 0, -2.0]]
    held = np.array([[True] * 3, [True, True, False]])
    structure = jc.Structure(
        nodes, jc.Bars([[0, 1]], area=1e-4, law=law), supports=jc.Supports(held)
    )

    def trace(area):
        bars = jc.Bars([[0, 1]], area=area, law=law)
        phase = jc.Phase(loads=jc.NodalLoads([1], (0, 0, -2e4)))
        return jc.trace_path(jc.replace(structure, elements=bars), [phase], method=newton)

    path = ok(trace(1e-4), 6)  # down the falling branch to its end
    assert path.events.names == ["limit point", "material failure"]
    assert np.allclose(path.events.load_factor, [0.5, 0.2], atol=1e-9)
    strain = np.asarray(path.displacement)[:, 1, 2] / -2.0
    exact = np.interp(strain, [0, 0.01, 0.03], [0, 0.5, 0.2])
    assert np.abs(path.load_factor - exact).max() < 1e-9
    # at a corner there is no null vector: the formula of smooth limit points would be wrong
    assert np.isnan(jax.grad(lambda a: trace(a).failure_load)(1e-4))


# --- what else can happen


@pytest.mark.slow
def test_single_precision(newton):
    structure, phases = von_mises_truss()
    single = jc.replace(structure, nodes=jnp.asarray(structure.nodes, jnp.float32))
    path = ok(jc.trace_path(single, phases, method=newton))
    assert path.load_factor.dtype == jnp.float32
    assert path.events.names == ["limit point"] * 2
    # the bars carry 30 times the load, in balance to 1e-5
    assert np.allclose(500 * path.events.load_factor, [381.0872, -381.0872], rtol=1e-3)


def test_it_says_when_there_is_no_room(newton):
    path = ok(jc.trace_path(*truss(USUAL), steps=10, method=newton), status.OUT_OF_POINTS)
    assert len(path.load_factor) == 10
    path = ok(jc.trace_path(*truss(USUAL), steps=10, until=0.05, method=newton))
    assert float(path.load_factor[-1]) == 0.05
    assert np.isnan(float(path.failure_load))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"until": 0.0}, "until.* must be positive"),
        ({"down_to": 0.5}, "down_to.* must be negative"),
        ({"step": -1.0}, "step.* must be positive"),
        ({"tol": 0.0}, "tol.* must be positive"),
        ({"steps": 1}, "steps = 1: expected a whole number"),
        ({"events": True}, "events = True: expected a whole number"),
        ({"method": jc.Incremental()}, "method: expected Newton, got Incremental"),
    ],
)
def test_wrong_arguments(change, message):
    with pytest.raises(ValueError, match=message):
        jc.trace_path(*von_mises_truss(), **change)


def test_kinds_have_names():
    assert set(paths.FAILURES) < set(paths.NAMES)


def test_paths_of_frames_do_not_depend_on_their_size():
    """A toggle of 2.6 mm has the path of one of 26 m: quaternions are no lengths.

    Lengths times s, forces times s^2.
    """

    def limit(size):
        half_span, rise, side, n = 13.0, 0.4, 0.4, 2
        x = np.linspace(-half_span, half_span, 2 * n + 1)
        nodes = size * np.column_stack([x, 0 * x, rise * (1 - np.abs(x) / half_span)])
        section = jc.Section.rectangle(side * size, side * size, jc.Elastic(1e7))
        links = np.column_stack([np.arange(2 * n), np.arange(1, 2 * n + 1)])
        beams = jc.Beams(links, section=section)
        structure = jc.Structure(nodes, beams, supports=jc.clamped([0, 2 * n]))
        push = jc.NodalLoads([n], (0.0, 0.0, -3000.0 * size**2))
        path = jc.trace_path(structure, jc.Phase(loads=push), step=0.05)
        return int(path.status), float(path.load_factor[-1]), float(path.displacement[-1, n, 2])

    status, factor, sunk = limit(1.0)
    assert status == 0 and sunk < -0.1
    small = limit(1e-4)
    assert small[0] == status
    # the same steps, whose corrections end at 1e-10 of the forces
    np.testing.assert_allclose(small[1:], [factor, 1e-4 * sunk], rtol=1e-7)
