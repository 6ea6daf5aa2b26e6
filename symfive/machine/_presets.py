"""Ready-made machines: the files of `designs/machines`, in the source tree or the installed package; a machine as designed."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from symfive.arrays import Array
from symfive.errors import InputError, among
from symfive.machine._data import Machine
from symfive.machine._read import read_machine
from symfive.outputs import own_data

_PACKAGE = Path(__file__).resolve().parent.parent
_FOLDERS = (_PACKAGE / "_designs" / "machines", _PACKAGE.parent / "designs" / "machines")


def presets() -> tuple[str, ...]:
    """Names of the ready-made machines."""
    return tuple(sorted(path.stem for path in _folder().glob("*.toml")))


def preset(name: str) -> Machine:
    """The ready-made machine of that name. Raises `InputError` for a name that is not in `presets()`."""
    among(name, presets(), f'there is no ready-made machine "{name}"')
    return _read(_folder() / f"{name}.toml")


@cache
def _read(path: Path) -> Machine:
    """Nothing changes a machine, so one serves everybody."""
    with own_data():
        return read_machine(path)


def _folder() -> Path:
    for folder in _FOLDERS:
        if folder.is_dir():
            return folder
    raise InputError(
        "the ready-made machines are not installed", remedy="install symfive again, or name a machine file"
    )


def designed_ball(machine: Machine, commands: Mapping[str, Array], tool_ball: ArrayLike) -> Array:
    """The tool's ball in the workpiece frame (N, 3) mm without errors; `commands` axis → (N,) in mm or degree.

    From the tool to the bed and on to the workpiece every axis moves it along its direction by q, or turns it about its line by
    q (conventions, section 1, all errors zero: the workpiece side moves by -q and is inverted).
    """
    structure = machine.structure
    count = len(next(iter(commands.values())))
    point = np.broadcast_to(np.asarray(tool_ball, dtype=float), (count, 3))
    for name in (*reversed(structure.tool), *reversed(structure.workpiece)):
        axis = machine.axes[name]
        q, direction = commands[name][:, None] * axis.to_internal, np.array(axis.direction)
        if not axis.rotary:
            point = point + direction * q
            continue
        arm = point - np.array(axis.origin)
        along = (arm @ direction)[:, None] * direction
        point = np.array(axis.origin) + along + (arm - along) * np.cos(q) + np.cross(direction, arm) * np.sin(q)
    return np.asarray(point)
