"""How long is a footbridge to be waited for: 60 m, ten segments, 2 x 4 stays, erected and loaded?

Question   Lines of a script, and seconds, for a footbridge on stays from drawing to member forces:
           cantilevered segment by segment, its deck level, and crowded on one half.
Reference  Statics: reactions against weights and loads.
Error      N out of balance.
Command    python experiments/footbridge.py
"""

import time

import jax
import numpy as np

import jaxcable as jc

begin = time.perf_counter()
jc.keep_programs()
jax.config.update("jax_enable_x64", True)

# nodes: the mast in the middle, with its foot 8 m below the deck; then five on either side
mast = [[0.0, 0.0, z] for z in (-8.0, 0.0, 12.0, 13.0, 14.0, 15.0)]
deck = [[s * 6.0 * k, 0.0, 0.0] for k in range(1, 6) for s in (-1, 1)]
nodes = np.array(mast + deck)
ends = 6 + np.arange(10).reshape(5, 2)

steel = jc.Elastic(210e9)
tube = jc.Section.ring(0.6, 0.02, steel)
girder = jc.Section.ring(0.5, 0.02, steel)
elements = {
    "mast": jc.Beams([[k, k + 1] for k in range(5)], section=tube, up=(1, 0, 0), weight=2.8e3),
    "deck": jc.Beams(
        np.stack([np.vstack([[1, 1], ends[:-1]]), ends], axis=-1).reshape(-1, 2),
        section=girder,
        weight=5e3,  # N/m, with planks
    ),
    "stays": jc.Cables(
        [(2 + k, int(end)) for k in range(4) for end in ends[k]], axial_stiffness=195e9 * 4e-4
    ),
}
structure = jc.Structure(nodes, elements, supports=jc.clamped([0]))

nothing = {"mast": None, "deck": None}
stages = []
for k in range(4):  # a segment on either side, and its stays
    pair = jc.only([2 * k, 2 * k + 1])
    jacks = {**nothing, "stays": jc.only([2 * k, 2 * k + 1], 50e3)}
    stages.append(
        jc.Phase(
            adds={"mast": None, "deck": pair, "stays": pair},
            placed="attached",
            jacking=jacks,
            loads=jc.SelfWeight() if k == 0 else None,
        )
    )
bearings = jc.clamped([0]) + jc.restrained(ends[4], "yz", "x")
last = {**nothing, "deck": jc.only([8, 9]), "stays": None}
stages.append(jc.Phase(adds=last, supports=bearings))

level = jc.design.Target("positions", 0.0, at=(ends[:4].ravel(), 2), within=1e-4)
unknowns = [(k, "jacking") for k in range(4)]
tuned = jc.design.tune(structure, stages, unknowns, level, bounds=(1e3, None))
print(f"forces of the jacks, after {time.perf_counter() - begin:.0f} s from the start:")
print(
    " ", jc.describe(tuned.status), [f"{v['stays'].values[1] / 1e3:.1f} kN" for v in tuned.values]
)

crowd = jc.Phase(loads=jc.NodalLoads(ends[:4, 1], (0.0, 0.0, -24e3)))
clock = time.perf_counter()
solution = jax.block_until_ready(jc.solve(structure, [*tuned.phases, crowd]))
first, clock = time.perf_counter() - clock, time.perf_counter()
jax.block_until_ready(jc.solve(structure, [*tuned.phases, crowd]))
print(f"erected and crowded: {first:.1f} s, again {1e3 * (time.perf_counter() - clock):.0f} ms")
out = float(np.abs(np.asarray(solution.reactions + solution.load)[:, 2].sum()))
sag, force = float(solution.displacement[:, 2].min()), float(solution.tension["stays"].max())
moment = float(np.abs(np.asarray(solution.section_forces["deck"])[..., 4]).max())
print(
    f"  {jc.describe(solution.status)}: {-1e3 * sag:.0f} mm down, stays up to {force / 1e3:.0f} kN,"
)
print(f"  deck up to {moment / 1e3:.0f} kN m; {out:.1e} N out of balance")
