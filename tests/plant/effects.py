"""The table of effects: name -> stage and function.  A new effect is one function and one line here.

Stages run in the order ``drive`` (loop constants), ``axis`` (coordinate behind the drive; the gear's error
before the
play, FORMATS.md and paper 3 alike), ``body`` (error motions, displacements, set-up) and ``sensor``.
"""

from collections.abc import Callable, Iterable

from . import behind, foreign, instrument, strange, structure
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
    # the frozen strata
    "cold_friction": ("drive", foreign.cold_friction),
    "chord_polygon": ("axis", foreign.chord_polygon),
    "screw_heat": ("axis", foreign.screw_heat),
    "scale_slip": ("axis", foreign.scale_slip),
    "preloaded_play": ("axis", foreign.preloaded_play),
    "settling": ("axis", foreign.settling),
    "cover_plates": ("body", foreign.cover_plates),
    "position_cross_talk": ("body", foreign.position_cross_talk),
    "roller_ripple": ("body", foreign.roller_ripple),
    "bed_bending": ("body", foreign.bed_bending),
    "jerk_yield": ("body", foreign.jerk_yield),
    "imbalance": ("body", foreign.imbalance),
    "gantry_lag": ("body", foreign.gantry_lag),
    "resonant_cogging": ("body", foreign.resonant_cogging),
    "table_growth": ("body", foreign.table_growth),
    "yaw_drift": ("body", foreign.yaw_drift),
    "taut_hose": ("body", foreign.taut_hose),
    "ball_form": ("body", foreign.ball_form),
    "probe_product": ("sensor", foreign.probe_product),
    "clamp_scatter": ("axis", strange.clamp_scatter),
    "coarse_counts": ("axis", strange.coarse_counts),
    "valve_lag": ("axis", strange.valve_lag),
    "one_flank": ("axis", strange.one_flank),
    "walking_coupling": ("axis", strange.walking_coupling),
    "drag_chain": ("body", strange.drag_chain),
    "rail_joint": ("body", strange.rail_joint),
    "motor_heat": ("body", strange.motor_heat),
    "loose_seat": ("body", strange.loose_seat),
    "soft_ground": ("body", strange.soft_ground),
    "cage_order": ("body", strange.cage_order),
    "oil_shot": ("body", strange.oil_shot),
    "soft_probe": ("sensor", strange.soft_probe),
    "cubic_sensor": ("sensor", strange.cubic_sensor),
    "clock_rate": ("sensor", strange.clock_rate),
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
FROZEN = {
    stratum: tuple(name for name, (_, function) in EFFECTS.items() if function.__module__.endswith(f".{stratum}"))
    for stratum in ("foreign", "strange")
}
"""Those of the frozen strata."""

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
