# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # In motion: how far does a guyed mast swing in gusts, and what if a guy breaks?
#
# A mast of 90 m stands in turbulent wind. Its natural modes tell how it vibrates; with the spectrum
# of the wind they give standard deviations and peaks. Histories in time have to agree with these,
# and they go on where modes end: a guy breaks, others go slack and taut. Last, a damper is chosen
# by the gradient of what is left of a swing, taken through all steps of the motion.
#
# The first run takes up to 3 minutes on two cores; the next one, less.
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/jaxcable/jaxcable/blob/main/notebooks/10_motion.ipynb)

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
import matplotlib.pyplot as plt
import numpy as np

import jaxcable as jc

# %% [markdown]
# ## The mast in the mean wind
#
# A tube with guys at three levels, prestressed under its weight, given by its stiffnesses. The wind
# has 28 m/s at 10 m and grows with the height. Vibrations start from the state in the mean wind.

# %%
mast, (prestress, _) = jc.scenes.guyed_mast(90.0, 3, per_level=4, pretension=60e3)
area, inertia = 10.99e-3, 217.3e-6  # m2, m4: the tube 406.4 x 8.8 mm, elastic
stiffness = {"EA": 210e9 * area, "EIy": 210e9 * inertia, "EIz": 210e9 * inertia}
tube = jc.Section.linear(**stiffness, GJ=2 * 81e9 * inertia)
parts = mast.elements
parts = {**parts, "mast": jc.replace(parts["mast"], section=tube)}
mast = jc.replace(mast, elements=parts)
top, middle = 12, 6
profile = jc.WindPowerLaw(velocity=28.0, exponent=0.16)
blown = jc.WindLoads((1.0, 0.0, 0.0), profile, drag=0.9, diameter=0.4064, on="mast")
still = jc.solve(mast, prestress)
windy = jc.solve(mast, jc.Phase(loads=blown), start=still)
jc.raise_if_failed(windy)
mean = windy.load - still.load
shift = windy.displacement[top, 0] - still.displacement[top, 0]
print(f"mean wind {mean[:, 0].sum() / 1e3:.1f} kN, the top moves by {1e3 * shift:.0f} mm")
print("guys, kN:", (windy.tension["guys"] / 1e3).round(1))

# %% [markdown]
# ## Modes
#
# Masses are those of the weights. Modes across and along the wind nearly coincide, as the guys make
# three equal angles; seen from the side, those across the wind look straight.

# %%
modes = jc.dynamics.modes(mast, windy, n=20)
jc.raise_if_failed(modes)
print(modes.frequency[:8].round(2), "Hz")
jc.plots.mode_shapes(modes, windy, structure=mast, view="elevation")

# %% [markdown]
# ## Gusts, by modes and in time
#
# The same turbulence twice: the spectral response of 20 modes, and two histories of three minutes
# drawn from random keys, of which the first half minute is left out.

# %%
wind = jc.dynamics.Turbulence(profile, deviation=4.5, length_scale=110.0)
ratio = 0.02
gust = jc.dynamics.gust_response(mast, windy, modes, mean, wind, damping=ratio, duration=150.0)
damping = jc.dynamics.Rayleigh.from_ratios((modes.frequency[0], ratio), (modes.frequency[5], ratio))
times = {"start": windy, "dt": 0.05, "steps": 3_600, "damping": damping}


def swinging(key):
    """Displacement of the top and the middle, and forces of guys, in gusts from a key."""
    options = {"dt": times["dt"], "steps": times["steps"], "key": key}
    forces = jc.dynamics.wind_forces(wind, windy.positions, mean, **options)
    moved = jc.dynamics.transient(mast, forces, **times, nodes=[middle, top])
    return moved.displacement[..., 0], moved.tension["guys"], moved.status


histories = [swinging(key) for key in jax.random.split(jax.random.key(7), 2)]
away, forces, codes = (np.stack(part) for part in zip(*histories, strict=True))
late = slice(600, None)
measured = away[:, late].std(axis=(0, 1))
expected = np.asarray(gust.displacement)[[middle, top], 0]
for name, one, other in zip(("middle", "top"), expected, measured, strict=True):
    print(f"{name:6s} standard deviation {1e3 * one:.1f} mm by modes, {1e3 * other:.1f} mm in time")
