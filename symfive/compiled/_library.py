"""One function over rows as machine code: found on disk or compiled, loaded, called."""

from __future__ import annotations

import ctypes
import functools
import hashlib
from collections.abc import Sequence
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.compiled._cache import cache_folder, discard, find, keep, remember, remembered, workplace
from symfive.compiled._compiler import Compiler
from symfive.compiled._source import source_of

ALIGNMENT = 64


class Library:
    """A loaded library. It keeps no state: threads may call it at the same time."""

    def __init__(self, path: Path) -> None:
        library = ctypes.CDLL(str(path))
        self._call = library.symfive_rows
        self._call.restype = None
        library.symfive_work.restype = ctypes.c_size_t
        self._work = int(library.symfive_work())

    def __call__(self, rows: int, inputs: Sequence[Array], results: Sequence[Array]) -> None:
        """Fill the first rows of the results; all arrays are C-contiguous doubles of the sizes that the function has."""
        buffer = np.empty(self._work + ALIGNMENT, dtype=np.uint8)
        work = buffer.ctypes.data + -buffer.ctypes.data % ALIGNMENT
        given = (ctypes.c_void_p * len(inputs))(*(array.ctypes.data for array in inputs))
        wanted = (ctypes.c_void_p * len(results))(*(array.ctypes.data for array in results))
        self._call(ctypes.c_size_t(rows), given, wanted, ctypes.c_void_p(work))


def key_of(function: Any, held: Sequence[int], compiler: Compiler) -> str:
    """What the library of a function depends on: its operations, what is held, who compiles it and how."""
    parts = (function.serialize(), repr(sorted(held)), compiler.identity, _generator())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


@functools.cache
def _generator() -> str:
    """A digest of the code that writes the C."""
    room = files("symfive.compiled")
    names = (
        "graph.py",
        "scalar.py",
        "vector.py",
        "_source.py",
        "_library.py",
        "templates/rows.c",
        "templates/lanes.c",
        "templates/helpers.c",
    )
    text = "".join((room / name).read_text(encoding="utf-8") for name in names)
    return hashlib.sha256((ca.CasadiMeta.version() + text).encode()).hexdigest()


def found(key: str) -> Library | None:
    """The library of a key from the disk, if there is a whole one that loads."""
    path = find(cache_folder(), key)
    if path is None:
        return None
    try:
        return Library(path)
    except (OSError, AttributeError):
        discard(path)
        return None


def interpretation_s(key: str) -> float:
    """Seconds for which earlier runs have interpreted the function of a key."""
    return remembered(cache_folder(), key)


def note_interpretation(key: str, seconds: float) -> None:
    """Note for later runs for how long the function of a key has been interpreted."""
    with suppress(OSError):
        remember(cache_folder(), key, seconds)


def compiled(function: Any, held: Sequence[int], compiler: Compiler, key: str) -> Library:
    """The library of a function, compiled now and kept. Raises `OSError`, or `NotImplementedError` for an operation unknown."""
    source = source_of(function, held)
    folder = cache_folder()
    with workplace(folder) as place:
        path = keep(folder, key, compiler.compile(source.text, place))
    try:
        return Library(path)
    except (OSError, AttributeError) as error:
        discard(path)
        raise OSError(f"what {compiler.program} has made cannot be loaded: {error}") from None
