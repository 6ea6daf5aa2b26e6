"""NC programs of a plan. A dialect is one small file and one line of the table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import count
from pathlib import Path

from symfive.campaign import Campaign, Run
from symfive.errors import InputError, among
from symfive.instruments import is_probed
from symfive.machine import Machine
from symfive.nc._arc import circle_of
from symfive.nc._base import Dialect, Step
from symfive.nc._pace import CAUTION, able, pace
from symfive.nc._post import UNCHECKED, Post, collision_warning, table_assumed, turned_against, which_point
from symfive.nc._probing import Prober, check_probing, cycle_of
from symfive.nc._render import render
from symfive.nc._route import (
    Positions,
    Way,
    at_the_top,
    lifts,
    one_by_one,
    out_to_the_top,
    over_the_top,
    top_of,
    turned_home,
    upright_axis,
)
from symfive.nc._seat import Seat, along_arcs
from symfive.nc._steps import (
    addressed,
    arrival_times,
    check_addresses,
    outside_s,
    program_steps,
    retract_words,
    rotary_ranges,
    series_name,
    series_of,
    series_steps,
    stands,
)
from symfive.nc._touch import Probing, touch_reach
from symfive.nc._writer import word_order
from symfive.nc.heidenhain import HEIDENHAIN
from symfive.nc.iso import ISO
from symfive.nc.linuxcnc import LINUXCNC
from symfive.nc.siemens import SIEMENS
from symfive.outputs import write_text

__all__ = [
    "CAUTION", "DIALECTS", "UNCHECKED", "Dialect", "Positions", "Post", "Probing", "Seat", "Step", "Way", "able", "addressed",
    "along_arcs", "arrival_times", "at_the_top", "can_write", "check_addresses", "circle_of", "collision_warning", "dialect_of",
    "lifts", "one_by_one", "out_to_the_top", "outside_s", "over_the_top", "pace", "program", "program_steps", "retract_words",
    "rotary_ranges", "series_name", "series_of", "stands", "table_assumed", "top_of", "touch_reach", "turned_against",
    "turned_home", "upright_axis", "which_point", "word_order", "write_programs",
]  # fmt: skip

DIALECTS: dict[str, Dialect] = {dialect.name: dialect for dialect in (ISO, SIEMENS, HEIDENHAIN, LINUXCNC)}


def dialect_of(name: str) -> Dialect:
    """The dialect of that name. Raises `InputError`."""
    among(name, DIALECTS, f'NC dialect "{name}" is unknown')
    return DIALECTS[name]


def can_write(machine: Machine, dialect: str, post: Post, *, probing: bool = False) -> None:
    """Raises `InputError` where programs for that machine and control cannot be written as the user decided."""
    check_addresses(machine)
    chosen = dialect_of(dialect)
    if chosen.worded(post).centred and not {"X", "Y", "Z"} <= set(machine.linear_axes):
        raise InputError(
            "tool-centre control moves X, Y and Z", remedy="leave out --tool-centre, or name the linear axes so"
        )
    if probing:
        check_probing(machine)
        cycle_of(chosen, post)


def _text(
    machine: Machine, run: Run, dialect: Dialect, steps: Sequence[Step], post: Post, number: int = 1, name: str = ""
) -> str:
    head = (
        f"symfive for {dialect.name}, {dialect.verified}",
        f"read it and dry-run it {'' if run.dynamic else 'slowly '}without the instrument first",
        *collision_warning(machine, post, (run,)),
        which_point(machine, run, post),
        *turned_against(post),
        *filter(None, [rotary_ranges(machine, run, post)]),
        dialect.datum,
        _first(dialect, machine, post),
    )
    rotary = bool(machine.rotary_axes)
    return render(
        dialect, name or run.id, [*(Step(kind="comment", text=said) for said in head), *steps], number, rotary=rotary
    )


def _first(dialect: Dialect, machine: Machine, post: Post) -> str:
    """Where the first move goes."""
    axis = upright_axis(machine)
    number = any("{words}" in line for line in dialect.retract)
    there = f"{axis} {post.machine_top:g} in machine coordinates" if number else f"the reference point of {axis}"
    return f"first move: {axis} alone to {there}, which must be the top of its travel; then rotary axes, plane, {axis}"


def _written(
    machine: Machine, run: Run, dialect: Dialect, post: Post, number: int, probing: Probing | None = None
) -> str:
    """One run's program."""
    if not is_probed(run):
        return _text(machine, run, dialect, program_steps(machine, run, post), post, number)
    steps = Prober(machine, run, dialect, post, probing).steps()
    return _text(machine, run, cycle_of(dialect, post).prepared(dialect, post), steps, post, number)


def program(machine: Machine, run: Run, dialect: str, post: Post | None = None, probing: Probing | None = None) -> str:
    """The program of one run; `probing`: sphere, tip and feeds of a touch probe. Raises `InputError` for an unknown dialect and
    for axes without an NC address."""
    chosen = dialect_of(dialect)
    return _written(machine, run, chosen, chosen.worded(post or Post()), 1, probing)


def write_programs(
    campaign: Campaign, folder: Path | str, dialects: Iterable[str], post: Post | None = None
) -> tuple[Path, ...]:
    """One program per run and dialect into `folder`/dialect, named and numbered as the runs, behind these one per series of
    circles during which the bar stays on; files that they need on the control stand beside them. Returns the paths."""
    chosen, machine = [dialect_of(name) for name in dialects], campaign.machine
    written = []
    series = series_of(machine, campaign.runs) if chosen else []
    for dialect in chosen:
        own, numbers = dialect.worded(post or Post()), count(1)
        texts = {run.id: _written(machine, run, dialect, own, next(numbers)) for run in campaign.runs}
        for runs in series:
            steps = series_steps(machine, runs, own)
            name = series_name(runs)
            texts[name] = _text(machine, runs[0], dialect, steps, own, next(numbers), name)
        files = dict[str, str]()
        for number, (name, text) in enumerate(texts.items(), start=1):
            stem = dialect.file(name)
            stem = f"{stem[:-4]}_{number:03d}" if f"{stem}{dialect.suffix}" in files else stem
            files[f"{stem}{dialect.suffix}"] = text
        if any(map(is_probed, campaign.runs)):
            files |= cycle_of(dialect, own).beside
        for name, text in files.items():
            write_text(path := Path(folder) / dialect.name / name, text)
            written.append(path)
    return tuple(written)
