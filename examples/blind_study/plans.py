"""Random machines and the tests run on them: R-test grids, static ball bar, planar circles, X-C circles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import plant

Random = np.random.Generator
Runs = list[dict[str, Any]]

FIVE_AXIS = (
    "table-bc",
    "table-ac",
    "table-ac-gantry",
    "head-ca",
    "head-cb",
    "mixed-c-b",
    "nutating-table",
    "nutating-head",
)
PLANAR = (*FIVE_AXIS, "three-axis", "three-axis-gantry")
TURNING = ("table-bc", "table-ac", "table-ac-gantry", "mixed-c-b", "turning-table")
LOCATION = {"A": "EY EZ EB EC", "B": "EX EZ EA EC", "C": "EX EY EA EB"}
"""The four location errors that each rotary axis has of its own (ISO 230-7)."""
MOTIONS = {
    "A": ("EXA", "EZA", "ECA"),
    "B": ("EXB", "EYB", "ECB"),
    "C": ("EXC", "EZC", "EAC"),
    "X": ("EYX",),
    "Y": ("EXY",),
}
"""Error motions that a baseline may already hold."""


@dataclass(frozen=True)
class Setting:
    """A machine, its true errors, its tests and its noise: everything of a case but the effects."""

    kind: str
    topology: str
    machine: dict[str, Any]
    fit: Runs
    heldout: Runs
    noise: plant.NoiseOptions
    location: dict[str, float] = field(default_factory=dict)
    motions: dict[str, Any] = field(default_factory=dict)

    @property
    def dynamic(self) -> bool:
        """Recordings of a motion, not poses at rest."""
        return self.fit[0]["sampling"] == "dynamic"

    @property
    def white_um(self) -> float:
        """1 sigma of the declared noise."""
        return float(self.fit[0]["noise_um"])

    def moving(self) -> list[str]:
        """Axes that move within a run."""
        return [a for a in self.machine["axes"] if any(np.ptp(run["command"][a]) > 1e-6 for run in self.fit)]

    def reach(self, axis: str) -> tuple[float, float]:
        """Lowest and highest command of an axis (mm, degree)."""
        values = np.concatenate([run["command"][axis] for run in self.fit])
        return float(values.min()), float(values.max())

    def duration(self) -> float:
        """End of the last run on the campaign's clock, s."""
        return max(run.get("start_s", 0.0) + float(run["t_s"][-1]) for run in self.fit)


def draw_noise(rng: Random, white: float, dynamic: bool) -> plant.NoiseOptions:
    """A third of the instruments are as their data sheet says; the others drift, have memory and miss rows."""
    if rng.random() < 0.33:
        return plant.PLAIN
    return plant.NoiseOptions(
        coloured_um=white * rng.uniform(0.3, 0.8),
        correlation_s=rng.uniform(0.3, 2.0) if dynamic else rng.uniform(20.0, 90.0),
        drift_um=0.0 if dynamic else white * rng.uniform(0.0, 0.3),
        outlier_rate=rng.uniform(0.0, 0.002 if dynamic else 0.008),
        outlier_um=8.0 * white,
        missing_rate=rng.uniform(0.0, 0.02),
        quantum_um=float(rng.choice([0.0, 0.1])),
    )


def draw_errors(rng: Random, topology: str, kind: str) -> dict[str, Any]:
    """`[errors]` of the baseline: what the model may vary, with random sigmas; sometimes error motions too."""
    axes = plant.topology(topology, {})["axes"]
    errors: dict[str, Any] = {}
    if kind == "planar":
        errors["EC0X"] = {"sigma": rng.uniform(20.0, 60.0)}
        errors["EXX"] = {"basis": "polynomial", "order": 1, "sigma": 5.0}
    else:
        for axis in (a for a in axes if a in "ABC" and (kind != "xc" or a == "C")):
            for word in LOCATION[axis].split():
                errors[f"{word}0{axis}"] = {
                    "sigma": rng.uniform(30.0, 90.0) if word[1] in "ABC" else rng.uniform(15.0, 50.0)
                }
    if rng.random() < 0.4:
        wide = {"planar": "XY", "xc": "C"}.get(kind, "ABC")
        choices = [m for a in axes if a in wide for m in MOTIONS[a]]
        for motion in rng.choice(choices, min(2, len(choices)), replace=False):
            basis = {"basis": "fourier", "order": 2} if motion[2] == "C" else {"basis": "polynomial", "order": 2}
            errors[str(motion)] = {**basis, "sigma": 10.0 if motion[1] in "ABC" else 3.0}
    return errors


