"""Noise of real instruments: what they read of a thing that does not move, from the recordings of `symfive.convert`.

A thing at rest may hum or drift, which is no noise: a series in which one frequency stands out is set aside (R. A. Fisher 1929,
"Tests of significance in harmonic analysis"; behind the filter that whitens noise with the memory of one row). Rows follow each
other as they were recorded, whatever the time between them was.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import plant
from numpy.typing import NDArray

from symfive.campaign import Campaign, read_campaign, write_campaign
from symfive.convert import convert

from .cases import make_case
from .judge import judge

Array = NDArray[np.float64]
LEAST = 900
"""Rows of a series at least: two R-test grids take 1008."""
FAR = 5.0
"""Readings so many robust 1σ off count as outliers; they stay in the series, but not in its 1σ."""
LEVEL = 1e-3
"""Chance from which on a frequency stands out."""
STILL = 1e-3
"""An axis that moves less than this from row to row, or in a whole run, stands still (mm, degree)."""
STOP = 5
"""Rows for which an axis stands at a stop of a slow scan."""


def standstill(campaign: Campaign) -> Iterator[Array]:
    """Readings of the runs in which no axis moves, without their mean."""
    for run in campaign.runs:
        if all(np.ptp(way) < STILL for way in run.commands.values()):
            yield from (values - values.mean() for values in run.readings.values())


def stops(campaign: Campaign) -> Iterator[Array]:
    """Readings at the stops of slow scans, one after the other, without the mean of each stop."""
    for run in (run for run in campaign.runs if run.dynamic):
        moved = np.any([np.abs(np.diff(way)) > STILL for way in run.commands.values()], axis=0)
        pieces = [p for p in np.split(np.arange(run.rows), np.flatnonzero(moved) + 1) if len(p) >= STOP]
        for values in run.readings.values():
            yield np.concatenate([values[p] - values[p].mean() for p in pieces] or [np.zeros(0)])


def between_targets(campaign: Campaign) -> Iterator[Array]:
    """What two targets at rest do differently from pose to pose, over √2: the place of the tracker drops out."""
    targets = [run for run in campaign.runs if run.id.startswith("base")]
    first, other = targets[0], targets[1]
    _, mine, theirs = np.intersect1d(first.time, other.time, return_indices=True)
    for name, values in first.readings.items():
        apart = (values[mine] - other.readings[name][theirs]) / np.sqrt(2.0)
        yield apart - np.median(apart)


SOURCES = {
    "jjxray-slit": standstill,
    "ess-rotary/wobbling": standstill,
    "ess-xyz": stops,
    "irb120-tracker": between_targets,
}
"""Recordings in which something stands still, and what is its noise."""


def recorded_noise(source: str) -> tuple[Array, ...]:
    """Series of the noise of a recording, each of mean 0 and 1σ 1. Raises `InputError` where the recording is not there."""
    found = [series for series in SOURCES[source](convert(source)) if len(series) >= LEAST and np.ptp(series) > 0.0]
    kept = tuple(series / _sigma(series) for series in found if chance_of_the_highest(series) > LEVEL)
    if not kept:
        raise RuntimeError(f"{source}: all {len(found)} series hum or drift")
    return kept


def chance_of_the_highest(series: Array) -> float:
    """How probable it is that one frequency of noise with the memory of one row stands out as much as the highest of this series
    does (Fisher's g, first term of his sum)."""
    centred = series - series.mean()
    fresh = centred[1:] - float(centred[1:] @ centred[:-1] / (centred @ centred)) * centred[:-1]
    power = np.abs(np.fft.rfft(fresh))[1:-1] ** 2
    return float(min(1.0, len(power) * (1.0 - power.max() / power.sum()) ** (len(power) - 1)))


def _sigma(series: Array) -> float:
    """1σ of a series without its outliers."""
    robust = 1.4826 * float(np.median(np.abs(series))) or float(series.std())
    return float(series[np.abs(series) < FAR * robust].std())


def judge_recorded(seed: int, id: str) -> dict[str, Any] | None:
    """The verdict on a case without an effect whose noise is a real instrument's, scaled to what the case declares; which of the
    instruments goes by the case's number. None for recordings of a motion: they have more rows than were recorded at rest."""
    source = list(SOURCES)[int(id.rsplit("-", 1)[1]) % len(SOURCES)]
    case = make_case(seed, id)
    setting = case.setting
    if setting.dynamic:
        return None
    series = recorded_noise(source)
    pool = np.concatenate(series)
    begin = int(np.random.default_rng([seed, case.seed]).integers(len(pool)))
    with tempfile.TemporaryDirectory() as folder:
        for place, runs in (("fit", setting.fit), ("heldout", setting.heldout)):
            plant.write_campaign(
                Path(folder) / "clean" / place, setting.machine, runs, setting.location, setting.motions, (), seed=case.seed,
                noise_options=plant.QUIET,
            )  # fmt: skip
            noisy, begin = _with_noise(read_campaign(Path(folder) / "clean" / place), pool, begin)
            write_campaign(noisy, Path(folder) / place)
        return {"source": source, "series": len(series), **judge(Path(folder))}


def _with_noise(clean: Campaign, pool: Array, begin: int) -> tuple[Campaign, int]:
    """The campaign with the pool's values as noise, in a row from the one at `begin`, each once as long as there are any; and
    where the next begins."""
    runs = []
    for run in clean.runs:
        readings = {}
        for name, values in run.readings.items():
            fresh = pool[(begin + np.arange(len(values))) % len(pool)]
            readings[name], begin = values + run.noise(run.instrument[0]) * fresh, begin + len(values)
        runs.append(run.with_readings(readings))
    return replace(clean, runs=tuple(runs)), begin
