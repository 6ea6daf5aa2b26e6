"""Recordings, campaigns and moments that tests of the posterior share."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from symfive.campaign import Campaign
from symfive.importers import polar_run
from symfive.machine import preset

NOISE = 0.3
CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"


def trace(angle_deg: np.ndarray, sense: float, plays: Mapping[str, float], soft: float, seed: int) -> np.ndarray:
    """Radial deviation, µm, of a circle of 150 mm: squareness 30 µrad, scale mismatch 20 ppm, a centre offset, and each axis
    behind by half its play with the sign of its velocity, at once or in proportion to `soft` µm of way."""
    t, radius = np.radians(angle_deg), 150e3
    found = radius * (30e-6 * np.sin(t) * np.cos(t) + 10e-6 * np.cos(2 * t)) + 3.0 * np.cos(t) - 2.0 * np.sin(t)
    for axis, width in plays.items():
        along, speed = (np.cos(t), -sense * np.sin(t)) if axis == "X" else (np.sin(t), sense * np.cos(t))
        side = np.where(speed >= 0.0, 1.0, -1.0)
        if soft:
            for turn in np.flatnonzero(np.diff(side)):
                later = np.arange(len(t)) > turn
                way = np.abs(along - along[turn + 1]) * radius
                near = later & (way < soft) & (np.arange(len(t)) < turn + len(t) // 4)
                side[near] = side[turn + 1] * (2.0 * way[near] / soft - 1.0)
        found -= 0.5 * width * side * along
    return found + NOISE * np.random.default_rng(seed).normal(size=len(t))


def bars(plays: Mapping[str, float], soft: float = 0.0, machine: str = "three-axis", angles: int = 900) -> Campaign:
    """Two circles, there and back, as a ball bar's software exports them."""
    found, runs, up = preset(machine), [], np.arange(angles) * (360.0 / angles)
    for seed, (name, sense) in enumerate((("ccw", 1.0), ("cw", -1.0))):
        angle = up if sense > 0.0 else up[::-1]
        deviation = trace(angle, sense, plays, soft, seed)
        height = 0.0 if machine == "three-axis" else 200.0
        runs.append(
            polar_run(
                found, angle, deviation, centre=(0.0, 0.0, height), radius=150.0, feed=1000.0, id=name, noise_um=NOISE
            )
        )
    return Campaign(machine=found, runs=tuple(runs))
