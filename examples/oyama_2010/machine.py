"""The machine of the paper, what is concealed in it, and its recordings, which the independent plant writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import plant
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run, SetupSigma, read_campaign
from symfive.machine import Machine, machine_to_data, preset
from symfive.procedures import campaign_of, r_test_grid

Array = NDArray[np.float64]
Motion = Callable[[Array], Array]

INTERSECTION = (0.0, 0.0, -50.0)
"""Where B and C meet, mm: the origin of the paper's frames and the point all its errors refer to."""
NESTS = ((80.0, 0.0, 60.0), (80.0, 0.0, 160.0))
"""The sensors' two places, one above the other, mm in the workpiece frame of symfive (origin on the table top)."""
B_DEG = np.arange(-90.0, 91.0, 30.0)
C_DEG = np.arange(0.0, 360.0, 30.0)
NOISE_UM = 0.3
SETUP = SetupSigma(table_ball=0.0, tool_ball=0.0, length=0.0)
"""The paper takes the ball on the spindle's axis and the nest as known; the zero of each run stays unknown."""
MASTERED = {"table_ball": [0.0] * 3, "tool_ball": [0.0] * 3}


@dataclass(frozen=True)
class Concealed:
    """What is wrong with the machine, in the paper's signs: functions of B or C (degree, as the table turns), µm and µrad.

    `b` and `c`: component (`X` … `C`) → function; `effects` as the plant knows them.
    """

    b: Mapping[str, Motion] = field(default_factory=dict)
    c: Mapping[str, Motion] = field(default_factory=dict)
    effects: Sequence[Mapping[str, Any]] = ()

    def motions(self) -> dict[str, Motion]:
        """For the plant: ISO 230-1 name → function of the command, which counts the table's angle backwards."""
        return {
            f"E{letter}{axis}": partial(_backwards, function)
            for axis, functions in (("B", self.b), ("C", self.c))
            for letter, function in functions.items()
        }

    def values(self, axis: str, degrees: Array) -> Array:
        """The six true errors (N, 6) in µm and µrad."""
        functions = self.b if axis == "B" else self.c
        return np.stack([functions[k](degrees) if k in functions else np.zeros(len(degrees)) for k in "XYZABC"], axis=1)


def _backwards(function: Motion, command: Array) -> Array:
    return function(-command)


def _sin(degrees: Array) -> Array:
    return np.sin(np.radians(degrees))


def concealed(*, of_c: Mapping[str, Motion] | None = None) -> Concealed:
    """A machine of the size that the paper reports (its section 4), with B as measured there and C running out.

    dx_BY 4 µm on average with 10 µm at one end, dy_BY 6 µm, dz_BY -3 µm and -9 µm at ±90° (the table sinks), alpha_BY
    ±0.003° between the ends, gamma_BY alike, beta_BY next to nothing. The signs are lost in print and chosen here.
    """
    bump = 10.0 * np.exp(-(((B_DEG - 90.0) / 20.0) ** 2))
    base = 4.0 - float(bump.mean())
    return Concealed(
        b={
            "X": lambda b: base + 10.0 * np.exp(-(((b - 90.0) / 20.0) ** 2)),
            "Y": lambda b: 6.0 + 1.5 * _sin(b),
            "Z": lambda b: -3.0 - 6.0 * (1.0 - np.cos(np.radians(b))),
            "A": lambda b: 1e6 * np.radians(3e-3) * b / 90.0,
            "B": lambda b: 2.0 * _sin(2.0 * b),
            "C": lambda b: -1e6 * np.radians(2.5e-3) * b / 90.0,
        },
        c=of_c
        if of_c is not None
        else {
            "X": lambda c: 1.5 * _sin(2.0 * c),
            "Y": lambda c: 1.5 * (np.cos(np.radians(2.0 * c)) - np.cos(np.radians(3.0 * c))),
            "Z": lambda c: 1.0 * _sin(2.0 * c),
            "A": lambda c: 6.0 * _sin(3.0 * c),
            "B": lambda c: -4.0 * _sin(3.0 * c),
        },
    )


