"""One linear axis, ISO 230-2: 5 positions, 5 cycles, 2 directions (paulscherrerinstitute/ecmccfg)."""

from __future__ import annotations

from pathlib import Path

from symfive.campaign import Campaign
from symfive.convert._files import files, linear_axes, positive_name
from symfive.convert._iso230 import iso230_run

MARGIN_MM = 5.0  # beyond the outermost positions: the travel is not recorded


def ecmc_iso230(folder: Path) -> Campaign:
    """Every `*_ISO230.dat` as a static run `laser` of the axis X, µm; the scripts' fit of scale is undone."""
    runs = tuple(
        iso230_run(path, positive_name(path.name.split(".")[0]), "X", ("X",), noise_um=0.2)
        for path in files(folder, "*_ISO230.dat")
    )
    low = min(float(run.commands["X"].min()) for run in runs)
    high = max(float(run.commands["X"].max()) for run in runs)
    machine = linear_axes("ecmc linear axis", {"X": (low - MARGIN_MM, high + MARGIN_MM)})
    return Campaign(machine=machine, runs=runs, name="ecmc-iso230")
