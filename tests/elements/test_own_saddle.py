"""A rope over a saddle, written in a test file: inputs of own elements, phase by phase."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from extensions.own_saddle import Saddles
from numpy.testing import assert_allclose
from oracles.convergence import converged
from oracles.taylor import assert_gradient
from oracles.traced import traced

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.common import status
from jaxcable.files.codec import TYPES

EA, MU, PULL = 1e6, 0.2, 1000.0
NODES = np.array([[-3.0, 0.0, -4.0], [0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])  # sides of 5 m
TURN = np.arccos(0.6)  # of the rope at its saddle


def rope(**groups):
    """A rope from an anchor over a fixed saddle to an end that moves along its side."""
    groups = groups or {"ropes": Saddles([[0, 1, 2]], EA)}
    return jc.Structure(NODES, groups, jc.pinned([0, 1]) + jc.restrained([2], "yz"))


def pulled(force, **own):
    """A phase that adds a force at the end, and states what is given of the rope."""
    load = jc.NodalLoads([2], jnp.stack([force, 0.0, 0.0]) if force else (0.0, 0.0, 0.0))
    stated = {name: {"ropes": value} for name, value in own.items()}
    clamped = stated.pop("clamped", None)  # `Phase` has an argument of this name
    return jc.Phase(loads=load, increments=2, own=stated or None, clamped=clamped)


def history(mu=MU):
    return [
        pulled(PULL, friction=mu),  # slides towards the end
        pulled(-0.8 * PULL),  # slides back
        pulled(0.05 * PULL),  # sticks
        pulled(2 * PULL, clamped=1.0),
        pulled(0.5 * PULL, clamped=jc.only([0], 0.0)),  # slides by what the clamp has held
        pulled(-0.25 * PULL, friction=0.0),
    ]


@pytest.mark.slow
def test_forces_are_those_of_euler_and_of_the_clamp():
    """The forces on the first side follow from those at the end, and all lengths from forces."""
    solution = converged(jc.solve(rope(), history()))
    k = np.exp(MU * TURN)
    last = PULL * np.cumsum([1.0, -0.8, 0.05, 2.0, 0.5, -0.25])
    stays = 0.2 * PULL * k  # after sliding back: it sticks below 0.2 PULL k^2, and a clamp holds it
    first = [PULL / k, stays, stays, stays, last[4] / k, last[5]]
    assert 0.25 < 0.2 * k**2
    results = [phase.results["rope_forces"]["ropes"][0] for phase in solution.phases]
    # tol 1e-10 of the residual
    assert_allclose(results, np.stack([first, last], axis=1), rtol=1e-8)
    rest = 10.0 - 5.0 / (1 + np.array(first) / EA)
    moved = rest * (1 + last / EA) - 5.0
    found = [phase.positions[2, 0] - NODES[2, 0] for phase in solution.phases]
    assert_allclose(found, moved, rtol=1e-7)
    assert_allclose(solution.reactions[0], np.array([-0.6, 0.0, -0.8]) * first[-1], rtol=1e-8)


def end(p):
    """Where the end is after five phases, by friction, and the force in the anchor after two."""
    solution = jc.solve(rope(), history(MU * p)[:5])
    return solution.displacement[2, 0] + solution.phases[1].reactions[0, 0] / EA, solution.status


@pytest.mark.slow
def test_gradient_by_a_statement():
    assert_gradient(end, 1.0, 0.5)
    many, codes = jax.vmap(end)(jnp.array([0.5, 1.0]))
    assert not codes.any()
    assert_allclose(many[1], end(1.0)[0], rtol=1e-10)


def test_traced_numbers_keep_their_rules():
    def code(stiffness, friction):
        ropes = Saddles([[0, 1, 2]], stiffness)
        return jc.solve(rope(ropes=ropes), history(friction)[:1]).status

    codes = traced(jax.vmap(code))(jnp.array([EA, -EA, EA]), jnp.array([MU, MU, -MU]))
    assert codes.tolist() == [status.OK, status.INVALID_INPUT, status.INVALID_INPUT]


def test_commands_import_own_classes(tmp_path, monkeypatch, capsys):
    """A module of the folder that the command line names registers them; without it they are
    unknown, and one that is not there is refused."""
    scene = rope(), [pulled(PULL, friction=MU)]
    jc.save_scene(tmp_path / "rope.json", scene)
    text = "from extensions import own_saddle\nown_saddle.register(own_saddle.Saddles)\n"
    (tmp_path / "my_ropes.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(TYPES, "Saddles")
    before = list(sys.path)
    assert main(["info", "rope.json"]) == 2
    assert "unknown type 'Saddles'" in capsys.readouterr().err
    assert main(["info", "rope.json", "--import", "my_strings"]) == 2
    assert "--import: No module named 'my_strings'" in capsys.readouterr().err
    assert main(["info", "rope.json", "--import", "my_ropes"]) == 0
    assert "friction 0.2" in capsys.readouterr().out
    assert sys.path == before
