"""Names of jax and XLA that may change from version to version.

All that the package takes from jax beyond its documented interface, and the options of XLA. The
names were there in jax 0.10 to 0.12 (`TESTED`), and the package can be installed with no other
version; the tests run with jax of the night. Without jax 0.10 some of it is needless:

- `define_primitive` for roots: since jax 0.12 `lax.custom_root` has its second derivatives in the
  reverse mode of a `lax.scan`, too. It stays for functions as a whole (`custom_vmap` has no reverse
  mode, jax-ml/jax#9073) and for linear maps (`linear_call` has no `jax.vmap`, jax-ml/jax#13283).
- `register_host_function`: jax's own cache keeps programs with callbacks since jax-ml/jax#38405;
  but a callback makes arrays of jax, for which a busy program can wait for ever.
- `quick_compile_options`: XLA has no older emitters since jax 0.12.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import operator
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import jaxlib.version
import numpy as np
from jax._src import config, xla_bridge
from jax._src.core import trace_ctx
from jax._src.util import weakref_cache_key_types
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir
from jax.interpreters.partial_eval import dce_jaxpr, dce_rules
from jaxlib.xla_client import batched_device_put

from .jaxprs import results_that_depend

_T = TypeVar("_T")
implementation_of_keys = operator.attrgetter("_impl")  # by the dtype of random keys
TESTED = (0, 10), (0, 13)
"""The first version of jax that is tested, and the first one that is not; as in pyproject.toml."""


# --- primitives

functions_of_primitives: dict[Any, Callable[..., Any]] = {}
"""Functions that jax can trace, with the results of this package's primitives, by primitive."""


def define_primitive(
    name: str,
    evaluate: Callable[..., Any],
    shape_rule: Callable[..., Any],
    jvp_rule: Callable[..., Any],
    batch_rule: Callable[..., Any],
    transpose_rule: Callable[..., Any] | None = None,
    lowered: Callable[..., Any] | None = None,
    multiple_results: bool = False,
    narrow: Callable[..., tuple[Sequence[bool], Sequence[bool], dict[str, Any]]] | None = None,
) -> Any:
    """Define a primitive of jax with its rules and return it.

    Args:
        name: name of the primitive.
        evaluate: computes the results from the arguments.
        shape_rule: returns shapes and dtypes of the results from those of the arguments.
        jvp_rule: rule of the forward derivative.
        batch_rule: rule for `jax.vmap`.
        transpose_rule: rule for the transpose, if the primitive is linear.
        lowered: the function that is traced and compiled; default `evaluate`.
        multiple_results: whether the primitive returns a list of results.
        narrow: function of which results are used, a list of bool, of the number of arguments, and
            of the parameters by name; it returns which results and arguments remain, and the new
            parameters. None: all remain if any result is used.
    """
    made = Primitive(name)
    made.multiple_results = multiple_results
    made.def_impl(evaluate)
    made.def_abstract_eval(shape_rule)
    ad.primitive_jvps[made] = jvp_rule
    batching.primitive_batchers[made] = batch_rule
    if transpose_rule is not None:
        ad.primitive_transposes[made] = transpose_rule
    lowering = mlir.lower_fun(lowered or evaluate, multiple_results=multiple_results)
    mlir.register_lowering(made, lowering)
    if narrow is not None:
        dce_rules[made] = functools.partial(_without_unused_results, narrow)
    functions_of_primitives[made] = lowered or evaluate
    return made


def _without_unused_results(narrow, used, *further):
    """Return used arguments and the equation of a primitive without the results that are not used.

    A rule of jax (`dce_rules`); `narrow` is that of `define_primitive`, the equation the last
    argument.
    """
    equation = further[-1]  # behind more lists since jax 0.12
    count = len(equation.invars)
    if not any(used):
        return [False] * count, None
    results, arguments, parameters = narrow(used, count, **equation.params)
    if all(results):
        return [True] * count, equation
    less = equation.replace(
        invars=[x for x, own in zip(equation.invars, arguments, strict=True) if own],
        outvars=[x for x, own in zip(equation.outvars, results, strict=True) if own],
        params=parameters,
    )
    return list(arguments), less


def is_zero_tangent(tangent: Any) -> bool:
    """Tell, in a rule of a primitive, whether a tangent is jax's symbolic zero, not an array."""
    return isinstance(tangent, ad.Zero)


def zero_tangent(x: Any) -> Any:
    """Return jax's symbolic zero as the tangent of array `x`, for a rule of a primitive."""
    return ad.Zero(jax.typeof(x).to_tangent_aval())


def instantiate_tangent(tangent: Any) -> Any:
    """Return a tangent as an array: a symbolic zero, in a rule of a primitive, becomes zeros."""
    return ad.instantiate_zeros(tangent)


def differentiated_arguments(primals: Sequence[Any], tangents: Sequence[Any]) -> tuple[int, ...]:
    """Return, in a rule of a primitive, the indices of float arguments with nonzero tangents."""
    pairs = enumerate(zip(primals, tangents, strict=True))
    return tuple(k for k, (x, t) in pairs if is_float(x) and not is_zero_tangent(t))


