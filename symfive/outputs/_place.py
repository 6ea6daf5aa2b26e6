"""The place of an output: nobody else writes there, and what is beside it takes its name by one rename."""

from __future__ import annotations

import ctypes
import os
import shutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from symfive.errors import InputError

EXCHANGE = 2  # renameat2's flag (Linux)


class Output:
    """What is being written: its place, the file or folder beside it, what was read meanwhile, what people may edit."""

    def __init__(self, target: Path, overwrite: bool, recorded: bool) -> None:
        self.target, self.overwrite, self.recorded = target, overwrite, recorded
        self.beside = target.with_name(f".{target.name}.writing")
        self.read: dict[str, str] = {}
        self.to_edit: set[str] = set()

    def holds(self, path: Path) -> bool:
        """Whether `path` is written as part of it."""
        return Path(os.path.abspath(path)).is_relative_to(self.beside)


being_written: ContextVar[Output | None] = ContextVar("output", default=None)
"""The output that is open."""


def put(path: Path, parts: Iterable[bytes]) -> None:
    """Write a file and wait until the disk has it."""
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_BINARY", 0), 0o644)
    try:
        for part in parts:
            rest = memoryview(part)
            while rest:
                rest = rest[os.write(handle, rest) :]
        os.fsync(handle)
    finally:
        os.close(handle)


def before_of(target: Path) -> Path:
    """Where the former results lie between two renames."""
    return target.with_name(f".{target.name}.before")


def swap(output: Output) -> None:
    """The results in their place by one rename; by two, undone by the next call, where the system cannot exchange names."""
    if not output.target.exists() or not any(output.target.iterdir()):
        if output.target.exists() and os.name == "nt":
            output.target.rmdir()
        os.rename(output.beside, output.target)
    elif not exchanged(output.beside, output.target):
        before = before_of(output.target)
        os.rename(output.target, before)
        os.rename(output.beside, output.target)
        shutil.rmtree(before, ignore_errors=True)
    with suppress(OSError):  # the results are in their place; when the disk has their name is the system's affair
        sync(output.target.parent)


def exchanged(one: Path, other: Path) -> bool:
    """Exchange the names of two folders in one step, where the system can."""
    if sys.platform != "linux":
        return False
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    here = ctypes.c_int(-100)  # AT_FDCWD
    return renameat2 is not None and renameat2(here, os.fsencode(one), here, os.fsencode(other), EXCHANGE) == 0


def sync(folder: Path) -> None:
    """The folder's names on the disk, where the system can."""
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def alone(target: Path) -> Iterator[None]:
    """Nobody else writes `target` meanwhile; the lock falls with the process. Folders above are made, and unmade in failure."""
    made = [folder for folder in target.parents if not folder.exists()]
    with ExitStack() as undo:
        for folder in reversed(made):
            folder.mkdir(exist_ok=True)
            undo.callback(_remove_empty, folder)
        with _locked(target):
            yield
        undo.pop_all()


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):  # somebody uses it
        folder.rmdir()


@contextmanager
def _locked(target: Path) -> Iterator[None]:
    if sys.platform == "win32":
        yield
        return
    import fcntl

    path = target.with_name(f".{target.name}.lock")
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise InputError("another process is writing there", path=target, remedy="wait for its end") from None
        except BaseException:
            os.close(handle)
            raise
        if path.exists() and path.stat().st_ino == os.fstat(handle).st_ino:
            break
        os.close(handle)  # who had it removed it: once more
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()
        os.close(handle)


@contextmanager
def writing(target: Path) -> Iterator[None]:
    """What the system refuses in this block is an `InputError`."""
    try:
        yield
    except OSError as error:
        problem = f"it cannot be written ({error.strerror or error})"
        raise InputError(problem, path=target, remedy="choose a place with room where you may write") from None
