"""The command line: one command a file, and `guard`, which turns what goes wrong into one line."""

from .parser import main

__all__ = ["main"]
