"""Pictures of cables with friction: every segment has its own tension, in colors and diagrams."""

import numpy as np
import pytest
import scenes
from banks import hung_lines
from oracles.convergence import converged
from test_plots import legend_texts
from test_view import decoded

import jaxcable as jc
from jaxcable.plots.tensions_along import cables_with_largest_drop


@pytest.fixture(scope="module")
def stay():
    """A stay over a saddle, whose load slips it; and its segments' tensions in every phase."""
    structure, phases = scenes.saddle_stay(increments=2)
    solution = converged(jc.solve(structure, phases))
    return structure, solution, [of_segments(phase) for phase in solution.phases]


def of_segments(phase):
    return np.asarray(phase.element_results["segment_tension"]["stay"][0])


def test_segments_have_their_own_colors(stay):
    structure, solution, tensions = stay
    for made, own in ((structure, tensions[1]), (None, tensions[1])):
        figure = jc.plots.net(solution, structure=made, phase=1)
        casing, taut, slack = figure.axes[1].collections[1:4]
        assert len(casing.get_segments()) == len(slack.get_segments()) == 0
        np.testing.assert_allclose(taut.get_array(), own / 1e3, rtol=1e-12)
        low, high = taut.get_clim()
        both = np.concatenate(tensions[:2]) / 1e3  # both pictures have one scale
        assert (low, high) == pytest.approx((both.min(), both.max()), rel=1e-12)
    # other results have a number for the cable
    figure = jc.plots.net(solution, structure=structure, phase=1, color="friction_used 0")
    (value,) = set(figure.axes[1].collections[2].get_array())
    assert value == pytest.approx(1.0)


@pytest.mark.slow
def test_a_slack_segment_is_dashed():
    """A rope clamped to a bar, one end of which is let go."""
    nodes = [[-3.0, 0, 0], [0.0, 0, 0], [3.0, 0, -1.0]]
    rope = jc.FrictionCables(links=[[0, 1, 2]], axial_stiffness=1e6, friction=0.1)
    springs = jc.Springs([1], (1e6, 1e6, 1e6))
    structure = jc.Structure(nodes, {"stay": rope, "bar": springs}, jc.pinned([0, 2]))
    loose = jc.SupportMovement([2], (-0.1, 0.0, 0.0))
    phases = [jc.Phase(pretension={"stay": 1e4}, clamped=1), jc.Phase(loads=loose)]
    solution = converged(jc.solve(structure, phases))
    left, right = of_segments(solution)
    assert right == 0 < left
    figure = jc.plots.net(solution, structure=structure)
    _, taut, slack = figure.axes[1].collections[1:4]
    np.testing.assert_allclose(taut.get_array(), [left], rtol=1e-12)
    assert len(slack.get_segments()) == 1


def test_the_page_has_the_tensions_of_segments(stay):
    structure, solution, tensions = stay
    told, arrays = decoded(jc.plots.view(solution, None, structure=structure))
    ends = [k for k, shot in enumerate(told["shots"]) if shot["end"]]
    np.testing.assert_allclose(arrays["segment_tension"][ends], tensions, rtol=2e-7)  # float32
    labels = [column["label"] for column in told["columns"]]
    assert {"tension", "slip 0", "friction_used 1"} <= set(labels)
    assert not any(label.startswith("segment_tension") for label in labels)


def test_tension_along_a_stay(stay):
    _, solution, tensions = stay
    figure = jc.plots.tension_along(solution, "stay", phases=[1, -1], names=["p", "on", "off"])
    (axes,) = figure.axes
    steps = [line for line in axes.lines if line.get_label() in ("on", "off")]
    for line, k in zip(steps, (1, 2), strict=True):
        edges, values = (x.reshape(-1, 2) for x in line.get_data())
        np.testing.assert_allclose(values.T, np.tile(tensions[k] / 1e3, (2, 1)), rtol=1e-12)
        chain = np.asarray(solution.phases[k].positions)
        lengths = np.linalg.norm(np.diff(chain, axis=0), axis=1)
        np.testing.assert_allclose(np.diff(edges)[:, 0], lengths, rtol=1e-12)
    # a dot at the saddle, and a square at the clip, which the load has pulled
    assert legend_texts(figure) == ["on", "off", "friction fully used", "clamp"]
    dots = [line.get_marker() for line in axes.lines if len(line.get_xdata()) and line not in steps]
    assert set(dots) == {"o", "s"}
    assert axes.get_xlabel() == "length from the first end (m)"
    assert axes.get_ylabel() == "tension (kN)"
    imperial = jc.plots.tension_along(solution, units="kip, ft")
    assert imperial.axes[0].get_ylabel() == "tension (kip)"
    assert legend_texts(imperial)[:3] == ["phase 1", "phase 2", "phase 3"]