def paper_machine(*, baseline: str = "location") -> Machine:
    """The preset with every tilt of C referred to the intersection; `baseline`: `location` errors only, or the `whole` file."""
    whole = preset("oyama-2010")
    machine = replace(whole, axes={**whole.axes, "C": replace(whole.axes["C"], origin=INTERSECTION)})
    if baseline == "whole":
        return machine
    return replace(machine, errors={t.name: t for t in machine.location_errors})


def nests_of_the_paper(nests: Sequence[Sequence[float]] = NESTS) -> tuple[tuple[float, float, float], ...]:
    """w_p*: the nests from the intersection of the axes, mm."""
    places = np.asarray(nests, dtype=float) - INTERSECTION
    return tuple((float(x), float(y), float(z)) for x, y, z in places)


def grid_of(
    machine: Machine,
    *,
    nests: Sequence[Sequence[float]] = NESTS,
    b: Array = B_DEG,
    c: Array = C_DEG,
    returning: bool = False,
    setup: SetupSigma = SETUP,
) -> Campaign:
    """The paper's plan: all combinations of B and C in each nest, once through (`returning`: and backwards)."""
    grid = {"B": b.tolist(), "C": c.tolist()}
    runs = r_test_grid(machine, grid=grid, nests=nests, returning=returning, noise_um=NOISE_UM, setup_sigma_um=setup)
    return campaign_of(machine, runs, "oyama-2010")


def record(
    plan: Campaign, hidden: Concealed, folder: Path, *, seed: int = 2010, noise: bool = True, mastered: bool = True
) -> Campaign:
    """The plan measured by the plant and read back from its files.

    `mastered`: ball and nest stand where they should; else the plant draws their errors from the declared 1σ.
    """
    machine = dict(machine_to_data(plan.machine))
    options = plant.PLAIN if noise else plant.QUIET
    runs = [_spec(run, mastered) for run in plan.runs]
    plant.write_campaign(
        folder, machine, runs, None, hidden.motions(), hidden.effects, seed=seed, noise_options=options
    )
    return read_campaign(folder)


def _spec(run: Run, mastered: bool) -> dict[str, Any]:
    sigma = run.setup_sigma_um
    spec: dict[str, Any] = {
        "id": run.id, "file": run.file, "instrument": run.instrument[0], "sampling": run.sampling, "start_s": run.start_s,
        "table_ball": list(run.table_ball), "tool_ball": list(run.tool_ball), "noise_um": run.noise_um, "t_s": run.time,
        "command": dict(run.commands),
        "setup_sigma_um": {"table_ball": sigma.table_ball, "tool_ball": sigma.tool_ball, "length": sigma.length},
    }  # fmt: skip
    return spec | ({"setup_um": MASTERED} if mastered else {})


def displacements(campaign: Campaign, b: Array = B_DEG, c: Array = C_DEG) -> Array:
    """w_p (nests, len(b), len(c), 3) mm on the grid of the *table's* angles (degree), from the reading at B = C = 0.

    Poses visited more than once are averaged.
    """
    found = np.zeros((len(campaign.runs), len(b), len(c), 3))
    for k, run in enumerate(campaign.runs):
        i = np.argmin(np.abs(b[:, None] + run.commands["B"]), axis=0)
        j = np.argmin(np.abs((c[:, None] + run.commands["C"] + 180.0) % 360.0 - 180.0), axis=0)
        readings = 1e-3 * np.stack([run.readings[f"d{axis}_um"] for axis in "xyz"], axis=1)
        visits = np.zeros((len(b), len(c)))
        np.add.at(visits, (i, j), 1.0)
        np.add.at(found[k], (i, j), readings)
        found[k] /= visits[:, :, None]
        found[k] -= found[k, np.argmin(np.abs(b)), np.argmin(np.abs(c))]
    return found


def between(machine: Machine, nest: Sequence[float] = (-60.0, 70.0, 110.0)) -> Campaign:
    """A check: poses half-way between those of the map, with B = C = 0 as reference, in another place."""
    b = np.concatenate([[0.0], np.arange(-75.0, 76.0, 30.0)])
    c = np.concatenate([[0.0], np.arange(15.0, 360.0, 30.0)])
    return grid_of(machine, nests=[nest], b=b, c=c)
