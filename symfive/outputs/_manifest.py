"""The manifest of a folder of results: what was read, what was written, by which version and command; inputs held against it."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from symfive.errors import InputError
from symfive.outputs._place import being_written

MANIFEST = "manifest.json"
SCHEMA = "symfive.manifest/1"
command: ContextVar[str] = ContextVar("command", default="Python")
"""The command line that is running."""


@contextmanager
def by_command(words: str) -> Iterator[None]:
    """Manifests written in this block say that the command line `words` made them."""
    token = command.set(words)
    try:
        yield
    finally:
        command.reset(token)


def manifest_of(folder: Path) -> Mapping[str, Any] | None:
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


def digest_of(path: Path) -> str:
    """The file's SHA-256."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def cut(text: str) -> str:
    """The text with at most 200 characters, for a sentence."""
    return text if len(text) <= 200 else f"{text[:197]}..."


@contextmanager
def own_data() -> Iterator[None]:
    """What is read in this block came with symfive: no input, since the manifest's version says which it is."""
    token = being_written.set(None)
    try:
        yield
    finally:
        being_written.reset(token)


class Reading:
    """A file being read: `update` with its bytes as they come, `end` once.

    Raises `InputError` where the output of this call would replace the file, and where a manifest holds another one.
    `listed`: the folder's manifest, if there is one, must hold it.
    """

    def __init__(self, path: Path, *, listed: bool = False) -> None:
        self._path, self._output = path, being_written.get()
        real = Path(os.path.realpath(path))
        if self._output is not None and real.is_relative_to(self._output.target):
            problem = f"this input lies where the results would go ({self._output.target})"
            raise InputError(problem, path=path, remedy="name another output")
        folder = next((f for f in real.parents if (f / MANIFEST).is_file()), None)
        manifest = None if folder is None or real.name == MANIFEST else manifest_of(folder)
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
            problem = f'this is not the file that "{cut(self._by)}" wrote, as {MANIFEST} beside it says'
            raise InputError(
                problem, path=self._path, remedy=f"run that again, or delete {MANIFEST} to use the folder as it is"
            )
        if self._output is not None:
            self._output.read[str(self._path)] = found
