"""Plans of sweeps read by the independent plant with lag, delay and slow noise."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from plant import NoiseOptions, simulate_run

from symfive.campaign import Campaign, Run, SetupSigma, read_campaign

SLOW = NoiseOptions(coloured_um=0.3, correlation_s=1.0)
COLUMNS = {"r_test": ("dx_um", "dy_um", "dz_um"), "ball_bar": ("dL_um",)}
FINE = 20
"""Instants per row at which the plant moves: it shifts readings by a delay along straight lines between these."""


def measured(folder: Path, seed: int) -> tuple[Campaign, dict[str, float]]:
    """The plan read by the plant: errors, set-up and drives drawn from their priors, delay, slow noise."""
    generator, plan = np.random.default_rng(seed), read_campaign(folder)
    table = tomllib.loads((folder / "machine.toml").read_text(encoding="utf-8"))
    expected = json.loads((folder / "plan.json").read_text())["expected"]
    names = [name for name in expected if not name.startswith(("setup.", "mounting.", "latency.", "servo_mismatch."))]
    truth = {name: float(expected[name]["prior_std"] * generator.standard_normal()) for name in names}
    for axis in table["axes"].values():
        axis["drive"]["position_gain"] *= 1.0 + 0.1 * generator.standard_normal()
    motions = {
        component: _motion({name.partition(".")[2]: v for name, v in truth.items() if name.startswith(f"{component}.")})
        for component in {name.partition(".")[0] for name in names if "." in name}
    }
    location = {name: value for name, value in truth.items() if "." not in name}
    runs, setups = [], dict[str, dict[str, Any]]()
    for number, run in enumerate(plan.runs):
        mounted = str(sorted(run.mounting.items()) or run.id)
        spec = {**_spec(run), "setup_um": setups.setdefault(mounted, _setup(run, generator))}
        delay = {"effect": "latency", "delay_ms": 5.0 * generator.standard_normal()}
        own = 1000 * number + seed
        read = simulate_run(
            table, spec, location, motions, [delay], seed=own, noise_options=SLOW, oversample=FINE
        ).values
        runs.append(run.with_readings(dict(zip(COLUMNS[run.instrument[0]], read.T, strict=True))))
    return Campaign(machine=plan.machine, runs=tuple(runs)), truth


def _motion(terms: dict[str, float]) -> Callable[[np.ndarray], np.ndarray]:
    """Harmonics of a turn, µm or µrad at degrees."""
    waves = {"cos": np.cos, "sin": np.sin}
    return lambda q: sum(size * waves[name[:3]](int(name[3:]) * np.radians(q)) for name, size in terms.items())


def _spec(run: Run) -> dict[str, Any]:
    """A recording for the plant."""
    return {
        "id": run.id, "instrument": run.instrument[0], "sampling": "dynamic", "t_s": run.time, "command": run.commands,
        "table_ball": run.table_ball, "tool_ball": run.tool_ball, "noise_um": run.noise_um, "length": run.length or 0.0,
    }  # fmt: skip


def _setup(run: Run, generator: np.random.Generator) -> dict[str, Any]:
    """Set-up errors drawn; a nest's place is not known at all: its zero is."""
    sigma, known = run.setup_sigma_um, run.length is not None
    assert isinstance(sigma, SetupSigma)
    return {
        "table_ball": list(known * sigma.table_ball * generator.standard_normal(3)),
        "length": known * sigma.length * generator.standard_normal(),
        "zero": [] if known else list(150.0 * generator.standard_normal(3)),
        "tool_ball": list(sigma.tool * generator.standard_normal(3)),
    }
