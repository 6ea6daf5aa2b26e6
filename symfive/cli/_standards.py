"""The numbers that standards ask for, beside identification and diagnosis."""

from __future__ import annotations

from pathlib import Path

import click

from symfive.cli import _common as cli
from symfive.outputs import output_file, write_json


@cli.app.command(epilog='Example: symfive standards measured/ --tolerance "G(b)=10" --tolerance E=6')
@cli.campaign_path
@click.option("-o", "--output", type=cli.PATH, help="A JSON file for the numbers, too.")
@click.option(
    "--tolerance", "tolerances", multiple=True,
    help="NAME=VALUE (µm; of a rotary axis µrad; squareness µm/m), e.g. G=8, \"G XY CCW=8\" or G@circle-1=8: pass, fail or "
    "cannot be decided.",
)  # fmt: skip
@click.option(
    "--uncertainty",
    "uncertainties",
    multiple=True,
    help="NAME=U (k = 2) from your own budget, instead of that of the noise.",
)
@cli.as_json
@cli.quiet
def standards(
    campaign: Path, output: Path | None, tolerances: tuple[str, ...], uncertainties: tuple[str, ...], as_json: bool, quiet: bool
) -> None:  # fmt: skip
    """Report values to the standards. ISO 230-4, ISO 230-2 and ISO 10791-6, decided by ISO 14253-1."""
    from symfive.standards import decided, standard_values, standards_data, standards_text, with_uncertainties

    limits = cli.numbers_of("--tolerance", tolerances, "E=6", least=0.0)
    known = cli.numbers_of("--uncertainty", uncertainties, "E=6", least=0.0)
    values = with_uncertainties(standard_values(cli.read(campaign, quiet, measured=True)), known)
    decisions = decided(values, limits)
    data = standards_data(values, decisions)
    if output is not None:
        with output_file(output) as path:
            write_json(path, data)
    cli.tell(data, standards_text(values, decisions), as_json)
