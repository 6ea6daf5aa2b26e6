"""From a design to runs: order, return poses, repeats, time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run
from symfive.design._criteria import Volume
from symfive.design._information import Task, inverse
from symfive.design._order import move_times, out_and_back, round_trip, there_and_back, timetable
from symfive.design._refine import Rows
from symfive.design._space import Space
from symfive.errors import InputError

__all__ = ["SETUP_S", "Schedule", "scheduled", "shortened"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
SETUP_S = 300.0
"""Time to place a nest or a ball and to mount the tool, before each run."""
UNSAFE_S = 60.0
"""What a move costs on which the spindle has to be drawn back (or the bar taken off)."""
DRIFT_UM_PER_H = 30.0
BETWEEN = np.linspace(0.125, 0.875, 7)


@dataclass(frozen=True)
class Schedule:
    """The runs of a plan: `campaign`, its `seconds` with set-up, `unsafe` run → rows reached only with the spindle drawn
    back, `drift` the efficiency left when a linear drift is a nuisance, `rows` the design."""

    campaign: Campaign
    seconds: float
    unsafe: dict[str, tuple[int, ...]]
    drift: float
    rows: Rows


def scheduled(space: Space, rows: Rows, *, returns: int, repeats: int, noise_um: float) -> Schedule:
    """Both orders (round trip; there and back) are laid out and the one with more information per minute is taken."""
    plans = [_laid_out(space, rows, order, returns, repeats, noise_um) for order in (lambda o: o, there_and_back)]
    # ψ of D per parameter falls by log(time) when twice the time is spent on readings, so time and efficiency compare
    return max(plans, key=lambda p: math.log(max(p.drift, 1e-9)) - math.log(p.seconds))


def _laid_out(
    space: Space, rows: Rows, ordering: Callable[[Indices], Indices], returns: int, repeats: int, noise_um: float
) -> Schedule:
    runs: list[Run] = []
    unsafe: dict[str, tuple[int, ...]] = {}
    clock = 0.0
    instants, places = [], []
    letter = "nest" if space.instrument == "r_test" else "bar"
    for g in range(rows.groups):
        mine = np.flatnonzero(rows.group == g)
        commands = space.commands(rows.z[mine], rows.k[mine])
        times = move_times(space.machine, commands) + UNSAFE_S * _blocked(space, rows, mine)
        order = np.repeat(out_and_back(ordering(round_trip(times)), returns), repeats)
        commands = {name: np.round(values[order], 6) for name, values in commands.items()}
        blocked = _blocked(space, rows, mine)
        rows_unsafe = tuple(int(i) + 1 for i in np.flatnonzero(blocked[order[:-1], order[1:]]))
        time = timetable(space.machine, commands, space.machine.workspace.seconds_per_pose)
        time = time + np.concatenate(
            [[0.0], np.cumsum([UNSAFE_S * (i + 1 in rows_unsafe) for i in range(len(order) - 1)])]
        )
        name = f"{letter}-{g + 1}"
        clock += SETUP_S
        first = mine[0]
        runs.append(
            Run(
                id=name, instrument=(space.instrument,), sampling="static", time=time, commands=commands,
                table_ball=_clean(space.table_ball(rows.z[first])), tool_ball=_clean(space.tool_ball(rows.z[first])),
                length=float(rows.k[first, 0]) if space.instrument == "ball_bar" else None, start_s=clock,
                noise_um=noise_um, setup_sigma_um=space.setup_sigma,
            )
        )  # fmt: skip
        if rows_unsafe:
            unsafe[name] = rows_unsafe
        instants.append(clock + time)
        places.append(mine[order])
        clock += float(time[-1])
    campaign = Campaign(machine=space.machine, runs=tuple(runs), name="plan")
    drift = _drift(space, rows, np.concatenate(places), np.concatenate(instants), repeats)
    return Schedule(campaign, clock, unsafe, drift, rows)


def _clean(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    return tuple(round(v, 6) + 0.0 for v in vector)  # type: ignore[return-value]


def _blocked(space: Space, rows: Rows, mine: Indices) -> Array:
    """1 where the straight way between two poses leaves the limits (n, n)."""
    n = len(mine)
    first, second = np.meshgrid(mine, mine, indexing="ij")
    a, b = rows.z[first.ravel()], rows.z[second.ravel()]
    bad = np.zeros(n * n, dtype=bool)
    for share in BETWEEN:
        bad |= np.any(space.kernel.limits(a + share * (b - a), rows.k[first.ravel()]) < -1e-6, axis=1)
    return bad.reshape(n, n).astype(float)


def _drift(space: Space, rows: Rows, visited: Indices, instants: Array, repeats: int) -> float:
    """Efficiency (D, all machine parameters) left when a linear drift of the tool in the workpiece frame is a nuisance."""
    everything = np.arange(len(space.shared))
    z, k, group = rows.z[visited], rows.k[visited], rows.group[visited]
    sensitivities = space.kernel.rows(z, k) / math.sqrt(repeats)
    task = Task(Volume(), np.eye(len(everything)), space.own_sigma, everything)
    plain = task.information(sensitivities, group, rows.groups)
    hours = (instants - instants.mean()) / 3600.0
    directions = np.eye(3)[None, :, :] if space.instrument == "r_test" else _bars(space, z)[:, :, None]
    rate = DRIFT_UM_PER_H / (space.noise_um * math.sqrt(repeats)) * hours[:, None, None] * directions
    whole = task.layout(rows.groups).embed(sensitivities, group)
    cross = np.einsum("npy,ndy->pd", whole, np.broadcast_to(rate, (len(z), 3, whole.shape[2])))
    own = np.einsum("ndy,ney->de", rate, rate) + np.eye(3)
    drifting = plain - cross @ inverse(own) @ cross.T
    return math.exp(task.value(plain) - task.value(drifting))


def _bars(space: Space, z: Array) -> Array:
    azimuth, elevation = z[:, space.poses - 2], z[:, space.poses - 1]
    return np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )


def shortened(
    space: Space,
    task: Task,
    rows: Rows,
    schedule: Schedule,
    seconds: float,
    returns: int,
    repeats: int,
    noise_um: float,
) -> Schedule:
    """The schedule with the poses that tell least left out until it fits. Raises `InputError` where it cannot."""
    while schedule.seconds > seconds:
        excess = (schedule.seconds - seconds) / max(schedule.seconds - rows.groups * SETUP_S, 1.0)
        drop = max(1, int(0.8 * excess * len(rows.z)))
        if len(rows.z) - drop < 2:
            least = math.ceil(schedule.seconds / 60.0)
            raise InputError(
                f"the plan does not fit into {seconds / 60.0:g} minutes", remedy=f"give about {least} minutes"
            )
        for _ in range(drop):
            sensitivities = space.kernel.rows(rows.z, rows.k)
            whole = task.layout(rows.groups).embed(sensitivities, rows.group)
            information = task.information(sensitivities, rows.group, rows.groups)
            least_worth = int(np.argmin([task.value(information - row @ row.T) for row in whole]))
            kept = np.delete(np.arange(len(rows.z)), least_worth)
            rows = Rows.of(rows.z[kept], rows.k[kept], rows.group[kept], rows.poses)
        schedule = scheduled(space, rows, returns=returns, repeats=repeats, noise_um=noise_um)
    return schedule
