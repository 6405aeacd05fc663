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
    """Have XLA compile every loop that it can to one function, on CPUs.

    Analyses of cable nets with up to some hundred unknowns are then two to three times faster;
    others are as they were. It sets an option in the environment variable XLA_FLAGS, which jax
    reads at its first computation: call this before any. The command line does so by itself; import
    of the package never does.

    Warns:
        RuntimeWarning: jax has started already, without the option; nothing is changed.

    Example:
        >>> import jaxcable as jc
        >>> jc.fuse_loops()  # then the rest of the program
    """
    if fuses():
        return
    if _started():
        text = "fuse_loops: jax has computed already, so that XLA keeps its flags; call it first"
        warnings.warn(text, RuntimeWarning, stacklevel=2)
        return
    flags = os.environ.get("XLA_FLAGS", "").split()
    option = f"{_OPTION}={_BYTES}"
    own = [flag for flag in flags if flag.startswith(_FLAG + "=")]
    if own:  # the flag takes a list
        flags[flags.index(own[-1])] = f"{own[-1]},{option}"
    else:
        flags.append(f"{_FLAG}={option}")
    os.environ["XLA_FLAGS"] = " ".join(flags)


def fuses() -> bool:
    """Whether XLA_FLAGS asks for fused loops of any size."""
    return f"{_OPTION}={_BYTES}" in os.environ.get("XLA_FLAGS", "")


def _started():
    """Whether jax has started XLA; jax has no public function that tells and does not start it."""
    bridge = getattr(getattr(jax, "_src", None), "xla_bridge", None)
    started = getattr(bridge, "backends_are_initialized", lambda: False)
    return bool(started())
