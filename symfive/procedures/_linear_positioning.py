"""Positioning of one linear axis measured with a laser interferometer (ISO 230-2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run, SetupSigma
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.procedures._limits import checked
from symfive.procedures._nominal import Nominal
from symfive.procedures._setting import BALL_SETUP, pose_times, tool_ball_of

GOLDEN = 0.6180339887498949
SHARE = 0.3
"""Targets are moved by up to ± this share of their interval, so that a periodic error is met at every phase."""


def linear_positioning(
    machine: Machine, *, axis: str = "X", targets: Sequence[float] | None = None, cycles: int = 5,
    overrun: float = 2.0, hold: Mapping[str, float] | None = None, seconds_per_pose: float | None = None,
    tool_ball: Sequence[float] | None = None, noise_um: float = 0.3, setup_sigma_um: SetupSigma = BALL_SETUP,
) -> tuple[Run, ...]:  # fmt: skip
    """A positioning test (ISO 230-2): `cycles` times through the targets and back, each approached from both sides; one run.

    `targets` mm, ascending; by default at least five per metre and at least five (ISO 230-2, 5.3.2), unevenly
    spaced over the travel. The axis goes `overrun` mm past the end targets before it turns back; those stops
    are recorded too. `tool_ball` is the position of the reflector (its Abbe offset acts), `hold` the positions of
    the other axes. Raises `InputError` for positions outside the travel.
    """
    if axis not in machine.linear_axes:
        raise InputError(f"the machine has no linear axis {axis}", remedy="name a linear axis")
    low, high = machine.axes[axis].travel
    stops = _targets(low + overrun, high - overrun) if targets is None else np.asarray(targets, dtype=float)
    if stops.ndim != 1 or stops.size < 2 or not np.all(np.diff(stops) > 0.0):
        raise InputError("the targets do not ascend", remedy="give at least two ascending positions in mm")
    if not overrun > 0.0 or cycles < 1:
        raise InputError(
            "overrun and cycles must be positive", remedy="give an overrun above 0 mm and one cycle or more"
        )
    up = np.concatenate([[stops[0] - overrun], stops])
    down = np.concatenate([[stops[-1] + overrun], stops[::-1]])
    way = np.concatenate([np.tile(np.concatenate([up, down]), cycles), up[:1]])
    commands = Nominal(machine).commands({**(hold or {}), axis: way}, len(way))
    run = Run(
        id=f"{axis.lower()}-positioning", instrument=("laser",), sampling="static",
        time=pose_times(machine, len(way), seconds_per_pose), commands=commands, tool_ball=tool_ball_of(machine, tool_ball),
        noise_um=noise_um, setup_sigma_um=setup_sigma_um, options={"axis": axis},
    )  # fmt: skip
    return (checked(machine, run, place="the targets or the overrun"),)


def _targets(low: float, high: float) -> Array:
    """P_i = low + (i - 1)·p + r_i with r_i spread by the golden section (deterministic, never periodic), mm."""
    count = max(5, int(np.ceil((high - low) / 200.0)) + 1)
    interval = (high - low) / (count - 1 + 2.0 * SHARE)
    steps = np.arange(count)
    shift = (2.0 * np.modf(GOLDEN * (steps + 1))[0] - 1.0) * SHARE
    return np.asarray(np.round(low + interval * (SHARE + steps + shift), 3))
