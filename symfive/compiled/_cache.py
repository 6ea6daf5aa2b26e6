"""Compiled libraries on disk, kept from run to run in a folder that nobody but the user can write to.

A library lies at `KEY/DIGEST.so`: KEY says what it was made from, DIGEST is the SHA-256 of its own bytes, so that a file that
was cut short or changed is never loaded. It arrives by one rename; processes that compile the same at one time do no harm.
`KEY/interpreted` holds the seconds of interpretation, in all runs, of a function that has no library yet.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

MOST = 1000
"""Functions of which something is kept; those used longest ago go first."""
ABANDONED_S = 3600.0
MOST_SECONDS = 1e6
_WORK, _SECONDS = "work-", "interpreted"


def cache_folder() -> Path:
    """`$XDG_CACHE_HOME/symfive`, by default `~/.cache/symfive`, made where it is missing.

    Raises `OSError` where it cannot be made, belongs to somebody else, or others could change what is in it.
    """
    if os.name != "posix":
        raise OSError("who may write to a folder is asked the POSIX way only")
    given = os.environ.get("XDG_CACHE_HOME", "")
    try:
        base = Path(given) if os.path.isabs(given) else Path.home() / ".cache"
    except RuntimeError as error:
        raise OSError(str(error)) from None
    folder = base / "symfive"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder = folder.resolve()
    _private(folder)
    for parent in folder.parents:
        _firm(parent)
    return folder


def _private(path: Path) -> None:
    status = path.lstat()
    if status.st_uid != os.getuid():
        raise OSError(f"{path} belongs to another user")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise OSError(f"others can write to {path}")


def _firm(path: Path) -> None:
    """Nobody but its owner, who is the user or root, can move what is in it; where others write, only their own."""
    status = path.lstat()
    if status.st_uid not in (0, os.getuid()):
        raise OSError(f"{path} belongs to another user")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not status.st_mode & stat.S_ISVTX:
        raise OSError(f"others can write to {path}")


def find(folder: Path, key: str) -> Path | None:
    """The whole and unchanged library of a key, or None. Damaged files are removed."""
    place = folder / key
    try:
        _private(place)
        for path in sorted(place.iterdir()):
            if path.name == _SECONDS:
                continue
            _private(path)
            if path.suffix == ".so" and hashlib.sha256(path.read_bytes()).hexdigest() == path.stem:
                os.utime(place)
                return path
            discard(path)
    except OSError:
        pass
    return None


def keep(folder: Path, key: str, library: Path) -> Path:
    """Move a finished library to its place; returns where it is."""
    place = folder / key
    place.mkdir(mode=0o700, exist_ok=True)
    _private(place)
    path = place / f"{hashlib.sha256(library.read_bytes()).hexdigest()}.so"
    os.replace(library, path)
    discard(place / _SECONDS)
    _tidy(folder)
    return path


def remembered(folder: Path, key: str) -> float:
    """Seconds of interpretation in earlier runs; 0 where none are noted."""
    try:
        _private(folder / key / _SECONDS)
        seconds = float((folder / key / _SECONDS).read_bytes()[:40])
    except (OSError, ValueError):
        return 0.0
    return seconds if 0.0 <= seconds < MOST_SECONDS else 0.0


def remember(folder: Path, key: str, seconds: float) -> None:
    """Note the seconds of interpretation so far, for the runs to come."""
    with suppress(OSError):
        place = folder / key
        place.mkdir(mode=0o700, exist_ok=True)
        _private(place)
        part = place / f"{_SECONDS}-{os.getpid()}-{threading.get_ident()}"
        part.write_text(f"{seconds:.3f}", encoding="ascii")
        os.replace(part, place / _SECONDS)


def discard(path: Path) -> None:
    """Remove a file that is of no use, if it is there."""
    with suppress(OSError):
        path.unlink(missing_ok=True)


@contextmanager
def workplace(folder: Path) -> Iterator[Path]:
    """A folder of one's own to compile in, removed afterwards."""
    path = Path(tempfile.mkdtemp(prefix=_WORK, dir=folder))
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)


def _tidy(folder: Path) -> None:
    """Remove what was used longest ago beyond `MOST`, and what interrupted compilations have left."""
    found = []
    for path in folder.iterdir():
        try:
            found.append((path.stat().st_mtime, path))
        except OSError:
            continue  # another process has removed it
    found.sort(reverse=True)
    old = [path for age, path in found if path.name.startswith(_WORK) and time.time() - age > ABANDONED_S]
    kept = [path for _, path in found if not path.name.startswith(_WORK)]
    for path in (*old, *kept[MOST:]):
        shutil.rmtree(path, ignore_errors=True)
