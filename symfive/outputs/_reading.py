"""Inputs: never what is being written, and what the manifest beside them says."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from symfive.errors import InputError
from symfive.outputs._manifest import MANIFEST, cut, manifest_of
from symfive.outputs._place import being_written


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
