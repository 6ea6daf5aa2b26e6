"""The machine's chain as a picture, the affected link marked: inline SVG in the colours of the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from markupsafe import Markup

from symfive.diagnose import Finding, place_words
from symfive.machine import Machine
from symfive.report._page import fragment

BOX, GAP, TALL = 78, 34, 44
DRIVE, BODY, INSTRUMENT = 112, 34, 190
"""Upper edges of the three rows: bodies and axes, drives below them, the instrument below those."""
LEFT, ENDS = 14, 26
STACK = 24
"""From one badge to the next where several findings affect the same link."""
UPWARDS = ("axis", "structure", "loop")
"""Over these the badges grow upwards, elsewhere downwards."""


@dataclass(frozen=True)
class _Place:
    """Where a finding sits: `part` of `axis`, and words for it."""

    part: str
    axis: str | None
    words: str
    timed: bool


_Places = Sequence[tuple[int, _Place]]


def affected_link(finding: Finding, machine: Machine) -> _Place:
    """The link that a finding affects, from the stage at which its effect enters and its axis."""
    stage, axis = finding.effect.stage, finding.axis if finding.axis in machine.axes else None
    if finding.effect.in_the_drive:
        part = "drive"
    elif stage in ("drive", "reading", "recording"):  # of the stage `drive`, and in none: a clock
        part, axis = "instrument", None
    else:
        part = ("axis" if stage == "axis" else "structure") if axis else "loop"
    timed = "t" in finding.coordinate.split(", ")
    return _Place(part, axis, place_words(finding, machine), timed)


def chain_picture(machine: Machine, findings: Sequence[tuple[int, Finding]], title: str) -> Markup:
    """Workpiece, axes, bed, axes, tool in a row, drives below, the instrument between the ends; `findings` numbered."""
    structure = machine.structure
    names = ["workpiece", *structure.workpiece, "bed", *structure.tool, "tool"]
    left = {name: LEFT + i * (BOX + GAP) for i, name in enumerate(names)}
    places = [(number, affected_link(finding, machine)) for number, finding in findings]
    begin, end = left[names[0]] + ENDS, left[names[-1]] + BOX - ENDS
    badges, above, height = _badges(places, left, names)
    return fragment(
        "chain", title=title, above=above, width=2 * LEFT + len(names) * (BOX + GAP) - GAP, height=height,
        axis_line=BODY + TALL / 2, body_top=BODY, tall=TALL, box=BOX, drive_top=DRIVE, instrument_top=INSTRUMENT,
        links=_links(structure.workpiece, left, names, places),
        bodies=[_body(name, left[name], machine, places) for name in names],
        begin=begin, end=end, middle=(begin + end) / 2, instrument=any(p.part == "instrument" for _, p in places),
        badges=badges,
    )  # fmt: skip


def _links(
    workpiece: tuple[str, ...], left: dict[str, int], names: Sequence[str], places: _Places
) -> list[dict[str, object]]:
    """From body to body, and the whole loop where a finding belongs to no single axis. An affected axis marks the link that it
    carries: outward of it, away from the bed."""
    found: list[dict[str, object]] = []
    for a, b in pairwise(names):
        marked = any(p.part == "structure" and (b if p.axis in workpiece else a) == p.axis for _, p in places)
        found.append({"start": left[a] + BOX, "end": left[b], "affected": marked})
    if any(p.part == "loop" for _, p in places):
        found.append({"start": left[names[0]] + BOX / 2, "end": left[names[-1]] + BOX / 2, "affected": True})
    return found


def _body(name: str, x: int, machine: Machine, places: _Places) -> dict[str, object]:
    """A body, or an axis with its drive (None: it has none)."""
    if name not in machine.axes:
        return {"name": name, "x": x, "words": name, "said": name, "corner": 5, "affected": False, "drive": None}
    rotary = machine.axes[name].rotary
    kind = "rotary" if rotary else "linear"
    return {
        "name": name, "x": x, "words": f"{name}′" if name in machine.structure.workpiece else name,
        "said": f"{kind} axis {name}, moves the {machine.structure.carries(name)}", "corner": 22 if rotary else 5,
        "affected": any(p.part == "axis" and p.axis == name for _, p in places),
        "drive": any(p.part == "drive" and p.axis in (name, None) for _, p in places),
    }  # fmt: skip


def _badges(places: _Places, left: dict[str, int], names: Sequence[str]) -> tuple[list[dict[str, object]], int, int]:
    """The numbers of the findings, stacked where several affect one link; how far they go above and below."""
    spots = [_spot(place, left, names) for _, place in places]
    ranks = [spots[:i].count(spot) for i, spot in enumerate(spots)]
    above = STACK * max((k for k, (_, p) in zip(ranks, places, strict=True) if p.part in UPWARDS), default=0)
    height, found = INSTRUMENT + 44, list[dict[str, object]]()
    for (number, place), (x, y), k in zip(places, spots, ranks, strict=True):
        down = place.part not in UPWARDS
        words = f"{place.words}{', changing with time' if place.timed else ''}"
        found.append(
            {"number": number, "words": words, "x": x, "y": y + STACK * k * (1 if down else -1), "timed": place.timed}
        )
        height = max(height, int(y + STACK * k * down) + 16)
    return found, above, height


def _spot(place: _Place, left: dict[str, int], names: Sequence[str]) -> tuple[float, float]:
    """Position of the first badge of a place."""
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
