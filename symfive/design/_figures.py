"""Figures of a plan: the poses as the workpiece sees them, the expected uncertainties, what each pose is worth."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from symfive.campaign import Run
from symfive.machine import Machine
from symfive.procedures import Nominal

if TYPE_CHECKING:
    from symfive.design._plan import Plan

__all__ = ["pose_figure", "svg", "uncertainty_figure", "worth_figure"]

Array = NDArray[np.float64]
COLOURS = "viridis"
STICK_MM = 60.0


def svg(figure: Figure) -> str:
    """The figure as SVG text, the same bytes whenever it is drawn."""
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "symfive", "svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None}, bbox_inches="tight")
    return buffer.getvalue()


def pose_figure(machine: Machine, run: Run) -> Figure:
    """Top and side view in the workpiece frame: table, balls, tool directions and bars, coloured by order; and the path
    of the rotary axes."""
    nominal = Nominal(machine)
    balls = nominal.ball(run.commands, run.tool_ball)
    workpiece, tool = nominal.workpiece_rotation(run.commands), nominal.tool_rotation(run.commands)
    axes_of_tool = np.einsum("nji,nj->ni", workpiece, tool[:, :, 2])
    rotary = [name for name in machine.axis_names if machine.axes[name].rotary]
    figure = Figure(figsize=(11.0, 3.9))
    panels = figure.subplots(1, 3 if rotary else 2)
    colours = matplotlib.colormaps[COLOURS](np.linspace(0.0, 0.92, run.rows))
    for panel, (i, j) in zip(panels[:2], ((0, 1), (0, 2)), strict=True):
        _table(panel, machine.workspace.table_radius or 100.0, j == 1)
        for ball, axis, colour in zip(balls, axes_of_tool, colours, strict=True):
            end = ball + STICK_MM * axis
            panel.plot([ball[i], end[i]], [ball[j], end[j]], color=colour, linewidth=0.8)
            if "ball_bar" in run.instrument:
                panel.plot(
                    [run.table_ball[i], ball[i]], [run.table_ball[j], ball[j]], color=colour, linewidth=1.6, alpha=0.7
                )
        panel.plot(run.table_ball[i], run.table_ball[j], "o", color="#c1121f", markersize=6)
        panel.set_aspect("equal")
        panel.set_xlabel("x in mm")
        panel.set_ylabel(f"{'xyz'[j]} in mm")
        panel.set_title("from above" if j == 1 else "from the front", fontsize=9)
    if rotary:
        _rotary_path(panels[2], machine, run, rotary, colours)
    figure.tight_layout()
    return figure


def _table(panel: Any, radius: float, above: bool) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    if above:
        panel.plot(radius * np.cos(angle), radius * np.sin(angle), color="0.6", linewidth=1.0)
    else:
        panel.plot([-radius, radius], [0.0, 0.0], color="0.6", linewidth=2.0)


def _rotary_path(panel: Any, machine: Machine, run: Run, rotary: list[str], colours: Array) -> None:
    first, second = (rotary[0], rotary[1]) if len(rotary) > 1 else (rotary[0], rotary[0])
    x, y = run.commands[second], run.commands[first]
    if len(rotary) == 1:
        x = np.arange(1.0, run.rows + 1.0)
    panel.plot(x, y, color="0.8", linewidth=0.8)
    panel.scatter(x, y, c=colours, s=16)
    panel.set_xlabel(f"{second} in degree" if len(rotary) > 1 else "pose")
    panel.set_ylabel(f"{first} in degree")
    panel.set_title("order: dark first", fontsize=9)


def uncertainty_figure(plan: Plan) -> Figure:
    """Prior and expected 1σ of the machine's parameters (logarithmic)."""
    parameters = [p for p in plan.assessment.parameters if p.kind != "setup"]
    sigma = plan.assessment.sigma
    figure = Figure(figsize=(7.0, 0.8 + 0.19 * len(parameters)))
    panel = figure.subplots()
    y = np.arange(len(parameters))
    panel.barh(y, [p.sigma for p in parameters], color="0.88", label="prior")
    panel.barh(y, [sigma[p.name] for p in parameters], color="#1d6996", height=0.5, label="after the plan")
    panel.set_yticks(y, [f"{p.name} ({p.unit})" for p in parameters], fontsize=7)
    panel.set_xscale("log")
    panel.invert_yaxis()
    panel.set_xlabel("1σ")
    panel.legend(fontsize=7)
    figure.tight_layout()
    return figure


def worth_figure(plan: Plan) -> Figure:
    """What the loss of each row would cost, in per cent of the joint 1σ."""
    figure = Figure(figsize=(7.0, 2.4))
    panel = figure.subplots()
    start = 1
    for run, worth in plan.assessment.worth.items():
        panel.bar(np.arange(start, start + len(worth)), 100.0 * np.expm1(0.5 * worth), label=run)
        start += len(worth)
    panel.set_xlabel("row of the plan")
    panel.set_ylabel("1σ lost without it, %")
    panel.legend(fontsize=7)
    figure.tight_layout()
    return figure
