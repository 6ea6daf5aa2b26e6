"""The report of a diagnosis: one HTML file that a service engineer reads from top to bottom."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from symfive.diagnose import SHOWN_SHARE, Diagnosis, Finding, facts_of
from symfive.drawing import poses_figure
from symfive.errors import InputError
from symfive.numbers import expected_ratio, percent, plain_number, power_of_ten
from symfive.report._bands import error_motion_bands
from symfive.report._cards import card
from symfive.report._chain import chain_picture
from symfive.report._evidence import (
    classes_list,
    fit_table,
    gap_table,
    observability_table,
    suspects_table,
    tests_table,
)  # fmt: skip
from symfive.report._finding_figure import finding_figure
from symfive.report._findings import closing
from symfive.report._geometry import geometry_chart, geometry_table
from symfive.report._over_time import READING as OVER_TIME
from symfive.report._over_time import residuals_with_tips
from symfive.report._page import embedded, write_page
from symfive.report._polar import polar_trace
from symfive.report._save import keep
from symfive.report._spectrum import READING as SPECTRUM
from symfive.report._spectrum import residual_spectrum
from symfive.report._standards import standards_section
from symfive.report._style import Tips
from symfive.report._tables import noise_table, outlier_table, setup_table
from symfive.report._visible import visible_parts

__all__ = ["diagnosis_report"]

NAME = "report.html"
IN_SHORT = ("where", "how large", "how sure")
"""What the verdict says of each finding; its card has the rest."""
Array = NDArray[np.float64]
Drawn = Callable[[], tuple[Figure, Tips]]
_READING = (
    "Residual over the coordinate named below. Left, before: the line is this effect, and the coloured dots should follow it "
    "(grey: the residual before the other findings are subtracted). Right, after: with all findings in the model, only noise "
    "should remain, evenly around zero within the grey band."
)


def diagnosis_report(diagnosis: Diagnosis, folder: Path | str) -> Path:
    """Write `report.html` and its figures (`figures/*.png`) into `folder`; returns the page's path.

    One self-contained page (no network, below 3 MB): the verdict, a card per finding in order of its share of the
    deviation, the machine's chain with the guilty links, before and after, what the campaign can see at all, the
    quality of the data, noise and set-up. Raises `InputError` where the folder cannot be written.
    """
    target = Path(folder)
    findings = diagnosis.by_share
    title = f"Diagnosis of {diagnosis.after.model.machine.name}"
    body = [
        *_head(diagnosis, findings, title),
        *_cards(diagnosis, findings, target / "figures"),
        *_proof(diagnosis, target / "figures"),
        *_sight(diagnosis),
        *standards_section(diagnosis.after),
        *_quality(diagnosis, target / "figures"),
    ]
    write_page(target / NAME, title, "\n".join(body))
    return target / NAME


def _head(diagnosis: Diagnosis, findings: Sequence[Finding], title: str) -> list[str]:
    model = diagnosis.after.model
    campaign, machine = model.campaign, model.machine
    unit = diagnosis.after.unit
    before, after = (plain_number(rms, unit) for rms in (diagnosis.fit.rms_before_um, diagnosis.fit.rms_after_um))
    tiles = [
        ("residual RMS before → after", f"{before} → {after} {unit}")
        if findings
        else ("residual RMS", f"{after} {unit}"),
        ("estimated noise (1σ of one reading)", f"{plain_number(diagnosis.noise_um, unit)} {unit}"),
        ("χ²/dof", f"{plain_number(diagnosis.fit.chi2_dof_after)} ({expected_ratio(diagnosis.after.dof)})"),
        ("p-value of “the model is complete”", power_of_ten(diagnosis.p_value)),
        ("false-alarm rate allowed", percent(diagnosis.false_alarms)),
        ("effects tested", str(len(diagnosis.observability))),
    ]
    if diagnosis.geometry_share > SHOWN_SHARE:
        part = percent(diagnosis.geometry_share)
        tiles.insert(1, ("explained by geometry and set-up (refitted)", part))
    links = [("findings", "Findings")] if findings else []
    proof = "Before and after" if findings else "Residuals"
    links += [("proof", proof), ("sight", "Sensitivity of these tests"), ("quality", "Data quality"),
              ("noise", "Noise"), ("setup", "Set-up")]  # fmt: skip
    facts = f"Campaign {campaign.name}; structure {machine.structure.code}; {len(campaign.runs)} runs, {campaign.rows} rows."
    chain = chain_picture(machine, list(enumerate(findings, start=1)), "Machine chain with the place of each finding")
    return [
        f"<h1>{html.escape(title)}</h1>",
        f'<p class="facts">{html.escape(facts)}</p>',
        _verdict(diagnosis, findings),
        '<dl class="tiles">' + "".join(f"<div><dt>{k}</dt><dd>{html.escape(v)}</dd></div>" for k, v in tiles) + "</dl>",
        chain if findings else "",
        "<nav>" + "".join(f'<a href="#{key}">{words}</a>' for key, words in links) + "</nav>",
        *(f"<p>Note: {html.escape(note)}.</p>" for note in (*diagnosis.after.notes, *campaign.notes)),
    ]


def _verdict(diagnosis: Diagnosis, findings: Sequence[Finding]) -> str:
    """The verdict, a line for each finding, what speaks against them, the next step."""
    listed = ""
    for number, finding in enumerate(findings, start=1):
        facts = facts_of(finding, diagnosis.after)
        alike = (
            [f"cannot be distinguished from {facts['reads the same']} in this test"]
            if "reads the same" in facts
            else []
        )
        said = "; ".join([*(facts[question] for question in IN_SHORT), *alike])
        listed += f'<li><a href="#finding-{number}">{html.escape(finding.title)}</a>: {html.escape(said)}</li>'
    against = "".join(f"<li>{html.escape(said)}</li>" for said in (*diagnosis.doubts, *diagnosis.excluded))
    return (
        f'<div class="verdict {"no" if diagnosis.mismatch or not diagnosis.after.converged else "yes"}">'
        f"<strong>{html.escape(diagnosis.verdict)}</strong>"
        + (f"<ol>{listed}</ol>" if listed else "")
        + (f"<ul>{against}</ul>" if against else "")
        + f"<p>{html.escape(closing(diagnosis))}</p></div>"
    )


def _cards(diagnosis: Diagnosis, findings: Sequence[Finding], figures: Path) -> Iterator[str]:
    if not findings:
        return
    yield '<h2 id="findings">Findings</h2>'
    parts = visible_parts(diagnosis.before, [f.contribution for f in findings])
    for number, (finding, visible) in enumerate(zip(findings, parts, strict=True), start=1):
        title = f"{finding.title}: residual before and after"
        picture = _figure(f"finding-{number}-residual", title, _READING,
                          partial(finding_figure, diagnosis, finding, visible, _others(parts, number - 1)), figures)  # fmt: skip
        yield card(number, finding, diagnosis, picture)


def _others(parts: Sequence[Mapping[str, Array]], mine: int) -> dict[str, Array] | None:
    """The sum of what all other findings explain; None where there is no other."""
    rest = [part for i, part in enumerate(parts) if i != mine]
    return {run: np.sum([part[run] for part in rest], axis=0) for run in rest[0]} if rest else None


def _proof(diagnosis: Diagnosis, figures: Path) -> Iterator[str]:
    yield f'<h2 id="proof">{"Before and after" if diagnosis.findings else "Residuals"}</h2>'
    yield fit_table(diagnosis)
    before, after = diagnosis.before, diagnosis.after
    if diagnosis.findings:
        said = "Where a value moved by more than its bar, the geometry had absorbed part of a finding."
        yield _figure("geometry", "Geometry before and after", said, lambda: geometry_chart(before, after), figures)
        shown = geometry_table(diagnosis)
        yield f"<details><summary>Table of all geometry errors</summary>{shown}</details>"
    said = "Measured (dashed: model) and residual, magnified further. Both directions overlaid."
    if diagnosis.findings:
        yield _figure("polar-before", "Circular tests before", f"Before: without the findings. {said}",
                      lambda: (polar_trace(before), {}), figures)  # fmt: skip
    words = "After: with all findings. " if diagnosis.findings else ""
    yield _figure("polar-after", "Circular tests", words + said, lambda: (polar_trace(after), {}), figures)
    said = "Error over the travel used, with its uncertainty. Where the band contains zero, no error is proven."
    yield _figure("error-motions", "Error motions", said, lambda: (error_motion_bands(after), {}), figures)


def _figure(name: str, title: str, reading: str, draw: Drawn, figures: Path) -> str:
    """The figure on the page and as a file; "" where there is nothing to draw."""
    try:
        figure, tips = draw()
    except InputError:
        return ""  # no circle among the runs, no error motion in the machine file
    keep(figure, name, figures)
    return embedded(figure, name, title, reading, tips)


def _sight(diagnosis: Diagnosis) -> list[str]:
    return [
        '<h2 id="sight">Is anything missing, and where</h2>',
        "<p>Tests of the fit before any finding: is the model complete, and if not, which link of the chain "
        "explains most of the mismatch?</p>",
        tests_table(diagnosis),
        suspects_table(diagnosis),
        "<h2>What this campaign could detect</h2>",
        "<p>For each effect: the share that geometry and set-up cannot absorb, and how many σ an effect of usual size "
        "would reach. An effect with a small share could be present and undetected.</p>",
        classes_list(diagnosis),
        observability_table(diagnosis),
    ]


def _quality(diagnosis: Diagnosis, figures: Path) -> list[str]:
    after = diagnosis.after
    gaps = gap_table(after.model.campaign)
    has_setup = any(p.run is not None for p in after.parameters)
    return [
        '<h2 id="quality">Data quality</h2>',
        outlier_table(after) if after.outliers else "<p>No reading is excluded as an outlier.</p>",
        gaps or "<p>No rows are missing in the recordings.</p>",
        _figure("residuals-over-time", "Residuals over time", OVER_TIME, lambda: residuals_with_tips(after), figures),
        _figure(
            "residual-spectrum", "Spectrum of the residuals", SPECTRUM, lambda: (residual_spectrum(after), {}), figures
        ),
        '<h2 id="noise">Noise, estimated and declared</h2>',
        noise_table(after),
        '<h2 id="setup">Set-up</h2>',
        setup_table(after) if has_setup else "<p>No set-up parameter was estimated.</p>",
        poses_figure(after.model.campaign),
    ]
