# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Large nets and many cases: how large, how many, on what?
#
# This notebook analyses a net with thousands of unknowns and differentiates it with respect to
# thousands of pretensions. Then it analyses a thousand load cases of a small net, on one device and
# on several. It shows what to write and how long it takes; times are those of this machine at this
# moment.
#
# jax can treat one processor as several devices, if an environment variable says so before jax is
# imported. Never take more devices than there are cores: they would wait for each other.
#
# A run takes up to 4 minutes on two cores, most of them to compile.
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/jaxcable/jaxcable/blob/main/notebooks/07_large_nets.ipynb)

# %%
# where jaxcable is missing, in Colab for one, install it
import importlib.util
import subprocess
import sys

if importlib.util.find_spec("jaxcable") is None:
    subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", "jaxcable"], check=True)

# %%
import os
import sys

if "jax" not in sys.modules:  # afterwards it is too late
    n_device = min(2, os.cpu_count())
    os.environ["XLA_FLAGS"] = f"--xla_force_host_platform_device_count={n_device}"
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads of two libraries would fight
import jax

jax.config.update("jax_enable_x64", True)
import tempfile
import time
from pathlib import Path

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxcable as jc

jc.fuse_loops()  # before jax computes anything: small nets are two to three times faster

print(f"{len(jax.devices())} device(s) of {os.cpu_count()} cores")

# %% [markdown]
# ## A large net
#
# A saddle of 40 x 40 free nodes, prestressed with 20 kN a cable, then loaded with 500 N a node.
# `progress` is called after each increment; `progress=True` prints every half second how far a long
# analysis is. The first call includes compilation.

# %%
net, (prestress, load) = jc.scenes.saddle(40, 40, rise=0.1, increments=(1, 2))
n_cable = len(net.elements.links)
print(f"{3 * 40 * 40} unknowns, {n_cable} cables")
solution = jc.solve(net, [prestress, load], progress=print)
jax.effects_barrier()  # all that was to be printed has been printed
jc.raise_if_failed(solution)

# %%
jc.plots.net(solution, structure=net, loads=False, supports=False)

# %% [markdown]
# The linear solver is chosen by size: matrices are dense up to 150 unknowns, banded up to some
# hundred, and sparse beyond that. Sparse ones are solved by PARDISO if `pip install
# jaxcable[pardiso]` was done, else by SciPy's SuperLU. `Newton(linear_solver="superlu")` names one.
# `report` says how accurate the result is.

# %%
print("\n".join(jc.report(net, solution).summary))

# %% [markdown]
# ## Equilibrium, checked independently
#
# NumPy assembles the forces from end positions, unstressed lengths and $EA$ alone: how large are
# the unbalanced forces at the free nodes, compared with the force in a cable?

# %%
links = np.asarray(net.elements.links)
places, rest = np.asarray(solution.positions), np.asarray(solution.rest_length)
chord = places[links[:, 1]] - places[links[:, 0]]
length = np.linalg.norm(chord, axis=1)
tension = np.maximum(np.asarray(net.elements.axial_stiffness) * (length - rest) / rest, 0.0)
left = np.asarray(solution.load).copy()
np.add.at(left, links[:, 0], (tension / length)[:, None] * chord)
np.add.at(left, links[:, 1], -(tension / length)[:, None] * chord)
free = np.asarray(load.loads.nodes)
residual = np.abs(left[free]).max()
print(f"{residual:.1e} N at the worst free node; cables carry up to {tension.max():.0f} N")

# %% [markdown]
# ## What does a gradient cost?
#
# The gradient of the mean deflection with respect to the pretension of each cable (adjoint method)
# is one more solve with the tangent at the end, however many parameters there are.
# Times are medians of seven calls, waiting for the result.


# %%
def sag(pretension):
    own = jc.replace(prestress, pretension=pretension)
    solution = jc.solve(net, [own, load])
    return jnp.mean(solution.displacement[:, 2]), solution.status


def measure(function, *arguments, calls=7):
    """Return the result, the time of the first call, and the median time of later ones, s."""
    begin = time.perf_counter()
    result = jax.block_until_ready(function(*arguments))
    first, seconds = time.perf_counter() - begin, []
    for _ in range(calls):
        begin = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        seconds.append(time.perf_counter() - begin)
    return result, first, float(np.median(seconds))


