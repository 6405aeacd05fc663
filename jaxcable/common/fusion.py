"""Loops as one function each: a setting of XLA that small analyses on CPUs need to be fast.

XLA's backend for CPUs runs a program as a chain of small functions, called one after the other. A
loop that touches few bytes it compiles to one function instead, if nothing in it calls a library or
scatters. Its limit, one kilobyte, is below the smallest net; an analysis of some hundred unknowns
spends half of its time between functions. The limit is a flag of XLA, read when jax starts.
"""

from __future__ import annotations

import contextlib
import os
import warnings

import jax
import jaxlib

from .jax_internals import TESTED, flags_in_effect, fusion_flag, has_started, missing

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
        RuntimeWarning: jax has computed already, without the option, or this version of jax may not
            have it; nothing is changed.

    Example:
        The first lines of a script:

        >>> import jaxcable as jc
        >>> jc.fuse_loops()
    """
    refused = _refusal()
    if refused:
        warnings.warn(f"fuse_loops: {refused}", RuntimeWarning, stacklevel=2)
    elif ask() and has_started() is None:
        missing("started")


def ask() -> bool:
    """Ask XLA for fused loops; False if that cannot be, or is too late."""
    if _refusal():
        return False
    if not has_started():
        with contextlib.suppress(AttributeError):  # it is not in every version of jax
            jax.config.update("jax_cpu_enable_async_dispatch", False)
        flag = fusion_flag(_BYTES)
        if flag is not None and not fuses():
            os.environ["XLA_FLAGS"] = _with_option(os.environ.get("XLA_FLAGS", ""), *flag)
    return True


def fuses() -> bool:
    """Whether XLA's flags ask for fused loops of any size."""
    flag = fusion_flag(_BYTES)
    return flag is not None and flag[1] in flags_in_effect()


def _refusal():
    """Why loops are not fused if they are asked for now; None if they are."""
    if fusion_flag(_BYTES) is None:
        first, end = (".".join(map(str, version)) for version in TESTED)
        return (
            f"the option of XLA is known to be there in jaxlib {first} up to {end}, and an unknown "
            f"one would end this process; this is {jaxlib.__version__}, and nothing is changed"
        )
    if fuses():
        return None
    if has_started():
        return "jax has computed already and keeps its flags; call it before"
    flags = os.environ.get("XLA_FLAGS", "").strip()
    if flags and not flags.startswith("-"):
        return "XLA_FLAGS names a file of flags, which is left as it is; add the option there"
    return None


def _with_option(flags, flag, option):
    """Flags of XLA with one more option of a flag that takes a list, and whose last one counts."""
    flags = flags.split()
    own = [k for k, word in enumerate(flags) if word.startswith(flag + "=")]
    if own:
        flags[own[-1]] += f",{option}"
    else:
        flags.append(f"{flag}={option}")
    return " ".join(flags)
