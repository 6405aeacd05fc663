# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # An overhead line: which tower should be higher, and what is the ruling span worth?
#
# A section of six spans in hilly country is strung with the conductor Drake. Its states of heat,
# ice, wind and a broken conductor are solved with all strings and spans, exactly. Beside them are
# the usual shortcuts: the ruling span, the parabola, the catenary with one strain. In the end the
# derivatives of the clearance say which towers to raise.
#
# The first run takes up to 2 minutes on two cores, most of them to trace; the next one, less.
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/jaxcable/jaxcable/blob/main/notebooks/09_overhead_line.ipynb)

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

import jaxcable as jc

# %% [markdown]
# ## The section
#
# Heights are those of the attachments above the ground; at the fifth tower the line turns by 4
# degrees.

# %%
section = jc.lines.LineSection(
    jc.catalogue.conductor("Drake"),
    station=[0.0, 300.0, 640.0, 900.0, 1250.0, 1500.0, 1800.0],  # m
    ground=[100.0, 112.0, 131.0, 108.0, 99.0, 121.0, 110.0],
    height=[23.0, 27.0, 25.0, 28.0, 25.0, 25.0, 23.0],
    kinds=["strain", *["suspension"] * 5, "strain"],
    angle=[0.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0],  # degrees
    string_length=2.5,
    string_weight=900.0,  # N
    profile=[[0, 100], [150, 105], [300, 112], [480, 126], [640, 131], [900, 108], [1100, 97],
             [1250, 99], [1500, 121], [1650, 119], [1800, 110]],
)  # fmt: skip
State = jc.lines.LineState
states = {
    "everyday": State(15.0),
    "heavy ice": State(-5.0, ice=0.02),
    "hot": State(75.0, condition="final"),
    "uneven ice": State(-5.0, ice=[0.0, 0.02, 0.02, 0.0, 0.0, 0.02], condition="final"),
    "oblique storm": State(5.0, wind=600.0, wind_direction=60.0, condition="final"),
    "span 3 broken": State(5.0, condition="final", broken=2),
}
strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
left = jc.lines.stretch(section, strung, {"ice": states["heavy ice"]}, creep=states["everyday"])
found = jc.lines.analyse(section, strung, states, permanent=left)
assert not found.status.any()
print("permanent stretch, mm/m: aluminum", np.round(1e3 * left[:, 0], 2))
for name, level, clear in zip(found.names, found.horizontal, found.clearance, strict=True):
    print(f"{name:14s}", *(f"{x / 1e3:6.2f}" for x in level), f"kN  {np.nanmin(clear):6.2f} m")
jc.lines.plot_profile(section, found)

# %% [markdown]
# The hot conductor has stretched for good: under its own heaviest ice in every span, or in ten
# years of creep, whichever is more. When span 3 breaks, the strings beside it swing up, and the
# next spans sag.
#
# ## The ruling span
#
# One horizontal tension for all spans, that of an equivalent span: how far are its sags off?

# %%
ruling = jc.lines.ruling_span(section, strung, states, found, permanent=left)
print(f"ruling span {section.ruling_spans()[0]:.1f} m; errors of sags, mm")
for name, error in zip(found.names, ruling.sag_error, strict=True):
    print(f"{name:14s}", *(f"{x:6.0f}" for x in np.round(1e3 * error) + 0.0))

# %% [markdown]
# Uneven ice and a broken conductor have no ruling span at all, and an oblique wind presses down on
# spans that rise with it, which a level span does not.
#
# ## Parabola, catenary, elastic catenary
#
# Over the ruling span, strung to a sixth of the rated strength at 15 degrees:

# %%
span = section.ruling_spans()[0]
limit = {"everyday": float(section.conductor.strength) / 6}
simple = {name: states[name] for name in ("everyday", "heavy ice", "hot")}
table = jc.lines.sag_tension(
    section.conductor, span, simple, limit, stretched_by=["heavy ice"], creep="everyday"
)
print("sag after stretch, m: exact, parabola, catenary with one strain")
for name, *sags in zip(
    table.names, table.sag[:, 1], table.parabola[:, 1, 0], table.catenary[:, 1, 0], strict=True
):
    print(f"{name:10s}", *(f"{x:8.3f}" for x in sags))

# %% [markdown]
# ## Which tower should be higher?
#
# The least clearance of the hot line shall be 12 m. Its derivatives by the heights of all towers,
# where the section is strung anew each time, tell what a meter of each tower gives. The shortest
# change of heights that closes the gap is along them; two or three such steps do.

# %%
hot = {"hot": State(75.0)}


def least_clearance(height):
    """Return the least height of the hot, new conductor above the ground, m."""
    higher = jc.replace(section, height=height)
    new = jc.lines.string(higher, parameter=1500.0, temperature=15.0)
    results = jc.lines.analyse(higher, new, hot)
    return jnp.min(results.clearance), results.clearance[0]


heights = jnp.asarray(section.height)
for _ in range(4):
    (least, spans), slope = jax.value_and_grad(least_clearance, has_aux=True)(heights)
    where = int(np.argmin(spans)) + 1
    print(f"{least:.3f} m, span {where}; m per m", *(f"{x:.2f}" for x in np.round(slope, 2) + 0.0))
    if least > 12.0 - 1e-3:
        break
    heights = heights + (12.0 - least) * slope / jnp.sum(slope**2)
print("raised by, m:", *(f"{x:.2f}" for x in np.round(heights - section.height, 2) + 0.0))
assert abs(float(least) - 12.0) < 1e-3
