"""Curves, diagrams of section forces and arrows: by the vertices that are drawn."""

import warnings

import numpy as np
import pytest
import scenes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.quiver import Quiver
from oracles.convergence import converged
from test_view import decoded

import jaxcable as jc
from jaxcable.model.result_parts import straight_pieces
from jaxcable.plots import element_curves, snapshots, symbols, views

SECTION = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
RIGIDITY = 10e9 * 0.1 * 0.2**3 / 12
LENGTH, LOAD = 4.0, 50.0
# a catenary between levelled supports: half its length, horizontal force, weight, stiffness
HALF, PULL, WEIGHT, STIFFNESS = 60.0, 6000.0, 30.0, 60e6


def loaded(structure, *forces):
    """A phase for each force on node 1; the tie is taken away in the first one."""
    first, *others = (jc.Phase(loads=jc.NodalLoads([1], force)) for force in forces)
    return structure, converged(jc.solve(structure, [jc.replace(first, removes="tie"), *others]))


@pytest.fixture(scope="module")
def cantilever():
    """4 m along x in one element, under a small load at its end, twice; a stay is not there."""
    groups = {
        "beam": jc.Beams([[0, 1]], section=SECTION),
        "tie": jc.Cables([[1, 2]], axial_stiffness=1e3),
    }
    nodes = [[0, 0, 0], [LENGTH, 0, 0], [LENGTH, 0, 3.0]]
    structure = jc.Structure(nodes, groups, supports=jc.clamped([0]) + jc.pinned([2]))
    return loaded(structure, *2 * [(0.0, 0.0, -LOAD)])


@pytest.fixture(scope="module")
def rope():
    """A catenary with a node in its middle, under its weight, then under a load there."""
    half = PULL / WEIGHT * np.arcsinh(WEIGHT * HALF / PULL) + PULL * HALF / STIFFNESS
    nodes = [[-half, 0.0, 9.0], [0.0, 0.0, 0.0], [half, 0.0, 9.0]]
    cables = jc.Catenaries(
        [[0, 1], [1, 2]], axial_stiffness=STIFFNESS, weight=WEIGHT, rest_length=HALF
    )
    structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
    push = jc.NodalLoads([1], (500.0, 0.0, -1000.0))
    solution = jc.solve(structure, [jc.Phase(loads=jc.SelfWeight()), jc.Phase(loads=push)])
    assert int(solution.status) == 0
    return structure, solution


def colored(axes):
    """Vertices of the lines that have a color by value, a list of [n_place, 2]."""
    lines = next(c for c in axes.collections if c.get_array() is not None)
    return [np.asarray(segment) for segment in lines.get_segments()]


def deflection(x):
    """Of a cantilever, ``P x^2 (3 L - x) / 6 EI``."""
    return -LOAD * x**2 * (3 * LENGTH - x) / (6 * RIGIDITY)


def hanging(s):
    """Place of a catenary at a length s from its lowest point, elastic, closed form."""
    stretch = WEIGHT * s / PULL
    x = PULL / WEIGHT * np.arcsinh(stretch) + PULL * s / STIFFNESS
    z = PULL / WEIGHT * (np.sqrt(1 + stretch**2) - 1) + WEIGHT * s**2 / (2 * STIFFNESS)
    return np.stack([x, z], axis=-1)


@pytest.mark.slow
def test_a_catenary_is_drawn_as_one(rope):
    """Between nodes where the closed form has them, the line is the closed form."""
    structure, solution = rope
    axes = jc.plots.net(solution, structure=structure).axes
    left, right = colored(axes[0])
    s = np.linspace(0.0, HALF, len(right))
    depth = hanging(HALF)[1] - 9.0  # the supports are at 9 m, so the lowest point is below 0
    expected = hanging(s) - [0.0, depth]
    span = 2 * hanging(HALF)[0]
    # 1e-6 of the span: the middle node is in equilibrium to 1e-10 of the forces
    np.testing.assert_allclose(right, expected, atol=1e-6 * span)
    np.testing.assert_allclose(left, expected[::-1] * [-1.0, 1.0], atol=1e-6 * span)
    assert len(right) > 10
    chord = right[0] + np.linspace(0, 1, len(s))[:, None] * (right[-1] - right[0])
    assert np.abs(right - chord).max() > 1e-2 * span  # the control: it is no chord
    assert all(len(line) == 2 for line in colored(jc.plots.net(solution).axes[0]))


