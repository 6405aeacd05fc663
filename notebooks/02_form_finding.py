# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Form finding: which shape belongs to given forces, and how long is each cable cut?
#
# A cable net cannot be drawn first and analysed afterwards, because its shape follows from its
# forces. So one prescribes forces (or force densities) and finds the shape; the unstressed lengths
# to which cables are cut follow from shape, forces and stiffness. This notebook does so for a roof
# of 14 x 14 m, and then computes its deflection under snow.
#
# The first run takes up to 4 minutes on two cores, most of them to compile; the next one, less.
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/jaxcable/jaxcable/blob/main/notebooks/02_form_finding.ipynb)

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
import numpy as np
from scipy.optimize import root

import jaxcable as jc

jc.fuse_loops()  # before jax computes anything: small nets are two to three times faster

# %% [markdown]
# ## The frame and the topology
#
# Four cables each way between the edges of a saddle. Only the anchors determine the form; the
# positions of free nodes are the start of the iteration. The cables are strands of 100 mm², steel
# expands by $1.2 \cdot 10^{-5}$ per kelvin.

# %%
n, spacing = 4, 2.8  # free nodes a side; m
EA, strength, alpha = 165e9 * 100e-6, 150e3, 1.2e-5  # N, N, 1/K

structure, _ = jc.scenes.saddle(n, n, spacing=spacing, rise=0.15)
links = structure.elements.links.array  # [40, 2], first the rows along x, then the columns along y
structure = jc.replace(
    structure,
    elements=jc.Cables(links, axial_stiffness=EA, strength=strength, expansion=alpha),
)
x, y, z = structure.nodes.T
print(f"{structure.n_node} nodes, {len(links)} cables, edges from {z.min():.1f} to {z.max():.1f} m")


# %% [markdown]
# ## Force densities
#
# With $q = T / l$ prescribed, equilibrium is linear in the coordinates (Schek 1974): one linear
# solve, no iteration. But the forces are only known afterwards: they vary with the lengths. (The
# drawn surface, a hyperbolic paraboloid over an even plan, happens to be the shape of equal force
# densities.)


# %%
def lengths(positions):
    return np.linalg.norm(np.diff(np.asarray(positions)[links], axis=1)[:, 0], axis=1)


q = 10e3  # N/m
by_density = jc.force_density(structure, q)
tension = q * lengths(by_density)
print(f"tensions from {tension.min() / 1e3:.2f} to {tension.max() / 1e3:.2f} kN")
print(f"away from the drawn saddle: {np.abs(by_density - structure.nodes).max():.1e} m")

# %% [markdown]
# ## The minimal net
#
# A net whose cables all have the same tension is, of all nets between these anchors, the one with
# the least total length: $\sum T l$ is stationary. `find_form` takes tensions (or stresses, or
# lengths) and returns the shape.

# %%
T = 20e3  # N
form = jc.find_form(structure, tension=jnp.full(len(links), T))  # the scalar T would do, too
jc.raise_if_failed(form)
print(f"{jc.describe(form.status)} in {form.iterations} steps")
for name, positions in (
    ("drawn surface", structure.nodes),
    ("force densities", by_density),
    ("equal tensions", form.positions),
):
    print(f"{name:16s} total length {lengths(positions).sum():.4f} m")

# %% [markdown]
# ## Other forces, another shape
#
# Tensions can differ from cable to cable: here all cables along $x$, which hang, have `ratio` times
# the tension of those along $y$, which arch upward. The cables with more tension become straighter.

# %%
along_x = np.arange(len(links)) < len(links) // 2
middle = int(np.argmin(np.hypot(x - x.mean(), y - y.mean())))
print("tension along x / along y   height of the node nearest to the middle")
for ratio in (0.5, 1.0, 2.0):
    other = jc.find_form(structure, tension=jnp.where(along_x, ratio * T, T))
    jc.raise_if_failed(other)
    print(f"{ratio:12.1f} {other.positions[middle, 2]:33.3f} m")

# %% [markdown]
# ## From the form to an analysis
#
# An analysis takes the positions of the form as nodes and its tensions as pretension. It begins in
# equilibrium, so nothing moves in phase 1. Phase 2 adds snow, 0.75 kN/m² of the plan, on the meshes
# of the net, which `net_faces` finds.

# %%
found = jc.replace(structure, nodes=form.positions)
faces = jc.net_faces(structure.nodes, links, border="ends")
snow = jc.Phase(loads=jc.AreaLoads(faces, (0.0, 0.0, -750.0)))
solution = jc.solve(found, [jc.Phase(pretension=form.tension), snow])
jc.raise_if_failed(solution)
for k, phase in enumerate(solution.phases, 1):
    moved = jnp.linalg.norm(phase.displacement_in_phase, axis=1)
    print(f"phase {k} moves nodes by up to {moved.max():.4f} m")
print(f"slack cables under snow: {solution.phases[1].path.n_slack[-1]}")

# %%
jc.plots.net(solution, structure=found)

# %% [markdown]
# ## One derivative through form and load
#
# If all tensions are raised by the same factor, the shape stays and the net deflects less. If only
# the cables in one direction are tensioned more, the shape changes too. The derivative of the whole
# chain (form, prestress, snow) has both effects, here for the node that moves most.

# %%
moved = np.linalg.norm(solution.displacement, axis=1)
worst = int(np.argmax(moved))
print(f"node {worst}: {1e3 * moved[worst]:.2f} mm, near the middle {1e3 * moved[middle]:.2f} mm")


