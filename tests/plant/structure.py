"""Effects of the structure between the axes: error motions, gravity, heat, play sideways,
inertia, resonance.
"""

from collections.abc import Callable

import numpy as np

from .behind import dahl, hysteresis
from .chain import Array
from .drives import transition
from .state import UM, URAD, RunState, Spec


def error_motion_value(state: RunState, component: str, spec: Spec | Callable[[Array], Array]) -> Array:
    """Error motion in um or urad over its axis' coordinate q (mm or degree), or over another axis (`over`).

    A callable gets q; `coefficients` c_k give sum c_k.(q/half travel)^k, k = 1…; `harmonics` [[k, cos, sin],
    …] give
    sum cos.cos(k.q) + sin.sin(k.q); form ``local``: `amplitude`.exp(-((q - at)/width)^2).
    """
    if callable(spec):
        return np.asarray(spec(state.coordinate(component[2:])), float)
    name = spec.get("over", component[2:])
    name = name if isinstance(name, str) else name[0]
    q = state.coordinate(name)
    value = np.zeros(len(q))
    for k, c in enumerate(spec.get("coefficients", []), start=1):
        value += c * (q / state.travel[name]) ** k
    turn = (
        np.deg2rad(q)
        if state.axis(name).rotary
        else 2.0 * np.pi * q / float(spec.get("period", 2.0 * state.travel[name]))
    )
    for k, c, s in spec.get("harmonics", []):
        value += c * np.cos(k * turn) + s * np.sin(k * turn)
    if spec.get("form") == "local":
        value += float(spec["amplitude"]) * np.exp(-(((q - float(spec["at"])) / float(spec["width"])) ** 2))
    return value


def error_motion(state: RunState, spec: Spec) -> None:
    """`component` with `coefficients`, `harmonics` or form ``local``; see error_motion_value."""
    state.add_motion(spec["component"], error_motion_value(state, spec["component"], spec))


def location_error(state: RunState, spec: Spec) -> None:
    """`component` (EY0C) += `value`; form ``drift``: times 1 - exp(-clock/time_constant_s)."""
    value = float(spec["value"]) * (URAD if spec["component"][1] in "ABC" else UM)
    grow = 1.0 - np.exp(-state.clock / float(spec["time_constant_s"])) if spec.get("form") == "drift" else 1.0
    state.location[spec["component"]] = state.location.get(spec["component"], 0.0) + value * np.asarray(grow)


def gravity_sag(state: RunState, spec: Spec) -> None:
    """`component` += amplitude.g(q) over the tilting `axis`: ``sin``, ``one_minus_cos``, ``hysteresis`` (sin,
    branches apart by
    `branch` of the amplitude), ``stiffening`` (sin.(1 - stiffening.sin^2)); `constant_cos` adds 1 - cos of
    another size."""
    name = spec["axis"]
    q, form = state.x[name], spec.get("form", "sin")
    s = np.sin(q)
    shape = {
        "sin": s,
        "one_minus_cos": 1.0 - np.cos(q),
        "stiffening": s * (1.0 - float(spec.get("stiffening", 0.3)) * s**2),
    }.get(form, s)
    if form == "hysteresis":
        start = state.approach(name)[0]
        shape = s - float(spec.get("branch", 0.2)) * dahl(q, np.deg2rad(float(spec.get("distance_deg", 10.0))), start)
    state.add_motion(
        spec["component"],
        float(spec["amplitude"]) * shape + float(spec.get("constant_cos", 0.0)) * (1.0 - np.cos(q)),
    )