def draw_truth(rng: Random, errors: dict[str, Any]) -> tuple[dict[str, float], dict[str, Any]]:
    """True location errors and error motions from their sigmas."""
    location, motions = {}, {}
    for name, term in errors.items():
        if "basis" not in term:
            location[name] = float(rng.normal(0.0, term["sigma"]))
        elif term["basis"] == "fourier":
            motions[name] = {
                "harmonics": [[k, *rng.normal(0.0, term["sigma"], 2).tolist()] for k in range(1, term["order"] + 1)]
            }
        else:
            motions[name] = {"coefficients": rng.normal(0.0, term["sigma"], term["order"]).tolist()}
    return location, motions


def drives(rng: Random, names: str) -> dict[str, dict[str, float]]:
    """Position loops of the driven axes."""
    gain, integral = rng.uniform(30.0, 60.0), rng.uniform(0.03, 0.08)
    return {
        name: {
            "position_gain": round(gain, 1),
            "velocity_gain": round(rng.uniform(220.0, 380.0), 0),
            "integral_time": round(integral, 3),
            "viscous": round(rng.uniform(4.0, 10.0), 1),
            "feedforward": 0.0,
        }
        for name in names
    }


def _new_machine(rng: Random, name: str, kind: str, driven: str = "") -> dict[str, Any]:
    tilts = [a for a in plant.topology(name, {})["axes"] if a in "AB"]
    origins = {a: [0.0, 0.0, float(np.round(rng.uniform(-90.0, 0.0)))] for a in tilts}
    return plant.topology(
        name, draw_errors(rng, name, kind), drives=drives(rng, driven) if driven else None, origins=origins
    )


def _poses(rng: Random, lean: bool) -> tuple[np.ndarray, np.ndarray]:
    """Poses of a grid of both rotary axes, to and fro, and random ones that were left out of it."""
    tilt = float(rng.choice([60.0, 75.0, 90.0]))
    outer = np.linspace(-tilt, tilt, 3 if lean else 7)
    inner = np.arange(0.0, 331.0, 60.0 if lean else 30.0)
    held = plant.random_poses(
        np.linspace(-tilt, tilt, 13).tolist(), np.arange(0.0, 331.0, 15.0).tolist(), 48, int(rng.integers(1 << 30))
    )
    return plant.grid_poses(outer.tolist(), inner.tolist()), held


def r_test_grids(rng: Random, name: str, lean: bool = False) -> tuple[dict[str, Any], Runs, Runs]:
    """Two nests (one if `lean`), every pose twice."""
    machine = _new_machine(rng, name, "r_test")
    tilt = next(a for a in machine["axes"] if a in "AB")
    poses, held = _poses(rng, lean)
    common = {"axes": (tilt, "C"), "noise_um": round(rng.uniform(0.25, 0.6), 2), "sigma_um": 20.0}
    nests = [(rng.uniform(60.0, 110.0), rng.uniform(-40.0, 10.0), rng.uniform(30.0, 70.0))]
    nests += [] if lean else [(rng.uniform(20.0, 60.0), rng.uniform(30.0, 70.0), rng.uniform(120.0, 170.0))]
    fit = [
        plant.r_test(machine, f"nest{i + 1}", nest=np.round(nest).tolist(), poses=poses, start_s=1500.0 * i, **common)
        for i, nest in enumerate(nests)
    ]
    check = plant.r_test(machine, "check", nest=[-50.0, 60.0, 100.0], poses=held, start_s=1500.0 * len(nests), **common)
    return machine, fit, [check]


def static_bars(rng: Random, name: str, lean: bool = False) -> tuple[dict[str, Any], Runs, Runs]:
    """Ball bar at rest along X, Y and Z from balls at several places, every pose twice."""
    machine = _new_machine(rng, name, "static_bar")
    tilt = next(a for a in machine["axes"] if a in "AB")
    poses, held = _poses(rng, lean)
    common = {"axes": (tilt, "C"), "noise_um": round(rng.uniform(0.25, 0.6), 2), "length": 100.0}
    places = (
        ("x", (1.0, 0.0, 0.0), (0.0, 0.0, 140.0)),
        ("y", (0.0, 1.0, 0.0), (80.0, 0.0, 60.0)),
        ("z", (0.0, 0.0, 1.0), (60.0, 50.0, 40.0)),
    )
    fit = [
        plant.static_ball_bar(
            machine, f"bar-{word}", table_ball=ball, direction=way, poses=poses, start_s=1500.0 * i, **common
        )
        for i, (word, way, ball) in enumerate(places[: 1 if lean else 3])
    ]
    check = plant.static_ball_bar(
        machine,
        "check",
        table_ball=(-40.0, 60.0, 90.0),
        direction=(0.6, 0.0, 0.8),
        poses=held,
        start_s=4500.0,
        **common,
    )
    return machine, fit, [check]


