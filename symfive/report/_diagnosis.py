"""The report of a diagnosis: one HTML file that a service engineer reads from top to bottom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from markupsafe import Markup

from symfive.arrays import Array
from symfive.diagnose import SHOWN_SHARE, Diagnosis, Finding, facts_of
from symfive.drawing import poses_figure
from symfive.effects import form_words
from symfive.identify import Identification
from symfive.numbers import expected_ratio, percent, plain_number, power_of_ten
from symfive.report._cards import card
from symfive.report._chain import chain_picture
from symfive.report._evidence import (
    fit_table,
    gap_table,
    geometry_chart,
    geometry_table,
    observability_table,
    suspects_table,
    tests_table,
)
from symfive.report._finding_figure import finding_figure
from symfive.report._findings import closing
from symfive.report._page import fragment, write_page
from symfive.report._polar import polar_trace
from symfive.report._report import drawn, placed
from symfive.report._tables import noise_table, outlier_table, setup_table, standards_section, worth_section
from symfive.screen import plural

NAME = "report.html"
IN_SHORT = ("where", "how large", "how sure", "share")
"""What the verdict says of each finding, before what to do; its card has the rest."""
_READING = (
    "Residual over the coordinate named below. Left, before: the line is this effect, and the coloured dots should follow it "
    "(grey: the residual before the other findings are subtracted). Right, after: with all findings in the model, only noise "
    "should remain, evenly around zero within the grey band."
)


def diagnosis_report(diagnosis: Diagnosis, folder: Path | str) -> Path:
    """Write `report.html` and its figures (`figures/*.png`) into `folder`; returns the page's path.

    One self-contained page (no network, below 3 MB): the verdict, a card per finding in order of its share of the
    deviation, the machine chain with the affected links, before and after, what the campaign could detect, the
    quality of the data, noise and set-up. Raises `InputError` where the folder cannot be written.
    """
    target = Path(folder)
    findings = diagnosis.by_share
    title = f"Diagnosis of {diagnosis.after.model.machine.name}"
    body = fragment("diagnosis", title=title, **_head(diagnosis, findings), **_proof(diagnosis, target / "figures"),
                    **_sensitivity(diagnosis), **_quality(diagnosis, target / "figures"),
                    findings=_cards(diagnosis, findings, target / "figures"), worth=_worth(diagnosis, findings))  # fmt: skip
    write_page(target / NAME, title, body)
    return target / NAME


def _head(diagnosis: Diagnosis, findings: Sequence[Finding]) -> dict[str, object]:
    model = diagnosis.after.model
    campaign, machine = model.campaign, model.machine
    runs = plural(len(campaign.runs), "run")
    facts = f"Campaign {campaign.name}; structure {machine.structure.code}; {runs}, {campaign.rows} rows."
    title = "Machine chain with the place of each finding"
    return {
        "facts": facts,
        "bad": diagnosis.mismatch or not diagnosis.after.converged,
        "verdict": diagnosis.verdict,
        "against": (*diagnosis.doubts, *diagnosis.excluded, *diagnosis.proof),
        "closing": closing(diagnosis),
        "tiles": fragment("tiles", tiles=_tiles(diagnosis)),
        "chain": chain_picture(machine, list(enumerate(findings, start=1)), title) if findings else "",
        "notes": (*diagnosis.after.notes, *campaign.notes),
    }


def _tiles(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    unit = diagnosis.after.unit
    before, after = (plain_number(rms, unit) for rms in (diagnosis.fit.rms_before_um, diagnosis.fit.rms_after_um))
    tiles = [
        ("residual RMS before → after", f"{before} → {after} {unit}")
        if diagnosis.findings
        else ("residual RMS", f"{after} {unit}"),
        ("estimated noise (1σ of one reading)", f"{plain_number(diagnosis.noise_um, unit)} {unit}"),
        ("χ²/dof", f"{plain_number(diagnosis.fit.chi2_dof_after)} ({expected_ratio(diagnosis.after.dof)})"),
        ("p-value of the baseline (“nothing is missing”)", power_of_ten(diagnosis.p_value)),
        ("false-alarm rate of the general tests", percent(diagnosis.false_alarms)),
        ("effects tested", str(len(diagnosis.observability))),
    ]
    if diagnosis.geometry_share > SHOWN_SHARE:
        tiles.insert(1, ("explained by geometry and set-up (refitted)", percent(diagnosis.geometry_share)))
    return tiles


def _cards(diagnosis: Diagnosis, findings: Sequence[Finding], figures: Path) -> list[dict[str, object]]:
    """Title, one line and card of each finding."""
    parts = visible_parts(diagnosis.before, [f.contribution for f in findings])
    cards: list[dict[str, object]] = []
    for number, (finding, visible) in enumerate(zip(findings, parts, strict=True), start=1):
        rest = [part for other, part in enumerate(parts, start=1) if other != number]
        others = {run: np.sum([part[run] for part in rest], axis=0) for run in rest[0]} if rest else None
        picture = placed(f"finding-{number}-residual", f"{finding.title}: residual before and after", _READING,
                          partial(finding_figure, diagnosis, finding, visible, others), figures)  # fmt: skip
        facts = facts_of(finding, diagnosis.after)
        alike = [f"not separated in this test {facts['not separated']}"] if finding.alias else []
        to_do = [f"to do: {facts['what to do']}"] if "what to do" in facts else []
        short = "; ".join([*(facts[question] for question in IN_SHORT), *alike, *to_do])
        cards.append({"title": finding.title, "short": short, "card": card(number, finding, diagnosis, picture)})
    return cards


def _proof(diagnosis: Diagnosis, figures: Path) -> dict[str, object]:
    """Before and after: fit, geometry, circular tests, error motions."""
    before, after, found = diagnosis.before, diagnosis.after, bool(diagnosis.findings)
    moved = "Where a value moved by more than its bar, the geometry had absorbed part of a finding."
    circles = "Measured (dashed: model) and residual, magnified further. Both directions overlaid."
    words = "After: with all findings. " if found else ""
    return {
        "proof": "Before and after" if found else "Residuals",
        "fit": fit_table(diagnosis),
        "geometry": placed("geometry", "Geometry before and after", moved, lambda: geometry_chart(before, after), figures)
        if found else "",
        "geometry_table": geometry_table(diagnosis) if found else "",
        "polar_before": placed("polar-before", "Circular tests before", f"Before: without the findings. {circles}",
                                partial(polar_trace, before), figures) if found else "",
        "polar_after": placed("polar-after", "Circular tests", words + circles, partial(polar_trace, after), figures),
        "error_motions": drawn("error-motions", after, figures),
    }  # fmt: skip


def _sensitivity(diagnosis: Diagnosis) -> dict[str, object]:
    machine = diagnosis.after.model.machine
    return {
        "tests": tests_table(diagnosis),
        "suspects": suspects_table(diagnosis),
        "classes": [[form_words(key, machine) for key in group] for group in diagnosis.classes],
        "observability": observability_table(diagnosis),
        "standards": standards_section(diagnosis.after),
    }


def _worth(diagnosis: Diagnosis, findings: Sequence[Finding]) -> Markup:
    """Of each finding, under all names that it may have, and of each location error, each corrected alone."""
    machine = diagnosis.after.model.machine
    titles = [
        f"{f.title} (or {', '.join(form_words(key, machine) for key in f.alias)})" if f.alias else f.title
        for f in findings
    ]
    return worth_section(diagnosis.after, titles, [f.effects for f in findings])


def _quality(diagnosis: Diagnosis, figures: Path) -> dict[str, object]:
    after = diagnosis.after
    has_setup = any(p.of_setup for p in after.parameters)
    return {
        "outliers": outlier_table(after) if after.outliers else "",
        "gaps": gap_table(after.model.campaign),
        "over_time": drawn("residuals-over-time", after, figures),
        "spectrum": drawn("residual-spectrum", after, figures),
        "noise": noise_table(after),
        "setup": setup_table(after) if has_setup else "",
        "poses": Markup(poses_figure(after.model.campaign)),
    }  # fmt: skip


def visible_parts(before: Identification, contributions: Sequence[Mapping[str, Array]]) -> list[dict[str, Array]]:
    """Each contribution (run → (N, ny)) less what the parameters of `before` take of it.

    With its Jacobian J and priors P, both whitened by the noise that the fit used: c - J (JᵀJ + P⁻¹)⁻¹ Jᵀc, the
    linearised residual if c is in the readings and not in the model.
    """
    if not contributions:
        return []
    problem, taken = before.problem(), list[Array]()
    for contribution in contributions:
        information = problem.information_at(before.values, of=contribution)
        matrix = information.matrix + np.diag(problem.prior_precision)
        taken.append(np.asarray(np.linalg.solve(matrix, information.gradient)))
    return problem.less(contributions, before.values, taken)