def thermal_drift(state: RunState, spec: Spec) -> None:
    """amplitude.(1 - exp(-clock/tau)) along `direction`; ``single``, ``two`` (`share` with
    `time_constant2_s`), ``ramp`` (per
    time_constant_s), ``onset`` (the heat comes at `onset_s`)."""
    form, tau = spec.get("form", "single"), float(spec["time_constant_s"])
    heated = np.maximum(state.clock - float(spec.get("onset_s", 0.0)), 0.0)
    shape = heated / tau if form == "ramp" else 1.0 - np.exp(-heated / tau)
    if form == "two":
        share = float(spec.get("share", 0.5))
        shape = (1.0 - share) * shape + share * (1.0 - np.exp(-heated / float(spec["time_constant2_s"])))
    state.shift_tool(spec["direction"], float(spec["amplitude"]) * shape)


def setup_shift(state: RunState, spec: Spec) -> None:
    """The artefact (table ball or nest) moves by `shift` (3) um in the workpiece frame at `t_s` of `run`;
    ``step``, ``creep`` (`creep_s`).
    """
    if spec.get("run", state.run_id) != state.run_id:
        return
    late = state.t - float(spec["t_s"])
    share = np.where(late >= 0.0, 1.0, 0.0)
    if spec.get("form", "step") == "creep":
        share = share * (1.0 - np.exp(-np.maximum(late, 0.0) / float(spec["creep_s"])))
    state.table_ball = state.table_ball + UM * share[:, None] * np.asarray(spec["shift"], float)


def lateral_play(state: RunState, spec: Spec) -> None:
    """`component` (EYX) -= width/2.w with the axis' direction; ``hard`` (narrow play of `takeup` um),
    ``presliding`` (`distance`).
    """
    name = spec["component"][2:]
    lag = hysteresis(state, name, {**spec, "width": float(spec.get("takeup", 2.0))})
    state.add_motion(spec["component"], -float(spec["width"]) / 2.0 * lag)


def vibration(state: RunState, spec: Spec) -> None:
    """amplitude.sin(2.pi.f.clock + phase) along `direction`; ``tone``, ``beat`` (times cos of `beat_hz`),
    ``wandering`` (random phase walk).
    """
    phase = float(spec.get("phase", 0.0))
    form = spec.get("form", "tone")
    if form == "wandering":
        walk = state.rng.normal(0.0, float(spec.get("wander", 1.0)) * np.sqrt(state.dt), len(state.t))
        phase = phase + np.cumsum(walk)
    tone = np.sin(2.0 * np.pi * float(spec["frequency_hz"]) * state.clock + phase)
    if form == "beat":
        tone = tone * np.cos(2.0 * np.pi * float(spec["beat_hz"]) * state.clock)
    state.shift_tool(spec.get("direction", [1.0, 0.0, 0.0]), float(spec["amplitude"]) * tone)


def inertial_compliance(state: RunState, spec: Spec) -> None:
    """compliance.acceleration of `axis` along `direction`, um per m/s^2 or rad/s^2; ``linear``, ``softening``
    (tanh above `limit`).
    """
    a = state.a[spec["axis"]] * (1.0 if state.axis(spec["axis"]).rotary else 1e-3)
    if spec.get("form", "linear") == "softening":
        limit = float(spec["limit"])
        a = limit * np.tanh(a / limit)
    state.shift_tool(spec["direction"], float(spec["compliance"]) * a)


def structural_resonance(state: RunState, spec: Spec) -> None:
    """z'' + 2.zeta.w.z' + w^2.z = -participation.a of `axis`, z along `direction`; a rotary axis acts through
    `lever` mm.

    The acceleration is linear between instants, so the recursion is exact.  Form ``command``: the commanded
    acceleration excites it.
    """
    name = spec["axis"]
    w, zeta = 2.0 * np.pi * float(spec["frequency_hz"]), float(spec["damping"])
    source = state.a[name]
    if spec.get("form", "actual") == "command":
        source = np.gradient(np.gradient(state.command[name], state.t), state.t)
    force = (
        -float(spec.get("participation", 1.0))
        * source
        * (float(spec.get("lever", 100.0)) if state.axis(name).rotary else 1.0)
    )
    phi, gain = transition(
        np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]]),
        np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        state.dt,
    )
    slope = np.append(np.diff(force) / state.dt, 0.0)
    z, out = np.zeros(2), np.empty(len(force))
    drive = np.outer(force, gain[:, 0]) + np.outer(slope, gain[:, 1])
    for k in range(len(force)):
        out[k] = z[0]
        z = phi @ z + drive[k]
    state.shift_tool(spec["direction"], out / UM)


