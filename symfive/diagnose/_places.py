"""Where an effect acts: link of the chain, axis, coordinate, stretches of the runs, direction of space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.effects import Effect
from symfive.effects.unknown import Unknown
from symfive.machine import Machine

__all__ = [
    "LINKS", "Interval", "axis_of", "coordinate_of", "direction_of", "in_the_drive", "intervals_of", "leaves", "link_of",
    "moves_the_same", "reshapes",
]  # fmt: skip

Array = NDArray[np.float64]

LINKS = ("drive", "behind the drive", "structure", "instrument and set-up")
"""The links of the chain from the command to the reading (P. Andolfatto, S. Lavernhe & J. Mayer 2011)."""
_STAGE_LINKS = {"drive": LINKS[0], "axis": LINKS[1], "structure": LINKS[2], "reading": LINKS[3], "recording": LINKS[3]}
SIDEWAYS = 0.3
"""What moves less than this share of an effect along an axis of the machine does not move along it."""
_SETUP = ("setup_shift", "latency", "bar_temperature", "sensor_error", "sensor_low_pass")


@dataclass(frozen=True)
class Interval:
    """A stretch of a run in which the effect acts most (s)."""

    run: str
    begin_s: float
    end_s: float


def link_of(effect: Effect) -> str:
    """Which link of the chain the effect belongs to."""
    if effect.id == "force_friction" or getattr(effect, "place", "") == "force":
        return LINKS[0]
    return LINKS[3] if effect.id in _SETUP else _STAGE_LINKS[effect.stage]


def in_the_drive(effect: Effect) -> bool:
    """Whether it acts in the position loops, or shows in the force of a drive."""
    return effect.stage == "drive" or link_of(effect) == LINKS[0]


def axis_of(effect: Effect) -> str | None:
    """The axis an effect is about: its own, or that of its component."""
    component = getattr(effect, "component", None)
    if effect.axis is None and isinstance(component, str):
        return component[3:] if component[2:3] == "0" else component[2:]
    return effect.axis


_COORDINATES = {
    "backlash": "{axis} velocity sign", "lateral_play": "{axis} velocity sign", "friction": "{axis} velocity sign",
    "reversal_spike": "{axis} velocity sign", "counterbalance": "{axis} velocity sign", "transmission_error": "{axis}",
    "servo_mismatch": "{axis} velocity", "latency": "time", "location_error": "pose", "error_motion": "{axis}",
    "scale_error": "{axis}", "gravity_sag": "{axis}", "thermal_drift": "time", "spindle_growth": "time",
    "bar_temperature": "time", "setup_shift": "time", "sensor_error": "reading", "sensor_low_pass": "time",
    "vibration": "time", "inertial_compliance": "{axis} acceleration", "structural_resonance": "{axis} acceleration",
    "table_step": "{axis}", "eccentric_mass": "{axis}", "force_friction": "{axis} velocity sign",
}  # fmt: skip


def coordinate_of(effect: Effect) -> str:
    if isinstance(effect, Unknown):
        return ", ".join(effect.over)
    return _COORDINATES.get(effect.id, "pose").format(axis=axis_of(effect))


def intervals_of(campaign: Campaign, contribution: Mapping[str, Array], limit: int = 40) -> tuple[Interval, ...]:
    """Stretches in which the effect exceeds half of its largest deviation from its own mean; where there are more than
    `limit`, those with the shortest pauses between them are one."""
    away = {run: np.abs(c - np.median(c, axis=0)) for run, c in contribution.items()}
    largest = max((float(a.max()) for a in away.values()), default=0.0)
    found: list[Interval] = []
    for run in campaign.runs:
        strong = away[run.id].max(axis=1) > 0.5 * largest
        edges = np.flatnonzero(np.diff(np.concatenate([[False], strong, [False]]).astype(int)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            found.append(Interval(run.id, float(run.time[begin]), float(run.time[end - 1])))
    pauses = sorted(b.begin_s - a.end_s for a, b in pairwise(found) if a.run == b.run)
    longest = pauses[min(len(found) - limit, len(pauses)) - 1] if len(found) > limit and pauses else -1.0
    joined: list[Interval] = []
    for piece in found:
        last = joined[-1] if joined else None
        if last is not None and last.run == piece.run and piece.begin_s - last.end_s <= longest:
            joined[-1] = Interval(last.run, last.begin_s, piece.end_s)
        else:
            joined.append(piece)
    return tuple(joined)


def direction_of(machine: Machine, effect: Effect, values: Mapping[str, float]) -> tuple[float, float, float] | None:
    """Direction of space in which it acts, machine frame: of its three amplitudes, its component or its axis."""
    vector = [values[name] for c in "xyz" for name in values if name.startswith(effect.key) and name.endswith(f".{c}")]
    if len(vector) == 3:
        norm = float(np.linalg.norm(vector))
        return (vector[0] / norm, vector[1] / norm, vector[2] / norm) if norm > 0.0 else None
    component = getattr(effect, "component", None)
    if isinstance(component, str):
        return tuple(float(i == "XYZABC".index(component[1]) % 3) for i in range(3))  # type: ignore[return-value]
    axis = axis_of(effect)
    return None if axis is None else machine.axes[axis].direction


def reshapes(term: Unknown, named: Effect, machine: Machine, values: Mapping[str, float]) -> bool:
    """Whether a term without a name moves what a named effect moves, over the same coordinate of the same axis: then it only
    changes its shape."""
    if coordinate_of(named) != term.over[0] or not term.owners <= {axis_of(named)}:
        return False
    return term.place == "reading" or _moved(machine, term, values) <= _moved(machine, named, values)


def leaves(term: Effect, named: Effect) -> bool:
    """Whether a term without a name takes nothing from a named effect: a drive's force less what its friction holds."""
    return named.id == "force_friction" and bool(getattr(term, "less", ())) and term.axis == named.axis


def _moved(machine: Machine, effect: Effect, values: Mapping[str, float]) -> set[tuple[bool, str]]:
    """Whether it turns (or shifts), and about (or along) what."""
    if isinstance(effect, Unknown) and effect.place == "structure":
        return {(c in "abc", "xyz"["xyzabc".index(c) % 3]) for c in effect.directions}
    component, axis = getattr(effect, "component", None), axis_of(effect)
    turns = component[1] in "ABC" if component else axis is not None and machine.axes[axis].rotary
    along = direction_of(machine, effect, values) or (0.0, 0.0, 0.0)
    return {(turns, c) for c, share in zip("xyz", along, strict=True) if abs(share) > SIDEWAYS}


def moves_the_same(a: Effect, b: Effect) -> bool:
    """Whether two effects move the same component, or go by one word: then each may be a shape of the other, whatever its plain
    shape scores."""
    one, two = _component(a), _component(b)
    if one is None and two is None:
        return (a.vocabulary, a.axis) == (b.vocabulary, b.axis)
    return one == two


def _component(effect: Effect) -> str | None:
    """The component that an effect moves, if it moves one; a scale error is the linear part of the positioning error."""
    return f"E{effect.axis}{effect.axis}" if effect.id == "scale_error" else getattr(effect, "component", None)