def is_float(x: Any) -> bool:
    """Tell whether an array, which may be traced, is one of floats."""
    return jnp.issubdtype(jnp.result_type(x), jnp.inexact)


def replace_entries(values: Sequence[Any], places: Sequence[int], some: Sequence[Any]) -> list[Any]:
    """Return a list of `values` in which `some` replace the entries with the indices `places`."""
    found = list(values)
    for k, x in zip(places, some, strict=True):
        found[k] = x
    return found


def value_and_tangents(
    function: Callable[..., Any], primals: Sequence[Any], tangents: Sequence[Any]
) -> Any:
    """Return ``function(*primals)`` and its tangents, in a rule of a primitive, as `jax.jvp`."""
    moving = differentiated_arguments(primals, tangents)

    def some(*values):
        return function(*replace_entries(primals, moving, values))

    return jax.jvp(some, [primals[k] for k in moving], [tangents[k] for k in moving])


def linearize_entries(
    function: Callable[..., Sequence[Any]], leaves: Sequence[Any], moving: Sequence[int]
) -> tuple[Sequence[Any], list[bool], Any, list[int | None], list[Any]]:
    """Linearize a function of arrays at `leaves` by its arguments with the indices `moving`.

    Returns:
        All results; which of them have a tangent, a list of bool; the jaxpr from tangents of these
        arguments to those of these results; for each constant of the jaxpr its index among the
        leaves, or None; the other constants.
    """

    def of_moving(*some):
        values = function(*replace_entries(leaves, moving, some))
        return [x for x in values if is_float(x)], values

    at = [leaves[k] for k in moving]
    _, linear, values = jax.linearize(of_moving, *at, has_aux=True)
    part = jax.make_jaxpr(linear)(*at)
    known = {id(x): k for k, x in enumerate(leaves)}
    places = [known.get(id(x)) for x in part.consts]
    further = [x for x, k in zip(part.consts, places, strict=True) if k is None]
    moves = results_that_depend(part.jaxpr, [True] * len(at))
    outvars = [x for x, own in zip(part.jaxpr.outvars, moves, strict=True) if own]
    of_floats = iter(moves)
    moved = [is_float(x) and next(of_floats) for x in values]
    return values, moved, part.jaxpr.replace(outvars=outvars), places, further


def is_undefined_primal(argument: Any) -> bool:
    """Tell, in a transpose rule, whether jax asks for the cotangent of this argument."""
    return ad.is_undefined_primal(argument)


def abstract_array(x: Any) -> Any:
    """Return shape and dtype of `x` as the `ShapedArray` that shape rules of primitives return."""
    return jax.core.ShapedArray(x.shape, x.dtype)


def abstract_argument(x: Any) -> jax.ShapeDtypeStruct:
    """Return shape and dtype of an argument: an array, a number of Python, or a traced value."""
    aval = x if isinstance(x, jax.core.ShapedArray) else jax.typeof(x)
    return jax.ShapeDtypeStruct(aval.shape, aval.dtype, weak_type=aval.weak_type)


def as_operand(x: Any) -> Any:
    """Return an argument of a primitive: arrays as they are, numbers as arrays of NumPy."""
    return x if hasattr(x, "dtype") else np.asarray(x, jax.typeof(x).dtype)


def convert_closure(
    function: Callable[[Any], Any], x: Any
) -> tuple[Callable[[Any, Any], Any], Any]:
    """Return ``g(x, values)``, which captures nothing, and the values that `function` captures."""
    program = jax.make_jaxpr(function)(x)
    return lambda x, values: bind_constants(program.jaxpr, values)(x)[0], program.consts


def bind_constants(jaxpr: Any, constants: Sequence[Any]) -> Callable[..., Any]:
    """Return the Python function that a jaxpr computes with the given constants."""
    return jaxpr_as_fun(ClosedJaxpr(jaxpr, constants))


def function_of_jaxpr(program: Any) -> Callable[..., Any]:
    """Return the Python function that computes a closed jaxpr, as `jax.make_jaxpr` returns it."""
    return jaxpr_as_fun(program)


def without_unused_equations(program: Any) -> Any:
    """Return a closed jaxpr without equations that no result needs."""
    used = [True] * len(program.jaxpr.outvars)
    less, _ = dce_jaxpr(program.jaxpr, used, instantiate=True)
    return ClosedJaxpr(less, program.consts)


# --- where the program is

# traces of derivatives and batches compute with numbers if those around them do
_EAGER_TRACES = "JVPTrace", "LinearizeTrace", "BatchTrace", "JaxprTrace"


def _active_trace_names():
    """Return the class names of jax's active traces, from the innermost outward, a list."""
    trace, kinds = trace_ctx.trace, []
    while trace is not None:
        kinds.append(type(trace).__name__)
        trace = getattr(trace, "parent_trace", None)
    return kinds


def is_tracing() -> bool:
    """Tell whether jax is tracing a function now, in this thread.

    Outside of a program, derivatives and batches compute with numbers: that is not tracing.
    """
    kinds = _active_trace_names()
    return kinds[-1] != "EvalTrace" or any(kind not in _EAGER_TRACES for kind in kinds[:-1])


