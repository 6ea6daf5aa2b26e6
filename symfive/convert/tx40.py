"""Six servo axes of a small arm in motion: joint positions and motor currents, 5 kHz (Stäubli TX40).

Example data of the FIGAROH project (Apache-2.0).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from symfive.campaign import Campaign, Run
from symfive.convert._files import files, read_columns, serial_chain
from symfive.errors import InputError
from symfive.instruments.drive_force import low_pass

AXES = {  # direction, a point on the axis in mm, all axes at zero; the links' lengths are those of the data sheet
    "J1": ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
    "J2": ((0.0, 1.0, 0.0), (0.0, 0.0, 320.0)),
    "J3": ((0.0, 1.0, 0.0), (0.0, 35.0, 545.0)),
    "J4": ((0.0, 0.0, 1.0), (0.0, 35.0, 545.0)),
    "J5": ((0.0, 1.0, 0.0), (0.0, 35.0, 770.0)),
    "J6": ((0.0, 0.0, 1.0), (0.0, 35.0, 835.0)),
}
RATE_HZ = 5000.0
CUT_OFF_HZ, EVERY = 20.0, 100
"""Low-pass of position and current, ten times what the joints do (below 2 Hz), and which rows are kept: 50 Hz, 2.5 times it."""
ENDS = 500
"""Rows left out at either end, where the filter has no neighbours."""
NOISE = 0.01


def tx40(folder: Path) -> Campaign:
    """`*_pos.csv` (degree) and `*_curr.csv` (A) as one run a joint, with encoder and drive force, all joints moving in each.

    `Jk_torque_Nm` is the motor's current: all is per unit of torque constant (1 Nm/A at the joint). The motion is taken from
    the encoders; position and current pass the same zero-phase low-pass.
    """
    names = [f"Joint_{k}" for k in range(1, len(AXES) + 1)]
    angles, currents = (read_columns(files(folder, f"*_{kind}.csv")[0], names) for kind in ("pos", "curr"))
    if angles.shape != currents.shape or len(angles) < 10 * ENDS:
        raise InputError("positions and currents are not of one recording", path=folder)
    smooth = np.stack([low_pass(column, CUT_OFF_HZ, 1.0 / RATE_HZ) for column in angles.T], axis=1)
    force = np.stack([low_pass(column, CUT_OFF_HZ, 1.0 / RATE_HZ) for column in currents.T], axis=1)
    rows = slice(ENDS, len(angles) - ENDS, EVERY)
    time = np.arange(len(angles))[rows] / RATE_HZ
    machine = serial_chain("Staubli TX40", AXES)
    runs = tuple(
        Run(
            id=f"current-{name}",
            instrument=("encoder", "drive_force"),
            sampling="dynamic",
            time=time,
            commands={axis: smooth[rows, i] for i, axis in enumerate(AXES)},
            readings={f"{name}_act_deg": smooth[rows, k], f"{name}_torque_Nm": force[rows, k]},
            noise_um={"encoder": 1e-3, "drive_force": NOISE},
            options={"axis": name, "encoder_axes": [name], "motion_from": "encoder", "low_pass_hz": CUT_OFF_HZ},
        )
        for k, name in enumerate(AXES)
    )
    return Campaign(machine=machine, runs=runs, name="tx40")
