"""The shapes that a family of effects can take beside its plain one, from the options of its own class."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from itertools import combinations
from typing import Any

from symfive.campaign import Campaign
from symfive.effects import Effect
from symfive.effects.transmission_error import TransmissionError
from symfive.effects.unknown import Unknown

__all__ = ["carried", "narrower", "plain", "shapes", "simpler", "variants"]

SHAPES: dict[str, tuple[dict[str, Any], ...]] = {
    "backlash": ({"shape": "pre_sliding"}, {"shape": "wind_up"}),
    "friction": ({"shape": "stribeck"}, {"shape": "lugre"}),
    "reversal_spike": ({"shape": "pulse"},),
    "lateral_play": ({"shape": "pre_sliding"}, {"shape": "play"}),
    "thermal_drift": ({"shape": "exponential"}, {"shape": "mixture"}, {"shape": "linear"}, {"shape": "delayed"}),
    "setup_shift": ({"shape": "creep"},),
    "transmission_error": ({"harmonics": 2}, {"harmonics": 3}, {"harmonics": 8}, {"harmonics": 16}),
    "servo_mismatch": ({"gains": ("position_gain",)}, {"gains": ("velocity_gain",)}, {"gains": ("feedforward",)}),
    "sensor_error": ({"shape": "gain"},),
    "inertial_compliance": ({"shape": "softening"},),
    "table_step": ({"shape": "late"}, {"shape": "early"}, {"shape": "gradual"}),
    "unknown": ({"order": 16}, {"order": 32}),
    "gravity_sag": (
        {"parts": ("sin",)}, {"parts": ("one_minus_cos",)}, {"parts": ("sin", "sin_cubed")},
        {"parts": ("sin", "one_minus_cos", "sin_cubed")}, {"parts": ("sin", "branch")},
        {"parts": ("sin", "one_minus_cos", "branch")},
    ),
}  # fmt: skip
"""Options that change an effect's shape and not what it is."""
MULTIPLES = ((2, 2), (2, 4), (3, 3))
"""Of a period that was found, with how many harmonics: it may be that of the largest harmonic and not of the first."""


def plain(effect: Effect) -> Effect:
    """The effect in the shape in which the catalogue holds it."""
    names = {name for options in SHAPES.get(effect.id, ()) for name in options}
    defaults: dict[str, Any] = {f.name: f.default for f in fields(effect) if f.name in names and effect.id != "unknown"}
    return replace(effect, **defaults) if defaults else effect


def simpler(effect: Effect) -> list[Effect]:
    """The effect in its plain shape, and with the period of which it may be a multiple; nothing if it is plain."""
    first = plain(effect)
    if first == effect:
        return []
    found = [first]
    if isinstance(effect, TransmissionError):
        for multiple in (multiple for multiple, harmonics in MULTIPLES if harmonics == effect.harmonics):
            sigma = None if effect.period_sigma is None else effect.period_sigma / multiple
            found.append(replace(effect, period=effect.period / multiple, period_sigma=sigma, harmonics=1))
    return found


def shapes(effect: Effect, campaign: Campaign) -> int:
    """In how many shapes the effect could come where it is in a richer one than its plain one."""
    richer = len(effect.parameters(campaign)) > len(plain(effect).prepare(campaign).parameters(campaign))
    return 1 + len(list(variants(plain(effect)))) if richer else 1


def variants(effect: Effect) -> Iterator[Effect]:
    """The other shapes of an effect; of a term without a name, finer ones along its only coordinate."""
    order = getattr(effect, "order", 0)
    for options in SHAPES.get(effect.id, ()):
        finer = isinstance(order, int) and order < options.get("order", 0) and getattr(effect, "basis", "") == "bspline"
        if effect.id == "unknown" and not finer:
            continue
        if all(getattr(effect, name) != value for name, value in options.items()):
            yield replace(effect, **options)
    if isinstance(effect, TransmissionError) and effect == plain(effect):
        for multiple, harmonics in MULTIPLES:
            sigma = None if effect.period_sigma is None else multiple * effect.period_sigma
            yield replace(effect, period=multiple * effect.period, period_sigma=sigma, harmonics=harmonics)


def carried(effect: Effect, other: Effect, campaign: Campaign, values: Mapping[str, float]) -> dict[str, float]:
    """What the values of an effect say of another of its shapes: nothing of one with another period."""
    if getattr(effect, "period", 0.0) != getattr(other, "period", 0.0):
        return {}
    return {p.name: values[p.name] for p in other.parameters(campaign) if p.name in values}


def narrower(effect: Effect) -> list[Unknown]:
    """A term without a name that shifts the tool, in some of its directions only, a cycle also with its first harmonic alone; no
    other effect."""
    if not isinstance(effect, Unknown) or effect.place != "structure":
        return []
    parts = range(1, len(effect.directions) + 1)
    ways = ["".join(d) for n in parts for d in combinations(effect.directions, n)]
    orders = [effect.order, *([1] if effect.period and effect.order != 1 else [])]
    found = [replace(effect, directions=way, order=order) for order in orders for way in ways]
    return [shape for shape in found if shape != effect]
