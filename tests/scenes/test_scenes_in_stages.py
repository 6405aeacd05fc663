"""Scenes that are erected in stages, against statics written apart."""

import numpy as np
import pytest
import scipy.optimize
from banks import problems
from oracles.convergence import converged

import jaxcable as jc

TIGHT = jc.Newton(tol=1e-13)


def solved(scene):
    solution = converged(jc.solve(*scene, TIGHT))
    assert all(bool(phase.stable) for phase in solution.phases)
    problems.assert_balanced(solution)
    return solution


def assert_at_once_it_is_the_same(scene, built):
    assert len(scene.phases) == 2
    apart = np.asarray(solved(scene).positions) - np.asarray(built.positions)
    assert np.abs(apart).max() < 1e-8


def pull(group, k, positions):
    """Force of an elastic element on its first end, [3], N; a cable does not push."""
    first, second = group.links.array[k]
    chord = positions[second] - positions[first]
    length, rest = np.linalg.norm(chord), group.rest_length[k]
    force = group.axial_stiffness[k] * (length - rest) / rest
    return (max(force, 0.0) if isinstance(group, jc.Cables) else force) * chord / length


@pytest.mark.slow
class TestSuspensionFootbridge:
    n = 4
    a, sag, span, dead = 15.0, 6.0, 60.0, 4e3

    @pytest.fixture(scope="class")
    @classmethod
    def built(cls):
        scene = jc.scenes.suspension_footbridge(cls.n)
        return *scene, solved(scene)

    def test_the_cables_are_in_equilibrium_at_every_stage(self, built):
        """Forces of cables, hangers and weights at every node, by NumPy, with the lengths alone."""
        structure, phases, solution = built
        cables, hangers = (structure.elements[name] for name in ("cables", "hangers"))
        hung = np.zeros(structure.n_node)
        for k, phase in enumerate(solution.phases[: self.n // 2 + 1]):
            positions = np.asarray(phase.positions)
            there = np.asarray(phase.present["hangers"]) > 0
            assert there.sum() == (min(2 * k + 1, self.n - 1) if k else 0)
            if k:
                load = phases[k].loads
                np.add.at(hung, load.nodes.array, np.asarray(load.forces)[:, 2])
            out = np.outer(hung, [0.0, 0.0, 1.0])
            present = [(cables, j) for j in range(len(cables.links))]
            for group, j in [*present, *((hangers, j) for j in np.flatnonzero(there))]:
                force = pull(group, j, positions)
                ends = group.links.array[j]
                out[ends] += [force, -force]
                out[ends, 2] -= 0.5 * group.weight[j] * group.rest_length[j]
            free = [*range(6, 5 + self.n), *(hangers.links.array[there, 1])]
            assert np.abs(out[free]).max() < 1e-5  # N, of 4e5: forces are EA times 1e-13 or so

    def test_the_girder_is_level_and_bears_nothing_of_the_dead_load(self, built):
        _, _, solution = built
        closed = solution.phases[-2]
        deck = np.asarray(closed.positions)[5 + self.n :]
        assert np.abs(deck[:, 2]).max() < 1e-8
        assert np.abs(np.asarray(closed.section_forces["girder"])).max() < 1e-2  # N, N m
        # nearly the parabola: cables and hangers weigh 2 % of the deck
        thrust = np.asarray(closed.tension["cables"])[self.n // 2]
        assert thrust == pytest.approx(self.dead * self.span**2 / (8 * self.sag), rel=0.03)
        hangers = np.asarray(closed.tension["hangers"])
        np.testing.assert_allclose(hangers, self.dead * self.a, rtol=1e-3)
        # the planks bend it, between what hangers take and all of it
        moment = np.asarray(solution.section_forces["girder"])[..., 4]
        most = 1e3 * self.span**2 / 8
        assert 0.01 * most < np.abs(moment).max() < 0.5 * most

    def test_at_once_it_is_the_same(self, built):
        once = jc.scenes.suspension_footbridge(self.n, stages=False)
        assert_at_once_it_is_the_same(once, built[2])


class TestRoofRing:
    n, lifts, load = 6, 2, 200.0  # N/m2: more slackens the spokes that hold the lower ring

    @pytest.fixture(scope="class")
    @classmethod
    def built(cls):
        scene = jc.scenes.roof_ring(cls.n, lifts=cls.lifts, load=cls.load)
        return *scene, solved(scene)

    def test_the_hub_is_where_three_equations_put_it(self, built):
        """By symmetry: radius and height of the hub, and radius of the upper ring."""
        structure, _, solution = built
        groups = structure.elements
        fan = 2 * np.sin(np.pi / self.n)
        rest = {k: float(groups[k].rest_length[0]) for k in ("hub", "rings")}
        stiff = {k: float(groups[k].axial_stiffness[0]) for k in ("hub", "rings", "upper")}
        for k, phase in enumerate(solution.phases[: self.lifts + 1]):
            upper = float(phase.rest_length["upper"][0])
            weight = float(groups["hub"].weight[0]) * rest["hub"]
            weight += 0.5 * float(groups["upper"].weight[0]) * upper

            def out(x, upper=upper, weight=weight):
                radius, z, ring = x
                chord = np.array([ring - radius, 4.0 - z])
                length = np.hypot(*chord)
                force = stiff["upper"] * (length - upper) / upper * chord / length
                hoop = stiff["hub"] * (fan * radius - rest["hub"]) / rest["hub"]
                arch = stiff["rings"] * (fan * ring - rest["rings"]) / rest["rings"]
                return force[1] - weight, force[0] - fan * hoop, -force[0] - fan * arch

            begin = 20.0, -12.0 * (1 - k / self.lifts) + 1.0, 60.0
            x, _, code, _ = scipy.optimize.fsolve(out, begin, xtol=1e-14, full_output=True)
            assert code == 1 or np.abs(out(x)).max() < 1e-3  # N, of 1e5
            positions = np.asarray(phase.positions)
            hub, ring = positions[2 * self.n :], positions[: self.n]
            np.testing.assert_allclose(np.hypot(*hub[:, :2].T), x[0], atol=1e-8)
            np.testing.assert_allclose(hub[:, 2], x[1], atol=1e-7)
            np.testing.assert_allclose(np.hypot(*ring[:, :2].T), x[2], atol=1e-8)
            assert not np.asarray(phase.present["lower"]).any()

    def test_it_ends_as_drawn_with_the_force_that_is_asked_for(self, built):
        structure, phases, solution = built
        stressed = solution.phases[-2]
        assert np.abs(np.asarray(stressed.positions) - structure.nodes).max() < 1e-9
        np.testing.assert_allclose(stressed.tension["lower"], 1e6, rtol=1e-8)
        drop = np.asarray(solution.phases[0].positions)[2 * self.n :, 2]
        assert (np.abs(drop + 12.0) < 0.5).all()  # longer by a strand; the hub stretches less
        # half of the load between rings of 60 m and 20 m, on the nodes of the inner one
        roof = phases[-1].loads
        assert roof.nodes.array.tolist() == [*range(2 * self.n, 3 * self.n)]
        force = 0.5 * self.load * np.pi * (60.0**2 - 20.0**2) / self.n
        np.testing.assert_allclose(roof.forces, (0.0, 0.0, -force), rtol=1e-14)

    @pytest.mark.slow
    def test_at_once_it_is_the_same(self, built):
        scene = jc.scenes.roof_ring(self.n, stages=False, load=self.load)
        assert_at_once_it_is_the_same(scene, built[2])
