"""sf.py: the C functions of sf.c in Python, by ctypes and NumPy. Made by symfive 0.1.0.

    import sf
    machine = sf.Machine()                 # compiles sf.c beside this file where that was not done for this model
    position, direction = machine.forward(q, tool)

Compiled by hand: `cc -O2 -shared -fPIC sf.c -o libsf.so -lm`. A library is loaded only if it states the model of this file,
belongs to the user or to root, and nobody else can write to it.
"""

from __future__ import annotations

import ctypes
import os
import stat
import subprocess
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
MODEL = "74a1813ac4abe34ed5aac8b3a152445812b6762ed1acfd3276113623cfb8024c"
AXES = ("Y", "X", "B", "C", "Z",)
PARAMETERS = (
    "EC0X",
    "EX0B",
    "EA0B",
    "EX0C",
    "EA0C",
    "EXC.cos1",
    "EXC.sin1",
    "EXC.cos2",
    "EXC.sin2",
)
STATUS = ("done", "singular", "unreachable", "not converged", "an argument is not finite, too large or no unit vector")


def build(folder: Path = HERE, compiler: str = os.environ.get("CC", "cc"), flags: tuple[str, ...] = ("-O2",)) -> Path:
    """Compile the scalar functions into a shared library in `folder` and return its path."""
    return _compiled(Path(folder) / "libsf.so", [compiler, "-std=c99", *flags], HERE / "sf.c")


class WrongLibrary(OSError):
    """A library of another model, or one that somebody else may have written."""


class NotSolved(ArithmeticError):
    """The C function returned another status than 0: `status`; after 1 (singular) `q` holds what it found, else None."""

    def __init__(self, function: str, status: int, q=None) -> None:
        super().__init__(f"{function}: {STATUS[status]}")
        self.status = status
        self.q = q


class Machine:
    """The functions with arrays instead of pointers. q in mm and rad, tool in mm, p in the parameters' units."""

    def __init__(self, library: Path | str | None = None) -> None:
        self._c = _loaded(library, HERE / "libsf.so", build, "sf_model")
        self._c.sf_parameter_name.restype = ctypes.c_char_p
        self.p = np.zeros(max(1, len(PARAMETERS)))
        self._c.sf_parameters(_pointer(self.p))

    def parameter_name(self, index: int) -> str:
        """Name of a parameter as the library knows it."""
        return self._c.sf_parameter_name(ctypes.c_int(index)).decode()

    def forward(self, q, tool, p=None):
        """Point (3, mm) and direction (3) of the real tool in the workpiece frame."""
        return self._call("forward", (q, tool, self._p(p)), (3, 3))

    def nominal(self, q, tool):
        """The same of the machine without errors."""
        return self._call("nominal", (q, tool), (3, 3))

    def error(self, q, tool, p=None):
        """Volumetric error: real minus nominal point (3, mm) and direction (3, rad)."""
        return self._call("error", (q, tool, self._p(p)), (3, 3))

    def axis_jacobian(self, q, tool, p=None):
        """Derivatives (3, axes) of point and direction by q."""
        parts = self._call("axis_jacobian", (q, tool, self._p(p)), (3 * len(AXES),) * 2)
        return tuple(part.reshape(-1, 3).T for part in parts)

    def parameter_jacobian(self, q, tool, p=None):
        """Derivatives (3, parameters) of the point by p, mm per unit."""
        (part,) = self._call("parameter_jacobian", (q, tool, self._p(p)), (3 * len(PARAMETERS),))
        return part.reshape(-1, 3).T

    def direction_jacobian(self, q, tool, p=None):
        """Derivatives (3, parameters) of the direction by p, rad per unit."""
        (part,) = self._call("direction_jacobian", (q, tool, self._p(p)), (3 * len(PARAMETERS),))
        return part.reshape(-1, 3).T

    def inverse_nominal(self, target, tool, q):
        """q with the linear axes so that the nominal point is at `target`."""
        return self._solve("inverse_nominal", (target, tool), q)

    def inverse(self, target, tool, q, p=None):
        """q with the linear axes so that the real point is at `target`."""
        return self._solve("inverse", (target, tool, self._p(p)), q)

    def compensate(self, wanted, tool, p=None):
        """Commands that bring the real point to where the nominal one would be."""
        return self._solve("compensate", (wanted, tool, self._p(p)), wanted)

    def compensate_direction(self, wanted, tool, p=None):
        """The same for point and direction."""
        return self._solve("compensate_direction", (wanted, tool, self._p(p)), wanted)

    def orient(self, direction, q):
        """q with the rotary axes so that the nominal tool has the direction."""
        return self._solve("orient", (direction,), q)

    def _p(self, p):
        return self.p if p is None else p

    def _call(self, name, inputs, sizes):
        arrays = [np.ascontiguousarray(value, dtype=float) for value in inputs]
        results = [np.empty(size) for size in sizes]
        status = getattr(self._c, f"sf_{name}")(*map(_pointer, (*arrays, *results)))
        if status:
            raise NotSolved(name, status)
        return tuple(results)

    def _solve(self, name, inputs, q):
        arrays = [np.ascontiguousarray(value, dtype=float) for value in inputs]
        result = np.array(q, dtype=float)
        status = getattr(self._c, f"sf_{name}")(*map(_pointer, (*arrays, result)))
        if status:
            raise NotSolved(name, status, result if status == 1 else None)
        return result


