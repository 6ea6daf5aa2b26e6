"""The index's tables, version by version: SQLite, written ahead (WAL), each migration in one transaction."""

from __future__ import annotations

import os
import sqlite3
from pathlib import Path

from symfive.errors import InputError

MIGRATIONS = (
    # 1: every record by its folder, every event; a folder stands in `pending` while its record is being written
    """
    CREATE TABLE visits (folder TEXT PRIMARY KEY, id TEXT NOT NULL, machine TEXT NOT NULL, time REAL NOT NULL,
                         stage INTEGER NOT NULL, record TEXT NOT NULL) WITHOUT ROWID;
    CREATE INDEX visits_of_a_machine ON visits (machine, time, stage, id);
    CREATE TABLE events (id TEXT PRIMARY KEY, machine TEXT NOT NULL, time REAL NOT NULL, record TEXT NOT NULL) WITHOUT ROWID;
    CREATE INDEX events_of_a_machine ON events (machine, time, id);
    CREATE TABLE pending (folder TEXT PRIMARY KEY) WITHOUT ROWID;
    """,
    # 2: the machines by name, and the state of each, so that the fleet's table needs no visits
    """
    CREATE TABLE machines (key TEXT PRIMARY KEY, name TEXT NOT NULL, serial TEXT NOT NULL, structure TEXT NOT NULL,
                           state TEXT) WITHOUT ROWID;
    INSERT INTO machines (key, name, serial, structure)
        SELECT machine, json_extract(record, '$.machine.name'), json_extract(record, '$.machine.serial'),
               json_extract(record, '$.machine.structure')
        FROM (SELECT machine, record FROM visits UNION ALL SELECT machine, record FROM events) GROUP BY machine;
    """,
    # 3: records in a table that keeps them on its own pages (without row ids each took an overflow page of 4 kB), and what
    # was watched of each machine, so that its trend watches nothing again
    """
    CREATE TABLE records (folder TEXT PRIMARY KEY, id TEXT NOT NULL, machine TEXT NOT NULL, time REAL NOT NULL,
                          stage INTEGER NOT NULL, record TEXT NOT NULL);
    INSERT INTO records SELECT folder, id, machine, time, stage, record FROM visits;
    DROP TABLE visits;
    ALTER TABLE records RENAME TO visits;
    CREATE INDEX visits_of_a_machine ON visits (machine, time, stage, id);
    CREATE TABLE courses (machine TEXT PRIMARY KEY, course BLOB NOT NULL);
    """,
)
NEWEST = len(MIGRATIONS)
PATIENCE_S = 120.0
"""How long a writer waits for the others."""


def connect(path: Path, *, create: bool = True) -> sqlite3.Connection:
    """The index, brought to the newest version; only to be read where the user may not write.

    Raises `InputError` where it is not there, damaged, of a newer symfive, or of an older one and may not be written.
    """
    if not create and not path.is_file():
        remedy = "add results with symfive history add, rebuild a lost index with symfive history rebuild, or give --history DIR"
        raise InputError("there is no history", path=path.parent, remedy=remedy)
    readable_only = path.is_file() and not writable(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        name: Path | str = path
        if readable_only:  # without a log nobody writes it, and none can be made: then it needs no locks
            log = path.with_name(f"{path.name}-wal")
            name = f"{path.absolute().as_uri()}?mode=ro{'' if log.exists() else '&immutable=1'}"
        connection = sqlite3.connect(
            name, timeout=PATIENCE_S, isolation_level=None, check_same_thread=False, uri=readable_only
        )
    except (OSError, sqlite3.Error) as error:
        remedy = "choose a place with room where you may write"
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"the index cannot be opened ({reason})", path=path, remedy=remedy) from None
    try:
        if not readable_only:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = FULL")
        _migrate(connection, path)
    except sqlite3.DatabaseError as error:
        connection.close()
        raise broken(error, path) from None
    except UnicodeDecodeError as error:  # in what SQLite says of the damage
        connection.close()
        raise damaged(str(error), path) from None
    except BaseException:
        connection.close()
        raise
    return connection


def writable(path: Path) -> bool:
    """Whether an index may be written: the file, and beside it the log that SQLite writes ahead."""
    return os.access(path, os.W_OK) and os.access(path.parent, os.W_OK)


def put_damaged_aside(path: Path) -> bool:
    """Rename an index that SQLite cannot read, with what belongs to it; whether there was one."""
    if not path.is_file():
        return False
    try:
        connection = sqlite3.connect(path, timeout=PATIENCE_S)
        try:
            (said,) = connection.execute("PRAGMA quick_check(1)").fetchone()
            if said == "ok":
                return False
        finally:
            connection.close()
    except sqlite3.OperationalError as error:  # busy or without rights: not damaged
        raise broken(error, path) from None
    except (sqlite3.DatabaseError, UnicodeDecodeError):
        pass
    for end in ("", "-wal", "-shm"):
        file = path.with_name(path.name + end)
        if file.exists():
            file.replace(path.with_name(f"{path.name}.damaged{end}"))
    return True


def broken(error: sqlite3.Error, path: Path) -> InputError:
    """What SQLite refuses, as a sentence with its remedy."""
    said = str(error)
    if "locked" in said or "busy" in said:
        return InputError("another process is writing the index", path=path, remedy="wait for its end")
    if "full" in said or "disk I/O" in said or "readonly" in said or "unable to open" in said:
        return InputError(f"the index cannot be written ({said})", path=path, remedy="make room, or check your rights")
    return damaged(said, path)


def damaged(said: str, path: Path) -> InputError:
    """That an index cannot be read, by what is wrong in it, with its remedy."""
    return InputError(f"the index is damaged ({said})", path=path, remedy="rebuild it: symfive history rebuild FOLDER")


def _migrate(connection: sqlite3.Connection, path: Path) -> None:
    """Apply what is missing; two processes that begin at once do it once."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version == NEWEST:
        return
    connection.execute("BEGIN IMMEDIATE")
    try:
        (version,) = connection.execute("PRAGMA user_version").fetchone()
        if version > NEWEST:
            problem = f"the index is of version {version}, this symfive knows {NEWEST}"
            raise InputError(problem, path=path, remedy="use the newer symfive, or rebuild the index in another folder")
        for number in range(version, NEWEST):
            for statement in MIGRATIONS[number].split(";"):
                if statement.strip():
                    connection.execute(statement)
        connection.execute(f"PRAGMA user_version = {NEWEST}")
        connection.execute("COMMIT")
    except BaseException:
        connection.execute("ROLLBACK")
        raise
