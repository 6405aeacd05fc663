"""Settings of the process while a command runs: precision, kept programs, warnings."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator

import jax
import matplotlib

from ..common import program_store
from .guard import print_message

_PRECISION = "jax_enable_x64"


@contextlib.contextmanager
def command_settings(quiet: bool, whole_process: bool) -> Iterator[None]:
    """Set double precision, the store of compiled programs and warnings for the ``with`` block.

    All are restored at its end.

    Args:
        quiet: whether to leave out warnings.
        whole_process: whether the process was started for the command; then pictures need no
            display.
    """
    if whole_process:
        matplotlib.use("Agg")  # pictures go to files; no display is needed
    double = getattr(jax.config, _PRECISION)
    with warnings.catch_warnings(), program_store.preserve_program_settings():
        with warnings.catch_warnings(record=True) as refused:
            warnings.simplefilter("always", RuntimeWarning)
            program_store.keep_programs()
        # of files that another process is just writing; `keep_programs` says so in the block only
        text = "Error (reading|writing) persistent compilation cache entry"
        warnings.filterwarnings("ignore", text)
        for warning in () if quiet else refused:
            print_message(f"warning: {warning.message}")
        jax.config.update(_PRECISION, True)
        try:
            yield
        finally:
            jax.config.update(_PRECISION, double)
