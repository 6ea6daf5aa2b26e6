"""Force or torque of an axis' drive: inverse dynamics with mass, viscous and Coulomb friction and offset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from symfive.arrays import Array, Flags
from symfive.errors import InputError
from symfive.instruments._base import Column, Instrument, Machine, Parameter, Run

if TYPE_CHECKING:
    from symfive.motion import RunMotion, Series, Signal
    from symfive.row import Row

IGNORED = "ignored"
TERMS = ("mass", "viscous", "coulomb", "offset")
_CALLED = {"viscous": "viscous friction", "coulomb": "Coulomb friction", "offset": "force offset"}
ORDER = 4
FINER = 10
V_REST = 0.1
"""mm/s or degree/s, where a run states no `v_rest`."""
UNEVEN = 0.1
"""Share of noise in an acceleration at which its factor, the mass, is 1 % too small."""
NEGATIVE = 3.0
"""σ below zero at which a mass is none."""
DERIVATIVES = {"velocity": 1, "acceleration": 2, "jerk": 3}


def low_pass(values: Array, cut_off_hz: float, interval: float) -> Array:
    """Zero-phase low-pass of a recording at a constant rate: Butterworth of order 4, forward and backward.

    `values` (N,), `cut_off_hz` where its gain is one half, `interval` s. Recordings too short for it are returned as
    they are.
    """
    from scipy.signal import butter, sosfiltfilt

    sections = butter(ORDER, cut_off_hz, fs=1.0 / interval, output="sos")
    padding = min(len(values) - 2, int(3.0 / (cut_off_hz * interval)))
    return np.asarray(sosfiltfilt(sections, values, padlen=padding)) if padding > 2 * ORDER else np.array(values)


@dataclass(frozen=True)
class FilteredMotion:
    """Velocity, acceleration, jerk or direction of an axis from its encoder, whose recording has passed the force's low-pass.

    Force and motion have thus passed the same linear filter, which leaves their relation as it was (M. Gautier
    1997, "parallel filtering"). `quantity` is `velocity`, `acceleration` or `jerk` (of a quintic spline through the rows) or
    `direction` (sgn, linear within ±`rest` mm/s or rad/s, behind the same low-pass, computed on a finer grid).
    """

    axis: str
    quantity: str
    cut_off_hz: float
    rest: float = 0.0

    @property
    def parameters(self) -> tuple[str, ...]:
        """None: the recording is what it is."""
        return ()

    def series(self, motion: RunMotion) -> Series:
        """Its values along the run, mm or rad, s."""
        from scipy.interpolate import make_interp_spline

        from symfive.motion import Series

        time, recorded = motion.run.time, motion.recorded(self.axis)
        measured = motion.axis(self.axis).position.value if recorded is None else recorded
        if len(time) < 6:
            return Series(np.zeros_like(time))
        spline = make_interp_spline(time, measured, k=5)
        if self.quantity != "direction":
            return Series(spline.derivative(DERIVATIVES[self.quantity])(time))
        fine = np.interp(np.arange(FINER * (len(time) - 1) + 1) / FINER, np.arange(len(time)), time)
        sign = np.clip(spline.derivative(1)(fine) / self.rest, -1.0, 1.0)
        return Series(low_pass(sign, self.cut_off_hz, motion.run.interval / FINER)[::FINER])


def rest_speed(run: Run) -> float:
    """The speed below which the axis of a run counts as at rest, mm/s or degree/s."""
    return float(run.options.get("v_rest", V_REST))


def moved(run: Run, machine: Machine) -> Array:
    """Position (N,) of the driven axis, mm or degree: that of the encoder where the motion is taken from it."""
    axis = machine.axes[run.options["axis"]]
    measured = run.readings.get(f"{axis.name}_act_{axis.unit}") if run.encoder_is_motion else None
    return run.commands[axis.name] if measured is None else measured


def stands(run: Run, machine: Machine) -> Flags:
    """Of each interval between two rows (N - 1,) whether the driven axis moves less than `v_rest` allows: in none if the axis
    never moves, for then the drive reads what the axis holds."""
    still = np.abs(np.diff(moved(run, machine))) < rest_speed(run) * np.diff(run.time)
    return np.asarray(still & ~still.all())


def _rests(run: Run, machine: Machine) -> Flags:
    """Rest between motions (N,): both ends of each interval in which the axis stands, and as far as the low-pass carries them
    (1/`low_pass_hz`)."""
    still = stands(run, machine)
    rows = np.append(still, False) | np.append(False, still)
    reach = int(1.0 / (float(run.options.get("low_pass_hz", np.inf)) * run.interval)) if still.any() else 0
    return np.asarray(np.convolve(rows, np.ones(2 * reach + 1), "same") > 0.0)


def rest_counts(run: Run) -> bool:
    """Whether what the drive of a run reads at rest counts."""
    return run.options.get("at_rest") != IGNORED


def driven_axis(run: Run) -> str | None:
    """The axis whose drive force a run records; None where it records none."""
    return str(run.options.get("axis")) if DriveForce.name in run.instrument else None


class DriveForce(Instrument):
    """F = mass·a + viscous·v + coulomb·sgn(v) + offset (A. Janot, M. Gautier & M. Brunot 2019), N or Nm.

    The run names the axis; `force_terms` lists which of the four terms the baseline holds (default all). Units: kg and
    N s/m for a linear axis, kg m² and Nm s/rad for a rotary one. Within the velocity resolution `v_rest` (mm/s or
    degree/s, default 0.1) the friction force is not determined by the direction of motion and passes linearly
    through 0; with `at_rest = "ignored"` readings at rest between motions do not count.

    With `motion_from = "encoder"` and `low_pass_hz` both force and encoder in the file have passed `low_pass` at that
    frequency; the direction of motion then passes it too.
    """

    name = "drive_force"
    imported = (("force", "N", "N"), ("torque", "Nm", "Nm"))
    on_control = True
    plain_weights = True

    def check(self, run: Run, machine: Machine) -> None:
        if run.options.get("axis") not in machine.axes:
            problem = f"run {run.id}: a drive force belongs to one axis"
            raise InputError(problem, remedy='add axis = "X" to the run', keys=("axis",))
        unknown = [term for term in self.terms(run) if term not in TERMS]
        if unknown:
            problem = f"run {run.id}: force term {unknown[0]!r} is unknown"
            raise InputError(problem, remedy=f"use {', '.join(TERMS)}", keys=("force_terms",))
        if "low_pass_hz" in run.options and not run.encoder_is_motion:
            raise InputError(
                f"run {run.id}: low_pass_hz filters a motion recorded by the encoder",
                remedy='add motion_from = "encoder"',
                keys=("low_pass_hz",),
            )

    def terms(self, run: Run) -> tuple[str, ...]:
        return tuple(run.options.get("force_terms", TERMS))

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        name = run.options["axis"]
        quantity, unit = ("torque", "Nm") if machine.axes[name].rotary else ("force", "N")
        return (Column(f"{name}_{quantity}_{unit}", unit, 1.0),)

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        name = run.options["axis"]
        rotary = machine.axes[name].rotary
        units = {
            "mass": "kg m^2" if rotary else "kg", "viscous": "Nm s/rad" if rotary else "N s/m",
            "coulomb": "Nm" if rotary else "N", "offset": "Nm" if rotary else "N",
        }  # fmt: skip
        return tuple(
            Parameter(name=f"drive_force.{name}.{term}", unit=units[term], sigma=1e6, kind="drive",
                      called=f"{_CALLED.get(term, term)} of axis {name}")
            for term in self.terms(run)
        )  # fmt: skip

    def constants(self, run: Run, machine: Machine) -> dict[str, float]:
        return {"v_rest": rest_speed(run) * machine.axes[run.options["axis"]].to_internal}

    def undetermined(self, run: Run, machine: Machine) -> Flags:
        return super().undetermined(run, machine) if rest_counts(run) else _rests(run, machine)

    def remarks(self, run: Run, machine: Machine, found: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
        count, said = int(_rests(run, machine).sum()), list[str]()
        unit = machine.axes[run.options["axis"]].unit
        rest = f"at rest (v_rest = {rest_speed(run):g} {unit}/s)"
        if count and not rest_counts(run):
            said.append(f"run {run.id}: {count} readings {rest} are not counted")
        elif count:
            what = f'{rest}, where friction may hold any force up to its level; at_rest = "{IGNORED}" leaves them out'
            said.append(f"run {run.id}: {count} of {run.rows} readings of the drive force were taken {what}")
        if (share := self._uneven(run, machine)) > UNEVEN:
            problem = f"the times of the rows are uneven, which adds {100.0 * share:.0f} % of noise to the acceleration"
            said.append(f"run {run.id}: {problem}; write the instants at which the rows were sampled")
        name = f"drive_force.{run.options['axis']}.mass"
        mass, sigma = found.get(name, (0.0, 0.0))
        if mass < -NEGATIVE * sigma:
            said.append(
                f"run {run.id}: {name} is {mass:.3g}, below zero: is the force or the position reversed in sign?"
            )
        return tuple(said)

    def _uneven(self, run: Run, machine: Machine) -> float:
        """By how much, as a share of its rms, the acceleration of the encoder's motion differs from that at even times; lost rows
        are none of it."""
        axis = machine.axes[run.options["axis"]]
        position = run.readings.get(f"{axis.name}_act_{axis.unit}")
        if not run.encoder_is_motion or position is None or run.rows < 3:
            return 0.0
        rows = np.append(0.0, np.cumsum(np.maximum(np.round(np.diff(run.time) / run.interval), 1.0)))
        even = rows * (run.time[-1] - run.time[0]) / rows[-1]
        own, smooth = (np.gradient(np.gradient(position, t), t) for t in (run.time, even))
        return float(np.linalg.norm(own - smooth) / (np.linalg.norm(smooth) or 1.0))

    def signals(self, run: Run, machine: Machine) -> tuple[Signal, ...]:
        from symfive.motion import Acceleration, Velocity

        name = run.options["axis"]
        cut_off = run.options.get("low_pass_hz")
        if cut_off is None:
            return (Velocity(name), Acceleration(name))
        rest = self.constants(run, machine)["v_rest"]
        quantities = ("velocity", "acceleration", "direction")
        return tuple(FilteredMotion(name, q, float(cut_off), rest) for q in quantities)

    def reading(self, row: Row, run: Run) -> list[Any]:
        import casadi as ca

        name = run.options["axis"]
        metre = 1.0 if row.machine.axes[name].rotary else 1e-3
        velocity, acceleration, *direction = (row.signal(signal) for signal in self.signals(run, row.machine))
        sign = direction[0] if direction else ca.fmin(ca.fmax(velocity / row.constant("v_rest"), -1.0), 1.0)
        factors = {"mass": acceleration * metre, "viscous": velocity * metre, "coulomb": sign, "offset": 1.0}
        force = ca.SX(0)
        for term in self.terms(run):
            force += row.parameter(f"drive_force.{name}.{term}") * factors[term]
        return [force]
