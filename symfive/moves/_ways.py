"""Ways of a run's program on which no bodies meet and no axis leaves its travel.

Moves are straight in the axes between the program's blocks, and a rapid moves one axis: which way several take together depends
on the control. A pose has a way out where the tool can be drawn back from it, go up alone to the top and, there, turn the
rotary axes home and go over the workpiece's origin. Two such poses are joined over the top, axis by axis in whichever order is
clear, and if there is none over the place where their ways out meet: so every two of them are joined. On rapid moves bodies
keep `RAPID_MM` apart, and the ball `KEPT_OFF` off its nest. Not tested are the first moves, from wherever the machine stands to
above the first pose.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from symfive.campaign import FIRST_LINE, Run
from symfive.errors import InputError
from symfive.machine import Machine, Workspace
from symfive.moves._bodies import kept_off_nest
from symfive.moves._moves import ROUNDING_MM, Moves, blocked_moves
from symfive.nc import (
    Positions,
    Post,
    Seat,
    Way,
    at_the_top,
    lifts,
    one_by_one,
    out_to_the_top,
    program_steps,
    stands,
    turned_home,
    upright_axis,
)
from symfive.procedures import Nominal

RETRACTS_MM = (50.0, 80.0, 120.0, 200.0, 35.0, 25.0)
"""How far the tool is drawn back, as they are tried: longer ones where something meets, shorter ones where no travel is left."""
REMEDY = "what helps: a longer tool, a slimmer post, tool or bar ([workspace] post_radius, tool_radius, bar_radius), more travel"
ELSEWHERE = "what helps: another position or height of the table ball, another radius, a longer tool"


def least_retract(workspace: Workspace, *, probe: bool) -> float:
    """The shortest retract that takes the ball, or a probe's tip, as far off as rapid moves keep it, mm."""
    return min((mm for mm in RETRACTS_MM if mm >= kept_off_nest(workspace, probe)), default=max(RETRACTS_MM))


@dataclass(frozen=True)
class _Out:
    """A pose's way out: `up` from the lifted pose to the top and the rotary axes home there, `over` from there to where all ways
    out meet."""

    up: Way
    over: Way


@dataclass(frozen=True)
class Tested:
    """What is known of straight moves in one set-up: whether one with the ball seated is clear, and what meets on
    the others."""

    seated: dict[tuple[float, ...], bool] = field(default_factory=dict)
    met: dict[tuple[bytes, bytes, bool, bool], str] = field(default_factory=dict)


