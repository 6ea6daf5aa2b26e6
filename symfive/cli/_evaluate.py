"""From readings to answers: identify, predict, diagnose, and many machines at once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from symfive.cli._common import (
    CampaignPath,
    Dialects,
    Json,
    OutputPath,
    Overwrite,
    Progress,
    Quiet,
    app,
    dialects_of,
    joined,
    number,
    read,
    tell,
)

__all__ = ["diagnose", "fleet", "identify", "predict"]


@app.command(epilog="Example: symfive identify measured/ -o results/")
def identify(
    campaign: CampaignPath,
    output: OutputPath,
    also: Annotated[list[Path] | None, typer.Option("--with", help="A further campaign of the same machine.")] = None,
    noise: Annotated[str, typer.Option(help="estimate, or declared (believe the data sheet).")] = "estimate",
    loss: Annotated[str, typer.Option(help="square, or huber (by IPOPT).")] = "square",
    figures: Annotated[bool, typer.Option(help="Draw the figures.")] = True,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Identify the machine's errors: identification.json, model.json, identification.html and figures."""
    from symfive.identify import identify as identify_campaign
    from symfive.outputs import output_folder
    from symfive.report import identification_text
    from symfive.results import write_identification

    progress = Progress(quiet)
    with output_folder(output, overwrite=overwrite) as folder:
        data = joined(campaign, also, quiet)
        result = identify_campaign(data, noise=noise, loss=loss, progress=progress)
        write_identification(result, folder, figures=figures, progress=progress)
    _notes(result.notes, quiet)
    tell(result.to_data(), identification_text(result), as_json)


def _notes(notes: tuple[str, ...], quiet: bool) -> None:
    """What a fit has to say of itself."""
    if not quiet:
        for note in notes:
            typer.echo(f"note: {note}", err=True)


@app.command(epilog="Example: symfive predict results/model.json heldout/ -o predicted/")
def predict(
    model: Annotated[Path, typer.Argument(help="A fitted model.json (or its folder).", show_default=False)],
    campaign: CampaignPath,
    output: OutputPath,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Predict the readings of a plan or campaign; a run's own set-up is fitted where it has readings."""
    from symfive.campaign import write_campaign_files
    from symfive.identify import predict as predict_campaign
    from symfive.model import read_model
    from symfive.outputs import output_folder, write_json

    with output_folder(output, overwrite=overwrite) as folder:
        result = predict_campaign(read_model(model), read(campaign, quiet))
        write_campaign_files(result.campaign, folder)
        setup = {run: dict(values) for run, values in result.setup.items()}
        summary = {"schema": "symfive.prediction/1", "rms": dict(result.rms), "rms_kept": dict(result.rms_kept),
                   "rms_by_column": {run: dict(each) for run, each in result.rms_by_column.items()}, "setup": setup}  # fmt: skip
        write_json(folder / "prediction.json", summary)
    tell(summary, "\n".join(result.lines), as_json)


@app.command(epilog="Example: symfive diagnose measured/ -o diagnosis/")
def diagnose(
    campaign: CampaignPath,
    output: OutputPath,
    also: Annotated[list[Path] | None, typer.Option("--with", help="A further campaign of the same machine.")] = None,
    false_alarms: Annotated[
        float,
        typer.Option(parser=number(1e-6, 0.5), metavar="N", help="False-alarm rate over the whole catalogue."),
    ] = 0.01,
    nc: Dialects = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Where the model is wrong: locate the mismatch, name the physics left out, model it and show the fit improve."""
    from symfive.diagnose import diagnose as diagnose_campaign
    from symfive.outputs import output_folder
    from symfive.report import diagnosis_text
    from symfive.results import write_diagnosis

    progress, dialects = Progress(quiet), dialects_of(nc)
    with output_folder(output, overwrite=overwrite) as folder:
        data = joined(campaign, also, quiet)
        result = diagnose_campaign(data, false_alarms=false_alarms, progress=progress)
        write_diagnosis(result, folder, nc=dialects, progress=progress)
    _notes(result.after.notes, quiet)
    tell(result.to_data(), diagnosis_text(result), as_json)


@app.command(epilog="Example: symfive fleet machines/ -o results/ --workers 4")
def fleet(
    campaigns: Annotated[
        list[Path], typer.Argument(help="Campaigns' folders, or folders that hold some.", show_default=False)
    ],
    output: OutputPath,
    diagnose: Annotated[bool, typer.Option("--diagnose", help="Diagnose instead of identify.")] = False,
    workers: Annotated[int, typer.Option(help="Processes of this computer; 0: none but this one.")] = 1,
    scheduler: Annotated[str | None, typer.Option(help="A Dask scheduler instead, as tcp://host:8786.")] = None,
    figures: Annotated[bool, typer.Option(help="Draw the figures (a diagnosis always does).")] = True,
    redo: Annotated[bool, typer.Option("--redo", "--overwrite", help="Begin anew what is complete already.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Identify or diagnose many campaigns: a folder of results each, and one table of all (CSV and text)."""
    from symfive.executors import executor
    from symfive.fleet import fleet as fleet_of

    with executor(workers, scheduler) as pool:
        table = fleet_of(
            campaigns, output, diagnose=diagnose, figures=figures, redo=redo, pool=pool, progress=Progress(quiet)
        )
    tell(table.to_data(), table.text, as_json)
    for sentence in table.failures:
        typer.echo(f"symfive: {sentence}", err=True)
    if any(row.failed for row in table.rows):
        raise typer.Exit(2)
