"""Which optimizer is best under constraints, and are the package's own ones still worth keeping?

Question   Six problems with constraints: loss, evaluations and seconds of `minimize_subject_to` by
           SLSQP, trust-constr and IPOPT, beside the method of multipliers around `minimize`, which
           the package had before. Five problems without constraints: `minimize` beside SciPy's
           L-BFGS-B, `fit` beside SciPy's `least_squares`.
Reference  Dome: least load path 282.93, found by SLSQP, from a publication unknown to us;
           its load path and moves are computed by NumPy in `tests/design/test_constrained.py`.
           Three bars: Schmit, Structural design by systematic synthesis (1960); its optimum is that
           of a quadratic. Ten bars: Haftka and Guerdal, Elements of Structural Optimization (1992),
           5060.85 lb. Rosen-Suzuki: Hock and Schittkowski, Test Examples for Nonlinear
           Programming Codes (1981), problem 43, -44. Cantilever and ropes: closed forms, below.
Error      Relative excess of the loss over the known one; largest constraint; KKT residual, by the
           package.
Command    python experiments/constrained.py  (IPOPT where ipyopt is installed)
           (writes experiments/results/constrained.txt and .json)

Seconds are those of a second call, once everything is compiled; a call ends after 60 s.
"""

import functools
import importlib.util
import json
import time

import jax
import jax.numpy as jnp
import numpy as np
from record import RESULTS, Record, write
from scipy import optimize

import jaxcable as jc
from jaxcable import design

LONGEST = 60.0  # s
SOLVERS = ["slsqp", "trust-constr"] + ["ipopt"] * bool(importlib.util.find_spec("ipyopt"))

# -- the dome: 36 sectors of 17 nodes, every second one turned by 5 degrees, and one at the top
RADII = [
    *(0.4094532382, 1.2866053251, 2.1539653883, 3.0049324491, 3.8330304886, 4.6319569318),
    *(5.3956314331, 6.1182416487, 6.7942881448, 7.4186262297, 7.9865039034, 8.4935996298),
    *(8.9360545930, 9.3104994604, 9.6140866750, 9.8445043726, 10.0),
]
WEIGHTS = [
    *(0.0063212865, 0.0194630295, 0.0320948745, 0.0437515438, 0.0540788543, 0.0627630029),
    *(0.0695401140, 0.0742042434, 0.0894614099, 0.0634711180, 0.0740678224, 0.0695800439),
    *(0.0629781070, 0.0544626020, 0.0442922987, 0.0293642938, 0.0178610674),
]
TOP = 0.0174674734  # weight of the top
# bars of a sector: (node, node, sectors further)
BARS = [
    *((0, 0, 1), (0, 1, 0), (0, 1, -1), (1, 1, 1), (1, 2, 1), (2, 1, 0), (2, 2, 1), (2, 3, 0)),
    *((3, 2, 1), (3, 3, 1), (3, 4, 1), (4, 3, 0), (4, 4, 1), (4, 5, 0), (5, 4, 1), (5, 5, 1)),
    *((5, 6, 1), (6, 5, 0), (6, 6, 1), (6, 7, 0), (7, 6, 1), (7, 7, 1), (7, 8, 1), (8, 10, 0)),
    *((8, 7, 0), (8, 8, 1), (8, 9, 1), (9, 8, 0), (9, 10, 0), (9, 11, 0), (10, 12, 0), (10, 9, 1)),
    *((10, 11, 1), (11, 10, 0), (11, 12, 0), (11, 13, 0), (12, 14, 0), (12, 11, 1), (12, 13, 1)),
    *((13, 12, 0), (13, 14, 0), (13, 15, 0), (14, 16, 0), (14, 13, 1), (14, 15, 1), (15, 14, 0)),
    *((15, 16, 0), (16, 15, 1), (16, 16, 1)),
]
NEAR = 0.1  # how far a node may move in plan, in each direction


