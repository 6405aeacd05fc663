"""Scenes with fibre sections and beams: equilibrium, fibres against section forces, pictures."""

import jax
import numpy as np
import pytest
from banks import problems

import jaxcable as jc

SADDLE_LAW = jc.materials.strand(1860e6, 195e9)


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


@pytest.mark.slow
def test_guyed_mast():
    structure, phases = jc.scenes.guyed_mast(levels=2, per_level=2, increments=(2, 3))
    solution = jc.solve(structure, phases)
    assert int(solution.status) == 0
    problems.assert_balanced(solution)
    assert_fibres_sum_to_section_forces(structure, solution, "mast", 0.03)  # 15 m long
    first, last = (np.asarray(p.tension["guys"]) for p in solution.phases)
    # windward guys (one of three at a level) gain, the two others lose alike, by symmetry
    assert (last[[0, 3]] > first[[0, 3]]).all() and (last[[1, 4]] < first[[1, 4]]).all()
    assert np.abs(last[1::3] - last[2::3]).max() < 1e-6 * last.max()
    drift = np.asarray(solution.displacement - solution.phases[0].displacement)[:5]
    assert (drift[1:, 0] > 0).all() and np.abs(drift[:, 1]).max() < 1e-8
    # the foot takes the weight and what the guys pull down
    down = -np.asarray(solution.load)[:, 2].sum()
    assert float(solution.reactions[:, 2].sum()) == pytest.approx(down, rel=1e-8)
    assert float(solution.reactions[0, 2]) > down


@pytest.mark.slow
def test_a_net_stiffens_an_arch():
    structure, phases = jc.scenes.strung_arch(n=8, load=2e3, increments=(1, 2))
    stiffened = jc.solve(structure, phases)
    assert int(stiffened.status) == 0
    problems.assert_balanced(stiffened)
    assert_fibres_sum_to_section_forces(structure, stiffened, "arch", 0.01)
    # the same arch with a net that does next to nothing
    net = structure.elements["net"]
    loose = jc.replace(
        structure, elements={**structure.elements, "net": jc.replace(net, axial_stiffness=1.0)}
    )
    bare = jc.solve(
        loose,
        [
            jc.Phase(pretension={"arch": None, "net": 1e-6}, loads=jc.SelfWeight()),
            jc.Phase(loads=phases[1].loads, increments=2),
        ],
    )
    assert int(bare.status) == 0

    def sway(solution):
        moved = solution.displacement - solution.phases[0].displacement
        return float(np.abs(np.asarray(moved)).max())

    assert sway(stiffened) < 0.8 * sway(bare)


