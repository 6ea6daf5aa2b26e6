"""What all verbs share: the program, arguments and options of the same meaning, notes and progress."""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from symfive.errors import InputError
from symfive.files import shown
from symfive.separated import LARGEST, SMALLEST
from symfive.version import __version__

if TYPE_CHECKING:
    from symfive.campaign import Campaign


class Number(click.ParamType[float]):
    """A number from `low` to `high`, neither NaN nor infinity nor beyond all machines."""

    name = "number"
    kind: Callable[[Any], float] = float
    words, form = "a number", "g"

    def __init__(self, low: float = -LARGEST, high: float = LARGEST) -> None:
        self.low, self.high = low, high

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number that the text says."""
        try:
            number = self.kind(value)
        except ValueError:
            self.fail(f"{shown(value)} is not {self.words}", param, ctx)
        if not self.low <= number <= self.high:
            ends = f"from {self.low:{self.form}} to {self.high:{self.form}}"
            self.fail(f"{shown(value)} is not {self.words} {ends}", param, ctx)
        return number


class Whole(Number):
    """A whole number from `low` to `high`."""

    name = "integer"
    kind = int
    words, form = "a whole number", "d"


class _Path(click.Path):
    """A path that the system can name."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path that the text says."""
        try:
            return super().convert(value, param, ctx)
        except ValueError:  # a NUL within
            self.fail(f"{shown(value)} cannot be the name of a file", param, ctx)


PATH = _Path(path_type=Path)
POSITIVE = Number(SMALLEST)
MOST = 100_000
"""Poses, circles, repeats, starts: more would not end."""
COUNT = Whole(-MOST, MOST)
SEED = Whole(0, 2**63 - 1)


