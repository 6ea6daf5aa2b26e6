"""How the cost grows: identification with poses and parameters, location of a mismatch with the size of the library.

    .venv/bin/python benchmarks/growth.py [--quick]

(`identify.py` has the growth with rows, each size in a process of its own for its memory.) CPU seconds, least of three. A
smaller library has every second or fourth kind of effect, in the library's order.
"""

from __future__ import annotations

import os

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from identify import SEED
from rows import exponent
from timing import timed

from symfive import identify, preset, simulate
from symfive.campaign import Campaign, read_campaign
from symfive.diagnose import detect, locate
from symfive.inference import Problem
from symfive.machine import ErrorTerm
from symfive.model import Model
from symfive.posterior import candidates
from symfive.procedures import campaign_of, r_test_grid

Growth = list[tuple[int, float]]
STEPS_DEG, STEPS_DEG_QUICK = (30.0, 15.0, 7.5, 3.75), (30.0, 15.0)
ORDERS, ORDERS_QUICK = (1, 2, 4, 8), (1, 2)
EVERY, EVERY_QUICK = (4, 2, 1), (2, 1)
SAG_AND_DRIFT = Path(__file__).resolve().parent.parent / "tests" / "data" / "campaigns" / "static-sag-and-drift" / "fit"


def poses(steps: Sequence[float] = STEPS_DEG) -> Growth:
    """Poses of an R-test at rest, and seconds of the whole identification, the model built already."""
    return [
        (model.campaign.rows, timed(lambda model=model: identify(model, noise="declared"))[0])
        for model in (Model(_static(step)) for step in steps)
    ]


def parameters(orders: Sequence[int] = ORDERS) -> Growth:
    """Parameters of the error motions of every axis, and seconds of one Gauss-Newton step over the same poses."""
    found = []
    for order in orders:
        model = Model(_static(7.5, order))
        problem = Problem.of(model)

        def step(problem: Problem = problem, model: Model = model) -> None:
            information = problem.information_at(model.start)
            np.linalg.solve(information.matrix + np.diag(problem.prior_precision), information.gradient)

        step()  # compiles
        found.append((len(model.parameters), timed(step)[0]))
    return found


def _static(step_deg: float, order: int = 0) -> Campaign:
    """A simulated R-test on a grid; with an `order`, six error motions of it for every axis."""
    machine = preset("table-bc")
    if order:
        motions = {}
        for axis in machine.axes:
            basis = ("fourier",) if machine.axes[axis].rotary else ("polynomial",)
            for c in "XYZABC":
                motions[f"E{c}{axis}"] = ErrorTerm(name=f"E{c}{axis}", sigma=5.0, basis=basis, order=(order,))
        located = {k: v for k, v in machine.errors.items() if v.is_location}
        machine = replace(machine, errors={**located, **motions}, text="")
    return simulate(campaign_of(machine, r_test_grid(machine, step_deg=step_deg)), seed=SEED).campaign


def effects(every: Sequence[int] = EVERY) -> Growth:
    """Effects in the catalogue, and seconds to locate a mismatch with them; the others are excluded."""
    campaign = read_campaign(SAG_AND_DRIFT)
    detection = detect(campaign)
    whole = [form.effect for form in candidates(campaign).forms if not form.effect.unidentified]
    ids = list(dict.fromkeys(effect.id for effect in whole))
    found = []
    for stride in every:
        kept = set(ids[::stride])
        exclude = tuple(id for id in ids if id not in kept)
        count = sum(effect.id in kept for effect in whole)
        found.append((count, timed(lambda exclude=exclude: locate(detection, exclude=exclude))[0]))
    return found


def main() -> None:
    """Parse the options and print."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--quick", action="store_true", help="small sizes")
    quick = options.parse_args().quick
    for name, growth in (
        ("poses", poses(STEPS_DEG_QUICK if quick else STEPS_DEG)),
        ("parameters", parameters(ORDERS_QUICK if quick else ORDERS)),
        ("effects", effects(EVERY_QUICK if quick else EVERY)),
    ):
        sizes = ", ".join(f"{n}: {seconds:.4f} s" for n, seconds in growth)
        print(f"{name:11} {sizes}; {name}^{exponent(growth):.2f}")


if __name__ == "__main__":
    main()
