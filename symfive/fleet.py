"""Many recorded machines: each campaign identified or diagnosed into a folder of its own, and one table of all.

What is complete is not done again, so that an interrupted fleet goes on where it was; a campaign that cannot be used
ends in one sentence of the table and stops no other.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from symfive.campaign import Campaign, read_campaign
from symfive.diagnose import EXPLAINED, Diagnosis
from symfive.diagnose import diagnose as diagnose_campaign
from symfive.errors import InputError
from symfive.executors import Inline, finished
from symfive.files import one_line
from symfive.identify import Identification, identify
from symfive.model import read_json
from symfive.numbers import plain_number, unit_words, with_std, with_unit
from symfive.outputs import output_folder, write_json, write_text
from symfive.results import write_diagnosis, write_identification
from symfive.screen import OnScreen, aligned
from symfive.separated import plain_cell
from symfive.threads import one_thread
from symfive.version import __version__

__all__ = ["SCHEMA", "Fleet", "Row", "Task", "fleet", "row_of"]

SCHEMA = "symfive.fleet/1"
DONE = "fleet-row.json"
"""Lies among a campaign's results, which are the fleet's where it does: their row in the table, and of what they are."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One campaign in the table: `errors` location error → (value, 1σ, unit), `rms` of the residuals in `rms_unit`."""

    campaign: str
    verdict: str
    says: str = ""
    rms: float | None = None
    rms_unit: str = ""
    chi2_dof: float | None = None
    errors: Mapping[str, tuple[float, float, str]] = field(default_factory=dict)

    @property
    def failed(self) -> bool:
        """Whether the campaign has no results; `says` tells why."""
        return self.verdict == "failed"


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a worker does with one campaign: `name` in the table, its `folder`, the `target` of the results."""

    name: str
    folder: Path
    target: Path
    diagnose: bool = False
    figures: bool = True
    redo: bool = False


@dataclass(frozen=True, repr=False)
class Fleet(OnScreen):
    """The table of all campaigns, in the order they were given."""

    verb: str
    rows: tuple[Row, ...]

    @property
    def errors(self) -> dict[str, str]:
        """Location errors of any of the machines, with their units."""
        return {name: unit for row in self.rows for name, (_, _, unit) in row.errors.items()}

    def to_data(self) -> dict[str, Any]:
        """The table as JSON."""
        return {"schema": SCHEMA, "verb": self.verb, "campaigns": [asdict(row) for row in self.rows]}

    def csv(self) -> str:
        """The table as CSV: value and 1σ of every location error; what a machine does not have is empty.

        Text that a spreadsheet would take for a formula begins with an apostrophe.
        """
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        columns = [f"{name}{part}_{unit}" for name, unit in self.errors.items() for part in ("", "_std")]
        table.writerow(["campaign", "verdict", "rms", "rms_unit", "chi2_dof", *map(plain_cell, columns), "says"])
        for row in self.rows:
            numbers = [n for name in self.errors for n in row.errors.get(name, ("", "", ""))[:2]]
            cells = [row.campaign, row.verdict, row.rms, row.rms_unit, row.chi2_dof, *numbers, row.says]
            table.writerow([plain_cell(cell) for cell in cells])
        return text.getvalue()

    def __str__(self) -> str:
        return "\n".join([self.text, *self.failures])

    @property
    def failures(self) -> list[str]:
        """A sentence for each campaign that has no results."""
        return [one_line(f"{_short(row.campaign)}: failed: {row.says}") for row in self.rows if row.failed]

    @property
    def text(self) -> str:
        """The table of those that have some."""
        heads = ["campaign", "verdict", "rms", "chi²/dof", *(f"{n} {unit_words(u)}" for n, u in self.errors.items())]
        return "\n".join(aligned([heads, *(self._line(row) for row in self.rows if not row.failed)]))

    def _line(self, row: Row) -> list[str]:
        found = (row.errors.get(name) for name in self.errors)
        errors = ["" if e is None else with_std(e[0], e[1]) for e in found]
        rms = with_unit(row.rms or 0.0, row.rms_unit)
        return [one_line(row.campaign), row.verdict.replace("_", " "), rms, plain_number(row.chi2_dof or 0.0), *errors]


def _short(name: str) -> str:
    """A campaign's name as it stands in a sentence."""
    return name if len(name) <= 200 else f"{name[:100]} … {name[-90:]}"


def fleet(
    campaigns: Sequence[Path | str], output: Path | str, *, diagnose: bool = False, figures: bool = True,
    redo: bool = False, pool: Executor | None = None, progress: Callable[[str], None] = lambda message: None,
) -> Fleet:  # fmt: skip
    """Identifies or diagnoses every campaign into its own folder of `output`; writes and returns the table of all.

    `campaigns` are folders of campaigns, or folders that hold some; `pool` is any executor (`symfive.executors`), whose
    workers see both folders under the same paths. `redo` begins anew what is complete. Raises `InputError`.
    """
    root = Path(os.path.abspath(output))
    folders = _folders(campaigns)
    common = Path(os.path.commonpath([folder.parent for folder in folders]))
    tasks = [
        Task(name=name, folder=folder, target=root / name, diagnose=diagnose, figures=figures, redo=redo)
        for folder in folders for name in [Path(os.path.relpath(folder, common)).as_posix()]
    ]  # fmt: skip
    for task in tasks:
        if task.target == task.folder:
            raise InputError(
                "results would go into the campaign itself", path=task.folder, remedy="name another folder"
            )
    rows: dict[int, Row] = {}
    try:
        for number, outcome in finished(pool or Inline(), row_of, [(task,) for task in tasks]):
            name, failed = tasks[number].name, isinstance(outcome, Exception)
            rows[number] = Row(campaign=name, verdict="failed", says=_sentence(outcome)) if failed else outcome
            progress(f"{len(rows)} of {len(tasks)}: {name}: {rows[number].verdict}")
    except KeyboardInterrupt as interrupt:
        done = sum(not row.failed for row in rows.values())
        interrupt.add_note(f"{done} of {len(tasks)} campaigns are complete; repeat the command to continue")
        raise
    table = Fleet("diagnose" if diagnose else "identify", tuple(rows[number] for number in range(len(tasks))))
    write_text(root / "fleet.csv", table.csv())
    return table


