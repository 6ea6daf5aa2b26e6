"""Campaign folders: `campaign.toml` and one CSV a run (docs: conventions, section 5)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path, PurePosixPath
from typing import Any

from symfive.campaign._csv import read_columns, write_columns
from symfive.campaign._data import Campaign, Run, SetupSigma
from symfive.errors import InputError
from symfive.files import TomlFile, output_folder, read_toml, toml_text, write_text
from symfive.instruments import instruments_of
from symfive.machine import Machine, read_machine, unknown_keys, write_machine

__all__ = ["SCHEMA", "read_campaign", "write_campaign"]

SCHEMA = "symfive.campaign/1"
_FIELDS = {f.name for f in fields(Run)} - {"options", "time", "commands", "readings"}
_KNOWN_OPTIONS = (
    "axis", "encoder_axes", "force_terms", "form_axis", "form_order", "form_sigma_um", "motion_from", "placement",
    "placement_id", "placement_sigma", "sensors", "smoothing_s", "v_rest",
)  # fmt: skip


def read_campaign(path: Path | str) -> Campaign:
    """Read a campaign or plan from its folder (or its `campaign.toml`). Raises `InputError`."""
    path = Path(path)
    file = read_toml(path / "campaign.toml" if not path.is_file() else path)
    data = file.data
    if data.get("schema") != SCHEMA:
        raise file.error(f"schema is {data.get('schema')!r}", "schema", remedy=f'the first line must be schema = "{SCHEMA}"')
    machine_file = _inside(file, data.get("machine", "machine.toml"), "machine")
    machine = read_machine(file.path.parent / machine_file)
    blocks = data.get("run", [])
    if not isinstance(blocks, list) or not blocks:
        raise file.error("the campaign has no runs", remedy="add a [[run]] block")
    runs = []
    notes = [f'key "{key}" of {machine_file} is unknown to symfive; it is kept' for key in unknown_keys(machine)]
    for number, block in enumerate(blocks):
        run = _run(file, number, block, machine)
        runs.append(run)
        notes += [
            f'key "{key}" of run {run.id} is unknown to symfive; it is kept'
            for key in run.options
            if key not in _KNOWN_OPTIONS
        ]
        if "setup_sigma_um" not in block and {"ball_bar", "r_test", "grid_encoder"} & set(run.instrument):
            notes.append(f"run {run.id} declares no setup_sigma_um; 20 µm per ball and 0.5 µm of length are assumed")
    extra = {key: value for key, value in data.items() if key not in ("schema", "machine", "run", "name")}
    notes += [f'key "{key}" of campaign.toml is unknown to symfive; it is kept' for key in extra]
    try:
        return Campaign(
            machine=machine, runs=tuple(runs), name=str(data.get("name", file.path.parent.resolve().name)),
            machine_file=machine_file, comments=file.comments, notes=tuple(notes), extra=extra, path=file.path.parent,
        )  # fmt: skip
    except InputError as error:
        raise error.at(file.path, file.line("run")) from None


def _inside(file: TomlFile, name: Any, *keys: str | int) -> str:
    """A file name that stays below the campaign's folder or beside it as the machine file may."""
    if not isinstance(name, str) or not name or "\0" in name:
        raise file.error(f"{name!r} is not a file name", *keys, remedy="write a name in quotes")
    parts = PurePosixPath(name.replace("\\", "/"))
    if keys[0] == "run" and (parts.is_absolute() or ".." in parts.parts):
        raise file.error(f'file "{name}" lies outside the campaign', *keys, remedy="put the CSV into the campaign's folder")
    return name


