"""Effects in and behind the drive of one axis: play, gears, screws, table steps, servo loops, friction.

`form` picks the shape; the first named in a docstring is the textbook one.  Stages: ``drive`` functions
change the
drive's constants before the motion is computed, ``axis`` functions change the coordinate behind it.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from .chain import Array
from .drives import Friction, TwoMass
from .state import RunState, Spec, since_reversal


def play(x: ArrayLike, width: ArrayLike, start: float) -> Array:
    """Play operator y_k = min(max(y_{k-1}, x_k - b/2), x_k + b/2): the output lags, b (N,) or scalar is the
    total width.
    """
    x = np.asarray(x, float)
    half = np.broadcast_to(np.asarray(width, float) / 2.0, x.shape)
    low, high = (x - half).tolist(), (x + half).tolist()
    out, y = [], float(start)
    for a, b in zip(low, high, strict=True):
        y = min(max(y, a), b)
        out.append(y)
    return np.array(out)


def dahl(x: ArrayLike, distance: float, start: float) -> Array:
    """Pre-sliding state w in -1..1 with dw = (sgn(dx) - w).|dx|/distance, exact for piecewise monotone x,
    (N,).
    """
    step = np.diff(np.asarray(x, float), prepend=np.asarray(x, float)[:1])
    keep, sign = np.exp(-np.abs(step) / distance).tolist(), np.sign(step).tolist()
    out, w = [], float(start)
    for k, s in zip(keep, sign, strict=True):
        w = s + (w - s) * k
        out.append(w)
    return np.array(out)


def hysteresis(state: RunState, name: str, spec: Spec) -> Array:
    """Lag state in -1..1 of an axis: ``hard`` (a narrow play), ``presliding`` (Dahl, `distance` um or urad).

    Static runs count the first row as approached like the second; dynamic runs begin at `start` in -1..1.
    """
    start = float(spec.get("start", 0.0)) if state.dynamic else float(state.approach(name)[0])
    x = state.x[name]
    if spec.get("form", "hard") == "presliding":
        return dahl(x, float(spec.get("distance", 50.0)) * state.small(name), start)
    width = float(spec["width"]) * state.small(name)
    return (x - play(x, width, x[0] - start * width / 2.0)) / (width / 2.0)


def backlash(state: RunState, spec: Spec) -> None:
    """`width`: q -= width/2.w.  Forms ``hard``, ``presliding`` (`distance`), ``wind_up`` (`slope`: width per
    mm or degree).
    """
    name = spec["axis"]
    small, x = state.small(name), state.x[name]
    if spec.get("form", "hard") == "wind_up":
        width = small * np.maximum(float(spec["width"]) + float(spec["slope"]) * state.coordinate(name), 0.0)
        sign = float(spec.get("start", 0.0)) if state.dynamic else state.approach(name)[0]
        state.x[name] = play(x, width, x[0] - sign * width[0] / 2.0)
    else:
        state.x[name] = x - float(spec["width"]) / 2.0 * small * hysteresis(state, name, spec)


def transmission_error(state: RunState, spec: Spec) -> None:
    """q += amplitude.sin(2.pi.q/period + phase); ``sine``, ``harmonics`` ([[order, amplitude, phase], …]),
    ``sawtooth``.
    """
    name, form = spec["axis"], spec.get("form", "sine")
    angle = 2.0 * np.pi * state.coordinate(name) / float(spec["period"]) + float(spec.get("phase", 0.0))
    if form == "sawtooth":
        error = float(spec["amplitude"]) * 2.0 * (angle / (2.0 * np.pi) - np.floor(angle / (2.0 * np.pi) + 0.5))
    else:
        error = float(spec.get("amplitude", 0.0)) * np.sin(angle)
        for order, amplitude, phase in spec.get("harmonics", []) if form == "harmonics" else []:
            error = error + amplitude * np.sin(order * angle + phase)
    state.x[name] = state.x[name] + state.small(name) * error


def scale_error(state: RunState, spec: Spec) -> None:
    """q += ppm.1e-6.q; forms ``linear``, ``growing`` (times 1 - exp(-clock/time_constant_s)), ``about`` (zero
    at `at` mm).
    """
    q = state.coordinate(spec["axis"]) - float(spec.get("at", 0.0))
    grow = 1.0
    if spec.get("form", "linear") == "growing":
        grow = 1.0 - np.exp(-state.clock / float(spec["time_constant_s"]))
    small = state.small(spec["axis"]) if state.axis(spec["axis"]).rotary else 1e-6
    state.x[spec["axis"]] = state.x[spec["axis"]] + float(spec["ppm"]) * small * q * grow


def servo_mismatch(state: RunState, spec: Spec) -> None:
    """Real loop constants (absolute values); form ``delay``: the command reaches the loop `delay_ms` late."""
    name = spec["axis"]
    changed = {
        k: float(spec[k])
        for k in ("position_gain", "velocity_gain", "integral_time", "viscous", "feedforward")
        if k in spec
    }
    state.drives[name] = replace(state.drives[name], **changed)
    if spec.get("form", "gains") == "delay":
        state.command[name] = np.interp(state.t - 1e-3 * float(spec["delay_ms"]), state.t, state.command[name])


def friction(state: RunState, spec: Spec) -> None:
    """`coulomb` (mm/s^2 or rad/s^2).  Forms ``coulomb``, ``stribeck`` (`breakaway`, `stribeck_speed`),
    ``lugre`` (`stiffness`, `damping`).
    """
    keys = {
        "coulomb": ("coulomb", "asymmetry"),
        "stribeck": ("coulomb", "breakaway", "stribeck_speed", "asymmetry"),
        "lugre": ("coulomb", "breakaway", "stribeck_speed", "stiffness", "damping", "asymmetry"),
    }[spec.get("form", "coulomb")]
    rub = Friction(**{k: float(spec[k]) for k in keys if k in spec})
    state.drives[spec["axis"]] = replace(state.drives[spec["axis"]], friction=rub)


def two_mass_screw(state: RunState, spec: Spec) -> None:
    """Outside the vocabulary: the load hangs on the motor by a spring, `frequency_hz`, `damping`, `ratio` of
    inertias.
    """
    screw = TwoMass(float(spec["frequency_hz"]), float(spec.get("damping", 0.05)), float(spec.get("ratio", 0.0)))
    state.drives[spec["axis"]] = replace(state.drives[spec["axis"]], two_mass=screw)


def compensation_table_step(state: RunState, spec: Spec) -> None:
    """Outside: wrong node of a compensation table, q += step at `at` (mm or degree) over `ramp`; forms
    ``step``, ``dent``.
    """
    name = spec["axis"]
    u = (state.coordinate(name) - float(spec["at"])) / max(float(spec.get("ramp", 1e-3)), 1e-9)
    shape = np.clip(1.0 - np.abs(u), 0.0, 1.0) if spec.get("form", "step") == "dent" else np.clip(u, 0.0, 1.0)
    state.x[name] = state.x[name] + float(spec["step"]) * state.small(name) * shape


def counterbalance(state: RunState, spec: Spec) -> None:
    """Outside: Z lags only in one direction, q -= amplitude.(1 + slope.q).(1 + s)/2 (`slope` per mm), as a
    weak counterbalance does.
    """
    name = spec["axis"]
    lag = float(spec["amplitude"]) * (1.0 + float(spec.get("slope", 0.0)) * state.coordinate(name))
    up = (
        1.0 + dahl(state.x[name], float(spec.get("distance", 20.0)) * state.small(name), state.approach(name)[0])
    ) / 2.0
    state.x[name] = state.x[name] - state.small(name) * lag * up


def stick_slip_teeth(state: RunState, spec: Spec) -> None:
    """Outside: decaying teeth after a reversal below `speed` (mm/s or degree/s): q -=
    s.amplitude.frac(xi/pitch).exp(-xi/decay).
    """
    name = spec["axis"]
    sign = state.approach(name)
    unit = np.pi / 180.0 if state.axis(name).rotary else 1.0
    xi = since_reversal(state.x[name], sign)
    speed = np.abs(np.gradient(state.x[name], state.t))
    tooth = np.mod(xi / (float(spec["pitch"]) * unit), 1.0) * np.exp(-xi / (float(spec["decay"]) * unit))
    slow = speed < float(spec.get("speed", np.inf)) * unit
    state.x[name] = state.x[name] - sign * state.small(name) * float(spec["amplitude"]) * tooth * slow


def reversal_pulse(state: RunState, spec: Spec) -> None:
    """Outside: a friction-compensation pulse that comes too late, q += s.amplitude.exp(-((t - t_rev -
    delay)/width)^2).
    """
    name = spec["axis"]
    sign = state.approach(name)
    position = state.x[name].copy()
    for k in np.flatnonzero(np.diff(sign) != 0.0):
        start = state.t[k]
        if 0 < k < len(position) - 1:  # between the rows: the vertex of the parabola through three of them
            before, after = np.diff(position[k - 1 : k + 2]) / np.diff(state.t[k - 1 : k + 2])
            if before != after and before != 0.0:
                start = 0.5 * (state.t[k - 1] + state.t[k]) + 0.5 * (state.t[k + 1] - state.t[k - 1]) * before / (
                    before - after
                )
        u = (state.t - start - 1e-3 * float(spec["delay_ms"])) / (1e-3 * float(spec["width_ms"]))
        state.x[name] = state.x[name] + sign[k + 1] * float(spec["amplitude"]) * state.small(name) * np.exp(-(u**2))
