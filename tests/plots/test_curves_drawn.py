"""Curves, diagrams of section forces and arrows: by the vertices that are drawn."""

import jax
import numpy as np
import pytest
import scenes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.quiver import Quiver
from oracles.convergence import converged
from PIL import Image

import jaxcable as jc
from jaxcable.plots import element_curves, snapshots, symbols, views

SECTION = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
RIGIDITY = 10e9 * 0.1 * 0.2**3 / 12
LENGTH, LOAD = 4.0, 50.0
# a catenary between levelled supports: half its length, horizontal force, weight, stiffness
HALF, PULL, WEIGHT, STIFFNESS = 60.0, 6000.0, 30.0, 60e6


def loaded(structure, *forces):
    """A phase for each force on node 1; the tie is taken away in the first one."""
    first, *others = (jc.Phase(loads=jc.NodalLoads([1], force)) for force in forces)
    solution = converged(jc.solve(structure, [jc.replace(first, removes="tie"), *others]))
    return structure, solution


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


def deflection(x, load=LOAD):
    """Of a cantilever, ``P x^2 (3 L - x) / 6 EI``."""
    return -load * x**2 * (3 * LENGTH - x) / (6 * RIGIDITY)


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
@pytest.mark.parametrize("magnify", [1.0, 20.0])
def test_a_cantilever_is_bent(cantilever, magnify):
    """``P x^2 (3 L - x) / 6 EI`` under the first load, from there on magnified."""
    structure, solution = cantilever
    figure = jc.plots.net(solution, structure=structure, magnify=magnify)
    for axes, factor in zip(figure.axes[:2], (1.0, 1.0 + magnify), strict=True):
        (line,) = colored(axes)
        x = np.linspace(0.0, LENGTH, len(line))
        expected = factor * deflection(x)
        # the cubic is of small rotations, here 6e-4: the load at the end shortens by their square
        np.testing.assert_allclose(line[:, 1], expected, rtol=1e-4, atol=1e-6 * LENGTH)
        np.testing.assert_allclose(line[:, 0], x, atol=1e-5 * LENGTH * factor)
    assert all(len(line) == 2 for line in colored(jc.plots.net(solution).axes[0]))


@pytest.mark.slow
def test_sequences_and_diagrams_have_the_same_curves(cantilever, rope):
    for structure, solution in (cantilever, rope):
        stages = jc.plots.sequence(solution, structure=structure).axes
        net = jc.plots.net(solution, structure=structure).axes
        for one, other in zip(stages[:2], net[:2], strict=True):
            np.testing.assert_allclose(colored(one), colored(other), atol=1e-12)
    # before the first phase catenaries are not known: no ghosts; then they are where they were
    ghosts = [part.collections[0].get_segments() for part in stages[:2]]
    assert len(ghosts[0]) == 0
    np.testing.assert_allclose(ghosts[1], colored(stages[0]), atol=1e-12)
    structure, solution = cantilever
    figure = jc.plots.diagram(solution, structure=structure, names=["a", "both loads"])
    assert figure.axes[0].get_title() == "My (N m), both loads"
    lines = (part for part in figure.axes[0].collections if isinstance(part, LineCollection))
    (axis,) = (part.get_segments()[0] for part in lines if part.get_linewidth()[0] == 1.4)
    net = jc.plots.net(solution, structure=structure).axes
    np.testing.assert_allclose(axis, colored(net[1])[0], atol=1e-12)


@pytest.mark.slow
def test_increments_have_curves(cantilever, rope, tmp_path):
    structure, solution = cantilever
    found = [element_curves.SolutionCurves(solution, structure).in_increment(k, 0) for k in (0, 1)]
    for k, curves in enumerate(found):
        x = np.linspace(0.0, LENGTH, curves.offsets.shape[1])
        place = np.asarray(solution.phases[k].positions)
        drawn = curves.points(place)[0, :, 2]
        expected = deflection(x, (k + 1) * LOAD)
        np.testing.assert_allclose(drawn, expected, rtol=1e-4, atol=1e-6 * LENGTH)
    structure, solution = rope
    made = jc.plots.animation(
        solution, tmp_path / "rope.gif", structure=structure, names=["hung", "loaded"], dpi=40
    )
    with Image.open(made) as gif:
        assert gif.n_frames == 2


@pytest.mark.slow
def test_magnified_after_another_analysis(cantilever):
    """Two phases, or the second one after an analysis of the first one: one deflected line.

    Displacements and rotations count from the nodes of the input, magnified 40 times.
    """
    structure, both = cantilever
    _, first = loaded(structure, (0.0, 0.0, -LOAD))
    load = jc.NodalLoads([1], (0.0, 0.0, -LOAD))
    second = converged(jc.solve(structure, jc.Phase(loads=load), start=first))
    x = np.linspace(0.0, LENGTH, element_curves.PLACES)
    pictures = [
        jc.plots.sequence(both, magnify=40.0, structure=structure).axes[1],
        jc.plots.sequence(second, magnify=40.0, structure=structure).axes[0],
        jc.plots.net(second, magnify=40.0, structure=structure).axes[1],
    ]
    for axes in pictures:
        # end shortened by the rotation, w'^2, and magnified: 40 * 3e-5 m; of 40 * 3 mm
        (line,) = colored(axes)
        np.testing.assert_allclose(line[:, 1], 40 * deflection(x, 2 * LOAD), atol=2e-4)
    shots = snapshots.Snapshots(second, structure).increments(9)
    np.testing.assert_allclose(shots[-1].positions, second.positions, atol=1e-12)


