"""Ready-made machines: the files of `designs/machines`, in the source tree or inside the installed package."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from symfive.errors import InputError
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
    if name not in presets():
        raise InputError(f'there is no ready-made machine "{name}"', remedy=f"use one of {', '.join(presets())}")
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
