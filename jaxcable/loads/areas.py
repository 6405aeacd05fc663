"""Dead loads on the faces of a net: snow per plan area, cladding per surface."""

import itertools

import jax.numpy as jnp
import numpy as np

from .. import _check
from .._tree import copy, pytree
from . import faces as _faces
from .along import check_geometry, padded, room

PER = ("projected", "initial")


@pytree(static=("per", "geometry"), indices=("faces",))
class AreaLoads:
    """Dead loads per area, on tributary areas: a third of each triangle to each of its corners.

    Areas are those before the load acts, so that it is dead; they have derivatives.

    Args:
        faces: node numbers, [n_face, 3] or [n_face, 4], in turn round each face; quadrilaterals
            are the mean of both ways to split them, a triangle among them repeats a node.
            `net_faces` finds those of a net.
        forces: force per area, [3] or [n_face, 3], N/m2: snow is ``(0, 0, -s)``.
        per: which area: "projected", as seen along the force (plan area, for snow), or "initial",
            the surface itself. A zero force has no direction to look along: see `LineLoads`.
        factor: of the forces.
        geometry: whose areas, "input", those of the structure's nodes, or "begun", those where the
            phase that adds the load begins: the form after prestress.

    Raises:
        ValueError: wrong shapes, a face of less than three nodes, an unknown `per` or `geometry`;
            where a phase is analysed, a node that the structure does not have.

    Example:
        Snow of 1 kN/m2 under wind that lifts with 0.4 kN/m2, on a net that spans 1.12 m2:

        >>> structure, _ = jc.scenes.flat_net()
        >>> faces = jc.net_faces(structure.nodes, structure.elements.links)
        >>> snow, wind = jc.AreaLoads(faces, (0.0, 0.0, -1000.0)), jc.FacePressure(faces, 400.0)
        >>> solution = jc.solve(structure, jc.Phase(pretension=200.0, loads=[snow, wind]))
        >>> print(f"{jc.describe(solution.status)}: {solution.load[:, 2].sum():.3f} N")
        converged: -672.000 N
    """

    faces: object
    forces: object
    per: str = "projected"
    factor: object = 1.0
    geometry: str = "input"
    begun: object = None  # nodes where the phase began, [n_row, 3], m, put in by the analysis

    def __post_init__(self):
        object.__setattr__(self, "faces", _faces.checked(self.faces))
        forces = _check.floats(self.forces, "forces")
        if forces.shape not in ((3,), (len(self.faces), 3)):
            raise ValueError(
                f"forces: expected shape (3,) or ({len(self.faces)}, 3), got {forces.shape}"
            )
        object.__setattr__(self, "forces", forces)
        object.__setattr__(self, "factor", _check.floats(self.factor, "factor"))
        if self.per not in PER:
            raise ValueError(f"per = {self.per!r}: expected one of {', '.join(PER)}")
        check_geometry(self.geometry, self.per)

    def check(self, structure):
        """Raise ValueError if a node is unknown to the structure."""
        _faces.known(self.faces, structure)

    def among(self, structure):
        """The load with room for the nodes where its phase begins, if it asks for them."""
        return copy(self, begun=room(self.geometry, structure))

    def scaled(self, factor):
        """The load times `factor`."""
        return copy(self, factor=factor * self.factor)

    def element_forces(self, groups, states, nodes, shape, dtype):
        """Force on every node, as `shape`, N."""
        corners = (nodes if self.begun is None else self.begun)[self.faces]
        per_area = jnp.broadcast_to(self.forces.astype(dtype), (len(corners), 3))
        total = jnp.zeros((shape[0], 3), dtype)
        for numbers, vector in _faces.area_vectors(corners):
            if self.per == "projected":
                square = jnp.sum(per_area**2, axis=-1)
                some = jnp.where(square > 0, square, 1.0)
                area = jnp.abs(jnp.sum(vector * per_area, axis=-1)) / jnp.sqrt(some)
            else:
                square = jnp.sum(vector**2, axis=-1)
                some = jnp.where(square > 0, square, 1.0)
                area = jnp.where(square > 0, jnp.sqrt(some), 0.0)
            force = (area / 3)[:, None] * per_area
            for k in numbers:
                total = total.at[self.faces[:, k]].add(force)
        return padded(self.factor.astype(dtype) * total, shape)

    def per_length(self, number, group, state, nodes):
        """It acts on nodes and shapes no element."""
        return None


def net_faces(nodes, links, largest=4):
    """Faces of a net as seen in plan: its meshes, and those between its border and its links.

    The meshes of the planar graph that the links and the convex hull of the nodes draw in the x-y
    plane, in anticlockwise order: normals point up. Meshes of more than four corners are split into
    triangles from their first node.

    Args:
        nodes: [n_node, 3], m.
        links: of a two-way net whose links do not cross in plan, [n_elem, 2].
        largest: corners up to which a mesh is one face, 3 or 4.

    Returns:
        [n_face, 4] node numbers, triangles with their last node repeated; for `AreaLoads` and
        `FacePressure`.

    Raises:
        ValueError: two nodes at one place in plan, or a node without link.

    Example:
        Three by three cells without corner nodes: five quadrilaterals and four triangles.

        >>> structure, _ = jc.scenes.flat_net()
        >>> faces = jc.net_faces(structure.nodes, structure.elements.links)
        >>> faces.shape, int((faces[:, 2] == faces[:, 3]).sum())
        ((9, 4), 4)
    """
    plan = np.asarray(nodes, float)[:, :2]
    edges = {tuple(sorted(link)) for link in np.asarray(links).tolist()}
    edges |= _border(plan)
    spokes = [[] for _ in plan]
    for i, j in edges:
        spokes[i].append(j)
        spokes[j].append(i)
    following = {}
    for i, others in enumerate(spokes):
        if not others:
            raise ValueError(f"nodes[{i}]: no link touches it")
        way = plan[others] - plan[i]
        if (way == 0).all(axis=1).any():
            raise ValueError(f"nodes[{i}]: a linked node has the same place in plan")
        turn = np.argsort(np.arctan2(way[:, 1], way[:, 0]))
        round_ = [others[k] for k in turn]
        for before, after in zip(round_, [*round_[1:], round_[0]], strict=True):
            following[after, i] = before  # arriving from `after`, go on to the next to the right
    faces, left = [], set(following)
    while left:
        edge = min(left)
        face = []
        while edge in left:
            left.remove(edge)
            face.append(edge[0])
            edge = edge[1], following[edge]
        x, y = plan[face].T
        if x @ np.roll(y, -1) - y @ np.roll(x, -1) <= 0:
            continue  # the outside
        if len(face) <= largest:
            faces.append([*face, face[-1]][:4])
        else:
            faces += [[face[0], b, c, c] for b, c in itertools.pairwise(face[1:])]
    return np.array(faces)


def _border(plan):
    """Edges between neighbours on the convex hull, nodes on its straight sides included."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(plan)
    size = np.ptp(plan, axis=0).max()
    edges = set()
    for (i, j), equation in zip(hull.simplices, hull.equations, strict=True):
        side = np.flatnonzero(np.abs(plan @ equation[:2] + equation[2]) <= 1e-9 * size)
        way = plan[j] - plan[i]
        along = (plan[side] - plan[i]) @ way / (way @ way)
        side = side[(along >= -1e-9) & (along <= 1 + 1e-9)]
        ordered = side[np.argsort((plan[side] - plan[i]) @ way)]
        edges |= {tuple(sorted(pair)) for pair in itertools.pairwise(ordered)}
    return {(int(i), int(j)) for i, j in edges}
