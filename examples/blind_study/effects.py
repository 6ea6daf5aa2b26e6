"""Random effects of random form and size for a setting, as the plant's plain data; nothing of symfive.

A draft is a function of one factor that scales what the effect does; the study then chooses the factor so that the
effect has the size it wants.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .plans import Random, Setting

Spec = dict[str, Any]
Make = Callable[[float], Spec]
Drawer = Callable[[Random, Setting], "Draft | None"]
Table = tuple[tuple[Drawer, float], ...]

RELATIVES = {
    "counterbalance": "backlash",
    "compensation_table_step": "error_motion",
    "eccentric_mass": "error_motion",
    "bar_temperature": "thermal_drift",
    "reversal_pulse": "friction",
}
"""Effects of the plant without a word of their own in the vocabulary, and the nearest word."""
INSTRUMENT = ("sensor_error", "latency", "setup_shift", "bar_temperature")
"""Effects that are not the machine's."""


@dataclass(frozen=True)
class Draft:
    """`make` factor -> the plant's effect."""

    make: Make

    @property
    def spec(self) -> Spec:
        """The effect at factor 1."""
        return self.make(1.0)


def name_of(spec: Spec) -> tuple[str, str | None]:
    """Word of the vocabulary and axis under which a finding would be right."""
    word = RELATIVES.get(spec["effect"], spec["effect"])
    if word in ("thermal_drift", "setup_shift", "sensor_error", "latency", "vibration"):
        return word, None
    component = spec.get("component", "")
    if word == "location_error":
        return word, component[3:]
    return word, spec.get("axis") or component[2:]


def _pick(rng: Random, values: Any) -> Any:
    return values[int(rng.integers(len(values)))]


def _unit(rng: Random) -> list[float]:
    v = rng.normal(size=3)
    return np.round(v / np.linalg.norm(v), 3).tolist()


def _rotary(setting: Setting, moving: bool = True) -> list[str]:
    return [a for a in (setting.moving() if moving else setting.machine["axes"]) if a in "ABC"]


def _linear(setting: Setting) -> list[str]:
    return [a for a in setting.moving() if a in "XYZ"]


def _driven(setting: Setting) -> list[str]:
    return [a for a, table in setting.machine["axes"].items() if "drive" in table]


def _size(axis: str, um: float, urad: float) -> float:
    return urad if axis in "ABC" else um


def backlash(rng: Random, setting: Setting) -> Draft:
    """Play, with a hard, a pre-sliding or a growing form."""
    axis = _pick(rng, setting.moving())
    low, high = setting.reach(axis)
    form, width = str(rng.choice(["hard", "presliding", "wind_up"], p=[0.5, 0.3, 0.2])), _size(axis, 6.0, 60.0)
    share = rng.uniform(0.3, 0.8) / max(abs(low), abs(high)) * _pick(rng, [-1.0, 1.0])
    distance = _size(axis, rng.uniform(30.0, 300.0), rng.uniform(60.0, 600.0))

    def make(a: float) -> Spec:
        spec: Spec = {"effect": "backlash", "axis": axis, "width": a * width, "form": form}
        if form == "presliding":
            spec["distance"] = distance
        if form == "wind_up":
            spec["slope"] = a * width * share
        return spec

    return Draft(make)


def transmission(rng: Random, setting: Setting) -> Draft | None:
    """Periodic error of a worm, a screw or an encoder; at poses at rest only periods that the grid can see."""
    axes = [a for a in (_driven(setting) if setting.dynamic else _rotary(setting)) if a != "A" and a != "B"]
    if not axes:
        return None
    axis = _pick(rng, axes)
    if not setting.dynamic:
        period = 360.0 / float(_pick(rng, [4.0, 4.5, 5.0]))
    else:
        period = 360.0 / float(rng.integers(60, 180)) if axis == "C" else float(_pick(rng, [4.0, 5.0, 8.0, 10.0, 12.0]))
    form = str(rng.choice(["sine", "harmonics", "sawtooth"], p=[0.6, 0.3, 0.1])) if setting.dynamic else "sine"
    size, phase, second = _size(axis, 2.0, 30.0), float(rng.uniform(0.0, 6.28)), float(rng.uniform(0.0, 6.28))

    def make(a: float) -> Spec:
        spec: Spec = {
            "effect": "transmission_error",
            "axis": axis,
            "period": period,
            "amplitude": a * size,
            "phase": phase,
        }
        if form != "sine":
            spec["form"] = form
        if form == "harmonics":
            spec["harmonics"] = [[2, 0.4 * a * size, second]]
        return spec

    return Draft(make)


def scale(rng: Random, setting: Setting) -> Draft | None:
    """Positioning error growing with travel."""
    axes = [a for a in _linear(setting) if f"E{a}{a}" not in setting.machine["errors"]]
    if not axes:
        return None
    axis, sign = _pick(rng, axes), _pick(rng, [-1.0, 1.0])
    return Draft(lambda a: {"effect": "scale_error", "axis": axis, "ppm": 30.0 * a * sign})