class _Verb(click.Command):
    """Its usage errors know whose help explains them; click leaves that out of an option without its value."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except click.UsageError as error:
            error.ctx = error.ctx or ctx
            raise


class _InOrder(click.Group):
    """The help lists the verbs in the order in which they are defined."""

    command_class = _Verb

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)


def _show_completion(ctx: click.Context, parameter: click.Parameter, shell: str | None) -> None:
    from click.shell_completion import get_completion_class

    if shell is not None:
        complete = get_completion_class(shell)
        assert complete is not None  # the option takes no other shell
        click.echo(complete(app, {}, "symfive", "_SYMFIVE_COMPLETE").source())
        ctx.exit()


@click.group(
    cls=_InOrder,
    help="One symbolic model of five-axis machine tools: plan, measure, identify, diagnose, predict, generate code.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(__version__, message="symfive %(version)s", help="Print the version.")
@click.option(
    "--show-completion", type=click.Choice(["bash", "zsh", "fish"]), expose_value=False, is_eager=True,
    callback=_show_completion, help="Print the completion script of this shell, for its start file.",
)  # fmt: skip
def app() -> None:
    """The program."""


text = functools.partial(click.option, default="", show_default=False)
flag = functools.partial(click.option, is_flag=True)
positive = functools.partial(click.option, type=POSITIVE)
"""Options whose value is a text, is or is not there, or is a number above zero."""
campaign_path = click.argument("campaign", type=PATH, help="A campaign's folder, or its campaign.toml.")
direction = click.option(
    "--direction", multiple=True, help="ccw or cw, one per file, where the angles do not follow the motion."
)
fitted = flag("--fitted", help="The software removed each circle's mean radius and centre.")
overwrite = flag("--overwrite", help="Replace results in the folder unless somebody changed them.")
output_path = click.option("-o", "--output", type=PATH, required=True, help="The folder for the results.")
dialects = click.option(
    "--nc",
    multiple=True,
    help="Dialect of the NC programs: iso (default), siemens, heidenhain, linuxcnc …; may be repeated.",
)
as_json = flag("--json", "as_json", help="Print the result as JSON.")
quiet = flag("-q", "--quiet", help="Print nothing but errors and the result.")
scheduler = click.option("--scheduler", help="A Dask scheduler instead, e.g. tcp://host:8786.")


def cut(verb: Callable[..., None]) -> Callable[..., None]:
    """The options that thin and cut recordings: `how`, `step_deg`, `step`."""
    for option in (
        click.option("--every", "step", type=Whole(1, MOST), default=1, help="Keep every n-th row."),
        positive("--step-deg", help="With --split turns: rows of a rotary axis every so many degrees."),
        click.option("--split", "how", help="turns, cycles, or moves (between rests): cut each recording into runs."),
    ):
        verb = option(verb)
    return verb


def gathered(into: str, *names: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The options `names` of a verb as one mapping, its argument `into`."""

    def decorated(verb: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(verb)
        def run(**given: Any) -> None:
            mapping = {name: given.pop(name) for name in names}
            verb(**given, **{into: mapping})

        return run

    return decorated


class Progress:
    """Plain lines on standard error, from two seconds on."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._begin = time.monotonic()

    def __call__(self, message: str) -> None:
        elapsed = time.monotonic() - self._begin
        if not self._quiet and elapsed > 2.0:
            click.echo(f"{elapsed:5.1f} s  {message}", err=True)


def dialects_of(names: Sequence[str]) -> tuple[str, ...]:
    """The dialects asked for. Raises `InputError` for an unknown one, before any work is done."""
    from symfive.nc import dialect_of

    return tuple(dialect_of(name).name for name in names or ("iso",))


def read(path: Path, quiet: bool, *, measured: bool = False) -> Campaign:
    """A campaign, its notes printed; `measured`: raises `InputError` where a run has no readings, or readings that its instrument
    cannot have taken with these balls and commands."""
    from symfive.given import campaign_given
    from symfive.plausible import unreadable

    campaign = campaign_given(path)
    noted(campaign.notes, quiet)
    if measured and not campaign.measured:
        empty = next(run.id for run in campaign.runs if not run.measured)
        raise InputError(f"run {empty} has no readings", path=path, remedy="measure or simulate the plan first")
    if measured and (said := unreadable(campaign)):
        raise InputError(said[0], path=path, remedy=said[1])
    return campaign


def joined(path: Path, also: Sequence[Path], quiet: bool) -> Campaign:
    """A measured campaign, joined with others of the same machine. Raises `InputError` for readings that are given twice."""
    data = read(path, quiet, measured=True)
    for number, more in enumerate(also, start=2):
        found = read(more, quiet, measured=True)
        both = data.joined(found, prefix=f"c{number}-")
        for run in found.runs:
            if twin := next((own for own in data.runs if own.records_the_same(run)), None):
                problem = f"run {run.id} holds the readings of run {twin.id} again, which would count twice"
                raise InputError(problem, path=more, remedy="name each recording once")
        data = both
    return data


def refuse_namesakes(files: Sequence[Path]) -> None:
    """Raises `InputError` where two files have one name, which their runs would have too."""
    for number, path in enumerate(files):
        if path.stem in {other.stem for other in files[:number]}:
            problem = f"two files are called {shown(path.stem)}, and a run has the name of its file"
            raise InputError(problem, path=path, remedy="rename one of them, or name each file once")


def noted(notes: Iterable[object], quiet: bool) -> None:
    """Notes on standard error."""
    for note in () if quiet else notes:
        click.echo(f"note: {note}", err=True)


def written(campaign: Campaign, output: Path, quiet: bool, more: str = "") -> None:
    """What a folder holds now, and what of it is hardly meant, on standard error."""
    if not quiet:
        from symfive.plausible import doubts
        from symfive.screen import plural

        noted(doubts(campaign), quiet)
        click.echo(f"{campaign.rows} rows of {plural(len(campaign.runs), 'run')} in {output}{more}", err=True)


def tell(data: dict[str, Any], text: str, as_json: bool) -> None:
    """The result on standard output."""
    click.echo(json.dumps(data, indent=1) if as_json else text)


def numbers_of(option: str, entries: Sequence[str], example: str, least: float = -LARGEST) -> dict[str, float]:
    """NAME=VALUE as a table. Raises `InputError` for text, and for what is no number from `least` up."""
    found = {}
    for entry in entries:
        name, sign, text = entry.rpartition("=")
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not (sign and name.strip() and least <= value <= LARGEST):
            raise InputError(f"{option} {shown(entry)} is not NAME=VALUE", remedy=f"write {option} {example}")
        found[name.strip()] = value
    return found


def point_of(option: str, text: str) -> tuple[float, float, float]:
    """X,Y,Z in mm. Raises `InputError` for anything else."""
    try:
        x, y, z = (float(word) for word in text.split(","))
        if not all(abs(value) <= LARGEST for value in (x, y, z)):
            raise ValueError
    except ValueError:
        raise InputError(f'{option} "{text}" is not X,Y,Z', remedy=f"write {option} 0,0,50") from None
    return x, y, z
