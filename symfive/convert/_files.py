"""What the converters share: finding files, number tables, logs of EPICS channels, sampling times of late arrivals, machines of
one axis or of a serial chain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter

from symfive.arrays import Array
from symfive.campaign import Vector
from symfive.errors import InputError
from symfive.files import read_text
from symfive.machine import ErrorTerm, Machine, Structure, Workspace, make_axis

STEADY = 20.0  # resolutions a sample: from there on a lost sample shows in the value
_NO_VALUE = ("***", "<undefined>")


def files(folder: Path, pattern: str) -> list[Path]:
    """The files of that pattern in name order; at least one, else `InputError`."""
    found = sorted(folder.glob(pattern))
    if not found:
        raise InputError(
            f"there is no file {pattern} in the folder", path=folder, remedy="check that the recording is complete"
        )
    return found


def table(path: Path, columns: int, delimiter: str | None = None) -> Array:
    """A table of numbers without header: (rows, columns)."""
    lines = [(k, line) for k, line in enumerate(read_text(path).split("\n"), start=1) if line.strip()]
    rows = []
    for number, line in lines:
        cells = line.split(delimiter)
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            raise InputError("the row holds text where a number belongs", path=path, line=number) from None
        if len(row) != columns or not np.isfinite(row).all():
            raise InputError(f"the row does not hold {columns} finite numbers", path=path, line=number)
        rows.append(row)
    if not rows:
        raise InputError("the file holds no numbers", path=path)
    return np.array(rows)


def read_columns(path: Path, names: Sequence[str]) -> Array:
    """A table under one header line that holds just these names, comma-separated: (rows, columns)."""
    header, _, body = read_text(path).partition("\n")
    if header.strip().split(",") != list(names):
        raise InputError(f"the header is not {','.join(names)}", path=path, line=1)
    try:
        rows = np.loadtxt(body.splitlines(), delimiter=",", ndmin=2)
    except ValueError as error:
        raise InputError(f"the rows are not numbers ({error})", path=path) from None
    if rows.shape[1:] != (len(names),) or not np.isfinite(rows).all():
        raise InputError(f"the rows do not hold {len(names)} finite numbers", path=path)
    return np.asarray(rows)


@dataclass(frozen=True)
class Channel:
    """One channel of a log: `time` (N,) s on the log's clock (UTC epoch), `value` (N,), in order of time."""

    time: Array
    value: Array

    def at(self, time: Array) -> Array:
        """Linear interpolation; constant beyond the ends."""
        return np.interp(time, self.time, self.value)

    def mean(self, begin: float, end: float) -> float:
        """Mean of the values from `begin` to `end`; interpolated at `end` where there are none."""
        inside = (self.time >= begin) & (self.time <= end)
        return float(self.value[inside].mean()) if inside.any() else float(self.at(np.array([end]))[0])


@dataclass(frozen=True)
class Log:
    """The channels of one log file by full name."""

    path: Path
    channels: dict[str, Channel]

    def find(self, ending: str) -> Channel:
        """The one channel whose name ends so. Raises `InputError` where there is none."""
        found = self.names(ending)
        if not found:
            raise InputError(f"there is no channel …{ending} in the log", path=self.path, remedy="check the recording")
        return self.channels[found[0]]

    def names(self, ending: str) -> list[str]:
        """Names of the channels with that ending."""
        return sorted(name for name in self.channels if name.endswith(ending))


def read_log(path: Path) -> Log:
    """A log of EPICS `camonitor`: lines "channel date time value [alarm …]", channels asynchronous."""
    times: dict[str, list[float]] = {}
    values: dict[str, list[float]] = {}
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        cells = line.split()
        if not cells or any(mark in line for mark in _NO_VALUE):
            continue
        try:
            instant = datetime.fromisoformat(f"{cells[1]} {cells[2]}").replace(tzinfo=UTC).timestamp()
            value = float(cells[3])
            if not np.isfinite(value):
                raise ValueError
        except (ValueError, IndexError):
            raise InputError(
                "the line does not read channel, date, time, value",
                path=path,
                line=number,
                remedy="the log may be cut off there",
            ) from None
        times.setdefault(cells[0], []).append(instant)
        values.setdefault(cells[0], []).append(value)
    if not times:
        raise InputError("the log holds no channel", path=path)
    channels = {}
    for name, instants in times.items():
        order = np.argsort(np.array(instants), kind="stable")
        channels[name] = Channel(np.array(instants)[order], np.array(values[name])[order])
    return Log(path, channels)


