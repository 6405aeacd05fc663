"""The potential of bars, cables, contacts, ground contacts and springs under nodal loads, in NumPy.

It shares no code with the package: it reads what the caller stated, works out unstressed lengths,
and knows the forces by positions alone.
"""

import numpy as np

import jaxcable as jc

_SIGNS = {jc.Bars: (-np.inf, np.inf), jc.Cables: (0.0, np.inf), jc.Contacts: (-np.inf, 0.0)}


class ContactPotential:
    """Stored energy less the work of the loads, J, of a structure after its phases.

    Phases state pretensions and nodal loads only.

    Attributes:
        nodes: initial positions, [n_node, 3], m.
        free: which displacements are not supported, [n_node, 3] bool.
        load: loads on nodes, [n_node, 3], N.
        links, stiffness, rest, low, high: of bars, cables and contacts: nodes [n, 2], EA, N,
            unstressed length, m, and bounds of the force, N, [n] each.
        grounds: node, direction, stiffness, gap, and whether it only presses, of each ground
            contact and of each axis of a spring.
    """

    def __init__(self, structure, phases):
        self.nodes = np.asarray(structure.nodes, float)
        self.free = ~np.asarray(structure.supports.fixed(len(self.nodes)))[:, :3]
        self.load, self.grounds, rows = np.zeros(self.nodes.shape), [], []
        stated = {}
        for phase in phases:
            stated |= {} if phase.pretension is None else phase.pretension
            if phase.loads is not None:
                np.add.at(self.load, phase.loads.nodes.array, np.asarray(phase.loads.forces))
        for name, group in structure.elements.items():
            links = np.asarray(group.links.array)
            if isinstance(group, jc.GroundContacts):
                self.grounds += [
                    (i, n / np.linalg.norm(n), k, gap, True)
                    for (i,), n, k, gap in zip(
                        links, group.normal, group.stiffness, group.gap, strict=True
                    )
                ]
            elif isinstance(group, jc.Springs):
                self.grounds += [
                    (i, axis, k, 0.0, False)
                    for (i,), each in zip(links, group.stiffness, strict=True)
                    for axis, k in zip(np.eye(3), each, strict=True)
                ]
            else:
                rows.append(self._rows(group, links, stated.get(name)))
        self.links, self.stiffness, self.rest, self.low, self.high = (
            np.concatenate(columns) for columns in zip(*rows, strict=True)
        )

    def _rows(self, group, links, pretension):
        """Return links, EA, unstressed length and bounds of the force of a group, [n] each."""
        n, chord = len(links), np.linalg.norm(np.diff(self.nodes[links], axis=1)[:, 0], axis=1)
        stiffness = np.broadcast_to(group.axial_stiffness, n)
        rest = chord if group.rest_length is None else np.broadcast_to(group.rest_length, n)
        if isinstance(group, jc.Contacts) and group.gap is not None:
            rest = chord - group.gap
        if pretension is not None:
            rest = chord / (1 + np.asarray(pretension) / stiffness)
        return links, stiffness, rest, *(np.full(n, end) for end in _SIGNS[type(group)])

    def forces(self, displacement):
        """Return vectors from end to end, [n, 3], m, and axial forces of bars and such, [n], N."""
        place = self.nodes + displacement
        vector = place[self.links[:, 1]] - place[self.links[:, 0]]
        force = self.stiffness * (np.linalg.norm(vector, axis=1) - self.rest) / self.rest
        return vector, np.clip(force, self.low, self.high)

    def energy(self, displacement):
        """Return the potential at a displacement, [n_node, 3], m, in J."""
        _, force = self.forces(displacement)
        total = 0.5 * np.sum(force**2 * self.rest / self.stiffness)
        for node, way, stiffness, gap, presses in self.grounds:
            opening = way @ displacement[node] + gap
            total += 0.5 * stiffness * (min(opening, 0.0) if presses else opening) ** 2
        return total - np.sum(self.load * displacement)

    def gradient(self, displacement):
        """Return the unbalanced force on every free displacement, and the largest force, N."""
        vector, force = self.forces(displacement)
        pull = force[:, None] * vector / np.linalg.norm(vector, axis=1)[:, None]
        left, sizes = -self.load, [np.abs(self.load).max(), np.abs(force).max()]
        np.add.at(left, self.links, np.stack([-pull, pull], axis=1))
        for node, way, stiffness, gap, presses in self.grounds:
            opening = way @ displacement[node] + gap
            force = stiffness * (min(opening, 0.0) if presses else opening)
            left[node] += force * way
            sizes.append(abs(force))
        return left[self.free], max(sizes)

    def hessian(self, displacement):
        """Return the derivative of `gradient`, [n_free, n_free], N/m."""
        vector, force = self.forces(displacement)
        length, (n, _) = np.linalg.norm(vector, axis=1), self.nodes.shape
        along = vector / length[:, None]
        square = along[:, :, None] * along[:, None, :]
        acts = force != 0
        density = (force / length)[:, None, None]
        slope = np.where(acts, self.stiffness / self.rest, 0.0)[:, None, None]
        block, whole = slope * square + density * (np.eye(3) - square), np.zeros((n, 3, n, 3))
        for (i, j), own in zip(self.links, block, strict=True):
            for row, column, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
                whole[row, :, column] += sign * own
        for node, way, stiffness, gap, presses in self.grounds:
            if not presses or way @ displacement[node] + gap < 0:
                whole[node, :, node] += stiffness * np.outer(way, way)
        return whole.reshape(3 * n, 3 * n)[np.ix_(self.free.ravel(), self.free.ravel())]
