"""Which element groups a load along elements acts on."""

import jax


def chosen(on, structure):
    """Numbers of the groups that the key `on` of the structure's elements names; None: all.

    Raises:
        ValueError: there is no such key.
    """
    count = len(structure.groups)
    if on is None:
        return tuple(range(count))
    numbers = structure.arrange(list(range(count)))
    try:
        return tuple(jax.tree.leaves(numbers[on]))
    except (KeyError, IndexError, TypeError):
        raise ValueError(f"on = {on!r}: no such key in the structure's elements") from None
