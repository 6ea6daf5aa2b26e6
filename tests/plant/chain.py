"""Exact homogeneous-transformation chain of FORMATS.md section 1, vectorised over poses.

    linear axis:  A(q) = Trans(R0.e.s + E(q)) . R(q)
    rotary axis:  A(q) = Trans(o + P0 + E(q)) . R0 . R(q) . Rot(e, s) . Trans(-o)

with s = -q on the workpiece side and s = +q on the tool side; the ball in the workpiece frame is
``d = inv(W) . T . tool_ball``.  Inside the plant: mm and rad.  Names of errors: ISO 230-1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

LETTERS: dict[str, tuple[str, tuple[float, float, float]]] = {
    "X": ("linear", (1.0, 0.0, 0.0)),
    "Y": ("linear", (0.0, 1.0, 0.0)),
    "Z": ("linear", (0.0, 0.0, 1.0)),
    "U": ("linear", (1.0, 0.0, 0.0)),
    "V": ("linear", (0.0, 1.0, 0.0)),
    "W": ("linear", (0.0, 0.0, 1.0)),
    "A": ("rotary", (1.0, 0.0, 0.0)),
    "B": ("rotary", (0.0, 1.0, 0.0)),
    "C": ("rotary", (0.0, 0.0, 1.0)),
}
"""Kind and default direction of the ISO 841 letters."""

COMPONENTS = ("EX", "EY", "EZ", "EA", "EB", "EC")
"""Order of the six error components: three translations, three rotations."""


@dataclass(frozen=True)
class Axis:
    """One axis of the chain: ``side`` is -1 on the workpiece side and +1 on the tool side."""

    name: str
    kind: str
    side: int
    direction: tuple[float, float, float]
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def rotary(self) -> bool:
        """True for a rotary axis (command in degree in files, rad inside)."""
        return self.kind == "rotary"

    @property
    def column(self) -> str:
        """Name of the command column in a CSV, e.g. ``X_mm`` or ``C_deg``."""
        return f"{self.name}_{'deg' if self.rotary else 'mm'}"


@dataclass(frozen=True)
class Chain:
    """Axes from the bed outward on both sides; ``axes`` holds them in the structural code's order."""

    structure: str
    workpiece: tuple[Axis, ...]
    tool: tuple[Axis, ...]
    axes: tuple[Axis, ...] = field(default=())

    def axis(self, name: str) -> Axis:
        """The axis of that name; KeyError if the machine lacks it."""
        for axis in self.workpiece + self.tool:
            if axis.name == name:
                return axis
        raise KeyError(f"no axis {name!r} in {self.structure!r}")


def parse_structure(structure: str, tables: Mapping[str, Mapping] | None = None) -> Chain:
    """Chain of the structural code, e.g. ``"w C' B' X' Y' b Z t"``; `tables` are the ``[axes.NAME]`` of
    machine.toml.
    """
    tables = tables or {}
    words = structure.split()
    if words[0] != "w" or words[-1] != "t" or words.count("b") != 1:
        raise ValueError(f"structural code {structure!r} must read 'w ... b ... t'")
    bed = words.index("b")
    inner = [_axis(w, -1, tables) for w in words[1:bed]]
    outer = [_axis(w, +1, tables) for w in words[bed + 1 : -1]]
    # The shared campaigns list the columns from the bed outward: workpiece side first, then tool side.
    return Chain(structure, tuple(inner[::-1]), tuple(outer), tuple(inner[::-1]) + tuple(outer))


def _axis(word: str, side: int, tables: Mapping[str, Mapping]) -> Axis:
    name = word.rstrip("'")
    if word.endswith("'") != (side < 0):
        raise ValueError(f"axis {word!r} stands on the wrong side of the bed for its prime")
    table = tables.get(name, {})
    kind, direction = LETTERS.get(name, (table.get("kind"), table.get("direction")))
    kind = table.get("kind", kind)
    direction = np.asarray(table.get("direction", direction), float)
    if kind not in ("linear", "rotary") or direction.shape != (3,):
        raise ValueError(f"axis {name!r} needs kind and direction")
    unit = direction / np.linalg.norm(direction)
    return Axis(name, kind, side, tuple(unit.tolist()), tuple(float(v) for v in table.get("origin", (0.0, 0.0, 0.0))))


UNTURNED = np.eye(3)
"""The rotation of a linear axis without error motions; no product is made with it."""


def rot(direction: Sequence[float], angle: ArrayLike) -> Array:
    """Rodrigues rotation matrices about a unit `direction`, (..., 3, 3) for `angle` (...) in rad."""
    a = np.asarray(angle, float)[..., None, None]
    x, y, z = direction
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(a) * k + (1.0 - np.cos(a)) * (k @ k)


