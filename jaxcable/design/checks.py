"""Checks of load cases: utilizations, the cases that govern, and what has passed."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.solution import Solution
from ..common import checks as arguments
from ..common import status
from ..common.tree import apply_numpy_or_jax, pytree
from ..common.types import Array, Bool, Float, Int
from ..model.structure import Structure
from ..model.topology import require_same_topology
from ..programs.traced_function import evaluate_at_once
from .cable_checks import CableResistance, CableSafety, CableService
from .check import UTILIZATION, Check, describe_largest, input_with_unit
from .combinations import Combinations
from .result_envelopes import values_of_cases

RULES = {"EN 1993-1-11": (CableResistance, CableService), "ASCE 19": (CableSafety,)}
"""Checks of all cables of a structure, by the name of a standard."""


@pytree(static=("name", "of", "clause", "formula", "inputs", "not_covered", "items", "units"))
class CheckResult:
    """Result of one check: utilizations, and forces and resistances in the governing cases.

    Attributes:
        utilization: largest one of each item over the cases that count, [n_item], -; NaN where all
            of these have failed.
        case: indices of the cases that govern, [n_item].
        second_case: of checks of ranges: the cases at their lower ends, [n_item]; otherwise None.
        terms: forces, resistances and so on in these cases, by name, [n_item] each.
        values: utilizations in all cases that count, [n_counted, n_item]; for ranges the forces.
        counted: indices of the cases that count, [n_counted].
        name, clause, formula, not_covered: of the `Check`.
        of: limit states or rules whose combinations count; empty: all cases.
        inputs: pairs of names and texts: what was given.
        items: names of the items.
        units: pairs of names of terms and their units.

    Example:
        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e7, strength=300e3)
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, -2.0]], rope, supports=jc.pinned([0]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], (0, 0, -90e3))))
        >>> (found,) = jc.design.checks(structure, solution).results
        >>> print(found.items[0], found.terms["F_Ed"].round(), found.terms["F_Rd"], found.inputs)
        element 0 [90000.] [200000.] (('k_e', '1'), ('gamma_R', '1'), ('F_k (N)', 'not checked'))
    """

    utilization: Float[Array, " n_item"]
    case: Int[Array, " n_item"]
    second_case: Int[Array, " n_item"] | None
    terms: dict[str, Float[Array, " n_item"]]
    values: Float[Array, "n_counted n_item"]
    counted: Int[Array, " n_counted"]
    name: str
    of: tuple[str, ...]
    clause: str
    formula: str
    inputs: tuple[tuple[str, str], ...]
    not_covered: str
    items: tuple[str, ...]
    units: tuple[tuple[str, str], ...]

    @property
    def largest(self) -> Float[Array, ""]:
        """Largest utilization of all items, -; NaN if an item has none."""
        return apply_numpy_or_jax(lambda xp, used: xp.max(used), self.utilization)


@pytree(static=("names", "not_made"))
class Checks:
    """Checks of load cases: result of `checks`.

    Attributes:
        results: list of `CheckResult`, in the order of the checks.
        status: status codes of the cases, [n_case].
        stable: whether the cases end in a stable equilibrium, [n_case].
        names: of the cases.
        not_made: checks of the standard for which no case counts, in words.

    Example:
        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e7, strength=300e3)
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, -2.0]], rope, supports=jc.pinned([0]))
        >>> hung = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -1e3)))
        >>> cases = [jc.Phase(loads=jc.NodalLoads([1], (0, 0, -p))) for p in (60e3, 99e3)]
        >>> solutions = jc.design.solve_cases(structure, hung, cases)
        >>> found = jc.design.checks(structure, solutions, "ASCE 19", names=["snow", "ice"])
        >>> print(found.passed, found.governing("cable safety"))
        True ['ice']
        >>> print(found)
        cable safety: utilization 0.733, element 0, ice, ASCE 19, factor of safety on the minimum \
