"""Effects: exact sensitivities, plain formulas, the independent plant, what they leave alone, how they are reported."""

from __future__ import annotations

import json
import math
import tempfile
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import plant
import pytest
from scipy.spatial.transform import Rotation

from symfive.campaign import Campaign, Run, read_campaign
from symfive.effects import EFFECTS, VOCABULARY, Effect, make_effect
from symfive.errors import InputError
from symfive.machine import Machine, Structure, machine_from_data, make_axis, preset
from symfive.model import Model, effect_to_data, effects_from_data, signature
from symfive.motion import PreSliding, RunMotion, approach
from symfive.posterior import candidates
from symfive.procedures import campaign_of, planar_circle
from symfive.report.signature import plot_signature

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
         {"growth": 30.0, "shift": 3.0, "time_constant_s": 5.0}),
    Case("axis_growth", "planar", "Y", {"shape": "linear", "span_s": 1e6},
         {"effect": "scale_error", "ppm": 30.0, "form": "growing", "time_constant_s": 1e6}, {"growth": 30.0}, agree=1e-5),
    Case("axis_growth", "static", "Z"),
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
    Case("spindle_growth", "static"),
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
    small = {p.name: 0.3 if p.bounded else 17.0 for p in model.parameters if p.kind in ("location_error", "setup")}
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
            wrong = np.abs(at.jacobian[:, :, list(at.columns).index(i)] - wanted).max(axis=1)
            allowed = 1e-6 * np.abs(wanted).max() + 2e-9 / step
            assert np.mean(wrong > allowed) <= events, f"{name} in {run.id}: {wrong.max()} > {allowed}"


every_case = pytest.mark.parametrize("number", range(len(CASES)), ids=lambda number: str(CASES[number]))


@every_case
def test_sensitivities_are_exact(number: int) -> None:
    model = model_of(number)
    effect, runs = model.effects[-1], [run for run in model.campaign.runs if model.effects[0].applies(run)]
    names = [p.name for p in (*effect.parameters(model.campaign), *effect.starts(runs[0]))]
    assert_exact(model, names, events=0.01)


@every_case
def test_at_zero_size_nothing_changes(number: int) -> None:
    case, model = CASES[number], model_of(number)
    zero = model.predict({p.name: p.mean for p in model.effects[-1].parameters(model.campaign)})
    for run, readings in baseline(case.where).predict({}).items():
        np.testing.assert_allclose(zero[run], readings, rtol=0, atol=1e-8)


@pytest.mark.parametrize("case", [case for case in CASES if case.plant is not None], ids=str)
def test_plant_agrees(case: Case) -> None:
    model = model_of(CASES.index(case))
    machine, runs = plants()[case.where]
    spec = {"effect": case.effect, "axis": case.axis} | (case.plant or {})
    shift = {p: 40.0 for p in ("EX0C", "EA0C") if p in machine["errors"]}
    values, told = own(model, case.sizes) | shift, {run["id"]: dict(spec) for run in runs}
    for run in runs:
        sides = model.effects[-1].starts(model.campaign.run(run["id"]))
        if spec.get("start") == START or (sides and case.where == "static"):
            steps = np.diff(run["command"][spec["axis"] or spec["component"][2:]])
            first = float(np.sign(steps[np.abs(steps) > 1e-6][0]))
            if "start" in spec:
                told[run["id"]]["start"] = first
            values |= {p.name: first for p in sides}  # the plant's static axes count as they first go
    predicted = model.predict(values)
    for run in runs:
        truth = plant.simulate_run(machine, run, shift, effects=[told[run["id"]]], noise_options=plant.QUIET).values
        wrong = np.abs(truth - predicted[run["id"]]).max(axis=1)
        assert np.mean(wrong > case.agree) <= case.rows, wrong.max()


@pytest.mark.parametrize("case", [c for c in CASES if EFFECTS[c.effect].dynamic_only], ids=str)
def test_dynamic_effects_rest_in_static_runs(case: Case) -> None:
    still = campaign(case.where)
    still = replace(still, runs=tuple(replace(run, sampling="static") for run in still.runs))
    model = Model(still, [case.make()])
    sized = model.predict(model.effects[-1].typical(still))
    for run, readings in Model(still).predict({}).items():
        np.testing.assert_array_equal(sized[run], readings)


FORMULAS = {
    "scale_error": ("Y", {}, {"ppm": 30.0}, lambda run: (30e-6 * run.commands["Y"] * 1e3, (0, 1, 0))),
    "transmission_error": ("Y", {"period": 40.0}, {"sin": 3.0, "cos": 4.0},
        lambda run: (5.0 * np.sin(2.0 * np.pi * run.commands["Y"] / 40.0 + math.atan2(4.0, 3.0)), (0, 1, 0))),
    "thermal_drift": (None, {}, {"amplitude.z": 20.0, "time_constant_s": 300.0},
        lambda run: (20.0 * (1.0 - np.exp(-(run.start_s + run.time) / 300.0)), (0, 0, 1))),
    "lateral_play": (None, {"component": "EZX"}, {"width": 10.0},
        lambda run: (-5.0 * came_from(run.commands["X"]), (0, 0, 1))),
    "backlash": ("Z", {}, {"width": 10.0}, lambda run: (-5.0 * came_from(run.commands["Z"]), (0, 0, 1))),
    "table_step": ("Y", {"at": 20.0, "ramp": 1e-6}, {"height": 7.0},
        lambda run: (7.0 * (run.commands["Y"] > 20.0), (0, 1, 0))),
    "gravity_sag": ("B", {"component": "EZB"}, {"sin": 6.0, "one_minus_cos": 2.0},
        lambda run: (-6.0 * np.sin(tilt(run)) - 2.0 * (1.0 - np.cos(tilt(run))), (0, 0, 1))),
}  # fmt: skip


