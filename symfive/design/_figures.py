"""Figures of a plan: the poses as the workpiece sees them, the expected uncertainties, what each pose is worth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from symfive.arrays import Array
from symfive.campaign import FIRST_LINE, Run
from symfive.design._assess import Assessment
from symfive.design._mounting import STILL
from symfive.drawing.render import rendered
from symfive.instruments import has_bar, mounted
from symfive.machine import Machine
from symfive.numbers import unit_words
from symfive.procedures import Nominal

MOST_BARS = 400

COLOURS = "viridis"
STICK_MM = 60.0
ROOM = {"left": 0.065, "right": 0.985, "bottom": 0.205, "top": 0.93, "wspace": 0.26}
"""Of the panels for their labels, the same for all machines: a layout that is sought takes longer than the picture."""
LOOK = {"svg.hashsalt": "symfive", "svg.fonttype": "none", "text.parse_math": False}


def svg(figure: Figure) -> str:
    """The figure as SVG text, the same bytes whenever it is drawn."""
    return rendered(figure, "svg", LOOK, figure.dpi).decode()


def pose_figure(machine: Machine, run: Run) -> Figure:
    """Top and side view in the workpiece frame: table, balls, tool directions and bars, coloured by order; and the path
    of the rotary axes that turn."""
    nominal = Nominal(machine)
    balls = nominal.ball(run.commands, run.tool_ball)
    workpiece, tool = nominal.workpiece_rotation(run.commands), nominal.tool_rotation(run.commands)
    axes_of_tool = np.einsum("nji,nj->ni", workpiece, tool[:, :, 2])
    turning = [name for name in machine.axis_names if machine.axes[name].rotary and np.ptp(run.commands[name]) > STILL]
    figure = Figure(figsize=(11.0, 4.1))
    panels = figure.subplots(1, 3 if turning else 2, gridspec_kw=ROOM)
    colours = matplotlib.colormaps[COLOURS](np.linspace(0.0, 0.92, run.rows))
    for panel, (i, j) in zip(panels[:2], ((0, 1), (0, 2)), strict=True):
        _table(panel, machine, j == 1)
        if j == 2:
            panel.plot([run.table_ball[0]] * 2, [0.0, run.table_ball[2]], color="0.6", linewidth=3.0, zorder=0)
        sticks = np.stack([balls, balls + STICK_MM * axes_of_tool], axis=1)[:, :, [i, j]]
        panel.add_collection(LineCollection(list(sticks), colors=colours, linewidths=0.8, linestyles=[(0, (3, 1.5))]))
        if has_bar(run):
            bars = np.stack([np.broadcast_to(run.table_ball, balls.shape), balls], axis=1)[:, :, [i, j]]
            panel.add_collection(LineCollection(list(bars), colors=colours, linewidths=1.8))
        panel.plot(run.table_ball[i], run.table_ball[j], "o", color="#c1121f", markersize=6)
        panel.set_aspect("equal")
        panel.margins(0.08)
        panel.set_xlabel("x in mm")
        panel.set_ylabel(f"{'xyz'[j]} in mm")
        panel.set_title(
            "from above, as the table sees it" if j == 1 else "from the front, as the table sees it", fontsize=9
        )
    if turning:
        _rotary_path(panels[2], run, turning, colours)
    _key(figure, run)
    return figure


def _key(figure: Figure, run: Run) -> None:
    """What the lines of the pose picture are."""
    bar, (stands, _) = has_bar(run), mounted(run)
    lines = [
        *([Line2D([], [], marker="o", linestyle="", color="#c1121f", label=stands)] if stands else []),
        Line2D([], [], color="0.3", linewidth=0.8, linestyle=(0, (3, 1.5)), label="tool, from its ball upward"),
        *([Line2D([], [], color="0.3", linewidth=1.8, label="bar")] if bar else []),
        Line2D([], [], color="0.6", linewidth=3.0, label="table, post"),
    ]
    figure.legend(handles=lines, loc="lower center", ncols=len(lines), fontsize=8, frameon=False)


def _table(panel: Any, machine: Machine, above: bool) -> None:
    radius, (x, y) = machine.workspace.table_radius or 100.0, machine.table_centre
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    if above:
        panel.plot(x + radius * np.cos(angle), y + radius * np.sin(angle), color="0.6", linewidth=1.0)
    else:
        panel.plot([x - radius, x + radius], [0.0, 0.0], color="0.6", linewidth=2.0)


def _rotary_path(panel: Any, run: Run, rotary: list[str], colours: Array) -> None:
    first, second = (rotary[0], rotary[1]) if len(rotary) > 1 else (rotary[0], rotary[0])
    x, y = run.commands[second], run.commands[first]
    if len(rotary) == 1:
        x = np.arange(1.0, run.rows + 1.0)
    panel.plot(x, y, color="0.8", linewidth=0.8)
    panel.scatter(x, y, c=colours, s=16)
    panel.set_xlabel(f"{second} in degree" if len(rotary) > 1 else "pose")
    panel.set_ylabel(f"{first} in degree")
    panel.set_title("order: dark first", fontsize=9)


def uncertainty_figure(expected: Assessment) -> Figure:
    """Prior and expected 1σ of the machine's parameters (logarithmic)."""
    parameters = [p for p in expected.parameters if p.kind != "setup"]
    sigma = expected.sigma
    figure = Figure(figsize=(7.0, 0.8 + 0.19 * len(parameters)), layout="constrained")
    panel = figure.subplots()
    y = np.arange(len(parameters))
    panel.barh(y, [p.sigma for p in parameters], color="0.88", label="prior")
    panel.barh(y, [sigma[p.name] for p in parameters], color="#1d6996", height=0.5, label="after the plan")
    panel.set_yticks(y, [f"{p.what} / {unit_words(p.unit)}" for p in parameters], fontsize=7)
    panel.set_xscale("log")
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.minorticks_off()
    panel.invert_yaxis()
    panel.set_xlabel("1σ")
    panel.legend(fontsize=7)
    return figure


def worth_figure(worth: Mapping[str, Array]) -> Figure:
    """What the loss of each row would cost, in per cent of the joint 1σ; rows by the lines of their run's file. Of many rows
    a bar stands for several and shows the most informative one."""
    figure = Figure(figsize=(7.0, 0.6 + 1.7 * len(worth)), layout="constrained")
    panels = figure.subplots(len(worth), 1, squeeze=False, sharey=True)[:, 0]
    for panel, (run, values) in zip(panels, worth.items(), strict=True):
        size = -(-len(values) // MOST_BARS)
        first = np.arange(0, len(values), size)
        highest = np.maximum.reduceat(np.asarray(values), first)
        panel.bar(first + FIRST_LINE + 0.5 * (size - 1), 100.0 * np.expm1(0.5 * highest), 0.8 * size, color="#1d6996")
        panel.set_title(f"run {run}", fontsize=9, loc="left")
        panel.set_ylabel("1σ lost, %")
        panel.margins(x=0.01)
    panels[-1].set_xlabel("line of the run's file")
    return figure
