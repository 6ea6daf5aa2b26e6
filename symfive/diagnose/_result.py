"""The diagnosis: findings in order of the evidence each adds, the fit before and after, the observability table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from symfive.diagnose._cross_validation import Fit
from symfive.diagnose._detect import Detection
from symfive.diagnose._finding import Finding
from symfive.diagnose._hold_out import HoldOut
from symfive.diagnose._locate import Location, Observability
from symfive.diagnose._words import facts_of
from symfive.identify import UNCONVERGED, Identification, relief_notes, tension_notes
from symfive.inference import Outlier
from symfive.numbers import change, expected_ratio, percent, plain_number, unit_words, with_std
from symfive.screen import OnScreen, wrapped

SCHEMA = "symfive.diagnosis/1"
EXPLAINED = 1.1
"""Residuals up to so many times the declared noise count as explained."""
SHOWN_ERRORS = 5
"""Errors of the machine file that are listed beside the findings, at most."""
SHOWN_SHARE = 0.01
"""Geometry and set-up that explain less, beside the findings, are not mentioned."""


def _excluded(fit: Identification) -> dict[str, Any]:
    every = fit.problem().readings
    return {"excluded": len(fit.outliers), "readings": every, "share": len(fit.outliers) / max(every, 1),
            "rms_kept_um": fit.rms_kept.get(fit.file_unit, 0.0)}  # fmt: skip


def mean_square(result: Identification, outliers: tuple[Outlier, ...]) -> float:
    """Of the residuals that count, without these readings; in units of the noise where they have several units."""
    problem, total, count = result.problem(), 0.0, 0
    for run, residual in result.residuals.items():
        if len(result.rms) > 1:
            residual = residual / result.model.noise(run)
        counted = problem.judged(result.model.campaign.run(run))
        names = [column.name for column in result.model.columns(run)]
        for outlier in (each for each in outliers if each.run == run):
            counted[outlier.row, names.index(outlier.column)] = False
        total += float(np.sum(residual[counted] ** 2))
        count += int(counted.sum())
    return total / max(count, 1)


@dataclass(frozen=True, repr=False)
class Diagnosis(OnScreen):
    """Result of `diagnose`.

    `p_value` bounds how often a clean campaign deviates as much. `before` and `after` are the identifications without and with
    the findings, `detection` and `location` the tests before any finding, `remaining` the same tests after. `hold_out`: the gain
    of the findings on held-out readings; `searched`: on the rows of long recordings outside the search, before all rows were
    fitted. `other_readings`: recordings with a reversed sign, exchanged columns or another unit, by the fit.
    """

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
    hold_out: HoldOut | None = None
    searched: HoldOut | None = None
    other_readings: tuple[str, ...] = ()

    @property
    def unnamed(self) -> tuple[str, ...]:
        """What the tests that need no name still find in the fit with all findings."""
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
        """Observability of every library effect in this campaign."""
        return self.location.observability

    @property
    def classes(self) -> tuple[tuple[str, ...], ...]:
        """Classes of effects that the campaign cannot separate."""
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
            "hold_out": None if self.hold_out is None else self.hold_out.to_data(self.after.unit),
            "searched": None if self.searched is None else self.searched.to_data(self.after.unit),
            "outliers": {"before": _excluded(self.before), "after": _excluded(self.after)},
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
            "says": self.summary,
        }

    @property
    def summary(self) -> str:
        """The verdict in words, one sentence per finding."""
        return self._warned(" ".join([self._summary(), *self.excluded, *self.proof]))

    def _summary(self) -> str:
        if self.mismatch:
            return " ".join([*(f.says for f in self.findings), *self.doubts])
        left = plain_number(self.fit.rms_after_um, self.after.unit)
        text = f"None of the {len(self.observability)} effects tested is significant (residual {left} {self.after.unit} rms)."
        beyond = "slow noise of the instrument, or an effect that these recordings cannot locate"
        explained = "The model explains the readings down to the declared noise."
        rest = f"It is {self._beyond_noise}: {beyond}." if self._beyond_noise else explained
        return " ".join([text, rest, *self.doubts])

    def _warned(self, said: str) -> str:
        """Behind a warning where a recording seems to be wrong, or the fit did not converge."""
        said = said if self.after.converged else f"{UNCONVERGED} {said}"
        doubts = (doubt[:1].upper() + doubt[1:] for doubt in self.other_readings)
        return "".join([*(f"Check a recording first. {doubt}. If it is right: " for doubt in doubts), said])

    @property
    def noise_ratio(self) -> float:
        """What is left, in declared noise."""
        return float(np.sqrt(max(self.fit.chi2_dof_after, 0.0)))

    @property
    def beyond_noise(self) -> bool:
        """Whether more is left than noise: by more than a tenth, and more than chance explains."""
        return self.noise_ratio > EXPLAINED and self.after.fits == "no"

    @property
    def _beyond_noise(self) -> str:
        """How large the residual is where it is more than noise, else nothing."""
        return f"{plain_number(self.noise_ratio)} times the declared noise" if self.beyond_noise else ""

    @property
    def by_share(self) -> list[Finding]:
        """The findings, the largest share of the deviation first."""
        return sorted(self.findings, key=lambda finding: -finding.share)

    @property
    def geometry_share(self) -> float:
        """The share of the deviation's mean square that no finding explains but geometry and set-up, refitted under
        the smaller noise."""
        if not self.findings:
            return 0.0
        left, total = (mean_square(fit, self.after.outliers) for fit in (self.after, self.before))
        return max(0.0, 1.0 - left / max(total, 1e-300) - sum(f.share for f in self.findings))

    @property
    def doubts(self) -> tuple[str, ...]:
        """What speaks against the findings, where the final fit is far from its priors, and what is left beside it."""
        against = (
            (*self.fit.doubts(self.after.unit), *relief_notes(self.detection.fit, self.after)) if self.findings else ()
        )
        return (*against, *self.tension, *self.unnamed)

    @property
    def tension(self) -> tuple[str, ...]:
        """Which error is further from its prior mean than can be, and what to check; nothing where none is."""
        return tuple(f"{said[:1].upper()}{said[1:]}." for said in tension_notes(self.after))

    @property
    def excluded(self) -> tuple[str, ...]:
        """What was excluded as outliers, before and after, in a sentence; none where nothing was."""
        counts = [len(fit.outliers) for fit in ((self.before, self.after) if self.findings else (self.after,))]
        if not any(counts):
            return ()
        every, unit = self.after.problem().readings, self.after.file_unit
        numbers = " → ".join(dict.fromkeys(map(str, counts)))
        share = " → ".join(dict.fromkeys(percent(n / every) for n in counts))
        kept = self._change(self.before.rms_kept.get(unit, 0.0), self.after.rms_kept.get(unit, 0.0), unit)
        return (
            f"Excluded outliers: {numbers} of {every} readings ({share}); without them rms {kept} {self.after.unit}.",
        )

    @property
    def geometry(self) -> tuple[str, ...]:
        """The errors of the machine file that lie beyond 2σ, the clearest first, in a sentence; none where none does."""
        fit = self.after
        beyond = {p.name: abs(fit[p.name] - p.mean) / max(fit.uncertainty(p.name), 1e-300)
                  for p in fit.parameters if p.kind in ("location_error", "error_motion")}  # fmt: skip
        names = sorted((name for name in beyond if beyond[name] > 2.0), key=lambda name: -beyond[name])
        if not names:
            return ()
        shown = [fit.parameters[fit.model.index[name]] for name in names[:SHOWN_ERRORS]]
        said = [f"{p.what} {with_std(fit[p.name], fit.uncertainty(p.name), p.unit)}" for p in shown]
        more = f" and {len(names) - len(said)} more (symfive identify)" if len(names) > len(said) else ""
        return (f"Geometry identified beyond 2σ: {', '.join(said)}{more}.",)

    @property
    def proof(self) -> tuple[str, ...]:
        """What was withdrawn, and before → after of all readings, the fitted and the held-out ones; none where none were."""
        parts = (part for part in (self.searched, self.hold_out) if part is not None)
        return tuple(said for part in parts for said in part.sentences(self.after.unit))

    @property
    def verdict(self) -> str:
        """One short sentence, behind a warning where a recording seems to be wrong, or the fit did not converge."""
        return self._warned(self._verdict())

    def _verdict(self) -> str:
        names = [finding.title[:1].lower() + finding.title[1:] for finding in self.by_share]
        if names:
            faults = "Fault found" if len(names) == 1 else f"{len(names)} faults found"
            left = f" The residual is {self._beyond_noise}." if self._beyond_noise else ""
            rest = " Part of the deviation is not explained." if self.unnamed else left
            return f"{faults}: {'; '.join(names)}.{rest}"
        if self.mismatch:
            return "The model does not explain these readings, and no effect of the catalogue does."
        if self._beyond_noise:
            return f"No fault found, but the residual is {self._beyond_noise}."
        return "No fault found: the model explains these readings down to the noise."

    def __str__(self) -> str:
        lines = wrapped("", self.verdict)
        for number, finding in enumerate(self.by_share, start=1):
            lines += ["", f"{number:3}. {finding.title}"]
            for question, answer in facts_of(finding, self.after).items():
                lines += wrapped(f"{'':5}{question:16}", answer)
        if self.doubts:
            lines += ["", *(line for said in self.doubts for line in wrapped("  -  ", said))]
        return "\n".join([*lines, "", *self._quality()])

    def _change(self, before: float, after: float, unit: str = "") -> str:
        """Before → after of the findings. Without any both fits have the same model, and the second the better noise."""
        return change(before, after, unit) if self.findings else plain_number(after, unit)

    def _quality(self) -> list[str]:
        fit, unit = self.fit, self.after.unit
        noise = plain_number(self.noise_um, unit)
        which = "all readings" if self.hold_out is None else "fitted readings"
        rms = [f"{self._change(fit.rms_before_um, fit.rms_after_um, unit)} {unit}"]
        for other in self.after.rms.keys() - {self.after.file_unit}:
            old, new = (each.rms.get(other, 0.0) for each in (self.before, self.after))
            rms.append(f"{self._change(old, new, unit_words(other))} {unit_words(other)}")
        lines = [f"rms {', '.join(rms)} ({which}), noise {noise} {unit}"]
        lines += [line for said in (*self.excluded, *self.geometry) for line in wrapped("", said)]
        if self.geometry_share > SHOWN_SHARE:
            lines.append(
                f"explained by geometry and set-up (refitted): {percent(self.geometry_share)} of the deviation's mean square"
            )
        if fit.heldout_rms_before_um is not None and fit.heldout_rms_after_um is not None:
            held = self._change(fit.heldout_rms_before_um, fit.heldout_rms_after_um, unit)
            which = "runs left out in turn" if self.hold_out else "held-out runs"
            expected = plain_number(fit.heldout_expected_um.get("run", fit.rms_after_um), unit)
            lines.append(f"{which}: rms {held} {unit} (expected {expected} {unit})")
        ratio = self._change(fit.chi2_dof_before, fit.chi2_dof_after)
        lines += wrapped("", f"chi²/dof {ratio} against the declared noise ({expected_ratio(self.after.dof)})")
        if self.findings:
            lines.append(
                "± is 1σ (k = 1), if the names are right. Confidence: against all named and unidentified effects."
            )
        return [*lines, *(line for said in self.proof for line in wrapped("", said))]
