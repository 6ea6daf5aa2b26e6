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
        return "record further runs and diagnose all together (--with); do not use model.json, its fit did not converge"
    for finding in diagnosis.by_share:
        if finding.next_test and finding.test is not None:
            return f"record {finding.next_test}: {finding.test.says}"
    if diagnosis.unnamed:
        return "repeat the runs at another place or feed: what is left needs more readings to get a name"
    if any(finding.alias for finding in diagnosis.findings):
        return "use model.json, but do not rely on the name where another one reads the same"
    if diagnosis.doubts:
        return "record further runs and diagnose all together (--with) before you rely on these names"
    if diagnosis.findings:
        return "use model.json, which has the findings in; a run that it has not seen is the test (symfive predict)"
    if diagnosis.noise_ratio > EXPLAINED:
        return "repeat one run: if both differ by as much, it is noise and the data sheet too hopeful"
    return "use model.json; a run it has not seen is the test (symfive predict)"


def diagnosis_text(diagnosis: Diagnosis) -> str:
    """What `symfive diagnose` prints: the diagnosis, what could not be seen, the next step."""
    return "\n".join([str(diagnosis), *wrapped("", _sight(diagnosis)), "", *wrapped("", closing(diagnosis))])


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
