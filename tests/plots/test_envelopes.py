"""Pictures of envelopes: what they draw, what their legends name, and that nothing is cut off."""

import jax
import numpy as np
import pytest
from matplotlib.collections import LineCollection

import jaxcable as jc
from jaxcable.common.status import NOT_CONVERGED, OK
from jaxcable.common.tree import copy_with
from jaxcable.plots.ordinates import write_largest_values
from jaxcable.plots.style import new_figure
from jaxcable.plots.views import choose_view

SECTION = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
NODES = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [4.0, 0.0, 0.0], [2.0, 0.0, 2.0]]
ROPE = jc.Cables([[3, 1]], axial_stiffness=1e5, strength=2e4)
BEAMS = jc.Beams([[0, 1], [1, 2]], section=SECTION)
ENDS = jc.restrained([0], "xyz", "x") + jc.restrained([2], "yz") + jc.pinned([3])
STRUCTURE = jc.Structure(NODES, {"beam": BEAMS, "rope": ROPE}, supports=ENDS)
START = jc.Phase(pretension={"rope": 100.0}, loads=jc.NodalLoads([1], (0.0, 0.0, -1e3)))
CASES = [jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, p))) for p in (-500.0, 900.0)]
NAMES = ["snow", "wind"]


@pytest.fixture(scope="module")
def solved():
    solutions = jc.design.solve_cases(STRUCTURE, START, CASES)
    assert (solutions.status == 0).all()
    return solutions, jc.design.envelope(STRUCTURE, solutions, NAMES)


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def nothing_is_cut_off(figure):
    figure.draw_without_rendering()
    width, height = figure.get_size_inches() * figure.dpi
    shown = [*figure.legends, *(t for axes in figure.axes for t in axes.texts)]
    shown += [axes.title for axes in figure.axes]
    for part in shown:
        box = part.get_window_extent()
        assert box.x0 >= -1 and box.y0 >= -1 and box.x1 <= width + 1 and box.y1 <= height + 1


@pytest.mark.parametrize("units, factor, unit", [(None, 1.0, "N m"), ("kN, m", 1e-3, "kN m")])
def test_moments_are_drawn_to_scale_and_named(solved, units, factor, unit, tmp_path):
    _, envelope = solved
    path = tmp_path / "My.png"
    figure = jc.plots.envelope_diagram(STRUCTURE, envelope, "My", path, units=units)
    assert path.read_bytes().startswith(b"\x89PNG")
    moments = np.stack([np.asarray(x) for x in jax.tree.leaves(envelope.values["My"])])
    least = f"{factor * moments.min():.4g}"
    case = np.unravel_index(moments.argmin(), moments.shape)[1]
    assert f"smallest My: {least} {unit}, {NAMES[case]}" in legend(figure)
    assert "pinned" in legend(figure)
    assert any("negative: at -z" in line for line in legend(figure))
    (axes,) = figure.axes
    assert axes.get_aspect() == 1.0
    assert float(least) in {float(text.get_text()) for text in axes.texts}
    lines = [c for c in axes.collections if isinstance(c, LineCollection)]
    z = np.concatenate([np.array(part)[:, 1] for part in lines[-1].get_segments()])
    assert z.min() == pytest.approx(-0.12 * 4.0)  # below, where the sagging beam is in tension
    nothing_is_cut_off(figure)


