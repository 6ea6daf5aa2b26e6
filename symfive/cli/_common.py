"""What all verbs share: the program, arguments and options of the same meaning, notes and progress."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symfive.files import shown
from symfive.separated import LARGEST, SMALLEST

if TYPE_CHECKING:
    from symfive.campaign import Campaign

__all__ = [
    "MOST",
    "MOST_SEED",
    "POSITIVE",
    "CampaignPath",
    "Dialects",
    "Json",
    "OutputPath",
    "Overwrite",
    "Progress",
    "Quiet",
    "app",
    "dialects_of",
    "joined",
    "read",
    "tell",
]  # fmt: skip

app = typer.Typer(
    name="symfive",
    help="One symbolic model of five-axis machine tools: plan, measure, identify, diagnose, predict, generate code.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: loading rich takes as long as all the rest
    context_settings={"help_option_names": ["-h", "--help"]},
)

CampaignPath = Annotated[Path, typer.Argument(help="A campaign's folder, or its campaign.toml.", show_default=False)]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace results that lie there, unless somebody changed them.")
]
OutputPath = Annotated[Path, typer.Option("-o", "--output", help="The folder for the results.", show_default=False)]
Dialects = Annotated[
    list[str] | None,
    typer.Option(
        "--nc", help="Dialect of the NC programs: iso (default), siemens, heidenhain or linuxcnc; may be repeated."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print nothing but errors and the result.")]


def number(low: float = -LARGEST, high: float = LARGEST) -> Callable[[str], float]:
    """The parser of an option: a number from `low` to `high`, neither NaN nor infinity nor beyond all machines."""

    def parsed(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise typer.BadParameter(f"{shown(text)} is not a number") from None
        if not low <= value <= high:
            raise typer.BadParameter(f"{shown(text)} is not a number from {low:g} to {high:g}")
        return value

    return parsed


POSITIVE = SMALLEST
"""The least that is positive."""
MOST = 100_000
"""Poses, circles, repeats, starts: more would not end."""
MOST_SEED = 2**63 - 1


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"symfive {version('symfive')}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


class Progress:
    """Plain lines on standard error, from two seconds on."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._begin = time.monotonic()

    def __call__(self, message: str) -> None:
        elapsed = time.monotonic() - self._begin
        if not self._quiet and elapsed > 2.0:
            typer.echo(f"{elapsed:5.1f} s  {message}", err=True)


def dialects_of(names: list[str] | None) -> tuple[str, ...]:
    """The dialects asked for. Raises `InputError` for an unknown one, before any work is done."""
    from symfive.nc import dialect_of

    return tuple(dialect_of(name).name for name in names or ("iso",))


def read(path: Path, quiet: bool, *, measured: bool = False) -> Campaign:
    """A campaign, its notes told; `measured`: raises `InputError` where a run has no readings."""
    from symfive.errors import InputError
    from symfive.given import campaign_given

    campaign = campaign_given(path)
    if not quiet:
        for note in campaign.notes:
            typer.echo(f"note: {note}", err=True)
    if measured and not campaign.measured:
        empty = next(run.id for run in campaign.runs if not run.measured)
        raise InputError(f"run {empty} has no readings", path=path, remedy="measure or simulate the plan first")
    return campaign


def joined(path: Path, also: list[Path] | None, quiet: bool) -> Campaign:
    """A measured campaign, joined with further ones of the same machine."""
    data = read(path, quiet, measured=True)
    for number, more in enumerate(also or [], start=2):
        data = data.joined(read(more, quiet, measured=True), prefix=f"c{number}-")
    return data


def tell(data: dict[str, Any], text: str, as_json: bool) -> None:
    """The result on standard output."""
    typer.echo(json.dumps(data, indent=1) if as_json else text)
