# ---
# jupyter:
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Optimal pretension: how little prestress does a net need under several load cases?
#
# Prestress makes a net stiff, and costs edge beams, anchors and strands. Here the forces of eight
# cables are chosen with exact gradients: first as a trade-off between deflection and prestress (by
# the default optimizer, and by Adam from optax), then for a specification: the least prestress with
# which deflections stay within a limit, no cable is nearly slack and none is overstressed.
#
# The first run takes up to 7 minutes on two cores, most of them to compile; the next one, less.
#
# [![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)](https://colab.research.google.com/github/jaxcable/jaxcable/blob/main/notebooks/03_pretension.ipynb)

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
import optax
from scipy import optimize

import jaxcable as jc

jc.fuse_loops()  # before jax computes anything: small nets are two to three times faster

# %% [markdown]
# ## Net and prestress
#
# A saddle of 10 x 10 m with four cables each way, strands of 100 mm². Every cable is tensioned by a
# jack and then anchored: `jacking` holds its force while the net finds its form, so that the eight
# parameters are the forces before any load. Parameters can be any pytree of arrays; here they are a
# dict.

# %%
n, spacing = 4, 2.0  # free nodes a side; m
EA, strength = 165e9 * 100e-6, 150e3  # N, N
structure, _ = jc.scenes.saddle(n, n, spacing=spacing, rise=0.1)
links = structure.elements.links.array  # 5 links a cable, those along x first
structure = jc.replace(structure, elements=jc.Cables(links, axial_stiffness=EA, strength=strength))


def prestress(T):  # T: {"x": [4], "y": [4]}, N
    return jc.Phase(jacking=jnp.repeat(jnp.concatenate([T["x"], T["y"]]), n + 1))


# %% [markdown]
# ## Load cases
#
# Load effects on a net cannot be superposed: every combination needs its own analysis. `combine`
# makes a batch of them from basic loads and factors, and `solve_cases` runs the batch from one
# prestressed state. Snow is per area of the plan, on the meshes that `net_faces` finds.

# %%
faces = jc.net_faces(structure.nodes, links, border="ends")
left = structure.nodes[faces, 0].mean(axis=1) < (n + 1) * spacing / 2
snow = jc.AreaLoads(faces, (0.0, 0.0, -750.0))  # N/m2
drift = jc.AreaLoads(faces[left], (0.0, 0.0, -750.0))
wind = jc.AreaLoads(faces, (0.0, 0.0, 500.0))
names = ("snow", "drifted snow", "wind")
factors = [[1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]]
cases = jc.Phase(loads=jc.combine({"snow": snow, "drift": drift, "wind": wind}, factors))

# %% [markdown]
# Three values are extremes over all cases: the largest deflection, the smallest margin of strain
# before a cable goes slack, and the largest share of the breaking force. The exact extreme
# has a kink where another node or cable becomes the worst one, and a kink stops a gradient method.
# So each is replaced by a smooth bound on the safe side.


# %%
def measure(T):
    solutions = jc.design.solve_cases(structure, [prestress(T)], cases)  # a leading axis [3]
    moved = jax.vmap(lambda one: jc.design.largest_deflection(one, width=2e-3))(solutions)
    values = {
        "deflection": jc.design.smooth_max(moved, 5e-4),  # m
        "strain": jc.design.slack_margin(structure, solutions, 2e-5),
        "use": jc.design.smooth_max(jc.design.utilization(structure, solutions.tension), 2e-3),
    }
    return values, solutions


look = jax.jit(measure)
start = {"x": jnp.full(n, 30e3), "y": jnp.full(n, 30e3)}


def show(T):
    values, solutions = look(T)
    jc.raise_if_failed(solutions)
    for name, u, tension in zip(
        names, solutions.phases[-1].displacement_in_phase, solutions.tension
    ):
        largest = jnp.linalg.norm(u, axis=1).max()
        print(
            f"{name:13s} moves {1e3 * largest:4.1f} mm, "
            f"tensions {tension.min() / 1e3:4.1f} to {tension.max() / 1e3:4.1f} kN"
        )
    print("smooth bounds:", {name: float(f"{value:.4g}") for name, value in values.items()})


