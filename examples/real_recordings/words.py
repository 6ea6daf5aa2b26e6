"""The page and the data of all studies: every number with its unit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from symfive.diagnose import Detection, Finding
from symfive.identify import Identification

from .study import Study, named, rms_of

MOST = 8
SHOWN = 5
UNITS = {"um": "µm", "urad": "µrad", "deg": "°", "kg m^2": "kg m²", "1": ""}
SUMMARY_HEAD = (
    "recording",
    "plain model leaves",
    "findings",
    "with them",
    "held out: plain → ours, fair rival",
    "time",
)


def shown_unit(unit: str | None) -> str:
    """A unit as it is written on a page."""
    return UNITS.get(unit or "", (unit or "").replace("um", "µm").replace("urad", "µrad"))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines) + "\n"


def _number(value: float, std: float | None, unit: str | None) -> str:
    spread = f" ± {std:.2g}" if std is not None else ""
    return f"{value:.4g}{spread} {shown_unit(unit)}".strip()


def believed(study: Study) -> str:
    """Machine parameters of the plain fit, value ± 1σ, most significant first, and their values with the findings."""
    before, after = study.found.before, study.found.after
    known = [(name, value, std, unit) for name, value, std, unit, sigma in before.table() if std < 0.5 * sigma]
    ordered = sorted(known, key=lambda row: -abs(row[1]) / max(row[2], 1e-12))[:MOST]
    if not ordered:
        return "No machine parameter: these readings determine only zeros and set-ups.\n"
    rows = []
    for name, value, std, unit in ordered:
        then = _number(after[name], after.uncertainty(name), unit) if study.found.findings else "as before"
        rows.append((name, _number(value, std, unit), then))
    return table(("parameter", "plain fit, value ± 1σ", "with the findings"), rows)


def left_by(fit: Identification) -> str:
    """Residual rms of a fit, by unit of reading."""
    return ", ".join(f"{rms:.3g} {shown_unit(unit)}" for unit, rms in fit.rms.items())


def failing(detection: Detection) -> str:
    """One line per test: p-value and its statement if it fails."""
    limit = detection.level / max(len(detection.tests), 1)
    lines = [f"- {t.name}: {'p < 1e-300' if t.p_value == 0.0 else f'p = {t.p_value:.2g}'}" + (
        f"; {t.says}" if t.p_value < limit else "; passes") for t in detection.tests]  # fmt: skip
    return "\n".join(lines) + "\n"


def sizes(finding: Finding) -> str:
    """The parameters of a finding with 1σ and unit."""
    found = []
    for name, q in finding.parameters.items():
        if isinstance(q.value, str):
            found.append(f"{name} {q.value}")
        elif isinstance(q.value, float):
            plain = name.removesuffix(f"_{(q.unit or '').lower()}").replace("_", " ")
            found.append(f"{plain} {_number(q.value, q.std if isinstance(q.std, float) else None, q.unit)}")
        elif name == "matrix":
            gains = ", ".join(f"{line[k]:.3g}" for k, line in enumerate(q.value))
            found.append(f"gains of the columns {gains}, and the cross terms")
    return ", ".join(found[:SHOWN]) + (f" and {len(found) - SHOWN} more" if len(found) > SHOWN else "")


def _places(study: Study) -> str:
    suspects = study.found.location.significant
    if not suspects:
        return "No place of the chain is significant.\n"
    rows = [
        (s.link, s.axis or "", s.coordinate, s.effect.key, f"{s.log_p / math.log(10.0):.0f}") for s in suspects[:SHOWN]
    ]
    return table(("link", "axis", "coordinate", "best as", "log10 p"), rows)


def _findings(study: Study) -> str:
    found = study.found.findings
    if not found:
        return f"None. {units_said(study)}\n"
    rows = []
    for f in found:
        rivals = ", ".join(f"{r.effect}{f' {r.axis}' if r.axis else ''} {100 * r.confidence:.0f} %" for r in f.rivals[:2]
                           if r.confidence > 0.01)  # fmt: skip
        name = f.name.replace("_", " ") + (f" of {f.axis}" if f.axis else "")
        rows.append((name, f"`{f.effect.key}`", f.coordinate, sizes(f), f"{100 * f.confidence:.0f} %", rivals))
    return table(("name", "form", "over", "parameters", "confidence", "rivals"), rows)


def units_said(study: Study) -> str:
    """The verdict without findings, in the units of the readings."""
    left = left_by(study.found.after)
    return f"Of {len(study.found.observability)} effects none is significant in the residual of the baseline ({left})."


def _held_out(study: Study) -> str:
    unit = shown_unit(study.recording.unit)
    rows = []
    for part in study.held_out:
        gone = "; ".join(
            f"{w.words} ({w.rms_without_um:.3g} → {w.rms_with_um:.3g} {unit} with it)" for w in part.withdrawn
        )
        rows.append(
            (
                part.label, f"{part.before:.3g} {unit}", f"{part.after:.3g} {unit}", named(part.findings), gone or "nothing",
                f"{part.rival:.3g} {unit} ({part.rival_name})", f"{part.seconds:.0f} s",
            )
        )  # fmt: skip
    head = ("fitted → predicted", "plain", "ours", "findings of the part", "withdrawn", "rival", "time")
    return table(head, rows)


def _published(study: Study) -> str:
    wanted = study.recording.published or {}
    rows = []
    for name, value in wanted.items():
        for finding in study.found.findings:
            q = finding.parameters.get(name)
            if q is not None and isinstance(q.value, float) and isinstance(q.std, float):
                away = abs(q.value - value) / q.std
                unit = shown_unit(q.unit)
                rows.append((name, f"{value:g} {unit}", _number(q.value, q.std, q.unit), f"{away:.1f} σ"))
    return (
        "Published values of the removed effects:\n\n" + table(("", "published", "found", "difference"), rows)
        if rows
        else ""
    )


def section(study: Study, figure: str) -> str:
    """The page's section of one recording."""
    recording, found = study.recording, study.found
    left = f"{left_by(found.before)} → {left_by(found.after)}"
    pieces = [
        f"## {recording.name}\n",
        f"{recording.machine[0].upper()}{recording.machine[1:]} ({recording.source}). Input: {recording.prepared}; "
        f"{len(study.campaign.runs)} runs, {study.campaign.rows} rows. {study.seconds:.0f} s of processor time.\n",
        f"![{recording.name}](figures/{figure})\n",
        f"**1. A plain fit** leaves {left_by(found.before)}; its parameters:\n",
        believed(study),
        "Tests of its residual:\n",
        failing(found.detection),
        "**2. Place**\n",
        _places(study),
        "**3. Name**\n",
        _findings(study),
        *(f"- {f.title}. {study.judged(f)}" for f in found.findings),
        _published(study),
        f"**4. Held out** (rms of the readings in {shown_unit(recording.unit)})\n",
        _held_out(study),
        f"All readings fitted: {left}; outliers: "
        f"{len(found.before.outliers)} → {len(found.after.outliers)} readings.\n",
        "**5. What is left**\n",
        failing(found.remaining),
        f"{study.left.says}\n",
        *(f"Unidentified: {text}\n" for text in found.unnamed),
    ]  # fmt: skip
    return "\n".join(piece for piece in pieces if piece)


