"""Arguments of `transient` that are refused, and a motion whose energy is wrong."""

import jax
import numpy as np
import pytest
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.common.tree import copy_with
from jaxcable.dynamics import Dashpots, ModalDamping, Rayleigh, Removal, falling_load, transient
from jaxcable.dynamics.motion_checks import step_of_removal

BAR = jc.Bars([[0, 1]], axial_stiffness=1e3)
NODES = [[0.0, 0, 0], [1.0, 0, 0]]
GIVEN = {"dt": 0.1, "steps": 6, "masses": 1.0}


def one_bar(**options):
    """A bar along x that is free at its second end, for six steps."""
    structure = jc.Structure(NODES, BAR, supports=jc.pinned([0]))
    return transient(structure, options.pop("loads", None), **GIVEN | options)


def step(time):
    return np.zeros((2, 3)) if time < 1 else np.ones((2, 3))


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"method": jc.Incremental()}, "method: expected Newton, got Incremental"),
        ({"removes": [Removal(True)]}, "removes: expected a dynamics.Removal, got list"),
        ({"removes": 0}, "removes: expected a dynamics.Removal, got int"),
        ({"removes": jc.only([0])}, "removes: expected a dynamics.Removal, got Selection"),
        ({"removes": Removal(True, 0.1, 2.0)}, r"removes.duration = 2.0: .* after the motion"),
        (
            {"removes": Removal(True, GIVEN["dt"] * 6)},
            "removes.time = .*: expected .* fewer than 6",
        ),
        (
            {"loads": jc.NodalLoads([1], (0, 0, np.nan))},
            r"loads\[0\].forces.* = nan: must be finite",
        ),
        ({"distribution": "lump"}, "distribution = 'lump': expected one of lumped"),
        ({"nodes": np.array([True, False])}, r"nodes: expected integers, got bool"),
        ({"nodes": [1.5]}, "nodes: expected integers"),
        ({"nodes": [-1]}, r"nodes\[0\] = -1"),
        ({"velocity": [[1.0, 0, 0], [0, 0, 0]]}, r"velocity\[0\]: node 0 is held along x"),
        ({"velocity": [[0, 0, 0], [0, np.nan, 0]]}, r"velocity\[1, 1\] = nan: must be finite"),
        ({"masses": 0.0}, "masses: no element group has a weight"),
        ({"masses": np.nan}, "masses = nan: must be finite"),
        ({"dt": np.inf}, "dt = inf: must be finite"),
        ({"loads": step}, r"loads\[0\]: functions of time are traced.*jnp.where"),
        ({"loads": lambda t: np.zeros(3)}, r"loads\[0\]\(time\): expected .* \(2, 3\), got \(3,\)"),
        ({"loads": np.zeros((6, 2, 3))}, r"loads\[0\]: expected .*; 7 = steps \+ 1"),
        ({"loads": np.full((7, 2, 3), np.nan)}, r"loads\[0\]\[0, 0, 0\] = nan: must be finite"),
        ({"histories": ["tensions"]}, "'tension', 'peak_tension', 'section_strain';"),
    ],
)
def test_refused(options, text):
    with pytest.raises(ValueError, match=text):
        one_bar(**options)


def test_catenaries_have_no_energy_momentum_scheme():
    cable = jc.Catenaries([[0, 1]], axial_stiffness=1e6, weight=20.0, rest_length=1.1)
    structure = jc.Structure(NODES, cable, supports=jc.pinned([0]))
    with pytest.raises(ValueError, match=r"energy-momentum.*\(Catenaries\) are not supported"):
        transient(structure, scheme="energy-momentum", **GIVEN)


def test_what_is_held_has_no_velocity():
    """Along the directions of a support that are its own, too; traced ones give NaN."""
    slope = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])
    rollers = jc.restrained([1], "z", axes=slope)
    structure = jc.Structure(NODES, BAR, supports=jc.pinned([0]) + rollers)

    def moved(velocity):
        given = {"dt": 0.01, "steps": 1, "masses": 1.0}
        return transient(structure, velocity=[[0, 0, 0], velocity], **given)

    along, across = np.array([0.6, 0.0, 0.8]), np.array([-0.8, 0.0, 0.6])
    assert int(moved(along).status) == 0
    with pytest.raises(ValueError, match=r"velocity\[1\]: node 1 is held along z"):
        moved(across)
    ends = jax.vmap(lambda v: moved(v).displacement[-1])(np.stack([along, across]))
    assert np.isfinite(ends[0]).all() and np.isnan(ends[1]).all()


def test_what_is_gone_is_not_removed_again():
    net, phases = jc.scenes.flat_net(load=15.0)
    gone = jc.only([2])
    start = converged(jc.solve(net, [*phases, jc.Phase(removes=gone)]))
    with pytest.raises(ValueError, match=r"removes.elements: element 2 of elements is not there"):
        transient(net, start=start, removes=Removal(gone), **GIVEN)


