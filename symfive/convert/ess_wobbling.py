"""A heavy rotary axis: three eddy-current probes on the rim at 0, 120 and 240°, one on the face, and a
coast-down.

A. Sandström, anderssandstrom/ecmc_target_muts_logger.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from symfive.arrays import Array
from symfive.campaign import Campaign, Run
from symfive.convert._files import Log, files, one_axis, positive_name, read_log, sampling_times
from symfive.instruments.drive_force import low_pass

PERIOD_S = 0.01
RESOLUTION_DEG = 1e-3
RADIUS_MM = 1000.0  # of the probed rim: not recorded, it only enters where a tilt is asked for
COAST_LOW_PASS_HZ = 2.0
COAST_STEP = 10


def probes(form: bool) -> list[dict[str, object]]:
    """The four sensors: radial ones at 0, 120, 240° on the rim, a vertical one on the face at 0°."""
    sensors: list[dict[str, object]] = []
    for k in range(3):
        angle = math.radians(120.0 * k)
        direction = [round(math.cos(angle), 12), round(math.sin(angle), 12), 0.0]
        position = [RADIUS_MM * direction[0], RADIUS_MM * direction[1], 0.0]
        sensors.append({"direction": direction, "position": position, "target": "rim" if form else "ball"})
    face: dict[str, object] = {
        "direction": [0.0, 0.0, 1.0],
        "position": [RADIUS_MM, 0.0, 0.0],
        "target": "face" if form else "ball",
    }
    return [*sensors, face]


def ess_wobbling(folder: Path) -> Campaign:
    """Every `*.log` as a dynamic run of the axis C; all channels interpolated linearly onto one 100 Hz grid.

    Logs with probes: instrument `displacement`, four sensors. Logs of the angle alone: the drive is off, so
    `drive_force` at zero torque with the motion from the encoder, per unit of inertia (see `_coast_down`).
    The angle's time stamps are those of arrival and come in bursts; they are set back to the 10 ms clock on
    which it was sampled.
    """
    machine = one_axis("ESS target wheel drive", "w C' b t", "C", travel=(-1e6, 1e6))
    runs = []
    for path in files(folder, "*.log"):
        log = read_log(path)
        runs.append(_probed(log) if log.names("-AI01") else _coast_down(log))
    notes = ("the vertical lasers and the fork sensor are not converted: where they stand is not recorded",)
    return Campaign(machine=machine, runs=tuple(runs), name="ess-rotary/wobbling", notes=notes)


def _angle(log: Log) -> tuple[Array, Array]:
    """Sampling times s and unwrapped angle degree of the axis."""
    channel = log.find("Rotation-PosAct")
    angle = np.unwrap(channel.value, period=360.0)
    if np.ptp(angle) < 1.0:
        return channel.time, angle
    return sampling_times(type(channel)(channel.time, angle), PERIOD_S, RESOLUTION_DEG), angle


def _probed(log: Log) -> Run:
    time, angle = _angle(log)
    channels = [log.find(f"-AI0{k}") for k in range(1, 5)]
    begin = max([time[0], *(c.time[0] for c in channels)])
    end = min([time[-1], *(c.time[-1] for c in channels)])
    grid = np.arange(begin, end, PERIOD_S)
    turns = np.ptp(angle) > 1.0
    return Run(
        id=positive_name(log.path.stem),
        instrument=("displacement",),
        sampling="dynamic",
        time=grid - grid[0],
        commands={"C": np.interp(grid, time, angle)},
        readings={f"s{k}_um": 1e3 * (c.at(grid) - c.value.mean()) for k, c in enumerate(channels, start=1)},
        noise_um=2.0,
        options={"sensors": probes(form=bool(turns)), "form_axis": "C", "form_order": 2, "form_sigma_um": 1000.0},
    )


def _coast_down(log: Log) -> Run:
    """From the fastest moment on the axis is driven by nothing but friction and what is unbalanced.

    With J·a + friction = 0 the inertia cannot be determined, so all is per unit of inertia: the reading -a·(1 kg
    m²) in Nm takes the place of the torque; in one direction Coulomb friction and offset are one, so the
    terms are viscous and coulomb. `-a` is computed from the angle itself, behind a zero-phase low-pass at
    `COAST_LOW_PASS_HZ`; rows ten times a second.
    """
    time, angle = _angle(log)
    increasing = np.concatenate([[True], np.diff(time) > 0.0])
    grid = np.arange(time[0], time[-1], PERIOD_S)
    even = low_pass(np.interp(grid, time[increasing], angle[increasing]), COAST_LOW_PASS_HZ, PERIOD_S)
    grid, even = grid[COAST_STEP // 2 :: COAST_STEP], even[COAST_STEP // 2 :: COAST_STEP]
    spline = make_interp_spline(grid, even, k=5)
    speed = np.abs(spline.derivative(1)(grid))
    moving = np.flatnonzero(speed > 0.02 * speed.max())
    # from half a second after the speed was last within 1 % of its highest
    steady = int(np.flatnonzero(speed > 0.99 * speed.max())[-1]) + round(0.5 / (COAST_STEP * PERIOD_S))
    part = slice(min(steady, len(speed) - 2), int(moving[-1]) + 1)
    return Run(
        id=positive_name(log.path.stem),
        instrument=("encoder", "drive_force"),
        sampling="dynamic",
        time=grid[part] - grid[part][0],
        commands={"C": even[part]},
        readings={"C_act_deg": even[part], "C_torque_Nm": -np.radians(spline.derivative(2)(grid[part]))},
        noise_um={"encoder": 1e-3, "drive_force": 1e-3},
        options={
            "axis": "C",
            "encoder_axes": ["C"],
            "motion_from": "encoder",
            "low_pass_hz": COAST_LOW_PASS_HZ,
            "force_terms": ["viscous", "coulomb"],
        },
    )
