"""Rotations against SciPy's, and moments conjugate to spins against derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxcable.numerics import rotations

RNG = np.random.default_rng(0)
EPS = np.finfo(float).eps


def quaternion(vector):
    return Rotation.from_rotvec(vector).as_quat(scalar_first=True)


def test_products_and_matrices():
    (p, q), v = RNG.normal(size=(2, 3)), RNG.normal(size=3)
    first, second = Rotation.from_rotvec(q), Rotation.from_rotvec(p)
    p, q = quaternion(p), quaternion(q)
    both = rotations.compose(p, q)
    tol = 10 * EPS
    np.testing.assert_allclose(rotations.rotate(both, v), (second * first).apply(v), atol=tol)
    np.testing.assert_allclose(rotations.to_matrix(both), (second * first).as_matrix(), atol=tol)
    back = rotations.compose(rotations.invert(q), 3 * q)
    np.testing.assert_allclose(rotations.normalize(back), rotations.IDENTITY, atol=tol)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 9.9e-3, 1.01e-2, 1.0, 3.0])
def test_exponentials(angle):
    """On both sides of where a series takes over, and their derivatives: of 0, half the axis."""
    spin = angle * np.array([0.6, 0.0, -0.8])
    np.testing.assert_allclose(rotations.exp_map(jnp.asarray(spin)), quaternion(spin), atol=2 * EPS)
    slope = jax.jacfwd(rotations.exp_map)(jnp.asarray(spin))
    h = 1e-5 * np.eye(3)
    expected = [(quaternion(spin + d) - quaternion(spin - d)) / 2e-5 for d in h]
    np.testing.assert_allclose(slope.T, expected, atol=1e-9)  # h^2 and rounding over h


@pytest.mark.parametrize(("degrees", "error"), [(0.0, 1e-16), (10, 1e-15), (23, 1e-11), (45, 1e-7)])
def test_small_rotations_without_cases(degrees, error):
    vector = np.deg2rad(degrees) * np.array([0.6, 0.0, -0.8])
    r = rotations.to_stereographic(-quaternion(vector))  # the same rotation
    assert np.abs(rotations.small_stereographic_to_rotation_vector(r) - vector).max() <= error


def test_a_moment_is_conjugate_to_spins():
    vector, moment = 0.3 * np.array([0.6, 0.5, -0.8]), RNG.normal(size=3)
    q = jnp.asarray(quaternion(vector))

    def turned(spin):
        both = rotations.compose(rotations.exp_map(spin), q)
        return rotations.small_stereographic_to_rotation_vector(rotations.to_stereographic(both))

    expected = jax.jacfwd(turned)(jnp.zeros(3)).T @ moment
    found = rotations.moment_conjugate_to_spin(rotations.to_stereographic(q), jnp.asarray(moment))
    np.testing.assert_allclose(found, expected, rtol=1e-13)
