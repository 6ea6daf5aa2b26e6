"""The verbs of a history: add results and events, show a machine, show the fleet, rebuild the index."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symfive.errors import InputError
from symfive.files import shown
from symfive.history._change import Change, change_between
from symfive.history._export import format_of, write_table
from symfive.history._index import FILE, Index
from symfive.history._limits import RATE
from symfive.history._page import fleet_page, machine_page
from symfive.history._schema import put_damaged_aside
from symfive.history._take import Details, is_result, no_results, taken
from symfive.history._trend import Trend, trend_of
from symfive.history._visit import Event, MachineId, Visit
from symfive.history._watched import Watched
from symfive.history._words import MachineTable, row_of
from symfive.outputs import output_file, write_text
from symfive.screen import plural

FOLDER = "history"
"""Where the index lies unless another folder is named."""
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Added:
    """What `add` took: the visits by folder, and `notes` on them for the user."""

    visits: Mapping[Path, Visit]
    notes: tuple[str, ...]

    def __str__(self) -> str:
        machines = {visit.machine for visit in self.visits.values()}
        lines = [f"{plural(len(self.visits), 'visit')} of {plural(len(machines), 'machine')} in the history."]
        return "\n".join(
            [*lines, *(f"  {v.machine}: {v.date} {v.stage}".rstrip() for v in list(self.visits.values())[:20])]
        )


@dataclass(frozen=True)
class Rebuilt:
    """What `rebuild` found: the number of records, and a sentence for each that cannot be used."""

    count: int
    problems: tuple[str, ...]


class History:
    """The history in a folder: an SQLite index of the records among the results, and the events. A context manager.

    `create` makes it if it does not exist. Every method raises `InputError` for errors that a user can correct. Many processes
    may add at once.
    """

    def __init__(self, folder: Path | str = FOLDER, *, create: bool = False) -> None:
        self._index = Index(Path(folder), _kept, create=create)

    def __enter__(self) -> History:
        self._index.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._index.__exit__()

    @property
    def folder(self) -> Path:
        """Where the index and the events lie."""
        return self._index.folder

    def add(
        self, results: Path | str | Iterable[Path | str], details: Details | None = None, *,
        progress: Progress = lambda message: None,
    ) -> Added:  # fmt: skip
        """Take results in: folders that `identify`, `diagnose` or `fleet` wrote, or folders that hold such.

        `visit.json` is written among each one's results. What was added before is replaced by what is said now; nothing is
        counted twice. The date of several results cannot be given at once.
        """
        given = [results] if isinstance(results, (str, Path)) else list(results)
        folders = list(dict.fromkeys(folder for entry in given for folder in _results(Path(entry))))
        details = details or Details()
        if len(folders) > 1 and (details.time is not None or details.corrections):
            problem = f"one date or correction cannot hold for {len(folders)} results"
            raise InputError(problem, remedy="add them one by one")
        visits = dict[Path, Visit]()
        for number, folder in enumerate(folders, start=1):
            visits[folder] = taken(folder, details)
            progress(f"{number} of {len(folders)}: {folder.name}")
        notes = [note for folder, visit in visits.items() for note in self._notes(folder, visit, details)]
        self._index.add(visits)
        return Added(visits, tuple(dict.fromkeys(notes)))

    def event(self, machine: str, text: str, *, kind: str = "note", when: float | None = None) -> Event:
        """Write down what happened to a machine: `repair`, `adjustment`, `collision` or `note`; `when` in s, now by default."""
        seconds = float(round(time.time() if when is None else when))
        event = Event(machine=self.machine(machine), time=seconds, kind=kind, text=text)
        self._index.add_event(event)
        return event

    def machines(self) -> list[MachineId]:
        """Every machine, by name."""
        return [machine for machine, _ in self._index.machines()]

    def machine(self, name: str) -> MachineId:
        """The machine of that name, of `NAME#SERIAL`, or of that key. Raises `InputError` where there is none or several."""
        every = self.machines()
        found = [m for m in every if name in (m.name, f"{m.name}#{m.serial}", m.key)]
        if len(found) == 1:
            return found[0]
        if not found:
            known = ", ".join(dict.fromkeys(m.name for m in every[:8])) or "none yet"
            raise InputError(f"the history has no machine {shown(name)}", remedy=f"it knows: {known}")
        said = "; ".join(f"{m.key} (serial {m.serial or 'not given'}, {m.structure})" for m in found)
        problem = f"{len(found)} machines have the name {shown(name)}: {said}"
        raise InputError(problem, remedy="name it by NAME#SERIAL or by its key")

    def visits(self, machine: str | MachineId) -> list[Visit]:
        """The machine's visits in the order of their dates."""
        return self._index.visits(self._known(machine))

    def folders(self, machine: str | MachineId) -> list[Path]:
        """Where their results lie, in the same order."""
        return self._index.folders(self._known(machine))

    def events(self, machine: str | MachineId) -> list[Event]:
        """What happened to the machine, in the order of the dates."""
        return self._index.events(self._known(machine))

    def trend(
        self, machine: str | MachineId, *, tolerances: Mapping[str, float] | None = None, rate: float = RATE
    ) -> Trend:
        """Alarms, forecasts and advice for one machine; `rate` false alarms a year, `tolerances` ± by name, file units."""
        visits, events, course = self._index.whole(self._known(machine))
        watched = Watched.unpacked(course) if course and rate == RATE else None
        return trend_of(visits, events, rate=rate, tolerances=tolerances, watched=watched)

    def change(self, machine: str | MachineId, *, since: float | None = None, until: float | None = None) -> Change:
        """The change between two visits: the last one up to `since` (the first, if none) and the last one up to `until`.

        The machine's own scatter and temperature are taken into account as soon as its history knows them.
        """
        trend = self.trend(machine)
        visits = trend.visits
        if len(visits) < 2:
            raise InputError("a change needs two visits", remedy="add results with symfive history add")
        later = [v for v in visits if until is None or v.time <= until] or visits[:1]
        second = later[-1]
        earlier = [v for v in later[:-1] if since is None or v.time <= since]
        first = earlier[-1] if earlier else visits[0]
        if first is second:
            raise InputError("both dates fall on one visit", remedy="name dates before and after a visit")
        return change_between(first, second, trend.scatter)

    def fleet(self) -> MachineTable:
        """The table of all machines, from their states in the index."""
        machines = self._index.machines()
        with self._index.trusted():
            return MachineTable(tuple(row_of(machine, state) for machine, state in machines))

    def machine_page(
        self, machine: str | MachineId, *, tolerances: Mapping[str, float] | None = None, rate: float = RATE
    ) -> str:
        """The machine's page, as HTML."""
        return machine_page(self.trend(machine, tolerances=tolerances, rate=rate))

    def fleet_page(self) -> str:
        """The fleet's page, as HTML; it links to `KEY.html` of every machine."""
        states = dict(self._index.machines())
        link = {machine.key: f"{machine.key}.html" for machine, state in states.items() if state.get("visits")}
        table = self.fleet()
        with self._index.trusted():
            return fleet_page(table, list(states.values()), link=link)

    def write_pages(self, folder: Path) -> list[Path]:
        """`fleet.html` and a page of every machine in `folder`; their paths."""
        pages = {folder / "fleet.html": self.fleet_page()}
        for row in self.fleet().rows:
            if row.visits:
                pages[folder / f"{row.machine.key}.html"] = self.machine_page(row.machine)
        for path, page in pages.items():
            write_text(path, page)
        return list(pages)

    def export(self, path: Path | str) -> int:
        """Every visit and error as one long table, `.csv` or `.parquet`; the number of its rows."""
        target = Path(path)
        suffix = format_of(target)
        visits = (
            entry for machine in self.machines()
            for entry in zip(self._index.folders(machine), self._index.visits(machine), strict=True)
        )  # fmt: skip
        with output_file(target) as place:
            return write_table(visits, place, suffix=suffix)

    def rebuild(self, folders: Sequence[Path | str], *, progress: Progress = lambda message: None) -> Rebuilt:
        """The whole index anew from the records below `folders` and the events beside it; all or nothing."""
        count, problems = self._index.rebuild([Path(folder) for folder in folders], progress)
        return Rebuilt(count, tuple(problems))

    def digest(self) -> str:
        """SHA-256 of all that the index says; two histories of one digest are equal."""
        return self._index.digest()

    def _known(self, machine: str | MachineId) -> MachineId:
        return self.machine(machine) if isinstance(machine, str) else machine

    def _notes(self, folder: Path, visit: Visit, details: Details) -> Iterable[str]:
        """What a user may not have meant."""
        if details.time is None and not (folder / "visit.json").is_file():
            yield f"{folder.name}: dated {visit.date} by its files; give --date if it was measured earlier"
        if visit.time > time.time() + 86400.0:
            yield f"{folder.name}: {visit.date} is in the future; check the date and the computer's clock"
        for twin in self._index.twins(visit, folder):
            yield f"{folder.name}: the same results are in {twin}; they are counted once"
        others = [m for m in self.machines() if m.name == visit.machine.name and m.key != visit.machine.key]
        if others:
            of = "; ".join(f"serial {m.serial or 'not given'}, {m.structure}" for m in others)
            mine = visit.machine.serial or "not given"
            yield f'another machine is called "{visit.machine.name}" ({of}); this one has serial {mine}'
        if not visit.converged:
            yield f"{folder.name}: its fit did not converge; its uncertainties may be wrong"


def rebuilt(folder: Path | str, results: Sequence[Path | str], *, progress: Progress = lambda message: None) -> Rebuilt:
    """Rebuild the index in `folder`; one that is damaged is put aside as `index.sqlite.damaged` first. Raises `InputError`."""
    put_damaged_aside(Path(folder) / FILE)
    with History(folder, create=True) as history:
        return history.rebuild(results, progress=progress)


def _kept(visits: Sequence[Visit], events: Sequence[Event]) -> tuple[dict[str, Any], bytes]:
    if not visits:
        return {"visits": 0}, b""
    trend = trend_of(visits, events)
    return trend.state(), trend.watched.packed()


def _results(path: Path) -> list[Path]:
    """Folders of results at or below a path."""
    folder = Path(os.path.realpath(path.parent if path.name == "model.json" else path))
    if is_result(folder):
        return [folder]
    found = sorted(file.parent for file in folder.rglob("model.json")) if folder.is_dir() else []
    if not found:
        raise no_results(path)
    return found
