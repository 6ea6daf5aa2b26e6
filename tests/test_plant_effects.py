"""Effects of the independent plant show in its readings."""

from typing import Any

import numpy as np
import plant
import pytest
from plant.effects import FROZEN
from test_plant import SAG, campaign_like


# --- effects -----------------------------------------------------------------------------------------------
def test_backlash_output_lags_the_motion() -> None:
    x = np.array([0.0, 1.0, 2.0, 1.0, 0.0])
    assert plant.behind.play(x, 0.2, 0.0) == pytest.approx([0.0, 0.9, 1.9, 1.1, 0.1])
    machine = plant.static_table()
    poses = plant.grid_poses([0.0], [0.0, 30.0, 60.0])
    run = plant.r_test(machine, "nest", nest=[100.0, 0.0, 50.0], poses=poses)
    quiet = {"noise_options": plant.QUIET}
    spec = {"effect": "backlash", "axis": "C", "width": 80.0}
    change = plant.simulate_run(machine, run, effects=[spec], **quiet).values
    change = change - plant.simulate_run(machine, run, **quiet).values
    # C' carries the workpiece: C lagging by 40 urad leaves the ball 40 urad short of its polar angle.
    assert change[1] == pytest.approx([0.0, -4.0, 0.0], abs=1e-2)  # reached from below
    assert change[4] == pytest.approx([0.0, 4.0, 0.0], abs=1e-2)  # reached from above
    assert change[0] == pytest.approx([0.0, -4.0, 0.0], abs=1e-2)  # the first row counts like the second


DYNAMIC: list[dict[str, Any]] = [
    {"effect": "backlash", "axis": "C", "width": 80.0},
    {"effect": "backlash", "axis": "C", "width": 80.0, "form": "presliding", "distance": 800.0},
    {"effect": "backlash", "axis": "X", "width": 8.0, "form": "wind_up", "slope": 0.1},
    {"effect": "transmission_error", "axis": "C", "period": 3.0, "amplitude": 40.0, "phase": 0.3},
    {
        "effect": "transmission_error",
        "axis": "X",
        "period": 5.0,
        "form": "harmonics",
        "harmonics": [[2, 3.0, 0.1]],
    },
    {"effect": "transmission_error", "axis": "X", "period": 5.0, "amplitude": 3.0, "form": "sawtooth"},
    {"effect": "servo_mismatch", "axis": "C", "position_gain": 38.0},
    {"effect": "servo_mismatch", "axis": "X", "feedforward": 0.1, "velocity_gain": 200.0},
    {"effect": "servo_mismatch", "axis": "X", "form": "delay", "delay_ms": 1.0},
    {"effect": "friction", "axis": "X", "coulomb": 100.0},
    {"effect": "friction", "axis": "X", "coulomb": 100.0, "breakaway": 150.0, "form": "stribeck"},
    {
        "effect": "friction",
        "axis": "X",
        "coulomb": 100.0,
        "stiffness": 1e5,
        "damping": 300.0,
        "form": "lugre",
    },
    {"effect": "latency", "delay_ms": 20.0},
    {"effect": "latency", "form": "low_pass", "cutoff_hz": 2.0},
    {"effect": "location_error", "component": "EY0C", "value": 10.0},
    {
        "effect": "location_error",
        "component": "EX0C",
        "value": 10.0,
        "form": "drift",
        "time_constant_s": 20.0,
    },
    {"effect": "error_motion", "component": "EXC", "harmonics": [[2, 3.0, 1.0]]},
    {"effect": "error_motion", "component": "EXX", "coefficients": [0.0, 100.0]},
    {
        "effect": "error_motion",
        "component": "EYX",
        "form": "local",
        "amplitude": 5.0,
        "at": 60.0,
        "width": 10.0,
    },
    {"effect": "scale_error", "axis": "X", "ppm": 50.0},
    {"effect": "scale_error", "axis": "X", "ppm": 50.0, "form": "growing", "time_constant_s": 30.0},
    {"effect": "thermal_drift", "direction": [1.0, 0.0, 0.0], "amplitude": 8.0, "time_constant_s": 20.0},
    {
        "effect": "thermal_drift",
        "direction": [1.0, 0.0, 0.0],
        "amplitude": 8.0,
        "time_constant_s": 5.0,
        "form": "two",
        "time_constant2_s": 90.0,
    },
    {"effect": "setup_shift", "run": "r", "t_s": 10.0, "shift": [5.0, 0.0, 0.0]},
    {"effect": "sensor_error", "gain": 1.02},
    {"effect": "sensor_error", "form": "hysteresis", "width": 0.5},
    {"effect": "lateral_play", "component": "EYX", "width": 6.0},
    {"effect": "vibration", "frequency_hz": 12.0, "amplitude": 1.0, "form": "wandering"},
    {"effect": "inertial_compliance", "axis": "C", "direction": [1.0, 0.0, 0.0], "compliance": 3.0},
    {
        "effect": "structural_resonance",
        "axis": "X",
        "frequency_hz": 12.0,
        "damping": 0.03,
        "direction": [1.0, 0.0, 0.0],
    },
    {"effect": "two_mass_screw", "axis": "X", "frequency_hz": 20.0, "damping": 0.02},
    {"effect": "compensation_table_step", "axis": "C", "at": 45.0, "step": 60.0, "ramp": 2.0},
    {"effect": "counterbalance", "axis": "X", "amplitude": 5.0},
    {"effect": "stick_slip_teeth", "axis": "X", "amplitude": 4.0, "pitch": 0.5, "decay": 3.0},
    {"effect": "reversal_pulse", "axis": "X", "amplitude": 4.0, "delay_ms": 30.0, "width_ms": 20.0},
    {"effect": "eccentric_mass", "axis": "C", "amplitude": 20.0, "tilt": "A"},
    {"effect": "bar_temperature", "amplitude": 4.0, "time_constant_s": 30.0},
    {"effect": "changeover_sector", "axes": ["X", "Y"], "direction": [1.0, 0.0, 0.0], "amplitude": 3.0},
    {
        "effect": "shock",
        "t_s": 5.0,
        "frequency_hz": 15.0,
        "decay_s": 1.0,
        "amplitude": 5.0,
        "direction": [1.0, 0.0, 0.0],
    },
    {"effect": "speed_lift", "axis": "X", "half_speed": 5.0, "amplitude": 3.0, "direction": [1.0, 0.0, 0.0]},
]
STATIC: list[dict[str, Any]] = [
    SAG,
    {"effect": "gravity_sag", "axis": "B", "component": "EXB", "amplitude": 7.0, "form": "hysteresis"},
    {
        "effect": "thermal_drift",
        "direction": [0.0, 0.0, 1.0],
        "amplitude": 8.0,
        "time_constant_s": 400.0,
        "form": "onset",
        "onset_s": 1800.0,
    },
    {"effect": "sensor_error", "matrix": [[1.0, 0.01, 0.0], [0.0, 1.01, 0.0], [0.0, 0.0, 1.0]]},
    {"effect": "lateral_play", "component": "EXB", "width": 6.0, "form": "presliding"},
    {"effect": "backlash", "axis": "B", "width": 60.0, "form": "presliding"},
    {"effect": "coolant_cycle", "period_s": 400.0, "rise": 0.7, "amplitude": 3.0, "direction": [0.0, 1.0, 0.0]},
    {"effect": "two_axis_motion", "axes": ["B", "C"], "component": "EXC", "amplitude": 3.0},
]


