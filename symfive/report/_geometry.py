"""How the geometry moved when the physics joined the model."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from symfive.diagnose import Diagnosis, Finding
from symfive.drawing import BLUE, ORANGE
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.numbers import rounded, unit_words, with_std
from symfive.parameters import Parameter
from symfive.report._style import blank, footnote, named_rows, styled, tip
from symfive.report._tables import Cell, table
from symfive.report._words import meaning

MOST_ROWS = 60


@styled
def geometry_chart(before: Identification, after: Identification) -> Figure:
    """Location errors before (hollow) and after (full) with ±1σ, one panel a unit.

    Where the machine file has no location error free, its error motions' coefficients. Raises `InputError` where there
    is neither.
    """
    both = [p for p in after.parameters if p.name in before.model.index]
    parameters = [p for p in both if p.kind == "location_error"] or [p for p in both if p.kind == "error_motion"]
    if not parameters:
        raise InputError("the machine file frees no geometry", remedy="add a location error, as EX0C")
    units: dict[str, list[Parameter]] = {}
    for p in parameters[:MOST_ROWS]:
        units.setdefault(p.unit, []).append(p)
    longest = max(map(len, units.values()))
    figure = blank(4.7 * len(units) if len(units) > 1 else 6.8, 0.34 * longest + 1.25)
    panels = figure.subplots(1, len(units), squeeze=False)[0]
    for axes, (unit, mine) in zip(panels, units.items(), strict=True):
        _draw(axes, before, after, mine, unit)
    handles = [
        Line2D([], [], color=ORANGE, marker="o", markerfacecolor="none", markersize=5.0, label="before, ±1σ"),
        Line2D([], [], color=BLUE, marker="o", markersize=5.0, label="after, ±1σ"),
    ]
    figure.suptitle("Geometry before and after", x=0.01, ha="left")
    figure.legend(handles=handles, ncols=2, loc="outside upper right")
    rest = len(parameters) - MOST_ROWS
    footnote(figure, f"{rest} more in the table." if rest > 0 else "")
    return figure


def _draw(axes: Axes, before: Identification, after: Identification, parameters: list[Parameter], unit: str) -> None:
    for row, p in enumerate(parameters):
        for result, shift, colour, words in ((before, -0.15, ORANGE, "before"), (after, 0.15, BLUE, "after")):
            value, std = result[p.name], result.uncertainty(p.name)
            axes.plot([value - std, value + std], [row + shift] * 2, color=colour, linewidth=1.8, solid_capstyle="butt")
            face = colour if words == "after" else "none"
            (dot,) = axes.plot([value], [row + shift], "o", color=colour, markerfacecolor=face, markersize=5.0)
            tip(dot, f"tip-{p.name}-{words}", [f"{p.name} {words}: {with_std(value, std, unit)}"])
        std = after.uncertainty(p.name)
        moved = f"{rounded(before[p.name], std, unit)} → {rounded(after[p.name], std, unit)}"
        axes.text(1.02, row, moved, transform=axes.get_yaxis_transform(), va="center", fontsize=7.5)
    named_rows(axes, [p.name for p in parameters], unit)


def geometry_table(diagnosis: Diagnosis) -> str:
    """Every machine parameter before and after, with 1σ, and by how many σ it moved."""
    before, after = diagnosis.before, diagnosis.after
    kinds = ("location_error", "error_motion")
    names = [p.name for p in after.parameters if p.kind in kinds and p.name in before.model.index]
    moved = {name: (before[name], after[name]) for name in names}
    return _table("Machine geometry without and with all findings", moved, after)


def moved_table(finding: Finding, after: Identification) -> str:
    """What this finding alone moved: the parameters without it and with it, everything else as found."""
    said = "Change of the geometry with this finding (all others unchanged)"
    return _table(said, finding.moved, after)


def _table(caption: str, moved: Mapping[str, tuple[float, float]], after: Identification) -> str:
    rows: list[list[str | Cell]] = []
    classes = []
    machine = after.model.machine
    for name, (old, new) in moved.items():
        p = after.parameters[after.model.index[name]]
        std = after.uncertainty(name)
        sigmas = abs(new - old) / std if std > 0.0 else 0.0
        rows.append([name, meaning(p, machine), Cell(rounded(old, std, p.unit), old), Cell(rounded(new, std, p.unit), new),
                     Cell(rounded(std, std, p.unit), std), Cell(rounded(new - old, std, p.unit), new - old), unit_words(p.unit),
                     Cell(f"{sigmas:.1f}", sigmas)])  # fmt: skip
        classes.append("moved" if sigmas > 2.0 else "")
    heads = ["parameter", "meaning", "before", "after", "1σ after", "moved by", "unit", "in σ"]
    return table(caption, heads, rows, classes)
