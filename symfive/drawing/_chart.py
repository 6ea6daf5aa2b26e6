"""Charts as SVG text: axes with ticks, and lines, dots and bars in them.

For the figures of a plan, which is made in seconds: Matplotlib took a sixth of them to be imported and to measure and draw ticks.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.drawing._colours import FAINT, INK, PAPER

__all__ = ["Panel", "Scale", "drawing", "label", "ordered_colours"]

Array = NDArray[np.float64]
VIRIDIS = np.array([
    (68, 1, 84), (71, 44, 122), (59, 81, 139), (44, 113, 142), (33, 144, 141), (39, 173, 129), (92, 200, 99), (170, 220, 50),
])  # fmt: skip
"""From dark to light, even to the eye (S. van der Walt & N. Smith 2015), at sevenths of 0.875 of its range."""
STEPS = (1.0, 2.0, 5.0, 10.0)
TICK, GAP = 4.0, 3.0


@dataclass(frozen=True)
class Scale:
    """One coordinate: `low` is drawn at the pixel `start` and `high` at `end`, by their logarithms where it is `log`."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def __call__(self, values: Array | float) -> Array:
        """Pixels (n,) of values."""
        low, high, at = (np.log10(v) if self.log else np.asarray(v) for v in (self.low, self.high, values))
        return np.asarray(self.start + (at - low) / (high - low) * (self.end - self.start), dtype=np.float64)

    def ticks(self, most: int = 7) -> list[float]:
        """Round values inside, at most so many: 1, 2 or 5 times a power of ten apart; powers of ten of a logarithmic one."""
        if self.log:
            decades = range(math.ceil(math.log10(self.low) - 1e-9), math.floor(math.log10(self.high) + 1e-9) + 1)
            return [10.0**n for n in decades[:: max(1, -(-len(decades) // most))]]
        least = (self.high - self.low) / most
        power = 10.0 ** math.floor(math.log10(least))
        step = power * next(s for s in STEPS if s * power >= least * (1.0 - 1e-9))
        numbers = range(math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9) + 1)
        return [round(n * step, 12) for n in numbers]


@dataclass(frozen=True)
class Panel:
    """Axes: `x` from left to right, `y` from below upwards (its `start` is the larger pixel)."""

    x: Scale
    y: Scale

    @classmethod
    def alike(cls, box: tuple[float, float, float, float], low: Array, high: Array) -> Panel:
        """Axes of one scale in a box (left, top, width, height) around what lies between two points (2,)."""
        left, top, width, height = box
        middle, unit = 0.5 * (low + high), max((high[0] - low[0]) / width, (high[1] - low[1]) / height)
        a, b = middle - 0.5 * unit * np.array([width, height]), middle + 0.5 * unit * np.array([width, height])
        return cls(Scale(a[0], b[0], left, left + width), Scale(a[1], b[1], top + height, top))

    def lines(self, lines: Array, colours: Sequence[str], width: float, dash: str = "") -> str:
        """Lines (n, m, 2) through m points each, in one colour each."""
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        drawn = (
            f'<path stroke="{colour}" d="M{"L".join(_place(u, v) for u, v in line)}"/>'
            for line, colour in zip(self._pixels(lines).tolist(), colours, strict=True)
        )
        return f'<g fill="none" stroke-width="{width:g}"{dashed}>{"".join(drawn)}</g>'

    def dots(self, points: Array, colours: Sequence[str], radius: float) -> str:
        """Dots at points (n, 2)."""
        return "".join(
            f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{radius:g}" fill="{colour}"/>'
            for (u, v), colour in zip(self._pixels(points).tolist(), colours, strict=True)
        )

    def bars(self, low: Array, high: Array, colour: str) -> str:
        """Bars between corners (n, 2) and (n, 2)."""
        corners = np.stack([self._pixels(low), self._pixels(high)])
        places, sizes = corners.min(axis=0), np.ptp(corners, axis=0)
        drawn = (
            f"M{_place(u, v)}h{w:.1f}v{h:.1f}h{-w:.1f}z"
            for (u, v), (w, h) in zip(places.tolist(), sizes.tolist(), strict=True)
        )
        return f'<path fill="{colour}" d="{"".join(drawn)}"/>'

    def _pixels(self, points: Array) -> Array:
        return np.stack([self.x(points[..., 0]), self.y(points[..., 1])], axis=-1)

    def axes(
        self, x_label: str = "", y_label: str = "", title: str = "", names: Sequence[tuple[float, str]] | None = None
    ) -> str:
        """The frame with ticks, labels and a title; `names` (value, text) in place of numbers at y."""
        left, right, bottom, top = self.x.start, self.x.end, self.y.start, self.y.end
        across = [(self.x(value).item(), _number(value)) for value in self.x.ticks()]
        up = names if names is not None else [(value, _number(value)) for value in self.y.ticks(5)]
        along = [(self.y(value).item(), name) for value, name in up]
        marks = "".join(f"M{_place(u, bottom)}v{TICK:g}" for u, _ in across)
        marks += "".join(f"M{_place(left, v)}h{-TICK:g}" for _, (v, _) in zip(up, along, strict=True))
        frame = f"M{_place(left, top)}H{right:.1f}V{bottom:.1f}H{left:.1f}z{marks}"
        beside = left - TICK - GAP
        widest = max((len(name) for _, name in along), default=0)
        said = [label(name, u, bottom + TICK + 10.0, "middle") for u, name in across]
        said += [label(name, beside, v + 3.0, "end") for v, name in along]
        said.append(label(x_label, 0.5 * (left + right), bottom + TICK + 24.0, "middle"))
        said.append(label(y_label, beside - 5.5 * widest - 9.0, 0.5 * (top + bottom), "middle", upright=True))
        said.append(label(title, left, top - 6.0))
        return f'<path fill="none" stroke="{FAINT}" stroke-width="0.8" d="{frame}"/>{"".join(said)}'


def label(text: str, x: float, y: float, anchor: str = "start", *, upright: bool = False) -> str:
    """A text that starts, ends or has its middle at a place; `upright` reads upwards."""
    if not text:
        return ""
    turned = f' transform="rotate(-90 {_place(x, y)})"' if upright else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{turned}>{html.escape(text)}</text>'


def ordered_colours(count: int) -> list[str]:
    """Colours of so many things from the first, dark, to the last, light."""
    at, known = np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, len(VIRIDIS))
    parts = np.stack([np.interp(at, known, channel) for channel in VIRIDIS.T], axis=1).round().astype(int)
    return [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in parts.tolist()]


def drawing(width: float, height: float, parts: Iterable[str]) -> str:
    """A whole SVG file of so many pixels."""
    size = f'width="{width:g}" height="{height:g}" viewBox="0 0 {width:g} {height:g}"'
    look = f'font-family="system-ui, sans-serif" font-size="10" fill="{INK}"'
    ground = f'<rect width="{width:g}" height="{height:g}" fill="{PAPER}"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} {look}>{ground}{"".join(parts)}</svg>\n'


def _place(x: float, y: float) -> str:
    return f"{x:.1f} {y:.1f}"


def _number(value: float) -> str:
    return f"{value + 0.0:g}".replace("-", "−")
