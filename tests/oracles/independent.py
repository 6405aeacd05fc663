"""Is a result in equilibrium? A check in NumPy that shares no code with the package.

It reads what the caller stated (structure, phases) and what `solve` answered, works out unstressed
lengths, forces and loads of its own in extended precision, and compares. Forces come from the
equations of a bar, a cable, a polygonal law, Besseling's parallel model, a rope over several nodes
and the elastic catenary (Irvine's integrals, solved in two unknowns; the package solves one).

What `Newton` promises at a free freedom (see its docstring): a residual of at most `tol`, not below
64 eps, times the largest over nodes of (sum of the absolute end forces + load); and at least what
the rounding of displacements leaves, 8 eps u/L EA; cables are granted that as noise, see below.
`Verdict.ratio` is the residual over that. Beyond it a residual cannot be known better than the
arithmetic of the state evaluates it: that noise, ``NOISE eps (EA w/L + N)``, is in `Verdict.excess`
too.
"""

import dataclasses

import jax
import numpy as np
from oracles.independent_laws import AxialLaw, hang

import jaxcable as jc

WIDE = np.longdouble  # 64 bits of mantissa where there are such, else what a double has
NOISE = 8.0
"""Roundings in a force: of chord, displacement, their products, root, quotient and law."""


@dataclasses.dataclass
class Verdict:
    """What the check found.

    Attributes:
        residual: largest unbalanced force at a free freedom, N.
        scale: force that it is judged by, N.
        ratio: largest over freedoms of residual over what the method promises.
        excess: the same with the noise of the arithmetic granted.
        wrong: results that contradict the check, in words.
        forces: axial force per group, [n_elem], N.
    """

    residual: float
    scale: float
    ratio: float
    excess: float
    wrong: list
    forces: list

    @property
    def passed(self):
        """Whether an OK status is deserved."""
        return self.excess <= 1 and not self.wrong


@dataclasses.dataclass
class _Group:
    """Elements of one group, and the state that the inputs of the phases have left."""

    group: object
    law: object
    rest: object  # L0, [n]
    elongation: object  # initial chord minus L0, [n]
    blurred: object  # whether the elongation has the digits of a length only, [n]
    chord: object  # [n]
    warm: object = 1.0  # length over that at the reference temperature: 1 + expansion sum(dt)


