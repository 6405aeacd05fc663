"""Pictures for a report: the structure, and what governs over load cases."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from ..analysis.solution import Solution
from ..common import status
from ..common.tree import copy_with
from ..common.types import ArrayLike, Float
from ..common.units import UnitsLike
from ..design import envelope, utilization
from ..elements.abilities import Bending
from ..model.structure import Structure
from ..results.reference_phase import reference_phase, reference_words
from .element_curves import SolutionCurves
from .envelopes import KINDS, envelope_diagram, largest_magnitude
from .model_pictures import model
from .nets import net
from .snapshots import Snapshots
from .tensions_along import cables_with_largest_drop, tension_along
from .views import choose_view

_PLACES = 41  # along beams: the largest value between two of them is off by 1e-3 at most
_WORTH = 1e-3  # of the largest section force of a kind: less is not drawn


def for_report(
    structure: Structure,
    solution: Solution,
    *,
    cases: Solution | None = None,
    names: Sequence[str] | None = None,
    phase_names: Sequence[str] | None = None,
    ground: Float[ArrayLike, "n 3"] | None = None,
    since: int | str | None = None,
    units: UnitsLike | None = None,
) -> dict[str, Figure]:
    """Draw the pictures of a report: the structure, its forces, and what governs over cases.

    Each group of cables with friction has a diagram of `tension_along` the cable with the largest
    drop of tension. With cases there are their displacements, the structure in the case with the
    largest utilization, and envelopes of the section forces of beams, as far as there are such.

    Args:
        structure: `Structure` that was analysed.
        solution: its `Solution`, as for `report`.

    Options:
        cases: `Solution` with a leading axis [n_case], as for `report`.
        names: names of the cases, such as ``combinations.names``; without cases those of the
            phases, as for `report`.
        phase_names: names of the phases beside cases, such as the ``phase_names`` of a scene.
        ground: points of the ground along a line, as of `net`. Heights of a line, a plane structure
            without beams that is low, are magnified by one round factor in all pictures.
        since: phase from whose beginning the displacements of cases count, by its number from 0 or
            its name, as for `report`; "last phase" for the end of `solution`, at which cases begin.
            Default: from the initial geometry.
        units: units of the pictures, as of `net`.

    Returns:
        Matplotlib figures by their captions, for ``report(...).save(path, pictures=...)``; none
        of an analysis that has failed.

    Raises:
        ValueError: those of `net`, another number of names than of phases among them, and of
            `design.envelope`; a phase `since` that there is not.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> structure, phases = jc.scenes.flat_net()
    >>> pictures = jc.plots.for_report(structure, jc.solve(structure, phases))
    >>> list(pictures)
    ['Structure: groups, nodes and elements', 'Forces at the end of the first and the last phase']
    """
    if int(solution.status) != status.OK:
        return {}
    profile = np.zeros((0, 3)) if ground is None else np.asarray(ground, float).reshape(-1, 3)
    heights = _factor_on_heights(structure, solution, profile)
    look: Any = {"units": units, "heights": heights}
    stages = names if cases is None and phase_names is None else phase_names
    ends = "the first and the last phase" if len(solution.phases) > 1 else "the phase"
    found = {
        "Structure: groups, nodes and elements": model(structure, **look),
        f"Forces at the end of {ends}": net(
            solution, structure=structure, ground=ground, names=stages, **look
        ),
    }
    for cable, caption, phases in cables_with_largest_drop(solution):
        found[caption] = tension_along(solution, **cable, phases=phases, names=stages, units=units)
    if cases is None or not (np.asarray(cases.status) == status.OK).any():
        return found
    extremes = envelope(structure, cases, names, places=_PLACES)
    begin, words = _reference_state(structure, solution, cases, phase_names, since)
    found[f"Displacements in all cases{words}"] = envelope_diagram(
        structure, extremes, "displacement", solutions=cases, since=begin, **look
    )
    forces = envelope_diagram(structure, extremes, "tension", **look)
    found["Axial forces: largest and smallest over all cases"] = forces
    governing = _case_of_largest_utilization(structure, cases)
    if governing is not None:
        case = jax.tree.map(lambda x: np.asarray(x)[governing], cases)
        name = extremes.names[governing]
        look |= {"loads": False, "names": [name] if len(case.phases) == 1 else None}
        used = net(case, color="utilization", structure=structure, **look)
        found[f"Force over breaking force in {name}, where it is largest"] = used
    for kind in KINDS:
        worth = _WORTH * largest_magnitude(extremes, kind)
        for name in kind:
            if name != "N" and largest_magnitude(extremes, [name]) > worth:
                found[f"Envelope of {name} over all cases"] = envelope_diagram(
                    structure, extremes, name, units=units
                )
    return found


def _reference_state(structure, solution, cases, names, since):
    """Return the state from which displacements of cases count, and from where in words.

    It is the `Solution`, a `State`, or None for the initial geometry. `names` are those of the
    phases, or None.
    """
    if since is None:
        return None, ""
    heads = [f"phase {k}" for k in range(1, len(solution.phases) + 1)]
    labels = heads if names is None else list(names)
    begin = reference_phase(since, labels, solution, cases)
    if names is not None:
        heads = [f"{head}, {name}" for head, name in zip(heads, labels, strict=True)]
    words = f", since {reference_words(begin, heads)}"
    if begin == len(heads):
        return solution, words
    if begin == 0:
        return None, words
    state = SolutionCurves(solution, structure).state_after_phase(begin - 1)
    moved = np.asarray(solution.phases.moved_before)[begin]  # nodes put into place included
    return copy_with(state, displacement=moved), words


def _factor_on_heights(structure, solution, profile):
    """Return the factor on heights in all pictures of a report; 1 of a structure with beams.

    It is the round factor at which the final shape, with the sags of cables, and the ground are not
    very low. `profile` are points of the ground, [n, 3], m.
    """
    if any(isinstance(group, Bending) for group in structure.groups):
        return 1.0
    shape = Snapshots(solution, structure).at_state(solution.last).points()
    return choose_view(np.concatenate([shape, profile]), heights=None).heights


def _case_of_largest_utilization(structure, cases):
    """Return the index of the converged case with the largest utilization; None without any."""
    try:
        used = jax.tree.leaves(utilization(structure, cases))
    except ValueError:  # no group has a strength
        return None
    most = np.max([np.asarray(x).max(axis=1, initial=0.0) for x in used], axis=0)
    most = np.where(np.asarray(cases.status) == status.OK, most, -np.inf)
    return int(np.nanargmax(most)) if np.nanmax(most) > 0 else None
