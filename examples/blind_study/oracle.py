"""The oracle: `identify` with the true effects in the model, which is the best that a diagnosis can hope for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from symfive.campaign import read_campaign
from symfive.effects import Effect, make_effect
from symfive.identify import identify
from symfive.model import Model

from .judge import geometry

WIDE = 1e3
"""Prior sigma of an error motion's coefficients (µm, µrad): over a small part of the travel they are large."""
ROOM = 10.0
"""Prior sigma of an effect over what it turned out, within a tenth."""
WIDENINGS = 10
"""At most so many: what geometry absorbs nearly whole comes out larger each time."""
SHAPES: dict[tuple[str, str], dict[str, Any]] = {
    ("backlash", "presliding"): {"shape": "pre_sliding"},
    ("backlash", "wind_up"): {"shape": "wind_up"},
    ("lateral_play", "presliding"): {"shape": "pre_sliding"},
    ("friction", "stribeck"): {"shape": "stribeck"},
    ("friction", "lugre"): {"shape": "stribeck"},
    ("thermal_drift", "two"): {"shape": "mixture"},
    ("thermal_drift", "ramp"): {"shape": "linear"},
    ("setup_shift", "creep"): {"shape": "creep"},
    ("transmission_error", "harmonics"): {"harmonics": 2},
    ("transmission_error", "sawtooth"): {"harmonics": 3},
}
"""The library's nearest shape to a form of the plant."""
OWN_FORM = {
    "backlash": ("hard", "presliding", "wind_up"), "transmission_error": ("sine", "harmonics"), "scale_error": ("linear",),
    "location_error": ("value",), "error_motion": ("curve",), "gravity_sag": ("sin", "one_minus_cos"),
    "thermal_drift": ("single", "two", "ramp"), "lateral_play": ("hard", "presliding"), "servo_mismatch": ("gains",),
    "friction": ("coulomb", "stribeck"), "vibration": ("tone",), "inertial_compliance": ("linear",), "latency": ("delay",),
    "setup_shift": ("step", "creep"), "sensor_error": ("linear",),
}  # fmt: skip
"""Forms of the plant that the library holds too; the first of each is what a spec without `form` means."""
TEXTBOOK = (
    "hard",
    "sine",
    "linear",
    "value",
    "curve",
    "sin",
    "one_minus_cos",
    "single",
    "gains",
    "coulomb",
    "tone",
    "delay",
    "step",
)
"""Forms whose parameters mean the same in the plant and in the library."""


def form_of(spec: Mapping[str, Any]) -> str:
    """The form of an effect of the plant, `""` if the library has no such effect."""
    forms = OWN_FORM.get(spec["effect"], ("",))
    return str(spec.get("form", forms[0]))


def in_library(spec: Mapping[str, Any]) -> bool:
    """Whether the library holds this form."""
    return form_of(spec) in OWN_FORM.get(spec["effect"], ())


def true_effect(spec: Mapping[str, Any], instrument: str) -> Effect | None:
    """The library's effect for an effect of the plant; None where it holds none of that form."""
    name, form = spec["effect"], form_of(spec)
    if not in_library(spec):
        return None
    options: dict[str, Any] = dict(SHAPES.get((name, form), {}))
    if name == "sensor_error":
        options |= {"instrument": instrument, "shape": "matrix" if "matrix" in spec else "gain"}
    options |= {k: spec[k] for k in ("component", "frequency_hz", "run", "t_s", "period") if k in spec}
    if name == "setup_shift":
        options["t_s"] = float(spec["t_s"])
    if name == "error_motion":
        options |= {"basis": "fourier" if "harmonics" in spec else "polynomial", "order": 3, "sigma": WIDE}
    if name == "servo_mismatch":
        options["gains"] = tuple(k for k in ("position_gain", "velocity_gain", "feedforward") if k in spec)
    return make_effect(name, spec.get("axis"), **options)


def oracle(folder: Path, answer: Mapping[str, Any]) -> dict[str, Any] | None:
    """Geometry that a fit with the true effects gives; None where the library lacks one of them."""
    campaign = read_campaign(folder / "fit")
    effects = [true_effect(spec, campaign.runs[0].instrument[0]) for spec in answer["effects"]]
    if None in effects:
        return None
    known = [e.prepare(campaign) for e in effects if e is not None]
    result = identify(Model(campaign, tuple(known)))
    for _ in range(WIDENINGS):
        most = [effect.in_sigmas(campaign, result.named) for effect in known]
        if max(most, default=0.0) <= 1.1 / ROOM:
            break
        known = [replace(e, spread=max(ROOM * m, 1.0) * e.spread) for e, m in zip(known, most, strict=True)]
        result = identify(Model(campaign, tuple(known)), start=result.named)
    return {"geometry": geometry(result), "chi2_dof": result.chi2_dof}
