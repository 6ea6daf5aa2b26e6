"""A run as plain data: commanded positions, with or without readings, in the units of its files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import PureWindowsPath
from typing import TYPE_CHECKING, Any

import numpy as np

from symfive.arrays import Array, Indices
from symfive.disk import release
from symfive.errors import InputError
from symfive.files import shown
from symfive.numbers import plain_number, unit_words
from symfive.runs._options import check_options
from symfive.screen import OnScreen, plural
from symfive.validation import finite, freeze, is_number, numbers, one_of

if TYPE_CHECKING:
    from symfive.parameters import Parameter

Vector = tuple[float, float, float]
FIRST_LINE = 2
"""The line of a run's file in which its row 0 stands, as an editor counts: the header is line 1."""
_RESERVED = ("campaign.toml", "machine.toml")
LONG = 50_000
"""Rows from which the interval of a run is taken."""
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._ +-]*\Z")
_MOUNTING = re.compile(r"[A-Za-z0-9][A-Za-z0-9_ +-]*\Z")


def _frozen_array(values: Any) -> Array:
    on_disk = isinstance(values, np.memmap) and values.dtype == np.float64
    array = values.view() if on_disk else np.array(values, dtype=float)
    array.flags.writeable = False
    return array


def _inside(owner: str, name: object) -> str:
    """The name of a file that stays below the campaign's folder."""
    if not isinstance(name, str) or not name.strip() or not name.isprintable() or len(name) > 200:
        problem = f"{owner}: file {shown(name)} is not a file name"
        raise InputError(problem, remedy='write file = "….csv"', keys=("file",))
    parts = PureWindowsPath(name)  # knows both kinds of separators
    if parts.anchor or ".." in parts.parts:
        problem = f"{owner}: file {shown(name)} lies outside the campaign"
        raise InputError(problem, remedy="put the CSV into the campaign's folder", keys=("file",))
    if not parts.parts or file_identity(name) in _RESERVED:
        problem = f"{owner}: file {shown(name)} is not a CSV"
        raise InputError(problem, remedy='write file = "….csv"', keys=("file",))
    return name


def file_identity(name: str) -> str:
    """One spelling for all names of a file: `./A.csv` becomes `a.csv`."""
    return PureWindowsPath(name).as_posix().casefold()


def instrument_words(name: str) -> str:
    """The name of an instrument as one says it: `ball_bar` ball bar, `r_test` R-test."""
    return "R-test" if name == "r_test" else name.replace("_", " ")


@dataclass(frozen=True, kw_only=True)
class SetupSigma:
    """Prior 1σ of a run's set-up errors: ball positions and bar length in µm, plate orientation in µrad.

    `tool_ball` holds across the spindle axis and, without `tool_length`, along it too; `zero` is that of the R-test nest in
    the workpiece frame (None: position unknown).
    """

    table_ball: float = 20.0
    tool_ball: float = 20.0
    length: float = 0.5
    plate: float = 0.0
    tool_length: float | None = None
    zero: float | None = None
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra", freeze(self.extra))
        for name in ("table_ball", "tool_ball", "length", "plate", "tool_length", "zero"):
            value = getattr(self, name)
            if value is None and name in ("tool_length", "zero"):
                continue
            if not is_number(value) or not 0.0 <= value < 1e9 or (name == "zero" and value == 0.0):
                problem = f"setup_sigma_um: {name} = {shown(value)} is not a standard deviation"
                raise InputError(problem, remedy="write µm (plate: µrad), at least 0", keys=(name,))

    @property
    def tool(self) -> tuple[float, float, float]:
        """Of the tool ball's coordinates in the tool frame, µm."""
        along = self.tool_ball if self.tool_length is None else self.tool_length
        return self.tool_ball, self.tool_ball, along


