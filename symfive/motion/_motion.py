"""Motion of the axes during one run: commanded, after the drives, with velocities, accelerations and tangents."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from symfive.arrays import Array, Indices
from symfive.motion._between_rows import (
    LEAD_ROWS,
    along_the_curve,
    between,
    finer,
    instants,
    is_curved,
    is_moving,
    lead,
    pieces_of,
)
from symfive.motion._drives import GAINS, drive_response
from symfive.motion._first_order import lag_response
from symfive.motion._gaps import programme_of
from symfive.motion._loop import LOOP

if TYPE_CHECKING:
    from symfive.machine import Axis, Machine
    from symfive.runs import Run

T = TypeVar("T")
LAGS = LAG, LAG_OF_ALL = "lag", "lag of all"
"""The quantities of an axis without a drive that can be parameters, s: by so much it follows late, and by so much all do."""
SMOOTHING_S = 0.03


class Late(NamedTuple):
    """How late an instrument's clock is: `delay` s in the middle of a run that begins at `begin` and lasts `span` s on the
    campaign's clock, `drift` s more at its end than at its begin; `clocks` and `drifts` name the parameters that make them up."""

    delay: float = 0.0
    drift: float = 0.0
    begin: float = 0.0
    span: float = 1.0
    clocks: tuple[str, ...] = ()
    drifts: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.delay or self.drift or self.clocks)

    def share(self, clock: Array) -> Array:
        """What of the drift has come, from -1/2 to 1/2."""
        return (clock - self.begin) / self.span - 0.5


IN_TIME = Late()


@dataclass(frozen=True)
class Series:
    """A quantity along a run: `value` (N,) and its derivatives (N,) by parameter name, in internal units.

    `steps` marks a quantity that jumps (a direction of motion), which must not be interpolated smoothly.
    """

    value: Array
    tangents: Mapping[str, Array] = field(default_factory=dict)
    steps: bool = False

    def through(self, linear: Callable[[Array], Array]) -> Series:
        """What a linear operation makes of it."""
        return Series(linear(self.value), {name: linear(slope) for name, slope in self.tangents.items()}, self.steps)


class Signal(Protocol):
    """The contract: hashable, with the names of the parameters it depends on itself and its values along a run."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Parameters that enter the signal itself (not through the drives)."""
        ...

    def series(self, motion: RunMotion) -> Series:
        """Values (N,) and tangents, internal units."""
        ...


@dataclass(frozen=True)
class AxisMotion:
    """One axis along a run (mm or rad, per s, per s²): the command and what the drive made of it."""

    command: Series
    position: Series
    velocity: Series
    acceleration: Series


@lru_cache(maxsize=128)
def _remembered(command: bytes, interval: float, gains: tuple[tuple[str, float], ...]) -> Array:
    """`drive_response` without derivatives, remembered: models of one campaign share their commands, and mostly their drives."""
    response = drive_response(np.frombuffer(command), interval, dict(gains), ())
    response.flags.writeable = False
    return response


_PROGRAMMES: WeakKeyDictionary[Run, Run] = WeakKeyDictionary()
"""Of every run that lost rows: the motion as it was commanded."""
_KEPT: WeakKeyDictionary[Run, dict[object, tuple[Machine, tuple[float | None, ...], Any]]] = WeakKeyDictionary()
"""Of every run: what was computed, with the parameters that move it → machine, their values, result; for all models."""


