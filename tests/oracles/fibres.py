"""Sections of the tests, and forces of their fibres summed by NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
from oracles.traced import traced

import jaxcable as jc
from jaxcable import materials
from jaxcable.sections import Section

STEEL_YIELD = 235e6 / 210e9
REVERSIBLE = materials.steel(unloading="reversible")
CONCRETE = jc.Polygonal(  # parabola of EN 1992-1-1, 3.1.7, by four points; tension nearly cut off
    [-3.5e-3, -2e-3, -1.5e-3, -1e-3, -5e-4, 0.0, 5e-6, 5e-2],
    [-30e6, -30e6, -28.125e6, -22.5e6, -13.125e6, 0.0, 0.13125e6, 0.15e6],
)
PERFECT = materials.steel(hardening=0.0, unloading="reversible")
LONG = jc.Polygonal([-1, -STEEL_YIELD, 0, STEEL_YIELD, 1], [-235e6, -235e6, 0, 235e6, 235e6])
SECTIONS = {
    "steel rectangle": Section.rectangle(0.1, 0.2, REVERSIBLE, (6, 8)),
    "concrete-filled tube": Section.composite(
        [
            Section.disc(0.28, CONCRETE, (6, 6)),
            Section.ring(0.3, 0.01, REVERSIBLE, (1, 16)),
        ]
    ),
    "perfectly plastic rectangle": Section.rectangle(0.1, 0.2, PERFECT, (6, 8)),
}


def composite_cells(n):
    """Concrete-filled tube; cells of the core and of the wall are halved together."""
    core = Section.disc(0.28, jc.Elastic(33e9), (4 * n, 4 * n))
    return Section.composite([core, Section.ring(0.3, 0.01, jc.Elastic(210e9), (n, 16 * n))])


# --- by NumPy


def law_sum(section, strains, stress_of=None):
    """N, My, Mz [n, 3] by a NumPy fibre sum; `stress_of(law, strain)` or the points' curve."""
    y, z, area = (np.asarray(v) for v in (section.y, section.z, section.area))
    e = strains[:, :1] + strains[:, 1:2] * z - strains[:, 2:] * y
    parts = np.split(e, np.cumsum(section.counts)[:-1], axis=1)
    stress = [(stress_of or curve_stress)(*pair) for pair in zip(section.laws, parts, strict=True)]
    force = np.concatenate(stress, axis=1) * area
    return np.stack([force.sum(1), (force * z).sum(1), -(force * y).sum(1)], axis=1)


def curve_stress(law, strain):
    if isinstance(law, jc.Elastic):
        return float(law.E) * strain
    e, s = np.asarray(law.strain), np.asarray(law.stress)
    return np.where((strain >= e[0]) & (strain <= e[-1]), np.interp(strain, e, s), 0.0)


def sizes(section):
    """Sums of largest forces of the fibres: N, and moments about y and z."""
    largest = [np.abs(law.stress).max() for law in section.laws]
    force = np.repeat(largest, section.counts) * np.asarray(section.area)
    lever = np.abs([np.asarray(section.z), np.asarray(section.y)])
    return np.array([force.sum(), *(force * lever).sum(1)])


# --- by the package


@traced
def forces(section, strains):
    return jnp.stack(section.forces(*strains.T), axis=-1)


@traced
def tangent(section, strain):
    return jax.jacfwd(lambda v: jnp.stack(section.forces(*v)))(strain)
