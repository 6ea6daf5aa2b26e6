"""How long a program takes, against what the file and the plan state."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ._events import Event, Finding
from ._order import rests_of
from ._path import Path
from ._plan import Run

HALT_S = 0.1
"""What a control needs at most after a move that may stop on contact, until it has looked and begins the next one."""
ORIENT_S = 5.0
"""Half a turn of the spindle until it is held."""


def seconds(path: Path) -> float:
    """Time of the program without the operator's: blocks at their feeds, rapids at the axes' limits, dwells."""
    return float(sum(duration(path, e) for e in path.events))


def duration(path: Path, event: Event) -> float:
    """Of one event, s; a move from an unknown position counts nothing."""
    if event.kind == "orient":
        return ORIENT_S
    if event.kind == "dwell" or (event.kind == "feed" and np.isfinite(event.seconds)):
        return event.seconds
    if event.kind != "rapid" or not np.isfinite(event.end - event.start).all():
        return 0.0
    return fastest(path, np.abs(event.end - event.start))


def fastest(path: Path, way: np.ndarray) -> float:
    """Shortest time of a move from rest to rest over `way` (n,) at the axes' greatest feeds and accelerations, s."""
    speed, gain = path.machine.limit("max_feed") / 60.0, path.machine.limit("max_acceleration")
    triangle = way * gain < speed**2
    with np.errstate(invalid="ignore"):
        times = np.where(
            triangle, 2.0 * np.sqrt(way / gain), way / speed + np.where(np.isfinite(gain), speed / gain, 0.0)
        )
    return float(np.nan_to_num(times).max())


def time_table(path: Path) -> Iterator[Finding]:
    """In a static run the program needs between its first and last reading the time that the file's t_s says, within 5 % and
    a minute for each stop. That no block is asked to be faster than the axes can is what `feeds` says."""
    if not path.run.static or len(path.run.t) < 2:
        return
    rests = [i for i, _ in rests_of(path)]
    if path.run.probe:
        rests = [i for i, e in enumerate(path.events) if e.kind == "log" and e.text.endswith(",0")]
    if not rests:
        return
    between = path.events[rests[0] : rests[-1]]
    taken = sum(duration(path, e) for e in between)
    ramps = sum(up_to_speed(path, path.events[first:second]) for first, second in pairwise(rests))
    pauses = 60.0 * sum(e.kind == "stop" for e in between) + HALT_S * sum(bool(e.probing) for e in between)
    stated = float(path.run.t[-1] - path.run.t[0])
    if not 0.95 * taken - 1.0 <= stated <= 1.05 * (taken + ramps + pauses) + 1.0:
        says = f"{path.run.file.name} says {stated:.1f} s from first to last reading, the program takes {taken:.1f} s"
        yield path.fault("time", path.events[rests[-1]].line, says)


def up_to_speed(path: Path, events: list[Event]) -> float:
    """What the blocks between two rests take longer than their feeds say, at half of every axis' greatest acceleration, s.

    An axis that goes at v loses v/a: in the v/a up to speed and in the v/a to rest it goes half as far as at v. So it does on
    every stretch between two corners: block ends where its speed changes by more than it can in the shorter block.
    """
    moves = [e for e in events if e.kind == "feed" and np.isfinite(e.seconds) and e.seconds > 0.0]
    if not moves:
        return 0.0
    push = 0.5 * path.machine.limit("max_acceleration")
    needed = np.array([e.seconds for e in moves])
    speeds = np.array([e.end - e.start for e in moves]) / needed[:, None]
    able = push * np.minimum(needed[1:], needed[:-1])[:, None]
    corners = 1 + np.flatnonzero((np.abs(np.diff(speeds, axis=0)) > 1.01 * able).any(axis=1))
    highest = [np.abs(stretch).max(axis=0) for stretch in np.split(speeds, corners)]
    return float(sum(np.nan_to_num(speed / push).max() for speed in highest))


def minutes(paths: list[Path], runs: tuple[Run, ...]) -> tuple[float, float]:
    """Least and most minutes that a plan may state for one dialect's programs: with 5 min of set-up a run and up to one a stop;
    plans of recordings state the minutes of recording alone."""
    taken = sum(seconds(p) for p in paths)
    setup = 300.0 * len(runs)
    pauses = 60.0 * sum(sum(e.kind == "stop" for e in p.events) for p in paths)
    recorded = sum(float(run.t[-1] - run.t[0]) for run in runs)
    least = taken + setup if all(run.static for run in runs) else recorded
    return 0.95 * least / 60.0, 1.05 * (taken + setup + pauses) / 60.0
