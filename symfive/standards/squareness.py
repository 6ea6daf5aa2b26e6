"""Squareness of the linear axes (ISO 230-1) from identified location errors.

The directions of travel are d_j = R0_j e_j with R0_j = Rx(EA0j) Ry(EB0j) Rz(EC0j). S of axis k to axis j, nominally
perpendicular, is the angle between the positive axes less 90°: S = -d_j·d_k to first order. In contrast to the squareness of
one circle it holds for the whole workspace, as far as the model holds; U comes from the joint covariance.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from symfive.identify import Identification
from symfive.machine import Machine
from symfive.standards._value import COVERAGE, StandardValue

STANDARD = "ISO 230-1"
ACROSS = 1e-6
"""Nominal directions whose cosine is larger are not perpendicular."""


def squareness_values(identification: Identification) -> tuple[StandardValue, ...]:
    """Squareness, µm/m, of each pair of perpendicular linear axes of which a tilt was identified."""
    machine = identification.model.machine
    values = []
    for first, second in combinations(sorted(machine.linear_axes), 2):
        nominal = np.asarray(machine.axes[first].direction) @ np.asarray(machine.axes[second].direction)
        slopes = _slopes(machine, first, second)
        where = [i for i, p in enumerate(identification.parameters) if p.name in slopes]
        if abs(nominal) > ACROSS or not where:
            continue
        weights = np.array([slopes[identification.parameters[i].name] for i in where])
        variance = float(weights @ identification.covariance[np.ix_(where, where)] @ weights)
        values.append(StandardValue(
            standard=STANDARD, name=f"squareness {second} to {first}", what="(identified)",
            value=float(weights @ identification.values[where]), u=COVERAGE * float(np.sqrt(max(variance, 0.0))), unit="um/m",
            runs=tuple(run.id for run in identification.model.campaign.runs),
            conditions={"sign": f"+{first} to +{second} is 90° + value", "reference lines": "location errors of the model"},
        ))  # fmt: skip
    return tuple(values)


def _slopes(machine: Machine, first: str, second: str) -> dict[str, float]:
    """Location error → change of S per µrad: a tilt t of axis j turns d_j by t × d_j."""
    e = {name: np.asarray(machine.axes[name].direction, dtype=float) for name in (first, second)}
    slopes = {}
    for name, other in ((first, second), (second, first)):
        for k, letter in enumerate("ABC"):
            slope = -float(np.cross(np.eye(3)[k], e[name]) @ e[other])
            if abs(slope) > ACROSS:
                slopes[f"E{letter}0{name}"] = slope
    return slopes
