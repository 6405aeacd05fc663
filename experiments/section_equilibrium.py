"""How long does the iteration for the equilibrium of a section take, and how accurate is it?

Question   Errors, iterations and time of `Section.strains` against its tolerance, for 1000 random
           forces that the section can carry; whether 1000 that it cannot carry are recognized.
Reference  Forces of random strains, up to just before the end of the first fibre's curve, by a
           fibre sum in NumPy from the points of the curves; the strains are those it began with.
Error      Residual (the quantity that `tol` bounds, by NumPy): largest unbalanced force (moments
           over the radius of gyration) over the sum of absolute fibre forces plus the load, -.
           Force: NumPy sum at the strains found minus the target, over the capacity of all fibres,
           -. Strain: largest of e0 and the curvatures times the largest distance of a fibre, over
           the yield strain, where at least a tenth of the area is elastic, -. Each is the largest
           of 1000.
Command    python experiments/section_equilibrium.py
           (writes experiments/results/section_equilibrium.txt)

Times are wall seconds, median of 5 calls, each blocked on completion. "In turn" (one call with all
forces) iterates for one force after the other; a batch (vmap) iterates until its slowest force is
done. Compile: the first call minus the median warm one, with no compilation cache.
"""

import jax
import numpy as np
from benchmarks.measure import timed
from record import Record

import jaxcable as jc
from jaxcable import materials
from jaxcable.common import status
from jaxcable.sections import Section

TOLERANCES = [1e-4, 1e-6, 1e-8, 1e-10, 1e-12, None]
NUMBER = 1000


def make_sections():
    """Name -> section and the strain at which its steel yields."""
    steel = materials.steel(unloading="reversible")
    strand = materials.strand(unloading="reversible")
    concrete = jc.Polygonal(  # parabola of EN 1992-1-1, 3.1.7, by four points; hardly any tension
        [-3.5e-3, -2e-3, -1.5e-3, -1e-3, -5e-4, 0.0, 5e-6, 5e-2],
        [-30e6, -30e6, -28.125e6, -22.5e6, -13.125e6, 0.0, 0.13125e6, 0.15e6],
    )
    tube = Section.composite(
        [Section.disc(0.28, concrete), Section.ring(0.3, 0.01, steel, (2, 32))]
    )
    return {
        "steel rectangle, bilinear": (
            Section.rectangle(0.1, 0.2, steel, (10, 20)),
            235e6 / 210e9,
        ),
        "concrete-filled tube": (tube, 235e6 / 210e9),
        "strand, tension only": (Section.disc(0.05, strand), 0.9 * 1860e6 / 195e9),
    }


class Fibres:
    """The section again, in NumPy."""

    def __init__(self, section, yield_strain):
        self.y, self.z, self.area = (np.asarray(v) for v in (section.y, section.z, section.area))
        self.curves = [(np.asarray(law.strain), np.asarray(law.stress)) for law in section.laws]
        self.ends = np.cumsum(section.counts)[:-1]
        self.one_sided = all(strain[0] == 0 for strain, _ in self.curves)
        self.yield_strain = yield_strain
        self.lever = np.stack([np.ones_like(self.y), self.z, -self.y], axis=1)
        self.radius = np.sqrt((self.area @ self.lever**2) / self.area.sum())
        largest = [np.abs(stress).max() for _, stress in self.curves]
        force = np.repeat(largest, section.counts) * self.area
        self.capacity = force @ np.abs(self.lever)
        self.reach = np.array([1.0, *[max(np.abs(self.y).max(), np.abs(self.z).max())] * 2])

    def pulls(self, strains):
        """Forces of the fibres, [n, n_fibre]; none without a point of the curve."""
        parts = np.split(strains @ self.lever.T, self.ends, axis=1)
        stress = [
            np.where((e >= curve[0][0]) & (e <= curve[0][-1]), np.interp(e, *curve), 0.0)
            for curve, e in zip(self.curves, parts, strict=True)
        ]
        return np.concatenate(stress, axis=1) * self.area

    def random_strains(self, rng):
        """Up to just before the end of the first fibre, most of them small."""
        way = rng.normal(size=(NUMBER, 3))
        way = way / np.linalg.norm(way, axis=1, keepdims=True) / self.reach
        if self.one_sided:  # so that some fibre is taut
            way[:, 0] = np.abs(way[:, 0])
        limit = np.inf
        for (strain, _), rate in zip(
            self.curves, np.split(way @ self.lever.T, self.ends, axis=1), strict=True
        ):
            low = strain[0] if strain[0] < 0 else -np.inf
            end = np.where(rate > 0, strain[-1], low)
            limit = np.minimum(limit, (end / rate).min(1))
        return way * (0.999 * limit * 10 ** rng.uniform(-2.5, 0, NUMBER))[:, None]

    def elastic(self, strains):
        """Part of the area whose strain is below yield and, without compression, above zero."""
        e = strains @ self.lever.T
        return ((np.abs(e) < self.yield_strain) & ~(self.one_sided & (e <= 0))) @ (
            self.area / self.area.sum()
        )

    def errors(self, found, strains, target):
        """Largest residual, force error and strain error; strains that were found, [n, 3]."""
        pulls = self.pulls(found)
        over = pulls @ self.lever - target
        scale = np.abs(pulls).sum(1) + np.abs(target / self.radius).max(1)
        firm = self.elastic(strains) >= 0.1
        return (
            (np.abs(over / self.radius).max(1) / scale).max(),
            np.abs(over / self.capacity).max(),
            np.abs((found - strains) * self.reach)[firm].max() / self.yield_strain,
        )


