"""Ctrl-C while the command line still loads: one line, no traceback.

`python -m jaxcable` imports the package, and with it jax, before its `__main__` can act.
"""

import os
import signal
import sys

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it."""


def leave(*_):
    """End the process with one line."""
    os.write(2, b"jaxcable: interrupted\n")
    os._exit(INTERRUPTED)


def is_command_line():
    """Whether this process is ``python -m jaxcable`` or the script ``jaxcable``."""
    words = sys.orig_argv
    return words[1:3] == ["-m", "jaxcable"] or any(
        os.path.basename(word) == "jaxcable" for word in words[:2]
    )


if is_command_line():
    signal.signal(signal.SIGINT, leave)
