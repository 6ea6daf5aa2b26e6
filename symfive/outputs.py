"""The one place through which every verb writes: whole or not at all, never over an input, bound by a manifest.

A folder of results is made beside its place and swapped in by one rename. Its `manifest.json` holds the hashes of what was
read and of what was written; `reading` refuses a file that is not the one its manifest holds. Files that people fill in or
edit (a plan's tables, TOML) are listed there and not bound. A folder without a manifest is read as it is.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from symfive import __version__
from symfive.errors import InputError

__all__ = [
    "MANIFEST",
    "Reading",
    "by_command",
    "output_file",
    "output_folder",
    "write_bytes",
    "write_json",
    "write_text",
]

MANIFEST = "manifest.json"
SCHEMA = "symfive.manifest/1"
_EXCHANGE = 2  # renameat2's flag (Linux)


class _Output:
    """What is being written: its place, the file or folder beside it, what was read meanwhile, what people may edit."""

    def __init__(self, target: Path, overwrite: bool, recorded: bool) -> None:
        self.target, self.overwrite, self.recorded = target, overwrite, recorded
        self.beside = target.with_name(f".{target.name}.writing")
        self.read: dict[str, str] = {}
        self.to_edit: set[str] = set()

    def holds(self, path: Path) -> bool:
        """Whether `path` is written as part of it."""
        return Path(os.path.abspath(path)).is_relative_to(self.beside)


_open: ContextVar[_Output | None] = ContextVar("output", default=None)
_command: ContextVar[str] = ContextVar("command", default="Python")


@contextmanager
def by_command(words: str) -> Iterator[None]:
    """Manifests written in this block say that the command line `words` made them."""
    token = _command.set(words)
    try:
        yield
    finally:
        _command.reset(token)


# --- reading ------------------------------------------------------------------------------------------------------


class Reading:
    """A file being read: `update` with its bytes as they come, `end` once.

    Raises `InputError` where the output of this call would replace the file, and where a manifest holds another one.
    `listed`: the folder's manifest, if there is one, must hold it.
    """

    def __init__(self, path: Path, *, listed: bool = False) -> None:
        self._path, self._output = path, _open.get()
        real = Path(os.path.realpath(path))
        if self._output is not None and real.is_relative_to(self._output.target):
            problem = f"this input lies where the results would go ({self._output.target})"
            raise InputError(problem, path=path, remedy="name another output")
        folder = next((f for f in real.parents if (f / MANIFEST).is_file()), None)
        manifest = None if folder is None or real.name == MANIFEST else _manifest_of(folder)
        self._wanted: str | None = None
        if folder is not None and manifest is not None:
            name = real.relative_to(folder).as_posix()
            self._wanted = manifest["outputs"].get(name)
            self._by = manifest["command"]
            if self._wanted is None and listed and real.parent == folder:
                self._wanted = "none"
        self._digest = hashlib.sha256() if self._wanted or self._output else None

    def update(self, data: bytes) -> None:
        """Further bytes of the file."""
        if self._digest is not None:
            self._digest.update(data)

    def end(self) -> None:
        """The file was read to its end."""
        if self._digest is None:
            return
        found = self._digest.hexdigest()
        if self._wanted not in (None, found):
            problem = f'this is not the file that "{_cut(self._by)}" wrote, as {MANIFEST} beside it says'
            raise InputError(
                problem, path=self._path, remedy=f"run that again, or delete {MANIFEST} to use the folder as it is"
            )
        if self._output is not None:
            self._output.read[str(self._path)] = found


def _cut(text: str) -> str:
    return text if len(text) <= 200 else f"{text[:197]}..."


def _manifest_of(folder: Path) -> Mapping[str, Any] | None:
    """The manifest in a folder; None where there is none, or one of somebody else."""
    path = folder / MANIFEST
    try:
        data = json.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError):
        data = {"schema": SCHEMA}
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        return None
    right = isinstance(data.get("command"), str) and all(
        isinstance(data.get(key), dict) and all(isinstance(value, str) for value in data[key].values())
        for key in ("inputs", "outputs", "to_edit")
    )
    if not right:
        raise InputError("the manifest is damaged", path=path, remedy="delete it to use the folder as it is")
    return data


# --- writing ------------------------------------------------------------------------------------------------------


def write_bytes(path: Path, data: bytes, *, to_edit: bool = False) -> None:
    """Write a file: as part of the output that is open, else by itself, whole or not at all. `to_edit`: people change it."""
    output = _open.get()
    if output is not None and output.holds(path):
        with _writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            _put(path, data)
        if to_edit:
            output.to_edit.add(Path(os.path.abspath(path)).relative_to(output.beside).as_posix())
        return
    target = Path(os.path.realpath(path))
    with _writing(path), _alone(target):
        beside = target.with_name(f".{target.name}.writing")
        try:
            _put(beside, data)
            os.replace(beside, target)
        except BaseException:
            beside.unlink(missing_ok=True)
            raise


def write_text(path: Path, text: str, *, to_edit: bool = False) -> None:
    """The same for text in UTF-8."""
    write_bytes(path, text.encode(), to_edit=to_edit)


def write_json(path: Path, data: Any) -> None:
    """The same for JSON; NaN and infinity are refused, dates become text."""
    write_text(path, json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False, default=str) + "\n")


def _put(path: Path, data: bytes) -> None:
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_BINARY", 0), 0o644)
    try:
        rest = memoryview(data)
        while rest:
            rest = rest[os.write(handle, rest) :]
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def output_file(target: Path) -> Iterator[Path]:
    """The path under which to write a file that becomes `target` when the block ends; one that exists is never replaced."""
    target = _real(target)
    with _place(target, False, False) as output:
        if os.path.lexists(target):
            problem = "a file or folder of that name exists"
            raise InputError(problem, path=target, remedy="name another, or remove it yourself")
        try:
            yield output.beside
            with _writing(target):
                os.replace(output.beside, target)
        finally:
            output.beside.unlink(missing_ok=True)


@contextmanager
def output_folder(target: Path, *, overwrite: bool = False, recorded: bool = False) -> Iterator[Path]:
    """A folder that becomes `target`, with its manifest, when the block ends without an error; within one, a part of it.

    An existing folder is replaced only with `overwrite`, and only where symfive wrote its results and nobody changed them;
    what else lies there stays. `recorded`: they are readings of an instrument, which `overwrite` replaces only while
    their source is still there. What the block reads are the inputs. Raises `InputError`.
    """
    outer = _open.get()
    if outer is not None and outer.holds(target):
        with _writing(target):
            target.mkdir(parents=True, exist_ok=True)
        yield target
        return
    target = _real(target)
    with _place(target, overwrite, recorded) as output:
        _replaceable(output)
        number = 0
        try:
            with _writing(target):
                os.mkdir(output.beside)
                number = output.beside.stat().st_ino
            yield output.beside
            with _writing(target):
                _finish(output)
                _swap(output)
        except BaseException as error:
            done = os.path.isdir(target) and target.stat().st_ino == number
            said = f"the results in {target} are complete" if done else f"nothing was written to {target}"
            error.add_note(said)
            raise
        finally:
            shutil.rmtree(output.beside, ignore_errors=True)


def _real(target: Path) -> Path:
    """The place itself. Raises `InputError` for a root, beside which nothing lies."""
    real = Path(os.path.realpath(target))
    if not real.name:
        raise InputError("a folder of that name exists", path=target, remedy="name a folder inside it")
    return real


@contextmanager
def _place(target: Path, overwrite: bool, recorded: bool) -> Iterator[_Output]:
    """The output as the one that is open, its place nobody else's, what a crash left there cleaned."""
    output = _Output(target, overwrite, recorded)
    with ExitStack() as stack:
        with _writing(target):
            stack.enter_context(_alone(target))
            before = _before(target)
            if before.exists() and not target.exists():
                os.rename(before, target)
            for left in (before, output.beside):
                if left.is_dir():
                    shutil.rmtree(left)
                else:
                    left.unlink(missing_ok=True)
        token = _open.set(output)
        try:
            yield output
        finally:
            _open.reset(token)


