"""Identified parameters against what was known before, and identified error motions with their uncertainty."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from symfive.drawing import BLUE, FAINT, INK, ORANGE
from symfive.errors import InputError
from symfive.identify import Identification, MotionCurve
from symfive.numbers import rounded, unit_words
from symfive.parameters import DETERMINED, Parameter
from symfive.report._style import DIVERGING, SEQUENTIAL, blank, footnote, named_rows, styled

MOST_ROWS = 90
COLUMNS = 3
NORMAL_95 = 1.959964


@styled
def parameters_chart(identification: Identification, *, setup: bool = False) -> Figure:
    """Every parameter of the machine and the effects: value with its 95 % interval, on a bar of the prior's ±1σ.

    One panel a unit. Hollow: the readings add nothing to the prior. `setup=True` draws the runs' set-up instead.
    Raises `InputError` where there is nothing to draw.
    """
    units: dict[str, list[Parameter]] = {}
    for parameter in identification.parameters:
        if parameter.of_setup == setup:
            units.setdefault(parameter.unit, []).append(parameter)
    if not units:
        what = "set-up parameter" if setup else "parameter of the machine"
        raise InputError(f"the model has no {what}", remedy="see result.parameters")
    count = sum(map(len, units.values()))
    shown = {unit: parameters[:MOST_ROWS] for unit, parameters in units.items()}
    longest = max(len(parameters) for parameters in shown.values())
    columns = min(len(shown), 3)
    rows = -(-len(shown) // columns)
    figure = blank(4.8 * columns if columns > 1 else 6.8, (0.23 * longest + 0.9) * rows + 0.9)
    grid = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes, (unit, parameters) in zip(grid, shown.items(), strict=False):
        _draw(axes, identification, parameters, unit)
    for axes in grid[len(shown) :]:
        axes.set_visible(False)
    figure.suptitle(f"{'Set-up' if setup else 'Identified'} parameters", x=0.01, ha="left")
    _legend(figure)
    drawn = sum(map(len, shown.values()))
    footnote(figure, f"Drawn: {drawn} of {count} parameters; the table has all." if drawn < count else "")
    return figure


def _draw(axes: Axes, identification: Identification, parameters: list[Parameter], unit: str) -> None:
    rows, values = np.arange(len(parameters)), np.array([identification[p.name] for p in parameters])
    stds = np.array([identification.uncertainty(p.name) for p in parameters])
    low, high = np.array([identification.interval(p.name) for p in parameters]).T
    mean, sigma = (np.array([getattr(p, name) for p in parameters]) for name in ("mean", "sigma"))
    axes.barh(rows, 2.0 * sigma, left=mean - sigma, height=0.62, color=FAINT, alpha=0.22, linewidth=0)
    determined = stds < DETERMINED * sigma
    for chosen, colour, face in ((determined, BLUE, BLUE), (~determined, ORANGE, "none")):
        axes.hlines(rows[chosen], low[chosen], high[chosen], color=colour, linewidth=2.0)
        axes.plot(values[chosen], rows[chosen], "o", color=colour, markerfacecolor=face, markersize=4.5)
    for row, (value, std) in enumerate(zip(values.tolist(), stds.tolist(), strict=True)):
        said = f"{rounded(value, std, unit)} ± {rounded(std, std, unit)}"
        axes.text(1.02, row, said, transform=axes.get_yaxis_transform(), va="center", fontsize=7.5)
    near = sigma < 50.0 * np.maximum(np.abs(values), stds)  # a prior that is much wider would leave the values a dot
    reach = np.concatenate([low, high, (mean - sigma)[near], (mean + sigma)[near]])
    named_rows(axes, [p.words for p in parameters], unit)
    margin = 0.04 * max(float(np.ptp(reach)), 1e-9)
    axes.set_xlim(min(float(reach.min()), 0.0) - margin, max(float(reach.max()), 0.0) + margin)


def _legend(figure: Figure) -> None:
    determined = Line2D([], [], color=BLUE, marker="o", markersize=4.5, linewidth=2.0, label="value, 95 % interval")
    undetermined = Line2D([], [], color=ORANGE, marker="o", markerfacecolor="none", markersize=4.5, linewidth=2.0,
                      label="no better than the prior")  # fmt: skip
    figure.legend(handles=[determined, undetermined, Patch(color=FAINT, alpha=0.3, label="prior ±1σ")], ncols=3,
                  loc="outside upper right")  # fmt: skip


@styled
def error_motion_bands(identification: Identification, points: int = 73) -> Figure:
    """Each identified error motion of the baseline over the travel that was used, with 1σ and 95 % bands.

    A function of two axes is a pair of maps (value and 1σ); of more axes, the maps over the first two with the others
    in mid-travel. Location errors are not part of them. Raises `InputError` where the baseline has no error motion.
    """
    machine = identification.model.machine
    terms = machine.error_motions
    if not terms:
        raise InputError(
            "the machine file lets no error motion vary", remedy='add one, as EXX = { basis = "polynomial", … }'
        )
    panels = sum(1 if len(term.over) == 1 else 2 for term in terms)
    columns = min(COLUMNS, panels) if all(len(term.over) == 1 for term in terms) else min(4, max(panels, 2))
    rows = -(-panels // columns)
    figure = blank(max(4.8, 3.2 * columns), 2.4 * rows + 0.9)
    grid = list(figure.subplots(rows, columns, squeeze=False).flat)
    place, sliced = 0, False
    for term in terms:
        units = [unit_words(machine.axes[axis].unit) for axis in term.over]
        if len(term.over) == 1:
            _band(grid[place], identification.error_motion(term.name, points), units[0])
            place += 1
        else:
            sliced = sliced or len(term.over) > 2
            _maps(figure, grid[place], grid[place + 1], identification.error_motion(term.name, 37), units)
            place += 2
    for axes in grid[place:]:
        axes.set_visible(False)
    figure.suptitle("Identified error motions (dark band 1σ, light band 95 %)", x=0.01, ha="left")
    footnote(figure, "Maps of more than two axes: the others in mid-travel." if sliced else "")
    return figure


def _band(axes: Axes, curve: MotionCurve, unit: str) -> None:
    axis, at = next(iter(curve.at.items()))
    for factor, alpha in ((NORMAL_95, 0.22), (1.0, 0.40)):
        low, high = curve.value - factor * curve.std, curve.value + factor * curve.std
        axes.fill_between(at, low, high, color=BLUE, alpha=alpha, linewidth=0)
    axes.plot(at, curve.value, color=BLUE)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    middle = float(np.median(curve.std))
    axes.set_title(f"{curve.name}  (1σ about {middle:.2g} {unit_words(curve.unit)})")
    axes.set_xlabel(f"{axis} / {unit}")
    axes.set_ylabel(f"{curve.name} / {unit_words(curve.unit)}")
    axes.margins(x=0.0)


def _maps(figure: Figure, left: Axes, right: Axes, curve: MotionCurve, units: list[str]) -> None:
    names = list(curve.at)
    coordinates = [np.unique(at) for at in curve.at.values()]
    shape = tuple(len(c) for c in coordinates)
    flat = int(np.ravel_multi_index([n // 2 for n in shape[2:]], shape[2:])) if shape[2:] else 0
    value, std = (v.reshape((*shape[:2], -1))[:, :, flat] for v in (curve.value, curve.std))
    reach = max(float(np.abs(value).max()), 1e-12)
    unit = unit_words(curve.unit)
    for axes, table, title, look in (
        (left, value, curve.name, {"cmap": DIVERGING, "vmin": -reach, "vmax": reach}),
        (right, std, f"1σ of {curve.name}", {"cmap": SEQUENTIAL, "vmin": 0.0}),
    ):
        axes.grid(visible=False)
        mesh = axes.pcolormesh(coordinates[0], coordinates[1], table.T, shading="gouraud", rasterized=True, **look)  # type: ignore[arg-type]
        figure.colorbar(mesh, ax=axes, label=unit)
        axes.set_title(title)
        axes.set_xlabel(f"{names[0]} / {units[0]}")
        axes.set_ylabel(f"{names[1]} / {units[1]}")
