"""`check`: what a machine file or a campaign declares, in a few lines, and every problem found in its files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symfive.campaign import Campaign, Run, campaign_problems
from symfive.errors import InputError
from symfive.machine import Machine, error_names, machine_problems, unknown_keys
from symfive.screen import OnScreen, plural
from symfive.toml_files import read_toml
from symfive.validation import unknown_notes

__all__ = ["SCHEMA", "Check", "check"]

SCHEMA = "symfive.check/1"


@dataclass(frozen=True, repr=False)
class Check(OnScreen):
    """What the files at `path` declare and what is wrong with them.

    `machine` and `runs` as far as they can be read (a wrong entry is left out); `problems` in words with file and line;
    `notes` on unknown keys, which are kept, and on values that are valid but improbable (`symfive.plausible`).
    """

    path: Path
    machine: Machine | None
    runs: tuple[Run, ...]
    problems: tuple[InputError, ...]
    notes: tuple[str, ...]

    @property
    def right(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems

    def to_data(self) -> dict[str, Any]:
        """The same as nested mappings."""
        return {
            "schema": SCHEMA,
            "path": str(self.path),
            "machine": None if self.machine is None else _machine_data(self.machine),
            "runs": [
                {"id": run.id, "rows": run.rows, "instrument": list(run.instrument), "sampling": run.sampling,
                 "noise": {name: run.noise(name) for name in run.instrument}, "measured": run.measured}
                for run in self.runs
            ],
            "problems": [
                {"problem": e.problem, "remedy": e.remedy, "file": None if e.path is None else str(e.path),
                 "line": e.line, "column": e.column, "keys": list(e.keys)}
                for e in self.problems
            ],
            "notes": list(self.notes),
        }  # fmt: skip

    def __str__(self) -> str:
        lines = str(self.machine).split("\n") if self.machine is not None else []
        lines += [str(run) for run in self.runs]
        lines += [f"note: {note}" for note in self.notes]
        if self.problems:
            lines.append(f"{plural(len(self.problems), 'problem')}:")
        elif self.notes:
            lines.append(f"no error in the files; look at the note{'s' if len(self.notes) > 1 else ''} above")
        else:
            lines.append("no problem found")
        lines += [f"  {problem}" for problem in self.problems]
        if self.machine is not None and any(_concerns_errors(problem) for problem in self.problems):
            lines += ["a ready block for this structure (prior 1σ in µm and µrad):", "", "[errors]"]
            lines += [f"{name} = {{ sigma = {sigma:.1f} }}" for name, sigma in error_names(self.machine.axes).items()]
        return "\n".join(lines)


def check(path: Path | str) -> Check:
    """All problems and notes of a machine file, a campaign folder or its `campaign.toml`: reading goes on after a problem.

    Raises `InputError` only where there is no such file.
    """
    path = Path(path)
    if not os.path.lexists(path):
        raise InputError("there is no such file or folder", path=path, remedy="check the name")
    runs: tuple[Run, ...] = ()
    if path.is_dir() or _is_campaign(path):
        machine, runs, found = campaign_problems(path)
    else:
        machine, found = machine_problems(path)
    if machine is not None and not machine.errors and not runs and not any(map(_concerns_errors, found)):
        found = [*found, _nothing_free(path)]
    if machine is not None and machine.effects and not found:
        found = _effect_problems(machine, runs, path)
    named = {".".join(map(str, problem.keys)) for problem in found}
    unknown = [key for key in unknown_keys(machine) if key not in named] if machine else []
    notes = tuple(unknown_notes(unknown))
    if machine is not None and runs and not found:
        from symfive.plausible import doubts, out_of_reach

        campaign = Campaign(machine=machine, runs=runs)
        try:
            if not machine.errors:
                from symfive.model import Model

                free = Model(campaign).parameters  # what a drive's force has, set-up
                if not free:
                    found = [_nothing_free(path, runs)]
                elif all(parameter.of_setup for parameter in free):
                    notes += ("no error is declared, so that only the set-up of the runs can be identified",)
            notes += doubts(campaign)
            found += [
                InputError(problem, path=_file(path, "campaign.toml"), remedy=remedy, keys=("run", number))
                for number, run in enumerate(runs)
                for problem, remedy in out_of_reach(machine, run)
            ]
        except InputError as error:
            found = [error]
    elif machine is not None and not found:
        from symfive.plausible import beyond_travel

        notes += beyond_travel(machine)
    return Check(path, machine, runs, tuple(found), notes)


def _effect_problems(machine: Machine, runs: tuple[Run, ...], path: Path) -> list[InputError]:
    """What every other verb would say of the effects that the machine file holds."""
    from symfive.effects import baseline_effects
    from symfive.model import Model

    try:
        if runs:
            Model(Campaign(machine=machine, runs=runs))
        else:
            baseline_effects(machine)
    except InputError as error:
        return [error.at(_file(path, "machine.toml"), keys=("model", "effects"))]
    return []


def _nothing_free(path: Path, runs: tuple[Run, ...] = ()) -> InputError:
    if runs and {name for run in runs for name in run.instrument} == {"encoder"}:
        problem = "an encoder of the control reads no error of the machine, so that nothing can be identified"
        remedy = "add encoder_zero_sigma = 1.0 (mm or degree) to the runs: the drive can then be diagnosed"
        return InputError(problem, path=path, remedy=remedy, keys=("run", 0))
    problem = "no error is declared, so that nothing can be identified"
    return InputError(
        problem, path=_file(path, "machine.toml"), remedy="list the errors to identify under [errors]", keys=("errors",)
    )


def _is_campaign(path: Path) -> bool:
    try:
        return str(read_toml(path).data.get("schema", "")).startswith("symfive.campaign/")
    except InputError:
        return path.name == "campaign.toml"


def _file(path: Path, name: str) -> Path:
    return path / name if path.is_dir() else path


def _concerns_errors(error: InputError) -> bool:
    return error.keys[:1] == ("errors",)


def _machine_data(machine: Machine) -> dict[str, Any]:
    return {
        "name": machine.name,
        "structure": machine.structure.code,
        "axes": {a.name: {"travel": list(a.travel), "unit": a.unit, "drive": a.drive is not None} for a in machine.axes.values()},
        "table": None if machine.workspace.table_radius is None
        else {"radius": machine.workspace.table_radius, "centre": list(machine.table_centre), "axis": machine.table_axis},
        "errors": {t.name: {"sigma": t.sigma, "unit": t.unit} for t in machine.errors.values()},
        "errors_possible": error_names(machine.axes),
    }  # fmt: skip
