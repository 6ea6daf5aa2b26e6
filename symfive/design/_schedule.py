"""From a design to runs: order, return poses, repeats, time; what fits into a time, and what is most informative per minute."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from symfive.arrays import Array, Indices
from symfive.campaign import Campaign, Run
from symfive.design._candidates import value_of
from symfive.design._seated import Clear, Seated, bars_of
from symfive.design._space import Space
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.motion import approach
from symfive.moves import kept_apart, out_and_back, round_trip, there_and_back
from symfive.nc import Positions, Post, Seat, Way, arrival_times, outside_s
from symfive.optimal import Rows, Task, Volume, inverse
from symfive.procedures import Nominal

SETUP_S = 300.0
"""Time to place a nest or a ball and to mount the tool, before each run."""
UNSAFE_S = 60.0
"""What a move on which the spindle has to be drawn back (or the bar removed) costs while the order is sought."""
DRIFT_UM_PER_H = 30.0
Lay = Callable[[Rows], "Schedule"]
SHARE = 0.1
"""Of the poses, taken out at a time."""


@dataclass(frozen=True)
class Schedule:
    """The runs of a plan: `campaign`, its `seconds` with set-up, `unsafe` run → rows reached only with the spindle drawn
    back, `via` run → row → the intermediate positions of a seated move that goes around something, `moves` what answers how else
    a run's rows are reached, `drift` the efficiency left when a linear drift is a nuisance, `rows` the design."""

    campaign: Campaign
    seconds: float
    unsafe: dict[str, tuple[int, ...]]
    via: dict[str, dict[int, Way]]
    moves: dict[str, RunMoves]
    drift: float
    rows: Rows


@dataclass(frozen=True)
class RunMoves:
    """Seated moves to the rows of a run, which visits the poses of `seated` in an `order`; `sides` (rows, R) from which its
    rotary axes come."""

    seated: Seated
    order: Indices
    sides: Array

    def via(self, row: int, clear: Clear | None = None) -> Way | None:
        """Intermediate positions on the way from the row before, () where it is straight, None where the ball has to leave."""
        return self.seated.via(int(self.order[row - 1]), int(self.order[row]), self.sides[row], clear)


@dataclass(frozen=True)
class Laid:
    """A run by itself: `run` starts when it is set up, `seconds` until it is done; its `moves`, the rows that lead `around` and
    the intermediate positions `via` to others."""

    run: Run
    seconds: float
    moves: RunMoves
    around: tuple[int, ...]
    via: dict[int, Way]


def scheduled(
    space: Space, rows: Rows, *, returns: int, repeats: int, noise_um: float, index: bool = False,
    known: dict[tuple[str, bytes], list[Laid]] | None = None,
) -> Schedule:  # fmt: skip
    """Every run is laid out in both orders (round trip; there and back); of the same order in all runs and of another one in
    each the most information per minute decides. `index`: the first pose of every run is read once more with the spindle turned
    by 180°; `known` keeps the runs that were laid out in the same way for other designs that have them."""
    known = {} if known is None else known
    nest = "nest" if space.options.get("frame", "workpiece") == "workpiece" else "head"
    letter = {"r_test": nest, "touch_probe": "sphere"}.get(space.instrument, "bar")
    runs = []
    for g in range(rows.groups):
        z, k = rows.z[rows.group == g], rows.k[rows.group == g]
        key = f"{letter}-{g + 1}", z.tobytes() + k.tobytes()
        if key not in known:
            seated, orders = Seated(space, z, k), (lambda order: order, there_and_back)
            known[key] = [_laid_out(seated, key[0], order, returns, repeats, noise_um, index) for order in orders]
        runs.append(known[key])

    @cache
    def joined(chosen: tuple[int, ...]) -> Schedule:
        return _joined(space, rows, [laid[order] for laid, order in zip(runs, chosen, strict=True)], repeats)

    def rate(chosen: tuple[int, ...]) -> float:
        # ψ of D per parameter falls by log(time) when twice the time is spent on readings, so time and efficiency compare
        return math.log(max(joined(chosen).drift, 1e-9)) - math.log(joined(chosen).seconds)

    best = max([(order,) * len(runs) for order in (0, 1)], key=rate)
    for g in range(len(runs)):
        best = max(best, (*best[:g], 1 - best[g], *best[g + 1 :]), key=rate)
    return joined(best)


