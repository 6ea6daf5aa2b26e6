"""A diagnosis in words: the summary that is printed, and the next step. Plain text, to be escaped where it is shown."""

from __future__ import annotations

from symfive.diagnose import Diagnosis
from symfive.effects import form_words
from symfive.identify import may_have_stayed
from symfive.report._words import determined
from symfive.screen import first_of, wrapped
from symfive.standards import standard_values

FAINT_SIGMAS = 5.0
"""σ below which an effect of usual size would hardly be found."""
SHOWN_FAINT = 8
GEOMETRY = ("location_error", "error_motion")


def closing(diagnosis: Diagnosis) -> str:
    """The verdict again and the next step, in one line."""
    names = "; ".join(finding.title[:1].lower() + finding.title[1:] for finding in diagnosis.by_share)
    said = names or ("unnamed" if diagnosis.mismatch else "nothing found")
    return f"In short: {said}. Next: {_next_step(diagnosis)}."


def _next_step(diagnosis: Diagnosis) -> str:
    if diagnosis.other_readings:
        return diagnosis.other_readings[0]
    if not diagnosis.after.converged:
        return "record further runs and diagnose all together (--with); do not use model.json: the fit did not converge"
    for finding in diagnosis.by_share:
        if finding.next_test and finding.test is not None:
            return f"record {finding.next_test}: {finding.test.says}"
    if diagnosis.tension and not diagnosis.findings:
        return "check the set-up as said above before you enter a correction"
    if diagnosis.unnamed:
        return "repeat the runs at another position or feed; these readings do not show the cause"
    if alike := [finding for finding in diagnosis.findings if finding.alias]:
        positions = set(diagnosis.after.model.machine.axes)  # all that generated code depends on
        if all(positions.issuperset(finding.effect.coordinates) for finding in alike):
            return "symfive codegen model.json: its correction holds for every cause that this test does not separate"
        return "no further test here separates the causes: mend the one that is easiest to check, then repeat this test"
    if diagnosis.doubts:
        return "record further runs and diagnose all together (--with) before you act on these findings"
    if diagnosis.findings and diagnosis.hold_out is not None:
        return "the findings predict the held-out readings: diagnose all readings for the final values"
    if diagnosis.findings:
        return "the corrected model is model.json; check it on a run that was not used here (symfive predict)"
    if diagnosis.beyond_noise:
        if diagnosis.after.model.campaign.repeats:
            return (
                "enter the scatter of the repeated runs as noise_um; these readings do not name what is left beyond it"
            )
        return "repeat one run: if both differ by as much as this residual, it is noise above the data sheet"
    if not any(determined(diagnosis.after, p) for p in diagnosis.after.parameters if p.kind in GEOMETRY):
        return "these readings determine no error of the machine: plan a measurement that does (symfive plan)"
    return "model.json is the machine's model; check it on a run that was not used here (symfive predict), then symfive codegen"


def diagnosis_text(diagnosis: Diagnosis) -> str:
    """What `symfive diagnose` prints: the diagnosis, what this test cannot detect, the next step."""
    seen = [line for said in (*_squareness(diagnosis), _sight(diagnosis)) for line in wrapped("", said)]
    return "\n".join([str(diagnosis), *seen, "", *wrapped("", closing(diagnosis))])


def _squareness(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What the circles themselves read of squareness, beyond U, in a sentence: of the whole travel it may be known less."""
    values = [v for v in standard_values(diagnosis.after.model.campaign) if v.what == "(circle)" and abs(v.value) > v.u]
    best = {v.name: v for v in sorted(values, key=lambda v: -v.u)}
    said = "; ".join(value.words.replace(" (circle)", "") for value in best.values())
    return (f"On the circles (ISO 230-1, k = 2): {said}.",) if said else ()


def _sight(diagnosis: Diagnosis) -> str:
    machine = diagnosis.after.model.machine
    found = {finding.effect.key for finding in diagnosis.findings}  # larger than usual, then
    weak = (o for o in diagnosis.observability if o.sigmas < FAINT_SIGMAS and o.form not in found)
    faint = [form_words(o.form, machine) for o in weak]
    said = f"{len(diagnosis.observability)} effects were tested (report.html lists all)."
    if faint:
        said += f" {len(faint)} of usual size would be invisible in this test: {first_of(faint, SHOWN_FAINT)}."
    if groups := len(diagnosis.classes):
        said += f" This test cannot separate the effects within {'one group' if groups == 1 else f'each of {groups} groups'}."
    alike = may_have_stayed(diagnosis.after)
    if alike:
        said += (
            f" Set-up errors count as new in every run. If {' or '.join(alike)} stayed mounted between runs at the same "
            "position, enter it (mounting in campaign.toml): then they absorb less."
        )
    return said
