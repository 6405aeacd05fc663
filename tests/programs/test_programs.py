"""Programs outside of `jit`: the same by NumPy and by XLA, and when which of them runs."""

import signal
import threading
import time
import weakref

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxcable as jc
from jaxcable.analysis import phase_loop
from jaxcable.common import jax_internals as internals
from jaxcable.common import status
from jaxcable.programs import decision, known
from jaxcable.programs.program import Program
from jaxcable.programs.program_calls import as_program


@pytest.fixture(autouse=True)
def _as_before():
    with jc.evaluation("auto"):
        yield


def frame(k):
    """Two beams and a stay, which carries the load at the tip."""
    law = jc.Elastic(210e9)
    beams = jc.Beams([[0, 1], [1, 2]], section=jc.Section.ring(0.3, 0.01, law, shape=(1, 8)))
    stay = jc.Cables([[3, 2]], axial_stiffness=2e7)
    nodes = k * jnp.array([[0.0, 0, 0], [2, 0, 0.1], [4, 0, 0], [0, 0, 3]])
    supports = jc.clamped([0, 3])
    structure = jc.Structure(nodes, {"beams": beams, "stay": stay}, supports=supports)
    loads = jc.NodalLoads([2], [0.0, 0.0, -2e4])
    first = jc.Phase(pretension={"beams": None, "stay": 5e3})
    return structure, [first, jc.Phase(loads=loads, increments=2)]


def net(k):
    """A flat net under load, of scenes."""
    structure, phases = jc.scenes.flat_net()
    return jc.replace(structure, nodes=structure.nodes * k), phases


def slack(k):
    """A net some cables of which go slack."""
    structure, phases = jc.scenes.saddle(3, 3)
    loads = jc.NodalLoads([6], [0.0, 0.0, 2e4])
    return jc.replace(structure, nodes=structure.nodes * k), [phases[0], jc.Phase(loads=loads)]


def hanging(k):
    """A catenary between supports, with a node that it holds."""
    ropes = jc.Catenaries([[0, 1], [1, 2]], axial_stiffness=1e6, weight=40.0, rest_length=10.4)
    nodes = k * jnp.array([[0.0, 0, 0], [10, 0, -2], [20, 0, 1]])
    structure = jc.Structure(nodes, ropes, supports=jc.pinned([0, 2]))
    return structure, jc.Phase(loads=[jc.SelfWeight()])


def failing(k):
    """A net whose iteration may take one step only."""
    return *net(k), jc.Newton(max_steps=1)


CASES = {"net": net, "slack": slack, "frame": frame, "hanging": hanging, "failing": failing}


def analysis(case):
    """Function of a scale to the solution, and one to a number with all of it."""

    def solve(k):
        return jc.solve(*CASES[case](k))

    def number(k):
        solution = solve(k)
        forces = jax.tree.leaves(solution.tension)
        return (solution.displacement**2).sum() + sum((x**2).sum() for x in forces) * 1e-9

    return solve, number


def largest(x):
    """Largest finite magnitude in an array, 0 if there is none."""
    x = np.asarray(x, float)
    return np.max(np.abs(x[np.isfinite(x)]), initial=0.0)


TRANSFORMATIONS = {
    "value": lambda solve, number: solve(1.01),
    "grad": lambda solve, number: jax.grad(number)(1.01),
    "jvp": lambda solve, number: jax.jvp(number, (1.01,), (1.0,)),
    "hessian": lambda solve, number: jax.hessian(number)(1.01),
    "vmap": lambda solve, number: jax.vmap(solve)(jnp.array([1.0, 1.02])),
    "vmap of grad": lambda solve, number: jax.vmap(jax.grad(number))(jnp.array([1.0, 1.02])),
}
# compiled for long; of beams and catenaries `tests/analysis/test_transforms.py` compiles some
SLOW = pytest.mark.slow