def summary_row(study: Study) -> tuple[str, ...]:
    """The recording's line of the table at the top."""
    unit, found = shown_unit(study.recording.unit), study.found
    held = "; ".join(f"{p.before:.3g} → {p.after:.3g}, {p.rival:.3g} {unit} ({p.label})" for p in study.held_out)
    return (
        study.recording.name, left_by(found.before), named(found.findings),
        left_by(found.after) if found.findings else "", held, f"{study.seconds:.0f} s",
    )  # fmt: skip


def score(studies: Sequence[Study]) -> str:
    """Score over the held-out parts of all recordings, in a sentence."""
    parts = [part for study in studies for part in study.held_out]
    won, worse = sum(p.won for p in parts), sum(p.worse for p in parts)
    raw = sum(p.unfiltered > 1.01 * p.before for p in parts)
    return (
        f"Of {len(parts)} held-out parts ours predicts {won} at least as well as the rival ({won / max(len(parts), 1):.0%}) and "
        f"{worse} worse than the plain model; before anything was withdrawn {raw} were.\n"
    )


def page(studies: Sequence[Study], figures: Sequence[str], absent: Sequence[str]) -> str:
    """`recordings.md`."""
    lines = [
        "# Recordings of real machines: what the diagnosis does with them\n",
        "Every number comes from readings that others took on real machines. The missing effects were not known "
        "before. A name that nothing independent confirms may be wrong.\n",
        table(SUMMARY_HEAD, [summary_row(study) for study in studies]),
        score(studies),
        'Findings are withdrawn by the same held-out part that scores them, so "ours" is no independent estimate where something '
        "was withdrawn; the rival is the best of three by that part as well.\n",
        *(f"Not included: {text}\n" for text in absent),
        *(section(study, figure) for study, figure in zip(studies, figures, strict=True)),
    ]
    return "\n".join(lines)


def to_data(study: Study) -> dict[str, Any]:
    """One entry of `recordings.json`."""
    found, unit = study.found, study.recording.unit
    return {
        "name": study.recording.name, "source": study.recording.source, "handed_over": study.recording.prepared,
        "runs": len(study.campaign.runs), "rows": study.campaign.rows, "seconds": round(study.seconds, 1), "unit": unit,
        "believed": {n: {"value": v, "std": s, "unit": u} for n, v, s, u, _ in found.before.table()},
        "rms_before": dict(found.before.rms), "rms_after": dict(found.after.rms),
        "rms_before_in_unit": rms_of(found.before, unit), "rms_after_in_unit": rms_of(found.after, unit),
        "outliers_before": len(found.before.outliers), "outliers_after": len(found.after.outliers),
        "tests": {t.name: t.p_value for t in found.detection.tests},
        "places": [{"link": s.link, "axis": s.axis, "coordinate": s.coordinate, "form": s.effect.key,
                    "log10_p": s.log_p / math.log(10.0)} for s in found.location.significant],
        "findings": [f.to_data() for f in found.findings],
        "judged": [study.judged(f) for f in found.findings],
        "held_out": [{"part": p.label, "before": p.before, "after": p.after, "unfiltered": p.unfiltered, "rival": p.rival,
                      "rival_name": p.rival_name, "findings": [f.effect.key for f in p.findings],
                      "withdrawn": [w.effect.key for w in p.withdrawn], "seconds": round(p.seconds, 1)}
                     for p in study.held_out],
        "remaining": {t.name: t.p_value for t in found.remaining.tests}, "unnamed": list(found.unnamed),
    }  # fmt: skip
