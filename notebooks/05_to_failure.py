# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # To failure: at which load does a structure fail, and how?
#
# `jc.solve` answers "what happens under this load?". This notebook answers the other question: the
# load grows until something happens. Three things can:
#
# - the load reaches a maximum and the structure snaps (**limit point**),
# - the structure leaves its path sideways (**bifurcation**),
# - a cable is strained beyond its rupture strain (**material failure**).
#
# Cables that go slack on the way are no failure, but good to know. `jc.trace_path` follows the
# equilibrium path by arc length, past maxima, and locates all of these.
#
# The first run takes up to 3 minutes on two cores, most of them to compile; the next one, less.
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/jaxcable/jaxcable/blob/main/notebooks/05_to_failure.ipynb)

# %%
# where jaxcable is missing, in Colab for one, install it
import importlib.util
import subprocess
import sys

if importlib.util.find_spec("jaxcable") is None:
    subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", "jaxcable"], check=True)

# %%
import jax

jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxcable as jc

jc.fuse_loops()  # before jax computes anything: small nets are two to three times faster

# %% [markdown]
# ## A truss that snaps through
#
# The truss of von Mises: two bars with $EA$ = 1 MN meet in an apex, half-span $b$ = 1 m, rise
# $h$ = 0.1 m. The apex (node 1) moves in the plane of the truss; its load is 500 N at load
# factor 1.

# %%
structure, phases = jc.scenes.von_mises_truss(rise=0.1, load=500.0, sway=True)
path = jc.trace_path(structure, phases)
print(f"status: {jc.describe(path.status)}; {len(path.load_factor)} points")
for event in path.events:
    load, moved = 500 * event.load_factor, 1e3 * event.displacement[1, 2]
    print(f"{event.names[0]} at {load:.6f} N, apex moved by {moved:.2f} mm")

# %%
jc.plots.path(path, node=1, axis="-z", scale=500.0, unit="N")

# %% [markdown]
# The load rises to the first limit point. From there the apex would snap through to the right-hand
# branch under a dead load. The dashed part, where the load decreases, is stable only if the
# displacement of the apex is controlled, by a jack for example. The second limit point is the same
# on the way back. `path.failure_load` is the load factor of the first failure.
#
# ## The same by hand
#
# With the apex at the height $z$ over its feet and bars of the length $l = \sqrt{b^2 + z^2}$,
# unstressed $l_0$, equilibrium is $P = 2 EA\,\frac{l_0 - l}{l_0}\,\frac{z}{l}$. The maximum is
# where $l = (b^2 l_0)^{1/3}$.


# %%
def load_by_hand(l, b, l0, ea):
    """Return the load under which the bars have the length l."""
    return 2 * ea * (l0 - l) / l0 * np.sqrt(l**2 - b**2) / l


def limit_by_hand(h, b=1.0, ea=1e6):
    l0 = np.hypot(b, h)
    return load_by_hand((b**2 * l0) ** (1 / 3), b, l0, ea)


limit = 500 * float(path.failure_load)
print(f"traced {limit:.9f} N, by hand {limit_by_hand(0.1):.9f} N")

# %% [markdown]
# ## What `solve` says beyond the limit
#
# Beware: under the full 500 N there is an equilibrium, beyond the snap-through, and `solve` finds
# it with status 0. It does not tell that the structure jumps on its way there. Where a structure
# can snap through, trace the path.


# %%
def under(load):
    return jc.solve(structure, [jc.Phase(loads=jc.NodalLoads([1], [0.0, 0.0, -load]))])


for load in (0.99 * limit, 500.0):
    solution = under(load)
    height = 0.1 + float(solution.displacement[1, 2])
    print(f"{load:6.1f} N: {jc.describe(solution.status)}, apex at {1e3 * height:+.1f} mm")

# %% [markdown]
# ## What the limit load depends on
#
# The limit load is differentiable: one `jax.grad` gives its derivatives with respect to all numbers
# of the structure. They have different units; what can be compared is how much one percent less of
# each number reduces the load. The limit load grows with the cube of a small rise, and with the
# first power of the stiffness. (`through=False` ends at the first failure.)


# %%
def limit_load(numbers):
    nodes = jnp.asarray(structure.nodes).at[1, 2].set(numbers["rise"])
    bars = jc.replace(structure.elements, axial_stiffness=numbers["EA"])
    own = jc.replace(structure, nodes=nodes, elements=bars)
    return 500 * jc.trace_path(own, phases, through=False).failure_load


rate = jax.grad(limit_load)({"rise": 0.1, "EA": 1e6})
step = 1e-5
difference = (limit_by_hand(0.1 + step) - limit_by_hand(0.1 - step)) / (2 * step)
print(f"by rise: {rate['rise']:.4f} N/m; by hand, central difference: {difference:.4f} N/m")
print(f"by EA:   {rate['EA']:.6e}; by hand, P / EA: {limit / 1e6:.6e}")
for name, value in (("rise", 0.1), ("EA", 1e6)):
    print(f"one percent less {name}: {float(rate[name]) * value / limit:.2f} % less load")

# %% [markdown]
# ## A warning that can be measured
#
# Towards a limit point the stiffness goes to zero, and with it the lowest natural frequency $f$.
# Near the limit $f^4$ decreases linearly with the load, so that a line through two measured
# frequencies predicts the limit load before it is reached. The apex carries a mass of 10 kg.

# %%
shares = np.array([0.0, 0.3, 0.6, 0.8, 0.9, 0.95])
frequencies = []
for share in shares:
    solution = under(share * limit)
    jc.raise_if_failed(solution)
    slowest = jc.dynamics.modes(structure, solution, n=1, masses=10.0)
    frequencies.append(float(slowest.frequency[0]))