peak = np.abs(away[:, late, 1] - float(windy.displacement[top, 0])).max(axis=1)
highest = 1e3 * float(gust.displacement_peak[top, 0])
print(f"peaks of the top {(1e3 * peak).round(0)} mm, {highest:.0f} mm expected by modes")

# %%
figure, axes = plt.subplots(figsize=(8, 3))
seconds = times["dt"] * np.arange(times["steps"] + 1)
axes.plot(seconds, 1e3 * (away[0, :, 1] - away[0, 0, 1]), linewidth=0.8)
for sign in (-1, 1):
    axes.axhline(sign * highest, color="0.5", linestyle="--")
axes.set(xlabel="time, s", ylabel="top beyond the mean, mm", xlim=(0, 180))
axes.grid(color="0.9")
plt.show()

# %% [markdown]
# ## A guy breaks
#
# The uppermost guy into the wind breaks. Dynamic factors say how far forces swing beyond their
# static change; NaN stands for the guy that is gone.

# %%
broken = jc.dynamics.Removal({"guys": jc.only([6])}, time=1.0)
event = {"start": windy, "dt": 0.01, "steps": 500, "spectral_radius": 0.9, "damping": damping}
fallen = jc.dynamics.transient(mast, removes=broken, **event)
jc.raise_if_failed(fallen)
after = jc.solve(mast, jc.Phase(removes={"guys": jc.only([6])}), start=windy)
jc.raise_if_failed(after)
factors = jc.dynamics.dynamic_factors(fallen, windy, after)
print("factors of the guys", factors["guys"].round(2))
table = jc.report(mast, windy, motion=fallen).tables["motion_forces"]
for row in table.rows:
    if row[0] == "guys" and row[1] != 6:
        start, low, high = (row[k] / 1e3 for k in (4, 5, 7))
        print(f"guy {row[1]}: {start:5.1f} kN, then from {low:5.1f} to {high:5.1f} kN")
jc.plots.motion(fallen, nodes=[middle, top], direction="x", elements=[3, 7, 8], group="guys")

# %% [markdown]
# ## Which damper at the top?
#
# A gust front passes, and the mast swings on. How far does a damper between its middle and the
# ground lower this swing, the root of the mean square of the movement over six seconds? The
# gradient, which goes through all steps, says at each damper what a little more of it is worth.


# %%
def front(time):
    """Forces of a front of two seconds, N: half of the mean wind on top of it."""
    return 0.5 * jax.numpy.where(time < 2.0, jax.numpy.sin(np.pi * time / 2.0), 0.0) * mean


short = {"start": windy, "dt": 0.025, "steps": 320, "nodes": [middle]}


def swing(coefficient):
    """Root of the mean square of the movement of the middle after the front, mm."""
    damper = jc.dynamics.Dashpots([middle], coefficient)
    moved = jc.dynamics.transient(mast, front, **short, damping=[damping, damper])
    away = moved.displacement[80:, 0, 0] - windy.displacement[middle, 0]
    return 1e3 * jax.numpy.sqrt((away**2).mean())


coefficients = np.array([0.0, 1e3, 2e3, 4e3])  # N s/m
found = np.array([jax.value_and_grad(swing)(c) for c in coefficients])
for c, (value, slope) in zip(coefficients, found, strict=True):
    print(f"{c / 1e3:4.1f} kN s/m: {value:6.2f} mm, {1e3 * slope:+.3f} mm per kN s/m")

# %% [markdown]
# Checks: all histories have converged; standard deviations in time and by modes agree within the
# scatter of two histories; the gradient is the difference quotient.

# %%
assert not codes.any() and int(fallen.status) == 0
assert np.abs(measured / expected - 1).max() < 0.15
difference = (swing(1.01e3) - swing(0.99e3)) / 20.0
assert abs(found[1, 1] / difference - 1) < 1e-4