def _before(target: Path) -> Path:
    return target.with_name(f".{target.name}.before")


def _replaceable(output: _Output) -> list[str]:
    """What lies in the target and stays there. Raises `InputError` where the target must not be replaced."""
    target = output.target
    if not os.path.lexists(target):
        return []
    if not target.is_dir():
        raise InputError(
            "the output must be a folder, and a file of that name exists", path=target, remedy="name another"
        )
    if Path.cwd().is_relative_to(target):
        raise InputError("the output is the folder that you are in", path=target, remedy="name a folder inside it")
    files = [p.relative_to(target).as_posix() for p in sorted(target.rglob("*")) if p.is_symlink() or not p.is_dir()]
    if not files:
        return []
    manifest = _manifest_of(target)
    if manifest is None:
        problem = f"the folder holds files that symfive did not write there, as {_cut(files[0])}"
        raise InputError(problem, path=target, remedy="name another folder")
    if not output.overwrite:
        raise InputError("results lie there already", path=target, remedy="name another folder, or give --overwrite")
    if manifest.get("recorded") and not all(_is_there(Path(n), digest) for n, digest in manifest["inputs"].items()):
        problem = "readings lie there whose source is gone or was changed"
        raise InputError(problem, path=target, remedy="name another folder, or remove this one yourself")
    known = {**manifest["outputs"], **manifest["to_edit"]}
    for name in files:
        if name in known and _digest(target / name) != known[name]:
            problem = "the file was changed since symfive wrote it, and would be replaced"
            raise InputError(problem, path=target / name, remedy="name another folder, or remove this one yourself")
    # Python's caches hold what the files replaced were, and a file of the same second and size would be taken for its forerunner
    return [name for name in files if name not in known and name != MANIFEST and "__pycache__" not in name.split("/")]


