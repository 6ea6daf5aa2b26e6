"""The lines of a text file, all at once or, where it is long, block by block."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

from symfive.errors import InputError
from symfive.files import decoded, read_text
from symfive.outputs import Reading

BLOCK_BYTES = 1 << 22
MOST_BYTES = 100_000_000_000


def lines_of(path: Path, block: int | None = None) -> Iterator[tuple[int, list[str]]]:
    """Blocks of lines, each with the number of its first line (from 1), without blank lines at the end of the file.

    Files of more than `block` bytes are never held whole. Raises `InputError` as `read_text` does.
    """
    block = block or BLOCK_BYTES
    try:
        status = os.stat(path)
        long = stat.S_ISREG(status.st_mode) and block < status.st_size <= MOST_BYTES
    except (OSError, ValueError):
        long = False  # and `read_text` says why
    number, blank = 1, 0
    for text in _texts(path, block) if long else [read_text(path, at_most=MOST_BYTES)]:
        lines = text.split("\n")
        if text.endswith("\n"):
            lines.pop()
        lines = [""] * blank + lines
        count = len(lines)
        while lines and not lines[-1].strip():
            lines.pop()
        blank = count - len(lines)
        if lines:
            yield number, lines
            number += len(lines)


def _texts(path: Path, block: int) -> Iterator[str]:
    """The file's text in blocks that end with a line."""
    before, rest = 0, b""
    try:
        reading = Reading(path)
        with path.open("rb") as stream:
            while True:
                fresh = stream.read(block)
                reading.update(fresh)
                data = rest + fresh
                if not data:
                    reading.end()
                    return
                end = len(data) if not fresh else 1 + max(data.rfind(b"\n"), data.rfind(b"\r", 0, len(data) - 1))
                text = decoded(path, data[:end] or data, before)
                if not end:
                    problem = f"the line has more than {len(data)} bytes"
                    raise InputError(problem, path=path, line=before + 1, remedy="check that it is the right file")
                rest = data[end:]
                before += text.count("\n")
                yield text
    except OSError as error:
        problem = f"the file cannot be read ({error.strerror or error})"
        raise InputError(problem, path=path, remedy="check its name and rights") from None
