"""What a verb is given: the thing itself, or the path or the name of what it is read from."""

from __future__ import annotations

import os
from pathlib import Path

from symfive.campaign import Campaign, read_campaign
from symfive.errors import InputError
from symfive.files import shown
from symfive.machine import Machine, preset, presets, read_machine
from symfive.model import FittedModel, read_model

TABLES = (".csv", ".tsv", ".txt")


def campaign_given(given: object) -> Campaign:
    """A campaign as it is, that of a plan or a simulation, or the one in a folder. Raises `InputError` for all else."""
    if isinstance(given, Campaign):
        return given
    if isinstance(given, (str, Path)):
        return _campaign_at(Path(given))
    inner = getattr(given, "campaign", None)
    if isinstance(inner, Campaign):
        return inner
    raise _other(given, "a campaign or the path of its folder", 'read_campaign("measured/")')


def _campaign_at(path: Path) -> Campaign:
    if not path.suffix and not path.exists():
        raise InputError("there is no such folder", path=path, remedy="check the name; a campaign is a folder")
    if path.suffix.lower() in TABLES and path.is_file():
        remedy = "give the campaign's folder or its campaign.toml"
        raise InputError("this is a table of readings, not a campaign", path=path, remedy=remedy)
    return read_campaign(path)


def machine_given(given: object) -> Machine:
    """A machine as it is, the one in a file, or a preset by its name. Raises `InputError` for all else."""
    if isinstance(given, Machine):
        return given
    if isinstance(given, (str, Path)):
        if not _is_preset(given):
            return read_machine(given)
        if str(given) not in presets():
            remedy = f"name a machine file, or use one of {', '.join(presets())}"
            raise InputError(f"{shown(str(given))} is neither a file nor a ready-made machine", remedy=remedy)
        return preset(str(given))
    raise _other(given, "a machine, the path of its file or the name of a preset", 'read_machine("machine.toml")')


def _is_preset(given: str | Path) -> bool:
    """Whether it names a ready-made machine. Raises `InputError` where a file or folder of its name would be as good."""
    path = Path(given)
    if str(given) in presets() and os.path.lexists(path):
        problem = f'"{given}" is a ready-made machine and a {"folder" if path.is_dir() else "file"} here'
        raise InputError(problem, remedy=f"write ./{given} for the one here, or rename it")
    return path.suffix != ".toml" and not os.path.lexists(path) and os.sep not in str(given)


def model_given(given: object) -> FittedModel:
    """A fitted model as it is, or the one in a `model.json` or its folder. Raises `InputError` for all else."""
    if isinstance(given, FittedModel):
        return given
    if isinstance(given, (str, Path)):
        return read_model(given)
    raise _other(given, "a fitted model or the path of its model.json", "fitted_model(identification)")


def machine_or_model_given(given: object) -> Machine | FittedModel:
    """Either, as it is or read: a `model.json` or its folder is a fitted model. Raises `InputError` for all else."""
    if isinstance(given, (Machine, FittedModel)):
        return given
    if not isinstance(given, (str, Path)):
        raise _other(given, "a machine, a fitted model or the path of either", 'read_model("results/model.json")')
    path = Path(given)
    if path.suffix == ".toml" or str(given) in presets():
        return machine_given(given)
    if path.suffix == ".json" or path.is_dir():
        return read_model(path)
    remedy = f"name a machine.toml, a model.json, or one of {', '.join(presets())}"
    raise InputError("this is neither a machine nor a model", path=path, remedy=remedy)


def _other(given: object, wanted: str, example: str) -> InputError:
    return InputError(f"{shown(given)} ({type(given).__name__}) is not {wanted}", remedy=f"give it as {example}")
