# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Speed and error: how many increments, which elements and which precision do I need?
#
# Every analysis has an error, and every digit costs time. This notebook measures both, on two
# cables whose answers are known in closed form: first the **increments** and the **precision** of
# the numbers, on a prestressed rope; then the **elements**, on a hanging cable. In short: take the
# default, Newton's method with one increment and double precision, and catenaries where weight
# matters. The rest of this page is the evidence.
#
# Times are those of this machine at this moment; elsewhere only their ratios are meaningful.
#
# A run takes up to 3 minutes on two cores, most of them to compile.
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/jaxcable/jaxcable/blob/main/notebooks/06_speed_and_error.ipynb)

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
import time

import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq

import jaxcable as jc

jc.fuse_loops()  # before jax computes anything: small nets are two to three times faster

# %% [markdown]
# ## How to measure time
#
# - The first call of a program includes its compilation: it is timed separately.
# - jax returns before the work is done: `jax.block_until_ready` waits for the result.
# - Times of single calls vary: we take the median of 200.


# %%
def measure(function, *arguments):
    """Return the result, the time of the first call, and the median time of 200 more, s."""
    begin = time.perf_counter()
    result = jax.block_until_ready(function(*arguments))
    first = time.perf_counter() - begin
    seconds = []
    for _ in range(200):
        begin = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        seconds.append(time.perf_counter() - begin)
    return result, first, float(np.median(seconds))


# %% [markdown]
# ## A rope with a known answer
#
# A wire rope, $EA$ = 5 MN, is stretched with $T$ = 20 kN between two anchors 10 m apart, and pulled
# down in the middle with $P$ = 2 kN. With the half-span $a$, the unstressed half-length $L_0 = a /
# (1 + T/EA)$ and the deflection $w$: $P = 2 N w / l$, $N = EA\,(l - L_0)/L_0$, $l = \sqrt{a^2 +
# w^2}$. SciPy finds the root, independently of jaxcable.

# %%
EA, T, P, a = 5e6, 20e3, 2e3, 5.0
L0 = a / (1 + T / EA)


def pull(w):
    l = np.hypot(a, w)
    return 2 * EA * (l - L0) / L0 * w / l


exact = brentq(lambda w: pull(w) - P, 0.0, 1.0, xtol=1e-16, rtol=1e-15)
print(f"{1e3 * exact:.9f} mm; without the growth of the force {1e3 * P * a / (2 * T):.1f} mm")

# %% [markdown]
# The rope in jaxcable, under a load in `n` increments, compiled as one program. With `tol=inf` the
# incremental schemes finish whatever their error is.

# %%
nodes = np.array([[-a, 0.0, 0.0], [0.0, 0.0, 0.0], [a, 0.0, 0.0]])
cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=EA, rest_length=L0)
rope = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))


def program(structure, increments):
    """Return a function of load and method: deflections after each increment, and the status."""

    @jax.jit
    def run(load, method):
        down = load * jnp.array([0.0, 0.0, -1.0], load.dtype)
        phase = jc.Phase(loads=jc.NodalLoads([1], down), increments=increments)
        solution = jc.solve(structure, [phase], method)
        return -solution.phases[0].path.displacement[:, 1, 2], solution.status

    return run


inf = float("inf")
schemes = {
    "secant": jc.Incremental(stiffness="secant", tol=inf),
    "tangent": jc.Incremental(corrections=0, tol=inf),
    "1 correction": jc.Incremental(corrections=1, tol=inf),
    "2 corrections": jc.Incremental(corrections=2, tol=inf),
}

# %% [markdown]
# ## Increments
#
# One program of 64 increments is enough for all numbers of increments: under the load $64 P / n$
# its row $n$ is the rope under $P$ in $n$ increments. All increments take the same time, so that
# the time for $n$ follows from that for 64.

# %%
most = 64
sixty_four = program(rope, most)
counts = {"secant": (8, 16, 32, 64), "tangent": (8, 16, 32, 64)}
counts |= {"1 correction": (4, 8, 16, 32), "2 corrections": (2, 3, 4)}
errors, times = {}, {}
print("                 first call   an increment   error with n increments")
for name, method in schemes.items():
    _, first, seconds = measure(sixty_four, jnp.array(P), method)
    found = []
    for n in counts[name]:
        deflection, status = sixty_four(jnp.array(P * most / n), method)
        assert int(status) == 0, jc.describe(status)
        found.append(abs(float(deflection[n - 1]) - exact) / exact)
    errors[name] = np.array(found)
    times[name] = seconds
    row = "  ".join(f"{n}: {e:.0e}" for n, e in zip(counts[name], found))
    print(f"{name:16} {first:8.1f} s {1e6 * seconds / most:11.0f} us   {row}")

# %%
jc.plots.convergence(
    counts, errors, counts=True, xlabel="increments (-)", ylabel="relative error (-)"
)

# %% [markdown]
# The secant form, as in the paper of the two-phase method, is of first order: twice the increments,
# half the error. The tangent form adds the unbalanced force to the next increment: second order.
# Each correction doubles the order: 4, 8.
#
# ## Newton's method, and single precision
#
# Newton's method iterates to equilibrium: one increment is enough, and `tol` limits the relative
# unbalanced force. In float32 a number has 7 digits, and the smallest tolerance is 64 times its
# rounding error; smaller values of `tol` are raised to it.

