"""Ctrl-C while the command line still loads: one line, no traceback.

`python -m jaxcable` imports the package, and with it jax, before its `__main__` can act.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from typing import Any, NoReturn

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it."""


UNFINISHED_FILES: list[str] = []
"""Names of files that are being written: an interrupted process removes them."""


def exit_interrupted(*_: Any) -> NoReturn:
    """End the process after Ctrl-C: print one line, and remove files that are half written."""
    for name in UNFINISHED_FILES:
        with contextlib.suppress(OSError):
            os.unlink(name)
    os.write(2, b"jaxcable: interrupted\n")
    os._exit(INTERRUPTED)


def is_command_line() -> bool:
    """Tell whether this process is ``python -m jaxcable`` or the script ``jaxcable``."""
    words = sys.orig_argv
    return words[1:3] == ["-m", "jaxcable"] or any(
        os.path.basename(word) == "jaxcable" for word in words[:2]
    )


if is_command_line() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, exit_interrupted)
