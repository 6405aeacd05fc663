"""Damping of a motion in time: Rayleigh's, modal ratios, and dashpots."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks, memory_limit
from ..common.rules import Rule, nan_if_broken, not_negative, positive, refuse_if_broken
from ..common.tree import Indices, pytree, set_fields
from ..common.types import Array, ArrayLike, Float, Int
from ..mechanics.assembly import System
from ..model.structure import Structure
from ..spaces.space import Motion
from .inertial_system import DamperMatrices

_DENSE_DAMPING_MATRICES = 6  # dense matrices of all displacements in memory at once


@pytree
class Rayleigh:
    """Damping proportional to mass and stiffness, ``C = mass M + stiffness K``.

    K is the tangent stiffness at the start of the motion and stays as it is. A mode of circular
    frequency w then has the damping ratio ``mass / (2 w) + stiffness w / 2``. The part by mass acts
    on translations of nodes.

    Args:
        mass: factor of the mass matrix, 1/s; default 0.
        stiffness: factor of the stiffness matrix, s; default 0.

    Raises:
        ValueError: no scalars, or negative ones.

    Example:
        >>> damping = jc.dynamics.Rayleigh.from_ratios((2.0, 0.01), (10.0, 0.02))
        >>> omega = 2 * np.pi * 2.0
        >>> print(round(damping.mass / (2 * omega) + damping.stiffness * omega / 2, 6))
        0.01
    """

    mass: Float[ArrayLike, ""] = 0.0
    stiffness: Float[ArrayLike, ""] = 0.0

    def __post_init__(self):
        for name in ("mass", "stiffness"):
            set_fields(self, **{name: checks.as_scalar(getattr(self, name), name)})
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rules that both factors must not be negative, a list of `Rule`."""
        return [not_negative(name, getattr(self, name)) for name in ("mass", "stiffness")]

    @classmethod
    def from_ratios(
        cls, first: tuple[ArrayLike, ArrayLike], second: tuple[ArrayLike, ArrayLike]
    ) -> Rayleigh:
        """Return the Rayleigh damping that has given damping ratios at two frequencies.

        Args:
            first, second: pairs (frequency, Hz; damping ratio, without unit).

        Raises:
            ValueError: equal frequencies, or none above zero; ratios that need a negative factor.
        """
        (f, ratio), (g, other) = first, second
        f = nan_if_broken(positive("first_frequency", f))
        g = nan_if_broken(positive("second_frequency", g))
        for name, own in (("first", ratio), ("second", other)):
            warn_of_large_damping_ratios(own, f"{name}: damping ratio")
        a, b = 2 * np.pi * f, 2 * np.pi * g
        difference = checks.array_if_known(b**2 - a**2)
        if difference is not None and difference == 0:
            raise ValueError("first, second: are of the same frequency; give two")
        stiffness = 2 * (b * other - a * ratio) / (b**2 - a**2)
        return cls(2 * a * ratio - stiffness * a**2, stiffness)


@pytree
class ModalDamping:
    """Damping by a ratio for each of the given modes; other motion is not damped.

    ``C = sum of 2 ratio w M phi phi^T M / (phi^T M phi)`` with the circular frequencies w. The
    matrix couples all nodes: it is meant for up to a thousand displacements.

    Args:
        frequency: frequencies of the modes, [n], Hz.
        shapes: their displacements, [n, n_node, 3], of any scale, as `modes` has them.
        ratios: damping ratios, scalar or [n], without unit.

    Raises:
        ValueError: wrong shapes, negative ratios.

    Example:
        >>> shape = [[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]
        >>> jc.dynamics.ModalDamping([2.0], shape, 0.01).ratios
        array(0.01)
    """

    frequency: Float[ArrayLike, " n"]
    shapes: Float[ArrayLike, "n n_node 3"]
    ratios: Float[ArrayLike, ""] | Float[ArrayLike, " n"]

    def __post_init__(self):
        frequency = checks.as_floats(self.frequency, "frequency")
        shapes = checks.as_floats(self.shapes, "shapes")
        if frequency.ndim != 1 or shapes.ndim != 3 or shapes.shape[::2] != (len(frequency), 3):
            raise ValueError(
                f"shapes: expected [n, n_node, 3] for {frequency.shape} frequencies, got "
                f"{shapes.shape}"
            )
        ratios = checks.floats_of_shape(self.ratios, "ratios", (), frequency.shape)
        set_fields(self, frequency=frequency, shapes=shapes, ratios=ratios)
        refuse_if_broken(self.rules())
        warn_of_large_damping_ratios(ratios, "ratios")

    def rules(self) -> list[Rule]:
        """Return the rule that ratios must not be negative, a list of one `Rule`."""
        return [not_negative("ratios", self.ratios)]


