"""Figures of a plan as SVG: the poses as the workpiece sees them, the expected uncertainties, what each pose is worth.

They are written as text: Matplotlib takes as long to load and to draw them as a small plan takes to search.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from symfive.arrays import Array
from symfive.campaign import FIRST_LINE, Run
from symfive.design._assess import Assessment
from symfive.design._mounting import STILL
from symfive.instruments import has_bar, mounted
from symfive.machine import Machine
from symfive.numbers import unit_words
from symfive.procedures import Nominal

MOST_BARS = 400
STICK_MM = 60.0
TICKS = 5
"""At most so many intervals of numbers along an axis."""
VIRIDIS = np.array([(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (200, 225, 32)])
RED, BLUE, GREY, PALE, DARK = "#c1121f", "#1d6996", "#999", "#e0e0e0", "#4d4d4d"
TOOL = 'stroke-width="1.1" stroke-dasharray="3.3 1.7"'
Ticks = Iterable[tuple[float, str]]


@dataclass(frozen=True)
class _Panel:
    """A rectangle of a figure (px), and the ranges of x and y that it shows, y upwards."""

    left: float
    top: float
    wide: float
    tall: float
    low: Array
    high: Array

    def around(self, points: Array, equal: bool = False) -> _Panel:
        """The same with ranges that hold all points (n, 2); `equal`: both to one scale."""
        low, high = points.min(axis=0), points.max(axis=0)
        size = np.where(high > low, high - low, 1.0) * 1.16
        if equal:
            size = np.array([self.wide, self.tall]) * float(np.max(size / [self.wide, self.tall]))
        return replace(self, low=0.5 * (low + high - size), high=0.5 * (low + high + size))

    def at(self, points: Array) -> Array:
        """Where points (…, 2) are drawn."""
        share = (points - self.low) / (self.high - self.low)
        return np.asarray([self.left, self.top + self.tall] + share * [self.wide, -self.tall])

    def line(self, points: Array, colour: str, look: str = 'stroke-width="1"') -> str:
        """A line through points (n, 2)."""
        path = "L".join(f"{x:.1f} {y:.1f}" for x, y in self.at(points))
        return f'<path d="M{path}" fill="none" stroke="{colour}" {look}/>'

    def dot(self, point: Array, colour: str, radius: float) -> str:
        """A dot."""
        x, y = self.at(point)
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius}" fill="{colour}"/>'

    def bar(self, one: Array, other: Array, colour: str) -> str:
        """A rectangle between two corners."""
        (x, y), (u, v) = np.sort([self.at(one), self.at(other)], axis=0)
        return f'<rect x="{x:.1f}" y="{y:.1f}" width="{u - x:.1f}" height="{v - y:.1f}" fill="{colour}"/>'

    def frame(self, x: str, y: str, title: str = "", across: Ticks | None = None, up: Ticks | None = None) -> str:
        """The axes with numbers or the ticks given, what they are, and a title."""
        left, top, wide, tall = self.left, self.top, self.wide, self.tall
        path, words = (
            f"M{left:.1f} {top:.1f}v{tall:.1f}h{wide:.1f}v-{tall:.1f}z",
            [_text(left, top - 8.0, title, "start")],
        )
        for value, tick in self._numbers(0) if across is None else across:
            place, _ = self.at(np.array([value, self.low[1]]))
            path += f"M{place:.1f} {top + tall:.1f}v4"
            words.append(_text(place, top + tall + 17.0, tick))
        for value, tick in self._numbers(1) if up is None else up:
            _, place = self.at(np.array([self.low[0], value]))
            path += f"M{left:.1f} {place:.1f}h-4"
            words.append(_text(left - 7.0, place + 4.0, tick, "end"))
        words.append(_text(left + 0.5 * wide, top + tall + 34.0, x))
        words.append(f'<g transform="translate({left - 46.0} {top + 0.5 * tall}) rotate(-90)">{_text(0.0, 0.0, y)}</g>')
        return "".join([f'<path d="{path}" fill="none" stroke="#333" stroke-width=".8"/>', *words])

    def _numbers(self, axis: int) -> list[tuple[float, str]]:
        """Round numbers along an axis."""
        low, high = float(self.low[axis]), float(self.high[axis])
        power = 10.0 ** math.floor(math.log10((high - low) / TICKS))
        step = next(s * power for s in (1.0, 2.0, 5.0, 10.0) if (high - low) / (s * power) <= TICKS)
        return [(i * step, f"{i * step:g}") for i in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _text(x: float, y: float, words: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{html.escape(words)}</text>' if words else ""


def _figure(wide: float, tall: float, parts: Iterable[str]) -> str:
    size = f'width="{wide:.0f}" height="{tall:.0f}" viewBox="0 0 {wide:.0f} {tall:.0f}"'
    look = 'font-family="DejaVu Sans, Arial, sans-serif" font-size="12" style="background: #fff"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} {look}>\n' + "\n".join(parts) + "\n</svg>\n"


def pose_figure(machine: Machine, run: Run) -> str:
    """Top and side view in the workpiece frame: table, balls, tool directions and bars, coloured by order; and the path
    of the rotary axes that turn."""
    nominal = Nominal(machine)
    balls = nominal.ball(run.commands, run.tool_ball)
    workpiece, tool = nominal.workpiece_rotation(run.commands), nominal.tool_rotation(run.commands)
    ends, stands = balls + STICK_MM * np.einsum("nji,nj->ni", workpiece, tool[:, :, 2]), np.array(run.table_ball)
    turning = [name for name in machine.axis_names if machine.axes[name].rotary and np.ptp(run.commands[name]) > STILL]
    share = np.linspace(0.0, len(VIRIDIS) - 1.0, run.rows)
    mixed = np.stack([np.interp(share, np.arange(len(VIRIDIS)), channel) for channel in VIRIDIS.T], axis=1)
    colours = [f"#{colour.tobytes().hex()}" for colour in mixed.round().astype(np.uint8)]
    radius, angle = machine.workspace.table_radius or 100.0, np.linspace(0.0, 2.0 * np.pi, 121)
    rim = radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1) + [*machine.table_centre, 0.0]
    parts, pitch = list[str](), 986.0 / (3 if turning else 2)
    place = _Panel(70.0, 26.0, pitch - 78.0, 286.0, np.zeros(2), np.ones(2))
    for (i, j), side in (((0, 1), "above"), ((0, 2), "the front")):
        panel = place.around(np.concatenate([rim, balls, ends, [stands]])[:, [i, j]], equal=True)
        parts.append(panel.frame("x in mm", f"{'xyz'[j]} in mm", f"from {side}, as the table sees it"))
        parts.append(panel.line(rim[:, [i, j]], GREY))
        if j == 2:
            parts.append(panel.line(np.array([[stands[0], 0.0], stands[[0, 2]]]), GREY, 'stroke-width="4"'))
        for ball, end, colour in zip(balls, ends, colours, strict=True):
            parts.append(panel.line(np.array([ball, end])[:, [i, j]], colour, TOOL))
            if has_bar(run):
                parts.append(panel.line(np.array([stands, ball])[:, [i, j]], colour, 'stroke-width="2.4"'))
        parts.append(panel.dot(stands[[i, j]], RED, 4.5))
        place = replace(place, left=place.left + pitch)
    if turning:
        x, words = np.arange(1.0, run.rows + 1.0), "pose"
        if len(turning) > 1:
            x, words = run.commands[turning[1]], f"{turning[1]} in degree"
        path = np.stack([x, run.commands[turning[0]]], axis=1)
        panel = place.around(path)
        parts += [panel.frame(words, f"{turning[0]} in degree", "order: dark first"), panel.line(path, "#ccc")]
        parts += [panel.dot(point, colour, 2.7) for point, colour in zip(path, colours, strict=True)]
    return _figure(1056.0, 394.0, [*parts, *_key(run)])


def _key(run: Run) -> list[str]:
    """What the lines of the pose picture are."""
    stands, _ = mounted(run)
    kinds = [
        *([(stands, f'fill="{RED}" stroke="{RED}" stroke-width="9" stroke-linecap="round"', 0)] if stands else []),
        ("tool, from its ball upward", f'stroke="{DARK}" {TOOL}', 24),
        *([("bar", f'stroke="{DARK}" stroke-width="2.4"', 24)] if has_bar(run) else []),
        ("table, post", f'stroke="{GREY}" stroke-width="4"', 24),
    ]
    parts = list[str]()
    for i, (words, look, wide) in enumerate(kinds):
        x = 540.0 + 210.0 * (i - 0.5 * len(kinds))
        parts += [f'<path d="M{x - 0.5 * wide:.0f} 376h{wide}" {look}/>', _text(x + 20.0, 380.0, words, "start")]
    return parts


def uncertainty_figure(expected: Assessment) -> str:
    """Prior and expected 1σ of the machine's parameters (logarithmic)."""
    parameters = [p for p in expected.parameters if p.kind != "setup"]
    sizes = np.log10([(p.sigma, expected.sigma[p.name]) for p in parameters])
    before, after = sizes.T
    low, high = sizes.min() - 0.1 * np.ptp(sizes) - 0.1, sizes.max() + 0.05
    tall = 18.0 * len(parameters)
    panel = _Panel(250.0, 30.0, 410.0, tall, np.array([low, len(parameters) - 0.4]), np.array([high, -0.6]))
    decades = [(float(i), f"{10.0**i:g}") for i in range(math.ceil(low), math.floor(high) + 1)]
    names = [(float(i), f"{p.what} / {unit_words(p.unit)}") for i, p in enumerate(parameters)]
    parts = list[str]()
    for ends, half, colour, words, x in (
        (before, 0.4, PALE, "prior", 250.0),
        (after, 0.25, BLUE, "after the plan", 330.0),
    ):
        parts += [panel.bar(np.array([low, i - half]), np.array([end, i + half]), colour) for i, end in enumerate(ends)]
        parts += [f'<path d="M{x} 14h18" stroke="{colour}" stroke-width="10"/>', _text(x + 24.0, 18.0, words, "start")]
    return _figure(672.0, tall + 76.0, [*parts, panel.frame("1σ", "", across=decades, up=names)])


