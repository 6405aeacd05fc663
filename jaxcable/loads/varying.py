"""Loads that follow an amplitude: a piecewise linear function of the parameter of their phase."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import Rule, refuse_if_broken
from ..common.tree import apply_numpy_or_jax, pytree, set_fields
from ..common.types import Array, ArrayLike, Float
from ..common.units import SI, Units
from ..model.structure import Structure
from ..programs.joining import concatenate, stack_trees
from .load import Load

_MAX_SHOWN_POINTS = 8  # points of an amplitude that are shown


@pytree
class Amplitude:
    """Factor of a load as a piecewise linear function of the load factor of its phase.

    Attributes:
        parameters: load factors of the points, increasing from 0 to 1, [..., n_point].
        factors: factors of the load at these points, [..., n_point].
    """

    parameters: Float[ArrayLike, "... n_point"]
    factors: Float[ArrayLike, "... n_point"]

    def factor_at(self, parameter: Float[ArrayLike, ""]) -> Float[Array, " ..."]:
        """Interpolate the factor of the load at `parameter`, the load factor of the phase.

        At 0 it is zero, whatever the first factor: a phase begins with what earlier ones left.
        """
        begin, end = self.parameters[..., :-1], self.parameters[..., 1:]
        width = jnp.where(end > begin, end - begin, 1.0)  # points of later phases are all zero
        # no index is looked up: its derivative would scatter, which ends a fused program
        passed = jnp.clip((parameter - begin) / width, 0.0, 1.0)
        rises = self.factors[..., 1:] - self.factors[..., :-1]
        factor = self.factors[..., 0] + jnp.sum(rises * passed, axis=-1)
        return jnp.where(parameter > 0, factor, 0.0)

    def with_points(self, n_point: int) -> Amplitude:
        """Return the same function by `n_point` points; additional ones lie on its last line."""
        count = n_point - len(self.parameters)
        if not count:
            return self
        parts = np.arange(1, count + 1) / (count + 1)

        def more(values):
            before, last = values[-2], values[-1]
            return concatenate([values[:-1], before + parts * (last - before), values[-1:]])

        return jax.tree.map(more, self)

    def rules(self) -> list[Rule]:
        """Return the rules of `parameters` (increasing from 0 to 1), a list of `Rule`."""
        given = self.parameters
        return [
            Rule("parameters", given, lambda v: abs(v[..., :1]) > 0, _describe_first_parameter),
            Rule("parameters", given, lambda v: abs(v[..., -1:] - 1) > 0, _describe_last_parameter),
            Rule(
                "parameters", given, lambda v: v[..., 1:] <= v[..., :-1], _describe_not_increasing
            ),
        ]


def stack_amplitudes(amplitudes: Sequence[Amplitude | None]) -> Amplitude | None:
    """Stack amplitudes to one with a leading axis, padded to equally many points.

    An item that is None is proportional to the load factor of the phase. None if all are None.
    """
    if all(amplitude is None for amplitude in amplitudes):
        return None
    line = np.array([0.0, 1.0])
    given = [Amplitude(line, line) if one is None else one for one in amplitudes]
    n_point = max(len(one.parameters) for one in given)
    return stack_trees([one.with_points(n_point) for one in given])


@pytree
class Varying(Load):
    """A load that follows an amplitude within its phase, not the load factor itself.

    Other loads of a phase grow in proportion to its load factor. This one is multiplied by a
    piecewise linear function of it (an amplitude, or time series): snow before wind, a wind that
    rises and falls, a load that moves from node to node, loading and unloading in one phase.

    A phase begins in the equilibrium that earlier phases left. A first factor that is not zero is a
    load step: the first increment applies it. After the phase the load goes on acting with its
    last factor. Equilibrium is found at the ends of increments only: choose their number so that
    they end at the points of the amplitude. A warning says if they pass by its largest or smallest
    factor.

    Args:
        load: any load, or a `SupportMovement`.
        parameters: load factors of the phase, [n], n >= 2, without unit, increasing from 0 to 1.
        factors: of the load at these, [n], of any sign, without unit. Derivatives by the parameter
            of a point at which an increment ends are the mean of those on both sides.

    Raises:
        ValueError: no load, or one that varies already; wrong shapes; parameters that do not
            increase from 0 to 1 (traced ones end in INVALID_INPUT); in `trace_path`, a load of the
            last phase that varies: its path is that of a single load factor.

    Example:
        A bar of 1 m, EA = 1 MN, under 1 kN which is then reduced to a fifth:

        >>> nodes = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
        >>> bar = jc.Bars([[0, 1]], axial_stiffness=1e6)
        >>> guide = jc.pinned([0]) + jc.restrained([1], "yz")
        >>> structure = jc.Structure(nodes, bar, supports=guide)
        >>> pull = jc.NodalLoads([1], (1e3, 0.0, 0.0))
        >>> load = jc.Varying(pull, parameters=[0.0, 0.5, 1.0], factors=[0.0, 1.0, 0.2])
        >>> solution = jc.solve(structure, jc.Phase(loads=load, increments=4))
        >>> path = solution.phases[0].path
        >>> print(solution.status, path.tension[:, 0].round(3))  # N
        0 [ 500. 1000.  600.  200.]
    """

    load: Load
    parameters: Float[ArrayLike, "2+"]
    factors: Float[ArrayLike, "2+"]

    scales = ("factors",)

    def __post_init__(self):
        if not isinstance(self.load, Load) or isinstance(self.load, Varying):
            kind = checks.describe_type(self.load, "NodalLoads(nodes, forces)")
            raise ValueError(f"load: expected one load without an amplitude, got {kind}")
        for name in ("parameters", "factors"):
            set_fields(self, **{name: checks.as_floats(getattr(self, name), name)})
        shape = self.parameters.shape
        if len(shape) != 1 or shape[0] < 2:
            raise ValueError(f"parameters: expected shape [n] with n >= 2, got {shape}")
        checks.floats_of_shape(self.factors, "factors", shape)
        refuse_if_broken(self.amplitude.rules())

    @property
    def amplitude(self) -> Amplitude:
        """Factor of the load as a function of the load factor of the phase."""
        return Amplitude(self.parameters, self.factors)

    def check(self, structure: Structure) -> None:
        """Raise ValueError if the load that varies does not fit a structure."""
        self.load.check(structure)

    def describe(self, units: Units = SI) -> str:
        """Return the load, in `units`, and the points of its amplitude as text."""
        parameters, factors = (checks.array_if_known(x) for x in (self.parameters, self.factors))
        told = f"{len(self.parameters)} points"
        if parameters is not None and factors is not None and len(parameters) <= _MAX_SHOWN_POINTS:
            pairs = zip(factors, parameters, strict=True)
            told = ", ".join(f"{factor:.6g} at {parameter:.6g}" for factor, parameter in pairs)
        return f"{self.load.describe(units)}; amplitude: {told}"


def split_amplitude(load: Load, where: str, increments: int) -> tuple[Load, Amplitude | None]:
    """Split a load of a phase into the load itself, and its amplitude (None if it has none).

    Warn if no increment ends at the largest or the smallest factor of the amplitude.

    Args:
        load: any load; a `Varying` has an amplitude.
        where: the load as a user writes it, for the warning.
        increments: number of increments of the phase.
    """
    if not isinstance(load, Varying):
        return load, None
    parameters, factors = (checks.array_if_known(x) for x in (load.parameters, load.factors))
    if parameters is not None and factors is not None:
        seen = np.interp(np.arange(1, increments + 1) / increments, parameters, factors)
        seen = np.append(seen, 0.0)  # of the beginning
        low, high, near = seen.min(), seen.max(), 1e-6 * np.abs(factors).max()
        missed = (factors > high + near) | (factors < low - near)
        missed[0] = False  # no increment ends at the beginning
        if missed.any():
            k = int(missed.argmax())
            checks.warn_user(
                f"{where}: factors[{k}] = {factors[k]:.6g} is not reached: with increments = "
                f"{increments} the factor at the ends of increments is {low:.6g} to {high:.6g}; "
                f"choose increments so that one of them ends at load factor {parameters[k]:.6g}"
            )
    return load.load, load.amplitude


def scale_to_peak(load: Load, amplitude: Amplitude | None) -> Load:
    """Return a load times the largest absolute factor of its amplitude.

    It is returned unchanged without an amplitude, or if it has no fields to scale (`Load.scales`).
    """
    if amplitude is None or not load.scales:
        return load
    return load.scaled(
        apply_numpy_or_jax(lambda xp, factors: xp.max(xp.abs(factors)), amplitude.factors)
    )


def _describe_first_parameter(index, values):
    """Return the error message for `parameters`, here `values`, that do not begin at 0."""
    return f"parameters[0] = {values[0]}: must be 0, where the phase begins"


def _describe_last_parameter(index, values):
    """Return the error message for `parameters`, here `values`, that do not end at 1."""
    return f"parameters[{len(values) - 1}] = {values[-1]}: must be 1, where the phase ends"


def _describe_not_increasing(index, values):
    """Return the error message for `parameters`, here `values`, that do not increase at `index`."""
    k = index[0] + 1
    return f"parameters[{k}] = {values[k]}: must be above parameters[{k - 1}] = {values[k - 1]}"
