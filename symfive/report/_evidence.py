"""Tables of a diagnosis: before and after, observability, gaps in the recordings; how the geometry moved when the physics joined
the model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from symfive.campaign import Campaign
from symfive.diagnose import Diagnosis, Finding
from symfive.drawing import BLUE, ORANGE
from symfive.effects import EFFECTS, coordinate_words, form_words
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.numbers import expected_ratio, plain_number, power_of_ten, rounded, unit_words, with_std
from symfive.parameters import Parameter
from symfive.report._findings import FAINT_SIGMAS
from symfive.report._style import blank, footnote, named_rows, styled, tip
from symfive.report._tables import Cell, table
from symfive.report._words import meaning

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


MOST_ROWS = 60


@styled
def geometry_chart(before: Identification, after: Identification) -> Figure:
    """Location errors before (hollow) and after (full) with ±1σ, one panel a unit.

    Where the machine file has no location error free, its error motions' coefficients. Raises `InputError` where there
    is neither.
    """
    both = [p for p in after.parameters if p.name in before.model.index]
    parameters = [p for p in both if p.kind == "location_error"] or [p for p in both if p.kind == "error_motion"]
    if not parameters:
        raise InputError("the machine file frees no geometry", remedy="add a location error, as EX0C")
    units: dict[str, list[Parameter]] = {}
    for p in parameters[:MOST_ROWS]:
        units.setdefault(p.unit, []).append(p)
    longest = max(map(len, units.values()))
    figure = blank(4.7 * len(units) if len(units) > 1 else 6.8, 0.34 * longest + 1.25)
    panels = figure.subplots(1, len(units), squeeze=False)[0]
    for axes, (unit, mine) in zip(panels, units.items(), strict=True):
        _draw(axes, before, after, mine, unit)
    handles = [
        Line2D([], [], color=ORANGE, marker="o", markerfacecolor="none", markersize=5.0, label="before, ±1σ"),
        Line2D([], [], color=BLUE, marker="o", markersize=5.0, label="after, ±1σ"),
    ]
    figure.suptitle("Geometry before and after", x=0.01, ha="left")
    figure.legend(handles=handles, ncols=2, loc="outside upper right")
    rest = len(parameters) - MOST_ROWS
    footnote(figure, f"{rest} more in the table." if rest > 0 else "")
    return figure


def _draw(axes: Axes, before: Identification, after: Identification, parameters: list[Parameter], unit: str) -> None:
    for row, p in enumerate(parameters):
        for result, shift, colour, words in ((before, -0.15, ORANGE, "before"), (after, 0.15, BLUE, "after")):
            value, std = result[p.name], result.uncertainty(p.name)
            axes.plot([value - std, value + std], [row + shift] * 2, color=colour, linewidth=1.8, solid_capstyle="butt")
            face = colour if words == "after" else "none"
            (dot,) = axes.plot([value], [row + shift], "o", color=colour, markerfacecolor=face, markersize=5.0)
            tip(dot, f"tip-{p.name}-{words}", [f"{p.what} {words}: {with_std(value, std, unit)}"])
        std = after.uncertainty(p.name)
        moved = f"{rounded(before[p.name], std, unit)} → {rounded(after[p.name], std, unit)}"
        axes.text(1.02, row, moved, transform=axes.get_yaxis_transform(), va="center", fontsize=7.5)
    named_rows(axes, [p.what for p in parameters], unit)


def geometry_table(diagnosis: Diagnosis) -> str:
    """Every machine parameter before and after, with 1σ, and by how many σ it moved."""
    before, after = diagnosis.before, diagnosis.after
    kinds = ("location_error", "error_motion")
    names = [p.name for p in after.parameters if p.kind in kinds and p.name in before.model.index]
    moved = {name: (before[name], after[name]) for name in names}
    return _table("Machine geometry without and with all findings", moved, after)


def moved_table(finding: Finding, after: Identification) -> str:
    """What this finding alone moved: the parameters without it and with it, everything else as found."""
    said = "Change of the geometry with this finding (all others unchanged)"
    return _table(said, finding.moved, after)


def _table(caption: str, moved: Mapping[str, tuple[float, float]], after: Identification) -> str:
    rows: list[list[str | Cell]] = []
    classes = []
    machine = after.model.machine
    for name, (old, new) in moved.items():
        p = after.parameters[after.model.index[name]]
        std = after.uncertainty(name)
        sigmas = abs(new - old) / std if std > 0.0 else 0.0
        symbol = name.partition(".")[0]
        rows.append([symbol, meaning(p, machine), Cell(rounded(old, std, p.unit), old), Cell(rounded(new, std, p.unit), new),
                     Cell(rounded(std, std, p.unit), std), Cell(rounded(new - old, std, p.unit), new - old), unit_words(p.unit),
                     Cell(f"{sigmas:.1f}", sigmas)])  # fmt: skip
        classes.append("moved" if sigmas > 2.0 else "")
    heads = ["error", "meaning", "before", "after", "1σ after", "moved by", "unit", "in σ"]
    return table(caption, heads, rows, classes)
