# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Sections and a mast: what do laws given by points and fibre sections do?
#
# A steel tube yields fibre by fibre, and a mast of it moves with its guys. This notebook goes from
# the law of the material over the section to the mast, and checks the section against closed forms.

# %%
import jax

jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxcable as jc

# %% [markdown]
# ## The law: points of a stress-strain curve
#
# Any polygon through the origin will do. This one is ideal elastic-plastic steel, S355, up to 10 %
# strain. With `unloading="elastic"` it remembers its plastic strain: pulled beyond its yield strain
# and released, it returns along its first slope.

# %%
E, fy = 210e9, 355e6  # Pa
points = np.array([-0.1, -fy / E, 0.0, fy / E, 0.1])
law = jc.Polygonal(points, [-fy, -fy, 0.0, fy, fy], unloading="elastic")
remembered = law.settle(jnp.array(0.004), jnp.zeros(law.n_plastic))
for strain in (0.001, 0.004):
    virgin = law.stress_at(jnp.array(strain), jnp.zeros(law.n_plastic))
    print(f"strain {strain:.3f}: {virgin / 1e6:.0f} MPa")
released = law.stress_at(jnp.array(0.003), remembered)
print(f"back at 0.003 after 0.004: {released / 1e6:.0f} MPa")

# %% [markdown]
# ## The section: fibres
#
# Fibres divide the section; each has a place, an area and the law. Plane sections stay plane:
# $\varepsilon = e_0 + k_y z - k_z y$. Forces are sums over the fibres.

# %%
b, h = 0.10, 0.20  # m
section = jc.Section.rectangle(b, h, law, shape=(4, 40))
curvature = np.linspace(0.0, 12.0, 49) * fy / E / (h / 2)  # up to 12 times that of first yield
zero = jnp.zeros_like(curvature)
forces = jax.vmap(section.forces)(zero, jnp.asarray(curvature), zero)  # N, My, Mz
moment = np.asarray(forces[1])
elastic, plastic = fy * b * h**2 / 6, fy * b * h**2 / 4  # N m, by hand
print(f"largest moment {moment.max() / 1e3:.1f} kN m; plastic moment by hand {plastic / 1e3:.1f}")

# %%
_, axes = plt.subplots(figsize=(5, 3.2), dpi=110, layout="constrained")
axes.plot(curvature, moment / 1e3, label="fibres")
axes.axhline(elastic / 1e3, color="0.5", linestyle=":", label="first yield, by hand")
axes.axhline(plastic / 1e3, color="C1", linestyle="--", label="plastic moment, by hand")
axes.set(xlabel="curvature (1/m)", ylabel="moment (kN m)", ylim=(0, None))
axes.legend()
axes.grid(color="0.9")

# %% [markdown]
# ## How many fibres?
#
# Elastic: $M = E\,\frac{b h^3}{12}\,k$. Between first yield and full plasticity:
# $M = f_y b \left(\frac{h^2}{4} - \frac{1}{3}\left(\frac{f_y}{E k}\right)^2\right)$. The error of
# the fibre sum falls with the square of the size of the fibres; beyond yield it also depends on
# where in a fibre the yielding ends, and jumps.

# %%
first = fy / E / (h / 2)  # curvature of first yield
cases = {
    "elastic": (0.5 * first, E * b * h**3 / 12 * 0.5 * first),
    "yielding": (2.37 * first, fy * b * (h**2 / 4 - (fy / E / (2.37 * first)) ** 2 / 3)),
}
layers = np.array([8, 16, 32, 64, 128])
errors = {name: [] for name in cases}
for n in layers:
    rectangle = jc.Section.rectangle(b, h, law, shape=(1, int(n)))
    for name, (k, exact) in cases.items():
        errors[name].append(abs(float(rectangle.forces(0.0, k, 0.0)[1]) / exact - 1))
for name, values in errors.items():
    print(f"{name:9s}", *(f"{value:.1e}" for value in values))

# %%
jc.plots.convergence(
    layers, errors, counts=True, xlabel="layers (-)", ylabel="error of the moment (-)"
)

# %% [markdown]
# ## From forces to strains
#
# The other way round is an iteration with a status: beyond what the section bears there is none.

# %%
state = section.strains(N=500e3, My=50e3, Mz=0.0)
e0, ky, kz = state.strain
print(f"{jc.describe(state.status)}: e0 = {e0:.6f}, ky = {ky:.5f} 1/m")
stress = section.fibre_stress(e0, ky, kz, section.virgin())
print(jc.describe(section.strains(N=0.0, My=1.01 * plastic, Mz=0.0).status)[:48])
jc.plots.section(section, stress)

# %% [markdown]
# ## A guyed mast
#
# A tube 406.4 x 8.8 mm, 30 m high, clamped at its foot, with two levels of three guys. First its
# weight and the tension of the guys, then the wind, growing with the height.

# %%
structure, phases = jc.scenes.guyed_mast(height=30.0, levels=2, per_level=2, increments=(1, 4))
solution = jc.solve(structure, phases, progress=True)
jc.raise_if_failed(solution)
top = 4
print(f"the top moves by {1e3 * solution.phases[1].displacement[top, 0]:.1f} mm in the wind")
print(f"guys: {np.asarray(solution.tension['guys']).round(-2) / 1e3} kN")

# %%
jc.plots.net(solution, structure=structure, magnify=50.0)

# %% [markdown]
# ## Stresses along the path, and the report
#
# `jc.fibre_stress` gives the stress of every fibre at every increment. The most stressed fibre of
# the mast is far from yielding.

# %%
stresses = jc.fibre_stress(structure, solution.phases[1])[
    "mast"
]  # [n_inc, n_elem, n_point, n_fibre]
for factor, row in zip(solution.phases[1].path.load_factor, stresses):
    print(f"wind {factor:4.2f}: {row.min() / 1e6:7.1f} to {row.max() / 1e6:6.1f} MPa")

# %%
element, point = np.unravel_index(np.argmin(stresses[-1].min(axis=-1)), stresses.shape[1:3])
print(f"most pressed: element {element}, point {point}")
jc.plots.section(structure.elements["mast"].section, stresses[-1, element, point])

# %%
print(jc.report(structure, solution, phases).text(rows=6))

# %% [markdown]
# ## Checked
#
# The order of the fibre sum; the plastic moment of the rectangle; and the foot of the mast:
# its vertical reaction carries the weight and the pull of the guys, by statics.

# %%
order = np.log2(errors["elastic"][0] / errors["elastic"][1])
assert abs(order - 2) < 0.01, order
assert all(np.array(errors["yielding"]) < 1 / layers**2), errors
assert abs(moment.max() / plastic - 1) < 0.005  # 12 times the curvature of first yield
positions, guys = np.asarray(solution.positions), structure.elements["guys"]
pull = np.zeros(3)
for (foot, head), tension in zip(guys.links.array, solution.tension["guys"]):
    way = positions[foot] - positions[head]
    pull += tension * way / np.linalg.norm(way)
lengths = {key: np.asarray(value) for key, value in solution.rest_length.items()}
weight = float(np.sum(structure.elements["mast"].weight * lengths["mast"]))
weight += float(np.sum(guys.weight * lengths["guys"])) / 2  # the other half goes to the anchors
assert abs(float(solution.reactions[0, 2]) / (weight - pull[2]) - 1) < 1e-6
print(f"order {order:.2f}; vertical reaction {(weight - pull[2]) / 1e3:.3f} kN by statics")
