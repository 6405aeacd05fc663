"""Every transformation of jax, with every solver, on every kind of structure, beside plain numbers.

The oracle are analyses at 5 x 5 points around one, without any transformation: their values, and
first and second derivatives by differences of fourth order.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.problems import INSTALLED
from banks.shapes import tripod

import jaxcable as jc

TIGHT = {"tol": 1e-13}
SCHEME = {"corrections": 1, "tol": np.inf}  # its derivatives are exact wherever it ends
SOLVERS = {
    "chosen": jc.Newton(**TIGHT),  # dense; where XLA fuses loops, rolling for nets
    **{name: jc.Newton(linear_solver=name, **TIGHT) for name in ("dense", "superlu")},
    **{name: jc.Newton(linear_solver=name, **TIGHT) for name in ("cholmod", "pardiso")},
    "tangent": jc.Incremental(**SCHEME),
    "secant": jc.Incremental(**SCHEME, stiffness="secant"),
    "scheme-superlu": jc.Incremental(**SCHEME, linear_solver="superlu"),
}

# --- kinds of structures: of two factors, of prestress or stiffness and of a load, three numbers


def flat_net(p):
    structure, _ = jc.scenes.flat_net()
    tension = p[0] * jnp.repeat(jnp.array([180.0, 220.0]), 6, total_repeat_length=12)
    load = jc.NodalLoads([3, 4, 7, 8], p[1] * jnp.array([3.0, 1.0, -15.0]))
    return structure, [jc.Phase(pretension=tension, increments=2), jc.Phase(loads=load)], 3


def groups(p):
    """Two groups in one bundle, and a bar; a pressure that follows."""
    nodes = [[-1.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0.1, 0, 0.1], [0, 0, -1.0]]
    own = jc.Cables([[0, 4], [1, 4]], 1e5 * p[0]), jc.Cables([[2, 4], [3, 4]], 2e5)
    elements = dict(zip("ab", own, strict=True)) | {"bar": jc.Bars([[4, 5]], 1e3)}
    structure = jc.Structure(nodes, elements, jc.pinned([0, 1, 2, 3, 5]))
    loads = [
        jc.NodalLoads([4], p[1] * jnp.array([20.0, 10.0, -90.0])),
        jc.CablePressure(20.0, axis=(0.0, 1.0, 0.0), on="a"),
    ]
    return structure, [jc.Phase(pretension={"a": 200.0, "b": 300.0, "bar": None}, loads=loads)], 4


def bars(p):
    shape = tripod(height=0.5)
    elements = jc.replace(shape.structure.elements, axial_stiffness=p[0] * jnp.full(3, 1e5))
    load = shape.load(2e3 * p[1], direction=np.array([0.1, 0.2, -1.0]))
    return jc.replace(shape.structure, elements=elements), [jc.Phase(loads=load)], 0


def beams(p):
    section = jc.Section.rectangle(0.05, 0.08, jc.Elastic(1e9 * p[0]), (2, 2))
    group = jc.Beams([[0, 1]], section=section)
    structure = jc.Structure([[0.0, 0, 0], [2.0, 0, 0]], group, jc.clamped([0]))
    load = jc.NodalLoads([1], p[1] * jnp.array([100.0, 200.0, -300.0]))
    return structure, [jc.Phase(loads=load)], 1


def catenaries(p):
    group = jc.Catenaries([[0, 1], [1, 2]], axial_stiffness=1e6, weight=30.0)
    nodes = [[0.0, 0, 0], [20.0, 0, -4], [50.0, 0, 4.0]]
    structure = jc.Structure(nodes, group, jc.pinned([0, 2]))
    load = jc.NodalLoads([1], p[1] * jnp.array([50.0, 90.0, -900.0]))
    rest = (1 + 0.05 * (p[0] - 1)) * jnp.array([20.3, 30.9])  # taut at all points
    return structure, [jc.Phase(rest_length=rest, loads=[jc.SelfWeight(), load])], 1


def sliding(p):
    """A rope over a node that cables hold."""
    held = jc.Cables([[0, 1], [0, 2], [0, 3], [0, 4]], 1e5)
    elements = {"held": held, "rope": jc.SlidingCables([[1, 0, 2]], 1e4 * p[0])}
    nodes = [[0.1, 0.2, 0], [-1.0, 0, 0.2], [1, 0, 0.2], [0, -1, 0], [0, 1, 0.0]]
    structure = jc.Structure(nodes, elements, jc.pinned([1, 2, 3, 4]))
    load = jc.NodalLoads([0], p[1] * jnp.array([5.0, 10.0, -90.0]))
    return structure, [jc.Phase(pretension={"held": 300.0, "rope": 50.0}, loads=load)], 0


KINDS = {
    "net": flat_net,
    "groups": groups,
    "bars": bars,
    "beams": beams,
    "catenaries": catenaries,
    "sliding": sliding,
}

# --- transformations: of a function of two numbers; what they give, by what it is

P = np.ones(2)
STEP = 0.01
OFFSETS = STEP * np.arange(-2, 3)
FIRST = np.array([1, -8, 0, 8, -1]) / (12 * STEP)
SECOND = np.array([-1, 16, -30, 16, -1]) / (12 * STEP**2)
PLAIN = np.eye(5)[2]
WEIGHTS = np.array([1.0, -0.7, 0.4])  # make one number of three
WAY = np.array([0.3, -1.0])
ENDS = P + OFFSETS[[0, 4]], P + OFFSETS[[4, 0]]  # of a line through the points
ROOTS, SHARES = np.polynomial.legendre.leggauss(3)
ON_LINE = P + np.outer(ROOTS, OFFSETS[[4, 0]])


def along_line(both):
    """Integrals of the derivative of a function along a line, from gradients at three points."""
    values, slopes = both
    return {"change": slopes @ (ENDS[1] - ENDS[0]) @ SHARES / 2, "values": values}


def weighed(f):
    return lambda p: jnp.asarray(WEIGHTS) @ f(p)


def scanned(f):
    """A scan over points; `f` may return several arrays."""
    return jax.lax.scan(lambda restart, p: (restart, f(p)), 0, ON_LINE)[1]


def summed(f):
    """The sum of a scan in which every step weighs `f` anew."""
    shares = np.array([[0.2], [0.3], [0.5]]) * WEIGHTS

    def total(p):
        def step(restart, share):
            return restart + share @ f(p), None

        return jax.lax.scan(step, 0.0, shares)[0]

    return total


TRANSFORMATIONS = {
    "jit": lambda f: {"value": jax.jit(f)(P)},
    "jvp": lambda f: dict(zip(("value", "rate"), jax.jvp(f, (P,), (WAY,)), strict=True)),
    "jacfwd": lambda f: {"jacobian": jax.jacfwd(f)(P)},
    "jacrev": lambda f: {"jacobian": jax.jacrev(f)(P)},
    "grad": lambda f: {"gradient": jax.grad(weighed(f))(P)},
    "checkpoint": lambda f: {"gradient": jax.grad(weighed(jax.checkpoint(f)))(P)},
    "hessian": lambda f: {"hessian": jax.hessian(weighed(f))(P)},
    "jvp-of-grad": lambda f: {"product": jax.jvp(jax.grad(weighed(f)), (P,), (WAY,))[1]},
    "vmap": lambda f: {"ends": jax.vmap(f)(np.array(ENDS))},
    "vmap-of-grad": lambda f: along_line(jax.vmap(jax.value_and_grad(weighed(f)))(ON_LINE)),
    "scan": lambda f: along_line(scanned(jax.value_and_grad(weighed(f)))),
    "grad-of-scan": lambda f: {"gradient": jax.grad(summed(f))(P)},
}

# Sizes of errors: of two programs of an iteration that ends at 1e-13; of differences, whose steps
# are 1e-2, to the fourth power, and roundings divided by the step once or twice.
NEAR = {"value": 1e-11, "ends": 1e-11, "change": 1e-9, "values": 1e-3, "hessian": 1e-6}
NEAR |= {"product": 1e-6, "jacobian": 1e-6, "gradient": 1e-6, "rate": 1e-6}


def end(kind, solver, p):
    structure, phases, node = KINDS[kind](p)
    solution = jc.solve(structure, phases, SOLVERS[solver])
    return solution.displacement[node], solution.status


@functools.cache
def plain(kind, solver):
    """What transformations shall give, from analyses without any."""
    grid = np.zeros((5, 5, 3))
    for i, j in np.ndindex(5, 5):
        grid[i, j], status = end(kind, solver, P + OFFSETS[[i, j]])
        assert int(status) == 0
    jacobian = np.stack([FIRST @ grid[:, 2], FIRST @ grid[2]], axis=-1)
    of_one = grid @ WEIGHTS
    mixed = FIRST @ of_one @ FIRST
    hessian = np.array([[SECOND @ of_one @ PLAIN, mixed], [mixed, PLAIN @ of_one @ SECOND]])
    gradient, ways = WEIGHTS @ jacobian, ON_LINE - P  # `values` to second order
    return {
        "value": grid[2, 2],
        "ends": grid[[0, 4], [4, 0]],
        "jacobian": jacobian,
        "rate": jacobian @ WAY,
        "gradient": gradient,
        "hessian": hessian,
        "product": hessian @ WAY,
        "change": of_one[4, 0] - of_one[0, 4],
        "values": of_one[2, 2] + ways @ gradient + np.sum(ways @ hessian * ways, 1) / 2,
    }


# --- which are tried with each other: with * in `make test`, the others in `make test-all`

CASES = """
              net             groups    bars             beams    catenaries  sliding
