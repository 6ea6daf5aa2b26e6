"""What the diagnosis does with one recording, and what it is worth on readings that no fit has seen, beside a fair rival."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.diagnose import (
    WORSE,
    Diagnosis,
    Finding,
    Location,
    Split,
    Withdrawn,
    diagnose,
    held_out_square,
    locate,
    root,
)
from symfive.effects import Varying
from symfive.identify import Identification

from .recordings import Part, Recording
from .rivals import best_rival

Array = NDArray[np.float64]
TOO_SMALL = 2.0
"""σ below which a size says nothing."""


@dataclass(frozen=True)
class HeldOut:
    """What was fitted on one part of a recording alone, and rms of the readings of the other part, in the recording's unit.

    `before` by the plain model, `after` with the `findings` that stood it, `rival` by the regression `rival_name` on top of the
    plain model. `withdrawn` are the findings of the fitted part that made the held-out part worse; `seconds` it took to find
    them.
    """

    label: str
    before: float
    after: float
    rival: float
    rival_name: str
    findings: tuple[Finding, ...]
    withdrawn: tuple[Withdrawn, ...]
    seconds: float

    @property
    def unfiltered(self) -> float:
        """With all that the fitted part shows, before anything was withdrawn."""
        return self.withdrawn[0].rms_with_um if self.withdrawn else self.after

    @property
    def worse(self) -> bool:
        """Whether the held-out part is predicted worse than by the plain model."""
        return self.after > (1.0 + WORSE) * self.before

    @property
    def won(self) -> bool:
        """Whether it is predicted at least as well as by the rival."""
        return self.after <= (1.0 + WORSE) * self.rival


@dataclass(frozen=True)
class Study:
    """A recording as handed over, the diagnosis of all of it, the places of what is `left`, the held-out parts, and the time
    that the diagnosis of all of it took (s, of the processor)."""

    recording: Recording
    campaign: Campaign
    found: Diagnosis
    left: Location
    held_out: tuple[HeldOut, ...]
    seconds: float

    def judged(self, finding: Finding) -> str:
        """Whether a finding is right, as far as the recording decides it, and why: one sentence."""
        doubt = self._doubt(finding)
        if doubt:
            return f"Not decided, because {doubt}."
        parts = "; ".join(f"{p.label}: {p.before:.3g} → {p.after:.3g}" for p in self.held_out)
        reasons = [f"each part names it by itself and predicts the other better ({parts})"]
        return f"Right as far as this recording goes, because {' and '.join([*self._confirmed(finding), *reasons])}."

    def _doubt(self, finding: Finding) -> str:
        what = (finding.name, finding.axis)
        for part in self.held_out:
            for gone in part.withdrawn:
                if gone.effect.key == finding.effect.key and type(gone.effect) is type(finding.effect):
                    sizes = f"{gone.rms_without_um:.3g} → {gone.rms_with_um:.3g}"
                    changes = " as it changes here" if isinstance(gone.effect, Varying) else ""
                    return f"with it{changes} {part.label} is predicted worse ({sizes})"
        if finding.unidentified:
            return "no law of the library has its shape: it is a curve that predicts, not a cause"
        if finding.sigmas < TOO_SMALL:
            return f"its size is {finding.sigmas:.1f} σ from nothing"
        if finding.alias:
            return f"these readings do not separate it from {', '.join(finding.alias[:2])}"
        if finding.confidence < 0.9:
            other = next((r.words for r in finding.rivals), "another cause")
            return f"it is {100.0 * finding.confidence:.0f} % probable only, beside {other}"
        missing = [p.label for p in self.held_out if what not in {(f.name, f.axis) for f in p.findings}]
        if missing:
            return f"it is not found again where less is fitted ({missing[0]})"
        useless = [p.label for p in self.held_out if not p.after < p.before]
        return f"{useless[0]} is not predicted better" if useless else ""

    def _confirmed(self, finding: Finding) -> list[str]:
        """Published values that it gives back within 3σ."""
        found = []
        for name, value in (self.recording.published or {}).items():
            q = finding.parameters.get(name)
            if q is None or not isinstance(q.value, float) or not isinstance(q.std, float):
                continue
            if abs(q.value - value) < 3.0 * q.std:
                found.append(f"{name} {q.value:.4g} ± {q.std:.2g} is what others published ({value:g})")
        return found


def study(
    recording: Recording,
    campaign: Campaign,
    unseen: Campaign | None = None,
    progress: Callable[[str], None] = lambda message: None,
) -> Study:
    """Diagnose a recording that was prepared already; then each part alone, to predict what it does not hold; and all of it, to
    predict what is `unseen`."""
    begin = time.process_time()
    found = diagnose(campaign, exclude=recording.exclude, progress=progress)
    seconds = time.process_time() - begin
    parts = [_held_out(recording, part.cut(campaign), part, progress) for part in recording.parts]
    if unseen is not None:
        known = {run.id for run in campaign.runs}
        other = Part("all → the other file", lambda run: run.id in known)
        parts.append(_held_out(recording, replace(campaign, runs=(*campaign.runs, *unseen.runs)), other, progress))
    left = locate(found.remaining, exclude=recording.exclude)
    return Study(recording, campaign, found, left, tuple(parts), seconds)


def _held_out(recording: Recording, campaign: Campaign, part: Part, progress: Callable[[str], None]) -> HeldOut:
    split = Split(part.label, lambda run: np.full(run.rows, part.learn(run)))
    begin = time.process_time()
    found = diagnose(campaign, exclude=recording.exclude, hold_out=split, progress=progress)
    seconds = time.process_time() - begin
    before, after = (
        root(*held_out_square(fit, campaign, split, recording.unit)) for fit in (found.before, found.after)
    )
    name, rival = best_rival(found.before, campaign, split, recording.unit)
    gone = found.hold_out.withdrawn if found.hold_out else ()
    return HeldOut(part.label, before, after, min(rival, before), name, found.findings, gone, seconds)


def rms_of(fit: Identification, unit: str) -> float:
    """Root mean square of all readings, in `unit`; NaN where none has it."""
    return fit.rms.get(unit, float("nan"))


def coordinate(study: Study, run_id: str) -> Array:
    """The coordinate of the figure at the rows of a run (N,): mm, degree, mm/s, degree/s or s."""
    run, over = study.campaign.run(run_id), study.recording.over
    if over == "time":
        return np.asarray(run.time)
    axis = over.removesuffix(" velocity")
    values = run.commands[axis]
    return np.gradient(values, run.time) if over != axis else np.asarray(values)


def telling_column(study: Study) -> str:
    """The reading that the figure shows: the recording's, or the one that the findings change most."""
    if study.recording.column:
        return study.recording.column
    gained: dict[str, float] = {}
    before, after = study.found.before, study.found.after
    for run in filter(study.recording.draw, study.campaign.runs):
        for k, column in enumerate(before.model.columns(run)):
            squares = [float(np.sum(fit.residuals[run.id][:, k] ** 2)) for fit in (before, after)]
            gained[column.name] = gained.get(column.name, 0.0) + squares[0] - squares[1]
    return max(gained, key=lambda name: gained[name])


def named(findings: Sequence[Finding]) -> str:
    """The names of the findings with their axes, in order."""
    words = [f"{f.name.replace('_', ' ')}{f' of {f.axis}' if f.axis else ''}" for f in findings]
    return ", ".join(words) or "nothing"
