"""The log of a probing program: one line `row,touch,X,Y,Z` a touch, and the centres of the sphere fitted to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Run
from symfive.errors import InputError

__all__ = ["fitted_centres", "probed_run", "read_touches"]

Array = NDArray[np.float64]
LEAST_TOUCHES = 4
ROUNDS = 20
ENOUGH_MM = 1e-10


def read_touches(path: Path | str) -> dict[int, Array]:
    """Row of the run (from 0) → the X Y Z (mm) that the control stored at its touches (n, 3). Raises `InputError`.

    A touch that was taken again (same row and number) counts once, as it was taken last.
    """
    found: dict[int, dict[int, list[float]]] = {}
    for number, line in enumerate(Path(path).read_text().splitlines(), start=1):
        if not line.strip():
            continue
        try:
            row, touch, x, y, z = (float(word) for word in line.split(","))
            place = [x, y, z]
            if not (row.is_integer() and touch.is_integer() and np.all(np.isfinite(place))):
                raise ValueError
        except ValueError:
            problem = f"{path}, line {number}: {line[:60]!r} is not row,touch,X,Y,Z"
            raise InputError(problem, remedy="take the file that the probing program wrote, unchanged") from None
        found.setdefault(int(row), {})[int(touch)] = place
    return {row: np.array([touches[k] for k in sorted(touches)]) for row, touches in sorted(found.items())}


def fitted_centres(touches: Mapping[int, Array]) -> tuple[Array, float, float]:
    """Centres (rows, 3) of one sphere touched in several places, its effective radius (one for all, the tip's and the pre-travel
    in it) and the rms distance of the touches from it, mm.

    Least squares of the distances by Gauss-Newton: `|p_ij - c_i| = r`. Raises `InputError` for fewer than four touches a row.
    """
    for row, points in touches.items():
        if len(points) < LEAST_TOUCHES:
            problem = f"row {row + 1} of the run has {len(points)} touches"
            raise InputError(problem, remedy=f"a centre needs {LEAST_TOUCHES}: probe this pose again")
    points = np.concatenate(list(touches.values()))
    owner = np.repeat(np.arange(len(touches)), [len(p) for p in touches.values()])
    centres, radius = _start(touches)
    for _ in range(ROUNDS):
        away = points - centres[owner]
        size = np.linalg.norm(away, axis=1)
        table = np.zeros((len(points), 3 * len(touches) + 1))
        for axis in range(3):
            table[np.arange(len(points)), 3 * owner + axis] = away[:, axis] / size
        table[:, -1] = 1.0
        change = np.linalg.lstsq(table, size - radius, rcond=None)[0]
        centres, radius = centres + change[:-1].reshape(-1, 3), radius + float(change[-1])
        if np.abs(change).max() < ENOUGH_MM:
            break
    left = np.linalg.norm(points - centres[owner], axis=1) - radius
    return centres, radius, float(np.sqrt(np.mean(left**2)))


def _start(touches: Mapping[int, Array]) -> tuple[Array, float]:
    """Spheres `|p|² = 2 c·p + (r² - |c|²)`, linear in what is sought, one a row."""
    centres, radii = [], []
    for points in touches.values():
        middle = points.mean(axis=0)
        moved = points - middle
        table = np.column_stack([2.0 * moved, np.ones(len(moved))])
        *centre, constant = np.linalg.lstsq(table, np.sum(moved**2, axis=1), rcond=None)[0]
        centres.append(middle + centre)
        radii.append(np.sqrt(max(constant + float(np.dot(centre, centre)), 0.0)))
    return np.array(centres), float(np.mean(radii))


def probed_run(run: Run, touches: Mapping[int, Array]) -> Run:
    """The planned run with its readings: found minus commanded X, Y, Z in µm, every row probed. Raises `InputError`."""
    missing = sorted(set(range(run.rows)) - set(touches))
    if missing or max(touches) >= run.rows:
        problem = f"run {run.id} has {run.rows} rows, the log has {len(touches)}"
        what = f"row {missing[0] + 1} is missing" if missing else "it is of another run"
        raise InputError(f"{problem}: {what}", remedy="bring the log of this run's program, run to its end")
    centres, _, _ = fitted_centres(touches)
    found = {f"{axis}_dev_um": 1e3 * (centres[:, i] - run.commands[axis]) for i, axis in enumerate("XYZ")}
    return replace(run, readings=found)
