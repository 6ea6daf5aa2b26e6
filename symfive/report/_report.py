"""The report of an identification: one HTML file for whoever has to act on it."""

from __future__ import annotations

import html
from collections.abc import Iterator
from pathlib import Path

from symfive.drawing import poses_figure
from symfive.identify import Identification
from symfive.numbers import expected_ratio, plain_number
from symfive.report._page import embedded, sentences, write_page
from symfive.report._save import drawings, keep
from symfive.report._standards import standards_section, worth_section
from symfive.report._style import unit_words
from symfive.report._tables import noise_table, outlier_table, parameter_table, setup_table
from symfive.report._words import confounded_machine, confounded_setup, fits, verdict

__all__ = ["identification_report"]

NAME = "identification.html"
HEADLINES = {
    "yes": "The model fits.",
    "better": "The model fits.",
    "nearly": "The model almost fits.",
    "no": "The residuals are larger than the declared noise.",
    "unknown": "The fit cannot be judged.",
}


def identification_report(
    identification: Identification, folder: Path | str, *, figures: Path | str | None = None
) -> Path:
    """Write `identification.html` into `folder` and return its path.

    `figures`: a folder for the same figures as PNG files, each drawn once (as `save_figures` writes them).

    One self-contained file (no network, below 3 MB): the verdict in plain words, what cannot be told apart, every
    parameter with 1σ, 95 % interval, unit and prior, noise found against declared, outliers by file, row and column,
    set-up of each run, and the figures. Tables sort by a click; light or dark as the reader's system; prints.
    """
    path = Path(folder) / NAME
    machine = identification.model.machine
    title = f"Identification of {machine.name}"
    target = None if figures is None else Path(figures)
    write_page(path, title, "\n".join([_head(identification, title), *_sections(identification, target)]))
    return path


def _head(identification: Identification, title: str) -> str:
    campaign, machine = identification.model.campaign, identification.model.machine
    shared = sum(p.run is None for p in identification.parameters)
    effects = ", ".join(effect.key for effect in identification.model.effects)
    facts = [
        f"Campaign {campaign.name}",
        f"structure {machine.structure.code}",
        f"{len(campaign.runs)} runs, {campaign.rows} rows",
        f"{shared} parameters of the machine and its effects, {len(identification.parameters) - shared} of set-up",
        f"the readings determine {identification.rank} of {len(identification.parameters)} parameters",
        f"method {identification.method}",
        *([f"effects in the model: {effects}"] if effects else []),
    ]
    state, converged = fits(identification), identification.converged
    headline = HEADLINES[state] if converged else "The fit did not converge."
    known = {unit: value for unit, value in identification.rms.items() if unit != "mixed"}
    rms = ", ".join(f"{plain_number(value, unit)} {unit_words(unit)}" for unit, value in known.items())
    links = (("told-apart", "Not separable"), ("values", "Parameters"), ("noise", "Noise"), ("outliers", "Outliers"),
             ("setup", "Set-up"), ("figures", "Figures"))  # fmt: skip
    return "\n".join([
        f"<h1>{html.escape(title)}</h1>",
        f'<p class="facts">{html.escape("; ".join(facts))}.</p>',
        f'<div class="verdict {state if converged else "no"}"><strong>{html.escape(headline)}</strong>',
        f"<p>{html.escape(verdict(identification))}</p></div>",
        f'<p class="facts">Residual RMS {html.escape(rms or "not available")}; '
        f"χ²/dof {identification.chi2_dof:.4g} against the declared noise, "
        f"{identification.chi2_dof_whitened:.4g} against the estimated noise; {identification.dof:.0f} "
        f"degrees of freedom: {html.escape(expected_ratio(identification.dof))}.</p>",
        "<nav>" + "".join(f'<a href="#{key}">{words}</a>' for key, words in links) + "</nav>",
    ])  # fmt: skip


def _sections(identification: Identification, target: Path | None) -> list[str]:
    machine, setup = confounded_machine(identification), confounded_setup(identification)
    said = sentences(machine) if machine else "<p>Every parameter of the machine is determined on its own.</p>"
    if setup:
        said += (
            f"<details><summary>{len(setup)} combinations of set-up parameters alone (no effect on the machine's parameters)"
            f"</summary>{sentences(setup, 200)}</details>"
        )
    notes = (*identification.notes, *identification.model.campaign.notes)
    has_setup = any(p.run is not None for p in identification.parameters)
    has_shared = any(p.run is None for p in identification.parameters)
    return [
        *(f"<p>Note: {html.escape(note)}.</p>" for note in notes),
        '<h2 id="told-apart">What these readings cannot separate</h2>', said,
        '<h2 id="values">Parameters</h2>',
        parameter_table(identification) if has_shared else "<p>None: the model has set-up parameters only.</p>",
        *worth_section(identification),
        *standards_section(identification),
        '<h2 id="noise">Noise, estimated and declared</h2>', noise_table(identification),
        '<h2 id="outliers">Outliers</h2>',
        outlier_table(identification) if identification.outliers else "<p>None.</p>",
        '<h2 id="setup">Set-up</h2>',
        setup_table(identification) if has_setup else "<p>No set-up parameter was estimated.</p>",
        '<h2 id="figures">Figures</h2>', poses_figure(identification.model.campaign),
        *_figures(identification, target),
    ]  # fmt: skip


def _figures(identification: Identification, target: Path | None) -> Iterator[str]:
    for drawing, figure, tips in drawings(identification):
        if target is not None:
            keep(figure, drawing.name, target)
        yield embedded(figure, drawing.name, drawing.title, drawing.reading, tips)
