"""Second-order cones: scaling, way to the boundary, slacks and corrections, against definitions."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcable.numerics import cones

N = 50


def points(seed, slack):
    """Points (u, X) in the cone with their slacks."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(N, 3)) * 10 ** rng.uniform(-2, 2, (N, 1))
    y = np.sqrt((x**2).sum(1)) * slack * rng.uniform(0.5, 2, N)
    return np.sqrt((x**2).sum(1)) + y, x, y


def pairs(seed, slack=0.1, dtype=np.float64):
    """Pairs of points (u, X) and (N, V), and their slacks."""
    (u, x, y), (n, v, w) = points(seed, slack), points(seed + 1, slack)
    return [np.asarray(a, dtype) for a in (u, x, n, v, y, w)]


def jordan(a, b):
    """Jordan product of points [4]."""
    return np.r_[a @ b, a[0] * b[1:] + b[0] * a[1:]]


def hessian(scaled, k):
    """The matrix of `Scaling` for one pair, [4, 4]."""
    q, c, r, b = (np.asarray(a)[k] for a in scaled)
    a, h = 1 / b, r * c
    block = q * (np.eye(3) - np.outer(c, c)) + a * np.outer(h, h)
    return np.block([[a, -a * h[None]], [-a * h[:, None], block]])


@pytest.mark.parametrize("slack", [10.0, 0.1, 1e-4])
def test_scaling_maps_the_first_point_to_the_second(slack):
    u, x, n, v, y, w = pairs(0, slack)
    scaled = cones.nesterov_todd_scaling(u, x, n, v, y, w)
    for k in range(N):
        matrix = hessian(scaled, k)
        z = np.r_[n[k], -v[k]]
        size = np.abs(matrix) @ np.abs(np.r_[u[k], x[k]])
        assert np.abs(matrix @ np.r_[u[k], x[k]] - z).max() < 1e-12 * size.max()
        # the matrix keeps the cone: F'J F = (det z / det s)^(1/2) J, up to that factor
        mirror = np.diag([1.0, -1, -1, -1])
        factor = (w[k] * (2 * n[k] - w[k])) / (y[k] * (2 * u[k] - y[k]))
        kept = matrix @ mirror @ matrix
        size = np.abs(matrix).max() ** 2
        assert np.abs(kept - factor * mirror).max() < 1e-10 * size


def test_correction_is_that_of_the_definition():
    """``F^-1 (lam \\ (m e - F^-1 ds o F dz))`` with the root F of the inverse, in NumPy."""
    u, x, n, v, y, w = pairs(2)
    scaled = cones.nesterov_todd_scaling(u, x, n, v, y, w)
    rng = np.random.default_rng(3)
    du, dn = rng.normal(size=(2, N))
    dx, dv = rng.normal(size=(2, N, 3))
    m = rng.uniform(size=N)
    beyond = du * dn - (dx * dv).sum(1)
    force, back = cones.second_order_corrector(scaled, (n, v, w), (du, dx, dn, dv), m - beyond)
    for k in range(N):
        values, axes = np.linalg.eigh(hessian(scaled, k))
        root = axes * np.sqrt(values) @ axes.T  # F^-1
        inverse = np.linalg.inv(root)
        lam = root @ np.r_[u[k], x[k]]
        assert lam == pytest.approx(inverse @ np.r_[n[k], -v[k]], rel=1e-8)
        one = np.r_[m[k], 0, 0, 0]
        right = one - jordan(root @ np.r_[du[k], dx[k]], inverse @ np.r_[dn[k], -dv[k]])
        arrow = lam[0] * np.eye(4)
        arrow[0], arrow[:, 0] = lam, lam
        expected = root @ np.linalg.solve(arrow, right)
        size = np.abs(expected).max()
        assert np.abs(np.r_[force[k], back[k]] - expected).max() < 1e-7 * size


def test_rate_leads_to_the_boundary():
    u, x, _, _, y, _ = pairs(4)
    rng = np.random.default_rng(5)
    for _ in range(20):
        du, dx = rng.normal(size=N), rng.normal(size=(N, 3))
        rate = float(cones.inverse_step_to_boundary(u, x, y, du, dx))

        def least(t, du=du, dx=dx):
            return (u + t * du - np.sqrt(((x + t * dx) ** 2).sum(1))).min()

        assert rate > 0
        assert least(0.999 / rate) > 0 > least(1.001 / rate)


def test_slacks_keep_their_digits():
    u, x, _, _, y, _ = pairs(7, slack=1e-12)
    du, dx = 1e-3 * u, 1e-3 * x
    after = cones.slack_after_step(x, y, du, dx, jnp.asarray(0.5))
    assert np.asarray(after) == pytest.approx(1.0005 * y, rel=1e-3)
    naive = (u + 0.5 * du) - np.sqrt(((x + 0.5 * dx) ** 2).sum(1))
    assert np.abs(naive / y - 1).max() > 1e-6  # control
