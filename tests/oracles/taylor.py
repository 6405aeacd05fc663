"""Taylor's test of a gradient: with the right one the remainder falls with slope 2, else with 1."""

import weakref

import numpy as np

import jaxcable as jc

TIGHT = jc.Newton(tol=1e-13)
"""Newton's method to rounding, so that what is left of its iteration is no part of a remainder."""


def slope(value, p, gradient, size=1.0):
    """Slope of log remainder over log step, in a random direction; `size` scales the steps."""
    p, value_at = np.asarray(p), _remembered(value)
    direction = np.random.default_rng(1).normal(size=p.shape) * np.max(np.abs(p))
    f0, rate = value_at(p), np.sum(np.asarray(gradient) * direction)
    steps = 4e-4 * size * 0.5 ** np.arange(4)
    remainder = [abs(float(value_at(p + h * direction) - f0 - h * rate)) for h in steps]
    return np.polyfit(np.log(steps), np.log(remainder), 1)[0]


_known = weakref.WeakKeyDictionary()


def _remembered(value):
    """The function, computed once at a point: wrong gradients are tried at the same points."""
    known = _known.setdefault(value, {})

    def value_at(p):
        if p.tobytes() not in known:
            known[p.tobytes()] = value(p)
        return known[p.tobytes()]

    return value_at
