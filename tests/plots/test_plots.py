"""Pictures: what is in them, seen in their pixels; and that they leave matplotlib alone."""

import base64
import io
import itertools
import re

import jax
import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.text import Text
from oracles.convergence import converged
from PIL import Image

import jaxcable as jc
from jaxcable.model.topology import topology_of
from jaxcable.plots import element_forces, element_lines, layout, nets, style, symbols, views
from jaxcable.plots.snapshots import evenly_spaced_indices

FREE = [3, 4, 7, 8]


class Runs:
    """Analyses of one program: the flat net, with slack cables, in a vertical plane, and failed."""

    def __init__(self):
        self.structure, self.phases = jc.scenes.flat_net()
        self.taut = converged(jc.solve(self.structure, self.phases))
        push = jc.Phase(loads=jc.NodalLoads(FREE, (400.0, 0.0, -5.0)), increments=10)
        self.slack = converged(jc.solve(self.structure, [self.phases[0], push]))
        upright = np.asarray(self.structure.nodes)[:, [0, 2, 1]]
        upright = jc.replace(self.structure, nodes=upright)
        self.plane = converged(jc.solve(upright, self.phases))
        self.failed = jc.solve(self.structure, self.phases, jc.Newton(max_steps=3))
        assert int(self.failed.status) == 1 and int(self.failed.last.phase) == 0
        cables = jc.replace(self.structure.elements, strength=600.0)
        self.strong = jc.replace(self.structure, elements=cables)


@pytest.fixture(scope="module")
def runs():
    return Runs()


def found(loss, gradient_norm, failures):
    zeros = np.zeros(len(loss), int)
    history = jc.design.History(loss, gradient_norm, zeros, np.array(failures), zeros)
    n = len(loss) - 1
    return jc.design.Design(None, loss[-1], None, 0.0, history, 0, n, n, sum(failures))


def fitted():
    misfit = np.array([3.0, np.nan, 4.0, 0.5, 1e-6, np.nan])
    taken, codes = np.array([1, 0, 0, 1, 1, -1]), np.array([0, 3, 0, 0, 0, -1])
    history = jc.design.FitHistory(misfit, taken, 10.0 ** np.arange(6.0), codes)
    names = "params", "residual", "jacobian", "free", "without_influence"
    own = dict.fromkeys(names) | {"history": history, "status": 0, "steps": 4}
    return jc.design.Fit(misfit=misfit[4], **own)


ERRORS = {"Newton": [1e-3, 1e-9, 0.0], "secant": [1e-2, np.nan, 1e-4]}
PICTURES = {
    "net": lambda r: jc.plots.net(r.taut, structure=r.structure, reactions=True, magnify=3.0),
    "net, slack": lambda r: jc.plots.net(r.slack),
    "net, plane": lambda r: jc.plots.net(r.plane, reactions=True),
    "net, space": lambda r: jc.plots.net(r.taut, view="space", loads=False, supports=False),
    "net, utilization": lambda r: jc.plots.net(r.taut, color="utilization", structure=r.strong),
    "net, failed": lambda r: jc.plots.net(r.failed, state=r.failed.last),
    "model": lambda r: jc.plots.model(r.structure),
    "model, space": lambda r: jc.plots.model(r.structure, view="space", units="kip, ft"),
    "path": lambda r: jc.plots.path(r.taut.phases[1].path, 3, axis="-z"),
    "section": lambda r: jc.plots.section(jc.Section.disc(0.05, jc.Elastic(1e9), (3, 8))),
    "increments": lambda r: jc.plots.increments(r.slack),
    "increments, failed": lambda r: jc.plots.increments(r.failed),
    "convergence": lambda r: jc.plots.convergence([0.4, 0.2, 0.1], ERRORS, floor=1e-8),
    "work_precision": lambda r: jc.plots.work_precision([1.0, 2.0, np.inf], ERRORS),
    "history": lambda r: jc.plots.history(
        found(np.array([5.0, 2.0, 1.9]), np.array([1.0, 1e-2, 1e-7]), [0, 2, 0]), tol=1e-6
    ),
    "history of a fit": lambda r: jc.plots.history(fitted()),
}


@pytest.fixture(scope="module")
def pictures(runs):
    return {name: make(runs) for name, make in PICTURES.items()}


