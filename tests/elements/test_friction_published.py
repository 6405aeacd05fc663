"""Cables with friction against published figures: a tackle, and the draw-in of an anchor."""

import numpy as np
import pytest
from oracles.convergence import converged

import jaxcable as jc


@pytest.mark.slow
@pytest.mark.parametrize(("extra", "printed"), [(0, 0.309), (2, 0.367)])
def test_lead_line_of_a_tackle(extra, printed):
    """Four parts of line on plain bearings, factor 1.09 a sheave, and two more lead-in sheaves.

    Source: Wire Rope Technical Board, Wire Rope Users Manual, fourth edition, page 88: pull of the
    lead line over the load, while it is raised.
    """
    nodes = np.zeros((5, 3))
    nodes[:, 2] = 0.0, -5.0, -6.0, 1.0, -4.0  # upper and lower block, two more sheaves, the hand
    chain = [0, 1, 0, 1, 0, *[2, 3][:extra], 4]
    rope = jc.FrictionCables(links=[chain], axial_stiffness=1e7, axle_friction=0.09 / 2.09)
    held = jc.pinned([0, 2, 3, 4]) + jc.restrained([1], "xy")
    structure = jc.Structure(nodes, {"rope": rope}, held)
    load = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -6000.0)))
    raised = jc.Phase(loads=jc.SupportMovement([4], (0.0, 0.0, -0.4)))
    solution = converged(jc.solve(structure, [load, raised]))
    tension = np.asarray(solution.element_results["segment_tension"]["rope"][0])
    assert float(solution.phases[1].path.displacement[-1, 1, 2]) > 0.05
    assert round(tension[-1] / 6000.0, 3) == printed
    assert tension[:4].sum() == pytest.approx(6000.0, rel=1e-9)


@pytest.mark.slow
def test_draw_in_of_an_anchor():
    """Length of a tendon that the draw-in of its anchor affects: 13.25 m.

    The source takes the loss of force in the first meter, p, for that of every meter, and strains
    as small: ``x_A^2 = draw-in EA / p``. Exact is ``1 - exp(-a x) = a sqrt(draw-in EA / (P a))``
    with ``a = mu / R + K``, so that x is 3 % longer. A hundredth of force and of draw-in has the
    same x, and strains of 6e-5.

    Source: B. H. Ahmad, Prestressed Concrete Design (SAB 4323), Universiti Teknologi Malaysia,
    example 4.3: span 20 m, drape 558 mm, mu = 0.25, K = 0.0017 1/m, 1239 MPa, 2850 mm2, 195 GPa,
    5 mm.
    """
    n, each, radius = 61, 1 / 3, 20.0**2 / (8 * 0.558)
    at = each * np.arange(n) / radius  # the curvature is that of the source, the same everywhere
    nodes = np.stack([radius * np.sin(at), 0 * at, radius * (1 - np.cos(at))], axis=1)
    force, loss = 1239.0 * 2850 / 100, 0.25 / radius + 0.0017
    tendon = jc.FrictionCables(
        links=[range(n)], axial_stiffness=195e3 * 2850, friction=0.25, wobble=0.0017
    )
    strut = jc.Bars([[n - 1, n]], axial_stiffness=1e9)  # a node that moves
    supports = jc.pinned(range(n)) + jc.restrained([n], "xy")
    nodes = np.vstack([nodes, nodes[-1:] + np.array([0.0, 0.0, 1.0])])
    structure = jc.Structure(nodes, {"tendon": tendon, "strut": strut}, supports)
    jacked = jc.Phase(jacking={"tendon": force, "strut": None})
    drawn = jc.Phase(shortening={"tendon": -0.005 / 100, "strut": None})
    with jc.evaluation("numpy"):  # XLA compiles for longer than it runs
        solution = converged(jc.solve(structure, [jacked, drawn]))
    tension = np.asarray(solution.element_results["segment_tension"]["tendon"][0])
    # the first segment has the tension of its middle
    affected = np.log(force / tension[0]) / (2 * loss) + each / 2
    assert abs(each * tension.argmax() - affected) < each  # beyond it the tendon is as jacked
    same_in_every_meter = (1 - np.exp(-loss * affected)) / np.sqrt(loss * (1 - np.exp(-loss)))
    assert round(same_in_every_meter, 2) == 13.25
