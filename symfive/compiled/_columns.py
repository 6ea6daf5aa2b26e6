"""A CasADi function of scalars interpreted column by column: one array operation over all rows for each instruction.

CasADi's interpreter goes through all instructions row by row, and computes for every row anew what is the same for all: the
set-up, the location errors, the harmonics of an axis that stands. Here what does not change from row to row is computed once.
The bits are CasADi's: products and sums are rounded alike, and sines come from the same C library.
"""

from __future__ import annotations

import math
import operator
import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array

Value = float | Array
CHUNK = 1024
"""Rows at a time: the columns at work stay in the processor's cache."""
FEWEST = 256
"""Of fewer rows CasADi's interpreter is faster: an array operation costs as much as that takes for about so many."""
SHARE = 0.25
"""Of what CasADi's interpreter costs for many rows, of large functions, whose compiling costs (small ones: up to 0.6)."""


_OWN = threading.local()


def _each(number: Callable[..., float], column: Callable[..., Any]) -> Callable[..., Value]:
    """A function of the C library: of numbers, where it raises if it has no value, or of columns, in one loop of CasADi's."""

    def applied(*given: Value) -> Value:
        size = next((len(value) for value in given if isinstance(value, np.ndarray)), None)
        if size is None:
            return number(*given)
        trigger, sources, result = _loop(column, len(given))
        for source, value in zip(sources, given, strict=True):
            source[:size] = value
        trigger()
        return result[:size].copy()

    return applied


def _loop(function: Callable[..., Any], count: int) -> tuple[Callable[[], None], list[Array], Array]:
    """What evaluates a function of so many columns of `CHUNK` numbers, of this thread, with its arguments and its result."""
    loops: dict[Any, Any] = _OWN.__dict__.setdefault("loops", {})
    if function not in loops:
        columns = [ca.MX.sym(f"column{i}", CHUNK) for i in range(count)]
        loop: Any = ca.Function("loop", columns, [function(*columns)])
        buffer, trigger = loop.buffer()
        sources, result = [np.zeros(CHUNK) for _ in columns], np.zeros(CHUNK)
        for i, source in enumerate(sources):
            buffer.set_arg(i, source.data)
        buffer.set_res(0, result.data)
        loops[function] = buffer, trigger, sources, result
    return loops[function][1:]  # type: ignore[no-any-return]


def _number(value: Any) -> Value:
    """A number of numpy's as one of Python's."""
    return value if isinstance(value, np.ndarray) and value.ndim else float(value)


def _extreme(which: Callable[[Any, Any], Any]) -> Callable[..., Value]:
    """The smaller or the larger one; of two equal ones, which may be zeros of either sign, the first."""
    return lambda one, other: _number(np.where(np.equal(one, other), one, which(one, other)))


def _if(condition: Value, value: Value) -> Value:
    """The value where the condition is not zero, else zero."""
    if isinstance(condition, np.ndarray) or isinstance(value, np.ndarray):
        return np.where(np.not_equal(condition, 0.0), value, 0.0)
    return value if condition != 0.0 else 0.0


def _compared(compare: Callable[..., Any]) -> Callable[..., Value]:
    """A comparison as 0 or 1."""

    def compared(*given: Value) -> Value:
        said = compare(*given)
        return said.astype(float) if isinstance(said, np.ndarray) else float(said)

    return compared


_ROUNDED: dict[int, tuple[Callable[..., float], Callable[..., Array], bool]] = {
    ca.OP_ADD: (operator.add, np.add, False),
    ca.OP_SUB: (operator.sub, np.subtract, False),
    ca.OP_MUL: (operator.mul, np.multiply, False),
    ca.OP_DIV: (operator.truediv, np.divide, False),
    ca.OP_NEG: (operator.neg, np.negative, False),
    ca.OP_FABS: (abs, np.absolute, False),
    ca.OP_SQRT: (math.sqrt, np.sqrt, False),
    ca.OP_SQ: (operator.mul, np.multiply, True),
    ca.OP_TWICE: (operator.add, np.add, True),
}
"""Operations that IEEE 754 rounds in one way only: of numbers, of columns, whether their one argument is taken twice."""
_LIBRARY: dict[int, Callable[..., Value]] = {
    ca.OP_SIN: _each(math.sin, ca.sin), ca.OP_COS: _each(math.cos, ca.cos), ca.OP_TAN: _each(math.tan, ca.tan),
    ca.OP_ATAN: _each(math.atan, ca.atan), ca.OP_ATAN2: _each(math.atan2, ca.atan2), ca.OP_EXP: _each(math.exp, ca.exp),
    ca.OP_LOG: _each(math.log, ca.log), ca.OP_TANH: _each(math.tanh, ca.tanh), ca.OP_POW: _each(math.pow, operator.pow),
    ca.OP_CONSTPOW: _each(math.pow, ca.constpow), ca.OP_IF_ELSE_ZERO: _if,
    ca.OP_LT: _compared(operator.lt), ca.OP_LE: _compared(operator.le),
    ca.OP_EQ: _compared(operator.eq), ca.OP_NE: _compared(operator.ne),
    ca.OP_FMIN: _extreme(np.fmin), ca.OP_FMAX: _extreme(np.fmax), ca.OP_SIGN: lambda value: _number(
        np.where(np.less(value, 0.0), -1.0, np.where(np.greater(value, 0.0), 1.0, value))),
    ca.OP_FLOOR: lambda value: _number(np.floor(value)), ca.OP_CEIL: lambda value: _number(np.ceil(value)),
    ca.OP_FMOD: _each(math.fmod, ca.fmod), ca.OP_NOT: _compared(partial(operator.eq, 0.0)),
    ca.OP_AND: _compared(lambda one, other: (one != 0.0) & (other != 0.0)),
    ca.OP_OR: _compared(lambda one, other: (one != 0.0) | (other != 0.0)),
    ca.OP_INV: lambda value: 1.0 / value, ca.OP_ASSIGN: lambda value: value,
}  # fmt: skip
"""All others, of numbers or columns."""