def rot_xyz(abc: Array) -> Array:
    """Rx(a).Ry(b).Rz(c), exact, for `abc` (..., 3) in rad; written out for speed."""
    (sa, sb, sc), (ca, cb, cc) = np.moveaxis(np.sin(abc), -1, 0), np.moveaxis(np.cos(abc), -1, 0)
    out = np.empty((*abc.shape[:-1], 3, 3))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = cb * cc, -cb * sc, sb
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = sa * sb * cc + ca * sc, ca * cc - sa * sb * sc, -sa * cb
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb
    return out


def location(axis: Axis, location_errors: Mapping[str, ArrayLike]) -> Array:
    """Location errors (EX0j … EC0j) of `axis` in mm and rad, shape (6,) or (N, 6) when one of them varies."""
    if not location_errors:
        return np.zeros(6)
    values = [np.asarray(location_errors.get(f"{c}0{axis.name}", 0.0), float) for c in COMPONENTS]
    return np.stack(np.broadcast_arrays(*values), axis=-1)


def axis_transform(axis: Axis, q: Array, place: Array, motion: Array | None) -> tuple[Array, Array]:
    """Rotation (…,3,3) and translation (…,3) of A(q); `q` (N,) mm or rad, `place` (…,6), `motion` (N,6) or
    None.
    """
    s = axis.side * q
    e, o = np.asarray(axis.direction), np.asarray(axis.origin)
    if motion is None and not place.any():  # exact, and several times as quick
        if not axis.rotary:
            return UNTURNED, s[:, None] * e
        r = rot(axis.direction, s)
        return r, o - r @ o
    r0 = rot_xyz(place[..., 3:])
    shift = np.zeros(3) if motion is None else motion[:, :3]
    turn = UNTURNED if motion is None else rot_xyz(motion[:, 3:])
    if not axis.rotary:
        return turn, s[:, None] * (r0 @ e) + shift
    r = r0 @ turn @ rot(axis.direction, s)
    return r, o + place[..., :3] + shift - r @ o


def ball_in_workpiece(
    chain: Chain,
    command: Mapping[str, Array],
    tool_ball: ArrayLike,
    location_errors: Mapping[str, ArrayLike] | None = None,
    error_motions: Mapping[str, Array] | None = None,
    tool_shift: ArrayLike = 0.0,
) -> Array:
    """Ball centre d = inv(W).(T.tool_ball + tool_shift) in the workpiece frame, (N, 3) mm.

    `command`: axis -> (N,) in mm or rad; `location_errors`: "EA0C" -> scalar or (N,) in mm or rad;
    `error_motions`: axis -> (N, 6) in mm and rad, the order EX EY EZ EA EB EC; `tool_shift`: displacement of
    the
    tool relative to the table in the machine frame, (3,) or (N, 3) mm.
    """
    place, motion = location_errors or {}, error_motions or {}
    n = max(np.size(v) for v in command.values())
    point = np.broadcast_to(np.asarray(tool_ball, float), (n, 3))
    for axis in reversed(chain.tool):
        r, p = axis_transform(axis, np.asarray(command[axis.name], float), location(axis, place), motion.get(axis.name))
        point = (point if r is UNTURNED else np.einsum("...ij,...j->...i", r, point)) + p
    point = point + np.asarray(tool_shift, float)
    for axis in chain.workpiece:
        r, p = axis_transform(axis, np.asarray(command[axis.name], float), location(axis, place), motion.get(axis.name))
        point = point - p if r is UNTURNED else np.einsum("...ji,...j->...i", r, point - p)
    return point


def nominal_linear(
    chain: Chain, rotary: Mapping[str, Array], target: ArrayLike, tool_ball: ArrayLike
) -> dict[str, Array]:
    """Commands of the linear axes that keep the nominal tool ball on `target` (workpiece frame, mm) at given
    `rotary` (rad).

    The nominal chain is affine in the linear axes at each pose: solved exactly for three of them.
    """
    n = max([np.size(v) for v in rotary.values()] + [np.atleast_2d(target).shape[0]])
    linear = [a.name for a in chain.workpiece + chain.tool if not a.rotary]
    if len(linear) != 3:
        raise ValueError(f"exactly three linear axes are needed, {chain.structure!r} has {len(linear)}")
    base = {
        a.name: np.broadcast_to(np.asarray(rotary.get(a.name, 0.0), float), (n,)) for a in chain.workpiece + chain.tool
    }
    d0 = ball_in_workpiece(chain, base, tool_ball)
    columns = [ball_in_workpiece(chain, {**base, name: np.ones(n)}, tool_ball) - d0 for name in linear]
    solution = np.linalg.solve(np.stack(columns, axis=-1), (np.asarray(target, float) - d0)[..., None])[..., 0]
    return {**base, **{name: solution[:, i] for i, name in enumerate(linear)}}
