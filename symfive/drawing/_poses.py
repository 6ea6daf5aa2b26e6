"""The poses of a campaign as its workpiece sees them, to be turned in space: inline SVG that is whole without its script."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign, Run
from symfive.drawing._page import SERIES, own_file
from symfive.instruments import has_bar, has_post, instruments_of
from symfive.procedures import Nominal

SCRIPT = own_file("poses.js")
"""Turns every such figure of a page by dragging and by the arrow keys."""
TURN, TILT = -60.0, 25.0
"""Where the eye stands at first: angle about Z from X, height over the table, degree."""
WIDE, TALL, REACH = 720, 480, 215.0
MOST_POINTS, MOST_LINES, MOST_NAMES = 1200, 24, 24
"""Points of all runs, lines of a recording in motion, names below the drawing."""
COLOURS = (f"var(--blue, {SERIES[0]})", f"var(--orange, {SERIES[1]})", *SERIES[2:])
STYLE = own_file("poses.css")


@dataclass(frozen=True)
class _Poses:
    """What is drawn of a run, mm in the workpiece frame: the tool's ball (N, 3), the way up along the tool (N, 3)."""

    run: Run
    ball: Array
    up: Array

    @property
    def nest(self) -> Array:
        """The ball or nest on the table, (1, 3); (0, 3) where the instrument has none."""
        return np.array([self.run.table_ball] if has_post(self.run) else np.empty((0, 3)))


def projected(points: Array, centre: Array, scale: float, turn: float = TURN, tilt: float = TILT) -> Array:
    """Points (N, 3) mm as they are drawn, (N, 2): to the right and down, from afar at the angles `turn` and `tilt`, degree."""
    a, e = math.radians(turn), math.radians(tilt)
    right = [-math.sin(a), math.cos(a), 0.0]
    down = [math.sin(e) * math.cos(a), math.sin(e) * math.sin(a), -math.cos(e)]
    return np.asarray(scale * (points - centre) @ np.array([right, down]).T)


