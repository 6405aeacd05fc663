"""Names of profiles and cables as people write them, and the nearest ones to an unknown name."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable

_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_H_SHAPE = re.compile(r"he(\d+)(aa|a|b|m)")
_IPE = re.compile(r"ipe(\d+)(a|o)")
_EQUAL_LEGS = re.compile(r"(l|shs|rhs)([\d.]+)x\2x([\d.]+)")


def plain_name(name: str) -> str:
    """Return the normalized name of a profile or cable, by which spellings are compared.

    Spaces, hyphens and capitals do not count; the sign of multiplication is x, and a decimal comma
    a point. ``HE 200 A`` is the same as ``HEA 200``, and ``L 100x100x10`` as ``L 100x10``.
    """
    text = str(name).lower().replace("\u00d7", "x").replace("*", "x").replace(",", ".")
    text = re.sub(r"[\s_-]", "", text)
    text = _NUMBER.sub(lambda found: f"{float(found[0]):.10g}", text)
    for pattern in (_H_SHAPE, _IPE):
        if found := pattern.fullmatch(text):
            return ("he" if pattern is _H_SHAPE else "ipe") + found[2] + found[1]
    if found := _EQUAL_LEGS.fullmatch(text):
        return f"{'shs' if found[1] == 'rhs' else found[1]}{found[2]}x{found[3]}"
    return text


def unknown_name_error(name: str, names: Iterable[str], what: str) -> ValueError:
    """Return the ValueError for a name that is in no table; its text has up to three near names.

    Args:
        name: what was asked for.
        names: the names that there are.
        what: what they are names of, and how to list them; ends the text.
    """
    plain, wanted = {plain_name(one): one for one in names}, plain_name(name)
    alike = [one for one in plain if _NUMBER.sub("#", one) == _NUMBER.sub("#", wanted)]
    near = sorted(alike, key=lambda one: _number_distance(one, wanted))[:3]
    near = near or [x for x in plain if all(plain_name(w) in x for w in str(name).split())][:3]
    near = near or difflib.get_close_matches(wanted, list(plain), n=3, cutoff=0.6)
    hint = f"; near it are {', '.join(plain[one] for one in near)}" if near else ""
    return ValueError(f"name = {name!r}: is in no table{hint}; {what}")


def _number_distance(one, other):
    """Return how far the numbers in two names are apart: the sum of |log(a / b)| over their pairs.

    Both names have as many numbers.
    """
    pairs = zip(_NUMBER.findall(one), _NUMBER.findall(other), strict=True)
    return sum(abs(math.log(max(float(a), 1e-9) / max(float(b), 1e-9))) for a, b in pairs)
