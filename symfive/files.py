"""Reading text whatever the file is."""

from __future__ import annotations

import stat
from pathlib import Path

from symfive.errors import InputError
from symfive.outputs import Reading

MAX_TEXT_BYTES = 1_000_000_000


def shown(value: object) -> str:
    """The value as it stands in a message: its `repr`, cut to 60 characters."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # nested without end, or an integer of more than 4300 digits
        return f"a {type(value).__name__} too long to show"
    return text if len(text) <= 60 else f"{text[:57]}..."


def one_line(text: str) -> str:
    """Text from outside as one line: blanks of every kind as one blank, what is not printed as a question mark."""
    return "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))


def read_bytes(path: Path, *, at_most: int = MAX_TEXT_BYTES, text: bool = False, listed: bool = False) -> bytes:
    """The file's bytes; every way in which that can fail is one `InputError`, a `text` in UTF-16 too.

    `listed`: a manifest beside it must hold it.
    """
    try:
        reading = Reading(path, listed=listed)
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise InputError("this is a folder, not a file", path=path, remedy="name the file inside it")
        if not stat.S_ISREG(status.st_mode):
            raise InputError("this is a device or a pipe, not a file", path=path, remedy="save it as a file first")
        if status.st_size > at_most:
            problem = f"the file has {status.st_size} bytes, more than {at_most}"
            raise InputError(problem, path=path, remedy="check that it is the right file, or split it")
        with path.open("rb") as stream:
            start = stream.read(65536)
            if text:
                _refuse_other_encodings(path, start)
            data = start + stream.read()
    except FileNotFoundError:
        raise InputError("there is no such file", path=path, remedy="check the name and the folder") from None
    except OSError as error:
        problem = f"the file cannot be read ({error.strerror or error})"
        raise InputError(problem, path=path, remedy="check its name and rights") from None
    except InputError:
        raise
    except (MemoryError, ValueError) as error:  # ValueError: a NUL in the name
        problem = f"the file cannot be read ({str(error) or 'not enough memory'})"
        raise InputError(problem, path=path, remedy="check its name and size") from None
    reading.update(data)
    reading.end()
    return data


def read_text(path: Path, *, at_most: int = MAX_TEXT_BYTES, listed: bool = False) -> str:
    """The same as text."""
    return decoded(path, read_bytes(path, at_most=at_most, text=True, listed=listed))


def decoded(path: Path, data: bytes, before: int = 0) -> str:
    """The text of a part of a file in UTF-8, every line ended by a line feed; `before` lines of the file stand before it. Raises
    `InputError` with line and column."""
    _refuse_other_encodings(path, data, before)
    try:
        text = data.decode("utf-8" if before else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = before + data.count(b"\n", 0, error.start) + 1
        column = error.start - (data.rfind(b"\n", 0, error.start) + 1) + 1
        problem = f"byte 0x{data[error.start]:02x} is not UTF-8 text"
        raise InputError(problem, path=path, line=line, column=column, remedy="save the file as UTF-8") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _refuse_other_encodings(path: Path, data: bytes, before: int = 0) -> None:
    if not before and data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError("the file is UTF-16 text", path=path, line=1, remedy="save the file as UTF-8")
    if b"\0" in data:
        line = before + data.count(b"\n", 0, data.index(b"\0")) + 1
        raise InputError("a NUL byte stands in the text", path=path, line=line, remedy="give a text file in UTF-8")
