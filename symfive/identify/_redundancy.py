"""Which errors of a topology are redundant, found by the null space of the exact Jacobian."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from symfive.campaign import Campaign, Run, SetupSigma
from symfive.given import machine_given
from symfive.inference import Confounding, Problem, confounded_combinations
from symfive.machine import ErrorTerm, Machine
from symfive.model import Model

NOISE_UM = 1e-3
LARGE_SIGMA = 1e3


def all_location_errors(machine: Machine, sigma: float = LARGE_SIGMA) -> dict[str, ErrorTerm]:
    """Every location error that ISO 230-1 gives the machine's axes: six for a rotary one, three tilts for a linear one."""
    terms = {}
    for name in machine.axis_names:
        for letter in "XYZABC" if machine.axes[name].rotary else "ABC":
            terms[f"E{letter}0{name}"] = ErrorTerm(name=f"E{letter}0{name}", sigma=sigma)
    return terms


def redundancies(machine: Machine | Path | str, *, poses: int = 400, seed: int = 0) -> tuple[Confounding, ...]:
    """Combinations of the machine's errors that no measurement of tool against workpiece can determine.

    The position of two tool balls in the workpiece frame is differentiated with respect to `machine.errors` (or, if it
    has none, all location errors) at `poses` random poses over the travel, with set-up and zeros known exactly
    and a noise of 1 nm. Combinations that the readings leave undetermined are redundant. (For location errors see also
    R. J. Hocken, ISO 230-1 annex A: a machine with 5 axes has 8 independent ones beside the squarenesses.)
    """
    machine = machine_given(machine)
    if not machine.errors:
        machine = replace(machine, errors=all_location_errors(machine))
    generator = np.random.default_rng(seed)
    commands = {}
    for axis in machine.axes.values():
        low, high = axis.travel
        if axis.rotary:
            low, high = max(low, -360.0), min(high, 360.0)
        commands[axis.name] = generator.uniform(low, high, poses)
    exact = SetupSigma(table_ball=0.0, tool_ball=0.0, length=0.0)
    runs = tuple(
        Run(
            id=f"ball-{i}", instrument=("tracker",), sampling="static", time=np.arange(poses, dtype=float), commands=commands,
            tool_ball=ball, noise_um=NOISE_UM * 1e-3, setup_sigma_um=exact,
            options={"placement_sigma": (1e-9, 1e-9)}, mounting={"placement": "exact"},
        )
        for i, ball in enumerate([(0.0, 0.0, -100.0), (60.0, 0.0, -150.0), (0.0, 50.0, -250.0)])
    )  # fmt: skip
    model = Model(Campaign(machine=machine, runs=runs))
    problem = Problem.of(model)
    information = problem.information(problem.blocks(model.start, readings=False))
    found = confounded_combinations(information.matrix, model.parameters)
    return tuple(c for c in found if c.of_machine)