def sampling_times(channel: Channel, period: float, resolution: float) -> Array:
    """When the values of a channel, of that `resolution`, were sampled, s (N,): they arrive late and in
    bursts.

    The source samples every `period` seconds and stamps on arrival, so arrival = sampling + delay with delay
    ≥ 0 and often near its minimum. Lost samples show as steps of the running minimum of the delays that
    follow; where the value moves steadily, the size of a step places the loss exactly. The smallest delay
    remains as an unknown constant.
    """
    count = np.arange(len(channel.time))
    late = channel.time - period * count
    floor = np.minimum.accumulate(late[::-1])[::-1]
    lost = np.maximum.accumulate(np.round((floor - floor[0]) / period))
    ticks = np.maximum(np.diff(count + lost), 1.0)
    step = np.diff(channel.value)
    usual = median_filter(step, size=51, mode="nearest")
    steady = np.abs(usual) > STEADY * resolution
    ratio = np.round(step / np.where(steady, usual, 1.0))
    ticks = np.where(steady, np.maximum(ratio, 1.0), ticks)
    index = np.concatenate([[0.0], np.cumsum(ticks)])
    late = channel.time - period * index
    return np.asarray(period * index + np.quantile(late, 0.02))


def array(value: object) -> Array:
    """A flat array of a file's entry."""
    return np.asarray(value, dtype=float).ravel()


def positive_name(stem: str) -> str:
    """A file's stem as the id of a run."""
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in stem).strip("-._") or "run"


def one_axis(name: str, code: str, axis: str, travel: tuple[float, float] = (-360.0, 360.0)) -> Machine:
    """A machine of one axis with the structural code `code`; `travel` in mm or degree."""
    return Machine(name=name, structure=Structure.parse(code), axes={axis: make_axis(axis, travel=travel)})


def linear_axes(name: str, travels: Mapping[str, tuple[float, float]]) -> Machine:
    """A machine of linear axes with these travels in mm, the scale of each an error of prior 1σ 200 µm."""
    terms = [ErrorTerm(name=f"E{a}{a}", sigma=200.0, basis=("polynomial",), order=(1,)) for a in travels]
    return Machine(
        name=name, structure=Structure.parse(f"w b {' '.join(travels)} t"),
        axes={axis: make_axis(axis, travel=travel) for axis, travel in travels.items()},
        errors={term.name: term for term in terms},
    )  # fmt: skip


def serial_chain(
    name: str, axes: Mapping[str, tuple[Vector, Vector]], *, sigma: tuple[float, float] | None = None,
    linear: Mapping[str, tuple[float, float]] | None = None, travel: tuple[float, float] = (-360.0, 360.0),
    workspace: Workspace | None = None,
) -> Machine:  # fmt: skip
    """A chain from the bed to the tool: name → direction and a point on the axis (mm), all axes at zero.

    `linear` the axes that slide, with their travels in mm; the others turn, within `travel` in degree, and have all six location
    errors with the prior 1σ `sigma` (µm, µrad) where that is given.
    """
    sliding = linear or {}
    made = {
        axis: make_axis(axis, kind="linear" if axis in sliding else "rotary", direction=direction, origin=origin,
                        travel=sliding.get(axis, travel))
        for axis, (direction, origin) in axes.items()
    }  # fmt: skip
    terms = [
        ErrorTerm(name=f"E{letter}0{axis}", sigma=sigma[letter in "ABC"])
        for axis in axes if sigma is not None and axis not in sliding for letter in "XYZABC"
    ]  # fmt: skip
    return Machine(
        name=name, structure=Structure.parse(f"w b {' '.join(axes)} t"), axes=made,
        errors={term.name: term for term in terms}, workspace=workspace or Workspace(),
    )  # fmt: skip
