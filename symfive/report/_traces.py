"""The residuals of an identification column by column, with noise and outliers, and thinning for drawing.

A long recording is drawn by blocks of its rows: their means, which every row enters, between their lowest and highest residuals
(a min-max envelope), so that a figure costs one pass through the rows and no memory that grows with them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.campaign import FIRST_LINE, Campaign, Run
from symfive.disk import release
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.inference import Noise
from symfive.instruments import fitted_parts
from symfive.machine import Axis, Machine
from symfive.numbers import with_unit
from symfive.report._style import label_of, robust_limit, short

BLOCKS = 1 << 14
"""A recording of more than twice as many rows is drawn by this many blocks: ten to a pixel of a wide figure."""
READ_ROWS = 1 << 16


@dataclass(frozen=True)
class Condensed:
    """A run as it is drawn: `run` of n rows with `residual`, `low`, `high`, `sample` (n, ny) and `outlier` (n, ny).

    Each row stands for `step` rows: it has the commands of the middle one and that one's residual (`sample`), the means of
    readings and residuals, and the lowest and highest residual, outliers not counted. Outliers have rows of their own among them.
    """

    run: Run
    residual: Array
    low: Array
    high: Array
    sample: Array
    outlier: Flags
    step: int


@dataclass(frozen=True)
class Trace:
    """One reading column of one run as it is drawn: `residual` (N,) in `unit`, rows left out as outliers (N,), noise of the fit.

    Of a long recording each row stands for `step` rows, as `Condensed` says; `low`, `high`, `sample` (N,) without the outliers.
    """

    run: Run
    instrument: str
    column: str
    unit: str
    residual: Array
    outlier: Flags
    noise: Noise
    low: Array
    high: Array
    sample: Array
    step: int = 1

    def piece(self, most: int) -> int:
        """How many rows each of about `most` pieces has."""
        return max(1, -(-len(self.residual) // most))

    @property
    def farthest(self) -> Array:
        """The residual farthest from zero of what each row stands for, outliers included."""
        far = np.where(-self.low > self.high, self.low, self.high)
        return np.asarray(np.where(np.isfinite(far), far, self.residual))

    def envelope(self, most: int) -> tuple[Indices, Array]:
        """Rows and residuals of a line that shows the lowest and the highest of about `most` pieces; all rows where there are no
        more."""
        count, size = len(self.residual), self.piece(most)
        if size == 1 and self.step == 1:
            return np.arange(count), self.kept
        first = np.arange(0, count, size)
        low, high = np.fmin.reduceat(self.low, first), np.fmax.reduceat(self.high, first)
        return np.repeat(first, 2), np.stack([low, high], axis=1).ravel()

    @property
    def label(self) -> str:
        """The column without its unit."""
        return label_of(self.column)

    def said(self, row: int) -> tuple[str, str]:
        """Run and pose of a row, with the line of the file, and its residual, in words."""
        pose = f"{short(self.run.id)}, pose {row + 1} (line {row + FIRST_LINE})"
        return pose, f"{self.label} {with_unit(self.residual[row], self.unit)}"

    @property
    def kept(self) -> Array:
        """The residual with NaN in place of outliers."""
        return np.where(self.outlier, np.nan, self.residual)


def limit_of(traces: Sequence[Trace]) -> float:
    """How far the panel of some traces reaches."""
    values = np.concatenate([value for trace in traces for value in (trace.low, trace.high)])
    return robust_limit(values, 4.0 * max(trace.noise.declared for trace in traces))


def chosen_runs(campaign: Campaign, runs: str | Iterable[str] | None) -> tuple[Run, ...]:
    """All runs, or those of the given id(s). Raises `InputError` for one that is not there."""
    if runs is None:
        return campaign.runs
    chosen = tuple(campaign.run(id) for id in ([runs] if isinstance(runs, str) else runs))
    if not chosen:
        raise InputError("no run was chosen", remedy=f"name some of {', '.join(r.id for r in campaign.runs)}")
    return chosen


def condensed_of(identification: Identification, run: Run) -> Condensed:
    """A run of a fit as it is drawn."""
    return condensed(run, identification.residuals[run.id], *_outliers(identification, run))


def _whole(identification: Identification, run: Run) -> Condensed:
    """All rows, as they lie on disk."""
    residual = identification.residuals[run.id]
    mask = np.zeros(residual.shape, dtype=bool)
    for place in _outliers(identification, run)[1]:
        mask[place] = True
    return Condensed(run, residual, residual, residual, residual, mask, 1)


def _outliers(identification: Identification, run: Run) -> tuple[list[str], list[tuple[int, int]]]:
    """The names of a run's columns, and row and column of its outliers."""
    names = [column.name for column in identification.model.columns(run)]
    return names, [(o.row, names.index(o.column)) for o in identification.outliers if o.run == run.id]


