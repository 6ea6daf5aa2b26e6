"""NC programs of a plan. A dialect is one small file and one line of the table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from symfive.campaign import Campaign, Run
from symfive.errors import InputError
from symfive.files import write_text
from symfive.machine import Machine
from symfive.nc._base import Dialect, Step, render
from symfive.nc._post import LETTERS, Post, program_steps
from symfive.nc._warning import collision_warning
from symfive.nc.heidenhain import HEIDENHAIN
from symfive.nc.iso import ISO
from symfive.nc.linuxcnc import LINUXCNC
from symfive.nc.siemens import SIEMENS

__all__ = [
    "DIALECTS", "LETTERS", "Dialect", "Post", "Step", "collision_warning", "dialect_of", "program", "program_steps",
    "write_programs",
]  # fmt: skip

DIALECTS: dict[str, Dialect] = {dialect.name: dialect for dialect in (ISO, SIEMENS, HEIDENHAIN, LINUXCNC)}


def dialect_of(name: str) -> Dialect:
    """The dialect of that name. Raises `InputError`."""
    if name not in DIALECTS:
        raise InputError(f'NC dialect "{name}" is unknown', remedy=f"use one of {', '.join(DIALECTS)}")
    return DIALECTS[name]


def _text(run: Run, dialect: Dialect, steps: Sequence[Step], warning: Sequence[str], number: int = 1) -> str:
    head = (f"symfive for {dialect.name}, {dialect.verified}, read it and run it slowly in air first", *warning)
    return render(dialect, run.id, [*(Step(kind="comment", text=said) for said in head), *steps], number)


def program(machine: Machine, run: Run, dialect: str, post: Post | None = None) -> str:
    """The program of one run. Raises `InputError` for an unknown dialect and for axes without an NC address."""
    warning = collision_warning(machine, run, post or Post())
    return _text(run, dialect_of(dialect), program_steps(machine, run, post), warning)


def write_programs(
    campaign: Campaign, folder: Path | str, dialects: Iterable[str], post: Post | None = None
) -> tuple[Path, ...]:
    """One program per run and dialect into `folder`/dialect, numbered from 1 as the runs; returns their paths."""
    chosen = [dialect_of(name) for name in dialects]
    written = []
    for number, run in enumerate(campaign.runs if chosen else (), start=1):
        steps = program_steps(campaign.machine, run, post)
        warning = collision_warning(campaign.machine, run, post or Post())
        for dialect in chosen:
            path = Path(folder) / dialect.name / f"{run.id}{dialect.suffix}"
            write_text(path, _text(run, dialect, steps, warning, number))
            written.append(path)
    return tuple(written)