def pixels(figure, dpi=60):
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return np.asarray(Image.open(buffer).convert("RGB")).astype(int)


def legends(figure):
    return [*figure.legends, *(a.get_legend() for a in figure.axes if a.get_legend())]


def legend_texts(figure):
    return [text.get_text() for legend in legends(figure) for text in legend.get_texts()]


@pytest.mark.slow_cases(
    "convergence",
    "history",
    "history of a fit",
    "increments",
    "increments, failed",
    "net, plane",
    "net, utilization",
    "work_precision",
)
@pytest.mark.parametrize("name", PICTURES)
def test_nothing_is_cut_off_and_something_is_drawn(pictures, name):
    figure = pictures[name]
    image = pixels(figure)
    edge = np.concatenate([image[[0, -1]].reshape(-1, 3), image[:, [0, -1]].reshape(-1, 3)])
    assert (edge == 255).all()
    for axes in figure.axes:
        left, low, right, high = np.round(layout.visible_extent(axes) * 60).astype(int)
        inside = image[len(image) - high + 2 : len(image) - low - 2, left + 2 : right - 2]
        assert len(np.unique(inside.reshape(-1, 3), axis=0)) > 4
    # 4 inches wide, as printed in 10 cm, no text is smaller than 5.5 points
    sizes = {t.get_fontsize() for t in figure.findobj(Text) if t.get_text()}
    assert min(sizes) * 3.94 / figure.get_figwidth() > 5.5


@pytest.mark.slow_cases(
    "convergence", "history of a fit", "increments", "increments, failed", "work_precision"
)
@pytest.mark.parametrize("name", PICTURES)
def test_axes_have_units_and_the_legend_is_beside_them(pictures, name):
    figure = pictures[name]
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()
    boxes = [legend.get_window_extent(renderer) for legend in legends(figure)]
    for axes in figure.axes:
        labels = [axes.get_xlabel(), axes.get_ylabel()]
        if axes.name == "3d":
            low, high = (np.array(p) * figure.dpi for p in np.split(layout.visible_extent(axes), 2))
            own = matplotlib.transforms.Bbox([low, high])
            labels.append(axes.get_zlabel())
        else:
            own = axes.get_tightbbox(renderer, bbox_extra_artists=[])  # labels, no legend
        assert not any(own.overlaps(box) for box in boxes)
        for label in filter(None, labels):
            assert re.search(r"\(.+\)|^(loss|misfit|damping|load factor)$", label)


def test_axes_of_geometry_are_equal(pictures):
    for name in ("net", "net, plane", "net, space", "model", "model, space"):
        bar = not name.startswith("model")  # the last axes are those of the color bar
        for axes in pictures[name].axes[: -1 if bar else None]:
            if axes.name == "3d":
                limits = [np.ptp(getattr(axes, f"get_{own}lim")()) for own in "xyz"]
                assert np.ptp(axes.get_box_aspect() / np.array(limits)) < 1e-9
            else:
                assert axes.get_aspect() == 1


def test_legend_and_color_bar_of_a_net(pictures, runs):
    figure = pictures["net"]
    plan, space, bar = figure.axes
    assert plan.get_title() == "Before loading: plan"
    assert space.get_title() == "After loading, displacements x 3"
    assert bar.get_xlabel() == "tension (N)"
    largest = f"largest reaction {np.linalg.norm(runs.taut.reactions, axis=1).max():.3g} N"
    assert legend_texts(figure) == ["before", "pinned", "largest load 150 N", largest]
    tension = np.concatenate([runs.taut.phases[0].tension, runs.taut.tension])
    assert np.allclose(bar.get_xlim(), [tension.min(), tension.max()])
    # the deflection is magnified, that of the first phase is not
    drawn = next(c for c in space.collections if c.get_array() is not None)
    ends = np.concatenate([np.asarray(s) for s in drawn._segments3d])
    assert np.isclose(ends[:, 2].min(), 3 * runs.taut.phases[1].displacement_in_phase[:, 2].min())


def test_bars_without_force_are_not_slack():
    bars = jc.Bars([[0, 1], [0, 2]], axial_stiffness=1.0)
    cable = jc.Cables([[1, 2]], axial_stiffness=1.0)
    structure = jc.Structure(np.eye(3), [bars, cable], jc.pinned([0, 1, 2]))
    told, parts = {"tension": [np.array([0.0, -2.0]), np.zeros(1)]}, topology_of(structure).parts
    shown = element_forces.ElementForces(told, parts, structure)
    assert shown.slack.tolist() == [False, False, True]
    assert shown.compressed.tolist() == [False, True, False]
    unknown = element_forces.ElementForces(told, parts)
    assert unknown.slack.tolist() == [True, False, True]