def dome():
    """The structure, its loads, the group of every bar, and the plan of its free nodes."""
    turned = [np.radians(5 * (k % 2) * (1 if k < 8 else -1)) for k in range(17)]
    plan = [(0.0, 0.0)]
    for sector in range(36):
        for radius, angle in zip(RADII, turned, strict=True):
            angle = np.radians(10 * sector) + angle
            plan.append((radius * np.cos(angle), radius * np.sin(angle)))
    plan = np.array(plan)

    def node(sector, k):
        return 1 + 17 * (sector % 36) + k

    links = [
        pair
        for sector in range(36)
        for pair in [
            (node(sector, 0), 0),
            *((node(sector, a), node(sector + on, b)) for a, b, on in BARS),
        ]
    ]
    links = np.array(links)
    places = np.round(np.linalg.norm(plan[links].mean(axis=1), axis=1), 1)
    group = np.unique(places, return_inverse=True)[1]
    nodes = np.column_stack([plan, np.zeros(len(plan))])
    rim = np.arange(17, len(plan), 17)
    bars = jc.Bars(links, axial_stiffness=1e3)  # force densities need none
    structure = jc.Structure(nodes, bars, supports=jc.pinned(rim))
    force = np.zeros_like(nodes)
    force[:, 2] = -np.array([TOP, *(WEIGHTS * 36)])
    free = np.setdiff1d(np.arange(len(plan)), rim)
    return structure, jc.NodalLoads(free, force[free]), group, plan, free


STRUCTURE, LOADS, GROUP, PLAN, FREE = dome()
LINKS = STRUCTURE.elements.links


def dome_state(density):
    """Its load path, and how far the free nodes move in plan over what they may, [n, 2]."""
    x = jc.force_density(STRUCTURE, density[GROUP], LOADS)
    squared = jnp.sum((x[LINKS[:, 0]] - x[LINKS[:, 1]]) ** 2, axis=1)
    return jnp.sum(jnp.abs(density[GROUP]) * squared), (x[FREE, :2] - PLAN[FREE]) / NEAR


def dome_problem(density):
    path, moved = dome_state(density)
    return path, jnp.concatenate([(moved - 1).ravel(), (-moved - 1).ravel()])


# -- three bars: P = 2 kN, strength 2 kN/cm2, l = 100 cm; volume in cm3
def three_bars(area):
    a, b = area
    below = jnp.sqrt(2.0) * a**2 + 2 * a * b
    stress = [(jnp.sqrt(2.0) * a + b) / below, b / below, 1 / (a + jnp.sqrt(2.0) * b)]
    return 100 * (2 * jnp.sqrt(2.0) * a + b), jnp.array(stress) - 1  # 2 kN over 2 kN/cm2


# -- ten bars: two bays of 360 in, 1e5 lb at both lower nodes, 25 ksi, 2 in; weight in lb
TEN = [(5, 3), (3, 1), (6, 4), (4, 2), (4, 3), (2, 1), (5, 4), (6, 3), (3, 2), (4, 1)]
CORNERS = 360.0 * np.array([(2, 1), (2, 0), (1, 1), (1, 0), (0, 1), (0, 0)])
_ENDS = np.array(TEN) - 1
_ALONG = CORNERS[_ENDS[:, 1]] - CORNERS[_ENDS[:, 0]]
LENGTHS = np.linalg.norm(_ALONG, axis=1)
RATES = np.zeros((10, 12))  # change of the length of a bar with displacements
for bar, (start, end) in enumerate(_ENDS):
    RATES[bar, 2 * end : 2 * end + 2] = _ALONG[bar] / LENGTHS[bar]
    RATES[bar, 2 * start : 2 * start + 2] = -_ALONG[bar] / LENGTHS[bar]
RATES = RATES[:, :8]
DOWN = np.array([0.0, 0, 0, -1e5, 0, 0, 0, -1e5])