# %%
tolerances = {
    "Newton": (1e-1, 1e-2, 1e-4, 1e-6, 1e-10),
    "Newton, float32": (1e-1, 1e-2, 1e-4, 1e-6),
}
single = jc.replace(rope, nodes=jnp.asarray(rope.nodes, jnp.float32))
for name, structure in (("Newton", rope), ("Newton, float32", single)):
    one = program(structure, 1)
    load = jnp.array(P, structure.nodes.dtype)
    own = []
    for tol in tolerances[name]:
        (deflection, status), first, seconds = measure(one, load, jc.Newton(tol=tol))
        assert int(status) == 0, jc.describe(status)
        error = abs(float(deflection[-1]) - exact) / exact
        own.append((error, seconds))
        note = f", first call {first:.1f} s" if tol == tolerances[name][0] else ""
        print(f"{name:16} tol {tol:.0e}: error {error:.1e}, {1e6 * seconds:5.0f} us{note}")
    errors[name], times[name] = np.array(own).T

# %% [markdown]
# With the tolerance 0.1 the start already counts as converged: that call iterates nothing, and its
# time is the fixed cost of a call. The incremental schemes have the same fixed cost.

# %%
fixed = times["Newton"][0]
for name in schemes:
    times[name] = fixed + np.array(counts[name]) * (times[name] - fixed) / most
microseconds = {name: 1e6 * seconds for name, seconds in times.items()}
jc.plots.work_precision(
    microseconds, errors, xlabel="time (us)", ylabel="relative error of the deflection (-)"
)

# %% [markdown]
# Lower left is best. Newton's method reaches all digits in little more than the time of a call that
# does nothing; the incremental schemes need corrections to come near. The tolerance of Newton's
# method hardly matters for the time, because its last steps double the number of correct digits:
# leave it at its default. It is relative to the forces in the cables, which are much larger than
# the load here: therefore a tolerance of 0.1 is far too large, and single precision has an error of
# 1e-4 at any tolerance. That is good enough for large batches on a graphics processor; small
# structures on a laptop gain nothing from it.
#
# ## Elements
#
# A cable of 122 m hangs between two level supports 120 m apart, 30 N/m, $EA$ = 60 MN. What is its
# horizontal force $H$? Irvine's elastic catenary:
# $\;\frac{H L_0}{EA} + \frac{2H}{w}\,\mathrm{arsinh}\frac{w L_0}{2H} = \text{span}$.

# %%
span, weight, stiffness, length = 120.0, 30.0, 60e6, 122.0


def reach(H):
    return H * length / stiffness + 2 * H / weight * np.arcsinh(weight * length / (2 * H))


horizontal = brentq(lambda H: reach(H) - span, 1e2, 1e6, xtol=1e-12, rtol=1e-15)
print(f"H = {horizontal:.6f} N")


# %%
def hanging(n):
    """Return the cable as n straight elements, or as one catenary for n = 0."""
    x = np.linspace(0.0, 1.0, max(n, 1) + 1)
    nodes = np.stack([span * x, 0 * x, -40 * x * (1 - x)], axis=1)  # a parabola to start from
    shared = {"axial_stiffness": stiffness, "weight": weight}
    if n == 0:
        cable = jc.Catenaries([[0, 1]], rest_length=length, **shared)
    else:
        links = np.stack([np.arange(n), np.arange(1, n + 1)], axis=1)
        cable = jc.Cables(links, rest_length=length / n, **shared)
    return jc.Structure(nodes, cable, supports=jc.pinned([0, len(nodes) - 1]))


sizes, off, needed = [4, 8, 16], [], []
for n in (*sizes, 0):
    structure = hanging(n)

    @jax.jit
    def force(factor, structure=structure):
        loads = jc.SelfWeight(factor * jnp.array([0.0, 0.0, -1.0]))
        solution = jc.solve(structure, [jc.Phase(loads=loads)])
        return jnp.abs(solution.reactions[0, 0]), solution.status

    (found, status), first, seconds = measure(force, 1.0)
    assert int(status) == 0, jc.describe(status)
    off.append(abs(float(found) / horizontal - 1))
    needed.append(seconds)
    name = f"{n} straight elements" if n else "one catenary"
    print(f"{name:20} error {off[-1]:.1e}, {1e6 * seconds:6.0f} us, first call {first:.1f} s")

# %%
jc.plots.convergence(sizes, off[:3], counts=True, ylabel="relative error of H (-)")

# %% [markdown]
# Chords are shorter than the cable: straight elements have an error of second order, and with 16 of
# them it is still 0.2 %. One catenary is exact to rounding, without any unknown here, and faster.
# Straight elements are right where cables are straight: between the joints of a prestressed net.
#
# ## Checks
#
# The closed forms were the reference for all errors; here the orders of convergence are compared
# with the theory (within 10 %; 20 % for the highest, which is measured between two and four
# increments).


# %%
def order(n, error):
    return -np.polyfit(np.log(n), np.log(error), 1)[0]


expected = {"secant": 1, "tangent": 2, "1 correction": 4, "2 corrections": 8}
for name, theory in expected.items():
    seen = order(counts[name][1:], errors[name][1:])
    print(f"{name:16} order {seen:.2f}, theory {theory}")
    assert abs(seen - theory) < (0.2 if theory == 8 else 0.1) * theory
straight = order(sizes, off[:3])
print(f"straight elements: order {straight:.2f}, theory 2; one catenary {off[3]:.0e} off")
assert abs(straight - 2) < 0.1
assert errors["Newton"][-1] < 1e-12 and off[3] < 1e-12
assert 1e-6 < errors["Newton, float32"][-1] < 1e-3
