"""One run from its commands to its readings: drives, what lies behind them, the exact chain, the instrument,
noise.
"""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import effects as catalogue
from . import instrument as instruments
from . import probe
from .chain import Array, parse_structure
from .drives import Drive, follow
from .noise import PLAIN, NoiseOptions, kept_rows, noise, quantise
from .state import UM, URAD, RunState, Spec
from .structure import error_motion_value

ZERO_SIGMA_UM = 150.0
"""1 sigma of an R-test's or grid encoder's unknown zero."""


@dataclass(frozen=True)
class Reading:
    """Readings of one run: `rows` kept (N,) bool, `values` (N, k) in the columns' units, the true
    `setup_um`.
    """

    columns: list[str]
    values: Array
    rows: Array
    setup_um: dict[str, Any]


def generator(seed: int, run_id: str, purpose: int) -> np.random.Generator:
    """Independent stream per seed, run and purpose, so that one run's draws never depend on another's."""
    return np.random.default_rng([seed, zlib.crc32(run_id.encode()), purpose])


def draw_setup(run: Spec, rng: np.random.Generator) -> dict[str, Any]:
    """Set-up errors in um: ``table_ball``, ``tool_ball`` (3), ``length``, ``zero`` (k), drawn from
    setup_sigma_um unless given.
    """
    sigma, given = run.get("setup_sigma_um", {}), run.get("setup_um", {})
    main = run["instrument"] if isinstance(run["instrument"], str) else run["instrument"][0]
    zero = {"r_test": 3, "grid_encoder": 2}.get(main, 0)
    drawn = {
        "table_ball": rng.normal(0.0, 1.0, 3) * sigma.get("table_ball", 0.0),
        "tool_ball": rng.normal(0.0, 1.0, 3) * sigma.get("tool_ball", 0.0),
        "length": rng.normal() * sigma.get("length", 0.0),
        "zero": rng.normal(0.0, ZERO_SIGMA_UM, 3)[:zero],
    }
    if "lobing_sigma_um" in run:
        drawn["lobing"] = rng.normal(0.0, 1.0, 2) * run["lobing_sigma_um"]
    return {k: given.get(k, v if np.isscalar(v) else v.tolist()) for k, v in drawn.items()}


def rounded_command(machine: Mapping[str, Any], run: Spec) -> dict[str, Array]:
    """Commands in mm and degree as the CSV holds them (7 decimals); axes that the run does not name stand at
    zero.
    """
    n = len(run["t_s"])
    chain = parse_structure(machine["structure"], machine["axes"])
    return {
        a.name: np.round(np.broadcast_to(np.asarray(run["command"].get(a.name, 0.0), float), (n,)), 7)
        for a in chain.axes
    }


def build_state(
    machine: Mapping[str, Any],
    run: Spec,
    setup: Mapping[str, Any],
    seed: int,
    oversample: int,
    beside: Mapping[str, Array],
) -> RunState:
    """The run's state on the fine instants, axes on their commands (or so far `beside`, mm), before any motion is computed."""
    chain = parse_structure(machine["structure"], machine["axes"])
    rows = np.round(np.asarray(run["t_s"], float), 6)
    dynamic = run["sampling"] == "dynamic"
    t = (
        np.interp(np.arange((len(rows) - 1) * oversample + 1) / oversample, np.arange(len(rows)), rows)
        if dynamic
        else rows
    )
    command = {}
    for name, q in rounded_command(machine, run).items():
        q = np.deg2rad(q) if chain.axis(name).rotary else q + beside.get(name, 0.0)
        command[name] = np.interp(t, rows, q) if dynamic else q
    drives = {n: Drive.from_table(table["drive"]) for n, table in machine["axes"].items() if "drive" in table}
    travel = {a.name: float(np.max(np.abs(machine["axes"][a.name]["travel"]))) for a in chain.axes}
    return RunState(
        chain,
        travel,
        run["id"],
        dynamic,
        t,
        t + float(run.get("start_s", 0.0)),
        command,
        drives,
        generator(seed, run["id"], 3),
        np.asarray(run.get("table_ball", (0.0, 0.0, 0.0)), float) + UM * np.asarray(setup["table_ball"]),
        np.asarray(run["tool_ball"], float) + UM * np.asarray(setup["tool_ball"]),
        np.asarray(float(run.get("length", 0.0)) + UM * setup["length"]),
    )


