"""Sections by their stiffnesses, without fibres: given as numbers, or made by an analysis.

`LinearSection` has the numbers that a user gives. `SectionStiffness` is what an analysis evaluates,
of such a section and of a fibre section whose laws are all linear: a 3 x 3 matrix.
"""

from __future__ import annotations

from typing import Any, NoReturn

import jax.numpy as jnp

from ..common import checks
from ..common.rules import Rule, positive, refuse_if_broken
from ..common.tree import pytree, replace, set_fields
from ..common.types import Array, ArrayLike, Float
from ..materials import Elastic
from ..materials.law import Law, Numbers, Values


@pytree
class SectionStiffness:
    """Stiffness that replaces a `section.Section` in an element if all its laws are linear.

    Attributes:
        matrix: derivative of (N, My, Mz) by (e0, ky, kz), [3, 3], N, N m and N m2.
        torsion: torsional stiffness, N m2, or None if it is not known.
        GAy, GAz: shear stiffnesses along y and z, N; None: rigid in shear.
    """

    matrix: Float[Array, "3 3"]
    torsion: Float[Array, ""] | None
    GAy: Float[Array, ""] | None = None
    GAz: Float[Array, ""] | None = None

    is_elastic = True
    has_rupture = False
    has_memory = False

    @property
    def laws(self) -> tuple[Law]:
        """Linear law of an area of 1 m2 that has the axial stiffness EA; a tuple of one."""
        return (Elastic(self.matrix[0, 0]),)

    def uniaxial(self) -> tuple[Float[Array, ""], Law]:
        """Return an area of 1 m2, and the linear law that over it has the axial stiffness."""
        return jnp.ones_like(self.matrix[0, 0]), *self.laws

    def stiffness(self) -> Float[Array, "3 3"]:
        """Return the derivative of (N, My, Mz) by (e0, ky, kz), [3, 3], N, N m and N m2."""
        return self.matrix

    def torsional_stiffness(self) -> Float[Array, ""] | None:
        """Return the torsional stiffness, N m2, or None if it is not known."""
        return self.torsion

    def energy(self, e0: Numbers, ky: Numbers, kz: Numbers, memory: None = None) -> Values:
        """Return the stored energy per length, J/m; there are no history variables."""
        strain = jnp.stack(jnp.broadcast_arrays(e0, ky, kz), axis=-1)
        return 0.5 * jnp.sum(strain * (strain @ self.matrix), axis=-1)