class Ways:
    """Clear ways between the poses of one run; `tested` moves of its set-up are not looked at again."""

    def __init__(
        self, machine: Machine, run: Run, retract_mm: float = RETRACTS_MM[0], tested: Tested | None = None
    ) -> None:
        self.machine, self.run = machine, run
        self.nominal, self.moves = Nominal(machine), Moves(machine, run)
        self.retracts = list(dict.fromkeys((retract_mm, *RETRACTS_MM)))
        upright = upright_axis(machine)
        self.rotary = [name for name, axis in machine.axes.items() if axis.rotary]
        self.plane = [name for name in machine.axes if name not in (*self.rotary, upright)]
        self.seat = Seat(machine, run, self.nominal)
        self._out: dict[tuple[float, ...], _Out | str] = {}
        self._tested = tested or Tested()

    def meets(self, before: Positions, after: Positions, *, rapid: bool) -> str:
        """What meets on a straight move without a bar, "" where it is clear."""
        return self.met([(before, after)], rapid, bar=False)[0]

    def met(self, moves: Sequence[tuple[Positions, Positions]], rapid: bool, bar: bool) -> list[str]:
        """The same of several moves, those that are new all at once."""
        known = self._tested.met
        ends = [(self.moves.vector(before), self.moves.vector(after)) for before, after in moves]
        keys = [(before.tobytes(), after.tobytes(), rapid, bar) for before, after in ends]
        new = {key: pair for key, pair in zip(keys, ends, strict=True) if key not in known}
        if new:
            starts, after = (np.stack(places) for places in zip(*new.values(), strict=True))
            known.update(zip(new, self.moves.met(starts, after, rapid=rapid, bar=bar), strict=True))
        return [known[key] for key in keys]

    def outs(self, rows: Iterable[int]) -> list[Way | str]:
        """`out` of several rows: the way that is tried first is looked at for all of them at once."""
        rows = list(rows)
        standing: list[tuple[Positions, Positions]] = []
        lifting, rapids = list(standing), list(standing)
        for row in rows:
            entry, *around = self._stand(row) or [{}]
            if not entry:
                continue
            standing += itertools.pairwise((entry, entry, *around))
            if (lifted := next(lifts(self.nominal, self.run, row, self.retracts[0]), None)) is not None:
                lifting.append((entry, lifted))
                up = out_to_the_top(self.machine, lifted)
                rapids += itertools.pairwise((*up, *one_by_one(up[-1], self._at_home(up[-1]), self.plane)[1:]))
        for moves, rapid, bar in ((standing, False, True), (lifting, False, False), (rapids, True, False)):
            self.met(moves, rapid, bar)
        return [self.out(row) for row in rows]

    def seated(self, moves: Sequence[tuple[Positions, Positions]]) -> list[bool]:
        """Whether each of some straight moves with the ball in its nest, or the bar on, is clear."""
        keys = [(*before.values(), *after.values()) for before, after in moves]
        known = self._tested.seated
        fresh = {key: move for key, move in zip(keys, moves, strict=True) if key not in known}
        paths = dict(zip(fresh, self.seat.paths([*fresh.values()]), strict=True))
        followed = {key: path for key, path in paths.items() if path is not None}
        known.update(dict.fromkeys(fresh, False))
        known.update(zip(followed, self.moves.clear([*followed.values()]), strict=True))
        return [known[key] for key in keys]

    def out(self, row: int) -> Way | str:
        """The way out of a row's pose: drawn back, at the top, rotary axes home one by one; else what meets on the first one
        that was tried."""
        found = self._way_out(row)
        return found if isinstance(found, str) else found.up

    def _way_out(self, row: int) -> _Out | str:
        pose = {name: float(q[row]) for name, q in self.run.commands.items()}
        key = tuple(pose.values())
        if key not in self._out:
            self._out[key] = self._search(row)
        return self._out[key]

    def _stand(self, row: int) -> list[Positions]:
        """Where the axes are at a pose (`stands`); nowhere where that leaves a travel."""
        try:
            return stands(self.machine, self.run, row)
        except InputError:
            return []

    def _search(self, row: int) -> _Out | str:
        entry, *around = self._stand(row) or [{}]
        if not entry:
            return "travel"
        met = next(filter(None, self.met([*itertools.pairwise((entry, entry, *around))], rapid=False, bar=True)), "")
        for mm in self.retracts if not met else ():
            for lifted in lifts(self.nominal, self.run, row, mm):
                away = self._below(lifted) or self.meets(entry, lifted, rapid=False) or self._leaving(lifted)
                if isinstance(away, _Out):
                    return away
                met = met or away
        return met or "travel to draw the tool back"

    def _below(self, lifted: Positions) -> str:
        """What keeps the ball from leaving downwards: a nest opens upwards; a bar has none."""
        ball = self.moves.clearances.frames(self.moves.vector(lifted)[None])[0][0]
        return "nest, from below," if self.run.length is None and ball[2] < self.run.table_ball[2] - ROUNDING_MM else ""

    def _leaving(self, lifted: Positions) -> _Out | str:
        top = at_the_top(self.machine, lifted)
        away = self.meets(lifted, top, rapid=True)
        if away:
            return away
        turned = self._in_some_order(top, turned_home(self.machine, top), self.rotary)
        if isinstance(turned, str):
            return turned
        crossed = self._in_some_order(turned[-1], self._at_home(turned[-1]), self.plane)
        return crossed if isinstance(crossed, str) else _Out((lifted, *turned), crossed)

    def _at_home(self, place: Positions) -> Positions:
        """The place over the workpiece's origin."""
        return {**place, **{name: self.machine.home(name) for name in self.plane}}

    def around(self, row: int) -> Way:
        """The way to a row from the one before, out of the nest. Raises `InputError` where one of the two has no way out."""
        one, two = self.left_by(row - 1), self.left_by(row)
        before, after = one.up[0], two.up[0]
        high, there = at_the_top(self.machine, before), at_the_top(self.machine, after)
        level = {upright_axis(self.machine): high[upright_axis(self.machine)]}
        direct = self._in_some_order(high, {**there, **level}, [*self.rotary, *self.plane])
        if not isinstance(direct, str):
            return _without_rests((before, *direct, there, after))
        home_there = {**two.up[-1], **level}
        across = self._in_some_order(one.up[-1], home_there, self.plane)
        middle = (*one.over, *two.over[::-1]) if isinstance(across, str) else across
        return _without_rests((*one.up, *middle, *two.up[::-1]))

    def left_by(self, row: int) -> _Out:
        found = self._way_out(row)
        if isinstance(found, str):
            problem = f"run {self.run.id}: {found} on every exit path from the pose of line {row + FIRST_LINE}"
            raise InputError(problem, remedy=ELSEWHERE if self.run.dynamic else REMEDY)
        return found

    def _in_some_order(self, before: Positions, after: Positions, names: Sequence[str]) -> Way | str:
        """From one place to another, one axis at a time in the first order that is clear; else what meets first."""
        moved = [name for name in names if before[name] != after[name]]
        blind: set[frozenset[str]] = set()
        met: list[str] = []

        def onwards(done: frozenset[str]) -> tuple[Positions, ...]:
            here = {**before, **{name: after[name] for name in done}}
            if len(done) == len(moved):
                return (here,)
            for name in moved:
                then = done | {name}
                if name in done or then in blind:
                    continue
                what = self.meets(here, {**here, name: after[name]}, rapid=True)
                met.extend([what] if what else [])
                if not what and (rest := onwards(then)):
                    return (here, *rest)
            blind.add(done)
            return ()

        return onwards(frozenset()) or met[0]