def ten_bars(area):
    stiffness = RATES.T @ ((1e7 * area / LENGTHS)[:, None] * RATES)
    moved = jnp.linalg.solve(stiffness, DOWN)
    stress = 1e7 / LENGTHS * (RATES @ moved)
    limits = jnp.concatenate([stress / 25e3, moved / 2.0])
    return 0.1 * (area @ LENGTHS), jnp.concatenate([limits - 1, -limits - 1])


# -- Rosen and Suzuki
def rosen_suzuki(x):
    a, b, c, d = x
    loss = a**2 + b**2 + 2 * c**2 + d**2 - 5 * a - 5 * b - 21 * c + 7 * d
    first = a**2 + b**2 + c**2 + d**2 + a - b + c - d - 8
    second = a**2 + 2 * b**2 + c**2 + 2 * d**2 - a - d - 10
    third = 2 * a**2 + b**2 + c**2 + 2 * a - b - d - 5
    return loss, jnp.array([first, second, third]) / 8


# -- cantilever of 20 square bays of 1 m, a force of 1 at its tip: forces n of 60 bars by statics.
# Least volume for a deflection of 1 with E = 1: A = |n| sum(l |n|), by the multiplier of the limit
BAYS = np.arange(1, 21)
UNIT = np.concatenate([BAYS, BAYS - 1, np.full(20, np.sqrt(2.0))])  # chords, chords, diagonals
UNIT[20] = 0.1  # the last upper chord has no force: a little, so that it has an area
SPANS = np.concatenate([np.ones(40), np.full(20, np.sqrt(2.0))])
SIZE = 1e4


def cantilever(area):
    return area @ SPANS, jnp.array([jnp.sum(UNIT**2 * SPANS / (SIZE * area)) - 1])


# -- four ropes of two links of 5 m, EA = 1e6 N, a load in the middle: least pretension for a sag
SAGS, PULLS, STIFF = np.array([0.1, 0.15, 0.2, 0.25]), np.array([2e3, 4e3, 6e3, 8e3]), 1e6
_PLACES = np.array([[x, y, 0.0] for y in range(4) for x in (-5.0, 0.0, 5.0)])
_ROPES = [(3 * k + j, 3 * k + j + 1) for k in range(4) for j in (0, 1)]
_MIDDLE = np.arange(1, 12, 3)
_ROPE = jc.Structure(
    _PLACES,
    jc.Cables(_ROPES, axial_stiffness=STIFF),
    supports=jc.pinned(np.setdiff1d(np.arange(12), _MIDDLE)),
)
_PULL = jc.NodalLoads(_MIDDLE, np.column_stack([0 * PULLS, 0 * PULLS, -PULLS]))


def ropes(force):
    phases = [jc.Phase(pretension=jnp.repeat(force, 2)), jc.Phase(loads=_PULL)]
    solution = jc.solve(_ROPE, phases)
    sag = -solution.displacement[_MIDDLE, 2]
    return jnp.sum(force) / 1e3, sag / SAGS - 1, solution


def least_pretension():
    """By statics: the force at the sag, the unstressed length, and the force at a length of 5 m."""
    length = np.hypot(5.0, SAGS)
    force = PULLS * length / (2 * SAGS)
    return STIFF * (5.0 * (1 + force / STIFF) / length - 1)


_THREE = np.array([(3 + np.sqrt(3.0)) / 6, 1 / np.sqrt(6.0)])  # minimum on the first limit
PROBLEMS = {  # name: (problem, start, bounds, known loss)
    "dome": (dome_problem, np.full(34, -0.205), (-5.0, -1e-6), 282.93),
    "three bars": (
        three_bars,
        np.array([1.0, 1.0]),
        (0.0, 2.0),
        float(three_bars(jnp.asarray(_THREE))[0]),
    ),
    "ten bars": (ten_bars, np.full(10, 20.0), (0.1, 50.0), 5060.85),
    "Rosen-Suzuki": (rosen_suzuki, np.zeros(4), None, -44.0),
    "cantilever": (cantilever, np.ones(60), (1e-4, 1e3), (SPANS @ UNIT) ** 2 / SIZE),
    "ropes": (ropes, np.full(4, 1e5), (1.0, 1e6), least_pretension().sum() / 1e3),
}


