"""Campaigns, effects and checks that tests of effects share."""

import math
import tempfile
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import plant
import pytest

from symfive.campaign import Campaign, read_campaign
from symfive.effects import Effect, make_effect
from symfive.model import Model

NO_SETUP = {"table_ball": [0.0] * 3, "tool_ball": [0.0] * 3, "length": 0.0, "zero": [0.0] * 3}


@dataclass(frozen=True)
class Case:
    """An effect on a campaign; `plant` the same in the plant's words, `sizes` in symfive's, `agree` to how many µm."""

    effect: str
    where: str
    axis: str | None = None
    options: dict[str, Any] = field(default_factory=dict)
    plant: dict[str, Any] | None = None
    sizes: dict[str, float] = field(default_factory=dict)
    agree: float = 1e-6
    rows: float = 0.0  # share of the rows at which the two may differ: reversals fall between rows

    def __str__(self) -> str:
        return "-".join(map(str, (self.effect, self.where, *self.options.values())))

    def make(self) -> Effect:
        return make_effect(self.effect, self.axis, **self.options)


def polar(amplitude: float, phase: float, *names: str) -> dict[str, float]:
    return dict(zip(names, (amplitude * math.cos(phase), amplitude * math.sin(phase)), strict=True))


def along(name: str, size: float) -> dict[str, float]:
    return {f"{name}.{c}": size * v for c, v in zip("xyz", SLANTED, strict=True)}


