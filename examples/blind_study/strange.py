"""The stratum `strange`: further physics for which nothing in the search was written, drawn once `foreign` had been looked at.

One drawer per form, with the kinds of test in which it can show and the coordinates over which an answer is right (`forms`).
Frozen before anything was run on it: the digest of this file is pinned by a test.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .effects import Draft, _driven, _linear, _pick, _rotary, _size, _unit
from .foreign import MOTION, STATIC, _inside, _letter, _own, _time
from .forms import Form
from .plans import Random, Setting

BAR = ("static_bar", "planar", "xc")
"""Kinds of test that a ball bar may run."""


def _tilt(setting: Setting, *, of_table: bool = False) -> str | None:
    """The tilting axis that moves; `of_table`: only one that carries the workpiece."""
    words = setting.machine["structure"].split()
    return next((a for a in _rotary(setting) if a in "AB" and (not of_table or f"{a}'" in words)), None)


def _lap(setting: Setting) -> float:
    """Mean length of a run, s."""
    return float(np.mean([run["t_s"][-1] for run in setting.fit]))


def _path(setting: Setting, axis: str) -> float:
    """Mean path of an axis in a run, mm or degree."""
    return float(np.mean([np.abs(np.diff(run["command"][axis])).sum() for run in setting.fit]))


def _phase(rng: Random) -> float:
    return float(rng.uniform(0.0, 2.0 * np.pi))


def clamp_scatter(rng: Random, setting: Setting) -> Draft | None:
    axis = _tilt(setting)
    base = {"effect": "clamp_scatter", "axis": axis, "seed": int(rng.integers(1 << 31))}
    return Draft(lambda a: {**base, "scatter": 30.0 * a}) if axis else None


def drag_chain(rng: Random, setting: Setting) -> Draft:
    axis = _pick(rng, _linear(setting))
    low, high = setting.reach(axis)
    widths = (rng.uniform(0.7, 1.3) * np.array([0.05, 0.2, 0.6]) * (high - low)).tolist()
    base = {"effect": "drag_chain", "axis": axis, "direction": _unit(rng), "widths": widths}
    return Draft(lambda a: {**base, "amplitude": 3.0 * a})


def soft_probe(rng: Random, setting: Setting) -> Draft | None:
    base = {"effect": "soft_probe", "probe": int(_pick(rng, [0, 1, 2])), "tilt": _tilt(setting, of_table=True)}
    return Draft(lambda a: {**base, "amplitude": 4.0 * a}) if base["tilt"] else None


def rail_joint(rng: Random, setting: Setting) -> Draft | None:
    axis = _pick(rng, _linear(setting))
    component = _letter(rng, setting, axis, "XYZ")
    base = {"effect": "rail_joint", "component": component, "at": _inside(rng, setting, axis)}
    base["settling"] = float(rng.uniform(0.05, 0.2) * np.ptp(setting.reach(axis)))
    return Draft(lambda a: {**base, "amplitude": 5.0 * a}) if component else None


def coarse_counts(rng: Random, setting: Setting) -> Draft:
    base = {"effect": "coarse_counts", "axis": _pick(rng, _rotary(setting)), "zero": float(rng.uniform(-0.5, 0.5))}
    base["step"] = float(rng.uniform(80.0, 120.0))
    return Draft(lambda a: {**base, "step": base["step"] * a})


def valve_lag(rng: Random, setting: Setting) -> Draft:
    base = {"effect": "valve_lag", "axis": _pick(rng, _driven(setting))}
    return Draft(lambda a: {**base, "amplitude": _size(base["axis"], 3.0, 30.0) * a})


def walking_coupling(rng: Random, setting: Setting) -> Draft | None:
    base = {"effect": "walking_coupling", "axis": "C"}
    return Draft(lambda a: {**base, "amplitude": 2.0 * a}) if "C" in _rotary(setting) else None


def motor_heat(rng: Random, setting: Setting) -> Draft:
    base = {"effect": "motor_heat", "axis": _pick(rng, _driven(setting)), "direction": _unit(rng)}
    base["time_constant_s"] = float(rng.uniform(0.2, 0.8) * _lap(setting))
    return Draft(lambda a: {**base, "amplitude": 5.0 * a})


def loose_seat(rng: Random, setting: Setting) -> Draft | None:
    axis = _tilt(setting, of_table=True)
    if axis is None:
        return None
    limit = float(rng.uniform(0.15, 0.6) * max(np.abs(setting.reach(axis))))
    base = {"effect": "loose_seat", "axis": axis, "limit": limit, "direction": _unit(rng)}
    return Draft(lambda a: {**base, "amplitude": 2.0 * a})


def soft_ground(rng: Random, setting: Setting) -> Draft:
    axis = _pick(rng, _linear(setting))
    base = {"effect": "soft_ground", "component": {"X": "EBX", "Y": "EAY"}[axis]}
    base["time_constant_s"] = float(rng.uniform(0.05, 0.3) * _lap(setting))
    return Draft(lambda a: {**base, "amplitude": 30.0 * a})


def cubic_sensor(rng: Random, setting: Setting) -> Draft | None:
    sign = float(_pick(rng, [-1.0, 1.0]))
    wanted = setting.fit[0]["instrument"] == "ball_bar"
    return Draft(lambda a: {"effect": "cubic_sensor", "curvature": 1e-5 * sign * a}) if wanted else None


def one_flank(rng: Random, setting: Setting) -> Draft:
    base = {"effect": "one_flank", "axis": _pick(rng, _driven(setting)), "flank": float(_pick(rng, [-1.0, 1.0]))}
    base |= {"period": float(360.0 / rng.integers(60, 120)), "phase": _phase(rng)}
    if base["axis"] != "C":
        base["period"] = float(rng.uniform(6.0, 16.0))
    return Draft(lambda a: {**base, "amplitude": _size(base["axis"], 3.0, 40.0) * a})


def cage_order(rng: Random, setting: Setting) -> Draft | None:
    order = float(_pick(rng, [2, 3, 4]) + rng.uniform(0.25, 0.75))
    base = {"effect": "cage_order", "axis": "C", "order": order, "phase": _phase(rng)}
    base["slip"] = float(rng.uniform(0.3, 1.5))
    return Draft(lambda a: {**base, "amplitude": 3.0 * a}) if "C" in _rotary(setting) else None


def oil_shot(rng: Random, setting: Setting) -> Draft:
    axis = _pick(rng, _linear(setting))
    every = float(rng.uniform(0.25, 0.6) * _path(setting, axis))
    base = {"effect": "oil_shot", "axis": axis, "every": every, "direction": _unit(rng)}
    base |= {"first": float(rng.uniform(0.1, 0.9) * every), "squeezed": float(rng.uniform(0.1, 0.4) * every)}
    return Draft(lambda a: {**base, "amplitude": 5.0 * a})


def clock_rate(rng: Random, setting: Setting) -> Draft:
    sign = float(_pick(rng, [-1.0, 1.0]))
    return Draft(lambda a: {"effect": "clock_rate", "rate": 2.0 * sign * a})


FORMS: Mapping[str, Form] = {
    "drag_chain": Form(drag_chain, MOTION, _own("", " velocity sign", " since reversal")),
    "clamp_scatter": Form(clamp_scatter, STATIC, _own("", " velocity sign", " since reversal", time=True)),
    "valve_lag": Form(valve_lag, MOTION, _own(" velocity", " velocity sign")),
    "soft_probe": Form(soft_probe, ("r_test",), lambda spec: {str(spec["tilt"]), "C", "reading"}),
    "rail_joint": Form(rail_joint, MOTION, _own("", " velocity sign", " since reversal")),
    "coarse_counts": Form(coarse_counts, STATIC, _own("")),
    "motor_heat": Form(motor_heat, MOTION, _own(" velocity", time=True)),
    "loose_seat": Form(loose_seat, STATIC, _own("", " velocity sign", " since reversal")),
    "soft_ground": Form(soft_ground, MOTION, _own("", " velocity", " velocity sign", " since reversal")),
    "cage_order": Form(cage_order, ("r_test", "xc"), _own("", " velocity sign", " since reversal")),
    "one_flank": Form(one_flank, MOTION, _own("", " velocity sign", " since reversal")),
    "walking_coupling": Form(walking_coupling, (*STATIC, "xc"), _own("", time=True)),
    "oil_shot": Form(oil_shot, MOTION, _time),
    "cubic_sensor": Form(cubic_sensor, BAR, lambda spec: {"reading"}),
    "clock_rate": Form(clock_rate, MOTION, lambda spec: {"t", "time", "reading"}),
}
