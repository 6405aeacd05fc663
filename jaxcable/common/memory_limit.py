"""Refuse, in words, dense matrices that do not fit into memory."""

from __future__ import annotations

import os
from pathlib import Path

import jax

_CONTROL_GROUP = Path("/sys/fs/cgroup")  # limits of a container (control groups, version 2)


def available_bytes() -> int | None:
    """Return the bytes of memory left for arrays on the default device; None if that is unknown.

    On the CPU it is what the machine has left or, if that is less, the container's limit leaves.
    """
    device = getattr(jax.config, "jax_default_device", None) or jax.local_devices()[0]
    stats = device.memory_stats() if isinstance(device, jax.Device) else None
    if stats and "bytes_limit" in stats:
        return stats["bytes_limit"] - stats.get("bytes_in_use", 0)
    left = [_available_machine_bytes(), _available_container_bytes()]
    return min((amount for amount in left if amount is not None), default=None)


_NEVER_REFUSED = 1 << 26  # bytes that are never refused: less than jax itself takes


def require_memory(n_bytes: float, what: str, way_out: str) -> None:
    """Raise ValueError if arrays do not fit into memory.

    Args:
        n_bytes: bytes that the arrays take together.
        what: what needs the memory, in words; begins the message.
        way_out: what to do instead, in words; ends the message.
    """
    if n_bytes < _NEVER_REFUSED:
        return
    left = available_bytes()
    if left is not None and n_bytes > left:
        raise ValueError(
            f"{what}: needs about {_format_bytes(n_bytes)} of memory, and "
            f"{_format_bytes(left)} are left; {way_out}"
        )


def _available_machine_bytes():
    """Return the bytes that the machine can give without swapping; None if that is unknown."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="utf-8").splitlines()
        return 1024 * int(dict(line.split(":") for line in lines)["MemAvailable"].split()[0])
    except (OSError, KeyError):
        pass
    try:  # other systems: all of the memory
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None


def _available_container_bytes():
    """Return the bytes left below the memory limit of a container; None if there is no limit.

    Cached files, which the system counts as used memory, are counted as free.
    """
    try:
        names = "max", "current", "stat"
        limit, used, stat = ((_CONTROL_GROUP / f"memory.{name}").read_text() for name in names)
        kinds = dict(line.split() for line in stat.splitlines())
        files = int(kinds["inactive_file"]) + int(kinds["active_file"])
        return int(limit) - max(int(used) - files, 0)
    except (OSError, KeyError, ValueError):  # no such file, or "max"
        return None


def _format_bytes(n_bytes):
    """Return an amount of memory as a text in MiB or GiB."""
    return f"{n_bytes / 2**30:.3g} GiB" if n_bytes >= 2**30 else f"{n_bytes / 2**20:.3g} MiB"