SLANTED = (0.6, 0.0, 0.8)
TONE = {
    f"{c}.{part}": v * w
    for c, v in zip("xz", (1.2, 1.6), strict=True)
    for part, w in polar(1.0, 0.4, "sin", "cos").items()
}
MATRIX = [[1.01, 0.02, 0.0], [0.01, 0.98, 0.03], [0.0, -0.02, 1.0]]
ENTRIES = {f"matrix.{i + 1}{j + 1}": v for i, line in enumerate(MATRIX) for j, v in enumerate(line)}
START = "start of the first motion"
CASES = [
    Case("backlash", "planar", "X", plant={"width": 12.0}, sizes={"width": 12.0}),
    Case("backlash", "circle", "C", plant={"width": 80.0}, sizes={"width": 80.0}),
    Case("backlash", "static", "C", plant={"width": 80.0}, sizes={"width": 80.0}),
    Case("backlash", "planar", "X", {"shape": "pre_sliding"},
         {"width": 12.0, "form": "presliding", "distance": 60.0, "start": START}, {"width": 12.0, "distance": 60.0}),
    Case("backlash", "planar", "X", {"shape": "wind_up"},
         {"width": 12.0, "form": "wind_up", "slope": 0.03}, {"width": 12.0, "slope": 0.03}),
    Case("transmission_error", "planar", "X", {"period": 10.0}, {"period": 10.0, "amplitude": 3.0, "phase": 0.7},
         polar(3.0, 0.7, "sin", "cos")),
    Case("transmission_error", "circle", "C", {"period": 4.0, "harmonics": 2},
         {"period": 4.0, "form": "harmonics", "harmonics": [[1, 60.0, 0.7], [2, 20.0, -1.0]]},
         polar(60.0, 0.7, "sin", "cos") | polar(20.0, -1.0, "sin2", "cos2")),
    Case("transmission_error", "static", "C", {"period": 90.0, "period_sigma": 0.0}),
    Case("servo_mismatch", "planar", "X", {}, {"position_gain": 40.0, "velocity_gain": 200.0, "feedforward": 0.1},
         {"position_gain": 40.0, "velocity_gain": 200.0, "feedforward": 0.1}),
    Case("servo_mismatch", "circle", "C", {"gains": ("position_gain", "integral_time", "viscous")}),
    Case("friction", "planar", "X", {}, {"coulomb": 150.0}, {"coulomb": 150.0}, agree=0.05),
    Case("friction", "circle", "C", {}, {"coulomb": 1.0}, {"coulomb": 1.0}, agree=0.01),
    Case("friction", "planar", "X", {"shape": "stribeck"},
         {"coulomb": 150.0, "form": "stribeck", "breakaway": 220.0, "stribeck_speed": 2.0},
         {"coulomb": 150.0, "stiction": 70.0, "stribeck_speed": 2.0}, agree=0.08),
    # the plant's command is linear between rows even where the delay reads it: 0.03 µm of sagitta
    Case("latency", "planar", None, {}, {"delay_ms": 7.0}, {"delay_ms": 7.0}, agree=0.04),
    Case("latency", "circle", None, {}, {"delay_ms": 7.0}, {"delay_ms": 7.0}, agree=0.05),
    Case("sensor_low_pass", "planar", None, {}, {"effect": "latency", "form": "low_pass", "cutoff_hz": 5.0},
         {"time_constant_ms": 100.0 / math.pi}, agree=0.04),
    Case("location_error", "static", None, {"component": "EY0B"},
         {"component": "EY0B", "value": 30.0}, {"value": 30.0}),
    Case("location_error", "static", None, {"component": "EC0C", "drift": True},
         {"component": "EC0C", "value": 30.0, "form": "drift", "time_constant_s": 300.0},
         {"value": 30.0, "time_constant_s": 300.0}),
    Case("location_error", "planar", None, {"component": "EB0Y"}),
    Case("error_motion", "static", None, {"component": "EAC"},
         {"component": "EAC", "harmonics": [[1, 3.0, 4.0], [2, -2.0, 5.0]]},
         {"cos1": 3.0, "sin1": 4.0, "cos2": -2.0, "sin2": 5.0}),
    Case("error_motion", "planar", None, {"component": "EXX", "basis": "polynomial", "order": 3}),
    Case("error_motion", "static", None, {"component": "EZB", "basis": "bspline", "order": 4}),
    Case("error_motion", "static", None,
         {"component": "EAC", "over": ("B", "C"), "basis": ("polynomial", "fourier"), "order": (2, 1)}),
    Case("scale_error", "planar", "Y", {}, {"ppm": 30.0}, {"ppm": 30.0}),
    Case("axis_growth", "planar", "X", {},
         {"effect": "scale_error", "ppm": 30.0, "form": "growing", "time_constant_s": 5.0, "at": -100.0},
         {"growth": 30.0, "held": 300.0, "time_constant_s": 5.0}),
    Case("axis_growth", "planar", "Y", {"shape": "linear", "span_s": 1e6},
         {"effect": "scale_error", "ppm": 30.0, "form": "growing", "time_constant_s": 1e6}, {"growth": 30.0}, agree=1e-5),
    Case("axis_growth", "static", "Z"),
    Case("axis_turn", "static", "C"),
    Case("axis_turn", "circle", "C", {"shape": "linear"}),
    Case("gravity_sag", "static", "B", {"component": "EZB"},
         {"component": "EZB", "amplitude": 15.0, "constant_cos": 4.0}, {"sin": 15.0, "one_minus_cos": 4.0}),
    Case("gravity_sag", "static", "B", {"component": "EAB", "parts": ("one_minus_cos",)},
         {"component": "EAB", "amplitude": 15.0, "form": "one_minus_cos"}, {"one_minus_cos": 15.0}),
    Case("gravity_sag", "static", "B", {"component": "EZB", "parts": ("sin", "sin_cubed")},
         {"component": "EZB", "amplitude": 15.0, "form": "stiffening", "stiffening": 0.2}, {"sin": 15.0, "sin_cubed": -3.0}),
    Case("gravity_sag", "static", "B", {"component": "EZB", "parts": ("sin", "branch")},
         {"component": "EZB", "amplitude": 15.0, "form": "hysteresis", "branch": 0.2, "distance_deg": 1e-3},
         {"sin": 15.0, "branch": 3.0}),
    Case("gravity_sag", "static", "C", {"component": "EAC"}),
    Case("thermal_drift", "static", None, {}, {"direction": SLANTED, "amplitude": 20.0, "time_constant_s": 300.0},
         along("amplitude", 20.0) | {"time_constant_s": 300.0}),
    Case("thermal_drift", "static", None, {"shape": "mixture"},
         {"direction": SLANTED, "amplitude": 20.0, "time_constant_s": 300.0, "form": "two", "share": 0.25,
          "time_constant2_s": 2000.0},
         along("amplitude", 15.0) | along("slow", 5.0) | {"time_constant_s": 300.0, "slow_time_constant_s": 2000.0}),
    Case("thermal_drift", "static", None, {"shape": "linear"},
         {"direction": SLANTED, "amplitude": 20.0, "time_constant_s": 3600.0, "form": "ramp"}, along("rate", 20.0)),
    Case("thermal_drift", "static", None, {"shape": "delayed", "onset_s": 55.0},
         {"direction": SLANTED, "amplitude": 20.0, "time_constant_s": 300.0, "form": "onset", "onset_s": 40.0},
         along("amplitude", 20.0) | {"time_constant_s": 300.0, "onset_s": 40.0}),
    Case("setup_shift", "static", None, {"run": "n1", "t_s": 60.0},
         {"run": "n1", "t_s": 60.0, "shift": [3.0, -2.0, 1.0]}, {"shift.x": 3.0, "shift.y": -2.0, "shift.z": 1.0}),
    Case("setup_shift", "planar", None, {"run": "cw", "t_s": 2.0, "shape": "creep"},
         {"run": "cw", "t_s": 2.5, "form": "creep", "creep_s": 1.5, "shift": [3.0, -2.0, 1.0]},
         {"shift.x": 3.0, "shift.y": -2.0, "shift.z": 1.0, "creep_s": 1.5, "t_s": 2.5}),
    Case("setup_shift", "planar", None, {"run": "cw", "t_s": 2.0, "shape": "creep", "artefact": "tool"}),
    Case("sensor_error", "planar", None, {}, {"gain": 1.03}, {"gain.dL_um": 1.03}),
    Case("sensor_error", "static", None, {"shape": "matrix"}, {"matrix": MATRIX}, ENTRIES),
    Case("lateral_play", "planar", None, {"component": "EYX"},
         {"component": "EYX", "width": 8.0, "takeup": 1e-3, "start": START}, {"width": 8.0}, rows=0.01),
    Case("lateral_play", "static", None, {"component": "EAC"}, {"component": "EAC", "width": 20.0}, {"width": 20.0}),
    Case("lateral_play", "circle", None, {"component": "EYX", "shape": "pre_sliding"},
         {"component": "EYX", "form": "presliding", "width": 8.0, "distance": 90.0, "start": START},
         {"width": 8.0, "distance": 90.0}),
    Case("lateral_play", "planar", None, {"component": "EYX", "shape": "play"},
         {"component": "EYX", "width": 8.0, "takeup": 20.0, "start": START}, {"width": 8.0, "distance": 20.0}),
    Case("vibration", "planar", None, {"frequency_hz": 12.3},
         {"frequency_hz": 12.3, "amplitude": 2.0, "direction": SLANTED, "phase": 0.4},
         TONE | {"y.sin": 0.0, "y.cos": 0.0, "frequency_hz": 12.3}),
    Case("vibration", "planar", None, {"frequency_hz": 17.3, "place": "reading", "run": "cw"}),
    Case("vibration", "planar", None, {"frequency_hz": 12.3, "phases": "run"}),
    Case("inertial_compliance", "planar", "X", {},
         {"direction": SLANTED, "compliance": 50.0}, along("compliance", 50.0)),
    Case("inertial_compliance", "planar", "X", {"shape": "softening"},
         {"direction": SLANTED, "compliance": 50.0, "form": "softening", "limit": 1e3},
         along("compliance", 50.0) | {"knee": 1e6}),
    Case("inertial_compliance", "circle", "C", {}, {"direction": SLANTED, "compliance": 5.0}, along("compliance", 5.0)),
    Case("structural_resonance", "planar", "X", {"frequency_hz": 25.0},
         {"direction": SLANTED, "frequency_hz": 25.0, "damping": 0.04},
         along("participation", 1.0) | {"frequency_hz": 25.0, "damping": 0.04}, agree=0.05),
    Case("structural_resonance", "circle", "C", {"frequency_hz": 25.0},
         {"direction": SLANTED, "frequency_hz": 25.0, "damping": 0.04},
         along("participation", 100.0) | {"frequency_hz": 25.0, "damping": 0.04}),
    Case("unknown", "static", None, {"over": ("B",)}),
    Case("unknown", "static", None, {"over": ("B", "C"), "basis": "fourier", "order": (1, 2), "carrier": "C"},
         {"effect": "two_axis_motion", "axes": ["B", "C"], "component": "EYC", "order": 2, "phase": 0.3, "amplitude": 9.0},
         {"y.sin1(B)*sin2(C)": 9.0 * math.cos(0.3), "y.sin1(B)*cos2(C)": 9.0 * math.sin(0.3)}),
    Case("unknown", "planar", None, {"over": ("t",), "basis": "fourier", "order": 3}),
    Case("unknown", "planar", None, {"over": ("X velocity",), "order": 4}),
    Case("unknown", "static", None, {"over": ("B", "C"), "basis": ("bspline", "fourier"), "order": (3, 1),
                                      "directions": "z"}),
    Case("unknown", "static", None, {"over": ("C velocity sign", "C"), "basis": ("polynomial", "fourier"), "order": 1,
                                      "place": "axis"},
         {"effect": "backlash", "axis": "C", "width": 40.0}, {"axis.P1(C velocity sign)": -20.0}),
    Case("unknown", "planar", None, {"over": ("X velocity sign", "X"), "basis": "polynomial", "order": (1, 2)},
         {"effect": "lateral_play", "component": "EYX", "width": 8.0, "takeup": 1e-3, "start": START},
         {"y.P1(X velocity sign)": -4.0}, rows=0.01),
    Case("unknown", "static", None, {"over": ("B velocity sign",), "basis": "polynomial", "order": 1, "carrier": "B",
                                      "directions": "ac"},
         {"effect": "lateral_play", "component": "EAB", "width": 60.0, "takeup": 1e-3}, {"a.P1": -30.0}),
    Case("unknown", "planar", None, {"over": ("X acceleration",), "basis": "polynomial", "order": 1, "span": ((-1e3, 1e3),)},
         {"effect": "inertial_compliance", "axis": "X", "direction": SLANTED, "compliance": 50.0},
         {f"{c}.P1": 50.0 * d for c, d in zip("xyz", SLANTED, strict=True)}),
    Case("reversal_spike", "planar", "X"),
    Case("reversal_spike", "planar", "X", {"shape": "stick"}),
    Case("reversal_spike", "planar", "X", {"shape": "pulse"},
         {"effect": "reversal_pulse", "amplitude": 6.0, "delay_ms": 120.0, "width_ms": 60.0},
         {"height": 6.0, "delay_ms": 120.0, "width_ms": 60.0}, rows=0.1),
    Case("table_step", "planar", "X", {"at": 20.0, "ramp": 5.0},
         {"effect": "compensation_table_step", "at": 20.0, "ramp": 5.0, "step": 6.0}, {"height": 6.0}),
    Case("table_step", "planar", "X", {"at": 18.0, "ramp": 5.0, "shape": "gradual"},
         {"effect": "compensation_table_step", "at": 20.0, "ramp": 7.0, "step": 6.0},
         {"height": 6.0, "middle": 23.5, "ramp": 7.0}),
    Case("table_step", "static", "C", {"at": 100.0, "ramp": 20.0, "shape": "late"}),
    Case("table_step", "static", "C", {"at": 100.0, "ramp": 20.0, "shape": "early"}),
    Case("table_step", "static", "C", {"at": 100.0, "ramp": 20.0, "shape": "dent"},
         {"effect": "compensation_table_step", "form": "dent", "at": 100.0, "ramp": 20.0, "step": 60.0},
         {"height": 60.0}),
    Case("bar_temperature", "planar", None, {}, {"amplitude": 3.0, "time_constant_s": 5.0},
         {"amplitude": 3.0, "time_constant_s": 5.0}),
    Case("bar_temperature", "circle", None, {"clock": "campaign"}),
    Case("bar_length", "planar"),
    Case("spindle_growth", "static"),
    Case("table_growth", "static", None, {}, {"amplitude": 5.0, "time_constant_s": 900.0},
         {"expansion": 50.0, "time_constant_s": 900.0}),
    Case("counterbalance", "static", "Z", {}, {"amplitude": 5.0, "slope": 0.002, "distance": 1e-3},
         {"drop": 5.0, "slope": 0.01}),
    Case("eccentric_mass", "static", "C"),
    Case("load_moment", "static", "Y"),
    Case("load_moment", "static", "B"),
    Case("eccentric_mass", "circle", "C", {}, {"amplitude": -20.0, "phase": 0.5}, polar(20.0, 0.5, "cos", "sin")),
]  # fmt: skip


