"""A hanging cable under a stated tension: the unknown that lets nets of catenaries converge."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convex_oracle import WIDE, Element, Scene, find
from oracles.taylor import slope

import jaxcable as jc
from jaxcable.elements import hanging, hanging_springs


def spans(count=200, stiffest=10):
    """Chords, loads, unstressed lengths and stiffnesses of spans, deep, taut and near both."""
    rng = np.random.default_rng(5)
    for k in range(count):
        rest = 10 ** rng.uniform(-1, 2)
        chord = rng.normal(size=3)
        near = 1 + rng.choice([-1, 1]) * 10 ** rng.uniform(-8, -1)
        chord *= rest * (near if k % 2 else rng.uniform(0.05, 1)) / np.linalg.norm(chord)
        stiffness = 10 ** rng.uniform(1, stiffest)
        load = rng.normal(size=3) * 10 ** rng.uniform(-4, 1) / rest
        yield jnp.array(chord), chord @ chord - rest**2, jnp.array(load), rest, stiffness


def test_in_balance_it_is_the_hanging_cable():
    """Force and stiffness are those of `hang`; a tension that is one percent off shows."""
    stiffness_of = jax.jit(jax.jacfwd(hanging.hang), static_argnums=())
    stated = jax.jit(hanging_springs.under)
    for span in spans():
        chord, excess, *rest = span
        tension = hanging.least_tension(*span)
        at = stated(tension, *span)
        force = np.asarray(hanging.hang(*span)[0])
        assert np.abs(at.force - force).max() <= 1e-13 * np.abs(force).max()
        # gap and sag are differences of lengths, each rounded: sixteen roundings of the larger
        # part, the strain or the slack, and of the root that the tension comes from
        part = max(float(tension / rest[2]), abs(excess) / rest[1] ** 2, float(at.sag) / rest[1])
        give = float(tension * (at.compliance + at.less))
        room = 16 * np.finfo(float).eps * (part * rest[1] + give)
        assert abs(float(at.gap - at.sag)) <= room
        off = stated(1.01 * tension, *span)
        assert float(off.gap - off.sag) > 4e-3 * give  # can fail
        # |d|^2 - L0^2 moves with the chord
        matrices = stiffness_of(*span)[0], jax.jacfwd(hanging.hang, 1)(*span)[0]
        exact = np.asarray(matrices[0]) + np.outer(matrices[1], 2 * chord)
        block = hanging_springs.matrix(tension, *rest)
        block = block + np.outer(at.along, at.along) / (at.compliance + at.less)
        assert np.abs(block - exact).max() <= 1e-8 * np.abs(exact).max()


@pytest.mark.parametrize("name", ["force", "gap", "sag"])
def test_taylor_by_the_tension(name):
    """Off balance, too, derivatives by the tension are those that `Under` states."""
    rate = {"force": "along", "gap": "compliance", "sag": "less"}[name]
    sign = -1.0 if name == "sag" else 1.0
    for span in spans(12, stiffest=2):  # soft ones, so that strains are not linear up to rounding
        tension = 3.0 * hanging.least_tension(*span) + 0.01 * span[4]

        def value(p, span=span):
            return jnp.sum(getattr(hanging_springs.under(p[0], *span), name))

        stated = sign * jnp.sum(getattr(hanging_springs.under(tension, *span), rate))
        assert slope(value, tension[None], [stated]) == pytest.approx(2, abs=0.1)
        assert slope(value, tension[None], [1.01 * stated]) < 1.5  # can fail


@pytest.mark.parametrize("stiffness", [1e6, 1e9, 1e12, 1e14])
@pytest.mark.parametrize("lengths", [(10.2, 9.9), (11.0, 9.2), (10.002, 9.999)])
def test_stiff_spans_of_which_one_starts_slack(lengths, stiffness):
    """Two spans, one too long, one too short at the start: few steps whatever the stiffness."""
    nodes = np.array([[0.0, 0, 0], [10, 0, 0], [20, 0, 0]])
    cables = jc.Catenaries(
        [[0, 1], [1, 2]], axial_stiffness=stiffness, weight=30.0, rest_length=lengths
    )
    structure = jc.Structure(nodes, cables, jc.pinned([0, 2]))
    loads = jc.NodalLoads([1], (0.0, 0.0, -3e3))
    solution = jc.solve(structure, [jc.Phase(loads=jc.SelfWeight()), jc.Phase(loads=loads)])
    assert int(solution.status) == jc.status.OK
    assert max(int(jnp.max(phase.path.iterations)) for phase in solution.phases) <= 30

    elements = [
        Element("catenary", (k, k + 1), stiffness, WIDE(length), load=(0.0, 0.0, -30.0))
        for k, length in enumerate(lengths)
    ]
    free, load = np.zeros((3, 3), bool), np.zeros((3, 3))
    free[1], load[1, 2] = True, -3e3
    found = find(Scene(nodes, free, load, elements))
    assert found.found
    # tensions follow from the chord, whose rounding leaves EA eps u/L in them, beside the tolerance
    moved = float(np.abs(found.displacement).max())
    floor = 1e-9 * float(found.scale) + 16 * stiffness * np.finfo(float).eps * (moved / 10 + 1)
    assert np.abs(solution.tension - np.array(found.tension, float)).max() <= floor
