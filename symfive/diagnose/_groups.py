"""Partitions of a campaign's runs by feed, direction, place, height, time or instrument."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from symfive.campaign import Campaign, Run
from symfive.numbers import plain_number, unit_words

SAME_FEED = 1.25
"""Runs in order of their speed are of one feed as long as each is within this factor of the one before."""


def partitions(campaign: Campaign) -> dict[str, dict[str, tuple[str, ...]]]:
    """What the runs differ in → label of each group → its runs; only where there are two groups or more.

    Ways that part the runs alike are one way with all their names, as `place, time`.
    """
    found: dict[frozenset[tuple[str, ...]], tuple[list[str], dict[str, tuple[str, ...]]]] = {}
    for name, label in _LABELS.items():
        groups: dict[str, list[str]] = {}
        labels = _feeds(campaign) if label is None else {run.id: label(run, campaign) for run in campaign.runs}
        for run in campaign.runs:
            groups.setdefault(labels[run.id], []).append(run.id)
        if len(groups) > 1 and "" not in groups:
            parted = {key: tuple(ids) for key, ids in groups.items()}
            found.setdefault(frozenset(parted.values()), ([], parted))[0].append(name)
    return {", ".join(names): groups for names, groups in found.values()}


def kind_of(run: Run, campaign: Campaign) -> str:
    """Key of comparable runs: instruments, moving axes, direction of a circle."""
    moves = ",".join(name for name, way in run.commands.items() if np.ptp(way) > 0.0)
    return f"{_instrument(run, campaign)} {moves} {_direction(run, campaign)}"


def _feeds(campaign: Campaign) -> dict[str, str]:
    """Runs of about one feed share the label of the slowest of them; "" where nothing moves."""
    speeds = {run.id: _speed(run, campaign) for run in campaign.runs}
    labels: dict[str, str] = {}
    last, label = 0.0, ""
    for id, (speed, unit) in sorted(speeds.items(), key=lambda item: item[1]):
        if speed > SAME_FEED * last:
            label = f"about {plain_number(float(f'{speed:.3g}'))} {unit_words(unit)}/min"
        last = speed
        labels[id] = label
    return labels


def _speed(run: Run, campaign: Campaign) -> tuple[float, str]:
    """Median speed along the path of a recording, in mm/min (degree/min where only rotary axes move)."""
    if not run.dynamic or run.rows < 3:
        return 0.0, "mm"
    for rotary, unit in ((False, "mm"), (True, "deg")):
        axes = [np.diff(run.commands[n]) for n, a in campaign.machine.axes.items() if a.rotary == rotary]
        speed = 60.0 * float(np.median(np.sqrt(sum(d**2 for d in axes)) / np.diff(run.time))) if axes else 0.0
        if speed > 0.0:
            return speed, unit
    return 0.0, "mm"


def _direction(run: Run, campaign: Campaign) -> str:
    """Sense of a circle: of the rotary axis that turns most, else of the plane in which the linear axes go round."""
    machine = campaign.machine
    travel = {n: float(run.commands[n][-1] - run.commands[n][0]) for n, a in machine.axes.items() if a.rotary}
    most = max(travel, key=lambda n: abs(travel[n]), default=None)
    if most is not None and abs(travel[most]) > 90.0:
        return f"{most}{'+' if travel[most] > 0 else '-'}"
    linear = sorted((n for n, a in machine.axes.items() if not a.rotary), key=lambda n: -np.ptp(run.commands[n]))[:2]
    if len(linear) < 2 or np.ptp(run.commands[linear[1]]) == 0.0:
        return ""
    a, b = (run.commands[n] - run.commands[n].mean() for n in sorted(linear))
    area = float(np.sum(a[:-1] * b[1:] - a[1:] * b[:-1]))
    return f"{''.join(sorted(linear))} {'counter-clockwise' if area > 0 else 'clockwise'}"


def _half(run: Run, campaign: Campaign) -> str:
    if not all(r.has_clock for r in campaign.runs):
        return ""
    starts = sorted(r.start_s for r in campaign.runs)
    middle = 0.5 * (starts[(len(starts) - 1) // 2] + starts[len(starts) // 2])
    return "first half" if run.start_s <= middle else "second half"


def _instrument(run: Run, campaign: Campaign) -> str:
    return "+".join(run.instrument)


_LABELS: Mapping[str, Callable[[Run, Campaign], str] | None] = {
    "feed": None,
    "direction": _direction,
    "place": lambda run, _: f"ball at {', '.join(f'{c:.0f}' for c in run.table_ball)} mm",
    "height": lambda run, _: f"ball at z = {run.table_ball[2]:.0f} mm",
    "time": _half,
    "instrument": _instrument,
}


def way(campaign: Campaign, name: str) -> Mapping[str, tuple[str, ...]]:
    """The groups of one way to part the runs, as `feed`; empty where the runs do not differ in it."""
    return next((groups for names, groups in partitions(campaign).items() if name in names.split(", ")), {})
