"""The shapes that a family of effects can take beside its plain one, from the options of its own class."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

from symfive.effects import Effect, Unknown

__all__ = ["along_one", "plain", "variants"]

SHAPES: dict[str, tuple[dict[str, Any], ...]] = {
    "backlash": ({"shape": "pre_sliding"}, {"shape": "wind_up"}),
    "friction": ({"shape": "stribeck"},),
    "reversal_spike": ({"shape": "pulse"},),
    "lateral_play": ({"shape": "pre_sliding"}, {"shape": "play"}),
    "thermal_drift": ({"shape": "mixture"}, {"shape": "linear"}),
    "setup_shift": ({"shape": "creep"},),
    "transmission_error": ({"harmonics": 2}, {"harmonics": 3}),
    "servo_mismatch": ({"gains": ("position_gain",)}, {"gains": ("velocity_gain",)}, {"gains": ("feedforward",)}),
    "sensor_error": ({"shape": "gain"},),
    "unknown": (
        {"directions": "x"}, {"directions": "y"}, {"directions": "z"},
        {"directions": "xy"}, {"directions": "xz"}, {"directions": "yz"},
        {"order": 16}, {"order": 32},
    ),
    "gravity_sag": (
        {"parts": ("sin",)}, {"parts": ("one_minus_cos",)}, {"parts": ("sin", "sin_cubed")},
        {"parts": ("sin", "one_minus_cos", "sin_cubed")},
    ),
}  # fmt: skip
"""Options that change an effect's shape and not what it is."""


def plain(effect: Effect) -> Effect:
    """The effect in the shape in which the catalogue holds it."""
    names = {name for options in SHAPES.get(effect.id, ()) for name in options}
    defaults: dict[str, Any] = {f.name: f.default for f in fields(effect) if f.name in names and effect.id != "unknown"}
    return replace(effect, **defaults) if defaults else effect


def variants(effect: Effect) -> Iterator[Effect]:
    """The other shapes of an effect; of a term without a name, narrower and finer ones."""
    for options in SHAPES.get(effect.id, ()):
        if isinstance(effect, Unknown) and not _narrows(effect, options):
            continue
        if all(getattr(effect, name) != value for name, value in options.items()):
            yield replace(effect, **options)


def along_one(effect: Effect) -> list[Effect]:
    """A term without a name that shifts the tool, in one direction each; no other effect."""
    return [v for v in variants(effect) if isinstance(v, Unknown) and len(v.directions) == 1 < len(effect.directions)]


def _narrows(effect: Unknown, options: dict[str, Any]) -> bool:
    """Whether the term would shift the tool in fewer directions, or be finer along its only coordinate."""
    if "directions" in options:
        return effect.place == "structure" and set(options["directions"]) < set(effect.directions)
    return isinstance(effect.order, int) and effect.order < options["order"]
