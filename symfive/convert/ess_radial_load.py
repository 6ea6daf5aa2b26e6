"""The same rotary axis at standstill, without and with a radial load of 10 kN from three sides; probes as in
wobbling.

A. Sandström, anderssandstrom/ecmc_target_muts_logger.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from symfive.campaign import Campaign, Run
from symfive.convert._files import files, one_axis, positive_name, read_log
from symfive.convert.ess_wobbling import probes

PERIOD_S = 0.1
LOADED, FREE = "_10kN", "_no_load"


def ess_radial_load(folder: Path) -> Campaign:
    """One run a side (`x_plus`, …): the unloaded rows, then the loaded ones, with common zeros.

    Instrument `displacement`, four sensors, 10 Hz, times of the log's clock, axis C at rest (its recorded
    angle is invalid and set to 0). Files without a partner become runs of their own.
    """
    machine = one_axis("ESS target wheel drive", "w C' b t", "C")
    sides: dict[str, list[Path]] = {}
    for path in files(folder, "*.log"):
        side = path.stem.removesuffix(LOADED).removesuffix(FREE)
        sides.setdefault(side, []).append(path)
    runs = tuple(_run(side, paths) for side, paths in sides.items())
    return Campaign(machine=machine, runs=runs, name="ess-rotary/radial-load")


def _run(side: str, paths: list[Path]) -> Run:
    times, readings = [], []
    for path in sorted(paths, key=lambda p: p.stem.endswith(LOADED)):
        log = read_log(path)
        channels = [log.find(f"-AI0{k}") for k in range(1, 5)]
        begin, end = max(c.time[0] for c in channels), min(c.time[-1] for c in channels)
        grid = np.arange(begin, end + 1e-3, PERIOD_S)
        times.append(grid)
        readings.append(np.stack([c.at(grid) for c in channels], axis=1))
    order = np.argsort(np.concatenate(times), kind="stable")
    time, values = np.concatenate(times)[order], np.concatenate(readings)[order]
    values = 1e3 * (values - values.mean(axis=0))
    return Run(
        id=positive_name(side),
        instrument=("displacement",),
        sampling="static",
        time=time - time[0],
        commands={"C": np.zeros(len(time))},
        readings={f"s{k + 1}_um": values[:, k] for k in range(4)},
        noise_um=2.0,
        options={"sensors": probes(form=False), "load_kN": 10.0},
    )