def _scratch(size: int) -> Array:
    """Columns (size, `CHUNK`) to compute in, of this thread; all functions take them in turn."""
    found: Array | None = getattr(_OWN, "columns", None)
    if found is None or len(found) < size:
        found = _OWN.columns = np.empty((size, CHUNK))
    return found[:size]


class Columns:
    """The program of a function over rows; `held` inputs are the same for all of them. Raises `NotImplementedError` for a
    function with operations that it does not know."""

    def __init__(self, function: Any, held: tuple[int, ...]) -> None:
        if not function.is_a("SXFunction"):
            raise NotImplementedError("not a function of scalars")
        self.held = held
        self._inputs: list[tuple[int, int, int]] = []
        self._steps: list[tuple[int, int, int, Any, Any]] = []
        self._outputs: list[tuple[int, int, int]] = []
        self._size = function.sz_w()
        self._read(function)

    def _read(self, function: Any) -> None:
        """Instructions as (slot of the result, slots of the arguments, operation of numbers, operation of columns); constants,
        inputs and results as steps of their own kind."""
        for k in range(function.n_instructions()):
            op, out = function.instruction_id(k), function.instruction_output(k)
            if op == ca.OP_CONST:
                self._steps.append((out[0], -1, -1, float(function.instruction_constant(k)), None))
            elif op == ca.OP_INPUT:
                which, place = function.instruction_input(k)
                self._steps.append((out[0], -2, -1, which, place))
            elif op == ca.OP_OUTPUT:
                which, place = out
                self._steps.append((function.instruction_input(k)[0], -3, -1, which, place))
            else:
                first, *more = function.instruction_input(k)
                if op in _ROUNDED:
                    number, column, twice = _ROUNDED[op]
                    self._steps.append((out[0], first, first if twice else (more or [-1])[0], number, column))
                elif op in _LIBRARY:
                    self._steps.append((out[0], first, (more or [-1])[0], _LIBRARY[op], None))
                else:
                    raise NotImplementedError(f"operation {op}")

    def __call__(self, given: Sequence[Array], results: Sequence[Array], first: int, last: int) -> bool:
        """Write the results of rows `first` to `last`; False where an operation has no number, which is left to CasADi."""
        with np.errstate(all="ignore"):
            try:
                for start in range(first, last, CHUNK):
                    self._rows(given, results, start, min(start + CHUNK, last))
            except (ArithmeticError, ValueError):
                return False
        return True

    def _rows(self, given: Sequence[Array], results: Sequence[Array], first: int, last: int) -> None:
        slots: list[Value] = [0.0] * self._size
        buffers = [*_scratch(self._size)[:, : last - first]]
        inputs = [
            value.tolist() if i in self.held else [_steady(column) for column in value[first:last].T.copy()]
            for i, value in enumerate(given)
        ]
        for out, a, b, number, column in self._steps:
            if a >= 0:
                x = slots[a]
                if b < 0:
                    slots[out] = number(x) if column is None or type(x) is float else column(x, buffers[out])
                else:
                    y = slots[b]
                    if column is None or (type(x) is float and type(y) is float):
                        slots[out] = number(x, y)
                    else:
                        slots[out] = column(x, y, buffers[out])
            elif a == -1:
                slots[out] = number
            elif a == -2:
                slots[out] = inputs[number][column]
            else:
                results[number][first:last, column] = slots[out]


def _steady(column: Array) -> Value:
    """A column, or its one number where that is the same to the last bit."""
    bits = column.view(np.int64)
    return float(column[0]) if (bits == bits[0]).all() else column
