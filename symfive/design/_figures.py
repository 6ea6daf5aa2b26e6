"""Figures of a plan: the poses as the workpiece sees them, the expected uncertainties, what each pose is worth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import FIRST_LINE, Run
from symfive.design._mounting import STILL
from symfive.drawing import Panel, Scale, drawing, label, ordered_colours
from symfive.machine import Machine
from symfive.numbers import unit_words
from symfive.procedures import Nominal

if TYPE_CHECKING:
    from symfive.design._plan import Plan

__all__ = ["pose_figure", "uncertainty_figure", "worth_figure"]

Array = NDArray[np.float64]
MOST_BARS = 400
STICK_MM = 60.0
BALL, AFTER, STEEL, PRIOR = "#c1121f", "#1d6996", "#999999", "#e0e0e0"
WIDE, TALL, LEFT, TOP, APART = 990.0, 360.0, 60.0, 26.0, 70.0
"""Of the picture of poses, pixels: its size, where its first panel begins, and the way between two panels."""
DASH = "3 1.5"
MARGIN = 0.08


def pose_figure(machine: Machine, run: Run) -> str:
    """SVG: top and side view in the workpiece frame: table, balls, tool directions and bars, coloured by order; and the path
    of the rotary axes that turn."""
    nominal = Nominal(machine)
    balls = nominal.ball(run.commands, run.tool_ball)
    workpiece, tool = nominal.workpiece_rotation(run.commands), nominal.tool_rotation(run.commands)
    up = STICK_MM * np.einsum("nji,nj->ni", workpiece, tool[:, :, 2])
    turning = [name for name in machine.axis_names if machine.axes[name].rotary and np.ptp(run.commands[name]) > STILL]
    colours, panels = ordered_colours(run.rows), 3 if turning else 2
    width, height = (WIDE - LEFT - 15.0 - (panels - 1) * APART) / panels, TALL - TOP - 70.0
    sticks = np.stack([balls, balls + up], axis=1)
    table_ball = np.asarray(run.table_ball)
    bars = np.stack([np.broadcast_to(table_ball, balls.shape), balls], axis=1)
    parts = []
    for i, (j, view) in enumerate(((1, "above"), (2, "the front"))):
        seen, table = [0, j], _table(machine, j == 1)
        everything = np.concatenate([sticks[..., seen].reshape(-1, 2), table, table_ball[None, seen]])
        low, high = everything.min(axis=0), everything.max(axis=0)
        edge = MARGIN * (high - low)
        box = (LEFT + i * (width + APART), TOP, width, height)
        panel = Panel.alike(box, low - edge, high + edge)
        parts.append(panel.axes("x in mm", f"{'xyz'[j]} in mm", f"from {view}, as the table sees it"))
        parts.append(panel.lines(table[None], [STEEL], 1.0 if j == 1 else 2.0))
        if j == 2:
            parts.append(panel.lines((table_ball * [[1.0, 1.0, 0.0], [1.0, 1.0, 1.0]])[None, :, seen], [STEEL], 3.0))
        parts.append(panel.lines(sticks[..., seen], colours, 0.8, DASH))
        if "ball_bar" in run.instrument:
            parts.append(panel.lines(bars[..., seen], colours, 1.8))
        parts.append(panel.dots(table_ball[None, seen], [BALL], 4.0))
    if turning:
        parts.append(_rotary_path((LEFT + 2.0 * (width + APART), TOP, width, height), run, turning, colours))
    return drawing(WIDE, TALL, [*parts, _key("ball_bar" in run.instrument)])


def _key(bar: bool) -> str:
    """What the lines of the pose picture are."""
    kinds = [("tool, from its ball upward", "#4d4d4d", 0.8, DASH), ("table, post", STEEL, 3.0, "")]
    kinds += [("bar", "#4d4d4d", 1.8, "")] if bar else []
    x, y, parts = 0.5 * WIDE - 210.0, TALL - 12.0, []
    parts.append(f'<circle cx="{x:g}" cy="{y - 3.0:g}" r="4" fill="{BALL}"/>')
    parts.append(label("table ball" if bar else "nest", x + 10.0, y))
    for i, (name, colour, width, dash) in enumerate(kinds):
        there = x + 90.0 + (0.0, 170.0, 280.0)[i]
        line = f'stroke="{colour}" stroke-width="{width:g}" stroke-dasharray="{dash or "none"}"'
        parts.append(f'<path d="M{there:g} {y - 3.0:g}h24" {line}/>{label(name, there + 30.0, y)}')
    return "".join(parts)


def _table(machine: Machine, above: bool) -> Array:
    """The table's edge (n, 2) from above, or its top from the front, mm."""
    radius, (x, y) = machine.workspace.table_radius or 100.0, machine.table_centre
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    if above:
        return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1)
    return np.array([[x - radius, 0.0], [x + radius, 0.0]])


