"""A campaign as plain data: a machine and its runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from symfive.errors import InputError
from symfive.files import shown
from symfive.machine import Machine
from symfive.runs._run import Run, file_identity
from symfive.screen import OnScreen, listed, plural
from symfive.validation import freeze

MOUNTED = {"tool_ball": "tool ball", "table_ball": "table ball", "length": "bar"}
"""What may stay mounted from run to run, in words."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Campaign(OnScreen):
    """A machine and its runs. A campaign without readings is a measurement plan.

    `notes` are remarks from reading it (unknown keys, unusual but valid rows); `comments` are those in
    the file, `text` is the text of the file, so that writing keeps its layout.
    """

    machine: Machine
    runs: tuple[Run, ...]
    name: str = "campaign"
    machine_file: str = "machine.toml"
    comments: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)
    path: Path | None = None
    text: str = field(default="", repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra", freeze(self.extra))
        if not isinstance(self.name, str) or not self.name.isprintable():
            problem = f"name = {shown(self.name)} is not one line of printed text"
            raise InputError(problem, remedy='write name = "…"', keys=("name",))
        if not self.runs:
            raise InputError("the campaign has no runs", remedy="add a [[run]] block", keys=("run",))
        ids: set[str] = set()
        files: set[str] = set()
        for number, run in enumerate(self.runs):
            if run.id in ids:
                problem = f'two runs have the id "{run.id}"'
                raise InputError(problem, remedy="give every run its own id", keys=("run", number, "id"))
            if file_identity(run.file) in files:
                problem = f'two runs have the file "{run.file}"'
                raise InputError(problem, remedy="give every run its own CSV", keys=("run", number, "file"))
            self._check_mountings(run, number)
            ids.add(run.id)
            files.add(file_identity(run.file))
            if set(run.commands) != set(self.machine.axis_names):
                odd = sorted(set(run.commands) ^ set(self.machine.axis_names))
                problem = f"run {run.id}: the commands and the machine's axes differ in {', '.join(odd)}"
                raise InputError(
                    problem, remedy=f"command each of {', '.join(self.machine.axis_names)}", keys=("run", number)
                )

    def _check_mountings(self, run: Run, number: int) -> None:
        """What stays mounted stands in the same place, as well known."""
        for quantity, name in run.mounting.items():
            first = next(r for r in self.runs if r.mounting.get(quantity) == name)
            stated = [(getattr(r, quantity, None), getattr(r.setup_sigma_um, quantity, None)) for r in (first, run)]
            if stated[0] != stated[1]:
                problem = f'run {run.id}: {quantity} of mounting "{name}" is not that of run {first.id}'
                remedy = f"state the same {quantity} and setup_sigma_um in both, or give them different mountings"
                raise InputError(problem, remedy=remedy, keys=("run", number, "mounting", quantity))

    def __str__(self) -> str:
        count = sum(run.measured for run in self.runs)
        state = "measured" if self.measured else f"{count} of them measured" if count else "a plan, no readings yet"
        machine = f"machine {self.machine.name}: {self.machine.structure.code}"
        head = f"campaign {self.name}: {plural(len(self.runs), 'run')}, {plural(self.rows, 'row')}, {state}"
        return "\n".join([head, machine, *listed([str(run) for run in self.runs], "campaign.runs")])

    @property
    def measured(self) -> bool:
        """Whether every run has readings."""
        return all(run.measured for run in self.runs)

    @property
    def rows(self) -> int:
        """Number of rows of all runs."""
        return sum(run.rows for run in self.runs)

    @property
    def repeats(self) -> tuple[tuple[str, ...], ...]:
        """Ids of runs that repeat each other: same instrument, set-up and commands, row by row."""
        groups: list[list[Run]] = []
        for run in self.runs:
            home = next((g for g in groups if g[0].repeated_by(run)), None)
            if home is None:
                groups.append([run])
            else:
                home.append(run)
        return tuple(tuple(r.id for r in g) for g in groups if len(g) > 1)

    def run(self, id: str) -> Run:
        """The run of that id."""
        for run in self.runs:
            if run.id == id:
                return run
        raise InputError(f'there is no run "{id}"', remedy=f"use one of {', '.join(r.id for r in self.runs)}")

    def select(self, *ids: str) -> Campaign:
        """The campaign of these runs only."""
        return replace(self, runs=tuple(self.run(id) for id in ids))

    def with_machine(self, machine: Machine) -> Campaign:
        """The same recordings with another baseline model."""
        return replace(self, machine=machine)

    def alike(self, quantity: str) -> tuple[tuple[str, ...], ...]:
        """Ids of the runs that state the same `tool_ball`, `table_ball` or `length`, as well known, and not how it was mounted,
        where they are several."""
        groups: dict[object, list[str]] = {}
        for run in self.runs:
            if quantity not in run.mounting and getattr(run, quantity) is not None:
                sigma = run.setup_sigma_um
                along = sigma.tool_length if quantity == "tool_ball" else None
                groups.setdefault((getattr(run, quantity), getattr(sigma, quantity), along), []).append(run.id)
        return tuple(tuple(ids) for ids in groups.values() if len(ids) > 1)

    def staying(self, *quantities: str) -> Campaign:
        """The same campaign if these quantities stayed mounted wherever its runs state them alike."""
        names = {
            (run, quantity): f"{number} alike"
            for quantity in quantities
            for number, runs in enumerate(self.alike(quantity), 1)
            for run in runs
        }
        runs = []
        for run in self.runs:
            own = {quantity: names[run.id, quantity] for quantity in quantities if (run.id, quantity) in names}
            runs.append(replace(run, mounting={**run.mounting, **own}) if own else run)
        return replace(self, runs=tuple(runs))

    def joined(self, other: Campaign, prefix: str = "") -> Campaign:
        """This campaign and another one on the same machine; `prefix` keeps the ids and mountings of the second
        apart. Where their clocks overlap the second begins at the end of the first: a machine makes one test at a time."""
        if other.machine.structure != self.machine.structure:
            raise InputError(
                f'the campaigns are of machines "{self.machine.structure.code}" and "{other.machine.structure.code}"',
                remedy="join campaigns of one machine only",
            )
        (begin, end), (first, last) = (
            (min(run.start_s for run in runs), max(run.start_s + run.duration for run in runs))
            for runs in (self.runs, other.runs)
        )
        later = end - first if first < end and begin < last else 0.0
        runs = tuple(
            replace(
                run, id=prefix + run.id, file=f"{prefix}{run.file}", start_s=run.start_s + later,
                mounting={quantity: prefix + name for quantity, name in run.mounting.items()},
            )
            for run in other.runs
        )  # fmt: skip
        return replace(self, runs=self.runs + runs, notes=self.notes + other.notes)
