"""Curves, laws that follow them, batched calls of laws, and the paths that strains take."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from oracles.traced import traced

import jaxcable as jc
from jaxcable import materials

E = 200e9

# (strain, stress) of curves; the origin is among the points of all but one
SYMMETRIC = (
    [-2e-2, -4e-3, -1e-3, 0, 1e-3, 4e-3, 2e-2],
    [-380e6, -320e6, -200e6, 0, 200e6, 320e6, 380e6],
)

CURVES = {
    "symmetric": SYMMETRIC,
    "unsymmetric": ([-3.5e-3, -2e-3, -7e-4, 0, 1e-4, 9e-4], [-38e6, -36e6, -20e6, 0, 3e6, 4e6]),
    "tension-only": ([0, 2e-3, 7e-3, 2.5e-2], [0, 400e6, 700e6, 760e6]),
    "softening": ([-6e-3, -2e-3, 0, 1e-3, 2e-3, 8e-3], [-9e6, -30e6, 0, 20e6, 24e6, 3e6]),
    "origin inside a segment": ([-2e-3, -1e-3, 1e-3, 5e-3], [-1.5e8, -1e8, 1e8, 2e8]),
}

LAWS = {name: jc.Polygonal(*points) for name, points in CURVES.items()}

# concave curves of elastic unloading; slopes from the origin are equal on both sides
ELASTIC = {
    "steel": materials.steel(),
    "four points": jc.Polygonal(*SYMMETRIC, "elastic"),
    "perfectly plastic": materials.steel(hardening=0.0),
    "unsymmetric yield": jc.Polygonal(
        [-2e-2, -5e-3, -2e-3, 0, 1e-3, 3e-3, 2e-2],
        [-1.15e9, -7e8, -4e8, 0, 2e8, 4e8, 9.1e8],
        "elastic",
    ),
    "one corner against two": jc.Polygonal(
        [-2e-2, -5e-3, -2e-3, 0, 1e-3, 2e-2],
        [-1.15e9, -7e8, -4e8, 0, 2e8, 2.1e9],
        "elastic",
    ),
}

CABLES = {
    "strand": materials.strand(),
    "four points": jc.Polygonal(*CURVES["tension-only"], "elastic"),
    "steel without compression": materials.steel().tension_only(),
}


def apart(found, expected):
    """Largest difference."""
    return np.abs(found - expected).max()


def points_of(law):
    return np.asarray(law.strain), np.asarray(law.stress)


def virgin(law):
    return np.zeros(law.n_memory) if law.n_memory else None


def curve(strain, stress, at):
    """The curve by NumPy: zero beyond the ends and, without compression branch, below zero."""
    inside = (at >= strain[0]) & (at <= strain[-1])
    return np.where(inside, np.interp(at, strain, stress), 0.0)


def area_under(strain, stress, at):
    """Integral of the curve from zero to every `at`, by trapezia between all its corners."""
    out = []
    for e in np.clip(at, strain[0], strain[-1]):
        between = [x for x in strain if min(e, 0) < x < max(e, 0)]
        grid = np.sort([0.0, e, *between])
        out.append(np.sign(e) * np.trapezoid(np.interp(grid, strain, stress), grid))
    return np.array(out)


SIZE = 400  # all batches are filled up to this size: one program for each kind of law


def batched(function):
    """`function(law, number, memory)` of single numbers, for arrays of up to `SIZE` of them."""

    @traced
    def run(law, number, memory):
        each = functools.partial(function, law)
        return jax.vmap(each, (0, None if memory is None else 0))(number, memory)

    def filled(law, number, memory=None):
        n = len(number)
        rows = np.minimum(np.arange(SIZE), n - 1)
        number = np.asarray(number, float)[rows]
        if memory is not None:
            memory = np.broadcast_to(memory, (n, law.n_memory))[rows]
        return tuple(np.asarray(out)[:n] for out in run(law, number, memory))

    return filled


@batched
def evaluate(law, strain, memory):
    """Stress, its slope, energy, its slope, distance from a corner, whether beyond."""
    stress, slope = jax.value_and_grad(law.stress_at)(strain, memory)
    energy, gradient = jax.value_and_grad(law.energy_at)(strain, memory)
    distance = law.corner_distance(strain, memory)
    return stress, slope, energy, gradient, distance, law.is_ruptured(strain)


@batched
def invert(law, stress, memory):
    """Strain at every stress and its slope."""
    return jax.value_and_grad(law.strain_at)(stress, memory)


def samples(law, n=SIZE, seed=0):
    """Strains from before the first to beyond the last point; none on a corner."""
    strain, _ = points_of(law)
    return np.random.default_rng(seed).uniform(1.2 * min(strain[0], -1e-3), 1.2 * strain[-1], n)


def rounding(law):
    """Rounding of ramps, which go on with the initial slope to the largest strain, Pa."""
    return 1e-14 * float(law.modulus) * np.abs(law.strain).max()


# --- histories


def kinematic(E, tangent, yield_stress):
    """Bilinear kinematic hardening: elastic trial and return in closed form, of many fibres."""
    H = E * tangent / (E - tangent)

    def update(strain, memory):
        over = E * (strain - memory) - H * memory  # back stress H times plastic strain
        flow = np.maximum(0.0, np.abs(over) - yield_stress) / (E + H)
        memory = memory + np.sign(over) * flow
        return E * (strain - memory), memory

    return update


N_PATH = 120


@traced
def _along(law, strains):
    def increment(memory, strain):
        stress = law.stress_at(strain, memory)
        gradient = jax.grad(law.energy_at)(strain, memory)
        settled = law.commit_memory(strain, memory)
        again = law.stress_at(strain, settled)
        back = law.strain_at(stress, memory)
        slack = law.is_slack(strain, memory)
        return settled, (stress, gradient, again, back, settled, slack)

    return jax.lax.scan(increment, jnp.zeros(law.n_memory), strains)[1]


def history(law, strains):
    """Along a path: stress, slope of the energy, stress after settling, inverse, memory, slack."""
    filled = np.append(strains, np.full(N_PATH - len(strains), strains[-1]))
    return tuple(np.asarray(out)[: len(strains)] for out in _along(law, filled))


def random_path(law, seed, n=N_PATH):
    """Strains that wander over the whole curve, with reversals of all sizes."""
    strain, _ = points_of(law)
    rng = np.random.default_rng(seed)
    reach = 0.98 * 10 ** rng.uniform(-1.5, 0, n)
    return reach * rng.uniform(max(strain[0], -0.3 * strain[-1]), strain[-1], n)
