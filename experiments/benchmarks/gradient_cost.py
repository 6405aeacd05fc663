"""How long does the gradient of a two-phase analysis take, and how accurate is it?

Question   Time of value and derivative of one deflection with respect to all pretensions, beside
           the value alone and beside finite differences; and whether the derivative of the final
           state repeats increments or needs memory for them.
Reference  The gradient of the same net at tolerance 1e-13 with dense matrices; checked in turn by
           central differences with Richardson extrapolation, at tolerance 1e-13, for 12 pretensions
           (all of the flat net).
Error      Largest difference over the largest entry of the reference, -. Of finite differences over
           the same 12 pretensions, at the best of the steps tried.
Results    gradient_cost.txt and .png; a minute or two

Nets: `jaxcable.scenes.flat_net`, and `saddle` of 10 x 10 and 20 x 20 free nodes with 5 kN / (n + 1)
on each, no cable slack; two phases of one increment, where the analysis takes least time and the
gradient takes most in comparison. Default tolerance (1e-10). Times are wall milliseconds of jitted
functions, value and value-and-gradient alternating in one process, in both orders, each call
blocked on completion and with new pretensions (factors of matrices are cached by value). Ratios are
medians of the ratios of consecutive calls, with their quartiles. Compile: the first call minus the
median.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from record import Record

import jaxcable as jc
from jaxcable.spaces.dof_map import make_dof_map

from .measure import by_turns, clock, quartiles

TIGHT = {"tol": 1e-13, "linear_solver": "dense"}
STEPS = 10.0 ** -np.arange(1.0, 9.0)  # of finite differences, relative to the pretension
RICHARDSON = 1e-2  # of the reference, likewise; rounding makes 1e-3 up to ten times worse
CHOSEN = 12


def net(n, increments=1):
    """Structure, loading phase, observed node and mean pretension; the flat net for n = 2."""
    if n == 2:
        structure, (_, loading) = jc.scenes.flat_net(increments=(1, increments))
    else:
        load = 5000.0 / (n + 1)
        structure, (_, loading) = jc.scenes.saddle(n, n, load=load, increments=(1, increments))
    free = loading.loads.nodes.array
    return structure, loading, int(free[(n // 2) * n + n // 2]), 200.0 if n == 2 else 20e3


def deflection(n, increments=1, **options):
    """Deflection of the middle, jitted: value, and value with gradient; and all pretensions."""
    structure, loading, node, mean = net(n, increments)

    def value(T):
        solution = jc.solve(structure, [jc.Phase(pretension=T), loading], jc.Newton(**options))
        return solution.displacement[node, 2], solution.status

    count = len(structure.elements.links)
    T = jnp.asarray(mean * np.random.default_rng(0).uniform(0.9, 1.1, count))
    return jax.jit(value), jax.jit(jax.value_and_grad(value, has_aux=True)), T


def warm(programs, T, pairs):
    """Warm times of two functions of pretensions, ms, [pairs, 2]."""
    return by_turns(programs, pairs, lambda number: T * (1 + 1e-7 * number))


def default_solver(structure):
    """Name of the solver that this machine chooses."""
    fixed = structure.fixed(structure.supports)
    links = tuple((group.links, group.n_freedom, ()) for group in structure.groups)
    return make_dof_map(fixed, None, links).pattern.solver.name


def reference(n):
    """Tight gradient with dense matrices, chosen entries, and its error by differences."""
    single, both, T = deflection(n, **TIGHT)
    (_, status), gradient = both(T)
    assert int(status) == 0
    chosen = np.random.default_rng(1).choice(len(T), CHOSEN, replace=False)

    def central(k, h):
        ends = [single(T.at[k].add(sign * h)) for sign in (1, -1)]
        assert int(ends[0][1]) == int(ends[1][1]) == 0
        return float(ends[0][0] - ends[1][0]) / (2 * h)

    h = RICHARDSON * float(jnp.mean(T))
    extrapolated = np.array([(4 * central(k, h / 2) - central(k, h)) / 3 for k in chosen])
    gradient = np.asarray(gradient)
    error = np.abs(gradient[chosen] - extrapolated).max() / np.abs(gradient).max()
    return gradient, chosen, error


def difference_errors(single, T, chosen, gradient):
    """Errors of forward differences at all steps."""
    start, largest = float(single(T)[0]), np.abs(gradient).max()
    errors = []
    for step in STEPS:
        h = step * float(jnp.mean(T))
        found = [(float(single(T.at[k].add(h))[0]) - start) / h for k in chosen]
        errors.append(np.abs(found - gradient[chosen]).max() / largest)
    return np.array(errors)


def batched_differences(single, T):
    """Median time of all forward differences as one vmapped program, ms."""
    changes = jnp.vstack([jnp.zeros_like(T), 1e-5 * jnp.mean(T) * jnp.eye(len(T))])
    batch = jax.jit(jax.vmap(lambda change, T: single(T + change)[0], (0, None)))
    return 1e3 * np.median([clock(batch, changes, T * (1 + 1e-7 * k))[0] for k in range(8)][1:])


def costs(say, pairs):
    """The table of nets; returns what the picture needs."""
    say("\nvalue, and value with gradient by all pretensions (VG), two phases of one increment\n")
    say(
        f"{'unknowns':>8} {'cables':>6}  {'solver':8} {'compile, s':>12} {'value, ms':>19} "
        f"{'VG, ms':>19} {'VG / value':>18} {'differences / value':>20}\n"
        f"{'counted  in a batch':>118}"
    )
    curves, lines = {}, []
    for n, count in pairs.items():
        gradient, chosen, checked = reference(n)
        default = default_solver(net(n)[0])
        for solver in [None, *(["superlu"] if n == 20 and default != "superlu" else [])]:
            single, both, T = deflection(n, linear_solver=solver)
            name = solver or default
            first = [clock(function, T)[0] for function in (single, both)]
            times = warm((single, both), T, count)
            compiled = first - np.median(times, 0) / 1e3
            (_, status), own = both(T)
            assert int(status) == 0
            alone = np.median(times[:, 0])
            batch = f"{batched_differences(single, T) / alone:.1f}" if n < 20 else "-"
            say(
                f"{3 * n * n:8} {len(T):6}  {name:8} {compiled[0]:5.1f} {compiled[1]:6.1f} "
                f"{quartiles(times[:, 0]):>19} {quartiles(times[:, 1]):>19} "
                f"{quartiles(times[:, 1] / times[:, 0]):>18} {len(T) + 1:>9} {batch:>10}"
            )
            error = np.abs(np.asarray(own) - gradient).max() / np.abs(gradient).max()
            best = ""
            if solver is None:
                apart = difference_errors(single, T, chosen, gradient)
                curves[3 * n * n] = apart, error
                best = f"{apart.min():.1e} at {STEPS[apart.argmin()]:.0e}"
            lines.append(f"{3 * n * n:8}  {name:8} {error:10.1e} {best:>22} {checked:16.1e}")
    say(
        "\nThe first solver of a net is the default here. Differences: one analysis more than "
        "there are cables,\ncounted; in a batch: all in one vmapped call, measured.\n\n"
        "errors, relative to the largest entry of the reference\n\n"
        f"{'unknowns':>8}  {'solver':8} {'gradient':>10} {'differences, best step':>22} "
        f"{'reference itself':>16}"
    )
    say("\n".join(lines))
    return curves


def by_increments(say, pairs, counts):
    """The table of increments: time and memory, dense matrices."""
    say("\nincrements of the loading phase (dense matrices, so that no memory is the host's)\n")
    say(
        f"{'unknowns':>8} {'increments':>10} {'value, ms':>20} {'VG, ms':>20} {'VG - value':>11} "
        f"{'VG / value':>18} {'temporary memory, kB':>32}\n"
        f"{'value        VG      more':>136}"
    )
    for n in [n for n in pairs if n < 20]:
        for count in counts:
            *functions, T = deflection(n, count, linear_solver="dense")
            programs = [f.lower(T).compile() for f in functions]
            kB = [f.memory_analysis().temp_size_in_bytes / 1e3 for f in programs]
            times = warm(programs, T, pairs[n])
            more = np.median(times[:, 1] - times[:, 0])
            say(
                f"{3 * n * n:8} {count:10} {quartiles(times[:, 0]):>20} "
                f"{quartiles(times[:, 1]):>20} {more:11.2f} "
                f"{quartiles(times[:, 1] / times[:, 0]):>18} "
                f"{kB[0]:12.1f} {kB[1]:9.1f} {kB[1] - kB[0]:9.1f}"
            )


def draw(curves):
    eps = np.finfo(float).eps  # an error below it is shown as this
    figure, axes = plt.subplots(figsize=(7.5, 4), layout="constrained")
    for k, (unknowns, (errors, gradient)) in enumerate(curves.items()):
        axes.loglog(STEPS, errors, "o-", color=f"C{k}", label=f"differences, {unknowns} unknowns")
        axes.axhline(
            max(gradient, eps), ls="--", color=f"C{k}", label=f"gradient, {unknowns} unknowns"
        )
    axes.set_xlabel("step of the forward difference, relative to the pretension")
    axes.set_ylabel("error, relative to the largest entry")
    figure.legend(fontsize="small", ncols=3, loc="outside lower center")
    return figure


def run(cases, _):
    say = Record("gradient_cost")
    curves = costs(say, cases.gradients)
    by_increments(say, cases.gradients, cases.increments)
    say.close(draw(curves))
