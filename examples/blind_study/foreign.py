"""The stratum `foreign`: physics for which nothing in the search was written, drawn and frozen before anything was run on it.

One drawer per form, with the kinds of test in which it can show and the coordinates over which an answer is right (`forms`). The
digest of this file is pinned by a test.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from .effects import Draft, Spec, _driven, _linear, _pick, _rotary, _unit
from .forms import Form
from .plans import Random, Setting

STATIC, MOTION, ANY = ("r_test", "static_bar"), ("planar", "xc"), ("r_test", "static_bar", "planar", "xc")


def _tau(rng: Random, setting: Setting) -> float:
    return float(rng.uniform(0.2, 0.7) * setting.duration())


def _inside(rng: Random, setting: Setting, axis: str) -> float:
    low, high = setting.reach(axis)
    return float(low + rng.uniform(0.3, 0.7) * (high - low))


def _letter(rng: Random, setting: Setting, axis: str, letters: str) -> str | None:
    """A component of an axis that the baseline does not hold and that is not its own motion."""
    free = [c for c in letters if c != axis and f"E{c}{axis}" not in setting.machine["errors"]]
    return f"E{_pick(rng, free)}{axis}" if free else None


def screw_heat(rng: Random, setting: Setting) -> Draft:
    axis = _pick(rng, _linear(setting))
    base = {
        "effect": "screw_heat",
        "axis": axis,
        "at": _inside(rng, setting, axis),
        "time_constant_s": _tau(rng, setting),
    }
    base["width"] = float(rng.uniform(0.05, 0.15) * np.ptp(setting.reach(axis)))
    return Draft(lambda a: {**base, "amplitude": 8.0 * a})


def scale_slip(rng: Random, setting: Setting) -> Draft:
    base = {"effect": "scale_slip", "axis": _pick(rng, _linear(setting))}
    base["t_s"] = float(rng.uniform(0.3, 0.7) * setting.duration())
    return Draft(lambda a: {**base, "ppm": 40.0 * a})


def preloaded_play(rng: Random, setting: Setting) -> Draft | None:
    turning = [axis for axis in _rotary(setting) if axis == "C"]
    tilts = [axis for axis in _rotary(setting) if axis in "AB"]
    if not turning or not tilts:
        return None
    base = {"effect": "preloaded_play", "axis": "C", "tilt": tilts[0], "limit": float(rng.uniform(0.3, 0.8))}
    return Draft(lambda a: {**base, "width": 60.0 * a})


def settling(rng: Random, setting: Setting) -> Draft | None:
    tilts = [axis for axis in _rotary(setting) if axis in "AB"]
    if not tilts:
        return None
    base = {"effect": "settling", "axis": tilts[0], "time_constant_s": float(rng.uniform(6.0, 25.0))}
    return Draft(lambda a: {**base, "share": 200.0 * a})


def cold_friction(rng: Random, setting: Setting) -> Draft | None:
    if not _driven(setting):
        return None
    base = {"effect": "cold_friction", "axis": _pick(rng, _driven(setting)), "time_constant_s": _tau(rng, setting)}
    return Draft(lambda a: {**base, "excess": 2.0 * a})


def chord_polygon(rng: Random, setting: Setting) -> Draft:
    step = float(rng.uniform(1.0, 3.0))
    return Draft(lambda a: {"effect": "chord_polygon", "axes": ["X", "Y"], "step_deg": step * float(np.sqrt(a))})


def cover_plates(rng: Random, setting: Setting) -> Draft:
    axis = _pick(rng, _linear(setting))
    base = {"effect": "cover_plates", "axis": axis, "direction": _unit(rng), "plates": int(_pick(rng, [2, 3, 4]))}
    base["plate"] = float(rng.uniform(0.1, 0.25) * np.ptp(setting.reach(axis)))
    return Draft(lambda a: {**base, "amplitude": 1.0 * a})


def position_cross_talk(rng: Random, setting: Setting) -> Draft | None:
    linear = _linear(setting)
    if len(linear) < 2:
        return None
    axis, place = rng.permutation(linear)[:2].tolist()
    base = {"effect": "position_cross_talk", "axis": axis, "place": place, "direction": _unit(rng)}
    return Draft(lambda a: {**base, "amplitude": 100.0 * a})


def roller_ripple(rng: Random, setting: Setting) -> Draft | None:
    component = _letter(rng, setting, _pick(rng, _linear(setting)), "XYZ")
    base = {"effect": "roller_ripple", "component": component, "pitch": float(rng.uniform(10.0, 30.0))}
    base["phase"] = float(rng.uniform(0.0, 6.28))
    return Draft(lambda a: {**base, "amplitude": 2.0 * a}) if component else None


def bed_bending(rng: Random, setting: Setting) -> Draft | None:
    linear = _linear(setting)
    if len(linear) < 2:
        return None
    first, second = rng.permutation(linear)[:2].tolist()
    component = _letter(rng, setting, first, "XYZ")
    base = {"effect": "bed_bending", "component": component, "axes": [first, second]}
    return Draft(lambda a: {**base, "amplitude": 4.0 * a}) if component else None


def jerk_yield(rng: Random, setting: Setting) -> Draft:
    base = {"effect": "jerk_yield", "axis": _pick(rng, _linear(setting)), "direction": _unit(rng)}
    return Draft(lambda a: {**base, "amplitude": 200.0 * a})


def imbalance(rng: Random, setting: Setting) -> Draft | None:
    if "C" not in _rotary(setting):
        return None
    base = {"effect": "imbalance", "axis": "C", "phase": float(rng.uniform(0.0, 6.28))}
    return Draft(lambda a: {**base, "amplitude": 2.0 * a})


def gantry_lag(rng: Random, setting: Setting) -> Draft:
    base = {"effect": "gantry_lag", "component": f"EC{_pick(rng, _linear(setting))}"}
    return Draft(lambda a: {**base, "amplitude": 30.0 * a})


def resonant_cogging(rng: Random, setting: Setting) -> Draft:
    axis = _pick(rng, _linear(setting))
    speed = max(float(np.abs(np.gradient(run["command"][axis], run["t_s"])).max()) for run in setting.fit)
    pitch = float(_pick(rng, [8.0, 10.0, 12.0, 16.0]))
    base = {
        "effect": "resonant_cogging", "axis": axis, "pitch": pitch, "damping": float(rng.uniform(0.05, 0.2)),
        "frequency_hz": float(rng.uniform(0.3, 0.8)) * speed / pitch, "direction": _unit(rng),
        "phase": float(rng.uniform(0.0, 6.28)),
    }  # fmt: skip
    return Draft(lambda a: {**base, "amplitude": 1.0 * a})


def table_growth(rng: Random, setting: Setting) -> Draft:
    base = {"effect": "table_growth", "time_constant_s": _tau(rng, setting)}
    return Draft(lambda a: {**base, "amplitude": 8.0 * a})


def yaw_drift(rng: Random, setting: Setting) -> Draft:
    component = f"E{_pick(rng, 'ABC')}{_pick(rng, _linear(setting))}"
    base = {"effect": "yaw_drift", "component": component, "time_constant_s": _tau(rng, setting)}
    return Draft(lambda a: {**base, "amplitude": 30.0 * a})


def taut_hose(rng: Random, setting: Setting) -> Draft | None:
    axes = _linear(setting)
    if len(axes) < 2:
        return None
    points = np.concatenate([np.stack([run["command"][name] for name in axes], axis=1) for run in setting.fit])
    way = rng.normal(size=len(axes))
    anchor = points.mean(axis=0) + 250.0 * way / np.linalg.norm(way)
    reach = np.linalg.norm(points - anchor, axis=1)
    base = {"effect": "taut_hose", "axes": axes, "anchor": np.round(anchor, 1).tolist()}
    base["free"] = float(np.quantile(reach, rng.uniform(0.4, 0.7)))
    return Draft(lambda a: {**base, "amplitude": 1.0 * a})


def ball_form(rng: Random, setting: Setting) -> Draft | None:
    if setting.fit[0]["instrument"] != "ball_bar":
        return None
    base = {"effect": "ball_form", "order": int(_pick(rng, [5, 6, 7])), "phase": float(rng.uniform(0.0, 6.28))}
    base["axes"] = setting.moving()
    return Draft(lambda a: {**base, "amplitude": 2.0 * a})


def probe_product(rng: Random, setting: Setting) -> Draft:
    return Draft(lambda a: {"effect": "probe_product", "curvature": 1e-4 * a})


def _time(spec: Spec) -> set[str]:
    return {"t", "time"}


def _own(*more: str, time: bool = False) -> Callable[[Spec], set[str]]:
    """The axis itself and what of it is named in `more`, `time` or not."""

    def found(spec: Spec) -> set[str]:
        axis = spec.get("axis") or spec["component"][2:]
        return {f"{axis}{what}" for what in more} | (_time(spec) if time else set())

    return found


def _all(spec: Spec) -> set[str]:
    return set(spec["axes"])


FORMS: Mapping[str, Form] = {
    "screw_heat": Form(screw_heat, ANY, _own("", time=True)),
    "preloaded_play": Form(preloaded_play, STATIC, lambda spec: {"C velocity sign", str(spec["tilt"])}),
    "position_cross_talk": Form(
        position_cross_talk, ("planar",), lambda spec: {f"{spec['axis']} acceleration", str(spec["place"])}
    ),
    "roller_ripple": Form(roller_ripple, MOTION, _own("")),
    "table_growth": Form(table_growth, STATIC, _time),
    "imbalance": Form(imbalance, ("xc",), _own("", " velocity")),
    "taut_hose": Form(taut_hose, ANY, _all),
    "cold_friction": Form(cold_friction, MOTION, _own(" velocity", time=True)),
    "bed_bending": Form(bed_bending, ANY, _all),
    "gantry_lag": Form(gantry_lag, ("planar",), _own(" velocity")),
    "settling": Form(settling, STATIC, _own("", " velocity sign", " since reversal", time=True)),
    "cover_plates": Form(cover_plates, MOTION, _own("", " velocity sign", " since reversal")),
    "scale_slip": Form(scale_slip, ANY, _own("", time=True)),
    "ball_form": Form(ball_form, ("planar", "static_bar"), _all),
    "jerk_yield": Form(jerk_yield, MOTION, _own(" velocity", " acceleration")),
    "resonant_cogging": Form(resonant_cogging, MOTION, _own("", " velocity")),
    "probe_product": Form(probe_product, ("r_test",), lambda spec: {"reading"}),
    "yaw_drift": Form(yaw_drift, ANY, _time),
    "chord_polygon": Form(chord_polygon, ("planar",), _all),
}
