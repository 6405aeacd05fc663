"""Word of long work: what is told, when it is printed, and that it costs nothing unasked."""

import io

import jax
import jax.numpy as jnp
import pytest
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.common.progress import Increment, Printer, Step, as_listener


@pytest.fixture(scope="module")
def scene():
    return jc.scenes.flat_net(load=15.0)


@pytest.mark.slow
@pytest.mark.parametrize("method", [jc.Newton(), jc.Incremental(corrections=1)])
def test_every_increment_is_told_as_the_path_has_it(method, scene):
    told = []
    solution = converged(jc.solve(*scene, method, progress=told.append))
    jax.effects_barrier()
    told.sort(key=lambda news: (news.phase, news.number))  # calls may come out of turn
    assert [(n.phase, n.number) for n in told] == [(1, 1), *((2, k) for k in range(1, 11))]
    path = solution.phases[1].path
    assert [n.load_factor for n in told[1:]] == path.load_factor.tolist()
    assert [n.residual for n in told[1:]] == path.residual.tolist()
    assert [n.iterations for n in told[1:]] == path.iterations.tolist()
    assert {n.status for n in told} == {0} and told[0].phases == 2 and told[1].count == 10


def deflection(scene, tension, progress):
    first, load = jc.Phase(pretension=tension), scene.phases[1]
    return jc.solve(scene.structure, [first, load], progress=progress).displacement[3, 2]


def test_a_program_without_a_listener_has_nothing_of_it(scene):
    def text(progress):
        return str(jax.make_jaxpr(lambda T: deflection(scene, T, progress))(200.0))

    assert "callback" not in text(None) and text(None) == text(False)
    assert "progress.make_printing_reporter, " in text(True) and "jaxcable" not in text(False)
    assert "callback" in text(print)


@pytest.mark.slow
def test_derivatives_are_the_same_with_a_listener(scene):
    told = []
    found = jax.grad(lambda T: deflection(scene, T, told.append))(200.0)
    jax.effects_barrier()
    assert len(told) == 11
    assert float(found) == float(jax.grad(lambda T: deflection(scene, T, None))(200.0))


def test_steps_of_an_optimization_are_told():
    told = []
    found = jc.minimize(lambda x: jnp.sum((x - 2.0) ** 4), jnp.zeros(2), progress=told.append)
    jax.effects_barrier()
    assert int(found.status) == 0
    told.sort(key=lambda news: news.number)
    assert [n.number for n in told] == list(range(int(found.steps) + 1))
    assert [n.loss for n in told] == found.history.loss[: len(told)].tolist()
    assert str(told[0]).startswith("step 0 of 100: loss 32, gradient ") and told[0].loss == 32.0


def test_lines_come_with_long_work_only(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("jaxcable.progress.time.monotonic", lambda: now[0])
    stream = io.StringIO()
    show = Printer(stream=stream)

    def news(number, code=0):
        return Increment(1, 1, number, 9, number / 9, 3, 1e-7, 1e-12, code)

    for number in range(1, 4):  # short work is silent
        show(news(number))
        now[0] += 0.1
    assert stream.getvalue() == ""
    now[0] += 0.5
    show(news(4))
    show(news(5))
    line = "phase 1 of 1, increment 4 of 9: 3 iterations, residual 1.0e-07 N (1.0e-12)\n"
    assert stream.getvalue() == line
    now[0] += 60.0
    show(news(1))  # other work begins
    assert stream.getvalue() == line
    now[0] += 1.0
    show(news(2, 1))
    assert "no equilibrium found" in stream.getvalue()
    assert str(Step(2, 9, 1.5, 1e-3, 4)).endswith("loss 1.5, gradient 1.0e-03, 4 trials failed")


def test_wrong_listeners_are_named(scene):
    with pytest.raises(ValueError, match="progress = 3: expected True, or a function"):
        jc.solve(*scene, progress=3)
    assert as_listener(None) is None and as_listener(False) is None
    assert as_listener(True) is as_listener(True)  # one object: no second compilation


@pytest.mark.slow
def test_short_work_is_silent_and_known_programs_are_not_compiled(scene):
    show = Printer(pause=1e3, stream=io.StringIO())
    jc.raise_if_failed(jc.solve(*scene, progress=show))
    jax.effects_barrier()
    assert show.stream.getvalue() == ""
    show.pause = 0.0
    jc.raise_if_failed(jc.solve(*scene, progress=show))
    jax.effects_barrier()
    assert "phase 2 of 2" in show.stream.getvalue()