def test_displacements_show_the_case_that_governs(solved):
    """And element values have one scale; failed cases are not drawn."""
    solutions, envelope = solved
    figure = jc.plots.envelope_diagram(STRUCTURE, envelope, "displacement", units="kN, m")
    sizes = np.linalg.norm(solutions.displacement, axis=2)
    case, node = np.unravel_index(sizes.argmax(), sizes.shape)
    text = f"{1e3 * sizes.max():.4g} mm, node {node}, {NAMES[case]}"
    text = f"largest displacement from the initial geometry: {text}"
    assert [line.replace("\n", " ") for line in legend(figure)[:2]] == [text, "all 2 cases"]
    nothing_is_cut_off(figure)
    begun = jc.solve(STRUCTURE, START)
    figure = jc.plots.envelope_diagram(STRUCTURE, envelope, "displacement", since=begun)
    sizes = np.linalg.norm(np.asarray(solutions.positions) - np.asarray(begun.positions), axis=2)
    case, node = np.unravel_index(sizes.argmax(), sizes.shape)
    text = f"{1e3 * sizes.max():.4g} mm, node {node}, {NAMES[case]}"
    text = f"largest displacement from the reference state: {text}"
    shown = [line.replace("\n", " ") for line in legend(figure)[:3]]
    assert shown == [text, "all 2 cases", "reference state"]
    figure = jc.plots.envelope_diagram(STRUCTURE, envelope, "tension")
    most = max(float(np.max(x)) for x in jax.tree.leaves(envelope.high["tension"]))
    assert legend(figure)[0].startswith(f"largest tension: {most:.4g} N, ")
    first, second = (
        next(c for c in axes.collections if c.get_array() is not None) for axes in figure.axes[:2]
    )
    assert first.get_clim() == second.get_clim() and first.get_clim()[1] == pytest.approx(most)
    nothing_is_cut_off(figure)
    broken = copy_with(solutions, status=np.array([NOT_CONVERGED, OK]))
    failed = jc.design.envelope(STRUCTURE, broken, NAMES)
    figure = jc.plots.envelope_diagram(STRUCTURE, failed, "displacement")
    assert "all 1 cases" in legend(figure) and legend(figure)[0].endswith("wind")


@pytest.fixture(scope="module")
def without_rope():
    """The beam as it is when its rope has been removed, under either of two loads."""
    built = jc.solve(STRUCTURE, [START, jc.Phase(removes="rope")])
    solutions = jc.design.solve_cases(STRUCTURE, None, CASES, start=built)
    assert int(built.status) == 0 and (solutions.status == 0).all()
    return solutions, jc.design.envelope(STRUCTURE, solutions, NAMES)


@pytest.mark.slow
@pytest.mark.parametrize("of", ["displacement", "tension", "Vz"])
def test_removed_elements_are_not_drawn(without_rope, of):
    """The rope from (2, 2) down to the beam is the only element above 0.6 m."""
    figure = jc.plots.envelope_diagram(STRUCTURE, without_rope[1], of, supports=False)
    lines = [c for axes in figure.axes for c in axes.collections if isinstance(c, LineCollection)]
    parts = [np.array(part) for c in lines for part in c.get_segments()]
    assert len(parts) >= 4 and max(part[:, 1].max() for part in parts if len(part)) < 0.6


@pytest.mark.slow
def test_supports_of_removed_elements_are_not_marked(solved, without_rope):
    """The rope hangs from a pin at (2, 2), above the beam."""
    highest = []
    for _, envelope in (solved, without_rope):
        axes, *_ = jc.plots.envelope_diagram(STRUCTURE, envelope, "tension").axes
        marks = [line for line in axes.lines if line.get_marker() == "^"]
        highest.append(max(np.max(line.get_ydata()) for line in marks))
    assert highest == [2.0, 0.0]


@pytest.mark.slow
def test_displaced_beams_are_bent(without_rope):
    """Halves of a beam under a force in the middle: at quarters 11/16 of what the middle moves."""
    solutions, envelope = without_rope
    figure = jc.plots.envelope_diagram(
        STRUCTURE, envelope, "displacement", solutions=solutions, supports=False
    )
    bold = max(figure.axes[0].collections, key=lambda own: own.get_linewidth()[0])
    (left, right) = bold.get_segments()
    quarter = np.interp(1.0, *np.transpose(left))
    # chords between 25 points are off by 1e-3; the slope is too small to matter, too
    assert quarter / left[-1, 1] == pytest.approx(11 / 16, rel=3e-3)
    np.testing.assert_allclose(right[::-1, 1], left[:, 1], rtol=1e-2, atol=1e-6)


POLES = jc.Beams([[0, 1], [1, 2], [3, 4], [5, 6]], section=SECTION)
FEET = [[1.0, 0.5, 0.0], [1.0, 0.5, 5.0], [1.0, 0.0, 0.0], [1.0, 0.0, 5.0]]
UPRIGHT = jc.Structure(
    [[0.0, 0.0, 0.0], [0.0, 0.0, 3.0], [0.0, 0.0, 6.0], *FEET],
    POLES,
    supports=jc.clamped([0, 3, 5]),
)


@pytest.fixture(scope="module")
def mast():
    """Three cantilevers upwards; the first one is pushed along y by 200 N, or by -100 N."""
    cases = [jc.Phase(loads=jc.NodalLoads([2], (0.0, p, 0.0))) for p in (200.0, -100.0)]
    solutions = jc.design.solve_cases(UPRIGHT, jc.Phase(), cases)
    assert (solutions.status == 0).all()
    return jc.design.envelope(UPRIGHT, solutions, NAMES)


