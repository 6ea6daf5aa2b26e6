"""The report of an identification: one HTML file; its figures as files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from markupsafe import Markup
from matplotlib.figure import Figure

from symfive.drawing import poses_figure
from symfive.errors import InputError, among
from symfive.identify import Identification
from symfive.inference import not_separated
from symfive.numbers import plain_number
from symfive.outputs import write_bytes
from symfive.report._correlation import correlation_matrix
from symfive.report._over_coordinates import residuals_over_coordinates
from symfive.report._over_time import residuals_over_time
from symfive.report._page import embedded, fragment, sentences, write_page
from symfive.report._parameters import error_motion_bands, parameters_chart
from symfive.report._polar import polar_trace
from symfive.report._spectrum import residual_spectrum
from symfive.report._style import rendered
from symfive.report._tables import (
    noise_table,
    outlier_table,
    parameter_table,
    setup_table,
    standards_section,
    worth_section,
)
from symfive.report._words import verdict
from symfive.screen import plural

FORMATS = ("png", "svg", "pdf")
NAME = "identification.html"
HEADLINES = {
    "yes": "The model fits.",
    "better": "The model fits.",
    "nearly": "The model almost fits.",
    "no": "The residuals are larger than the declared noise.",
    "unknown": "The fit cannot be judged.",
}


@dataclass(frozen=True)
class Drawing:
    """One figure of the report: file `name`, `title`, how to read it, and what draws it."""

    name: str
    title: str
    reading: str
    draw: Callable[[Identification], Figure]


FIGURES = (
    Drawing("parameters", "Identified parameters",
            "Dot and line: value and 95 % interval. Grey bar: prior ±1σ. Hollow: the readings add nothing to the prior.",
            parameters_chart),
    Drawing("polar-trace", "Circular tests",
            "Left of each pair: measured (dashed: fitted model). Right: residual, magnified further. A circle is good. A gap "
            "between the two directions at an axis points to backlash, a fixed oval to squareness or scale.",
            polar_trace),
    Drawing("residuals-over-time", "Residuals over time",
            "Measured minus modelled, over time in s or the number of the pose. Good: noise around zero within the grey band, no "
            "waves, no steps. A single pose far out may be a misreading.",
            residuals_over_time),
    Drawing("residuals-over-coordinates", "Residuals over the axes",
            "Residual over the position of each axis (mm or °). Two separate lines: the error depends on the direction of motion "
            "(backlash, friction, lag). Two lines that bend together: a geometric error.",
            residuals_over_coordinates),
    Drawing("residual-spectrum", "Spectrum of the residuals",
            "Amplitude of the residual over frequency in 1/s, or over order (waves per revolution). Peaks above the dashed line "
            "are not noise: at a fixed frequency a vibration, at a fixed order an error that repeats every revolution.",
            residual_spectrum),
    Drawing("error-motions", "Identified error motions",
            "Error over the travel used, with its uncertainty. Where the band contains zero, no error is proven.",
            error_motion_bands),
    Drawing("correlations", "Correlations",
            "Strong colour: the readings determine a combination of the two parameters, not each of them.",
            correlation_matrix),
)  # fmt: skip


def placed(name: str, title: str, reading: str, draw: Callable[[], Figure], folder: Path | None) -> Markup:
    """A figure on the page and, in a `folder`, as PNG; nothing where there is nothing to draw."""
    try:
        figure = draw()
    except InputError:
        return Markup()  # no circle among the runs, no error motion in the machine file
    if folder is not None:
        write_bytes(folder / f"{name}.png", rendered(figure, "png"))
    return embedded(figure, name, title, reading)


def drawn(name: str, identification: Identification, folder: Path | None) -> Markup:
    """The figure of that name in the report of an identification."""
    drawing = next(drawing for drawing in FIGURES if drawing.name == name)
    return placed(name, drawing.title, drawing.reading, partial(drawing.draw, identification), folder)


def save_figures(
    identification: Identification, folder: Path | str, *, formats: Sequence[str] = ("png",)
) -> list[Path]:
    """Write every figure that applies into `folder`, each file whole, and return their paths.

    `formats` of `png`, `svg`, `pdf`. Long runs are drawn thinned, and the figure says so; names are fixed
    (`residuals-over-time.png`, …). Raises `InputError` for another format or where the folder cannot be written.
    """
    for format in formats:
        among(format, FORMATS, f'figures cannot be written as "{format}"')
    folder = Path(folder)
    written = []
    for drawing in FIGURES:
        try:
            figure = drawing.draw(identification)
        except InputError:
            continue  # as in `placed`
        for format in formats:
            written.append(folder / f"{drawing.name}.{format}")
            write_bytes(written[-1], rendered(figure, format))
    return written


def identification_report(
    identification: Identification, folder: Path | str, *, figures: Path | str | None = None
) -> Path:
    """Write `identification.html` into `folder` and return its path.

    `figures`: a folder for the same figures as PNG files, each drawn once (as `save_figures` writes them).

    One self-contained file (no network, below 3 MB): the verdict in plain words, what cannot be separated, every
    parameter with 1σ, 95 % interval, unit and prior, noise found against declared, outliers by file, row and column,
    set-up of each run, and the figures. Tables sort by a click; light or dark as the reader's system; prints.
    """
    path, target = Path(folder) / NAME, None if figures is None else Path(figures)
    machine = identification.model.machine
    title = f"Identification of {machine.name}"
    setup = not_separated(c for c in identification.confounded if not c.of_machine)
    parameters = identification.parameters
    against = f"χ²/dof {plain_number(identification.chi2_dof_whitened)} against the estimated noise"
    quality = f"{against}; {plural(round(identification.dof), 'degree')} of freedom"
    body = fragment(
        "identification", title=title, facts=_facts(identification),
        state=identification.fits if identification.converged else "no",
        headline=HEADLINES[identification.fits] if identification.converged else "The fit did not converge.",
        verdict=verdict(identification), quality=quality,
        notes=(*identification.notes, *identification.model.campaign.notes),
        confounded=sentences(identification.inseparable), confounded_setup=sentences(setup, 200), setup_count=len(setup),
        parameters=parameter_table(identification) if any(not p.of_setup for p in parameters) else "",
        worth=worth_section(identification), standards=standards_section(identification), noise=noise_table(identification),
        outliers=outlier_table(identification) if identification.outliers else "",
        setup=setup_table(identification) if any(p.of_setup for p in parameters) else "",
        poses=Markup(poses_figure(identification.model.campaign)),
        figures=[drawn(each.name, identification, target) for each in FIGURES],
    )  # fmt: skip
    write_page(path, title, body)
    return path


def _facts(identification: Identification) -> list[str]:
    campaign, machine = identification.model.campaign, identification.model.machine
    shared = sum(not p.of_setup for p in identification.parameters)
    effects = ", ".join(effect.words for effect in identification.model.effects)
    return [
        f"Campaign {campaign.name}",
        f"structure {machine.structure.code}",
        f"{plural(len(campaign.runs), 'run')}, {campaign.rows} rows",
        f"{shared} parameters of the machine and its effects, {len(identification.parameters) - shared} of set-up",
        f"the readings determine {identification.rank} of {len(identification.parameters)} parameters",
        f"method {identification.method}",
        *([f"effects in the model: {effects}"] if effects else []),
    ]