even = 20e3 * jnp.ones(n_cable)
(mean, status), first, alone = measure(jax.jit(sag), even)
both = jax.jit(jax.value_and_grad(sag, has_aux=True))
(_, gradient), first_both, with_gradient = measure(both, even)
print(f"{jc.describe(status)}, mean deflection {1e3 * mean:.2f} mm")
print(f"value    {1e3 * alone:6.0f} ms, first call {first:.1f} s")
print(f"both     {1e3 * with_gradient:6.0f} ms, first call {first_both:.1f} s (value and gradient)")
print(f"both over value {with_gradient / alone:.2f}, for {n_cable} derivatives")

# %% [markdown]
# ## A thousand load cases
#
# A net of 4 x 4 free nodes is prestressed once; then a thousand random winds act on that state.
# `jc.batched` is `jax.vmap` in chunks that fit the cache. Check the status of every case.

# %%
small, (pull, wind) = jc.scenes.saddle(4, 4)
inner = np.asarray(wind.loads.nodes)
start = jc.solve(small, [pull])
jc.raise_if_failed(start)


def case(forces):
    phase = jc.Phase(loads=jc.NodalLoads(inner, forces))
    solution = jc.solve(small, [phase], start=start)
    return solution.tension, solution.status


forces = jnp.asarray(np.random.default_rng(1).normal(0.0, 1500.0, (1000, len(inner), 3)))  # N
single = jax.jit(case)
_, _, one = measure(single, forces[0], calls=50)
(tensions, codes), _, chunked = measure(jc.batched(case, chunk=128), forces)
print(f"{int((codes == 0).sum())} of {len(codes)} cases converged")
print(f"one by one {1e6 * one:.0f} us a case, in chunks {1e3 * chunked:.0f} us a case")

# %% [markdown]
# The envelope shows the largest and the smallest force of each cable over all cases.

# %%
highest, lowest = 1e-3 * jnp.max(tensions, axis=0), 1e-3 * jnp.min(tensions, axis=0)
numbers = np.arange(len(highest))
_, axes = plt.subplots(figsize=(6, 3.2), dpi=110, layout="constrained")
axes.fill_between(numbers, lowest, highest, step="mid", alpha=0.3, label="envelope of the cases")
axes.step(numbers, 1e-3 * start.tension, where="mid", color="black", label="prestress")
axes.set(xlabel="cable (-)", ylabel="tension (kN)", xlim=(0, numbers[-1]), ylim=(0, None))
axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2, frameon=False)
axes.grid(color="0.9")

# %% [markdown]
# ## Several devices
#
# With `devices` the cases are distributed over cores of one processor, over graphics processors, or
# with `jax.distributed` over several machines (`experiments/several_devices.py` shows it). Devices
# that are parts of one processor share its cores; whether they save time must be measured.

# %%
spread = jc.batched(case, chunk=128, devices=jax.devices())
(again, _), _, shared = measure(spread, forces)
print(f"{len(jax.devices())} device(s): {1e3 * shared:.0f} us a case, one: {1e3 * chunked:.0f} us")
print(f"largest difference {jnp.abs(again - tensions).max():.1e} N")

# %% [markdown]
# ## Files for other programs
#
# A scene is saved as a JSON file and loaded again; a result is written as a VTK file for ParaView.

# %%
with tempfile.TemporaryDirectory() as folder:
    jc.save_scene(Path(folder) / "net.json", (net, [prestress, load]))
    back, _ = jc.load_scene(Path(folder) / "net.json")
    [written] = jc.files.save_vtk(Path(folder) / "net.vtk", net, solution)
    head = written.read_text().splitlines()[:5]
same = np.array_equal(back.nodes, net.nodes)
print("scene read back, the same nodes:", same)
print("\n".join(head))

# %% [markdown]
# ## Checks
#
# Equilibrium is checked by NumPy, to the tolerance of Newton's method (1e-10 of the forces at a
# node, where four cables meet). Cases of the batch are compared with single analyses, and the
# gradient with a difference quotient in a random direction.

# %%
assert residual < 1e-10 * 4 * tension.max()
assert (np.asarray(codes) == 0).all() and same
singles = np.stack([single(forces[k])[0] for k in range(0, 1000, 100)])
apart = np.abs(singles - np.asarray(tensions[::100])).max()
assert apart < 1e-8 * np.abs(singles).max()
assert np.abs(np.asarray(again - tensions)).max() < 1e-8 * np.abs(singles).max()
direction = np.random.default_rng(2).normal(size=n_cable)
(up, _), (down, _) = (both(even + h * direction)[0] for h in (10.0, -10.0))
exact, difference = float(gradient @ direction), float(up - down) / 20
assert abs(exact - difference) < 1e-5 * abs(exact)
print(f"batch against single: {apart:.1e} N; derivative {exact:.6e}, difference {difference:.6e} m")
