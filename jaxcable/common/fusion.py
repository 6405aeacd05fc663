"""Loops as one function each: a setting of XLA that small analyses on CPUs need to be fast.

XLA's backend for CPUs runs a program as a chain of small functions, called one after the other. A
loop that touches few bytes it compiles to one function instead, if nothing in it calls a library or
scatters. Its limit, one kilobyte, is below the smallest net; an analysis of some hundred unknowns
spends half of its time between functions. The limit is a flag of XLA, read when jax starts.
"""

from __future__ import annotations

import os
import warnings

import jax

_OPTION = "xla_cpu_small_while_loop_byte_threshold"
_FLAG = "--xla_backend_extra_options"
_BYTES = 1_000_000_000


def fuse_loops() -> None:
    """Have XLA compile every loop that it can to one function, and call it at once, on CPUs.

    Analyses of cable nets with up to some hundred unknowns are then two to five times faster, and
    so are batches of them; others are as they were. It sets an option in the environment variable
    XLA_FLAGS, and jax's `jax_cpu_enable_async_dispatch` to False, so that a program runs in the
    thread that calls it: to hand it over to another takes as long as a small net. jax reads both
    when it first computes: call this before. The command line does so by itself; importing the
    package never does.

    Warns:
        RuntimeWarning: jax has computed already, without the option; nothing is changed.

    Example:
        The first lines of a script:

        >>> import jaxcable as jc
        >>> jc.fuse_loops()
    """
    if not ask():
        text = "fuse_loops: jax has computed already and keeps its flags; call it before"
        warnings.warn(text, RuntimeWarning, stacklevel=2)


def ask() -> bool:
    """Ask XLA for fused loops; False if it is too late for this."""
    if _started():
        return fuses()
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    if fuses():
        return True
    flags = os.environ.get("XLA_FLAGS", "").split()
    option = f"{_OPTION}={_BYTES}"
    own = [flag for flag in flags if flag.startswith(_FLAG + "=")]
    if own:  # the flag takes a list, and the last one counts
        flags[flags.index(own[-1])] = f"{own[-1]},{option}"
    else:
        flags.append(f"{_FLAG}={option}")
    os.environ["XLA_FLAGS"] = " ".join(flags)
    return True


def fuses() -> bool:
    """Whether XLA_FLAGS asks for fused loops of any size."""
    return f"{_OPTION}={_BYTES}" in os.environ.get("XLA_FLAGS", "")


def _started():
    """Whether jax has started XLA; jax has no public function that tells and does not start it."""
    bridge = getattr(getattr(jax, "_src", None), "xla_bridge", None)
    started = getattr(bridge, "backends_are_initialized", lambda: False)
    return bool(started())
