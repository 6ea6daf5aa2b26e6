"""Arrays too long for memory: in temporary files that vanish with them."""

from __future__ import annotations

import mmap
import os
import tempfile
from pathlib import Path
from typing import IO, Any

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError

IN_MEMORY_BYTES = 1 << 21
TURNED_ROWS = 1 << 16


def new_table(rows: int, columns: int) -> Array:
    """An array (rows, columns) of zeros, on disk where it is large. Raises `InputError` where the disk has no room."""
    size = 8 * rows * columns
    if size <= IN_MEMORY_BYTES:
        return np.zeros((rows, columns))
    with _temporary() as file:
        try:
            _reserve(file, size)
        except OSError as error:
            raise _no_room(error) from None
        return np.memmap(file, dtype=np.float64, mode="r+", shape=(rows, columns))


class Spool:
    """A table (N, columns) of unknown length, written by blocks of rows and then read by columns."""

    def __init__(self, columns: int) -> None:
        self._file, self._columns = _temporary(), columns

    def __enter__(self) -> Spool:
        return self

    def __exit__(self, *error: object) -> None:
        self._file.close()

    def append(self, table: Array) -> None:
        """Write further rows (n, columns). Raises `InputError` where the disk has no room."""
        try:
            self._file.write(np.ascontiguousarray(table).tobytes())
        except OSError as error:
            raise _no_room(error) from None

    def finish(self) -> Array:
        """The table turned, (columns, N), so that each column lies in one piece."""
        rows = self._file.tell() // (8 * self._columns)
        turned = new_table(self._columns, rows)
        self._file.seek(0)
        for first in range(0, rows, TURNED_ROWS):
            block = np.frombuffer(self._file.read(8 * self._columns * TURNED_ROWS)).reshape(-1, self._columns)
            turned[:, first : first + len(block)] = block.T
            release(turned)
        return turned


def release(*arrays: Array) -> None:
    """Take the pages of arrays that lie on disk out of memory; they come back when they are read."""
    for array in arrays:
        mapped: Any = getattr(array, "_mmap", None)
        shared = mapped is not None and getattr(array, "mode", "c") != "c"  # a private copy would be lost
        if shared and hasattr(mmap, "MADV_DONTNEED"):
            mapped.madvise(mmap.MADV_DONTNEED)


def _temporary() -> IO[bytes]:
    try:
        return tempfile.TemporaryFile(prefix="symfive.")
    except OSError as error:
        raise _no_room(error) from None


def _reserve(file: IO[bytes], size: int) -> None:
    """Room on the disk, so that none lacks when a page is written."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), 0, size)
    else:
        file.truncate(size)


def _no_room(error: OSError) -> InputError:
    problem = f"a temporary file cannot be written ({error.strerror or error})"
    remedy = "set TMPDIR to a folder with room: a long recording takes 16 bytes a reading and 8 a command there"
    return InputError(problem, path=Path(tempfile.gettempdir()), remedy=remedy)
