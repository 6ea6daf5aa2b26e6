"""Many machines, many years: the history of what was measured."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click

from symfive.cli import _common as cli
from symfive.outputs import output_file, output_folder, write_bytes, write_text

where = click.option(
    "--history", "index", type=cli.PATH, default="history", envvar="SYMFIVE_HISTORY", help="The folder of the index."
)
machine_name = click.argument("machine", help="Name, NAME#SERIAL or key of the machine.")
rate = click.option(
    "--false-alarms", type=cli.Number(1e-6, 100.0), default=0.1, help="Permitted false alarms per machine and year."
)


@cli.app.group(
    name="history", cls=type(cli.app), no_args_is_help=True,
    epilog='Example: symfive history add results/ --date 2026-03-04 && symfive history show "tilting table BC"',
)  # fmt: skip
def history() -> None:
    """Follow machines over the years. Results of many dates, alarms, forecasts, pages."""


@history.command(epilog="Example: symfive history add results/ --date 2026-03-04 --temperature 21.5 --serial A17")
@click.argument("results", type=cli.PATH, nargs=-1, required=True, help="Result folders, or folders that contain some.")
@where
@click.option("--date", help="When it was measured, e.g. 2026-03-04 or 2026-03-04T08:30 (UTC); else the files' time.")
@cli.text("--serial", help="Serial number: two machines may have the same name.")
@click.option("--as-found", "stage", flag_value="as-found", help="Before an adjustment.")
@click.option("--as-left", "stage", flag_value="as-left", help="After it: the levels of the errors are reset.")
@cli.text("--instrument", help="The instrument.")
@cli.text("--operator", help="Who measured.")
@click.option("--temperature", type=cli.Number(-60.0, 100.0), help="The machine's temperature, °C.")
@cli.text("--note", help="A note.")
@click.option(
    "--corrected",
    "corrections",
    multiple=True,
    help="NAME=VALUE (µm, µrad): correction that was active in the control.",
)
@cli.quiet
def add(
    results: tuple[Path, ...], index: Path, date: str | None, serial: str, stage: str | None, instrument: str, operator: str,
    temperature: float | None, note: str, corrections: tuple[str, ...], quiet: bool,
) -> None:  # fmt: skip
    """Add results to the history. Writes visit.json into the results."""
    from symfive.history import Details, History, instant

    details = Details(
        time=None if date is None else instant(date), serial=serial, stage=stage or "", instrument=instrument,
        operator=operator, temperature=temperature, note=note, corrections=cli.numbers_of("--corrected", corrections, "EX0C=10"),
    )  # fmt: skip
    with History(index, create=True) as opened:
        added = opened.add(results, details, progress=cli.Progress(quiet))
    cli.noted((f"{sentence}." for sentence in added.notes), quiet)
    if not quiet:
        click.echo(str(added))


@history.command(
    epilog='Example: symfive history event "tilting table BC" "new spindle" --kind repair --date 2026-04-01'
)
@machine_name
@click.argument("text", help="What happened.")
@where
@click.option(
    "--kind", type=click.Choice(["repair", "adjustment", "collision", "note"]), default="note",
    help="A repair or an adjustment resets the levels of the errors.",
)  # fmt: skip
@click.option("--date", help="When; else now.")
@cli.quiet
def event(machine: str, text: str, index: Path, kind: str, date: str | None, quiet: bool) -> None:
    """Record an event of a machine."""
    from symfive.history import History, instant

    with History(index) as opened:
        found = opened.event(machine, text, kind=kind, when=None if date is None else instant(date))
    if not quiet:
        click.echo(f"{found.machine}: {found.kind} on {found.when[:10]}: {found.text}")


@history.command(epilog='Example: symfive history show "tilting table BC" --since 2026-03-01 --tolerance EX0C=10')
@machine_name
@where
@click.option("--since", help="Also the change since the last visit up to this date.")
@click.option("--until", help="The change until the last visit up to this date, instead of the newest.")
@click.option(
    "--tolerance", "tolerances", multiple=True, help="NAME=VALUE (µm, µrad): forecast when the error exceeds ±VALUE."
)
@rate
@click.option("-o", "--output", type=cli.PATH, help="A folder for the machine's page, history.html.")
@cli.overwrite
@cli.as_json
def show(
    machine: str, index: Path, since: str | None, until: str | None, tolerances: tuple[str, ...], false_alarms: float,
    output: Path | None, overwrite: bool, as_json: bool,
) -> None:  # fmt: skip
    """Show a machine over the years. Alarms with their causes, errors and rates, forecast, when to measure again."""
    from symfive.history import History, instant, trend_text

    limits = cli.numbers_of("--tolerance", tolerances, "EX0C=10")
    with History(index) as opened:
        trend = opened.trend(machine, tolerances=limits, rate=false_alarms)
        text, data = trend_text(trend), trend.to_data()
        if since is not None or until is not None:
            change = opened.change(machine, since=_instant(instant, since), until=_instant(instant, until))
            text, data = f"{text}\n\n{change}", {**data, "change": change.to_data()}
        if output is not None:
            with output_folder(output, overwrite=overwrite) as folder:
                write_text(folder / "history.html", opened.machine_page(machine, tolerances=limits, rate=false_alarms))
    cli.tell(data, text, as_json)


@history.command(epilog="Example: symfive history fleet -o pages/")
@where
@click.option("-o", "--output", type=cli.PATH, help="A folder for fleet.html and a page of every machine.")
@cli.overwrite
@cli.as_json
def fleet(index: Path, output: Path | None, overwrite: bool, as_json: bool) -> None:
    """Show all machines. Open alarms, their dates and causes."""
    from symfive.history import History

    with History(index) as opened:
        table = opened.fleet()
        if output is not None:
            with output_folder(output, overwrite=overwrite) as folder:
                opened.write_pages(folder)
    cli.tell(table.to_data(), str(table), as_json)


@history.command(epilog="Example: symfive history rebuild results/")
@click.argument("folders", type=cli.PATH, nargs=-1, required=True, help="Folders that contain results.")
@where
@cli.quiet
def rebuild(folders: tuple[Path, ...], index: Path, quiet: bool) -> None:
    """Rebuild the index. From the records in the results, all or nothing."""
    from symfive.history import rebuilt

    found = rebuilt(index, folders, progress=cli.Progress(quiet))
    for sentence in found.problems:
        click.echo(f"symfive: {sentence}", err=True)
    if not quiet:
        click.echo(f"{found.count} records in {index}")
    if found.problems:
        raise click.exceptions.Exit(2)


@history.command(epilog="Example: symfive history export -o history.parquet")
@where
@click.option(
    "-o", "--output", type=cli.PATH, required=True, help="The table: .csv, or .parquet with symfive[history]."
)
@cli.quiet
def export(index: Path, output: Path, quiet: bool) -> None:
    """Export one long table. Every visit and error, for DuckDB, pandas or a spreadsheet."""
    from symfive.history import History

    with History(index) as opened:
        count = opened.export(output)
    if not quiet:
        click.echo(f"{count} rows in {output}")


@history.command(epilog='Example: symfive history certificate results/ -o dcc.xml --laboratory "Lab" --country DE')
@click.argument("results", type=cli.PATH, help="The folder of results.")
@click.option("-o", "--output", type=cli.PATH, required=True, help="The XML file.")
@click.option("--date", help="When it was measured; else as in the history, or the files' time.")
@cli.text("--laboratory", help="Who certifies.")
@cli.text("--laboratory-city", help="Its city.")
@cli.text("--person", help="Who is responsible and will sign.")
@cli.text("--customer", help="For whom.")
@cli.text("--customer-city", help="Its city.")
@cli.text("--country", help="Two letters, ISO 3166-1.")
@cli.text("--number", help="The certificate's number; else from the results' hash.")
@cli.text("--manufacturer", help="Of the machine.")
@click.option("--place", default="customer", help="laboratory, customer, laboratoryBranch, customerBranch or other.")
@cli.quiet
def certificate(results: Path, output: Path, date: str | None, quiet: bool, **entries: str) -> None:
    """Write a calibration certificate. PTB's DCC of one result, unsigned; missing entries are marked."""
    from symfive.history import Details, Office, instant, taken
    from symfive.history import certificate as certificate_of

    office = Office(**entries)
    with output_file(output) as path:
        visit = taken(results, Details(time=None if date is None else instant(date)))
        write_bytes(path, certificate_of(visit, office))
    options = ", ".join(f"--{name.replace('_', '-')}" for name in office.open)
    missing = f"; to be filled in: {options}" if options else ""
    cli.noted([f"the certificate is unsigned{missing}."], quiet)


@history.command(epilog="Example: symfive history serve")
@where
@click.option("--port", type=cli.Whole(0, 65535), default=0, help="Port on 127.0.0.1; 0 chooses a free one.")
def serve(index: Path, port: int) -> None:
    """Serve the pages. On this computer, at the printed address; Ctrl-C ends it."""
    from symfive.history import Server

    server = Server(index, port)
    click.echo(server.address)
    server.serve()


def _instant(instant: Callable[[str], float], text: str | None) -> float | None:
    """A date; one without a time is its whole day."""
    if text is None:
        return None
    return instant(text) + (86399.0 if "T" not in text and " " not in text.strip() else 0.0)
