"""The log of a probing program: one line a touch, and the centres of the sphere fitted to it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run
from symfive.errors import InputError
from symfive.files import read_text, shown
from symfive.instruments import touches_of
from symfive.plausible import SOUGHT_MM

LEAST_TOUCHES = 4
ROUNDS = 20
ENOUGH_MM = 1e-10
MAX_BYTES = 20_000_000
FAR_MM = 0.1
"""No touch lies so far off the sphere of all others: the pre-travel of a probe varies by some µm, dirt is some 10 µm thick."""

_NUMBER = r"([-+]?\s*(?:\d+[.,]?\d*|[.,]\d+)(?:EX?[-+]?\d+)?)"
_COMMAS = re.compile(r"(\d+),(\d+),([^,]+),([^,]+),([^,]+)")
_WORDS = re.compile(rf"R\s*(\d+)\s*T\s*(\d+)\s*X\s*{_NUMBER}\s*Y\s*{_NUMBER}\s*Z\s*{_NUMBER}", re.I)
_BESIDE = re.compile(r"[%;].*|")
"""Lines of the control itself: the tape's ends, a path."""


def read_touches(path: Path | str) -> dict[int, Array]:
    """Row of the run (from 0) → the X Y Z (mm) that the control stored at its touches (n, 3). Raises `InputError`.

    A line is `row,touch,X,Y,Z` (LinuxCNC) or `R0 T1 X12.345 Y-6.7 Z89`, with any blanks, decimal comma or point (the other
    controls). A touch that was taken again (same row and number) counts once, as it was taken last. A last line without its end
    that is no touch was cut off where the log broke.
    """
    path = Path(path)
    found: dict[int, dict[int, list[float]]] = {}
    lines = read_text(path, at_most=MAX_BYTES).split("\n")
    for number, line in enumerate(lines, start=1):
        line = "".join(c for c in line if c.isprintable()).strip()
        if _BESIDE.fullmatch(line):
            continue
        try:
            row, touch, place = _touch(line)
        except ValueError:
            if found and number == len(lines):
                break
            problem = f"{shown(line)} is not a touch: row,touch,X,Y,Z or R0 T1 X12.3 Y4.5 Z6.7"
            remedy = "take the file that the probing program wrote, unchanged"
            raise InputError(problem, path=path, line=number, remedy=remedy) from None
        found.setdefault(row, {})[touch] = place
    if not found:
        raise InputError("the log has no touches", path=path, remedy="run the probing program, and take its log")
    return {row: np.array([touches[k] for k in sorted(touches)]) for row, touches in sorted(found.items())}


def _touch(line: str) -> tuple[int, int, list[float]]:
    """Row, touch, place. Raises `ValueError`."""
    words = _WORDS.fullmatch(line)
    match = words or _COMMAS.fullmatch(line)
    if match is None:
        raise ValueError
    row, touch, *place = match.groups()
    if words:
        place = [re.sub(r"\s", "", text).replace(",", ".").upper().replace("EX", "E") for text in place]
    numbers = [float(text) for text in place]
    if not np.all(np.isfinite(numbers)):
        raise ValueError
    return int(row), int(touch), numbers


def fitted_centres(touches: Mapping[int, Array]) -> tuple[Array, float, float]:
    """Centres (rows, 3) of one sphere touched in several places, its effective radius (one for all, the tip's and the pre-travel
    in it) and the rms distance of the touches from it, mm.

    Least squares of the distances by Gauss-Newton: `|p_ij - c_i| = r`. Raises `InputError` for fewer than four touches a row.
    """
    centres, radius, left = _fitted(touches)
    return centres, radius, float(np.sqrt(np.mean(left**2)))


def _fitted(touches: Mapping[int, Array]) -> tuple[Array, float, Array]:
    """Centres, radius, and what each touch is off the sphere, mm, row by row."""
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
    return centres, radius, np.linalg.norm(points - centres[owner], axis=1) - radius


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


@dataclass(frozen=True, kw_only=True)
class Probed:
    """A planned run with its readings, found minus commanded X, Y, Z in µm, of the rows that were probed.

    `planned` rows of the plan; `radius` mm, effective, of sphere and tip; `rms_um` of the touches off that sphere.
    """

    run: Run
    planned: int
    radius: float
    rms_um: float

    @property
    def runs(self) -> tuple[Run, ...]:
        """The one run."""
        return (self.run,)

    def __str__(self) -> str:
        said = f"run {self.run.id}: {self.run.rows} centres, effective radius of sphere and tip {self.radius:.4f} mm"
        said = f"{said}, touches {self.rms_um:.1f} µm (rms) off that sphere"
        if self.run.rows < self.planned:
            said = f"{said}; the log ends before pose {self.run.rows + 1} of {self.planned}"
        return said


def probed_run(run: Run, touches: Mapping[int, Array]) -> Probed:
    """The planned run with the readings of its log. The log may end early, but must begin with the first pose and skip none.

    Raises `InputError` for another run's log, and for a touch that is off the sphere of all others.
    """
    if "touch_probe" not in run.instrument:
        raise InputError(f"run {run.id} is not one of a touch probe", remedy="give the logs of probing programs")
    each = len(touches_of(run))
    last = max(touches)
    whole = {row: points for row, points in touches.items() if row < last or len(points) == each}
    for row in range(max(whole, default=-1) + 1):
        if len(whole.get(row, ())) != each:
            problem = (
                f"pose {row + 1} of run {run.id} has {len(whole.get(row, ()))} touches in the log, {each} are planned"
            )
            raise InputError(problem, remedy="bring the log of this run's program, unchanged")
    if not whole or last >= run.rows:
        problem = f"the log has {len(whole)} whole poses, the last is pose {last + 1}; run {run.id} has {run.rows}"
        raise InputError(problem, remedy="bring the log of this run's program")
    centres, radius, left = _fitted(whole)
    rows = len(whole)
    off = centres - np.stack([run.commands[axis][:rows] for axis in "XYZ"], axis=1)
    k = int(np.argmax(np.abs(off).max(axis=1)))
    if np.abs(off[k]).max() > SOUGHT_MM:
        problem = (
            f"at pose {k + 1} of run {run.id} the sphere is {np.abs(off[k]).max():.1f} mm from where the plan has it"
        )
        remedy = "bring the log of this run's program; it must have been written without tool-centre control"
        raise InputError(problem, remedy=remedy)
    j = int(np.argmax(np.abs(left)))
    if abs(left[j]) > FAR_MM:
        problem = (
            f"touches at pose {j // each + 1} of run {run.id} are {abs(left[j]):.3f} mm off the sphere of all touches"
        )
        raise InputError(problem, remedy="clean sphere and tip, check the probe, and run the program again")
    found = {f"{axis}_dev_um": 1e3 * off[:, i] for i, axis in enumerate("XYZ")}
    probed = run.part(0, rows).with_readings(found)
    return Probed(run=probed, planned=run.rows, radius=radius, rms_um=1e3 * float(np.sqrt(np.mean(left**2))))
