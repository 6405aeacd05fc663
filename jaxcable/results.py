"""What is read off a point of equilibrium, and the shape in which users get it."""

import jax.numpy as jnp

from ._tree import copy
from .assembly import each
from .ramp import make_system
from .solution import State
from .topology import topology_of


def state_of(frame, carry, load, number, factor, freedoms):
    """The `State` that a carry stands for; of the freedoms only what is held matters."""
    nodes, groups = frame
    motion = carry.motion
    system = make_system(nodes, groups, carry, None, freedoms, load)
    turns = motion.shape[1] > 3
    displacement = motion[:, :3] if turns else motion
    state = State(
        displacement=displacement,
        positions=nodes + displacement,
        tension=system.tensions(motion),
        rest_length=[state.rest_length for state in carry.states],
        reactions=system.reactions(motion),
        load=_acting(system, motion),
        phase=number,
        load_factor=factor,
        carry=None,
        fixed=None,
        peak_tension=system.peak_tensions(motion),
    )
    if not turns:
        return state
    return copy(
        state,
        reactions=state.reactions[:, :3],
        load=state.load[:, :3],
        rotation=motion[:, 3:],
        reaction_moments=state.reactions[:, 3:],
        section_forces=system.section_forces(motion),
    )


def _acting(system, motion):
    """All loads on every node, with what slides along ropes where it is now."""
    load = system.all_load(motion)
    for group, state in zip(system.groups, system.states, strict=True):
        if group.slides and state.line_load is not None:
            slid = each("slid", group, state, system.nodes, motion)
            load = load.at[group.links, :3].add(slid)
    return load


def row_of(ramp, system, x):
    """One increment of a path."""
    motion = system.motion(x)
    n_slack = sum(jnp.sum(slack) for slack in system.slack(motion))
    n_loose = jnp.sum(system.loose_nodes(motion))
    moved = motion - ramp.begin.motion
    if motion.shape[1] > 3:
        moved = moved[:, :3]
    strain = system.strains(motion)
    if all(own is None for own in strain):
        strain = None
    forces = system.tensions(motion), system.peak_tensions(motion)
    return moved, *forces, n_slack, n_loose, strain


def with_peaks(part):
    """Peak tensions put where a group has none of its own: its tensions, the same arrays."""
    pairs = zip(part.tension, part.peak_tension, strict=True)
    return copy(part, peak_tension=[own if peak is None else peak for own, peak in pairs])


def on_nodes(structure, part, per_element, per_node=("displacement",)):
    """Lists with an item per group put into the shape of the elements, rows onto their nodes.

    Args:
        structure: `Structure`.
        part: result of the compiled core.
        per_element: names of what has an item per group.
        per_node: names of what has an entry for each row of motion, on its second axis.
    """
    present = [name for name in per_element if getattr(part, name) is not None]
    changes = {name: structure.arrange(getattr(part, name)) for name in present}
    if structure.rows()[0] is not None:
        changes |= {name: getattr(part, name)[:, : structure.n_node] for name in per_node}
    return copy(part, **changes)


def arranged(structure, solution, fixed):
    """Put lists with an item per group into the shape of the elements, rows onto their nodes."""
    rows = structure.rows()[0]
    n_node = structure.n_node

    def arrange(part, *names):
        present = [name for name in names if getattr(part, name) is not None]
        return copy(part, **{name: structure.arrange(getattr(part, name)) for name in present})

    def fold(part):
        names = ("tension", "peak_tension", "rest_length", "section_forces")
        part = arrange(with_peaks(part), *names)
        if rows is None:
            return part
        one = ("displacement", "positions", "rotation")
        cut = {name: getattr(part, name)[:n_node] for name in one}
        summed = ("reactions", "reaction_moments", "load")  # a hinge passes its force to the node
        for name in (name for name in summed if hasattr(part, name)):
            value = getattr(part, name)
            cut[name] = jnp.zeros_like(value[:n_node]).at[rows.node].add(value)
        return copy(part, **cut)

    phases = []
    for phase in solution.phases:
        names = ("tension", "peak_tension", "strain")
        path = on_nodes(structure, with_peaks(phase.path), names)
        phases.append(copy(arrange(fold(phase), "began"), path=path))
    last = copy(fold(solution.last), fixed=fixed, topology=topology_of(structure))
    links = tuple(group.links for group in structure.groups)
    return copy(fold(solution), phases=tuple(phases), last=last, links=links)
