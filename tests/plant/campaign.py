"""Writes campaigns by FORMATS.md sections 4 and 5: machine.toml, campaign.toml, one CSV a run, truth.json."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .chain import parse_structure
from .noise import PLAIN, NoiseOptions
from .simulate import Reading, rounded_command, simulate_run
from .state import Spec

RUN_KEYS = (
    "id",
    "file",
    "instrument",
    "sampling",
    "start_s",
    "table_ball",
    "tool_ball",
    "length",
    "u",
    "v",
    "noise_um",
    "setup_sigma_um",
    "mounting",
    "lobing_sigma_um",
    "touches",
    "touch_frame",
    "frame",
    "sense",
)


def toml_value(value: Any) -> str:
    """One TOML value: bool, number, string, list, inline table."""
    if isinstance(value, (bool, np.bool_)):
        return str(bool(value)).lower()
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{k} = {toml_value(v)}" for k, v in value.items()) + " }"
    return "[" + ", ".join(toml_value(v) for v in value) + "]"


def machine_toml(machine: Mapping[str, Any]) -> str:
    """Text of machine.toml from the dictionary that tomllib would read back."""
    lines = [
        f"schema = {toml_value(machine.get('schema', 'symfive.machine/1'))}",
        f"name = {toml_value(machine.get('name', 'plant'))}",
        f"structure = {toml_value(machine['structure'])}",
    ]
    for name, table in machine["axes"].items():
        lines += ["", f"[axes.{name}]"] + [f"{k} = {toml_value(v)}" for k, v in table.items() if k != "drive"]
        if "drive" in table:
            lines += [f"[axes.{name}.drive]"] + [f"{k} = {toml_value(v)}" for k, v in table["drive"].items()]
    for section in ("errors", "workspace", "model"):
        if section in machine:
            lines += ["", f"[{section}]"] + [f"{k} = {toml_value(v)}" for k, v in machine[section].items()]
    return "\n".join(lines) + "\n"


def campaign_toml(runs: Sequence[Spec]) -> str:
    """Text of campaign.toml."""
    lines = ['schema = "symfive.campaign/1"', 'machine = "machine.toml"']
    for run in runs:
        lines += ["", "[[run]]"] + [f"{k} = {toml_value(run[k])}" for k in RUN_KEYS if k in run]
    return "\n".join(lines) + "\n"


def csv_text(machine: Mapping[str, Any], run: Spec, reading: Reading | None) -> str:
    """Text of a run's CSV: t_s, one command column per axis from the bed outward, readings (4 decimals,
    encoders 7).
    """
    axes = parse_structure(machine["structure"], machine["axes"]).axes
    command = rounded_command(machine, run)
    table = [np.asarray(run["t_s"], float)] + [command[a.name] for a in axes]
    header, form = ["t_s"] + [a.column for a in axes], ["%.6f"] + ["%.7f"] * len(axes)
    keep = np.ones(len(table[0]), bool)
    if reading is not None:
        header += reading.columns
        form += ["%.4f" if c.endswith("_um") else "%.7f" for c in reading.columns]
        table += list(reading.values.T)
        keep = reading.rows
    line = ",".join(form)
    return "\n".join([",".join(header)] + [line % tuple(row) for row in np.stack(table, axis=1)[keep].tolist()]) + "\n"


def write_campaign(
    folder: Path | str,
    machine: Mapping[str, Any],
    runs: Sequence[Spec],
    location_errors: Mapping[str, float] | None = None,
    error_motions: Mapping[str, Any] | None = None,
    effects: Sequence[Spec] = (),
    *,
    seed: int = 0,
    noise_options: NoiseOptions = PLAIN,
    readings: bool = True,
    truth: Path | str | None = None,
) -> dict[str, Reading]:
    """Writes one campaign folder and its truth.json (`truth`: another place for it); returns the readings by
    run.

    Location errors and error motions in um and urad; `effects` as dictionaries of FORMATS.md section 7 plus
    `form`;
    with ``readings=False`` the folder is a measurement plan.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "machine.toml").write_text(machine_toml(machine))
    (folder / "campaign.toml").write_text(campaign_toml(runs))
    results: dict[str, Reading] = {}
    for run in runs:
        reading = None
        if readings:
            reading = simulate_run(
                machine, run, location_errors, error_motions, effects, seed=seed, noise_options=noise_options
            )
            results[run["id"]] = reading
        (folder / run["file"]).write_text(csv_text(machine, run, reading))
    if readings:
        path = Path(truth) if truth else folder / "truth.json"
        path.write_text(truth_json(location_errors, error_motions, effects, results))
    return results


def write_pair(
    folder: Path | str,
    machine: Mapping[str, Any],
    fit: Sequence[Spec],
    heldout: Sequence[Spec],
    location_errors: Mapping[str, float] | None = None,
    error_motions: Mapping[str, Any] | None = None,
    effects: Sequence[Spec] = (),
    *,
    seed: int = 0,
    noise_options: NoiseOptions = PLAIN,
) -> tuple[Path, Path]:
    """Writes ``fit/``, ``heldout/`` and one truth.json beside them, as in the shared campaigns; returns both
    folders.
    """
    folder = Path(folder)
    places = folder / "fit", folder / "heldout"
    results: dict[str, Reading] = {}
    for place, runs in zip(places, (fit, heldout), strict=True):
        results |= write_campaign(
            place,
            machine,
            runs,
            location_errors,
            error_motions,
            effects,
            seed=seed,
            noise_options=noise_options,
            truth=folder / "truth.json",
        )
    (folder / "truth.json").write_text(truth_json(location_errors, error_motions, effects, results))
    return places


def truth_json(
    location_errors: Mapping[str, float] | None,
    error_motions: Mapping[str, Any] | None,
    effects: Sequence[Spec],
    results: Mapping[str, Reading],
) -> str:
    """Truth as in the shared campaigns (effects, location_errors_um_urad) plus what the plant drew
    (setup_um).
    """
    truth: dict[str, Any] = {
        "effects": [dict(e) for e in effects],
        "location_errors_um_urad": dict(location_errors or {}),
    }
    if error_motions:
        truth["error_motions_um_urad"] = {k: "function" if callable(v) else v for k, v in error_motions.items()}
    truth["setup_um"] = {run: reading.setup_um for run, reading in results.items()}
    return json.dumps(truth, indent=1, default=lambda v: np.asarray(v).tolist())
