"""NC programs of a plan. A dialect is one small file and one line of the table."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from symfive.campaign import Campaign, Run
from symfive.errors import InputError
from symfive.files import write_text
from symfive.machine import Machine
from symfive.nc._base import Dialect, Step, render
from symfive.nc._post import Post, program_steps
from symfive.nc.heidenhain import HEIDENHAIN
from symfive.nc.iso import ISO
from symfive.nc.linuxcnc import LINUXCNC
from symfive.nc.siemens import SIEMENS

__all__ = ["DIALECTS", "Dialect", "Post", "Step", "program", "program_steps", "write_programs"]

DIALECTS: dict[str, Dialect] = {dialect.name: dialect for dialect in (ISO, SIEMENS, HEIDENHAIN, LINUXCNC)}


def program(machine: Machine, run: Run, dialect: str, post: Post | None = None) -> str:
    """The program of one run. Raises `InputError` for an unknown dialect and for axes without an NC address."""
    if dialect not in DIALECTS:
        raise InputError(f'NC dialect "{dialect}" is unknown', remedy=f"use one of {', '.join(DIALECTS)}")
    chosen = DIALECTS[dialect]
    note = Step(
        kind="comment", text=f"symfive for {chosen.name}, {chosen.verified}, read it and run it slowly in air first"
    )
    return render(chosen, run.id, [note, *program_steps(machine, run, post)])


def write_programs(
    campaign: Campaign, folder: Path | str, dialects: Iterable[str], post: Post | None = None
) -> tuple[Path, ...]:
    """One program per run and dialect into `folder`/dialect; returns their paths."""
    written = []
    for dialect in dialects:
        for run in campaign.runs:
            text = program(campaign.machine, run, dialect, post)
            path = Path(folder) / dialect / f"{run.id}{DIALECTS[dialect].suffix}"
            write_text(path, text)
            written.append(path)
    return tuple(written)
