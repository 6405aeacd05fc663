"""Whether an analysis says that it ends in an unstable equilibrium."""

import json
import warnings

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
from oracles.convergence import converged
from oracles.traced import traced

import jaxcable as jc
from jaxcable import linear

NODES = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [5.0, 0.0, 1.0], [0.0, 5.0, 1.0]])
CRITICAL = 10.0  # N: a rigid strut of 1 m between springs of 50 N / 5 m


def propped_strut():
    strut = jc.Bars([[0, 1]], axial_stiffness=1e6)
    springs = jc.Bars([[1, 2], [1, 3]], axial_stiffness=[50.0, 60.0])
    return jc.Structure(NODES, [strut, springs], jc.pinned([0, 2, 3]))


def push_strut(load, method=None, increments=1):
    loads = jc.NodalLoads([1], load * jnp.array([0.0, 0.0, -1.0]))
    return jc.solve(propped_strut(), jc.Phase(loads=loads, increments=increments), method)


def push_without_warning(*args, **kwargs):
    """Return what `push_strut` does, without its warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jc.UnstableWarning)
        return push_strut(*args, **kwargs)


METHODS = {
    "dense": jc.Newton(linear_solver="dense"),
    "superlu": jc.Newton(linear_solver="superlu"),
    "incremental": jc.Incremental(corrections=1),
}


@pytest.mark.slow_cases("dense")
@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_a_strut_between_springs_buckles_at_the_critical_load(method):
    """Its shortening of 1e-5 moves the load by as much: it is bracketed by 1e-3."""
    below, above = (push_without_warning(f * CRITICAL, method) for f in (0.999, 1.001))
    assert below.status == above.status == 0
    assert below.stable and below.phases[0].stable
    assert not above.stable and not above.phases[0].stable
    np.testing.assert_allclose(above.displacement[1, :2], 0.0, atol=1e-6)  # upright all the same


@pytest.mark.slow
def test_watch_judges_every_increment():
    solution = converged(push_without_warning(10.8, jc.Newton(watch=True), increments=4))
    path = solution.phases[0].path
    np.testing.assert_array_equal(path.stable, 10.8 * np.asarray(path.load_factor) < CRITICAL)
    plain = push_without_warning(10.8, increments=4)
    assert plain.phases[0].path.stable is None
    np.testing.assert_array_equal(plain.phases[0].path.iterations, path.iterations)
    np.testing.assert_array_equal(plain.displacement, solution.displacement)


@pytest.mark.slow
def test_stability_in_a_batch_and_of_failed_analyses():
    loads = jnp.array([5.0, 11.0, jnp.nan, 9.9])
    solution = jax.vmap(push_strut)(loads)
    np.testing.assert_array_equal(solution.status == 0, [True, True, False, True])
    np.testing.assert_array_equal(solution.stable, [True, False, False, True])


def stiffness_of_bars(nodes, moved, links, EA, rest):
    """Tangent stiffness of straight bars, [3 n, 3 n], NumPy."""
    K = np.zeros((moved.size, moved.size))
    for (i, j), stiff, start in zip(links, EA, rest, strict=True):
        d = moved[j] - moved[i]
        length = np.linalg.norm(d)
        n = d / length
        force = stiff * (length - start) / start
        block = stiff / start * np.outer(n, n) + force / length * (np.eye(3) - np.outer(n, n))
        for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            K[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += sign * block
    return K


@pytest.mark.slow
def test_random_trusses_against_eigenvalues():
    """Flat ones in their plane, where pressed bars may give way; eigenvalues by NumPy."""
    rng = np.random.default_rng(5)
    nodes = np.array([[x, y, 0.0] for x in range(3) for y in range(3)], float)
    links = [(i, j) for i in range(9) for j in range(i) if np.hypot(*(nodes[i] - nodes[j])[:2]) < 2]
    fixed = [0, 2, 6, 8]
    free = np.setdiff1d(np.arange(9), fixed)
    structure = jc.Structure(nodes, jc.Bars(links, axial_stiffness=1e4), jc.pinned(fixed))
    forces = 10.0 ** rng.uniform(0.5, 2.5, (24, 1, 1)) * rng.normal(size=(24, 5, 3)) * [1, 1, 0]
    pretension = rng.uniform(-100.0, 300.0, (24, len(links)))

    @traced
    @jax.vmap
    def analyse(force, pretension):
        phases = [jc.Phase(pretension=pretension), jc.Phase(loads=jc.NodalLoads(free, force))]
        return jc.solve(structure, phases, jc.Newton())

    solution = analyse(jnp.asarray(forces), jnp.asarray(pretension))
    good = np.flatnonzero(solution.status == 0)
    lowest = []
    for k in good:
        moved = nodes + np.asarray(solution.displacement[k])
        rest = np.asarray(solution.rest_length[k])
        K = stiffness_of_bars(nodes, moved, links, np.full(len(links), 1e4), rest)
        at = (3 * free[:, None] + np.arange(3)).ravel()
        lowest.append(np.linalg.eigvalsh(K[np.ix_(at, at)])[0])
    lowest = np.array(lowest)
    assert np.abs(lowest).min() > 1e-6 * 1e4  # far from the rounding of the largest
    np.testing.assert_array_equal(solution.stable[good], lowest > 0)
    assert 3 <= (lowest > 0).sum() <= len(good) - 3  # there are some of both


@pytest.mark.slow
def test_nets_of_cables_are_stable():
    """Their energy is convex; loose nodes and slack cables are no instability."""
    structure, phases = jc.scenes.flat_net(load=15.0)
    assert jc.solve(structure, phases).stable
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1.0, 0]]
    slack = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5, rest_length=1.2)
    loose = jc.Structure(nodes, slack, jc.pinned([0, 2, 3]))
    alone = jc.solve(loose, jc.Phase())
    assert alone.status == 0 and alone.stable and alone.phases[0].path.n_loose[-1] == 1
    # beside a bar nothing is convex: a node without stiffness has no negative eigenvalue either
    both = [slack, jc.Bars([[0, 3]], axial_stiffness=1e5)]
    beside = jc.solve(jc.Structure(nodes, both, jc.pinned([0, 2, 3])), jc.Phase())
    assert beside.status == 0 and beside.stable and beside.phases[0].path.n_loose[-1] == 1


def test_a_zero_eigenvalue_is_not_positive():
    """Rounding of a singular matrix has either sign; 1e-9 of the largest entry is none."""
    rng = np.random.default_rng(0)
    basis = np.linalg.qr(rng.normal(size=(20, 20)))[0]
    from jaxcable.equilibrium.newton_step import zero_eigenvalue_bound

    for lowest, expected in ((0.0, False), (-1e-9, False), (1e-9, True)):
        values = np.geomspace(1e-3, 1.0, 20)
        values[0] = lowest
        matrix = jnp.asarray(basis * values @ basis.T)
        found = linear.is_definite(linear.add_to_diagonal(matrix, -zero_eigenvalue_bound(matrix)))
        assert bool(found) == expected


def gate():
    """A triangle of bars on a vertical line of hinges: nothing but a pull holds its angle."""
    bars = jc.Bars([[0, 1], [1, 2], [0, 2]], axial_stiffness=1e6)
    nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [1.5, 0.0, 1.0]]
    return jc.Structure(nodes, bars, supports=jc.pinned([0, 1])), 2


def crane():
    """A mast that turns on its foot, with an arm."""
    section = jc.Section.linear(EA=1e9, EIy=1e7, EIz=1e7, GJ=1e7)
    beams = jc.Beams([[0, 1], [1, 2]], section=section)
    nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, 5.0], [2.0, 0.0, 5.0]]
    return jc.Structure(nodes, beams, supports=jc.restrained([0], "xyz", "xy")), 2


@pytest.mark.quick_cases("gate-superlu")
@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
@pytest.mark.parametrize("scene", [gate, crane])
def test_what_turns_freely_is_not_stable(scene, method):
    """Under its weight it stays wherever it is turned to; a pull outward brings it back."""
    structure, tip = scene()
    for pull, expected in ((0.0, False), (100.0, True), (-100.0, False)):
        load = jc.NodalLoads([tip], (pull, 0.0, -100.0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", jc.UnstableWarning)
            solution = converged(jc.solve(structure, jc.Phase(loads=load), method))
        assert bool(solution.stable) == expected, pull


def test_instability_is_in_warning_report_picture_and_file(tmp_path, capsys):
    with pytest.warns(jc.UnstableWarning, match=r"phases\[0\]\) ends in an unstable equilibrium"):
        solution = push_strut(12.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        push_strut(8.0)
        assert not traced(push_strut)(12.0).stable
    structure = propped_strut()
    text = jc.report(structure, solution).text()
    assert "UNSTABLE at its end" in text
    assert "UNSTABLE" not in jc.report(structure, push_strut(8.0)).text()
    figure = jc.plots.net(solution, structure=structure)
    assert any("not known to be stable" in axes.get_title() for axes in figure.axes)
    plt.close("all")
    scene = tmp_path / "strut.json"
    loads = jc.NodalLoads([1], (0.0, 0.0, -12.0))
    jc.save_scene(scene, jc.scenes.Scene(structure, [jc.Phase(loads=loads)]))
    from jaxcable.__main__ import main

    result = tmp_path / "result.json"
    assert main(["solve", str(scene), "--save", str(result)]) == 0
    told = capsys.readouterr()
    assert "warning: phase 1 (phases[0]) ends in an unstable equilibrium" in told.err
    assert "UNSTABLE" in told.out
    assert json.loads(result.read_text())["stable"] is False
    assert jc.files.load_result(result)["stable"].dtype == bool
