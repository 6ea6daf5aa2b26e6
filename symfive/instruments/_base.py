"""The contract of an instrument: its columns, its own unknowns, its reading of a row."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from symfive.arrays import Array, Flags
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.parameters import Parameter
from symfive.runs import Column, Run

__all__ = [  # beside what stands here, what every instrument is written with
    "BallInstrument", "Column", "Instrument", "Machine", "Parameter", "Run",
]  # fmt: skip

if TYPE_CHECKING:
    from symfive.motion import Signal
    from symfive.row import Row

Symbol = Any
ZERO_SIGMA_UM = 1e4
"""Prior 1σ of an instrument's unknown zero: 10 mm, far more than any sensor's range."""


class Instrument:
    """Base of all instruments; a subclass is one file and one line in the table of `symfive.instruments`."""

    name: ClassVar[str]
    on_control: ClassVar[bool] = False
    """Whether the control itself records it, on its own clock and with its own sensors."""
    plain_weights: ClassVar[bool] = False
    """Whether its residual is mostly what any model leaves out (friction that is no law) and not noise of a sensor: then
    every reading counts the same, and the uncertainty allows for the residual's correlation as it is."""
    wired: ClassVar[bool] = True
    """Whether its columns, up to three, are asked after as exchanged, reversed or in another unit where a fit leaves much."""
    stands: ClassVar[str] = ""
    """What the set-up sheet has mounted on the table at `table_ball`; nothing where it names no place."""
    held: ClassVar[str] = "tool ball"
    """What the spindle holds at `tool_ball`."""
    on_a_post: ClassVar[bool] = False
    """Whether that is a ball or a nest on a post, which is drawn."""
    seated: ClassVar[str] = "ball"
    """What is seated on what stands on the table, or is touched there."""
    limit: ClassVar[str] = "sensor_range"
    """Entry of [workspace] that says how far its readings may go to either side."""
    ball_drawn: ClassVar[bool] = False
    """Whether it reads where `tool_ball` is in the workpiece frame, so that its poses are drawn."""
    vectors: ClassVar[tuple[str, ...]] = ()
    """Fields of a run whose components enter its reading as `constants`, as `table_ball`."""
    bar: ClassVar[bool] = False
    """Whether a bar of the run's `length` joins the two balls."""
    probes: ClassVar[bool] = False
    """Whether the control touches what stands on the table, by a program of its own that logs the places."""
    positions: ClassVar[bool] = False
    """Whether it compares the positions of the run's `axis` with their targets (ISO 230-2)."""
    numbers: ClassVar[tuple[str, ...]] = ()
    """Options that enter its reading as `constants` only: runs that differ in these share one function."""
    imported: ClassVar[tuple[tuple[str, str, str], ...]] = ()
    """Its columns in tables that are imported: `name`, of an axis behind `X_`, and the unit of a linear and of a rotary axis."""

    def check(self, run: Run, machine: Machine) -> None:
        """Raise `InputError` where the run lacks what the instrument needs."""

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        """Its reading columns in the order of `reading`."""
        raise InputError(f"instrument {self.name} has no columns")

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        """Its nuisances and quantities to be found, all named `setup.RUN.…` or `AXIS quantity`."""
        return ()

    def constants(self, run: Run, machine: Machine) -> Mapping[str, float]:
        """Numbers of the run that enter the reading, by name (mm, rad): by default the components of its `vectors`."""
        each = (vector_constants(name, getattr(run, name)) for name in self.vectors)
        return {key: value for vector in each for key, value in vector.items()}

    def signals(self, run: Run, machine: Machine) -> tuple[Signal, ...]:
        """Signals it reads beside the axis positions."""
        return ()

    def stroke(self, machine: Machine) -> float:
        """How far a reading may go to either side, mm, by `limit`."""
        return float(getattr(machine.workspace, self.limit))

    def on_table(self, run: Run) -> str:
        """What stands on the table in a run: `stands`, or another word for what its options say."""
        return self.stands

    def in_spindle(self, run: Run) -> str:
        """What the spindle holds in a run: `held`, or another word."""
        return self.held

    def place_sigma(self, run: Run) -> float | None:
        """1σ with which its place on the table is taken as known, µm; None where the readings determine it."""
        return run.setup_sigma_um.table_ball

    def zeroed(self, run: Run) -> bool:
        """Whether its readings may be set to zero at any pose, because the zero is an unknown of the run."""
        return True

    def turns(self, run: Run, machine: Machine) -> bool:
        """Whether what it reads along turns against the structure within a run."""
        return False

    def undetermined(self, run: Run, machine: Machine) -> Flags:
        """Rows (N,) of which no parameter determines the readings, so that these count nowhere."""
        return np.zeros(run.rows, dtype=bool)

    def start(self, run: Run, machine: Machine) -> tuple[str, ...]:
        """What the operator does to start the program of a run, in sentences of the set-up sheet."""
        start = f"Start the program of run {run.id}; it stops for you to mount the instrument."
        mount = "Mount the bar and start its recording there, then let the program go on."
        return (start, mount) if self.bar and run.dynamic else (start,)

    def remarks(self, run: Run, machine: Machine, found: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
        """What a fit says of such rows in a run, and of parameters that no instrument has: `found` name → value and 1σ."""
        return ()

    def reading(self, row: Row, run: Run) -> list[Symbol]:
        """The readings in internal units, one per column."""
        raise InputError(f"instrument {self.name} has no reading")


class BallInstrument(Instrument):
    """Reads the tool's ball against the table's: the places of both are constants, and the spindle turns the tool's."""

    on_a_post = True
    ball_drawn = True
    vectors = ("table_ball", "tool_ball")

    def designed(self, run: Run, away: Array) -> Array:
        """About what it would read (N, columns), mm, of a tool ball at `away` (N, 3) from the table's, workpiece frame."""
        return away

    def signals(self, run: Run, machine: Machine) -> tuple[Signal, ...]:
        from symfive.motion import SpindleAngle

        return () if run.spindle is None else (SpindleAngle(),)


def setup_parameter(run: Run, name: str, unit: str, sigma: float, **more: Any) -> Parameter:
    """A nuisance `setup.RUN.name` of a run, or `mounting.NAME.name` of the runs that share the mounting."""
    mounting = run.mounted(name)
    return Parameter(
        name=run.full_name(f"setup.{name}"), unit=unit, sigma=sigma, kind="setup",
        run=run.id if mounting is None else None, mounting=mounting, **more,
    )  # fmt: skip


def setup_vector(run: Run, name: str, sigma: float | tuple[float, float, float]) -> tuple[Parameter, ...]:
    """Three nuisance parameters of a run, µm, with one `sigma` or one each; none where it is 0 (exact)."""
    each = sigma if isinstance(sigma, tuple) else (sigma, sigma, sigma)
    return tuple(setup_parameter(run, f"{name}.{c}", "um", s) for c, s in zip("xyz", each, strict=True) if s)


def vector_constants(name: str, vector: tuple[float, float, float]) -> dict[str, float]:
    """Three constants `name.x`, `name.y`, `name.z`."""
    return {f"{name}.{c}": float(value) for c, value in zip("xyz", vector, strict=True)}
