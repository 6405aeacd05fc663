"""Structures that tests share, most with a solution that is known apart from the package.

`pieces`, `beam` and `in_line` are what most structures of tests consist of. Numbers, loads and
phases are a test's own; the shape of the arrays is that of the structure, so that a second test of
the same shape and phases finds the first one's programs. Nets of a publication are
`jc.scenes.flat_net`, `hypar_net` and `saddle_net`, with numbers in `tests/reference`; a mast is
`jc.scenes.guyed_mast`, and a bridge in stages `scenes.cable_stayed_bridge` of the experiments.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq

import jaxcable as jc
from jaxcable.common.tree import merge_indices, split_indices

DOWN = np.array([0.0, 0.0, -1.0])


def pieces(count, length=1.0, way=(1.0, 0.0, 0.0)):
    """Nodes [count + 1, 3] and links [count, 2] of equal pieces of a line that starts at zero."""
    nodes = np.outer(np.linspace(0, length, count + 1), way)
    return nodes, np.column_stack([np.arange(count), np.arange(1, count + 1)])


def beam(count, section, length=1.0, supports=None, **options):
    """A beam along x in `count` elements, clamped at its start unless told otherwise."""
    nodes, links = pieces(count, length)
    group = jc.Beams(links, section=section, **options)
    return jc.Structure(nodes, group, jc.clamped([0]) if supports is None else supports)


def in_line(elements, *places):
    """Elements on the x axis: nodes at `places`, m; the ends stay, all between move along x."""
    inner = jc.restrained(range(1, len(places) - 1), "yz")
    held = jc.pinned([0, len(places) - 1]) + inner
    return jc.Structure(np.outer(places, [1.0, 0.0, 0.0]), elements, held)


class Shape(NamedTuple):
    """A structure, its node that is loaded, and what is known.

    Attributes:
        structure: `jc.Structure`.
        node: the node at which `load` pulls.
        known: of a downward force P, in N, the drop of the node, in m, and the forces of the
            elements [n_elem], in N.
    """

    structure: jc.Structure
    node: int
    known: Callable

    def load(self, force, direction=DOWN):
        """A force on the node, in N; downward, where no other direction is given."""
        return jc.NodalLoads([self.node], force * np.asarray(direction))


def spokes(feet, height=0.0, stiffness=1e5, pretension=0.0, group=jc.Cables):
    """Straight elements from a ring of supports, of radius 1 m, to a node in the middle.

    By symmetry a downward force P moves it straight down, to where ``n N sin(angle) = P``.

    Args:
        feet: number of supports.
        height: of the node above the ring, m.
        stiffness: EA of each element, N.
        pretension: in the initial place, N, which sets the unstressed length.
        group: `jc.Cables` or `jc.Bars`.
    """
    angle = 2 * np.pi * np.arange(feet) / feet
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    nodes = np.vstack([[0.0, 0.0, height], ring])
    rest = np.hypot(1.0, height) / (1 + pretension / stiffness)
    links = [[0, k + 1] for k in range(feet)]
    elements = group(links, axial_stiffness=stiffness, rest_length=np.full(feet, rest))

    def force(drop):
        return stiffness * (np.hypot(1.0, drop - height) - rest) / rest

    def known(load):
        def missing(drop):
            return feet * force(drop) * (drop - height) / np.hypot(1.0, drop - height) - load

        drop = brentq(missing, min(0.0, 2 * height), height + 10.0, xtol=1e-15)
        return drop, np.full(feet, force(drop))

    return Shape(jc.Structure(nodes, elements, jc.pinned(range(1, feet + 1))), 0, known)


def cross(**numbers):
    """Four cables in a plane that meet in its middle: without stiffness, were there no tension."""
    return spokes(4, **numbers)


def tripod(height=1.0, **numbers):
    """Three bars on a ring that carry a node by compression; it snaps through under a large load.

    `known` is the solution before that.
    """
    shape = spokes(3, height=height, **({"group": jc.Bars} | numbers))
    rest = np.hypot(1.0, height)
    stiffness = float(np.max(shape.structure.elements.axial_stiffness))

    def known(load):
        def thrust(drop):
            return stiffness * (rest - np.hypot(1.0, height - drop)) / rest

        def missing(drop):
            return 3 * thrust(drop) * (height - drop) / np.hypot(1.0, height - drop) - load

        # the limit point lies above 2/5 of the height for every rise
        drop = brentq(missing, 0.0, 0.3 * height, xtol=1e-15)
        return drop, np.full(3, -thrust(drop))

    return shape._replace(known=known)


def chain(count=3, stiffness=1e5, weight=0.0, group=jc.Cables):
    """Elements of 1 m below each other, hung up at the top; the force pulls at the lower end."""
    nodes, links = pieces(count, count, DOWN)
    elements = group(links, axial_stiffness=stiffness, weight=weight)

    def known(load):
        # lumped weight: half of the own element, and all below it
        force = load + weight * (count - np.arange(count) - 0.5)
        return np.sum(force) / stiffness, force

    return Shape(jc.Structure(nodes, elements, jc.pinned([0])), count, known)


def cantilever(count=4, length=1.0, side=0.01, modulus=210e9):
    """A square beam, clamped at one end, for forces whose displacements are small.

    `known` gives the drop by bending of the tip, P L^3 / 3 E I, and axial forces, which are none.
    """
    section = jc.Section.rectangle(side, side, jc.Elastic(modulus))

    def known(load):
        return load * length**3 / (3 * modulus * side**4 / 12), np.zeros(count)

    return Shape(beam(count, section, length), count, known)


# a hub: cables from the corners of a sloping square, 3 m x 5 m, to its middle
SQUARE = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 3.0], [0, 4, 3.0], [1.5, 2, 1.5]])
SPOKES = np.array([[k, 4] for k in range(4)])


def hub(nodes=SQUARE, names=("front", "back"), **numbers):
    """The hub of two groups of two cables each, or of one, without `names`; EA = 100 kN."""
    given = {"axial_stiffness": 1e5} | numbers
    if names is None:
        elements = jc.Cables(SPOKES, **given)
    else:
        pairs = zip(names, (SPOKES[:2], SPOKES[2:]), strict=True)
        elements = {name: jc.Cables(links, **given) for name, links in pairs}
    return jc.Structure(nodes, elements, jc.pinned([0, 1, 2, 3]))


def at_rest(structure):
    """Groups, start states and nodes, as loads and elements are given them, without indices."""
    groups = merge_indices(*split_indices(structure.groups))
    nodes = jnp.asarray(structure.nodes)
    return groups, [group.start(nodes[group.links]) for group in groups], nodes


def load_at_rest(load, structure):
    """Forces of a dead load on the nodes of a structure that nothing has happened to."""
    load.check(structure)
    groups, states, nodes = at_rest(structure)
    load = merge_indices(*split_indices(load.with_group_indices(structure)))
    return load.element_forces(groups, states, nodes, nodes.shape, float)