# -- the loop that the package had: method of multipliers (Hestenes, Powell, Rockafellar)
@functools.cache
def augmented(problem):
    """The loss ``f + sum(max(0, m + p c)^2 - m^2) / (2 p)``, and loss and constraints."""

    def loss(params, m, p, tol):
        value, constraints, *solution = problem(params)
        pushed = jnp.maximum(0.0, m + p * (constraints + tol))
        value += jnp.sum(pushed**2 - m**2) / (2 * p)
        return (value, solution[0]) if solution else value

    return loss, jax.jit(lambda params: problem(params)[:2])


def multipliers(problem, start, bounds, ended, rounds=30, tol=1e-6):
    """Minimise the augmented loss by `minimize` again and again: parameters, evaluations."""
    loss, both = augmented(problem)
    value, constraints = both(start)
    m, p = np.zeros(len(constraints)), 10 * abs(float(value)) or 10.0
    worst, count, accuracy = np.inf, 0, max(tol, 1e-3)
    for _ in range(rounds):
        found = jc.minimize(loss, start, bounds, args=(m, p, tol), tol=accuracy)
        ended()
        count += int(found.evaluations)
        start = found.params
        tight = np.asarray(both(start)[1]) + tol
        gap = np.abs(np.maximum(tight, -m / p)).max(initial=0.0)
        m = np.maximum(0.0, m + p * tight)
        if gap <= tol and accuracy <= tol and int(found.status) == 0:
            break
        if gap > 0.25 * worst:
            p *= 100.0 if gap > 0.9 * worst else 10.0
        worst, accuracy = gap, max(tol, 0.1 * accuracy)
    return start, count


class TooLongError(Exception):
    """A call has taken longer than `LONGEST`."""


def limited(call):
    """The result of a call and its seconds; it gets a function to call after every step."""
    begin = time.perf_counter()

    def ended(_=None):
        if time.perf_counter() - begin > LONGEST:
            raise TooLongError

    try:
        return call(ended), time.perf_counter() - begin
    except TooLongError:
        return None, LONGEST


def row(name, solver):
    """One problem by one way: loss, error, violation, residual, status, evaluations, seconds."""
    problem, start, bounds, known = PROBLEMS[name]
    start = jnp.asarray(start)

    def call(ended):
        if solver == "multipliers":
            return multipliers(problem, start, bounds, ended)
        found = design.minimize_subject_to(problem, start, bounds, solver=solver, progress=ended)
        return found.params, found.evaluations, found

    if limited(call)[0] is None:  # the first call compiles
        return {"seconds": LONGEST}
    found, seconds = limited(call)
    if found is None:
        return {"seconds": LONGEST}
    params, count, *rest = found
    value, constraints = problem(params)[:2]
    told = {"seconds": seconds, "evaluations": count, "loss": float(value)}
    told["error"] = float(value / known - 1)
    told["violation"] = float(constraints.max())
    for own in rest:
        told |= {"status": int(own.status), "residual": own.kkt_residual}
    return told


# -- without limits
def valley(x):
    """Rosenbrock's, in 20 dimensions."""
    return jnp.sum(100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2)


def wall(x):
    """Not a number at and below zero; ``sum(x - log x)`` is least at 1."""
    return jnp.sum(x - jnp.log(x)) + 10 * jnp.sum((x[1:] - x[:-1]) ** 2)


def moved(density):
    return dome_state(density)[1].ravel()


def apart(density):
    return jnp.sum(moved(density) ** 2)


def valley_residuals(x):
    return jnp.concatenate([10 * (x[1:] - x[:-1] ** 2), 1 - x[:-1]])