def _run(file: TomlFile, number: int, block: Any, machine: Machine) -> Run:
    place: tuple[str | int, ...] = ("run", number)
    if not isinstance(block, Mapping):
        raise file.error("a run is not a table", *place, remedy="write [[run]]")
    table = dict(block)
    for key in ("id", "instrument", "sampling"):
        if key not in table:
            raise file.error(f"the run has no {key}", *place, remedy=f"add {key} = …")
    names = table["instrument"]
    names = tuple(names) if isinstance(names, list) else (names,)
    table["file"] = _inside(file, table.get("file", f"{table['id']}.csv"), *place, "file")
    sigma = table.get("setup_sigma_um", {})
    if not isinstance(sigma, Mapping):
        raise file.error("setup_sigma_um is not a table", *place, "setup_sigma_um", remedy="write { table_ball = 20.0, … }")
    known = {f.name for f in fields(SetupSigma)} - {"extra"}
    try:
        table["setup_sigma_um"] = SetupSigma(
            **{k: v for k, v in sigma.items() if k in known}, extra={k: v for k, v in sigma.items() if k not in known}
        )
        options = {key: value for key, value in table.items() if key not in _FIELDS}
        direct = {key: _tuple(value) for key, value in table.items() if key in _FIELDS and key != "instrument"}
        draft = Run(instrument=names, time=[0.0], commands={}, options=options, **direct)  # type: ignore[arg-type]
        for instrument in instruments_of(draft):
            instrument.check(draft, machine)
        columns = tuple(c.name for instrument in instruments_of(draft) for c in instrument.columns(draft, machine))
    except InputError as error:
        raise error.at(file.path, file.line(*place, _culprit(error, table))) from None
    except (TypeError, ValueError) as error:
        raise file.error(f"run {table['id']!r} is not of the right form ({error})", *place, remedy="correct it") from None
    time, commands, readings = read_columns(file.path.parent / table["file"], machine, columns)
    return Run(instrument=names, time=time, commands=commands, readings=readings, options=options, **direct)


def _culprit(error: InputError, table: Mapping[str, Any]) -> str:
    return next((key for key in table if key in error.problem), "id")


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def campaign_to_data(campaign: Campaign) -> dict[str, Any]:
    """`campaign.toml` as nested mappings."""
    return {
        "schema": SCHEMA,
        "machine": "machine.toml",
        **dict(campaign.extra),
        "run": [_run_table(run) for run in campaign.runs],
    }


def _run_table(run: Run) -> dict[str, Any]:
    instrument = run.instrument[0] if len(run.instrument) == 1 else list(run.instrument)
    table: dict[str, Any] = {"id": run.id, "file": run.file, "instrument": instrument, "sampling": run.sampling}
    if run.start_s:
        table["start_s"] = run.start_s
    table["table_ball"] = list(run.table_ball)
    table["tool_ball"] = list(run.tool_ball)
    for key in ("length", "u", "v"):
        value = getattr(run, key)
        if value is not None:
            table[key] = list(value) if isinstance(value, tuple) else value
    table["noise_um"] = run.noise_um if isinstance(run.noise_um, (int, float)) else dict(run.noise_um)
    sigma = run.setup_sigma_um
    table["setup_sigma_um"] = {"table_ball": sigma.table_ball, "tool_ball": sigma.tool_ball}
    if run.length is not None:
        table["setup_sigma_um"]["length"] = sigma.length
    if sigma.plate:
        table["setup_sigma_um"]["plate"] = sigma.plate
    table["setup_sigma_um"] |= dict(sigma.extra)
    return {**table, **dict(run.options)}


def write_campaign(campaign: Campaign, folder: Path | str) -> None:
    """Write a campaign folder with its own copy of the machine file, whole or not at all."""
    with output_folder(Path(folder)) as target:
        write_campaign_files(campaign, target)


def write_campaign_files(campaign: Campaign, folder: Path) -> None:
    """The same into a folder that exists (used where more files go beside them)."""
    write_machine(campaign.machine, folder / "machine.toml")
    for run in campaign.runs:
        write_columns(folder / run.file, run, campaign.machine)
    write_text(folder / "campaign.toml", toml_text(campaign_to_data(campaign), campaign.comments))