@pytest.mark.slow_cases("1.0")
@pytest.mark.parametrize("magnify", [1.0, 3.0])
def test_curves_end_in_the_nodes(rope, magnify):
    """Every point of a cable moves by the factor, as the nodes do."""
    structure, solution = rope
    figure = jc.plots.net(solution, structure=structure, magnify=magnify)
    before, after = (np.array(colored(axes)) for axes in figure.axes[:2])
    start, end = (np.asarray(phase.positions)[:, [0, 2]] for phase in solution.phases)
    nodes = start + magnify * (end - start)
    np.testing.assert_allclose(after[:, 0], nodes[:2], atol=1e-9)
    np.testing.assert_allclose(after[:, -1], nodes[1:], atol=1e-9)
    exact = np.asarray(jc.forms.catenary_curves(structure, solution, n=before.shape[1]))[..., ::2]
    np.testing.assert_allclose(after, before + magnify * (exact - before), atol=1e-6)


@pytest.mark.slow
def test_beams_are_bent_and_magnified_also_after_another_analysis(cantilever):
    """``P x^2 (3 L - x) / 6 EI`` after two phases, or one after an analysis of the first one.

    Displacements and rotations count from the nodes of the input, magnified 40 times.
    """
    structure, both = cantilever
    _, first = loaded(structure, (0.0, 0.0, -LOAD))
    load = jc.NodalLoads([1], (0.0, 0.0, -LOAD))
    second = converged(jc.solve(structure, jc.Phase(loads=load), start=first))
    x = np.linspace(0.0, LENGTH, element_curves.PLACES)
    for axes, factor, near in (
        (jc.plots.net(both, structure=structure).axes[0], 1.0, 4e-6),  # after the first phase
        (jc.plots.sequence(both, magnify=40.0, structure=structure).axes[1], 80.0, 2e-4),
        (jc.plots.sequence(second, magnify=40.0, structure=structure).axes[0], 80.0, 2e-4),
        (jc.plots.net(second, magnify=40.0, structure=structure).axes[1], 80.0, 2e-4),
    ):
        # end shortened by the rotation, w'^2, and magnified: 40 * 3e-5 m; of 40 * 3 mm
        (line,) = colored(axes)
        np.testing.assert_allclose(line[:, 1], factor * deflection(x), rtol=1e-4, atol=near)
        np.testing.assert_allclose(line[:, 0], x, atol=4e-5 * factor)
    assert all(len(line) == 2 for line in colored(jc.plots.net(both).axes[0]))
    shots = snapshots.Snapshots(second, structure).increments(9)
    np.testing.assert_allclose(shots[-1].positions, second.positions, atol=1e-12)


def test_nets_of_cables_have_no_curves_and_no_section_forces():
    """The lines of straight elements stay one array, whatever is known of the structure."""
    structure, phases = jc.scenes.flat_net()
    solution = converged(jc.solve(structure, phases))
    assert element_curves.SolutionCurves(solution, structure).at_state(solution.last) is None
    links = structure.elements.links.array, np.arange(12)
    drawn = element_curves.picture_lines(
        views.View("space"), np.asarray(solution.positions), links, None
    )
    assert drawn.shape == (12, 2, 3)