jit           secant          -         pardiso          -        dense       -
jvp           dense           -         -                dense    -           chosen
jacfwd        chosen,secant   -         cholmod          -        dense       superlu
jacrev        scheme-superlu  superlu   -                superlu  -           -
grad          -               -         tangent          dense    dense       chosen
checkpoint    superlu         -         pardiso          -        -           -
hessian       superlu         -         cholmod          -        dense       -
jvp-of-grad   chosen,secant   superlu   tangent          -        -           -
vmap          chosen          superlu   pardiso          dense    -           -
vmap-of-grad  chosen          -         scheme-superlu   -        -           chosen
scan          superlu         dense     -                -        -           chosen
grad-of-scan  secant          -         cholmod*         dense    -           -
"""


def cases():
    """Read the table."""
    header, *rows = CASES.strip().splitlines()
    for row in rows:
        name, *cells = row.split()
        for kind, cell in zip(header.split(), cells, strict=True):
            for solver in cell.split(",") if cell != "-" else ():
                marks = [] if solver.endswith("*") else [pytest.mark.slow]
                solver = solver.rstrip("*")
                if solver in ("cholmod", "pardiso") and solver not in INSTALLED:
                    marks.append(pytest.mark.skip(reason=f"{solver} is not installed"))
                yield pytest.param(name, kind, solver, marks=marks, id=f"{name}-{kind}-{solver}")


@pytest.mark.parametrize(("name", "kind", "solver"), [*cases()])
def test_transformations(name, kind, solver):
    expected = plain(kind, solver)
    found = TRANSFORMATIONS[name](lambda p: end(kind, solver, p)[0])
    for what, numbers in found.items():
        error = np.abs(numbers - expected[what]).max() / np.abs(expected[what]).max()
        assert error < NEAR[what], (what, error)


def test_every_one_occurs():
    values = (case.values for case in cases())
    for found, known in zip(
        zip(*values, strict=True), (TRANSFORMATIONS, KINDS, SOLVERS), strict=True
    ):
        assert set(found) >= set(known)


NET, (PRESTRESS, _) = jc.scenes.flat_net()


@pytest.mark.slow
def test_a_gradient_by_a_structure_is_a_structure():
    load = jc.Phase(loads=jc.NodalLoads([3, 4, 7, 8], (0.0, 0.0, -15.0)))

    @jax.jit
    @functools.partial(jax.value_and_grad, has_aux=True)
    def deflection(structure):
        solution = jc.solve(structure, [PRESTRESS, load], jc.Newton(**TIGHT))
        return solution.displacement[3, 2], solution.status

    def at(stiffness):
        elements = jc.replace(NET.elements, axial_stiffness=stiffness)
        return float(deflection(jc.replace(NET, elements=elements))[0][0])

    (_, status), gradient = deflection(NET)
    assert int(status) == 0
    assert gradient.nodes.shape == (12, 3) and gradient.elements.axial_stiffness.shape == (12,)
    base = np.asarray(NET.elements.axial_stiffness)
    difference = (at(base + 1.0) - at(base - 1.0)) / 2.0
    assert float(gradient.elements.axial_stiffness.sum()) == pytest.approx(difference, rel=1e-5)
