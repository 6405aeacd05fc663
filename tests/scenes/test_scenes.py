"""Scenes of cables and beams, and pictures of sections: loads and balance, what is refused."""

import numpy as np
import pytest
import scenes
from banks import problems
from oracles.convergence import converged

import jaxcable as jc


def solved(scene):
    """The solution of a scene; the analysis is fine, and reactions balance the loads."""
    solution = converged(jc.solve(*scene))
    problems.assert_balanced(solution)
    return solution


def assert_fibres_sum_to_section_forces(structure, solution, name, share):
    """Fibres against equilibrium; `share` of the largest: what deflects within an element.

    N times the deflection against its chord is in the forces and not in the curvatures. The order
    of the fibres and the point of a strain would be wrong by more than the forces themselves.
    """
    group = structure.elements[name]
    stress = np.asarray(jc.fibre_stress(structure, solution.phases[-1])[name])[-1]
    forces = np.asarray(solution.section_forces[name])
    y, z, area = (np.asarray(v) for v in (group.section.y, group.section.z, group.section.area))
    lever = np.stack([area, area * z, -area * y], axis=-1)
    size = np.abs(forces[..., [0, 4, 5]]).max((0, 1))
    apart = np.abs(stress @ lever - forces[..., [0, 4, 5]]).max((0, 1))
    assert (apart[:2] < np.array([1e-3, share]) * size[:2]).all() and apart[2] < 1e-6 * size[1]


def test_wind_on_a_mast():
    """0.5 kN/m at the foot to 1 kN/m at the top: on 15 m, and on half of that at the top."""
    _, (_, loading) = jc.scenes.guyed_mast(30.0, 1, per_level=2)
    wind = np.asarray(loading.loads.forces)
    np.testing.assert_allclose(wind[:, 0], [0.75 * 15e3, 7.5e3], rtol=1e-14)
    assert not wind[:, 1:].any()


@pytest.mark.slow
def test_guyed_mast():
    structure, phases = jc.scenes.guyed_mast(30.0, 1, per_level=2, increments=(1, 2))
    solution = solved((structure, phases))
    assert_fibres_sum_to_section_forces(structure, solution, "mast", 0.03)  # elements of 15 m
    first, last = (np.asarray(p.tension["guys"]) for p in solution.phases)
    # the windward guy (one of three) gains, the two others lose alike, by symmetry
    assert last[0] > first[0] and (last[1:] < first[1:]).all()
    assert abs(last[1] - last[2]) < 1e-6 * last[0]
    drift = np.asarray(solution.displacement - solution.phases[0].displacement)[1:3]
    assert (drift[:, 0] > 0).all() and np.abs(drift[:, 1]).max() < 1e-8
    # the foot takes the weight and what the guys pull down
    down = -np.asarray(solution.load)[:, 2].sum()
    assert float(solution.reactions[:, 2].sum()) == pytest.approx(down, rel=1e-8)
    assert float(solution.reactions[0, 2]) > down


def test_an_oblong_saddle_rises_and_falls_by_its_own_spans():
    """A tenth of 8 m up to the middles of two edges, and a tenth of 16 m down to the others."""
    x, y, z = np.asarray(jc.scenes.saddle(3, 7, spacing=2.0, rise=0.1).structure.nodes).T
    assert (x.max(), y.max()) == (8.0, 16.0)
    assert z.max() == pytest.approx(0.8) == z[(x == 0.0) & (y == 8.0)].item()
    assert z.min() == pytest.approx(-1.6) == z[(x == 4.0) & (y == 16.0)].item()


def test_sizes_of_the_saddle_net():
    structure, phases = jc.scenes.saddle_net()
    assert structure.n_node == 132 and len(structure.elements.links) == 201
    area = np.asarray(structure.elements.section.area)
    assert area.shape == (100,) and len(phases[1].loads.nodes) == 15 * 6
    assert area.sum() == pytest.approx(1963.5e-6, rel=1e-5)  # the paper's 19.63 cm2


WRONG = [
    ("tent_edge", {"reach": -6.0}, "lean, reach: guys would push"),
    ("isolated_cable", {"n": -1}, "n = -1"),
    ("guyed_mast", {"levels": 0}, "levels, per_level = 0, 4"),
    ("strung_arch", {"n": 6}, "n = 6: must be a multiple of 4"),
    ("cable_stayed_bridge", {"n": 2}, "n = 2: must be at least 3"),
    ("cable_stayed_bridge", {"stays": "star"}, "stays = 'star'"),
    ("suspension_footbridge", {"n": 7}, "n = 7: must be even, and at least 4"),
    ("suspension_footbridge", {"n": 2}, "n = 2: must be even, and at least 4"),
    ("suspension_footbridge", {"sag": 0.0}, "sag = 0.0: must be positive"),
    ("roof_ring", {"n": 2}, "n = 2"),
    ("roof_ring", {"lifts": 0}, "lifts = 0"),
    ("roof_ring", {"hub": 60.0}, "hub = 60.0: must be less than"),
    ("roof_ring", {"drop": -1.0}, "drop = -1.0: must be positive"),
    ("simplex", {"height": 0.0}, "height = 0.0: must be positive"),
    ("geiger_dome", {"sectors": 2}, "sectors = 2: expected a whole number"),
    ("geiger_dome", {"rise": -1.0}, "rise = -1.0: must be positive"),
    ("geiger_dome", {"struts": (6, 6)}, r"struts: expected a length or \[3\]"),
    ("geiger_dome", {"struts": 1.0}, r"struts\[1\]: its foot, at 3.01 m, must be"),
    ("levy_dome", {"rings": 0}, "rings = 0: expected a whole number"),
    ("levy_dome", {"pretension": 0.0}, "pretension = 0.0: must be positive"),
    ("levy_dome", {"cable_stiffness": {"ridges": 1.0}}, "expected the keys ridges, diagonals, hoo"),
    ("cable_truss", {"form": "lens"}, "form = 'lens': expected one of biconcave"),
    ("cable_truss", {"loaded": "left"}, "loaded = 'left': expected one of full"),
    ("cable_truss", {"panels": 2}, "panels = 2: expected a whole number"),
    ("cable_truss", {"gap": 0.0}, "gap = 0.0: must be positive"),
    ("cable_truss", {"sags": (1.0, 0.0)}, r"sags\[1\] = 0.0: must be positive"),
]


@pytest.mark.parametrize(("name", "options", "message"), WRONG)
def test_scenes_that_are_none(name, options, message):
    with pytest.raises(ValueError, match=message):
        scenes.EVERY[name](**options)


def test_picture_of_a_section(tmp_path):
    section = jc.Section.composite(
        [jc.Section.disc(0.28, jc.Elastic(33e9)), jc.Section.ring(0.3, 0.01, jc.Elastic(210e9))]
    )
    by_law = jc.plots.section(section, path=tmp_path / "law.png")
    (axes,) = by_law.axes
    assert axes.get_aspect() == 1
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["1: Elastic", "2: Elastic"]
    stress = np.asarray(section.fibre_stress(1e-4, 2e-3, 0.0))
    figure = jc.plots.section(section, stress, path=tmp_path / "stress.png")
    axes, bar = figure.axes
    assert axes.get_xlabel() == "y (mm)" and bar.get_ylabel() == "stress (N/mm2), tension positive"
    low, high = axes.collections[0].get_clim()
    assert low == -high == pytest.approx(-np.abs(stress).max() / 1e6)
    assert all((tmp_path / name).stat().st_size > 1e4 for name in ("law.png", "stress.png"))
