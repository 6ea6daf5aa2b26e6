"""Putting one row's function together: commands → drives → axes → structure → chain → instrument, once, symbolically.

Runs of few rows evaluated in one call: its cost is paid once, and its rows are many enough for array operations.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.compiled import Mapped
from symfive.effects import STAGES, Effect
from symfive.instruments import Column, columns_of, instruments_of
from symfive.kinematics import basis_of, first_order, function_words
from symfive.machine import Machine
from symfive.motion import Position, Signal
from symfive.parameters import Parameter
from symfive.row import Row
from symfive.runs import Run

FEW, MOST = 256, 1024
"""Rows of a run that is not evaluated alone, and of all runs in one call: array operations need the former and keep the latter in
the processor's cache."""


def machine_parameters(machine: Machine) -> tuple[Parameter, ...]:
    """The errors of the baseline as parameters: location errors by name, error motions one per basis function."""
    found = []
    for term in machine.errors.values():
        if term.is_location:
            found.append(
                Parameter(name=term.name, unit=term.unit, sigma=term.sigma, mean=term.mean, kind="location_error")
            )
        else:
            names = basis_of(term, machine).names
            found += [
                Parameter(name=f"{term.name}.{n}", unit=term.unit, sigma=term.sigma, kind="error_motion",
                          called=f"{term.name} ({function_words(n)})")
                for n in names
            ]  # fmt: skip
    return tuple(found)


