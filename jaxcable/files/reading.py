"""Reading of untrusted files.

A file is data: nothing in it is executed, unpickled or looked up by name outside of constant
tables. It is read up to a limit of size; the message that refuses it is one line, with the place of
the error.
"""

from __future__ import annotations

import json
from os import PathLike
from pathlib import Path
from typing import Any

LARGEST = 64 * 1024 * 1024
"""Default of the largest size that is read, bytes: enough for a net of a million links."""


class FileError(ValueError):
    """A file has wrong contents; the message names the file, and the line or the field.

    Example:
        >>> import tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.json"
        >>> _ = path.write_text('{"format": "jaxcable scene", "version": 9}')
        >>> try:
        ...     jc.load_scene(path)
        ... except jc.files.FileError as error:
        ...     print(str(error).removeprefix(str(path)))
        : version: 9 is newer than 1, the newest that this jaxcable reads; update jaxcable
    """


def parse_number(word: str) -> float:
    """Return the float in a text, as `float` does, but ValueError for underscores and non-ASCII."""
    if not word.isascii() or "_" in word:  # float("1_0") is 10
        raise ValueError(f"{word!r} is not a number")
    try:
        return float(word)
    except ValueError:
        raise ValueError(f"{word!r} is not a number") from None


def parse_integer(word: str) -> int:
    """Return the integer in a text, as `int` does, but ValueError for underscores and non-ASCII."""
    if not word.isascii() or "_" in word:
        raise ValueError(f"{word!r} is not a whole number")
    return int(word)


def read_bytes(path: str | PathLike[str], largest: int = LARGEST) -> bytes:
    """Read a text file of at most `largest` bytes; refuse binary files.

    Raises:
        OSError: there is no such file, or it cannot be read.
        FileError: the file is too large, or binary.
    """
    path = Path(path)
    with path.open("rb") as stream:
        data = stream.read(int(largest) + 1)  # devices and pipes have no size to check beforehand
    if len(data) > largest:
        raise FileError(
            f"{path}: larger than the limit of {largest / 1e6:.3g} MB; to read it all the same, "
            "give largest=..., bytes"
        )
    if b"\0" in data[:4096]:
        raise FileError(f"{path}: is a binary file, not text")
    return data


def read_text(path: str | PathLike[str], largest: int = LARGEST) -> str:
    """Read the text of a UTF-8 file of at most `largest` bytes.

    Raises:
        OSError: there is no such file, or it cannot be read.
        FileError: the file is too large, or no text.
    """
    data = read_bytes(path, largest)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise FileError(f"{path}: line {line}: not UTF-8; save the file in this encoding") from None


def read_json(path: str | PathLike[str], largest: int = LARGEST) -> dict[str, Any]:
    """Read the JSON object in a file, a dict; refuse repeated keys and NaN.

    Raises:
        OSError, FileError: as `read_text`; also FileError, with line and column, for text that is
            no JSON object.
    """
    text = read_text(path, largest)
    if not text.lstrip()[:1] == "{":
        raise FileError(f"{path}: line 1: not a JSON object, which starts with {{")
    try:
        return json.loads(
            text,
            object_pairs_hook=_refuse_repeated_keys,
            parse_constant=_refuse_nan_and_infinity,
            parse_int=_parse_json_integer,
        )
    except json.JSONDecodeError as error:
        raise FileError(f"{path}: {_describe_json_error(text, error)}") from None
    except RecursionError:
        deep = "lists or objects are nested too deeply; look for brackets that are not closed"
        raise FileError(f"{path}: {deep}") from None
    except ValueError as error:
        raise FileError(f"{path}: {error}") from None


_JSON_FAULTS = {
    "Expecting ':' delimiter": "a colon is missing after the name of a field",
    "Expecting property name": "expected the name of a field in double quotes",
    "Expecting value": "expected a number, a text in double quotes, true, false, null, [ or {",
    "Extra data": "there is text after the end of the object",
    "Invalid control character": "a line break or a tab inside of a text",
    "Unterminated string": "the closing quote of a text is missing",
}
"""What the messages of Python's parser, which begin so, mean."""


def _describe_json_error(text, error):
    """Return the message on text that is not valid JSON: line, column, and what to mend.

    `error` is the JSONDecodeError of Python.
    """
    before, after = text[: error.pos].rstrip(), text[error.pos :].lstrip()[:1]
    where = f"line {error.lineno}, column {error.colno}: not valid JSON: "
    if before.endswith(",") and after and after in "}]":
        return f"{where}remove the comma before {after}"
    if not after and not error.msg.startswith("Unterminated"):
        return f"{where}the file ends before all brackets are closed"
    if error.msg.startswith("Expecting ',' delimiter"):
        # Python points at what follows, mostly on the next line
        line = before.count("\n") + 1
        if line < error.lineno:
            return f"line {line}: not valid JSON: a comma is missing at the end of this line"
        return f"{where}a comma is missing before this place"
    faults = (words for begin, words in _JSON_FAULTS.items() if error.msg.startswith(begin))
    return where + next(faults, error.msg)


def _refuse_repeated_keys(pairs):
    """Return the pairs of a JSON object as a dict; raise ValueError for a repeated key."""
    found = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"the field {key!r} occurs twice in one object")
        found[key] = value
    return found


def _parse_json_integer(digits):
    """Return the integer in a text of digits; raise ValueError for more than 20 digits."""
    if len(digits) > 20:
        begin = f"{digits[:12]}...: a whole number of {len(digits)} digits"
        raise ValueError(f"{begin} is too long; at most 20 are allowed")
    return int(digits)


def _refuse_nan_and_infinity(name):
    """Raise ValueError that names the constant: "NaN" and "Infinity" are no valid JSON."""
    raise ValueError(f"{name} is not allowed (look for this word); files hold finite numbers only")
