# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A first net: how far does it move under load, and how does that depend on its prestress?
#
# A cable net has no stiffness across its plane until it is prestressed. So it is analysed in two
# phases: **prestress** first, then **load** on the resulting geometry. This notebook analyses a net
# of twelve cables, takes the derivative of its deflection with respect to the prestress, and checks
# both by hand.
#
# All units are SI: m, N, Pa.
#
# The first run takes up to 2 minutes on two cores, most of them to compile; the next one, less.
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/jaxcable/jaxcable/blob/main/notebooks/01_first_net.ipynb)

# %%
# where jaxcable is missing, in Colab for one, install it
import importlib.util
import subprocess
import sys

if importlib.util.find_spec("jaxcable") is None:
    subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", "jaxcable"], check=True)

# %%
import jax

jax.config.update("jax_enable_x64", True)  # double precision: lengths and strains need it
import tempfile
from pathlib import Path

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import root

import jaxcable as jc

jc.fuse_loops()  # before jax computes anything: small nets are two to three times faster

# %% [markdown]
# ## The net
#
# The net is flat: two cables run along $x$ and two along $y$, in a grid of 3 x 3 cells of 0.4 m.
# They cross at four free nodes; their eight ends are anchored. `nodes` has a row of coordinates for
# each node, `links` a pair of node numbers (from 0) for each cable between two nodes.

# %%
a = 0.4  # m, side of a cell
nodes = a * np.array(
    [
        [1, 0, 0],  # 0, 1: anchors at y = 0
        [2, 0, 0],
        [0, 1, 0],  # 2 anchor, 3 and 4 free, 5 anchor
        [1, 1, 0],
        [2, 1, 0],
        [3, 1, 0],
        [0, 2, 0],  # 6 anchor, 7 and 8 free, 9 anchor
        [1, 2, 0],
        [2, 2, 0],
        [3, 2, 0],
        [1, 3, 0],  # 10, 11: anchors at y = 3 a
        [2, 3, 0],
    ]
)
along_x = [(2, 3), (3, 4), (4, 5), (6, 7), (7, 8), (8, 9)]
along_y = [(0, 3), (3, 7), (7, 10), (1, 4), (4, 8), (8, 11)]
free = [3, 4, 7, 8]
anchors = [0, 1, 2, 5, 6, 9, 10, 11]

# %% [markdown]
# The cables are straight and carry tension only. $EA$ is their axial stiffness, about that of a
# steel wire of 0.8 mm. Supports hold all three directions.

# %%
EA = 97.97e3  # N
structure = jc.Structure(
    nodes, jc.Cables(along_x + along_y, axial_stiffness=EA), supports=jc.pinned(anchors)
)

# %% [markdown]
# ## Two phases
#
# A phase adds something to the structure in equal increments. The first adds 200 N of pretension:
# it fixes how much shorter than 0.4 m each cable is cut. The second adds 75 N to every free node.

# %%
T, P = 200.0, 75.0  # N
prestress = jc.Phase(pretension=T)
loading = jc.Phase(loads=jc.NodalLoads(free, (0.0, 0.0, -P)), increments=10)

solution = jc.solve(structure, [prestress, loading])
print(jc.describe(solution.status))
print(f"deflection {-1e3 * solution.displacement[3, 2]:.3f} mm")

# %% [markdown]
# Every analysis has a status. `describe` gives it in words; `raise_if_failed` stops if it is not
# "converged", and says which increment failed and what to try. A failed analysis gives NaN, never a
# number that looks right.

# %%
jc.raise_if_failed(solution)
jc.plots.net(solution, structure=structure, magnify=5.0)

# %% [markdown]
# ## Was it in equilibrium?
#
# Each increment is iterated to equilibrium. The residual is the largest unbalanced force relative
# to the forces at a node; the iteration stops when it is below the line. No cable went slack.

# %%
jc.plots.increments(solution)

# %% [markdown]
# ## The net stiffens
#
# Deflection and load are not proportional: the tension grows as the cables stretch, and with it
# the stiffness. A linear analysis of the prestressed net would give $P / k$ with $k = 2 T / a$: too
# much deflection, and no change of the tension at all.

# %%
path = solution.phases[1].path
linear = P / (2 * T / a)
print("load (N)   deflection (mm)   linear (mm)   tension at the anchor (N)")
for k in (0, 1, 4, 9):
    factor, deflection = path.load_factor[k], -path.displacement[k, 3, 2]
    print(
        f"{factor * P:8.1f} {1e3 * deflection:17.2f} {1e3 * factor * linear:13.2f}"
        f" {path.tension[k, 0]:27.1f}"
    )

# %% [markdown]
# ## A cable goes slack
#
# Now let a rope pull node 3 along $x$ instead. `start=` continues from an analysis: here from the
# prestressed net, which need not be found again. The cable from node 3 back to its anchor, node 2,
# tightens; the next one along $x$, to node 4, gives way until it is slack. That is not an error: a
# slack cable has no force and no stiffness, and `n_slack` counts such cables in every increment.

# %%
prestressed = jc.solve(structure, [prestress])
pull = jc.Phase(loads=jc.NodalLoads([3], (800.0, 0.0, 0.0)), increments=8)
pulled = jc.solve(structure, [pull], start=prestressed)
jc.raise_if_failed(pulled)
side = pulled.phases[0].path
for k in range(8):
    print(
        f"{800 * side.load_factor[k]:5.0f} N: slack cables {side.n_slack[k]}, "
        f"tension 2-3 {side.tension[k, 0]:6.1f} N, tension 3-4 {side.tension[k, 1]:5.1f} N"
    )

