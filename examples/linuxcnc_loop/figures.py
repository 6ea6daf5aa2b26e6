"""Deviations before and after, what is left, and the location errors beside the truth."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from .deviation import size
from .result import Loop, Passage

logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)
BEFORE, AFTER, NOISE = "#b4471f", "#1f6fb4", "#777777"
DPI = 120


def save_figures(loop: Loop, folder: Path) -> None:
    """`deviation.png`, `rest.png`, `location-errors.png`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in (
        ("deviation", _deviation(loop)), ("rest", _rest(loop)), ("location-errors", _location_errors(loop))
    ):  # fmt: skip
        figure.savefig(folder / f"{name}.png", dpi=DPI)


def _deviation(loop: Loop) -> Figure:
    """True distance and measured distance of every pose on a logarithmic scale."""
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    poses = (len(loop.before.true.distances), len(loop.held_out_before.true.distances))
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(poses[0], max(poses[1], 0.3 * poses[0])))
    pairs = ((left, loop.before, loop.after, "the plan's poses"),
             (right, loop.held_out_before, loop.held_out_after, "held-out poses"))  # fmt: skip
    for axes, before, after, title in pairs:
        for passage, colour, words in ((before, BEFORE, "before"), (after, AFTER, "after")):
            _points(axes, passage, colour, words)
        axes.axhline(np.sqrt(3.0) * loop.noise_um, color=NOISE, linestyle="--", label="noise of a reading, rms")
        axes.set(yscale="log", xlabel="pose", title=title)
    left.set_ylabel("deviation of the tool centre point / µm")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(
        f"{loop.machine.name} at LinuxCNC's joints: true rms {loop.before.true.rms:.0f} → {loop.after.true.rms:.1f} µm, "
        f"held out {loop.held_out_before.true.rms:.0f} → {loop.held_out_after.true.rms:.1f} µm"
    )
    return figure


def _points(axes: object, passage: Passage, colour: str, words: str) -> None:
    number = np.arange(1, len(passage.true.distances) + 1)
    axes.plot(number, passage.true.distances, "o", color=colour, markersize=4, label=f"{words}: true, work offset set")  # type: ignore[attr-defined]
    axes.plot(  # type: ignore[attr-defined]
        number,
        passage.measured.distances,
        "x",
        color=colour,
        markersize=4,
        alpha=0.6,
        label=f"{words}: measured, set-up taken out",
    )


def _rest(loop: Loop) -> Figure:
    """The parts of what is left as bars."""
    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    axes = figure.subplots()
    names = ("whole", "identified values", "beyond the model", "control")
    rows = np.arange(len(names))
    for shift, passage, colour, words in (
        (-0.2, loop.after, AFTER, "plan's poses"), (0.2, loop.held_out_after, "#6aa9d8", "held out")
    ):  # fmt: skip
        rest = passage.rest
        sizes = [passage.true.rms, *(size(part) for part in (rest.values, rest.beyond, rest.control))]
        bars = axes.barh(rows + shift, sizes, height=0.38, color=colour, label=words)
        axes.bar_label(bars, fmt=" {:.3g}", fontsize=8)
    axes.set_yticks(rows, names)
    axes.invert_yaxis()
    axes.margins(x=0.12)
    axes.axvline(np.sqrt(3.0) * loop.noise_um, color=NOISE, linestyle="--", label="noise of a reading")
    axes.set(xlabel="rms / µm", title=f"{loop.machine.name}: what is left, work offset set")
    axes.legend(frameon=False)
    return figure


def _location_errors(loop: Loop) -> Figure:
    """Identified values with their 95 % bands beside the truth."""
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    names = list(loop.truth.location_errors)
    values = np.array([loop.identification[name] for name in names])
    bands = np.abs(np.array([loop.identification.interval(name) for name in names]).T - values)
    axes.errorbar(names, values, bands, fmt="o", color=AFTER, capsize=3, label="identified, 95 % band")
    axes.plot(
        names, [loop.truth.location_errors[name] for name in names], "_", color=BEFORE, markersize=16, label="true"
    )
    axes.axhline(0.0, color=NOISE, linewidth=0.6)
    axes.tick_params(axis="x", rotation=60)
    axes.set(ylabel="µm, µrad", title=f"{loop.machine.name}: location errors")
    axes.legend(frameon=False)
    return figure
