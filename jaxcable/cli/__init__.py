"""The command line: one command a file, and `guard`, which reports errors in one line."""

from .parser import main

__all__ = ["main"]