@pytree(indices=("nodes",))
class Dashpots:
    """Viscous dampers between two nodes, or from nodes to the ground.

    Between two nodes the force is ``coefficient`` times the rate of their distance, along the line
    between them. (It is that of the motion that the step expects, an error of third order.) From a
    node to the ground it is against the velocity of the node.

    Args:
        nodes: pairs of nodes, [n, 2], or nodes, [n].
        coefficient: damping coefficient, scalar or [n], N s/m; of dampers to the ground also [3]
            along x, y, z.

    Raises:
        ValueError: wrong shapes, negative coefficients, unknown nodes, a node joined with itself.

    Example:
        >>> jc.dynamics.Dashpots([[0, 1]], 2e3).coefficient
        array([2000.])
    """

    nodes: Int[ArrayLike, " n"] | Int[ArrayLike, "n 2"]
    coefficient: Float[ArrayLike, " ..."]

    def __post_init__(self):
        nodes = np.asarray(self.nodes)
        if nodes.dtype.kind not in "iu" or nodes.shape[1:] not in ((), (2,)) or nodes.ndim == 0:
            raise ValueError(f"nodes: expected indices [n] or [n, 2], got shape {nodes.shape}")
        n, ground = len(nodes), nodes.ndim == 1
        if not ground and (alike := nodes[:, 0] == nodes[:, 1]).any():
            k = int(alike.argmax())
            raise ValueError(f"nodes[{k}] = {nodes[k].tolist()}: joins a node with itself")
        shapes = ((), (n,), (3,), (n, 3)) if ground else ((), (n,))
        value = checks.floats_of_shape(self.coefficient, "coefficient", *shapes)
        if ground:
            value = value[:, None] if value.shape == (n,) and n != 3 else value
        xp = checks.numpy_or_jax(value)
        value = xp.broadcast_to(value, (n, 3) if ground else (n,))
        set_fields(self, nodes=Indices(nodes.astype(np.int32)), coefficient=value)
        refuse_if_broken(self.rules())

    def rules(self) -> list[Rule]:
        """Return the rule that coefficients must not be negative, a list of one `Rule`."""
        return [not_negative("coefficient", self.coefficient)]

    def check(self, structure: Structure) -> None:
        """Raise ValueError if a node is unknown to the structure."""
        checks.require_known_nodes(self.nodes.array, structure.n_node, "dashpot nodes")

    @property
    def is_grounded(self) -> bool:
        """Whether the dampers join nodes to the ground, and not pairs of nodes."""
        return self.nodes.array.ndim == 1

    def matrices(self, nodes: Float[Array, "n_row 3"], motion: Motion) -> DamperMatrices:
        """Return the damping matrix of each dashpot, N s/m, with its direction in a motion.

        Dashpots to the ground have their coefficients along x, y and z, and no direction. One whose
        two nodes coincide gives zero. `nodes` are the initial positions of all rows, m, and
        `motion` is theirs.
        """
        links, c = jnp.asarray(self.nodes.array), jnp.asarray(self.coefficient, nodes.dtype)
        if self.is_grounded:
            return DamperMatrices(links[:, None], jax.vmap(jnp.diag)(c))
        at = (nodes + motion[:, :3])[links]
        along = at[:, 1] - at[:, 0]
        square = jnp.sum(along**2, axis=1)
        scaled = jnp.concatenate([-along, along], axis=1)
        c = c / jnp.where(square > 0, square, jnp.inf)
        return DamperMatrices(links, c[:, None, None] * scaled[:, :, None] * scaled[:, None, :])


def warn_of_large_damping_ratios(ratios: Float[ArrayLike, " ..."], name: str) -> None:
    """Warn of damping ratios of 1 or more, which may be percentages; traced ones are not tested.

    `name` is what the warning calls them.
    """
    known = checks.array_if_known(ratios)
    if known is not None and (known >= 1).any():
        checks.warn_user(
            f"{name} = {float(np.max(known)):g}: is critical damping or more, without vibration; "
            "0.05 is 5 %"
        )


