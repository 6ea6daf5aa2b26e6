"""Reads a campaign folder back into the plant's own dictionaries and fits set-up errors to it: the plant's
check on others' data.
"""

import csv
import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from . import instrument as instruments
from .chain import Array, parse_structure
from .simulate import prepare
from .state import UM, RunState, Spec

NO_SETUP = {"table_ball": [0.0] * 3, "tool_ball": [0.0] * 3, "length": 0.0, "zero": [0.0] * 3}


def read_campaign(folder: Path | str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Machine and runs of a folder; each run gets ``t_s``, ``command`` (mm, degree) and ``readings`` (N, k)
    in its columns' units.
    """
    folder = Path(folder)
    campaign = tomllib.loads((folder / "campaign.toml").read_text())
    machine = tomllib.loads((folder / campaign["machine"]).read_text())
    axes = parse_structure(machine["structure"], machine["axes"]).axes
    for run in campaign["run"]:
        with (folder / run["file"]).open(newline="") as file:
            header, *rows = csv.reader(file)
        table = dict(zip(header, np.array(rows, float).T, strict=True))
        run["t_s"] = table.pop("t_s")
        run["command"] = {a.name: table.pop(a.column) for a in axes}
        run["columns"] = list(table)
        run["readings"] = np.stack(list(table.values()), axis=1) if table else np.zeros((len(rows), 0))
    return machine, campaign["run"]


def read_truth(folder: Path | str) -> dict[str, Any]:
    """truth.json of a campaign or of a fit/heldout pair."""
    return json.loads((Path(folder) / "truth.json").read_text())


def fit_setup(
    machine: Mapping[str, Any],
    run: Spec,
    location_errors: Mapping[str, float],
    effects: Sequence[Spec] = (),
    error_motions: Mapping[str, Any] | None = None,
) -> tuple[dict[str, float], Array]:
    """Set-up errors (um) of one run by Gauss-Newton with their priors, machine held; returns them and the
    residual (N, k) um.
    """
    state = prepare(machine, run, location_errors, error_motions, effects, NO_SETUP, 0, 1)
    nominal = state.table_ball, state.tool_ball, state.length
    sigma = run["setup_sigma_um"]
    names = [f"{ball}.{c}" for ball in ("table_ball", "tool_ball") for c in "xyz"]
    prior = [sigma[name.split(".")[0]] for name in names]
    if run["instrument"] == "ball_bar":
        names, prior = [*names, "length"], [*prior, sigma["length"]]
    else:
        zeros = run["readings"].shape[1]
        names, prior = [*names, *[f"zero.{i}" for i in range(zeros)]], [*prior, *[1e4] * zeros]

    def predict(s: Array) -> Array:
        _place(state, nominal, s, run["instrument"])
        zero = s[6:] if run["instrument"] != "ball_bar" else np.zeros(1)
        return instruments.measured(state, instruments.true_reading(state, run["instrument"], run), zero)

    s, noise = np.zeros(len(names)), float(run["noise_um"])
    for _ in range(2):
        y = predict(s)
        columns = [(predict(s + e) - y).ravel() / noise for e in np.eye(len(s))]
        a = np.vstack([np.stack(columns, axis=1), np.diag(1.0 / np.asarray(prior))])
        b = np.concatenate([(run["readings"] - y).ravel() / noise, -s / np.asarray(prior)])
        s = s + np.linalg.lstsq(a, b, rcond=None)[0]
    return dict(zip(names, s.tolist(), strict=True)), run["readings"] - predict(s)


def _place(state: RunState, nominal: tuple[Array, Array, Array], s: Array, instrument: str) -> None:
    state.table_ball, state.tool_ball = nominal[0] + UM * s[:3], nominal[1] + UM * s[3:6]
    if instrument == "ball_bar":
        state.length = nominal[2] + UM * s[6]
