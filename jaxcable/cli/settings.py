"""Settings of the process while a command runs: precision, and pictures without a display."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

import jax

_PRECISION = "jax_enable_x64"


@contextlib.contextmanager
def command_settings(whole_process: bool) -> Iterator[None]:
    """Set double precision for the ``with`` block, and restore the precision at its end.

    Args:
        whole_process: whether the process was started for the command; then pictures need no
            display.
    """
    if whole_process:
        # pictures go to files; no display is needed, and matplotlib is imported where one is drawn
        os.environ["MPLBACKEND"] = "Agg"
    double = getattr(jax.config, _PRECISION)
    jax.config.update(_PRECISION, True)
    try:
        yield
    finally:
        jax.config.update(_PRECISION, double)
