"""The machine's chain as a picture, the guilty link marked: inline SVG in the colours of the page."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from symfive.diagnose import Finding, in_the_drive, place_words
from symfive.machine import Machine

__all__ = ["chain_picture", "guilty"]

BOX, GAP, TALL = 78, 34, 44
DRIVE, BODY, INSTRUMENT = 112, 34, 190
"""Upper edges of the three rows: bodies and axes, drives below them, the instrument below those."""
LEFT, ENDS = 14, 26
STACK = 24
"""From one badge to the next where several findings accuse the same link."""
UPWARDS = ("axis", "structure", "loop")
"""Over these the badges grow upwards, elsewhere downwards."""


@dataclass(frozen=True)
class _Place:
    """Where a finding sits: `part` of `axis`, and words for it."""

    part: str
    axis: str | None
    words: str
    timed: bool


def guilty(finding: Finding, machine: Machine) -> _Place:
    """The link that a finding accuses, from the stage at which its effect enters and its axis."""
    stage, axis = finding.effect.stage, finding.axis if finding.axis in machine.axes else None
    if in_the_drive(finding.effect):
        part = "drive"
    elif stage in ("reading", "recording"):
        part, axis = "instrument", None
    else:
        part = ("axis" if stage == "axis" else "structure") if axis else "loop"
    timed = any(word in ("t", "time") for word in finding.coordinate.split(", "))
    return _Place(part, axis, place_words(finding, machine), timed)


def chain_picture(machine: Machine, findings: Sequence[tuple[int, Finding]], title: str) -> str:
    """Workpiece, axes, bed, axes, tool in a row, drives below, the instrument between the ends; `findings` numbered."""
    structure = machine.structure
    names = ["workpiece", *structure.workpiece, "bed", *structure.tool, "tool"]
    left = {name: LEFT + i * (BOX + GAP) for i, name in enumerate(names)}
    width = 2 * LEFT + len(names) * (BOX + GAP) - GAP
    places = [(number, guilty(finding, machine)) for number, finding in findings]
    axes = set(machine.axes)
    drawn = []
    for a, b in pairwise(names):
        drawn.append(_link(left[a] + BOX, left[b], _carried(structure.workpiece, a, b, places)))
    drawn.append(_loop(left, names, any(p.part == "loop" for _, p in places)))
    for name in names:
        drawn.append(_body(name, left[name], name in axes, machine, _marks(places, ("axis",), name)))
        if name in axes:
            drawn.append(_drive(name, left[name], _marks(places, ("drive",), name)))
    drawn.append(_instrument(left, names, [n for n, p in places if p.part == "instrument"]))
    spots = [_spot(place, left, names) for _, place in places]
    heights = [spots[:i].count(spot) for i, spot in enumerate(spots)]
    above = STACK * max((k for k, p in zip(heights, places, strict=True) if p[1].part in UPWARDS), default=0)
    height = INSTRUMENT + 44
    for (number, place), (x, y), k in zip(places, spots, heights, strict=True):
        drawn.append(_badge(number, place, x, y + STACK * k * (-1 if place.part in UPWARDS else 1)))
        height = max(height, int(y + STACK * k * (place.part not in UPWARDS)) + 16)
    return (
        f'<svg class="chain" role="img" aria-label="{html.escape(title)}" viewBox="0 {-above} {width} {height + above}" '
        f'style="max-width: {width}px"><title>{html.escape(title)}</title>{"".join(drawn)}</svg>'
    )


def _marks(places: Sequence[tuple[int, _Place]], parts: tuple[str, ...], axis: str) -> bool:
    return any(p.part in parts and (p.axis == axis or (p.axis is None and p.part == "drive")) for _, p in places)


def _carried(workpiece: tuple[str, ...], a: str, b: str, places: Sequence[tuple[int, _Place]]) -> bool:
    """Whether the link a–b is what a guilty axis carries: outward of it, away from the bed."""
    return any(p.part == "structure" and (b if p.axis in workpiece else a) == p.axis for _, p in places)


def _link(start: int, end: int, guilty: bool) -> str:
    mark = "guilty" if guilty else "link"
    y = BODY + TALL / 2
    return f'<line class="{mark}" x1="{start}" y1="{y}" x2="{end}" y2="{y}"/>'


def _body(name: str, x: int, axis: bool, machine: Machine, guilty: bool) -> str:
    words = name
    said = name
    if axis:
        words = f"{name}′" if name in machine.structure.workpiece else name
        kind = "rotary" if machine.axes[name].rotary else "linear"
        said = f"{kind} axis {name}, moves the {machine.structure.carries(name)}"
    mark = " guilty" if guilty else ""
    round_corner = 22 if axis and machine.axes[name].rotary else 5
    return (
        f'<g><title>{html.escape(said)}</title><rect class="body{mark}" x="{x}" y="{BODY}" width="{BOX}" '
        f'height="{TALL}" rx="{round_corner}"/><text x="{x + BOX / 2}" y="{BODY + TALL / 2 + 5}">{html.escape(words)}'
        "</text></g>"
    )


def _drive(name: str, x: int, guilty: bool) -> str:
    mark = " guilty" if guilty else ""
    middle = x + BOX / 2
    return (
        f"<g><title>drive of {html.escape(name)}: command to motor and encoder</title>"
        f'<line class="thin" x1="{middle}" y1="{BODY + TALL}" x2="{middle}" y2="{DRIVE}"/>'
        f'<rect class="drive{mark}" x="{x + 8}" y="{DRIVE}" width="{BOX - 16}" height="28" rx="3"/>'
        f'<text class="small" x="{middle}" y="{DRIVE + 18}">drive {html.escape(name)}</text></g>'
    )


def _loop(left: dict[str, int], names: Sequence[str], guilty: bool) -> str:
    """The whole structural loop behind the chain, marked where the accused is no single axis."""
    if not guilty:
        return ""
    start, end = left[names[0]] + BOX / 2, left[names[-1]] + BOX / 2
    return f'<line class="guilty" x1="{start}" y1="{BODY + TALL / 2}" x2="{end}" y2="{BODY + TALL / 2}"/>'


def _instrument(left: dict[str, int], names: Sequence[str], guilty: Sequence[int]) -> str:
    start, end = left[names[0]] + ENDS, left[names[-1]] + BOX - ENDS
    middle, mark = (start + end) / 2, " guilty" if guilty else ""
    y = INSTRUMENT + 14
    return (
        f"<g><title>the instrument reads between workpiece and tool</title>"
        f'<path class="thin dashed" d="M{start} {BODY + TALL} V{y} H{middle - 48} M{middle + 48} {y} H{end} '
        f'V{BODY + TALL}"/><rect class="drive{mark}" x="{middle - 48}" y="{INSTRUMENT}" width="96" height="28" rx="3"/>'
        f'<text class="small" x="{middle}" y="{INSTRUMENT + 18}">instrument</text></g>'
    )


def _spot(place: _Place, left: dict[str, int], names: Sequence[str]) -> tuple[float, float]:
    """Where the first badge of a place stands."""
    if place.part == "instrument":
        return (left[names[0]] + left[names[-1]] + BOX) / 2 + 62, INSTRUMENT + 2
    if place.part == "loop":
        return left[names[-1]] + BOX / 2, BODY - 2
    if place.axis is None:
        return LEFT + 24, DRIVE - 2
    start = left[place.axis]
    outward = start - GAP / 2 if names.index(place.axis) < names.index("bed") else start + BOX + GAP / 2
    return {
        "axis": (start + BOX / 2, BODY - 2),
        "drive": (start + BOX - 8, DRIVE - 2),
        "structure": (outward, BODY - 2),
    }[place.part]


def _badge(number: int, place: _Place, x: float, y: float) -> str:
    clock = (
        f'<g class="clock" transform="translate({x + 20:g} {y:g})"><circle r="8"/><path d="M0 -5 V0 L4 2"/></g>'
        if place.timed
        else ""
    )
    words = f"{place.words}{', changing with time' if place.timed else ''}"
    return (
        f'<g><title>{number}: {html.escape(words)}</title><circle class="badge" cx="{x:g}" cy="{y:g}" r="11"/>'
        f'<text class="badge" x="{x:g}" y="{y + 4:g}">{number}</text>{clock}</g>'
    )