def _finish(output: _Output) -> None:
    """The manifest, and beside the results what else lies in the target."""
    written = sorted(p for p in output.beside.rglob("*") if p.is_file())
    digests = {p.relative_to(output.beside).as_posix(): _digest(p) for p in written}
    manifest = {
        "schema": SCHEMA,
        "version": __version__,
        "command": _command.get(),
        "recorded": output.recorded,
        "inputs": output.read,
        "outputs": {name: digest for name, digest in digests.items() if name not in output.to_edit},
        "to_edit": {name: digest for name, digest in digests.items() if name in output.to_edit},
    }
    _put(output.beside / MANIFEST, (json.dumps(manifest, indent=1, ensure_ascii=False) + "\n").encode())
    for name in _replaceable(output):
        here, there = output.target / name, output.beside / name
        if os.path.lexists(there):
            raise InputError("a file of yours would be replaced", path=here, remedy="move it away")
        there.parent.mkdir(parents=True, exist_ok=True)
        if here.is_symlink():
            os.symlink(os.readlink(here), there)
        else:
            try:
                os.link(here, there)
            except OSError:  # a file system without links
                shutil.copy2(here, there)
    for folder in (output.beside, *(p for p in output.beside.rglob("*") if p.is_dir())):
        _sync(folder)


def _swap(output: _Output) -> None:
    """The results in their place by one rename; by two, undone by the next call, where the system cannot exchange names."""
    if not output.target.exists() or not any(output.target.iterdir()):
        if output.target.exists() and os.name == "nt":
            output.target.rmdir()
        os.rename(output.beside, output.target)
    elif not _exchanged(output.beside, output.target):
        before = _before(output.target)
        os.rename(output.target, before)
        os.rename(output.beside, output.target)
        shutil.rmtree(before, ignore_errors=True)
    with suppress(OSError):  # the results are in their place; when the disk has their name is the system's affair
        _sync(output.target.parent)


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange the names of two folders in one step, where the system can."""
    if sys.platform != "linux":
        return False
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    here = ctypes.c_int(-100)  # AT_FDCWD
    return renameat2 is not None and renameat2(here, os.fsencode(one), here, os.fsencode(other), _EXCHANGE) == 0


def _sync(folder: Path) -> None:
    """The folder's names on the disk, where the system can."""
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _is_there(path: Path, digest: str) -> bool:
    return path.is_file() and _digest(path) == digest


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@contextmanager
def _alone(target: Path) -> Iterator[None]:
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
def _writing(target: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        problem = f"it cannot be written ({error.strerror or error})"
        raise InputError(problem, path=target, remedy="choose a place with room where you may write") from None
