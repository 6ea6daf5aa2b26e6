"""Sections 3.2 and 4 of the paper: what a ball bar reads, equations (10) to (13), and what is read off its trace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .drives import PAPER, Drive, Drives, Gear, behind_the_gear, driven
from .path import Circle

Array = NDArray[np.float64]
ROW_DEG = 0.025
STEP_S = 2e-4
RUN_UP_DEG = 30.0


def bar_um(x: Array, c: Array, circle: Circle, *, dx_um: float = 0.0, dy_um: float = 0.0) -> Array:
    """E of (11) µm: the ball bar on X_out mm and C_out rad, the C axis at (dx, dy) µm from the machine's origin.

    (12), (13) as a rigid body has them, the table turning by -C as (4) wants: the ball was laid on the tool's ball at
    C = 0, so its arm about the axis is (X_T - dx, -dy). Without eccentricity this is (10).
    """
    dx, dy = 1e-3 * dx_um, 1e-3 * dy_um
    arm, cosine, sine = circle.x_t - dx, np.cos(c), np.sin(c)
    along = x - (arm * cosine - dy * sine + dx)
    across = arm * sine + dy * cosine - dy
    return np.asarray(1e3 * (np.hypot(along, across) - circle.radius))


def printed_bar_um(x: Array, c: Array, circle: Circle, *, dx_um: float, dy_um: float) -> Array:
    """E µm with (13) as it is printed, (X_T - dy) sin C in place of (X_T - dx) sin C: not the motion of a rigid table."""
    dx, dy = 1e-3 * dx_um, 1e-3 * dy_um
    cosine, sine = np.cos(c), np.sin(c)
    along = x - ((circle.x_t - dx) * cosine - dy * sine + dx)
    across = (circle.x_t - dy) * sine + dy * cosine - dy
    return np.asarray(1e3 * (np.hypot(along, across) - circle.radius))


def first_order_peak_um(circle: Circle, gain: float) -> float:
    """E(180°) µm of two equal first-order loops of `gain` 1/s: sign(1 - u)·(τ²/2)·X_T r/|r - X_T|·(dφ/dt)², τ = 1/gain.

    The first-order lags of X and C move the tool along its path and cancel; what is left is of second order.
    """
    size = circle.x_t * circle.radius / (circle.radius - circle.x_t)
    return 1e3 * size * (circle.phi_rate / gain) ** 2 / 2.0


@dataclass(frozen=True)
class Trace:
    """A lap: E `um` (N,) µm over φ `deg` (N,) in [0, 360], φ rising whatever the direction."""

    deg: Array
    um: Array

    @property
    def roundness(self) -> float:
        """Largest minus smallest reading, µm."""
        return float(np.ptp(self.um))

    def at(self, deg: float) -> float:
        """E at φ, µm."""
        return float(np.interp(deg, self.deg, self.um))

    def within(self, low: float, high: float) -> Array:
        """E where low ≤ φ ≤ high, µm."""
        return self.um[(self.deg >= low) & (self.deg <= high)]

    def largest(self, low: float, high: float) -> float:
        """The reading of largest magnitude in low ≤ φ ≤ high, with its sign, µm."""
        inside = self.within(low, high)
        return float(inside[np.argmax(np.abs(inside))])

    def half_range(self, low: float, high: float) -> float:
        """Half of what the readings span in low ≤ φ ≤ high, µm."""
        return float(np.ptp(self.within(low, high)) / 2.0)

    def without_circle(self) -> Trace:
        """What the least-squares circle (centre and radius) leaves."""
        phi = np.radians(self.deg)
        columns = np.column_stack([np.ones_like(phi), np.cos(phi), np.sin(phi)])
        return replace(self, um=self.um - columns @ np.linalg.lstsq(columns, self.um, rcond=None)[0])

    def minus(self, other: Trace) -> Trace:
        """The difference of two traces over the same φ."""
        return replace(self, um=self.um - other.um)


def one_axis_lags(circle: Circle, gain: float, axis: str) -> Trace:
    """The lap if `axis` (`X` or `C`) has a first-order loop of `gain` 1/s and the other follows as late, else unchanged.

    A delay of both leaves the path as it is; φ is counted without it. Steady state, by Fourier series over φ.
    """
    phi = np.linspace(0.0, 2.0 * np.pi, 16384, endpoint=False)
    turning = 1j * circle.phi_rate / gain * np.fft.fftfreq(len(phi), 1.0 / len(phi))
    x, c = circle.x(phi), circle.theta(phi)
    # what of θ grows evenly is delayed by a loop and not changed
    even = phi if axis == "C" and circle.u < 1.0 else np.zeros_like(phi)
    swing = np.fft.fft((x if axis == "X" else c) - even)
    lagging = np.fft.ifft(swing * np.exp(turning) / (1.0 + turning)).real + even
    return Trace(np.degrees(phi), bar_um(lagging, c, circle) if axis == "X" else bar_um(x, lagging, circle))


@dataclass(frozen=True)
class Case:
    """What is simulated: a `circle` and the `drives`, with or without hard `friction`, the `worm` and the `play`."""

    circle: Circle
    drives: Drives = PAPER
    friction: bool = True
    worm: bool = True
    play: bool = True

    def loop(self, axis: str) -> Drive:
        """The drive of `x` or `c`."""
        drive: Drive = getattr(self.drives, axis)
        return drive if self.friction else replace(drive, friction=0.0)

    @property
    def gear(self) -> Gear:
        """What stands behind the C drive."""
        gear = self.drives.gear
        gear = gear if self.worm else replace(gear, fluctuation=0.0)
        return gear if self.play else replace(gear, backlash=0.0)


@dataclass(frozen=True)
class Lap:
    """Where the axes were over φ `deg` (N,), rising: `x` mm and `c` rad (N,), behind screw and gear."""

    circle: Circle
    deg: Array
    x: Array
    c: Array

    def trace(self, *, dx_um: float = 0.0, dy_um: float = 0.0) -> Trace:
        """What the ball bar reads with the C axis off the machine's origin."""
        return Trace(self.deg, bar_um(self.x, self.c, self.circle, dx_um=dx_um, dy_um=dy_um))


