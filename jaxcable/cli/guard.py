"""Errors on the command line: one clear line on stderr and an exit status."""

from __future__ import annotations

import contextlib
import io
import os
import re
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
from ..common.writing import MADE_BY
from ..files import FileError

OK, FAILED, BAD_INPUT, NOT_PASSED = 0, 1, 2, 3
_HEAD = 4096  # bytes in which files say what has made them
# a path that the text has counted from 1 already stays
_PHASE = re.compile(r"(?<!\()\bphases\[(\d+)\](?:\.\w+|\[\d+\])*")
"""A place in the phases, such as ``phases[1].loads``, counted from 0 as in files and in Python."""
_MARKS = MADE_BY.encode(), b'<meta name="generator" content="jaxcable">'  # of pictures, and pages


class BadInput(Exception):  # noqa: N818 - the input is at fault, not the program
    """Input that a command cannot use; the text of the exception is the line to print."""


@contextlib.contextmanager
def refuse_value_errors(place: str | Path) -> Iterator[None]:
    """Turn a `ValueError` in the ``with`` block into `BadInput`, with `place` before its text."""
    try:
        yield
    except FileError:
        raise
    except ValueError as error:
        raise BadInput(f"{place}: {error}") from None


def run_guarded(command: Callable[[Namespace], int | None], options: Namespace) -> int:
    """Run a command; print any error in one line, and return the exit status.

    The status is 0 (done), 1 (the analysis failed), 2 (bad input) or 3 (checks not passed). With
    `options.quiet` nothing is printed but errors: no results, no warnings, no progress.

    The command runs in another thread, because compiled programs do not react to Ctrl-C: the main
    thread waits for it meanwhile.
    """
    outcome = []

    def work():
        try:
            shown = io.StringIO() if options.quiet else sys.stdout
            with warnings.catch_warnings(), contextlib.redirect_stdout(shown):
                for kind in (InputWarning, UnstableWarning):
                    warnings.simplefilter("ignore" if options.quiet else "always", kind)
                warnings.showwarning = _print_warning
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
    return result if isinstance(result, int) else _report_error(result)


def _report_error(error):
    """Print an error in one line and return the exit status; raise it again if it is a defect."""
    if isinstance(error, AnalysisError):
        print_message(str(error))
        return FAILED
    if isinstance(error, FileError | BadInput):
        print_message(str(error))
        return BAD_INPUT
    if isinstance(error, BrokenPipeError):  # the reader of the output has ended, as `head` does
        sys.stdout = open(os.devnull, "w", encoding="utf-8")
        return OK
    if isinstance(error, OSError) and error.strerror:
        name = error.filename if error.filename is not None else "the system"
        print_message(f"{name}: {error.strerror}")
        return BAD_INPUT
    if isinstance(error, MemoryError):
        print_message("not enough memory for this analysis")
        return FAILED
    raise error


def _print_warning(message, category, *_, **__):
    """Print a warning on stderr in one line, without its line of code.

    Rows of a table in it follow in further lines. Arguments are those of `warnings.showwarning`.
    """
    ours = issubclass(category, InputWarning | UnstableWarning)
    first, *rows = str(message).splitlines() or [""]
    print_message(f"warning: {first}" if ours else first)
    for row in rows:  # of the table of what a reader leaves out
        print(f"  {' '.join(row.split())}", file=sys.stderr)


def print_message(line: str) -> None:
    """Print one line on stderr; a place like ``phases[0]``, counted from 0, becomes "phase 1"."""
    line = _PHASE.sub(lambda found: f"phase {int(found[1]) + 1} ({found[0]})", line)
    print(f"jaxcable: {' '.join(line.split())}", file=sys.stderr)


def require_writable(*paths: str | Path | None, inputs: Sequence[str] = ()) -> None:
    """Raise an error if a file cannot be written, before long work begins.

    Args:
        paths: files that a command writes (those of `file_names.files_to_write`); None is no file.
        inputs: files that it reads.

    Raises:
        BadInput: a file would replace an input, or another file of `paths`.
        OSError: a file cannot be written.
    """
    named: set[str] = set()
    for path in paths:
        if path is None:
            continue
        target = os.path.realpath(path)
        if any(_is_same_file(target, name) for name in inputs):
            raise BadInput(f"{path}: is an input of this command; give another name for the output")
        if target in named or any(_is_same_file(target, other) for other in named):
            raise BadInput(f"{path}: two outputs of this command have this name")
        named.add(target)
        writing.require_writable(path)


def _is_same_file(path, other):
    """Return whether two paths are those of one existing file, perhaps by links."""
    return os.path.exists(path) and os.path.exists(other) and os.path.samefile(path, other)


def require_own_file(path: str | Path, option: str = "--save") -> None:
    """Raise `BadInput` if a file exists that this program has not written.

    It is for default names of outputs, which the user has not given; `option` names the option that
    gives another one.
    """
    path = Path(path)
    if not path.is_file():
        return
    with path.open("rb") as stream:
        begin = stream.read(_HEAD)
    if not any(mark in begin for mark in _MARKS):
        raise BadInput(
            f"{path}: exists and was not written by jaxcable; {option} names another file"
        )
