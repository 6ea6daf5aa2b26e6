"""From readings to answers: identify, predict, diagnose, and many machines at once."""

from __future__ import annotations

from pathlib import Path

import click

from symfive.cli import _common as cli
from symfive.outputs import output_folder, write_json

also = click.option("--with", "also", type=cli.PATH, multiple=True, help="A further campaign of the same machine.")


@cli.app.command(epilog="Example: symfive identify measured/ -o results/")
@cli.campaign_path
@cli.output_path
@also
@click.option(
    "--effects",
    type=cli.PATH,
    help="A JSON file whose effects are estimated too: plan.json of a plan in motion, model.json.",
)
@click.option("--noise", default="estimate", help="estimate, or declared (as on the data sheet).")
@click.option("--loss", default="square", help="square, or huber (by IPOPT).")
@click.option("--figures/--no-figures", default=True, help="Draw figures.")
@cli.overwrite
@cli.as_json
@cli.quiet
def identify(
    campaign: Path, output: Path, also: tuple[Path, ...], effects: Path | None, noise: str, loss: str, figures: bool,
    overwrite: bool, as_json: bool, quiet: bool,
) -> None:  # fmt: skip
    """Identify the errors of a machine. Writes identification.json, model.json, identification.html and figures."""
    from symfive.identify import identify as identify_campaign
    from symfive.model import effects_from_data, read_json
    from symfive.report import identification_text
    from symfive.results import write_identification

    progress = cli.Progress(quiet)
    with output_folder(output, overwrite=overwrite) as folder:
        data = cli.joined(campaign, also, quiet)
        table = {} if effects is None else read_json(effects)
        entries = table.get("effects", []) if isinstance(table, dict) else None
        further = effects_from_data(entries, effects or "")
        result = identify_campaign(data, effects=further, noise=noise, loss=loss, progress=progress)
        write_identification(result, folder, figures=figures, progress=progress)
    cli.noted(result.notes, quiet)
    cli.tell(result.to_data(), identification_text(result), as_json)


@cli.app.command(epilog="Example: symfive predict results/model.json heldout/ -o predicted/")
@click.argument("model", type=cli.PATH, help="A fitted model.json (or its folder).")
@cli.campaign_path
@cli.output_path
@cli.overwrite
@cli.as_json
@cli.quiet
def predict(model: Path, campaign: Path, output: Path, overwrite: bool, as_json: bool, quiet: bool) -> None:
    """Predict readings with a fitted model. Set-up is fitted to runs that have readings."""
    from symfive.campaign import write_campaign_files
    from symfive.identify import predict as predict_campaign
    from symfive.model import read_model

    with output_folder(output, overwrite=overwrite) as folder:
        result = predict_campaign(read_model(model), cli.read(campaign, quiet))
        write_campaign_files(result.campaign, folder)
        setup = {run: dict(values) for run, values in result.setup.items()}
        summary = {"schema": "symfive.prediction/1", "rms": dict(result.rms), "rms_kept": dict(result.rms_kept),
                   "rms_by_column": {run: dict(each) for run, each in result.rms_by_column.items()}, "setup": setup}  # fmt: skip
        write_json(folder / "prediction.json", summary)
    cli.tell(summary, "\n".join(result.lines), as_json)


@cli.app.command(epilog="Example: symfive diagnose measured/ -o diagnosis/")
@cli.campaign_path
@cli.output_path
@also
@click.option("--false-alarms", type=cli.Number(1e-6, 0.5), default=0.01, help="False-alarm rate of the general tests.")
@click.option("--hold-out", metavar="half|cycles|runs:NAMES", help="Fit the rest, test the findings on this part.")
@cli.dialects
@cli.overwrite
@cli.as_json
@cli.quiet
def diagnose(
    campaign: Path, output: Path, also: tuple[Path, ...], false_alarms: float, hold_out: str | None,
    nc: tuple[str, ...], overwrite: bool, as_json: bool, quiet: bool,
) -> None:  # fmt: skip
    """Find the faults of a machine. Cause, location, size and confidence, the corrected model, and the next test."""
    from symfive.diagnose import diagnose as diagnose_campaign
    from symfive.report import diagnosis_text
    from symfive.results import write_diagnosis

    progress, dialects = cli.Progress(quiet), cli.dialects_of(nc)
    with output_folder(output, overwrite=overwrite) as folder:
        data = cli.joined(campaign, also, quiet)
        result = diagnose_campaign(data, false_alarms=false_alarms, hold_out=hold_out, progress=progress)
        write_diagnosis(result, folder, nc=dialects, progress=progress)
    cli.noted(result.after.notes, quiet)
    cli.tell(result.to_data(), diagnosis_text(result), as_json)


@cli.app.command(epilog="Example: symfive fleet machines/ -o results/ --workers 4")
@click.argument(
    "campaigns", type=cli.PATH, nargs=-1, required=True, help="Campaign folders, or folders that contain some."
)
@cli.output_path
@cli.flag("--diagnose", help="Diagnose instead of identify.")
@click.option("--workers", default=1, help="Processes of this computer; 0: only this one.")
@cli.scheduler
@click.option("--figures/--no-figures", default=True, help="Draw the figures (a diagnosis always does).")
@cli.flag("--redo", "--overwrite", "redo", help="Repeat campaigns that are complete.")
@cli.as_json
@cli.quiet
def fleet(
    campaigns: tuple[Path, ...], output: Path, diagnose: bool, workers: int, scheduler: str | None, figures: bool,
    redo: bool, as_json: bool, quiet: bool,
) -> None:  # fmt: skip
    """Identify or diagnose many machines. One folder of results each, and one table of all (CSV and text)."""
    from symfive.executors import executor
    from symfive.fleet import fleet as fleet_of

    with executor(workers, scheduler) as pool:
        table = fleet_of(
            campaigns, output, diagnose=diagnose, figures=figures, redo=redo, pool=pool, progress=cli.Progress(quiet)
        )
    cli.tell(table.to_data(), table.text, as_json)
    for sentence in table.failures:
        click.echo(f"symfive: {sentence}", err=True)
    if any(row.failed for row in table.rows):
        raise click.exceptions.Exit(2)
