"""Correlations of the estimated parameters."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from symfive.arrays import Array
from symfive.drawing import FAINT, INK
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.report._style import DIVERGING, blank, footnote, short, styled

Group = tuple[str, list[tuple[str, int]]]
MOST_SINGLE = 70
NUMBERED = 26
DIAGONAL = "#b4bec8"


@styled
def correlation_matrix(identification: Identification) -> Figure:
    """Posterior correlations by name: the machine's and the effects' parameters first, then each run's set-up.

    Near ±1: the readings fix a combination of the two and not each. With more than 70 parameters each run's set-up is
    drawn as one field, that of its strongest correlation. Parameters held fixed are left out.
    """
    groups = _groups(identification)
    if not groups:
        raise InputError("no parameter was free", remedy="free at least one")
    std = np.where(identification.std > 0.0, identification.std, 1.0)
    correlation = np.clip(identification.covariance / np.outer(std, std), -1.0, 1.0)
    order = [place for _, members in groups for _, place in members]
    together = len(order) > MOST_SINGLE and any(heading for heading, _ in groups)
    if together:
        table, labels, edges = _condensed(correlation, groups)
    else:
        table = correlation[np.ix_(order, order)]
        labels = [short(label) for _, members in groups for label, _ in members]
        edges = list(np.cumsum([0] + [len(members) for _, members in groups]))
    n = len(labels)
    letters = 8.0 if n <= NUMBERED else 6.5 if n <= 50 else 5.8
    side = float(np.clip(0.155 * n, 2.4, 9.0) if n > NUMBERED else max(0.28 * n, 2.4))
    figure, axes, beside = _layout(side, 0.0078 * letters * max(map(len, labels)) + 0.2)
    masked = np.ma.masked_array(table, mask=np.eye(n, dtype=bool))
    colours = DIVERGING.with_extremes(bad=DIAGONAL)
    image = axes.imshow(masked, cmap=colours, vmin=-1.0, vmax=1.0, interpolation="nearest")
    axes.grid(visible=False)
    axes.set_xticks(range(n), labels, rotation=90, fontsize=letters)
    axes.set_yticks(range(n), labels, fontsize=letters)
    axes.tick_params(length=0.0)
    if n <= NUMBERED:
        _numbers(axes, table)
    for edge in edges[1:-1]:
        axes.axhline(edge - 0.5, color=INK, linewidth=0.7)
        axes.axvline(edge - 0.5, color=INK, linewidth=0.7)
    if not together:
        _headings(axes, [heading for heading, _ in groups], edges)
    bar = figure.colorbar(image, cax=beside, ticks=[-1.0, -0.5, 0.0, 0.5, 1.0])
    bar.set_label("correlation (−1 … 1)")
    figure.suptitle("Correlation of the estimated parameters", x=0.01, ha="left")
    footnote(figure, "Set-up of a run: its strongest correlation with each of the others." if together else "")
    return figure


def _layout(side: float, margin: float) -> tuple[Figure, Axes, Axes]:
    """A square of `side` inches with room for labels, headings and a colour bar."""
    width, height = margin + side + 2.1, margin + side + 0.75
    figure = blank(width, height, arranged=False)
    axes = figure.add_axes((margin / width, (margin + 0.2) / height, side / width, side / height))
    tall = min(0.7 * side, 3.0)
    bar = ((margin + side + 1.35) / width, (margin + 0.2 + 0.5 * (side - tall)) / height, 0.14 / width, tall / height)
    return figure, axes, figure.add_axes(bar)


def _groups(identification: Identification) -> list[Group]:
    machine: Group = ("", [])
    owners: dict[str, Group] = {}
    for place, parameter in enumerate(identification.parameters):
        if identification.std[place] <= 0.0:
            continue
        if not parameter.of_setup:
            machine[1].append((parameter.what, place))
        else:
            heading = parameter.owner_words
            owners.setdefault(heading, (heading, []))[1].append((parameter.what, place))
    return [group for group in (machine, *owners.values()) if group[1]]


def _condensed(correlation: Array, groups: list[Group]) -> tuple[Array, list[str], list[int]]:
    """One field per machine parameter and one per run, the strongest correlation of its members."""
    units: list[tuple[str, list[int]]] = []
    for heading, members in groups:
        if heading:
            units.append((f"set-up of {short(heading, 24)}", [place for _, place in members]))
        else:
            units += [(label, [place]) for label, place in members]
    table = np.eye(len(units))
    for i, (_, first) in enumerate(units):
        for j, (_, second) in enumerate(units):
            if i != j:
                block = correlation[np.ix_(first, second)]
                table[i, j] = block.flat[int(np.argmax(np.abs(block)))]
    single = sum(len(members) for heading, members in groups if not heading)
    return table, [name for name, _ in units], [0, single, len(units)]


def _numbers(axes: Axes, table: Array) -> None:
    for i, j in np.ndindex(*table.shape):
        if i != j and abs(table[i, j]) >= 0.1:
            colour = "#ffffff" if abs(table[i, j]) > 0.45 else "#1e2b37"
            text = f"{table[i, j]:.1f}".replace("0.", ".") if abs(table[i, j]) < 0.995 else f"{table[i, j]:.0f}"
            words = text.replace("-", "−")
            axes.text(j, i, words, ha="center", va="center", fontsize=6.5, color=colour)


def _headings(axes: Axes, headings: list[str], edges: list[int]) -> None:
    """Run ids along the right edge, beside their set-up parameters."""
    for heading, (first, last) in zip(headings, pairwise(edges), strict=True):
        if heading:
            words = f" set-up of\n {short(heading, 18)}"
            axes.text(edges[-1] - 0.2, 0.5 * (first + last) - 0.5, words, fontsize=7, va="center", color=FAINT)
