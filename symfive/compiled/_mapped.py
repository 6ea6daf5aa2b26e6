"""A CasADi function over rows: by CasADi's interpreter at first, by machine code once that is cheaper, with the same bits.

Ski-rental rule (R. Karp 1992): compile once interpreting has cost as much as compiling would. Then no sequence of calls costs
more than twice the optimum. Costs are counted in operations, not in seconds, so that the same calls always take the same
decisions. Machine code left on disk by an earlier run is cheap and is looked for early; interpretation in earlier runs counts.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.compiled._cache import cache_folder
from symfive.compiled._columns import FEWEST, SHARE, Columns
from symfive.compiled._library import (
    SWITCH,
    Compiler,
    Library,
    compiled,
    find_compiler,
    found,
    interpretation_s,
    key_of,
    note_interpretation,
)

BLOCK = 64
"""Rows in one call of the interpreter, at most."""
PIECE = 4096
"""Rows that are interpreted before the rule is applied again."""
INTERPRETED_S = 5e-9
"""Of one operation on one row. These costs are of one processor; only their ratios matter, which vary little."""
LOOKED_UP_S, LOOKED_UP_OPERATION_S = 3e-3, 3e-6
COMPILED_S, COMPILED_OPERATION_S = 0.05, 1.8e-4
NOTED = 0.05
"""Interpretation is noted for later runs whenever it has grown by this share of what compiling costs, so that what many runs cost
adds up."""
MOST_OPERATIONS = 40_000


@dataclass(frozen=True)
class Status:
    """State of compiled evaluation in this process: `compiler` (its path, None without one or where `SYMFIVE_COMPILER` is
    `none`), `folder` of the libraries (None where it cannot be used), how many functions were `compiled` or `loaded` from
    disk, and why others stayed interpreted (`refused`: reason → how many)."""

    compiler: str | None
    folder: str | None
    compiled: int
    loaded: int
    refused: dict[str, int]


@dataclass
class _State:
    """Of one function: seconds of interpretation so far and how many are noted on disk, its library, whether the decision is
    final."""

    spent: float = 0.0
    noted: float = 0.0
    looked: bool = False
    settled: bool = False
    key: str = ""
    library: Library | None = None


_STATES: dict[str, _State] = {}
_MADE: Counter[str] = Counter()
_REFUSED: Counter[str] = Counter()
_LOCK = threading.RLock()


def status() -> Status:
    """How the functions of this process are evaluated."""
    compiler = find_compiler()
    try:
        folder = str(cache_folder())
    except OSError:
        folder = None
    name = compiler.program if compiler else None
    return Status(name, folder, _MADE["compiled"], _MADE["loaded"], dict(_REFUSED))


@dataclass
class Mapped:
    """A CasADi function over rows.

    `function`: dense inputs and results. Inputs of the indices `held` are the same for all rows and given once, shape
    (elements,); the others have one row each, (n, elements), elements column by column. Each result is (n, elements).
    """

    function: Any
    held: tuple[int, ...] = ()
    _state: _State = field(default_factory=_State, repr=False)
    _blocks: dict[int, Any] = field(default_factory=dict, repr=False)
    _columns: Columns | None = field(default=None, repr=False)
    _tried: bool = field(default=False, repr=False)
    _lock: Any = field(default_factory=threading.Lock, repr=False)

    def __post_init__(self) -> None:
        self._inputs = [self.function.numel_in(i) for i in range(self.function.n_in())]
        self._outputs = [self.function.numel_out(i) for i in range(self.function.n_out())]
        self._operations = self.function.n_instructions()

    @property
    def compiled(self) -> bool:
        """Whether machine code evaluates it."""
        return self._state.library is not None

    def __reduce__(self) -> tuple[type[Mapped], tuple[Any, tuple[int, ...]]]:
        return Mapped, (self.function, self.held)

    def __call__(self, *inputs: Array) -> list[Array]:
        """Every result for all rows. Raises `ValueError` for inputs of other shapes."""
        given, rows = self._checked(inputs)
        results = [np.empty((rows, size)) for size in self._outputs]
        first = 0
        while first < rows:
            if (library := self._state.library) is not None:
                rest = [value if i in self.held else value[first:] for i, value in enumerate(given)]
                library(rows - first, rest, [result[first:] for result in results])
                break
            last = min(rows, first + PIECE)
            cost = self._interpret(given, results, first, last)
            self._state.spent += (last - first) * self._operations * cost
            self._count(given, results, first, last)
            first = last
        return results

    def _checked(self, inputs: Sequence[Array]) -> tuple[list[Array], int]:
        given = [np.ascontiguousarray(value, dtype=float) for value in inputs]
        rows = next(len(value) for i, value in enumerate(given) if i not in self.held)
        wanted = [(size,) if i in self.held else (rows, size) for i, size in enumerate(self._inputs)]
        if [value.shape for value in given] != wanted:
            raise ValueError(f"inputs of the shapes {[value.shape for value in given]}, not {wanted}")
        return given, rows

    # ---- by the interpreter

    def _interpret(self, given: Sequence[Array], results: Sequence[Array], first: int, last: int) -> float:
        """Write these rows of the results; returns what an operation on one row has cost, s."""
        if last - first >= FEWEST and self._by_columns(given, results, first, last):
            return SHARE * INTERPRETED_S
        blocks = -(-(last - first) // BLOCK)
        block = -(-(last - first) // blocks)
        with self._lock:
            trigger, sources, outputs = self._block(block)
            for i in self.held:
                sources[i][:] = given[i]
            for start in range(first, last, block):
                count = min(block, last - start)
                for i, source in enumerate(sources):
                    if i not in self.held:
                        source[:count] = given[i][start : start + count]
                        source[count:] = given[i][start]
                trigger()
                for result, output in zip(results, outputs, strict=True):
                    result[start : start + count] = output[:count]
        return INTERPRETED_S

    def _by_columns(self, given: Sequence[Array], results: Sequence[Array], first: int, last: int) -> bool:
        """The same by array operations; False where they cannot."""
        if not self._tried:
            self._tried = True
            with suppress(NotImplementedError):
                self._columns = Columns(self.function, self.held)
        return self._columns is not None and self._columns(given, results, first, last)

    def _block(self, block: int) -> tuple[Callable[[], None], list[Array], list[Array]]:
        if block not in self._blocks:
            # nothing reduced: an input held for all rows would cost a graph of copies
            buffer, trigger = self.function.map(block).buffer()
            sources = [np.zeros((block, size)) for size in self._inputs]
            outputs = [np.zeros((block, size)) for size in self._outputs]
            for i, array in enumerate(sources):
                buffer.set_arg(i, array.data)
            for i, array in enumerate(outputs):
                buffer.set_res(i, array.data)
            self._blocks[block] = buffer, trigger, sources, outputs
        return self._blocks[block][1:]  # type: ignore[no-any-return]

    # ---- by machine code

    def _count(self, given: Sequence[Array], results: Sequence[Array], first: int, last: int) -> None:
        """Look for machine code, or compile, once that has become cheaper than what the interpreter has cost."""
        state = self._state
        if state.settled or state.spent < LOOKED_UP_S + LOOKED_UP_OPERATION_S * self._operations:
            return
        with _LOCK:
            self._decide(lambda library: self._agrees(library, given, results, first, last))

    def _decide(self, agrees: Callable[[Library], bool]) -> None:
        state, bought = self._state, COMPILED_S + COMPILED_OPERATION_S * self._operations
        if state.looked and state.spent < bought:
            if not state.library and state.spent > state.noted + NOTED * bought:
                state.noted = state.spent
                note_interpretation(state.key, state.spent)
            return
        try:
            compiler = self._compiler()
            if not state.looked:
                state.looked, state.key = True, key_of(self.function, self.held, compiler)
                known = _STATES.setdefault(state.key, state)
                if known is state:
                    state.noted = interpretation_s(state.key)
                    state.spent += state.noted
                else:
                    known.spent += state.spent
                    self._state = state = known
            if state.library is not None or state.settled:
                return
            source, library = "loaded", found(state.key)
            if library is None and state.spent >= bought:
                source, library = "compiled", compiled(self.function, self.held, compiler, state.key)
            if library is None:
                return
            if not agrees(library):
                raise OSError("machine code differs from the interpreter")
            state.library = library
            _MADE[source] += 1
        except (OSError, NotImplementedError) as error:
            state.settled = True
            _REFUSED[str(error)] += 1

    def _compiler(self) -> Compiler:
        function = self.function
        arguments = [function.sparsity_in(i) for i in range(len(self._inputs))]
        arguments += [function.sparsity_out(i) for i in range(len(self._outputs))]
        if not function.is_a("SXFunction") or not all(part.is_dense() for part in arguments):
            raise NotImplementedError("not a function of dense scalars")
        if self._operations > MOST_OPERATIONS:
            raise NotImplementedError(f"more than {MOST_OPERATIONS} operations")
        compiler = find_compiler()
        if compiler is None:
            raise OSError(f"no C compiler, or {SWITCH} is none")
        return compiler

    def _agrees(
        self, library: Library, given: Sequence[Array], results: Sequence[Array], first: int, last: int
    ) -> bool:
        """Whether machine code gives what the interpreter has given for the same rows, to the last bit."""
        again = [np.full_like(result[first:last], np.inf) for result in results]
        part = [value if i in self.held else value[first:last] for i, value in enumerate(given)]
        library(last - first, part, again)
        return all(
            np.array_equal(one, other[first:last], equal_nan=True) for one, other in zip(again, results, strict=True)
        )
