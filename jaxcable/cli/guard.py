"""Errors on the command line: one clear line on stderr and an exit status."""

from __future__ import annotations

import contextlib
import io
import os
import sys
import threading
import warnings
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from ..common import writing
from ..common.checks import InputWarning, UnstableWarning
from ..common.interrupt import exit_interrupted
from ..common.status import AnalysisError
from ..files import FileError
from ..plots.style import MADE_BY

OK, FAILED, BAD_INPUT = 0, 1, 2
_HEAD = 4096  # bytes in which files say what has made them
_MARKS = MADE_BY.encode(), b'<meta name="generator" content="jaxcable">'  # of pictures, and pages


class Refused(Exception):  # noqa: N818 - the input is at fault, not the program
    """Input that a command cannot use; the text is the line to print."""


@contextlib.contextmanager
def refusing(place: str | Path) -> Iterator[None]:
    """Refuse what the package calls a `ValueError` in the block, with `place` before its text."""
    try:
        yield
    except FileError:
        raise
    except ValueError as error:
        raise Refused(f"{place}: {error}") from None


def guarded(command: Callable[[Namespace], int | None], options: Namespace) -> int:
    """Run a command; returns the exit status: 0, 1 (analysis failed) or 2 (bad input).

    With `options.quiet` nothing is printed but errors: no results, no warnings. Commands show no
    progress then.

    The command runs in another thread, because compiled programs do not react to Ctrl-C: the main
    thread waits for Ctrl-C meanwhile.
    """
    outcome = []

    def work():
        try:
            shown = io.StringIO() if options.quiet else sys.stdout
            with warnings.catch_warnings(), contextlib.redirect_stdout(shown):
                for kind in (InputWarning, UnstableWarning):
                    warnings.simplefilter("ignore" if options.quiet else "always", kind)
                warnings.showwarning = _warn
                outcome.append(command(options) or OK)
        except BaseException as error:
            outcome.append(error)

    thread = threading.Thread(target=work, daemon=True)
    try:
        thread.start()
        while thread.is_alive():
            thread.join(0.1)
    except KeyboardInterrupt:
        exit_interrupted()  # compiled programs cannot be stopped otherwise
    (result,) = outcome
    return result if isinstance(result, int) else _exit_status(result)


def _exit_status(error):
    """Print an error in one line and return the exit status; errors of the program are raised."""
    if isinstance(error, AnalysisError):
        say(str(error))
        return FAILED
    if isinstance(error, FileError | Refused):
        say(str(error))
        return BAD_INPUT
    if isinstance(error, BrokenPipeError):  # the reader of the output has ended, as `head` does
        sys.stdout = open(os.devnull, "w")
        return OK
    if isinstance(error, OSError) and error.strerror:
        name = error.filename if error.filename is not None else "the system"
        say(f"{name}: {error.strerror}")
        return BAD_INPUT
    if isinstance(error, MemoryError):
        say("not enough memory for this analysis")
        return FAILED
    raise error


def _warn(message, category, *_, **__):
    """Print a warning without its place in this program: one line, and one for each row in it."""
    ours = issubclass(category, InputWarning | UnstableWarning)
    first, *rows = str(message).splitlines() or [""]
    say(f"warning: {first}" if ours else first)
    for row in rows:  # of the table of what a reader leaves out
        print(f"  {' '.join(row.split())}", file=sys.stderr)


def say(line: str) -> None:
    """Print one line on stderr."""
    print(f"jaxcable: {' '.join(line.split())}", file=sys.stderr)


def require_writable(*paths: str | Path | None, inputs: Sequence[str] = ()) -> None:
    """Raise an error if a file cannot be written, before long work begins; None is no file.

    Each path is that of a file, not one from which names of files are made (`derived.tables`).

    Args:
        paths: files that a command writes.
        inputs: files that it reads.

    Raises:
        Refused: a file would take the place of an input, or of another file of `paths`.
        OSError: a file cannot be written.
    """
    named: set[str] = set()
    for path in paths:
        if path is None:
            continue
        target = os.path.realpath(path)
        if any(_is_same(target, name) for name in inputs):
            raise Refused(f"{path}: is read by this command; give another name to write to")
        if target in named or any(_is_same(target, other) for other in named):
            raise Refused(f"{path}: named for two files that this command writes")
        named.add(target)
        writing.require_writable(path)


def _is_same(path, other):
    """Whether two paths are those of one file that is there, perhaps by links."""
    return os.path.exists(path) and os.path.exists(other) and os.path.samefile(path, other)


def require_ours(path: str | Path, option: str = "--save") -> None:
    """Raise `Refused` if a file, which the user has not named, is one that others have made."""
    path = Path(path)
    if not path.is_file():
        return
    with path.open("rb") as stream:
        begin = stream.read(_HEAD)
    if not any(mark in begin for mark in _MARKS):
        raise Refused(
            f"{path}: there already, and not of this program; {option} names another file"
        )