# %% [markdown]
# In pictures slack cables are dashed.

# %%
jc.plots.net(pulled, structure=structure)

# %% [markdown]
# ## The report
#
# `report` lists what a checking engineer asks for: reactions and their sum beside that of the
# loads, forces and their envelope, and the unstressed lengths to which cables are cut. It can be
# saved as text, CSV or JSON (`.save("net.txt")`), and its tables are plain lists.

# %%
written = jc.report(structure, solution, [prestress, loading])
print(written)

# %% [markdown]
# ## How the deflection depends on the prestress
#
# The whole analysis is a differentiable function. `jax.grad` gives the derivative of the
# deflection of node 3 with respect to the pretension of each cable, through both phases, in one
# backward pass.


# %%
def deflection(tension):  # of node 3, m, by the pretension of every cable [12], N
    phases = [jc.Phase(pretension=tension), loading]
    return -jc.solve(structure, phases).displacement[3, 2]


rate = jax.jit(jax.grad(deflection))(T * jnp.ones(12))
for name, k in (("from an anchor to node 3", 0), ("between free nodes", 1), ("far away", 5)):
    print(f"cable {k:2d}, {name:25s} {1e6 * rate[k]:7.2f} micrometres per newton")
print(f"all cables together {1e6 * rate.sum():30.2f} micrometres per newton")

# %% [markdown]
# The two cables that tie node 3 to its anchors matter most. To see the whole range, map the same
# function over many levels of prestress at once: `vmap` runs them as one batch. The tangent drawn
# at 200 N is the derivative from above.

# %%
levels = jnp.linspace(25.0, 400.0, 16)
deflections = jax.jit(jax.vmap(lambda t: deflection(t * jnp.ones(12))))(levels)
assert np.isfinite(deflections).all()  # a failed level would be NaN
for k in range(0, 16, 3):
    print(f"{levels[k]:5.0f} N: {1e3 * deflections[k]:6.2f} mm")

# %%
figure, axes = plt.subplots(figsize=(5, 3.2), dpi=120, layout="constrained")
axes.plot(levels, 1e3 * deflections, "o-", markersize=3, label="two phases")
near = np.array([80.0, 320.0])
tangent = -solution.displacement[3, 2] + (near - T) * rate.sum()
axes.plot(near, 1e3 * tangent, "--", label="derivative at 200 N")
axes.set(xlabel="pretension (N)", ylabel="deflection under 75 N (mm)")
axes.legend(frameon=False)
axes.grid(color="0.9")

# %% [markdown]
# ## Save it, and use it without Python
#
# A structure with its phases is a scene. It is saved as readable JSON with all digits, so that an
# analysis of the loaded scene gives the same numbers.

# %%
folder = Path(tempfile.mkdtemp())
jc.save_scene(folder / "net.json", (structure, [prestress, loading]))
scene = jc.load_scene(folder / "net.json")
again = jc.solve(*scene)
jc.raise_if_failed(again)
print("identical:", bool((again.displacement == solution.displacement).all()))

# %% [markdown]
# The same file works on the command line:
#
# ```
# python -m jaxcable solve net.json --plot net.png --report
# ```
#
# ## Check by hand
#
# By symmetry the four free nodes move alike: node 3 by $(u, u, -w)$. So the cables to the anchors
# and those between free nodes have the lengths
#
# $$ l_1 = \sqrt{(a + u)^2 + u^2 + w^2}, \qquad l_2 = a - 2u, $$
#
# with forces $N = EA\,(l - l_0) / l_0$, where $l_0 = a / (1 + T / EA)$. Node 3 is in equilibrium
# along $x$ and along $z$ if
#
# $$ N_2 - N_1 \frac{a + 2u}{l_1} = 0, \qquad 2 N_1 \frac{w}{l_1} = P. $$
#
# SciPy solves these two equations for the two unknowns, independently of jaxcable.


# %%
def by_hand(T, P):  # the unknowns u, w in units of a
    l0 = a / (1 + T / EA)

    def unbalanced(x):
        u, w = a * x
        l1, l2 = np.sqrt((a + u) ** 2 + u**2 + w**2), a - 2 * u
        N1, N2 = EA * (l1 - l0) / l0, EA * (l2 - l0) / l0
        return np.array([N2 - N1 * (a + 2 * u) / l1, 2 * N1 * w / l1 - P]) / P

    found = root(unbalanced, [0.0, 0.05], tol=1e-14)
    return a * found.x, np.abs(unbalanced(found.x)).max()


(u, w), left = by_hand(T, P)
print(f"by hand:  deflection {1e3 * w:.9f} mm, sideways {1e3 * u:+.9f} mm (unbalanced {left:.0e})")
print(
    f"jaxcable: deflection {-1e3 * solution.displacement[3, 2]:.9f} mm, "
    f"sideways {1e3 * solution.displacement[3, 0]:+.9f} mm"
)

# %% [markdown]
# The derivative by hand is the difference quotient of the deflections at two pretensions 0.1 N
# apart; its relative error is about 1e-7.

# %%
slope = (by_hand(T + 0.05, P)[0][1] - by_hand(T - 0.05, P)[0][1]) / 0.1
print(f"by hand {1e6 * slope:.6f}, jaxcable {1e6 * rate.sum():.6f} micrometres per newton")
assert left < 1e-10
assert np.abs(solution.displacement[3] - np.array([u, u, -w])).max() < 1e-10  # m
assert abs(rate.sum() / slope - 1) < 1e-6