def poses_figure(campaign: Campaign) -> str:
    """A `<figure>` with all runs that have a ball, coloured by run; "" where none has one.

    Table, frame, the balls on the table, the tool's ball at each pose by the exact nominal kinematics, the tool's direction,
    bars. Of long runs every so many a row is drawn, and the caption says so. Needs `SCRIPT` on the page to be turned.
    """
    runs = [run for run in campaign.runs if any(i.ball_drawn for i in instruments_of(run))]
    if not runs:
        return ""
    nominal = Nominal(campaign.machine)
    poses = [_poses(nominal, run, max(MOST_POINTS // len(runs), 2)) for run in runs]
    radius = campaign.machine.workspace.table_radius
    angle = np.linspace(0.0, 2.0 * np.pi, 61)
    rim = (radius or 0.0) * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    table = rim + np.array([*campaign.machine.table_centre, 0.0])
    solid = np.concatenate([table, *(p.ball for p in poses), *(p.nest for p in poses)])
    size = float(np.ptp(solid, axis=0).max()) or 100.0
    corners = np.concatenate([solid, *(p.ball + 0.15 * size * p.up for p in poses)])
    centre = np.round((corners.min(axis=0) + corners.max(axis=0)) / 2.0, 1)
    scale = float(f"{REACH / max(float(np.linalg.norm(corners - centre, axis=1).max()), 1e-3):.6g}")
    pen = _Pen(centre, scale)
    parts = [pen.path(table, len(table), "grey")] if radius else []
    parts += [pen.path(np.array([0.25 * size * np.eye(3)[i] * on for on in (0, 1)]), 2, "ink") for i in range(3)]
    parts += [pen.text(0.29 * size * np.eye(3)[i], "xyz"[i]) for i in range(3)]
    parts += [pen.run(p, 0.15 * size, COLOURS[i % len(COLOURS)]) for i, p in enumerate(poses)]
    view = " ".join(f"{v:g}" for v in (*centre, scale, TURN, TILT))
    label = html.escape(f"Poses of {campaign.machine.name} in the workpiece frame, {len(runs)} runs")
    return (
        f'<figure class="poses"><svg role="img" aria-label="{label}" width="{WIDE}" height="{TALL}" '
        f'viewBox="{-WIDE // 2} {-TALL // 2} {WIDE} {TALL}" data-view="{view}"><style>\n{STYLE}</style>{"".join(parts)}</svg>'
        f'<p class="names">{_names(poses)}</p><figcaption>{_caption(poses)}</figcaption></figure>'
    )


def _poses(nominal: Nominal, run: Run, most: int) -> _Poses:
    rows = np.unique(np.linspace(0, run.rows - 1, min(most, run.rows)).round().astype(int))
    commands = {name: values[rows] for name, values in run.commands.items()}
    workpiece, tool = nominal.workpiece_rotation(commands), nominal.tool_rotation(commands)
    return _Poses(run, nominal.ball(commands, run.tool_ball), np.einsum("nji,nj->ni", workpiece, tool[:, :, 2]))


@dataclass(frozen=True)
class _Pen:
    """Draws in the first view and leaves the points in space with each shape for the script."""

    centre: Array
    scale: float

    def path(self, points: Array, each: int, kind: str) -> str:
        """Strokes of `each` points (1: a dot), mm."""
        if not len(points):
            return ""
        points, end = points.round(1), "h0" if each == 1 else ""
        places = enumerate(projected(points, self.centre, self.scale))
        d = "".join(f"{'L' if i % each else 'M'}{_number(u)} {_number(v)}{end}" for i, (u, v) in places)
        return f'<path class="{kind}" data-each="{each}" data-p="{_numbers(points)}" d="{d}"/>'

    def text(self, point: Array, word: str) -> str:
        (u, v) = projected(point.round(1)[None], self.centre, self.scale)[0]
        place = f'data-each="0" data-p="{_numbers(point)}" x="{_number(u)}" y="{_number(v)}"'
        return f'<text text-anchor="middle" dominant-baseline="middle" {place}>{html.escape(word)}</text>'

    def run(self, poses: _Poses, stick: float, colour: str) -> str:
        """One run: the tool at each pose, bars, balls, and the post of the ball on the table."""
        ball, nest = poses.ball, poses.nest
        step = -(-len(ball) // MOST_LINES) if poses.run.dynamic else 1
        bars = has_bar(poses.run)
        shapes = [
            self.path(_pairs(ball[::step], (ball + stick * poses.up)[::step]), 2, "tools"),
            self.path(_pairs(np.broadcast_to(nest, ball.shape)[::step], ball[::step]), 2, "bars") if bars else "",
            self.path(_pairs(nest * [1.0, 1.0, 0.0], nest), 2, "grey"),
            self.path(nest, 1, "nest"),
            self.path(ball, 1, "dots"),
        ]
        return f'<g style="color: {colour}"><title>{html.escape(poses.run.id)}</title>{"".join(shapes)}</g>'


def _pairs(first: Array, second: Array) -> Array:
    return np.stack([first, second], axis=1).reshape(-1, 3)


def _number(value: float) -> str:
    return f"{value + 0.0:.1f}"


def _numbers(points: Array) -> str:
    return " ".join(f"{value + 0.0:.1f}".removesuffix(".0") for value in points.ravel())


def _names(poses: Sequence[_Poses]) -> str:
    buttons = "".join(
        f'<button type="button"><i style="color: {COLOURS[i % len(COLOURS)]}"></i>{html.escape(p.run.id)}</button>'
        for i, p in enumerate(poses[:MOST_NAMES])
    )
    rest = len(poses) - MOST_NAMES
    return buttons + (f"<span>and {rest} more</span>" if rest > 0 else "")


def _caption(poses: Sequence[_Poses]) -> str:
    drawn, rows = sum(len(p.ball) for p in poses), sum(p.run.rows for p in poses)
    said = "The poses in the workpiece frame. Large dots: balls on the table; small dots: ball or tip of the tool; thin lines: "
    said += "tool axis; lines between balls: bar."
    said += f" {drawn} of {rows} rows are drawn, with fewer lines." if drawn < rows else ""
    hint = "Drag or use the arrow keys to turn the view, Home to reset it. A name shows its run alone."
    return f'{said} <span class="hint">{hint}</span>'
