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
import jaxlib

from .jax_internals import (
    TESTED,
    fusion_flag,
    has_xla_started,
    xla_flags_in_effect,
)

_BYTES = 1_000_000_000  # more than a loop over any net touches: no limit in effect


def fuse_loops() -> None:
    """Have XLA compile each loop to a single function where it can, on CPUs (for fast small nets).

    Analyses of cable nets with up to some hundred unknowns are then two to five times faster, and
    so are batches of them; others take as long as before. It adds an option to the environment
    variable XLA_FLAGS, and sets jax's `jax_cpu_enable_async_dispatch` to False, so that a program
    runs in the thread that calls it: a switch of threads takes as long as the analysis of a small
    net. jax reads both settings when it first computes: call this function before. Neither the
    command line nor importing the package does.

    Warns:
        RuntimeWarning: jax has computed already, without the option, or this version of jax may not
            have it; nothing is changed.

    Example:
        The first lines of a script:

        >>> import jaxcable as jc
        >>> jc.fuse_loops()
    """
    refused = _reason_against_fusion()
    if refused:
        warnings.warn(f"fuse_loops: {refused}", RuntimeWarning, stacklevel=2)
    request_fused_loops()


def request_fused_loops() -> bool:
    """Set the flags by which XLA fuses loops; return False, and set none, if that is not possible.

    It is not possible once jax has computed something, or if this version of jax is not known.
    """
    if _reason_against_fusion():
        return False
    if not has_xla_started():
        jax.config.update("jax_cpu_enable_async_dispatch", False)
        flag = fusion_flag(_BYTES)
        if flag is not None and not are_loops_fused():
            os.environ["XLA_FLAGS"] = _add_flag_option(os.environ.get("XLA_FLAGS", ""), *flag)
    return True


def are_loops_fused() -> bool:
    """Tell whether XLA's flags in this process ask for loops fused to single functions."""
    flag = fusion_flag(_BYTES)
    return flag is not None and flag[1] in xla_flags_in_effect()


def usable_cores() -> int:
    """Return how many cores this process may use if jax computes on CPUs; else 1."""
    if jax.default_backend() != "cpu":
        return 1
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _reason_against_fusion():
    """Return in words why XLA's loops cannot be fused any more or at all; None if they can."""
    if fusion_flag(_BYTES) is None:
        first, end = (".".join(map(str, version)) for version in TESTED)
        return (
            f"XLA's option is known for jaxlib {first} up to {end} only, and an unknown option "
            f"would end this process; this is jaxlib {jaxlib.__version__}, and nothing is changed"
        )
    if are_loops_fused():
        return None
    if has_xla_started():
        return "jax has already computed something and reads no more flags; call it earlier"
    flags = os.environ.get("XLA_FLAGS", "").strip()
    if flags and not flags.startswith("-"):
        return "XLA_FLAGS names a file of flags, which is not changed; add the option to that file"
    return None


def _add_flag_option(flags, flag, option):
    """Return the text of XLA_FLAGS with an option added to the last occurrence of a flag.

    XLA reads the last one only. Without any, ``flag=option`` is appended.
    """
    flags = flags.split()
    own = [k for k, word in enumerate(flags) if word.startswith(flag + "=")]
    if own:
        flags[own[-1]] += f",{option}"
    else:
        flags.append(f"{flag}={option}")
    return " ".join(flags)
