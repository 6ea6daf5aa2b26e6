"""A run by windows of its rows, so that a long one is never in memory as a whole.

Drives, plays and filters remember what was before, and splines reach a little ahead. So each window is computed with a margin of
rows on either side, and two neighbours must agree in the rows about their seam. Where they do not, the margin grows, to the whole
run if need be. The first window begins with the run and is right; what agrees with it goes on from the same state, and so on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Indices
from symfive.disk import new_table, release
from symfive.model import Model
from symfive.runs import Run

LONG = 50_000
"""Up to so many rows a run is one window."""
ROWS = 16_384
MARGIN_ROWS, MARGIN_S = 64, 2.5
"""Fifty time constants of a slow position loop (20 1/s)."""
GROWTH = 4
SHARED = 8
"""Rows on either side of a seam in which two windows must agree."""
SAME_READING, SAME_SLOPE = 1e-6, 1e-8
"""To this share of the noise (slopes: times 1σ of the prior) and of the slopes' own size."""


@dataclass(frozen=True)
class Window:
    """Rows of a run from number `first`: what `inside` cuts out of `run`, of `prediction` (m, ny) and of `jacobian`
    (m, ny, k; None where no slopes were wanted), which hold the margins as well. `columns` (k,) as in `Linearisation`."""

    first: int
    inside: slice
    run: Run
    prediction: Array
    jacobian: Array | None
    columns: Indices

    @property
    def rows(self) -> slice:
        """Its rows in the whole run."""
        return slice(self.first, self.first + self.inside.stop - self.inside.start)

    def about(self, seam: int) -> tuple[Array, Array | None]:
        """Prediction and slopes of the rows about a row of the whole run."""
        middle = seam - self.first + self.inside.start
        rows = slice(middle - SHARED, middle + SHARED)
        return self.prediction[rows], None if self.jacobian is None else self.jacobian[rows]


def spans_of(rows: int) -> list[slice]:
    """Rows in stretches that fit into memory."""
    return [slice(first, min(first + LONG, rows)) for first in range(0, rows, LONG)]


def windows_of(
    model: Model, run: Run, values: Array, margins: dict[str, int], slopes: int | None = None
) -> Iterator[Window]:
    """The run at parameter `values`, window by window. `slopes`: in the first so many rows only (default: all).

    `margins` remembers by run how many rows the margins take.
    """
    wanted = run.rows if slopes is None else slopes
    margin = margins.get(run.id, 0) or _margin(run)
    rows = max(ROWS, 2 * margin)
    if run.rows <= max(LONG, 2 * rows):
        yield _window(model, run, values, slice(0, run.rows), 0, wanted)
        return
    former = _window(model, run, values, slice(0, rows), margin, wanted)
    for first in range(rows, run.rows, rows):
        fresh = _window(model, run, values, slice(first, min(first + rows, run.rows)), margin, wanted)
        while not _agree(model, former, fresh):
            margins[run.id] = margin = GROWTH * margin
            if 2 * margin > run.rows:
                yield _window(model, run, values, slice(former.first, run.rows), run.rows, wanted)
                return
            former, fresh = (_window(model, run, values, w.rows, margin, wanted) for w in (former, fresh))
        yield former
        former = fresh
    yield former


def predicted(model: Model, run: Run, values: Array, margins: dict[str, int]) -> Array:
    """The readings that a model predicts (N, ny), on disk where they are long."""
    found = new_table(run.rows, len(model.columns(run)))
    for window in windows_of(model, run, values, margins, slopes=0):
        found[window.rows] = window.prediction[window.inside]
        release(found)
    return found


def _margin(run: Run) -> int:
    if not run.dynamic or run.rows <= LONG:
        return MARGIN_ROWS
    return max(MARGIN_ROWS, int(np.ceil(MARGIN_S / run.interval)))


def _window(model: Model, run: Run, values: Array, rows: slice, margin: int, slopes: int) -> Window:
    begin, end = max(0, rows.start - margin), min(run.rows, rows.stop + margin)
    whole = end - begin == run.rows
    if not whole:
        run = run.part(begin, end)
    inside = slice(rows.start - begin, rows.stop - begin)
    if rows.start < slopes:
        line = model.linearise(run, values, ahead=whole)
        return Window(rows.start, inside, run, line.prediction, line.jacobian, line.columns)
    return Window(rows.start, inside, run, model.predict_run(run, values), None, np.zeros(0, dtype=np.int64))


def _agree(model: Model, former: Window, fresh: Window) -> bool:
    """Whether two neighbours say the same about the rows at their seam."""
    (reading, slope), (other, other_slope) = former.about(fresh.first), fresh.about(fresh.first)
    noise = model.noise(fresh.run)
    if np.any(np.abs(reading - other) > SAME_READING * noise):
        return False
    if slope is None or other_slope is None:
        return True
    least = SAME_READING * noise[:, None] / model.prior_sigma[fresh.columns]
    return bool(np.all(np.abs(slope - other_slope) <= least + SAME_SLOPE * np.abs(slope).max(axis=0)))
