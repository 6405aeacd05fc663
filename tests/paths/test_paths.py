"""Paths by arc length against closed forms: limit points, branch points, slack cables, failure."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.optimize
from banks.problems import SOLVERS, two_links
from oracles.traced import traced

import jaxcable as jc
from jaxcable.common import status

USUAL = jnp.array([0.1, 1.0, 1.0])


@pytest.fixture(scope="module", params=SOLVERS)
def method(request):
    """The method, with every linear solver."""
    return jc.Newton(linear_solver=request.param)


def ok(path, code=0):
    assert int(path.status) == code, jc.describe(path.status)
    return path


# --- the truss of von Mises, free in its plane: one program, also for crooked trusses


def load_at(height, rise=0.1, b=1.0, ea=1e6):
    """Load of the truss with its apex at a height over the feet."""
    l0, l = np.hypot(b, rise), np.hypot(b, height)
    return 2 * ea * (l0 - l) / l0 * height / l


def limit_load(rise, b, ea):
    """The same at ``l = (b^2 l0)^(1/3)``, mpmath."""
    l0 = mpmath.sqrt(b * b + rise * rise)
    l = (b * b * l0) ** (mpmath.mpf(1) / 3)
    return 2 * ea * (l0 - l) / l0 * mpmath.sqrt(l * l - b * b) / l


def two_bars(nodes, stiffness, load, rest_length=None):
    """Two bars that meet in node 1, which moves in the plane of x and z, and a load on it."""
    held = np.ones((3, 3), bool)
    held[1, [0, 2]] = False
    if rest_length is None:
        rest_length = jnp.linalg.norm(jnp.diff(nodes, axis=0), axis=1)
    stiffness = jnp.asarray(stiffness, float)
    bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=stiffness, rest_length=rest_length)
    structure = jc.Structure(nodes, bars, supports=jc.Supports(held))
    return structure, jc.Phase(loads=jc.NodalLoads([1], jnp.asarray(load)))


def truss(p, load=500.0):
    """The truss with p = (rise, half-span, EA / 1e6)."""
    nodes = jnp.array([[-1.0, 0, 0], [0, 0, 0], [1.0, 0, 0]]) * p[1]
    return two_bars(nodes.at[1, 2].set(p[0]), 1e6 * p[2], [0.0, 0.0, -load])


@pytest.fixture(scope="module")
def snapping(method):
    return ok(jc.trace_path(*truss(USUAL), method))


@pytest.mark.slow_cases("superlu")
def test_the_whole_path_of_the_truss(snapping, method):
    height = 0.1 + np.asarray(snapping.displacement)[:, 1, 2]
    # forces of 1e4 N in the bars are in balance to 1e-10: 1e-6 N of 381
    assert np.abs(500 * snapping.load_factor - load_at(height)).max() < 1e-8 * 381
    assert (np.diff(height) < 0).all() and height[0] == 0.1 and height[-1] < -0.119
    assert float(snapping.load_factor[-1]) == 1.0  # exactly where it was to end
    # between the limit points, and only there, the tangent is not positive definite
    turn = np.sqrt(np.hypot(1, 0.1) ** (2 / 3) - 1)
    inside = np.abs(height) < turn * (1 - 1e-6)
    assert (np.asarray(snapping.n_negative)[inside] == 1).all()
    assert (np.asarray(snapping.n_negative)[np.abs(height) > turn * (1 + 1e-6)] == 0).all()
    fallen = ok(jc.trace_path(*truss(USUAL), method, down_to=-0.5))
    assert float(fallen.load_factor[-1]) == -0.5 and float(fallen.rise[-1]) < 0
    assert fallen.events.names == ["limit point"]


@pytest.mark.slow_cases("superlu")
def test_limit_points_of_the_truss(snapping, method):
    events = snapping.events
    assert events.names == ["limit point"] * 2
    loads = 500 * np.asarray(events.load_factor)
    assert abs(loads[0] - 381.0871904181) < 1e-9 * 381  # physics of the truss, in ten digits
    exact = float(limit_load(mpmath.mpf("0.1"), mpmath.mpf(1), mpmath.mpf(10) ** 6))
    assert np.abs(loads - [exact, -exact]).max() < 1e-10 * exact
    w = -np.asarray(events.displacement)[:, 1, 2]
    assert abs(w[0] - 0.0423607465) < 1e-8 and abs(w[1] - (0.2 - 0.0423607465)) < 1e-8
    assert np.allclose(events.alignment, 1.0)  # the null vector is the load's direction
    assert np.abs(500 * (events.lower - events.upper)).max() < 1e-9
    assert float(snapping.failure_load) == float(events.load_factor[0])
    ended = ok(jc.trace_path(*truss(USUAL), method, through=False), status.LIMIT_POINT)
    assert len(ended.events) == 1
    with pytest.raises(jc.AnalysisError, match="maximum"):
        jc.raise_if_failed(ended)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dense"], indirect=True)
def test_picture_of_a_path(snapping, tmp_path):
    figure = jc.plots.path(snapping, 1, axis="-z", path=tmp_path / "path.png", scale=500, unit="N")
    assert (tmp_path / "path.png").stat().st_size > 1e4
    axes = figure.axes[0]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["stable", "unstable", "limit point"]
    assert axes.get_ylabel() == "load (N)" and "node 1" in axes.get_xlabel()
    increments = jc.solve(*truss(USUAL, load=100.0)).phases[0].path  # neither events nor stability
    assert jc.plots.path(increments, 1, path=tmp_path / "phase.png").axes[0].get_legend() is None
    with pytest.raises(ValueError, match="axis = 'w'"):
        jc.plots.path(snapping, 1, axis="w")
    with pytest.raises(ValueError, match="node = 7: the structure has nodes 0 to 2"):
        jc.plots.path(snapping, 7)


@pytest.mark.slow_cases("superlu")
def test_a_bifurcation_is_told_from_a_limit_point(method):
    scene = truss(jnp.array([3.0, 1.0, 1.0]), load=1e6)
    path = ok(jc.trace_path(*scene, method))
    l0 = np.sqrt(10.0)
    lengths = np.real(np.roots([1, -l0, 0, l0]))
    first, second = (load_at(np.sqrt(l * l - 1), rise=3.0) for l in sorted(lengths)[:0:-1])
    top = float(limit_load(3.0, 1.0, 1e6))
    expected = ["bifurcation", "limit point", "bifurcation"]
    assert path.events.names == [*expected, *expected]
    loads = 1e6 * np.asarray(path.events.load_factor)
    assert np.allclose(loads[:3], [first, top, second], rtol=1e-9)
    assert np.allclose(loads[3:], [-second, -top, -first], rtol=1e-9)
    forks = path.events[np.array([0, 2])]
    assert (forks.lower < forks.load_factor).tolist() == [True, False]  # up, and down again
    ends = 1e6 * np.sort([forks.lower, forks.upper], axis=0)
    assert (ends[0] < [first, second]).all() and (ends[1] > [first, second]).all()
    assert np.allclose(path.events.alignment, [0, 1, 0, 0, 1, 0], atol=1e-6)
    mode = np.asarray(path.events.mode)[:2, 1]
    assert np.allclose(np.abs(mode), [[1, 0, 0], [0, 0, 1]], atol=1e-6)  # sideways, and down
    assert set(np.asarray(path.n_negative).tolist()) == {0, 1, 2}
    ended = ok(jc.trace_path(*scene, method, through=False), status.BIFURCATION)
    assert float(ended.failure_load) == float(path.failure_load)


@pytest.mark.slow
def test_a_start_that_is_unstable_already(method):
    """Two bars in line, pressed by 1 % of EA, that are pulled along their line."""
    nodes = jnp.array([[-1.0, 0, 0], [0, 0, 0], [1.0, 0, 0]])
    scene = two_bars(nodes, 1e6, [500.0, 0.0, 0.0], jnp.full(2, 1.01))
    path = ok(jc.trace_path(*scene, method, through=False), status.BIFURCATION)
    assert path.events.names == ["bifurcation"] and float(path.failure_load) == 0.0


def crooked(seed):
    """Two bars of different length under a slanting load, and its numbers in NumPy."""
    r = np.random.default_rng(seed)
    rise, left, right, lift = r.uniform([0.05, 0.5, 0.5, -0.1], [0.5, 2.0, 2.0, 0.1])
    nodes = np.array([[-left, 0, 0], [0, 0, rise], [right, 0, lift * rise]])
    ea = 10 ** r.uniform(4, 7)
    load = 1.2 * ea * (rise / np.hypot(left, rise)) ** 3 * np.array([0.2, 0.0, -1.0])
    numbers = nodes[[0, 2]][:, [0, 2]], nodes[1, [0, 2]], ea, load[[0, 2]]
    return two_bars(jnp.asarray(nodes), ea, load), numbers


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


@pytest.mark.slow_cases("dense-2", "superlu-2", "superlu-3", "superlu-8")
@pytest.mark.parametrize("seed", [2, 3, 8])
def test_limit_points_of_crooked_trusses(seed, method):
    """Where a K of two unknowns is singular to the last digits its factors are of no use."""
    scene, numbers = crooked(seed)
    path = ok(jc.trace_path(*scene, method))
    assert len(path.events) > 0 and set(path.events.names) == {"limit point"}
    for event in path.events:
        at = numbers[1] + np.asarray(event.displacement)[1, [0, 2]]
        exact = turning_point(*numbers, at, float(event.load_factor))
        # of the square of 1e-9 steps along the path, and the rounding of forces: 1e-10 of them
        assert abs(float(event.load_factor) - exact) < 1e-8


def failure(p, until):
    """Failure load of the truss, N, and the status of its path."""
    path = jc.trace_path(*truss(p), through=False, until=until)
    return 500 * path.failure_load, path.status


rates = traced(jax.vmap(jax.value_and_grad(failure, has_aux=True)))


def test_derivative_of_the_limit_load():
    """In a batch, with one that fails, one that fails nowhere on its path, and Taylor's test."""
    direction, steps = np.array([0.01, -0.1, 0.2]), 0.05 * 0.5 ** np.arange(4)
    points = np.array([[0.1, 1, 1], [np.nan, 1, 1], [0.1, 1, 1], [0.2, 1, 0.1]])
    points = np.concatenate([points, points[0] + np.outer(steps, direction)])
    (loads, codes), gradients = rates(points, np.array([1, 1, 0.05, 1, 1, 1, 1, 1.0]))
    assert codes.tolist() == [status.LIMIT_POINT, status.NONFINITE, 0] + [status.LIMIT_POINT] * 5
    assert np.isnan(loads[1:3]).all() and np.isnan(gradients[1:3]).all()
    exact = [float(limit_load(a, b, 1e6 * c)) for a, b, c in points[[0, 3]].tolist()]
    assert np.allclose(loads[np.array([0, 3])], exact, rtol=1e-9)
    h, b, ea = mpmath.mpf("0.1"), mpmath.mpf(1), mpmath.mpf(10) ** 6
    exact = [mpmath.diff(limit_load, (h, b, ea), n) for n in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    exact = np.array([float(v) for v in exact]) * [1, 1, 1e6]
    assert np.allclose(gradients[0], exact, rtol=1e-9)

    def slope(g):
        left = np.abs(loads[4:] - loads[0] - steps * (g @ direction))
        return np.polyfit(np.log(steps), np.log(left), 1)[0]

    assert abs(slope(np.asarray(gradients[0])) - 2) < 0.1
    assert slope(1.01 * np.asarray(gradients[0])) < 1.5  # negative control


@pytest.mark.slow
def test_second_derivatives_of_a_limit_load_are_nan():
    second = traced(jax.jacfwd(jax.jacrev(lambda p: failure(p, 1.0)[0])))(USUAL)
    assert np.isnan(second).all()  # exact at first order only, and says so


@pytest.mark.slow
def test_it_says_when_there_is_no_room():
    path = ok(jc.trace_path(*truss(USUAL), steps=10, events=2), status.OUT_OF_POINTS)
    assert len(path.load_factor) == 10
    steep = truss(jnp.array([3.0, 1.0, 1.0]), load=1e6)
    path = ok(jc.trace_path(*steep, steps=200, events=2), status.OUT_OF_EVENTS)
    assert path.events.names == ["bifurcation", "limit point"]


@pytest.mark.slow
def test_a_path_that_ends_is_lost():
    """A jack of 200 N and a load pull a node towards an anchor, against 500 N/m of a spring.

    Where the node meets the anchor the force of the jack turns round: no point follows.
    """
    held = np.ones((3, 3), bool)
    held[1, 0] = False
    nodes = [[0.0, 0, 0], [1.0, 0, 0], [3.0, 0, 0]]
    parts = {"jack": jc.Bars([[0, 1]], 1e5), "spring": jc.Bars([[1, 2]], 1e3)}
    structure = jc.Structure(nodes, parts, supports=jc.Supports(held))
    jacked = jc.Phase(jacking={"jack": 200.0, "spring": None})
    pull = jc.replace(jacked, loads=jc.NodalLoads([1], (-1000.0, 0, 0)))
    path = ok(jc.trace_path(structure, [jacked, pull]), status.PATH_LOST)
    assert abs(1000 * float(path.load_factor[-1]) - 300.0) < 1e-6
    assert abs(float(path.displacement[-1, 1, 0]) + 1.0) < 1e-9  # it is at the anchor
    assert len(path.events) == 0 and "not found" in jc.describe(path.status)


# --- cables


def test_slackening_and_tightening_between_two_cables():
    """A node between two plumb cables, one above and one below."""
    nodes = [[0, 0, 1.0], [0, 0, 0], [0, 0, -1.0]]
    held = np.ones((3, 3), bool)
    held[1, 2] = False
    # both are cut for 100 N, so that the lower one is slack when u = 1e-3
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5, rest_length=1 / 1.001)
    structure = jc.Structure(nodes, cables, supports=jc.Supports(held))
    none, down, up = (jc.Phase(loads=jc.NodalLoads([1], (0, 0, f))) for f in (0.0, -500.0, 500.0))
    path = ok(jc.trace_path(structure, [none, down]))
    assert path.events.names == ["slackening"]
    assert abs(500 * float(path.events.load_factor[0]) - 200.0) < 1e-6
    assert np.asarray(path.events.elements).tolist() == [[False, True]]
    assert list(np.asarray(path.n_slack)[[0, -1]]) == [0, 1]
    # and back: the load goes, both cables carry again
    back = ok(jc.trace_path(structure, [down, up]))
    assert back.events.names == ["tightening"]
    assert abs(500 * (1 - float(back.events.load_factor[0])) - 200.0) < 1e-6
    assert np.asarray(back.events.elements).tolist() == [[False, True]]
    assert np.allclose(np.asarray(back.tension)[-1], 100.0, rtol=1e-9)


