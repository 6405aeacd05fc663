"""Eigenmodes of a state, structures that deviate by them: closed forms, a strut that buckles."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks import problems
from oracles.taylor import slope

import jaxcable as jc
from jaxcable import stiffness

EPS = np.finfo(float).eps


# --- a strut of two bars, its joint guyed by four level cables: buckles sideways at P = k a / 2

HALF, REACH, EA_CABLE, TENSION = 1.5, 2.0, 1e6, 1e5
SIDE = 2 * EA_CABLE / (REACH / (1 + TENSION / EA_CABLE)) + 2 * TENSION / REACH
"""What the guys hold the joint with, sideways: two along the way, two across it, N/m."""
CRITICAL = SIDE * HALF / 2
BACK = 2 * TENSION / REACH / SIDE
"""Part of that by which guys that were tensioned with the joint aside pull it back."""
SCALE = 1e3  # EA of the bars over that of the cables: shortening moves the result by 1e-3


def strut():
    nodes = np.array(
        [
            [0, 0, 0],
            [0, 0, HALF],
            [0, 0, 2 * HALF],
            *[[x, y, HALF] for x, y in ((REACH, 0), (0, REACH), (-REACH, 0), (0, -REACH))],
        ],
        float,
    )
    mask = np.ones((7, 3), bool)
    mask[1] = mask[2, 2] = False
    return jc.Structure(
        nodes,
        {
            "guys": jc.Cables([(1, k) for k in range(3, 7)], axial_stiffness=EA_CABLE),
            "strut": jc.Bars([(0, 1), (1, 2)], axial_stiffness=SCALE * EA_CABLE),
        },
        supports=jc.Supports(mask),
    )


STRUT = strut()
SIDEWAYS = np.zeros((2, 7, 3))
SIDEWAYS[0, 1, 0] = SIDEWAYS[1, 1, 1] = 1.0


@jax.jit
def pushed(amplitudes, load, structure=STRUT):
    """Solution of the strut with an imperfection (amplitudes [2], m) under a load on its top, N."""
    bent = stiffness.imperfect(structure, SIDEWAYS, amplitudes)
    force = jnp.zeros((1, 3)).at[0, 2].set(-load)
    return jc.solve(
        bent,
        [
            jc.Phase(pretension={"guys": TENSION, "strut": None}),
            jc.Phase(loads=jc.NodalLoads([2], force)),
        ],
        jc.Newton(tol=1e-13),
    )


def amplified(amplitudes, load=0.6 * CRITICAL):
    """Sideways displacement of the joint, [2], m."""
    return pushed(amplitudes, load).displacement[1, :2]


@pytest.mark.slow
def test_an_imperfection_grows_as_the_buckling_load_says():
    """Over the amplitude (P - BACK P_cr) / (P_cr - P), to first order; so is the derivative."""
    for part in (0.3, 0.6):
        solution = pushed(jnp.array([1e-4, 0.0]), part * CRITICAL)
        assert int(solution.status) == 0
        grown = np.asarray(solution.displacement)[1] / 1e-4
        # the bars shorten by P / EA = 3e-4, which the amplification multiplies
        assert grown[0] == pytest.approx((part - BACK) / (1 - part), rel=5e-3)
        assert abs(grown[1]) < 1e-6
    rate = jax.jacrev(amplified)(jnp.zeros(2))
    expected = (0.6 - BACK) / 0.4
    assert np.abs(np.asarray(rate) - expected * np.eye(2)).max() < 5e-3 * expected


def test_derivative_by_the_amplitude():
    @jax.jit
    @functools.partial(jax.value_and_grad, has_aux=True)
    def there(amplitudes):
        solution = pushed(amplitudes, 0.6 * CRITICAL)
        way = jnp.array([1.0, -0.7]) * solution.displacement[1, :2]
        return jnp.sum(way) * 100, solution.status

    def value(amplitudes):
        return there(amplitudes)[0][0]

    at = jnp.array([0.03, -0.02])
    (_, code), gradient = there(at)
    assert int(code) == 0
    assert abs(slope(value, at, gradient, 100.0) - 2) < 0.1
    assert abs(slope(value, at, 1.01 * gradient, 100.0) - 1) < 0.1  # control: a wrong gradient


def test_the_mode_that_buckles_is_the_softest():
    """Its stiffness is that of the guys less 2 P / a, and negative beyond the critical load."""
    for part in (0.0, 0.6, 0.9, 1.2):
        # a perfectly straight strut stays straight at any load
        solution = pushed(jnp.zeros(2), part * CRITICAL)
        assert int(solution.status) == 0
        found = stiffness.modes(STRUT, solution, n=2)
        # bars shortened by P / EA, guys lowered with the joint: 1e-3
        assert np.abs(found.stiffness / SIDE - (1 - part)).max() < 5e-3
        assert (found.stiffness[0] < 0) == (part > 1)
        # two equal eigenvalues: the modes are some basis of the joint's two ways to go
        joint = found.shapes[:, 1, :2]
        assert np.abs(joint @ joint.T - np.eye(2)).max() < 1e-9
        others = np.delete(found.shapes, 1, axis=1)
        assert np.abs(others).max() < 1e-9


# --- modes


def test_modes_of_two_links():
    """Closed form: 2 T / a twice, 2 EA / L0 along the links."""
    ea, tension, half = 1e4, 200.0, 1.0
    structure, _ = problems.two_links(ea, tension, 0.0)
    solution = jc.solve(structure, jc.Phase(pretension=tension))
    assert int(solution.status) == 0
    found = stiffness.modes(structure, solution)  # three freedoms: three modes, not six
    expected = [2 * tension / half, 2 * tension / half, 2 * ea * (1 + tension / ea) / half]
    assert np.abs(found.stiffness - expected).max() < 1e-12 * expected[2]
    assert found.shapes.shape == (3, 3, 3)
    assert np.abs(found.shapes[2] - [[0, 0, 0], [1, 0, 0], [0, 0, 0]]).max() < 1e-12
    assert np.abs(np.linalg.norm(found.shapes, axis=-1).max(1) - 1).max() < 10 * EPS
    flat = found.shapes.reshape(3, -1)
    assert (flat[np.arange(3), np.abs(flat).argmax(1)] > 0).all()
    # they are eigenvectors of the tangent, and the state serves as well as the solution
    matrix = np.asarray(stiffness.tangent_of(structure, solution.last))
    own = found.shapes[:, 1]
    assert np.abs(own @ matrix - found.stiffness[:, None] * own).max() < 1e-12 * expected[2]
    # a failed analysis has a last state, and no other
    failed = jc.solve(structure, jc.Phase(pretension=np.nan))
    assert int(failed.status) != 0
    assert np.isfinite(stiffness.modes(structure, failed, 1).stiffness).all()


def test_supports_of_the_phase_that_the_state_belongs_to():
    structure, _ = problems.two_links(1e4, 200.0, 0.0)
    held = jc.pinned([0, 2]) + jc.Supports(np.array([[0, 0, 0], [0, 1, 0], [0, 0, 0]], bool))
    phases = [jc.Phase(pretension=200.0, supports=held), jc.Phase(supports=jc.pinned([0, 2]))]
    solution = jc.solve(structure, phases)
    assert int(solution.status) == 0
    assert stiffness.tangent_of(structure, solution).shape == (3, 3)
    last = jc.common.tree.copy(solution.last, phase=jnp.int32(0))  # as if the second one failed
    assert stiffness.tangent_of(structure, last).shape == (2, 2)
    both = stiffness.tangent_of(structure, last, fixed=np.zeros((3, 3), bool))
    assert both.shape == (9, 9)


@pytest.mark.slow
def test_modes_of_a_cantilever_beam():
    """The softest mode of the tangent under no load is bending about the weak axis."""
    n, length = 6, 3.0
    nodes = np.column_stack([np.linspace(0, length, n + 1), np.zeros((n + 1, 2))])
    section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(1e9), (20, 20))
    structure = jc.Structure(
        nodes,
        jc.Beams([(k, k + 1) for k in range(n)], section=section, up=(0, 0, 1.0)),
        jc.clamped([0]),
    )
    solution = jc.solve(structure, jc.Phase())
    assert int(solution.status) == 0
    found = stiffness.modes(structure, solution, n=2)
    assert (found.stiffness > 0).all() and found.shapes.shape == (2, n + 1, 3)
    # width 0.1 along y, height 0.2 along z: bends along y first
    ways = [int(np.abs(shape).max(0).argmax()) for shape in found.shapes]
    assert ways[0] == 1 and np.abs(found.shapes[0][-1, 1]) == pytest.approx(1.0)
    bare = stiffness.imperfect(structure, found.shapes[0], 0.01)
    assert float(bare.nodes[-1, 1]) == pytest.approx(0.01)


# --- imperfect


def test_imperfect_moves_the_nodes():
    shapes = np.random.default_rng(0).normal(size=(3, 7, 3))
    amplitudes = np.array([0.01, -0.02, 0.05])
    moved = stiffness.imperfect(STRUT, shapes, amplitudes)
    expected = STRUT.nodes + sum(a * s for a, s in zip(amplitudes, shapes, strict=True))
    assert np.abs(np.asarray(moved.nodes) - expected).max() < 10 * EPS
    alone = stiffness.imperfect(STRUT, shapes[0], 0.01)
    assert np.abs(np.asarray(alone.nodes) - STRUT.nodes - 0.01 * shapes[0]).max() < 10 * EPS
    alike = stiffness.imperfect(STRUT, shapes, 0.01)
    assert np.abs(np.asarray(alike.nodes) - STRUT.nodes - 0.01 * shapes.sum(0)).max() < 10 * EPS
    assert moved.supports is STRUT.supports


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (
            lambda: stiffness.imperfect(STRUT, np.zeros((2, 6, 3)), 0.0),
            r"shapes: expected \[k, 7, 3\]",
        ),
        (lambda: stiffness.imperfect(STRUT, SIDEWAYS, [0.1] * 3), "amplitudes: expected a scalar"),
        (lambda: stiffness.modes(STRUT, None, n=0), "n = 0: expected a whole number"),
        (lambda: stiffness.modes(STRUT, None), "state: expected a Solution or its last"),
        (
            lambda: stiffness.tangent_of(STRUT, STRUT),
            "state: expected a Solution .*, got Structure",
        ),
        (
            lambda: jax.jit(lambda nodes: stiffness.modes(jc.replace(STRUT, nodes=nodes), None))(
                STRUT.nodes
            ),
            "state: is traced",
        ),
        (
            lambda: stiffness.tangent_of(
                STRUT, pushed(jnp.zeros(2), 0.6 * CRITICAL), fixed=np.zeros((2, 3), bool)
            ),
            r"fixed: expected booleans of shape \(7, 3\), got \(2, 3\)",
        ),
    ],
)
def test_refused(ask, message):
    with pytest.raises(ValueError, match=message):
        ask()