@pytest.mark.slow
def test_a_mast_is_seen_where_its_moments_are_in_their_true_length(mast):
    figure = jc.plots.envelope_diagram(UPRIGHT, mast, "Mz")
    (axes,) = figure.axes
    assert axes.get_xlabel() == "y (m)" and axes.get_ylabel() == "z (m)"
    # P h of the closed form; the sway of 6 % of the height adds 0.1 %, hence three digits
    assert max(abs(float(t.get_text())) for t in axes.texts) == pytest.approx(1200.0, rel=2e-3)
    lines = [c for c in axes.collections if isinstance(c, LineCollection)]
    y = np.concatenate([np.array(part)[:, 0] for part in lines[-1].get_segments()])
    assert np.abs(y).max() == pytest.approx(0.12 * 6.0)  # of the height, m
    moved = jc.plots.envelope_diagram(UPRIGHT, mast, "displacement")
    assert moved.axes[0].get_xlabel() == "y (m)"
    assert jc.plots.envelope_diagram(UPRIGHT, mast, "Mz", view="space").axes[0].name == "3d"


@pytest.mark.slow
def test_a_moment_of_rounding_is_zero(mast):
    """My of a mast that bends about z only."""
    figure = jc.plots.envelope_diagram(UPRIGHT, mast, "My")
    assert legend(figure)[0].startswith("largest My: 0 N") and not figure.axes[0].texts


def test_what_cannot_be_drawn_is_refused(solved):
    solutions, envelope = solved
    one = jax.tree.map(lambda x: np.asarray(x)[:1], solutions)
    for given, options, message in (
        (envelope, {"of": "Mq"}, "of = 'Mq': is no result"),
        (envelope, {"of": "reactions"}, "of = 'reactions': has no number for each element"),
        (envelope, {"high": 0}, "high = 0: must be positive"),
        (envelope, {"view": "side"}, "view = 'side'"),
        (envelope, {"since": one}, 'since: is for of = "displacement", not for'),
        (solutions, {}, "envelope: expected a ResultEnvelope"),
        (envelope, {"of": "displacement", "solutions": one}, "must be the batch of the 2 cases"),
    ):
        with pytest.raises(ValueError, match=message):
            jc.plots.envelope_diagram(STRUCTURE, given, **options)


@pytest.mark.slow
def test_a_report_gets_the_pictures_that_there_are(solved, tmp_path):
    solutions, _ = solved
    begin = jc.solve(STRUCTURE, START)
    pictures = jc.plots.for_report(STRUCTURE, begin, cases=solutions, names=NAMES)
    shown = "".join(pictures)
    assert "breaking force in snow" in shown and "Envelope of My" in shown and "of T" not in shown
    options = {"names": NAMES, "phase_names": ["erected"], "since": "erected"}
    since = jc.plots.for_report(STRUCTURE, begin, cases=solutions, **options)
    figure = since["Displacements in all cases, since the end of phase 1, erected"]
    assert "reference state" in legend(figure)
    report = jc.report(STRUCTURE, begin, cases=solutions, names=NAMES)
    (path,) = report.save(tmp_path / "r.html", pictures=pictures)
    assert path.read_text().count("<figure>") == len(pictures) >= 5


def test_values_of_repeated_bays_are_written_twice_at_most():
    """Of six equal bays the largest value is written at two that are far apart."""
    base = np.array([[[2.0 * k + x, 0.0, 0.0] for x in (0.0, 1.0, 2.0)] for k in range(6)])
    values = np.array([0.0, 5.0, 0.0]) * (1.0 + 1e-12 * np.arange(6.0))[::-1, None]
    tips = base - 0.2 * values[..., None] * np.array([0.0, 0.0, 1.0])
    view = choose_view(base.reshape(-1, 3))
    axes = new_figure(6.0, 2.0).add_subplot(xlim=(0, 12), ylim=(-1.2, 0.2))
    write_largest_values(axes, view, (base, tips), values, 1.0, (0.5, 9, 0.0))
    assert [text.get_text() for text in axes.texts] == ["5", "5"]
    first, second = (text.get_position()[0] for text in axes.texts)
    assert first == 1.0 and second - first >= 4 * 0.5