def label(spec: dict[str, Any]) -> str:
    return f"{spec['effect']}-{spec.get('form', 'default')}"


@pytest.mark.parametrize("spec", DYNAMIC, ids=label)
def test_dynamic_effect_shows_in_the_readings(spec: dict[str, Any]) -> None:
    machine = plant.dynamic_table()
    run = {
        **plant.synchronous_circle(machine, "r", x_t=55.0, feed=1600.0),
        "start_s": 100.0 * ("t_s" not in spec),
    }
    assert_visible(machine, run, spec)


@pytest.mark.parametrize("spec", STATIC, ids=label)
def test_static_effect_shows_in_the_readings(spec: dict[str, Any]) -> None:
    assert_visible(plant.static_table(), campaign_like("static-none")[0], spec)


def assert_visible(machine: dict[str, Any], run: dict[str, Any], spec: dict[str, Any]) -> None:
    """The effect changes the reading's shape by 0.1 to 300 um, nothing else."""
    quiet = {"location_errors": {"EX0C": 20.0}, "noise_options": plant.QUIET}
    plain = plant.simulate_run(machine, run, **quiet).values
    change = plant.simulate_run(machine, run, effects=[spec], **quiet).values - plain
    assert np.isfinite(change).all()
    assert 0.1 < np.ptp(change, axis=0).max() < 300.0


def test_every_effect_of_the_table_is_tried_and_unknown_names_fail() -> None:
    frozen = {name for names in FROZEN.values() for name in names}  # tried in test_blind_study
    assert {s["effect"] for s in DYNAMIC + STATIC} == set(plant.EFFECTS) - frozen
    machine = plant.dynamic_table()
    run = plant.synchronous_circle(machine, "r", x_t=45.0, sweep_deg=20.0)
    with pytest.raises(ValueError, match="no effect 'warp'"):
        plant.simulate_run(machine, run, effects=[{"effect": "warp"}])


def test_noise_has_the_stated_parts() -> None:
    t, rng = np.arange(40000) * 0.02, np.random.default_rng(1)
    options = plant.NoiseOptions(white_um=0.3, coloured_um=0.25, correlation_s=0.8, outlier_rate=0.001, outlier_um=5.0)
    y = plant.noise.noise(t, 1, 9.0, options, rng)[:, 0]
    core = y[np.abs(y) < 2.0]
    assert core.std() == pytest.approx(np.hypot(0.3, 0.25), rel=0.05)
    assert 10 < np.sum(np.abs(y) >= 2.0) < 60
    lag = np.corrcoef(core[:-40], core[40:])[0, 1] * core.var()
    assert lag == pytest.approx(0.25**2 * np.exp(-1.0), rel=0.25)
