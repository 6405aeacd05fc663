"""Small free vibrations about a loaded state."""

import jax
import jax.numpy as jnp
import numpy as np

from .. import _check
from .._rules import not_negative, or_nan, positive
from .._tree import pytree
from ..tangent import displaced_by, filled, prepared, tangent_of

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity, m/s2."""


@pytree
class Vibration:
    """Natural frequencies and modes, slowest first.

    Attributes:
        frequency: [n], Hz; NaN for a mode without positive stiffness (the state is unstable or
            a mechanism: see `squared`).
        squared: squared circular frequencies, [n], 1/s2; negative where the state is unstable.
        shapes: displacements, the largest of a node 1, [n, n_node, 3].

    Example:
        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> solution = jc.solve(structure, jc.Phase(pretension=500.0, loads=weight))
        >>> found = jc.paths.natural_frequencies(structure, solution, masses=50.0)  # kg
        >>> print(solution.status, jnp.round(found.squared, 6))  # K / m: 200, 14600, 25800 N/m
        0 [  4. 292. 516.]
    """

    frequency: object
    squared: object
    shapes: object


def natural_frequencies(
    structure, state, n=6, masses=None, fixed=None, gravity=STANDARD_GRAVITY, distribution=None
):
    """Natural frequencies and modes about the state of a solution: ``(K - w^2 M) phi = 0``.

    K is the tangent stiffness there, prestress and loads in it. Masses are those of the weights of
    the element groups (over `gravity`), shared out to the nodes, and `masses`; they do not turn:
    rotations of beams follow without inertia (static condensation, exact but for masses on rigid
    arms, where it is Guyan's reduction). Dense, meant for some hundred unknowns.

    A pure function. Derivatives are those of simple eigenvalues; equal ones have no definite modes,
    and derivatives of their shapes are not finite.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (its last converged state) or `State`.
        n: number of modes; fewer if fewer freedoms have mass.
        masses: added masses at the nodes, [n_node] or scalar, kg; all positive if traced (massless
            freedoms are condensed, and which they are must be known).
        fixed: freedoms to leave out, as in `forms.tangent_of`.
        gravity: acceleration that weights are divided by, m/s2.
        distribution: of an element's mass m: "lumped", half to each end; "consistent", m/3 and m/6
            between them, as of straight elements; "mean", of both, whose errors cancel; None for
            what is of order 4 in the length of an element: the mean for cables and bars, lumped for
            beams. Cables over several nodes are always lumped.

    Returns:
        `Vibration`.

    Raises:
        ValueError: wrong arguments, or no mass at all.

    Source: Goudreau and Taylor, Comp. Meth. Appl. Mech. Eng. 2 (1973), for the mean.

    Example:
        50 kg between two cables swing across their plane with ``sqrt(2 N / l m) / 2 pi``:

        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> solution = jc.solve(structure, jc.Phase(pretension=500.0, loads=weight))
        >>> found = jc.paths.natural_frequencies(structure, solution, masses=50.0)
        >>> print(solution.status, f"{found.frequency[0]:.6f} Hz, {2 / (2 * np.pi):.6f} Hz")
        0 0.318310 Hz, 0.318310 Hz
    """
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 1:
        raise ValueError(f"n = {n!r}: expected a whole number of at least 1")
    if distribution is not None and distribution not in _SHARES:
        raise ValueError(
            f"distribution = {distribution!r}: expected one of {', '.join(map(repr, _SHARES))}"
        )
    gravity = or_nan(positive("gravity", gravity))
    if masses is not None:
        masses = jnp.broadcast_to(_check.floats(masses, "masses"), structure.n_node)
        masses = or_nan(not_negative("masses", masses))
    thawed, arrays, freedoms = prepared(structure, state, fixed)
    heavy = np.zeros(structure.n_node, bool)
    for group in structure.groups:
        if getattr(group, "weight", None) is not None:
            heavy[group.links.array[_positive(group.weight)]] = True
    if masses is not None:
        heavy |= _positive(masses)
    if not heavy.any():
        raise ValueError("masses: no element group has a weight; give weight=... in N/m, or masses")
    n_free = len(freedoms.free)
    if freedoms.carried is not None:
        heavy[freedoms.carried[1]] |= heavy[freedoms.carried[0]]
    moving = np.unique(np.asarray(freedoms.number)[: structure.n_node, :3][heavy])
    moving = moving[moving < n_free]
    stiffness = tangent_of(structure, state, fixed)
    moved = displaced_by(thawed, arrays, freedoms)[: structure.n_node]
    mass = _node_mass(structure, thawed, arrays, gravity, distribution)
    if masses is not None:
        mass = mass + jnp.diag(masses.astype(mass.dtype))
    return _solve(stiffness, mass, moving, moved, min(n, len(moving)))


def _positive(values):
    """Where there is mass, NumPy bool; everywhere while values are traced."""
    known = _check.concrete(values)
    return np.ones(len(values), bool) if known is None else known > 0


_SHARES = {"lumped": (1 / 2, 0.0), "consistent": (1 / 3, 1 / 6), "mean": (5 / 12, 1 / 12)}


def _node_mass(structure, thawed, arrays, gravity, distribution):
    """Mass matrix of the nodes, the same in every direction, [n_node, n_node], kg."""
    nodes, groups, carry = filled(thawed, arrays)
    rows = structure.rows()[0]
    node = np.arange(structure.n_node) if rows is None else rows.node
    mass = jnp.zeros((structure.n_node, structure.n_node), nodes.dtype)
    for group, given, state in zip(groups, structure.groups, carry.states, strict=True):
        if getattr(group, "weight", None) is None:
            continue
        best = "lumped" if group.n_freedom == 6 else "mean"
        own, other = _SHARES[best if distribution is None else distribution]
        whole = group.weight * state.loaded / gravity
        links = node[given.links.array]
        if links.shape[1] != 2:
            share = group.at_ends(whole, nodes[group.links])
            mass = mass.at[links, links].add(share)
            continue
        for i in (0, 1):
            mass = mass.at[links[:, i], links[:, i]].add(own * whole)
            mass = mass.at[links[:, i], links[:, 1 - i]].add(other * whole)
    return mass


def _solve(stiffness, mass, moving, moved, n):
    """The slowest `n` modes; `moving` are the unknowns with mass, `moved` what they displace."""
    n_free = len(stiffness)
    still = np.setdiff1d(np.arange(n_free), moving)
    symmetric = 0.5 * (stiffness + stiffness.T)
    condensed = symmetric[np.ix_(moving, moving)]
    follow = None
    if len(still):
        follow = -jnp.linalg.solve(
            symmetric[np.ix_(still, still)], symmetric[np.ix_(still, moving)]
        )
        condensed = condensed + symmetric[np.ix_(moving, still)] @ follow
    all_of = jnp.zeros((n_free, len(moving)), moved.dtype).at[moving].set(jnp.eye(len(moving)))
    if follow is not None:
        all_of = all_of.at[still].set(follow)
    ways = jnp.tensordot(moved, all_of, 1)  # [n_node, 3, n_moving]
    own = jnp.tensordot(ways, jnp.tensordot(mass, ways, 1), ((0, 1), (0, 1)))
    root = jnp.linalg.cholesky(own)
    half = jax.scipy.linalg.solve_triangular(root, condensed, lower=True)
    standard = jax.scipy.linalg.solve_triangular(root, half.T, lower=True)
    squared, vectors = jnp.linalg.eigh(0.5 * (standard + standard.T))
    modes = jax.scipy.linalg.solve_triangular(root.T, vectors, lower=False)[:, :n]
    shapes = jnp.moveaxis(jnp.tensordot(ways, modes, 1), -1, 0)
    size = jnp.max(jnp.linalg.norm(shapes, axis=-1), axis=1)
    flat = shapes.reshape(n, -1)
    sign = jnp.sign(jnp.take_along_axis(flat, jnp.argmax(jnp.abs(flat), axis=1)[:, None], axis=1))
    shapes = shapes * (sign[:, 0] / size)[:, None, None]
    squared = squared[:n]
    positive = squared > 0
    frequency = jnp.sqrt(jnp.where(positive, squared, 1.0)) / (2 * jnp.pi)
    frequency = jnp.where(positive, frequency, jnp.nan)
    return Vibration(frequency, squared, shapes)