def tilt(run: Any) -> np.ndarray:
    return np.deg2rad(run.commands["B"])


def came_from(command: np.ndarray) -> np.ndarray:
    """By the moves; before the first one between the flanks, but for a single first row, which counts like the second."""
    signs = np.zeros(len(command))
    for k in range(1, len(command)):
        step = command[k] - command[k - 1]
        signs[k] = np.sign(step) if abs(step) > 1e-9 else signs[k - 1]
    begins = np.flatnonzero(signs)[0]
    if begins == 1:
        signs[0] = signs[1]
    return signs


@pytest.mark.parametrize("name", FORMULAS)
def test_plain_formulas(name: str) -> None:
    """R-test readings by hand: a shift e of the tool in the machine frame reads Rᵀ·e at the turned table."""
    axis, options, sizes, formula = FORMULAS[name]
    plan = campaign("static")
    change = signature(make_effect(name, axis, **options), plan, zero_but(name, axis, options, sizes))
    for run in plan.runs:
        value, direction = formula(run)
        pairs = zip(tilt(run), np.deg2rad(run.commands["C"]), strict=True)
        turned = [Rotation.from_euler("YZ", [-b, -c]).as_matrix() for b, c in pairs]
        wanted = np.stack([r.T @ np.asarray(direction) for r in turned]) * value[:, None]
        np.testing.assert_allclose(change[run.id], wanted, rtol=0, atol=2e-6 * max(1.0, np.abs(value).max()))


def zero_but(name: str, axis: str | None, options: dict[str, Any], sizes: dict[str, float]) -> dict[str, float]:
    effect = Model(campaign("static"), [make_effect(name, axis, **options)]).effects[-1]
    means = {p.name.removeprefix(effect.key + "."): p.mean for p in effect.parameters(campaign("static"))}
    return means | sizes


@pytest.mark.parametrize("code", ["w C' B' X' Y' b Z t", "w C' X' Y' b Z B t"])
@pytest.mark.parametrize("direction", [(0.0, 1.0, 0.0), (0.0, 1.0, 1.0), (1.0, 2.0, -0.5)])
def test_gravity_turns_in_the_tilted_frame(code: str, direction: tuple[float, float, float]) -> None:
    """Against gravity turned by a numerical rotation about the axis' own direction, on either side of the machine."""
    axes: dict[str, Any] = {n: {} for n in "CXYZ"} | {"B": {"direction": list(direction)}}
    machine = machine_from_data({"schema": "symfive.machine/1", "structure": code, "axes": axes})
    poses = np.array([0.0, 20.0, 50.0, -70.0])
    commands = {n: np.zeros(4) for n in "CXYZ"} | {"B": poses}
    plan = replace(campaign("static"), machine=machine)
    runs = (replace(plan.runs[0], time=np.arange(4.0), commands=commands, readings={}, tool_ball=(0.0, 0.0, -100.0)),)
    plan = replace(plan, runs=runs)
    unit, down = np.asarray(direction) / np.linalg.norm(direction), np.array([0.0, 0.0, -1.0])
    sign = -1.0 if "B'" in code else 1.0
    across = -sign * np.cross(unit, down)
    change = [Rotation.from_rotvec(sign * q * unit).inv().apply(down) - down for q in np.deg2rad(poses)]
    wanted = np.array(change) @ (across / np.linalg.norm(across))
    got = signature(make_effect("gravity_sag", "B", component="EZB"), plan, {"sin": 8.0, "one_minus_cos": 0.0})
    moved = got[runs[0].id]
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 8.0 * np.abs(wanted), rtol=0, atol=1e-6)
    if sign > 0.0:
        np.testing.assert_allclose(moved[:, 2], 8.0 * wanted, rtol=0, atol=1e-6)
    sine = np.linalg.norm(across)
    np.testing.assert_allclose(wanted, sine * np.sin(np.deg2rad(poses)), rtol=0, atol=1e-12)
    said = make_effect("gravity_sag", "B", component="EZB").describe(
        plan, {"gravity_sag.B.EZB.sin": 8.0, "gravity_sag.B.EZB.one_minus_cos": 0.0}, {}
    )
    assert said["amplitude"].value == pytest.approx(8.0 * sine)  # what it moves at sin q = 1


@pytest.mark.parametrize("slip", [0.0, 1e-9, 2.9e-4, 0.1, 1.0])
@pytest.mark.parametrize("axis", ["B", "C"])
def test_a_sag_is_no_larger_than_gravity_turns_in_its_frame(axis: str, slip: float) -> None:
    """However near an axis is to the vertical, alone or on a tilting one: 1 g turned over is a change by 2."""
    axes: dict[str, Any] = {n: {} for n in "CXYZB"}
    axes[axis] = {"direction": [0.0, slip, 1.0]}
    machine = machine_from_data({"schema": "symfive.machine/1", "structure": "w C' B' X' Y' b Z t", "axes": axes})
    generator = np.random.default_rng(1)
    commands = {n: np.zeros(50) for n in "XYZ"} | {n: generator.uniform(-180.0, 180.0, 50) for n in "BC"}
    plan = campaign("static")
    run = replace(plan.runs[0], time=np.arange(50.0), commands=commands, readings={}, tool_ball=(0.0, 0.0, -100.0))
    plan = replace(plan, machine=machine, runs=(run,))
    if axis == "B" and slip < 1e-8:  # vertical, to rounding
        with pytest.raises(InputError, match="gravity does not turn"):
            make_effect("gravity_sag", "B", component="EZB").prepare(plan)
        return
    moved = signature(make_effect("gravity_sag", axis, component=f"EZ{axis}"), plan, {"sin": 8.0, "one_minus_cos": 0.0})
    turns = 2.0 if axis == "C" else 2.0 * slip / math.hypot(slip, 1.0)
    assert 0.1 * turns * 8.0 < np.linalg.norm(moved[run.id], axis=1).max() <= turns * 8.0 + 1e-6


