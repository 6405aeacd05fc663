"""Stresses of the fibres along the path of a phase, from the strains that it recorded."""

import jax
import jax.numpy as jnp


def fibre_stress(structure, phase):
    """Stress of every fibre at every increment of a phase.

    Args:
        structure: the `Structure` that was analysed.
        phase: one of its `solution.phases`.

    Returns:
        In the shape of `elements`, Pa, NaN from a failure on: for bars and cables with a section
        [n_inc, n_elem, n_fibre], with one law [n_inc, n_elem]; for beams
        [n_inc, n_elem, n_point, n_fibre], the fibres in the order of the section's `y` and `z`;
        None for a group with a mere stiffness.

    A law that remembers is followed from the plastic strains that the phase began with.
    """
    strains = _leaves(structure, phase.path.strain)
    began = _leaves(structure, phase.began)
    return structure.arrange(
        [
            None if strain is None else _follow(group, strain, plastic)
            for group, strain, plastic in zip(structure.groups, strains, began, strict=True)
        ]
    )


def _leaves(structure, tree):
    """A result in the shape of `elements` as a list with an item per group."""
    if tree is None:
        return [None] * len(structure.groups)
    numbers = structure.arrange(list(range(len(structure.groups))))
    items = [None] * len(structure.groups)

    def put(number, item):
        items[number] = item

    jax.tree.map(put, numbers, tree)
    return items


def _follow(group, strain, plastic):
    """Stress [n_inc, ...] of a group from its strains and the plastic strains it began with."""
    if group.n_freedom == 6:
        return _remember(
            strain,
            plastic,
            lambda e, p: group.section.fibre_stress(e[..., 0], e[..., 1], e[..., 2], p),
            lambda e, p: group.section.settle(e[..., 0], e[..., 1], e[..., 2], p),
        )
    section = group.section
    laws = (group.law,) if section is None else section.laws
    counts = (1,) if section is None else section.counts
    if group.tension_only:
        laws = tuple(law.tension_only() for law in laws)

    def parts(plastic):
        start = 0
        for law in laws:
            own = None if not law.n_plastic else plastic[..., start : start + law.n_plastic]
            start += law.n_plastic
            yield law, own

    def stress(strain, plastic):
        each = [law.stress_at(strain, own) for law, own in parts(plastic)]
        if group.tension_only and plastic is None:
            each = [jnp.where(strain < 0, 0.0, value) for value in each]
        if section is None:
            return each[0]
        shape = strain.shape
        return jnp.concatenate(
            [
                jnp.broadcast_to(s[..., None], (*shape, n))
                for s, n in zip(each, counts, strict=True)
            ],
            axis=-1,
        )

    def settle(strain, plastic):
        kept = [law.settle(strain, own) for law, own in parts(plastic) if own is not None]
        return jnp.concatenate(kept, axis=-1)

    return _remember(strain, plastic, stress, settle)


def _remember(strain, plastic, stress, settle):
    """Evaluate `stress` at every increment, with the plastic strains that `settle` leaves."""
    if plastic is None:
        return stress(strain, None)

    def step(plastic, e):
        return settle(e, plastic), stress(e, plastic)

    return jax.lax.scan(step, plastic, strain)[1]