@pytest.mark.slow
def test_a_cable_that_is_added_hangs_in_all_increments():
    """Its shape is known from the phase that adds it, not from the end of the phase before."""
    nodes = [[0.0, 0, 0], [100.0, 0, 0], [0, 50.0, 0], [100.0, 50.0, 0]]
    cables = jc.Catenaries([[0, 1], [2, 3]], STIFFNESS, weight=WEIGHT)
    structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 1, 2, 3]))
    hang = jc.Phase(sag=jc.only([0], 5.0), loads=jc.SelfWeight())
    add = jc.Phase(adds=jc.only([1]), sag=jc.only([1], 5.0), increments=2)
    solution = converged(jc.solve(structure, [hang, add]))
    shots = snapshots.Snapshots(solution, structure).increments(9)
    assert [shot.curves.is_known.tolist() for shot in shots] == [
        [True, False],
        [True] * 2,
        [True] * 2,
    ]
    middle = shots[1].curves.offsets[:, 12, 2]
    np.testing.assert_allclose(middle, -5.0, rtol=1e-3)  # between the ends by unstressed length


@pytest.mark.slow
def test_pressed_curves(cantilever):
    """A strut that bends has a casing along its curve."""
    structure, solution = loaded(cantilever[0], (-1e3, 0.0, -LOAD))
    axes = jc.plots.net(solution, structure=structure).axes[0]
    casing, taut, slack = axes.collections[1:4]  # after the ghost
    assert len(casing.get_segments()) == len(taut.get_segments()) == 1
    np.testing.assert_allclose(casing.get_segments()[0], taut.get_segments()[0])
    assert len(casing.get_segments()[0]) > 10 and len(slack.get_segments()) == 0


def test_nets_of_cables_have_no_curves_and_no_section_forces():
    """The lines of straight elements stay one array, whatever is known of the structure."""
    structure, phases = jc.scenes.flat_net()
    solution = converged(jc.solve(structure, phases))
    assert element_curves.SolutionCurves(solution, structure).after_phase(0) is None
    links = structure.elements.links.array, np.arange(12)
    drawn = element_curves.picture_lines(
        views.View("space"), np.asarray(solution.positions), links, None
    )
    assert drawn.shape == (12, 2, 3)
    for known in (structure, None):
        with pytest.raises(ValueError, match="has no beams"):
            jc.plots.diagram(solution, structure=known)


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
    with pytest.raises(ValueError, match="structure: needed for axes"):
        jc.plots.net(solution, axes=True)


@pytest.mark.parametrize("name", scenes.EVERY)
def test_arrows_are_a_modest_part_of_every_scene(name):
    """At most 0.14 of the extent, and 0.3 of what is seen in every direction of the picture."""
    scene = scenes.EVERY[name](*((20, 20) if name == "saddle" else ()))
    nodes = np.asarray(scene.structure.nodes)
    links = np.concatenate([g.links.array[:, :2] for g in scene.structure.groups])
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
    (key,) = arrows.legend()
    assert key.get_label() == f"largest load 5 N, {len(arrows.tails)} of 10000 drawn"
    few = symbols.ForceArrows("load", forces[:200], nodes[:200], view, nodes, links, push=True)
    assert len(few.tails) == 200 and few.legend()[0].get_label().endswith(" N")


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
    assert not symbols.ForceArrows("reaction", *at, push=False, least=1e3).legend()
    structure, phases = jc.scenes.flat_net()
    solution = converged(jc.solve(structure, phases))
    tiny = jc.replace(solution.last, reactions=1e-13 * solution.last.reactions)
    for state, count in ((solution.last, 1), (tiny, 0)):
        figure = jc.plots.net(solution, structure=structure, state=state, reactions=True)
        texts = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
        assert sum("reaction" in text for text in texts) == count


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
    assert "My positive" in names and "My negative" not in names


@pytest.mark.slow
def test_shear_is_constant_and_named(cantilever):
    structure, solution = cantilever
    figure = jc.plots.diagram(solution, "Vz", structure=structure)
    values = written(figure)
    assert np.abs(values) == pytest.approx(2 * LOAD, rel=1e-4) and len(set(np.sign(values))) == 1
    assert figure.axes[0].get_title() == "Vz (N), after loading"
    assert jc.plots.diagram(solution, "N", structure=structure, view="space").axes[0].name == "3d"


@pytest.mark.slow
def test_a_load_downward_bends_a_span_below():
    """A propped cantilever: 9 q L^2 / 128 in the span, below it; q L^2 / 8 at the clamp, above."""
    beam = jc.Beams([[0, 1]], section=SECTION)
    ends = jc.clamped([0]) + jc.restrained([1], "yz")
    structure = jc.Structure([[0.0, 0, 0], [6.0, 0, 0]], beam, supports=ends)
    solution = converged(jc.solve(structure, jc.Phase(loads=jc.LineLoads((0.0, 0.0, -1e3)))))
    figure = jc.plots.diagram(solution, structure=structure)
    values = written(figure)
    assert max(values) == pytest.approx(4500, rel=5e-3)
    assert min(values) == pytest.approx(-2531, rel=5e-3)
    positive, negative = areas(figure)
    assert positive[..., 1].max() > 0.1 and negative[..., 1].min() < -0.1


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


@pytest.mark.slow
def test_what_is_refused(cantilever):
    structure, solution = cantilever
    failed = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, np.nan))))
    assert int(failed.status) != 0
    batch = jax.tree.map(lambda x: x[None], solution)
    for draw in (jc.plots.net, jc.plots.diagram):
        with pytest.raises(ValueError, match="the analysis failed"):
            draw(failed, structure=structure)
        with pytest.raises(ValueError, match="batch"):
            draw(batch, structure=structure)
    with pytest.raises(ValueError, match="of = 'Q': expected one of N, Vy"):
        jc.plots.diagram(solution, of="Q")
    with pytest.raises(ValueError, match=r"high = 0.0: must be"):
        jc.plots.diagram(solution, high=0.0)
