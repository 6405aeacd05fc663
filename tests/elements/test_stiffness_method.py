"""The oracle of linear frames has the values of textbooks; rooms compare the package with it."""

import numpy as np
import pytest
from oracles.stiffness_method import Member, local_axes, solve_frame

# Both sides are the same real number: round-off 1e-16 times the condition, at most 1e7, of frames
# of a few members with EA L2 / EI up to 1e4.
EXACT = 1e-9
SECTION = dict(EA=4e8, GJ=3e6, EIy=8e6, EIz=2e6)
X, Y, Z = np.eye(3)


def held(node, kind, axes=(X, Y, Z)):
    return [(node, axis, kind) for axis in axes]


@pytest.mark.parametrize("plane", [1, 2])
@pytest.mark.parametrize(
    ("kind", "start", "shear"),
    [
        ("simple", 0, 1 / 2),
        ("cantilever", -1 / 2, 1),
        ("propped", -1 / 8, 5 / 8),
        ("clamped", -1 / 12, 1 / 2),
    ],
)
def test_beam_in_a_skew_position(kind, start, shear, plane):
    """Uniform load towards -y or -z, Roark, table 8.1: Mz = M, Vy = -V; My = -M, Vz = -V."""
    nodes, up, q = np.array([[1.0, 2, 3], [3, 1, 5]]), (0.3, 0.5, 1), 700.0
    axes, L = local_axes(nodes[1] - nodes[0], up), 3.0
    member = Member(0, 1, **SECTION, up=up, load=-q * axes[plane])
    supports = [*held(0, "translation", axes), (0, axes[0], "rotation")]
    supports += held(0, "rotation", axes[1:]) if kind != "simple" else []
    supports += held(1, "translation", axes[1:]) if kind != "cantilever" else []
    supports += held(1, "rotation", axes[1:]) if kind == "clamped" else []
    s = np.linspace(0, 1, 7)
    M, V = q * L**2 * (start + shear * s - s**2 / 2), q * L * (shear - s)
    expected = np.zeros((7, 6))
    expected[:, plane] = -V
    expected[:, 6 - plane] = M if plane == 1 else -M
    found = solve_frame(nodes, [member], supports, np.zeros((2, 6)))
    for part in (slice(0, 3), slice(3, 6)):  # forces, moments
        size = np.abs(expected[:, part]).max()
        assert np.abs(found.internal(0, s) - expected)[:, part].max() <= EXACT * size
