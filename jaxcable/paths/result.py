"""The result of `trace_path`, and its failure load."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from ..analysis.phase_results import Path
from ..common.tree import pytree
from ..common.types import Array, Float, Int
from ..programs.program_calls import as_program
from .events import FAILURES, Events


@pytree(kw_only=True)
class TracedPath(Path):
    """Equilibrium path with its events: a `Path` whose load factor may rise and fall.

    Points are in the order in which they were reached. Inside a transformation the arrays have
    their full length, with NaN in floats and -1 in counts behind the last point and event.

    Attributes:
        load_factor, displacement, displacement_in_phase, tension, peak_tension: as in a `Path`, one
            entry per point.
        residual, relative_residual, rounding: as in a `Path`, one entry per point.
        n_slack, n_loose, strain: as in a `Path`, one entry per point.
        status: outcome, scalar: OK if the path reached the last load factor; LIMIT_POINT or
            BIFURCATION if it ends there (``through=False``); MATERIAL_FAILURE, MECHANISM; PATH_LOST
            if no next point is found; OUT_OF_EVENTS; OUT_OF_POINTS, or EXCESSIVE_DEFORMATION if the
            load still rises then but little stiffness is left; or the status of the phases before.
        iterations: number of iterations of the corrector, [n].
        factorizations: None here.
        equilibrated: None here.
        n_negative: number of negative eigenvalues of the tangent stiffness, [n]: 0 is stable. If
            the tangent is not symmetric to rounding (pressure that does not keep its direction
            where it has no potential, nodal moments), the number of eigenvalues with negative real
            part; with more than 400 unknowns these are not counted, -1, and only crossings of an
            odd number are seen.
        stiffness: eigenvalue of the tangent stiffness nearest to zero, [n], N/m (of a unit vector
            of all unknowns). If the tangent is not symmetric, its smallest singular value, with the
            sign of the real part of that eigenvalue, or of the determinant where eigenvalues are
            not counted.
        rise: load factor's part of the unit tangent, -1 to 1; changes its sign at limit points,
            [n].
        events: `Events`.

    Example:
        >>> structure, phases = jc.scenes.von_mises_truss(rise=0.1, load=500.0)
        >>> path = jc.trace_path(structure, phases)
        >>> unstable = path.n_negative > 0
        >>> print(path.status, bool(unstable[0]), bool(unstable.any()), bool(unstable[-1]))
        0 False True False
        >>> print(f"{path.load_factor[-1]:.1f}: {path.displacement[-1, 1, 2]:.3f} m")  # through
        1.0: -0.219 m
    """

    _shown: ClassVar[str] = "load_factor, displacement m, n_negative, events"

    status: Int[Array, ""]
    factorizations: None  # type: ignore[assignment]  # of a `Path` only
    equilibrated: None  # type: ignore[assignment]  # likewise
    n_negative: Int[Array, " n"]
    stiffness: Float[Array, " n"]
    rise: Float[Array, " n"]
    events: Events

    @property
    def failure_load(self) -> Float[Array, ""]:
        """Load factor of the first limit point, bifurcation or material failure; NaN if none.

        Differentiable where the event's load factor is, see `Events.load_factor`; a NaN has NaN
        derivatives.

        Returns:
            Scalar.

        Example:
            >>> path = jc.trace_path(*jc.scenes.von_mises_truss(rise=0.1, load=500.0))
            >>> print(path.status, f"{500 * path.failure_load:.6f} N")
            0 381.087190 N
        """
        events = self.events
        return _load_factor_of_first_failure(events.kind, events.load_factor, self.load_factor)


@as_program
def _load_factor_of_first_failure(event_kinds, event_factors, path_factors):
    """Return the load factor of the first event whose kind is one of `FAILURES`; NaN without one.

    Args:
        event_kinds: kinds of all events, [n_event].
        event_factors: load factors of all events, [n_event].
        path_factors: load factors of the path, [n]; they give a NaN derivatives that are NaN, too.
    """
    fails = jnp.isin(event_kinds, jnp.asarray(FAILURES))
    if event_kinds.shape[0] == 0:
        return jnp.nan * jnp.sum(path_factors)
    first = event_factors[jnp.argmax(fails)]
    # without a failure: NaN from the path, whose derivatives are NaN, and not zero
    nothing = jnp.where(jnp.any(fails), 0.0, jnp.nan) * path_factors[0]
    return jnp.where(jnp.any(fails), first, 0.0) + nothing
