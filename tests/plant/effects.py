"""The table of effects: name -> stage and function.  A new effect is one function and one line here.

Stages run in the order ``drive`` (loop constants), ``axis`` (coordinate behind the drive; the gear's error
before the
play, FORMATS.md and paper 3 alike), ``body`` (error motions, displacements, set-up) and ``sensor``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from . import behind, instrument, structure
from .state import RunState, Spec

EFFECTS: dict[str, tuple[str, Callable[[RunState, Spec], None]]] = {
    # FORMATS.md section 7
    "servo_mismatch": ("drive", behind.servo_mismatch),
    "friction": ("drive", behind.friction),
    "transmission_error": ("axis", behind.transmission_error),
    "scale_error": ("axis", behind.scale_error),
    "backlash": ("axis", behind.backlash),
    "location_error": ("body", structure.location_error),
    "error_motion": ("body", structure.error_motion),
    "gravity_sag": ("body", structure.gravity_sag),
    "thermal_drift": ("body", structure.thermal_drift),
    "setup_shift": ("body", structure.setup_shift),
    "lateral_play": ("body", structure.lateral_play),
    "vibration": ("body", structure.vibration),
    "inertial_compliance": ("body", structure.inertial_compliance),
    "structural_resonance": ("body", structure.structural_resonance),
    "latency": ("sensor", instrument.latency),
    "sensor_error": ("sensor", instrument.sensor_error),
    # outside the vocabulary: a diagnosis should answer "unknown" or a near relative
    "two_mass_screw": ("drive", behind.two_mass_screw),
    "compensation_table_step": ("axis", behind.compensation_table_step),
    "counterbalance": ("axis", behind.counterbalance),
    "stick_slip_teeth": ("axis", behind.stick_slip_teeth),
    "reversal_pulse": ("axis", behind.reversal_pulse),
    "eccentric_mass": ("body", structure.eccentric_mass),
    "bar_temperature": ("body", structure.bar_temperature),
    "changeover_sector": ("body", structure.changeover_sector),
    "shock": ("body", structure.shock),
    "speed_lift": ("body", structure.speed_lift),
    "coolant_cycle": ("body", structure.coolant_cycle),
    "two_axis_motion": ("body", structure.two_axis_motion),
}

OUTSIDE = (
    "two_mass_screw",
    "compensation_table_step",
    "counterbalance",
    "stick_slip_teeth",
    "reversal_pulse",
    "eccentric_mass",
    "bar_temperature",
    "changeover_sector",
    "shock",
    "speed_lift",
    "coolant_cycle",
    "two_axis_motion",
)
"""Effects that FORMATS.md section 7 has no name for."""

FINE = ("structural_resonance", "latency", "two_mass_screw", "reversal_pulse")
"""Effects that need instants between the rows."""


def apply(state: RunState, effects: Iterable[Spec], stage: str) -> None:
    """Applies the effects of one stage in the table's order; ValueError for a name the plant lacks."""
    named = list(effects)
    for spec in named:
        if spec["effect"] not in EFFECTS:
            raise ValueError(f"the plant has no effect {spec['effect']!r}")
    for name, (where, function) in EFFECTS.items():
        for spec in named:
            if where == stage and spec["effect"] == name:
                function(state, spec)
