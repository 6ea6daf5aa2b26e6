"""Campaign folders: `campaign.toml` and one CSV a run (docs: conventions, section 5)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from symfive.campaign._csv import read_columns, write_columns
from symfive.errors import InputError, inside
from symfive.files import shown
from symfive.instruments import check_mounting, columns_of, instruments_of
from symfive.machine import Machine, machine_problems, read_machine, refuse_slips, unknown_keys, write_machine
from symfive.outputs import output_folder, write_text
from symfive.runs import OPTIONS, Campaign, Run, SetupSigma
from symfive.toml_files import TomlFile, parse_toml, read_toml, rewritten_toml
from symfive.validation import as_tuples, unknown_notes

SCHEMA = "symfive.campaign/1"
_TOP = ("schema", "machine", "run", "name")
_FIELDS = {f.name for f in fields(Run)} - {
    "options", "time", "commands", "readings", "instrument", "setup_sigma_um", "spindle",
}  # fmt: skip
_KEYS = (*sorted(_FIELDS), *OPTIONS, "instrument", "placement_id", "setup_sigma_um")


def read_campaign(path: Path | str) -> Campaign:
    """Read a campaign or plan from its folder (or its `campaign.toml`). Raises `InputError`."""
    path = Path(path)
    file = read_toml(path / "campaign.toml" if os.path.isdir(path) else path)
    folder = file.path.parent
    data = file.data
    refuse_slips(file, (), data, _TOP)
    machine_file = _machine_file(file)
    machine = read_machine(folder / machine_file)
    drafts = _drafts(file, machine)
    extra = {key: value for key, value in data.items() if key not in _TOP}
    notes = unknown_notes(unknown_keys(machine), machine_file) + unknown_notes(extra, "campaign.toml")
    for draft, block in zip(drafts, data["run"], strict=True):
        notes += unknown_notes((key for key in draft.options if key not in OPTIONS), f"run {draft.id}")
        if "setup_sigma_um" not in block and _counts_on_setup(draft, machine):
            notes.append(f"run {draft.id} declares no setup_sigma_um; 20 µm per ball and 0.5 µm of length are assumed")
        if "noise_um" not in block:
            notes.append(f"run {draft.id} declares no noise_um; {Run.noise_um} is assumed, in the unit of its readings")

    def build(runs: tuple[Run, ...]) -> Campaign:
        return Campaign(
            machine=machine, runs=runs, name=data.get("name", folder.resolve().name), machine_file=machine_file,
            comments=file.comments, notes=tuple(notes), extra=extra, path=folder, text=file.text,
        )  # fmt: skip

    with file.placing():
        build(tuple(replace(draft, commands=dict.fromkeys(machine.axis_names, np.zeros(1))) for draft in drafts))
    return build(tuple(_with_columns(folder, draft, machine) for draft in drafts))


def campaign_problems(path: Path | str) -> tuple[Machine | None, tuple[Run, ...], list[InputError]]:
    """The machine and the runs as far as they can be read, and every problem of the files, not only the first."""
    path = Path(path)
    found: list[InputError] = []
    machine, runs = None, list[Run]()
    try:
        file = read_toml(path / "campaign.toml" if os.path.isdir(path) else path)
        machine, found = machine_problems(file.path.parent / _machine_file(file))
        if machine is None:
            return None, (), found
        for number, block in enumerate(_blocks(file)):
            try:
                runs.append(_with_columns(file.path.parent, _draft(file, number, block, machine), machine))
            except InputError as error:
                found.append(error)
        if not found:
            read_campaign(path)  # what only shows where all is together
    except InputError as error:
        found.append(error)
    return machine, tuple(runs), found


def _machine_file(file: TomlFile) -> str:
    file.require_schema(SCHEMA)
    name = file.data.get("machine", "machine.toml")
    if not isinstance(name, str) or not name.strip() or not name.isprintable():
        raise file.error(
            f"machine = {shown(name)} is not a file name", "machine", remedy='write machine = "machine.toml"'
        )
    return name


def _counts_on_setup(run: Run, machine: Machine) -> bool:
    """Whether an instrument of the run has unknowns whose priors are those of balls or length."""
    exact = replace(run, setup_sigma_um=SetupSigma(table_ball=0.0, tool_ball=0.0, length=0.0))
    return any(i.parameters(run, machine) != i.parameters(exact, machine) for i in instruments_of(run))


def _drafts(file: TomlFile, machine: Machine) -> tuple[Run, ...]:
    """The runs without the contents of their CSV: one row at time 0."""
    return tuple(_draft(file, number, block, machine) for number, block in enumerate(_blocks(file)))


def _blocks(file: TomlFile) -> list[Any]:
    blocks = file.data.get("run", [])
    if not isinstance(blocks, list) or not blocks:
        raise file.error("the campaign has no runs", "run", remedy="add a [[run]] block")
    return blocks


def _draft(file: TomlFile, number: int, block: Any, machine: Machine) -> Run:
    place: tuple[str | int, ...] = ("run", number)
    if not isinstance(block, Mapping):
        raise file.error("a run is not a table", *place, remedy="write [[run]]")
    table = dict(block)
    refuse_slips(file, place, table, _KEYS)
    for key in ("id", "instrument", "sampling"):
        if key not in table:
            raise file.error(f"the run has no {key}", *place, remedy=f"add {key} = …")
    names = table.pop("instrument")
    sigma = table.pop("setup_sigma_um", {})
    if "placement_id" in table:  # its name before other mountings could be shared
        table["mounting"] = {"placement": table.pop("placement_id"), **table.get("mounting", {})}
    if not isinstance(sigma, Mapping):
        raise file.error(
            "setup_sigma_um is not a table", *place, "setup_sigma_um", remedy="write { table_ball = 20.0 }"
        )
    known = {f.name for f in fields(SetupSigma)} - {"extra"}
    refuse_slips(file, (*place, "setup_sigma_um"), sigma, known)
    more = {key: value for key, value in sigma.items() if key not in known}
    try:
        with file.placing(*place):
            with inside("setup_sigma_um"):
                spread = SetupSigma(**{key: value for key, value in sigma.items() if key in known}, extra=more)
            draft = Run(
                instrument=tuple(names) if isinstance(names, list) else (names,), setup_sigma_um=spread,
                time=np.zeros(1), commands={},
                options={key: value for key, value in table.items() if key not in _FIELDS},
                **{key: as_tuples(value) for key, value in table.items() if key in _FIELDS},
            )  # fmt: skip
            for instrument in instruments_of(draft):
                instrument.check(draft, machine)
                instrument.columns(draft, machine)
                instrument.parameters(draft, machine)
                instrument.constants(draft, machine)
            check_mounting(draft, machine)
    except InputError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        problem = f"run {shown(table['id'])} is not of the right form ({error})"
        raise file.error(problem, *place, remedy="compare it with the conventions, section 5") from None
    return draft


def _with_columns(folder: Path, draft: Run, machine: Machine) -> Run:
    columns = tuple(column.name for column in columns_of(draft, machine))
    time, commands, readings, spindle = read_columns(folder / draft.file, machine, columns, dynamic=draft.dynamic)
    return replace(draft, time=time, commands=commands, readings=readings, spindle=spindle)


def campaign_to_data(campaign: Campaign) -> dict[str, Any]:
    """`campaign.toml` as nested mappings."""
    data: dict[str, Any] = {"schema": SCHEMA, "machine": "machine.toml"}
    if campaign.path is None or campaign.name != campaign.path.resolve().name:
        data["name"] = campaign.name
    return {**data, **dict(campaign.extra), "run": [_run_table(run) for run in campaign.runs]}


def _run_table(run: Run) -> dict[str, Any]:
    instrument = run.instrument[0] if len(run.instrument) == 1 else list(run.instrument)
    table: dict[str, Any] = {"id": run.id, "file": run.file, "instrument": instrument, "sampling": run.sampling}
    if run.start_s:
        table["start_s"] = run.start_s
    if not run.has_clock:
        table["clock"] = run.clock
    if run.clock_sigma_ms:
        table["clock_sigma_ms"] = run.clock_sigma_ms
    table["table_ball"] = list(run.table_ball)
    table["tool_ball"] = list(run.tool_ball)
    for key in ("length", "u", "v"):
        value = getattr(run, key)
        if value is not None:
            table[key] = list(value) if isinstance(value, tuple) else value
    table["noise_um"] = run.noise_um if isinstance(run.noise_um, (int, float)) else dict(run.noise_um)
    sigma = run.setup_sigma_um
    table["setup_sigma_um"] = {"table_ball": sigma.table_ball, "tool_ball": sigma.tool_ball}
    if run.length is not None or sigma.length != SetupSigma.length:
        table["setup_sigma_um"]["length"] = sigma.length
    if sigma.plate:
        table["setup_sigma_um"]["plate"] = sigma.plate
    known = {"tool_length": sigma.tool_length, "zero": sigma.zero}
    table["setup_sigma_um"] |= {key: value for key, value in known.items() if value is not None}
    table["setup_sigma_um"] |= dict(sigma.extra)
    if run.mounting:
        table["mounting"] = dict(run.mounting)
    return {**table, **dict(run.options)}


def write_campaign(campaign: Campaign, folder: Path | str, *, overwrite: bool = False) -> None:
    """Write a campaign folder with its own copy of the machine file, whole or not at all (`symfive.outputs`)."""
    with output_folder(Path(folder), overwrite=overwrite) as target:
        write_campaign_files(campaign, target, to_edit=True)


def write_campaign_files(campaign: Campaign, folder: Path, *, to_edit: bool = False) -> None:
    """Write a campaign into an existing folder, where further files join it.

    A manifest protects readings that must not be edited; it never covers tables without readings, which people fill in.
    """
    write_machine(campaign.machine, folder / "machine.toml")
    for run in campaign.runs:
        write_columns(folder / run.file, run, campaign.machine, to_edit=to_edit or not run.measured)

    def read(text: str) -> dict[str, Any]:
        file = parse_toml(Path("campaign"), text)
        return {**file.data, "run": [_run_table(draft) for draft in _drafts(file, campaign.machine)]}

    text = rewritten_toml(campaign.text, campaign_to_data(campaign), read, campaign.comments)
    write_text(folder / "campaign.toml", text, to_edit=True)
