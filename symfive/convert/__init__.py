"""Converters of public recordings to campaigns: one small module per kind of recording, one line of the
table.

The recordings are never part of symfive. They are looked for in the folder that the environment variable
`SYMFIVE_DATA` names, by default `../shared/data` beside the repository; their sources and licences stand in
its README.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from symfive.campaign import Campaign
from symfive.convert.ecmc_iso230 import ecmc_iso230
from symfive.convert.emps import emps
from symfive.convert.ess_radial_load import ess_radial_load
from symfive.convert.ess_wobbling import ess_wobbling
from symfive.convert.ess_xyz import ess_xyz
from symfive.convert.hilti_column import hilti_column
from symfive.convert.irb120_tracker import irb120_tracker
from symfive.convert.jjxray_slit import jjxray_slit
from symfive.convert.mukca import mukca
from symfive.convert.tx40 import tx40
from symfive.errors import InputError, among
from symfive.separated import LARGEST

__all__ = ["CONVERTERS", "VARIABLE", "convert", "data_folder"]

VARIABLE = "SYMFIVE_DATA"

CONVERTERS: dict[str, Callable[[Path], Campaign]] = {
    "ecmc-iso230": ecmc_iso230,
    "emps": emps,
    "ess-rotary/radial-load": ess_radial_load,
    "ess-rotary/wobbling": ess_wobbling,
    "ess-xyz": ess_xyz,
    "ess-xyz/week42": ess_xyz,
    "hilti-column": hilti_column,
    "irb120-tracker": irb120_tracker,
    "jjxray-slit": jjxray_slit,
    "mukca/dinova_2": mukca,
    "mukca/panda_1": mukca,
    "mukca/panda_3": mukca,
    "tx40": tx40,
}
"""Name (the recording's folder below the data folder) → function of that folder."""


def data_folder() -> Path:
    """The folder of the recordings. Raises `InputError` where there is none."""
    named = os.environ.get(VARIABLE)
    folder = Path(named) if named else Path(__file__).resolve().parents[3] / "shared" / "data"
    if not folder.is_dir():
        raise InputError(
            f"the folder of the recordings, {folder}, is not there",
            remedy=f"set {VARIABLE} to the folder that holds them; they are not part of symfive",
        )
    return folder


def convert(name: str, data: Path | str | None = None) -> Campaign:
    """The recording `name` as a campaign, read from the folder `data/name` (default: below `data_folder()`).

    Raises `InputError` for a name that is not in `CONVERTERS` and for files that are missing, of another layout or
    cut short.
    """
    among(name, CONVERTERS, f'there is no converter for "{name}"')
    folder = (data_folder() if data is None else Path(data)) / name
    if not folder.is_dir():
        raise InputError(
            f'the folder of the recording "{name}" is not there',
            path=folder,
            remedy=f"set {VARIABLE} or pass its parent folder",
        )
    remedy = "it must have the layout of the public recording"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # numpy's for means of nothing and overflows
            campaign = CONVERTERS[name](folder)
    except InputError as error:
        raise InputError(
            error.problem, path=error.path or folder, line=error.line, column=error.column, remedy=error.remedy or remedy,
            keys=error.keys,
        ) from None  # fmt: skip
    except (ArithmeticError, LookupError, RuntimeWarning, TypeError, ValueError) as error:
        raise InputError(f"the recording cannot be converted ({error})", path=folder, remedy=remedy) from None
    for run in campaign.runs:
        columns = (run.time, *run.commands.values(), *run.readings.values())
        if not all((np.abs(column) <= LARGEST).all() for column in columns) or np.any(np.diff(run.time) <= 0.0):
            problem = f"run {run.id}: a value is not finite, beyond {LARGEST:g}, or time does not increase"
            raise InputError(problem, path=folder, remedy=remedy)
    return _within_travel(campaign)


def _within_travel(campaign: Campaign) -> Campaign:
    """The campaign with as much travel as was recorded: a converter only assumes it."""
    axes = dict(campaign.machine.axes)
    for name, axis in axes.items():
        low = min([axis.travel[0], *(float(run.commands[name].min()) for run in campaign.runs)])
        high = max([axis.travel[1], *(float(run.commands[name].max()) for run in campaign.runs)])
        axes[name] = replace(axis, travel=(low, high))
    return campaign if axes == campaign.machine.axes else campaign.with_machine(replace(campaign.machine, axes=axes))