@cache
def plants() -> dict[str, tuple[dict[str, Any], list[dict[str, Any]]]]:
    """The plant's machines and runs, without set-up errors."""
    planar, circle, static = plant.planar_table(), plant.dynamic_table(), plant.static_table()
    poses = plant.grid_poses([-90, -45, 0, 45, 90], range(0, 360, 60))
    path = {"feed": 2400.0, "sweep_deg": 120.0, "centre": (20.0, -10.0, 80.0)}
    turn = {"x_t": 55.0, "feed": 2400.0, "sweep_deg": 120.0}
    found = {
        "planar": (planar, [plant.planar_circle(planar, "ccw", **path),
                            plant.planar_circle(planar, "cw", direction=-1, start_deg=60.0, **path)]),
        "circle": (circle, [plant.synchronous_circle(circle, "ccw", **turn),
                            plant.synchronous_circle(circle, "cw", direction=-1, **turn)]),
        "static": (static, [plant.r_test(static, "n1", nest=(90.0, -20.0, 50.0), poses=poses),
                            plant.r_test(static, "n2", nest=(50.0, 40.0, 150.0), poses=poses[::-1], start_s=600.0)]),
    }  # fmt: skip
    for _, runs in found.values():
        for run in runs:
            zero = [0.0] * (3 if run["instrument"] == "r_test" else 0)
            run["setup_um"] = {**NO_SETUP, "zero": zero}
    return found