def move(state: RunState, effects: Sequence[Spec]) -> None:
    """Fills x, v, a of every axis: through its drive in a dynamic run, on its command otherwise; then what
    lies behind.
    """
    catalogue.apply(state, effects, "drive")
    for name, c in state.command.items():
        if state.dynamic and name in state.drives:
            motion = follow(state.drives[name], c, state.dt)
            state.x[name], state.v[name], state.a[name] = motion.x, motion.v, motion.a
            state.encoder[name] = motion.encoder
        else:
            state.x[name], state.encoder[name] = c.copy(), c
            state.v[name] = np.gradient(c, state.t) if state.dynamic else np.zeros_like(c)
            state.a[name] = np.gradient(state.v[name], state.t) if state.dynamic else np.zeros_like(c)
    catalogue.apply(state, effects, "axis")


def prepare(
    machine: Mapping[str, Any],
    run: Spec,
    location_errors: Mapping[str, float] | None,
    error_motions: Mapping[str, Any] | None,
    effects: Sequence[Spec],
    setup: Mapping[str, Any],
    seed: int,
    oversample: int,
    beside: Mapping[str, Array] | None = None,
) -> RunState:
    """The run's state with every motion, error and effect in it, ready to be read."""
    state = build_state(machine, run, setup, seed, oversample, beside or {})
    state.location = {k: np.asarray(v * (URAD if k[1] in "ABC" else UM)) for k, v in (location_errors or {}).items()}
    move(state, effects)
    for component, spec in (error_motions or {}).items():
        state.add_motion(component, error_motion_value(state, component, spec))
    catalogue.apply(state, effects, "body")
    catalogue.apply(state, effects, "sensor")
    return state


def simulate_run(
    machine: Mapping[str, Any],
    run: Spec,
    location_errors: Mapping[str, float] | None = None,
    error_motions: Mapping[str, Any] | None = None,
    effects: Sequence[Spec] = (),
    *,
    seed: int = 0,
    noise_options: NoiseOptions = PLAIN,
    oversample: int | None = None,
) -> Reading:
    """Readings of one run; location errors and error motions in um and urad.

    `run` holds the keys of ``[[run]]`` plus ``t_s`` (N,), ``command`` {axis: (N,) mm or degree} and
    optionally
    the true ``setup_um`` and ``mounting``.  `oversample` instants per row (chosen by the effects when None).
    """
    setup = draw_setup(run, generator(seed, run["id"], 1))
    for quantity, name in run.get("mounting", {}).items():  # the same in all runs that share it
        setup[quantity] = draw_setup(run, generator(seed, f"mounting {name}", 1))[quantity]
    dynamic = run["sampling"] == "dynamic"
    if oversample is None:
        oversample = 5 if dynamic and any(e["effect"] in catalogue.FINE for e in effects) else 1
    state = prepare(machine, run, location_errors, error_motions, effects, setup, seed, oversample)
    take = slice(None, None, oversample if dynamic else 1)
    kinds = [run["instrument"]] if isinstance(run["instrument"], str) else list(run["instrument"])
    driven = [a for a in state.chain.axes if a.name in state.drives] if "encoder" in kinds else []
    zero = np.asarray(setup["zero"]) if len(setup["zero"]) else np.zeros(1)
    rng, blocks, rows = generator(seed, run["id"], 2), [], state.t[take]
    for kind in kinds:
        if kind == "encoder":
            encoders = [state.coordinate(a.name, state.encoder[a.name])[take] for a in driven]
            blocks.append(np.stack(encoders, axis=1))
            continue
        if kind == "touch_probe":
            everything = (machine, run, location_errors, error_motions, effects, setup, seed, oversample)
            state, found = probe.found_um(run, setup, lambda beside, given=everything: prepare(*given, beside))
        else:
            found = instruments.true_reading(state, kind, run)
        y = instruments.measured(state, found, zero)[take]
        y = y + noise(rows, y.shape[1], float(run["noise_um"]), noise_options, rng)
        blocks.append(quantise(y, noise_options.quantum_um))
    names = instruments.columns(run["instrument"], [a.column.replace("_", "_act_") for a in driven])
    kept = kept_rows(len(rows), noise_options.missing_rate, rng)
    return Reading(names, np.concatenate(blocks, axis=1), kept, setup)
