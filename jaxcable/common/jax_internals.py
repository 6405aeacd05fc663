"""Names of jax and XLA that may change from version to version, each with what replaces it.

All that the package takes from jax beyond its documented interface, and the options of XLA. A name
that is missing costs speed, never a result: `warn_missing_feature` says once what is lost. The
names were there in jax 0.10 to 0.12 (`TESTED`). Without jax 0.10 some of it is needless:

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
import importlib
import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import jaxlib.version
import numpy as np

TESTED = (0, 10), (0, 13)
"""The first version of jax that is tested, and the first one that is not; as in pyproject.toml."""

_LOSSES = {
    "primitives": "jax.extend.core.Primitive and jax.interpreters: derivatives are traced with "
    "every analysis, which takes longer to compile, and no analysis is compiled to a single "
    "function",
    "cache": "jax.experimental.compilation_cache: jax does not keep programs if it has compiled "
    "one before",
    "started": "jax._src.xla_bridge.backends_are_initialized: loops are not fused if jax has "
    "computed something before",
}
_warned_features: set[str] = set()


def warn_missing_feature(feature: str) -> None:
    """Warn, once in a process, that jax lacks a feature (a key of `_LOSSES`), and what is lost."""
    if feature not in _warned_features:
        _warned_features.add(feature)
        text = f"jax {jax.__version__} lacks {_LOSSES[feature]}"
        warnings.warn(text, RuntimeWarning, stacklevel=3)


def _import_members(module: str, *names: str) -> Any:
    """Import a module and return a list of its members `names`; None if anything is missing."""
    try:
        found = importlib.import_module(module)
        return [getattr(found, name) for name in names]
    except (ImportError, AttributeError):
        return None


# --- primitives

_jaxpr_tools = _import_members(
    "jax.extend.core", "Primitive", "ClosedJaxpr", "jaxpr_as_fun", "Jaxpr"
)
functions_of_primitives: dict[Any, Callable[..., Any]] = {}
"""Functions that jax can trace, with the results of this package's primitives, by primitive."""
_rule_modules = _import_members("jax.interpreters", "ad", "batching", "mlir")
_unused_result_rules = _import_members("jax.interpreters.partial_eval", "dce_rules")
_unused_tools = _import_members("jax.interpreters.partial_eval", "dce_jaxpr")


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
    """Define a primitive of jax with its rules and return it; None if jax has no way to do so.

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
    if _jaxpr_tools is None or _rule_modules is None:
        return None
    ad, batching, mlir = _rule_modules
    made = _jaxpr_tools[0](name)
    made.multiple_results = multiple_results
    try:
        made.def_impl(evaluate)
        made.def_abstract_eval(shape_rule)
        ad.primitive_jvps[made] = jvp_rule
        batching.primitive_batchers[made] = batch_rule
        if transpose_rule is not None:
            ad.primitive_transposes[made] = transpose_rule
        lowering = mlir.lower_fun(lowered or evaluate, multiple_results=multiple_results)
        mlir.register_lowering(made, lowering)
        if narrow is not None and _unused_result_rules is not None:
            _unused_result_rules[0][made] = functools.partial(_without_unused_results, narrow)
        functions_of_primitives[made] = lowered or evaluate
        used = ad.Zero, ad.instantiate_zeros, ad.is_undefined_primal, jax.core.ShapedArray
    except (AttributeError, TypeError):
        return None
    return made if all(used) else None


def _without_unused_results(narrow, used, *further):
    """Rule of a primitive for equations of which some results are not used (jax's `dce_rules`)."""
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
    return isinstance(tangent, _rule_modules[0].Zero)


def zero_tangent(x: Any) -> Any:
    """Return jax's symbolic zero as the tangent of array `x`, for a rule of a primitive."""
    return _rule_modules[0].Zero(jax.typeof(x).to_tangent_aval())


def instantiate_tangent(tangent: Any) -> Any:
    """Return a tangent as an array: a symbolic zero, in a rule of a primitive, becomes zeros."""
    return _rule_modules[0].instantiate_zeros(tangent)


def is_undefined_primal(argument: Any) -> bool:
    """Tell, in a transpose rule, whether jax asks for the cotangent of this argument."""
    return _rule_modules[0].is_undefined_primal(argument)


def abstract_array(x: Any) -> Any:
    """Return shape and dtype of `x` as the `ShapedArray` that shape rules of primitives return."""
    return jax.core.ShapedArray(x.shape, x.dtype)


def abstract_argument(x: Any) -> jax.ShapeDtypeStruct:
    """Return shape and dtype of an argument, which may be a number of Python or be traced."""
    aval = x if isinstance(x, jax.core.ShapedArray) else jax.typeof(x)
    return jax.ShapeDtypeStruct(aval.shape, aval.dtype, weak_type=aval.weak_type)


def as_operand(x: Any) -> Any:
    """Return an argument of a primitive: arrays as they are, numbers as arrays of NumPy."""
    return x if hasattr(x, "dtype") else np.asarray(x, jax.typeof(x).dtype)


def convert_closure(
    function: Callable[[Any], Any], x: Any
) -> tuple[Callable[[Any, Any], Any], Any]:
    """Return ``g(x, values)`` that captures nothing, and the values that `function` captures."""
    if _jaxpr_tools is None:
        converted, values = jax.closure_convert(function, x)
        return lambda x, values: converted(x, *values), values
    program = jax.make_jaxpr(function)(x)
    return lambda x, values: bind_constants(program.jaxpr, values)(x)[0], program.consts


def bind_constants(jaxpr: Any, constants: Sequence[Any]) -> Callable[..., Any]:
    """Return the Python function that a jaxpr computes with the given constants."""
    make, function = _jaxpr_tools[1:3]
    return function(make(jaxpr, constants))


def function_of_jaxpr(program: Any) -> Callable[..., Any]:
    """Return the Python function that computes a closed jaxpr, as `jax.make_jaxpr` returns it."""
    return _jaxpr_tools[2](program)


def is_jaxpr(value: Any) -> bool:
    """Tell whether a value is a jaxpr, with its constants or without."""
    return hasattr(value, "eqns") and (hasattr(value, "consts") or hasattr(value, "constvars"))


def is_jaxpr_literal(value: Any) -> bool:
    """Tell whether an operand of an equation in a jaxpr is a literal number, not a variable."""
    return hasattr(value, "val") and hasattr(value, "aval")


def without_unused_equations(program: Any) -> Any:
    """Return a closed jaxpr without equations that no result needs; the same where jax cannot."""
    if _unused_tools is None:
        return program
    used = [True] * len(program.jaxpr.outvars)
    less, _ = _unused_tools[0](program.jaxpr, used, instantiate=True)
    return _jaxpr_tools[1](less, program.consts)


def counts_of_scan(parameters: dict[str, Any]) -> tuple[int, int]:
    """Return the numbers of constants and carried values of an equation `scan`."""
    if "num_consts" in parameters:
        return parameters["num_consts"], parameters["num_carry"]
    groups = parameters["ft_in"].unpack()  # since jax 0.12
    return len(groups[0]), len(groups[1])


# --- where the program is

_traces = _import_members("jax._src.core", "trace_ctx")
# traces of derivatives and batches compute with numbers if those around them do
_EAGER_TRACES = "JVPTrace", "LinearizeTrace", "BatchTrace", "JaxprTrace"


def current_trace() -> Any:
    """Return the object in which jax records operations now, in this thread; None if not known."""
    return None if _traces is None else getattr(_traces[0], "trace", None)


def _traces_around():
    """Return the kinds of jax's traces from the present one outward; None if not known."""
    trace, kinds = current_trace(), []
    if trace is None:
        return None
    while trace is not None:
        kinds.append(type(trace).__name__)
        trace = getattr(trace, "parent_trace", None)
    return kinds


def is_tracing() -> bool:
    """Tell whether jax is tracing a function now, in this thread.

    Outside of a program, derivatives and batches compute with numbers: that is not tracing. Where
    jax lacks the name, a new array is made to find out, which takes a hundred times as long
    (30 us).
    """
    kinds = _traces_around()
    if kinds is None:
        return isinstance(jnp.zeros(()), jax.core.Tracer)
    return kinds[-1] != "EvalTrace" or any(kind not in _EAGER_TRACES for kind in kinds[:-1])


def is_untransformed() -> bool:
    """Tell whether jax computes with plain numbers now: no derivative, no batch, no program."""
    return _traces_around() == ["EvalTrace"]


def is_differentiating() -> bool:
    """Tell whether jax takes a derivative of computations with numbers, outside of a program."""
    kinds = _traces_around() or []
    return not is_tracing() and ("JVPTrace" in kinds or "LinearizeTrace" in kinds)


_mesh = _import_members("jax._src.config", "abstract_mesh_context_manager", "config_ext")


@contextlib.contextmanager
def same_context_as_outside() -> Iterator[None]:
    """Have jax find functions again, in a transpose rule, that it has traced outside of it.

    While jax transposes it sets a mesh of no devices, which means what no mesh means. But its
    record of traced functions takes it for another context, and everything is traced anew.
    """
    setting, module = (None, None) if _mesh is None else _mesh
    mesh = getattr(setting, "value", None)
    if not (getattr(mesh, "empty", False) and hasattr(module, "unset")):
        yield
        return
    before = setting.swap_local(module.unset)
    try:
        yield
    finally:
        setting.set_local(before)


def has_xla_started() -> bool | None:
    """Tell whether XLA has started, after which it reads no flags; None if that is not known."""
    bridge = getattr(getattr(jax, "_src", None), "xla_bridge", None)
    started = getattr(bridge, "backends_are_initialized", None)
    return None if started is None else bool(started())


# --- options of XLA


@functools.cache
def quick_compile_options() -> dict[str, Any] | None:
    """Return compiler options with which XLA compiles small programs in half the time, or None.

    They choose XLA's older code generator for CPUs. Its programs are as fast for some hundred
    unknowns, and take up to half as long again for thousands. jax 0.10 has it; 0.12 has none.

    Nothing else is worth it (measured with 0.10.2 and 0.12.0.1): with
    ``xla_backend_optimization_level=0`` the compiler needs 0.4 to 0.7 of its time, but programs run
    1.2 to 2.5 times as long; level 1 saves a tenth and runs take up to 7 % longer; other numbers of
    parts compiled in parallel, schedulers and instruction sets change nothing; XLA's preset for
    fast compilation takes longer; without its HLO passes the process dies.
    """
    options = {"xla_cpu_use_fusion_emitters": False}
    if jax.default_backend() != "cpu":
        return None
    try:
        jax.jit(lambda: jnp.zeros(()), compiler_options=options)()
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


# --- programs on disk


def reset_jax_cache() -> bool:
    """Have jax read the setting of its cache folder again; return False if this jax cannot."""
    found = _import_members("jax.experimental.compilation_cache.compilation_cache", "reset_cache")
    if found is None:
        return False
    found[0]()
    return True


# --- arrays

_client = _import_members("jaxlib.xla_client", "batched_device_put")


def arrays_on_device(arrays: Sequence[np.ndarray], device: jax.Device) -> list[jax.Array]:
    """Return jax arrays of NumPy arrays with dtypes of jax, bound to no device.

    This takes a third of the time of `jnp.asarray`, which is felt after analyses of a millisecond.
    """
    place = jax.sharding.SingleDeviceSharding(device)
    if _client is None:
        return list(jax.device_put(list(arrays)))
    put = _client[0]
    return [put(_shaped(x.shape, x.dtype), place, [x], [device], False) for x in arrays]


def arrays_on_default_device(arrays: Sequence[np.ndarray]) -> list[jax.Array]:
    """Return jax arrays of NumPy arrays with dtypes of jax, bound to no device."""
    device = getattr(jax.config, "jax_default_device", None)
    return arrays_on_device(arrays, device if isinstance(device, jax.Device) else jax.devices()[0])


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