breaking strength
    """

    results: list[CheckResult]
    status: Int[Array, " n_case"]
    stable: Bool[Array, " n_case"]
    names: tuple[str, ...]
    not_made: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> CheckResult:
        """Return the result of a check by its name."""
        for one in self.results:
            if one.name == name:
                return one
        raise KeyError(f"{name!r}{arguments.suggest_names(name, self.utilization)}")

    @property
    def utilization(self) -> dict[str, Float[Array, " n_item"]]:
        """Utilizations by the name of the check."""
        return {one.name: one.utilization for one in self.results}

    @property
    def largest(self) -> Float[Array, ""]:
        """Largest utilization of all checks, -; NaN if an item has none. Differentiable."""
        of_each = [one.largest for one in self.results]
        return apply_numpy_or_jax(lambda xp, *used: xp.max(xp.stack(used)), *of_each)

    @property
    def failed(self) -> dict[str, int]:
        """Status codes of the cases that have failed, by name; nothing is known of them."""
        codes = zip(self.names, np.asarray(self.status).tolist(), strict=True)
        return {name: code for name, code in codes if code != status.OK}

    @property
    def unstable(self) -> list[str]:
        """Names of the cases that end in an unstable equilibrium, in which nothing stays."""
        sound = (np.asarray(self.status) != status.OK) | np.asarray(self.stable)
        return [name for name, is_sound in zip(self.names, sound, strict=True) if not is_sound]

    @property
    def unchecked(self) -> dict[str, list[str]]:
        """Items without a value in a case that has converged, by the name of the check.

        Other cases govern them; `passed` is False if none has a value.
        """
        good, found = np.asarray(self.status) == status.OK, {}
        for one in self.results:
            unknown = np.isnan(np.asarray(one.values)[good[np.asarray(one.counted)]]).any(axis=0)
            if unknown.any():
                found[one.name] = [one.items[k] for k in np.flatnonzero(unknown)]
        return found

    @property
    def passed(self) -> bool:
        """Whether all utilizations are at most 1, and all cases that count are OK and stable."""
        good = (np.asarray(self.status) == status.OK) & np.asarray(self.stable)
        sound = all(good[np.asarray(one.counted)].all() for one in self.results)
        return sound and bool(np.asarray(self.largest) <= 1.0)

    def governing(self, name: str) -> list[str]:
        """Return the names of the cases that govern each item of a check; "" without a value."""
        one = self[name]
        second = one.case if one.second_case is None else one.second_case
        arrays = one.case, second, one.utilization
        parts = zip(*(np.asarray(array).tolist() for array in arrays), strict=True)
        return [
            ""
            if np.isnan(used)
            else self.names[k]
            if one.second_case is None
            else f"{self.names[j]} to {self.names[k]}"
            for k, j, used in parts
        ]

    def __str__(self) -> str:
        lines = []
        for one in self.results:
            k, used = describe_largest(one.utilization, one.terms, dict(one.units))
            case = self.governing(one.name)[k] or "no case has a value"
            clause = f", {one.clause}" if one.clause else ""
            fails = "FAILS: " if one.utilization[k] > 1 else ""
            lines.append(f"{one.name}: {fails}{used}, {one.items[k]}, {case}{clause}")
        return "\n".join([*lines, *self.remarks()])

    def remarks(self) -> list[str]:
        """Return sentences on what has not been checked, and on unstable cases."""
        parts = (
            ("NOT CHECKED, because the analysis failed", self.failed),
            ("NOT passed, UNSTABLE at the end", self.unstable),
            *((f"NOT CHECKED by {k} in each case, no value", v) for k, v in self.unchecked.items()),
            ("NOT MADE", self.not_made),
        )
        return [f"{text}: {'; '.join(names)}" for text, names in parts if names]


def checks(
    structure: Structure,
    solutions: Solution,
    rules: str | Check | Sequence[str | Check] = "EN 1993-1-11",
    *,
    combinations: Combinations | None = None,
    names: Sequence[str] | None = None,
) -> Checks:
    """Check load cases: the utilization of every item, its clause and the case that governs.

    Args:
        structure: `Structure` that was analysed.
        solutions: `Solution` with a leading axis [n_case], as of `solve_cases`; or that of one
            case.
        rules: a `Check`; the name of a standard for all cables with a strength, "EN 1993-1-11"
            (`CableResistance`, and `CableService` where combinations of serviceability are given)
            or "ASCE 19" (`CableSafety`, 2.2); or a list of these.

    Options:
        combinations: the `Combinations` that `solutions` are the results of; checks of ultimate
            limit states then count ultimate combinations only, and so on, see `Check.of`. Without
            them every check counts all cases.
        names: of the cases, without combinations; default "case 0" and so on.

    Returns:
        `Checks`. Utilizations are differentiable, by the case that governs.

    Raises:
        ValueError: wrong arguments; a check without elements that it can be made for, or that none
            of the combinations counts for; two checks of the same name.

    Example:
        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e7, strength=300e3)
        >>> structure = jc.Structure([[0, 0, 0], [0, 0, -2.0]], rope, supports=jc.pinned([0]))
        >>> load = jc.NodalLoads([1], (0, 0, -60e3))
        >>> combinations = jc.design.combinations([jc.design.Action("crowd", "imposed A", load)])
        >>> hung = jc.Phase(loads=jc.NodalLoads([1], (0, 0, -1e3)))
        >>> solutions = jc.design.solve_cases(structure, hung, combinations)
        >>> print(jc.design.checks(structure, solutions, combinations=combinations))
        cable resistance: utilization 0.455, element 0, ULS 6.10-2, EN 1993-1-11:2006, 6.2
        cable service stress: utilization 0.452, element 0, SLS characteristic-2, \
