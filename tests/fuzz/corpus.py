"""The kept corpus: few small inputs that together reach what all inputs found reach, and its replay."""

import hashlib
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

from .checks import Reader, run

KEPT = Path(__file__).parent / "corpus"
OPEN = Path(__file__).parent / "open"
"""Inputs that show faults which are not mended yet, each in a folder of its reader's name."""
MOST_BYTES = 45_000
"""Of one reader's corpus, without what is called `fault-…` or `seed-…`: these are always kept."""
Place = tuple[str, int, int]


def name_of(data: bytes) -> str:
    """The name of an input's file."""
    return hashlib.sha256(data).hexdigest()[:12] + ".txt"


def inputs(folder: Path) -> Iterator[Path]:
    """The inputs of one reader."""
    return (path for path in sorted(folder.glob("*")) if path.is_file())


def reached(reader: Reader, data: bytes, room: Path) -> set[Place]:
    """Pairs of lines of symfive that follow each other while it reads this. Raises what `run` raises."""
    places: set[Place] = set()

    def enter(frame: FrameType, event: str, argument: Any) -> Any:
        file = frame.f_code.co_filename
        if "/symfive/" not in file:
            return None
        before = 0

        def step(frame: FrameType, event: str, argument: Any) -> Any:
            nonlocal before
            if event == "line":
                places.add((file, before, frame.f_lineno))
                before = frame.f_lineno
            return step

        return step

    def read(folder: Path) -> Any:
        sys.settrace(enter)
        try:
            return reader.read(folder)
        finally:
            sys.settrace(None)

    run(replace(reader, read=read), data, room)
    return places


def keep(name: str, reader: Reader, found: Iterable[Path], room: Path) -> tuple[int, int]:
    """Rewrite the kept corpus of a reader from itself and what was found; (its inputs, lines of symfive they reach).

    Greedily the input that adds the most places for its size is next, until none adds any or the corpus is full. Only
    text is kept.
    """
    folder = KEPT / name
    folder.mkdir(parents=True, exist_ok=True)
    covered: set[Place] = set()
    waiting: dict[bytes, set[Place]] = {}
    for path in [*inputs(folder), *found]:
        data = path.read_bytes()
        if b"\0" in data or data in waiting or not _is_text(data):
            continue
        try:
            places = reached(reader, data, room)
        except Exception:
            continue  # an open fault: it lies beside the corpus
        if path.parent == folder and path.name.startswith(("fault-", "seed-")):
            covered |= places
        else:
            waiting[data] = places
    for seed in reader.seeds():
        covered |= reached(reader, seed, room)
    kept: list[bytes] = []
    while waiting:
        best = max(waiting, key=lambda data: len(waiting[data] - covered) / (100 + len(data)))
        if not waiting[best] - covered or sum(map(len, kept)) + len(best) > MOST_BYTES:
            break
        covered |= waiting.pop(best)
        kept.append(best)
    names = {name_of(data): data for data in kept}
    for path in list(inputs(folder)):
        if not path.name.startswith(("fault-", "seed-")) and path.name not in names:
            path.unlink()
    for file, data in names.items():
        (folder / file).write_bytes(data)
    return len(list(inputs(folder))), len({(file, line) for file, _, line in covered})


def _is_text(data: bytes) -> bool:
    try:
        data.decode()
    except UnicodeDecodeError:
        return False
    return True
