"""Readings of FORMATS.md section 2 and what the instrument itself does to them: gain, lag,
delay, resolution.
"""

from collections.abc import Sequence

import numpy as np

from .behind import play
from .chain import Array, axis_transform, ball_in_workpiece, location
from .state import RunState, Spec

COLUMNS = {
    "ball_bar": ("dL_um",),
    "r_test": ("dx_um", "dy_um", "dz_um"),
    "touch_probe": ("X_dev_um", "Y_dev_um", "Z_dev_um"),
    "grid_encoder": ("du_um", "dv_um"),
}
"""Reading columns of each instrument; `encoder` adds one column per driven axis."""


def ball(state: RunState) -> Array:
    """Tool ball in the workpiece frame, (N, 3) mm, with everything the state holds."""
    return ball_in_workpiece(state.chain, state.x, state.tool_ball, state.location, state.motion, state.tool_shift)


def true_reading(state: RunState, instrument: str, run: Spec) -> Array:
    """Reading without the instrument's own faults and without its zero, (N, k) um."""
    d = ball(state)
    if instrument == "ball_bar":
        return 1e3 * (np.linalg.norm(d - state.table_ball, axis=1) - state.length)[:, None]
    if instrument == "r_test" and run.get("frame", "workpiece") != "workpiece":
        return 1e3 * head_reading(state, run["frame"]) * (-1.0 if run.get("sense") == "table-tool" else 1.0)
    if instrument == "r_test":
        return 1e3 * (d - state.table_ball)
    if instrument == "grid_encoder":
        # The plate is bolted on the table: its set-up shift moves it like the other artefacts.
        moved = d - (state.table_ball - np.asarray(run.get("table_ball", (0.0, 0.0, 0.0)), float))
        return 1e3 * np.stack([moved @ np.asarray(run["u"], float), moved @ np.asarray(run["v"], float)], axis=1)
    raise ValueError(f"the plant has no instrument {instrument!r}")


def head_reading(state: RunState, frame: str) -> Array:
    """Both balls in the machine frame by the chains: tool minus table there, or in the tool's axes, (N, 3) mm."""
    ends, turns = [], []
    for side, point in ((state.chain.workpiece, state.table_ball), (state.chain.tool, state.tool_ball)):
        at, turn = np.broadcast_to(point, (len(state.t), 3)), np.broadcast_to(np.eye(3), (len(state.t), 3, 3))
        for axis in reversed(side):
            place, motion = location(axis, state.location), state.motion.get(axis.name)
            rotation, shift = axis_transform(axis, state.x[axis.name], place, motion)
            at, turn = (rotation @ at[:, :, None])[:, :, 0] + shift, rotation @ turn
        ends.append(at)
        turns.append(turn)
    away = ends[1] + state.tool_shift - ends[0]
    return np.asarray(np.einsum("nji,nj->ni", turns[1], away) if frame == "tool" else away)


def columns(instrument: str | Sequence[str], driven: Sequence[str]) -> list[str]:
    """Names of the reading columns; `driven` are the encoder columns such as ``X_act_mm``."""
    kinds = [instrument] if isinstance(instrument, str) else list(instrument)
    return [c for kind in kinds for c in (driven if kind == "encoder" else COLUMNS[kind])]


def measured(state: RunState, reading: Array, zero: Array) -> Array:
    """Reading after gain and cross matrix, low-pass, latency and zero, (N, k) um."""
    y = reading @ state.gain[: reading.shape[1], : reading.shape[1]].T
    for spec in state.sensor:
        y = curved(y, spec)
    if state.low_pass_hz > 0.0:
        y = low_pass(y, state.dt, state.low_pass_hz)
    if np.any(state.delay_s):
        y = np.stack([np.interp(state.t - state.delay_s, state.t, c) for c in y.T], axis=1)
    return y + zero


def low_pass(y: Array, dt: float, cutoff_hz: float) -> Array:
    """First order, 1/(1 + s/w), exact for a reading linear between instants, at rest before the first, (N,
    k).
    """
    w = 2.0 * np.pi * cutoff_hz
    keep = np.exp(-w * dt)
    new = 1.0 - (1.0 - keep) / (w * dt)
    old = (1.0 - keep) / (w * dt) - keep
    out = np.empty_like(y)
    out[0] = z = y[0]
    for k in range(1, len(y)):
        z = keep * z + new * y[k] + old * y[k - 1]
        out[k] = z
    return out


def curved(y: Array, spec: Spec) -> Array:
    """Non-linear sensor: ``quadratic`` y + curvature.y^2 (1/um), ``product`` y + curvature times the product of the other two
    columns, ``cubic`` y + curvature.y^3 (1/um^2), ``offset`` y + `offset` (N, k), ``hysteresis`` y - width/2.sgn(dy) with
    a play of `width` um.
    """
    if spec["form"] == "quadratic":
        return y + float(spec["curvature"]) * y**2
    if spec["form"] == "product":
        return y + float(spec["curvature"]) * np.roll(y, 1, axis=1) * np.roll(y, 2, axis=1)
    if spec["form"] == "cubic":
        return y + float(spec["curvature"]) * y**3
    if spec["form"] == "offset":
        return y + np.asarray(spec["offset"], float)
    return np.stack([play(c, float(spec["width"]), c[0]) for c in y.T], axis=1)


def sensor_error(state: RunState, spec: Spec) -> None:
    """`gain` (scalar or one per direction) or `matrix` (k, k); forms ``linear``, ``quadratic``,
    ``hysteresis``.
    """
    if "matrix" in spec:
        matrix = np.asarray(spec["matrix"], float)
        full = np.eye(3)
        full[: len(matrix), : len(matrix)] = matrix
        state.gain = full @ state.gain
    elif "gain" in spec:
        state.gain = np.diag(np.broadcast_to(np.asarray(spec["gain"], float), (3,))) @ state.gain
    if spec.get("form", "linear") != "linear":
        state.sensor.append(spec)


def latency(state: RunState, spec: Spec) -> None:
    """y(t) = y_true(t - delay_ms); form ``low_pass`` instead filters with `cutoff_hz`."""
    if spec.get("form", "delay") == "low_pass":
        state.low_pass_hz = float(spec["cutoff_hz"])
    else:
        state.delay_s += 1e-3 * float(spec["delay_ms"])