def location(rng: Random, setting: Setting) -> Draft | None:
    """A squareness of the linear axes that the baseline holds at zero."""
    names = [n for n in ("EC0X", "EC0Y", "EA0Y", "EB0X", "EA0Z", "EB0Z") if n not in setting.machine["errors"]]
    names = [n for n in names if n[3] in _linear(setting)]
    if not names:
        return None
    name, sign = _pick(rng, names), _pick(rng, [-1.0, 1.0])
    return Draft(lambda a: {"effect": "location_error", "component": name, "value": 30.0 * a * sign})


def motion(rng: Random, setting: Setting) -> Draft | None:
    """Error motion of one component: harmonics of a turning axis, a polynomial or one place of a travel."""
    axis = _pick(rng, setting.moving())
    letters = [c for c in "XYZABC" if not (axis in "XYZ" and c == axis) and not (axis in "ABC" and c == axis)]
    component = f"E{_pick(rng, letters)}{axis}"
    if component in setting.machine["errors"]:
        return None
    low, high = setting.reach(axis)
    travel = setting.machine["axes"][axis]["travel"][1]
    size = 20.0 if component[1] in "ABC" else 4.0
    base: Spec = {"effect": "error_motion", "component": component}
    if axis in "ABC" and high - low > 200.0:
        order, phase = int(_pick(rng, [2, 3])), rng.uniform(0.0, 6.28)
        return Draft(lambda a: {**base, "harmonics": [[order, a * size * np.cos(phase), a * size * np.sin(phase)]]})
    reach = max(abs(low), abs(high)) / travel
    c = rng.normal(0.0, 1.0, 3) * [0.3, 1.0, 0.7] / reach ** np.arange(1, 4)
    return Draft(lambda a: {**base, "coefficients": (a * size * c).tolist()})


def sag(rng: Random, setting: Setting) -> Draft | None:
    """Sag of what a tilting axis carries: textbook sine, 1 - cosine, with two branches, stiffening."""
    tilts = [a for a in _rotary(setting) if a in "AB"]
    if not tilts:
        return None
    axis = tilts[0]
    component = f"E{_pick(rng, 'XYZABC')}{axis}"
    if component in setting.machine["errors"]:
        return None
    form = str(rng.choice(["sin", "one_minus_cos", "hysteresis", "stiffening"], p=[0.3, 0.4, 0.15, 0.15]))
    size = (20.0 if component[1] in "ABC" else 8.0) * _pick(rng, [-1.0, 1.0])
    return Draft(
        lambda a: {"effect": "gravity_sag", "axis": axis, "component": component, "amplitude": a * size, "form": form}
    )


def drift(rng: Random, setting: Setting) -> Draft:
    """The tool drifts against the table: one or two time constants, a ramp, or heat that comes late."""
    end, way = setting.duration(), _unit(rng)
    form = str(rng.choice(["single", "two", "ramp", "onset"], p=[0.5, 0.2, 0.15, 0.15]))
    more = {
        "two": {"time_constant2_s": 1.5 * end, "share": 0.5},
        "onset": {"onset_s": float(rng.uniform(0.1, 0.5) * end)},
    }
    tau = float(rng.uniform(0.15, 0.6) * end)
    return Draft(
        lambda a: (
            {"effect": "thermal_drift", "direction": way, "amplitude": 8.0 * a, "time_constant_s": tau, "form": form}
            | more.get(form, {})
        )
    )


def lateral(rng: Random, setting: Setting) -> Draft:
    """The carriage moves sideways when it reverses, at once or over some distance."""
    axis = _pick(rng, setting.moving())
    letter = _pick(rng, [c for c in "XYZABC" if c != axis])
    form, size = str(rng.choice(["hard", "presliding"], p=[0.6, 0.4])), 20.0 if letter in "ABC" else 5.0
    base = {"effect": "lateral_play", "component": f"E{letter}{axis}"}
    base |= {} if form == "hard" else {"form": form, "distance": _size(axis, 100.0, 300.0)}
    return Draft(lambda a: {**base, "width": a * size})


def servo(rng: Random, setting: Setting) -> Draft | None:
    """A loop that differs from the machine file: its gains, its feed-forward, or a late command."""
    if not setting.dynamic or not _driven(setting):
        return None
    axis = _pick(rng, _driven(setting))
    table = setting.machine["axes"][axis]["drive"]
    what, sign = (
        str(rng.choice(["position_gain", "velocity_gain", "feedforward", "delay"], p=[0.5, 0.15, 0.2, 0.15])),
        _pick(rng, [-1, 1]),
    )

    def make(a: float) -> Spec:
        spec: Spec = {"effect": "servo_mismatch", "axis": axis}
        if what == "delay":
            return {**spec, "form": "delay", "delay_ms": 0.5 * a}
        if what == "feedforward":
            return {**spec, what: 0.02 * a}
        return {**spec, what: table[what] * float(np.exp(np.clip(0.02 * a * sign, -1.0, 1.0)))}

    return Draft(make)