def as_dampings(damping: Any, structure: Structure) -> list[Rayleigh | ModalDamping | Dashpots]:
    """Return the argument `damping` of `transient` as a list, empty for None.

    ValueError for anything but dampings, and for those of unknown nodes or of other structures.
    """
    given = [] if damping is None else damping
    given = given if isinstance(given, list | tuple) else [given]
    for k, one in enumerate(given):
        if not isinstance(one, Rayleigh | ModalDamping | Dashpots):
            kind = checks.describe_type(one, "Rayleigh(mass, stiffness)")
            raise ValueError(f"damping[{k}]: expected a damping of jc.dynamics, got {kind}")
        if isinstance(one, Dashpots):
            one.check(structure)
        if isinstance(one, ModalDamping):
            if one.shapes.shape[1] != structure.n_node:
                raise ValueError(
                    f"damping[{k}].shapes: {one.shapes.shape[1]} nodes, the structure has "
                    f"{structure.n_node}"
                )
            itemsize = np.dtype(one.shapes.dtype).itemsize
            memory_limit.require_memory(
                _DENSE_DAMPING_MATRICES * (3 * structure.n_node) ** 2 * itemsize,
                f"damping[{k}]: a dense damping matrix of {3 * structure.n_node} displacements",
                "take Rayleigh damping",
            )
    return list(given)


def rows_coupled_by_damping(
    structure: Structure, dampings: list[Rayleigh | ModalDamping | Dashpots]
) -> tuple[tuple[Indices, int, tuple[()]], ...]:
    """Return the rows that mass and damping matrices couple, for the sparsity pattern.

    They are triples (rows of each matrix, degrees of freedom of a row, inner unknowns), as
    `dof_map.make_dof_map` takes them.
    """
    rows = structure.motion_rows()[0]
    n_row = structure.n_node if rows is None else len(rows)
    found = [(Indices(np.arange(n_row, dtype=np.int32)[:, None]), structure.space.n_freedom, ())]
    for one in dampings:
        if isinstance(one, Dashpots):
            links = one.nodes.array
            found.append((Indices(links.reshape(len(links), -1)), 3, ()))
        if isinstance(one, ModalDamping):
            found.append((Indices(np.arange(structure.n_node, dtype=np.int32)[None]), 3, ()))
    return tuple(found)


def rayleigh_damping_matrices(
    dampings: list[Any], system: System, masses: list[Array], nodal_mass: Array, x: Motion
) -> tuple[list[Array] | None, Array | None]:
    """Return the damping matrices of all `Rayleigh` dampings: of elements, and of rows by mass.

    Both are as in `Inertia`, `damping` and `nodal_damping`; (None, None) without `Rayleigh`.

    Args:
        dampings: list of dampings.
        system: `System` at the start.
        masses, nodal_mass: mass matrices of elements and masses of rows, as in `Inertia`.
        x: motion at the start, of all rows.
    """
    given = [one for one in dampings if isinstance(one, Rayleigh)]
    if not given:
        return None, None
    by_mass, by_stiffness = (
        sum(jnp.asarray(v) for v in values)
        for values in zip(*((one.mass, one.stiffness) for one in given), strict=True)
    )
    found = []
    for group, mass, tangent in zip(system.groups, masses, system.tangents(x), strict=True):
        n_end = mass.shape[1] // 3
        size, width = n_end * group.n_freedom, group.n_freedom
        own = mass.reshape(len(mass), n_end, 3, n_end, 3)
        more = (0, width - 3)
        own = jnp.pad(own, [(0, 0), (0, 0), more, (0, 0), more]).reshape(len(mass), size, size)
        found.append(by_mass * own + by_stiffness * tangent[:, :size, :size])
    which = jnp.diag(jnp.asarray([1.0] * 3 + [0.0] * (system.space.n_freedom - 3), x.dtype))
    return found, by_mass * nodal_mass[:, None, None] * which[None]


def modal_damping_matrix(one: ModalDamping, momentum: Float[Array, "n n_node 3"]) -> DamperMatrices:
    """Return the one matrix of a `ModalDamping`, which couples all nodes, N s/m.

    `momentum` has the products of the mass matrix and the shapes, [n, n_node, 3], kg m.
    """
    count, n_node = momentum.shape[:2]
    modal_mass = jnp.sum(one.shapes * momentum, axis=(1, 2))
    factor = 4 * jnp.pi * jnp.broadcast_to(one.ratios, count) * one.frequency / modal_mass
    flat = momentum.reshape(count, -1)
    return DamperMatrices(
        jnp.arange(n_node)[None], jnp.einsum("k,ki,kj->ij", factor, flat, flat)[None]
    )
