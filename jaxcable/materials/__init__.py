"""Uniaxial laws, one a file: stress from strain, and from what earlier increments left.

A law is a pytree shared by the elements or fibres of a group. Its members take arrays of any shape:

- ``stress_at(strain, plastic=None)``, Pa; derivatives at corners are those of loading;
- ``energy_at(strain, plastic=None)``: stress integrated over strain, written apart from it, J/m3;
- ``strain_at(stress, plastic=None)``: the inverse on the rising branch from zero; NaN above;
- ``modulus``: slope at the origin; ``capacity``: (smallest, largest) stress;
- ``limits``: strains (lowest, highest) at which the curve ends; ``beyond(strain)``: whether it has
  been left there, and ``breaks`` (static): whether it can be;
- ``continued()``: the law for an iteration, which goes on elastically beyond its ends so that the
  way to an answer may lead through there; the answer itself may not (`status.MATERIAL_FAILURE`);
- ``tension_only()``: the law without its compression branch;
- ``softened(compliance)``: the material in series with a spring, strain per stress, 1/Pa;
- ``rising`` (static): whether stress is known not to fall with strain (the energy is then convex);
- ``corners(plastic)``: strains at which the slope jumps, last axis; ``corner_distance(strain)``;
- ``n_plastic`` (static): how many plastic strains a fibre remembers, 0 for a reversible law;
  ``size_at(strain, plastic)`` is the sum of the absolute stresses of its parts, Pa, which rounding
  is relative to; ``settle(strain, plastic)`` returns them, [..., n_plastic], after an increment
  has ended at `strain`.
"""

from .elastic import Elastic
from .parallel import Parallel
from .polygonal import Polygonal
from .presets import steel, strand, tension_only

__all__ = ["Elastic", "Parallel", "Polygonal", "steel", "strand", "tension_only"]