def test_times_in_single_precision_are_whole_numbers_of_steps():
    step = np.float32(0.003)
    for k in (0, 50, 333):
        gone = Removal(True, time=np.float32(0.003 * k), duration=np.float32(0.003 * (400 - k)))
        assert step_of_removal(gone, step, 400) == k
    for time, release in ((0.0031, 0.0), (0.003, 1.2)):
        with pytest.raises(ValueError, match="removes"):
            gone = Removal(True, time=np.float32(time), duration=np.float32(release))
            step_of_removal(gone, step, 400)


def test_nodes_of_histories_and_of_pictures():
    pushed = {"velocity": [[0.0, 0, 0], [0.1, 0, 0]]}
    histories = ["displacement", "reactions", "tension"]
    moved = converged(one_bar(nodes=[1], histories=histories, **pushed))
    assert moved.reactions.shape == (7, 1, 3) and list(moved.nodes.array) == [1]
    assert jax.tree.map(lambda a: a, moved).nodes == moved.nodes
    figure = jc.plots.motion(moved, elements=[0])
    most = {name: getattr(moved.energy, name) + 1e3 for name in ("stored", "total")}
    prestressed = copy_with(moved.energy, **most)
    other = copy_with(moved, energy=prestressed, displacement=moved.displacement + 0.5)
    for own, same in zip(figure.axes, jc.plots.motion(other, elements=[0]).axes, strict=True):
        for a, b in zip(own.lines, same.lines, strict=True):  # from the start of the motion
            np.testing.assert_allclose(a.get_ydata(), b.get_ydata(), atol=1e-9)
    assert len(jc.plots.motion(moved, elements=None).axes) == 2  # displacement, and energy
    for options, text in (
        ({"nodes": [0]}, r"nodes\[0\] = 0: the motion has the histories of nodes 1"),
        ({"elements": [1]}, "elements: 1 is unknown"),
        ({"elements": [0], "group": "bar"}, "group = 'bar': the structure has one group"),
    ):
        with pytest.raises(ValueError, match=text):
            jc.plots.motion(moved, **options)
    structure = jc.Structure(NODES, {"bar": BAR}, supports=jc.pinned([0]))
    moved = converged(transient(structure, **GIVEN))
    with pytest.raises(ValueError, match=r"nodes\[0\] = 99: .* histories of nodes 0 to 1"):
        jc.plots.motion(moved, nodes=[99])
    with pytest.raises(ValueError, match=r"group = None: .* within their group; give one of 'bar'"):
        jc.plots.motion(moved, elements=[0])


def test_a_failure_names_its_step():
    thrown = {"dt": 0.05, "velocity": [[0, 0, 0], [40.0, 9.0, 0]], "method": jc.Newton(max_steps=3)}
    moved = one_bar(**thrown)
    with pytest.raises(
        jc.AnalysisError, match=r"^step \d of 6, at 0\.\d+ s: no balance.*a smaller dt"
    ):
        jc.raise_if_failed(moved)


def test_a_motion_that_gains_energy_is_warned_of():
    """The rope of a pendulum vibrates at 36 Hz, slower steps cannot follow it: the energy grows."""
    rope = jc.Cables([[0, 1]], axial_stiffness=1e5)
    structure = jc.Structure(NODES, rope, supports=jc.pinned([0]))
    bob = jc.PointMasses([1], 2.0)
    given = {"masses": bob, "steps": 100, "histories": []}
    with pytest.warns(jc.InputWarning, match=r"dt: from t = \d.* s on the steps gain") as seen:
        moved = converged(transient(structure, bob, dt=0.05, **given))
    assert len(seen) == 1 and seen[0].filename == __file__
    assert np.max(moved.energy.error) > 1.5 * 2.0 * 9.80665  # of a fall of 1 m


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (
            lambda: Dashpots([[0, 1], [1, 1]], 5.0),
            r"nodes\[1\] = \[1, 1\]: joins a node with itself",
        ),
        (lambda: Rayleigh.from_ratios((0.0, 0.01), (5.0, 0.01)), "first_frequency = 0.0: must be"),
        (
            lambda: falling_load(np.zeros((2, 3)), dt=0.1, steps=4, at=0.5),
            "at = 0.5: after the end of the history at 0.4 s",
        ),
    ],
)
def test_what_has_no_effect_is_refused(call, text):
    with pytest.raises(ValueError, match=text):
        call()


@pytest.mark.parametrize(
    "call",
    [
        lambda ratio: Rayleigh.from_ratios((1.0, ratio), (2.0, ratio)),
        lambda ratio: ModalDamping([1.0], np.ones((1, 2, 3)), ratio),
    ],
)
def test_percentages_are_suspicious(call):
    call(0.05)
    with pytest.warns(jc.InputWarning, match=r"ratios? = 5: is critical .* 0.05 is 5 %"):
        call(5.0)