def _laid_out(
    own: Seated, name: str, ordering: Callable[[Indices], Indices], returns: int, repeats: int, noise_um: float, index: bool
) -> Laid:  # fmt: skip
    """The run of one set-up's poses in an order."""
    space, z, k = own.space, own.z[0], own.k[0]
    order = np.repeat(_order(own, ordering, returns), repeats)
    turned = np.zeros(len(order) + index)
    if index:
        order, turned[1] = np.insert(order, 1, order[0]), 180.0
    run = Run(
        id=name, instrument=(space.instrument,), sampling="static", time=np.arange(len(order), dtype=float),
        commands={axis: values[order] for axis, values in own.commands.items()},
        table_ball=space.table_ball(z), tool_ball=space.tool_ball(z),
        length=float(k[0]) if space.bar else None,
        noise_um=noise_um, setup_sigma_um=space.setup_sigma, spindle=turned if index else None, options=space.options,
    )  # fmt: skip
    moves = RunMoves(own, order, _sides(space.machine, run))
    follows = _followed(space.machine, run, own.likely_moves(order, moves.sides), own.followed)
    ways = {i: moves.via(i, follows) for i in range(1, len(order)) if order[i] != order[i - 1]}
    around, via = tuple(i for i, way in ways.items() if way is None), {i: way for i, way in ways.items() if way}
    post = Post(unsafe={name: around} if around else {}, via={name: via} if via else {})
    return Laid(*_timed(space.machine, run, post, 0.0), moves, around, via)


def _joined(space: Space, rows: Rows, laid: Sequence[Laid], repeats: int) -> Schedule:
    """The runs of a design one after the other."""
    runs, clock, instants, places = list[Run](), 0.0, [], []
    for g, own in enumerate(laid):
        run = replace(own.run, start_s=clock + own.run.start_s)
        straight = np.ones(run.rows, dtype=bool) if run.spindle is None else run.spindle == 0.0
        instants.append((run.start_s + run.time)[straight])
        places.append(np.flatnonzero(rows.group == g)[own.moves.order][straight])
        runs.append(run)
        clock += own.seconds
    drift = _drift(space, rows, np.concatenate(places), np.concatenate(instants), repeats)
    unsafe, via = (
        {own.run.id: own.around for own in laid if own.around},
        {own.run.id: own.via for own in laid if own.via},
    )
    moves = {own.run.id: own.moves for own in laid}
    return Schedule(
        Campaign(machine=space.machine, runs=tuple(runs), name="plan"), clock, unsafe, via, moves, drift, rows
    )


def _followed(
    machine: Machine, run: Run, likely: Sequence[tuple[Positions, Positions]], known: dict[tuple[float, ...], bool]
) -> Clear:
    """Whether the linear axes can follow the ball all along straight seated moves of a run; `likely` moves are answered at once,
    `known` ones not again."""
    seat = Seat(machine, run, Nominal(machine))

    def follows(moves: Sequence[tuple[Positions, Positions]]) -> list[bool]:
        keys = [(*before.values(), *after.values()) for before, after in moves]
        fresh = {key: move for key, move in zip(keys, moves, strict=True) if key not in known}
        known.update({key: path is not None for key, path in zip(fresh, seat.paths([*fresh.values()]), strict=True)})
        return [known[key] for key in keys]

    follows(likely)
    return follows


def _sides(machine: Machine, run: Run) -> Array:
    """From which side each rotary axis comes to the rows of a run (rows, R): -1 or 1, 0 of one that never turns."""
    found = [approach(q) for name, q in run.commands.items() if machine.axes[name].rotary]
    return np.stack(found, axis=1) if found else np.zeros((run.rows, 0))


def _order(seated: Seated, ordering: Callable[[Indices], Indices], returns: int) -> Indices:
    """The poses of a set-up in the order of the run, return poses included."""
    times = np.where(np.isfinite(seated.times), seated.times, seated.straight + UNSAFE_S)
    _, pose = np.unique(np.stack(list(seated.commands.values()), axis=1), axis=0, return_inverse=True)
    return kept_apart(out_and_back(ordering(round_trip(times)), returns), pose.ravel(), times)


def retimed(schedule: Schedule, post: Post) -> Schedule:
    """The schedule with the times that its programs need on the ways of `post`."""
    campaign, seconds = on_ways(schedule.campaign, post)
    unsafe = {run: tuple(rows) for run, rows in post.unsafe.items()}
    via = {run: dict(rows) for run, rows in post.via.items()}
    return replace(schedule, campaign=campaign, seconds=seconds, unsafe=unsafe, via=via)


def on_ways(campaign: Campaign, post: Post) -> tuple[Campaign, float]:
    """A campaign of static runs with the times that its programs need on the ways of `post`, and how long it takes, s."""
    clock, runs = 0.0, []
    for run in campaign.runs:
        timed, clock = _timed(campaign.machine, run, post, clock)
        runs.append(timed)
    return replace(campaign, runs=tuple(runs)), clock


def _timed(machine: Machine, run: Run, post: Post, clock: float) -> tuple[Run, float]:
    """A run that is set up from `clock` on, at the times of its program, and when it is done, s."""
    time = arrival_times(machine, run, post, machine.workspace.seconds_per_pose)
    around = math.ceil(outside_s(machine, run, post))
    start = clock + SETUP_S + around
    return replace(run, time=time, start_s=start), start + float(time[-1])


