"""`repr` of structures and results: a few lines, whatever state they are in, and cheap."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc

STRUCTURE, PHASES = jc.scenes.flat_net(load=15.0)


def short(thing):
    """The text, which is short."""
    text = repr(thing)
    assert 1 <= len(text.splitlines()) <= 5 and max(map(len, text.splitlines())) <= 100
    return text


def test_of_an_analysis():
    solution = jc.solve(STRUCTURE, PHASES)
    text = short(solution)
    assert text.startswith("Solution: converged\n") and f"{solution.tension.max():.6g} N" in text
    assert "displacement [12, 3]" in text and "PhaseResults[2]" in text
    for part in (STRUCTURE, *PHASES, solution.last, solution.phases, solution.phases[1].path):
        short(part)
    failed = jc.solve(STRUCTURE, PHASES, jc.Newton(max_steps=1))
    assert "status 1, no equilibrium found" in short(failed) and "tension [12] NaN" in repr(failed)
    batch = jax.tree.map(lambda a, b: jnp.stack([a, b]), solution, failed)
    assert short(batch).startswith("Solution: 1 of 2 converged; one: status 1, no equilibrium")
    # what transformations put into pytrees
    for leaf in (None, 3, "x", object(), np.zeros(0)):
        short(jax.tree.map(lambda _, leaf=leaf: leaf, solution))
    gone = jax.tree.map(jnp.array, solution)
    gone.tension.delete()
    assert "tension" in short(gone)


def test_of_what_is_traced():
    seen = []

    def length(tension):
        solution = jc.solve(STRUCTURE, [jc.Phase(pretension=tension), PHASES[1]])
        seen.append(short(solution))
        return solution.rest_length.sum()

    jax.eval_shape(jax.vmap(jax.grad(length)), 200.0 * jnp.ones((2, 12)))
    assert seen and "Solution: traced\n" in seen[0] and "[12] traced N" in seen[0]


@pytest.mark.slow_cases("Design")
@pytest.mark.parametrize("kind", ["Design", "Fit", "ConstrainedDesign", "Confidence"])
def test_of_optimizations(kind):
    fit = jc.fit(lambda p: jnp.concatenate([p - 1, p]), jnp.zeros(2))
    found = {
        "Design": lambda: jc.minimize(lambda x: jnp.sum(x**2), jnp.ones(2), steps=1),
        "Fit": lambda: fit,
        "ConstrainedDesign": lambda: jc.design.minimize_subject_to(
            lambda p: (p @ p, 1 - p), jnp.ones(2)
        ),
        "Confidence": lambda: jc.design.confidence(fit),
    }[kind]()
    text = short(found)
    assert text.startswith(kind)
    if kind == "Design":
        assert "status 8, maximum number of optimization steps reached" in text


def test_of_sections_laws_and_forms():
    section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(1e9))
    for thing in (section, jc.Polygonal([0, 1e-3], [0, 1e8]), jc.Newton(), jc.SelfWeight()):
        short(thing)
    large = jc.scenes.saddle(8, 8)[0]
    assert "Cables[" in short(large)
    assert "Structure" in repr(jc.scenes.flat_net()) and len(repr(jc.scenes.flat_net())) < 500
