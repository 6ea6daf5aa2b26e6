"""Physics for which no diagnosis was written: the frozen outside stratum of the blind study (docs/blind-study.md).

Each function is one form, with the mechanism in its docstring. Frozen before anything was run on it: the digest of this file
is pinned by a test, so that a form can be added but none changed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .behind import hysteresis
from .chain import Array
from .instrument import ball
from .state import UM, RunState, Spec, since_reversal


def _warmed(state: RunState, spec: Spec) -> Array:
    """1 - exp(-clock/time_constant_s), (N,)."""
    return 1.0 - np.exp(-state.clock / float(spec["time_constant_s"]))


def _unit_speed(state: RunState, name: str) -> Array:
    """Speed in mm/s or degree/s, (N,)."""
    return np.rad2deg(state.v[name]) if state.axis(name).rotary else state.v[name]


def screw_heat(state: RunState, spec: Spec) -> None:
    """A screw warms where its nut runs: what lies beyond `at` moves, q += amplitude.(1 + tanh((q - at)/width))/2, with time."""
    name = spec["axis"]
    beyond = 0.5 * (1.0 + np.tanh((state.coordinate(name) - float(spec["at"])) / float(spec["width"])))
    state.x[name] = state.x[name] + float(spec["amplitude"]) * state.small(name) * beyond * _warmed(state, spec)


def scale_slip(state: RunState, spec: Spec) -> None:
    """The clamp of a scale slips at `t_s` of the clock: from then on q += ppm.1e-6.q."""
    name = spec["axis"]
    state.x[name] = state.x[name] * (1.0 + 1e-6 * float(spec["ppm"]) * (state.clock >= float(spec["t_s"])))


def preloaded_play(state: RunState, spec: Spec) -> None:
    """Play of `axis` that the moment of an unbalanced table closes: `width`.(1 - |sin(tilt)|/limit) while that is positive."""
    name = spec["axis"]
    free = np.clip(1.0 - np.abs(np.sin(state.x[spec["tilt"]])) / float(spec["limit"]), 0.0, 1.0)
    side = hysteresis(state, name, {"form": "hard", "width": 0.1})
    state.x[name] = state.x[name] - 0.5 * float(spec["width"]) * state.small(name) * free * side


def chord_polygon(state: RunState, spec: Spec) -> None:
    """A coarse interpolator: the circle of two `axes` is a polygon with a corner every `step_deg`."""
    first, second = spec["axes"]
    points = np.stack([state.x[first], state.x[second]], axis=1)
    centre = 0.5 * (points.max(axis=0) + points.min(axis=0))
    away = points - centre
    angle, step = np.unwrap(np.arctan2(away[:, 1], away[:, 0])), np.deg2rad(float(spec["step_deg"]))
    before = np.floor(angle / step) * step
    share = ((angle - before) / step)[:, None]
    corners = [np.stack([np.cos(a), np.sin(a)], axis=1) for a in (before, before + step, angle)]
    short = (1.0 - share) * corners[0] + share * corners[1] - corners[2]
    inward = np.hypot(*away.T)[:, None] * short
    state.x[first], state.x[second] = state.x[first] + inward[:, 0], state.x[second] + inward[:, 1]


def settling(state: RunState, spec: Spec) -> None:
    """A clamped axis creeps home after every step: q -= share.step.exp(-(t - t_step)/time_constant_s), share in 1e-6."""
    name = spec["axis"]
    step = np.diff(state.x[name], prepend=state.x[name][:1])
    moved = np.flatnonzero(np.abs(step) > 1e-9)
    left = np.zeros(len(step))
    for row in moved:
        late = state.t - state.t[row]
        left += np.where(late >= 0.0, step[row] * np.exp(-np.maximum(late, 0.0) / float(spec["time_constant_s"])), 0.0)
    state.x[name] = state.x[name] - 1e-6 * float(spec["share"]) * left


def cold_friction(state: RunState, spec: Spec) -> None:
    """Viscous friction of cold grease falls with time: viscous.(1 + excess.exp(-start/time_constant_s)), run by run."""
    name = spec["axis"]
    drive = state.drives[name]
    cold = float(np.exp(-state.clock[0] / float(spec["time_constant_s"])))
    state.drives[name] = replace(drive, viscous=drive.viscous * (1.0 + float(spec["excess"]) * cold))


def cover_plates(state: RunState, spec: Spec) -> None:
    """Plates of a telescopic cover engage one after the other as an axis moves off: a push of `amplitude` along `direction` for
    every `plate` mm or degree since the reversal, at most `plates` of them."""
    name = spec["axis"]
    sign = state.approach(name)
    unit = np.pi / 180.0 if state.axis(name).rotary else 1.0
    engaged = np.minimum(
        np.floor(since_reversal(state.x[name], sign) / (float(spec["plate"]) * unit)), float(spec["plates"])
    )
    state.shift_tool(spec["direction"], float(spec["amplitude"]) * sign * engaged)


def position_cross_talk(state: RunState, spec: Spec) -> None:
    """A carriage off centre on its beam: `amplitude` um per m/s^2 of `axis` and 100 mm of `place`, along `direction`."""
    push = 1e-3 * state.a[spec["axis"]] * state.x[spec["place"]] / 100.0
    state.shift_tool(spec["direction"], float(spec["amplitude"]) * push)


def roller_ripple(state: RunState, spec: Spec) -> None:
    """Rollers enter and leave a guide: `component` += amplitude.sin(2.pi.q/pitch + phase), sideways."""
    angle = 2.0 * np.pi * state.coordinate(spec["component"][2:]) / float(spec["pitch"]) + float(spec["phase"])
    state.add_motion(spec["component"], float(spec["amplitude"]) * np.sin(angle))


def bed_bending(state: RunState, spec: Spec) -> None:
    """A bed bends under two carriages: `component` += amplitude.p.q^2 over both of `axes`, in 100 mm."""
    p, q = (state.x[name] / 100.0 for name in spec["axes"])
    state.add_motion(spec["component"], float(spec["amplitude"]) * p * q**2)


def jerk_yield(state: RunState, spec: Spec) -> None:
    """A column that yields to the rate of force: `amplitude` um per m/s^3 of `axis` along `direction`."""
    state.shift_tool(spec["direction"], 1e-3 * float(spec["amplitude"]) * np.gradient(state.a[spec["axis"]], state.t))


def imbalance(state: RunState, spec: Spec) -> None:
    """An unbalanced table: amplitude.(speed/10 degree/s)^2 outward, turning with the `axis`."""
    name = spec["axis"]
    angle = state.axis(name).side * state.x[name] + float(spec["phase"])
    size = float(spec["amplitude"]) * (_unit_speed(state, name) / 10.0) ** 2
    state.shift_tool([1.0, 0.0, 0.0], size * np.cos(angle))
    state.shift_tool([0.0, 1.0, 0.0], size * np.sin(angle))


def gantry_lag(state: RunState, spec: Spec) -> None:
    """Two motors of one gantry lag unlike: `component` (a yaw) += amplitude urad per 10 mm/s of its axis."""
    state.add_motion(spec["component"], 0.1 * float(spec["amplitude"]) * state.v[spec["component"][2:]])


def resonant_cogging(state: RunState, spec: Spec) -> None:
    """A motor's cogging shakes a frame that resonates at one speed: amplitude.gain(|v|/pitch).sin(2.pi.q/pitch + phase)."""
    name, pitch = spec["axis"], float(spec["pitch"])
    ratio = np.abs(_unit_speed(state, name)) / (pitch * float(spec["frequency_hz"]))
    gain = ((1.0 - ratio**2) ** 2 + (2.0 * float(spec["damping"]) * ratio) ** 2) ** -0.5
    wave = np.sin(2.0 * np.pi * state.coordinate(name) / pitch + float(spec["phase"]))
    state.shift_tool(spec["direction"], float(spec["amplitude"]) * gain * wave)