EN 1993-1-11:2006, 7.2
    """
    if not isinstance(solutions, Solution):
        kind = arguments.describe_type(solutions, "solve_cases(structure, phases, cases)")
        raise ValueError(f"solutions: expected a Solution, got {kind}")
    require_same_topology(structure, solutions.last.topology, "solutions")
    if np.ndim(solutions.status) == 0:
        solutions = jax.tree.map(lambda x: jnp.asarray(x)[None], solutions)
    count = len(solutions.status)
    if combinations is not None:
        if not isinstance(combinations, Combinations):
            kind = arguments.describe_type(combinations, "design.combinations(actions)")
            raise ValueError(f"combinations: expected Combinations, got {kind}")
        if len(combinations) != count:
            raise ValueError(
                f"combinations: there are {len(combinations)} of them, and {count} solutions; give "
                "those that solve_cases had"
            )
        if names is not None:
            raise ValueError("names: combinations have names of their own; give one of them")
        names = combinations.names
    names = tuple(f"case {k}" for k in range(count)) if names is None else tuple(map(str, names))
    if len(names) != count or len(set(names)) < count:
        raise ValueError(f"names: expected {count} different ones, one for each case")
    made, not_made = _list_of_checks(rules, combinations)
    counted = [_counted_cases(one, combinations, count) for one in made]
    values = _values_of_checks(made, counted, structure, solutions)
    of = [tuple(one.of) if combinations is not None else () for one in made]
    parts = zip(made, of, counted, values, strict=True)
    results = [_check_result(*one, structure) for one in parts]
    return Checks(results, solutions.status, solutions.stable, names, not_made)


def require_checks(
    rules: str | Check | Sequence[str | Check], structure: Structure, argument: str = "rules"
) -> None:
    """Raise ValueError, which names the argument, for rules that `checks` refuses for a structure.

    These are entries that are no checks, and checks of groups or nodes that it does not have.
    """
    for one in _list_of_checks(rules, None, argument)[0]:
        try:
            one.items(structure)
        except ValueError as error:
            raise ValueError(f"{argument}: {error}") from None


def _list_of_checks(rules, combinations, argument="rules"):
    """Return the list of checks that `rules` name, and texts: checks for which no case counts."""
    several = isinstance(rules, list | tuple) and bool(rules)
    found, places, not_made = [], {}, ()
    expected = f"expected {' or '.join(RULES)} (cables), or a check such as MemberSection(...)"
    for k, entry in enumerate(rules if several else [rules]):
        place = f"{argument}[{k}]" if several else argument
        if isinstance(entry, str) and entry in RULES:
            made, left_out = _checks_of_standard(entry, combinations)
            not_made += left_out
        elif isinstance(entry, Check):
            made = [entry]
        else:
            given = repr(entry) if isinstance(entry, str) else type(entry).__name__
            raise ValueError(f"{place}: {expected} (members by EN 1993-1-1), got {given}")
        for one in made:
            if one.name in places:
                other = places[one.name]
                raise ValueError(
                    f"{place}: {one.name!r} is the name of {other}, too; give name=..."
                )
            places[one.name] = place
        found += made
    return found, not_made


def _checks_of_standard(name, combinations):
    """Return the checks of a standard that have cases, and texts that name those without."""
    found = [make() for make in RULES[name]]
    states = () if combinations is None else (*combinations.limit_states, *combinations.rules)
    known = [one for one in found if set(one.of) & set(states)]
    # without combinations all cases are taken for ultimate ones: the first check alone
    known = known or found[:1]
    names = [one.name for one in known]
    others = [one for one in found if one.name not in names]
    return known, tuple(f"{one.name}, without cases of {' or '.join(one.of)}" for one in others)


def _counted_cases(check, combinations, count):
    """Return the indices of the cases that count for a check, [n]; ValueError if none does."""
    if combinations is None or not check.of:
        return np.arange(count)
    pairs = zip(combinations.limit_states, combinations.rules, strict=True)
    found = np.flatnonzero([bool({state, rule} & set(check.of)) for state, rule in pairs])
    if not len(found):
        have = dict.fromkeys([*combinations.limit_states, *combinations.rules])
        raise ValueError(
            f"{check.name}: of = {check.of!r}: no combination is of it"
            f"{arguments.suggest_names(check.of[0], have)}"
        )
    return found


def _values_of_checks(made, counted, structure, solutions):
    """Return for each check: governing terms by name, (case, second case), values of all cases.

    `counted` are the indices of the cases that count, [n_counted], for each check.
    """
    orders: list[list[str]] = []  # transformations sort the keys of a dict
    n_case = len(solutions.status)

    def values(solutions):
        found = []
        for check, cases in zip(made, counted, strict=True):
            order: list[str] = []
            index = jnp.asarray(cases)

            def terms_of_case(solution, case, check=check, order=order):
                order[:] = terms = check.for_case(case, n_case).evaluate(structure, solution)
                return terms

            chosen = jax.tree.map(lambda x, index=index: jnp.asarray(x)[index], solutions)
            terms = values_of_cases(terms_of_case, chosen, index)
            terms = check.across_cases({name: terms[name] for name in order})
            governing, which, second = check.governing_terms(terms)
            orders.append(list(governing))
            places = index[which], None if second is None else index[second]
            found.append((list(governing.values()), places, terms[UTILIZATION]))
        return found

    found = evaluate_at_once(values, solutions)
    orders = orders[-len(made) :]  # of the last time that it was traced
    return [
        (dict(zip(order, terms, strict=True)), places, every)
        for order, (terms, places, every) in zip(orders, found, strict=True)
    ]


def _check_result(check, of, counted, values, structure):
    """Return the `CheckResult` of one check; `values` is its entry of `_values_of_checks`."""
    found, (which, second), every = values
    used = found.pop(UTILIZATION)
    items = tuple(check.items(structure)) or tuple(f"value {k}" for k in range(len(used)))
    if len(items) != len(used):
        raise ValueError(f"{check.name}: has {len(items)} names of items for {len(used)} values")
    left_out = check.skipped_text(structure)
    if left_out:
        arguments.warn_user(f"{check.name}: not checked: {left_out}")
    inputs = tuple(input_with_unit(name, value) for name, value in check.inputs().items())
    return CheckResult(
        used,
        which,
        second,
        found,
        every,
        jnp.asarray(counted),
        check.name,
        of,
        check.clause,
        check.formula,
        inputs,
        "; ".join(text for text in (check.not_covered, left_out) if text),
        items,
        tuple((name, check.units.get(name, "-")) for name in found),
    )
