"""Seven rotary axes in series: a ball at the flange rests in a socket while the arm takes many
configurations.

G. Franzese, M. Spahn & M. Ramirez, platonics-delft/kinematics_calibration. The arm is a Franka Emika Panda.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from symfive.campaign import Campaign, Run, SetupSigma
from symfive.convert._chain import axes_of_modified_dh, forward, rounded
from symfive.convert._files import files, location_errors, positive_name, table
from symfive.machine import Machine, Structure, make_axis

__all__ = ["AXES", "PANDA_A", "PANDA_ALPHA", "PANDA_D", "TOOL_BALL", "mukca"]

PANDA_A = (0.0, 0.0, 0.0, 82.5, -82.5, 0.0, 88.0)
PANDA_D = (333.0, 0.0, 316.0, 0.0, 384.0, 0.0, 0.0)
PANDA_ALPHA = (0.0, -90.0, 90.0, 90.0, -90.0, 90.0, 90.0)
_BALL = (0.0, 0.0, 242.5)  # mm, in frame 7
_FRAMES, _TURN, _PLACE = axes_of_modified_dh(PANDA_A, PANDA_D, PANDA_ALPHA)

AXES = {f"J{k}": frame for k, frame in enumerate(_FRAMES, start=1)}
"""Name → direction and origin (mm) of every axis, all axes at zero."""
TOOL_BALL = rounded(_PLACE + _TURN @ np.array(_BALL))
"""The ball in the tool frame (which is the machine frame at zero), mm."""

NOISE_UM = 100.0  # repeatability of the arm by its data sheet
LINEAR_UM, ANGULAR_URAD = 1000.0, 20000.0


def mukca(folder: Path) -> Campaign:
    """The folder of one arm: every `PLACE/hole_k.csv` as a static run of `r_test` with all readings zero.

    Command: the joint angles (rad in the file, degree here). The socket is unknown: `table_ball` starts at
    the mean of the nominal forward kinematics and the zeros of the run, ±10 mm, place it.
    """
    machine = Machine(
        name=f"Franka Panda {folder.name}",
        structure=Structure.parse(f"w b {' '.join(AXES)} t"),
        axes={
            name: make_axis(name, kind="rotary", direction=direction, origin=origin)
            for name, (direction, origin) in AXES.items()
        },
        errors=location_errors(list(AXES), LINEAR_UM, ANGULAR_URAD),
    )
    runs = tuple(_run(path) for path in files(folder, "*/hole_[0-9].csv"))
    return Campaign(machine=machine, runs=runs, name=f"mukca/{folder.name}")


def _run(path: Path) -> Run:
    angles = np.degrees(table(path, len(AXES), ","))
    rotation, position = forward(AXES, angles)
    socket = (rotation @ np.array(TOOL_BALL) + position).mean(axis=0)
    x, y, z = (round(float(v), 3) for v in socket)
    n = len(angles)
    return Run(
        id=positive_name(f"{path.parent.name}-{path.stem}"),
        instrument=("r_test",),
        sampling="static",
        time=np.arange(float(n)),
        clock="none",
        commands={name: angles[:, i] for i, name in enumerate(AXES)},
        readings={f"d{c}_um": np.zeros(n) for c in "xyz"},
        table_ball=(x, y, z),
        tool_ball=TOOL_BALL,
        noise_um=NOISE_UM,
        setup_sigma_um=SetupSigma(table_ball=0.0, tool_ball=2000.0),
    )
