"""Random faults of the instrument and the set-up, and effects that the vocabulary has no word for."""

from __future__ import annotations

from typing import Any

from .effects import Draft, Spec, Table, _linear, _pick, _rotary, _size, _unit
from .plans import Random, Setting


def gain(rng: Random, setting: Setting) -> Draft | None:
    """The instrument's gain, cross-sensitivity, or a hysteresis of its probes."""
    base: Spec = {"effect": "sensor_error"}
    if setting.kind == "r_test" and rng.random() < 0.5:
        cross = rng.normal(0.0, 0.01, (3, 3))
        return Draft(
            lambda a: {**base, "matrix": [[float(i == j) + a * float(cross[i, j]) for j in range(3)] for i in range(3)]}
        )
    return Draft(lambda a: {**base, "gain": 1.0 + 0.02 * a})


def late(rng: Random, setting: Setting) -> Draft | None:
    """The instrument's clock is late, or its filter slow."""
    if not setting.dynamic:
        return None
    if rng.random() < 0.7:
        return Draft(lambda a: {"effect": "latency", "delay_ms": 6.0 * a})
    return Draft(lambda a: {"effect": "latency", "form": "low_pass", "cutoff_hz": 12.0 / a})


def moved(rng: Random, setting: Setting) -> Draft:
    """The artefact slips within one run, at once or creeping."""
    run = _pick(rng, setting.fit)
    end, way = float(run["t_s"][-1]), _unit(rng)
    base: dict[str, Any] = {"effect": "setup_shift", "run": run["id"], "t_s": float(rng.uniform(0.25, 0.75) * end)}
    if rng.random() < 0.25:
        base |= {"form": "creep", "creep_s": 0.1 * end}
    return Draft(lambda a: {**base, "shift": [6.0 * a * c for c in way]})


def warm_bar(rng: Random, setting: Setting) -> Draft | None:
    """The bar grows anew in every run after a hand has held it."""
    if setting.fit[0]["instrument"] != "ball_bar":
        return None
    tau = float(rng.uniform(0.3, 1.0) * setting.fit[0]["t_s"][-1])
    return Draft(lambda a: {"effect": "bar_temperature", "amplitude": 3.0 * a, "time_constant_s": tau})


def shock(rng: Random, setting: Setting) -> Draft | None:
    """A blow on the machine that rings for some seconds."""
    if not setting.dynamic:
        return None
    run = _pick(rng, setting.fit)
    at = run["start_s"] + float(rng.uniform(0.2, 0.6) * run["t_s"][-1])
    base = {
        "effect": "shock",
        "t_s": at,
        "frequency_hz": float(rng.uniform(0.2, 1.5)),
        "decay_s": float(rng.uniform(4.0, 12.0)),
    }
    way = _unit(rng)
    return Draft(lambda a: {**base, "direction": way, "amplitude": 6.0 * a})


def lift(rng: Random, setting: Setting) -> Draft | None:
    """An oil film lifts a carriage with its speed."""
    if not setting.dynamic:
        return None
    axis, way = _pick(rng, _linear(setting) or setting.moving()), _unit(rng)
    return Draft(
        lambda a: {"effect": "speed_lift", "axis": axis, "half_speed": 6.0, "direction": way, "amplitude": 5.0 * a}
    )


def teeth(rng: Random, setting: Setting) -> Draft | None:
    """Stick-slip after every reversal: decaying teeth."""
    if not setting.dynamic:
        return None
    axis = _pick(rng, _linear(setting))
    base = {
        "effect": "stick_slip_teeth",
        "axis": axis,
        "pitch": float(rng.uniform(2.0, 5.0)),
        "decay": float(rng.uniform(15.0, 40.0)),
    }
    return Draft(lambda a: {**base, "amplitude": 6.0 * a})


def changeover(rng: Random, setting: Setting) -> Draft | None:
    """The tool stands aside while one axis is the faster one of two."""
    if setting.kind != "planar":
        return None
    way = _unit(rng)
    return Draft(lambda a: {"effect": "changeover_sector", "axes": ["X", "Y"], "direction": way, "amplitude": 3.0 * a})


def chiller(rng: Random, setting: Setting) -> Draft:
    """A chiller switches on and off: the tool goes to and fro in a triangle of time."""
    end, way = setting.duration(), _unit(rng)
    base = {
        "effect": "coolant_cycle",
        "period_s": float(rng.uniform(0.2, 0.45) * end),
        "rise": float(rng.uniform(0.2, 0.8)),
    }
    phase = float(rng.uniform(0.0, 1.0))
    return Draft(lambda a: {**base, "phase": phase, "direction": way, "amplitude": 4.0 * a})


def two_axes(rng: Random, setting: Setting) -> Draft | None:
    """An error motion over two axes that is no sum of functions of one each."""
    axes = _rotary(setting) if not setting.dynamic else setting.moving()[:2]
    if len(axes) < 2 or setting.kind == "planar":
        return None
    carrier = "C" if "C" in axes else axes[0]
    letter = _pick(rng, "XYZ")
    if f"E{letter}{carrier}" in setting.machine["errors"]:
        return None
    base = {
        "effect": "two_axis_motion",
        "axes": sorted(axes),
        "component": f"E{letter}{carrier}",
        "order": int(_pick(rng, [3, 2])),
    }
    phase = float(rng.uniform(0.0, 6.28))
    return Draft(lambda a: {**base, "phase": phase, "amplitude": a * _size("X", 5.0, 20.0)})


FAULTS: Table = ((gain, 1.0), (late, 1.5), (moved, 2.0), (warm_bar, 1.0))
"""Instrument and set-up."""
OUTSIDE: Table = (
    (shock, 1.0), (lift, 1.5), (teeth, 1.0), (changeover, 1.5), (chiller, 1.0), (two_axes, 2.0),
)  # fmt: skip
"""Physics for which neither the vocabulary nor the diagnostician's catalogue has a word."""


def coordinates(spec: Spec) -> set[str]:
    """Coordinates over which an honest `unknown` would be right."""
    effect = spec["effect"]
    if effect in ("shock", "coolant_cycle"):
        return {"t"}
    if effect == "changeover_sector":
        return {c for a in spec["axes"] for c in (a, f"{a} velocity")}
    if effect == "two_axis_motion":
        return set(spec["axes"])
    found = {spec["axis"], f"{spec['axis']} velocity"}
    return found | {f"{spec['axis']} since reversal"} if effect == "stick_slip_teeth" else found
