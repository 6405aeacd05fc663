"""Many cases: in chunks that fit the cache or the memory, and over several devices.

`jax.vmap` solves all cases at once. That is best for some dozen cases of a small structure. The
data of more cases no longer fit the cache, and later the memory. `batched` solves the cases in
chunks, and shares them out to devices, which may belong to several processes. Where XLA fuses loops
(`common.fusion`) a program keeps one core busy, and `batched` shares chunks out to threads.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.sharding import Mesh, PartitionSpec

from ..common import checks
from ..common.fusion import are_loops_fused, usable_cores
from ..common.jax_internals import is_untransformed
from ..common.types import Array, PyTree
from ..programs.known import KnownPrograms
from ..programs.program_calls import as_program
from ..programs.traced_function import trace_function

_CASES_AXIS = "cases"
_THREAD_CHUNK = 256  # cases of a thread at once: their data stay in cache
# Cases at once without threads: data of frames and nets of some fifty unknowns stay in cache, and
# each operation still works on many numbers.
_CHUNK = 64


def batched(
    function: Callable[..., PyTree[Array]],
    chunk: int | None = None,
    *,
    devices: Sequence[jax.Device] | None = None,
) -> Callable[..., PyTree[Array]]:
    """Map a function of one case over the leading axis of its arguments.

    The result is that of ``jax.vmap(function)``, as a program, whatever the chunks and devices, and
    has the same transformations. Devices do not wait for each other: each iterates until its own
    cases have converged. Every call traces the function, so that it sees what the function reads
    now; programs are known by its equations and the number of cases at once. Outside of jit a chunk
    is a call of the program; within it chunks are a loop.

    Args:
        function: of one case; its arguments and results are pytrees of arrays.
        chunk: number of cases that a device, or a thread, solves at once, each until all of them
            have converged. None for at most 64 on CPUs, which keep the work of small structures in
            the cache, 256 where loops are fused (`jc.fuse_loops`), and on accelerators all of a
            device's share. For large nets take as many as memory allows, or 1.

    Options:
        devices: devices to share the cases out to, such as ``jax.devices()`` (with
            `jax.distributed` those of all processes, which all have to make the call); None, the
            default, for no sharing. The result stays distributed over the devices.

    Returns:
        A function of the same arguments with a leading axis [n_case].

    Raises:
        ValueError: `chunk` is no positive integer, `devices` is empty, or the arguments have no
            common leading axis.

    Example:
        How far three loads push the middle of a saddle down, ``F / 4 q``:

        >>> nodes = [[1.0, 0, 1], [-1, 0, 1], [0, 1, -1], [0, -1, -1], [0, 0, 0]]
        >>> cables = jc.Cables([[0, 4], [1, 4], [2, 4], [3, 4]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 1, 2, 3]))
        >>> def height(force):
        ...     return jc.force_density(structure, 100.0, jc.NodalLoads([4], force))[4, 2]
        >>> forces = jnp.array([[0.0, 0.0, -40.0], [0.0, 0.0, -80.0], [0.0, 0.0, -200.0]])  # N
        >>> print(jnp.round(jc.batched(height, chunk=2)(forces), 6))  # m
        [-0.1 -0.2 -0.5]
    """
    if chunk is not None:
        checks.require_whole_number(chunk, "chunk")
    if devices is not None and len(devices) == 0:
        raise ValueError("devices: expected at least one, or None")
    options = chunk, None if devices is None else tuple(devices)

    def mapped(*cases):
        count = _count_cases(cases)
        avals = jax.tree.map(jax.typeof, cases)
        one = jax.tree.map(lambda x: x.update(shape=x.shape[1:]), avals)
        traced = trace_function(function, *one)
        if devices is not None or not _are_concrete_arrays(cases) or not is_untransformed():
            key = traced.equations, *options
            return _within_program.find(key, lambda: _mapped_function(*options))(traced, *cases)
        workers = 1
        _, size = _equal_chunks(count, _cases_at_once(chunk))
        if are_loops_fused():
            workers = usable_cores()
            rounds = -(-count // (workers * (chunk or _THREAD_CHUNK)))
            size = -(-count // (workers * rounds))
        if size == count:
            return _map_cases(traced, *cases)
        return _map_chunks(functools.partial(_map_cases, traced), cases, size, workers)

    return mapped


@as_program
def _map_cases(function, *cases):
    """Return ``jax.vmap(function)(*cases)``, the results of all cases at once; a program."""
    return jax.vmap(function)(*cases)


def _mapped_function(chunk, devices):
    """Return the function ``run(function, *cases)`` that maps a `TracedFunction` over all cases.

    It serves for calls within another program, or with several devices: chunks are a loop.
    Arguments are those of `batched`, `devices` a tuple or None.
    """

    def share(function, *cases):
        """Return the results of the cases of one device, chunk by chunk."""
        count = _count_cases(cases)
        chunks, size = _equal_chunks(count, _cases_at_once(chunk))
        if chunks == 1:
            return jax.vmap(function)(*cases)
        parts = jax.tree.map(
            lambda a: a.reshape(chunks, size, *a.shape[1:]), _pad_cases(cases, chunks * size)
        )
        results = lax.map(lambda part: jax.vmap(function)(*part), parts)
        return jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:])[:count], results)

    @jax.jit
    def run(function, *cases):
        if devices is None:
            return share(function, *cases)
        count = _count_cases(cases)
        per_device = -(-count // len(devices))
        one, every = PartitionSpec(_CASES_AXIS), PartitionSpec()
        spread = jax.shard_map(
            share,
            mesh=Mesh(np.asarray(devices), (_CASES_AXIS,)),
            in_specs=(every, *[one] * len(cases)),
            out_specs=one,
            check_vma=False,  # loops begin with constants, which are the same on all devices
        )
        results = spread(function, *_pad_cases(cases, per_device * len(devices)))
        return jax.tree.map(lambda a: a[:count], results)

    return run


_within_program = KnownPrograms()


def _cases_at_once(chunk):
    """Return how many cases are solved at once; None for all.

    It is the user's `chunk`; if that is None, 64 on a CPU where loops are not fused, else all.
    """
    if chunk is not None or are_loops_fused() or jax.default_backend() != "cpu":
        return chunk
    return _CHUNK


def _equal_chunks(count, most):
    """Return number and size of equal chunks of at most `most` cases: they have least padding."""
    chunks = 1 if most is None else -(-count // most)
    return chunks, -(-count // chunks)


def _map_chunks(program, cases, size, workers):
    """Call `program` for chunks of `size` cases, and return the joined results, [n_case, ...].

    With several `workers` as many threads call it. The last chunk is padded (`_pad_cases`).
    """
    cases = jax.tree.map(np.asarray, cases)
    count = _count_cases(cases)

    def compute(begin):
        part = jax.tree.map(lambda a: a[begin : begin + size], cases)
        return jax.tree.map(np.asarray, program(*_pad_cases(part, size)))

    begins = range(0, count, size)
    first = compute(0)  # it makes the program
    if workers == 1:
        parts = [first, *map(compute, begins[1:])]
    else:
        with ThreadPoolExecutor(workers) as pool:
            parts = [first, *pool.map(compute, begins[1:])]
    return jax.tree.map(lambda *parts: jnp.asarray(np.concatenate(parts)[:count]), *parts)


def _are_concrete_arrays(cases):
    """Return whether all leaves are arrays that NumPy can hold: not traced, no random keys."""
    return not any(
        isinstance(leaf, jax.core.Tracer)
        or jnp.issubdtype(jnp.result_type(leaf), jax.dtypes.extended)
        for leaf in jax.tree.leaves(cases)
    )


def _count_cases(cases):
    """Return the length of the common leading axis of arrays; ValueError if there is none."""
    shapes = [jnp.shape(leaf) for leaf in jax.tree.leaves(cases)]
    counts = {shape[0] if shape else None for shape in shapes}
    if len(counts) != 1 or None in counts or 0 in counts:
        raise ValueError(
            "cases: expected arrays with one common leading axis [n_case, ...] and at least one "
            f"case, got shapes {shapes}"
        )
    return counts.pop()


def _pad_cases(cases, count):
    """Pad a pytree of cases to `count` cases by repeating the last one."""

    def fill(a):
        missing = count - a.shape[0]
        if missing == 0:
            return a
        join = np if isinstance(a, np.ndarray) else jnp
        return join.concatenate([a, join.broadcast_to(a[-1:], (missing, *a.shape[1:]))])

    return jax.tree.map(fill, cases)
