# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Sections and a guyed mast: when does steel yield, and how much more can it carry?
#
# Beams have fibre sections: a cross-section is a mesh of small areas, each with the uniaxial law of
# its material. Section forces are sums over fibres, so that yielding needs no formulas, only the
# stress-strain curve of the steel. Here a section is loaded beyond yielding and checked by closed
# forms; then a mast of such a section stands in the wind.
#
# The first run takes up to 4 minutes on two cores, most of them to compile; the next one, less.
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/jaxcable/jaxcable/blob/main/notebooks/04_sections_and_mast.ipynb)

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
# ## Laws
#
# A law is a polygon through points (strain, stress in Pa). This one is elastic and ideally plastic,
# with failure at a strain of 5 %. `jc.materials.steel` has the bilinear curve of Eurocode 3 with
# some hardening and elastic unloading, `strand` that of prestressing steel, each with the source of
# its numbers.

# %%
E, fy, ultimate = 210e9, 355e6, 0.05
ey = fy / E
ideal = jc.Polygonal([-ultimate, -ey, 0.0, ey, ultimate], [-fy, -fy, 0.0, fy, fy])
hardening = jc.materials.steel(fy)
strand = jc.materials.strand()
strain = jnp.array([0.5 * ey, 2 * ey, 0.02])
for name, law in (("ideal", ideal), ("steel", hardening), ("strand", strand)):
    print(f"{name:7s}", "  ".join(f"{s / 1e6:6.1f} MPa" for s in law.stress_at(strain)))

# %% [markdown]
# A curve ends: beyond its last point the material has failed. An analysis then ends with a failure
# status; it does not extrapolate the stress.
#
# ## A section
#
# A rectangle of 100 x 200 mm, 2 x 40 fibres. Its plastic forces follow from textbook formulas; its
# initial stiffness is a sum over fibres.

# %%
b, h = 0.1, 0.2  # m
section = jc.Section.rectangle(b, h, ideal, shape=(2, 40))
first_yield = 2 * ey / h  # curvature, 1/m
N_pl, M_el, M_pl = fy * b * h, fy * b * h**2 / 6, fy * b * h**2 / 4

print(f"plastic forces: N {N_pl / 1e6:.2f} MN, M {M_pl / 1e3:.1f} kN m (elastic {M_el / 1e3:.1f})")
print(f"EI {section.stiffness()[1, 1] / 1e6:.3f} MN m2, exact {E * b * h**3 / 12 / 1e6:.3f}")

# %% [markdown]
# ## Strains from forces
#
# `forces` gives $N$, $M_y$, $M_z$ from the strain at the axis and the curvatures; `strains` is the
# inverse. It iterates and returns a status, because forces can exceed the capacity of a section.
# Here: 40 % of the plastic axial force, with 80 % and with 90 % of the plastic moment.

# %%
state = section.strains(N=0.4 * N_pl, My=0.8 * M_pl, Mz=0.0)
e0, ky, kz = state.strain
print(f"{jc.describe(state.status)} in {state.steps} steps")
print(
    f"axial strain {1e3 * e0:.3f} per mille, curvature {ky / first_yield:.2f} x that of first yield"
)
print(f"with 0.9 M: {jc.describe(section.strains(N=0.4 * N_pl, My=0.9 * M_pl, Mz=0.0).status)}")

# %%
jc.plots.section(section, section.fibre_stress(e0, ky, kz))

# %% [markdown]
# ## Moment and curvature
#
# For the ideally plastic rectangle the curve is known: $M = EI\,\kappa$ up to first yield at
# $\kappa_y = 2 f_y / (E h)$, then
#
# $$ M = M_{pl} \left( 1 - \frac{1}{3} \Big( \frac{\kappa_y}{\kappa} \Big)^2 \right). $$

# %%
curvature = first_yield * jnp.linspace(0.0, 6.0, 61)
moment = section.forces(jnp.zeros(61), curvature, jnp.zeros(61))[1]
ratio = np.asarray(curvature) / first_yield
known = M_pl * np.where(ratio < 1, ratio / 1.5, 1 - 1 / (3 * np.maximum(ratio, 1) ** 2))
harder = jc.Section.rectangle(b, h, hardening, shape=(2, 40))
virgin = harder.initial_memory()  # history variables (plastic strains) before loading
moment_hardening = jax.vmap(lambda k: harder.forces(0.0, k, 0.0, virgin)[1])(curvature)
print(f"largest difference to the closed form: {np.abs(moment - known).max() / M_pl:.1e} of M_pl")