@pytest.mark.slow
def test_utilization(pictures, runs):
    """The strength is 600 N: what holds more has a color that is in no part of the scale."""
    used = 100 * np.concatenate([runs.taut.phases[0].tension, runs.taut.tension]) / 600
    assert used.min() < 100 < used.max()
    figure = pictures["net, utilization"]
    bar = figure.axes[-1]
    assert bar.get_xlabel() == f"force / breaking force (%), largest {used.max():.4g} %"
    assert np.allclose(bar.get_xlim(), [0.0, 100.0], atol=1e-3)  # 1e-6 are rounding
    assert {0, 100} <= set(bar.get_xticks())
    for axes, values in zip(figure.axes, np.split(used, 2), strict=False):
        lines = next(c for c in axes.collections if c.get_array() is not None)
        assert np.allclose(lines.get_array(), values)  # all are taut
        lines.update_scalarmappable()
        red = (lines.get_colors()[:, :3] == matplotlib.colors.to_rgb(style.OVER)).all(axis=1)
        assert (red == (values > 100)).all()
    below = jc.replace(runs.strong, elements=jc.replace(runs.strong.elements, strength=2e3))
    figure = jc.plots.net(runs.taut, color="utilization", structure=below)
    assert figure.axes[-1].get_xlabel() == "force / breaking force (%)"


@pytest.mark.slow
def test_titles_say_the_phase(runs):
    three = converged(jc.solve(runs.structure, [*runs.phases, jc.Phase()]))
    one = converged(jc.solve(runs.structure, runs.phases[:1]))
    snow = {"names": ["prestress", "snow"], "magnify": 2.0}
    for solution, options, titles in (
        (runs.taut, {}, ["Before loading: plan", "After loading"]),
        (runs.taut, snow, ["prestress: plan", "snow, displacements x 2"]),
        (three, {}, ["After phase 1 of 3: plan", "After phase 3 of 3"]),
        (one, {"names": ["prestress"]}, ["prestress: plan", "prestress"]),
    ):
        figure = jc.plots.net(solution, **options)
        assert [axes.get_title() for axes in figure.axes[:-1]] == titles


def test_views(pictures):
    figure = pictures["net, plane"]  # what lies in a vertical plane is drawn in elevation
    assert [axes.name for axes in figure.axes[:2]] == ["rectilinear"] * 2
    assert figure.axes[0].get_title() == "Before loading: elevation"
    assert figure.axes[0].get_ylabel() == "z (m)"
    assert [axes.name for axes in pictures["net"].axes[:2]] == ["rectilinear", "3d"]
    turned = np.array([[0.0, 0, 0], [3.0, 4.0, 0], [6.0, 8.0, 1.0]])
    view = views.choose_view(turned)
    assert view.kind == "elevation" and view.plane
    assert np.allclose(view.project(turned), [[0, 0], [5, 0], [10, 1]])
    assert view.axis_labels()[0] == "along 53° to x (m)"
    assert np.allclose(np.abs(view.normal), [0.8, 0.6, 0.0])
    mast = np.array([[0.0, 0, 0], [0, 0, 9.0], [3.0, 0, 0], [0, 3.0, 0]])
    assert views.choose_view(mast).kind == "elevation" and not views.choose_view(mast).plane
    hanging = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, -4.0]])
    assert views.choose_view(hanging).axis_labels() == ("x (m)", "z (m)")
    assert views.choose_view(mast, "plan").kind == "plan"


