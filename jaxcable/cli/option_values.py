"""Words of options as numbers within limits; argparse says what is expected otherwise."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable

from ..files.reading import parse_integer, parse_number


def parse_any(word: str) -> float:
    """Return a word as a number; raise argparse's error for any other."""
    return _parse_within(word, parse_number, lambda v: True, "a number")


def parse_positive(word: str) -> float:
    """Return a word as a positive number; raise argparse's error for any other."""
    return _parse_within(word, parse_number, lambda v: 0 < v < float("inf"), "a positive number")


def whole_number_up_to(most: int) -> Callable[[str], int]:
    """Return a function that parses a whole number from 0 to `most`, as `parse_positive` does."""

    def whole_number(word):
        expected = f"a whole number from 0 to {most}"
        return _parse_within(word, parse_integer, lambda v: 0 <= v <= most, expected)

    return whole_number


def _parse_within(word, parse, is_allowed, expected):
    """Return ``parse(word)``; raise argparse's error if it fails or its value is not allowed.

    `is_allowed` judges the value, and `expected` says in words what is allowed.
    """
    with contextlib.suppress(ValueError):
        if is_allowed(value := parse(word)):
            return value
    raise argparse.ArgumentTypeError(f"{word}: expected {expected}")