@pytest.mark.slow
def test_an_unstressed_net_has_no_tangent_at_first():
    """Two links in line pulled sideways, without prestress: ``P = EA (w/a)^3`` for small w."""
    structure, normal = two_links(1e5, 0.0, 1.0)
    phase = jc.Phase(loads=jc.NodalLoads([1], 50.0 * normal))
    path = ok(jc.trace_path(structure, [phase]))
    w = np.asarray(path.displacement)[:, 1] @ normal
    length = np.hypot(1.0, w)
    exact = 2e5 * (length - 1) * w / length
    # the links carry up to 700 N, in balance to 1e-10
    assert np.abs(50 * path.load_factor - exact).max() < 1e-7
    bars, _ = two_links(1e5, 0.0, 1.0, group=jc.Bars)
    # its equilibrium is not unique: refused
    ok(jc.trace_path(bars, [phase]), status.SINGULAR)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
def test_an_unstressed_cable_is_neither_slack_nor_taut(dtype):
    """Four plumb cables and one between their nodes, which all loads leave without strain."""
    d = np.array([1, 0.37, 0.11])
    d = 0.83 * d / np.linalg.norm(d)
    up, down = np.array([0, 0, 2.0]), np.array([0, 0, -2.0])
    nodes = jnp.asarray(np.stack([0 * d, d, up, d + up, down, d + down]), dtype)
    cables = jc.Cables([[2, 0], [3, 1], [4, 0], [5, 1], [0, 1]], axial_stiffness=1.37e5)
    structure = jc.Structure(nodes, cables, supports=jc.pinned([2, 3, 4, 5]))
    phases = [
        jc.Phase(pretension=np.array([100.0, 100, 100, 100, 0])),
        jc.Phase(loads=jc.NodalLoads([0, 1], (7.3, 3.1, -50.0))),
    ]
    path = ok(jc.trace_path(structure, phases))
    assert len(path.events) == 0 and float(path.load_factor[-1]) == 1.0


