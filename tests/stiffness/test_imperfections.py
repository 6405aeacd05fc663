"""Eigenmodes of a state, structures that deviate by them: closed forms, a strut that buckles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks import problems
from banks.shapes import pieces
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient
from oracles.traced import traced

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
RING = [[REACH, 0, HALF], [0, REACH, HALF], [-REACH, 0, HALF], [0, -REACH, HALF]]
STRUT = jc.Structure(
    np.array([[0, 0, 0], [0, 0, HALF], [0, 0, 2 * HALF], *RING], float),
    {
        "guys": jc.Cables([(1, k) for k in range(3, 7)], axial_stiffness=EA_CABLE),
        # shortening of bars a thousand times as stiff moves the result by 1e-3
        "strut": jc.Bars([(0, 1), (1, 2)], axial_stiffness=1e3 * EA_CABLE),
    },
    supports=jc.pinned([0, *range(3, 7)]) + jc.restrained([2], "xy"),
)
SIDEWAYS = np.zeros((2, 7, 3))
SIDEWAYS[0, 1, 0] = SIDEWAYS[1, 1, 1] = 1.0


@traced
def pushed(amplitudes, load):
    """Solution of the strut with an imperfection (amplitudes [2], m) under a load on its top, N."""
    bent = stiffness.imperfect(STRUT, SIDEWAYS, amplitudes)
    force = jnp.zeros((1, 3)).at[0, 2].set(-load)
    return jc.solve(
        bent,
        [
            jc.Phase(pretension={"guys": TENSION, "strut": None}),
            jc.Phase(loads=jc.NodalLoads([2], force)),
        ],
        TIGHT,
    )


def test_an_imperfection_grows_as_the_buckling_load_says():
    """Over the amplitude (P - BACK P_cr) / (P_cr - P), to first order; its mode is the softest.

    The stiffness of that is the guys' less 2 P / a, negative beyond the critical load.
    """
    for part in (0.3, 0.6):
        solution = converged(pushed(jnp.array([1e-4, 0.0]), part * CRITICAL))
        grown = np.asarray(solution.displacement)[1] / 1e-4
        # the bars shorten by P / EA = 3e-4, which the amplification multiplies
        assert grown[0] == pytest.approx((part - BACK) / (1 - part), rel=5e-3)
        assert abs(grown[1]) < 1e-6
    for part in (0.0, 0.9, 1.2):
        # a perfectly straight strut stays straight at any load
        solution = converged(pushed(jnp.zeros(2), part * CRITICAL))
        found = stiffness.modes(STRUT, solution, n=2)
        # bars shortened by P / EA, guys lowered with the joint: 1e-3
        assert np.abs(found.stiffness / SIDE - (1 - part)).max() < 5e-3
        assert (found.stiffness[0] < 0) == (part > 1)
        # two equal eigenvalues: the modes are some basis of the joint's two ways to go
        joint = found.shapes[:, 1, :2]
        assert np.abs(joint @ joint.T - np.eye(2)).max() < 1e-9
        assert np.abs(np.delete(found.shapes, 1, axis=1)).max() < 1e-9


@pytest.mark.slow
def test_derivative_by_the_amplitude():
    """And the closed form at no amplitude."""

    def aside(amplitudes):
        solution = pushed(amplitudes, 0.6 * CRITICAL)
        return 100 * jnp.array([1.0, -0.7]) @ solution.displacement[1, :2], solution.status

    assert_gradient(aside, [0.03, -0.02], 100.0)
    expected = 100 * (0.6 - BACK) / 0.4 * np.array([1.0, -0.7])
    rate, code = jax.grad(aside, has_aux=True)(jnp.zeros(2))
    assert int(code) == 0
    np.testing.assert_allclose(rate, expected, rtol=5e-3)


# --- modes


def test_modes_of_two_links():
    """Closed form: 2 T / a twice, 2 EA / L0 along the links."""
    ea, tension, half = 1e4, 200.0, 1.0
    structure, _ = problems.two_links(ea, tension, 0.0)
    solution = converged(jc.solve(structure, jc.Phase(pretension=tension)))
    found = stiffness.modes(structure, solution)  # three freedoms: three modes, not six
    expected = [2 * tension / half, 2 * tension / half, 2 * ea * (1 + tension / ea) / half]
    assert np.abs(found.stiffness - expected).max() < 1e-12 * expected[2]
    assert found.shapes.shape == (3, 3, 3)
    assert np.abs(found.shapes[2] - [[0, 0, 0], [1, 0, 0], [0, 0, 0]]).max() < 1e-12
    assert np.abs(np.linalg.norm(found.shapes, axis=-1).max(1) - 1).max() < 10 * EPS
    flat = found.shapes.reshape(3, -1)
    assert (flat[np.arange(3), np.abs(flat).argmax(1)] > 0).all()
    # they are eigenvectors of the tangent, and the state serves as well as the solution
    matrix = np.asarray(stiffness.tangent_stiffness(structure, solution.last))
    own = found.shapes[:, 1]
    assert np.abs(own @ matrix - found.stiffness[:, None] * own).max() < 1e-12 * expected[2]
    # a failed analysis has no modes, the last converged state has
    failed = jc.solve(structure, [jc.Phase(pretension=tension), jc.Phase(pretension=np.nan)])
    assert int(failed.status) != 0
    found = stiffness.modes(structure, failed.last, 1)
    assert found.stiffness[0] == pytest.approx(expected[0], rel=1e-12)
    with pytest.warns(jc.InputWarning, match=r"failed .*, results are NaN; give solution.last"):
        with pytest.raises(ValueError, match="is not finite; the analysis has failed"):
            stiffness.modes(structure, failed, 1)


def test_a_failed_solution_has_no_tangent_and_no_derivative():
    """Also where it is traced; it is told where it is known."""
    structure, _ = problems.two_links(1e4, 200.0, 0.0)

    def entry(tension, of_last):
        phases = [jc.Phase(pretension=200.0), jc.Phase(pretension=tension)]
        solution = jc.solve(structure, phases)
        of = solution.last if of_last else solution
        return stiffness.tangent_stiffness(structure, of)[0, 0]

    with pytest.warns(jc.InputWarning, match="has failed"):
        value, slope = jax.value_and_grad(entry)(np.nan, False)
    assert np.isnan(value) and np.isnan(slope)
    assert np.isfinite(entry(np.nan, True))
    with pytest.warns(jc.InputWarning, match="has failed"):
        assert np.isnan(entry(np.nan, False))
    value, slope = jax.value_and_grad(entry)(300.0, False)
    assert value == entry(300.0, True)
    assert np.isfinite(slope)


def test_supports_of_the_phase_that_the_state_belongs_to():
    structure, _ = problems.two_links(1e4, 200.0, 0.0)
    held = jc.pinned([0, 2]) + jc.restrained([1], "y")
    phases = [jc.Phase(pretension=200.0, supports=held), jc.Phase(supports=jc.pinned([0, 2]))]
    solution = converged(jc.solve(structure, phases))
    assert stiffness.tangent_stiffness(structure, solution).shape == (3, 3)
    last = jc.common.tree.copy_with(
        solution.last, phase=jnp.int32(0)
    )  # as if the second one failed
    assert stiffness.tangent_stiffness(structure, last).shape == (2, 2)
    both = stiffness.tangent_stiffness(structure, last, fixed=np.zeros((3, 3), bool))
    assert both.shape == (9, 9)


@pytest.mark.slow
def test_modes_of_a_cantilever_beam():
    """The softest mode under no load is bending about the weak axis; sections do not turn by it."""
    n, length = 2, 3.0
    nodes, links = pieces(n, length, (0.0, 0.0, 1.0))
    section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(1e9), (20, 20))
    beams = jc.Beams(links, section=section, up=(0, 1.0, 0))
    structure = jc.Structure(nodes, beams, jc.clamped([0]))
    solution = converged(jc.solve(structure, jc.Phase()))
    found = stiffness.modes(structure, solution, n=2)
    assert (found.stiffness > 0).all() and found.shapes.shape == (2, n + 1, 3)
    # width 0.1 along x, height 0.2 along y: bends along x first
    ways = [int(np.abs(shape).max(0).argmax()) for shape in found.shapes]
    assert ways[0] == 0 and np.abs(found.shapes[0][-1, 0]) == pytest.approx(1.0)
    bent = stiffness.imperfect(structure, found.shapes[0], 0.01)
    assert float(bent.nodes[-1, 0]) == pytest.approx(0.01)
    upright = jc.replace(structure, elements=jc.replace(beams, up=None))
    leaning = stiffness.imperfect(upright, found.shapes[0], 0.01)
    axis = np.asarray(leaning.elements.up)
    assert np.ptp(axis, axis=0).max() == 0 and axis[0, 2] == 0


def test_imperfect_moves_the_nodes():
    shapes = np.random.default_rng(0).normal(size=(3, 7, 3))
    for given, amplitudes, expected in (
        (shapes, np.array([0.01, -0.02, 0.05]), [0.01, -0.02, 0.05]),
        (shapes[0], 0.01, [0.01, 0.0, 0.0]),
        (shapes, 0.01, [0.01, 0.01, 0.01]),
    ):
        moved = stiffness.imperfect(STRUT, given, amplitudes)
        way = np.tensordot(expected, shapes, 1)
        assert np.abs(np.asarray(moved.nodes) - STRUT.nodes - way).max() < 10 * EPS
        assert moved.supports is STRUT.supports