@pytest.mark.slow_cases(
    *("value-frame", "grad-frame", "vmap-frame", "value-hanging", "grad-hanging", "vmap-hanging"),
    *("value-net", "grad-slack", "vmap-slack", "vmap-net", "grad-failing", "vmap-failing"),
)
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(
    "transformation",
    [
        "value",
        "grad",
        pytest.param("jvp", marks=SLOW),
        pytest.param("hessian", marks=SLOW),
        "vmap",
        pytest.param("vmap of grad", marks=SLOW),
    ],
)
def test_numpy_and_xla_agree(case, transformation):
    """1e-12 of the largest of each result; status, iterations and other integers are equal.

    With slack cables the points differ a little more, by what the tolerance leaves: 1e-11.
    """
    transform = TRANSFORMATIONS[transformation]
    with jc.evaluation("numpy"):
        ours = transform(*analysis(case))
    with jc.evaluation("xla"):
        theirs = transform(*analysis(case))
    if transformation == "value":
        assert (ours.status == status.OK) == (case != "failing")
    pairs = zip(jax.tree_util.tree_leaves_with_path(ours), jax.tree.leaves(theirs), strict=True)
    whole = max(map(largest, jax.tree.leaves(theirs)))
    for (path, own), other in pairs:
        own, other = np.asarray(own), np.asarray(other)
        assert own.shape == other.shape and own.dtype == other.dtype
        if own.dtype.kind != "f":
            np.testing.assert_array_equal(own, other, err_msg=str(path))
            continue
        assert (np.isnan(own) == np.isnan(other)).all(), path
        # differences of the largest numbers, such as unbalanced forces, are rounding
        atol = (1e-11 if case == "slack" else 1e-12) * largest(other) + 1e-15 * whole
        np.testing.assert_allclose(own, other, rtol=0, atol=atol, err_msg=str(path))


@pytest.fixture
def compilations():
    """List of the programs that XLA has compiled since the beginning of the test."""
    found = []

    def hear(event, _, **about):
        if "backend_compile" in event:
            found.append(about)

    jax.monitoring.register_event_duration_secs_listener(hear)
    yield found
    jax.monitoring.unregister_event_duration_listener(hear)


# --- the decision


@as_program
def repeat(x, count):
    """A loop of `count` turns, in which little is done."""
    return lax.fori_loop(0, count, lambda _, y: jnp.sin(y) + x, x)


def programs():
    """The programs of `repeat`."""
    return list(repeat.known.values())


@pytest.fixture
def _no_programs():
    repeat.known.clear()
    internals.quick_compile_options()  # compiles a program, once in a process, to see that it can


@pytest.mark.usefixtures("_no_programs")
def test_much_work_is_compiled_and_little_is_not(compilations):
    for _ in range(20):
        repeat(1.0, 2)
    assert compilations == [] and programs()[0].work < 20 * 20
    repeat(1.0, 10**6)  # one long call: it begins again
    assert len(compilations) == 1
    np.testing.assert_allclose(repeat(1.0, 3), np.sin(np.sin(np.sin(1) + 1) + 1) + 1, rtol=1e-14)


@pytest.mark.usefixtures("_no_programs")
def test_the_same_calls_are_decided_alike(compilations):
    """Work is counted, not timed: the same call is the first one that is compiled."""
    compiled_at = []
    for _ in range(2):
        repeat.known.clear()
        before, calls = len(compilations), 0
        while len(compilations) == before:
            repeat(1.0, 50)
            calls += 1
        compiled_at.append(calls)
    assert compiled_at[0] == compiled_at[1] > 5


@pytest.mark.usefixtures("_no_programs")
def test_ways_can_be_set(compilations):
    with jc.evaluation("numpy"):
        repeat(1.0, 10**5)
        assert compilations == []
        with jc.evaluation("xla"):
            repeat(1.0, 2)
            assert len(compilations) == 1
        assert decision.current_way() == "numpy"
    assert decision.current_way() == "auto"
    jc.evaluation("xla")
    assert decision.current_way() == "xla"


def test_an_operation_without_a_rule_is_compiled_alone(compilations):
    """Singular values, in a loop that NumPy runs."""

    def scaled(x):
        return lax.fori_loop(
            0, 3, lambda k, y: y / jnp.linalg.svd(y, compute_uv=False)[0] + k * jnp.eye(2), x
        )

    program = Program(scaled, [np.eye(2)])
    for factor in (1.0, 2.0):
        y = np.array([[factor, 3.0], [-1.0, 2.0]])
        found = program.run([y])[0]
        for k in range(3):
            y = y / np.linalg.norm(y, 2) + k * np.eye(2)
        np.testing.assert_allclose(found, y, rtol=1e-14)
    assert len(compilations) == 1 and program.work > 0


def test_what_does_not_depend_on_an_argument_is_not_differentiated_or_mapped():
    """By a program, in the program after it: floats have no tangents there, indices no cases."""

    @as_program
    def first(x, y, k):
        return 2.0 * x, y + 1.0, k + 1

    @as_program
    def second(a, b, k):
        return a * b[k]

    def value(x):
        return second(*first(x, np.arange(3.0), 1))

    assert float(jax.grad(value)(np.float64(1.0))) == 6.0
    np.testing.assert_allclose(jax.vmap(value)(jnp.arange(2.0)), [0.0, 6.0])
    kinds = [key[:2] for key in next(iter(second.known.values())).known.programs]
    assert kinds == [("jvp", (0,)), ("vmap", (0, 0, None))]


