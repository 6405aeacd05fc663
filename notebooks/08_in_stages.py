# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # In stages: how does the erection sequence affect the finished structure?
#
# Structures are built in stages. Elements are added to others that have already moved, they are
# stressed, and temporary elements are removed again. A phase can add and remove elements (element
# birth and death). An added element is unstressed between the positions that its ends have then;
# the forces of a removed element are ramped down to zero. Everything else in an analysis, gradients
# included, is as before.
#
# The first run takes up to 7 minutes on two cores, most of them to compile; the next one, less.
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/jaxcable/jaxcable/blob/main/notebooks/08_in_stages.ipynb)

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

# %% [markdown]
# ## Two spans, one after the other
#
# A beam over two spans has a moment of q L² / 8 over its middle support. Here the first span
# already carries its own weight when the second one is joined rigidly to its deflected end. The
# weight of the first span then causes no moment over the support, and half of q L² / 8 is missing
# for good.

# %%
span, weight = 10.0, 8.0  # m, kN/m: moments come in kN m
section = jc.Section.rectangle(0.3, 0.6, jc.Elastic(30e6))  # kN/m2
nodes = np.linspace([0, 0, 0], [2 * span, 0, 0], 17)
links = np.column_stack([np.arange(16), np.arange(1, 17)])
beams = jc.Beams(links, section=section, weight=weight)
held = jc.restrained([0], "xyz", "x") + jc.restrained([8, 16], "yz", "x")
beam = jc.Structure(nodes, beams, supports=held)
second = jc.only(np.arange(8, 16))
one_by_one = jc.solve(beam, [jc.Phase(loads=jc.SelfWeight()), jc.Phase(adds=second)])
at_once = jc.solve(beam, [jc.Phase(loads=jc.SelfWeight()), jc.Phase()])


def over_the_support(solution):
    jc.raise_if_failed(solution)
    return float(solution.section_forces[7, -1, 4])


for name, solution in (("at once", at_once), ("one by one", one_by_one)):
    share = weight * span**2 / over_the_support(solution)
    print(f"{name:10s} {over_the_support(solution):6.2f} kN m = q L² / {share:.2f}")

# %% [markdown]
# ## A suspension footbridge
#
# First the cables hang freely. Then segments of the deck are hung from the middle outward, and the
# cables change their shape at every stage. Because of the hump at the quarter points, the joints
# between segments stay open. Last, the girder is joined, unstressed in the shape that it has then,
# and the planks are laid.

# %%
bridge, phases = jc.scenes.suspension_footbridge(8)
names = ["cables", "middle", *(f"segments {k}" for k in (2, 3, 4)), "girder joined", "planks"]
erected = jc.solve(bridge, phases)
jc.raise_if_failed(erected)
jc.plots.sequence(erected, structure=bridge, names=names)

# %% [markdown]
# What if the girder were joined first, and the deck hung on it? The phases have another order,
# which is data: nothing is compiled again. The girder then bends while the cables change their
# shape. The final state is the same, because all laws are elastic and the girder is straight and
# unstressed when it is joined in both sequences. But moments during erection are larger.

# %%
first, *hung, girder, planks = phases
early = jc.solve(bridge, [first, girder, *hung, planks])
jc.raise_if_failed(early)


def largest(solution):
    """Largest moment of the girder at the end of every phase, kN m."""
    found = [phase.section_forces["girder"][..., 4] for phase in solution.phases]
    return np.array([float(jnp.abs(m).max()) / 1e3 for m in found])


figure, axes = plt.subplots(figsize=(7, 3))
stages = np.arange(1, len(phases) + 1)
axes.plot(stages, largest(erected), "o-", label="girder joined when all hangs")
axes.plot(stages, largest(early), "s--", label="girder joined first")
axes.set(xlabel="phase", ylabel="largest moment of the girder, kN m", ylim=(-5, 110))
axes.grid(color="0.9")
axes.legend()
plt.show()
print("largest on the way, kN m:", largest(erected).round(1).max(), largest(early).round(1).max())
apart = np.abs(np.asarray(erected.positions) - np.asarray(early.positions)).max()
print(f"last states are {apart:.1e} m apart")

# %% [markdown]
# The moments in the second sequence, all in one scale, drawn on the side that is in tension:

# %%
jc.plots.sequence(
    early, structure=bridge, names=[names[0], names[-2], *names[1:-2], names[-1]], diagram="My"
)

