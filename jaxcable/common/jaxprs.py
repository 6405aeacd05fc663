"""What stands in jaxprs, the traced programs of jax: equations, results, what these depend on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def is_jaxpr(value: Any) -> bool:
    """Tell whether a value is a jaxpr, with its constants or without."""
    return hasattr(value, "eqns") and (hasattr(value, "consts") or hasattr(value, "constvars"))


def is_jaxpr_literal(value: Any) -> bool:
    """Tell whether an operand of an equation in a jaxpr is a literal number, not a variable."""
    return hasattr(value, "val") and hasattr(value, "aval")


def results_that_depend(jaxpr: Any, on: Sequence[bool]) -> list[bool]:
    """Tell which results of a jaxpr depend on some of its arguments: those where `on` is true."""
    found = {x for x, asked in zip(jaxpr.invars, on, strict=True) if asked}
    for equation in jaxpr.eqns:
        if any(not is_jaxpr_literal(x) and x in found for x in equation.invars):
            found.update(equation.outvars)
    return [not is_jaxpr_literal(x) and x in found for x in jaxpr.outvars]


def scan_operand_counts(parameters: dict[str, Any]) -> tuple[int, int]:
    """Return the numbers of constants and of carried values of a `scan`, from its parameters."""
    if "num_consts" in parameters:
        return parameters["num_consts"], parameters["num_carry"]
    groups = parameters["ft_in"].unpack()  # since jax 0.12
    return len(groups[0]), len(groups[1])