# --- laws


FALLING = jc.Polygonal([0.0, 0.01, 0.03], [0.0, 1e8, 0.4e8])


def falling(area=1e-4):
    """A bar of 2 m that hangs from node 0, beside a stiff one without load, and 20 kN."""
    nodes = np.array([[0, 0, 0], [0, 0, -2.0], [1.0, 0, 0], [1.0, 0, -1.0]])
    held = np.ones((4, 3), bool)
    held[[1, 3], 2] = False
    elements = {
        "falling": jc.Bars([[0, 1]], area=area, law=FALLING),
        "stiff": jc.Bars([[2, 3]], axial_stiffness=1e13),
    }
    structure = jc.Structure(nodes, elements, supports=jc.Supports(held))
    return structure, jc.Phase(loads=jc.NodalLoads([1], (0, 0, -2e4)))


@pytest.mark.slow
def test_softening_turns_the_path_at_the_peak_of_the_curve():
    """Down the falling branch to its end, where the bar breaks."""
    path = ok(jc.trace_path(*falling()), status.MATERIAL_FAILURE)
    assert path.events.names == ["limit point", "material failure"]
    assert np.allclose(path.events.load_factor, [0.5, 0.2], atol=1e-9)
    strain = np.asarray(path.displacement)[:, 1, 2] / -2.0
    exact = np.interp(strain, [0, 0.01, 0.03], [0, 0.5, 0.2])
    assert np.abs(path.load_factor - exact).max() < 1e-9
    assert np.allclose([path.events.lower[1], path.events.upper[1]], 0.2, atol=1e-9)
    broken = path.events.elements
    assert broken["falling"].tolist() == [[False], [True]] and not np.any(broken["stiff"])


