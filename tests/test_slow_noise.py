"""The slow noise of a recording, found together with many parameters: as likely as any other, not where a search gave up."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import cho_factor, cho_solve, toeplitz

from symfive.campaign import Campaign, Run
from symfive.identify import identify
from symfive.inference import Noise
from symfive.machine import ErrorTerm, preset

WHITE, SLOW, CORRELATION_S, ROWS, INTERVAL_S = 0.3, 0.3, 1.0, 1200, 0.05


def recording(seed: int) -> Campaign:
    """One minute of a laser along X, whose error motion takes a third of what 60 correlation times of slow noise tell."""
    generator, machine = np.random.default_rng(seed), preset("three-axis")
    bent = ErrorTerm(name="EXX", sigma=5.0, basis=("polynomial",), order=(20,), over=("X",))
    low, high = machine.axes["X"].travel
    stay = {name: np.zeros(ROWS) for name in ("Y", "Z")}
    slow, keep = np.zeros(ROWS), np.exp(-INTERVAL_S / CORRELATION_S)
    for row, new in enumerate(generator.standard_normal(ROWS)):
        slow[row] = keep * slow[row - 1] + np.sqrt(1.0 - keep**2) * new if row else new
    readings = SLOW * slow + WHITE * generator.standard_normal(ROWS)
    run = Run(
        id="x", instrument=("laser",), sampling="dynamic", time=INTERVAL_S * np.arange(ROWS), noise_um=WHITE,
        commands={"X": np.linspace(low, high, ROWS), **stay}, table_ball=(0.0, 0.0, 0.0), tool_ball=(0.0, 0.0, -100.0),
        options={"axis": "X"},
    )  # fmt: skip
    axes = {name: replace(axis, drive=None) for name, axis in machine.axes.items()}  # no lag at the start
    machine = replace(machine, axes=axes, errors={"EXX": bent})
    return Campaign(machine=machine, runs=(run.with_readings({"X_dev_um": readings}),))


def likelihood(readings: np.ndarray, noise: Noise) -> float:
    """-2 log restricted likelihood of readings with any polynomial of order 20, from their whole covariance matrix."""
    lag = INTERVAL_S * np.arange(ROWS)
    factor = cho_factor(
        toeplitz(noise.coloured**2 * np.exp(-lag / noise.time_constant)) + noise.white**2 * np.eye(ROWS)
    )
    form = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, ROWS), 20)
    inside = form.T @ cho_solve(factor, form) + np.diag([1e-8, *[1.0 / 25.0] * 20])
    pull = form.T @ cho_solve(factor, readings)
    square = readings @ cho_solve(factor, readings) - pull @ np.linalg.solve(inside, pull)
    return float(square + 2.0 * np.log(np.diag(factor[0])).sum() + np.linalg.slogdet(inside)[1])


@pytest.mark.parametrize("seed", (4, 10, 15, 25))
def test_no_other_slow_noise_is_more_likely(seed):
    campaign = recording(seed)
    found = identify(campaign).noises["x", "laser"]
    readings = campaign.runs[0].readings["X_dev_um"]
    reached = likelihood(readings, found)
    for factor in (0.125, 0.25, 0.5, 0.8, 1.25, 2.0, 4.0):  # as much of it in what the errors take
        other = replace(found, time_constant=factor * found.time_constant, coloured=factor**0.5 * found.coloured)
        assert reached < likelihood(readings, other) + 0.1
