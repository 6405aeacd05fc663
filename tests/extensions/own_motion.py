"""Motion in time, written outside of the package: a `System` with inertia and damping.

Time steps by the generalized-alpha method (Chung, Hulbert 1993): with the spectral radius rho of
very short waves from 0 to 1; without one the average acceleration (Newmark 1959).
"""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
from jax import lax

import jaxcable as jc
from jaxcable.common.tree import copy_with, merge_indices, pytree, split_indices
from jaxcable.elements.element_state import with_fields
from jaxcable.equilibrium.newton import equilibrate
from jaxcable.mechanics.assembly import System
from jaxcable.mechanics.restart_state import make_system
from jaxcable.numerics import implicit
from jaxcable.programs.program_calls import as_program
from jaxcable.stiffness import tangent

GRAVITY = 9.80665


@pytree
class InMotion:
    """What a step in time hands to the next one, beside the states of elements.

    From phase to phase only the velocity needs a place, in `Carry`: loads may jump there, so that
    the acceleration begins anew from balance (`let_go`). A phase in equilibrium leaves it zero.

    Attributes:
        motion: of all rows, [n_row, n_motion].
        velocity, acceleration: of all rows, translations and spins, [n_row, n_freedom].
        unbalanced: internal less external force without inertia, [n_row, n_freedom], N.
    """

    motion: object
    velocity: object
    acceleration: object
    unbalanced: object


@pytree(static=("rho",), kw_only=True)
class SystemInMotion(System):
    """A system at the end of a time step, whose external force includes inertia and damping.

    Elements with inner numbers are not foreseen.

    Attributes:
        begun: `InMotion` at the start of the step.
        masses: of elements, as `System.masses` gives them; they do not turn with the elements.
        damping: damping over mass, 1/s.
        duration: of the step, s.
        rho: spectral radius, or None.
    """

    begun: InMotion
    masses: list
    damping: object
    duration: object
    rho: object = None

    def _numbers(self):
        """Numbers alpha_m, alpha_f, beta, gamma of the method."""
        if self.rho is None:
            return 0.0, 0.0, 0.25, 0.5
        m, f = (2 * self.rho - 1) / (self.rho + 1), self.rho / (self.rho + 1)
        return m, f, 0.25 * (1 - m + f) ** 2, 0.5 - m + f

    def rates(self, begun, x):
        """Velocity and acceleration at a motion `x` of rows at the end of the step."""
        (_, _, beta, gamma), h = self._numbers(), self.duration
        mean = self.space.displacement_between(begun.motion, x) / h
        now = (mean - begun.velocity) / (beta * h) - (0.5 / beta - 1) * begun.acceleration
        return begun.velocity + h * ((1 - gamma) * begun.acceleration + gamma * now), now

    def _resistance(self, mass, begun, x):
        """Inertia and damping of one element by the motion of its ends, in their shape, N."""
        m, f, *_ = self._numbers()
        velocity, acceleration = self.rates(begun, x)
        total = (1 - m) * acceleration + m * begun.acceleration
        total = total + self.damping * ((1 - f) * velocity + f * begun.velocity)
        total = total[:, : len(mass) // len(x)]
        return self.space.pad_moments((mass @ total.reshape(-1)).reshape(total.shape)) / (1 - f)

    def external_force(self, x, row_step=None):
        at = x if row_step is None else self.space.motion_after_row_step(x, row_step)
        ends = []
        for group, mass in zip(self.groups, self.masses, strict=True):
            placed = jax.tree.map(lambda a, links=group.links: a[links], (self.begun, at))
            ends.append(jax.vmap(self._resistance)(mass, *placed))
        f = self._numbers()[1]
        against = self.sum_at_rows(ends) + f / (1 - f) * self.begun.unbalanced
        against = against if row_step is None else self.space.conjugate_loads(against, row_step)
        return super().external_force(x, row_step) - against

    def external_stiffness_parts(self, x):
        def of_element(mass, begun, x):
            def force(step):
                step = self.space.pad_moments(step)
                resistance = self._resistance(
                    mass, begun, self.space.motion_after_row_step(x, step)
                )
                return self.space.conjugate_loads(resistance, step)[:, :width]

            width = len(mass) // len(x)
            return jax.jacfwd(force)(jnp.zeros((len(x), width)))

        blocks = []
        for group, mass in zip(self.groups, self.masses, strict=True):
            placed = jax.tree.map(lambda a, links=group.links: a[links], (self.begun, x))
            blocks.append(jax.vmap(of_element)(mass, *placed))
        return [*super().external_stiffness_parts(x), *self.matrix_parts(blocks, x)]

    def nodes_without_stiffness(self, motion, slack=None):
        return jnp.zeros(len(motion), bool)  # a node that only slack cables touch has a mass


def moving(system, begun, masses, duration, damping=0.0, rho=None):
    """The `SystemInMotion` of a system at the end of a step."""
    given = {field.name: getattr(system, field.name) for field in dataclasses.fields(system)}
    numbers = {"damping": damping, "duration": duration, "rho": rho}
    return SystemInMotion(**given, begun=begun, masses=masses, **numbers)


def step_in_time(system, begun, masses, duration, damping=0.0, rho=None, method=None):
    """A step in time: the system with the memory after it, `InMotion`, and the status."""
    end = moving(system, begun, masses, duration, damping, rho)
    method = jc.Newton() if method is None else method
    outcome, _ = equilibrate(lax.stop_gradient(end), begun.motion, method, True)
    x = implicit.attach_derivative(end, outcome.x, outcome.equilibrated)
    ended = InMotion(x, *end.rates(begun, x), system.unbalanced(x))
    if system.has_memory:
        pairs = zip(system.states, system.commit_memory(x, duration=duration), strict=True)
        states = [state if new is None else with_fields(state, memory=new) for state, new in pairs]
        system = copy_with(system, states=states)
    return system, ended, outcome.code


def at_rest(structure, solution):
    """The system of a solution, and its motion."""
    without_indices, arrays, dof_map = tangent.split_solution_state(structure, solution)
    nodes, groups, restart = tangent.merge_solution_state(without_indices, arrays)
    return make_system(nodes, groups, restart, restart.motion, dof_map), restart.motion


def let_go(system, x, velocity, damping=0.0, distribution=None):
    """`InMotion` at a motion `x` with a velocity [n_row, n_freedom]; masses of the elements."""
    mass = system.mass_matrix(x, GRAVITY, distribution)
    size, axes = jnp.linalg.eigh(mass)
    inverse = jnp.where(size > 1e-12 * size.max(), 1 / size, 0.0)  # a spin may have no mass
    pulled = axes @ (inverse * (axes.T @ -system.residual(x)))
    acceleration = system.space.prolong(x, pulled) - damping * velocity
    begun = InMotion(x, velocity, acceleration, system.unbalanced(x))
    return begun, system.mass_matrices(x, GRAVITY, distribution)


@partial(as_program, static=("rho",))
def _program(without_indices, arrays, states, *numbers, rho):
    system = copy_with(merge_indices(without_indices, arrays), states=states)
    system, ended, code = step_in_time(system, *numbers, rho)
    return system.states, ended, code


def history(system, start, duration, count, damping=0.0, rho=None):
    """A number of steps: `InMotion` at the start (of `let_go`) and after each, and statuses."""
    (without_indices, arrays), states = split_indices(copy_with(system, states=None)), system.states
    (begun, masses), codes = start, []
    found = [begun]
    for _ in range(count):
        given = without_indices, arrays, states, found[-1], masses, duration, damping
        states, ended, code = _program(*given, rho=rho)
        found.append(ended)
        codes.append(int(code))
    return found, codes
