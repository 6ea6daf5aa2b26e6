"""Programmes of R-tests, the joints that were recorded at their poses, and poses that no plan has visited."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Run
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.nc import Post, program, top_of
from symfive.procedures import Nominal

from .configuration import TCP_OFF, tcp_on
from .controller import Recording

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
DWELL_S = 0.25
SETUPS, TRIES = 200, 100
"""Set-ups drawn until one has room for all poses, and poses drawn in each."""
HALF_TURN_DEG = 180.0
WAY_POINTS = 24
"""Points of the way between two poses that must be within the travels."""
INSIDE = 0.9
"""Share of every travel, and of the workspace, that held-out poses may use."""


def programme(machine: Machine, run: Run, post: Post) -> str:
    """The run as a LinuxCNC programme under tool-centre point control. The control's machine coordinates are those of the
    machine file."""
    own = replace(
        post, tool_centre_on=tcp_on(-run.tool_ball[2]), tool_centre_off=TCP_OFF, dwell_s=DWELL_S, machine_top=top_of(machine)
    )  # fmt: skip
    return program(machine, run, "linuxcnc", own)


def pose_lines(text: str) -> list[int]:
    """Line numbers, from 1, of the blocks that end at a pose: the last motion before each dwell. A block that says again where
    the axes stand (a pose visited twice in succession) moves nothing, and the control passes over it."""
    found, last, place = [], 0, ""
    for number, line in enumerate(text.splitlines(), start=1):
        if line.startswith("G1 "):
            words = line.split(" F")[0]
            last, place = (last if words == place else number), words
        elif line.startswith("G0 "):
            place = ""
        elif line.startswith("G4 "):
            found.append(last)
    return found


def joints_at_poses(text: str, recording: Recording) -> dict[str, Array]:
    """Joints at rest at every pose of a programme, letter → (rows,). Raises `InputError` where a pose was not reached."""
    rest = []
    for number in pose_lines(text):
        during = np.flatnonzero(recording.line == number)
        if not during.size:
            raise InputError(f"the control never ran line {number} of the programme", remedy="look at its recording")
        after = np.flatnonzero(recording.line[during[-1] + 1 :] != 0)
        end = during[-1] + 1 + (int(after[0]) if after.size else recording.line.size - during[-1] - 1)
        rest.append(slice((during[-1] + end) // 2, end))
    found = {}
    for letter, values in recording.joints.items():
        windows = [values[window] for window in rest]
        if any(w.size == 0 or np.ptp(w) > 0.0 for w in windows):
            raise InputError(f"axis {letter} did not come to rest in a dwell", remedy="make the dwell longer")
        found[letter] = np.array([w[-1] for w in windows])
    return found


def plant_run(run: Run, joints: Mapping[str, Array]) -> dict[str, Any]:
    """The run as the plant takes it, at positions that the joints had (mm, degree)."""
    sigma = run.setup_sigma_um
    return {
        "id": run.id, "file": run.file, "instrument": run.instrument[0], "sampling": run.sampling,
        "start_s": run.start_s, "table_ball": list(run.table_ball), "tool_ball": list(run.tool_ball),
        "noise_um": run.noise(run.instrument[0]), "t_s": run.time, "command": dict(joints),
        "setup_sigma_um": {"table_ball": sigma.table_ball, "tool_ball": sigma.tool_ball},
    }  # fmt: skip


def held_out_run(machine: Machine, like: Run, *, poses: int, seed: int) -> Run:
    """An R-test at random poses of the rotary axes with the nest and the tool elsewhere. Raises `InputError` if none fit."""
    rng = np.random.default_rng(seed)
    nominal = Nominal(machine)
    rotary = {name: axis for name, axis in machine.axes.items() if axis.rotary}
    for _ in range(SETUPS):
        nest, tool = _drawn_setup(machine, like, rng)
        drawn = {name: _drawn(axis.travel, rng) for name, axis in rotary.items()}
        reached = np.flatnonzero(_inside(machine, nominal, drawn, nest, tool))
        chosen: list[int] = []
        for i in reached:
            if not chosen or _clear_way(machine, nominal, drawn, (chosen[-1], int(i)), nest, tool):
                chosen.append(int(i))
            if len(chosen) == poses:
                fixed = {name: angles[chosen] for name, angles in drawn.items()}
                pace = float(np.median(np.diff(like.time)))
                return replace(
                    like, id="held-out", file="held-out.csv", table_ball=nest, tool_ball=tool, readings={}, start_s=0.0,
                    time=pace * np.arange(poses, dtype=float),
                    commands=nominal.follow(np.tile(nest, (poses, 1)), tool, fixed, "the held-out run"),
                )  # fmt: skip
    raise InputError("no other poses fit into the travels", remedy="ask for fewer held-out poses")


def _drawn(travel: tuple[float, float], rng: np.random.Generator) -> Array:
    """Angles within the travel, or within one turn, degree."""
    return INSIDE * rng.uniform(max(travel[0], -HALF_TURN_DEG), min(travel[1], HALF_TURN_DEG), TRIES)


def _drawn_setup(machine: Machine, like: Run, rng: np.random.Generator) -> tuple[Vector, Vector]:
    """Nest and tool ball, mm, within the workspace; where the machine file does not bound one, as in the other run."""
    space = machine.workspace
    heights = space.ball_height or (like.table_ball[2], like.table_ball[2])
    lengths = space.tool_length or (-like.tool_ball[2], -like.tool_ball[2])
    angle, radius = rng.uniform(0.0, 2.0 * np.pi), INSIDE * (space.table_radius or 0.0) * np.sqrt(rng.uniform())
    x, y = machine.table_centre
    nest = (x + radius * float(np.cos(angle)), y + radius * float(np.sin(angle)), float(rng.uniform(*heights)))
    return nest, (0.0, 0.0, -float(rng.uniform(*lengths)))


def _inside(
    machine: Machine, nominal: Nominal, rotary: Mapping[str, Array], nest: Vector, tool: Vector
) -> NDArray[np.bool_]:
    """Which poses, with the tool ball in the nest, are within the travels of all axes."""
    rows = len(next(iter(rotary.values()), np.zeros(1)))
    commands = nominal.follow(np.tile(nest, (rows, 1)), tool, rotary, "the held-out run")
    within = [(commands[n] >= a.travel[0]) & (commands[n] <= a.travel[1]) for n, a in machine.axes.items()]
    return np.asarray(np.all(within, axis=0))


def _clear_way(
    machine: Machine, nominal: Nominal, rotary: Mapping[str, Array], ends: tuple[int, int], nest: Vector, tool: Vector
) -> bool:
    """Whether all axes stay within their travels while the rotary ones go straight and the tool stays in the nest."""
    share = np.linspace(0.0, 1.0, WAY_POINTS)
    way = {name: angles[ends[0]] + share * (angles[ends[1]] - angles[ends[0]]) for name, angles in rotary.items()}
    return bool(_inside(machine, nominal, way, nest, tool).all())
