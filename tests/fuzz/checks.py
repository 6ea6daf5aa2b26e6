"""What must hold of every input, whatever it is: it is read and right, or refused in one sentence."""

import math
import os
import shutil
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from symfive.errors import InputError

LONGEST_S = 5.0
LONGEST_SENTENCE = 1500


class Fault(AssertionError):  # noqa: N818
    """An invariant does not hold."""


@dataclass(frozen=True)
class Reader:
    """One reader under test.

    `put` lays the input out in a folder, `read` reads it from there and may raise `InputError`, `check` looks at what was
    accepted and has a folder to write to. With `lines` every sentence about a file that is there names its line.
    `seeds` are the inputs to begin with, `words` what mutations may put into them.
    """

    put: Callable[[bytes, Path], None]
    read: Callable[[Path], Any]
    check: Callable[[Any, Path], None]
    seeds: Callable[[], Iterator[bytes]]
    words: tuple[str, ...] = ()
    lines: bool = False


def run(reader: Reader, data: bytes, room: Path) -> str:
    """Give the reader one input: "read" or "refused". Raises whatever is a fault. `room` is emptied first."""
    shutil.rmtree(room, ignore_errors=True)
    source, target = room / "in", room / "out"
    source.mkdir(parents=True)
    reader.put(data, source)
    before = _tree(source)
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            found = reader.read(source)
        except InputError as error:
            _sentence(error, source, reader.lines)
            outcome = "refused"
        else:
            reader.check(found, target)
            outcome = "read"
    taken = time.process_time() - begin  # of the processor: others may keep it busy
    if taken > LONGEST_S:
        raise Fault(f"it took {taken:.1f} s")
    if _tree(source) != before or not {p.name for p in room.iterdir()} <= {"in", "out"}:
        raise Fault(f"files were written beside the output: {sorted(map(str, room.rglob('*')))}")
    return outcome


def _tree(folder: Path) -> dict[str, bytes | None]:
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}


def _sentence(error: InputError, source: Path, lines: bool) -> None:
    text = str(error)
    if error.path is None or str(error.path) not in text:
        raise Fault(f"the sentence names no file: {text}")
    if not error.remedy or not error.problem:
        raise Fault(f"the sentence has no remedy: {text}")
    if text != " ".join(text.split()) or not text.endswith((".", "?")) or len(text) > LONGEST_SENTENCE:
        raise Fault(f"that is no sentence: {text[:LONGEST_SENTENCE]}")
    if "not of the right form" in text or "Traceback" in text:
        raise Fault(f"the sentence does not say what is wrong: {text}")
    if error.line is not None and not 1 <= error.line <= _lines(error.path):
        raise Fault(f"line {error.line} is not in the file: {text}")
    if lines and error.line is None and os.path.isfile(error.path):
        raise Fault(f"the sentence names no line: {text}")


def _lines(path: Path) -> int:
    text = path.read_bytes().replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return text.count(b"\n") + 1


def finite(value: Any, name: str = "") -> None:
    """Raise `Fault` where a number in a nested value is not finite; what a file holds beside (`extra`) is not looked at."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind != "f" or not np.isfinite(value).all():
            raise Fault(f"{name} is not finite")
    elif is_dataclass(value):
        for field in fields(value):
            if field.name not in ("extra", "text", "comments", "notes"):
                finite(getattr(value, field.name), f"{name}.{field.name}")
    elif isinstance(value, Mapping):
        for key, entry in value.items():
            finite(entry, f"{name}.{key}")
    elif isinstance(value, (list, tuple)):
        for number, entry in enumerate(value):
            finite(entry, f"{name}.{number}")
    elif isinstance(value, float) and not math.isfinite(value):
        raise Fault(f"{name} = {value} was accepted")


def equal(a: Any, b: Any, name: str = "") -> None:
    """Raise `Fault` where two nested values differ. Where a file lay and its text do not count."""
    if isinstance(a, np.ndarray):
        same = a.shape == b.shape and np.array_equal(a, b)
    elif is_dataclass(a):
        for field in fields(a):
            if field.name not in ("path", "text", "comments", "notes"):
                equal(getattr(a, field.name), getattr(b, field.name), f"{name}.{field.name}")
        return
    elif isinstance(a, Mapping):
        same = set(a) == set(b)
        for key in a if same else ():
            equal(a[key], b[key], f"{name}.{key}")
    elif isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)):
        same = len(a) == len(b)
        for number, pair in enumerate(zip(a, b, strict=False)):
            equal(*pair, f"{name}.{number}")
    else:
        same = a == b or (isinstance(a, float) and math.isnan(a))
    if not same:
        raise Fault(f"{name}: {a!r} was written and {b!r} read back"[:500])