def main():
    @jax.jit
    def in_turn(section, target, tol):
        return section.strains(*target.T, tol=tol)

    @jax.jit
    def batch(section, target, tol):
        return jax.vmap(lambda force: section.strains(*force, tol=tol))(target)

    say = Record("section_equilibrium")
    for name, (section, yield_strain) in make_sections().items():
        fibres = Fibres(section, yield_strain)
        strains = fibres.random_strains(np.random.default_rng(5))
        target = fibres.pulls(strains) @ fibres.lever
        firm = np.count_nonzero(fibres.elastic(strains) >= 0.1)
        say(f"\n{name}: {section.n_fibre} fibres, strains compared for {firm} of {NUMBER} forces")
        say(
            f"{'':8}{'largest error':^30}{'iterations':>16}{'not':>6}"
            f"{'ms for 1000 = us for one':>28}"
        )
        say(
            f"{'tol':>8}{'residual':>10}{'force':>10}{'strain':>10}{'mean':>10}{'max':>6}{'OK':>6}"
            f"{'one batch':>16}{'in turn':>12}"
        )
        compiling = []
        for tol in TOLERANCES:
            state, *times = timed(batch, section, target, tol)
            again, *times_turn = timed(in_turn, section, target, tol)
            seconds, seconds_turn = (np.median(own[1]) for own in (times, times_turn))
            if tol in (TOLERANCES[0], None):  # others are other arguments of the same program
                compiling.append((times[0] - seconds, times_turn[0] - seconds_turn))
            good = np.asarray(state.status) == status.OK
            assert (good == (np.asarray(again.status) == status.OK)).all()
            found = np.stack(state.strain, axis=1)
            errors = fibres.errors(found[good], strains[good], target[good])
            steps = np.asarray(state.steps)
            say(
                f"{'default' if tol is None else format(tol, '.0e'):>8}"
                + "".join(f"{error:10.1e}" for error in errors)
                + f"{steps.mean():10.2f}{steps.max():6d}{NUMBER - good.sum():6d}"
                f"{1e3 * seconds:16.1f}{1e3 * seconds_turn:12.1f}"
            )
        ratio = (np.abs(target) / fibres.capacity).max(1, keepdims=True)
        beyond = in_turn(section, 1.01 * target / ratio, None)
        codes, steps = np.asarray(beyond.status), np.asarray(beyond.steps)
        caught = np.count_nonzero(codes == status.BEYOND_CAPACITY)
        say(
            f"of {NUMBER} forces beyond what all fibres together can carry {caught} are "
            f"BEYOND_CAPACITY, {np.count_nonzero(codes == status.OK)} OK; at most {steps.max()} "
            "iterations"
        )
        say(
            f"compile: batch {np.median(compiling, axis=0)[0]:.1f} s, "
            f"in turn {np.median(compiling, axis=0)[1]:.1f} s"
        )
    say.close()


if __name__ == "__main__":
    main()