def test_heights_of_a_line_are_magnified_over_its_ground():
    """Two spans that sag by 2 m in 100 m: by 10 they are 0.2 times as high as wide."""
    nodes = np.array([[0.0, 0, 0], [25.0, 0, -2], [50.0, 0, 0], [75.0, 0, -2], [100.0, 0, 0]])
    assert views.choose_view(nodes, heights=None).heights == 10.0
    high = nodes * [1.0, 1.0, 11.0]  # 22 m: twice the height is more than 0.3 of the width
    assert views.choose_view(high, heights=None).heights == 1.0
    seen = views.choose_view(nodes, heights=5.0)
    np.testing.assert_array_equal(seen.project(nodes)[:, 1], 5.0 * nodes[:, 2])
    links = [[0, 1], [1, 2], [2, 3], [3, 4]]
    line = jc.Structure(nodes, jc.Cables(links, axial_stiffness=1e6), jc.pinned([0, 2, 4]))
    hung = converged(jc.solve(line, jc.Phase(loads=jc.NodalLoads([1, 3], (0.0, 0.0, -1e3)))))
    ground = np.array([[0.0, 0.0, -6.0], [100.0, 0.0, -8.0]])
    figure = jc.plots.net(hung, structure=line, heights=5.0, ground=ground)
    axes = figure.axes[0]
    assert axes.get_ylabel() == "z (m) x 5" and axes.get_ylim()[0] < 5.0 * -8.0
    drawn = [own.get_xydata() for own in axes.lines if len(own.get_xydata()) == 2]
    assert any(np.allclose(points, [[0.0, -30.0], [100.0, -40.0]]) for points in drawn)
    for place, text in zip(axes.get_yticks(), axes.get_yticklabels(), strict=True):
        assert float(text.get_text()) == pytest.approx(place / 5.0)


@pytest.mark.slow
def test_all_pictures_of_a_line_have_one_factor_on_heights():
    """Level supports: heights are those of the sags, 8 m in 600 m, hence 0.3 / (8 / 600) = 22."""
    nodes = [[0.0, 0, 20], [300.0, 0, 20], [600.0, 0, 20]]
    spans = jc.Catenaries([[0, 1], [1, 2]], axial_stiffness=30e6, weight=15.0, rest_length=300.36)
    line = jc.Structure(nodes, spans, jc.pinned([0, 1, 2]))
    hung = converged(jc.solve(line, jc.Phase(loads=jc.SelfWeight())))
    cases = jax.tree.map(lambda x: np.asarray(x)[None], hung)
    pictures = jc.plots.for_report(line, hung, cases=cases, names=["weight"])
    assert len(pictures) == 4
    assert {figure.axes[0].get_ylabel() for figure in pictures.values()} == {"z (m) x 20"}
    for low, factor in (1e-7, 1.0), (0.1, 100.0):  # rounding; 0.3 / (0.1 / 600) is 1800
        points = np.array([[0.0, 0, 20], [300.0, 0, 20 - low], [600.0, 0, 20]])
        assert views.choose_view(points, heights=None).heights == factor


def test_a_group_that_another_one_swamps_has_its_own_colors():
    """A net of 10 to 30 kN between edges of 300 kN; then one of which no group is small."""
    group = np.array([0, 0, 1, 1, 1])
    force = np.array([-300e3, 150e3, 10e3, 30e3, np.nan])
    own = element_lines.ColoredValues(force, "tension", "N", group, ["edge", "net"])
    scale = element_lines.ColorScale([own])
    shares = scale.numbers(own)
    np.testing.assert_allclose(shares[:4], [100.0, 50.0, 100.0 / 3, 100.0])
    texts = [entry.get_label() for entry in scale.legend_entries()]
    assert texts == ["edge: -300 to 150 kN", "net: 10 to 30 kN"]
    together = element_lines.ColorScale([own], one_scale=True)
    np.testing.assert_allclose(together.numbers(own), force / 1e3)
    whole = 26793.992565943103  # 100 whole / whole is above 100, by rounding
    equal = own._replace(value=np.array([-300e3, 150e3, whole, whole, 10e3]))
    assert element_lines.ColorScale([equal]).numbers(equal).max() == 100.0
    alike = own._replace(value=np.array([-300e3, 150e3, 100e3, 90e3, 80e3]))
    scale = element_lines.ColorScale([alike])
    assert scale.legend_entries() == [] and scale.label == "axial force (kN), tension positive"
    np.testing.assert_allclose(scale.numbers(alike), alike.value / 1e3)