def friction(rng: Random, setting: Setting) -> Draft | None:
    """Coulomb, Stribeck or LuGre friction inside the loop."""
    if not setting.dynamic or not _driven(setting):
        return None
    axis = _pick(rng, _driven(setting))
    form = str(rng.choice(["coulomb", "stribeck", "lugre"], p=[0.4, 0.35, 0.25]))
    size, over = _size(axis, 100.0, 1.0), rng.uniform(1.2, 1.6)

    def make(a: float) -> Spec:
        spec: Spec = {"effect": "friction", "axis": axis, "coulomb": a * size, "form": form}
        if form != "coulomb":
            spec |= {"breakaway": over * a * size, "stribeck_speed": _size(axis, 2.0, 0.02)}
        if form == "lugre":
            spec |= {"stiffness": 1e5, "damping": 300.0}
        return spec

    return Draft(make)


def vibration(rng: Random, setting: Setting) -> Draft | None:
    """A tone, a beat or a wandering tone that the motion does not cause."""
    if not setting.dynamic:
        return None
    nyquist = 0.5 / float(setting.fit[0]["t_s"][1] - setting.fit[0]["t_s"][0])
    form, hertz, way = (
        str(rng.choice(["tone", "beat"], p=[0.75, 0.25])),
        float(rng.uniform(0.25, 0.8) * nyquist),
        _unit(rng),
    )
    base = {
        "effect": "vibration",
        "frequency_hz": hertz,
        "direction": way,
        "form": form,
        "phase": float(rng.uniform(0, 6.28)),
    }
    base |= {"beat_hz": float(rng.uniform(0.02, 0.05))} if form == "beat" else {}
    return Draft(lambda a: {**base, "amplitude": 1.0 * a})


def compliance(rng: Random, setting: Setting) -> Draft | None:
    """Deflection proportional to an axis' acceleration, or softening."""
    if not setting.dynamic:
        return None
    axis = _pick(rng, setting.moving())
    form, way, size = str(rng.choice(["linear", "softening"], p=[0.7, 0.3])), _unit(rng), _size(axis, 20.0, 4.0)
    base = {"effect": "inertial_compliance", "axis": axis, "direction": way}
    base |= {"form": form, "limit": _size(axis, 0.02, 0.3)} if form == "softening" else {}
    return Draft(lambda a: {**base, "compliance": a * size})


def _carriers(setting: Setting, axis: str) -> list[str]:
    """The axes between the bed and an axis."""
    names = [word.rstrip("'") for word in setting.machine["structure"].split()]
    near, far = sorted((names.index("b"), names.index(axis)))
    return names[near + 1 : far]


def relative(rng: Random, setting: Setting) -> Draft | None:
    """A near relative: no word of its own in the vocabulary, but one for its kind."""
    linear = _linear(setting)
    turning = [a for a in _rotary(setting) if a == "C"]
    if turning and rng.random() < 0.4:
        phase = float(rng.uniform(0.0, 6.28))
        tilt = next((a for a in _rotary(setting) if a in _carriers(setting, "C")), None)
        base = {"effect": "eccentric_mass", "axis": "C", "phase": phase} | ({"tilt": tilt} if tilt else {})
        return (
            None
            if {"EAC", "EBC"} & set(setting.machine["errors"])
            else Draft(lambda a: {**base, "amplitude": 20.0 * a})
        )
    if not linear:
        return None
    axis = _pick(rng, linear)
    low, high = setting.reach(axis)
    if setting.dynamic and rng.random() < 0.5:
        base = {
            "effect": "reversal_pulse",
            "axis": axis,
            "delay_ms": float(rng.uniform(20, 60)),
            "width_ms": float(rng.uniform(30, 60)),
        }
        return Draft(lambda a: {**base, "amplitude": 5.0 * a})
    if axis == "Z":
        return Draft(lambda a: {"effect": "counterbalance", "axis": axis, "amplitude": 5.0 * a})
    base = {"effect": "compensation_table_step", "axis": axis, "at": float(rng.uniform(0.3, 0.7) * (high - low) + low)}
    return Draft(lambda a: {**base, "ramp": 2.0, "step": 6.0 * a})


MACHINE: Table = (
    (backlash, 2.0), (transmission, 1.5), (scale, 1.0), (location, 1.0), (motion, 2.0), (sag, 2.0), (drift, 1.5),
    (lateral, 1.5), (servo, 2.0), (friction, 1.5), (vibration, 1.0), (compliance, 1.0), (relative, 1.0),
)  # fmt: skip
"""Effects of the machine and how often they are drawn."""


def draw(rng: Random, setting: Setting, table: Table) -> Draft | None:
    """One effect that this setting can have; None of a table of one where it cannot."""
    if len(table) == 1:
        return table[0][0](rng, setting)
    weights = np.array([w for _, w in table])
    while True:
        drawer = table[int(rng.choice(len(table), p=weights / weights.sum()))][0]
        draft = drawer(rng, setting)
        if draft is not None:
            return draft