def _folders(campaigns: Sequence[Path | str]) -> list[Path]:
    """Folders of the campaigns, each once; a folder without a campaign of its own stands for those in it."""
    if not campaigns:
        raise InputError("there is no campaign", remedy="name a folder with campaigns in it")
    found: dict[Path, None] = {}
    for path in (Path(os.path.abspath(name)) for name in campaigns):
        if path.is_file() and path.name != "campaign.toml":
            raise InputError(
                "this is no folder", path=path, remedy="name the folder of a campaign, or one that holds some"
            )
        folder = path.parent if path.is_file() else path
        inner = [] if (folder / "campaign.toml").is_file() else sorted(folder.glob("*/campaign.toml"))
        found |= dict.fromkeys(file.parent for file in inner) or {folder: None}
    return list(found)


@one_thread
def row_of(task: Task) -> Row:
    """Identifies or diagnoses one campaign and writes its results, complete or not at all; its row in the table."""
    campaign = read_campaign(task.folder)
    if not campaign.measured:
        raise InputError("a run has no readings", path=task.folder, remedy="measure or simulate the plan first")
    done, key = task.target / DONE, _key(campaign, task)
    before = _before(done, task.name, key) if done.is_file() and not task.redo else None
    if before is not None:
        return before
    with output_folder(task.target, overwrite=task.redo or done.is_file()) as folder:
        campaign = read_campaign(task.folder)
        result = diagnose_campaign(campaign) if task.diagnose else identify(campaign)
        if isinstance(result, Diagnosis):
            write_diagnosis(result, folder)
        else:
            write_identification(result, folder, figures=task.figures)
        row = _row(task.name, result)
        write_json(folder / DONE, {"key": key, "row": asdict(row)})
    return row


def _before(done: Path, name: str, key: str) -> Row | None:
    """The row of results that lie there complete; None where it is of others or cannot be used."""
    try:
        data = read_json(done, listed=True)
        if data["key"] != key:
            return None
        row = dict(data["row"])
        errors = {str(n): (float(value), float(std), str(unit)) for n, (value, std, unit) in row["errors"].items()}
        rms, chi2 = float(row["rms"]), float(row["chi2_dof"])
        found = Row(
            campaign=name, verdict=str(row["verdict"]), says=str(row["says"]), rms=rms, rms_unit=str(row["rms_unit"]),
            chi2_dof=chi2, errors=errors,
        )  # fmt: skip
    except (InputError, AttributeError, LookupError, OverflowError, TypeError, ValueError):
        return None
    numbers = [rms, chi2, *(number for value, std, _ in errors.values() for number in (value, std))]
    return found if all(map(math.isfinite, numbers)) else None


def _key(campaign: Campaign, task: Task) -> str:
    """Digest of all that decides the results: the recordings and the machine, the verb, symfive."""
    digest = hashlib.sha256(f"{__version__} {task.diagnose} {task.figures}".encode())
    for name in ("campaign.toml", campaign.machine_file, *(run.file for run in campaign.runs)):
        digest.update(hashlib.sha256((task.folder / name).read_bytes()).digest())
    return digest.hexdigest()


def _row(name: str, result: Identification | Diagnosis) -> Row:
    fit = result.after if isinstance(result, Diagnosis) else result
    return Row(
        campaign=name,
        verdict=_verdict(result),
        says=result.summary if isinstance(result, Diagnosis) else "; ".join(result.to_data()["says"]),
        rms=float(fit.rms_um),
        rms_unit=next((unit for unit in fit.rms if unit == "um"), next(iter(fit.rms), "um")),
        chi2_dof=float(fit.chi2_dof),
        errors={
            p.name: (float(value), float(std), p.unit)
            for p, value, std in zip(fit.parameters, fit.values, fit.std, strict=True)
            if p.kind == "location_error"
        },
    )


def _verdict(result: Identification | Diagnosis) -> str:
    """In a few words: what was found beside the geometry, else how well the model explains the readings."""
    if isinstance(result, Diagnosis):
        if result.mismatch:
            return ", ".join(f"{f.name} {f.axis or ''}".rstrip() for f in result.findings) or "unnamed mismatch"
        result = result.after
    ratio = math.sqrt(result.chi2_dof)
    if not result.converged:
        return "not converged"
    return "explained" if ratio <= EXPLAINED else f"{plain_number(ratio)} times the declared noise"


def _sentence(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, InputError) else f"{type(error).__name__}: {text}"