@pytest.mark.slow
def test_a_corner_is_no_smooth_limit_point_beside_a_stiff_bar():
    """There is no null vector: the formula of smooth limit points would be wrong."""

    def load(area):
        path = jc.trace_path(*falling(area), through=False)
        return path.failure_load, path.status

    (value, code), slope = traced(jax.value_and_grad(load, has_aux=True))(1e-4)
    assert int(code) == status.LIMIT_POINT
    assert abs(float(value) - 0.5) < 1e-9 and np.isnan(slope)


def plastic_hanger(rise):
    """Two bars in a V that yield and turn, loaded with twice what makes them yield."""
    stress, yielded = 235e6, 235e6 / 200e9
    law = jc.Polygonal([-1.0, -yielded, 0, yielded, 1.0], np.sign(np.arange(-2, 3)) * stress)
    bars = jc.Bars([[0, 1], [1, 2]], area=1e-4, law=law)
    held = np.ones((3, 3), bool)
    held[1, 2] = False
    nodes = [[-1.0, 0.0, rise], [0.0, 0.0, 0.0], [1.0, 0.0, rise]]
    force = 2 * 1e-4 * stress
    load = jc.NodalLoads([1], (0, 0, -2 * force * rise / np.hypot(1, rise)))
    return jc.Structure(nodes, bars, jc.Supports(held)), jc.Phase(loads=load)