@cache
def campaign(where: str) -> Campaign:
    """The same as a plan that symfive reads."""
    machine, runs = plants()[where]
    with tempfile.TemporaryDirectory() as folder:
        plant.write_campaign(folder, machine, runs, readings=False)
        return read_campaign(folder)


@cache
def model_of(number: int) -> Model:
    """The model of a case, assembled once for all tests."""
    return Model(campaign(CASES[number].where), [CASES[number].make()])


@cache
def baseline(where: str) -> Model:
    return Model(campaign(where))


def own(model: Model, values: dict[str, float]) -> dict[str, float]:
    """Values by the last effect's own names, as the model's names."""
    return {f"{model.effects[-1].key}.{name}": value for name, value in values.items()}


def around(model: Model) -> np.ndarray:
    """A point at which nothing is zero: errors and set-ups of the baseline, effects of usual size."""
    small = {
        p.name: 0.3 if np.isfinite([p.lower, p.upper]).any() else 17.0
        for p in model.parameters
        if p.kind in ("location_error", "setup")
    }
    typical = {n: v for e in model.effects for n, v in e.typical(model.campaign).items()}
    values = model.vector(small | typical)
    return values * (1.0 + 0.013 * np.arange(len(values)) / len(values))


def assert_exact(model: Model, names: list[str], *, events: float = 0.0) -> None:
    """Sensitivities against central differences of fourth order; `events`: share of rows that may fall on a kink."""
    values = around(model)
    for run in [run for run in model.campaign.runs if model.effects[0].applies(run)][:1]:
        at = model.linearise(run, values)
        np.testing.assert_allclose(at.prediction, model.predict_run(run, values), rtol=0, atol=1e-9)
        for name in names:
            i, p = model.index[name], model.parameters[model.index[name]]
            step = 1e-3 * p.sigma

            def moved(steps: int, i: int = i, step: float = step, run: Any = run) -> np.ndarray:
                shifted = values.copy()
                shifted[i] += steps * step
                return model.predict_run(run, shifted)

            wanted = (8.0 * (moved(1) - moved(-1)) - (moved(2) - moved(-2))) / (12.0 * step)
            slope = at.jacobian[:, :, at.columns == i].sum(axis=2)  # none of a parameter of another run
            wrong = np.abs(slope - wanted).max(axis=1)
            allowed = 1e-6 * np.abs(wanted).max() + 2e-9 / step
            assert np.mean(wrong > allowed) <= events, f"{name} in {run.id}: {wrong.max()} > {allowed}"


every_case = pytest.mark.parametrize("number", range(len(CASES)), ids=lambda number: str(CASES[number]))


def tilt(run: Any) -> np.ndarray:
    return np.deg2rad(run.commands["B"])
