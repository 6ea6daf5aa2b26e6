"""Check the files of a machine or campaign."""

from __future__ import annotations

from pathlib import Path

import click

from symfive.cli import _common as cli


@cli.app.command(epilog="Example: symfive check machine.toml")
@click.argument("path", type=cli.PATH, help="A machine file, or a campaign's folder.")
@cli.as_json
@cli.flag("-q", "--quiet", help="Print the problems only.")
def check(path: Path, as_json: bool, quiet: bool) -> None:
    """Check files. Prints a summary and every problem; exit code 1 if there is one."""
    from symfive.check import check as check_files

    result = check_files(path)
    if as_json or not quiet:
        cli.tell(result.to_data(), str(result), as_json)
    elif not result.right:
        click.echo("\n".join(map(str, result.problems)))
    if not result.right:
        raise click.exceptions.Exit(1)
