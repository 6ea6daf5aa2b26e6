"""The index of a history: an exact mirror of the records in the results' folders and of the events beside it.

A record is written whole and then indexed; its folder stands in `pending` meanwhile, so that whoever comes after a crash
completes it. What is in two folders is counted once.
"""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from symfive.errors import InputError
from symfive.history._schema import broken, connect, damaged, writable
from symfive.history._take import RECORD, read_record, record_bytes
from symfive.history._visit import STAGES, Event, MachineId, Visit
from symfive.outputs import write_bytes, write_json

FILE, EVENTS = "index.sqlite", "events"
Keep = Callable[[Sequence[Visit], Sequence[Event]], tuple[Mapping[str, Any], bytes]]
"""What is kept of a machine, from its visits and events: its state for the fleet's table, and what was watched."""
OF_A_MACHINE = """SELECT MIN(folder), record FROM visits WHERE machine = ? GROUP BY id ORDER BY time, stage, id"""


class Index:
    """The index in `folder`; a context manager. What it shall `keep` of a machine follows whenever its visits change."""

    def __init__(self, folder: Path, keep: Keep, *, create: bool = True) -> None:
        self.folder, self._keep = Path(os.path.realpath(folder)), keep
        self.path = self.folder / FILE
        self._connection = connect(self.path, create=create)

    def __enter__(self) -> Index:
        try:
            if writable(self.path):
                self._complete()
        except BaseException:
            self._connection.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def machines(self) -> list[tuple[MachineId, dict[str, Any]]]:
        """Every machine, by name and serial number, and its state."""
        rows = self._all("SELECT name, structure, serial, state FROM machines ORDER BY name, serial, key")
        with self.trusted():
            return [
                (MachineId(name=n, structure=c, serial=s), dict(json.loads(state or "{}"))) for n, c, s, state in rows
            ]

    def visits(self, machine: MachineId) -> list[Visit]:
        """The machine's visits in the order of their dates, each once."""
        rows = self._all(OF_A_MACHINE, machine.key)
        with self.trusted():
            return [Visit.from_data(json.loads(record)) for _, record in rows]

    def folders(self, machine: MachineId) -> list[Path]:
        """Their folders, in the same order."""
        return [Path(folder) for folder, _ in self._all(OF_A_MACHINE, machine.key)]

    def events(self, machine: MachineId) -> list[Event]:
        """What happened to the machine, in the order of the dates."""
        rows = self._all("SELECT record FROM events WHERE machine = ? ORDER BY time, id", machine.key)
        with self.trusted():
            return [Event.from_data(json.loads(record)) for (record,) in rows]

    def whole(self, machine: MachineId) -> tuple[list[Visit], list[Event], bytes]:
        """Visits, events and what was watched of them, of one instant; nothing where that is not known."""
        with self._transaction("DEFERRED"):
            courses = self._all("SELECT course FROM courses WHERE machine = ?", machine.key)
            return self.visits(machine), self.events(machine), courses[0][0] if courses else b""

    def twins(self, visit: Visit, folder: Path) -> list[Path]:
        """Other folders that hold the same results."""
        rows = self._all("SELECT folder FROM visits WHERE id = ? AND folder <> ?", visit.results, str(folder))
        return [Path(other) for (other,) in rows]

    def add(self, visits: Mapping[Path, Visit]) -> None:
        """Write each visit's record among its results, then index all of them in one transaction."""
        with self._transaction():
            self._connection.executemany("INSERT OR IGNORE INTO pending VALUES (?)", [(str(f),) for f in visits])
        for folder, visit in visits.items():
            path, data = folder / RECORD, record_bytes(visit)
            if not path.is_file() or path.read_bytes() != data:
                write_bytes(path, data)
        self._index_visits(visits)

    def add_event(self, event: Event) -> Path:
        """Write the event beside the index, then index it; its path."""
        path = self.folder / EVENTS / f"{event.id}.json"
        with self._transaction():
            self._connection.execute("INSERT OR IGNORE INTO pending VALUES (?)", (str(path),))
        if not path.is_file():
            write_json(path, event.to_data())
        self._index_event(path, event)
        return path

    def rebuild(self, folders: Iterable[Path], progress: Callable[[str], None]) -> tuple[int, list[str]]:
        """Everything anew from the records below `folders` and the events beside the index, in one transaction.

        Returns the number of records, and a sentence for each that cannot be used.
        """
        count, problems, machines = 0, list[str](), dict[str, MachineId]()
        with self._transaction():
            for table in ("visits", "events", "pending", "machines", "courses"):
                self._connection.execute(f"DELETE FROM {table}")
            for folder in _records(folders):
                try:
                    visit = read_record(folder)
                except InputError as error:
                    problems.append(str(error))
                    continue
                self._insert(folder, visit)
                machines[visit.machine.key] = visit.machine
                count += 1
                if count % 1000 == 0:
                    progress(f"{count} records")
            for event in _events(self.folder / EVENTS, problems):
                self._put_event(event)
                machines[event.machine.key] = event.machine
            for number, machine in enumerate(machines.values(), start=1):
                self._renew([machine])
                progress(f"{number} of {len(machines)} machines")
        return count, problems

    def digest(self) -> str:
        """SHA-256 of all that the index says: two of one digest are equal."""
        digest = hashlib.sha256()
        for table in ("visits", "events", "machines", "courses"):
            for row in self._connection.execute(f"SELECT * FROM {table} ORDER BY 1"):
                digest.update(repr(row).encode())
        return digest.hexdigest()

    def _complete(self) -> None:
        """Index what a crash left between its record and the index; a writer that is still at it loses nothing by that."""
        left = [Path(folder) for (folder,) in self._all("SELECT folder FROM pending")]
        for path in left:
            try:
                if path.parent == self.folder / EVENTS:
                    self._index_event(path, Event.from_data(json.loads(path.read_bytes())))
                elif (path / RECORD).is_file():
                    self._index_visits({path: read_record(path)})
            except (InputError, OSError, ValueError):
                continue  # not written, or not yet: `add` writes it again

    def _index_event(self, path: Path, event: Event) -> None:
        with self._transaction():
            self._put_event(event)
            self._renew([event.machine])
            self._connection.execute("DELETE FROM pending WHERE folder = ?", (str(path),))

    def _index_visits(self, visits: Mapping[Path, Visit]) -> None:
        with self._transaction():
            before = {
                key for folder in visits
                for (key,) in self._all("SELECT machine FROM visits WHERE folder = ?", str(folder))
            }  # fmt: skip
            for folder, visit in visits.items():
                self._insert(folder, visit)
            machines = {visit.machine.key: visit.machine for visit in visits.values()}
            for key in before - set(machines):
                (row,) = self._all("SELECT name, structure, serial FROM machines WHERE key = ?", key)
                machines[key] = MachineId(name=row[0], structure=row[1], serial=row[2])
            self._renew(machines.values())
            self._connection.executemany("DELETE FROM pending WHERE folder = ?", [(str(f),) for f in visits])

    def _insert(self, folder: Path, visit: Visit) -> None:
        record = json.dumps(visit.to_data(), separators=(",", ":"), ensure_ascii=False)
        row = (str(folder), visit.results, visit.machine.key, visit.time, STAGES.index(visit.stage), record)
        self._connection.execute("INSERT OR REPLACE INTO visits VALUES (?, ?, ?, ?, ?, ?)", row)

    def _put_event(self, event: Event) -> None:
        record = json.dumps(event.to_data(), separators=(",", ":"), ensure_ascii=False)
        row = (event.id, event.machine.key, event.time, record)
        self._connection.execute("INSERT OR REPLACE INTO events VALUES (?, ?, ?, ?)", row)

    def _renew(self, machines: Iterable[MachineId]) -> None:
        """The state of machines whose visits or events changed; one without any is forgotten."""
        for machine in machines:
            visits, events = self.visits(machine), self.events(machine)
            self._connection.execute("DELETE FROM machines WHERE key = ?", (machine.key,))
            self._connection.execute("DELETE FROM courses WHERE machine = ?", (machine.key,))
            if visits or events:
                kept, course = self._keep(visits, events)
                state = json.dumps(kept, separators=(",", ":"), ensure_ascii=False)
                row = (machine.key, machine.name, machine.serial, machine.structure, state)
                self._connection.execute("INSERT INTO machines VALUES (?, ?, ?, ?, ?)", row)
                self._connection.execute("INSERT INTO courses VALUES (?, ?)", (machine.key, course))

    def _all(self, statement: str, *values: Any) -> list[Any]:
        try:
            return self._connection.execute(statement, values).fetchall()
        except sqlite3.Error as error:
            raise broken(error, self.path) from None
        except UnicodeDecodeError as error:
            raise damaged(str(error), self.path) from None

    @contextmanager
    def trusted(self) -> Iterator[None]:
        """Where only what the index wrote itself is read: what is wrong with that is damage, and a sentence."""
        try:
            yield
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
            raise damaged(str(error), self.path) from None

    @contextmanager
    def _transaction(self, kind: str = "IMMEDIATE") -> Iterator[None]:
        """All or nothing; one writer after the other, unless it is `DEFERRED`: then it reads of one instant."""
        try:
            self._connection.execute(f"BEGIN {kind}")
            try:
                yield
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise
        except sqlite3.Error as error:
            raise broken(error, self.path) from None
        except UnicodeDecodeError as error:
            raise damaged(str(error), self.path) from None


def _records(folders: Iterable[Path]) -> Iterator[Path]:
    """Folders at or below these that hold a record, each once; links to folders are not followed."""
    left, seen = [Path(os.path.realpath(folder)) for folder in folders][::-1], set[str]()
    while left:
        folder = left.pop()
        try:
            entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
        except OSError as error:
            problem = f"the folder cannot be read ({error.strerror})"
            raise InputError(problem, path=folder, remedy="check its name and rights") from None
        if any(entry.name == RECORD for entry in entries) and str(folder) not in seen:
            seen.add(str(folder))
            yield folder
        left += [Path(entry.path) for entry in reversed(entries) if entry.is_dir(follow_symlinks=False)]


def _events(folder: Path, problems: list[str]) -> Iterator[Event]:
    for path in sorted(folder.glob("*.json")) if folder.is_dir() else ():
        try:
            yield Event.from_data(json.loads(path.read_bytes()))
        except InputError as error:
            problems.append(str(error.at(path)))
        except (OSError, ValueError) as error:
            problems.append(str(InputError(f"it cannot be read ({error})", path=path, remedy="add the event again")))