@pytest.mark.slow
def test_collapse_without_limit_point_ends_with_a_reason():
    """Bars that yield and turn carry ever more, by the sine of their angle, and next to nothing.

    Steps by the first stiffness spent 200 rows on an eighth of it and told nothing.
    """
    path = ok(jc.trace_path(*plastic_hanger(0.3), steps=100))
    assert len(path.load_factor) < 60
    drop = 0.3 - np.asarray(path.displacement[:, 1, 2])
    yielded = np.asarray(path.load_factor) > 0.51
    sines = drop / np.hypot(1, drop)
    expected = 0.5 * sines / (0.3 / np.hypot(1, 0.3))
    assert yielded.sum() > 5
    np.testing.assert_allclose(path.load_factor[yielded], expected[yielded], rtol=1e-8)
    # twice the first load is beyond the sine of a right angle: no equilibrium, and no limit point
    torn = ok(jc.trace_path(*plastic_hanger(1.0), steps=100), status.MATERIAL_FAILURE)
    assert len(torn.load_factor) < 100
    short = jc.trace_path(*plastic_hanger(1.0), steps=40)
    assert int(short.status) == status.EXCESSIVE_DEFORMATION
    assert "given way" in jc.describe(short.status) and np.isnan(short.failure_load)


# --- loads that follow: the tangent is not symmetric


