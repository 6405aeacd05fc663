"""Count what a reader leaves out of a file: one table for all kinds of files."""

from __future__ import annotations

import dataclasses
from os import PathLike
from types import TracebackType
from typing import Self

from ..common import checks
from .reading import FileError

_PLACES = 3  # places that are named in a row, so that it stays one line
_ROWS = 12  # rows that a warning shows, so that it fits a screen


@dataclasses.dataclass(frozen=True)
class Omission:
    """Something in a file that a reader has left out: a row of ``Net.omissions``.

    Attributes:
        what: the kind of thing, such as ``"CIRCLE"`` or ``"attribute 'thickness' of a vertex"``.
        count: how many there are.
        where: the first places in the file, in words: layers, lines or keys; may be empty.
        why: the reason, or what to do about it; may be empty.

    Example:
        >>> row = jc.files.Omission("CIRCLE", 2, "layer 'masts'", "convert it to a polyline first")
        >>> print(row)
        CIRCLE (2), layer 'masts': convert it to a polyline first
    """

    what: str
    count: int
    where: str
    why: str

    def __str__(self) -> str:
        """The row as text."""
        place = f", {self.where}" if self.where else ""
        return f"{self.what} ({self.count}){place}{': ' if self.why else ''}{self.why}"


class Omissions:
    """Table of contents of a file that a reader leaves out, counted by kind and reason.

    ``with Omissions(path) as table`` issues the warning of `warn` at the end of the block. A
    `FileError` that is raised in the block gets the path before its message.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        """Begin an empty table of a file."""
        self._path = path
        self._places: dict[tuple[str, str], dict[str, None]] = {}
        self._counts: dict[tuple[str, str], int] = {}

    def add(self, what: str, where: str = "", why: str = "", count: int = 1) -> None:
        """Count something that is left out of the file.

        Args:
            what: the kind of thing.
            where: its place in the file, in words.
            why: the reason, or what to do about it.
            count: number of things at this place; 0 adds no row.
        """
        if count:
            key = what, why
            self._counts[key] = self._counts.get(key, 0) + count
            self._places.setdefault(key, {}).update({where: None} if where else {})

    def rows(self) -> tuple[Omission, ...]:
        """Return an `Omission` for each kind of thing that is left out, a tuple sorted by kind."""
        rows = []
        for what, why in sorted(self._counts):
            places = list(self._places[what, why])
            more = len(places) - _PLACES
            where = ", ".join(places[:_PLACES]) + (f" and {more} more" if more > 0 else "")
            rows.append(Omission(what, self._counts[what, why], where, why))
        return tuple(rows)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if isinstance(error, FileError):
            raise FileError(f"{self._path}: {error}") from error.__cause__
        if error is None:
            self.warn()

    def warn(self) -> None:
        """Issue one `InputWarning` that lists the omissions from the file; none without any."""
        rows = self.rows()
        if rows:
            shown = [f"\n  {row}" for row in rows[:_ROWS]]
            if len(rows) > _ROWS:
                shown.append(f"\n  and {len(rows) - _ROWS} more kinds; `omissions` has them all")
            checks.warn_user(f"{self._path}: left out:{''.join(shown)}")
