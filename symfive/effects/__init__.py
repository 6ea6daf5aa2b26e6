"""Effects: every piece of physics beside rigid geometry and linear drives. One file and one line of the table each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields
from functools import cache
from typing import Any, get_type_hints

from symfive.effects._axes import across, component_of, location_of, moving, reversing
from symfive.effects._base import AXIS, BALL, CARRIED, FORCE, LINKS, READING, STAGES, TOOL, Effect, Form, Scan, Tone
from symfive.effects._coordinates import coordinate_values
from symfive.effects._quantity import Quantity, amplitude_and_phase, length_spread
from symfive.effects._words import coordinate_words, effect_words, fits, key_words, quantity_words
from symfive.effects.axis_growth import AxisGrowth
from symfive.effects.axis_turn import AxisTurn
from symfive.effects.backlash import Backlash
from symfive.effects.bar_length import BarLength
from symfive.effects.bar_temperature import BarTemperature
from symfive.effects.counterbalance import Counterbalance
from symfive.effects.eccentric_mass import EccentricMass
from symfive.effects.error_motion import ErrorMotion
from symfive.effects.following_lag import FollowingLag
from symfive.effects.force_delay import ForceDelay
from symfive.effects.force_friction import ForceFriction
from symfive.effects.force_ripple import ForceRipple
from symfive.effects.force_vibration import ForceVibration
from symfive.effects.friction import Friction
from symfive.effects.gravity_sag import GravitySag
from symfive.effects.gravity_torque import GravityTorque
from symfive.effects.held_friction import HeldFriction
from symfive.effects.inertial_compliance import InertialCompliance
from symfive.effects.latency import Latency
from symfive.effects.lateral_play import LateralPlay
from symfive.effects.load_inertia import LoadInertia
from symfive.effects.load_moment import LoadMoment
from symfive.effects.location_error import LocationError
from symfive.effects.reversal_spike import ReversalSpike
from symfive.effects.scale_error import ScaleError
from symfive.effects.sensor_error import SensorError
from symfive.effects.sensor_low_pass import SensorLowPass
from symfive.effects.servo_mismatch import ServoMismatch
from symfive.effects.setup_shift import SetupShift
from symfive.effects.spindle_growth import SpindleGrowth
from symfive.effects.structural_resonance import StructuralResonance
from symfive.effects.table_growth import TableGrowth
from symfive.effects.table_step import TableStep
from symfive.effects.thermal_drift import ThermalDrift
from symfive.effects.transmission_error import TransmissionError
from symfive.effects.unknown import Unknown
from symfive.effects.varying import Varying
from symfive.effects.vibration import Vibration, columns_read
from symfive.errors import InputError
from symfive.files import shown
from symfive.kinematics import function_words
from symfive.machine import Machine

__all__ = [
    "AXIS", "BALL", "CARRIED", "EFFECTS", "FORCE", "LINKS", "READING", "STAGES", "TOOL", "VOCABULARY", "Effect", "Form",
    "Quantity", "Scan", "Tone", "Unknown", "Varying", "across", "amplitude_and_phase", "baseline_effects", "columns_read",
    "component_of", "coordinate_values", "coordinate_words", "effect_words", "finding_words", "form_words", "length_spread",
    "location_of", "make_effect", "moving", "parameter_words", "reversing",
]  # fmt: skip

_TABLE: tuple[type[Effect], ...] = (
    # the vocabulary (docs/conventions.md, section 7)
    Backlash,
    TransmissionError,
    ServoMismatch,
    Friction,
    Latency,
    LocationError,
    ErrorMotion,
    ScaleError,
    GravitySag,
    ThermalDrift,
    SetupShift,
    SensorError,
    LateralPlay,
    Vibration,
    InertialCompliance,
    StructuralResonance,
    Unknown,
    # further forward models, reported under a word of the vocabulary
    ReversalSpike,
    FollowingLag,
    ForceFriction,
    ForceDelay,
    ForceRipple,
    ForceVibration,
    HeldFriction,
    GravityTorque,
    LoadInertia,
    SensorLowPass,
    SpindleGrowth,
    TableGrowth,
    AxisGrowth,
    AxisTurn,
    BarLength,
    BarTemperature,
    TableStep,
    Counterbalance,
    EccentricMass,
    LoadMoment,
    Varying,
)
EFFECTS: dict[str, type[Effect]] = {effect.id: effect for effect in _TABLE}
VOCABULARY: tuple[str, ...] = tuple(name for name, effect in EFFECTS.items() if not effect.reported_as)
"""The words a finding may use."""


@cache
def _types_of(effect: str) -> dict[str, Any]:
    """The types of an effect's options by name."""
    return get_type_hints(EFFECTS[effect])


def make_effect(effect: str, axis: str | None = None, **options: Any) -> Effect:
    """An effect by name. Raises `InputError` for an unknown name, and for an option it lacks or does not have."""
    if effect not in EFFECTS:
        raise InputError(f'effect "{effect}" is unknown', remedy=f"use one of {', '.join(EFFECTS)}")
    kind = EFFECTS[effect]
    known = {f.name: f for f in fields(kind) if f.name != "axis"}
    for name in options:
        if name not in known:
            raise InputError(f'effect {effect} has no option "{name}"', remedy=f"it takes {', '.join(sorted(known))}")
    for name, f in known.items():
        if name not in options and f.default is MISSING and f.default_factory is MISSING:
            raise InputError(f"effect {effect} needs its option {name}", remedy=f"write {name} = …")
    hints = _types_of(effect)
    options = {n: make_effect(**v) if hints[n] is Effect and isinstance(v, Mapping) else v for n, v in options.items()}
    for name, value in {"axis": axis, **options}.items():
        if not fits(value, hints[name]):
            problem = f"effect {effect}: {name} = {shown(value)} is not of the right kind"
            raise InputError(
                problem, remedy=f"write {name} as {known[name].type if name in known else 'the name of an axis'}"
            )
    return kind(axis=axis, **options)


def parameter_words(name: str, axes: Iterable[str]) -> str:
    """A parameter, or a form of an effect, in words where only its name is known, of a machine with these `axes`."""
    head, _, rest = name.partition(".")
    if head in EFFECTS or "_" in head:
        return key_words(name, tuple(axes), EFFECTS.get(head, Effect).terms)
    return f"{head} ({function_words(rest)})" if rest else name


def finding_words(word: str, name: str, unit: str | None) -> str:
    """A quantity of a finding of which only its word of the vocabulary is known, in words."""
    terms = (term for effect in EFFECTS.values() if (effect.reported_as or effect.id) == word for term in effect.terms)
    return quantity_words(name, unit, tuple(terms))


def form_words(key: str, machine: Machine) -> str:
    """The key of a form of an effect, or the name of one of its parameters, in words."""
    return parameter_words(key, machine.axis_names)


def baseline_effects(machine: Machine) -> tuple[Effect, ...]:
    """The effects that the machine file's `[model]` already holds."""
    return tuple(make_effect(entry.effect, entry.axis, **dict(entry.options)) for entry in machine.effects)