class RunMotion:
    """The motion of every axis in a run, given the parameters (internal units, by name).

    `freed` maps (axis, quantity of the drive) to the name of the parameter that takes its place. Nothing is computed again
    until a parameter that moves it changes. The motion is as an instrument sees it that is `late`, with its slopes in what makes
    that up.
    """

    def __init__(
        self, run: Run, machine: Machine, freed: Mapping[tuple[str, str], str], values: Mapping[str, float],
        late: Late = IN_TIME,
    ) -> None:  # fmt: skip
        self.run = run
        self.machine = machine
        self._freed = freed
        self.values = values
        self._late = late

    def _kept(
        self, what: object, axis: str | None, parameters: Sequence[str], make: Callable[[], T], *, late: bool = True
    ) -> T:
        """The result of `make`, which depends on `parameters`, the freed gains of an axis (None: of all axes) and, if it is
        `late`, on the delay."""
        gains = tuple((place, name) for place, name in self._freed.items() if axis in (None, place[0]))
        seen, key = (
            (self._late, (what, gains, bool(self._late), self._late.clocks)) if late else (IN_TIME, (what, gains))
        )
        stamp = (*seen[:4], *(self.values.get(name) for name in (*(name for _, name in gains), *parameters)))
        kept = _KEPT.setdefault(self.run, {})
        found = kept.get(key)
        if found is None or found[0] is not self.machine or found[1] != stamp:
            found = kept[key] = self.machine, stamp, make()
        result: T = found[2]
        return result

    @cached_property
    def _delay(self) -> Array:
        """How much earlier the motion is that is seen in each row, s (N,)."""
        return np.asarray(self._late.delay + self._late.drift * self._late.share(self.clock))

    def _slopes(self, rate: Array) -> dict[str, Array]:
        """Tangents in the delay of what changes by `rate` (N,) in a second."""
        drifting = dict.fromkeys(self._late.drifts, -rate * self._late.share(self.clock)) if self._late.drifts else {}
        return dict.fromkeys(self._late.clocks, -rate) | drifting

    @cached_property
    def clock(self) -> Array:
        """Time on the campaign's clock, s (N,)."""
        return self.run.start_s + self.run.time

    def series(self, signal: Signal) -> Series:
        """The values of a signal along the run. What has memory follows the motion through rows that the recorder lost too."""
        axis = getattr(signal, "axis", None)
        if self.run.pieces:
            return self._kept(signal, axis, signal.parameters, lambda: self._in_pieces(signal))
        if self._whole is None:
            return self._kept(signal, axis, signal.parameters, lambda: signal.series(self))
        found, rows = self._whole.series(signal), self.run.steps
        tangents = {name: tangent[rows] for name, tangent in found.tangents.items()}
        return Series(found.value[rows], tangents, steps=found.steps)

    def _in_pieces(self, signal: Signal) -> Series:
        return _joined([signal.series(piece) for piece in self._pieces], self.run)

    @cached_property
    def _pieces(self) -> list[RunMotion]:
        own = self.machine, self._freed, self.values, self._late
        return [RunMotion(piece.run, *own) for piece in self.run.pieces]

    @cached_property
    def _whole(self) -> RunMotion | None:
        """The motion with the rows that the recorder lost, where there are any and the command tells what they were."""
        run = self.run
        if not run.dynamic or run.encoder_is_motion or len(run.steps) == run.steps[-1] + 1:
            return None
        if run not in _PROGRAMMES:
            _PROGRAMMES[run] = programme_of(run)
        return RunMotion(_PROGRAMMES[run], self.machine, self._freed, self.values, self._late)

    def late(self, late: Late) -> RunMotion:
        """The motion as an instrument sees it that is late."""
        return RunMotion(self.run, self.machine, self._freed, self.values, late)

    def axis(self, name: str) -> AxisMotion:
        """The motion of one axis."""
        if self.run.pieces:
            each = [piece.axis(name) for piece in self._pieces]
            names = ("position", "velocity", "acceleration")
            parts = [_joined([getattr(m, part) for m in each], self.run) for part in names]
            return AxisMotion(Series(np.asarray(self.run.commands[name]) * self.machine.axes[name].to_internal), *parts)
        return self._kept(("axis", name), name, (), lambda: self._move(self.machine.axes[name]))

    def _move(self, axis: Axis) -> AxisMotion:
        command = np.asarray(self.run.commands[axis.name]) * axis.to_internal
        rest = Series(np.zeros_like(command))
        measured = self.recorded(axis.name) if self.run.dynamic else None
        if measured is not None:
            return self._smoothed(Series(command), self._earlier(measured))
        if not self.run.dynamic or np.all(command == command[0]):
            return AxisMotion(Series(command), Series(command), rest, rest)
        if self._looped(axis):
            return self._driven(axis, command)
        if is_curved(self.run) or self._lag(axis.name)[1]:
            return self._following(axis, command)
        position = self._earlier(command)
        return AxisMotion(position, position, *self._from_row_to_row(position))

    def _looped(self, axis: Axis) -> bool:
        """Whether it moves as a position loop about a velocity loop: that of its drive, or one that parameters make up."""
        shaped = any((axis.name, quantity) in self._freed for quantity in LOOP)
        return axis.drive is not None or (shaped and self._lag(axis.name)[0] > 0.0)

    def _lag(self, axis: str) -> tuple[float, tuple[str, ...]]:
        """By how much an axis without a drive follows late, s, and the parameters whose sum that is."""
        freed = [self._freed[axis, lag] for lag in LAGS if (axis, lag) in self._freed]
        names = tuple(dict.fromkeys(freed))
        return sum(self.values[name] for name in names), names

    def _following(self, axis: Axis, command: Array) -> AxisMotion:
        """An axis without a drive along its command, late by its lags. Where that goes straight from row to row, velocities are
        differences of the rows, as without a lag: what is commanded between them is not known."""
        tau, lags = self._lag(axis.name)
        pieces, first = self._kept(("pieces", axis.name), "", (), lambda: pieces_of(self.run, command), late=False)
        place = first + np.asarray(self.run.steps - self._delay / self.run.interval)
        motion, rates = lag_response(pieces, self.run.interval, tau, place, settled=is_moving(self.run))
        parts = [
            Series(motion[:, k, 0], dict.fromkeys(lags, motion[:, k, 1]) | self._slopes(rates[:, k])) for k in range(3)
        ]
        if not is_curved(self.run):
            parts[1:] = self._from_row_to_row(parts[0])
        return AxisMotion(Series(command) if lags else parts[0], *parts)

    def _from_row_to_row(self, position: Series) -> tuple[Series, Series]:
        """Velocity and acceleration as differences of the rows."""
        velocity = position.through(self._rate)
        return velocity, velocity.through(self._rate)

    def _rate(self, column: Array) -> Array:
        return np.asarray(np.gradient(column, self.run.time))

    def recorded(self, name: str) -> Array | None:
        """The positions of an axis (mm, rad) where the run takes its motion from the encoder and that has recorded them."""
        axis = self.machine.axes[name]
        readings = self.run.readings.get(f"{name}_act_{axis.unit}")
        if readings is None or not self.run.encoder_is_motion:
            return None
        return np.asarray(readings) * axis.to_internal

    def _smoothed(self, command: Series, measured: Series) -> AxisMotion:
        """Motion as the encoder recorded it, smoothed by a local cubic over `smoothing_s` (Savitzky & Golay 1964)."""
        span = float(self.run.options.get("smoothing_s", SMOOTHING_S))
        window = min(2 * round(span / self.run.interval / 2) + 1, (self.run.rows - 1) // 2 * 2 + 1)
        if window < 5:
            return AxisMotion(command, measured, *self._from_row_to_row(measured))
        from scipy.signal import savgol_filter

        def smooth(order: int) -> Series:
            return measured.through(lambda c: savgol_filter(c, window, 3, deriv=order, delta=self.run.interval))

        return AxisMotion(command, *(smooth(order) for order in range(3)))

    def _earlier(self, column: Array) -> Series:
        """A column as it was `delay` earlier, along Akima's curve, which does not overshoot at corners (H. Akima 1970): beyond
        the ends the axis stands; where the recording begins in motion it goes on as it went."""
        if not self._late:
            return Series(column)
        time = self.run.time
        at, moves = time - self._delay, np.ones(len(time))
        if not is_moving(self.run):
            moves = ((at >= time[0]) & (at <= time[-1])).astype(float)
            at = np.clip(at, time[0], time[-1])
        if len(time) < 3:
            slope = np.ptp(column) / np.ptp(time) if len(time) > 1 else 0.0
            return Series(np.interp(at, time, column), self._slopes(slope * moves))
        from scipy.interpolate import Akima1DInterpolator

        curve = Akima1DInterpolator(time, column, extrapolate=True)
        return Series(np.asarray(curve(at)), self._slopes(np.asarray(curve(at, 1) * moves)))

    def _driven(self, axis: Axis, command: Array) -> AxisMotion:
        delay = self._delay
        factor = instants(self.run) if delay.any() or is_curved(self.run) else 1
        response, names, first = self._response(axis, factor)
        if delay.any():
            place = np.asarray(first + factor * (self.run.steps - delay / self.run.interval))
            motion, rates = between(response, place, self.run.interval / factor)
            rate = rates[:, :, 0]
        else:
            motion = response[first + factor * self.run.steps]
            rate = np.column_stack([motion[:, 1:, 0], self._rate(motion[:, 2, 0])])
        parts = []
        for k in range(3):
            tangents = {n: motion[:, k, 1 + i] for i, n in enumerate(names)}
            parts.append(Series(motion[:, k, 0], tangents | self._slopes(rate[:, k])))
        return AxisMotion(Series(command), *parts)

    def _response(self, axis: Axis, factor: int) -> tuple[Array, tuple[str, ...], int]:
        """The drive's motion at `factor` instants per interval, as `finer` has them, the parameters of its derivatives, and the
        place of the first row; no delay is in it."""
        return self._kept(
            ("response", axis.name, factor), axis.name, (), lambda: self._respond(axis, factor), late=False
        )

    def _respond(self, axis: Axis, factor: int) -> tuple[Array, tuple[str, ...], int]:
        run, first = self.run, self._commanded(axis, factor)[1]
        wanted = {q: self._freed[axis.name, q] for q in GAINS if (axis.name, q) in self._freed}
        tau, lags = self._lag(axis.name)
        gains = {quantity: float(getattr(axis.drive, quantity, 0.0)) for quantity in LOOP}
        gains |= {quantity: self.values[name] for quantity, name in wanted.items()}
        quantities = tuple(wanted)
        if lags:
            gains["position_gain"] = 1.0 / tau
            quantities = (*quantities, "position_gain")

        def respond(chords: int) -> Array:
            column, interval = self._commanded(axis, chords)[0], run.interval / chords
            if quantities:
                found = drive_response(column, interval, gains, quantities)
            else:
                found = _remembered(column.tobytes(), interval, tuple(sorted(gains.items())))
            return found[:: chords // factor]

        found = along_the_curve(run, factor, respond)
        if lags:  # the last slope is in a gain, the inverse of their sum
            found = np.concatenate([found[:, :, :-1], *[found[:, :, -1:] / -(tau**2)] * len(lags)], axis=2)
        return found, (*wanted.values(), *lags), first

    def _commanded(self, axis: Axis, factor: int) -> tuple[Array, int]:
        """What an axis is commanded at `factor` instants per interval, and the place of the first row, as `finer` says."""
        command = np.asarray(self.run.commands[axis.name]) * axis.to_internal
        return self._kept(
            ("commanded", axis.name, factor), "", (), lambda: finer(self.run, command, factor), late=False
        )

    def led(self, name: str) -> tuple[Array, Series, int]:
        """Instants, s, and positions of an axis with the motion before the first row, where the recording begins in motion, and
        how many rows that is: an axis may have turned just before."""
        position, interval = self.axis(name).position, self.run.interval
        if self.recorded(name) is not None or self.run.steps[:LEAD_ROWS][-1] != LEAD_ROWS - 1:
            return self.run.time, position, 0
        led = position.through(lambda column: np.concatenate([lead(self.run, column), column]))
        first = len(led.value) - self.run.rows
        before = self.run.time[0] - interval * np.arange(first, 0, -1)
        return np.concatenate([before, self.run.time]), led, first

    def fine_acceleration(self, name: str, interval: float) -> tuple[Series, Indices, float]:
        """Acceleration of an axis at a constant interval of at most `interval` s: (series, indices of the rows,
        interval)."""
        factor = max(1, int(np.ceil(self.run.interval / interval - 1e-9)))
        return self._kept(("fine", name, factor), name, (), lambda: self._finely(name, factor))

    def _finely(self, name: str, factor: int) -> tuple[Series, Indices, float]:
        axis, motion = self.machine.axes[name], self.axis(name)
        rows, fine = self.run.steps * factor, np.arange(self.run.steps[-1] * factor + 1)
        if self._looped(axis) and self.recorded(name) is None and np.ptp(motion.command.value):
            whole, names, first = self._response(axis, factor)
            response = whole[first:]
            series = Series(response[:, 2, 0], {n: response[:, 2, 1 + i] for i, n in enumerate(names)})
        else:
            series = motion.acceleration.through(lambda column: np.interp(fine, rows, column))
        return series, rows, self.run.interval / factor


def _joined(parts: Sequence[Series], run: Run) -> Series:
    """What holds along each piece of a run, one after the other, in the rows that are kept."""
    own = [piece.own for piece in run.pieces]

    def join(each: Sequence[Array]) -> Array:
        return np.concatenate([values[rows] for values, rows in zip(each, own, strict=True)])

    names = dict.fromkeys(name for part in parts for name in part.tangents)
    still = [np.zeros_like(part.value) for part in parts]
    tangents = {n: join([p.tangents.get(n, s) for p, s in zip(parts, still, strict=True)]) for n in names}
    return Series(join([part.value for part in parts]), tangents, steps=parts[0].steps)
