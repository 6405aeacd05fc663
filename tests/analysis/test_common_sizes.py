"""Analyses of similar size share one program, with the results of a program of their own size."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.analysis import common_sizes, padding, phase_loop
from jaxcable.analysis.preparation import prepare
from jaxcable.common.fusion import are_loops_fused

not_fused = pytest.mark.skipif(are_loops_fused(), reason="sizes are exact then")

# columns of the log that are counts, statuses or flags; the others are floats
COUNTS = [
    k
    for k, name in enumerate(jc.analysis.phase_results.LOG_COLUMNS)
    if name not in ("residual", "scale", "rounding")
]


def check_equal(structure, phases, method=None, start=None):
    """Check a padded solution against that of exact sizes; return the padded one.

    Fields are equal but for rounding: other kernels of XLA and larger sums round otherwise. What
    is itself rounding (an elongation of 1e-16 m) is measured by the size of the structure.
    """
    padded, exact = (
        jc.solve(structure, phases, method, start=start, exact_sizes=exact)
        for exact in (False, True)
    )
    assert jax.tree.structure(padded) == jax.tree.structure(exact)
    np.testing.assert_array_equal(
        np.asarray(padded.phases.log)[..., COUNTS], np.asarray(exact.phases.log)[..., COUNTS]
    )
    residuals = id(padded.phases.log)  # which are rounding
    pairs = zip(jax.tree_util.tree_leaves_with_path(padded), jax.tree.leaves(exact), strict=True)
    for (path, one), other in pairs:
        assert (type(one), one.shape, one.dtype) == (type(other), other.shape, other.dtype), path
        if isinstance(one, jax.Array):
            assert (one.weak_type, one.committed) == (other.weak_type, other.committed), path
        if id(one) == residuals:
            continue
        one, other = np.asarray(one, float), np.asarray(other, float)
        np.testing.assert_array_equal(np.isnan(one), np.isnan(other), str(path))
        size = np.nanmax(np.abs(other), initial=1e-3)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * size, err_msg=str(path))
    return padded


def free_nodes(structure):
    """Nodes that are held in no direction."""
    held = structure.fixed(structure.supports).array[: structure.n_node]
    return np.flatnonzero(~held.any(axis=1))


def is_padded(structure, phases, start=None):
    task = prepare(structure, phases, None, start, to_end=True)
    core = task.without_indices, task.arrays, task.method, task.code
    return common_sizes.pad_analysis(task, core) is not None


SCENES = {
    name: getattr(jc.scenes, name)()
    for name in (
        *("flat_net", "accuracy_cable", "roof_ring", "simplex", "von_mises_truss"),
        *("guyed_mast", "suspension_footbridge"),
    )
}
# of 192 and of 174 unknowns: solvers with narrow bands, and on the host
CLAMPED = jc.Structure(
    np.linspace([0.0, 0, 0], [30.0, 0, 0], 30),
    jc.Beams(
        np.stack([np.arange(29), np.arange(1, 30)], axis=1),
        jc.Section.rectangle(0.2, 0.4, jc.Elastic(30e9)),
    ),
    jc.clamped([0]),
)
SCENES |= {
    "hypar_net": jc.scenes.hypar_net(increments=(5, 3)),
    "saddle": jc.scenes.saddle(4, 5),
    "large saddle": jc.scenes.saddle(8, 8, load=50.0),
    "many beams": (CLAMPED, jc.Phase(loads=jc.NodalLoads([29], (5.0, 0.0, -30.0)))),
}


@not_fused
@pytest.mark.parametrize("name", SCENES)
def test_results_are_those_of_exact_sizes(name):
    structure, phases = SCENES[name][:2]
    assert is_padded(structure, phases)
    assert int(check_equal(structure, phases).status) == 0


@not_fused
@pytest.mark.parametrize("name", ["flat_net", "roof_ring", "simplex", "guyed_mast"])
def test_a_continued_analysis_is_padded_too(name):
    """Groups of the ring are joined: their states are, too. Three phases become four."""
    structure, phases = SCENES[name][:2]
    begun = jc.solve(structure, phases)
    load = jc.NodalLoads(free_nodes(structure)[:1], (0.0, 0.0, -1.0))
    load = jc.Phase(loads=load, increments=2)
    assert is_padded(structure, [load] * 3, begun)
    assert int(check_equal(structure, [load] * 3, start=begun).status) == 0
    check_equal(structure, load, start=begun.last)


HELD = jc.scenes.flat_net().structure.supports + jc.pinned([3])
LIFT = jc.SupportMovement([3], (0.0, 0.0, 0.01))


@pytest.mark.parametrize(
    "changes",
    [
        {"method": jc.Newton(max_steps=1)},
        {"phases": [jc.Phase(pretension=200.0), jc.Phase(removes=jc.only([0, 1])), jc.Phase()]},
        {"method": jc.Newton(tol=1e-6, watch=True)},
        {"method": jc.Incremental(1)},
        {
            "phases": jc.Phase(
                pretension=200.0, loads=[jc.SelfWeight(), jc.LineLoads((0, 0, -2.0))]
            ),
            "weight": 3.0,
        },
        {"phases": [jc.Phase(jacking=jc.only([1, 4], 250.0)), jc.Phase(temperature=-20.0)]},
        {
            "phases": [
                jc.Phase(pretension=200.0, increments=30),
                jc.Phase(supports=HELD, loads=LIFT),
            ]
        },
        {"phases": [jc.Phase(), jc.Phase(pretension=4e3, increments=3)]},
    ],
    ids=["fails", "removed", "watched", "incremental", "weight", "jacks", "held", "stiff"],
)
def test_statuses_and_nan_are_those_of_exact_sizes(changes):
    structure, phases = jc.scenes.flat_net(load=15.0)
    cables = jc.replace(
        structure.elements, weight=changes.get("weight"), expansion=1e-5, strength=5e3
    )
    structure = jc.replace(structure, elements=cables)
    check_equal(structure, changes.get("phases", phases), changes.get("method"))


def test_an_unsound_input_fails_alike():
    """A traced rule is broken only inside of jit; here a start that has failed keeps its status."""
    structure, phases = jc.scenes.flat_net(load=15.0)
    failed = jc.solve(structure, phases, jc.Newton(max_steps=1))
    assert int(failed.status) == 1
    assert int(check_equal(structure, phases[1], start=failed).status) == 1


def test_what_cannot_be_padded_has_exact_sizes():
    """Pressure on faces follows the net: its forces couple nodes beyond elements."""
    structure, _ = jc.scenes.saddle(3, 3)[:2]
    wind = jc.FacePressure([[6, 7, 11], [7, 12, 11]], 50.0)
    phases = [jc.Phase(pretension=1e3), jc.Phase(loads=wind)]
    assert not is_padded(structure, phases)
    assert int(check_equal(structure, phases).status) == 0


def nets(rng, sizes):
    """Yield nets on a saddle with so many cables, of which random ones are left out."""
    for k, size in enumerate(sizes):
        structure, _ = jc.scenes.saddle(5, 6) if k % 2 else jc.scenes.saddle(3, 9)
        links = structure.elements.links.array
        while len(links) > size:
            left = np.delete(links, rng.integers(len(links)), axis=0)
            if np.bincount(left.ravel(), minlength=structure.n_node).min() > 0:
                links = left
        cables = jc.Cables(links, axial_stiffness=1e6)
        loads = jc.NodalLoads(free_nodes(structure)[k : k + 2], (0.0, 0.0, -50.0))
        phases = [jc.Phase(pretension=1e3), jc.Phase(loads=loads, increments=2 + k)]
        yield jc.replace(structure, elements=cables), phases


@not_fused
def test_ten_nets_of_60_to_70_cables_share_one_program():
    jc.forget_programs()
    for structure, phases in nets(np.random.default_rng(1), range(60, 70)):
        assert int(jc.solve(structure, phases).status) == 0
    # one without fallbacks, and one with: a net with few cables hangs in part
    assert len(phase_loop.analyse.known) <= 2


@not_fused
@pytest.mark.parametrize("each", [False, True])
@pytest.mark.parametrize("geometry", ["input", "begun"])
def test_snow_on_another_number_of_faces_shares_the_program(geometry, each):
    """One force for all faces, or one for each; the gradient is that of exact sizes, too."""
    jc.forget_programs()
    structure, (prestress, _) = jc.scenes.saddle(5, 5)
    faces = jc.net_faces(structure.nodes, structure.elements.links.array, border="ends")
    counts, known = (len(faces), len(faces) - 1, len(faces) - 5), []

    def phases_of(count, factor=1.0):
        forces = np.linspace([0.0, 0, -90.0], [30.0, 0, -40.0], count)
        forces = forces if each else forces[0]
        snow = jc.AreaLoads(faces[:count], forces, factor=factor, geometry=geometry)
        return [prestress, jc.Phase(loads=snow, increments=3)]

    for count in counts:
        assert int(jc.solve(structure, phases_of(count)).status) == 0
        known.append(len(phase_loop.analyse.known))
    assert known[0] == known[-1]
    check_equal(structure, phases_of(counts[-1]))

    def vertical_load(factor, exact):
        phases = phases_of(counts[-1], factor)
        return jc.solve(structure, phases, exact_sizes=exact).load[:, 2].sum()

    slopes = [jax.grad(vertical_load)(1.0, exact) for exact in (False, True)]
    assert slopes[1] < -100.0  # N
    np.testing.assert_allclose(*slopes, rtol=1e-12)  # sums in another order


@not_fused
def test_increments_up_to_40_share_four_programs():
    jc.forget_programs()
    structure, (prestress, loading) = jc.scenes.flat_net(load=15.0)
    for count in range(1, 41):
        solution = jc.solve(structure, [prestress, jc.replace(loading, increments=count)])
        assert int(solution.status) == 0
        assert solution.phases[1].path.load_factor.shape == (count,)
    assert len(phase_loop.analyse.known) == 4  # up to 12, 24, 36 and 48


def test_gradients_start_from_padded_solutions():
    """Taylor slopes of the gradient outside of jit, whose points come from a padded analysis."""
    structure, phases = jc.scenes.saddle(3, 4, load=200.0)[:2]

    def sag(scale):
        moved = jc.replace(structure, nodes=structure.nodes * jnp.array([[1.0, 1.0, scale]]))
        return jnp.sum(jc.solve(moved, phases).displacement[:, 2])

    rate = jax.grad(sag)(1.0)
    # slope 2 of the remainder where it is far above rounding
    left = [abs(sag(1.0 + h) - sag(1.0) - h * rate) for h in (0.02, 0.01)]
    assert 1.9 < np.log2(left[0] / left[1]) < 2.1
    without = [abs(sag(1.0 + h) - sag(1.0)) for h in (0.02, 0.01)]
    assert 0.9 < np.log2(without[0] / without[1]) < 1.1  # negative control


def test_progress_reports_the_number_of_phases():
    structure, phases = jc.scenes.flat_net(load=15.0)
    reports = []
    solution = jc.solve(structure, [*phases, jc.Phase()], progress=reports.append)
    assert int(solution.status) == 0
    jax.effects_barrier()
    assert {(report.phase, report.phases) for report in reports} == {(1, 3), (2, 3), (3, 3)}


class Fuses(jc.Cables):
    """Cables of a user, whose mechanics may read their strength."""


@pytest.mark.parametrize(("kind", "kept"), [(jc.Cables, False), (Fuses, True)])
def test_only_own_elements_keep_their_strength(kind, kept):
    """For cables of the package it is for reports: with and without it they share programs."""
    group = kind([[0, 1], [1, 2]], axial_stiffness=1e5, strength=[50.0, 60.0])
    padded = common_sizes._pad_group(group, 4)
    np.testing.assert_array_equal(padded.axial_stiffness, 4 * [1e5])
    assert (padded.strength is not None) == kept
    if kept:
        np.testing.assert_array_equal(padded.strength, [50.0, 60.0, 60.0, 60.0])


def test_sizes_grow_by_little():
    """Large enough, few, and at most half as large again (above 24 unknowns)."""
    found = [padding.common_size(n) for n in range(1, 2000)]
    assert all(size >= n for n, size in enumerate(found, 1))
    assert found == sorted(found) and len(set(found)) < 25
    assert max(size / n for n, size in enumerate(found, 1) if n > 24) <= 1.5


@pytest.mark.parametrize("wrong", [None, 1, "yes"])
def test_exact_sizes_is_true_or_false(wrong):
    with pytest.raises(ValueError, match=r"exact_sizes = .*: expected True or False"):
        jc.solve(*jc.scenes.flat_net()[:2], exact_sizes=wrong)
