"""Limit loads of plane extensible rods by the shooting method, independently of jaxcable.

``x' = (1+e) cos t, z' = (1+e) sin t, t' = M/EI, M' = (1+e)(H sin t - V cos t)`` with the axial
strain ``e = (H cos t + V sin t)/EA``: the geometrically exact rod without shear (Reissner 1972).
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve, minimize_scalar


def along(state, force, length, ea, ei):
    """Integrate (x, z, t, M) over a length under a constant section force (H, V)."""
    H, V = force

    def rates(_, y):
        cos, sin = np.cos(y[2]), np.sin(y[2])
        stretch = 1 + (H * cos + V * sin) / ea
        return [stretch * cos, stretch * sin, y[3] / ei, stretch * (H * sin - V * cos)]

    found = solve_ivp(rates, (0, length), state, "DOP853", rtol=1e-11, atol=1e-11)
    return found.y[:, -1]


def lee_frame(w, guess, ea=6 * 720.0, ei=2 * 720.0, length=120.0):
    """Unknowns (t0, H, V, P) of Lee's frame whose loaded point has moved down by w."""

    def misses(p):
        t0, H, V, P = p
        corner = along([0, 0, t0, 0], (H, V), length, ea, ei)
        corner[2] -= np.pi / 2
        loaded = along(corner, (H, V), 0.2 * length, ea, ei)
        end = along(loaded, (H, V + P), 0.8 * length, ea, ei)
        return [
            loaded[1] - (length - w),
            end[0] - length,
            end[1] - length,
            end[3] / 100,
        ]

    found, _, flag, message = fsolve(misses, guess, xtol=1e-12, full_output=True)
    if flag != 1 and np.abs(misses(found)).max() > 1e-8:
        raise RuntimeError(message)
    return found


def lee_limit(near, guess):
    """Largest P of Lee's frame near the deflection `near`, and its deflection."""
    start = lee_frame(near, guess)

    def negative(w):
        return -lee_frame(w, start)[3]

    bounds = (near - 0.5, near + 0.5)
    best = minimize_scalar(negative, bounds=bounds, method="bounded", options={"xatol": 1e-5})
    return -best.fun, best.x


def toggle(push, guess, half_span=12.943, rise=0.386, ea=0.753 * 0.243 * 1.03e7, ei=None):
    """Load on the apex of Williams' toggle pushed down by `push`: (H, V, M0), half of it."""
    ei = 0.753 * 0.243**3 / 12 * 1.03e7 if ei is None else ei
    length, slope = np.hypot(half_span, rise), np.arctan2(rise, half_span)

    def misses(p):
        H, V, M = p
        end = along([0, 0, slope, M], (H, V), length, ea, ei)
        return [end[0] - half_span, end[1] - rise + push, end[2] - slope]

    found, _, flag, message = fsolve(misses, guess, xtol=1e-12, full_output=True)
    if flag != 1 and np.abs(misses(found)).max() > 1e-8:
        raise RuntimeError(message)
    return found


def toggle_limits():
    """First maximum and following minimum of the load on the apex, and where they are."""
    pushes, p, found = np.linspace(0.01, 0.6, 60), np.zeros(3), []
    for push in pushes:
        p = toggle(push, p)
        found.append(p)
    load = -2 * np.array(found)[:, 1]
    out = []
    for sign, k in ((1, int(np.argmax(load[:40]))), (-1, 25 + int(np.argmin(load[25:55])))):
        best = minimize_scalar(
            lambda w, sign=sign, k=k: sign * 2 * toggle(w, found[k])[1],
            bounds=(pushes[k - 1], pushes[k + 1]),
            method="bounded",
            options={"xatol": 1e-6},
        )
        out.append((-sign * best.fun, best.x))
    return out
