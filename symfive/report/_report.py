"""The report of an identification: one HTML file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from markupsafe import Markup

from symfive.drawing import poses_figure
from symfive.identify import Identification
from symfive.numbers import expected_ratio, with_unit
from symfive.report._page import embedded, fragment, sentences, write_page
from symfive.report._save import drawings, keep
from symfive.report._standards import standards_section, worth_section
from symfive.report._tables import noise_table, outlier_table, parameter_table, setup_table
from symfive.report._words import confounded_machine, confounded_setup, fits, verdict

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

    One self-contained file (no network, below 3 MB): the verdict in plain words, what cannot be separated, every
    parameter with 1σ, 95 % interval, unit and prior, noise found against declared, outliers by file, row and column,
    set-up of each run, and the figures. Tables sort by a click; light or dark as the reader's system; prints.
    """
    path = Path(folder) / NAME
    machine = identification.model.machine
    title = f"Identification of {machine.name}"
    setup = confounded_setup(identification)
    parameters = identification.parameters
    body = fragment(
        "identification", title=title, facts=_facts(identification),
        state=fits(identification) if identification.converged else "no",
        headline=HEADLINES[fits(identification)] if identification.converged else "The fit did not converge.",
        verdict=verdict(identification), quality=_quality(identification),
        notes=(*identification.notes, *identification.model.campaign.notes),
        confounded=sentences(confounded_machine(identification)), confounded_setup=sentences(setup, 200), setup_count=len(setup),
        parameters=parameter_table(identification) if any(not p.of_setup for p in parameters) else "",
        worth=worth_section(identification), standards=standards_section(identification), noise=noise_table(identification),
        outliers=outlier_table(identification) if identification.outliers else "",
        setup=setup_table(identification) if any(p.of_setup for p in parameters) else "",
        poses=Markup(poses_figure(identification.model.campaign)),
        figures=_figures(identification, None if figures is None else Path(figures)),
    )  # fmt: skip
    write_page(path, title, body)
    return path


def _facts(identification: Identification) -> list[str]:
    campaign, machine = identification.model.campaign, identification.model.machine
    shared = sum(not p.of_setup for p in identification.parameters)
    effects = ", ".join(effect.key for effect in identification.model.effects)
    return [
        f"Campaign {campaign.name}",
        f"structure {machine.structure.code}",
        f"{len(campaign.runs)} runs, {campaign.rows} rows",
        f"{shared} parameters of the machine and its effects, {len(identification.parameters) - shared} of set-up",
        f"the readings determine {identification.rank} of {len(identification.parameters)} parameters",
        f"method {identification.method}",
        *([f"effects in the model: {effects}"] if effects else []),
    ]


def _quality(identification: Identification) -> str:
    known = {unit: value for unit, value in identification.rms.items() if unit != "mixed"}
    rms = ", ".join(with_unit(value, unit) for unit, value in known.items())
    return (
        f"Residual RMS {rms or 'not available'}; χ²/dof {identification.chi2_dof:.4g} against the declared noise, "
        f"{identification.chi2_dof_whitened:.4g} against the estimated noise; {identification.dof:.0f} degrees of freedom: "
        f"{expected_ratio(identification.dof)}"
    )


def _figures(identification: Identification, target: Path | None) -> Iterator[Markup]:
    for drawing, figure, tips in drawings(identification):
        if target is not None:
            keep(figure, drawing.name, target)
        yield embedded(figure, drawing.name, drawing.title, drawing.reading, tips)
