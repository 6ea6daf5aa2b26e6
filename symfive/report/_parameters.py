"""Identified parameters against what was known before."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from symfive.drawing import BLUE, FAINT, ORANGE
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.numbers import rounded
from symfive.parameters import DETERMINED, Parameter
from symfive.report._style import blank, footnote, named_rows, styled

MOST_ROWS = 90


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
    named_rows(axes, [p.name.removeprefix("setup.") for p in parameters], unit)
    margin = 0.04 * max(float(np.ptp(reach)), 1e-9)
    axes.set_xlim(min(float(reach.min()), 0.0) - margin, max(float(reach.max()), 0.0) + margin)


def _legend(figure: Figure) -> None:
    determined = Line2D([], [], color=BLUE, marker="o", markersize=4.5, linewidth=2.0, label="value, 95 % interval")
    undetermined = Line2D([], [], color=ORANGE, marker="o", markerfacecolor="none", markersize=4.5, linewidth=2.0,
                      label="no better than the prior")  # fmt: skip
    figure.legend(handles=[determined, undetermined, Patch(color=FAINT, alpha=0.3, label="prior ±1σ")], ncols=3,
                  loc="outside upper right")  # fmt: skip