def test_axes_of_sections(cantilever):
    """x along the beam, z up, y away from who looks, of one length that leaves room."""
    structure, solution = cantilever
    plain = jc.plots.net(solution, structure=structure)
    figure = jc.plots.net(solution, structure=structure, axes=True)
    texts = [[t.get_text() for t in f.legends[0].get_texts()] for f in (plain, figure)]
    assert texts[1] == [*texts[0], "section axis x", "section axis y", "section axis z"]
    space = figure.axes[1]
    drawn = [part for part in space.collections if isinstance(part, LineCollection)]
    lines = [part.get_segments() for part in drawn[-3:]]
    assert [len(part) for part in lines] == [1, 0, 1]
    (x,), _, (z,) = lines
    middle = colored(space)[0][12]
    np.testing.assert_allclose([x[0], z[0]], [middle] * 2)
    np.testing.assert_allclose(x[1] - x[0], [0.05 * LENGTH, 0.0], atol=1e-3)  # it has turned
    np.testing.assert_allclose(z[1] - z[0], [0.0, 0.05 * LENGTH], atol=1e-3)
    dots = [line for line in space.lines if line.get_marker() == "."]
    assert len(dots) == 1  # y, seen end on


@pytest.mark.parametrize("name", scenes.EVERY)
def test_arrows_are_a_modest_part_of_every_scene(name):
    """At most 0.14 of the extent, and 0.3 of what is seen in every direction of the picture."""
    scene = scenes.EVERY[name](*((20, 20) if name == "saddle" else ()))
    nodes = np.asarray(scene.structure.nodes)
    links = straight_pieces(scene.structure.groups)[0]
    rng = np.random.default_rng(len(name))
    extent = np.ptp(nodes, axis=0).max()
    fields = {
        "down": np.array([0.0, 0.0, -1e3]) * rng.uniform(0.1, 1.0, (len(nodes), 1)),
        "any": rng.normal(size=(len(nodes), 3)) * 10.0 ** rng.uniform(0, 6, (len(nodes), 1)),
    }
    for kind in ("elevation", "space"):
        view = views.choose_view(nodes, kind)
        size = np.ptp(view.project(nodes), axis=0)
        room = 0.3 * np.maximum(size, (0.15 if view.flat else 0.4) * extent)
        for forces in fields.values():
            arrows = symbols.ForceArrows("load", forces, nodes, view, nodes, links, push=True)
            longest = np.linalg.norm(arrows.vectors, axis=1).max()
            assert longest <= 0.14 * extent * (1 + 1e-9)
            parts = np.abs(view.project(arrows.vectors)).max(axis=0)
            assert (parts <= room * (1 + 1e-9)).all()
            # and not smaller than it has to be: one of the bounds is reached
            many = 0.8 / np.sqrt(len(arrows.tails))
            reached = [longest / (extent * min(0.14, many)), *(parts / room)]
            assert max(reached) == pytest.approx(1.0, rel=1e-9)
            # the picture stays that of the structure
            everything = np.concatenate([nodes, arrows.ends])
            assert (np.ptp(view.project(everything), axis=0) <= size + 2 * room + 1e-9).all()


def test_many_arrows_are_thinned():
    """Of 10 000 at most 250, with the largest of all among them; the legend counts them."""
    x, y = (a.ravel() for a in np.meshgrid(*2 * [np.arange(100.0)]))
    nodes = np.stack([x, y, 0 * x], axis=1)
    forces = np.zeros((10_000, 3))
    forces[:, 2] = -np.random.default_rng(3).uniform(1.0, 2.0, 10_000)
    forces[4321, 2] = -5.0
    links = np.array([[0, 1]])
    view = views.choose_view(nodes, "space")
    arrows = symbols.ForceArrows("load", forces, nodes, view, nodes, links, push=True)
    assert 100 <= len(arrows.tails) <= 250
    tips = arrows.tails + arrows.vectors
    assert (tips == nodes[4321]).all(axis=1).any()
    (key,) = arrows.legend_entries()
    assert key.get_label() == f"largest load 5 N, {len(arrows.tails)} of 10000 drawn"
    few = symbols.ForceArrows("load", forces[:200], nodes[:200], view, nodes, links, push=True)
    assert len(few.tails) == 200 and few.legend_entries()[0].get_label().endswith(" N")


