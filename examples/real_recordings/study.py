"""What the diagnosis does with one recording, and what every finding is worth on readings that were not fitted."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.diagnose import Diagnosis, Finding, Location, Split, diagnose, held_out_square, locate, root
from symfive.effects import Effect
from symfive.identify import Identification, fitted_model, predict
from symfive.inference import gauss_newton
from symfive.model import Model

from .recordings import Recording

__all__ = [
    "HeldOut",
    "Study",
    "coordinate",
    "held_out_rms",
    "lacking",
    "named",
    "rms_of",
    "study",
    "telling_column",
]

Array = NDArray[np.float64]
TOLERANCE = 1e-2
"""σ: a refit whose steps are smaller than this has settled."""
WORSE = 1.005
"""A held-out part counts as worse from half a per cent on."""


@dataclass(frozen=True)
class HeldOut:
    """rms of the readings that were not fitted, in the recording's unit: of the baseline, with all findings, and `without`
    each finding in turn (form → rms)."""

    label: str
    before: float
    after: float
    without: dict[str, float]

    @property
    def worse(self) -> tuple[str, ...]:
        """Findings without which the held-out part would be predicted better."""
        return tuple(form for form, rms in self.without.items() if self.after > WORSE * rms)


@dataclass(frozen=True)
class Study:
    """A recording as handed over, its diagnosis, the places of what is `left`, the held-out parts, and the time it took (s)."""

    recording: Recording
    campaign: Campaign
    found: Diagnosis
    left: Location
    held_out: tuple[HeldOut, ...]
    seconds: float

    @property
    def idle(self) -> tuple[str, ...]:
        """Findings without which no held-out part is predicted any worse."""
        forms = [f.effect.key for f in self.found.findings]
        return tuple(f for f in forms if all(p.without[f] <= WORSE * p.after for p in self.held_out))

    @property
    def unsupported(self) -> tuple[str, ...]:
        """Findings that make every held-out part worse."""
        parts = [set(part.worse) for part in self.held_out]
        return tuple(sorted(set.intersection(*parts))) if parts else ()


def study(
    recording: Recording,
    campaign: Campaign,
    unseen: Campaign | None = None,
    progress: Callable[[str], None] = lambda message: None,
) -> Study:
    """Diagnose a recording that was prepared already, and predict what each part does not hold and what is `unseen`."""
    begin = time.perf_counter()
    found = diagnose(campaign, exclude=recording.exclude, progress=progress)
    progress("predicting held-out parts")
    parts = [_held_out(found, part, recording.unit) for part in recording.parts]
    if unseen is not None:
        parts.append(_other(found, unseen))
    left = locate(found.remaining, exclude=recording.exclude)
    return Study(recording, campaign, found, left, tuple(parts), time.perf_counter() - begin)


def _held_out(found: Diagnosis, part: Split, unit: str) -> HeldOut:
    without = {f.effect.key: held_out_rms(lacking(found.after, f.effect), part, unit) for f in found.findings}
    before, after = (held_out_rms(fit, part, unit) for fit in (found.before, found.after))
    return HeldOut(part.label, before, after, without)


def _other(found: Diagnosis, unseen: Campaign) -> HeldOut:
    """The same for runs that no fit has seen: their own zeros are fitted, nothing else."""

    def rms(fit: Identification) -> float:
        each = predict(fitted_model(fit), unseen).rms
        rows = np.array([unseen.run(id).rows for id in each])
        return float(np.sqrt(np.sum(rows * np.array(list(each.values())) ** 2) / rows.sum()))

    without = {f.effect.key: rms(_settled(lacking(found.after, f.effect))) for f in found.findings}
    return HeldOut("all → the other file", rms(found.before), rms(found.after), without)


def _settled(fit: Identification) -> Identification:
    return replace(fit, values=gauss_newton(fit.problem(), fit.values, TOLERANCE)[0])


def lacking(fit: Identification, effect: Effect) -> Identification:
    """The same fit without an effect; its values are a start only."""
    kept = tuple(e for e in fit.model.added if e.key != effect.key)
    model = Model(fit.model.campaign, kept)
    start = {n: v for n, v in fit.named.items() if n in model.index}
    return replace(fit, model=model, values=model.vector(start))


def held_out_rms(fit: Identification, part: Split, unit: str) -> float:
    """Root mean square, in `unit`, of the readings that `part` does not learn from, with the parameters of those it does.

    The noise of those is that of the whole fit.
    """
    problem, campaign = fit.problem(), fit.model.campaign
    problem.left_out = {run.id: problem.left_out[run.id] | ~part.learn(run)[:, None] for run in campaign.runs}
    values, _ = gauss_newton(problem, fit.values, TOLERANCE)
    return root(*held_out_square(replace(fit, values=values), campaign, part, unit))


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
