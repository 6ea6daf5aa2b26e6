"""All figures of an identification, as files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from symfive.errors import InputError
from symfive.identify import Identification
from symfive.outputs import write_bytes
from symfive.report._correlation import correlation_matrix
from symfive.report._over_coordinates import coordinates_with_tips
from symfive.report._over_time import residuals_with_tips
from symfive.report._parameters import error_motion_bands, parameters_chart
from symfive.report._polar import polar_trace
from symfive.report._spectrum import residual_spectrum
from symfive.report._style import Tips, rendered

FORMATS = ("png", "svg", "pdf")


@dataclass(frozen=True)
class Drawing:
    """One figure of the report: file `name`, `title`, how to read it, and what draws it and says what hovering tells."""

    name: str
    title: str
    reading: str
    draw: Callable[[Identification], tuple[Figure, Tips]]


def _plain(draw: Callable[[Identification], Figure]) -> Callable[[Identification], tuple[Figure, Tips]]:
    """A drawing that says nothing more where one hovers."""
    return lambda identification: (draw(identification), {})


FIGURES = (
    Drawing("parameters", "Identified parameters",
            "Dot and line: value and 95 % interval. Grey bar: prior ±1σ. Hollow: the readings add nothing to the prior.",
            _plain(parameters_chart)),
    Drawing("polar-trace", "Circular tests",
            "Left of each pair: measured (dashed: fitted model). Right: residual, magnified further. A circle is good. A gap "
            "between the two directions at an axis points to backlash, a fixed oval to squareness or scale.",
            _plain(polar_trace)),
    Drawing("residuals-over-time", "Residuals over time",
            "Measured minus modelled, over time in s or the number of the pose. Good: noise around zero within the grey band, no "
            "waves, no steps. A single pose far out may be a misreading.",
            residuals_with_tips),
    Drawing("residuals-over-coordinates", "Residuals over the axes",
            "Residual over the position of each axis (mm or °). Two separate lines: the error depends on the direction of motion "
            "(backlash, friction, lag). Two lines that bend together: a geometric error.",
            coordinates_with_tips),
    Drawing("residual-spectrum", "Spectrum of the residuals",
            "Amplitude of the residual over frequency in 1/s, or over order (waves per revolution). Peaks above the dashed line "
            "are not noise: at a fixed frequency a vibration, at a fixed order an error that repeats every revolution.",
            _plain(residual_spectrum)),
    Drawing("error-motions", "Identified error motions",
            "Error over the travel used, with its uncertainty. Where the band contains zero, no error is proven.",
            _plain(error_motion_bands)),
    Drawing("correlations", "Correlations",
            "Strong colour: the readings determine a combination of the two parameters, not each of them.",
            _plain(correlation_matrix)),
)  # fmt: skip


def drawings(identification: Identification) -> Iterator[tuple[Drawing, Figure, Tips]]:
    """The figures that this identification has something for, and what hovering over them tells."""
    for drawing in FIGURES:
        try:
            figure, tips = drawing.draw(identification)
        except InputError:
            continue  # nothing to draw: no circle among the runs, no error motion in the machine file
        yield drawing, figure, tips


def keep(figure: Figure, name: str, folder: Path) -> None:
    """Write one figure as PNG."""
    write_bytes(folder / f"{name}.png", rendered(figure, "png"))


def save_figures(
    identification: Identification, folder: Path | str, *, formats: Sequence[str] = ("png",)
) -> list[Path]:
    """Write every figure that applies into `folder`, each file whole, and return their paths.

    `formats` of `png`, `svg`, `pdf`. Long runs are drawn thinned, and the figure says so; names are fixed
    (`residuals-over-time.png`, …). Raises `InputError` for another format or where the folder cannot be written.
    """
    for format in formats:
        if format not in FORMATS:
            raise InputError(f'figures cannot be written as "{format}"', remedy=f"use one of {', '.join(FORMATS)}")
    folder = Path(folder)
    written = []
    for drawing, figure, _ in drawings(identification):
        for format in formats:
            written.append(folder / f"{drawing.name}.{format}")
            write_bytes(written[-1], rendered(figure, format))
    return written
