"""Section forces at the end of any phase: between stored places, in diagrams, in pictures."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.results.interpolation import interpolate_section_forces

SECTION = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
SPAN, LOAD = 6.0, 1e3  # m, N/m


@pytest.fixture(scope="module")
def propped():
    """A beam clamped at its left end and propped at the right under q, which then is doubled."""
    ends = jc.clamped([0]) + jc.restrained([1], "yz")
    beam = jc.Beams([[0, 1]], section=SECTION)
    structure = jc.Structure([[0.0, 0, 0], [SPAN, 0, 0]], beam, supports=ends)
    half = jc.Phase(loads=jc.LineLoads((0.0, 0.0, -LOAD)))
    solution = converged(jc.solve(structure, [half, half]))
    return structure, solution


def drawn(figure, axes=0):
    return [float(text.get_text()) for text in figure.axes[axes].texts]


@pytest.mark.slow
def test_forces_between_stored_places_are_those_of_equilibrium():
    """Against `section_forces` of the last state, which integrates loads along the beam.

    The note of the docstring: 1e-4 of the largest; measured 2e-5 and less.
    """
    structure, phases = jc.scenes.guyed_mast()
    solution = converged(jc.solve(structure, phases))
    exact = jax.tree.leaves(jc.section_forces(structure, solution, 101))
    found = jax.tree.leaves(jc.section_forces(structure, solution.phases[-1], 101))
    assert len(exact) == len(found) > 0
    for a, b in zip(exact, found, strict=True):
        for kind in (slice(0, 3), slice(3, 6)):
            size = float(jnp.abs(a[..., kind]).max())
            np.testing.assert_allclose(b[..., kind], a[..., kind], atol=1e-4 * size)
    # a control: straight lines between the stored places miss by far more
    stored = jax.tree.leaves(solution.section_forces)[0]
    wrong = np.stack([np.interp(np.linspace(0, 1, 101), [0, 0.5, 1], m) for m in stored[..., 4]])
    assert np.abs(wrong - exact[0][..., 4]).max() > 1e-3 * np.abs(exact[0][..., 4]).max()


@pytest.mark.parametrize("count", [3, 5, 9])
def test_polynomials_through_gauss_lobatto_points(count):
    """Moments up to degree 2 n - 1 with their slopes are met; cubics beyond six points."""
    points = 0.5 + 0.5 * np.sort(
        np.r_[-1, np.polynomial.Legendre.basis(count - 1).deriv().roots().real, 1]
    )
    degree = 3 if count > 6 else 2 * count - 1
    length, x = 2.5, np.linspace(0, 1, 41)
    moment = np.polynomial.Polynomial(np.random.default_rng(count).normal(size=degree + 1))
    slope = moment.deriv()
    at = np.zeros((1, count, 6))
    at[0, :, 4], at[0, :, 2] = moment(points), slope(points) / length
    at[0, :, 5], at[0, :, 1] = moment(points), -slope(points) / length
    found = np.asarray(interpolate_section_forces(jnp.asarray(at), jnp.array([length]), x))[0]
    size = np.abs(moment(x)).max()
    for k in (4, 5):  # rounding of interpolation up to degree 9
        np.testing.assert_allclose(found[:, k], moment(x), atol=1e-11 * size)
    np.testing.assert_allclose(found[:, 2], slope(x) / length, atol=1e-10 * size)
    np.testing.assert_allclose(found[:, 1], -slope(x) / length, atol=1e-10 * size)


def test_what_is_refused(propped):
    structure, solution = propped
    nodes, beams = [[SPAN * k, 0, 0] for k in range(3)], jc.Beams([[0, 1], [1, 2]], SECTION)
    two = jc.replace(structure, nodes=nodes, elements=beams)
    with pytest.raises(ValueError, match="state: has 1 elements in group 0, the structure has 2"):
        jc.section_forces(two, solution.phases[0])
    plots = jc.plots
    for draw, options, message in (
        *((plots.diagram, {"phase": phase}, "phases 0 to 1") for phase in (2, True, "a")),
        (plots.net, {"phase": 0, "state": solution.last}, "state, phase: give only one"),
        (plots.net, {"state": solution.phases[0]}, "of one of its phases give phase="),
        (plots.sequence, {"diagram": "M"}, "of = 'M'"),
    ):
        with pytest.raises(ValueError, match=message):
            draw(solution, structure=structure, **options)


@pytest.mark.slow_cases("True")
@pytest.mark.parametrize("known", [True, False])
def test_a_diagram_of_each_phase(propped, known):
    """q L^2/8 at the clamp, and 9 q L^2/128 at 3/8 of the span from the prop.

    Linear theory: deflections of 1e-3 of the span change moments by 1e-5 of themselves.
    """
    structure, solution = propped
    x = np.array([0.0, 0.3, 0.625, 1.0])
    options = {"structure": structure if known else None, "view": "elevation"}
    for k, phase, number in zip((1, 2), solution.phases, (0, -1), strict=True):
        figure = jc.plots.diagram(solution, phase=number, **options)
        assert drawn(figure)[0] == pytest.approx(k * LOAD * SPAN**2 / 8, rel=1e-3)
        forces = jc.section_forces(structure, phase, places=x)[0] / (k * LOAD * SPAN)
        np.testing.assert_allclose(forces[:, 4], SPAN * (1 - 5 * x + 4 * x**2) / 8, atol=6e-4)
        np.testing.assert_allclose(forces[:, 2], x - 5 / 8, atol=1e-4)


def test_diagrams_of_all_phases_have_one_scale(propped):
    structure, solution = propped
    figure = jc.plots.sequence(solution, structure=structure, diagram="My", view="elevation")
    high, numbers = [], []
    for k in (0, 1):
        areas = [
            path.vertices
            for part in figure.axes[k].collections
            if type(part).__name__ == "PolyCollection"
            for path in part.get_paths()
        ]
        high.append(max(abs(v[:, 1]).max() for v in areas))
        numbers.append(max(map(abs, drawn(figure, k))))
    assert high[1] / high[0] == pytest.approx(2.0, rel=1e-2)
    assert numbers == pytest.approx([LOAD * SPAN**2 / 8, LOAD * SPAN**2 / 4], rel=1e-3)
    assert figure.legends[0].get_texts()[0].get_text() == "My positive (N m)"


def test_results_of_a_failed_analysis_are_nan():
    """Also those that are derived from it; its last converged state has the values of phase 0."""
    nodes = [[0.0, 0.0, 0.0], [100.0, 0.0, 10.0]]
    line = jc.Catenaries([[0, 1]], axial_stiffness=1e7, weight=20.0, expansion=1e-5)
    structure = jc.Structure(nodes, line, supports=jc.pinned([0, 1]))
    strung = jc.Phase(rest_length=100.6, loads=jc.SelfWeight())
    failed = jc.solve(structure, [strung, jc.Phase(temperature=np.nan)])
    assert int(failed.status) == jc.status.NONFINITE
    functions = jc.results.sags, jc.results.horizontal_tensions
    for function in functions:
        for of, is_known in ((failed, False), (failed.last, True)):
            values = jax.tree.leaves(function(structure, of))
            assert all(np.isfinite(x).all() == is_known for x in values)
    ends = np.asarray(failed.last.reactions)[:, :2]
    pull = float(jc.results.horizontal_tensions(structure, failed.last)[0])
    assert np.linalg.norm(ends, axis=1) == pytest.approx([pull, pull], rel=1e-9)
