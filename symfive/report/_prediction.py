"""Predicted against measured readings of a run that the fit has not seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from symfive.arrays import Array
from symfive.drawing import FAINT, INK, SERIES
from symfive.errors import InputError
from symfive.numbers import plain_number, unit_words
from symfive.report._over_time import FEW_ROWS
from symfive.report._style import blank, footnote, styled
from symfive.report._traces import spread

MOST_POINTS = 12_000
MOST_COLUMNS = 6


@styled
def prediction_chart(
    measured: ArrayLike, predicted: ArrayLike, *, at: ArrayLike | None = None, along: str = "row",
    names: Sequence[str] = (), unit: str = "um", noise: float | None = None, title: str = "held-out run",
) -> Figure:  # fmt: skip
    """Measured and predicted readings above each other, their difference below, with its root mean square.

    `measured`, `predicted` (N,) or (N, ny) in `unit`; `at` (N,) the abscissa, named by `along` ("time / s"); `names`
    of the columns; `noise` the declared 1σ, drawn as a ±2σ band. Raises `InputError` where the shapes differ.
    """
    read, model = (_table(values) for values in (measured, predicted))
    if read.shape != model.shape or not read.size:
        problem = f"measured readings {read.shape} and predicted ones {model.shape} do not match"
        raise InputError(problem, remedy="give both the same rows and columns, at least one")
    place = np.arange(1.0, len(read) + 1.0) if at is None else np.asarray(at, dtype=float)
    if place.shape != (len(read),):
        raise InputError(f"at has the shape {place.shape}", remedy=f"give {len(read)} numbers, one a row")
    columns = min(read.shape[1], MOST_COLUMNS)
    figure = blank(max(6.0, 3.0 * columns), 4.6)
    grid = figure.subplots(2, columns, squeeze=False, sharex=True, height_ratios=[3, 2])
    index, step = spread(len(read), MOST_POINTS)
    for j in range(columns):
        upper, lower = grid[:, j]
        name = names[j] if j < len(names) else f"column {j + 1}" if read.shape[1] > 1 else "reading"
        colour, difference = SERIES[j % len(SERIES)], read[:, j] - model[:, j]
        few = len(read) < FEW_ROWS
        wide, thin = ({"linestyle": "none", "marker": m, "markersize": s} for m, s in (("o", 5.0), ("_", 8.0)))
        look = (wide, thin) if few else ({"linewidth": 2.4}, {"linewidth": 0.9})
        upper.plot(place[index], read[index, j], color=colour, alpha=0.45, label="measured", **look[0])
        upper.plot(place[index], model[index, j], color=INK, label="predicted", **look[1])
        upper.set_ylabel(f"{name} / {unit_words(unit)}")
        upper.legend(loc="best")
        if noise is not None:
            lower.axhspan(-2.0 * noise, 2.0 * noise, color=FAINT, alpha=0.16, linewidth=0)
        lower.axhline(0.0, color=INK, linewidth=0.6)
        if few:
            lower.vlines(place, 0.0, difference, color=colour, linewidth=0.8, alpha=0.55)
            lower.plot(place, difference, "o", color=colour, markersize=4.0, markeredgewidth=0.0)
        else:
            lower.plot(place[index], difference[index], color=colour, linewidth=0.7, rasterized=len(index) > 2000)
        rms = plain_number(float(np.sqrt(np.nanmean(difference**2))), unit)
        against = f", declared noise {plain_number(noise)}" if noise is not None else ""
        lower.set_title(f"measured − predicted: RMS {rms}{against} {unit_words(unit)}")
        lower.set_ylabel(unit_words(unit))
        lower.set_xlabel(along)
        lower.margins(x=0.01)
    figure.suptitle(f"Prediction check: {title}", x=0.01, ha="left")
    footnote(
        figure,
        f"Drawn: every {step}th row; the numbers are of all rows." if step > 1 else "",
        f"Drawn: {columns} of {read.shape[1]} columns." if columns < read.shape[1] else "",
        "Grey: ±2σ of the declared noise." if noise is not None else "",
    )
    return figure


def _table(values: ArrayLike) -> Array:
    array = np.asarray(values, dtype=float)
    return array[:, None] if array.ndim == 1 else array.reshape(len(array), -1) if array.ndim else array.reshape(1, 1)