def test_a_program_of_another_size_of_a_batch_is_none_of_its_own(compilations):
    """Few cases are evaluated one by one."""
    analyse = jax.vmap(lambda k: jc.solve(*net(k)).tension)
    first = analyse(jnp.array([1.0, 1.1]))
    known = len(phase_loop.analyse.known)
    again = analyse(jnp.array([1.0, 1.1, 1.2]))
    assert len(phase_loop.analyse.known) == known
    np.testing.assert_allclose(first, again[:2], rtol=1e-13)


# --- interrupts and threads


@pytest.mark.usefixtures("_no_programs")
def test_a_program_can_be_interrupted():
    """Between its operations, and runs again after that."""

    def stop(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, 0.5)
    begin = time.perf_counter()
    try:
        with jc.evaluation("numpy"), pytest.raises(KeyboardInterrupt):
            repeat(1.0, 10**9)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert time.perf_counter() - begin < 20.0
    assert repeat(1.0, 0) == 1.0


@pytest.mark.usefixtures("_no_programs")
def test_threads_share_programs():
    """Eight threads, each with numbers of its own, in the same two programs."""
    found = {}

    def work(k):
        x = np.full(3 + k % 2, float(k))
        for _ in range(5):
            found[k] = np.asarray(repeat(x, 40))

    threads = [threading.Thread(target=work, args=(k,), daemon=True) for k in range(8)]
    for one in threads:
        one.start()
    for one in threads:
        one.join(60.0)
        assert not one.is_alive()
    assert len(programs()) == 2
    for k, values in found.items():
        np.testing.assert_allclose(values, np.full(3 + k % 2, repeat(float(k), 40)), rtol=1e-13)


# --- derivatives and batches of programs


@as_program
def cubic(x, a):
    """A function of a vector and a number to two results and an integer."""
    return {"sum": (a * x**3).sum(), "each": jnp.sin(a) * x}, jnp.argmax(x)


X, A = np.array([0.3, -1.2, 2.0]), 0.7


def number_of(x, a):
    found, _ = cubic(x, a)
    return found["sum"] + (found["each"] ** 2).sum()


def plain_number(x, a):
    return (a * x**3).sum() + ((jnp.sin(a) * x) ** 2).sum()


@pytest.mark.parametrize(
    "derive",
    [
        lambda f: jax.grad(f, (0, 1))(X, A),
        lambda f: jax.jvp(f, (X, A), (np.ones(3), 1.0)),
        pytest.param(lambda f: jax.hessian(f)(X, A), marks=SLOW),
        lambda f: jax.jacfwd(jax.grad(f, 1))(X, A),
        lambda f: jax.vmap(jax.grad(f), (0, None))(np.stack([X, 2 * X]), A),
        lambda f: jax.vmap(jax.vmap(f, (None, 0)), (0, None))(np.stack([X, 2 * X]), np.ones(4)),
        lambda f: jax.grad(lambda a: jax.vmap(lambda x: f(x, a))(np.stack([X, X])).sum())(A),
        lambda f: jax.grad(jax.grad(jax.grad(f, 1), 1), 1)(X, A),
        lambda f: jax.jit(jax.grad(f))(X, A),
        lambda f: jax.linear_transpose(lambda x: jax.jvp(f, (X, A), (x, 0.0))[1], X)(1.0),
    ],
)
def test_derivatives_and_batches_of_programs(derive):
    with jc.evaluation("numpy"):
        ours = derive(number_of)
    theirs = derive(plain_number)
    for own, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-13)


@pytest.mark.parametrize("way", ["numpy", "xla"])
@pytest.mark.parametrize(
    "derive",
    [
        lambda f, lin, pull: f(lin(X)),
        lambda f, lin, pull: pull(f(X))[0],
        lambda f, lin, pull: jax.jvp(lambda t: f(lin(t)), (X,), (X,))[1],
    ],
)
def test_linear_parts_of_programs_within_programs(way, derive):
    """What `jax.linearize` and `jax.vjp` return is called inside of another program."""

    def square(x):
        return jnp.sin(x) * x

    with jc.evaluation(way):
        run = as_program(square)
        _, lin = jax.linearize(run, X)
        _, pull = jax.vjp(run, X)
        found = as_program(lambda t: derive(lambda x: 2.0 * x, lin, pull) + t)(np.zeros(3))
    _, lin = jax.linearize(square, X)
    _, pull = jax.vjp(square, X)
    np.testing.assert_allclose(found, derive(lambda x: 2.0 * x, lin, pull), rtol=1e-14)