def _without_rests(way: Way) -> Way:
    return tuple(place for i, place in enumerate(way) if i == 0 or place != way[i - 1])


Detour = Callable[[int, Callable[[Sequence[tuple[Positions, Positions]]], Sequence[bool]]], Way | None]
"""Intermediate positions of a seated move to a row, of whose legs a function says which are clear; None: there is none."""


def cleared(
    machine: Machine, runs: Iterable[Run], unsafe: Mapping[str, Sequence[int]], post: Post | None = None,
    detours: Mapping[str, Detour] | None = None, tested: Mapping[str, Tested] | None = None,
) -> Post:  # fmt: skip
    """The programs with every move clear: a row whose straight way with the ball seated is not is reached by way of intermediate
    positions (`detours` by run), and where there are none around, out of the nest.

    `unsafe` run → rows that lead around anyway, `tested` run → what is known of moves in its set-up. Raises `InputError` where a
    pose has no way out, and where something meets along a recording.
    """
    post = replace(post or Post(), unsafe={}, ways={}, tested=machine.workspace.spindle_nose is not None)
    for run in runs:
        around = {row for row in unsafe.get(run.id, ()) if row}
        ways = Ways(machine, run, post.retract_mm, (tested or {}).get(run.id))
        post = _cleared(ways, around, post, (detours or {}).get(run.id))
    return post


def _cleared(ways: Ways, around: set[int], post: Post, detour: Detour | None) -> Post:
    machine, run = ways.machine, ways.run
    ways.outs(sorted({0, run.rows - 1, *around, *(row - 1 for row in around)}))
    first, last = (ways.left_by(row).up for row in (0, run.rows - 1))
    led: dict[int, Way] = {0: first[:1], run.rows: last}
    via = dict(post.via.get(run.id, {}))
    while True:
        led |= {row: ways.around(row) for row in sorted(around - set(led))}
        unsafe = {**post.unsafe, run.id: tuple(sorted(around))} if around else post.unsafe
        bent = {**post.via, run.id: via} if via else {name: rows for name, rows in post.via.items() if name != run.id}
        own = replace(post, unsafe=unsafe, via=bent, ways={**post.ways, run.id: led})
        met = dict(blocked_moves(machine, run, program_steps(machine, run, own), ways.met))
        for row, what in met.items():
            if run.dynamic or row in led:
                on = "along the recording at" if run.dynamic and row not in led else "on the path to"
                line = min(row, run.rows - 1) + FIRST_LINE
                raise InputError(f"run {run.id}: {what} {on} line {line}", remedy=ELSEWHERE if run.dynamic else REMEDY)
        if not met:
            return own
        for row in met:
            via.pop(row, None)
            other = detour(row, ways.seated) if detour is not None else None
            if other:
                via[row] = other
            else:
                around = around | {row}