def test_kinds_of_supports():
    """Clamped, pinned, pinned about one axis more, on rollers, out of a plane only, free."""
    rows = ["111111", "111000", "111100", "001000", "010000", "000000"]
    fixed = np.array([[letter == "1" for letter in row] for row in rows])
    beams, normal = np.ones(6, bool), np.array([0.0, 1.0, 0.0])
    sprung = np.arange(6) > 3
    clamped, pinned, in_part, on_ground = symbols.support_kinds(fixed, sprung, beams, normal)
    assert on_ground.tolist() == [False, False, False, False, True, True]
    assert clamped.tolist() == [True, False, False, False, False, False]
    assert pinned.tolist() == [False, True, True, False, False, False]
    assert in_part.tolist() == [False, False, False, True, False, False]
    clamped, pinned, in_part, on_ground = symbols.support_kinds(fixed, sprung)  # cables, in space
    assert not clamped.any() and pinned.tolist() == [True, True, True, False, False, False]
    assert in_part.tolist() == [False, False, False, True, True, False]
    assert on_ground.tolist() == [False] * 5 + [True]


def test_round_factors_units_of_force_and_frames():
    places = np.array([[0.0, 0, 0], [10.0, 0, 0]])
    sizes = (2.0, 0.3, 0.02, 1.1e-5, 0.0)
    found = [nets.round_magnification(np.array([[0.0, 0, size]]), places) for size in sizes]
    assert found == [1.0, 2.0, 50.0, 50000.0, 1.0]
    texts = [style.format_force(force) for force in (15.7, 999.0, 9e3, 2.5e6)]
    assert texts == ["15.7 N", "999 N", "9 kN", "2.5 MN"]
    # the last frame is the last increment
    for n_increment, n_frame, frames in (11, 4, [0, 3, 7, 10]), (3, 60, [0, 1, 2]), (500, 1, [499]):
        assert evenly_spaced_indices(n_increment, n_frame).tolist() == frames


def test_increments_and_failed_solutions(pictures, runs):
    residual, iterations, slack = pictures["increments"].axes
    path = runs.slack.phases[1].path
    assert (slack.lines[0].get_ydata()[1:] == path.n_slack).all()
    assert (iterations.lines[0].get_ydata()[1:] == path.iterations).all()
    assert residual.get_yscale() == "log"
    assert legend_texts(pictures["increments"]) == ["increment", "tol = 1e-10"]
    low, high = residual.get_ylim()
    assert low < np.asarray(path.relative_residual).max() < 1e-10 < high
    failed = pictures["increments, failed"]
    assert legend_texts(failed)[-1] == "failed"
    cross = next(line for line in failed.axes[0].lines if line.get_label() == "failed")
    assert cross.get_xdata() == [2] and cross.get_ydata() > 1e-10
    assert len(failed.axes[2].lines[0].get_xdata()) == 1  # nothing is said of what was not reached
    assert pictures["net, failed"].axes[0].get_title() == "After phase 1: plan"
    with pytest.raises(ValueError, match=r"solution: the analysis failed.*state=solution.last"):
        jc.plots.net(runs.failed)
    with pytest.raises(ValueError, match="not one finite"):
        jc.plots.history(found(np.full(2, np.nan), np.ones(2), [1, 0]))


def test_names_of_phases_are_where_they_begin(runs):
    names = ["prestress and self-weight", "snow"]
    texts = {}
    for stated in (None, names, ["a name as long as the picture, and longer: " * 3, "snow"]):
        axes = jc.plots.increments(runs.slack, names=stated).axes[0]
        written = {text.get_text(): text.get_position() for text in axes.texts}
        texts |= written
        (begin, at) = (written[name] for name in (stated or ["phase 1", "phase 2"]))
        # of 11 increments the first one is phase 1; its name is above that of phase 2
        assert 0 < begin[0] < 0.02 and 1 / 11 < at[0] < 1 / 11 + 0.02
        assert begin[1] > at[1] + 0.1 and at[1] > 1
        rising = [line for line in axes.lines if line.get_transform() == axes.transAxes]
        tops = {round(float(x), 6): top for line in rising for x, top in line.get_xydata()[1:]}
        assert (
            set(tops) == {0.0, round(1 / 11, 6)} and tops[0.0] > begin[1] > tops[round(1 / 11, 6)]
        )
    assert len(texts) == 5