# %%
figure, axes = plt.subplots(figsize=(5, 3.2), dpi=120, layout="constrained")
axes.plot(ratio, known / 1e3, color="0.6", linewidth=4, label="closed form")
axes.plot(ratio, moment / 1e3, label="80 fibres, ideally plastic")
axes.plot(ratio, moment_hardening / 1e3, "--", label="80 fibres, hardening E/100")
axes.set(xlabel="curvature over that of first yield (-)", ylabel="moment (kN m)", ylim=(0, None))
axes.legend(frameon=False, loc="lower right")
axes.grid(color="0.9")

# %% [markdown]
# ## Axial force and moment together
#
# For each ratio of elongation to curvature, `interaction` increases both until the first fibre
# reaches the end of its curve. For this section the plastic interaction is $|M| / M_{pl} + (N /
# N_{pl})^2 = 1$.

# %%
N, My, _ = section.interaction(n_angle=4, n_axial=61)
n, m = np.asarray(N[:, 0]) / N_pl, np.asarray(My[:, 0]) / M_pl
print(f"largest difference to the closed form: {np.abs(m + n**2 - 1).max():.1e}")

figure, axes = plt.subplots(figsize=(4.2, 3.2), dpi=120, layout="constrained")
axes.plot(n, 1 - n**2, color="0.6", linewidth=4, label="closed form")
axes.plot(n, m, ".", label="80 fibres")
axes.plot(0.4, 0.8, "s", label="above: carried")
axes.plot(0.4, 0.9, "x", label="above: not carried")
axes.set(xlabel="N / N_pl (-)", ylabel="M / M_pl (-)")
axes.legend(frameon=False, loc="lower center")
axes.grid(color="0.9")

# %% [markdown]
# ## How many fibres?
#
# Quantities with closed forms: the bending stiffness of the rectangle, $E b h^3 / 12$, and of a
# disc, $E \pi d^4 / 64$, and the plastic moment of the disc, $f_y d^3 / 6$. (The last one needs a
# law that yields at a very small strain; otherwise the remaining elastic core adds an error.) The
# errors of the stiffness are proportional to the square of the fibre size; with ten fibres across
# they are about 1 %.

# %%
d, rigid = 0.2, jc.Polygonal([-0.05, -1e-6, 0.0, 1e-6, 0.05], [-fy, -fy, 0.0, fy, fy])
counts, errors = (4, 8, 16, 32), {"EI, rectangle": [], "EI, disc": [], "plastic moment, disc": []}
for k in counts:
    rectangle = jc.Section.rectangle(b, h, ideal, shape=(1, k))
    disc = jc.Section.disc(d, rigid, shape=(k, k))
    values = (
        float(rectangle.stiffness()[1, 1]) / (E * b * h**3 / 12),
        float(disc.stiffness()[1, 1]) / (1e6 * fy * np.pi * d**4 / 64),
        float(disc.forces(0.0, 0.4, 0.0)[1]) / (fy * d**3 / 6),
    )
    for series, value in zip(errors.values(), values):
        series.append(abs(value - 1))

# %%
jc.plots.convergence(
    counts, errors, counts=True, xlabel="fibres across (-)", ylabel="relative error (-)"
)

# %% [markdown]
# ## A guyed mast
#
# A tube of 406.4 x 8.8 mm, 40 m high and clamped at its foot, with three guys at half height and
# three at the top. Phase 1 adds the weight and tensions the guys; phase 2 adds wind along $x$, 2.5
# kN/m at the top. The two groups of elements are a dict, and results are dicts with the same keys.

# %%
law = jc.materials.steel(fy, unloading="reversible")  # the wind only grows here


FINE, TOP = 8, 16  # elements between two levels of guys; node at the top


def mast(wind, per_level=FINE):
    return jc.scenes.guyed_mast(
        height=40.0, levels=2, per_level=per_level, increments=(2, 6), wind=wind, law=law
    )


structure, phases = mast(2500.0)
solution = jc.solve(structure, phases)
jc.raise_if_failed(solution)
print(f"top moves {1e3 * solution.displacement[TOP, 0]:.1f} mm")
print("guys (kN):", np.round(solution.tension["guys"] / 1e3, 1))

# %%
jc.plots.net(solution, structure=structure, magnify=20.0)

# %% [markdown]
# ## Stresses
#
# `fibre_stress` gives the stress of every fibre, at every integration point of every element, in
# every increment of a phase. The picture shows the section with the largest stress.

# %%
stress = jc.fibre_stress(structure, solution.phases[1])["mast"]  # [n_inc, n_elem, n_point, n_fibre]
largest = np.abs(stress).max(axis=(1, 2, 3))
for factor, value in zip(solution.phases[1].path.load_factor, largest):
    print(f"load factor {factor:.2f}: {value / 1e6:5.1f} MPa")
element, point = np.unravel_index(np.abs(stress[-1]).max(axis=-1).argmax(), stress.shape[1:3])
low, high = structure.nodes[structure.elements["mast"].links.array[element], 2]
print(f"the largest stress is between {low:.1f} and {high:.1f} m of height")