@pytest.mark.slow
@pytest.mark.parametrize(
    "law", [pytest.param(None, marks=pytest.mark.slow), SADDLE_LAW], ids=["linear", "strand"]
)
def test_saddle_net_of_fibres(law):
    scene = jc.scenes.saddle_net(law=law, increments=(2, 3), spacing=2.0, load=9e3)
    structure, phases = scene
    assert structure.n_node == 132 and len(structure.elements.links) == 201
    solution = jc.solve(structure, phases)
    assert int(solution.status) == 0
    problems.assert_balanced(solution)
    area = np.asarray(structure.elements.section.area).sum()
    assert area == pytest.approx(1963.5e-6, rel=1e-5)  # the paper's 19.63 cm2
    for phase, n in zip(solution.phases, (2, 3), strict=True):
        stress = np.asarray(jc.fibre_stress(structure, phase))
        assert stress.shape == (n, 201, 100)
        # all fibres of a cable at one strain: the same stress, tension over area
        assert np.abs(stress * area - np.asarray(phase.path.tension)[..., None]).max() < 1e-6
    # phase 1 leaves every cable at a tension of the order of its jacking force
    assert (np.asarray(solution.phases[0].tension) > 0).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: jc.scenes.guyed_mast(levels=0), "levels, per_level = 0, 4"),
        (lambda: jc.scenes.strung_arch(n=6), "n = 6: must be a multiple of 4"),
    ],
)
def test_wrong_scene(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_picture_of_a_section(tmp_path):
    section = jc.Section.composite(
        [jc.Section.disc(0.28, jc.Elastic(33e9)), jc.Section.ring(0.3, 0.01, jc.Elastic(210e9))]
    )
    by_law = jc.plots.section(section, path=tmp_path / "law.png")
    assert len(by_law.axes) == 1 and by_law.axes[0].get_aspect() == 1
    assert [t.get_text() for t in by_law.axes[0].get_legend().get_texts()] == [
        "1: Elastic",
        "2: Elastic",
    ]
    stress = np.asarray(section.fibre_stress(1e-4, 2e-3, 0.0))
    figure = jc.plots.section(section, stress, path=tmp_path / "stress.png")
    axes, bar = figure.axes
    assert axes.get_xlabel() == "y (mm)" and bar.get_ylabel() == "stress (N/mm2), tension positive"
    low, high = axes.collections[0].get_clim()
    assert low == -high == pytest.approx(-np.abs(stress).max() / 1e6)
    assert all((tmp_path / name).stat().st_size > 1e4 for name in ("law.png", "stress.png"))
    with pytest.raises(ValueError, match=r"stress: expected shape \(228,\), got \(3,\)"):
        jc.plots.section(section, np.zeros(3))
    with pytest.raises(ValueError, match="section: has no mesh to draw"):
        jc.plots.section(jc.Section([0.0], [0.0], [1.0], jc.Elastic(1.0)))


def test_stresses_keep_the_shape_of_the_elements():
    nodes = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 0, 1.0]])
    structure = jc.Structure(
        nodes,
        [
            jc.Bars([[0, 1]], area=1e-4, law=jc.Elastic(1e9)),
            jc.Cables([[1, 2]], axial_stiffness=1e5),
        ],
        jc.pinned([0, 2]),
    )
    solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], (0, 0, -10.0)), increments=2))
    assert int(solution.status) == 0
    stress, none = jc.fibre_stress(structure, solution.phases[0])
    assert none is None and stress.shape == (2, 1)
    expected = np.asarray(solution.phases[0].path.tension[0]) / 1e-4
    assert np.abs(stress - expected).max() <= 1e-12 * 1e9
    assert jax.tree.structure(solution.tension) == jax.tree.structure([0, 0])


@pytest.mark.parametrize("stages", [True, False])
def test_a_bridge_in_stages_and_at_once(stages):
    """In equilibrium, alike on both sides; in stages only what is there yet bears."""
    n, m = 4, 3
    structure, phases = jc.scenes.cable_stayed_bridge(n, stages=stages)
    solution = jc.solve(structure, phases)
    assert int(solution.status) == 0
    problems.assert_balanced(solution)
    z = np.asarray(solution.positions)[m + 3 :, 2].reshape(n, 2)
    np.testing.assert_allclose(z[:, 0], z[:, 1], atol=1e-8)
    tension = np.asarray(solution.tension["stays"]).reshape(m, 2)
    assert (tension > 1e5).all()
    np.testing.assert_allclose(tension[:, 0], tension[:, 1], rtol=1e-7)
    foot = float(solution.reactions[0, 2])
    on_bearings = np.asarray(solution.reactions)[-2:, 2]
    np.testing.assert_allclose(on_bearings[0], on_bearings[1], rtol=1e-6)
    assert foot + on_bearings.sum() == pytest.approx(-np.asarray(solution.load)[:, 2].sum())
    if not stages:
        return
    for k, phase in enumerate(solution.phases[:m]):
        there = np.asarray(phase.tension["stays"]) > 0
        assert there.sum() == 2 * (k + 1) and there[: 2 * (k + 1)].all()
        jacked = float(phases[k].jacking["stays"].values)
        np.testing.assert_allclose(phase.tension["stays"][2 * k : 2 * k + 2], jacked, rtol=1e-9)
        assert not np.asarray(phase.section_forces["deck"])[2 * (k + 1) :].any()
        assert not np.asarray(phase.reactions)[-2:].any()


@pytest.mark.parametrize("options", [{"n": 2}, {"stays": "star"}])
def test_bridges_that_are_none(options):
    with pytest.raises(ValueError, match=r"n = 2: must be at least 3|stays = 'star'"):
        jc.scenes.cable_stayed_bridge(**options)