def deflection(pair):  # of that node, m, by the tensions along x and along y, N
    form = jc.find_form(structure, jnp.where(along_x, pair[0], pair[1]))
    found = jc.replace(structure, nodes=form.positions)
    solution = jc.solve(found, [jc.Phase(pretension=form.tension), snow])
    return jnp.linalg.norm(solution.phases[1].displacement_in_phase[worst])


rate = jax.jit(jax.grad(deflection))(jnp.array([T, T]))
print(f"along x {1e6 * rate[0]:+.3f}, along y {1e6 * rate[1]:+.3f} mm per kN")
print(f"both    {1e6 * rate.sum():+.3f} mm per kN")

# %% [markdown]
# ## The cutting list
#
# Cables are cut without force, and at the temperature of the workshop. The unstressed length at the
# temperature of the site is $l_0 = l / (1 + T / EA)$. Say the form is wanted at 5 °C and the cables
# are cut at 25 °C: they must be longer by the factor $1 / (1 - 20\,\alpha)$. An analysis confirms
# it in one phase: cables of the workshop lengths are installed and cool by 20 K.

# %%
cooling = -20.0  # K
workshop = form.rest_length / (1 + alpha * cooling)
phases = [jc.Phase(rest_length=workshop, temperature=cooling), snow]
cooled = jc.solve(found, phases)
jc.raise_if_failed(cooled)
first = cooled.phases[0]
print(f"tensions on site {first.tension.min():.3f} to {first.tension.max():.3f} N")
k = int(jnp.argmax(form.length))
print(f"longest cable: {form.length[k]:.5f} m between its nodes")
print(f"  unstressed at  5 °C {form.rest_length[k]:.5f} m")
print(f"  unstressed at 25 °C {workshop[k]:.5f} m")

# %% [markdown]
# If it is given the phases, the report lists the lengths at the temperature before the first phase,
# with the reactions at the edge and the forces of the cables over their strength. Long tables show
# the governing rows only; `.csv()` and `.save("net.csv")` have all rows.

# %%
written = jc.report(found, cooled, phases)
print(written.text(rows=6))

# %% [markdown]
# ## A shape from weight: the hanging cable
#
# A form can also follow from loads: a cable between two level supports 120 m apart shall sag by 9 m
# under its own weight. `hanging_chain` finds the shape of $n$ straight elements and their
# unstressed length, exactly in equilibrium. The exact elastic catenary follows from its formulas
# for half span and sag, with horizontal force $H$ and half unstressed length $s$:
#
# $$ \frac{L}{2} = \frac{H}{w} \operatorname{asinh} \frac{w s}{H} + \frac{H s}{EA}, \qquad
# f = \frac{H}{w} \left( \sqrt{1 + (w s / H)^2} - 1 \right) + \frac{w s^2}{2 EA}. $$

# %%
span, sag, weight, stiffness = 120.0, 9.0, 30.0, 60e6  # m, m, N/m, N


def off(v):  # v: H in units of the parabola's, s in units of half the span
    H, s = v[0] * weight * span**2 / (8 * sag), v[1] * span / 2
    half = H / weight * np.arcsinh(weight * s / H) + H * s / stiffness
    depth = H / weight * (np.hypot(1, weight * s / H) - 1) + weight * s**2 / (2 * stiffness)
    return [half / (span / 2) - 1, depth / sag - 1]


exact = span * root(off, [1.0, 1.0], tol=1e-14).x[1]  # unstressed length, m
counts, errors = (4, 8, 16), []
for count in counts:
    shape, rest = jc.forms.hanging_chain(
        (0.0, 0.0, 0.0), (span, 0.0, 0.0), count, sag, weight, stiffness
    )
    errors.append(abs(float(rest.sum()) - exact))
    print(f"{count:3d} elements: {rest.sum():.6f} m, catenary {exact:.6f} m")

# %%
jc.plots.convergence(
    counts,
    {"length to cut": errors},
    counts=True,
    xlabel="number of elements (-)",
    ylabel="error of the unstressed length (m)",
)

# %% [markdown]
# ## Check the minimal net
#
# These checks use positions and tensions alone: the forces at every free node add up to zero; by
# Hooke's law the unstressed lengths lead to 20 kN; and no small random displacement of the free
# nodes makes the net shorter.

# %%
positions = np.asarray(form.positions)
way = positions[links[:, 1]] - positions[links[:, 0]]
length = np.linalg.norm(way, axis=1)
pull = T * way / length[:, None]
force = np.zeros_like(positions)
np.add.at(force, links[:, 0], pull)
np.add.at(force, links[:, 1], -pull)
free = ~np.asarray(structure.fixed(structure.supports))  # [n_node, 3]
print(f"largest force out of balance at a free node: {np.abs(force[free]).max():.1e} N")

rest = np.asarray(form.rest_length)
by_hooke = EA * (length - rest) / rest
print(f"tensions from the cutting list: {by_hooke.min():.4f} to {by_hooke.max():.4f} N")

rng = np.random.default_rng(1)
gains = [
    lengths(positions + np.where(free, rng.normal(0.0, 1e-3, free.shape), 0.0)).sum() - length.sum()
    for _ in range(100)
]
print(f"100 random moves of 1 mm: longer by {1e3 * min(gains):.4f} to {1e3 * max(gains):.4f} mm")

assert np.abs(force[free]).max() < 4e-10 * T  # the tolerance of the search: 1e-10 of 4 T a node
assert np.abs(by_hooke / T - 1).max() < 1e-9
assert np.abs(first.tension / T - 1).max() < 1e-9  # after cooling, on site
assert min(gains) > 0
order = np.log2(errors[-2] / errors[-1])
assert abs(order - 2) < 0.05  # chains approach the catenary at second order