@dataclass
class RowFunction:
    """The compiled function of one kind of run.

    `inputs` the signals of one row (after clock and time), `shared` and `own` the names of the parameters of the whole
    campaign and of one run (without its id), `constants` names of the run's numbers, `moving` the inputs whose slope is
    taken. The CasADi function maps (inputs, shared, own, constants) to (readings, d/dshared, d/down, d/dmoving), all in
    the files' units.
    """

    columns: tuple[Column, ...]
    inputs: tuple[Signal, ...]
    shared: tuple[str, ...]
    own: tuple[str, ...]
    constants: tuple[str, ...]
    moving: tuple[int, ...]
    value: Any
    slopes: Any
    _mapped: dict[tuple[bool, tuple[int, ...]], Mapped] = field(default_factory=dict)

    def evaluate(self, inputs: Array, shared: Array, own: Array, constants: Array, *, slopes: bool) -> Array:
        """Readings and, where asked, behind them their slopes in shared, own and moving inputs: (N, ny, 1 + …); `inputs` are
        (N, ni)."""
        return self._evaluated(slopes, (1, 2, 3), inputs, shared, own, constants)

    def evaluate_together(self, inputs: Array, shared: Array, own: Array, constants: Array) -> Array:
        """The same with slopes for the rows of several runs, every row with its run's `own` (N, no) and `constants` (N, nc)."""
        return self._evaluated(True, (1,), inputs, shared, own, constants)

    def _evaluated(self, slopes: bool, held: tuple[int, ...], inputs: Array, *others: Array) -> Array:
        if (slopes, held) not in self._mapped:
            self._mapped[slopes, held] = Mapped(self._table(slopes), held)
        (table,) = self._mapped[slopes, held](inputs, *others)
        ny = len(self.columns)
        return table.reshape(len(inputs), ny, table.shape[1] // ny)

    def _table(self, slopes: bool) -> Any:
        """All outputs of a row in one table (1 + …, ny), which lies in memory by columns of readings."""
        base = self.slopes if slopes else self.value
        arguments = base.sx_in()
        return ca.Function("table", arguments, [ca.densify(ca.horzcat(*base.call(arguments)).T)])


_KEPT: OrderedDict[tuple[object, ...], tuple[Machine, RowFunction]] = OrderedDict()
"""Functions that models have asked for, the latest last, each with its machine, of which the key holds the identity only."""
MOST_KEPT = 64
_LOCK = threading.Lock()


def kind_of(run: Run) -> tuple[object, ...]:
    """What the function of a run depends on beside the model: equal for runs that may share one."""
    numbers = {name for instrument in instruments_of(run) for name in instrument.numbers}
    options = repr(sorted((name, value) for name, value in run.options.items() if name not in numbers))
    return run.instrument, run.dynamic, run.spindle is not None, options


def assembled(
    machine: Machine, run: Run, effects: Sequence[Effect], parameters: Sequence[Parameter], linear: bool,
    kind: tuple[object, ...],
) -> RowFunction:  # fmt: skip
    """`assemble`, once for all runs of a `kind` and models of a machine that ask for the same: a search tries each effect many
    times."""
    shared = tuple((p.name, p.scale) for p in parameters if not p.of_setup)
    key = (id(machine), kind, shared, tuple(effects), linear)
    with _LOCK:
        kept = _KEPT.get(key)
        if kept is None:
            kept = _KEPT[key] = machine, assemble(machine, run, effects, parameters, linear)
            if len(_KEPT) > MOST_KEPT:
                _KEPT.popitem(last=False)
        else:
            _KEPT.move_to_end(key)
    return kept[1]


def assemble(
    machine: Machine, run: Run, effects: Sequence[Effect], parameters: Sequence[Parameter], linear: bool
) -> RowFunction:
    """The function of runs of this kind. `linear`: first order in the machine's errors, by differentiation."""
    instruments = instruments_of(run)
    columns = columns_of(run, machine)
    signals: list[Signal] = [Position(name) for name in machine.axis_names]
    wanted = [s for i in instruments for s in i.signals(run, machine)] + [s for e in effects for s in e.signals()]
    signals += [signal for signal in dict.fromkeys(wanted) if signal not in signals]
    common, mine = [p for p in parameters if not p.of_setup], [p for p in parameters if run.owns(p)]
    shared, own = tuple(p.name for p in common), tuple(f"setup.{p.quantity}" for p in mine)
    constants: dict[str, float] = {}
    for instrument in instruments:
        constants |= instrument.constants(run, machine)

    z = ca.SX.sym("inputs", 2 + len(signals))
    p, s, k = ca.SX.sym("shared", len(shared)), ca.SX.sym("own", len(own)), ca.SX.sym("constants", len(constants))
    scales = [q.scale for q in (*common, *mine)]
    scaled = ca.vertcat(p, s) * ca.DM(np.reshape(scales, (-1, 1)))
    values = dict(zip((*shared, *own), ca.vertsplit(scaled), strict=True))
    clock, time, *given = ca.vertsplit(z)
    inputs = dict(zip(signals, given, strict=True))
    row = Row(
        machine,
        {name: inputs[Position(name)] for name in machine.axis_names},
        clock, time, inputs, values,
        dict(zip(constants, ca.vertsplit(k), strict=True)),
    )  # fmt: skip
    row.columns, row.sensed = columns, sensed_columns(run, machine)
    row.sources = tuple(i.name for i in instruments for _ in i.columns(run, machine))
    apply_errors(row, effects)
    for instrument in instruments:
        row.readings += instrument.reading(row, run)
    for effect in effects:
        if effect.stage == "reading":
            effect.apply(row)
    readings = ca.vertcat(*(r / c.scale for r, c in zip(row.readings, columns, strict=True)))
    if linear:
        errors = ca.vertcat(
            *(p[i] for i, name in enumerate(shared) if name in {q.name for q in machine_parameters(machine)})
        )
        readings = first_order(readings, errors)
    moving = _moving(signals, effects, late="setup.clock" in own)
    arguments = [z, p, s, k]
    value = ca.Function("row", arguments, [readings])
    slopes = [ca.densify(ca.jacobian(readings, x)) for x in (p, s)]
    slopes.append(ca.densify(ca.jacobian(readings, z[list(moving)])) if moving else ca.SX(len(columns), 0))
    function = ca.Function("row_slopes", arguments, [readings, *slopes])
    return RowFunction(columns, tuple(signals), shared, own, tuple(constants), moving, value, function)


def sensed_columns(run: Run, machine: Machine) -> tuple[int, ...]:
    """Indices of the reading columns that the control does not record itself."""
    flags = [not i.on_control for i in instruments_of(run) for _ in i.columns(run, machine)]
    return tuple(k for k, outside in enumerate(flags) if outside)


def apply_errors(row: Row, effects: Sequence[Effect]) -> None:
    """Add the effects on axes, the errors of the baseline and the effects on the structure to a row, in this order."""
    machine = row.machine
    for stage in STAGES[:2]:
        for effect in effects:
            if effect.stage == stage:
                effect.apply(row)
    for term in machine.errors.values():
        if term.is_location:
            row.location[term.name] = row.parameter(term.name)
            continue
        basis = basis_of(term, machine)
        functions = ca.vertcat(*basis.values(*(row.axis[name] for name in term.over)))
        amplitudes = ca.vertcat(*(row.parameter(f"{term.name}.{name}") for name in basis.names))
        row.add_motion(term.name, ca.dot(amplitudes, functions))
    for effect in effects:
        if effect.stage == "structure":
            effect.apply(row)


def _moving(signals: Sequence[Signal], effects: Sequence[Effect], *, late: bool) -> tuple[int, ...]:
    """Inputs that depend on parameters: positions of axes with freed drives, signals with parameters, all if the clock is."""
    freed = {axis for effect in effects for axis, _ in effect.frees()}
    if late or "" in freed:
        return tuple(range(2, 2 + len(signals)))
    return tuple(
        2 + i for i, signal in enumerate(signals) if signal.parameters or getattr(signal, "axis", None) in freed
    )


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
