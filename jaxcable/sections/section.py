"""`Section`: constructors, geometry and equilibrium of a fibre section; forces are in `fibres`."""

from __future__ import annotations

import jax.numpy as jnp

from ..common import checks
from ..common.rules import Rule, positive, refuse_if_broken
from ..common.tree import Indices, pytree, set_fields
from ..common.types import Array, Float
from ..materials import Parallel
from ..materials.law import Law, require_law
from . import capacity, composites, geometry, shapes, shear, strains
from .fibres import Fibres
from .linear_section import SectionStiffness, linear


@pytree(static=("counts", "placed"), indices=("cells",))
class Section(Fibres):
    """A cross-section made of fibres: places y and z, an area and a law each.

    The constructors below make its mesh. Fibres of one law follow each other. The axis of an
    element goes through the origin of the coordinates. `disc`, `ring`, `rectangle`, `i_shape` and
    `box` put the origin at the centre of their shape; `polygon`, `mesh` and `composite` leave it at
    the origin of their points or parts. `centred` moves it to the centroid; it and `shifted` also
    stop beams from warning that the axis is off the centroid.

    The axis also counts as the shear centre: an element twists about it, and loads through it cause
    no torsion. In an L or a channel the centroid and the shear centre are apart, which is not
    modelled. Where the product ``Iyz`` of `inertia` is not zero (an L, a Z), a moment about y bends
    about z as well.

    Attributes:
        y, z: places of the fibres, [n_fibre], m.
        area: areas of the fibres, [n_fibre], m2.
        laws: uniaxial laws, in a list; fibres of one law follow each other.
        counts: number of fibres of each law, in a list; left out where there is one law.
        torsion: Saint-Venant torsion constant J, the share of each law, [n_law], m4, or None: beams
            then need a `torsional_stiffness` of their own.
        points: points of a mesh for pictures, [n_point, 2], m, or None; set by what makes meshes.
        cells: the four points of each fibre in a mesh for pictures, [n_fibre, 4], or None; set by
            what makes meshes.
        own: second moments of area of each fibre about its own centroid, of z^2 (Iy, for moments
            about y), y^2 (Iz) and yz, [n_fibre, 3], m4; None for fibres that are points with an
            area: a single one does not resist bending. They make `inertia` exact, and the forces of
            a section whose laws are linear. Other laws are evaluated at the centroids of the
            fibres.
        placed: False if the axis of beams, which goes through the origin of y and z, is merely the
            origin of the numbers given; beams then warn unless it is the centroid. It is set by
            what makes and moves sections.
        GAy, GAz: shear stiffnesses along y and z, scalars, N, with the shear coefficient in them;
            None, the default, is rigid in shear. They are linear whatever the laws of the fibres;
            `with_shear` sets them.

    Raises:
        ValueError: wrong shapes, an area that is not positive, something that is no law, `counts`
            that do not add up.

    Example:
        A rod of 50 mm, as in the paper's saddle net:

        >>> section = jc.Section.disc(0.05, jc.Elastic(210e9), shape=(10, 10))
        >>> print(f"{section.n_fibre} fibres, {1e4 * section.total_area:.2f} cm2")
        100 fibres, 19.63 cm2
        >>> print(f"{section.stiffness()[0, 0] / 1e6:.1f} MN")  # EA
        412.3 MN
    """

    def __post_init__(self):
        for name in ("y", "z", "area"):
            value = checks.as_floats(getattr(self, name), name)
            if value.ndim != 1 or len(value) != len(self.y) or len(value) == 0:
                raise ValueError(f"{name}: expected shape [n_fibre] as y, got {value.shape}")
            set_fields(self, **{name: value})
        refuse_if_broken(self.rules())
        if self.own is not None:
            set_fields(self, own=checks.as_floats(self.own, "own"))
            if self.own.shape != (self.n_fibre, 3):
                raise ValueError(f"own: expected shape [n_fibre, 3], got {self.own.shape}")
        set_fields(
            self, laws=tuple(self.laws) if isinstance(self.laws, list | tuple) else (self.laws,)
        )
        for k, law in enumerate(self.laws):
            require_law(law, f"laws[{k}]")
        set_fields(self, counts=(len(self.y),) if self.counts is None else tuple(self.counts))
        if len(self.counts) != len(self.laws) or sum(self.counts) != len(self.y):
            raise ValueError(
                f"counts = {self.counts}: expected the number of fibres of each law, "
                f"{len(self.laws)} numbers with the sum {self.n_fibre}"
            )
        for name in ("GAy", "GAz"):
            if (value := getattr(self, name)) is not None:
                set_fields(self, **{name: checks.as_scalar(value, name)})
        for name, shape in (("torsion", (len(self.laws),)), ("points", None)):
            if getattr(self, name) is None:
                continue
            value = checks.as_floats(getattr(self, name), name)
            if value.shape != (shape or (len(value) if value.ndim else 0, 2)):
                wanted = f"one constant per law, {list(shape)}" if shape else "[n_point, 2]"
                raise ValueError(f"{name}: expected shape {wanted}, got {value.shape}")
            set_fields(self, **{name: value})
        if self.cells is not None and not isinstance(self.cells, Indices):
            cells = checks.as_indices(self.cells, "cells", 4)
            count = 0 if self.points is None else len(self.points)
            if len(cells) != self.n_fibre or cells.max(initial=-1) >= count:
                raise ValueError(
                    f"cells: expected four indices of points, 0 to {count - 1}, for each of "
                    f"{self.n_fibre} fibres"
                )
            set_fields(self, cells=Indices(cells))

    def rules(self) -> list[Rule]:
        """Return the conditions that areas of fibres and shear stiffnesses are positive, a list."""
        shear = [positive(name, getattr(self, name)) for name in ("GAy", "GAz")]
        return [positive("area", self.area, "a fibre's area must be positive"), *shear]

    # --- shapes

    disc = classmethod(shapes.disc)
    ring = classmethod(shapes.ring)
    rectangle = classmethod(shapes.rectangle)
    i_shape = classmethod(shapes.i_shape)
    box = classmethod(shapes.box)
    polygon = classmethod(shapes.polygon)
    mesh = classmethod(shapes.mesh)
    composite = classmethod(composites.composite)
    linear = classmethod(linear)

    shifted = geometry.shifted
    centred = geometry.centred
    with_shear = shear.with_shear

    # --- numbers

    @property
    def total_area(self) -> Float[Array, ""]:
        """Area of the section, m2."""
        return jnp.sum(self.area)

    centroid = geometry.centroid
    inertia = geometry.inertia
    torsional_stiffness = geometry.torsional_stiffness

    def uniaxial(self) -> tuple[Float[Array, ""], Law]:
        """Return the area, m2, and the law of its mean stress, as bars and cables need them.

        All fibres have the same strain. Axial force is area times stress; of several laws the
        result is a `Parallel`.

        Example:
            >>> section = jc.Section.disc(0.05, jc.Elastic(210e9))
            >>> area, law = section.uniaxial()
            >>> print(f"{1e6 * area:.1f} mm2, {law.modulus / 1e9:.0f} GPa")
            1963.5 mm2, 210 GPa
        """
        areas = [jnp.sum(self.area[part]) for part in self._law_slices()]
        area: Array = sum(areas)  # type: ignore[assignment]  # an array: there is at least one law
        if len(self.laws) == 1:
            return area, self.laws[0]
        return area, Parallel(self.laws, jnp.stack(areas) / area)

    def for_analysis(self) -> Section | SectionStiffness:
        """Return the section in the form that an analysis evaluates.

        It is a `SectionStiffness` if all laws are linear, or else this one with `extrapolated`
        laws.
        """
        if not self.is_elastic:
            return self.extrapolated()
        torsion = None if self.torsion is None else self.torsional_stiffness()
        return SectionStiffness(self.stiffness(), torsion, *shear.shear_arrays(self))

    # --- equilibrium of the section

    strains = strains.solve_strains
    interaction = capacity.interaction


def section_hint(value: object) -> str:
    """Return how a message goes on if `value`, in place of a `Section`, is a profile or its name.

    The text follows the name of an argument; it is empty for all other values.
    """
    if isinstance(value, str):
        return f" = {value!r}: expected a Section; make one by catalogue.profile(name, law)"
    if callable(getattr(value, "section", None)):
        return f": expected a Section, got {type(value).__name__}; make one by its .section(law)"
    return ""