FREE_OF_LIMITS = {
    "valley": (valley, np.tile([-1.2, 0.5], 10), (-2.0, 0.8)),
    "wall": (wall, np.linspace(5.0, 30.0, 10), None),
    "dome's plan": (apart, np.full(34, -0.205), (-5.0, -1e-6)),
}
RESIDUALS = {
    "valley": (valley_residuals, np.tile([-1.2, 0.5], 10), (-2.0, 0.8)),
    "dome's plan": (moved, np.full(34, -0.205), (-5.0, -1e-6)),
}


def beside_scipy(name, squares):
    """A problem without limits by the package and by SciPy: two rows."""
    function, start, bounds = (RESIDUALS if squares else FREE_OF_LIMITS)[name]
    start = jnp.asarray(start)
    search = functools.partial(jc.fit if squares else jc.minimize, steps=1000)
    search(function, start, bounds)  # compiles
    begin = time.perf_counter()
    ours = search(function, start, bounds)
    loss = float(ours.misfit**2 if squares else ours.loss)
    seconds = time.perf_counter() - begin
    count = int(ours.steps) + 1 if squares else int(ours.evaluations)
    mine = {"loss": loss, "evaluations": count, "seconds": seconds, "status": int(ours.status)}
    low, high = bounds or (-np.inf, np.inf)
    value = jax.jit(function if squares else jax.value_and_grad(function))
    slope = jax.jit(jax.jacfwd(function))
    jax.block_until_ready((value(start), slope(start)))
    begin = time.perf_counter()
    if squares:
        found = optimize.least_squares(
            lambda x: np.asarray(value(x)),
            start,
            jac=lambda x: np.asarray(slope(x)),
            bounds=(low, high),
            x_scale="jac",
        )
        loss = 2 * found.cost
    else:
        found = optimize.minimize(
            lambda x: [np.asarray(part) for part in value(x)],
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=optimize.Bounds(low, high),
            options={"ftol": 1e-15, "gtol": 1e-9, "maxiter": 1000, "maxfun": 5000},
        )
        loss = float(found.fun)
    theirs = {"loss": loss, "evaluations": int(found.nfev), "success": bool(found.success)}
    theirs["seconds"] = time.perf_counter() - begin
    return mine, theirs


def main():
    say, told = Record("constrained"), {"limits": {}, "free": {}}
    say(
        f"\n{'':14}{'':14}{'loss':>12}{'error':>10}{'violation':>11}{'residual':>10}"
        f"{'evaluations':>13}{'seconds':>9}  status"
    )
    for name in PROBLEMS:
        told["limits"][name] = {}
        for solver in [*SOLVERS, "multipliers"]:
            found = told["limits"][name][solver] = row(name, solver)
            head = f"{name:14}{solver:14}"
            if "loss" not in found:
                say(head + f"{'not within ' + format(LONGEST, '.0f') + ' s':>24}")
                continue
            residual = f"{found['residual']:10.1e}" if "residual" in found else f"{'':10}"
            say(
                head
                + f"{found['loss']:12.5f}{found['error']:10.1e}{found['violation']:11.1e}{residual}"
                + f"{found['evaluations']:13}{found['seconds']:9.2f}  {found.get('status', '')}"
            )
    say("\nwithout limits: loss, evaluations, seconds of the package and of SciPy")
    for squares in (False, True):
        for name in RESIDUALS if squares else FREE_OF_LIMITS:
            mine, theirs = beside_scipy(name, squares)
            which = "fit, least_squares" if squares else "minimize, L-BFGS-B"
            told["free"][f"{name}: {which}"] = mine, theirs
            say(
                f"{name:14}{which:20}"
                + "".join(
                    f"{one['loss']:16.8g}{one['evaluations']:7}{one['seconds']:8.3f}"
                    for one in (mine, theirs)
                )
                + f"  {mine['status']}, {'success' if theirs['success'] else 'no success'}"
            )
    say.close()
    write(RESULTS / "constrained.json", json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    main()