@pytree
class LinearSection:
    """A cross-section of beams by its stiffnesses, without fibres; all laws are linear.

    `Section.linear` makes one, and `lattice` the one that replaces a lattice mast. Without fibres
    there are no stresses, no capacity and no picture of the section.

    Attributes:
        EA: axial stiffness, N.
        EIy, EIz: bending stiffnesses about the section's y and z through the centroid, N m2.
        GJ: torsional stiffness, N m2.
        GAy, GAz: shear stiffnesses along the section's y and z, N, each with its shear coefficient
            in it; None: rigid in shear in this direction.
        EIyz: product of the bending stiffness, the integral of ``E y z``, N m2; None: zero.
        y, z: place of the centroid relative to the axis of the beam, m; None: on the axis.

    Raises:
        ValueError: something that is no scalar, a stiffness that is not positive, or an EIyz that
            is too large for EIy and EIz.

    Example:
        >>> section = jc.Section.linear(EA=420e6, EIy=28e6, EIz=28e6, GJ=4e6, GAy=9e6, GAz=9e6)
        >>> print(type(section).__name__, f"{section.stiffness()[1, 1] / 1e6:.1f} MN m2")
        LinearSection 28.0 MN m2
    """

    EA: Float[ArrayLike, ""]
    EIy: Float[ArrayLike, ""]
    EIz: Float[ArrayLike, ""]
    GJ: Float[ArrayLike, ""]
    GAy: Float[ArrayLike, ""] | None = None
    GAz: Float[ArrayLike, ""] | None = None
    EIyz: Float[ArrayLike, ""] | None = None
    y: Float[ArrayLike, ""] | None = None
    z: Float[ArrayLike, ""] | None = None

    is_elastic = True
    has_rupture = False
    has_memory = False
    n_fibre = 0

    def __post_init__(self):
        for name in self._all_fields:
            value = getattr(self, name)
            if value is not None:
                set_fields(self, **{name: checks.as_scalar(value, name)})
            elif name in ("EA", "EIy", "EIz", "GJ"):
                raise ValueError(f"{name}: missing; a section by its stiffnesses needs a number")
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the conditions that the stiffnesses are positive, and ``EIyz^2 < EIy EIz``."""
        rules = [positive(n, getattr(self, n)) for n in ("EA", "EIy", "EIz", "GJ", "GAy", "GAz")]
        if self.EIyz is not None:
            text = "must be less than the root of EIy EIz in absolute value"
            values = (self.EIyz, self.EIy, self.EIz)
            rules.append(Rule("EIyz", values, lambda yz, y, z: yz * yz >= y * z, text))
        return rules

    @property
    def torsion(self) -> Float[ArrayLike, ""]:
        """Torsional stiffness GJ, N m2."""
        return self.GJ

    @property
    def laws(self) -> tuple[Law]:
        """Linear law of an area of 1 m2 that has the axial stiffness EA; a tuple of one."""
        return (Elastic(self.EA),)

    def uniaxial(self) -> tuple[Float[Array, ""], Law]:
        """Return an area of 1 m2, and the linear law that over it has the axial stiffness."""
        return jnp.ones_like(jnp.asarray(self.EA)), *self.laws

    def stiffness(self) -> Float[Array, "3 3"]:
        """Return the derivative of (N, My, Mz) by (e0, ky, kz), [3, 3], N, N m and N m2."""
        zero = jnp.zeros_like(jnp.asarray(self.EA))
        y, z, product = (zero if v is None else jnp.asarray(v) for v in (self.y, self.z, self.EIyz))
        first_y, first_z = self.EA * y, self.EA * z
        product = product + first_y * z
        rows = (
            (self.EA, first_z, -first_y),
            (first_z, self.EIy + first_z * z, -product),
            (-first_y, -product, self.EIz + first_y * y),
        )
        return jnp.stack([jnp.stack(jnp.broadcast_arrays(*row)) for row in rows])

    def torsional_stiffness(self) -> Float[ArrayLike, ""]:
        """Return the torsional stiffness GJ, N m2."""
        return self.GJ

    def centroid(self) -> tuple[Float[ArrayLike, ""], Float[ArrayLike, ""]]:
        """Return the place ``(y, z)`` of the centroid relative to the axis of the beam, m."""
        zero = jnp.zeros(())
        return zero if self.y is None else self.y, zero if self.z is None else self.z

    def shifted(
        self, y: Float[ArrayLike, ""] = 0.0, z: Float[ArrayLike, ""] = 0.0
    ) -> LinearSection:
        """Return the section moved by `y`, `z`, m, relative to the axis of the beam.

        Example:
            >>> section = jc.Section.linear(EA=4e8, EIy=2e7, EIz=1e7, GJ=4e6).shifted(z=0.1)
            >>> print(f"{section.stiffness()[1, 1] / 1e6:.1f} MN m2")  # EIy + EA z^2
            24.0 MN m2
        """
        y, z = checks.as_scalar(y, "y"), checks.as_scalar(z, "z")
        y, z = (new if old is None else old + new for old, new in ((self.y, y), (self.z, z)))
        return replace(self, y=y, z=z)

    def with_shear(
        self,
        GAy: Float[ArrayLike, ""] | None = None,
        GAz: Float[ArrayLike, ""] | None = None,
    ) -> LinearSection:
        """Return the section with these shear stiffnesses, N; None: rigid in shear."""
        return replace(self, GAy=GAy, GAz=GAz)

    def for_analysis(self) -> SectionStiffness:
        """Return the matrix of stiffnesses, `SectionStiffness`, which an analysis evaluates."""
        shear = [None if v is None else jnp.asarray(v) for v in (self.GAy, self.GAz)]
        return SectionStiffness(self.stiffness(), jnp.asarray(self.GJ), *shear)

    def fibre_stress(self, *strains: Any, **options: Any) -> NoReturn:
        """Raise ValueError: a section by its stiffnesses has no fibres, hence no stresses."""
        _refuse_fibres("fibre_stress")

    def interaction(self, *numbers: Any, **options: Any) -> NoReturn:
        """Raise ValueError: a section by its stiffnesses has no fibres, hence no capacity."""
        _refuse_fibres("interaction")


def linear(
    cls: type,
    EA: Float[ArrayLike, ""],
    EIy: Float[ArrayLike, ""],
    EIz: Float[ArrayLike, ""],
    GJ: Float[ArrayLike, ""],
    GAy: Float[ArrayLike, ""] | None = None,
    GAz: Float[ArrayLike, ""] | None = None,
    EIyz: Float[ArrayLike, ""] | None = None,
) -> LinearSection:
    """Make a section of beams from its stiffnesses; it has no fibres.

    Args:
        EA: axial stiffness, scalar, N.
        EIy, EIz: bending stiffnesses about y and z through the centroid, scalars, N m2.
        GJ: torsional stiffness, scalar, N m2.
        GAy, GAz: shear stiffnesses along y and z, scalars, N, with the shear coefficient in them;
            None: rigid in shear.
        EIyz: integral of ``E y z``, scalar, N m2; default zero.

    Returns:
        `LinearSection`.

    Raises:
        ValueError: a number that is no scalar or not positive.

    Example:
        A cantilever of 2 m; shear adds ``P L / GA`` to ``P L^3 / 3 EI``:

        >>> section = jc.Section.linear(EA=80e6, EIy=80e3, EIz=80e3, GJ=60e3, GAy=2e6, GAz=2e6)
        >>> beam = jc.Beams([[0, 1]], section=section)
        >>> nodes = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
        >>> structure = jc.Structure(nodes, beam, supports=jc.clamped([0]))
        >>> tip = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -100.0)))
        >>> solution = jc.solve(structure, tip)
        >>> print(f"{jc.describe(solution.status)}: {1e3 * solution.displacement[1, 2]:.3f} mm")
        converged: -3.433 mm
    """
    return LinearSection(EA, EIy, EIz, GJ, GAy, GAz, EIyz)


def _refuse_fibres(name: str) -> NoReturn:
    """Raise ValueError: the result `name` needs fibres, which this section has not."""
    raise ValueError(
        f"{name}: this section is given by its stiffnesses and has no fibres; make a fibre "
        "section, such as Section.ring, for stresses, capacities and pictures"
    )
