"""One machine measured for years: the plant's readings, linear in its errors, with ageing, seasons, collisions and repairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .chain import Array, parse_structure
from .machines import topology
from .noise import QUIET
from .paths import r_test
from .simulate import simulate_run

NOISE_UM, NEST_UM, BALL_UM = 0.4, 20.0, 0.5
"""1 sigma of a reading, of the nest's place, and of the tool ball, which is centred on the spindle by turning it."""
ACROSS = {"A": ("Y0", "Z0", "B0", "C0"), "B": ("X0", "Z0", "A0", "C0"), "C": ("X0", "Y0", "A0", "B0")}
DAYS_A_YEAR = 365.25


def location_errors(structure: str) -> dict[str, dict[str, float]]:
    """Four location errors of each rotary axis with their priors, um and urad."""
    names = [w.rstrip("'") for w in structure.split()]
    return {
        f"E{code}{axis}": {"sigma": 80.0 if code[0] in "ABC" else 40.0}
        for axis in names if axis in ACROSS for code in ACROSS[axis]
    }  # fmt: skip


@dataclass(frozen=True)
class Test:
    """A topology with three R-test runs: `slopes` of all readings (N, k + set-up) per um or urad, by central differences of
    the exact plant; `sigma` (set-up,) 1 sigma of each set-up error, um.
    """

    machine: dict[str, Any]
    runs: list[dict[str, Any]]
    names: list[str]
    slopes: Array
    sigma: Array

    @classmethod
    def of(cls, name: str) -> Test:
        """The test of one of the plant's topologies with two rotary axes."""
        from .machines import TOPOLOGIES

        machine = topology(
            name, location_errors(TOPOLOGIES[name][0]), origins={"B": [0.0, 0.0, -50.0], "A": [0.0, 0.0, -50.0]}
        )
        axes = tuple(a.name for a in parse_structure(machine["structure"], machine["axes"]).axes if a.rotary)
        tilt, turn = (0, 1) if axes[1] == "C" else (1, 0)
        grid = np.array([(a, c) for a in (-90.0, -45.0, 0.0, 45.0, 90.0) for c in range(0, 360, 60)], float)
        poses = np.empty_like(grid)
        poses[:, tilt], poses[:, turn] = grid[:, 0], grid[:, 1]
        nests = [(90.0, -20.0, 50.0), (-40.0, 60.0, 100.0), (30.0, -70.0, 150.0)]
        runs = [
            r_test(
                machine,
                f"nest{i}",
                nest=nest,
                poses=poses,
                axes=axes,
                noise_um=NOISE_UM,
                sigma_um=NEST_UM,
                start_s=300.0 * i,
            )
            for i, nest in enumerate(nests)
        ]
        for run in runs:
            run["setup_sigma_um"] = {"table_ball": NEST_UM, "tool_ball": BALL_UM}
        names = list(machine["errors"])
        parts = [_readings_by_error(machine, runs, names), *_readings_by_setup(machine, runs)]
        sigma = np.tile([NEST_UM] * 3 + [BALL_UM] * 3 + [150.0] * 3, len(runs))
        return cls(machine, runs, names, np.concatenate(parts, axis=1), sigma)


def _read(machine: Mapping[str, Any], runs: Sequence[Any], errors: Mapping[str, float], setups: Sequence[Any]) -> Array:
    found = []
    for run, setup in zip(runs, setups, strict=True):
        given = {**run, "setup_um": setup, "noise_um": 0.0}
        found.append(simulate_run(machine, given, errors, noise_options=QUIET).values.ravel())
    return np.concatenate(found)


def _nothing() -> dict[str, Any]:
    return {"table_ball": [0.0] * 3, "tool_ball": [0.0] * 3, "length": 0.0, "zero": [0.0] * 3}


def _readings_by_error(machine: Mapping[str, Any], runs: Sequence[Any], names: Sequence[str]) -> Array:
    setups = [_nothing() for _ in runs]
    columns = [(_read(machine, runs, {n: 1.0}, setups) - _read(machine, runs, {n: -1.0}, setups)) / 2.0 for n in names]
    return np.stack(columns, axis=1)


def _readings_by_setup(machine: Mapping[str, Any], runs: Sequence[Any]) -> list[Array]:
    parts = []
    for i in range(len(runs)):
        for key in ("table_ball", "tool_ball", "zero"):
            columns = []
            for axis in range(3):
                ends = []
                for sign in (1.0, -1.0):
                    setups = [_nothing() for _ in runs]
                    setups[i][key][axis] = sign
                    ends.append(_read(machine, runs, {}, setups))
                columns.append((ends[0] - ends[1]) / 2.0)
            parts.append(np.stack(columns, axis=1))
    return parts


@dataclass(frozen=True)
class Life:
    """A machine's errors over its visits: `truth` (n, k) um and urad, `day` (n,), `temperature` (n,) degree, `steps` as
    (visit, name, size), `repairs` the visits before which it was repaired.
    """

    truth: Array
    day: Array
    temperature: Array
    steps: list[tuple[int, str, float]] = field(default_factory=list)
    repairs: list[int] = field(default_factory=list)


def life(test: Test, visits: int, rng: np.random.Generator, *, days: float = 7.0, collisions: float = 0.0, repairs: float = 0.0,
         step: tuple[int, str, float] | None = None, scatter: float = 0.3) -> Life:  # fmt: skip
    """Ageing at constant rates (1 sigma 1 um or 10 urad a year), seasons (0.3 um or 3 urad per degree, 6 degree either way),
    `scatter` um (10 times as many urad) from visit to visit, `collisions` and `repairs` a year at random visits.
    """
    k = len(test.names)
    size = np.array([10.0 if name[1] in "ABC" else 1.0 for name in test.names])
    prior = np.array([test.machine["errors"][name]["sigma"] for name in test.names])
    day = np.arange(visits) * days + rng.uniform(-0.1, 0.1, visits) * days
    years = day / DAYS_A_YEAR
    warm = 20.0 + 6.0 * np.sin(2.0 * np.pi * (years - rng.random())) + rng.normal(0.0, 1.0, visits)
    truth = 0.5 * prior * rng.normal(size=k) + np.outer(years, rng.normal(0.0, 1.0, k) * size)
    truth = (
        truth + np.outer(warm - 20.0, rng.normal(0.0, 0.3, k) * size) + scatter * size * rng.normal(size=(visits, k))
    )
    steps, repaired = ([step] if step else []), []
    for visit in np.flatnonzero(rng.random(visits) < collisions * days / DAYS_A_YEAR):
        j = int(rng.integers(k))
        steps.append((int(visit), test.names[j], float(rng.choice([-1.0, 1.0]) * rng.uniform(2.0, 10.0) * size[j])))
    for visit, name, change in steps:
        truth[visit:, test.names.index(name)] += change
    for visit in np.flatnonzero(rng.random(visits) < repairs * days / DAYS_A_YEAR):
        repaired.append(int(visit))
        truth[visit:] += rng.normal(0.0, 5.0, k) * size
    return Life(truth, day, warm, steps, repaired)


def readings(test: Test, truth: Array, rng: np.random.Generator) -> Array:
    """Readings (n, N) um of visits whose errors are `truth` (n, k), each set up anew."""
    setup = rng.normal(size=(len(truth), len(test.sigma))) * test.sigma
    noise = rng.normal(0.0, NOISE_UM, (len(truth), len(test.slopes)))
    return np.concatenate([truth, setup], axis=1) @ test.slopes.T + noise
