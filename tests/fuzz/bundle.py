"""Several files as one text, so that a reader of folders, too, is fuzzed with one input: `=== name` begins a file."""

import re
from pathlib import Path

HEAD = re.compile(rb"^=== ([A-Za-z0-9._/-]{1,60})\n", re.MULTILINE)
MOST_FILES = 20


def packed(folder: Path, *names: str, lines: int = 6) -> bytes:
    """The files of a folder, of each CSV the first `lines`."""
    parts = []
    for name in names:
        data = (folder / name).read_bytes()
        if name.endswith(".csv"):
            data = b"\n".join(data.split(b"\n")[:lines]) + b"\n"
        parts.append(b"=== " + name.encode() + b"\n" + data)
    return b"".join(parts)


def unpack(data: bytes, folder: Path) -> None:
    """Write the files below the folder; names that would leave it and files in each other's way are passed over."""
    pieces = HEAD.split(data)[1:]
    for name, text in list(zip(pieces[::2], pieces[1::2], strict=True))[:MOST_FILES]:
        path = folder / name.decode()
        if name.startswith(b"/") or b".." in name or path.is_dir():
            continue
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(text)
        except OSError:
            continue