def worth_figure(worth: Mapping[str, Array]) -> str:
    """What the loss of each row would cost, in per cent of the joint 1σ; rows by the lines of their run's file. Of many rows
    a bar stands for several and shows the most informative one."""
    parts, highest = list[str](), 105.0 * math.expm1(0.5 * max(float(np.max(values)) for values in worth.values()))
    for i, (run, values) in enumerate(worth.items()):
        size = -(-len(values) // MOST_BARS)
        first = np.arange(0, len(values), size)
        cost = 100.0 * np.expm1(0.5 * np.maximum.reduceat(np.asarray(values), first))
        low, high = np.array([FIRST_LINE - 1.0, 0.0]), np.array([FIRST_LINE + len(values), highest or 1.0])
        panel = _Panel(70.0, 28.0 + 163.0 * i, 590.0, 110.0, low, high)
        bars = zip(first + FIRST_LINE + 0.1 * size - 0.5, cost, strict=True)
        parts += [panel.bar(np.array([x, 0.0]), np.array([x + 0.8 * size, y]), BLUE) for x, y in bars]
        parts.append(panel.frame("line of the run's file" if i == len(worth) - 1 else "", "1σ lost, %", f"run {run}"))
    return _figure(672.0, 163.0 * len(worth) + 24.0, parts)