def test_pre_sliding_after_a_reversal_is_the_catalogue_s_formula() -> None:
    plan = campaign("static")
    way = np.concatenate([np.linspace(0.0, 5.0, 60), np.linspace(5.0, 3.0, 200)])
    commands = {name: np.zeros(len(way)) for name in plan.machine.axis_names} | {"X": way}
    run = replace(plan.runs[0], time=np.arange(len(way), dtype=float), commands=commands)
    motion = RunMotion(run, plan.machine, {}, {"distance": 0.2})
    state = PreSliding("X", "distance").series(motion).value
    after = 5.0 - way[60:]
    np.testing.assert_allclose(state[:60], 1.0)
    np.testing.assert_allclose(state[60:], -(1.0 - 2.0 * np.exp(-after / 0.2)), atol=1e-12)


COMBINED = [
    ("planar", [("friction", "X", {}), ("servo_mismatch", "X", {})], 0.03),
    ("circle", [("servo_mismatch", "C", {}), ("backlash", "C", {}),
                ("structural_resonance", "X", {"frequency_hz": 30.0})], 0.03),
    ("planar", [("latency", None, {}), ("servo_mismatch", "X", {"gains": ("position_gain",)}),
                ("sensor_low_pass", None, {}), ("sensor_error", None, {})], 0.03),
    ("static", [("gravity_sag", "B", {"component": "EZB"}), ("thermal_drift", None, {}), ("eccentric_mass", "C", {}),
                ("transmission_error", "C", {"period": 90.0})], 0.0),
]  # fmt: skip


@pytest.mark.parametrize(("where", "effects", "events"), COMBINED, ids=lambda v: v if isinstance(v, str) else "")
def test_effects_join(where: str, effects: list[tuple[str, str | None, dict[str, Any]]], events: float) -> None:
    model = Model(campaign(where), [make_effect(name, axis, **options) for name, axis, options in effects])
    names = [p.name for e in model.effects for p in e.parameters(model.campaign)]
    names += [p.name for p in model.parameters if p.kind == "location_error"][:1]
    assert_exact(model, names, events=events)


def test_latency_leaves_the_control_s_own_recording_alone() -> None:
    plan = campaign("planar")
    runs = tuple(replace(run, instrument=("ball_bar", "encoder")) for run in plan.runs)
    change = signature(make_effect("latency"), replace(plan, runs=runs), {"delay_ms": 8.0})
    for run in runs:
        assert np.abs(change[run.id][:, 0]).max() > 0.01
        assert np.abs(change[run.id][:, 1:]).max() == 0.0


def test_latency_leaves_what_other_effects_do_to_the_control_s_own_recording_alone() -> None:
    """A clock belongs to a reading: force and bar may look at the velocity of one axis, and only the bar sees it late."""
    plan = campaign("planar")
    options = {"axis": "X", "force_terms": ("mass", "viscous")}
    runs = tuple(
        replace(run, instrument=("drive_force", "ball_bar"), options=options, readings={}) for run in plan.runs
    )
    plan = replace(plan, runs=runs)
    others = [make_effect("force_friction", "X"), make_effect("unknown", over=("X velocity",), place="force")]
    model = Model(plan, [*others, make_effect("latency")])
    at = {p.name: 5.0 for e in model.effects[:2] for p in e.parameters(plan)} | {"drive_force.X.mass": 90.0}
    on_time, late = model.predict(at), model.predict({**at, "latency.delay_ms": 8.0})
    for run in runs:
        change = late[run.id] - on_time[run.id]
        assert np.abs(change[:, 0]).max() == 0.0 and np.ptp(on_time[run.id][:, 0]) > 1.0
        assert np.abs(change[:, 1]).max() > 0.01
    names = [*at, "latency.delay_ms", next(p.name for p in model.parameters if p.kind == "location_error")]
    assert_exact(model, names)


@pytest.mark.parametrize("name", ["latency", "sensor_low_pass"])
def test_where_the_control_records_everything_no_instrument_is_late(name: str) -> None:
    plan = campaign("planar")
    runs = tuple(replace(run, instrument=("encoder",), readings={}) for run in plan.runs)
    assert not any(make_effect(name).applies(run) for run in runs)
    assert any(make_effect(name).applies(run) for run in plan.runs)
    assert name not in {form.effect.id for form in candidates(replace(plan, runs=runs)).forms}