def table_growth(state: RunState, spec: Spec) -> None:
    """A warm table grows about its axis: the artefact goes outward by `amplitude` um per 100 mm, with the campaign's time."""
    outward = np.asarray(state.table_ball) * [1.0, 1.0, 0.0] / 100.0
    state.table_ball = state.table_ball + UM * float(spec["amplitude"]) * _warmed(state, spec)[:, None] * outward


def yaw_drift(state: RunState, spec: Spec) -> None:
    """Sun on one side of a bed: `component` (a turn of a carriage, urad) grows with the campaign's time."""
    state.add_motion(spec["component"], float(spec["amplitude"]) * _warmed(state, spec))


def taut_hose(state: RunState, spec: Spec) -> None:
    """A hose fixed at `anchor` (mm of the `axes`) pulls the tool towards it by `amplitude` um per 10 mm beyond its length
    `free`."""
    away = np.stack([state.x[name] for name in spec["axes"]], axis=1) - np.asarray(spec["anchor"], float)
    reach = np.linalg.norm(away, axis=1)
    pull = float(spec["amplitude"]) * np.maximum(reach - float(spec["free"]), 0.0) / 10.0
    for i, name in enumerate(spec["axes"]):
        state.shift_tool(state.axis(name).direction, -pull * away[:, i] / reach)


def ball_form(state: RunState, spec: Spec) -> None:
    """The table's ball is no sphere: the bar reads amplitude.cos(order.azimuth + phase).cos(elevation)^order of where it
    touches."""
    bar = ball(state) - state.table_ball
    azimuth, flat = np.arctan2(bar[:, 1], bar[:, 0]), np.hypot(bar[:, 0], bar[:, 1]) / np.linalg.norm(bar, axis=1)
    order = int(spec["order"])
    state.length = state.length - UM * float(spec["amplitude"]) * flat**order * np.cos(
        order * azimuth + float(spec["phase"])
    )


def probe_product(state: RunState, spec: Spec) -> None:
    """Flat probes on a tilted ball: each of three reads its own displacement + curvature (1/um) times the other two's product."""
    state.sensor.append({"form": "product", "curvature": float(spec["curvature"])})