show(start)

# %% [markdown]
# ## A trade-off between deflection and prestress
#
# The first optimization is for drifted snow, the case that moves the net most. The loss is the
# squared deflection, in units of 20 mm, plus the mean square of the forces, in units of 30 kN. A
# third term keeps cables from going slack: a slack cable has no stiffness, and the kink in the loss
# would stop any gradient method. The function returns the solution beside the value, so that the
# optimizer sees when the analysis fails at a trial point, never accepts such a point, and counts
# it.


# %%
def forces(T):
    return jnp.concatenate([T["x"], T["y"]])


drifted = jax.tree.map(lambda x: x[1], cases)  # the second of the batch


def loss(T):
    solution = jc.solve(structure, [prestress(T), drifted])
    stiff = (jc.design.largest_deflection(solution, width=2e-3) / 0.02) ** 2
    light = jnp.mean((forces(T) / 30e3) ** 2)
    margin = jc.design.slack_margin(structure, solution, 2e-5)
    near_slack = jnp.maximum(0.0, 1 - margin / 5e-4) ** 2
    return stiff + light + near_slack, solution


bounds = (8e3, 80e3)  # N
found = jc.minimize(loss, start, bounds=bounds)
jc.raise_if_failed(found)
print(f"{jc.describe(found.status)} after {found.steps} steps, {found.failures} failed trials")
print(f"loss {found.history.loss[0]:.5f} -> {found.loss:.5f}")
print("along x (kN):", np.round(found.params["x"] / 1e3, 2))
print("along y (kN):", np.round(found.params["y"] / 1e3, 2))

# %%
jc.plots.history(found, tol=1e-6)

# %% [markdown]
# The forces of the middle cables along $x$ are at the lower bound of 8 kN: for this loss they do
# more harm than good. The snow drift lies on the left, and the first cable along $y$ carries most
# of it.
#
# Any optax transformation can replace the default optimizer. Adam has no line search: its step size
# is chosen by hand (here 500 N), and it needs many more steps. `Design` has the best point of all.

# %%
adam = jc.minimize(loss, start, bounds=bounds, optimizer=optax.adam(500.0), steps=300)
print(f"{adam.steps} steps: {jc.describe(adam.status).split(':')[0]}")
print(f"loss {adam.loss:.5f}, above the default's by {adam.loss - found.loss:.1e}")

# %% [markdown]
# ## The least prestress that meets a specification
#
# Now all cases, and limits: 16 mm of deflection, a strain of $2 \cdot 10^{-4}$ (3.3 kN) above
# slackness, 45 % of the breaking force. A constraint is a number without units that must not be
# positive. The loss is the mean force. Limits that will be varied are arguments, so that nothing is
# compiled again.


# %%
def problem(T, limits):
    values, solutions = measure(T)
    constraints = jnp.stack(
        [
            values["deflection"] / limits["deflection"] - 1,
            1 - values["strain"] / limits["strain"],
            values["use"] / limits["use"] - 1,
        ]
    )
    return jnp.mean(forces(T)) / 30e3, constraints, solutions


limits = {"deflection": 0.016, "strain": 2e-4, "use": 0.45}
least = jc.design.minimize_subject_to(problem, start, bounds=bounds, args=(limits,))
jc.raise_if_failed(least)
print(f"{jc.describe(least.status)} after {least.evaluations} evaluations")
print(f"mean force {30 * least.loss:.4f} kN")
print("along x (kN):", np.round(least.params["x"] / 1e3, 2))
print("along y (kN):", np.round(least.params["y"] / 1e3, 2))
for name, c, m in zip(limits, least.constraints, least.multipliers):
    print(f"{name:11s} constraint {c:+.1e}, multiplier {m:.4f}")