def is_untransformed() -> bool:
    """Tell whether jax computes with plain numbers now: no derivative, no batch, no program."""
    return _active_trace_names() == ["EvalTrace"]


def is_differentiating() -> bool:
    """Tell whether jax takes a derivative of computations with numbers, outside of a program."""
    kinds = _active_trace_names()
    return not is_tracing() and ("JVPTrace" in kinds or "LinearizeTrace" in kinds)


_mesh = getattr(config, "abstract_mesh_context_manager", None)  # elsewhere in jax 0.12


@contextlib.contextmanager
def same_context_as_outside() -> Iterator[None]:
    """Let jax find, in a transpose rule, functions that it has traced before (in a ``with`` block).

    While jax transposes it sets a mesh of no devices, which means what no mesh means. But its
    record of traced functions takes it for another context, and everything would be traced anew.
    """
    if not getattr(_mesh.value if _mesh else None, "empty", False):
        yield
        return
    before = _mesh.swap_local(config.config_ext.unset)
    try:
        yield
    finally:
        _mesh.set_local(before)


def has_xla_started() -> bool:
    """Tell whether XLA has started, after which it reads no flags."""
    return xla_bridge.backends_are_initialized()


# --- options of XLA


@functools.cache
def quick_compile_options() -> dict[str, Any] | None:
    """Return compiler options with which XLA compiles small programs in half the time, or None.

    They choose XLA's older code generator for CPUs. Its programs are as fast for some hundred
    unknowns, and take up to half as long again for thousands. jax 0.10 has it; 0.12 has none.

    Nothing else is worth it (measured with 0.10.2 and 0.12.0.1): lower optimization levels, other
    numbers of parts compiled in parallel, schedulers, instruction sets, XLA's preset.
    """
    options: dict[str, Any] = {"xla_cpu_use_fusion_emitters": False}
    if jax.default_backend() != "cpu":
        return None
    try:
        jax.jit(lambda: jnp.zeros(())).lower().compile(options)
    except jax.errors.JaxRuntimeError:
        return None
    return options


def fusion_flag(size: int) -> tuple[str, str] | None:
    """Return XLA's flag and the option of it that fuse loops over up to `size` bytes.

    None for jaxlib versions that are not tested: an unknown flag would end the process.
    """
    if not TESTED[0] <= jaxlib.version.__version_info__[:2] < TESTED[1]:
        return None
    return "--xla_backend_extra_options", f"xla_cpu_small_while_loop_byte_threshold={size}"


_flags: list[str] = []  # of XLA, once it has started


def xla_flags_in_effect() -> str:
    """Return the text of XLA_FLAGS as XLA has read it when it started, or as it will read it."""
    if _flags:
        return _flags[0]
    flags = os.environ.get("XLA_FLAGS", "")
    if has_xla_started():
        _flags.append(flags)
    return flags


xla_flags_in_effect()  # it may have started before this package


# --- records of jax


def held_weakly(cls: type[_T]) -> type[_T]:
    """Let jax's caches hold parameters of this class by weak references (a class decorator).

    jax records the shapes of results of its last 2048 operations, with their parameters. A program
    among these, and a user's function in it, would not be given back.
    """
    weakref_cache_key_types.add(cls)
    return cls


# --- arrays


def arrays_on_default_device(
    arrays: Sequence[np.ndarray], weak: Iterable[bool] = itertools.repeat(False)
) -> list[jax.Array]:
    """Return jax arrays on the default device, not committed to it, of NumPy arrays.

    These have dtypes of jax; `weak` tells of each whether its dtype yields to that of others. This
    takes a third of the time of `jnp.asarray`, which is felt after analyses of a millisecond.
    """
    device = _default_device()
    place = jax.sharding.SingleDeviceSharding(device)
    return [
        batched_device_put(_shaped(x.shape, x.dtype, weak_type=own), place, [x], [device], False)
        for x, own in zip(arrays, weak, strict=False)
    ]


def _default_device():
    """Return the device for which jax compiles programs of arrays that are bound to none."""
    device = getattr(jax.config, "jax_default_device", None)
    return device if isinstance(device, jax.Device) else jax.devices()[0]


def is_placed_elsewhere(x: Any) -> bool:
    """Tell whether `x` is a jax array that is bound to devices other than the default one."""
    return getattr(x, "committed", False) and x.sharding.device_set != {_default_device()}


def as_jax_arrays(tree: Any) -> Any:
    """Return a tree with arrays of jax in place of arrays of NumPy and numbers."""
    shape: Any
    leaves, shape = jax.tree.flatten(tree)
    places = [k for k, x in enumerate(leaves) if not isinstance(x, jax.Array)]
    arrays = [np.asarray(leaves[k]) for k in places]
    arrays = [x.astype(jax.dtypes.canonicalize_dtype(x.dtype), copy=False) for x in arrays]
    for k, x in zip(places, arrays_on_default_device(arrays), strict=True):
        leaves[k] = x
    return shape.unflatten(leaves)


_shaped = functools.lru_cache(maxsize=1024)(jax.core.ShapedArray)
