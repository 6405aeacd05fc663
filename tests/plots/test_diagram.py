"""`plots.diagram`: section forces on the structure, with the sides and the numbers they have."""

import jax
import matplotlib.collections
import numpy as np
import pytest

import jaxcable as jc

SECTION = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))


@pytest.fixture(scope="module")
def cantilever():
    """4 m along x, z up, under 500 N downward at its end; a stay beside it that never bears."""
    nodes = [[0.0, 0, 0], [4.0, 0, 0], [4.0, 0, 3.0]]
    groups = {
        "beam": jc.Beams([[0, 1]], section=SECTION),
        "tie": jc.Cables([[1, 2]], axial_stiffness=1e3),
    }
    structure = jc.Structure(nodes, groups, supports=jc.clamped([0]) + jc.pinned([2]))
    load = jc.NodalLoads([1], (0.0, 0.0, -500.0))
    solution = jc.solve(structure, [jc.Phase(loads=load, removes="tie")])
    assert int(solution.status) == 0
    return structure, solution


def areas(figure):
    """Corners of all areas of a flat diagram, [n, 4, 2]."""
    found = [
        [path.vertices[:4] for path in part.get_paths()]
        for part in figure.axes[0].collections
        if isinstance(part, matplotlib.collections.PolyCollection)
    ]
    return [np.array(part) for part in found]


def written(figure):
    return [float(text.get_text()) for text in figure.axes[0].texts]


@pytest.mark.parametrize("known", [True, False])
def test_a_moment_lies_on_the_side_in_tension(cantilever, known):
    """P L = 2 kN m at the clamp, where the upper side is in tension; with or without axes."""
    structure, solution = cantilever
    figure = jc.plots.diagram(solution, structure=structure if known else None, high=0.25)
    assert written(figure)[0] == pytest.approx(2000, rel=2e-3)  # shortened by its deflection
    (part,) = areas(figure)
    assert (part[:, 2:, 1] >= part[:, :2, 1][:, ::-1] - 1e-9).all()  # above the axis
    assert part[..., 1].max() == pytest.approx(0.25 * 4.0, rel=2e-2)
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "My positive" in names and "My negative" not in names


def test_shear_is_constant_and_named(cantilever):
    structure, solution = cantilever
    figure = jc.plots.diagram(solution, "Vz", structure=structure)
    values = written(figure)
    assert np.abs(values) == pytest.approx(500, rel=2e-3) and len(set(np.sign(values))) == 1
    assert figure.axes[0].get_title() == "Vz (N), at the end"


def test_a_load_downward_bends_a_span_below(cantilever):
    """q L^2 / 8 in the middle of a span, drawn below it; hogging over a clamped end above."""
    beam = jc.Beams([[0, 1]], section=SECTION)
    ends = jc.clamped([0]) + jc.restrained([1], "yz")
    structure = jc.Structure([[0.0, 0, 0], [6.0, 0, 0]], beam, supports=ends)
    solution = jc.solve(structure, jc.Phase(loads=jc.LineLoads((0.0, 0.0, -1e3))))
    assert int(solution.status) == 0
    figure = jc.plots.diagram(solution, structure=structure)
    values = written(figure)
    # propped cantilever: q L^2 / 8 at the clamp, 9 q L^2 / 128 in the span
    assert max(values) == pytest.approx(4500, rel=5e-3)
    assert min(values) == pytest.approx(-2531, rel=5e-3)
    positive, negative = areas(figure)
    assert positive[..., 1].max() > 0.1 and negative[..., 1].min() < -0.1


def test_in_space_and_of_a_failed_analysis(cantilever):
    structure, solution = cantilever
    figure = jc.plots.diagram(solution, "N", structure=structure, view="space")
    assert figure.axes[0].name == "3d"
    pull = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -1e9)), removes="tie")
    failed = jc.solve(structure, [pull], jc.Newton(max_steps=1))
    assert int(failed.status) != 0
    with pytest.raises(ValueError, match="has failed"):
        jc.plots.diagram(failed)


@pytest.mark.parametrize(
    "options, said",
    [({"of": "Q"}, "of = 'Q': expected one of N, Vy"), ({"high": 0.0}, "high = 0.0: must be")],
)
def test_what_is_refused(cantilever, options, said):
    with pytest.raises(ValueError, match=said):
        jc.plots.diagram(cantilever[1], **options)


def test_nets_have_no_section_forces():
    structure, phases = jc.scenes.flat_net()
    solution = jc.solve(structure, phases)
    assert int(solution.status) == 0
    for known in (structure, None):
        with pytest.raises(ValueError, match="has no beams"):
            jc.plots.diagram(solution, structure=known)
    with pytest.raises(ValueError, match="batch"):
        jc.plots.diagram(jax.tree.map(lambda x: x[None], solution))
