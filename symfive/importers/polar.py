"""The polar form of a ball bar: deviation over angle, as its software exports it, without the control's positions.

The positions are reconstructed from the programme: a circle about the ball at constant feed (ISO 230-4), from the angles
themselves. The recording begins and ends in motion, so the drives do too (`start = "moving"`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Run, SetupSigma
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.procedures import PLANES, Nominal, tool_ball_of, within_travel

__all__ = ["polar_run", "read_polar"]

Array = NDArray[np.float64]
UNITS = {"um": 1.0, "mm": 1e3}
EVEN = 0.05
"""Steps of the angle may differ from their median by this share (and be whole multiples of it where rows are lost)."""
LEAST_ROWS = 20


def read_polar(path: Path | str, *, unit: str = "um") -> tuple[Array, Array]:
    """Angle (N,) in degree and deviation (N,) in µm from two columns of a text file.

    Columns are parted by comma, semicolon, tab or spaces (a decimal comma is understood where semicolons, tabs or spaces part
    them); lines before the first pair of numbers are the head. `unit` of the deviation in the file: `um` or `mm`. Raises
    `InputError` naming file and line.
    """
    path = Path(path)
    if unit not in UNITS:
        raise InputError(f'unit "{unit}" is unknown', remedy=f"use one of {', '.join(UNITS)}")
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as cause:
        reason = cause.strerror if isinstance(cause, OSError) else "it is no text"
        raise InputError(f"the file cannot be read ({reason})", remedy="give the text file of an export").at(
            path
        ) from None
    pairs: list[tuple[float, float]] = []
    for number, line in enumerate(lines, start=1):
        pair = _pair(line)
        if pair is not None:
            pairs.append(pair)
        elif pairs and line.strip():
            error = InputError(
                f"{line.strip()[:40]!r} is not an angle and a deviation", remedy="remove what is no reading"
            )
            raise error.at(path, number)
    if len(pairs) < LEAST_ROWS:
        error = InputError(
            f"{len(pairs)} readings of angle and deviation", remedy=f"export at least {LEAST_ROWS}, two numbers a line"
        )
        raise error.at(path)
    angle, deviation = np.array(pairs).T
    return angle, UNITS[unit] * deviation


def _pair(line: str) -> tuple[float, float] | None:
    """The two numbers of a line; None where it holds anything else."""
    words = [word for word in re.split(r"[;\t]|\s+", line.strip()) if word]
    if len(words) == 2:
        words = [word.replace(",", ".") for word in words]
    else:
        words = [word for word in re.split(r"[,\s]+", line.strip()) if word]
    try:
        first, second = (float(word) for word in words)
    except ValueError:
        return None
    return (first, second) if np.isfinite([first, second]).all() else None


def polar_run(
    machine: Machine,
    angle_deg: Sequence[float] | Array,
    deviation_um: Sequence[float] | Array,
    *,
    centre: Sequence[float],
    radius: float,
    feed: float,
    id: str = "circle",
    plane: str = "XY",
    hold: Mapping[str, float] | None = None,
    tool_ball: Sequence[float] | None = None,
    noise_um: float = 0.3,
    setup_sigma_um: SetupSigma | None = None,
) -> Run:
    """A dynamic ball-bar run from its polar form.

    `angle_deg` (N,) degree in the `plane` (`XY`, `YZ`, `ZX`) from its first axis, rising for a circle seen counter-clockwise
    and falling for a clockwise one, in even steps; a jump by 360° is no jump. `deviation_um` (N,) µm of the distance from
    `radius` mm; `centre` mm of the table ball in the workpiece frame; `feed` mm/min along the path; `hold` positions of rotary
    axes, `tool_ball` mm in the tool frame. Raises `InputError` where the angles are not a steady motion or an axis cannot
    follow.
    """
    if plane not in PLANES:
        raise InputError(f'plane "{plane}" is unknown', remedy=f"use one of {', '.join(PLANES)}")
    if not (radius > 0.0 and feed > 0.0):
        raise InputError(f"radius {radius:g} mm and feed {feed:g} mm/min make no circle", remedy="give both above 0")
    angle, deviation = np.asarray(angle_deg, dtype=float), np.asarray(deviation_um, dtype=float)
    if angle.shape != deviation.shape or angle.ndim != 1 or len(angle) < LEAST_ROWS:
        raise InputError(f"{len(angle)} angles, {len(deviation)} deviations", remedy="give one deviation per angle")
    phi = _steady(angle)
    nominal, ball = Nominal(machine), tool_ball_of(machine, tool_ball)
    u, v = (nominal.seen_from_workpiece(nominal.commands(hold or {}, 1), np.eye(3)[i])[0] for i in PLANES[plane])
    target = np.asarray(centre, dtype=float) + radius * (np.outer(np.cos(phi), u) + np.outer(np.sin(phi), v))
    x, y, z = (float(c) for c in centre)
    run = Run(
        id=id, instrument=("ball_bar",), sampling="dynamic", time=np.abs(phi - phi[0]) * radius / (feed / 60.0),
        commands=nominal.follow(target, ball, hold or {}, f"circle {id}"), readings={"dL_um": deviation}, table_ball=(x, y, z),
        tool_ball=ball, length=radius, noise_um=noise_um, options={"start": "moving"},
        setup_sigma_um=setup_sigma_um or SetupSigma(table_ball=20.0, tool_ball=20.0, length=0.5),
    )  # fmt: skip
    return within_travel(machine, run, place="the centre, the radius or the tool's length in the machine file")


def _steady(angle_deg: Array) -> Array:
    """The angle unwrapped, rad. Raises `InputError` where it stands, turns back or goes in uneven steps."""
    phi = np.unwrap(np.radians(angle_deg))
    steps = np.diff(phi)
    usual = float(np.median(steps))
    ratio = steps / usual if usual != 0.0 else np.zeros(1)
    wrong = np.flatnonzero((np.abs(ratio - np.round(ratio)) > EVEN * np.maximum(np.round(ratio), 1.0)) | (ratio < 0.5))
    if usual == 0.0 or len(wrong):
        at = int(wrong[0]) + 2 if len(wrong) else 2
        before, after = angle_deg[at - 2 : at]
        raise InputError(
            f"reading {at}: the angle goes from {before:g}° to {after:g}°, usual are steps of {np.degrees(usual):.4g}°",
            remedy="export the angles of one circle in even steps, both senses as two files",
        )
    return np.asarray(phi)
