"""Pictures of a structure before any analysis: numbers are where they belong, none is covered."""

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from mpl_toolkits.mplot3d import proj3d
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.__main__ import main
from jaxcable.plots.style import INK, SERIES

MAST = jc.Structure(
    [[0.0, 0, 0], [0, 0, 6.0], [0, 0, 12.0], [5.0, 0, 0], [-5.0, 3.0, 0], [-5.0, -3.0, 0]],
    {
        "mast": jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e8),
        "guys": jc.Cables([[2, 3], [2, 4], [2, 5]], axial_stiffness=1e6),
        "ground": jc.Springs([0], stiffness=1e5),
    },
    supports=jc.pinned([3, 4, 5]) + jc.restrained([0, 1], "xy"),
)


def written(figure):
    """Return numbers with their colors and places, in pixels, a list."""
    figure.draw_without_rendering()
    (axes,) = figure.axes
    return [(t.get_text(), to_rgba(t.get_color()), t.get_window_extent()) for t in axes.texts]


def pixels_of(axes, position):
    """Return where a position is in the picture of axes in space, in pixels."""
    x, y, _ = proj3d.proj_transform(*position, axes.get_proj())
    return axes.transData.transform((x, y))


def test_numbers_are_beside_their_nodes_and_on_their_elements():
    """Numbers of elements are at the projection of their middles, within half a millimeter."""
    figure = jc.plots.model(MAST)
    found = written(figure)
    nodes = [(text, box) for text, color, box in found if color == to_rgba(INK)]
    assert [text for text, _ in nodes] == list("012345")
    (axes,) = figure.axes
    for text, box in nodes:
        away = np.array([box.x0, box.y0]) - pixels_of(axes, MAST.nodes[int(text)])
        assert (away > 0).all() and (away < 0.2 * figure.dpi).all()
    for number, name in enumerate(sorted(MAST.elements)):  # the order of groups
        group = MAST.elements[name]
        own = {text: box for text, color, box in found if color == to_rgba(SERIES[number])}
        assert list(own) == [str(k) for k in range(len(group.links))]
        for k, chain in enumerate(group.links.array):
            middle = (
                np.array([own[str(k)].x0 + own[str(k)].x1, own[str(k)].y0 + own[str(k)].y1]) / 2
            )
            at = pixels_of(axes, np.mean([MAST.nodes[node] for node in chain], axis=0))
            away = np.linalg.norm(middle - at) / figure.dpi  # inches: letters have parts below
            assert away < (0.02 if len(chain) > 1 else 0.2)


def test_no_number_covers_another_and_the_title_counts_the_others():
    """A net of 10 x 10 cells: boxes of all texts that are written are apart."""
    net = jc.scenes.saddle_net().structure
    figure = jc.plots.model(net)
    boxes = [box for _, _, box in written(figure)]
    # digits have no parts below the line: boxes of texts are higher than what is drawn
    drawn = [box.shrunk(0.9, 0.75) for box in boxes]
    for k, box in enumerate(drawn):
        assert not any(box.overlaps(other) for other in drawn[:k])
    total = net.n_node + sum(len(group.links) for group in net.groups)
    left_out = total - len(boxes)
    assert left_out > 0 and f"numbers left out: {left_out}" in figure.axes[0].get_title()


def test_the_command_draws_without_an_analysis(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    slack = jc.Phase(pretension={"guys": 1e3})
    jc.save_scene("mast.json", (MAST, [slack]))
    monkeypatch.setattr("jaxcable.cli.plot.solve_and_show", None)  # not called
    assert main(["plot", "mast.json", "--of", "model", "--save", "m.svg"]) == 0
    assert capsys.readouterr().out == "wrote m.svg\n"
    assert "<svg" in (tmp_path / "m.svg").read_text()
    assert main(["plot", "mast.json", "--of", "model", "--reactions"]) == 2
    assert "--reactions: not for diagrams and --of model" in capsys.readouterr().err


@pytest.mark.parametrize("gap", [" ", "_"])
def test_long_names_and_titles_stay_within_the_picture(gap):
    """Names of groups and phases of 200 characters, with spaces and without."""
    name = gap.join(["cables of the northern hall".replace(" ", gap)] * 8)[:200]
    structure, phases = jc.scenes.flat_net()
    named = jc.replace(structure, elements={name: structure.elements})
    solution = converged(jc.solve(named, phases))
    for figure in (jc.plots.model(named), jc.plots.net(solution, names=[name, name[::-1]])):
        figure.canvas.draw()
        parts = [*figure.legends, *(axes.title for axes in figure.axes)]
        shown = [text for legend in figure.legends for text in legend.get_texts()]
        assert any(text.get_text()[:20] == name[:20] for text in [*shown, *parts[1:]])
        for part in parts:
            box = part.get_window_extent()
            assert box.x0 >= 0 and box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1


def test_layers_that_cover_each_other_in_plan_are_drawn_in_space_too():
    """Two levels of a frame: half of the nodes lie above the others; black is for nodes alone."""
    plan = [[x, y] for x in (0.0, 10.0) for y in (0.0, 10.0)]
    nodes = [[*place, z] for z in (0.0, 1.0) for place in plan]
    names = [f"posts {k}" for k in range(8)]  # more than there are colors
    groups = {name: jc.Bars([[k % 4, 4 + k % 4]], 1e6) for k, name in enumerate(names)}
    frame = jc.Structure(nodes, groups, jc.pinned(range(8)))
    figure = jc.plots.model(frame)
    assert [axes.name for axes in figure.axes] == ["rectilinear", "3d"]
    assert figure.axes[1].get_title() == "structure: space" and not figure.axes[1].texts
    lines = [line for line in figure.legends[0].get_lines() if line.get_linestyle() != "None"]
    assert len(lines) == 8 and to_rgba("black") not in {to_rgba(x.get_color()) for x in lines}
    assert labels_of_heights(figure)


def labels_of_heights(figure):
    """Return the numbers on the upright axis of the last axes, none of which covers another."""
    figure.draw_without_rendering()
    axis = figure.axes[-1].zaxis
    low, high = figure.axes[-1].get_zlim()
    found = [t.label1 for t in axis.get_major_ticks() if low <= t.get_loc() <= high]
    boxes = [text.get_window_extent() for text in found]
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
    return found
