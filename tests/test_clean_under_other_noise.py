"""Clean campaigns under noise that is neither white nor Gauss-Markov: nothing is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import plant
import pytest
from concealed_world import circle_runs, grid_runs, read_by_the_plant, wrong

from symfive.arrays import Array
from symfive.campaign import Campaign
from symfive.diagnose import diagnose

KINDS = ("student", "flicker", "bursts", "quantised")
TESTS = ("circles", "r_test")
AS_IT_IS = {("bursts", "circles"): [wrong("a burst in the last rows of a run is a shift of its ball")]}
CASES = [pytest.param(kind, test, marks=AS_IT_IS.get((kind, test), [])) for kind in KINDS for test in TESTS]


def flicker(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Noise (N, ny) whose power falls as 1/f, rms 1."""
    rows, columns = shape
    root = np.sqrt(np.fft.rfftfreq(rows)[1:, None])
    waves = (rng.normal(size=(len(root), columns)) + 1j * rng.normal(size=(len(root), columns))) / root
    found = np.fft.irfft(np.concatenate([np.zeros((1, columns)), waves]), rows, axis=0)
    return np.asarray(found / found.std(axis=0))


def noisy(readings: Array, kind: str, sigma: float, rng: np.random.Generator) -> Array:
    """Readings (N, ny) with noise of about the declared `sigma`."""
    white = rng.normal(size=readings.shape)
    if kind == "student":
        return readings + sigma * rng.standard_t(3, readings.shape) / 3.0**0.5
    if kind == "flicker":
        return readings + sigma * (0.5 * white + 0.7 * flicker((len(readings), readings.shape[1]), rng))
    if kind == "quantised":
        return np.asarray(np.round((readings / sigma + 0.4 * white) / 2.0) * 2.0 * sigma)
    found = readings + 0.8 * sigma * white
    for _ in range(4):  # for a while one column is up to five times as noisy
        length = int(rng.uniform(0.005, 0.04) * len(readings)) + 2
        first, column = rng.integers(len(readings) - length), rng.integers(readings.shape[1])
        found[first : first + length, column] += sigma * rng.uniform(1.0, 4.0) * rng.normal(size=length)
    return found


def clean(folder, test: str, kind: str, seed: int) -> Campaign:
    rng = np.random.default_rng([seed, KINDS.index(kind), TESTS.index(test)])
    if test == "circles":
        machine = plant.planar_table()
        runs, errors = circle_runs(machine, (900.0, 2100.0)), ("EC0X",)
    else:
        machine = plant.static_table()
        runs, errors = grid_runs(machine), ("EX0B", "EZ0B", "EA0B", "EC0B", "EX0C", "EY0C", "EA0C", "EB0C")
    truth = {name: float(rng.normal(0.0, 25.0)) for name in errors}
    campaign = read_by_the_plant(folder, machine, runs, [], seed, plant.NoiseOptions(white_um=0.0), truth)

    def read(run):
        names = list(run.readings)
        table = noisy(np.stack([run.readings[name] for name in names], axis=1), kind, run.noise_um, rng)
        return replace(run, readings=dict(zip(names, table.T, strict=True)))

    return replace(campaign, runs=tuple(map(read, campaign.runs)))


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "test"), CASES)
def test_noise_of_no_modelled_kind_is_no_effect(tmp_path, kind: str, test: str) -> None:
    for seed in (31, 32):
        found = diagnose(clean(tmp_path / str(seed), test, kind, seed))
        assert not found.mismatch and not found.findings
