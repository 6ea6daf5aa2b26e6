"""From a design to runs: order, return poses, repeats, time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run
from symfive.design._criteria import Volume
from symfive.design._information import Task, inverse
from symfive.design._order import kept_apart, move_times, out_and_back, round_trip, there_and_back
from symfive.design._refine import Rows
from symfive.design._space import Space
from symfive.machine import Machine
from symfive.nc import Post, arrival_times, cycle_seconds, outside_s

__all__ = ["SETUP_S", "Schedule", "on_ways", "retimed", "scheduled"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
SETUP_S = 300.0
"""Time to place a nest or a ball and to mount the tool, before each run."""
UNSAFE_S = 60.0
"""What a move on which the spindle has to be drawn back (or the bar taken off) costs while the order is sought."""
DRIFT_UM_PER_H = 30.0
BETWEEN = np.linspace(0.0, 1.0, 37)[1:-1]
DENSELY = np.linspace(0.0, 1.0, 361)[1:-1]
MANY = 60
"""Poses in one run beyond which the ways between all pairs are looked at less closely; those taken always are."""


@dataclass(frozen=True)
class Schedule:
    """The runs of a plan: `campaign`, its `seconds` with set-up, `unsafe` run → rows reached only with the spindle drawn
    back, `drift` the efficiency left when a linear drift is a nuisance, `rows` the design."""

    campaign: Campaign
    seconds: float
    unsafe: dict[str, tuple[int, ...]]
    drift: float
    rows: Rows


def scheduled(
    space: Space, rows: Rows, *, returns: int, repeats: int, noise_um: float, index: bool = False
) -> Schedule:  # fmt: skip
    """Both orders (round trip; there and back) are laid out and the one with more information per minute is taken; `index`: the
    first pose of every run is read once more with the spindle turned by 180°."""
    plans = [
        _laid_out(space, rows, order, returns, repeats, noise_um, index) for order in (lambda o: o, there_and_back)
    ]
    # ψ of D per parameter falls by log(time) when twice the time is spent on readings, so time and efficiency compare
    return max(plans, key=lambda p: math.log(max(p.drift, 1e-9)) - math.log(p.seconds))


def _laid_out(
    space: Space, rows: Rows, ordering: Callable[[Indices], Indices], returns: int, repeats: int, noise_um: float,
    index: bool,
) -> Schedule:  # fmt: skip
    runs: list[Run] = []
    unsafe: dict[str, tuple[int, ...]] = {}
    clock = 0.0
    instants, places = [], []
    letter = {"r_test": "nest", "touch_probe": "sphere"}.get(space.instrument, "bar")
    for g in range(rows.groups):
        mine = np.flatnonzero(rows.group == g)
        commands = space.commands(rows.z[mine], rows.k[mine])
        times = move_times(space.machine, commands) + UNSAFE_S * _blocked(space, rows, mine)
        _, pose = np.unique(np.stack(list(commands.values()), axis=1), axis=0, return_inverse=True)
        order = kept_apart(out_and_back(ordering(round_trip(times)), returns), pose.ravel(), times)
        order = np.repeat(order, repeats)
        turned = np.zeros(len(order) + index)
        if index:
            order, turned[1] = np.insert(order, 1, order[0]), 180.0
        commands = {name: values[order] for name, values in commands.items()}
        leaves = _leaves(space, rows, mine[order[:-1]], mine[order[1:]], DENSELY)
        leaves |= space.instrument == "touch_probe"  # a tip cannot follow a sphere: it goes out and around
        rows_unsafe = tuple(int(i) + 1 for i in np.flatnonzero(leaves & (order[:-1] != order[1:])))
        name = f"{letter}-{g + 1}"
        first = mine[0]
        run = Run(
            id=name, instrument=(space.instrument,), sampling="static", time=np.arange(len(order), dtype=float),
            commands=commands, table_ball=space.table_ball(rows.z[first]),
            tool_ball=space.tool_ball(rows.z[first]),
            length=float(rows.k[first, 0]) if space.instrument == "ball_bar" else None,
            noise_um=noise_um, setup_sigma_um=space.setup_sigma, spindle=turned if index else None,
        )  # fmt: skip
        if rows_unsafe:
            unsafe[name] = rows_unsafe
        run, clock = _timed(space.machine, run, Post(unsafe=unsafe), clock)
        runs.append(run)
        straight = turned == 0.0
        instants.append((run.start_s + run.time)[straight])
        places.append(mine[order][straight])
    campaign = Campaign(machine=space.machine, runs=tuple(runs), name="plan")
    drift = _drift(space, rows, np.concatenate(places), np.concatenate(instants), repeats)
    return Schedule(campaign, clock, unsafe, drift, rows)


def retimed(schedule: Schedule, post: Post) -> Schedule:
    """The schedule with the times that its programs need on the ways of `post`."""
    campaign, seconds = on_ways(schedule.campaign, post)
    return replace(
        schedule, campaign=campaign, seconds=seconds, unsafe={run: tuple(rows) for run, rows in post.unsafe.items()}
    )


def on_ways(campaign: Campaign, post: Post) -> tuple[Campaign, float]:
    """A campaign of static runs with the times that its programs need on the ways of `post`, and how long it takes, s."""
    clock, runs = 0.0, []
    for run in campaign.runs:
        timed, clock = _timed(campaign.machine, run, post, clock)
        runs.append(timed)
    return replace(campaign, runs=tuple(runs)), clock


def _timed(machine: Machine, run: Run, post: Post, clock: float) -> tuple[Run, float]:
    """A run that is set up from `clock` on, at the times of its program, and when it is done, s."""
    rest = cycle_seconds(run) if "touch_probe" in run.instrument else 0.0
    time = arrival_times(machine, run, post, machine.workspace.seconds_per_pose, rest)
    around = math.ceil(outside_s(machine, run, post))
    start = clock + SETUP_S + around
    return replace(run, time=time, start_s=start), start + float(time[-1])


def _blocked(space: Space, rows: Rows, mine: Indices) -> Array:
    """1 where the way between two poses leaves the limits (n, n)."""
    n = len(mine)
    first, second = np.meshgrid(mine, mine, indexing="ij")
    shares = BETWEEN if n <= MANY else BETWEEN[2::5]
    return _leaves(space, rows, first.ravel(), second.ravel(), shares).reshape(n, n).astype(float)


def _leaves(space: Space, rows: Rows, first: Indices, second: Indices, shares: Array) -> NDArray[np.bool_]:
    """Whether the way from one row to another leaves the limits: rotary axes straight, the ball in its nest or the bar on
    the shorter arc, as the program drives."""
    a, b = rows.z[first], rows.z[second]
    bad = np.zeros(len(first), dtype=bool)
    for share in shares:
        z = a + share * (b - a)
        if space.instrument == "ball_bar":
            z[:, space.poses - 2 : space.poses] = _angles(_on_arc(_bars(space, a), _bars(space, b), float(share)))
        bad |= np.any(space.kernel.limits(z, rows.k[first]) < -1e-6, axis=1)
    return bad


def _on_arc(a: Array, b: Array, share: float) -> Array:
    """Unit vectors (n, 3) at a share of the shorter arc from a to b."""
    across = b - np.sum(a * b, axis=1, keepdims=True) * a
    size = np.linalg.norm(across, axis=1, keepdims=True)
    upright = np.where(np.abs(a[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    other = np.cross(a, upright)
    across = np.where(
        size < 1e-12, other / np.linalg.norm(other, axis=1, keepdims=True), across / np.maximum(size, 1e-12)
    )
    angle = share * np.arctan2(size, np.sum(a * b, axis=1, keepdims=True))
    return np.asarray(np.cos(angle) * a + np.sin(angle) * across)


def _angles(bars: Array) -> Array:
    """Azimuth and elevation (n, 2) of unit vectors."""
    return np.stack([np.arctan2(bars[:, 1], bars[:, 0]), np.arcsin(np.clip(bars[:, 2], -1.0, 1.0))], axis=1)


def _drift(space: Space, rows: Rows, visited: Indices, instants: Array, repeats: int) -> float:
    """Efficiency (D, all machine parameters) left when a linear drift of the tool in the workpiece frame is a nuisance."""
    everything = np.arange(len(space.shared))
    z, k, group = rows.z[visited], rows.k[visited], rows.group[visited]
    sensitivities = space.kernel.rows(z, k) / math.sqrt(repeats)
    task = Task(Volume(), np.eye(len(everything)), space.own_sigma, everything)
    plain = task.information(sensitivities, group, rows.groups)
    hours = (instants - instants.mean()) / 3600.0
    directions = _bars(space, z)[:, :, None] if space.instrument == "ball_bar" else np.eye(3)[None, :, :]
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
