"""What a reader leaves out of a file: one table for all kinds of files."""

from __future__ import annotations

import dataclasses
from os import PathLike
from types import TracebackType
from typing import Self

from ..common import checks
from .reading import FileError

_PLACES = 3  # places that are named in a row
_ROWS = 12  # rows that a warning shows


@dataclasses.dataclass(frozen=True)
class Omission:
    """A row of the table: something in a file that has not been read.

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
    """The table of one file while it is read; rows of one kind and reason are counted together.

    ``with Omissions(path) as table`` puts the path before a `FileError` of the block, and warns at
    its end.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        """Begin an empty table of a file."""
        self._path = path
        self._places: dict[tuple[str, str], dict[str, None]] = {}
        self._counts: dict[tuple[str, str], int] = {}

    def add(self, what: str, where: str = "", why: str = "", count: int = 1) -> None:
        """Count something that is left out.

        Args:
            what: the kind of thing.
            where: its place in the file, in words.
            why: the reason, or what to do about it.
            count: number of things at this place; none adds no row.
        """
        if count:
            key = what, why
            self._counts[key] = self._counts.get(key, 0) + count
            self._places.setdefault(key, {}).update({where: None} if where else {})

    def table(self) -> tuple[Omission, ...]:
        """Return the rows, a tuple sorted by kind."""
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
        """Issue one `InputWarning` with the rows of the file, if there are any."""
        rows = self.table()
        if rows:
            shown = [f"\n  {row}" for row in rows[:_ROWS]]
            if len(rows) > _ROWS:
                shown.append(f"\n  and {len(rows) - _ROWS} more kinds; `omissions` has them all")
            checks.warn_user(f"{self._path}: left out:{''.join(shown)}")
