"""Gauss–Newton along curved valleys and beside kinks, and noise made white."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from laser_world import laser_run
from scipy.linalg import cho_factor, cho_solve

from symfive.campaign import Campaign
from symfive.inference import Noise, Problem, gauss_newton, whiten
from symfive.machine import preset
from symfive.model import Model
from symfive.simulate import simulate


def _walked(
    reading: Callable[[np.ndarray], tuple[float, np.ndarray]], start: list[float], precision: float
) -> tuple[np.ndarray, bool, int]:
    """Where a fit of one reading (residual and slopes at given values) ends, whether it converged, and how often it looked."""
    seen = []

    def information_at(values: np.ndarray) -> SimpleNamespace:
        seen.append(values)
        residual, slope = reading(values)
        return SimpleNamespace(matrix=np.outer(slope, slope), gradient=slope * residual, square=residual**2)

    free = SimpleNamespace(lower=-np.inf, upper=np.inf)
    problem: Any = SimpleNamespace(
        model=SimpleNamespace(parameters=[free] * len(start), prior_mean=np.zeros(len(start))),
        prior_precision=np.full(len(start), precision),
        free=np.ones(len(start), dtype=bool),
        information_at=information_at,
    )
    return *gauss_newton(problem, np.array(start), 1e-6), len(seen)


@pytest.mark.parametrize("curvature", [1e-4, 1e-3])
@pytest.mark.parametrize("start", [30.0, 60.0])
def test_a_fit_walks_down_a_curved_valley(curvature, start):
    """Readings 10,000 times finer than the priors: y = c·x² is known well, and only the priors lead along it to 0."""

    def fine(at: np.ndarray) -> tuple[float, np.ndarray]:
        return 1e4 * (curvature * at[0] ** 2 - at[1]), 1e4 * np.array([-2.0 * curvature * at[0], 1.0])

    values, converged, looks = _walked(fine, [start, curvature * start**2], 1.0)
    assert converged and values == pytest.approx(0.0, abs=1e-4) and looks < 10


@pytest.mark.parametrize("share", [0.9, 0.97, -0.9, -0.97])
def test_a_fit_converges_where_the_bend_of_the_readings_counts(share):
    """y = a - c·x² is known, and the prior of y pulls by a: along the valley the Hessian is 1 - 2ac times Gauss–Newton's, whose
    steps are ten times too short or lead to the other side again and again."""
    pull = 30.0
    bend = 0.5 * share / pull

    def fine(at: np.ndarray) -> tuple[float, np.ndarray]:
        return 30.0 * (pull - bend * at[0] ** 2 - at[1]), 30.0 * np.array([2.0 * bend * at[0], 1.0])

    values, converged, looks = _walked(fine, [5.0, pull - bend * 25.0], 1.0)
    assert converged and values[0] == pytest.approx(0.0, abs=1e-2) and looks < 25


def test_a_step_that_no_second_one_corrects_is_shortened():
    """A wall that turns up steeply beyond the minimum: both whole steps lead beyond it."""

    def wall(at: np.ndarray) -> tuple[float, np.ndarray]:
        return -100.0 * float(np.arctan(at[0])), 100.0 / (1.0 + at**2)

    values, converged, _ = _walked(wall, [3.0], 1e-12)
    assert converged and values == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("steepness", [60.0, 100.0, 200.0])
def test_a_fit_goes_on_to_a_kink_however_often_its_steps_are_shortened(steepness):
    """A play meets its other side at 1: every whole step leads far beyond."""

    def kinked(at: np.ndarray) -> tuple[float, np.ndarray]:
        beyond = at[0] > 1.0
        residual = 2.6 - 0.3 * at[0] + (steepness + 0.3) * beyond * (at[0] - 1.0)
        return residual, np.array([-steepness if beyond else 0.3])

    values, converged, _ = _walked(kinked, [0.0], 1e-12)
    assert converged and values == pytest.approx(1.0, abs=1e-2)


def test_a_fit_settles_where_a_sum_is_known_and_its_parts_are_not():
    """The zero of an angle and the skew EC0B give the same readings: each is known to 100 µrad, their sum to a fifth of one."""
    angles = np.linspace(0.0, 345.0, 24)
    commands = {name: np.zeros(24) for name in "XYZB"} | {"C": angles}
    run = laser_run("c", angles, axis="C", commands=commands, noise_um=1.0)
    model = Model(simulate(Campaign(machine=preset("table-bc"), runs=(run,)), truth={}, seed=2).campaign)
    problem = Problem.of(model)
    best, _ = gauss_newton(problem, model.start, 1e-6)
    beside = best.copy()
    beside[model.index["setup.c.zero"]] += 0.9
    values, converged = gauss_newton(problem, beside, 1e-2)
    left = float(np.mean(model.predict(values)["c"] - model.predict(best)["c"]))
    assert converged and abs(left) < 1e-2 / np.sqrt(24.0)


@pytest.mark.parametrize(("n", "columns"), [(1, 1), (31, 2), (50, 3), (33, 3), (2200, 1), (1025, 40), (70, 2000)])
@pytest.mark.parametrize(
    "noise", [Noise(0.3, 0.7, 2.0), Noise(0.3, 0.3, 5.0), Noise(0.01, 0.7, 0.05), Noise(0.3, 0.7, 2.0, decades=3)]
)
def test_whitening_is_the_exact_inverse_of_the_covariance(n, columns, noise):
    """Whole blocks, broken ones, several levels of them and several spans of rows."""
    interval = 0.1
    lags = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) * interval
    slow = np.mean([np.exp(-lags / noise.time_constant * 10.0**k) for k in range(noise.decades)], axis=0)
    covariance = noise.coloured**2 * slow + noise.white**2 * np.eye(n)
    residual = np.random.default_rng(n).standard_normal((n, columns))
    white, logs = whiten(residual, noise, interval)
    factor = cho_factor(covariance)
    wanted = residual.T @ cho_solve(factor, residual)
    assert np.abs(white.T @ white - wanted).max() < 1e-8 * np.abs(wanted).max()
    assert logs == pytest.approx(2.0 * np.log(np.diag(factor[0])).sum(), rel=1e-9)


def test_what_never_changes_is_known_in_the_end():
    """A correlation time beyond all recordings: φ is 1 to the last digit, and what is left after many rows is white."""
    white, _ = whiten(np.full((500, 1), 4.0), Noise(0.3, 0.3, 1e18), 0.1)
    assert np.all(np.diff(white[:64, 0]) < 0.0)


def test_whitening_a_table_without_columns_leaves_it_empty():
    """A recording that is fitted without any parameter of its own."""
    white, logs = whiten(np.empty((1000, 2, 0)), Noise(0.3, 0.7, 2.0), 0.1)
    assert white.shape == (1000, 2, 0) and np.isfinite(logs)