# %% [markdown]
# The optimizer does not know that the loads are symmetric about $x$, and yet finds symmetric forces
# along $x$. The drift lies on the left, where the first cables along $y$ run.
#
# A limit with a positive multiplier governs, and the multiplier is its price. If the deflection may
# be 0.1 % larger, the mean force should fall by 0.1 % of the multiplier (times 30 kN).

# %%
wider = limits | {"deflection": 1.001 * limits["deflection"]}
relaxed = jc.design.minimize_subject_to(problem, least.params, bounds=bounds, args=(wider,))
jc.raise_if_failed(relaxed)
print(
    f"saved {3e4 * (least.loss - relaxed.loss):.2f} N, foretold {30 * least.multipliers[0]:.2f} N"
)

# %% [markdown]
# ## Was it worth it?
#
# The simple alternative is the same force in all cables. These are its largest deflections over all
# cases (the limit is 16 mm). Different forces do not only need less prestress: they also give the
# net another shape.

# %%
for T in (3e4 * float(least.loss), 30e3, 50e3, 80e3):
    values, solutions = look(jax.tree.map(lambda x, T=T: jnp.full_like(x, T), start))
    jc.raise_if_failed(solutions)
    print(f"{T / 1e3:5.1f} kN in all cables: {1e3 * values['deflection']:.1f} mm")

# %% [markdown]
# ## The result as a report
#
# With `cases`, the report has envelopes of forces and reactions over the load cases, and each
# extreme names its case.

# %%
values, after = look(least.params)
jc.raise_if_failed(after)
tensioned = jc.solve(structure, [prestress(least.params)])
jc.raise_if_failed(tensioned)
written = jc.report(structure, tensioned, cases=after, names=names)
print(written.text(rows=5))

# %%
loaded = jax.tree.map(lambda x: x[1], after)  # drifted snow
jc.plots.net(loaded, structure=structure)

# %% [markdown]
# ## Check without our derivatives
#
# The optimization above used SciPy's SLSQP with derivatives of jaxcable, and these also served to
# check the optimality conditions at its end. Here SLSQP gets values alone, and gradients come from
# finite differences. Central differences are needed, because the constraints are strongly curved
# (with respect to a force along $x$, that of the deflection has a first derivative of 0.06 and a
# second one of 170, in the units here). Forward differences with a step of $10^{-6}$ have errors of
# $10^{-4}$ in the gradient, central ones $10^{-8}$. With forward differences it is a matter of luck
# whether SLSQP converges, and it ends 0.02 mN above the optimum.


# %%
def constraints_of(x):  # x: forces in units of 30 kN, [8]; SLSQP wants them not negative
    values, _ = look({"x": 3e4 * jnp.asarray(x[:n]), "y": 3e4 * jnp.asarray(x[n:])})
    return np.array(
        [
            1 - float(values["deflection"]) / limits["deflection"],
            float(values["strain"]) / limits["strain"] - 1,
            1 - float(values["use"]) / limits["use"],
        ]
    )


other = optimize.minimize(
    np.mean,
    np.ones(2 * n),
    method="SLSQP",
    bounds=[(bounds[0] / 3e4, bounds[1] / 3e4)] * (2 * n),
    jac="3-point",  # of the constraints, too
    constraints={"type": "ineq", "fun": constraints_of},
    options={"ftol": 1e-10, "finite_diff_rel_step": 1e-6},
)
print(f"SLSQP: {other.message}; mean force {30 * other.fun:.4f} kN")
print(f"jaxcable: {30 * least.loss:.4f} kN")
assert other.success
assert abs(least.loss / other.fun - 1) < 1e-4
assert float(jnp.max(least.constraints)) <= 0
assert abs(float((least.loss - relaxed.loss) / (0.001 * least.multipliers[0])) - 1) < 0.1
