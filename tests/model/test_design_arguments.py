"""Wrong arguments of the functions of `design` are refused, naming argument, index and rule."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable import design
from jaxcable.design.targets import deviations

NODES = [[-4.0, 0, 3], [1.0, 0, 2], [4.0, 0, 3], [1.0, 0, 0]]
GROUPS = {
    "net": jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5),
    "mast": jc.Bars([[1, 3]], axial_stiffness=1e4),
}
STRUCTURE = jc.Structure(NODES, GROUPS, supports=jc.pinned([0, 2, 3]))
PHASES = [
    jc.Phase(pretension={"net": 500.0, "mast": None}),
    jc.Phase(loads=jc.NodalLoads([1], (0, 0, -100.0))),
]
FIT = design.fit(lambda p: p - 1.0, jnp.zeros(2))


@functools.cache
def solution():
    found = jc.solve(STRUCTURE, PHASES)
    assert int(found.status) == 0
    return found


Target = design.Target
TARGETS = {
    "no group": (Target("tension", 1.0), r"targets\[1\]: of = 'tension': there are several groups"),
    "no such group": (Target("tension", on="nett"), "on = 'nett': not a group.*mean 'net'"),
    "no groups": (Target("positions", on="net"), "on = 'net': the result of = 'positions' is not"),
    "no result": (Target("tensions"), "of = 'tensions': a phase has no such.*mean 'tension'"),
    "status": (Target("status"), "of = 'status': a phase has no such result"),
    "no beams": (Target("section_forces"), "of = 'section_forces': this structure has no such"),
    "too many": (Target("tension", [1.0, 2, 3], on="net"), "value: has 3 numbers, but 2 numbers"),
    "spread": (Target("positions", np.ones((2, 2)), at=(1, 2)), "value: has 4 numbers, but 1 num"),
    "no index": (Target("tension", on="net", at=5), r"at: index 5 is out of bounds.*shape \[2\]"),
    "nothing": (Target("tension", on="net", at=np.zeros(2, bool)), "at: means no number"),
    "text": (Target(lambda result: "a"), "of: expected an array of floats"),
    "integers": (Target(lambda result: result.status), "of: expected an array of floats"),
}


@pytest.mark.parametrize("name", TARGETS)
def test_targets_that_mean_nothing(name):
    target, said = TARGETS[name]
    with pytest.raises(ValueError, match=said):
        deviations([Target("positions"), target], solution())


def test_tune_names_the_target():
    with pytest.raises(ValueError, match=r"targets\[0\]: of = 'tension': there are several groups"):
        design.tune(STRUCTURE, PHASES, [(0, "pretension")], Target("tension", 500.0))
    pair = (0, "pretension")
    for unknowns, targets, said in (
        ([pair, pair], Target("tension"), r"unknowns\[1\] = \(0, 'pretension'\): is there twice"),
        ([(0, "pretensions")], Target("tension"), "not a statement; .* did you mean 'pretension'"),
        (5, Target("tension"), "unknowns: expected a list of pairs"),
        ([pair], 5, "targets: expected a list of Target, got int"),
    ):
        with pytest.raises(ValueError, match=said):
            design.tune(STRUCTURE, PHASES, unknowns, targets)


WRONG = {
    "of": (lambda: Target(3), "of: expected the name of a result or a function, got int"),
    "value": (lambda: Target("tension", np.nan), "value = nan: must be finite"),
    "within": (lambda: Target("tension", within=[1.0]), "within: expected a scalar"),
    "scale": (
        lambda: jc.minimize(lambda x: jnp.sum(x**2), jnp.ones(2), scale=np.nan),
        "scale = nan: must be positive and finite",
    ),
    "residuals": (
        lambda: jc.fit(lambda p: solution(), jnp.ones(2)),
        "residuals: expected floats, or .floats, solution., got a Solution",
    ),
    "rounds": (
        lambda: design.minimize_subject_to(lambda p: (p @ p, p), jnp.ones(2), rounds=0),
        "rounds = 0: expected a whole number",
    ),
    "influence of": (
        lambda: jc.influence(STRUCTURE, PHASES, of="tensions"),
        "of = 'tensions': .*did you mean 'tension'",
    ),
    "influence wrt": (
        lambda: jc.influence(STRUCTURE, PHASES, wrt="shortenings"),
        "wrt = 'shortenings': .*did you mean 'shortening'",
    ),
    "influence phase": (
        lambda: jc.influence(STRUCTURE, PHASES, phase=0.5),
        "phase = 0.5: there are phases 0 to 1",
    ),
    "matrix": (
        lambda: design.adjustment(jnp.eye(2), jnp.ones(3)),
        r"jacobian: has shape \[2, 2\], which is not one by 3 inputs",
    ),
    "rcond": (lambda: design.adjustment(jnp.eye(2), jnp.ones(2), rcond=-1.0), "rcond = -1.0: must"),
    "tolerances": (
        lambda: design.scatter(jnp.eye(2), jnp.ones(3)),
        r"tolerance: expected shape \(2,\), that of the inputs, got \(3,\)",
    ),
    "tolerance": (
        lambda: design.scatter(jnp.eye(2), np.array([1.0, -1.0])),
        r"tolerance\[1\] = -1.0: must not be negative",
    ),
    "a fit": (lambda: design.confidence(3), "fit: expected the result of fit, got int"),
    "fits": (
        lambda: design.confidence(jax.tree.map(lambda x: jnp.stack([x, x]), FIT)),
        r"fit: a batch of shape \(2,\)",
    ),
    "deviation": (lambda: design.confidence(FIT, deviation=0.0), "deviation = 0.0: must be posi"),
    "width": (lambda: design.smooth_max(jnp.ones(2), 0.0), "width = 0.0: must be positive"),
    "phase": (
        lambda: design.largest_deflection(solution(), 1e-3, phase=7),
        "phase = 7: there are phases 0 to 1",
    ),
    "nodes": (
        lambda: design.shape_distance(solution(), np.zeros((1, 3)), nodes=[9]),
        r"nodes\[0\] = 9: the structure has nodes 0 to 3",
    ),
    "positions": (
        lambda: design.shape_distance(solution(), np.zeros((2, 3)), nodes=[1]),
        r"positions: expected shape \(1, 3\), one per node, got \(2, 3\)",
    ),
    "tension": (
        lambda: design.tension_distance(solution(), {"net": np.ones(3), "mast": 1.0}),
        r"tension\['net'\]: expected a number or shape \(2,\), one value per element",
    ),
    "groups": (
        lambda: design.tension_distance(solution(), {"nett": 1.0, "mast": 1.0}),
        "tension: expected a number, or the shape of the elements",
    ),
    "stress": (lambda: design.material_use(solution(), 0.0), "stress.*must be positive"),
    "cases": (lambda: design.envelope(3.0), "values: expected arrays with the cases"),
    "forces": (
        lambda: design.utilisation(STRUCTURE, {"net": np.ones(3), "mast": np.ones(1)}),
        "tension: group 1 has 2 elements",
    ),
    "structure": (lambda: design.utilisation(3, 1.0), "structure: expected a Structure, got int"),
    "another": (
        lambda: design.slack_distance(jc.scenes.flat_net().structure, solution()),
        "solution: is of another structure",
    ),
    "distance": (
        lambda: design.nearest_kink(3, jnp.ones(2), jnp.ones(2)),
        "distance: expected a function, got int",
    ),
    "direction": (
        lambda: design.nearest_kink(lambda x: x, jnp.ones(2), jnp.ones(3)),
        r"direction: expected a scalar or shape \(2,\), got \(3,\)",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_arguments(name):
    call, said = WRONG[name]
    with pytest.raises(ValueError, match=said):
        call()