def verdict(structure, phases, solution, tol=None):
    """Judge a solution that claims to be in equilibrium at the end of all phases.

    `structure`, `phases` as given to `solve` with `Newton(tol)`; `solution` its answer, of status
    OK and without a start.
    """
    dtype = np.asarray(solution.displacement).dtype
    eps = float(np.finfo(dtype).eps)
    limit = max((1e-10 if eps < 1e-12 else 1e-5) if tol is None else tol, 64 * eps)
    nodes = _as_seen(structure.nodes, dtype)
    moved = _wide(solution.displacement)
    if not np.isfinite(np.asarray(solution.displacement)).all():
        return Verdict(np.nan, np.nan, np.inf, np.inf, ["displacement: not finite"], [])

    parts = [_unstressed(group, nodes, dtype) for group in structure.groups]
    fixed = structure.supports.fixed(len(nodes))[:, :3]
    load, factor_of_weight = np.zeros_like(nodes), np.zeros(3, WIDE)
    held = np.zeros_like(nodes)
    largest = _largest_moves(solution, len(nodes))
    for phase, result in zip(phases, solution.phases, strict=True):
        if phase.supports is not None:
            now = phase.supports.fixed(len(nodes))[:, :3]
            load[now & ~fixed] = 0
            fixed = now
        for part, stated in zip(parts, _statements(structure, phase), strict=True):
            _state(part, stated, dtype)
        for one in _loads(phase):
            if isinstance(one, jc.NodalLoads):
                force = np.broadcast_to(_as_seen(one.forces, dtype), (len(one.nodes), 3))
                np.add.at(load, one.nodes.array, force)
            elif isinstance(one, jc.SelfWeight):
                factor_of_weight += _as_seen(one.direction, dtype)
            elif isinstance(one, jc.SupportMovement):
                step = np.broadcast_to(_as_seen(one.displacements, dtype), (len(one.nodes), 3))
                np.add.at(held, one.nodes.array, step)
            else:
                raise NotImplementedError(type(one).__name__)
        _remember(parts, nodes, result.path)

    wrong = []
    force, rounding = np.zeros_like(nodes), np.zeros_like(nodes)
    size, noise, blur = np.zeros((3, len(nodes)), WIDE)
    axial = []
    for part in parts:
        links = part.group.links.array
        line = None
        if part.group.weight is not None and np.any(factor_of_weight != 0):
            weight = _as_seen(part.group.weight, dtype)[:, None] * factor_of_weight
            share = weight * (part.rest / part.warm)[:, None] / 2  # heat makes no mass
            for end in (0, -1):
                np.add.at(load, links[:, end], share)
            hangs = isinstance(part.group, jc.Catenaries)
            line = weight / (part.warm * np.ones_like(part.rest))[:, None] if hangs else None
        ends, tension, stiffness, inner = _end_forces(part, nodes, moved, line)
        claimed = _wide(jax.tree.leaves(solution.tension)[len(axial)])
        unsure = np.where(part.blurred, NOISE * eps * stiffness, 0)
        if line is not None:  # stiffer where it is tauter: between both lengths, no tangent
            shorter = dataclasses.replace(part, rest=part.rest * (1 - NOISE * eps))
            tauter = _end_forces(shorter, nodes, moved, line)[1]
            unsure = np.where(part.blurred, np.maximum(tauter - tension, unsure), 0)
        np.add.at(force, links, ends)
        # the promise counts from the tension that is claimed, where the digits of a length allow it
        apart = np.minimum(np.abs(claimed - tension), unsure)
        np.add.at(size, links, np.sqrt((ends**2).sum(-1)) + (inner + apart)[:, None])
        apart = moved[links].max((1, 2)) - moved[links].min((1, 2))
        if part.law.memory is not None:  # has the rounding of the strains that it has been through
            apart = np.maximum(apart, 2 * largest[links].max(1))
        grain = NOISE * eps * (stiffness * apart / part.chord + np.abs(tension) + inner)
        np.add.at(noise, links, grain[:, None])
        np.add.at(blur, links, unsure[:, None])
        if not part.group.tension_only:
            vector = np.abs((nodes + moved)[links[:, 1]] - (nodes + moved)[links[:, 0]])
            u = largest[links].max(1)
            length = np.sqrt((vector**2).sum(1))
            own = 8 * eps * stiffness * u / length
            np.add.at(rounding, links, (own / length)[:, None, None] * vector[:, None, :])
        axial.append(tension)
        if np.any(np.abs(claimed - tension) > grain + unsure):
            wrong.append(f"tension: {np.abs(claimed - tension).max():.3g} N apart")
        own = _wide(jax.tree.leaves(solution.rest_length)[len(axial) - 1])
        if np.any(np.abs(own - part.rest) > 8 * eps * part.rest):
            wrong.append(f"rest_length: {np.abs(own - part.rest).max():.3g} m apart")
        if part.law.ends is not None and np.any(part.law.beyond(_strain(part, nodes, moved), eps)):
            wrong.append("strain: beyond the curve of the law")

    weight = np.sqrt((load**2).sum(1))
    scale = np.max(size + weight)
    unbalanced = np.where(fixed, 0, force - load)
    promised = np.maximum(limit * scale, rounding) + blur[:, None]
    granted = promised + noise[:, None]
    ratio, excess = (
        float(np.max(np.where(unbalanced == 0, 0, np.abs(unbalanced) / np.maximum(g, 1e-300))))
        for g in (promised, granted)
    )
    wrong += _contradictions(solution, nodes, moved, fixed, held, load, force, granted, eps)
    return Verdict(
        float(np.abs(unbalanced).max()), float(scale), ratio, excess, wrong, [*map(_double, axial)]
    )


def _contradictions(solution, nodes, moved, fixed, held, load, force, granted, eps):
    """Results beside the displacements and tensions that do not fit."""
    wrong = []
    for name in ("positions", "reactions", "load"):
        if not np.isfinite(np.asarray(getattr(solution, name))).all():
            wrong.append(f"{name}: not finite")
    placed = np.abs(_wide(solution.positions) - (nodes + moved))
    if np.any(placed > 2 * eps * (np.abs(nodes) + np.abs(moved))):
        wrong.append("positions: not nodes plus displacement")
    carried = np.abs(_wide(solution.load) - load)
    if np.any(carried > 16 * eps * np.abs(load).max()):
        wrong.append(f"load: {carried.max():.3g} N apart")
    reaction = np.where(fixed, force - load, 0)
    apart = np.abs(_wide(solution.reactions) - reaction)
    if np.any(apart > granted + 32 * eps * np.max(np.abs(reaction))):
        wrong.append(f"reactions: {apart.max():.3g} N apart")
    strayed = np.abs(np.where(fixed & (held != 0), moved - held, 0))
    # supports that were free before begin anywhere; those that were moved all along end here
    if np.any(strayed > 8 * eps * np.abs(held).max()) and not _released(solution):
        wrong.append(f"supports: {strayed.max():.3g} m from where they are moved to")
    return wrong


def _released(solution):
    fixed = solution.last.fixed
    return any(f != fixed[0] for f in fixed)


def _wide(values):
    return np.asarray(values, WIDE)


def _double(values):
    return np.asarray(values, float)