def _rotary_path(box: tuple[float, float, float, float], run: Run, rotary: list[str], colours: list[str]) -> str:
    """One rotary axis over another, or over the number of the pose."""
    left, top, width, height = box
    several = len(rotary) > 1
    x = run.commands[rotary[1]] if several else np.arange(1.0, run.rows + 1.0)
    path = np.stack([x, run.commands[rotary[0]]], axis=1)
    low, high = path.min(axis=0), path.max(axis=0)
    edge = MARGIN * np.maximum(high - low, 1.0)
    (a, b), (c, d) = low - edge, high + edge
    panel = Panel(Scale(a, c, left, left + width), Scale(b, d, top + height, top))
    axes = panel.axes(f"{rotary[1]} in degree" if several else "pose", f"{rotary[0]} in degree", "order: dark first")
    return axes + panel.lines(path[None], ["#cccccc"], 0.8) + panel.dots(path, colours, 2.5)


def uncertainty_figure(plan: Plan) -> str:
    """SVG: prior and expected 1σ of the machine's parameters (logarithmic)."""
    parameters = [p for p in plan.assessment.parameters if p.kind != "setup"]
    prior = np.array([p.sigma for p in parameters])
    after = np.array([plan.assessment.sigma[p.name] for p in parameters])
    low, high = (10.0 ** f(np.log10(v)) for f, v in ((np.floor, min(prior.min(), after.min())), (np.ceil, prior.max())))
    count, row = len(parameters), 14.0
    y = np.arange(count, dtype=float)
    panel = Panel(
        Scale(low, max(high, 10.0 * low), 130.0, 620.0, log=True), Scale(count, -1.0, 12.0 + row * (count + 1), 12.0)
    )
    parts = [
        panel.bars(np.stack([np.full(count, low), y - half], 1), np.stack([values, y + half], 1), colour)
        for values, half, colour in ((prior, 0.4, PRIOR), (after, 0.25, AFTER))
    ]
    names = [(float(i), f"{p.name} ({unit_words(p.unit)})") for i, p in enumerate(parameters)]
    parts.append(panel.axes("1σ", names=names))
    foot = panel.y.start + 30.0
    for x, name, colour in ((430.0, "prior", PRIOR), (500.0, "after the plan", AFTER)):
        parts.append(f'<path fill="{colour}" d="M{x:g} {foot - 8.0:g}h14v8h-14z"/>{label(name, x + 20.0, foot)}')
    return drawing(640.0, foot + 12.0, parts)


def worth_figure(plan: Plan) -> str:
    """SVG: what the loss of each row would cost, in per cent of the joint 1σ; rows by the lines of their run's file. Of many rows
    a bar stands for several and shows the one that tells most."""
    worth, tall, parts = plan.assessment.worth, 120.0, []
    top = 100.0 * np.expm1(0.5 * max(float(np.max(values)) for values in worth.values()))
    for i, (run, values) in enumerate(worth.items()):
        size = -(-len(values) // MOST_BARS)
        first = np.arange(0, len(values), size)
        lost = 100.0 * np.expm1(0.5 * np.maximum.reduceat(np.asarray(values), first))
        middle, half = first + FIRST_LINE + 0.5 * (size - 1), 0.4 * size
        ends = (middle[0] - size, middle[-1] + size)
        above = 22.0 + i * tall
        panel = Panel(Scale(*ends, 70.0, 630.0), Scale(0.0, max(1.05 * top, 1e-9), above + tall - 45.0, above))
        zero = np.zeros(len(first))
        parts.append(panel.bars(np.stack([middle - half, zero], 1), np.stack([middle + half, lost], 1), AFTER))
        last = i + 1 == len(worth)
        parts.append(panel.axes("line of the run's file" if last else "", "1σ lost, %", f"run {run}"))
    return drawing(640.0, 22.0 + len(worth) * tall, parts)
