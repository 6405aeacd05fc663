"""Refuse, in words, dense matrices that do not fit into memory."""

from __future__ import annotations

import os
from pathlib import Path

import jax

_GROUP = Path("/sys/fs/cgroup")  # limits of a container (control groups, version 2)


def available() -> int | None:
    """Bytes of memory that are left for arrays on the default device; None if that is unknown.

    On the host those of the machine and, in a container, those below its limit.
    """
    device = getattr(jax.config, "jax_default_device", None) or jax.local_devices()[0]
    stats = device.memory_stats() if isinstance(device, jax.Device) else None
    if stats and "bytes_limit" in stats:
        return stats["bytes_limit"] - stats.get("bytes_in_use", 0)
    left = [_machine(), _container()]
    return min((amount for amount in left if amount is not None), default=None)


_SMALL = 1 << 26  # bytes that are never refused: less than jax itself takes


def require(n_bytes: float, what: str, way_out: str) -> None:
    """Raise ValueError if arrays do not fit into memory.

    Args:
        n_bytes: what the arrays of a computation need together.
        what: needs it, in words; begins the message.
        way_out: what to do instead, in words.
    """
    if n_bytes < _SMALL:
        return
    left = available()
    if left is not None and n_bytes > left:
        raise ValueError(
            f"{what}: needs about {_words(n_bytes)} of memory, and {_words(left)} are left; "
            f"{way_out}"
        )


def _machine():
    """Bytes that the machine can give without swapping."""
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    except (OSError, ValueError, IndexError):
        pass
    try:  # other systems: all of the memory
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None


def _container():
    """Bytes below the limit of the container; None if there is none.

    What the system keeps of files counts as used there, and is given back when it is needed.
    """
    try:
        limit = int((_GROUP / "memory.max").read_text())
        used = int((_GROUP / "memory.current").read_text())
        stat = dict(line.split() for line in (_GROUP / "memory.stat").read_text().splitlines())
        files = int(stat.get("inactive_file", 0)) + int(stat.get("active_file", 0))
        return limit - max(used - files, 0)
    except (OSError, ValueError):  # no such file, or "max"
        return None


def _words(n_bytes):
    """An amount of memory in words."""
    return f"{n_bytes / 2**30:.3g} GiB" if n_bytes >= 2**30 else f"{n_bytes / 2**20:.3g} MiB"