def condensed(
    run: Run, residual: Array, names: Sequence[str] = (), outliers: Sequence[tuple[int, int]] = ()
) -> Condensed:
    """A run with residuals (N, ny) of the columns `names` and outliers (row, column) as it is drawn: a long recording by blocks,
    else as it is."""
    count, columns = residual.shape
    out = np.array(outliers, dtype=np.int64).reshape(-1, 2)
    if not run.dynamic or count <= 2 * BLOCKS:
        mask = np.zeros((count, columns), dtype=bool)
        mask[out[:, 0], out[:, 1]] = True
        kept = np.where(mask, np.nan, residual)
        return Condensed(run, np.asarray(residual), kept, kept, kept, mask, 1)
    step = -(-count // BLOCKS)
    middle = np.minimum(np.arange(0, count, step) + step // 2, count - 1)
    rows = np.union1d(middle, out[:, 0])
    blocks = np.searchsorted(rows, middle)
    mask = np.zeros((len(rows), columns), dtype=bool)
    mask[np.searchsorted(rows, out[:, 0]), out[:, 1]] = True

    def chosen(values: Array) -> Array:
        single = np.array(values[rows])
        release(values)
        return single

    def drawn(values: Array, left_out: Indices) -> list[Array]:
        """Lowest, highest and mean value (n, k) of the blocks, amid them the rows of outliers, and all single values (n, k)."""
        single = chosen(values)
        found = []
        for table in _blocks(values, left_out, step):
            found.append(single.copy())
            found[-1][blocks] = table
        return [*found, single]

    low, high, mean, sample = drawn(residual, out)
    mean[mask] = sample[mask]
    for table in (low, high, sample):
        table[mask] = np.nan
    readings = {}
    for name, values in run.readings.items():
        mine = out[[names[column] == name for column in out[:, 1].tolist()]]
        mine[:, 1] = 0
        _, _, means, single = drawn(values[:, None], mine)
        spoilt = np.searchsorted(rows, mine[:, 0])
        means[spoilt] = single[spoilt]
        readings[name] = means[:, 0]
    commands, time = {name: chosen(values) for name, values in run.commands.items()}, chosen(run.time)
    return Condensed(replace(run, time=time, commands=commands, readings=readings), mean, low, high, sample, mask, step)


def _blocks(values: Array, left_out: Indices, step: int) -> tuple[Array, Array, Array]:
    """Lowest, highest and mean value (n, k) of blocks of `step` rows, without the (row, column) that are left out."""
    count, columns = values.shape
    n = -(-count // step)
    low, high, mean = (np.empty((n, columns)) for _ in range(3))
    span = step * max(1, READ_ROWS // step)
    for first in range(0, count, span):
        part = np.array(values[first : first + span])
        release(values)
        mine = left_out[(left_out[:, 0] >= first) & (left_out[:, 0] < first + len(part))]
        part[mine[:, 0] - first, mine[:, 1]] = np.nan
        edges = np.arange(0, len(part), step)
        place = slice(first // step, first // step + len(edges))
        low[place], high[place] = np.fmin.reduceat(part, edges), np.fmax.reduceat(part, edges)
        known = np.isfinite(part)
        sums = np.add.reduceat(np.where(known, part, 0.0), edges)
        counts = np.add.reduceat(known, edges, dtype=np.int64)
        mean[place] = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    return low, high, mean


def traces_of(
    identification: Identification, runs: str | Iterable[str] | None = None, *, drawn: bool = False
) -> list[Trace]:
    """Every column that entered the fit, in the order of the runs; `drawn`: long recordings condensed."""
    model = identification.model
    found = []
    for run in chosen_runs(model.campaign, runs):
        view = condensed_of(identification, run) if drawn else _whole(identification, run)
        columns = model.columns(run)
        for name, part in fitted_parts(run, model.machine):
            declared = run.noise(name)
            noise = identification.noises.get((run.id, name)) or Noise(declared, declared=declared)
            found += [
                Trace(
                    view.run, name, columns[j].name, columns[j].unit, view.residual[:, j], view.outlier[:, j], noise,
                    view.low[:, j], view.high[:, j], view.sample[:, j], view.step,
                )
                for j in range(part.start, part.stop)
            ]  # fmt: skip
    return found


def by_panel(traces: Iterable[Trace]) -> dict[tuple[str, str], list[Trace]]:
    """(run, unit) → its traces, which share a panel."""
    panels: dict[tuple[str, str], list[Trace]] = {}
    for trace in traces:
        panels.setdefault((trace.run.id, trace.unit), []).append(trace)
    return panels


def folded(axis: Axis, runs: Iterable[Run]) -> bool:
    """Whether an axis turns by more than one revolution in a run, so that it is drawn over one."""
    return axis.rotary and any(np.ptp(run.commands[axis.name]) > 360.0 + 1e-6 for run in runs)


def moving_axes(runs: Sequence[Run], machine: Machine) -> tuple[str, ...]:
    """Axes that move in at least one of the runs, in the machine's order."""
    return tuple(name for name in machine.axis_names if any(np.ptp(run.commands[name]) > 1e-9 for run in runs))


def direction_of(command: Array) -> Indices:
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


def spread(rows: int, most: int) -> tuple[Indices, int]:
    """Indices of at most about `most` evenly spread rows, and the step between them (1: all of them)."""
    step = max(1, -(-rows // most))
    return np.arange(0, rows, step), step