def test_orders(pictures):
    h = np.array([0.4, 0.2, 0.1])
    figure = jc.plots.convergence(h, {"a": h**2, "b": 3 * h})
    assert legend_texts(figure) == ["a: order 2.00", "b: order 1.00"]
    counted = jc.plots.convergence(1 / h, h**4, counts=True)
    assert legend_texts(counted) == ["order 4.00"]
    assert counted.axes[0].get_xlabel() == "number of elements (-)"
    texts = legend_texts(pictures["convergence"])
    slope = np.log(1e-2 / 1e-4) / np.log(0.4 / 0.1)
    # two of the first series are rounding or none: no order
    order = f"secant: order {slope:.2f}"
    assert texts == ["Newton", order, "failed", "zero error", "rounding"]


def test_failures_are_at_the_edge(pictures):
    axes = pictures["work_precision"].axes[0]
    assert legend_texts(pictures["work_precision"]) == ["Newton", "secant", "failed"]
    marks = [
        (float(x), float(y))
        for line in axes.lines
        if line.get_transform() == axes.transAxes and line.get_marker() == "x"
        for x, y in line.get_xydata()
    ]
    (never, top), (failed, high), (end, middle) = marks
    assert never > 0.95 and top > 0.95  # no time: the corner
    assert 0.3 < failed < 0.9 and high > 0.95  # an error that is not a number, after 2 s
    assert end > 0.95 and 0.1 < middle < 0.7  # an error, but no time


def test_history(pictures):
    texts = legend_texts(pictures["history"])
    assert texts == ["accepted step", "failed trials (2)", "tol = 1e-06"]
    loss, norm = pictures["history"].axes
    assert loss.get_yscale() == "linear" and norm.get_yscale() == "log"
    cross = loss.lines[1]
    assert cross.get_xdata().tolist() == [1] and cross.get_ydata().tolist() == [2.0]
    texts = legend_texts(pictures["history of a fit"])
    assert texts == ["accepted trial", "not accepted", "failed trial"]
    misfit = pictures["history of a fit"].axes[0]
    assert [line.get_xdata().tolist() for line in misfit.lines] == [[0, 3, 4], [2], [1]]


def test_moving_pictures(runs, tmp_path):
    path, options = tmp_path / "net.gif", {"structure": runs.structure, "frames": 4, "dpi": 50}
    with Image.open(jc.plots.animation(runs.slack, path, **options)) as gif:
        assert gif.n_frames == 4
        shots = []
        for k in range(4):
            gif.seek(k)
            shots.append(np.asarray(gif.convert("RGB")).astype(int))
    for one, two in itertools.pairwise(shots):
        changed = np.abs(one - two).max(axis=2) > 0
        assert changed.any() and changed.mean() < 0.2  # axes and scale stay where they are
    low = int(0.75 * len(shots[0]))  # color bar and legend
    assert all((shot[low:] == shots[0][low:]).all() for shot in shots)
    assert all((shot[[0, -1]] == 255).all() and (shot[:, [0, -1]] == 255).all() for shot in shots)

    page = jc.plots.animation(runs.plane, str(tmp_path / "net.html"), frames=3, dpi=40)
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"https?:|<link|src\s*=\s*\"(?!data:)|@import", text)
    frames = re.findall(r'"data:image/png;base64,([^"]+)"', text)
    assert len(frames) == 3 == len(set(frames))
    with Image.open(io.BytesIO(base64.b64decode(frames[-1]))) as last:
        assert last.format == "PNG" and last.width == 192  # 4.8 inches

    # of a failed analysis what has converged; nothing if that is nothing
    with Image.open(jc.plots.animation(runs.failed, tmp_path / "failed.gif", dpi=40)) as gif:
        assert gif.n_frames == 1


@pytest.mark.slow
def test_matplotlib_is_left_alone(runs, tmp_path):
    """No setting is changed, no figure is left open, and a notebook gets its picture."""
    before, open_before = dict(matplotlib.rcParams), plt.get_fignums()
    figures = [make(runs) for make in PICTURES.values()]
    jc.plots.animation(runs.taut, tmp_path / "net.gif", frames=1, dpi=30)
    assert dict(matplotlib.rcParams) == before and plt.get_fignums() == open_before
    assert figures[0]._repr_png_().startswith(b"\x89PNG")
    # settings of the user do not break the layout
    with matplotlib.rc_context({"font.size": 20.0, "figure.dpi": 40, "savefig.bbox": "tight"}):
        assert {t.get_fontsize() for t in jc.plots.net(runs.taut).findobj(Text)} == {style.SIZE}
