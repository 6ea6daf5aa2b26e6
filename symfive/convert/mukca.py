"""Six or seven rotary axes in series: a ball at the flange rests in a socket while the arm takes many
configurations.

G. Franzese, M. Spahn & M. Ramirez, platonics-delft/kinematics_calibration. The arms: Franka Emika Panda (`panda_*`) and
the arm of a Dinova (`dinova_*`, a Kinova Gen3 lite).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from symfive.campaign import Campaign, Run, SetupSigma, Vector
from symfive.convert._files import files, positive_name, serial_chain, table
from symfive.errors import InputError
from symfive.kinematics import axes_of_modified_dh, forward, rounded
from symfive.machine import Workspace

PANDA_A = (0.0, 0.0, 0.0, 82.5, -82.5, 0.0, 88.0)
PANDA_D = (333.0, 0.0, 316.0, 0.0, 384.0, 0.0, 0.0)
PANDA_ALPHA = (0.0, -90.0, 90.0, 90.0, -90.0, 90.0, 90.0)
_BALL = (0.0, 0.0, 242.5)  # mm, in frame 7
_FRAMES, _TURN, _PLACE = axes_of_modified_dh(PANDA_A, PANDA_D, PANDA_ALPHA)

AXES = {f"J{k}": frame for k, frame in enumerate(_FRAMES, start=1)}
"""Name → direction and origin (mm) of every axis, all axes at zero."""
TOOL_BALL = rounded(_PLACE + _TURN @ np.array(_BALL))
"""The ball in the tool frame (which is the machine frame at zero), mm."""

SIGMA = (1000.0, 20000.0)  # of every location error: µm, µrad
RANGE_MM = 20.0  # a socket has no stroke: so far off may the nominal arm put its ball


@dataclass(frozen=True)
class Arm:
    """A kind of arm: its `axes` (direction, a point on the axis in mm, all axes at zero), where its ball is then, mm, and how
    well it repeats."""

    name: str
    axes: Mapping[str, tuple[Vector, Vector]]
    ball: Vector
    noise_um: float


ARMS = {
    "panda": Arm("Franka Panda", AXES, TOOL_BALL, 100.0),
    "dinova": Arm(
        "Dinova",
        {
            "J1": ((0.0, 0.0, 1.0), (0.0, 0.0, 128.25)),
            "J2": ((0.0, -1.0, 0.0), (0.0, -30.0, 243.25)),
            "J3": ((0.0, 1.0, 0.0), (0.0, -30.0, 523.25)),
            "J4": ((0.0, 0.0, 1.0), (0.0, -10.0, 663.25)),
            "J5": ((1.0, 0.0, 0.0), (28.5, -10.0, 768.25)),
            "J6": ((0.0, 0.0, 1.0), (57.0, -10.0, 873.25)),
        },
        (57.4, -10.6, 1053.4),
        1000.0,
    ),
}
"""By the beginning of the folder's name. The Panda's repeatability is that of its data sheet; the other one's is what the
plain fit leaves, since no figure was found."""


def mukca(folder: Path) -> Campaign:
    """The folder of one arm: every `PLACE/hole_k.csv` as a static run of `r_test` with all readings zero.

    Command: the joint angles (rad in the file, degree here). The socket is unknown: `table_ball` starts at
    the mean of the nominal forward kinematics and the zeros of the run, ±10 mm, place it.
    """
    kind = folder.name.partition("_")[0]
    if kind not in ARMS:
        raise InputError(
            f'no arm is called "{kind}"', path=folder, remedy=f"use a folder {' or '.join(f'{k}_…' for k in ARMS)}"
        )
    arm = ARMS[kind]
    machine = serial_chain(
        f"{arm.name} {folder.name}", arm.axes, sigma=SIGMA, workspace=Workspace(sensor_range=RANGE_MM)
    )
    runs = tuple(_run(path, arm) for path in files(folder, "*/hole_[0-9].csv"))
    return Campaign(machine=machine, runs=runs, name=f"mukca/{folder.name}")


def _run(path: Path, arm: Arm) -> Run:
    angles = np.degrees(table(path, len(arm.axes), ","))
    rotation, position = forward(arm.axes, angles)
    socket = (rotation @ np.array(arm.ball) + position).mean(axis=0)
    n = len(angles)
    return Run(
        id=positive_name(f"{path.parent.name}-{path.stem}"),
        instrument=("r_test",),
        sampling="static",
        time=np.arange(float(n)),
        clock="none",
        commands={name: angles[:, i] for i, name in enumerate(arm.axes)},
        readings={f"d{c}_um": np.zeros(n) for c in "xyz"},
        table_ball=rounded(socket, 3),
        tool_ball=arm.ball,
        noise_um=arm.noise_um,
        setup_sigma_um=SetupSigma(table_ball=0.0, tool_ball=2000.0),
    )