REFUSED = [
    ("static", "location_error", None, {"component": "EX0C"}, "already varies EX0C"),
    ("static", "location_error", None, {"component": "EX0Y"}, "no position of its own"),
    ("planar", "scale_error", "X", {}, "already varies the scale"),
    ("planar", "error_motion", None, {"component": "EXX", "basis": "polynomial", "order": 1}, "already holds EXX"),
    ("planar", "error_motion", None, {"component": "EXX", "basis": "bspline", "order": 4}, "holds EXX as polynomial"),
    ("static", "gravity_sag", "Y", {"component": "EZB"}, "does not tilt"),
    ("planar", "gravity_sag", "X", {"component": "EZA"}, "does not tilt"),
    ("static", "friction", "X", {}, "needs the drive"),
    ("static", "backlash", None, {}, "belongs to an axis"),
    ("static", "backlash", "Q", {}, "the machine lacks"),
    ("static", "backlash", "C", {"shape": "round"}, "shape 'round' is unknown"),
    ("static", "transmission_error", "C", {}, "needs its period"),
    ("static", "lateral_play", None, {"component": "EXX"}, "lies along the motion"),
    ("static", "setup_shift", None, {"run": "n1", "t_s": -5.0}, "outside the run"),
    ("static", "table_step", "C", {"at": 1000.0, "ramp": 20.0, "shape": "late"}, "nothing was read beyond the step"),
    ("static", "unknown", None, {"over": ("speed",)}, "is unknown"),
    ("static", "unknown", None, {"over": ("B",), "carrier": "C", "directions": "xa"}, "needs coordinates and directions"),
    ("planar", "unknown", None, {"over": ("Z",)}, "does not move"),
    ("static", "unknown", None, {"over": ("B",), "carrier": "Q"}, "no axis Q carries it"),
    ("static", "unknown", None, {"over": ("B",), "carrier": "C", "place": "axis"}, "no axis C carries it"),
]  # fmt: skip


