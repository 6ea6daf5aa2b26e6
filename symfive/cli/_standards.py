"""The numbers that standards ask for, beside identification and diagnosis."""

from __future__ import annotations

from pathlib import Path

import click

from symfive.cli._common import PATH, app, as_json, campaign_path, numbers_of, quiet, read, tell
from symfive.outputs import output_file, write_json


@app.command(epilog='Example: symfive standards measured/ --tolerance "G(b)=10" --tolerance E=6')
@campaign_path
@click.option("-o", "--output", type=PATH, help="A JSON file for the numbers, too.")
@click.option(
    "--tolerance", "tolerances", multiple=True,
    help="NAME=VALUE (µm; of a rotary axis µrad; squareness µm/m), as G=8, \"G XY CCW=8\" or G@circle-1=8: pass, fail or "
    "cannot be decided.",
)  # fmt: skip
@click.option(
    "--uncertainty",
    "uncertainties",
    multiple=True,
    help="NAME=U (k = 2) from your own budget, instead of that of the noise.",
)
@as_json
@quiet
def standards(
    campaign: Path, output: Path | None, tolerances: tuple[str, ...], uncertainties: tuple[str, ...], as_json: bool, quiet: bool
) -> None:  # fmt: skip
    """Report the numbers of the standards. ISO 230-4, ISO 230-2 and ISO 10791-6, decided by ISO 14253-1."""
    from symfive.standards import decided, standard_values, standards_data, standards_text, with_uncertainties

    limits = numbers_of("--tolerance", tolerances, "E=6", least=0.0)
    known = numbers_of("--uncertainty", uncertainties, "E=6", least=0.0)
    values = with_uncertainties(standard_values(read(campaign, quiet, measured=True)), known)
    decisions = decided(values, limits)
    data = standards_data(values, decisions)
    if output is not None:
        with output_file(output) as path:
            write_json(path, data)
    tell(data, standards_text(values, decisions), as_json)
