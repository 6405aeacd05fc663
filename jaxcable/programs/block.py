"""Source text of a program under construction: values, lines, blocks.

A program is written as Python source in blocks: functions, bodies of loops, branches. What does not
change in a loop is written before it, what is known is computed while the program is written, and
what has been written before is not written again.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

_LARGEST_FOLDED = 200_000  # entries of an array that is computed while the program is written
_DEEPEST = 21  # depth of blocks: Python allows for 20 loops in one another
_ENTRIES_PER_CALL = 1000  # entries that NumPy works on in the time that a call of it takes


class Value(NamedTuple):
    """A value in the source text of a program.

    Attributes:
        name: name of its variable or constant in the source.
        shape: shape that it has in jax's program, None for what is no array.
        dtype: its dtype.
        held: shape of the array that stands for it in the source: `shape`, or with length 1 along
            axes where all entries are alike, or () for a number. NumPy broadcasts it.
        depth: depth of the block that computes it; 0 for constants.
    """

    name: str
    shape: tuple[int, ...] | None
    dtype: np.dtype[Any] | None
    held: tuple[int, ...] | None
    depth: int


class Names:
    """Names in the source of a program, and the constants and functions that they stand for.

    Args:
        functions: modules and functions that the source calls, by name.
        make_function: makes a Python function of these names and a jaxpr, as
            `writing.make_function`.
        n_call: number of calls of each jaxpr in the program, by its address (`id`).

    Attributes:
        space: globals of the program's functions, with the values of constants.
        kept: addresses (`id`) of the arrays among these.
    """

    def __init__(
        self,
        functions: dict[str, Any],
        make_function: Callable[..., Any],
        n_call: dict[int, int],
    ):
        self.space = dict(functions)
        self.make_function, self._n_call = make_function, n_call
        self._functions: dict[int, Any] = {}  # with the program, so that it stays
        self.kept: set[int] = set()
        self._count = itertools.count()
        self._by_content: dict[Any, Value] = {}
        self._helpers: dict[Any, str] = {}

    def new(self, letter: str = "v") -> str:
        """Return a name that is not used yet: a letter and a running number."""
        return f"{letter}{next(self._count)}"

    def constant(self, x: Any, shape: tuple[int, ...] | None = None) -> Value:
        """Return the `Value` of a known array or number; small equal ones share a name.

        An array of equal entries is stored as a number. `shape` is that in jax's program, if `x` is
        stored in a smaller one.
        """
        x = np.asarray(x)
        shape = x.shape if shape is None else shape
        if x.size > 1 and x.size <= _LARGEST_FOLDED and _is_uniform(x):
            x = x.reshape(-1)[0]
        held = x.shape
        key = (x.dtype, held, x.tobytes()) if x.size <= 16 else id(x)
        found = self._by_content.get(key)
        if found is None:
            name = self.new("c")
            x = self.space[name] = x if x.ndim else x[()]
            self.kept.add(id(x))
            found = self._by_content[key] = Value(name, shape, x.dtype, held, 0)
        return found._replace(shape=shape)

    def broadcast_constant(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """Return the array of full `shape` of the constant `name`, stored in a smaller one."""
        return np.array(np.broadcast_to(self.space[name], shape))

    def function_name(self, program: Any) -> str:
        """Return the name of the function that computes a jaxpr, written at its first call."""
        return self.deferred_function_name(program, lambda: program)

    def deferred_function_name(self, owner: Any, make: Callable[[], Any]) -> str:
        """Return the name of a function whose jaxpr is made, and written, when it is first called.

        Args:
            owner: object that stands for the function: for the same one the name is the same.
            make: returns the jaxpr.
        """
        key = id(owner)
        if key not in self._functions:
            name = self.new("g")

            def first(*arguments):
                self.space[name] = self.make_function(self, make())
                return self.space[name](*arguments)

            self.space[name] = first
            self._functions[key] = name, owner
        return self._functions[key][0]

    def add_call_counts(self, counts: dict[int, int]) -> None:
        """Add numbers of calls of jaxprs, by address (`id`), of a part that was traced later."""
        self._n_call = {**self._n_call, **counts}

    def is_called_once(self, jaxpr: Any) -> bool:
        """Tell whether a jaxpr of the program is called in one place only."""
        return self._n_call.get(id(jaxpr)) == 1

    def helper(self, make: Callable[..., Any], *static: Hashable) -> str:
        """Return the name of the function that ``make(*static)`` returns, made once."""
        key = make, static
        name = self._helpers.get(key)
        if name is None:
            name = self.new("h")
            self.space[name] = found = make(*static)  # before another thread can find the name
            self.kept.add(id(found))
            self._helpers[key] = name
        return name


def _is_uniform(x):
    """Return whether all entries of an array are equal bit by bit."""
    return x.tobytes() == x.reshape(-1)[:1].tobytes() * x.size


class Block:
    """A block of Python source under construction: a function, the body of a loop, a branch.

    Args:
        names: `Names` of the program.
        parent: the block that contains it; None for a function.
        is_loop: whether it is the body of a loop.

    Attributes:
        depth: 1 for a function, one more for each block around.
        lines: its lines; a pair is a header, such as that of a loop, with the block below it.
        work: work of running the block once, in calls of a NumPy function.
    """

    def __init__(self, names: Names, parent: Block | None = None, is_loop: bool = False):
        self.names, self.parent, self.is_loop = names, parent, is_loop
        self.depth: int = 1 if parent is None else parent.depth + 1
        if self.depth > _DEEPEST:
            raise NotImplementedError("loops and branches within too many others")
        self.lines: list[str | tuple[str, Block]] = []  # a line, or a header with its block
        self.work = 0.0
        self._written: dict[Any, Any] = {}

    def child(self, is_loop: bool = False) -> Block:
        """Return a block within this one."""
        return Block(self.names, self, is_loop)

    def write(
        self,
        template: str,
        inputs: Sequence[Value],
        shape: tuple[int, ...] | None,
        dtype: Any,
        held: tuple[int, ...] | None = None,
        work: float | None = None,
    ) -> Value:
        """Write an assignment of an expression to a new variable, and return its value.

        An expression of constants is computed now; one that is written already is not written
        again; one that does not change in a loop is written before it.

        Args:
            template: the expression, with {0}, {1}, ... for the inputs.
            inputs: values in the expression.
            shape, dtype, held: of the result, as of `Value`; `held` is `shape` if it is None.
            work: work of the expression, in calls of a NumPy function; None: one, and one per 1000
                entries.
        """
        held = shape if held is None else held
        entries = math.prod(held or ())
        names = tuple(x.name for x in inputs)
        if all(x.depth == 0 for x in inputs) and entries <= _LARGEST_FOLDED and shape is not None:
            known = eval(template.format(*names), self.names.space)
            return self.names.constant(known, shape)
        block = self._outermost(inputs)
        found = block.find(template, names)
        if found is None:
            found = Value(self.names.new(), shape, dtype, held, block.depth)
            block.lines.append(f"{found.name}={template.format(*names)}")
            block.work += 1 + entries / _ENTRIES_PER_CALL if work is None else work
            block._written[template, names] = found
        return found._replace(shape=shape)

    def write_call(
        self, text: str, inputs: Sequence[Value], avals: Sequence[Any], pure: bool = True
    ) -> list[Value]:
        """Write a call that returns a tuple of arrays in full shapes; return their values, a list.

        Args:
            text: template of the call, with {0}, {1}, ... for the inputs.
            inputs: values in the call.
            avals: abstract arrays with the shapes and dtypes of the results.
            pure: whether equal calls have equal results and no effects, so that one of them is
                enough.
        """
        names = tuple(x.name for x in inputs)
        block = self._outermost(inputs) if pure else self
        found = block.find(text, names) if pure else None
        if found is None:
            found = [
                Value(
                    self.names.new(), tuple(a.shape), np.dtype(a.dtype), tuple(a.shape), block.depth
                )
                for a in avals
            ]
            left = "".join(x.name + "," for x in found)
            line = text.format(*names)
            block.lines.append(f"({left})={line}" if found else line)
            block.work += 1
            if pure:
                block._written[text, names] = found
        return found

    def allocate(self, x: Value) -> None:
        """Write the allocation of the array of a variable, without setting its entries."""
        self.lines.append(f"{x.name}=np.empty({x.shape},'{x.dtype}')")

    def write_work_count(self) -> None:
        """Write, at the end of a loop's body, lines that count its work and stop at the limit."""
        self.lines += [f"w[0]+={round(self.work, 1)}", "if w[0]>w[1]: raise LimitReachedError"]

    def _outermost(self, inputs):
        """Return the outermost block, leaving loops only, in which all inputs are known.

        There an expression of these inputs is computed once, not in every turn.
        """
        block, depth = self, max((x.depth for x in inputs), default=0)
        while block.is_loop and depth < block.depth:
            block = block.parent
        return block

    def find(self, template: str, names: tuple[str, ...]) -> Any:
        """Return the value (or values) already written for an expression, here or in blocks around.

        `template` and `names` are the expression and its inputs; None if it has not been written.
        """
        block: Block | None = self
        while block is not None:
            found = block._written.get((template, names))
            if found is not None:
                return found
            block = block.parent
        return None

    def assign(self, names: Sequence[str], values: Sequence[Value]) -> None:
        """Write one assignment of values to variables with these names, all at once."""
        if names:
            self.lines.append(f"{','.join(names)}={','.join(x.name for x in values)}")

    def full(self, x: Value) -> Value:
        """Return `x` as a value whose array has its full shape; broadcast, if it is smaller."""
        if x.shape is None or x.held == x.shape:
            return x
        if x.depth == 0:
            name = self.names.helper(self.names.broadcast_constant, x.name, x.shape)
            return Value(name, x.shape, x.dtype, x.shape, 0)
        ones = self.names.helper(np.ones, x.shape, x.dtype)
        sign = "&" if np.dtype(x.dtype) == bool else "*"
        return self.write(f"{{0}}{sign}{ones}", [x], x.shape, x.dtype)

    def render(self, indent: str = "") -> Iterator[str]:
        """Yield the lines of source of the block and of the blocks in it, each after `indent`."""
        for line in self.lines or ["pass"]:
            header, block = (line, None) if isinstance(line, str) else line
            yield indent + header
            if block is not None:
                yield from block.render(indent + " ")