def test_arrows_keep_off_the_elements():
    """The reaction of a mast comes from below, that of a cable pulls; between two there is none."""
    nodes = np.array([[0.0, 0, 0], [0, 0, 5.0], [0, 0, 10.0], [8.0, 0, 0]])
    links = np.array([[0, 1], [1, 2], [2, 3]])
    view = views.choose_view(nodes, "elevation")
    force = np.array([[0.0, 0, 9.0], [0, 0, 9.0], [0, 0, 9.0], [4.0, 0, -5.0]])
    reactions = symbols.ForceArrows("reactions", force, nodes, view, nodes, links, push=False)
    tips = reactions.tails + reactions.vectors
    np.testing.assert_allclose(tips[0], nodes[0], atol=1e-12)  # ends at the foot
    np.testing.assert_allclose(reactions.tails[1:], nodes[1:])  # begin at the others
    assert reactions.under.tolist() == [False, True, False, False]
    loads = symbols.ForceArrows("load", -force, nodes, view, nodes, links, push=True)
    np.testing.assert_allclose((loads.tails + loads.vectors)[2], nodes[2], atol=1e-12)
    assert loads.tails[2, 2] > 10.0  # stands on the top
    figure = jc.plots.style.new_figure(3, 3, None)
    axes = view.add_axes(figure, nodes, "")
    reactions.draw(axes, view)
    orders = [(q.zorder, q.N) for q in axes.collections if isinstance(q, Quiver)]
    assert orders == [(1.5, 1), (6, 3)]  # one under the elements, at 3, the others above


@pytest.mark.slow
def test_reactions_of_rounding_size_have_no_arrows():
    """A ring that is prestressed in itself: 1 kN in its bars, 1e-13 kN at its supports."""
    nodes = np.array([[0.0, 0, 0], [2.0, 0, 0], [0.0, 1e-13, 0]])
    view = views.choose_view(nodes, "plan")
    force = np.array([[0.0, 0, 0], [1e-10, 0, 0], [0, 1e-13, 0]])
    at = force, nodes, view, nodes, np.array([[0, 1]])
    assert len(symbols.ForceArrows("reaction", *at, push=False).tails) == 2
    assert not symbols.ForceArrows("reaction", *at, push=False, negligible=1e3).legend_entries()
    structure, phases = jc.scenes.flat_net()
    solution = converged(jc.solve(structure, phases))
    tiny = jc.replace(solution.last, reactions=1e-13 * solution.last.reactions)
    for state, count in ((solution.last, 1), (tiny, 0)):
        figure = jc.plots.net(solution, structure=structure, state=state, reactions=True)
        texts = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
        assert sum("reaction" in text for text in texts) == count


