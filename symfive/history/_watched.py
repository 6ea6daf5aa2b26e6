"""A machine's visits watched one after the other: filter and watch together, and the outcome as bytes for the index."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.arrays import Array, Flags
from symfive.history._alarms import Alarm, Cause, Watch
from symfive.history._filter import State, follow
from symfive.history._forecast import YEAR
from symfive.history._information import Information, Readings
from symfive.history._visit import Event, Visit

STRETCH = 64
"""Visits that go through filter and watch at once."""
COURSE = 1
"""Of what is packed: another number where visits are watched otherwise."""


@dataclass(frozen=True)
class Watched:
    """The filter's `state` after the last visit, the `alarms`, levels along r directions after each of n visits (n, r) with their
    variances, and which had `begun`; the `excess` covariance (r, r) of the machine's scatter, None before it is known; the
    `smallest` step of each error that raises an alarm."""

    state: State
    alarms: tuple[Alarm, ...]
    levels: Array
    variances: Array
    begun: Flags
    excess: Array | None
    smallest: Mapping[str, float]

    def packed(self) -> bytes:
        """All of it as bytes; the same gives the same."""
        said = {"course": COURSE, "alarms": [asdict(alarm) for alarm in self.alarms], "smallest": dict(self.smallest)}
        excess = np.zeros((0, 0)) if self.excess is None else self.excess
        arrays: dict[str, NDArray[Any]] = {"levels": self.levels, "variances": self.variances, "begun": self.begun}
        arrays["excess"] = excess
        arrays |= {f"state_{field.name}": getattr(self.state, field.name) for field in fields(State)}
        stream = io.BytesIO()
        arrays["said"] = np.frombuffer(json.dumps(said).encode(), dtype=np.uint8)
        np.savez(stream, allow_pickle=False, **arrays)
        return stream.getvalue()

    @classmethod
    def unpacked(cls, data: bytes) -> Watched | None:
        """What was packed; None where another version of symfive watched otherwise, or the bytes are damaged."""
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                said = json.loads(arrays["said"].tobytes())
                if said["course"] != COURSE:
                    return None
                state = State(**{field.name: arrays[f"state_{field.name}"] for field in fields(State)})
                excess = arrays["excess"] if arrays["excess"].size else None
                alarms = tuple(_alarm(entry) for entry in said["alarms"])
                levels, variances, begun = (arrays[key] for key in ("levels", "variances", "begun"))
                return cls(state, alarms, levels, variances, begun, excess, said["smallest"])
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
            return None


def watch_visits(
    visits: Sequence[Visit], events: Sequence[Event], data: Information, readings: Readings, warmth: Array, rate: float
) -> Watched:
    """Time goes by, the forecast is judged, the state follows; no visit uses a later one.

    Visits go through filter and watch in stretches. An alarm ends one: the level begins anew at its visit, as after a repair.
    """
    state, watch = State.new(readings.basis.shape[1]), Watch(readings.basis, data.names, data.units, data.scale)
    alarms, (levels, variances) = list[Alarm](), np.empty((2, *readings.value.shape))
    begun = np.zeros(readings.value.shape, dtype=bool)
    years = np.diff([visits[0].time, *(visit.time for visit in visits)]) / YEAR  # since the visit before each
    renewed = _renewals(visits, events)
    at, length = 0, 1
    while at < len(visits):
        alone = at == 0 or renewed[at]
        later = np.flatnonzero(renewed[at + 1 : at + length])
        end = at + 1 if alone else min(at + length, len(visits), at + 1 + int(later[0]) if later.size else len(visits))
        part = slice(at, end)
        course = follow(
            state, years[part], readings.value[part], readings.variance[part], warmth[part], renewed=bool(renewed[at])
        )
        length = min(2 * length, STRETCH)
        if alone:
            watch.restart()
        else:
            alarm = watch.first_alarm(course.steps, rate, years[part], at)
            if alarm is not None:
                alarms.append(alarm)
                end, renewed[alarm.visit], length = alarm.visit, True, STRETCH // 4
        if end > at:
            state, kept = course.states[end - at - 1], slice(0, end - at)
            levels[at:end], variances[at:end] = course.level[kept], course.level_variance[kept]
            begun[at:end] = course.begun[kept]
        at = end
    last = readings.variance[-1]
    excess = watch.excess(last) if np.isfinite(last).all() else None
    return Watched(state, tuple(alarms), levels, variances, begun, excess, watch.smallest())


def _alarm(entry: Mapping[str, Any]) -> Alarm:
    causes = tuple(
        Cause(tuple(c["names"]), tuple(c["probabilities"]), c["change"], c["std"], c["unit"]) for c in entry["causes"]
    )
    return Alarm(entry["kind"], entry["visit"], entry["since"], entry["score"], entry["limit"], causes)


def _renewals(visits: Sequence[Visit], events: Sequence[Event]) -> Flags:
    """Before which visits the machine was repaired or adjusted, and which are as it was left."""
    times = np.array([visit.time for visit in visits])
    found = np.array([visit.stage == "as-left" for visit in visits])
    for event in events:
        at = int(np.searchsorted(times, event.time))
        if event.renews and 0 < at < len(visits):
            found[at] = True
    return found