# %% [markdown]
# ## A roof that is lifted
#
# A tension ring hangs 12 m below its final position, and jacks lift it by shortening the upper
# spokes. Then the lower spokes are added and shortened to their final lengths: this stresses the
# wheel.

# %%
roof, lifting = jc.scenes.roof_ring(24)
lifted = jc.solve(roof, lifting)
jc.raise_if_failed(lifted)
names = ["hung", *(f"lift {k}" for k in (1, 2, 3, 4)), "lower spokes", "stressed", "load"]
jc.plots.sequence(lifted, structure=roof, view="elevation", names=names, supports=False)

# %%
for name, phase in zip(names, lifted.phases, strict=True):
    hub, upper, lower = phase.positions[-1, 2], phase.tension["upper"][0], phase.tension["lower"][0]
    print(f"{name:13s} hub at {hub:7.3f} m, spokes {upper / 1e3:7.1f} and {lower / 1e3:6.1f} kN")

# %% [markdown]
# ## Lengths that meet targets
#
# Under its load the hub has moved down. Which lengths of the spokes bring it back to its level
# under the load, with 800 kN in the lower spokes? `design.tune` takes prestress inputs of any
# phases as unknowns, here one number each, and results of any phases as targets; derivatives go
# through all stages.

# %%
nothing = dict.fromkeys(roof.elements)
start = {key: jnp.mean(lifting[k].rest_length[key]) for k, key in ((0, "upper"), (6, "lower"))}
lifting[0] = jc.replace(lifting[0], rest_length={**nothing, "upper": start["upper"]})
lifting[6] = jc.replace(lifting[6], rest_length={**nothing, "lower": start["lower"]})
level = jc.design.Target("positions", 0.0, at=(-1, 2), within=1e-3)
force = jc.design.Target("tension", 800e3, at=0, on="lower", within=1e3)
unknowns = [(0, "rest_length"), (6, "rest_length")]
tuned = jc.design.tune(roof, lifting, unknowns, [level, force])
print(jc.describe(tuned.status), "in", int(tuned.steps), "steps")
for value, (_, before), key in zip(tuned.values, start.items(), ("upper", "lower"), strict=True):
    print(f"{key} spokes {1e3 * float(value[key] - before):+7.1f} mm")
print(f"hub at {1e3 * float(tuned.solution.positions[-1, 2]):.4f} mm,", end=" ")
print(f"lower spokes {float(tuned.solution.tension['lower'][0]) / 1e3:.3f} kN")
print("influence: mm and kN for each mm")
print(np.asarray(tuned.influence) * [[1.0], [1e-6]])

# %% [markdown]
# ## A thousand roofs
#
# Spokes are cut with errors. A batch of a thousand erections is one program: how do errors of up to
# 10 mm in the length of every spoke change forces and levels?

# %%
errors = np.random.default_rng(1).uniform(-10e-3, 10e-3, (1000, 2, 24))


def built(error):
    """Analyse the roof with spokes that are too long by `error`, [2, 24], m."""
    late = jc.Phase(shortening={**nothing, "upper": -error[0], "lower": -error[1]})
    solution = jc.solve(roof, [*tuned.phases[:-1], late, tuned.phases[-1]])
    return solution.tension["lower"], solution.positions[-24:, 2], solution.status


forces, heights, codes = jc.batched(built)(errors)
figure, axes = plt.subplots(1, 2, figsize=(8, 3))
axes[0].hist(np.asarray(forces).ravel() / 1e3, bins=40)
axes[0].set(xlabel="force of a lower spoke, kN", ylabel="spokes of 24 000")
axes[1].hist(1e3 * np.ptp(np.asarray(heights), axis=1), bins=40)
axes[1].set(xlabel="hub out of level, mm", ylabel="roofs of 1 000")
for each in axes:
    each.grid(color="0.9")
    each.set_axisbelow(True)
figure.tight_layout()
plt.show()

# %% [markdown]
# Checks: the locked-in moment is compared with a hand calculation; the tuned lengths meet their
# targets; every one of the thousand analyses has converged.

# %%
by_hand = weight * span**2 / 16
assert abs(over_the_support(one_by_one) - by_hand) < 1e-3  # kN m: spans are curved by their weight
assert all(bool(met) for met in tuned.met) and int(tuned.status) == 0
assert not np.asarray(codes).any()
