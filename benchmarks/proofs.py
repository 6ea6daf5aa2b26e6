"""Certificates of every preset machine, R-test and ball bar: what is proved, how sharp, in how much processor time.

    .venv/bin/python benchmarks/proofs.py [MACHINE ...]

Designs are of one start and not rounded: what counts is the bound, not the plan. `gap` is how much lower the bound's variance
is than that of the best weighted design found.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import math
import sys

from timing import timed

from symfive.design import certify, make_space, optimise, task_of
from symfive.errors import InputError
from symfive.machine import preset, presets

POINTS = {"r_test": (36, 2), "ball_bar": (48, 3)}


def main(names: list[str]) -> None:
    """One line a machine and instrument."""
    print(f"{'machine':16}{'instrument':12}{'certificate':>12}  {'':10}{'gap':>8}{'CPU s':>8}")
    for name in names or presets():
        for instrument, (points, setups) in POINTS.items():
            try:
                space = make_space(preset(name), instrument)
            except InputError:
                continue
            task = task_of(space, "D", [p.name for p in space.shared], None)
            rows, _ = optimise(space, task, points, setups, starts=1)
            spent, found = timed(lambda: certify(space, task, rows), 1)  # noqa: B023
            gap = 1.0 - math.exp(found.bound - found.relaxed)
            sure = "proved" if found.proved else "searched"
            print(f"{name:16}{instrument:12}{found.efficiency:12.3f}  {sure:10}{gap:8.4f}{spent:8.1f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
