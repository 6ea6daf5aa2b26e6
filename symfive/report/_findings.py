"""A diagnosis in words: the verdict, one line for each finding, what to do next. Plain text: who shows it escapes it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from symfive.diagnose import Diagnosis, Finding
from symfive.effects import Quantity
from symfive.machine import Machine
from symfive.numbers import expected_ratio, name_words, plain_number, rounded, unit_words, with_std
from symfive.report._chain import guilty

__all__ = [
    "FAINT_SIGMAS", "closing", "diagnosis_text", "doubts", "finding_line", "in_order", "over", "percent", "runs_of",
    "title_of", "verdict_of",
]  # fmt: skip

FAINT_SIGMAS = 5.0
"""An effect whose usual size stands out by less would hardly be found."""
SHOWN_RUNS, SHOWN_SIZES, SHOWN_FAINT = 6, 4, 8
EXPLAINED = 1.1
_QUANTITIES = {
    "velocity sign": "the direction in which {} moves", "velocity": "the velocity of {}",
    "acceleration": "the acceleration of {}", "": "the position of {}",
}  # fmt: skip


def in_order(diagnosis: Diagnosis) -> list[Finding]:
    """The findings, the largest share of the deviation first."""
    return sorted(diagnosis.findings, key=lambda finding: -finding.share)


def title_of(finding: Finding) -> str:
    """The effect and its axis, as `Gravity sag of axis B`."""
    where = f" of axis {finding.axis}" if finding.axis else ""
    return f"{finding.name.replace('_', ' ').capitalize()}{where}"


def percent(share: float) -> str:
    """A share in percent; what rounds to all or none says that it is more or less."""
    if share >= 0.999:
        return "above 99.9 %"
    if share < 1e-3:
        return "0 %" if share <= 0.0 else "below 0.1 %"
    return f"{100.0 * share:.3g} %"


def over(finding: Finding, machine: Machine) -> str:
    """The coordinate in words."""
    said = []
    for words in finding.coordinate.split(", "):
        name, _, quantity = words.partition(" ")
        known = name in machine.axes and quantity in _QUANTITIES
        said.append(_QUANTITIES[quantity].format(name) if known else {"t": "time"}.get(words, words))
    return " and ".join(said)


def runs_of(finding: Finding, diagnosis: Diagnosis) -> str:
    """The runs in which it acts."""
    names: Sequence[str] = finding.runs
    if len(names) == len(diagnosis.after.model.campaign.runs) > 1:
        return "in all runs"
    more = f" and {len(names) - SHOWN_RUNS} more runs" if len(names) > SHOWN_RUNS else ""
    return f"in {', '.join(names[:SHOWN_RUNS])}{more}"


def verdict_of(diagnosis: Diagnosis) -> str:
    """One short sentence."""
    count = len(diagnosis.findings)
    if count:
        left = ", and something is left that has no name" if diagnosis.unnamed else ""
        return f"{'One piece' if count == 1 else f'{count} pieces'} of physics had been left out of the model{left}."
    if diagnosis.mismatch:
        return "Something is left that has no name."
    ratio = _noise_ratio(diagnosis)
    if ratio > EXPLAINED:
        return f"Nothing with a name is missing, but what is left is {ratio:.2g} times the declared noise."
    return "The model explains these readings; nothing is missing that they could show."


def finding_line(finding: Finding, diagnosis: Diagnosis) -> str:
    """What, where, how large with its 1σ and unit, how sure."""
    machine = diagnosis.after.model.machine
    place = f"in {guilty(finding, machine).words}, over {over(finding, machine)}, {runs_of(finding, diagnosis)}"
    sizes = ", ".join(_sizes(finding)[:SHOWN_SIZES])
    return f"{title_of(finding)}: {place}{f'; {sizes}' if sizes else ''}; confidence {percent(finding.confidence)}"


def _sizes(finding: Finding) -> list[str]:
    """Its parameters; those within 2σ of 0 only where no other number stands out."""
    words, clear, faint = list[str](), list[str](), list[str]()
    for name, quantity in finding.parameters.items():
        value, std = quantity.value, quantity.std
        said = f"{name_words(name, quantity.unit)} {_quantity(quantity)}"
        if isinstance(value, (int, float)) and isinstance(std, (int, float)):
            (faint if abs(value) < 2.0 * std else clear).append(said)
        else:
            words.append(said)
    return [*words, *(clear or faint)]


def _quantity(quantity: Quantity) -> str:
    value, std, unit = quantity.value, quantity.std, quantity.unit or ""
    if isinstance(value, str):
        return value
    if isinstance(value, tuple):
        spreads = std if isinstance(std, tuple) else (0.0,) * len(value)
        pairs = [(v, s if isinstance(s, (int, float)) else 0.0) for v, s in zip(value, spreads, strict=False)]
        words = unit_words(unit) if unit != "1" else ""
        said = ", ".join(rounded(v, s, unit) if isinstance(v, (int, float)) else str(v) for v, s in pairs)
        return f"({said}) {words}".rstrip()
    return with_std(float(value), float(std) if isinstance(std, (int, float)) else 0.0, unit)


def doubts(diagnosis: Diagnosis) -> list[str]:
    """What speaks against the findings, what else could be meant, and what is left beside them."""
    against = diagnosis.fit.doubts(diagnosis.after.unit) if diagnosis.findings else ()
    return [*map(_alike, filter(lambda f: f.alias, in_order(diagnosis))), *against, *diagnosis.unnamed]


def _alike(finding: Finding) -> str:
    test = f": {finding.test.says}" if finding.test is not None else ""
    return f"{title_of(finding)}: {', '.join(finding.alias)} would read the same here{test}."


def closing(diagnosis: Diagnosis) -> str:
    """The verdict again and the next step, in one line."""
    findings = in_order(diagnosis)
    tested = [f for f in findings if f.test is not None and f.next_test]
    names = ", ".join(title[:1].lower() + title[1:] for title in map(title_of, findings))
    if tested:
        step = f"record {tested[0].next_test}: {tested[0].test.says}"  # type: ignore[union-attr]
    elif diagnosis.unnamed:
        step = "repeat the runs at another place or feed: what is left needs more readings to get a name"
    elif any(f.alias for f in findings):
        step = "use model.json, but do not rely on the name where another one reads the same"
    elif doubts(diagnosis):
        step = "record further runs and diagnose all together (--with) before you rely on these names"
    elif findings:
        step = "use model.json, which has the findings in; a run that it has not seen is the test (symfive predict)"
    elif _noise_ratio(diagnosis) > EXPLAINED:
        step = "repeat one run: if both differ by as much, it is noise and the data sheet too hopeful"
    else:
        step = "use model.json; a run that it has not seen is the test (symfive predict)"
    said = (
        f"In short: {names}" if findings else "In short: unnamed" if diagnosis.mismatch else "In short: nothing found"
    )
    return f"{said}. Next: {step}."


def diagnosis_text(diagnosis: Diagnosis) -> str:
    """What `symfive diagnose` prints: verdict, findings, what the fit leaves, what could not be seen, the next step."""
    fit, after = diagnosis.fit, diagnosis.after
    unit = after.unit
    lines = [verdict_of(diagnosis)]
    lines += [f"{i:3}. {finding_line(f, diagnosis)}" for i, f in enumerate(in_order(diagnosis), start=1)]
    lines += [f"  -  {said}" for said in doubts(diagnosis)]
    lines.append("")
    lines.append(f"rms {_change(fit.rms_before_um, fit.rms_after_um, unit)} {unit}, "
                 f"noise {plain_number(diagnosis.noise_um, unit)} {unit}")  # fmt: skip
    if fit.heldout_rms_before_um is not None and fit.heldout_rms_after_um is not None:
        held = _change(fit.heldout_rms_before_um, fit.heldout_rms_after_um, unit)
        lines.append(f"left-out runs: rms {held} {unit}")
    ratio = _change(fit.chi2_dof_before, fit.chi2_dof_after, "")
    lines.append(f"chi²/dof {ratio} to the declared noise ({expected_ratio(after.dof)})")
    return "\n".join([*lines, _sight(diagnosis), "", closing(diagnosis)])


def _change(before: float, after: float, unit: str) -> str:
    old, new = plain_number(before, unit), plain_number(after, unit)
    return new if old == new else f"{old} → {new}"


def _sight(diagnosis: Diagnosis) -> str:
    faint = [o.form for o in diagnosis.observability if o.sigmas < FAINT_SIGMAS]
    said = f"{len(diagnosis.observability)} effects were looked for"
    if faint:
        more = f" and {len(faint) - SHOWN_FAINT} more" if len(faint) > SHOWN_FAINT else ""
        said += f"; {len(faint)} of usual size would hardly show here: {', '.join(faint[:SHOWN_FAINT])}{more}"
    if diagnosis.classes:
        group = "group" if len(diagnosis.classes) == 1 else "groups"
        said += f"; {len(diagnosis.classes)} {group} of them read alike"
    return f"{said} (report.html lists all)"


def _noise_ratio(diagnosis: Diagnosis) -> float:
    return math.sqrt(max(diagnosis.fit.chi2_dof_after, 0.0))
