"""Six rotary axes in series, 1000 poses: joint angles and laser tracker positions of three reflectors on the
tool and three on the base.

K. Kamali 2018, icelinker/Robot-Calibration-LaserTracker. Nominal chain: shoulder 290 mm high, upper arm 270
mm, elbow offset 70 mm, forearm 302 mm, wrist to flange 72 mm.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from symfive.campaign import Campaign, Run, SetupSigma
from symfive.convert._files import files, serial_chain, table
from symfive.errors import InputError
from symfive.kinematics import forward, placement, rounded

AXES = {  # direction, a point on the axis in mm, all axes at zero
    "J1": ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
    "J2": ((0.0, 1.0, 0.0), (0.0, 0.0, 290.0)),
    "J3": ((0.0, 1.0, 0.0), (0.0, 0.0, 560.0)),
    "J4": ((1.0, 0.0, 0.0), (0.0, 0.0, 630.0)),
    "J5": ((0.0, 1.0, 0.0), (302.0, 0.0, 630.0)),
    "J6": ((1.0, 0.0, 0.0), (374.0, 0.0, 630.0)),
}
NOISE_MM = 0.02
READ_BACK_DEG = 1e-3
FAR_MM = 5.0  # no base reflector moves that far: the beam was on something else
SIGMA = (2000.0, 5000.0)  # of every location error: µm, µrad


def irb120_tracker(folder: Path) -> Campaign:
    """Static runs with instrument `tracker`, one a reflector, all with the placement `station`; one run
    `read-back`.

    Commands are the commanded angles (`generated_joints`); the run `read-back` holds the angles that the
    control read back (`measured_joints`) with instrument `encoder`. When the poses were taken is not
    recorded: `t_s` counts them. Where the tracker lost a reflector it wrote zeros or, on the base, another place; those
    rows are left out, as the notes say. Reflector positions on the tool and the placement are starting values
    of a linear least-squares fit with the nominal chain.
    """
    machine = serial_chain("ABB IRB 120", AXES, sigma=SIGMA, travel=(-400.0, 400.0))
    joints = table(folder / "generated_joints.txt", len(AXES))
    actual = table(folder / "measured_joints.txt", len(AXES))
    tool = [table(path, 3) for path in files(folder, "measured_SMR_*.txt")]
    base = [table(path, 3) for path in sorted(folder.glob("measured_base_*.txt"))]
    for readings in (*tool, *base, actual):
        if len(readings) != len(joints):
            raise InputError(f"{len(readings)} readings stand against {len(joints)} joint rows", path=folder)
    turn, shift, reflectors = placement(forward(AXES, joints), tool)
    station = [*shift, *Rotation.from_matrix(turn).as_euler("XYZ", degrees=True)]
    common = {"placement": [round(float(v), 3) for v in station]}
    runs, notes = [], []
    for k, readings in enumerate((*tool, *base)):
        on_tool = k < len(tool)
        name = f"tool-{k + 1}" if on_tool else f"base-{k + 1 - len(tool)}"
        seen = np.any(readings != 0.0, axis=1)
        if not seen.all():
            notes.append(f"{name}: {int((~seen).sum())} rows of zeros (no reading) are left out")
        if not on_tool:
            far = seen & (np.linalg.norm(readings - np.median(readings[seen], axis=0), axis=1) > FAR_MM)
            if far.any():
                notes.append(f"{name}: {int(far.sum())} rows more than {FAR_MM:g} mm from the reflector are left out")
            seen = seen & ~far
        fixed = np.median(turn.T @ (readings[seen] - shift).T, axis=1)
        point = rounded(reflectors[k] if on_tool else fixed, 3)
        runs.append(
            Run(
                id=name,
                instrument=("tracker",),
                sampling="static",
                time=np.flatnonzero(seen).astype(float),
                clock="none",
                commands={axis: joints[seen, i] for i, axis in enumerate(AXES)},
                readings={f"{c}_mm": readings[seen, i] for i, c in enumerate("xyz")},
                tool_ball=point if on_tool else (0.0, 0.0, 0.0),
                table_ball=(0.0, 0.0, 0.0) if on_tool else point,
                noise_um=NOISE_MM,
                setup_sigma_um=SetupSigma(table_ball=5000.0, tool_ball=5000.0),
                mounting={"placement": "station"},
                options={**common, **({} if on_tool else {"reflector_on": "workpiece"})},
            )
        )
    runs.append(
        Run(
            id="read-back",
            instrument=("encoder",),
            sampling="static",
            time=np.arange(float(len(joints))),
            clock="none",
            commands={axis: joints[:, i] for i, axis in enumerate(AXES)},
            readings={f"{axis}_act_deg": actual[:, i] for i, axis in enumerate(AXES)},
            noise_um=READ_BACK_DEG,
            options={"encoder_axes": list(AXES)},
        )
    )
    return Campaign(machine=machine, runs=tuple(runs), name="irb120-tracker", notes=tuple(notes))