@dataclass(frozen=True)
class Column:
    """A reading column of a CSV: internal value (mm, rad, …) = `scale` × the number in the file."""

    name: str
    unit: str
    scale: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """One stretch: of `run`, which has no readings, row `lead` and every `step`th after it. In the rows before that drives, plays
    and friction forget how it began."""

    run: Run
    lead: int
    step: int = 1

    @property
    def own(self) -> slice:
        """The rows that are kept."""
        return slice(self.lead, None, self.step)

    @property
    def rows(self) -> int:
        """How many they are."""
        return len(range(self.lead, self.run.rows, self.step))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Run(OnScreen):
    """One test: positions of the balls, commands and, once measured, readings. Compared by identity.

    `time` (N,) s; `commands` axis → (N,) in mm or degree; `readings` column → (N,) in the column's unit,
    empty in a plan; all three stay on disk if given as `numpy.memmap`. `clock` is `recorded`, or `none`: then `time` only
    orders the rows of a static run, and nothing is shown over time. `table_ball` and `tool_ball` mm in
    the workpiece and the tool frame; `length` mm; `u`, `v` unit vectors of a grid encoder's plane; `noise_um` 1σ of one
    reading, one number or one per instrument; `spindle` (N,) degree, angle of the spindle at each row of a static run, with which
    the error of the tool ball turns (None: it does not turn); `mounting` set-up quantity → name of its mounting: runs with
    the same name share its error (`tool_ball`: the ball stayed in the spindle); `pieces` the stretches of a longer recording that
    form the rows, in order (none: consecutive rows, except for lost ones). `clock_sigma_ms`: prior 1σ of
    the offset of the instrument's clock from the control's in this recording, ms; 0: one clock.
    """

    id: str
    instrument: tuple[str, ...]
    sampling: str
    time: Array
    commands: Mapping[str, Array]
    readings: Mapping[str, Array] = field(default_factory=dict)
    file: str = ""
    table_ball: Vector = (0.0, 0.0, 0.0)
    tool_ball: Vector = (0.0, 0.0, 0.0)
    length: float | None = None
    u: Vector | None = None
    v: Vector | None = None
    start_s: float = 0.0
    clock: str = "recorded"
    clock_sigma_ms: float = 0.0
    noise_um: float | Mapping[str, float] = 0.3
    setup_sigma_um: SetupSigma = field(default_factory=SetupSigma)
    spindle: Array | None = None
    mounting: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    pieces: tuple[Piece, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        if not isinstance(self.id, str) or not _ID.match(self.id) or ".." in self.id or len(self.id) > 100:
            problem = f"run id {shown(self.id)} is not a plain name"
            raise InputError(problem, remedy="use letters, digits, - and _", keys=("id",))
        owner = f"run {self.id}"
        put(self, "file", _inside(owner, self.file or f"{self.id}.csv"))
        put(self, "time", _frozen_array(self.time))
        put(self, "commands", freeze({k: _frozen_array(v) for k, v in self.commands.items()}))
        put(self, "readings", freeze({k: _frozen_array(v) for k, v in self.readings.items()}))
        put(self, "options", freeze(self.options))
        self._check_mounting(owner)
        put(self, "mounting", freeze(self.mounting))
        put(self, "spindle", None if self.spindle is None else _frozen_array(self.spindle))
        one_of(owner, "sampling", self.sampling, ("static", "dynamic"))
        one_of(owner, "clock", self.clock, ("recorded", "none"))
        if self.dynamic and not self.has_clock:
            problem = f'{owner}: clock = "none" in a recording at a constant rate'
            raise InputError(problem, remedy='remove it, or write sampling = "static" where the axes rest at each row')
        if not is_number(self.clock_sigma_ms) or not 0.0 <= self.clock_sigma_ms < 1e6:
            problem = f"{owner}: clock_sigma_ms = {shown(self.clock_sigma_ms)} is not a standard deviation"
            raise InputError(problem, remedy="write ms (1σ), at least 0", keys=("clock_sigma_ms",))
        if self.clock_sigma_ms and not self.dynamic:
            problem = f"{owner}: clock_sigma_ms in a run whose axes rest at each row"
            raise InputError(problem, remedy="remove it", keys=("clock_sigma_ms",))
        names = [name for name in self.instrument if isinstance(name, str)]
        if not names or len(set(names)) != len(self.instrument):
            problem = f"{owner}: instrument {shown(list(self.instrument))} is not a list of different names"
            raise InputError(problem, remedy='write instrument = "ball_bar"', keys=("instrument",))
        check_options(owner, self.options)
        if self.time.size == 0 or self.time.ndim != 1:
            raise InputError(f"{owner} has no rows", remedy="record at least one row or remove the run")
        if self.spindle is not None and self.dynamic:
            problem = f"{owner}: spindle_deg in a recording at a constant rate"
            raise InputError(problem, remedy='remove it, or write sampling = "static" where the axes rest at each row')
        turned = {} if self.spindle is None else {"spindle_deg": self.spindle}
        for name, values in {**self.commands, **self.readings, **turned}.items():
            if values.shape != self.time.shape:
                problem = f"{owner}: {name} has {values.size} rows, t_s has {self.time.size}"
                raise InputError(problem, remedy="give every column the same number of rows")
        if self.pieces and sum(piece.rows for piece in self.pieces) != self.rows:
            raise ValueError(f"{owner}: its pieces have other rows")
        self._check_geometry(owner)

    def _check_mounting(self, owner: str) -> None:
        if not isinstance(self.mounting, Mapping):
            problem = f"{owner}: mounting = {shown(self.mounting)} is not a table"
            raise InputError(problem, remedy='write mounting = { tool_ball = "1" }', keys=("mounting",))
        for quantity, name in self.mounting.items():
            if not isinstance(name, str) or not _MOUNTING.match(name) or len(name) > 100:
                problem = f"{owner}: mounting {quantity} = {shown(name)} is not a plain name"
                raise InputError(problem, remedy="use letters, digits, - and _", keys=("mounting", quantity))

    def _check_geometry(self, owner: str) -> None:
        for name in ("table_ball", "tool_ball"):
            numbers(owner, name, getattr(self, name), 3, example=f"{name} = [x, y, z] in mm")
        for name in ("u", "v"):
            vector = getattr(self, name)
            if vector is None:
                continue
            numbers(owner, name, vector, 3, example=f"{name} = [x, y, z]")
            if abs(np.hypot(np.hypot(vector[0], vector[1]), vector[2]) - 1.0) > 1e-3:
                problem = f"{owner}: {name} = {list(vector)} is not a unit vector"
                raise InputError(problem, remedy="give it the length 1", keys=(name,))
        if self.length is not None and not (is_number(self.length) and 0.0 < self.length < 1e6):
            problem = f"{owner}: length = {shown(self.length)} is not a length"
            raise InputError(problem, remedy="write mm above 0 and below 1e6", keys=("length",))
        finite(owner, start_s=self.start_s)
        many = self.noise_um if isinstance(self.noise_um, Mapping) else None
        for noise in (self.noise_um,) if many is None else many.values():
            if not is_number(noise) or not 0.0 < noise < 1e12:
                problem = f"{owner}: noise_um = {shown(noise)} is not a standard deviation"
                raise InputError(problem, remedy="write µm (1σ) above 0", keys=("noise_um",))
        if many is not None and set(many) != set(self.instrument):
            problem = f"{owner}: noise_um states the noise of {', '.join(map(str, many)) or 'no instrument'}"
            raise InputError(problem, remedy=f"state it of {', '.join(map(str, self.instrument))}", keys=("noise_um",))

    def __str__(self) -> str:
        state = "measured" if self.measured else "a plan, no readings yet"
        instruments = " and ".join(map(instrument_words, self.instrument))
        noises = tuple(dict.fromkeys(plain_number(self.noise(name)) for name in self.instrument))
        units = dict.fromkeys(unit_words(name.rpartition("_")[2]) for name in self.readings)
        unit = next(iter(units)) if len(units) == 1 else "µm"
        other = " (or its reading's unit)" if len(noises) > 1 and len(units) != 1 else ""
        noise = f"noise {' and '.join(noises)} {unit}{other}"
        clock = "" if self.has_clock else ", clock not recorded"
        return f"run {self.id}: {plural(self.rows, 'row')}, {instruments}, {self.sampling}{clock}, {noise}, {state}"

    @property
    def stands(self) -> tuple[Vector, Vector, float | None]:
        """Where balls and bar stand: runs that have the same may share a mounting."""
        return self.table_ball, self.tool_ball, self.length

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.time.size)

    @property
    def measured(self) -> bool:
        """Whether it has readings."""
        return bool(self.readings)

    def records_the_same(self, other: Run) -> bool:
        """Whether both have the same readings on the same motion."""
        columns = ((self.readings, other.readings), (self.commands, other.commands))
        return all(
            own.keys() == others.keys() and all(np.array_equal(column, others[name]) for name, column in own.items())
            for own, others in columns
        )

    @property
    def dynamic(self) -> bool:
        """Whether it is a recording at a constant rate (and not axes at rest at each row)."""
        return self.sampling == "dynamic"

    @property
    def has_clock(self) -> bool:
        """Whether it was recorded when each row was read, and not only in what order."""
        return self.clock != "none"

    @property
    def encoder_is_motion(self) -> bool:
        """Whether what its encoder read is taken as the motion of the axes, and not fitted."""
        return self.options.get("motion_from") == "encoder"

    def noise(self, instrument: str) -> float:
        """1σ of the instrument's white noise in µm (or the unit of its columns)."""
        if isinstance(self.noise_um, (int, float)):
            return float(self.noise_um)
        return float(self.noise_um[instrument])

    def full_name(self, name: str) -> str:
        """The parameter that the run calls `setup.…`: `setup.RUN.…`, or `mounting.NAME.…` where it shares the mounting. All
        others keep their name."""
        kind, _, quantity = name.partition(".")
        if kind != "setup":
            return name
        mounting = self.mounted(quantity)
        return f"setup.{self.id}.{quantity}" if mounting is None else f"mounting.{mounting}.{quantity}"

    def mounted(self, quantity: str) -> str | None:
        """The mounting by which it shares a set-up error with other runs, as `tool_ball.x`; None if it has its own."""
        return self.mounting.get(quantity.partition(".")[0])

    def owns(self, parameter: Parameter) -> bool:
        """Whether a parameter is one of its set-up, its own or shared with other runs."""
        return parameter.of_setup and self.full_name(f"setup.{parameter.quantity}") == parameter.name

    @cached_property
    def steps(self) -> Indices:
        """The number of the interval at which each row was recorded (N,): a missing row leaves a gap."""
        return _steps(self.time)

    @cached_property
    def interval(self) -> float:
        """The row interval, s (1 for a single row). Missing rows do not count nor, in a recording, that its stamps are a little
        off; of a long run, over its first rows. Without a clock it is 1 row."""
        if not self.has_clock:
            return 1.0
        if self.pieces:
            return self.pieces[0].step * self.pieces[0].run.interval
        time = np.asarray(self.time[:LONG])
        if len(time) < 2:
            return 1.0
        usual = float(np.median(np.diff(time)))
        return (float(time[-1]) - float(time[0])) / int(_steps(time)[-1]) if self.dynamic and usual > 0.0 else usual

    @property
    def course(self) -> Array:
        """Time of the rows on the run's own clock, s (N,); without a clock, their numbers from 1."""
        return self.time if self.has_clock else np.arange(1.0, self.rows + 1.0)

    @property
    def duration(self) -> float:
        """Time from the first row to the last, s; without a clock, in rows."""
        return float(self.time[-1] - self.time[0]) if self.has_clock else self.rows - 1.0

    def fastest(self, way: Array) -> float:
        """The highest speed along a way (N,) that something goes in its rows, per minute."""
        return float(np.max(np.abs(np.diff(way) / np.diff(self.time)), initial=0.0)) * 60.0

    def repeated_by(self, other: Run) -> bool:
        """Whether the other run was made in the same way: the readings differ by noise and by what changes in time."""
        alike = "instrument sampling clock table_ball tool_ball length u v noise_um rows options"
        if any(getattr(self, name) != getattr(other, name) for name in alike.split()):
            return False
        if self.has_clock and not np.allclose(
            self.time - self.time[0], other.time - other.time[0], rtol=1e-6, atol=1e-6
        ):
            return False
        turned = [np.zeros(run.rows) if run.spindle is None else run.spindle for run in (self, other)]
        return np.allclose(turned[0], turned[1]) and all(
            np.allclose(v, other.commands[n], atol=1e-6) for n, v in self.commands.items() if n in other.commands
        )

    def part(self, first: int, last: int) -> Run:
        """Its rows `first` … `last` - 1 in memory, as a run of the same name. Raises `ValueError` for a run of pieces."""
        if self.pieces:
            raise ValueError(f"run {self.id} consists of pieces and is not cut again")

        def cut(column: Array) -> Array:
            rows = np.array(column[first:last])
            release(column)
            return rows

        commands, readings = ({n: cut(v) for n, v in columns.items()} for columns in (self.commands, self.readings))
        spindle = None if self.spindle is None else cut(self.spindle)
        return replace(self, time=cut(self.time), commands=commands, readings=readings, spindle=spindle)

    def with_readings(self, readings: Mapping[str, Array]) -> Run:
        """The same run with other readings."""
        return replace(self, readings=readings)


def _steps(time: Array) -> Indices:
    """Every change of the time in whole intervals, at least one: of the usual length, and then of the mean one that follows."""
    changes = np.diff(time)
    usual = float(np.median(changes)) if changes.size else 0.0
    whole = np.ones(changes.size)
    for _ in range(2 if usual > 0.0 else 0):
        whole = np.maximum(1.0, np.rint(changes / usual))
        usual = float(np.sum(changes) / np.sum(whole))
    return np.concatenate([[0], np.cumsum(whole).astype(np.int64)])