fourth = np.array(frequencies) ** 4
print("load / limit   frequency   line through this and the one before points to")
for k, share in enumerate(shares):
    text = f"{share:12.2f} {frequencies[k]:8.3f} Hz"
    if k:
        guess = share + fourth[k] * (share - shares[k - 1]) / (fourth[k - 1] - fourth[k])
        text += f"   {guess:.3f} of the limit load"
    print(text)

# %%
_, axes = plt.subplots(figsize=(5, 3.2), dpi=110, layout="constrained")
axes.plot(shares * limit, fourth, "o-", label="computed")
axes.axvline(limit, color="C1", linestyle="--", label="limit load")
axes.set(xlabel="load (N)", ylabel="$f^4$ (Hz$^4$)", xlim=(0, None), ylim=(0, None))
axes.legend()
axes.grid(color="0.9")

# %% [markdown]
# ## A truss that sways first
#
# The same truss, but 10 m high, has two steep legs. Long before its limit point it buckles
# sideways, at a bifurcation. `alignment` distinguishes the two: the load does work on the critical
# mode $\varphi$ ($|\varphi \cdot F| > 0$) at a limit point, and none at a bifurcation. `mode` is
# $\varphi$.

# %%
steep, push = jc.scenes.von_mises_truss(rise=10.0, load=30e3, sway=True)
upright = jc.trace_path(steep, push)
print(f"status: {jc.describe(upright.status)}; {upright.events.names}")
print(f"at {30e3 * upright.failure_load:.3f} N, alignment {upright.events.alignment[0]:.1e}")
print("mode of the apex:", np.abs(np.round(upright.events.mode[0, 1], 6)))

# %% [markdown]
# By hand: the sway stiffness of the legs is zero where $l^3 - l_0 l^2 + l_0 b^2 = 0$.

# %%
l0 = np.hypot(1.0, 10.0)
sway_length = np.roots([1.0, -l0, 0.0, l0]).real.max()
branch = load_by_hand(sway_length, 1.0, l0, 1e6)
print(f"traced {30e3 * upright.failure_load:.6f} N, by hand {branch:.6f} N")

# %% [markdown]
# At a bifurcation `trace_path` stays on the primary path, as only a perfect structure does. Real
# structures have imperfections; the worst have the shape of the mode. With the apex 10 mm off the
# middle the path bends away and ends in a limit point at a lower load: the real failure load.

# %%
crooked = jc.replace(steep, nodes=jnp.asarray(steep.nodes).at[1, 0].add(0.01))
bent = jc.trace_path(crooked, push, through=False)
print(f"status: {jc.describe(bent.status)}")
loss = 1 - float(bent.failure_load) / float(upright.failure_load)
print(f"{30e3 * bent.failure_load:.0f} N, {loss:.1%} less than the perfect one")

# %%
jc.plots.path(bent, node=1, axis="x", scale=30.0, unit="kN")

# %% [markdown]
# ## A cable net: cables go slack first and break last
#
# A saddle net with 4 x 4 free nodes a metre apart, of prestressing strand: 93 mm$^2$, 1860 MPa,
# with its stress-strain curve. The prestress is 20 kN in every cable; the load is 1 kN on every
# node (about 1 kN/m$^2$ of snow) at load factor 1, and grows until a cable breaks. The phases
# before the last one are solved first.

# %%
strand = jc.materials.strand(unloading="reversible")
area = 93e-6  # m2
net, (_, snow) = jc.scenes.saddle(4, 4, rise=0.1, load=1000.0)
net = jc.replace(net, elements=jc.Cables(net.elements.links, area=area, law=strand))
prestress = jc.Phase(pretension=20e3)
loaded = jc.trace_path(net, [prestress, snow], until=100.0, step=0.5, largest=2.0)
print(jc.describe(loaded.status))

# %%
middle = int(np.argmin(np.linalg.norm(np.asarray(net.nodes)[:, :2] - 2.5, axis=1)))
jc.plots.path(loaded, node=middle, axis="-z", unit="kN a node")

# %% [markdown]
# Each event names its elements. The cables along $x$ hang and carry the snow; those along $y$ arch
# upward and go slack. At the last kink of the path strands begin to yield, which is no event. In
# the end some carrying cables are strained beyond the end of their curve. The load factor of the
# failure lies between the last converged point and the first failed one.

# %%
ends = np.asarray(net.nodes)[np.asarray(net.elements.links)]
along_x = np.abs(ends[:, 1, 1] - ends[:, 0, 1]) < 1e-9
for event, kind in zip(loaded.events, loaded.events.names):
    chosen = np.asarray(event.elements)
    where = f"{chosen[along_x].sum()} along x, {chosen[~along_x].sum()} along y"
    print(f"{kind:16} at {event.load_factor:7.3f} kN a node: {where}")
broken = loaded.events[len(loaded.events) - 1]
print(f"last good {broken.lower:.9f}, first failed {broken.upper:.9f} kN a node")
print(f"largest stress there {loaded.tension[-1].max() / area / 1e6:.2f} MPa")

# %% [markdown]
# ## Checks
#
# The limit load, its derivative and the sway load are compared with the closed forms, the stress at
# failure with the strength of the strand.

# %%
assert path.events.names[0] == "limit point"
assert abs(limit - limit_by_hand(0.1)) < 1e-9 * limit
assert abs(rate["rise"] - difference) < 1e-5 * difference
assert upright.events.names[0] == "bifurcation"
assert abs(30e3 * float(upright.failure_load) - branch) < 1e-8 * branch
assert abs(float(loaded.tension[-1].max()) / area - 1860e6) < 1e-6 * 1860e6
print(f"limit load off by {abs(limit / limit_by_hand(0.1) - 1):.1e}")
