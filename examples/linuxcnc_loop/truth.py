"""The true machine: the independent plant with drawn errors, richer than any model of it. Knows nothing of symfive.

Every location error is drawn from the prior of the machine file, every error motion too, and each error motion goes on for
one order more than the file has it. Error motions of linear axes follow ISO 230-1: a straightness has no slope of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import plant
from numpy.polynomial.legendre import legval
from numpy.typing import NDArray

Array = NDArray[np.float64]
Table = Mapping[str, Any]
Spec = dict[str, Any]

BEYOND = 0.1
"""1σ of the coefficients of the order that the file does not have, as a share of the others'."""
EXACT = {"table_ball": [0.0] * 3, "tool_ball": [0.0] * 3, "zero": [0.0] * 3}
"""A set-up without errors, µm."""
DRIFT_TIME_S = 600.0


@dataclass(frozen=True)
class MotionCurve:
    """An error motion (µm or µrad) over a coordinate in mm or degree: Legendre polynomials P1 … on the travel, or harmonics
    (cos, sin) 1 … of a turn. The last order is `beyond` the machine file's."""

    coefficients: Array
    travel: tuple[float, float] | None = None

    def __call__(self, q: Array) -> Array:
        """The value at coordinates q (N,)."""
        if self.travel is not None:
            low, high = self.travel
            return np.asarray(legval((2.0 * q - low - high) / (high - low), [0.0, *self.coefficients]))
        turns = np.deg2rad(q)
        harmonics = enumerate(self.coefficients.reshape(-1, 2), start=1)
        return np.asarray(sum(c * np.cos(k * turns) + s * np.sin(k * turns) for k, (c, s) in harmonics))

    def without_last_order(self) -> MotionCurve:
        """What the machine file's orders hold of it."""
        return replace(self, coefficients=self.coefficients[: -1 if self.travel is not None else -2])


@dataclass(frozen=True)
class TrueMachine:
    """`table` of machine.toml, location errors (µm, µrad), error motions by component, and effects that change in time."""

    table: Table
    location_errors: Mapping[str, float]
    error_motions: Mapping[str, MotionCurve]
    effects: Sequence[Spec] = field(default_factory=tuple)

    def within_the_file(self) -> TrueMachine:
        """The part of the truth that the machine file's terms hold."""
        motions = {name: curve.without_last_order() for name, curve in self.error_motions.items()}
        return replace(self, error_motions=motions, effects=())


def drawn_machine(table: Table, *, seed: int, drift_um: float = 0.0) -> TrueMachine:
    """One machine of the kind that `table` (machine.toml) describes; `drift_um`: the tool drifts along Z so far in the end."""
    rng = np.random.default_rng(seed)
    location: dict[str, float] = {}
    motions: dict[str, MotionCurve] = {}
    for name, term in table["errors"].items():
        if name[2] == "0":
            location[name] = float(rng.normal(0.0, term["sigma"]))
        else:
            motions[name] = _drawn_motion(name, term, table["axes"], rng)
    drift = {
        "effect": "thermal_drift", "direction": [0.0, 0.0, 1.0], "amplitude": drift_um, "time_constant_s": DRIFT_TIME_S
    }  # fmt: skip
    return TrueMachine(table, location, motions, (drift,) if drift_um else ())


def _drawn_motion(name: str, term: Table, axes: Table, rng: np.random.Generator) -> MotionCurve:
    axis = plant.parse_structure(f"w {name[2:]}' b t", axes).axis(name[2:])
    count, order = (2, term["order"]) if term["basis"] == "fourier" else (1, term["order"])
    sizes = np.full((order + 1, count), float(term["sigma"]))
    sizes[-1] *= BEYOND
    drawn = sizes * rng.normal(size=sizes.shape)
    along = abs(np.asarray(axis.direction)["XYZ".index(name[1])]) if name[1] in "XYZ" else 1.0
    if not axis.rotary and along < 0.5:  # a straightness: its slope is a squareness
        drawn[0] = 0.0
    travel = axes[name[2:]]["travel"]
    return MotionCurve(drawn.ravel(), None if term["basis"] == "fourier" else (float(travel[0]), float(travel[1])))


def measure(machine: TrueMachine, runs: Sequence[Spec], folder: Path, *, seed: int) -> None:
    """The R-tests of these runs as a campaign with readings; set-up errors and noise are this seed's."""
    plant.write_campaign(
        folder, machine.table, runs, machine.location_errors, dict(machine.error_motions), machine.effects, seed=seed
    )


def place_of_the_tool(machine: TrueMachine, run: Spec, joints: Mapping[str, Array]) -> Array:
    """Where the tool centre point truly is with the joints there, minus the nest, (N, 3) µm; no set-up error, no noise."""
    reading = plant.simulate_run(
        machine.table, {**run, "command": dict(joints), "setup_um": EXACT}, machine.location_errors,
        dict(machine.error_motions), machine.effects, noise_options=plant.QUIET,
    )  # fmt: skip
    return np.asarray(reading.values)


def tool_rotation(table: Table, joints: Mapping[str, Array]) -> Array:
    """The tool frame's axes in the workpiece frame as designed, (N, 3, 3)."""
    chain = plant.parse_structure(table["structure"], table["axes"])
    q = {a.name: np.deg2rad(joints[a.name]) if a.rotary else joints[a.name] for a in chain.axes}
    origin = plant.ball_in_workpiece(chain, q, np.zeros(3))
    return np.stack([plant.ball_in_workpiece(chain, q, unit) - origin for unit in np.eye(3)], axis=-1)
