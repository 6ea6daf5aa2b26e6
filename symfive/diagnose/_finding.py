"""One effect that is missing from the baseline model, and what else could be there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.design import Discrimination
from symfive.diagnose._intervals import Interval
from symfive.effects import Effect, Quantity, coordinate_words, effect_words
from symfive.numbers import in_words
from symfive.screen import OnScreen, listed


@dataclass(frozen=True)
class RivalName:
    """An alternative explanation of a finding, with its probability."""

    effect: str
    axis: str | None
    confidence: float
    component: str | None = None

    @property
    def words(self) -> str:
        """As `error motion of axis B (EXB)`."""
        if self.effect == "unknown":
            return "none of the known effects"
        return effect_words(self.effect, self.axis, self.component)


@dataclass(frozen=True, repr=False)
class Finding(OnScreen):
    """One effect missing from the baseline model.

    `share` of the deviation's mean square that it explains (the shares of all findings, of the geometry and of the residual add
    up to 1), `contribution` run → (N, ny) its part of the readings, `moved` the machine's parameters that changed most when it
    joined: name → (before, after), file units. `log_p` natural log of the probability that nothing acts there. `alias`: effects
    that the readings cannot distinguish from it; `by_experience`: its name comes before theirs only because it is more common.
    `sigmas`: all its amplitudes together, in σ from zero. `test` is what to record next while a rival remains, `next_test` the
    folder of its plan. `further`: effects that describe the same unidentified cause together with `effect`, the largest of
    them, and their parameters; `discrepancies`: unidentified effects that describe how its law differs from the readings.
    """

    effect: Effect
    name: str
    axis: str | None
    confidence: float
    parameters: Mapping[str, Quantity]
    rivals: tuple[RivalName, ...]
    runs: tuple[str, ...]
    coordinate: str
    intervals: tuple[Interval, ...]
    direction: tuple[float, float, float] | None
    says: str
    log_p: float
    visible: float
    share: float
    moved: Mapping[str, tuple[float, float]]
    contribution: Mapping[str, Array]
    alias: tuple[str, ...] = ()
    by_experience: bool = False
    sigmas: float = 0.0
    next_test: str | None = None
    test: Discrimination | None = None
    further: tuple[tuple[Effect, Mapping[str, Quantity]], ...] = ()
    discrepancies: tuple[tuple[Effect, Mapping[str, Quantity]], ...] = ()

    @property
    def effects(self) -> tuple[Effect, ...]:
        """All effects that describe it, and the discrepancies of their laws."""
        return (self.effect, *(effect for effect, _ in (*self.further, *self.discrepancies)))

    @property
    def unidentified(self) -> bool:
        """Whether no library effect matches; the parameters are then those of the nearest one."""
        return self.name == "unknown"

    @property
    def title(self) -> str:
        """The effect, its axis and its component, unless others are as good, as `Error motion of axis B (EXB)`, and the state in
        which alone it acts, as `Friction of axis X at rest`."""
        over = f"unidentified effect over {coordinate_words(self.coordinate)}"
        component = None if self.alias else getattr(self.effect, "component", None)
        named = f"{effect_words(self.name, self.axis, component)} {self.effect.state}".rstrip()
        said = over if self.unidentified else named
        return said[:1].upper() + said[1:]

    def __str__(self) -> str:
        said = {name: in_words(q.value, q.std, q.unit or "") for name, q in self.parameters.items()}
        return "\n".join(
            [self.title, *listed([f"  {name} {words}" for name, words in said.items()], "finding.parameters")]
        )

    def to_data(self) -> dict[str, Any]:
        """One entry of `findings`."""
        return {
            "effect": self.name,
            "axis": self.axis,
            "form": self.effect.key,
            "confidence": round(self.confidence, 4),
            "where": {
                "runs": list(self.runs),
                "coordinate": self.coordinate,
                "intervals": [{"run": i.run, "t_s": [i.begin_s, i.end_s]} for i in self.intervals],
                "direction": None if self.direction is None else list(self.direction),
            },
            "parameters": {name: _quantity(q) for name, q in self.parameters.items()},
            "further": [_described(*each) for each in self.further],
            "discrepancies": [_described(*each) for each in self.discrepancies],
            "rivals": [
                {"effect": r.effect, "axis": r.axis, "confidence": round(r.confidence, 4), "component": r.component}
                for r in self.rivals
            ],
            "alias": list(self.alias),
            "share": self.share,
            "visible": self.visible,
            "by_experience": self.by_experience,
            "size_sigmas": self.sigmas,
            "log10_p": self.log_p / float(np.log(10.0)),
            "geometry_moved": {name: {"before": b, "after": a} for name, (b, a) in self.moved.items()},
            "says": self.says,
            "next_test": self.next_test,
            "next_test_separation_sigma": None if self.test is None else self.test.separation,
        }


def _described(effect: Effect, parameters: Mapping[str, Quantity]) -> dict[str, Any]:
    return {"form": effect.key, "parameters": {name: _quantity(q) for name, q in parameters.items()}}


def _quantity(q: Quantity) -> Any:
    value = list(q.value) if isinstance(q.value, tuple) else q.value
    if isinstance(value, str):
        return value
    std = list(q.std) if isinstance(q.std, tuple) else q.std
    return {"value": value, "std": std, "unit": q.unit}