@pytest.mark.parametrize(("where", "name", "axis", "options", "message"), REFUSED)
def test_refused_with_one_sentence(
    where: str, name: str, axis: str | None, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Model(campaign(where), [make_effect(name, axis, **options)])


def test_make_effect_names_what_is_missing() -> None:
    with pytest.raises(InputError, match="needs its option component"):
        make_effect("error_motion")
    with pytest.raises(InputError, match='has no option "size"'):
        make_effect("backlash", "X", size=3.0)


def test_further_harmonics_join_those_of_the_baseline() -> None:
    plan = campaign("planar")
    effect = make_effect("error_motion", component="EXX", basis="polynomial", order=3)
    assert [p.name for p in effect.parameters(plan)] == ["error_motion.EXX.P2", "error_motion.EXX.P3"]


def test_an_error_motion_however_large_leaves_location_errors_what_they_are_at_the_axis_zero() -> None:
    """A polynomial vanishes at zero, with its slope there where a squareness has the slope."""
    tilt = campaign("static")
    rows = {run.id: run.commands["B"] == 0.0 for run in tilt.runs}
    assert sum(int(np.sum(at)) for at in rows.values()) > 5
    model = Model(tilt, [make_effect("error_motion", component="EXB", basis="polynomial", order=3)])
    moved = model.contribution(model.effects[-1], model.vector({f"error_motion.EXB.P{k}": 1000.0 for k in (1, 2, 3)}))
    assert max(np.abs(moved[id][at]).max(initial=0.0) for id, at in rows.items()) < 1e-6
    assert max(np.abs(moved[id]).max() for id in rows) > 100.0

    machine = preset("three-axis")
    square = replace(machine, errors={"EC0X": machine.errors["EC0X"]})
    circle = Model(
        campaign_of(square, planar_circle(square, centre=(0.0, 0.0, 110.0))),
        [make_effect("error_motion", component="EYX", basis="polynomial", order=3)],
    )
    (effect,) = circle.effects
    for id, y in circle.contribution(effect, circle.vector({"error_motion.EYX.P3": 1000.0})).items():
        run = circle.campaign.run(id)
        x, across = run.commands["X"], np.abs(run.commands["Y"]) / np.hypot(run.commands["X"], run.commands["Y"])
        near = (np.abs(x) < 70.0) & (np.abs(x) > 20.0)
        bow = np.abs(y[near, 0] / across[near] / x[near] ** 3)
        assert np.ptp(bow) < 0.25 * bow.mean()  # the axis lags behind its command


@every_case
def test_described_and_written(number: int) -> None:
    """Every report is finite JSON in the vocabulary's words; an effect survives model.json."""
    model = model_of(number)
    effect = model.effects[-1]
    covariance = {(p.name, p.name): (0.1 * p.sigma) ** 2 for p in model.parameters}
    values = dict(zip(model.index, around(model), strict=True))
    found = {name: vars(quantity) for name, quantity in effect.describe(model.campaign, values, covariance).items()}
    assert json.dumps(found, allow_nan=False)
    chosen = {"direction"} if effect.id == "spindle_growth" else set(vars(effect))  # not estimated
    for name, entry in found.items():
        numbers = np.ravel(entry["value"]).dtype.kind in "if"
        assert not numbers or name in chosen or entry["std"] is not None, name
    assert effect.vocabulary in VOCABULARY and effect.says and effect.hidden_by and effect.action
    again = effects_from_data(json.loads(json.dumps([effect_to_data(effect)])), "model.json")
    assert again == (effect,)


def test_amplitude_and_phase_are_reported_with_their_uncertainty() -> None:
    plan = campaign("planar")
    effect = make_effect("transmission_error", "X", period=10.0)
    values = {f"{effect.key}.{n}": v for n, v in (polar(3.0, 2.9, "sin", "cos") | {"period": 10.0}).items()}
    names = [f"{effect.key}.sin", f"{effect.key}.cos"]
    matrix = np.array([[0.04, 0.01], [0.01, 0.09]])
    covariance = {(a, b): matrix[i, j] for i, a in enumerate(names) for j, b in enumerate(names) if i <= j}
    found = effect.describe(plan, values, covariance)
    along_it = np.array([math.cos(2.9), math.sin(2.9)])
    assert found["amplitude"].value == pytest.approx(3.0) and found["phase"].value == pytest.approx(2.9)
    assert found["amplitude"].std == pytest.approx(math.sqrt(along_it @ matrix @ along_it), rel=1e-6)
    assert found["phase"].std == pytest.approx(
        math.sqrt(along_it[::-1] * (-1, 1) @ matrix @ (along_it[::-1] * (-1, 1))) / 3.0
    )
    assert (found["period"].unit, found["amplitude"].unit, found["phase"].unit) == ("mm", "um", "rad")


def test_vocabulary_is_that_of_the_conventions() -> None:
    assert set(VOCABULARY) == {
        "backlash", "transmission_error", "servo_mismatch", "friction", "latency", "location_error", "error_motion",
        "scale_error", "gravity_sag", "thermal_drift", "setup_shift", "sensor_error", "lateral_play", "vibration",
        "inertial_compliance", "structural_resonance", "unknown",
    }  # fmt: skip
    others = {"force_friction", "force_delay", "force_ripple", "gravity_torque", "varying"}  # below
    others |= {"following_lag"}  # of axes without a drive: test_following_lag
    assert {case.effect for case in CASES} | others == set(EFFECTS)


@pytest.mark.parametrize(
    ("over", "where"), [("C", "static"), ("t", "static"), ("B velocity sign", "static"), ("X velocity", "planar")]
)
def test_what_varies_is_the_effect_times_a_function_of_the_coordinate(over: str, where: str) -> None:
    plan, inner = campaign(where), make_effect("lateral_play", component="EYX" if where == "planar" else "EZB")
    effect = make_effect("varying", of=inner, over=over).prepare(plan)
    plain, varied = Model(plan, [inner]), Model(plan, [effect])
    shares = {p.name: m for p, m in zip(effect.parameters(plan)[1:], (0.4, -0.3), strict=False)}
    size = {f"{inner.key}.width": 6.0}
    for run in plan.runs:
        if over == "t":
            course = run.start_s + run.time
        elif over.endswith("sign"):
            course = approach(run.commands["B"])
        else:
            course = np.gradient(run.commands["X"], run.time) if over.endswith("velocity") else run.commands[over]
        ends = [np.min(effect.span), np.max(effect.span)]
        z = np.clip(2.0 * (course - ends[0]) / (ends[1] - ends[0]) - 1.0, -1.0, 1.0)
        functions = (
            (z, 1.5 * z**2 - 0.5) if not effect.periodic else (np.cos(np.radians(course)), np.sin(np.radians(course)))
        )
        share = 1.0 + sum(m * f for m, f in zip(shares.values(), functions, strict=False))
        alone, both = (model.predict_run(run, values) - model.predict_run(run, {})
                       for model, values in ((plain, size), (varied, size | shares)))  # fmt: skip
        if over.endswith("velocity"):  # behind its drive the axis is not quite as fast as commanded
            steady = np.abs(np.gradient(course)) < 1e-2 * np.abs(course).max()
            alone, both, share = alone[steady], both[steady], share[steady]
        scale = np.abs(alone).max()
        assert np.allclose(both, share[:, None] * alone, atol=(2e-2 if over.endswith("velocity") else 1e-3) * scale)
    assert_exact(varied, [p.name for p in effect.parameters(plan)])
    again = effects_from_data(json.loads(json.dumps([effect_to_data(effect)])), "model.json")
    assert again == (effect,)


def test_what_acts_inside_the_position_loop_cannot_vary() -> None:
    with pytest.raises(InputError, match="cannot vary over Y"):
        make_effect("varying", of=make_effect("servo_mismatch", "X"), over="Y").prepare(campaign("planar"))
    with pytest.raises(InputError, match='varies over "Q", which is unknown'):
        make_effect("varying", of={"effect": "backlash", "axis": "X"}, over="Q").prepare(campaign("planar"))


def test_force_friction_is_a_level_for_each_direction_where_the_baseline_has_none() -> None:
    machine = preset("three-axis")
    time = np.arange(400) * 0.01
    rest = {name: np.zeros(400) for name in machine.axis_names}
    bare = Run(
        id="x", instrument=("drive_force",), sampling="dynamic", time=time,
        commands={**rest, "X": 40.0 * np.sin(2.0 * np.pi * time)}, noise_um=0.3,
        options={"axis": "X", "force_terms": ("mass", "viscous")},
    )  # fmt: skip
    plan = Campaign(machine=machine, runs=(bare,))
    model = Model(plan, [make_effect("force_friction", "X")])
    sized = {"force_friction.X.coulomb": 20.0, "force_friction.X.offset": -3.0}
    force = (model.predict(sized)["x"] - model.predict({})["x"])[:, 0]
    speed = np.gradient(bare.commands["X"], time)
    clear = (np.abs(speed) > 60.0) & (time > 0.0)  # it starts from rest
    np.testing.assert_allclose(force[clear], 20.0 * np.sign(speed[clear]) - 3.0, atol=1e-9)
    full = replace(plan, runs=(replace(bare, options={"axis": "X"}),))
    with pytest.raises(InputError, match="without friction in its baseline"):
        make_effect("force_friction", "X").prepare(full)


def force_of(axis: str, machine: Machine, **more: float) -> Campaign:
    """The force of one axis along an encoder's motion that has passed the force's low-pass; all rotary axes move."""
    time = np.arange(600) * 0.01
    commands = {name: np.zeros(600) for name in machine.axis_names}
    for number, name in enumerate(n for n in machine.axis_names if machine.axes[n].rotary):
        commands[name] = 40.0 * np.sin((1.0 + 0.3 * number) * time)
    commands[axis] = 40.0 * np.sin(2.0 * time) + 15.0 * np.sin(5.0 * time)
    rotary = machine.axes[axis].rotary
    unit, quantity = ("deg", "torque_Nm") if rotary else ("mm", "force_N")
    options = {"axis": axis, "encoder_axes": [axis], "motion_from": "encoder", "low_pass_hz": 20.0} | more
    run = Run(
        id="f", instrument=("encoder", "drive_force"), sampling="dynamic", time=time, commands=commands, options=options,
        readings={f"{axis}_act_{unit}": commands[axis], f"{axis}_{quantity}": 10.0 * np.cos(time)},
    )  # fmt: skip
    return Campaign(machine=machine, runs=(run,))


def added_force(effect: Effect, plan: Campaign, values: dict[str, float]) -> np.ndarray:
    """What an effect adds to the recorded force (N,)."""
    model = Model(plan, [effect])
    at = model.named(model.start) | {"drive_force.X.mass": 80.0, "drive_force.X.viscous": 200.0} | values
    at = {name: value for name, value in at.items() if name in model.index}
    return np.asarray(model.contribution(model.effects[0], model.vector(at))["f"][:, 1])


def test_a_force_that_is_recorded_early_is_that_of_a_moment_later() -> None:
    plan = force_of("X", preset("three-axis"))
    t = plan.runs[0].time
    speed = (80.0 * np.cos(2.0 * t) + 75.0 * np.cos(5.0 * t)) * 1e-3
    acceleration = (-160.0 * np.sin(2.0 * t) - 375.0 * np.sin(5.0 * t)) * 1e-3
    jerk = (-320.0 * np.cos(2.0 * t) - 1875.0 * np.cos(5.0 * t)) * 1e-3
    added = added_force(make_effect("force_delay", "X"), plan, {"force_delay.X.delay_ms": -2.0})
    inner = slice(50, -50)
    np.testing.assert_allclose(added[inner], 2e-3 * (80.0 * jerk + 200.0 * acceleration)[inner], atol=1e-3)
    assert np.ptp(speed) > 0.1
    bare = replace(plan, runs=(replace(plan.runs[0], options={"axis": "X"}),))
    with pytest.raises(InputError, match="filtered motion"):
        make_effect("force_delay", "X").prepare(bare)


def test_a_ripple_of_the_force_follows_the_way() -> None:
    plan = force_of("X", preset("three-axis"))
    values = {"force_ripple.X.sin": 3.0, "force_ripple.X.cos2": -1.0}
    added = added_force(make_effect("force_ripple", "X", period=7.0, harmonics=2), plan, values)
    angle = 2.0 * np.pi * plan.runs[0].commands["X"] / 7.0
    np.testing.assert_allclose(added[20:], (3.0 * np.sin(angle) - np.cos(2.0 * angle))[20:], atol=0.2)
    with pytest.raises(InputError, match="no run records the drive force of Y"):
        make_effect("force_ripple", "Y", period=7.0).prepare(plan)


def test_friction_of_a_drive_may_differ_by_direction_and_fade_with_the_speed() -> None:
    plan = force_of("X", preset("three-axis"), force_terms=("mass", "viscous"))
    effect = make_effect("force_friction", "X", parts=("coulomb", "skew", "stribeck"))
    sizes = {"coulomb": 20.0, "skew": 30.0, "stribeck": -8.0, "speed": 12.0}
    added = added_force(effect, plan, {f"force_friction.X.{name}": size for name, size in sizes.items()})
    speed = np.gradient(plan.runs[0].commands["X"], plan.runs[0].time)
    clear = np.abs(speed) > 40.0
    expected = 20.0 * np.sign(speed) + 0.03 * np.abs(speed) - 8.0 * np.sign(speed) * np.exp(-np.abs(speed) / 12.0)
    np.testing.assert_allclose(added[clear], expected[clear], atol=0.3)  # the filter rounds reversals


def test_weight_loads_the_drive_of_a_tilted_axis() -> None:
    """A pendulum: the torque of a weight moment about a horizontal axis is that times the cosine of its angle to the horizon."""
    axes = {
        "J1": make_axis("J1", kind="rotary", direction=(0.0, 1.0, 0.0), origin=(0.0, 0.0, 100.0)),
        "J2": make_axis("J2", kind="rotary", direction=(0.0, 1.0, 0.0), origin=(0.0, 0.0, 400.0)),
        "J3": make_axis("J3", kind="rotary", direction=(0.0, 0.0, 1.0), origin=(0.0, 0.0, 400.0)),
    }
    machine = Machine(name="arm", structure=Structure.parse("w b J1 J2 J3 t"), axes=axes, errors={})
    plan = force_of("J1", machine)
    angle = {name: np.radians(way) for name, way in plan.runs[0].commands.items()}
    sizes = {"gravity_torque.J1.J1.z": 5.0, "gravity_torque.J1.J2.z": 2.0}
    added = added_force(make_effect("gravity_torque", "J1"), plan, sizes)
    # weight at the upper end of both links: it pulls the arm over as the sines of their angles
    expected = 5.0 * np.sin(angle["J1"]) + 2.0 * np.sin(angle["J1"] + angle["J2"])
    np.testing.assert_allclose(np.abs(added), np.abs(expected), atol=1e-6)
    with pytest.raises(InputError, match="no weight loads it"):
        make_effect("gravity_torque", "Z1").prepare(force_of("Z1", upright()))


def upright() -> Machine:
    axes = {"Z1": make_axis("Z1", kind="rotary", direction=(0.0, 0.0, 1.0), origin=(0.0, 0.0, 0.0))}
    return Machine(name="turn", structure=Structure.parse("w b Z1 t"), axes=axes, errors={})


def test_a_column_bends_under_the_reach_of_what_it_carries() -> None:
    """A boom that turns on a column: tilt by the moment of its weight, and by the height of the carriage."""
    axes = {
        "Z": make_axis("Z", travel=(0.0, 1000.0)),
        "C": make_axis("C", kind="rotary", direction=(0.0, 0.0, 1.0), origin=(0.0, 0.0, 0.0)),
    }
    machine = Machine(name="crane", structure=Structure.parse("w b Z C t"), axes=axes, errors={})
    boom, angles, height = (500.0, 0.0, 0.0), np.linspace(0.0, 350.0, 15), 800.0
    run = Run(
        id="f", instrument=("r_test",), sampling="static", time=np.arange(15.0), tool_ball=boom, table_ball=(0.0, 0.0, 0.0),
        commands={"Z": np.full(15, height), "C": angles},
    )  # fmt: skip
    plan = Campaign(machine=machine, runs=(run,))
    model = Model(plan, [make_effect("load_moment", "Z")])
    reach = 0.5 * np.stack([np.cos(np.radians(angles)), np.sin(np.radians(angles))], axis=1)  # m
    for name, tilt, shift in (("w", 40.0, 40.0 * 0.8), ("h", 40.0 * 0.8, 0.5 * 40.0 * 0.8**2)):
        change = model.predict({f"load_moment.Z.{name}.tool": 40.0})["f"] - model.predict({})["f"]
        radial = np.sum(change[:, :2] * reach, axis=1) / 0.5
        np.testing.assert_allclose(change[:, 2], -tilt * 0.5 * 0.5 * np.ones(15), rtol=1e-3)  # it sinks by tilt × reach
        np.testing.assert_allclose(radial, shift * 0.5, rtol=2e-3)  # and leans out


def test_an_unknown_of_a_drives_force_takes_nothing_from_offset_direction_and_speed() -> None:
    machine = preset("three-axis")
    time = np.arange(900) * 0.01
    commands = {name: np.zeros(900) for name in machine.axis_names}
    commands["X"] = 40.0 * np.sin(2.0 * np.pi * time) + 15.0 * np.sin(5.0 * time)
    bare = Run(
        id="x", instrument=("drive_force",), sampling="dynamic", time=time, commands=commands, noise_um=0.3,
        options={"axis": "X"},
    )  # fmt: skip
    plan = Campaign(machine=machine, runs=(bare,))
    model = Model(plan, [make_effect("unknown", over=("X velocity",), place="force", order=6)])
    names = [p.name for p in model.effects[0].parameters(plan)]
    assert {p.unit for p in model.parameters if p.name in names} == {"N"}
    speed = np.gradient(commands["X"], time)
    own = np.column_stack([np.ones(900), np.sign(speed), speed])
    at = model.contribution(model.effects[0], model.vector(dict.fromkeys(names, 5.0) | {names[0]: -9.0}))["x"][:, 0]
    taken = own @ np.linalg.lstsq(own, at, rcond=None)[0]
    assert np.std(at) > 0.5 and np.std(taken) < 0.2 * np.std(at)  # the drive lags behind its command
    assert_exact(model, names)
    with pytest.raises(InputError, match="no run records the drive force of Y"):
        make_effect("unknown", over=("Y",), place="force").prepare(plan)


def test_signature_is_drawn() -> None:
    figure = plot_signature(make_effect("backlash", "X"), campaign("planar"), {"width": 12.0})
    assert len(figure.axes) == 2 and figure.axes[0].lines
    with pytest.raises(InputError, match='no parameter "depth"'):
        signature(make_effect("backlash", "X"), campaign("planar"), {"depth": 12.0})


def test_a_drift_says_how_far_it_went_where_amplitude_and_time_constant_are_known_only_together():
    """Of a rise that has just begun only amplitude/τ is known."""
    plan = campaign("static")
    drift = make_effect("thermal_drift").prepare(plan)
    end = drift.clock_span(plan)
    names = [f"thermal_drift.{name}" for name in ("amplitude.x", "amplitude.y", "amplitude.z", "time_constant_s")]
    values = dict(zip(names, (30.0, 40.0, 0.0, 1e3 * end), strict=True))
    together = {(a, b): 0.81 * values[a] * values[b] for a in names for b in names}
    said = drift.describe(plan, values, together)
    assert said["amplitude"].value == pytest.approx(50.0) and said["amplitude"].std == pytest.approx(45.0)
    assert said["reached"].value == pytest.approx(0.05, rel=1e-3) and said["reached"].std < 1e-4
    assert said["reached"].unit == "um"


def test_a_component_that_is_not_seen_is_in_the_uncertainty_of_an_amplitude():
    """A circle in XY sees nothing of z: its prior's 1σ is all that is known, and to first order it adds nothing."""
    plan = campaign("planar")
    drift = make_effect("thermal_drift").prepare(plan)
    names = [f"thermal_drift.{name}" for name in ("amplitude.x", "amplitude.y", "amplitude.z", "time_constant_s")]
    values = dict(zip(names, (3.0, 4.0, 0.0, 100.0), strict=True))
    known = {(name, name): 0.01 for name in names[:2]}
    assert drift.describe(plan, values, known)["amplitude"].std == pytest.approx(0.1, rel=0.01)
    unseen = {**known, (names[2], names[2]): 25.0}
    assert drift.describe(plan, values, unseen)["amplitude"].std == pytest.approx(2.89, rel=0.01)


def test_a_step_on_its_ramp_stays_so_in_runs_that_end_before_it():
    plan = campaign("static")
    late = make_effect("table_step", "C", at=100.0, ramp=20.0, shape="late").prepare(plan)
    run = plan.runs[0]
    ends = int(np.argmax(run.commands["C"] > 100.0))
    few = replace(plan, runs=(run.part(0, ends),))
    assert late.prepare(few).beyond == late.beyond > 0.0
    with pytest.raises(InputError, match="nothing was read beyond the step"):
        make_effect("table_step", "C", at=100.0, ramp=20.0, shape="late").prepare(few)


def test_the_size_of_a_term_without_a_name_is_that_of_its_readings():
    """Also where the axis rests in a run: there it came from no side."""
    plan = campaign("static")
    still = replace(plan.runs[1], commands=plan.runs[1].commands | {"B": np.zeros(plan.runs[1].rows)})
    plan = replace(plan, runs=(plan.runs[0], still))
    term = make_effect("unknown", over=("B velocity sign",), basis="polynomial", order=1, directions="y").prepare(plan)
    values = {p.name: 4.0 for p in term.parameters(plan)}
    first = {r.id: next(float(np.sign(s)) for s in np.diff(r.commands["B"]) if abs(s) > 1e-9) for r in plan.runs[:1]}
    sides = {p.name: first[run.id] for run in plan.runs[:1] for p in term.starts(run)}
    moved = np.concatenate(list(Model(plan, [term]).contribution(term, values | sides).values()))
    size = term.describe(plan, values, {(name, name): 1.0 for name in values})["rms"].value
    assert size == pytest.approx(float(np.sqrt(np.mean(np.sum(moved**2, axis=1)))), rel=1e-6)
    assert size < 3.9


def test_the_part_of_an_amplitude_that_is_seen_is_said_by_itself():
    plan = campaign("planar")
    compliance = make_effect("inertial_compliance", "X").prepare(plan)
    names = [f"inertial_compliance.X.compliance.{c}" for c in "xyz"]
    values = dict(zip(names, (3.0, 4.0, 1.0), strict=True))
    known = {(name, name): 0.01 for name in names}
    assert "seen" not in compliance.describe(plan, values, known)
    seen = compliance.describe(plan, values, {**known, (names[2], names[2]): 25.0})["seen"]
    assert (seen.value, seen.std) == (pytest.approx(5.0), pytest.approx(0.1)) and seen.unit == "um/(m/s^2)"


def test_a_shape_stays_as_it_is_beyond_what_was_recorded():
    """A polynomial of order 8 would be 200 times as large at 1.4 times its span."""
    shape = make_effect("unknown", over=("t",), basis="polynomial", order=5, span=((0.0, 100.0),))
    said = []
    for start in (100.0, 140.0, 5000.0):
        plan = campaign("planar")
        late = replace(plan, runs=tuple(replace(run, start_s=start) for run in plan.runs[:1]))
        effect = shape.prepare(late)
        values = {p.name: 1.0 for p in effect.parameters(late)}
        (readings,) = Model(late, [effect]).predict(values).values()
        said.append(readings - next(iter(Model(late, [effect]).predict({}).values())))
    np.testing.assert_allclose(said[1], said[0], atol=1e-12)
    np.testing.assert_allclose(said[2], said[0], atol=1e-12)
    assert 0.1 < np.abs(said[0]).max() < 100.0


def test_the_size_of_a_term_without_a_name_is_what_the_readings_determine():
    """A direction of its amplitudes that they leave to the prior adds neither size nor doubt."""
    clean = read_campaign(Path(__file__).parent / "data" / "campaigns" / "static-none" / "fit")
    term = make_effect("unknown", over=("t",), order=4, directions="x").prepare(clean)
    parameters = term.parameters(clean)
    names, sigma = [p.name for p in parameters], np.array([p.sigma for p in parameters])
    seen = np.eye(len(names))[0]
    spread = np.outer(sigma, sigma) * (np.eye(len(names)) - 0.9996 * np.outer(seen, seen))
    pairs = {(a, b): spread[i, j] for i, a in enumerate(names) for j, b in enumerate(names)}
    exact = dict.fromkeys(names, 0.0) | {names[0]: sigma[0]}
    vague = {n: 0.3 * s for n, s in zip(names, sigma, strict=True)} | {names[0]: sigma[0]}
    wanted, found = (term.describe(clean, values, pairs)["rms"] for values in (exact, vague))
    assert found.value == pytest.approx(wanted.value) and found.std == pytest.approx(0.02 * found.value)
