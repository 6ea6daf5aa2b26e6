"""A diagnosis in words: the letter that is printed, and the next step. Plain text: who shows it escapes it."""

from __future__ import annotations

from symfive.diagnose import EXPLAINED, Diagnosis, named, wrapped

__all__ = ["FAINT_SIGMAS", "closing", "diagnosis_text"]

FAINT_SIGMAS = 5.0
"""An effect whose usual size stands out by less would hardly be found."""
SHOWN_FAINT = 8


def closing(diagnosis: Diagnosis) -> str:
    """The verdict again and the next step, in one line."""
    names = ", ".join(named(finding.name, finding.axis) for finding in diagnosis.by_share)
    said = names or ("unnamed" if diagnosis.mismatch else "nothing found")
    return f"In short: {said}. Next: {_next_step(diagnosis)}."


def _next_step(diagnosis: Diagnosis) -> str:
    if not diagnosis.after.converged:
        return "record further runs and diagnose all together (--with); do not use model.json: the fit did not converge"
    for finding in diagnosis.by_share:
        if finding.next_test and finding.test is not None:
            return f"record {finding.next_test}: {finding.test.says}"
    if diagnosis.unnamed:
        return "repeat the runs at another place or feed; the cause needs more readings"
    if any(finding.alias for finding in diagnosis.findings):
        return "use model.json: its correction holds, but the cause is not unique"
    if diagnosis.doubts:
        return "record further runs and diagnose all together (--with) before you act on these findings"
    if diagnosis.findings and diagnosis.hold_out is not None:
        return "the findings stand on readings that no fit has seen: diagnose all readings for the final values"
    if diagnosis.findings:
        return "the corrected model is model.json; check it on a run that was not used here (symfive predict)"
    if diagnosis.noise_ratio > EXPLAINED:
        return "repeat one run: if the two differ as much, it is noise, and larger than the data sheet says"
    return "use model.json; check it on a run that was not used here (symfive predict)"


def diagnosis_text(diagnosis: Diagnosis) -> str:
    """What `symfive diagnose` prints: the diagnosis, what could not be seen, the next step."""
    return "\n".join([str(diagnosis), *wrapped("", _sight(diagnosis)), "", *wrapped("", closing(diagnosis))])


def _sight(diagnosis: Diagnosis) -> str:
    faint = [o.form for o in diagnosis.observability if o.sigmas < FAINT_SIGMAS]
    said = f"{len(diagnosis.observability)} effects were tested"
    if faint:
        more = f" and {len(faint) - SHOWN_FAINT} more" if len(faint) > SHOWN_FAINT else ""
        said += f"; {len(faint)} of usual size would be invisible in this test: {', '.join(faint[:SHOWN_FAINT])}{more}"
    if diagnosis.classes:
        group = "group" if len(diagnosis.classes) == 1 else "groups"
        said += f"; {len(diagnosis.classes)} {group} of them cannot be separated"
    return f"{said} (report.html lists all)"
