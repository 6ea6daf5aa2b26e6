"""One function over rows: its C source, the C compiler of this computer, and the machine code, found on disk or made, called."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import shutil
import subprocess
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.compiled._cache import cache_folder, discard, find, keep, remember, remembered, workplace
from symfive.compiled.graph import exact_graph
from symfive.compiled.scalar import CALLS
from symfive.compiled.vector import HELPERS, LANES, Rows, indented, plain_lines

SWITCH = "SYMFIVE_COMPILER"
"""The environment variable that names the compiler; `none` switches compiling off."""
PROGRAMS = ("cc", "gcc", "clang")
EXACT = ("sqrt", "fabs", "floor", "ceil")
"""Library functions whose result is defined to the last bit: the compiler's own will do."""
FLAGS = (
    "-std=gnu99", "-w", "-O1", "-march=native", "-fPIC", "-fno-math-errno", "-fno-fast-math", "-ffp-contract=off",
    # the same library functions as CasADi's, none of the compiler's own
    *(f"-fno-builtin-{name}" for name in CALLS if name not in EXACT),
)  # fmt: skip
ASK_S, COMPILE_S = 20.0, 120.0
ALIGNMENT = 64


@dataclass(frozen=True)
class Compiler:
    """A compiler that answers: `program` its path, `identity` a digest of version, processor and options."""

    program: str
    identity: str

    def compile(self, text: str, folder: Path) -> Path:
        """The shared library of a C text, made in a folder of its own. Raises `OSError` where that fails."""
        (folder / "rows.c").write_text(text, encoding="ascii")
        command = [self.program, *FLAGS, "-shared", "rows.c", "-o", "rows.so", "-lm"]
        _run(command, COMPILE_S, cwd=folder, env={**os.environ, "LC_ALL": "C", "TMPDIR": str(folder)})
        return folder / "rows.so"


def find_compiler() -> Compiler | None:
    """The compiler that `SYMFIVE_COMPILER` names, by default the first of cc, gcc and clang that answers; None without."""
    if os.name != "posix":
        return None
    wanted = os.environ.get(SWITCH, "")
    if wanted.lower() == "none":
        return None
    for name in (wanted,) if wanted else PROGRAMS:
        program = shutil.which(name)
        if program is not None and (identity := _identity(program)):
            return Compiler(program, identity)
    return None


@functools.lru_cache(maxsize=8)
def _identity(program: str) -> str:
    """All macros that the compiler defines: its version, the processor's instructions, how it counts."""
    try:
        macros = _run([program, *FLAGS, "-dM", "-E", "-x", "c", "-"], ASK_S)
    except OSError:
        return ""
    return hashlib.sha256(macros + " ".join(FLAGS).encode()).hexdigest()


def _run(command: list[str], seconds: float, **options: object) -> bytes:
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=seconds, **options)  # type: ignore[call-overload]
    except subprocess.TimeoutExpired:
        raise OSError(f"{command[0]} takes more than {seconds:.0f} s") from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise OSError(f"{command[0]} fails: {said[0] if said else done.returncode}")
    return bytes(done.stdout)


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


@dataclass(frozen=True)
class Source:
    """A C text that holds numbers and names of its own only, and the operations a row."""

    text: str
    operations: int


def source_of(function: Any, held: Collection[int]) -> Source:
    """The source of a function of scalars (SX) with dense results; inputs of the indices `held` are the same for all rows.

    Raises `NotImplementedError` for an operation that is not written in C here.
    """
    inputs = [f"x{i}_" for i in range(function.n_in())]
    outputs = [f"y{i}_" for i in range(function.n_out())]
    graph = exact_graph(function, inputs, outputs)
    moving = tuple(name for i, name in enumerate(inputs) if i not in held)
    nodes = [node for name in outputs for node in graph.outputs[name]]
    rows = Rows(graph, moving, [(f"y[{place}] = %s;", node) for place, node in enumerate(nodes)])
    fixed = [target for target in rows.targets if not rows.moves[target[1]]]
    prepare = rows.prepare()
    load, gather, first = [], [], 0
    for i, name in enumerate(inputs):
        load.append(f"const double *const {name} = given[{i}];")
        if i not in held:
            gather.append(f"gather({name}, {function.nnz_in(i)}U, row, used, x + {first}U);")
            first += function.nnz_in(i)
    scatter, place = [], 0
    for i, name in enumerate(outputs):
        size = len(graph.outputs[name])
        scatter.append(f"scatter(y + {place}U, {size}U, results[{i}] + (row * {size}U), used);")
        place += size
    offsets, first = [], 0
    for i, name in enumerate(inputs):
        if i not in held:
            offsets.append(f"const v *const {name} = x + {first}U;")
            first += function.nnz_in(i)
    text = (files("symfive.compiled") / "templates" / "rows.c").read_text(encoding="utf-8")
    filled = Template(text).substitute(
        helpers=HELPERS, lanes=LANES, constants=max(1, len(rows.constants)), inputs=max(1, first), outputs=max(1, place),
        load=indented([line for line in load if any(line.split()[3] in other for other in (*prepare.lines, *gather))]),
        prepare=indented(plain_lines(prepare)), fixed=indented(rows.statements(fixed, own_sine=False)),
        offsets=indented(offsets), body=indented(rows.statements(
            [target for target in rows.targets if rows.moves[target[1]]], own_sine=False)),
        gather=indented(gather, 8), scatter=indented(scatter, 8),
    )  # fmt: skip
    return Source(filled, rows.operations)