def _drift(space: Space, rows: Rows, visited: Indices, instants: Array, repeats: int) -> float:
    """Efficiency (D, all machine parameters) left when a linear drift of the tool in the workpiece frame is a nuisance."""
    everything = np.arange(len(space.shared))
    z, k, group = rows.z[visited], rows.k[visited], rows.group[visited]
    sensitivities = space.kernel.rows(z, k) / math.sqrt(repeats)
    task = Task(Volume(), np.eye(len(everything)), space.own_sigma, everything)
    plain = task.information(sensitivities, group, rows.groups)
    hours = (instants - instants.mean()) / 3600.0
    directions = bars_of(space, z)[:, :, None] if space.bar else np.eye(3)[None, :, :]
    rate = DRIFT_UM_PER_H / (space.noise_um * math.sqrt(repeats)) * hours[:, None, None] * directions
    whole = task.layout(rows.groups).embed(sensitivities, group)
    cross = np.einsum("npy,ndy->pd", whole, np.broadcast_to(rate, (len(z), 3, whole.shape[2])))
    own = np.einsum("ndy,ney->de", rate, rate) + np.eye(3)
    drifting = plain - cross @ inverse(own) @ cross.T
    return math.exp(task.value(plain) - task.value(drifting))


def affordable(
    machine: Machine, minutes: float | None, points: int, runs: int, returns: int, repeats: int
) -> list[tuple[int, int]]:
    """Numbers of poses and runs that fit into the time, for every number of runs (without a budget: as wished).

    Raises `InputError` where not even two poses can be read.
    """
    if minutes is None:
        return [(points, min(runs, max(1, points // 2)))]
    pace = machine.workspace.seconds_per_pose * repeats
    found = []
    for count in range(1, runs + 1):
        most = int((60.0 * minutes - count * SETUP_S) // pace) - count * returns
        if most >= 2 * count:
            found.append((min(points, most), min(count, max(1, points // 2))))
    if not found:
        least = math.ceil((SETUP_S + (2 + returns) * pace) / 60.0)
        problem = f"{minutes:g} minutes are too short for one set-up ({SETUP_S / 60.0:g} min) and two poses"
        raise InputError(problem, remedy=f"give at least {least} minutes")
    return found


def without_least(space: Space, task: Task, rows: Rows, drop: int) -> Rows:
    """The design without its least informative poses, one after the other."""
    for _ in range(drop):
        sensitivities = space.kernel.rows(rows.z, rows.k)
        whole = task.layout(rows.groups).embed(sensitivities, rows.group)
        information = task.information(sensitivities, rows.group, rows.groups)
        least = int(np.argmin([task.value(information - row @ row.T) for row in whole]))
        kept = np.delete(np.arange(len(rows.z)), least)
        rows = Rows.of(rows.z[kept], rows.k[kept], rows.group[kept], rows.poses)
    return rows


def _without_a_run(space: Space, task: Task, rows: Rows) -> Rows:
    """The design without its least informative run."""
    left = [rows.group != g for g in range(rows.groups)]
    designs = [Rows.of(rows.z[kept], rows.k[kept], rows.group[kept], rows.poses) for kept in left]
    return min(designs, key=lambda design: value_of(space, task, design))


def shortened(space: Space, task: Task, rows: Rows, schedule: Schedule, seconds: float, lay: Lay) -> Schedule:
    """The schedule without its least informative poses until it fits. Raises `InputError` where it cannot."""
    while schedule.seconds > seconds:
        excess = (schedule.seconds - seconds) / max(schedule.seconds - rows.groups * SETUP_S, 1.0)
        drop = max(1, int(0.8 * excess * len(rows.z)))
        if len(rows.z) - drop < 2:
            if rows.groups == 1:
                least = math.ceil(schedule.seconds / 60.0)
                problem = f"the plan does not fit into {seconds / 60.0:g} minutes"
                raise InputError(problem, remedy=f"give about {least} minutes")
            rows = _without_a_run(space, task, rows)
        else:
            rows = without_least(space, task, rows, drop)
        schedule = lay(rows)
    return schedule


def most_per_minute(space: Space, task: Task, rows: Rows, lay: Lay) -> Schedule:
    """The part of a design that lowers ψ most per minute, set-up included: the least informative ones are removed."""
    before = task.value(task.prior)

    def rate(schedule: Schedule) -> float:
        return (before - value_of(space, task, schedule.rows)) / schedule.seconds

    current = best = lay(rows)
    while len(current.rows.z) > 2:
        drop = min(max(1, int(SHARE * len(current.rows.z))), len(current.rows.z) - 2)
        options = [lay(without_least(space, task, current.rows, drop))]
        if current.rows.groups > 1:
            fewer = _without_a_run(space, task, current.rows)
            options += [lay(fewer)] if len(fewer.z) >= 2 else []
        current = max(options, key=rate)
        best = max(best, current, key=rate)
    return best
