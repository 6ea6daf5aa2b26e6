"""A ball-screw axis under position control: commanded and measured position, drive force (EMPS).

A. Janot, M. Gautier & M. Brunot 2019, "Data set and reference models of EMPS".
"""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from symfive.campaign import Campaign, Run
from symfive.convert._files import array, files, one_axis, positive_name
from symfive.errors import InputError
from symfive.files import read_bytes
from symfive.instruments.drive_force import low_pass

RATE = 2.4
ENDS_S = 0.1
KEYS = ("t", "qg", "qm", "vir", "gtau", "kp")


def emps(folder: Path) -> Campaign:
    """Every `DATA_EMPS*.mat` as a run of the axis X with encoder (qm, mm) and drive force (gtau·vir, N).

    The motion is taken from the encoder. Position and force pass the same zero-phase low-pass at twice the
    bandwidth kp/2π of the position loop, which bounds what the reference can excite, and of its rows only as
    many are kept as that frequency needs (`RATE` times it); the first and last `ENDS_S` go, where the filter
    has no neighbours. `vir` is the voltage that the drive got: where the file holds `pulses_N`, the force pulses of the
    test, they are in it already.
    """
    machine = one_axis("EMPS ball-screw axis", "w b X t", "X", travel=(-50.0, 350.0))
    return Campaign(machine=machine, runs=tuple(_run(path) for path in files(folder, "DATA_EMPS*.mat")), name="emps")


def _run(path: Path) -> Run:
    content = io.BytesIO(read_bytes(path))
    try:
        data: dict[str, Any] = loadmat(content)
    except Exception as error:  # SciPy's reader fails in many ways
        raise InputError(f"the file is not a MAT file of version 7 or lower ({error})", path=path) from None
    missing = [key for key in KEYS if key not in data]
    if missing:
        raise InputError(f"the file lacks {', '.join(missing)}", path=path, remedy=f"it must hold {', '.join(KEYS)}")
    time, command, measured, voltage = (array(data[key]) for key in KEYS[:4])
    if not len(time) == len(command) == len(measured) == len(voltage) > 1000 or np.any(np.diff(time) <= 0.0):
        raise InputError("t, qg, qm and vir are not four columns of one recording in order of time", path=path)
    gain, position_gain = (float(array(data[key])[0]) for key in KEYS[4:])
    cut_off = round(2.0 * position_gain / (2.0 * math.pi), 1)
    interval = float(np.median(np.diff(time)))
    end = round(ENDS_S / interval)
    rows = slice(end, len(time) - end, max(1, int(1.0 / (RATE * cut_off * interval))))
    return Run(
        id=positive_name(path.stem),
        instrument=("encoder", "drive_force"),
        sampling="dynamic",
        time=time[rows],
        commands={"X": 1e3 * command[rows]},
        readings={
            "X_act_mm": 1e3 * low_pass(measured, cut_off, interval)[rows],
            "X_force_N": low_pass(gain * voltage, cut_off, interval)[rows],
        },
        noise_um={"encoder": 1e-4, "drive_force": 0.3},
        options={"axis": "X", "encoder_axes": ["X"], "motion_from": "encoder", "low_pass_hz": cut_off},
    )
