"""Identification against scipy's `least_squares` on the same model, in one run.

    .venv/bin/python benchmarks/least_squares.py [--quick]

Same campaign, same model (symfive's own compiled prediction), same priors as residuals, same declared noise; scipy takes its
Jacobian by differences of two points, with its own tolerances as a user has them, and of three points with the loosest
tolerances that reach symfive's values within 1e-3 of their 1σ. All start at the same values. CPU seconds, the building of the
model in neither.
"""

from __future__ import annotations

import os

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import argparse
from dataclasses import dataclass

import numpy as np
from identify import SEED, plan
from scipy.optimize import least_squares
from timing import timed

from symfive import identify, simulate
from symfive.model import Model

ROWS, ROWS_QUICK = 24_000, 2_000
TOLERANCES = (1e-8, 1e-10, 1e-12)
"""For cost, step and gradient alike, loosest first; the first is scipy's default."""
AGREED = 1e-3


@dataclass(frozen=True)
class Fit:
    """CPU `seconds`, scipy's `tolerance`, predictions of the whole campaign asked for, greatest distance from symfive's values in
    1σ, and how much more -2 log posterior is left."""

    seconds: float
    tolerance: float
    predictions: int
    distance: float
    excess: float


def compare(rows: int) -> tuple[float, int, int, dict[str, Fit]]:
    """symfive's seconds, rows and parameters, and scipy's fit by method."""
    campaign = simulate(plan(rows), seed=SEED).campaign
    model, calls = Model(campaign), 0
    runs, mean, sigma = campaign.runs, model.prior_mean, model.prior_sigma

    def residual(z: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        found = model.predict(mean + sigma * z)
        return np.concatenate([*(((model.readings(r) - found[r.id]) / model.noise(r)).ravel() for r in runs), z])

    start = (model.start - mean) / sigma
    residual(start)
    identify(model, noise="declared")  # whatever is compiled is compiled now
    seconds, ours = timed(lambda: identify(model, noise="declared"))
    least = residual((ours.values - mean) / sigma)
    fits: dict[str, Fit] = {}
    for method, tolerance in (("2-point", TOLERANCES[0]), *(("3-point", t) for t in TOLERANCES)):
        if "3-point" in fits and fits["3-point"].distance < AGREED:
            break
        calls, options = 0, dict.fromkeys(("ftol", "xtol", "gtol"), tolerance)
        spent, found = timed(lambda: least_squares(residual, start, method, **options), 1)  # noqa: B023
        distance = np.abs(mean + sigma * found.x - ours.values) / np.sqrt(np.diag(ours.covariance))
        excess = 2.0 * float(found.cost) - float(least @ least)
        fits[method] = Fit(spent, tolerance, calls, float(distance.max()), excess)
    return seconds, campaign.rows, len(model.parameters), fits


def main() -> None:
    """Parse the options and print."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--quick", action="store_true", help=f"{ROWS_QUICK} rows instead of {ROWS}")
    seconds, rows, parameters, fits = compare(ROWS_QUICK if options.parse_args().quick else ROWS)
    print(f"{rows} rows, {parameters} parameters: symfive {seconds:.3f} s")
    for method, fit in fits.items():
        print(
            f"least_squares, {method}, {fit.tolerance:g}: {fit.seconds:.2f} s ({fit.seconds / seconds:.1f} times), "
            f"{fit.predictions} predictions, values apart by {fit.distance:.1e} σ, "
            f"-2 log posterior above ours by {fit.excess:.1e}"
        )


if __name__ == "__main__":
    main()
