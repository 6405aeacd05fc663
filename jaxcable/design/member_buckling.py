"""Check of flexural buckling of steel members by EN 1993-1-1."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.solution import Solution, State
from ..common import checks, status
from ..common.types import Array, ArrayLike, Float, Int
from ..model.structure import Structure
from ..standards.steel_members import (
    IMPERFECTION_FACTORS,
    buckling_reduction,
    combined_bending,
    critical_force,
)
from ..stiffness.buckling import buckling_factor
from .check import ULTIMATE, UTILIZATION, Terms, warn_if_unusual
from .member_checks import OF_TUBES, OnMembers

_UNITS = {"N": "N", "N_ref": "N", "N_cr": "N", "N_b,Rd": "N", "My": "N m", "Mz": "N m"}


@dataclasses.dataclass(frozen=True)
class MemberBuckling(OnMembers):
    """Flexural buckling of members: ``N/N_b,Rd + My/My_Rd + Mz/Mz_Rd`` with largest moments.

    Moments are those of the deformed structure, so they contain the effect of the axial force on
    deflections, and interaction factors are 1 (conservative beside 6.3.3). Elements in tension have
    the moments alone.

    Args:
        elements, name, of, profile, section_class, yield_strength, places: as of `MemberSection`.
        lengths: buckling lengths about y and z, or one number for both, m. An element is seldom a
            member: give the length of the member.
        factors: instead of lengths, the lowest buckling factor of the loads of each case, without
            unit, as `buckling_factors` returns them, [n_case]; or one number for all cases, or of
            one case, from `stiffness.buckling_factor`. The critical force of an element is then
            ``N_cr = N_ref + factor (N - N_ref)``; where the loads relieve it, that of the case with
            the largest one, or N_ref if all do. For elements that do not take part in buckling it
            is a lower bound, and close to N_ref it says nothing of them: state their `lengths` in a
            check of their own.
        reference: `Solution` or `State` that the factors refer to, whose forces are N_ref; "last
            phase" for the state in which the last phase begins, which a scene file can state, too;
            None: 0.
        curves: buckling curves about y and z, table 6.2; or one for both.
        chi_lt: reduction of My for lateral torsional buckling, without unit; 1.0 for hollow
            sections, or where the flange in compression is held.
        gamma_m1: partial factor, without unit.
        youngs_modulus: modulus of elasticity, Pa.

    Example:
        >>> tube = jc.catalogue.profile_data("CHS 168.3x8")
        >>> strut = jc.Bars([[0, 1]], axial_stiffness=210e9 * tube.A)
        >>> supports = jc.pinned([0]) + jc.restrained([1], "xy")
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, 4.0]], strut, supports)
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], (0, 0, -400e3))))
        >>> buckling = jc.design.MemberBuckling(
        ...     profile=tube, yield_strength=355e6, lengths=4.0, curves="a"
        ... )
        >>> found = jc.design.checks(structure, solution, buckling)
        >>> print(found["member buckling"].utilization.round(3))
        [0.389]
    """

    name: str = "member buckling"
    of: Sequence[str] = ULTIMATE
    lengths: Float[ArrayLike, ""] | Float[ArrayLike, " 2"] | None = None
    factors: Float[ArrayLike, ""] | Float[ArrayLike, " n_case"] | None = None
    reference: Literal["last phase"] | Solution | State | None = None
    curves: str | Sequence[str] = ("c", "c")
    chi_lt: Float[ArrayLike, ""] = 1.0
    gamma_m1: Float[ArrayLike, ""] = 1.0
    youngs_modulus: Float[ArrayLike, ""] = 210e9

    clause = "EN 1993-1-1:2005, 6.3.1, 6.3.3 with k = 1 on moments of second order"
    formula = "-N/N_b,Rd + My/(chi_LT Wy f_y/gamma_M1) + Mz/(Wz f_y/gamma_M1), " + (
        f"N_b,Rd = min(chi_y, chi_z) A f_y/gamma_M1; {OF_TUBES}"
    )
    units = _UNITS
    not_covered = "shear, torsional buckling, lateral torsional buckling beyond chi_LT, class 4"

    def __post_init__(self):
        super().__post_init__()
        pair = (self.curves,) * 2 if isinstance(self.curves, str) else tuple(self.curves)
        if len(pair) != 2:
            raise ValueError(f"curves = {self.curves!r}: expected two, about y and z")
        for curve in pair:
            checks.require_one_of(curve, "curves", list(IMPERFECTION_FACTORS))
        object.__setattr__(self, "curves", pair)
        if (self.lengths is None) == (self.factors is None):
            raise ValueError("lengths, factors: give one of them, buckling lengths or factors")
        if self.factors is not None and checks.as_floats(self.factors, "factors").ndim > 1:
            raise ValueError("factors: expected one number, or one for each case, [n_case]")
        if self.lengths is not None:
            lengths = np.asarray(checks.as_floats(self.lengths, "lengths"))
            if lengths.shape not in ((), (2,)):
                raise ValueError(
                    f"lengths = {self.lengths}: expected one number, or two, about y and z; other "
                    "members get a check of their own, by elements"
                )
            lengths = np.broadcast_to(lengths, (2,))
            warn_if_unusual("lengths", lengths, 0.0, 1e3, "are they in m?")
            if not (lengths > 0).all():
                raise ValueError(f"lengths = {self.lengths}: expected positive lengths, m")
            object.__setattr__(self, "lengths", tuple(lengths.tolist()))
        warn_if_unusual("youngs_modulus", self.youngs_modulus, 1e9, 1e12, "is it in Pa?")
        if isinstance(self.reference, str):
            checks.require_one_of(self.reference, "reference", ["last phase"])
        if self.reference is not None and self.factors is None:
            raise ValueError("reference: belongs to factors, which are missing")

    def for_case(self, case: Int[ArrayLike, ""], n_case: int) -> MemberBuckling:
        """Return the check with the factor of one case, of `n_case`."""
        if self.factors is None or np.ndim(self.factors) == 0:
            return self
        if len(self.factors) != n_case:
            raise ValueError(
                f"{self.name}: factors: expected one number, or {n_case}, one for each case, got "
                f"{len(self.factors)}"
            )
        return dataclasses.replace(self, factors=jnp.asarray(self.factors)[case])

    def inputs(self) -> dict[str, Any]:
        """Return section, buckling lengths or factor, curves and so on, by labels of a report."""
        if self.lengths is None:
            how: dict[str, Any] = {"buckling factor": self.factors}
        else:
            lengths = np.broadcast_to(np.asarray(self.lengths), (2,)).tolist()
            how = {f"L_cr,{k} (m)": v for k, v in zip("yz", lengths, strict=True)}
        how |= {"curves": " and ".join(self.curves), "chi_LT": self.chi_lt}
        return {**super().inputs(), **how, "gamma_M1": self.gamma_m1}

    def _reference_compression(self, structure, solution):
        """Return the compressive forces of the reference, [n_item], N; negative in tension."""
        begin = self.reference
        if begin is None:
            return 0.0
        if isinstance(begin, str):
            if len(solution.phases) < 2:
                raise ValueError(
                    f"{self.name}: reference = {begin!r}: the solution has one phase alone; "
                    "give the Solution that it was started from"
                )
            begin = solution.phases[-2]
        return -self.checked_values(structure, begin.peak_tension)

    def _reductions(self, critical):
        """Return the reduction factors chi about y and about z at critical forces about both, N."""
        squash = self.section.A * jnp.asarray(self.yield_strength)
        return [
            buckling_reduction(jnp.sqrt(squash / force), curve)
            for force, curve in zip(critical, self.curves, strict=True)
        ]

    def evaluate(self, structure: Structure, solution: Solution) -> Terms:
        """Return axial force, resistance, N, largest moments, N m, and utilization, [n_item]."""
        forces = self._section_forces_of_checked(structure, solution)
        smallest, s = forces[..., 0].min(axis=1), self.section
        compression = jnp.maximum(-smallest, 0.0)
        by_factor: Terms = {}
        if self.factors is not None:
            factor = jnp.asarray(self.factors)
            reference = jnp.broadcast_to(
                self._reference_compression(structure, solution), compression.shape
            )
            added = compression - reference
            more = jnp.where(added > 0, factor * jnp.where(added > 0, added, 1.0), 0.0)
            # tension at the critical load: no buckling; an unknown factor leaves NaN
            total = reference + jnp.where(jnp.isnan(factor), jnp.nan, more)
            by_factor = {"N_ref": -reference, "N_cr": jnp.where(total <= 0, jnp.inf, total)}
            critical = [by_factor["N_cr"]] * 2
        else:
            modulus = jnp.asarray(self.youngs_modulus)
            lengths: Any = self.lengths  # as long as there are no factors
            pairs = zip((s.Iy, s.Iz), lengths, strict=True)
            critical = [critical_force(inertia, length, modulus) for inertia, length in pairs]
        strength = jnp.asarray(self.yield_strength) / self.gamma_m1
        My, Mz = (jnp.abs(forces[..., k]) for k in (4, 5))
        about_y, about_z = My / (self.chi_lt * s.Wy * strength), Mz / (s.Wz * strength)
        if s.circular:
            bending = combined_bending(about_y, about_z, s).max(axis=1)
        else:  # the largest of each, wherever they are (6.3.3)
            bending = about_y.max(axis=1) + about_z.max(axis=1)
        chi_y, chi_z = (jnp.broadcast_to(x, bending.shape) for x in self._reductions(critical))
        resistance = jnp.minimum(chi_y, chi_z) * s.A * strength
        return {
            "N": smallest,
            **by_factor,
            "chi_y": chi_y,
            "chi_z": chi_z,
            "N_b,Rd": resistance,
            "My": My.max(axis=1),
            "Mz": Mz.max(axis=1),
            UTILIZATION: compression / resistance + bending,
        }

    def across_cases(
        self, terms: dict[str, Float[Array, "n_case n_item"]]
    ) -> dict[str, Float[Array, "n_case n_item"]]:
        """Return the terms of all cases, [n_case, n_item] each; some know more of critical forces.

        A case that relieves an element only says that its critical force is above N_ref: the
        largest of the cases that compress it further is taken.
        """
        if self.lengths is not None or self.reference is None:
            return terms
        compression, reference = jnp.maximum(-terms["N"], 0.0), -terms["N_ref"]
        relieved, critical = compression <= reference, terms["N_cr"]
        loaded = ~relieved & ~jnp.isnan(critical)
        found = jnp.max(jnp.where(loaded, critical, 0.0), axis=0)
        critical = jnp.where(relieved, jnp.maximum(found[None], reference), critical)
        critical = jnp.where(critical <= 0, jnp.inf, critical)
        chi_y, chi_z = self._reductions([critical] * 2)
        strength = jnp.asarray(self.yield_strength) / self.gamma_m1
        resistance = jnp.minimum(chi_y, chi_z) * self.section.A * strength
        bending = terms[UTILIZATION] - compression / terms["N_b,Rd"]
        own = {"N_cr": critical, "chi_y": chi_y, "chi_z": chi_z, "N_b,Rd": resistance}
        return {**terms, **own, UTILIZATION: compression / resistance + bending}


def buckling_factors(
    structure: Structure, solutions: Solution, reference: Solution | State | None = None
) -> Float[np.ndarray, " n_case"]:
    """Find the lowest buckling factor of every case, one eigenproblem each.

    Args:
        structure: `Structure`.
        solutions: `Solution` with a leading axis [n_case].
        reference: as of `stiffness.buckling_factor`: the prestressed state.

    Returns:
        Factors, [n_case], -, for `MemberBuckling`; NaN for cases that have failed, and where there
        is no estimate, such as in those in which elements have become slack since the reference.

    Raises:
        ValueError: as `stiffness.buckling_factor`.

    Example:
        >>> structure, phases = jc.scenes.von_mises_truss(load=100.0)
        >>> pushes = [jc.Phase(loads=jc.NodalLoads([1], (0, 0, -p))) for p in (50.0, 100.0)]
        >>> solutions = jc.design.solve_cases(structure, jc.Phase(), pushes)
        >>> factors = jc.design.buckling_factors(structure, solutions)
        >>> print(factors.shape, bool(factors[0] > factors[1] > 1))
        (2,) True
    """
    found = np.full(len(solutions.status), np.nan)
    for k in np.flatnonzero(np.asarray(solutions.status) == status.OK):
        one = jax.tree.map(lambda values, k=k: values[k], solutions)
        found[k] = float(buckling_factor(structure, one, reference).factor[0])
    return found
