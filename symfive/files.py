"""Reading text whatever the file is, and writing files whole or not at all."""

from __future__ import annotations

import json
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from symfive.errors import InputError

__all__ = ["one_line", "output_folder", "read_text", "shown", "write_json", "write_text"]

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


def read_text(path: Path, *, at_most: int = MAX_TEXT_BYTES) -> str:
    """The file's text; every way in which that can fail is one `InputError`."""
    try:
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
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = error.start - (data.rfind(b"\n", 0, error.start) + 1) + 1
        problem = f"byte 0x{data[error.start]:02x} is not UTF-8 text"
        raise InputError(problem, path=path, line=line, column=column, remedy="save the file as UTF-8") from None
    _refuse_other_encodings(path, data)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _refuse_other_encodings(path: Path, data: bytes) -> None:
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError("the file is UTF-16 text", path=path, line=1, remedy="save the file as UTF-8")
    if b"\0" in data:
        line = data.count(b"\n", 0, data.index(b"\0")) + 1
        raise InputError("a NUL byte stands in the text", path=path, line=line, remedy="give a text file in UTF-8")


def write_text(path: Path, text: str) -> None:
    """Write `path` whole or not at all (a temporary sibling, flushed to disk, then renamed)."""
    with _writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".writing.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as stream:
                stream.write(text)
                stream.flush()
                os.fsync(stream.fileno())
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise


@contextmanager
def _writing(target: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        problem = f"it cannot be written ({error.strerror or error})"
        raise InputError(problem, path=target, remedy="choose a place with room where you may write") from None


def write_json(path: Path, data: Any) -> None:
    """Write JSON whole or not at all; NaN and infinity are refused, dates become text."""
    write_text(path, json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False, default=str) + "\n")


@contextmanager
def output_folder(target: Path) -> Iterator[Path]:
    """A temporary folder that becomes `target` when the block ends without an error.

    Where `target` already exists, files of the same name are replaced one by one (each whole) and others
    stay.
    """
    target = Path(target)
    with _writing(target):
        if target.exists() and not target.is_dir():
            problem = "the output must be a folder, and a file of that name exists"
            raise InputError(problem, path=target, remedy="name another")
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=target.parent, prefix=".writing."))
    try:
        yield temporary
        with _writing(target):
            os.chmod(temporary, 0o755)
            if not target.exists():
                os.rename(temporary, target)
                return
            for file in sorted(p for p in temporary.rglob("*") if p.is_file()):
                destination = target / file.relative_to(temporary)
                destination.parent.mkdir(parents=True, exist_ok=True)
                os.replace(file, destination)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
