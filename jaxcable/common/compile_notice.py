"""The notice that one waits for the compiler: one line in a terminal or a notebook, nowhere else.

Who asks for progress gets it everywhere (``progress=True``); who works in a terminal or in a
notebook gets it without asking, unless ``progress=False`` or the environment variable
JAXCABLE_PROGRESS=0 says no.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any, Literal

from .interrupt import SHOWN_LINE
from .program_store import are_programs_kept
from .progress import SHOW, Printer

_VARIABLE = "JAXCABLE_PROGRESS"
_NO = "", "0", "false", "no", "off"
_PAUSE = 2.0  # seconds before a notice that nobody has asked for
_COLUMNS = 80  # of a terminal that does not say how wide it is
_UNATTENDED = "CI", "PYTEST_CURRENT_TEST"  # environment variables where nobody looks

_Place = Printer | Literal["terminal", "never"] | None
# where the call from outside, which one waits for, shows notices: by a printer, in a terminal from
# any thread, nowhere; None: in a terminal or a notebook, from the main thread
_PLACE: ContextVar[_Place] = ContextVar("_PLACE", default=None)
_one_at_a_time = threading.Lock()
_cells: list[int] = []  # execution number of the cell of a notebook that had the last notice


@contextlib.contextmanager
def show_compilation(place: bool | Callable[[Any], object] | str | None) -> Iterator[None]:
    """Say where `announce_compilation` shows its notices while a ``with`` block runs.

    Args:
        place: argument `progress` of a public function: None for a terminal or a notebook; True or
            a `Printer` for the stream of the printer; False or another function for nowhere. Or
            "terminal", for a terminal whatever the thread. Within another such block it has no
            effect: one waits for the outer call.
    """
    shown: _Place
    if place is None or _PLACE.get() is not None:
        yield
        return
    if place is True:
        shown = SHOW
    elif isinstance(place, Printer):
        shown = place
    else:
        shown = "terminal" if place == "terminal" else "never"
    token = _PLACE.set(shown)
    try:
        yield
    finally:
        _PLACE.reset(token)


@contextlib.contextmanager
def announce_compilation() -> Iterator[None]:
    """Show one line if a ``with`` block, in which a program is compiled, takes long.

    In a terminal the line is erased when the block ends. Nothing is shown after that.
    """
    notice = _make_notice()
    if notice is None or not _one_at_a_time.acquire(blocking=False):  # nobody looks; nested
        yield
        return
    try:
        notice.start()
        yield
    finally:
        _one_at_a_time.release()
        notice.end()


def _make_notice():
    """Return the `_Notice` for a program that is now compiled; None where it is not shown."""
    place = _PLACE.get()
    if isinstance(place, Printer):
        return _Notice(place.pause, place.print_line, None)
    if place == "never" or os.environ.get(_VARIABLE, "1").strip().lower() in _NO:
        return None
    if any(name in os.environ for name in _UNATTENDED) or multiprocessing.parent_process():
        return None
    if place is None and threading.current_thread() is not threading.main_thread():
        return None
    if _is_terminal(sys.stderr):
        return _Notice(_PAUSE, _write_on_line, _erase_line)
    cell = _cell_of_notebook()
    if cell is None or cell in _cells:
        return None

    def print_once(text):
        _cells[:] = [cell]
        print(text, file=sys.stderr, flush=True)

    return _Notice(_PAUSE, print_once, None)


class _Notice:
    """A line that a thread shows after a pause, unless it has ended before.

    Args:
        pause: seconds.
        show: function that shows a text.
        hide: function that removes the text again, or None if it stays.
    """

    def __init__(self, pause, show, hide):
        self.show_text, self.hide_text, self.text = show, hide, _notice_text()
        self.shown = self.ended = False
        self.lock = threading.Lock()
        self.timer = threading.Timer(pause, self._show)
        self.timer.daemon = True

    def start(self):
        self.timer.start()

    def _show(self):
        with self.lock, contextlib.suppress(OSError, ValueError):  # the stream has been closed
            if not self.ended:
                self.shown = True
                self.show_text(self.text)

    def end(self):
        """Show nothing from now on; remove what is shown."""
        self.timer.cancel()
        with self.lock, contextlib.suppress(OSError, ValueError):
            self.ended = True
            if self.shown and self.hide_text is not None:
                self.hide_text(self.text)


def _notice_text():
    """Return the line to show: what one waits for, and how to avoid it in the next process."""
    if are_programs_kept():
        return "compiling the solver: some seconds, in the first run only"
    return "compiling the solver: some seconds in each process; jc.keep_programs() keeps it"


def _is_terminal(stream):
    """Tell whether a stream, or None, is a terminal."""
    try:
        return stream.isatty()
    except (AttributeError, ValueError):  # no stream; one that has been closed
        return False


def _write_on_line(text):
    """Write a text to the terminal without ending the line, as much as the line has room for."""
    text = text[: _columns_of_terminal() - 1]
    SHOWN_LINE[:] = [f"\r{' ' * len(text)}\r"]
    sys.stderr.write(f"\r{text}")
    sys.stderr.flush()


def _erase_line(_):
    """Erase what `_write_on_line` has written, and go to the beginning of the line."""
    sys.stderr.write(SHOWN_LINE.pop())
    sys.stderr.flush()


def _columns_of_terminal():
    """Return the number of characters in a line of the terminal."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns or _COLUMNS
    except (AttributeError, OSError, ValueError):  # a stream that only says it is a terminal
        return _COLUMNS


def _cell_of_notebook():
    """Return the execution number of the cell of a notebook that runs; None outside of notebooks.

    None also for a notebook that a program executes, from which nobody could be asked for input.
    """
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if hasattr(ipython, "get_ipython") else None
    kernel = getattr(shell, "kernel", None)
    if kernel is None:
        return None
    try:
        asks = kernel.get_parent("shell")["content"]["allow_stdin"]
    except (AttributeError, KeyError, TypeError):  # a kernel that says nothing of it
        asks = True
    return getattr(shell, "execution_count", 0) if asks else None