def test_forces_of_slack_structures_are_not_drawn():
    """A load that is taken off; and a net that is slack from the beginning."""
    nodes = [[-1.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, 0]]
    net = jc.Cables([[0, 4], [1, 4], [2, 4], [3, 4]], axial_stiffness=100e3)
    structure = jc.Structure(nodes, net, jc.pinned([0, 1, 2, 3]))
    on, off = (jc.Phase(loads=jc.NodalLoads([4], (0, 0, f))) for f in (-10.0, 10.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jc.UnstableWarning)  # a flat net without prestress
        unloaded = converged(jc.solve(structure, [on, off]))
        slack = converged(jc.solve(structure, jc.Phase(shortening=-0.01)))
    # F = 2 EA w^3 of four links of 1 m, and T = EA w^2 / 2: 68 N; then a sag of some 1e-6 m is left
    assert 0 < np.abs(unloaded.reactions).max() < 0.5 * 100e3 * 1e-12
    assert not reaction_texts(unloaded) and reaction_texts(unloaded, phase=0)
    _, arrays = decoded(jc.plots.view(unloaded, None))
    held, shown = arrays["held"], arrays["reactions"]
    assert held.tolist() == [0, 1, 2, 3]
    assert shown[0].any(axis=1).all() and not shown[1].any()
    noise = np.where(np.arange(5)[:, None] < 4, 1e-115, 0.0) * np.ones(3)
    last = jc.replace(slack.last, reactions=noise)
    assert not reaction_texts(slack, state=last, structure=structure)
    # 1e-12 N are no rounding error beside EA = 1e5 N times 2e-16, of a structure as small as this
    tiny = jc.replace(structure, elements=jc.replace(net, axial_stiffness=1e-6))
    few = jc.replace(slack.last, reactions=1e103 * noise)
    assert not reaction_texts(slack, state=few, structure=structure)
    assert reaction_texts(slack, state=few, structure=tiny)


def reaction_texts(solution, **options):
    figure = jc.plots.net(solution, reactions=True, **options)
    texts = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    return [text for text in texts if "reaction" in text]


def test_the_page_has_moments_of_supports_without_forces():
    """A cantilever under a moment at its tip: the support has this moment, and no force."""
    section = jc.Section.linear(EA=1e8, EIy=1e5, EIz=1e5, GJ=1e5)
    beam = jc.Beams([[0, 1]], section=section)
    structure = jc.Structure([[0.0, 0, 0], [2.0, 0, 0]], beam, jc.clamped([0]))
    moment = jc.NodalLoads([1], (0.0, 0, 0), moments=(0.0, 100.0, 0))
    solution = converged(jc.solve(structure, jc.Phase(loads=moment)))
    _, arrays = decoded(jc.plots.view(solution, None, structure=structure))
    assert arrays["held"].tolist() == [0] and not arrays["reactions"].any()
    np.testing.assert_allclose(arrays["reaction_moments"][0, 0], [0, -100.0, 0], atol=1e-5)


# --- diagrams of section forces


def areas(figure):
    """Corners of all areas of a flat diagram, a list of [n, 4, 2]."""
    parts = (part for part in figure.axes[0].collections if isinstance(part, PolyCollection))
    return [np.array([path.vertices[:4] for path in part.get_paths()]) for part in parts]


def written(figure):
    return [float(text.get_text()) for text in figure.axes[0].texts]


@pytest.mark.slow_cases("True")
@pytest.mark.parametrize("known", [True, False])
def test_a_moment_lies_on_the_side_in_tension(cantilever, known):
    """P L at the clamp, where the upper side is in tension; with or without axes."""
    structure, solution = cantilever
    figure = jc.plots.diagram(solution, structure=structure if known else None, high=0.25)
    assert written(figure)[0] == pytest.approx(2 * LOAD * LENGTH, rel=1e-4)
    (part,) = areas(figure)
    assert (part[:, 2:, 1] >= part[:, :2, 1][:, ::-1] - 1e-9).all()  # above the axis
    assert part[..., 1].max() == pytest.approx(0.25 * LENGTH, rel=2e-2)
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "My positive (N m)" in names and "My negative (N m)" not in names


def test_a_frame_that_bends_about_z_only(cantilever):
    """Moments about y are nothing, whatever rounding leaves."""
    structure, solution = loaded(cantilever[0], (0.0, 400.0, 0.0))
    figure = jc.plots.diagram(solution, structure=structure)
    assert figure.axes[0].get_title() == "My (N m), at the end: zero" and written(figure) == []
    figure = jc.plots.diagram(solution, "Mz", structure=structure, view="plan")
    assert np.abs(written(figure)[0]) == pytest.approx(400.0 * LENGTH, rel=1e-2)
    (part,) = areas(figure)
    assert (part[:, 2:, 1] <= part[:, :2, 1][:, ::-1] + 1e-9).all()  # in tension, at y < 0
    assert np.ptp(part[..., 1]) > 0.1
