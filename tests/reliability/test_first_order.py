"""First-order reliability: closed forms, published values, derivatives, searches that fail."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks import shapes
from oracles.taylor import slope as taylor_slope
from oracles.traced import traced
from scipy import optimize, special

import jaxcable as jc
from jaxcable import reliability, status
from jaxcable.reliability import Gumbel, Lognormal, Normal, Quantities, Uniform, first_order

PAIR = {"R": Normal(30.0, 3.0), "S": Normal(18.0, 4.0)}


def difference(x):
    return x["R"] - x["S"]


@pytest.mark.parametrize(("mean", "beta"), [(30.0, 12 / 5), (10.0, -8 / 5)])
def test_linear_limit_state_of_normal_quantities_is_exact(mean, beta):
    """A mean that fails has a negative index; more strength helps all the same."""
    found = first_order(difference, {**PAIR, "R": Normal(mean, 3.0)})
    assert found.status == status.OK and found.failures == 0 and found.limit_states is None
    assert found.beta == pytest.approx(beta, rel=1e-14)
    assert found.probability == pytest.approx(special.ndtr(-beta), rel=1e-13)
    assert found.alpha["R"] == pytest.approx(-0.6, rel=1e-14)
    assert found.alpha_squared["S"] == pytest.approx(0.64, rel=1e-14)
    for name, value in (("R", mean - 0.6 * beta * 3), ("S", 18 + 0.8 * beta * 4)):
        assert found.design_point[name] == pytest.approx(value, rel=1e-14)
        assert found.last_point[name] == found.design_point[name]
    assert found.distance < 1e-12 and found.misalignment < 1e-12


def parabola(x):
    """Der Kiureghian and Dakessian, Multiple design points (1998), with b 5, kappa 0.5, e 0.1."""
    return 5.0 - x["q"] - 0.5 * (x["p"] - 0.1) ** 2


STANDARD = {"p": Normal(0.0, 1.0), "q": Normal(0.0, 1.0)}


def test_two_design_points_of_a_parabola():
    """The nearest points by a cubic: d/dp of p^2 + (5 - (p - 0.1)^2 / 2)^2 is zero."""
    shifted = np.polynomial.Polynomial([-0.1, 1.0])
    squared = np.polynomial.Polynomial([0.0, 0.0, 1.0]) + (5.0 - 0.5 * shifted**2) ** 2
    roots = sorted(root.real for root in squared.deriv().roots() if abs(root.imag) < 1e-12)
    for start, root in ((-2.0, roots[0]), (2.0, roots[-1])):
        found = first_order(parabola, STANDARD, start={"p": start}, points=1)
        assert found.status == status.OK
        assert found.beta == pytest.approx(np.sqrt(squared(root)), rel=1e-11)
        assert found.design_point["p"] == pytest.approx(root, abs=1e-5)  # tol 1e-6 of the search
    assert np.sqrt(squared(roots[0])) == pytest.approx(2.906, abs=5e-4)  # as published
    assert np.sqrt(squared(roots[-1])) == pytest.approx(3.094, abs=5e-4)


def lognormal_index(mean_r, dev_r, mean_s, dev_s, rho):
    """Index of R - S, both lognormal, whose logarithms have the covariance log(1 + rho V W)."""
    v, w = dev_r / mean_r, dev_s / mean_s
    a, b = np.log(1 + v**2), np.log(1 + w**2)
    middle = np.log(mean_r) - a / 2 - np.log(mean_s) + b / 2
    return middle / np.sqrt(a + b - 2 * np.log(1 + rho * v * w))


def test_lognormal_quantities_with_a_correlation_of_their_values():
    """Index in closed form; its derivatives as in J.-M. Bourinet, FORM sensitivities to
    distribution parameters with the Nataf transformation (2017), four digits."""
    at = np.array([5.0, 5.0, 1.0, 1.0, 0.5])

    def index(p):
        pair = {"R": Lognormal(p[0], p[1]), "S": Lognormal(p[2], p[3])}
        wanted = jnp.eye(2).at[(0, 1), (1, 0)].set(p[4])
        matrix = reliability.normal_correlation(Quantities(pair), wanted)
        return first_order(difference, Quantities(pair, matrix)).beta

    beta, gradient = jax.value_and_grad(index)(jnp.asarray(at))
    assert beta == pytest.approx(lognormal_index(*at), rel=1e-10)
    numeric = optimize.approx_fprime(at, lambda p: lognormal_index(*p), 1e-7)
    np.testing.assert_allclose(gradient, numeric, rtol=3e-6)  # of the differences
    published = [0.5184, -0.2548, -1.3629, 0.0445, 2.4585]
    np.testing.assert_allclose(gradient, published, atol=6e-5)


MATRIX = np.array([[1.0, 0.3, 0.2], [0.3, 1.0, 0.2], [0.2, 0.2, 1.0]])


def column(x, capacity=1.0):
    return capacity - x["b"] / (1000 * x["c"]) - (x["a"] / (200 * x["c"])) ** 2


@pytest.mark.slow  # a dozen seconds to compile
def test_the_example_of_calrel():
    """Liu, Lin and Der Kiureghian, CALREL (1989): derivatives in Bourinet (2017), Tables 2 and 3.

    With b normal and a capacity of 1.7 pystra publishes 3.7347 (its test of FORM).
    """

    def index(mean, deviation, wanted, kind=Lognormal, capacity=1.0):
        own = Quantities(
            {
                "a": Lognormal(mean[0], deviation[0]),
                "b": kind(mean[1], deviation[1]),
                "c": Uniform(mean[2], deviation[2]),
            }
        )
        own = jc.replace(own, correlation=reliability.normal_correlation(own, wanted))
        return first_order(column, own, args=(capacity,))

    mean, deviation = jnp.array([500.0, 2000.0, 5.0]), jnp.array([100.0, 400.0, 0.5])
    by = jax.grad(lambda *p: index(*p).beta, argnums=(0, 1, 2))(
        mean, deviation, jnp.asarray(MATRIX)
    )
    # the last digit as printed; those of c differ by 2e-4 and 3e-4 of their size
    np.testing.assert_allclose(by[0], [-0.0059, -0.0009, 1.2602], rtol=2e-4, atol=6e-5)
    np.testing.assert_allclose(by[1], [-0.0079, -0.0006, -1.1942], rtol=4e-4, atol=6e-5)
    step = 1e-4  # the same by differences of the index, of second order
    for k, argument in enumerate((mean, deviation)):
        pair = [list((mean, deviation)) for _ in range(2)]
        for sign, one in zip((1, -1), pair, strict=True):
            one[k] = argument.at[2].add(sign * step)
        above, below = (float(index(*one, jnp.asarray(MATRIX)).beta) for one in pair)
        assert by[k][2] == pytest.approx((above - below) / (2 * step), rel=1e-5)
    both = by[2] + by[2].T  # a pair stands twice in the matrix
    np.testing.assert_allclose(
        [both[1, 0], both[2, 0], both[2, 1]], [-0.5151, 0.8916, 0.4688], rtol=1e-4, atol=6e-5
    )
    found = index(mean, deviation, MATRIX, Normal, 1.7)
    assert found.status == status.OK and found.beta == pytest.approx(3.7347, abs=1e-4)
    lengths = [sum(v**2 for v in part.values()) for part in (found.alpha, found.importance)]
    np.testing.assert_allclose(lengths, 1.0, rtol=1e-12)


def test_importance_does_not_depend_on_the_order():
    pair = {"R": Normal(30.0, 3.0), "S": Normal(18.0, 4.0)}
    one = first_order(difference, Quantities(pair, {("R", "S"): 0.5}))
    other = first_order(difference, Quantities(dict(reversed(pair.items())), {("R", "S"): 0.5}))
    assert one.beta == pytest.approx(12 / np.sqrt(9 + 16 - 2 * 0.5 * 12), rel=1e-13)
    assert other.beta == pytest.approx(float(one.beta), rel=1e-13)
    for name in pair:
        assert other.importance[name] == pytest.approx(float(one.importance[name]), rel=1e-12)
    assert abs(other.alpha["R"] - one.alpha["R"]) > 0.1  # control: factors of u do


# --- derivatives


def test_taylor_of_the_index():
    """By means, deviations, a number in `args` and one that the limit state captures."""

    def index(p):
        own = {"R": Lognormal(p[0], p[1]), "S": Gumbel(p[2], p[3])}

        def margin(x, factor):
            return factor * x["R"] ** 1.2 - p[5] * x["S"]

        return first_order(margin, own, args=(p[4],), tol=1e-10).beta

    at = np.array([30.0, 3.0, 15.0, 3.0, 0.6, 1.2])
    gradient = jax.grad(index)(jnp.asarray(at))
    value = traced(index)
    assert taylor_slope(value, at, gradient) == pytest.approx(2.0, abs=0.05)
    assert taylor_slope(value, at, 1.1 * gradient) < 1.1  # control
    forward = jax.jacfwd(index)(jnp.asarray(at))
    np.testing.assert_allclose(forward, gradient, rtol=1e-10)


def test_batches_programs_and_what_has_no_derivative():
    def results(mean):
        found = first_order(difference, {**PAIR, "R": Normal(mean, 3.0)})
        return (found.beta, found.alpha["R"], found.design_point["R"]), found.status

    first, *others = jax.jacfwd(lambda mean: results(mean)[0])(30.0)
    assert first == pytest.approx(1 / 5, rel=1e-13) and np.isnan(others).all()
    assert np.isnan(jax.hessian(lambda mean: results(mean)[0][0])(30.0))
    means = jnp.array([10.0, 30.0, np.nan])
    slope = jax.value_and_grad(lambda mean: (results(mean)[0][0], results(mean)[1]), has_aux=True)
    (betas, codes), _ = traced(jax.vmap(slope))(means)
    np.testing.assert_allclose(betas, (means - 18) / 5, rtol=1e-13)
    assert codes.tolist() == [status.OK, status.OK, status.BAD_START]


# --- searches that fail


def failing_index(mean, limit_state, options):
    return first_order(limit_state, {**STANDARD, "q": Normal(mean, 1.0)}, **options).beta


def test_failed_searches_say_so_and_give_nothing():
    cases = {
        status.OUT_OF_STEPS: (parabola, {"steps": 1, "start": {"p": 2.0}}),
        status.STATIONARY: (lambda x: 9.0 + 0.0 * x["p"], {}),
        status.BAD_START: (lambda x: jnp.sqrt(x["p"] - 1.0) - x["q"], {}),
        # the surface is beyond where the analysis fails
        status.STALLED: (lambda x: jnp.where(x["p"] < 2.0, 3.0 - x["p"], jnp.nan), {}),
    }
    for code, (limit_state, options) in cases.items():
        found = first_order(limit_state, STANDARD, **options)
        assert found.status == code
        assert np.isnan([found.beta, found.probability, found.distance]).all()
        assert np.isnan([*found.alpha.values(), *found.design_point.values()]).all()
    assert np.isnan(jax.grad(failing_index)(0.0, limit_state, options))
    assert found.last_point["p"] == pytest.approx(2.0, abs=1e-6) and found.failures > 5


def test_a_step_into_failed_analyses_is_shortened():
    """The full step from the median goes to -0.98, and below -0.9 the limit state is NaN."""

    def limit_state(x):
        inside = x["p"] > -0.9
        return jnp.where(inside, jnp.log((2.0 + x["p"]) / 1.2) - 0.1 * x["q"], jnp.nan)

    found = first_order(limit_state, STANDARD)
    assert found.status == status.OK and 0 < found.failures < found.evaluations

    def squared(p):  # on the surface
        return p**2 + (10 * np.log((2 + p) / 1.2)) ** 2

    best = optimize.minimize_scalar(squared, (-0.9, -0.8, -0.7), tol=1e-12)
    assert found.beta == pytest.approx(np.sqrt(best.fun), rel=1e-8)


def test_traced_numbers_that_are_not_allowed():
    found = traced(lambda d: first_order(difference, {**PAIR, "R": Normal(30.0, d)}))(-3.0)
    assert found.status == status.INVALID_INPUT and np.isnan(found.beta)


# --- several limit states, and a net


def test_several_limit_states():
    """In a dict or a vector, each is as by itself; one that fails leaves the others alone."""

    def both(x):
        return {"sum": 40.0 - x["R"] - x["S"], "margin": difference(x), "never": 0.0 * x["R"] + 1.0}

    found = first_order(both, PAIR)
    assert found.limit_states == ("margin", "never", "sum")
    assert found.status.tolist() == [status.OK, status.STATIONARY, status.OK]
    np.testing.assert_allclose(found.beta, [12 / 5, np.nan, -8 / 5], rtol=1e-13)
    alone = found.select_limit_state("margin")
    assert alone.limit_states is None and alone.design_point["S"].shape == ()
    vector = first_order(lambda x: jnp.stack([*both(x).values()]), PAIR)
    assert vector.limit_states == ("0", "1", "2")
    np.testing.assert_allclose(vector.beta, found.beta[jnp.array([2, 0, 1])], rtol=1e-15)
    with pytest.raises(ValueError, match="limit_state: none; there are 'margin'"):
        found.select_limit_state("margins")


def test_a_cross_of_cables():
    """Lengths, stiffness and load scatter; against SciPy on the equilibrium by hand."""
    shape = shapes.cross(pretension=1e3)
    numbers = [Normal(np.full(4, 1e3), 100.0), Lognormal(1e5, variation=0.05), Gumbel(300.0, 75.0)]
    quantities = Quantities(dict(zip(("pretension", "EA", "load"), numbers, strict=True)))

    def margin(x):
        cables = jc.replace(shape.structure.elements, axial_stiffness=x["EA"], rest_length=None)
        structure = jc.replace(shape.structure, elements=cables)
        phase = jc.Phase(pretension=x["pretension"], loads=shape.load(x["load"]))
        tension = jc.solve(structure, phase).tension
        return 2.0 - tension[0] / 1e3

    found = first_order(margin, quantities)
    assert found.status == status.OK and found.failures == 0
    # cables 0 and 2 (x), 1 and 3 (y) meet in the middle: residual of three displacements
    feet = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])

    def by_hand(u):
        values = quantities.values_at_normals(jnp.asarray(u))
        stiffness, pull = float(values["EA"]), np.array([0, 0, -float(values["load"])])
        rest = 1 / (1 + np.asarray(values["pretension"]) / stiffness)

        def forces(place):
            lines = feet - place
            lengths = np.linalg.norm(lines, axis=1)
            force = stiffness * (lengths - rest) / rest
            return force, (force / lengths) @ lines + pull

        place = optimize.root(lambda p: forces(p)[1], [0, 0, -0.05], tol=1e-12).x
        return 2.0 - forces(place)[0][0] / 1e3

    u = np.concatenate([np.ravel(found.u[name]) for name, _ in quantities.layout])
    assert by_hand(u) == pytest.approx(0.0, abs=1e-6)
    assert np.linalg.norm(u) == pytest.approx(float(found.beta), rel=1e-9)
    gradient = optimize.approx_fprime(u, by_hand, 1e-5)
    cosine = -(gradient @ u) / np.linalg.norm(gradient) / np.linalg.norm(u)
    assert cosine == pytest.approx(1.0, abs=1e-7)  # the nearest point: along the gradient
