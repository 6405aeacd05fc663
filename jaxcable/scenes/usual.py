"""Usual scenes in many sizes, for which programs are compiled in advance (`jaxcable warm`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ..analysis.phases import Phase
from ..common.tree import replace
from ..elements import Bars, Beams, Cables
from ..loads import LineLoads, NodalLoads, SelfWeight
from ..materials import Elastic
from ..model.structure import Structure
from ..model.supports import clamped, pinned
from ..sections import Section
from .building_blocks import Scene, chain_links, points_on_circle
from .nets import saddle

SIZES = {"small": 48, "medium": 120, "large": 300}
"""Largest number of elements of the scenes of each size."""

_LEGS = Section(
    y=[0.25, 0.25, -0.25, -0.25],
    z=[0.25, -0.25, 0.25, -0.25],
    area=[5.57e-4] * 4,
    laws=[Elastic(210e9)],
)
_DOWN = np.array([0.0, 0.0, -1.0])


def usual_nets(most: int) -> Iterator[Scene]:
    """Yield orthogonal nets of up to `most` cables: with nodal loads, then with weight as well."""
    for n_x in range(1, 13):
        for n_y in range(n_x, 4 * n_x + 1):
            if 2 * n_x * n_y + n_x + n_y > most:
                break
            net = saddle(n_x, n_y, load=100.0)
            yield net
            heavy = replace(net.structure.elements, weight=3.0)
            prestress, loading = net.phases
            yield Scene(
                replace(net.structure, elements=heavy),
                [replace(prestress, loads=SelfWeight()), loading],
            )


def usual_masts(most: int) -> Iterator[Scene]:
    """Yield guyed masts of up to `most` elements, under weight and wind."""
    for levels in (1, 2, 3, 4, 6):
        for per_level in range(1, 9):
            n = levels * per_level
            if n + 3 * levels > most or 6 * n > 150:
                continue
            mast = np.linspace([0.0, 0.0, 0.0], [0.0, 0.0, 6.0 * n], n + 1)
            anchors = points_on_circle(3.0 * n, 2 * np.pi / 3 * np.arange(3), 0.0)
            nodes = np.concatenate([mast, anchors])
            tops = [per_level * (k + 1) for k in range(levels)]
            guys = [[n + 1 + j, top] for top in tops for j in range(3)]
            elements = {
                "mast": Beams(
                    chain_links(range(n + 1)), _LEGS, torsional_stiffness=1e6, weight=300.0
                ),
                "guys": Cables(guys, axial_stiffness=9.8e6, weight=4.9),
            }
            supports = clamped([0]) + pinned(range(n + 1, n + 4))
            structure = Structure(nodes, elements, supports=supports)
            prestress = Phase(pretension={"mast": None, "guys": 10e3}, loads=SelfWeight())
            on_mast = LineLoads((500.0, 0.0, 0.0), on="mast")
            top = NodalLoads([n], (1500.0, 0.0, 0.0))
            yield Scene(structure, [prestress, Phase(loads=[on_mast, top], increments=5)])


def usual_domes(most: int) -> Iterator[Scene]:
    """Yield cable domes of up to `most` elements, with struts and one hoop, under snow."""
    for n in range(3, 33):
        if 6 * n + 1 > most:
            break
        hub = np.array([[0.0, 0.0, 2.5], [0.0, 0.0, -0.5]])
        angles = 2 * np.pi / n * np.arange(n)
        rings = [points_on_circle(r, angles, z) for r, z in ((6, 1.5), (6, -1.5), (12, 0.0))]
        nodes = np.concatenate([hub, *rings])
        tops, feet, anchors = (2 + n * k + np.arange(n) for k in range(3))
        links = {
            "inner ridges": [(0, k) for k in tops],
            "outer ridges": list(zip(tops, anchors, strict=True)),
            "inner diagonals": [(1, k) for k in tops],
            "outer diagonals": list(zip(feet, anchors, strict=True)),
            "hoop": list(zip(feet, np.roll(feet, -1), strict=True)),
        }
        struts = [(0, 1), *zip(tops, feet, strict=True)]
        cables = {name: Cables(own, axial_stiffness=32e6) for name, own in links.items()}
        elements = {**cables, "struts": Bars(struts, axial_stiffness=360e6)}
        structure = Structure(nodes, elements, supports=pinned(anchors))
        q = 5e3  # balanced: of the hoop at the feet of the struts, which outer diagonals pull
        density = {
            **dict.fromkeys(links, 3 * q),
            **{"inner ridges": 2 * q, "inner diagonals": q},
            "hoop": 3 * q / (4 * np.sin(np.pi / n) ** 2),
            "struts": np.array([-2.0 / 3.0 * n, *[-1.5] * n]) * q,
        }
        snow = Phase(loads=NodalLoads([0, *tops], 1e3 * _DOWN), increments=5)
        yield Scene(structure, [Phase(force_density=density), snow])


def usual_frames(most: int) -> Iterator[Scene]:
    """Yield plane portal frames of up to `most` beams, under weight and loads of nodes."""
    section = Section.rectangle(0.3, 0.3, Elastic(30e9))
    for n in range(2, 9):
        if 3 * n > most:
            break
        left = np.linspace([0.0, 0.0, 0.0], [0.0, 0.0, 4.0], n + 1)
        beam = np.linspace([0.0, 0.0, 4.0], [8.0, 0.0, 4.0], n + 1)[1:]
        right = np.linspace([8.0, 0.0, 4.0], [8.0, 0.0, 0.0], n + 1)[1:]
        links, up = chain_links(range(3 * n + 1)), (0.0, 1.0, 0.0)
        beams = Beams(links, section, up=up, weight=2250.0)
        structure = Structure(
            np.concatenate([left, beam, right]), beams, supports=clamped([0, 3 * n])
        )
        wind = NodalLoads([n], (5e3, 0.0, 0.0))
        yield Scene(structure, [Phase(loads=SelfWeight()), Phase(loads=wind, increments=5)])
        yield Scene(structure, [Phase(loads=[SelfWeight(), wind])])


KINDS: dict[str, Callable[[int], Iterator[Scene]]] = {
    "nets": usual_nets,
    "domes": usual_domes,
    "masts": usual_masts,
    "frames": usual_frames,
}
"""What the scenes of a kind are: functions of the largest number of elements."""