def simulate(
    cases: Sequence[Case], *, span_deg: tuple[float, float] = (0.0, 360.0), step_s: float = STEP_S
) -> tuple[Lap, ...]:
    """A lap of every case over the same φ, after a run-up of 30°; all drives are integrated side by side."""
    low, high = span_deg
    way = np.radians(np.arange(round((high - low + RUN_UP_DEG) / ROW_DEG) + 1) * ROW_DEG)
    begins = [np.radians((low if case.circle.direction > 0 else -high) - RUN_UP_DEG) for case in cases]
    angles = [case.circle.direction * (begin + way) for case, begin in zip(cases, begins, strict=True)]
    paired = list(zip(cases, angles, strict=True))
    commands = [case.circle.x(phi) for case, phi in paired] + [case.circle.theta(phi) for case, phi in paired]
    loops = [case.loop("x") for case in cases] + [case.loop("c") for case in cases]
    row_s = [np.radians(ROW_DEG) / abs(case.circle.phi_rate) for case in cases]
    moved = driven(loops, np.column_stack(commands), np.tile(row_s, 2), step_s=step_s, moving=True)
    laps = []
    for k, (case, phi) in enumerate(paired):
        c = behind_the_gear(moved[:, len(cases) + k], case.gear)
        lap = slice(round(RUN_UP_DEG / ROW_DEG), None)
        rising = slice(None, None, case.circle.direction)
        laps.append(Lap(case.circle, *(part[lap][rising] for part in (np.degrees(phi), moved[:, k], c))))
    return tuple(laps)