@pytest.mark.slow
def test_a_load_that_follows_makes_no_bifurcation():
    """The symmetric part of the tangent is singular elsewhere; the limit load has a derivative."""
    nodes = np.array([[0, 0, 1], [-1, 0, 0], [1, 0, 0], [-0.2, -1, 0.9], [0.2, 1, 1.1]])
    held = np.ones((5, 3), bool)
    held[0, [0, 2]] = False

    @traced
    def both(p):
        def value(p):
            bars = jc.Bars([[0, 1], [0, 2]], axial_stiffness=p[0] * 1e4)
            structure = jc.Structure(nodes, bars, supports=jc.Supports(held))
            phases = [
                jc.Phase(loads=jc.FacePressure([[0, 3, 4]], 6000.0 * p[1])),
                jc.Phase(loads=jc.NodalLoads([0], (0, 0, -4000.0))),
            ]
            path = jc.trace_path(structure, phases)
            return path.failure_load, path

        return jax.value_and_grad(value, has_aux=True)(p)

    point, step = jnp.ones(2), 1e-5 * jnp.eye(2)
    (top, path), gradient = both(point)
    assert [name for name in ok(path).events.names if name != "none"] == ["limit point"] * 2
    # at a limit point no load above is carried near by: the path itself is the witness
    assert abs(top - float(path.load_factor[:30].max())) < 1e-12 and abs(top - 0.52729) < 1e-4
    assert set(np.asarray(path.n_negative).tolist()) == {0, 1, -1}  # -1: nothing was reached
    central = [(both(point + h)[0][0] - both(point - h)[0][0]) / 2e-5 for h in step]
    # differences of load factors located to 1e-12 are good to 1e-7, and of second order
    assert np.allclose(gradient, central, rtol=1e-6)


def test_two_columns_that_buckle_together_under_loads_that_follow():
    """An even number of eigenvalues crosses zero: no sign of a determinant tells.

    Rigid struts between springs across; a pressed face beside each top couples both ways across by
    ``-s`` and ``s = p c / 6``, c its edge. With kx, ky of the springs and the load P on the top the
    tangent ``[[kx - P/h, -s], [s, ky - P/h]]`` has closed eigenvalues.
    """
    h, side, kx, ky, s, edge = 2.0, 4.0, 1e3, 2.4e3, 400.0, 1.5
    top = np.array([[0, 0, h]])
    springs = top + side * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    corners = top + np.array([[1, 0, -edge / 2], [1, 0, edge / 2]])
    one = np.concatenate([top, [[0, 0, 0]], springs, corners])
    nodes = np.concatenate([one, one + np.array([20.0, 0, 0])])
    both = np.array([0, 8])
    struts = jc.Bars(both[:, None] + [0, 1], axial_stiffness=1e12)
    links = (both[:, None, None] + [[0, 2], [0, 3], [0, 4], [0, 5]]).reshape(-1, 2)
    soft = jc.Bars(links, axial_stiffness=np.tile(side / 2 * np.array([kx, kx, ky, ky]), 2))
    held = np.ones((16, 3), bool)
    held[both] = False
    parts = {"struts": struts, "springs": soft}
    structure = jc.Structure(nodes, parts, supports=jc.Supports(held))
    pressure = 6 * s / edge
    faces = jc.FacePressure(both[:, None] + [0, 6, 7], pressure)
    area = 0.5 * np.cross(corners[0] - top[0], corners[1] - top[0])
    phases = [
        # what the face pushes in its first place is taken by a dead load
        jc.Phase(loads=[faces, jc.NodalLoads(both, -pressure / 3 * area)]),
        jc.Phase(loads=jc.NodalLoads(both, (0, 0, -5000.0))),
    ]
    path = ok(jc.trace_path(structure, phases))
    middle, half = (kx + ky) / 2, np.sqrt(((ky - kx) / 2) ** 2 - s**2)
    assert path.events.names == ["bifurcation"] * 2
    assert np.asarray(path.events.multiplicity).tolist() == [2, 2]
    exact = h * np.array([middle - half, middle + half])
    # the struts are shortened by P / EA = 5e-9, brackets are squares of 1e-5
    assert np.allclose(5000 * path.events.load_factor, exact, rtol=1e-7)
    numbers = np.asarray(path.n_negative)
    assert numbers[0] == 0 and numbers[-1] == 4 and set(numbers.tolist()) == {0, 2, 4}
    # within the bracket, though the struts' stiffness is 5e8 times what its rounding is judged by
    lower, upper = 5000 * np.asarray([path.events.lower, path.events.upper])
    assert (lower < exact).all() and (exact < upper).all() and (upper - lower < 0.1).all()
