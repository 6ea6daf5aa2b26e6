"""Tables of a diagnosis: before and after, observability, gaps in the recordings."""

from __future__ import annotations

import numpy as np

from symfive.campaign import Campaign
from symfive.diagnose import Diagnosis
from symfive.effects import EFFECTS, coordinate_words, form_words
from symfive.numbers import expected_ratio, plain_number, power_of_ten
from symfive.report._findings import FAINT_SIGMAS
from symfive.report._tables import Cell, table

GAP = 1.5
MOST_GAPS = 500


def fit_table(diagnosis: Diagnosis) -> str:
    """rms, χ²/dof and held-out runs, before and after, each against what is expected: of noise alone, and where readings are held
    out of what the others leave open."""
    fit, noise, unit = diagnosis.fit, diagnosis.noise_um, diagnosis.after.unit
    open_ = {what: plain_number(rms, unit) for what, rms in fit.heldout_expected_um.items()}
    before, after, held = diagnosis.before, diagnosis.after, diagnosis.hold_out
    aim = plain_number(noise, unit)
    band = expected_ratio(after.dof).removeprefix("noise alone gives ")
    lines: list[tuple[str, float | None, float | None, str, str]] = [
        (f"residual RMS of {'all readings' if held is None else 'the fitted part'}", fit.rms_before_um, fit.rms_after_um, unit,
         aim),
        ("residual RMS of held-out runs (each run in turn)", fit.heldout_rms_before_um, fit.heldout_rms_after_um, unit,
         open_.get("run", aim)),
        *((f"residual RMS, each {what} held out in turn", b, a, unit, open_.get(what, aim))
          for what, (b, a) in fit.heldout_by.items()),
        *((f"residual RMS of held-out readings ({part.label})", *part.rms["held_out"], unit, aim)
          for part in (diagnosis.searched, held) if part is not None),
        ("χ²/dof against the declared noise", fit.chi2_dof_before, fit.chi2_dof_after, "", band),
        ("χ²/dof against the estimated noise", before.chi2_dof_whitened, after.chi2_dof_whitened, "", band),
        ("parameters", len(before.parameters), len(after.parameters), "", ""),
        ("readings excluded as outliers", len(before.outliers), len(after.outliers), "", ""),
        *([("residual RMS without these", before.rms_kept.get(before.file_unit), after.rms_kept.get(after.file_unit),
            unit, aim)] if before.outliers or after.outliers else []),
    ]  # fmt: skip
    rows: list[list[str | Cell]] = [
        [what, _number(old, its), _number(new, its), its, goal]
        for what, old, new, its, goal in lines
        if old is not None
    ]
    heads = ["quantity", "before", "after", "unit", "expected"]
    return table("Residuals, compared with what is expected", heads, rows)


def _number(value: float | None, unit: str) -> str | Cell:
    if value is None:
        return "–"
    return Cell(str(value) if isinstance(value, int) else plain_number(value, unit), float(value))


def tests_table(diagnosis: Diagnosis) -> str:
    """The tests that need no name of an effect, before any finding."""
    detection = diagnosis.detection
    limit = detection.level / max(len(detection.tests), 1)
    rows: list[list[str | Cell]] = [
        [t.name, Cell(power_of_ten(t.p_value), t.p_value), t.says if t.p_value < limit else "passed"]
        for t in detection.tests
    ]
    return table("Does noise alone explain the residuals?", ["test", "p-value", "result"], rows)


def suspects_table(diagnosis: Diagnosis) -> str:
    """Where the mismatch may be: the best candidate of every link and axis, each fitted by itself."""
    found = diagnosis.location.significant
    if not found:
        return ""
    machine = diagnosis.after.model.machine
    rows: list[list[str | Cell]] = [
        [s.link, s.axis or "–", coordinate_words(s.coordinate), Cell(plain_number(s.nats), s.nats),
         form_words(s.effect.key, machine)]
        for s in found
    ]  # fmt: skip
    heads = ["link", "axis", "over", "log evidence gained", "best candidate"]
    return table("Where: each link and axis by itself, before any finding is fitted", heads, rows)


def observability_table(diagnosis: Diagnosis) -> str:
    """What the campaign can see of every effect of the catalogue, whether or not it was found."""
    rows: list[list[str | Cell]] = []
    classes = []
    machine = diagnosis.after.model.machine
    together = {key: i for i, group in enumerate(diagnosis.classes, start=1) for key in group}
    for o in sorted(diagnosis.observability, key=lambda o: -o.sigmas):
        kind = EFFECTS.get(o.form.partition(".")[0])
        group = f"class {together[o.form]}" if o.form in together else ""
        hidden = kind.hidden_by if kind is not None and o.visible < 0.5 else ""
        form, share = form_words(o.form, machine), Cell(f"{100.0 * o.visible:.1f}", o.visible)
        rows.append([o.effect.replace("_", " "), o.axis or "–", form, share,
                     Cell(f"{o.sigmas:.1f}" if o.sigmas < 1e4 else plain_number(o.sigmas), o.sigmas), group, hidden])  # fmt: skip
        classes.append("weak" if o.sigmas < FAINT_SIGMAS else "")
    heads = ["effect", "axis", "form", "visible share / %", "usual size / σ", "class (not separable)",
             "absorbed by"]  # fmt: skip
    weak = sum(c == "weak" for c in classes)
    caption = f"{len(rows)} effects tested" + (
        f"; {weak} (coloured) of usual size would be invisible here (below {FAINT_SIGMAS:g} σ)" if weak else ""
    )
    return table(caption, heads, rows, classes)


def gap_table(campaign: Campaign) -> str:
    """Rows missing from recordings at a constant rate; "" if none is."""
    rows: list[list[str | Cell]] = []
    for run in campaign.runs:
        if not run.dynamic or run.rows < 3:
            continue
        steps = np.diff(run.time)
        interval = float(np.median(steps))
        for k in np.flatnonzero(steps > GAP * interval).tolist():
            lost = round(float(steps[k]) / interval) - 1
            at = float(run.time[k])
            rows.append([run.id, run.file, Cell(str(k + 2), k), Cell(f"{at:.3f}", at),
                         Cell(plain_number(1e3 * float(steps[k])), float(steps[k])), Cell(str(lost), lost)])  # fmt: skip
    if not rows:
        return ""
    heads = ["run", "file", "after row of the file", "time / s", "gap / ms", "rows lost"]
    more = f" (first {MOST_GAPS} of {len(rows)})" if len(rows) > MOST_GAPS else ""
    return table(f"Gaps in the recordings{more}", heads, rows[:MOST_GAPS])