def planar_circles(rng: Random, name: str, lean: bool = False) -> tuple[dict[str, Any], Runs, Runs]:
    """XY circles at two feeds, both ways, about two centres (about one if `lean`), by ball bar or grid encoder."""
    machine = _new_machine(rng, name, "planar", "XY")
    slow = float(np.round(rng.uniform(600.0, 1200.0)))
    feeds = [slow, float(np.round(slow * rng.uniform(2.0, 3.5)))]
    centres = [(0.0, 0.0, 80.0)] + (
        [] if lean else [(float(rng.choice([-70.0, 70.0])), float(rng.choice([-50.0, 50.0])), 80.0)]
    )
    common = {
        "noise_um": round(rng.uniform(0.2, 0.5), 2), "dt": 0.03, "sweep_deg": 450.0,
        "instrument": "grid_encoder" if rng.random() < 0.25 else "ball_bar",
    }  # fmt: skip
    fit, start = [], 0.0
    for feed in feeds:
        for way in (1, -1):
            for k, centre in enumerate(centres):
                label = f"f{feed:.0f}-{'ccw' if way > 0 else 'cw'}-{k + 1}"
                fit.append(
                    plant.planar_circle(
                        machine, label, centre=centre, feed=feed, direction=way, start_s=start, **common
                    )
                )
                start += float(fit[-1]["t_s"][-1]) + 30.0
    check = plant.planar_circle(
        machine,
        "check",
        centre=(-40.0, 30.0, 80.0),
        radius=80.0,
        feed=float(np.round(slow * 1.7)),
        start_s=start,
        **common,
    )
    return machine, fit, [check]


def synchronous_circles(rng: Random, name: str, lean: bool = False) -> tuple[dict[str, Any], Runs, Runs]:
    """X and C together on circles about two places, two feeds, both ways about one of them (one feed if `lean`)."""
    machine = _new_machine(rng, name, "xc", "XC")
    slow = float(np.round(rng.uniform(600.0, 1000.0)))
    feeds = [slow] if lean else [slow, float(np.round(slow * rng.uniform(1.6, 2.2)))]
    common = {"noise_um": round(rng.uniform(0.2, 0.5), 2), "dt": 0.02}
    fit, start = [], 0.0
    for x_t, word in ((45.0, "near"), (55.0, "far")):
        for feed in feeds:
            for way in (1, -1) if word == "far" else (1,):
                label = f"{word}-f{feed:.0f}-{'ccw' if way > 0 else 'cw'}"
                fit.append(
                    plant.synchronous_circle(machine, label, x_t=x_t, feed=feed, direction=way, start_s=start, **common)
                )
                start += float(fit[-1]["t_s"][-1]) + 30.0
    check = plant.synchronous_circle(
        machine, "check", x_t=46.75, radius=55.0, feed=float(np.round(slow * 1.3)), start_s=start, **common
    )
    return machine, fit, [check]


KINDS: dict[str, tuple[Callable[..., tuple[dict[str, Any], Runs, Runs]], tuple[str, ...], float]] = {
    "r_test": (r_test_grids, FIVE_AXIS, 0.35),
    "static_bar": (static_bars, FIVE_AXIS, 0.15),
    "planar": (planar_circles, PLANAR, 0.25),
    "xc": (synchronous_circles, TURNING, 0.25),
}
"""Kind of test: how it is made, on which machines, and its share of the cases."""


def draw_setting(rng: Random, kinds: tuple[str, ...] = tuple(KINDS), lean: bool = False) -> Setting:
    """A random machine with random tests and noise; drawn again until every command is within travel."""
    weights = np.array([KINDS[k][2] for k in kinds])
    while True:
        kind = str(rng.choice(kinds, p=weights / weights.sum()))
        make, topologies, _ = KINDS[kind]
        topology = str(rng.choice(topologies))
        machine, fit, heldout = make(rng, topology, lean)
        if all(_within(machine, run) for run in fit + heldout):
            break
    location, motions = draw_truth(rng, machine["errors"])
    white = float(fit[0]["noise_um"])
    noise = draw_noise(rng, white, fit[0]["sampling"] == "dynamic")
    return Setting(kind, topology, machine, fit, heldout, noise, location, motions)


def _within(machine: dict[str, Any], run: dict[str, Any]) -> bool:
    return all(np.abs(q).max() <= machine["axes"][a]["travel"][1] for a, q in run["command"].items())
