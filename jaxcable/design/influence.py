"""Influence matrices: how small changes of prestress, load or shape change the final state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from ..analysis.activation import make_activation
from ..analysis.phases import (
    ABSOLUTE_INPUTS,
    INCREMENTAL_INPUTS,
    Phase,
    as_phases,
    with_phase_input,
)
from ..analysis.solution import Solution, State
from ..analysis.solver import solve
from ..common import checks, memory_limit
from ..common.rules import Rule, nan_if_broken, not_negative
from ..common.selection import only
from ..common.tree import replace
from ..common.types import Array, ArrayLike, Float, PyTree
from ..elements.abilities import Prestressable
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..linear import unbatched
from ..loads import NodalLoads, as_list
from ..model.structure import Structure
from .arguments import require_phase_index, require_structure

_COPIES = 2  # of the matrix in memory: as it is computed, and in its final shape
_OF = ("tension", "displacement", "positions", "reactions", "rest_length")


def influence(
    structure: Structure,
    phases: Phase | Sequence[Phase],
    of: str | Callable[[Solution], PyTree[Float[Array, " ..."]]] = "tension",
    wrt: str = "shortening",
    *,
    phase: int | None = None,
    method: Newton | Incremental | None = None,
    start: Solution | State | None = None,
) -> PyTree[Float[Array, " ..."]]:
    """Compute an influence matrix: the exact derivatives of final results by inputs of a phase.

    The derivatives go through all phases that follow the input.

    Args:
        structure, phases: as for `solve`.
        of: results at the end that are differentiated: "tension", "displacement", "positions",
            "reactions" or "rest_length", or a function of the `Solution` to a pytree of arrays.
        wrt: inputs with respect to which they are differentiated:

            - "shortening" or "temperature": of every element, added to what the phases have; m, K.
              By default after the last phase, as turnbuckles adjusted in the final state.
            - "pretension", "jacking", "end_tension" or another prestress of `Phase`, or a name in
              `Phase.own`: of every element for which a phase gives it; by default in the first
              phase that does.
            - "load": force on every node, [n_node, 3], N; by default in the last phase.
            - "nodes": initial positions, [n_node, 3], m.

    Options:
        phase: number of the phase whose input changes, from 0; see `wrt` for the default.
        method, start: as for `solve`.

    Returns:
        The Jacobian as from `jax.jacobian`: every array of `of` with the axes of `wrt` appended.
        With one group of elements, tension by shortening is [n_elem, n_elem], N/m: column j is the
        change of the tensions if element j were shortened by a metre and the response stayed
        linear. With several groups it is a pytree in the shape of `elements` for `of`, each entry a
        pytree for `wrt`, with None for groups without `wrt`. NaN if the analysis fails.

    Raises:
        ValueError: unknown `of`, `wrt` or `phase`, or no phase that gives `wrt`.

    Forward mode if `wrt` has at most as many numbers as `of`, else reverse mode.

    Example:
        The force in every leg of a tripod by the load on its top, ``1 / (3 * 0.8)`` of it:

        >>> around = 2 * np.pi * np.arange(3) / 3
        >>> feet = np.column_stack([3 * np.cos(around), 3 * np.sin(around), 0 * around])
        >>> legs = jc.Bars([[0, 3], [1, 3], [2, 3]], axial_stiffness=1e6)
        >>> structure = jc.Structure([*feet, [0.0, 0.0, 4.0]], legs, supports=jc.pinned([0, 1, 2]))
        >>> weight = jc.Phase(loads=jc.NodalLoads([3], (0.0, 0.0, -1e-3)))
        >>> matrix = jc.influence(structure, weight, of="tension", wrt="load")
        >>> print(jnp.round(matrix[:, 3, 2], 6))
        [0.416667 0.416667 0.416667]
    """
    if not callable(of) and of not in _OF:
        there = checks.suggest_names(of, _OF)
        raise ValueError(f"of = {of!r}: expected a function or the name of a result{there}")
    require_structure(structure)
    phases = as_phases(structure, phases) if isinstance(phases, Phase) or phases else []
    if not phases and start is None:
        raise ValueError("phases: there are none, and no start: there is no state to change")
    if phase is not None:
        require_phase_index(phase, len(phases))
    if (
        phase is None and isinstance(wrt, str) and wrt in INCREMENTAL_INPUTS
    ):  # a separate phase at the end, which changes nothing yet
        start = solve(structure, phases, method, start=start) if phases else start
        phases, phase = [Phase()], 0
    value, set_input = _input_values_and_setter(structure, phases or [Phase()], wrt, phase, start)

    def final(value):
        solution = solve(*set_input(value), method, start=start)
        found = of(solution) if callable(of) else getattr(solution, of)
        for leaf in jax.tree.leaves(found):
            if isinstance(leaf, str) or not jnp.issubdtype(jnp.result_type(leaf), jnp.floating):
                raise ValueError("of: expected a function of the solution to arrays of floats")
        return found

    n_of = _count_entries(jax.eval_shape(final, value))
    memory_limit.require_memory(
        _COPIES * n_of * _count_entries(value) * jax.dtypes.canonicalize_dtype(float).itemsize,
        f"influence: a dense matrix of {n_of} results by {_count_entries(value)} values",
        "give a function of fewer results as `of`, or jc.only(...) of fewer values",
    )
    mode = jax.jacfwd if _count_entries(value) <= n_of else jax.jacrev
    return mode(final)(value)


def _count_entries(tree):
    """Return the number of entries of all arrays of a pytree together."""
    return sum(leaf.size for leaf in jax.tree.leaves(tree))


def _input_values_and_setter(structure, phases, wrt, phase, start):
    """Return the present values of the input `wrt`, and a function that replaces them.

    The function takes other values and returns (structure, phases). `wrt` is "shortening", "load",
    "nodes" and so on, of phase number `phase`, or None for the default of `influence`.
    """
    if not isinstance(wrt, str):
        raise ValueError(f"wrt: expected a name such as 'shortening', got {type(wrt).__name__}")
    if wrt == "nodes":
        return jnp.asarray(structure.nodes), lambda v: (replace(structure, nodes=v), phases)
    if wrt == "load":
        number = len(phases) - 1 if phase is None else phase
        every = range(structure.n_node)

        def set_input(v):
            loads = [*as_list(phases[number].loads), NodalLoads(every, v)]
            return structure, _replace_in_phase(phases, number, loads=loads)

        return jnp.zeros_like(jnp.asarray(structure.nodes)), set_input
    own = dict.fromkeys(name for each in phases for name in each.own or ())
    known = (*INCREMENTAL_INPUTS, *ABSOLUTE_INPUTS, *own)
    if wrt not in known:
        there = checks.suggest_names(wrt, (*known, "load", "nodes"))
        raise ValueError(f"wrt = {wrt!r}: no input{there}")
    if wrt not in INCREMENTAL_INPUTS:
        for number in range(len(phases)) if phase is None else [phase]:
            if any(
                value is not None
                for value in _prestress_input_values(phases[number], structure, wrt)
            ):
                phase = number
                break
        else:
            where = "no phase states" if phase is None else f"phase {phase} does not state"
            raise ValueError(f"wrt = {wrt!r}: {where} a {wrt}")
    dtype = jnp.asarray(structure.nodes).dtype
    values = _prestress_input_values(phases[phase], structure, wrt)
    some_there = _has_present_elements_per_group(structure, phases, phase, start)
    for k, (group, some) in enumerate(zip(structure.groups, some_there, strict=True)):
        able = isinstance(group, Prestressable)
        able = able and (wrt != "temperature" or group.expansion is not None)
        if wrt in INCREMENTAL_INPUTS and values[k] is None and able:
            several = (len(group.components[wrt]),) if wrt in group.components else ()
            values[k] = jnp.zeros((len(group.links), *several), dtype)
        values[k] = values[k] if some else None
    if all(value is None for value in values):
        raise ValueError(f"wrt = {wrt!r}: no group of elements can have one")
    values = structure.arrange([jax.tree.map(jnp.asarray, v) for v in values])

    def set_statement(v):
        return structure, [
            with_phase_input(p, wrt, v) if k == phase else p for k, p in enumerate(phases)
        ]

    return values, set_statement


def _has_present_elements_per_group(structure, phases, phase, start):
    """Return one bool per group, a list: whether any of its elements is present in a phase.

    It is True where that is traced, hence not known. `phase` is the index of the phase, `start` is
    the state before all phases, or None.
    """
    last = start.last if isinstance(start, Solution) else start
    presence = make_activation(structure, phases, None if last is None else last.restart.states)
    if presence is None:
        return [True] * len(structure.groups)
    masks = [present[phase] for present in presence.present]
    return [isinstance(mask, jax.core.Tracer) or bool(mask.any()) for mask in masks]


def _prestress_input_values(phase, structure, name):
    """Return the prestress input `name` of a phase for each element group, as a list.

    An item is None for a group without this input; an array [n_elem]; or `Only` where an absolute
    input, such as a pretension, is given for some elements of the group.
    """
    stated = [own.get(name) for own in phase.inputs(structure)]
    return [
        s
        if s is None
        else s.values
        if s.chosen is None or name in INCREMENTAL_INPUTS
        else only(s.chosen, s.values[s.chosen])
        for s in stated
    ]


def _replace_in_phase(phases, number, **changes):
    """Return the list of phases with fields of the one of index `number` replaced by `changes`."""
    return [replace(p, **changes) if k == number else p for k, p in enumerate(phases)]


def flat_matrix(
    jacobian: PyTree[Float[ArrayLike, " ..."]], wrt: PyTree[Float[ArrayLike, " ..."]]
) -> Float[Array, "n_of n_wrt"]:
    """Flatten an influence matrix, a pytree of blocks for several groups, into one matrix.

    Args:
        jacobian: result of `influence`.
        wrt: any pytree of the shape of the inputs that `influence` differentiated by.

    Returns:
        [n_of, n_wrt]: a row for each result, a column for each input, group after group.

    Raises:
        ValueError: the shape of `wrt` is not that of these inputs.

    Example:
        >>> jacobian = {"net": {"net": np.ones((2, 2)), "guys": np.ones((2, 1))}}
        >>> jc.design.flat_matrix(jacobian, {"net": np.zeros(2), "guys": np.zeros(1)}).shape
        (2, 3)
    """
    shape: Any = jax.tree.structure(wrt)
    sizes = [jnp.size(leaf) for leaf in jax.tree.leaves(wrt)]

    def block(part, size):
        if not size or part.size % size:
            raise ValueError(
                f"jacobian: has shape {list(part.shape)}, which does not end with {size} inputs"
            )
        return part.reshape(-1, size)

    entries = jax.tree.leaves(jacobian, is_leaf=lambda t: shape == jax.tree.structure(t))
    if any(shape != jax.tree.structure(entry) for entry in entries):
        raise ValueError("jacobian: is the derivative by inputs of another shape than wrt")
    rows = [map(block, jax.tree.leaves(entry), sizes) for entry in entries]
    return jnp.concatenate([jnp.concatenate([*row], axis=1) for row in rows])


def adjustment(
    jacobian: PyTree[Float[ArrayLike, " ..."]],
    change: PyTree[Float[ArrayLike, " ..."]],
    like: PyTree[Float[ArrayLike, " ..."]] | None = None,
    *,
    rcond: float = 1e-10,
) -> PyTree[Float[Array, " ..."]]:
    """Find the smallest adjustments of inputs that achieve wanted changes of results (linearized).

    These solve ``jacobian x = change`` by least squares, so that a change that the structure cannot
    follow is achieved as well as possible. To retension a net take ``jacobian =
    influence(structure, phases)`` and ``change = target - measured``: the adjustments are the
    turnbuckle shortenings, in m, of one linear step.

    Args:
        jacobian: result of `influence`.
        change: wanted change of the results that `influence` differentiated, a pytree like these.
        like: a pytree of the shape of the adjustments; default that of `change`.

    Options:
        rcond: singular values below this part of the largest one count as zero. Raise it when
            `change` is measured with errors, which small singular values amplify.

    Returns:
        Adjustments in the shape of `like`.

    Raises:
        ValueError: the matrix does not fit `change` or `like`.

    Example:
        Shortenings of two turnbuckles that bring 10 N more to both cables:

        >>> matrix = jnp.array([[30e3, 20e3], [20e3, 30e3]])  # N/m, as from `influence`
        >>> shortening = jc.design.adjustment(matrix, jnp.array([10.0, 10.0]))
        >>> print(jnp.round(1e3 * shortening, 6))  # mm: 10 N / (30 + 20) N/mm
        [0.2 0.2]
    """
    for name, tree in (("jacobian", jacobian), ("change", change), ("like", like)):
        jax.tree.map(lambda x, name=name: checks.as_floats(x, name), tree)
    text = "must be at least 0 and below 1"
    rcond = nan_if_broken(Rule("rcond", rcond, lambda v: ~((v >= 0) & (v < 1)), text))
    like = change if like is None else like
    matrix = flat_matrix(jacobian, like)
    wanted = ravel_pytree(change)[0]
    if wanted.size != matrix.shape[0]:
        raise ValueError(
            f"change: has {wanted.size} numbers, the influence matrix has {matrix.shape[0]} rows"
        )
    flat = unbatched.lstsq(matrix, wanted.astype(matrix.dtype), rcond)
    return ravel_pytree(jax.tree.map(lambda x: jnp.zeros(jnp.shape(x), flat.dtype), like))[1](flat)


def propagate_tolerances(
    jacobian: PyTree[Float[ArrayLike, " ..."]], tolerance: PyTree[Float[ArrayLike, " ..."]]
) -> tuple[PyTree[Float[Array, " ..."]], PyTree[Float[Array, " ..."]]]:
    """Estimate by how much results deviate if inputs have tolerances, to first order.

    Args:
        jacobian: result of `influence`, for example of tension by shortening in phase 0 for
            tolerances of the cutting lengths.
        tolerance: tolerance t of every input that `influence` differentiated by, a pytree of arrays
            of their shape; for `worst` the largest deviation, for `random` the standard deviation.

    Returns:
        worst: deviations if those of all inputs add up, ``sum_j |J_ij| t_j``, a pytree like the
            results that `influence` differentiated.
        random: standard deviations if the inputs deviate independently, likewise:
            ``sqrt(sum_j (J_ij t_j)^2)``.

    Raises:
        ValueError: `tolerance` does not have the shape of these inputs.

    Example:
        Two cables whose tensions, N, change with their lengths, cut to 0.1 mm and 0.2 mm:

        >>> matrix = jnp.array([[30e3, 20e3], [20e3, 30e3]])  # N/m, as from `influence`
        >>> worst, random = jc.design.propagate_tolerances(matrix, jnp.array([1e-4, 2e-4]))
        >>> print(worst, jnp.round(random, 3))
        [7. 8.] [5.    6.325]
    """
    shape: Any = jax.tree.structure(tolerance)

    def is_entry(part):
        return jax.tree.structure(part) == shape

    if any(jnp.ndim(leaf) == 0 for leaf in jax.tree.leaves(tolerance)):
        raise ValueError(
            "tolerance: expected arrays, one number for each input of the influence matrix"
        )
    paths = [
        jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(tolerance)
    ]
    leaves = [
        nan_if_broken(not_negative("tolerance" + path, leaf))
        for path, leaf in zip(paths, jax.tree.leaves(tolerance), strict=True)
    ]
    tolerance = jax.tree.unflatten(shape, leaves)
    for entry in jax.tree.leaves(jacobian, is_leaf=is_entry):
        for path, part, one in zip(paths, jax.tree.leaves(entry), leaves, strict=False):
            inputs = jnp.shape(part)[jnp.ndim(part) - jnp.ndim(one) :]
            if inputs != jnp.shape(one):
                raise ValueError(
                    f"tolerance{path}: expected shape {inputs}, as the inputs have, got "
                    f"{jnp.shape(one)}"
                )

    def add(function, finish):
        def summed(entry):
            pairs = zip(jax.tree.leaves(entry), jax.tree.leaves(tolerance), strict=True)
            return finish(
                sum(jnp.tensordot(function(j), function(t), jnp.ndim(t)) for j, t in pairs)
            )

        return jax.tree.map(summed, jacobian, is_leaf=is_entry)

    return add(jnp.abs, lambda s: s), add(jnp.square, jnp.sqrt)