# %%
tube = structure.elements["mast"].section
jc.plots.section(tube, stress[-1, element, point])

# %% [markdown]
# ## How fine a mesh?
#
# Deflections converge fast. Stresses and moments need more elements: they have kinks at the guys,
# and a coarse mesh can miss the place where they are largest.

# %%
print("elements a level   top (mm)   largest stress (MPa)   between (m)   foot moment (kN m)")
feet = []
for per_level in (2, 4, FINE, 2 * FINE):
    own, own_phases = mast(2500.0, per_level)
    found = jc.solve(own, own_phases)
    jc.raise_if_failed(found)
    worst = np.abs(jc.fibre_stress(own, found.phases[1])["mast"][-1]).max(axis=(1, 2))
    where = own.nodes[own.elements["mast"].links.array[worst.argmax()], 2]
    feet.append(float(np.linalg.norm(np.asarray(found.reaction_moments)[0])))
    print(
        f"{per_level:16d} {1e3 * found.displacement[2 * per_level, 0]:10.2f} "
        f"{worst.max() / 1e6:22.1f}   {where[0]:4.1f} to {where[1]:4.1f} {feet[-1] / 1e3:20.2f}"
    )

# %% [markdown]
# ## How much more wind?
#
# Numbers can change without a new compilation. With more wind guys go slack one after the other,
# the top moves more than in proportion, and at 11 kN/m the first fibre yields (355 MPa).

# %%
for wind in (2500.0, 5000.0, 10000.0, 11000.0):
    stronger = jc.solve(*mast(wind))
    jc.raise_if_failed(stronger)
    largest = np.abs(jc.fibre_stress(structure, stronger.phases[1])["mast"][-1]).max()
    print(
        f"{wind / 1e3:4.1f} kN/m: {largest / 1e6:5.1f} MPa, "
        f"top moves {1e3 * stronger.displacement[TOP, 0]:5.1f} mm, "
        f"slack guys {stronger.phases[1].path.n_slack[-1]}, "
        f"greatest guy force {stronger.tension['guys'].max() / 1e3:.0f} kN"
    )

# %% [markdown]
# ## Reactions
#
# The report lists the reactions, moments included, and whether they are in equilibrium with the
# loads.

# %%
written = jc.report(structure, solution, phases)
print("\n".join(written.text().split("\n\n")[k] for k in (0, 1, 2)))

# %% [markdown]
# ## Check
#
# The section is compared with the closed forms above: its moment at three times the curvature of
# first yield is $1 - 1/27$ of the plastic moment, and errors fall at the expected orders. The mast
# is checked for equilibrium in NumPy: the sum of the wind is known without any analysis, and on the
# deformed mast the moments of loads and reactions about the foot add up to zero (except for the
# weight of the beams, which acts along them; this sum puts it at the nodes).

# %%
M3 = float(section.forces(0.0, 3 * first_yield, 0.0)[1])
print(f"M at 3 x yield curvature {M3 / M_pl:.5f}, closed form {1 - 1 / 27:.5f}")
orders = {name: np.log2(e[-2] / e[-1]) for name, e in errors.items()}
print({name: round(float(order), 2) for name, order in orders.items()})

z = np.linspace(0.0, 40.0, TOP + 1)[1:]  # nodes of the mast, m
share = np.append(np.ones(TOP - 1), 0.5) * 40.0 / TOP  # length that each stands for, m
blown = (2500.0 * (0.5 + 0.5 * z / 40.0) * share).sum()
held = np.asarray(solution.reactions)[:, 0].sum()
force = np.asarray(solution.reactions + solution.load)
arms = np.asarray(solution.positions)
about_foot = np.cross(arms, force).sum(axis=0) + np.asarray(solution.reaction_moments).sum(axis=0)
scale = np.abs(np.cross(arms, force)).sum()
print(f"wind {blown:.3f} N, reactions along x {held:.3f} N")
print(f"moments about the foot: {np.abs(about_foot).max() / scale:.1e} of all")

assert abs(M3 / M_pl - (1 - 1 / 27)) < 1e-3  # 40 layers: 1 / 1600 of the elastic core
assert np.abs(m + n**2 - 1).max() < 3e-3  # the curve ends at 5 %, not at infinity
assert abs(orders["EI, rectangle"] - 2) < 0.05 and abs(orders["EI, disc"] - 2) < 0.05
assert errors["plastic moment, disc"][-1] < 1e-6
assert abs(held / blown + 1) < 1e-9
assert np.abs(about_foot).max() < 1e-4 * scale
assert abs(feet[2] / feet[3] - 1) < 0.01  # the mesh is fine enough for the moment
