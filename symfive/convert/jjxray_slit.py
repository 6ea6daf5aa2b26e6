"""A slit blade on stepper and lead screw: commanded counter and resolver, mm, 100 Hz, and the resolver at
standstill.

A. Sandström, anderssandstrom/ecmc_bifrost_slits_sat.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from symfive.campaign import Campaign, Run
from symfive.convert._files import files, one_axis, positive_name, read_log


def jjxray_slit(folder: Path) -> Campaign:
    """Every `*.log` as a dynamic run of the axis X: the counter commands, the resolver (`encoder`) reads.

    The resolver's zero is arbitrary (`encoder_zero_sigma`, mm). It sits on the screw and sees no error of the
    guideway, so the baseline is the identity and a zero. A log without counter is a standstill: the command
    is 0.
    """
    machine = one_axis("slit axis on stepper and lead screw", "w b X t", "X", travel=(-100.0, 100.0))
    runs = tuple(_run(path) for path in files(folder, "*.log"))
    return Campaign(machine=machine, runs=runs, name="jjxray-slit")


def _run(path: Path) -> Run:
    log = read_log(path)
    resolver = log.find("Enc-PosAct")
    counter = [name for name in log.names("-PosAct") if not name.endswith("Enc-PosAct")]
    increasing = np.concatenate([[True], np.diff(resolver.time) > 0.0])
    time, reading = resolver.time[increasing], resolver.value[increasing]
    command = log.channels[counter[0]].at(time) if counter else np.zeros(len(time))
    return Run(
        id=positive_name(path.stem),
        instrument=("encoder",),
        sampling="dynamic",
        time=time - time[0],
        commands={"X": command},
        readings={"X_act_mm": reading},
        noise_um=1e-5,
        options={"encoder_axes": ["X"], "encoder_zero_sigma": 10.0},
    )
