"""Two lines over pulleys with hanging segments, of four and of three nodes, and a mast.

The mast is the first element and the first straight piece; the second line has a filler. All is in
a vertical plane.
"""

import functools

import numpy as np
from oracles.convergence import converged
from oracles.hanging_cable import HangingCable

import jaxcable as jc

EA, WEIGHT = 3e7, 15.0  # N, N/m
NODES = [[0, 0, 0], [120, 0, 10], [260, 0, 4], [360, 0, 0], [-5, 0, 0], [200, 0, 6], [365, 0, 0]]
SEGMENTS = {(0, 0): (0, 1), (0, 1): (1, 2), (0, 2): (2, 3), (1, 0): (4, 5), (1, 1): (5, 6)}
"""First and last node of every segment, by the index of the line and of the segment in it."""
FILLER = (1, 2)


@functools.cache
def solved():
    """Return structure and solution of the lines under their weight; every node is held."""
    lines = jc.SlidingCatenaries(
        links=[[0, 1, 2, 3], [4, 5, 6]],
        axial_stiffness=EA,
        weight=WEIGHT,
        rest_length=[363.0, 374.0],
        friction=0.05,
    )
    elements = {"a mast": jc.Bars([[7, 1]], axial_stiffness=1e9), "lines": lines}
    structure = jc.Structure([*NODES, [120, 0, -20]], elements, jc.pinned(range(8)))
    weight = jc.SelfWeight(on="lines")
    return structure, converged(jc.solve(structure, jc.Phase(loads=weight)))


def integrated(solution):
    """Return the `HangingCable` of every segment by its indices, a dict; solved apart."""
    results = solution.element_results
    length, pull = (
        np.asarray(results[name]["lines"]) for name in ("segment_length", "segment_pull")
    )
    load = [0.0, 0.0, -WEIGHT]
    return {
        at: HangingCable(NODES[a], NODES[b], length[at], EA, load, 1.001 * pull[at][:3])
        for at, (a, b) in SEGMENTS.items()
    }