class Batch:
    """Many poses at once by the vector kernel: point, Jacobian, information matrix."""

    def __init__(self, library: Path | str | None = None) -> None:
        self._c = _loaded(library, HERE / "libsf_batch.so", build_batch, "sf_batch_model")
        self._c.sf_batch_lanes.restype = ctypes.c_size_t
        self.lanes = int(self._c.sf_batch_lanes())

    def forward(self, q, tool, p):
        """Points (N, 3) of the real tool at q (N, axes)."""
        tiles, poses, c = self._tiles(q), len(q), self._prepared(tool, p)
        position = _aligned((len(tiles), 3, self.lanes))
        self._function("forward")(ctypes.c_size_t(len(tiles)), *map(_pointer, (tiles, c, position)))
        return _rows(position, poses)

    def jacobian(self, q, tool, p, stream=False):
        """Points (N, 3) and their derivatives (N, 3, parameters)."""
        tiles, poses, c = self._tiles(q), len(q), self._prepared(tool, p)
        position = _aligned((len(tiles), 3, self.lanes))
        by_p = _aligned((len(tiles), 3 * len(PARAMETERS), self.lanes))
        arrays = map(_pointer, (tiles, c, position, by_p))
        self._function("jacobian")(ctypes.c_size_t(len(tiles)), *arrays, ctypes.c_int(stream))
        return _rows(position, poses), _rows(by_p, poses).reshape(poses, -1, 3).transpose(0, 2, 1)

    def predict(self, q, tool, p, step):
        """Points (N, 3) to first order after a step of the parameters."""
        tiles, poses, c = self._tiles(q), len(q), self._prepared(tool, p)
        d = np.ascontiguousarray(step, dtype=float)
        position = _aligned((len(tiles), 3, self.lanes))
        self._function("predict")(ctypes.c_size_t(len(tiles)), *map(_pointer, (tiles, c, d, position)))
        return _rows(position, poses)

    def information(self, q, tool, p, target):
        """J'J (parameters, parameters), J'r and r'r with r = target - point; target (N, 3)."""
        tiles, poses, c = self._tiles(q), len(q), self._prepared(tool, p)
        wanted, size = self._tiles(target), len(PARAMETERS) + 1
        normal, work = _aligned((size, size)), _aligned((672, self.lanes))
        normal[:] = 0.0
        arrays = map(_pointer, (tiles, c, wanted, normal, work))
        self._function("information")(ctypes.c_size_t(poses), *arrays)
        return normal[:-1, :-1], normal[:-1, -1], normal[-1, -1]

    def leverage(self, q, tool, p, factor):
        """J M J' (N, 3, 3) for a covariance M = F F' of the parameters; `factor` F (parameters, rank)."""
        tiles, c, f = self._tiles(q), self._prepared(tool, p), np.ascontiguousarray(factor, dtype=float)
        if f.ndim != 2 or len(f) != len(PARAMETERS):
            raise ValueError(f"the factor has the shape {f.shape}, not ({len(PARAMETERS)}, rank)")
        found, work = _aligned((len(tiles), 6, self.lanes)), _aligned((672, self.lanes))
        rank, count = ctypes.c_size_t(f.shape[1]), ctypes.c_size_t(len(tiles))
        self._function("leverage")(count, _pointer(tiles), _pointer(c), _pointer(f), rank, *map(_pointer, (found, work)))
        return _rows(found, len(q))[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]

    def _function(self, name):
        return getattr(self._c, f"sf_batch_{name}_{self.lanes}")

    def _prepared(self, tool, p):
        arrays = [np.ascontiguousarray(value, dtype=float) for value in (tool, p)]
        c = _aligned((17,))
        self._function("prepare")(*map(_pointer, (*arrays, c)))
        return c

    def _tiles(self, rows):
        rows = np.asarray(rows, dtype=float)
        tiles = _aligned((-(-len(rows) // self.lanes), rows.shape[1], self.lanes))
        padded = np.resize(rows, (len(tiles) * self.lanes, rows.shape[1]))
        tiles[:] = padded.reshape(len(tiles), self.lanes, -1).transpose(0, 2, 1)
        return tiles


def build_batch(folder: Path = HERE, compiler: str = os.environ.get("CC", "cc"), flags: tuple[str, ...] = ()) -> Path:
    """Compile the vector kernel for this processor and return the library's path."""
    options = [compiler, "-std=gnu99", "-O2", "-march=native", *flags]
    return _compiled(Path(folder) / "libsf_batch.so", options, HERE / "sf_batch.c")


def _compiled(library, options, source):
    """Compile beside the place and move there, so that nobody loads half a library or changes one that is in use."""
    part = library.with_name(f".{library.name}.{os.getpid()}")
    try:
        subprocess.run([*options, "-shared", "-fPIC", str(source), "-o", str(part), "-lm"], check=True)
        part.chmod(0o755)
        os.replace(part, library)
    finally:
        part.unlink(missing_ok=True)
    return library


def _loaded(given, place, build, stated):
    """The library at `given`, or the one at `place`, which is compiled where it is missing or of another model."""
    path = Path(given) if given is not None else place
    if given is None and not (path.exists() and MODEL.encode() in path.read_bytes()):
        build()
    _check_owner(path)
    if MODEL.encode() not in path.read_bytes():
        raise WrongLibrary(f"{path} was compiled from another model than {MODEL[:12]}...; compile it anew")
    library = ctypes.CDLL(str(path))
    getattr(library, stated).restype = ctypes.c_char_p
    if getattr(library, stated)() != MODEL.encode():
        raise WrongLibrary(f"this process has an older {path} loaded; start it anew")
    return library


def _check_owner(path):
    if os.name == "posix":
        status = path.stat()
        if status.st_uid not in (0, os.getuid()):
            raise WrongLibrary(f"{path} belongs to another user; compile your own")
        if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise WrongLibrary(f"others can write to {path}; say chmod go-w or compile your own")


def _aligned(shape):
    """An uninitialised array that begins at a multiple of 64 bytes."""
    count = int(np.prod(shape))
    buffer = np.empty(8 * count + 64, dtype=np.uint8)
    offset = -buffer.ctypes.data % 64
    return buffer[offset : offset + 8 * count].view(float).reshape(shape)


def _rows(tiles, poses):
    return tiles.transpose(0, 2, 1).reshape(-1, tiles.shape[1])[:poses]


def _pointer(array):
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
