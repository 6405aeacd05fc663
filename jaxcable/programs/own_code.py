"""What programs depend on beside their arguments: the code of classes that a user has written."""

from __future__ import annotations

import functools
from typing import Any

from ..common import digest


def user_code_digest(tree: Any) -> str | None:
    """Return a digest of the code of users' classes among arguments of a program, as of now.

    It covers what their methods read from outside, which may have changed since the last call. None
    if all classes are of the package or of libraries.

    Args:
        tree: structure of the pytree of arguments (`jax.tree.structure`).
    """
    try:
        own = _user_objects(tree)
    except TypeError:  # not hashable: with traced indices
        own = _user_objects.__wrapped__(tree)
    return digest.host_function_digest(own) if own else None


@functools.lru_cache(maxsize=256)
def _user_objects(tree):
    """Return users' classes and functions in a tree structure: its nodes and their static fields.

    A tuple without repetition.
    """
    found = []

    def add(value):
        if isinstance(value, tuple | list):
            for part in value:
                add(part)
        elif not digest.is_library_module(getattr(value, "__module__", "builtins")):
            found.append(value)

    def visit(tree):
        data = tree.node_data()
        if data is not None:
            add(data)
        for child in tree.children():
            visit(child)

    visit(tree)
    return tuple(dict.fromkeys(found))
