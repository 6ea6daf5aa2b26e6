"""The residuals of an identification column by column, with noise and outliers, and thinning for drawing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.inference import Noise
from symfive.instruments import instruments_of
from symfive.machine import Machine
from symfive.report._style import label_of

__all__ = ["Trace", "chosen_runs", "direction_of", "moving_axes", "running_mean", "spread", "traces_of"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Trace:
    """One reading column of one run: `residual` (N,) in `unit`, rows left out as outliers (N,), noise of the fit."""

    run: Run
    instrument: str
    column: str
    unit: str
    residual: Array
    outlier: Mask
    noise: Noise

    @property
    def label(self) -> str:
        """The column without its unit."""
        return label_of(self.column)

    @property
    def kept(self) -> Array:
        """The residual with NaN in place of outliers."""
        return np.where(self.outlier, np.nan, self.residual)


def chosen_runs(campaign: Campaign, runs: str | Iterable[str] | None) -> tuple[Run, ...]:
    """All runs, or those of the given id(s). Raises `InputError` for one that is not there."""
    if runs is None:
        return campaign.runs
    chosen = tuple(campaign.run(id) for id in ([runs] if isinstance(runs, str) else runs))
    if not chosen:
        raise InputError("no run was chosen", remedy=f"name some of {', '.join(r.id for r in campaign.runs)}")
    return chosen


def traces_of(identification: Identification, runs: str | Iterable[str] | None = None) -> list[Trace]:
    """Every column that entered the fit, in the order of the runs."""
    model = identification.model
    found = []
    for run in chosen_runs(model.campaign, runs):
        first = 0
        for instrument in instruments_of(run):
            columns = instrument.columns(run, model.machine)
            if not (instrument.name == "encoder" and run.options.get("motion_from") == "encoder"):
                noise = identification.noises.get((run.id, instrument.name)) or _declared(run, instrument.name)
                for j, column in enumerate(columns, start=first):
                    outlier = np.zeros(run.rows, dtype=bool)
                    rows = [o.row for o in identification.outliers if o.run == run.id and o.column == column.name]
                    outlier[rows] = True
                    residual = np.asarray(identification.residuals[run.id][:, j])
                    found.append(Trace(run, instrument.name, column.name, column.unit, residual, outlier, noise))
            first += len(columns)
    return found


def _declared(run: Run, instrument: str) -> Noise:
    return Noise(run.noise(instrument), declared=run.noise(instrument))


def moving_axes(runs: Sequence[Run], machine: Machine) -> tuple[str, ...]:
    """Axes that move in at least one of the runs, in the machine's order."""
    return tuple(name for name in machine.axis_names if any(np.ptp(run.commands[name]) > 1e-9 for run in runs))


def direction_of(command: Array) -> NDArray[np.int64]:
    """+1 or -1 per row: whence the axis came or goes; at rest the last direction holds, the first row counts as the
    second."""
    step = np.sign(np.diff(command, prepend=command[:1]))
    moving = np.flatnonzero(step)
    if not moving.size:
        return np.ones(len(command), dtype=np.int64)
    last = np.maximum.accumulate(np.where(step != 0, np.arange(len(step)), moving[0]))
    return np.asarray(step[last], dtype=np.int64)


def running_mean(values: Array, window: int) -> Array:
    """Centred mean over `window` rows (fewer at the ends), NaN values left out."""
    known = np.isfinite(values)
    sums = np.concatenate([[0.0], np.cumsum(np.where(known, values, 0.0))])
    counts = np.concatenate([[0], np.cumsum(known)])
    rows = np.arange(len(values))
    low, high = np.maximum(rows - window // 2, 0), np.minimum(rows + window // 2 + 1, len(values))
    count = counts[high] - counts[low]
    return np.asarray(np.where(count > 0, (sums[high] - sums[low]) / np.maximum(count, 1), np.nan))


def spread(rows: int, most: int) -> tuple[NDArray[np.int64], int]:
    """Indices of at most about `most` evenly spread rows, and the step between them (1: all of them)."""
    step = max(1, -(-rows // most))
    return np.arange(0, rows, step), step
