"""What must hold of what the readers accept. Each check has a folder to write to."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from symfive.campaign import Campaign, Run, read_campaign, write_campaign
from symfive.campaign._csv import read_columns, write_columns  # one file without its folder
from symfive.errors import InputError
from symfive.fleet import Fleet, Row
from symfive.instruments import instruments_of
from symfive.machine import Machine, machine_from_data, machine_to_data, preset, read_machine, write_machine
from symfive.model import FittedModel, read_model, write_model
from symfive.parameters import UNIT_SCALE

from .checks import LONGEST_SENTENCE, Fault, equal, finite
from .seeds import DATA

UNITS = set(UNIT_SCALE)


@cache
def made(name: str) -> Machine:
    """A ready-made machine."""
    return preset(name)


def machine_is_right(machine: Machine, target: Path) -> None:
    """It is finite, and is the same after writing: over its own text, anew, and as plain data."""
    finite(machine, "machine")
    for axis in machine.axes.values():
        if axis.unit not in ("mm", "deg") or not axis.travel[0] < axis.travel[1]:
            raise Fault(f"axis {axis.name} has the unit {axis.unit}, travel {axis.travel}")
    for number, one in enumerate((machine, replace(machine, text=""))):
        write_machine(one, target / f"{number}.toml")
        equal(machine, read_machine(target / f"{number}.toml"), "machine")
    equal(machine, machine_from_data(machine_to_data(machine)), "machine")


def campaign_is_right(campaign: Campaign, target: Path) -> None:
    """All numbers are finite, units known, and it is the same after writing: over its own text and anew."""
    machine = campaign.machine
    finite(campaign.runs, "runs")
    for run in campaign.runs:
        run_is_right(run, machine)
        for instrument in instruments_of(run):
            finite(dict(instrument.constants(run, machine)), run.id)
            for parameter in instrument.parameters(run, machine):
                finite(parameter.sigma, parameter.name)
                if parameter.unit not in UNITS:
                    raise Fault(f"{parameter.name} has the unit {parameter.unit}")
    _ = campaign.repeats, campaign.measured, [run.interval for run in campaign.runs]
    for number, one in enumerate((campaign, replace(campaign, text=""))):
        folder = target / str(number)
        write_campaign(one, folder)
        back = read_campaign(folder)
        for name in ("machine", "runs", "extra"):
            equal(getattr(campaign, name), getattr(back, name), name)
        if campaign.path is None or campaign.name != campaign.path.name:
            equal(campaign.name, back.name, "name")
        written = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
        expected = {
            "campaign.toml",
            "machine.toml",
            "manifest.json",
            *(Path(run.file).as_posix() for run in campaign.runs),
        }
        if written != expected:
            raise Fault(f"written were {sorted(written)}")


def run_is_right(run: Run, machine: Machine) -> None:
    """The time increases and commands stay within travel."""
    if np.any(np.diff(run.time) <= 0.0):
        raise Fault(f"run {run.id}: time does not increase")
    for name, values in run.commands.items():
        low, high = machine.axes[name].travel
        if values.min() < low - 1e-6 * max(1.0, -low) or values.max() > high + 1e-6 * max(1.0, high):
            raise Fault(f"run {run.id}: {name} leaves its travel")


def recording_is_right(run: Run, target: Path) -> None:
    """It is finite and in order, and the same after writing."""
    machine = made("three-axis")
    finite(run, "run")
    run_is_right(run, machine)
    finite(run.interval, "interval")
    if len(run.steps) != run.rows or np.any(np.diff(run.steps) < 1):
        raise Fault("the steps do not increase")
    target.mkdir()
    write_columns(target / "run.csv", run, machine)
    time, commands, readings, _ = read_columns(target / "run.csv", machine, ("dL_um",), dynamic=True)
    equal((run.time, run.commands, run.readings), (time, commands, readings), "run")


def model_is_right(model: FittedModel, target: Path) -> None:
    """It is finite, its units are known, and it is the same after writing."""
    machine_is_right(model.machine, target)
    finite({"values": model.values, "std": model.std, "covariance": model.covariance}, "model")
    for name, unit in model.units.items():
        if unit not in UNITS:
            raise Fault(f"{name} has the unit {unit!r}")
    if any(std < 0.0 for std in model.std.values()):
        raise Fault("a 1σ is negative")
    if len(set(model.names)) != len(model.names) or not set(model.names) <= set(model.values):
        raise Fault("the covariance has other names than the parameters")
    write_model(model, target / "model.json")
    back = read_model(target / "model.json")
    for name in ("machine", "effects", "names", "covariance"):
        equal(getattr(model, name), getattr(back, name), name)
    for name in model.names:
        equal((model.values[name], model.std[name]), (back.values[name], back.std[name]), name)


def truth_is_right(found: Any, target: Path) -> None:
    """Values are finite; the effects join a campaign or say in a sentence why they cannot."""
    values, effects = found
    finite(values, "truth")
    campaign = _static()
    for effect in effects:
        try:
            joined = effect.prepare(campaign)
        except InputError as error:
            if not error.remedy or len(str(error)) > LONGEST_SENTENCE:
                raise Fault(f"that is no sentence: {error}") from None
            continue
        for parameter in joined.parameters(campaign):
            finite((parameter.mean, parameter.sigma), parameter.name)


@cache
def _static() -> Campaign:
    return read_campaign(DATA / "campaigns" / "static-none" / "fit")


def row_is_right(row: Row, target: Path) -> None:
    """The table of it can be made."""
    table = Fleet("identify", (row,))
    finite([row.rms, row.chi2_dof, dict(row.errors)], "row")
    _ = str(table), table.csv(), table.to_data()


def circle_is_right(run: Run, target: Path) -> None:
    """The run is a campaign's like any other."""
    finite(run, "run")
    campaign_is_right(Campaign(machine=made("three-axis"), runs=(run,)), target)
