"""Effects: every piece of physics beside rigid geometry and linear drives. One file and one line of the table each."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

from symfive.effects._base import STAGES, Effect
from symfive.effects.backlash import Backlash
from symfive.effects.servo_mismatch import ServoMismatch
from symfive.effects.thermal_drift import ThermalDrift
from symfive.errors import InputError

if TYPE_CHECKING:
    from symfive.machine import Machine

__all__ = ["EFFECTS", "STAGES", "Effect", "baseline_effects", "make_effect"]

EFFECTS: dict[str, type[Effect]] = {
    effect.id: effect
    for effect in (
        Backlash,
        ServoMismatch,
        ThermalDrift,
    )
}


def make_effect(effect: str, axis: str | None = None, **options: Any) -> Effect:
    """An effect of the vocabulary by name. Raises `InputError` for an unknown name or option."""
    if effect not in EFFECTS:
        raise InputError(f'effect "{effect}" is unknown', remedy=f"use one of {', '.join(EFFECTS)}")
    kind = EFFECTS[effect]
    known = {f.name for f in fields(kind)} - {"axis"}
    for name in options:
        if name not in known:
            raise InputError(f'effect {effect} has no option "{name}"', remedy=f"it takes {', '.join(sorted(known)) or 'none'}")
    return kind(axis=axis, **options)


def baseline_effects(machine: Machine) -> tuple[Effect, ...]:
    """The effects that the machine file's `[model]` already holds."""
    return tuple(make_effect(entry.effect, entry.axis, **dict(entry.options)) for entry in machine.effects)
