"""A campaign as plain data: runs of commanded positions with or without readings, in the units of its files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.errors import InputError
from symfive.machine import Machine

__all__ = ["Campaign", "Run", "SetupSigma"]

Vector = tuple[float, float, float]
Array = NDArray[np.float64]
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._ +-]*\Z")


def _frozen_array(values: Any) -> Array:
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array


@dataclass(frozen=True, kw_only=True)
class SetupSigma:
    """Prior 1σ of a run's set-up errors: ball positions and bar length in µm, plate orientation in µrad."""

    table_ball: float = 20.0
    tool_ball: float = 20.0
    length: float = 0.5
    plate: float = 0.0
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        for name in ("table_ball", "tool_ball", "length", "plate"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value < 1e9:
                raise InputError(f"setup_sigma_um.{name} = {value!r} is not a standard deviation", remedy="write µm, at least 0")


@dataclass(frozen=True, kw_only=True)
class Run:
    """One test: what stood where, what was commanded and, once measured, what was read.

    `time` (N,) s; `commands` axis → (N,) in mm or degree; `readings` column → (N,) in the column's unit, empty in a
    plan. `table_ball` and `tool_ball` mm in the workpiece and the tool frame; `length` mm; `u`, `v` unit vectors of a
    grid encoder's plane; `noise_um` 1σ of one reading, one number or one per instrument.
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
    noise_um: float | Mapping[str, float] = 0.3
    setup_sigma_um: SetupSigma = field(default_factory=SetupSigma)
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        freeze = object.__setattr__
        freeze(self, "time", _frozen_array(self.time))
        freeze(self, "commands", MappingProxyType({k: _frozen_array(v) for k, v in self.commands.items()}))
        freeze(self, "readings", MappingProxyType({k: _frozen_array(v) for k, v in self.readings.items()}))
        freeze(self, "options", MappingProxyType(dict(self.options)))
        if not isinstance(self.id, str) or not _ID.match(self.id) or ".." in self.id:
            raise InputError(f"run id {self.id!r} is not a plain name", remedy="use letters, digits, - and _")
        if not self.file:
            freeze(self, "file", f"{self.id}.csv")
        if self.sampling not in ("static", "dynamic"):
            raise InputError(f'sampling "{self.sampling}" is unknown', remedy='write "static" or "dynamic"')
        if self.time.size == 0:
            raise InputError(f"run {self.id} has no rows", remedy="record at least one row or remove the run")
        for name, values in {**self.commands, **self.readings}.items():
            if values.shape != self.time.shape:
                raise InputError(f"run {self.id}: {name} has {values.size} rows, t_s has {self.time.size}")
        for name in ("table_ball", "tool_ball", "u", "v"):
            vector = getattr(self, name)
            if vector is not None and (len(vector) != 3 or not np.all(np.isfinite(np.asarray(vector, dtype=float)))):
                raise InputError(f"run {self.id}: {name} is not three finite numbers", remedy="write [x, y, z] in mm")
        if self.length is not None and not 0.0 < self.length < 1e6:
            raise InputError(f"run {self.id}: length = {self.length!r} is not a length", remedy="write mm above 0")
        noises = [self.noise_um] if isinstance(self.noise_um, (int, float)) else list(self.noise_um.values())
        if not noises or any(isinstance(n, bool) or not 0.0 < n < 1e12 for n in noises):
            raise InputError(f"run {self.id}: noise_um = {self.noise_um!r} is not a positive number", remedy="write µm (1σ)")

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.time.size)

    @property
    def measured(self) -> bool:
        """Whether it has readings."""
        return bool(self.readings)

    @property
    def dynamic(self) -> bool:
        """Whether it is a recording at a constant rate (and not axes at rest at each row)."""
        return self.sampling == "dynamic"

    def noise(self, instrument: str) -> float:
        """1σ of the instrument's white noise in µm (or the unit of its columns)."""
        if isinstance(self.noise_um, (int, float)):
            return float(self.noise_um)
        return float(self.noise_um.get(instrument, 1.0))

    def with_readings(self, readings: Mapping[str, Array]) -> Run:
        """The same run with other readings."""
        return replace(self, readings=readings)


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """A machine and its runs. A campaign without readings is a measurement plan.

    `notes` are remarks of the reader (unknown keys kept, rows that are odd but legal); `comments` of the file.
    """

    machine: Machine
    runs: tuple[Run, ...]
    name: str = "campaign"
    machine_file: str = "machine.toml"
    comments: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)
    path: Path | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra", MappingProxyType(dict(self.extra)))
        if not self.runs:
            raise InputError("the campaign has no runs", remedy="add a [[run]] block")
        seen: set[str] = set()
        for run in self.runs:
            if run.id in seen:
                raise InputError(f'two runs have the id "{run.id}"', remedy="give every run its own id")
            seen.add(run.id)

    @property
    def measured(self) -> bool:
        """Whether every run has readings."""
        return all(run.measured for run in self.runs)

    @property
    def rows(self) -> int:
        """Number of rows of all runs."""
        return sum(run.rows for run in self.runs)

    def run(self, id: str) -> Run:
        """The run of that id."""
        for run in self.runs:
            if run.id == id:
                return run
        raise InputError(f'there is no run "{id}"', remedy=f"use one of {', '.join(r.id for r in self.runs)}")

    def select(self, *ids: str) -> Campaign:
        """The campaign of these runs only."""
        return replace(self, runs=tuple(self.run(id) for id in ids))

    def with_machine(self, machine: Machine) -> Campaign:
        """The same recordings with another baseline model."""
        return replace(self, machine=machine)

    def joined(self, other: Campaign, prefix: str = "") -> Campaign:
        """This campaign and another one on the same machine; `prefix` keeps the ids of the second apart."""
        if other.machine.structure != self.machine.structure:
            raise InputError(
                f'the campaigns are of machines "{self.machine.structure.code}" and "{other.machine.structure.code}"',
                remedy="join campaigns of one machine only",
            )
        runs = tuple(replace(run, id=prefix + run.id, file=f"{prefix}{run.file}") for run in other.runs)
        return replace(self, runs=self.runs + runs, notes=self.notes + other.notes)
