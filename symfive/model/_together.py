"""Runs of few rows evaluated in one call: its cost is paid once, and its rows are many enough for array operations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from symfive.arrays import Array
from symfive.model._assembly import RowFunction
from symfive.runs import Run

FEW, MOST = 256, 1024
"""Rows of a run that is not evaluated alone, and of all runs in one call: array operations need the former and keep the latter in
the processor's cache."""


class Given(NamedTuple):
    """What a run hands to its function: `inputs` (N, ni) of each of its clocks, its `own` parameters and its `constants`."""

    inputs: Sequence[Array]
    own: Array
    constants: Array


class Together:
    """The tables of runs that follow each other, at one vector of parameters: whoever asks for one run asks for the next ones."""

    def __init__(self, runs: Sequence[Run]) -> None:
        self._runs = [run for run in runs if run.rows < FEW]
        self._place = {run: place for place, run in enumerate(self._runs)}
        self._kept: dict[int, tuple[bytes, dict[str, list[Array]]]] = {}

    def tables(
        self, run: Run, vector: Array, shared: Array,
        function: Callable[[Run], RowFunction], given: Callable[[Run, Array], Given],
    ) -> list[Array]:  # fmt: skip
        """Readings and slopes (N, ny, 1 + …) of a run by its clocks, handed out once; nothing for a run that is evaluated alone.
        `function` and `given` say what belongs to a run, `shared` are the function's parameters that all runs share."""
        if run not in self._place:
            return []
        own, stamp = function(run), vector.tobytes()
        known, tables = self._kept.get(id(own), (b"", {}))
        if known != stamp or run.id not in tables:
            tables = _evaluated(own, shared, {each.id: given(each, vector) for each in self._from(run, own, function)})
            self._kept[id(own)] = stamp, tables
        return tables.pop(run.id)

    def _from(self, run: Run, own: RowFunction, function: Callable[[Run], RowFunction]) -> Iterator[Run]:
        """A run and those of the same function behind it, as many as one call takes."""
        rows = 0
        for each in self._runs[self._place[run] :]:
            if function(each) is own:
                rows += each.rows
                if rows > MOST:
                    return
                yield each


def _evaluated(function: RowFunction, shared: Array, given: Mapping[str, Given]) -> dict[str, list[Array]]:
    """The tables of runs by their ids and clocks."""
    pieces = [(id, inputs, one.own, one.constants) for id, one in given.items() for inputs in one.inputs]
    rows = [len(inputs) for _, inputs, _, _ in pieces]
    own, constants = (np.repeat(np.stack([piece[k] for piece in pieces]), rows, axis=0) for k in (2, 3))
    table = function.evaluate_together(np.concatenate([inputs for _, inputs, _, _ in pieces]), shared, own, constants)
    found: dict[str, list[Array]] = {id: [] for id in given}
    for (id, *_), part in zip(pieces, np.split(table, np.cumsum(rows)[:-1]), strict=True):
        found[id].append(part)
    return found