def _as_seen(values, dtype):
    """Numbers as the analysis has them, rounded to its dtype."""
    return np.asarray(np.asarray(values), dtype).astype(WIDE)


def _loads(phase):
    loads = phase.loads
    if loads is None:
        return []
    return list(loads) if isinstance(loads, list | tuple) else [loads]


def _largest_moves(solution, n_node):
    """Largest displacement component that a node ever had, [n_node], m."""
    largest = np.zeros(n_node, WIDE)
    for phase in solution.phases:
        largest = np.maximum(largest, np.abs(_wide(phase.path.displacement)).max((0, 2)))
    return largest


def _unstressed(group, nodes, dtype):
    links = group.links.array
    piece = np.diff(nodes[links], axis=1)
    chord = np.sqrt((piece**2).sum(-1)).sum(-1)
    rest, blurred = chord, np.zeros(len(links), bool)
    if group.rest_length is not None:
        rest, blurred = _as_seen(group.rest_length, dtype), ~blurred
    return _Group(group, AxialLaw(group, dtype), rest, chord - rest, blurred, chord)


def _statements(structure, phase):
    """Prestress of a phase per group, dicts from name to [n_elem] or scalar; plain forms only."""
    names = ("pretension", "force_density", "prestrain", "rest_length", "shortening", "temperature")
    out = [{} for _ in structure.groups]
    keys = list(structure.elements) if isinstance(structure.elements, dict) else None
    for name in names:
        value = getattr(phase, name)
        if value is None:
            continue
        for k, stated in enumerate(out):
            own = value[sorted(keys)[k]] if isinstance(value, dict) else value
            if own is not None:
                stated[name] = own
    return out


def _state(part, stated, dtype):
    chord = part.chord
    for name, value in stated.items():
        value = np.broadcast_to(_as_seen(value, dtype), chord.shape)
        if name == "rest_length":
            part.rest, part.elongation = value, chord - value
            part.blurred = np.ones(len(chord), bool)
        elif name in ("pretension", "force_density", "prestrain"):
            force = {"pretension": value, "force_density": value * chord}.get(name)
            strain = value if name == "prestrain" else part.law.strain_at(force)
            part.rest = chord / (1 + strain)
            part.elongation = part.rest * strain
            part.blurred = np.zeros(len(chord), bool)
    if "shortening" in stated:
        change = _as_seen(stated["shortening"], dtype)
        part.rest, part.elongation = part.rest - change, part.elongation + change
    if "temperature" in stated:
        expansion = _as_seen(part.group.expansion, dtype)
        strain = expansion * _as_seen(stated["temperature"], dtype)
        change = part.rest / part.warm * strain  # of the length at the reference temperature
        part.warm = part.warm + strain
        part.rest, part.elongation = part.rest + change, part.elongation - change


def _change(part, nodes, moved):
    """Change of length from the initial nodes, m: of a straight element without a difference."""
    links = part.group.links.array
    start, w = np.diff(nodes[links], axis=1), np.diff(moved[links], axis=1)
    before = np.sqrt((start**2).sum(-1))
    after = np.sqrt(((start + w) ** 2).sum(-1))
    both = before + after
    return (((2 * start + w) * w).sum(-1) / np.where(both > 0, both, 1)).sum(-1)


def _strain(part, nodes, moved):
    return (part.elongation + _change(part, nodes, moved)) / part.rest


def _end_forces(part, nodes, moved, line):
    """Internal forces [n, n_end, 3], axial forces [n], stiffness EA [n], forces inside [n]."""
    links = part.group.links.array
    piece = np.diff(nodes[links], axis=1) + np.diff(moved[links], axis=1)
    length = np.sqrt((piece**2).sum(-1))
    unit = piece / np.where(length > 0, length, 1)[..., None]
    ends = np.zeros((*links.shape, 3), WIDE)
    if line is not None:
        tension, stiffness = np.zeros(len(links), WIDE), np.zeros(len(links), WIDE)
        for k in range(len(links)):
            pull, tension[k], spring = hang(piece[k, 0], line[k], part.rest[k], part.law.EA[k])
            ends[k, 0], ends[k, 1] = -pull, pull
            stiffness[k] = spring * part.chord[k]
        return ends, tension, stiffness, np.zeros(len(links), WIDE)
    strain = _strain(part, nodes, moved)
    tension, stiffness, inner = part.law.force(strain)
    pull = tension[:, None, None] * unit
    ends[:, :-1] -= pull
    ends[:, 1:] += pull
    return ends, tension, stiffness, inner


def _remember(parts, nodes, path):
    """Plastic strains after the increments of a phase."""
    for part in parts:
        if part.law.memory is not None:
            for moved in _wide(path.displacement):
                part.law.commit_memory(_strain(part, nodes, moved))