def test_known_results_have_derivatives_in_and_of_batches():
    def plain(x, a):
        return (a * x**3).sum()

    program, both = as_program(plain), np.stack([X, 2.0 * X])

    def number(x, a):
        return program(x, a, value=lax.stop_gradient(plain(x, a)))

    for derive in (
        lambda f: jax.grad(f, (0, 1))(X, A),
        lambda f: jax.vmap(jax.grad(f), (0, None))(both, A),
        lambda f: jax.grad(lambda x, a: jax.vmap(f, (0, None))(x, a).sum(), (0, 1))(both, A),
    ):
        for own, other in zip(derive(number), derive(plain), strict=True):
            np.testing.assert_allclose(own, other, rtol=1e-13)


@pytest.mark.parametrize("way", ["numpy", "xla", "auto"])
def test_a_batch_without_cases_has_shapes(way):
    with jc.evaluation(way):
        found, index = jax.vmap(cubic, (0, None))(np.zeros((0, 3)), A)
        change = jax.vmap(jax.grad(number_of), (0, None))(np.zeros((0, 3)), A)
    assert found["sum"].shape == index.shape == (0,)
    assert found["each"].shape == change.shape == (0, 3)


@pytest.mark.parametrize("way", ["numpy", "xla"])
def test_numbers_of_python_yield_to_the_dtype_of_arrays(way):
    """Also where they are traced, and whatever has been called before."""
    x = np.ones(2, np.float32)
    with jc.evaluation(way):
        run = as_program(lambda x, a: x * a)
        assert run(x, np.float64(2.0)).dtype == np.float64
        found = [
            *jax.jvp(lambda a: run(x, a), (2.0,), (1.0,)),
            *jax.jvp(lambda x: run(x, 2.0), (x,), (x,)),
            jax.vmap(lambda x: run(x, 2.0))(x),
            jax.grad(lambda x: run(x, 2.0).sum())(x),
        ]
        assert [y.dtype for y in found] == [np.float32] * len(found)
        assert (run(2.0, 3.0) * x).dtype == np.float32
        pull = jax.vjp(lambda x, n: run(x, n), x, 2)[1]  # jax has a type of its own for such a 2
        np.testing.assert_array_equal(pull(x)[0], 2 * x)


def test_a_program_does_not_keep_all_of_its_batches():
    run = as_program(lambda x: 2.0 * x)
    for n in range(1, known.MOST_PROGRAMS + 4):
        np.testing.assert_array_equal(jax.vmap(run)(np.ones((n, 2))), 2.0 * np.ones((n, 2)))
    (program,) = run.known.values()
    assert len(program.known.programs) == known.MOST_PROGRAMS


def test_programs_depend_on_the_generator_of_random_keys():
    run = as_program(lambda x: jax.random.key_data(jax.random.key(5)) + x)
    for name, size in (("threefry2x32", 2), ("rbg", 4)):
        with jax.default_prng_impl(name):
            assert run(np.uint32(0)).shape == (size,)


def test_programs_are_forgotten_while_threads_make_others(monkeypatch):
    made = [known.KnownPrograms()]

    class Every(weakref.WeakSet):
        def __iter__(self):
            for one in super().__iter__():
                thread = threading.Thread(target=lambda: made.append(known.KnownPrograms()))
                thread.start()
                thread.join(0.1)
                yield one

    made[0].find("key", object)
    monkeypatch.setattr(known.KnownPrograms, "every", Every(made))
    known._forget()
    assert not made[0].programs


def test_what_was_heard_is_not_heard_again(compilations):
    """A long call that reports something does not begin again, compiled; the next one is."""
    heard = []

    @as_program
    def loud(x, count):
        jax.debug.callback(lambda a: heard.append(float(a)), x)
        return lax.fori_loop(0, count, lambda _, y: jnp.sin(y), x)

    loud(1.0, 3000)
    jax.effects_barrier()
    assert heard == [1.0] and compilations == []
    loud(2.0, 1)
    jax.effects_barrier()
    assert heard == [1.0, 2.0] and len(compilations) == 1


@pytest.mark.parametrize(
    "use",
    [
        lambda f: f(X),
        lambda f: jax.grad(lambda x: f(x).sum())(X),
        lambda f: jax.hessian(lambda x: f(x).sum())(X),
        lambda f: jax.vmap(jax.grad(lambda x: f(x).sum()))(np.stack([X, X])),
    ],
)
def test_programs_of_functions_that_are_gone_are_gone(use, collect_young):
    def function(x):
        return jnp.sin(x) * x

    program = as_program(function)
    use(program)
    seen = weakref.ref(function)
    del function, program
    collect_young()
    assert seen() is None
