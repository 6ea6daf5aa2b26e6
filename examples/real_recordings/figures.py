"""One figure a recording: the residual before and after over the coordinate that matters, and the held-out parts."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from symfive.identify import Identification

from .study import Study, coordinate, rms_of, telling_column
from .words import shown_unit

Array = NDArray[np.float64]
BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#8a949e"
MANY, SIDE = 400, 0.006
"""Rows above which points get small; up to which the two fits stand a little aside of each other (share of the reach)."""


def drawing(study: Study) -> Figure:
    """Left: residual of one column over the coordinate, baseline and with the findings. Right: held-out rms by part."""
    recording, found = study.recording, study.found
    figure = Figure(figsize=(11.0, 4.0), layout="constrained")
    figure.suptitle(f"{recording.name}: {recording.machine}", fontsize=11)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    for ax in (left, right):
        ax.grid(True, color="#e1e5e9", linewidth=0.6)
        ax.set_axisbelow(True)
        ax.tick_params(which="both", labelsize=8)
        for side in ("top", "right"):
            ax.spines[side].set_visible(False)
    for fit, colour, what in ((found.before, ORANGE, "baseline"), (found.after, BLUE, "with the findings")):
        if fit is found.before or found.findings:
            _residuals(left, study, fit, colour, what)
    left.set_xlabel(_axis_label(study), fontsize=8)
    left.set_ylabel(f"residual of {telling_column(study).rsplit('_', 1)[0]} / {_unit(study)}", fontsize=8)
    left.margins(y=0.22)
    left.legend(fontsize=8, frameon=False, ncols=2, loc="upper center")
    if not found.findings:
        left.set_title("no finding: nothing changes", loc="left", fontsize=9)
    _held_out(right, study)
    return figure


def _unit(study: Study) -> str:
    return shown_unit(telling_column(study).rsplit("_", 1)[1])


def _axis_label(study: Study) -> str:
    over = study.recording.over
    if over == "time":
        return "time / s"
    axis = over.removesuffix(" velocity")
    unit = "°" if study.campaign.machine.axes[axis].rotary else "mm"
    if over != axis:
        return f"velocity of {axis} / {unit}/s"
    return f"{axis} / {unit}"


def _residuals(ax: Axes, study: Study, fit: Identification, colour: str, what: str) -> None:
    places, values, outliers = [], [], []
    left_out, wanted = fit.problem().left_out, telling_column(study)
    for run in filter(study.recording.draw, study.campaign.runs):
        names = [c.name for c in fit.model.columns(run)]
        if wanted in names:
            column = names.index(wanted)
            places.append(coordinate(study, run.id))
            values.append(fit.residuals[run.id][:, column])
            outliers.append(left_out[run.id][:, column])
    x, y, out = np.concatenate(places), np.concatenate(values), np.concatenate(outliers)
    rms = float(np.sqrt(np.mean(y**2)))
    label = f"{what}: {rms:.3g} {_unit(study)} rms here"
    few = len(x) <= MANY
    aside = (-1.0 if fit is study.found.before else 1.0) * SIDE * float(np.ptp(x)) if few else 0.0
    ax.plot(
        x[~out] + aside,
        y[~out],
        ".",
        ms=5 if few else 2,
        color=colour,
        alpha=0.25 if study.recording.bins else 0.6,
        label=label,
    )
    if out.any():
        ax.plot(
            x[out] + aside,
            y[out],
            "x",
            ms=5,
            color=colour,
            label=f"{int(out.sum())} outlier{'s' if out.sum() > 1 else ''}",
        )
    if study.recording.bins:
        _mean_line(ax, x[~out], y[~out], study.recording.bins, colour)


def _mean_line(ax: Axes, x: Array, y: Array, bins: int, colour: str) -> None:
    """The mean of as many rows a bin, with its 1σ."""
    for_each = [rows for rows in np.array_split(np.argsort(x), bins) if len(rows) > 1]
    place, mean = [x[rows].mean() for rows in for_each], [y[rows].mean() for rows in for_each]
    spread = [y[rows].std() / np.sqrt(len(rows)) for rows in for_each]
    ax.errorbar(place, mean, yerr=spread, color=colour, lw=1.4, capsize=2, label="mean and its 1σ")


def _held_out(ax: Axes, study: Study) -> None:
    unit = shown_unit(study.recording.unit)
    before, after = (rms_of(fit, study.recording.unit) for fit in (study.found.before, study.found.after))
    rows = [("all that was fitted", before, after)]
    rows += [(part.label, part.before, part.after) for part in study.held_out]
    y = np.arange(len(rows))[::-1].astype(float)
    highest = max(max(before, after) for _, before, after in rows)
    for place, (label, before, after) in zip(y, rows, strict=True):
        for shift, value, colour in ((0.14, before, ORANGE), (-0.14, after, BLUE)):
            ax.barh(place + shift, value, height=0.26, color=colour)
            ax.text(value + 0.01 * highest, place + shift, f"{value:.3g}", va="center", fontsize=8, color="#3c4650")
        ax.text(0.005 * highest, place + 0.32, label, fontsize=8, va="bottom")
    ax.set_yticks([])
    ax.set_ylim(-0.5, len(rows) - 0.3)
    ax.set_xlim(0.0, 1.15 * highest)
    ax.set_xlabel(f"rms of the readings in {unit}, fitted and held out", fontsize=8)
    ax.set_title("fitted → predicted", loc="left", fontsize=9)


def save(figure: Figure, folder: Path, name: str) -> str:
    """One PNG; its file name."""
    folder.mkdir(parents=True, exist_ok=True)
    file = f"{re.sub('[^a-z0-9_]+', '-', name.lower()).strip('-')}.png"
    figure.savefig(folder / file, dpi=110)
    return file