def test_tension_along_a_hanging_cable(lines):
    """It rises towards the pulleys, with dots where friction is fully used."""
    (axes,) = jc.plots.tension_along(lines[1]).axes
    ends = np.asarray(lines[1].element_results["end_tensions"]["lines"][0])
    _, values = axes.lines[0].get_data()
    np.testing.assert_allclose(values, ends.ravel(), rtol=1e-12)  # below 10 kN in N
    assert values[0] < values[1] and values[4] > values[5]
    used = np.abs(lines[1].element_results["friction_used"]["lines"][0])
    dots = sum(len(marks.get_xdata()) for marks in axes.lines[1:])
    assert dots == np.count_nonzero(used > 1 - 1e-6) > 0


def test_a_report_has_the_tension_along_the_cable_with_the_largest_drop(stay, lines):
    """Of the stay, with the names of its phases; and of the line of three spans, not of two."""
    structure, solution, _ = stay
    names = ["prestress", "a load of a name that is long", "load taken away, and again a long name"]
    pictures = jc.plots.for_report(structure, solution, names=names)
    assert list(pictures)[1:] == [
        "Forces at the end of the first and the last phase",
        "Tension along stay, element 0",
    ]
    _, forces, along = pictures.values()
    titles = [axes.get_title() for axes in forces.axes[:2]]
    assert titles[0].startswith("prestress") and titles[1].startswith("load taken")
    assert legend_texts(along)[:3] == names
    along.canvas.draw()
    (legend,) = (axes.get_legend() for axes in along.axes)
    assert legend.get_window_extent().width < along.bbox.width  # nothing is cut off
    with pytest.raises(ValueError, match="names: 2 of them, but 3 phases"):
        jc.plots.for_report(structure, solution, phase_names=names[:2])
    ((cable, caption, phases),) = cables_with_largest_drop(lines[1])
    ends = np.array([own.ends.mean() for own in lines[2].values()])  # of three and two segments
    drops = np.ptp(ends[:3]), np.ptp(ends[3:])
    most = int(np.argmax(drops))
    assert cable == {"group": "lines", "element": most} and phases == [0]
    assert caption == f"Tension along lines, element {most}: the largest drop of 2 cables"


def test_tension_along_refuses(stay):
    for message, options in (
        ("group = 'saddle': is no group of cables with friction; there are", {"group": "saddle"}),
        ("element = 1: there are elements 0 to 0", {"element": 1}),
        ("phase = 3: there are phases 0 to 2", {"phases": [3]}),
        ("names: 1 of them, but 3 phases", {"names": ["on"]}),
        ("phases: the cable is in none of them", {"phases": []}),
    ):
        with pytest.raises(ValueError, match=message):
            jc.plots.tension_along(stay[1], **options)


@pytest.fixture(scope="module")
def lines():
    """Two hanging lines of three and two segments, and points along each of these apart."""
    structure, solution = hung_lines.solved()
    return structure, solution, hung_lines.integrated(solution)


def points_along(cable, count):
    return np.array([cable.at(part * cable.length) for part in np.linspace(0.0, 1.0, count)])


def test_hanging_segments_are_drawn_as_catenaries(lines):
    """Each has its own color; the mast, drawn before them, stays straight."""
    structure, solution, cables = lines
    figure = jc.plots.net(solution, structure=structure, loads=False)
    taut = figure.axes[0].collections[2]
    drawn = [np.asarray(line) for line in taut.get_segments()]
    assert [len(line) for line in drawn] == [2, *5 * [25]]
    for line, cable in zip(drawn[1:], cables.values(), strict=True):
        # 1e-8 m of lengths of 360 m: tensions are found to 1e-10 of the largest
        np.testing.assert_allclose(line, points_along(cable, 25)[:, [0, 2]], atol=1e-8)
    tensions = np.array([cable.ends.mean() for cable in cables.values()])
    np.testing.assert_allclose(taut.get_array()[1:], tensions, rtol=1e-8)  # below 10 kN in N


def test_hanging_segments_on_the_page(lines):
    structure, solution, cables = lines
    _, arrays = decoded(jc.plots.view(solution, None, structure=structure))
    np.testing.assert_array_equal(arrays["sagging"], [1, 2, 3, 4, 5])  # pieces; the mast is 0
    for sag, cable in zip(arrays["sag"][-1], cables.values(), strict=True):
        points = points_along(cable, len(sag) + 2)
        part = np.linspace(0.0, 1.0, len(points))[:, None]
        chord = (1 - part) * points[0] + part * points[-1]
        # numbers of 32 bits, of sags of some meters
        np.testing.assert_allclose(sag, (points - chord)[1:-1], atol=1e-6)
    assert np.abs(arrays["sag"]).max() > 1.0
