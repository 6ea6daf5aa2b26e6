"""The diagnosis: findings in order of the evidence each adds, the fit before and after, the observability table."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.design import Discrimination
from symfive.diagnose._detect import Detection
from symfive.diagnose._locate import Location, Observability, observability_words
from symfive.diagnose._places import Interval
from symfive.effects import Effect, Quantity
from symfive.identify import Identification

__all__ = ["SCHEMA", "Diagnosis", "Finding", "Fit", "RivalName"]

SCHEMA = "symfive.diagnosis/1"
Array = NDArray[np.float64]
WORSE = 0.01
"""Share by which left-out readings must be foretold worse before it is said: less may be chance."""


@dataclass(frozen=True)
class RivalName:
    """Another effect that could explain the same, with its probability."""

    effect: str
    axis: str | None
    confidence: float
    component: str | None = None


@dataclass(frozen=True)
class Finding:
    """One piece of physics that the baseline leaves out.

    `share` of the deviation's mean square that it explains, `contribution` run → (N, ny) its readings, `moved` the
    machine's parameters that changed most when it joined: name → (before, after), file units. `test` is what to record
    next where a rival stays, `next_test` the folder of its plan.
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
    shape_differs: float = 0.0
    next_test: str | None = None
    test: Discrimination | None = None

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
            "rivals": [
                {"effect": r.effect, "axis": r.axis, "confidence": round(r.confidence, 4), "component": r.component}
                for r in self.rivals
            ],
            "alias": list(self.alias),
            "share": self.share,
            "visible": self.visible,
            "shape_differs": self.shape_differs,
            "log10_p": self.log_p / float(np.log(10.0)),
            "geometry_moved": {name: {"before": b, "after": a} for name, (b, a) in self.moved.items()},
            "says": self.says,
            "next_test": self.next_test,
            "next_test_separation_sigma": None if self.test is None else self.test.separation,
        }


def _quantity(q: Quantity) -> Any:
    value = list(q.value) if isinstance(q.value, tuple) else q.value
    if isinstance(value, str):
        return value
    std = list(q.std) if isinstance(q.std, tuple) else q.std
    return {"value": value, "std": std, "unit": q.unit}


@dataclass(frozen=True)
class Fit:
    """Quality before and after, over kept readings; the held-out part by leaving out runs in turn, `heldout_by` a whole feed
    or place at a time: what → (before, after), µm."""

    rms_before_um: float
    rms_after_um: float
    chi2_dof_before: float
    chi2_dof_after: float
    heldout_rms_before_um: float | None
    heldout_rms_after_um: float | None
    heldout_by: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def doubts(self, unit: str) -> tuple[str, ...]:
        """What speaks against the findings: readings that were left out and are foretold worse with them."""
        runs = (self.heldout_rms_before_um, self.heldout_rms_after_um)
        held = {"run": runs, **self.heldout_by}
        return tuple(
            f"A {what} that was left out of the fit is foretold worse with them ({before:.3g} → {after:.3g} {unit} rms): "
            + (
                "take them as a hint, not as proven."
                if what == "run"
                else f"do not trust them beyond the {what}s recorded."
            )
            for what, (before, after) in held.items()
            if before is not None and after is not None and after > (1.0 + WORSE) * before
        )


@dataclass(frozen=True)
class Diagnosis:
    """Result of `diagnose`. `before` and `after` are the identifications without and with the findings, `detection` and
    `location` what was seen before any name, `remaining` the same tests on what is left."""

    p_value: float
    noise_um: float
    findings: tuple[Finding, ...]
    fit: Fit
    detection: Detection
    location: Location
    remaining: Detection
    before: Identification
    after: Identification
    false_alarms: float = 0.01

    @property
    def unnamed(self) -> tuple[str, ...]:
        """What is left and has no name: what the tests that need none say of the fit with all findings."""
        return tuple(
            t.says
            for t in self.remaining.tests
            if t.name in ("lack of fit", "agreement of groups") and 2.0 * t.p_value < self.remaining.level
        )

    @property
    def mismatch(self) -> bool:
        """Whether the baseline fails to explain the readings."""
        return bool(self.findings) or bool(self.unnamed)

    @property
    def observability(self) -> tuple[Observability, ...]:
        """What the campaign can see at all of every effect."""
        return self.location.observability

    @property
    def classes(self) -> tuple[tuple[str, ...], ...]:
        """Effects that the campaign cannot tell apart."""
        return self.location.classes

    def to_data(self) -> dict[str, Any]:
        """`diagnosis.json` (conventions, section 6)."""
        return {
            "schema": SCHEMA,
            "mismatch": self.mismatch,
            "p_value": self.p_value,
            "noise_um": self.noise_um,
            "findings": [f.to_data() for f in self.findings],
            "fit": {
                **{name: getattr(self.fit, name) for name in self.fit.__dataclass_fields__ if name != "heldout_by"},
                "heldout_by": {
                    what: {"rms_before_um": b, "rms_after_um": a} for what, (b, a) in self.fit.heldout_by.items()
                },
            },
            "tests": [
                {"test": t.name, "statistic": t.statistic, "dof": t.dof, "p_value": t.p_value, "says": t.says}
                for t in self.detection.tests
            ],
            "unnamed": list(self.unnamed),
            "observability": [
                {"effect": o.effect, "axis": o.axis, "form": o.form, "visible": o.visible, "sigmas": o.sigmas}
                for o in self.observability
            ],
            "classes": [list(c) for c in self.classes],
            "says": self.letter,
        }

    @property
    def letter(self) -> str:
        """The verdict in plain words."""
        if not self.mismatch:
            ratio = float(np.sqrt(self.fit.chi2_dof_after))
            text = (
                f"None of {len(self.observability)} effects that were looked for stands out of what the baseline leaves "
                f"({self.fit.rms_after_um:.3g} {self.after.unit} rms)."
            )
            if ratio > 1.1:
                return (
                    f"{text} That is {ratio:.2g} times the declared noise: coloured noise of the instrument, or something that "
                    "no effect of the catalogue describes and these recordings cannot place."
                )
            return f"{text} The baseline explains the readings down to the declared noise."
        doubts = self.fit.doubts(self.after.unit) if self.findings else ()
        return " ".join([*(f.says for f in self.findings), *doubts, *self.unnamed])

    def __str__(self) -> str:
        lines = [observability_words(self.observability, self.classes)]
        lines.append("")
        lines.append(self.letter)
        f = self.fit
        lines.append(
            f"rms {f.rms_before_um:.3g} → {f.rms_after_um:.3g} {self.after.unit}, "
            f"chi²/dof {f.chi2_dof_before:.3g} → {f.chi2_dof_after:.3g}"
        )
        if f.heldout_rms_after_um is not None and f.heldout_rms_before_um is not None:
            held = f"{f.heldout_rms_before_um:.3g} → {f.heldout_rms_after_um:.3g} {self.after.unit}"
            lines.append(f"left-out runs: rms {held}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"