def eccentric_mass(state: RunState, spec: Spec) -> None:
    """Outside: a mass off the axis tilts the table, urad, turning with `axis`: EA = a.sin(s.q + phase), EB =
    -a.cos(s.q + phase), s = -1 where the axis carries the workpiece, times cos of the tilting axis `tilt` if one is
    named."""
    name = spec["axis"]
    angle = state.axis(name).side * state.x[name] + float(spec.get("phase", 0.0))
    size = float(spec["amplitude"]) * (np.cos(state.x[spec["tilt"]]) if "tilt" in spec else 1.0)
    state.add_motion(f"EA{name}", size * np.sin(angle))
    state.add_motion(f"EB{name}", -size * np.cos(angle))


def bar_temperature(state: RunState, spec: Spec) -> None:
    """Outside: the bar grows within each run, `amplitude` um.(1 - exp(-t/time_constant_s)), anew in every
    run.
    """
    state.length = state.length + UM * float(spec["amplitude"]) * (
        1.0 - np.exp(-state.t / float(spec["time_constant_s"]))
    )


def changeover_sector(state: RunState, spec: Spec) -> None:
    """Outside: master/slave changeover, the tool stands `amplitude` um aside while the first of `axes` is the
    faster.
    """
    first, second = (np.abs(np.gradient(state.x[n], state.t)) for n in spec["axes"])
    state.shift_tool(spec["direction"], float(spec["amplitude"]) * (first > second))


def shock(state: RunState, spec: Spec) -> None:
    """Outside: a blow on the machine, a decaying tone from `t_s` of the campaign's clock along
    `direction`.
    """
    late = np.maximum(state.clock - float(spec["t_s"]), 0.0)
    ring = np.sin(2.0 * np.pi * float(spec["frequency_hz"]) * late) * np.exp(-late / float(spec["decay_s"]))
    state.shift_tool(spec["direction"], float(spec["amplitude"]) * ring)


def speed_lift(state: RunState, spec: Spec) -> None:
    """Outside: oil film of a slideway lifts the carriage, amplitude.u/(1 + u) along `direction`, u =
    |speed|/`half_speed` (mm/s or degree/s).
    """
    unit = np.pi / 180.0 if state.axis(spec["axis"]).rotary else 1.0
    u = np.abs(state.v[spec["axis"]]) / (float(spec["half_speed"]) * unit)
    state.shift_tool(spec["direction"], float(spec["amplitude"]) * u / (1.0 + u))


def coolant_cycle(state: RunState, spec: Spec) -> None:
    """Outside: a chiller switching on and off, a triangle of `period_s` on the campaign's clock along
    `direction`, `rise` (0…1) of it rising.
    """
    share, rise = (
        np.mod(state.clock / float(spec["period_s"]) + float(spec.get("phase", 0.0)), 1.0),
        float(spec["rise"]),
    )
    triangle = np.where(share < rise, share / rise, (1.0 - share) / (1.0 - rise))
    state.shift_tool(spec["direction"], float(spec["amplitude"]) * (2.0 * triangle - 1.0))


def two_axis_motion(state: RunState, spec: Spec) -> None:
    """Outside: `component` += amplitude.sin(p).sin(`order`.q + phase) over both of `axes` (p, q): no sum of
    functions of one axis each.
    """
    p, q = (state.x[name] / (1.0 if state.axis(name).rotary else state.travel[name]) for name in spec["axes"])
    turning = np.sin(float(spec.get("order", 2)) * q + float(spec.get("phase", 0.0)))
    state.add_motion(spec["component"], float(spec["amplitude"]) * np.sin(p) * turning)
