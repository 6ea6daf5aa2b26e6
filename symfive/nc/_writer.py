"""From a run of a plan to the steps of a program: approach, every pose with its dwell, retract.

From wherever the machine stands the tool's axis goes alone to its top in machine coordinates, then the rotary axes move, then the
plane, then the tool's axis comes down; the way back is the same turned round, and so is every way out of the nest and around,
whose rapids move one axis each: which way several axes take together in a rapid depends on the control.
Between two poses the ball must stay in its nest (or the bar at its length), so the linear axes follow the rotary ones in
short straight blocks; with the control's own tool-centre point control (the user's text switches it on) the words are the
ball's place in the workpiece frame instead and the control does the following.

How recordings are driven is in `_recording`.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run
from symfive.instruments import Instrument, has_bar, instruments_of, is_probed
from symfive.machine import Machine
from symfive.nc._arc import circle_of
from symfive.nc._base import Step
from symfive.nc._pace import CAUTION, pace, spread, tenths
from symfive.nc._post import Post
from symfive.nc._recording import STANDSTILL, circular, pose_of, pulled_out, said, straight_blocks
from symfive.nc._route import (
    LEAST_LIFT_MM,
    Positions,
    Way,
    at_the_top,
    out_to_the_top,
    over_the_top,
    upright_axis,
    usual_lift,
)
from symfive.nc._seat import Seat
from symfive.procedures import Nominal

ROTARY, LINEAR = "ABC", "XYZUVW"
LETTERS = "XYZABCUVW"
CREEP_MM_PER_MIN, SLOWEST_MM_PER_MIN, LAST_MM = 500.0, 100.0, 5.0
"""Feed towards and away from the nest, and on the last millimetres."""
HAND_S = 30.0
"""Time that a stop takes at which the operator removes or mounts a bar."""
ORIENT_S = 5.0
"""Time in which the spindle turns by half a turn and is held; an operator who turns it needs `HAND_S`."""


def word_order(machine: Machine) -> list[str]:
    """The axes in the order of a block's words; axes without an NC address last."""
    return sorted(machine.axis_names, key=lambda n: (LETTERS.find(n) % (len(LETTERS) + 1), n))


class Writer:
    """A run's moves: the ways to its poses and between them."""

    def __init__(self, machine: Machine, run: Run, post: Post) -> None:
        self.machine, self.run, self.post = machine, run, post
        self.nominal = Nominal(machine)
        self.names = machine.axis_names
        self.signs = {n: -1.0 if n in post.reversed_axes else 1.0 for n in word_order(machine)}
        self.rotary = list(machine.rotary_axes)
        self.upright = upright_axis(machine)
        self.plane = [name for name in self.names if name not in (*self.rotary, self.upright)]
        self.seat = Seat(machine, run, self.nominal)
        self.places = self.seat.places
        self.bar = has_bar(run)
        self.seated = self.centred = False
        self.frame: tuple[Array, Array] | None = None
        self.least_lift = LEAST_LIFT_MM
        self._known: dict[bool, dict[int, list[tuple[Array, Array, Array]]]] = {}
        self.circle = circle_of(machine, run)

    def stays(self, row: int) -> float:
        """How long the program stays at a pose, s."""
        return self.post.rest_s

    def turned(self, row: int) -> str:
        """The angle to which the spindle is turned before a row, degree; nothing where it stays."""
        angles = self.run.spindle
        if angles is None or (row and angles[row] == angles[row - 1]):
            return ""
        return f"{angles[row]:g}"

    def steps(self) -> list[Step]:
        """From wherever the machine stands to the top again."""
        found = self.opening()
        self.seated = True
        found += self.recording() if self.run.dynamic else self._poses()
        return [*found, *self.closing()]

    def opening(self) -> list[Step]:
        """What the run is, the first moves, the stop at which the instrument is seated."""
        run, ball = self.run, " ".join(f"{round(v, 3) + 0.0:.3f}" for v in self.run.table_ball)
        found = [
            Step(kind="comment", text=f"run {run.id}, {run.rows} rows, {', '.join(run.instrument)}"),
            Step(kind="comment", text=f"table ball {ball} mm, tool length {-run.tool_ball[2]:g} mm"),
            Step(kind="comment", text="work offset: origin of the workpiece frame, all rotary axes at 0"),
        ]
        if run.length is not None:
            found.append(Step(kind="comment", text=f"bar {run.length:g} mm"))
        self.seated = False
        found += self.first_moves()
        found.append(Step(kind="contour", text="" if self.circle is None else self.circle.plane))
        zeroed = all(instrument.zeroed(run) for instrument in instruments_of(run))
        seat = f"{'MOUNT' if self.bar else 'SEAT'} {self._ball}"
        if run.dynamic:
            text = f"{'SEAT, ZERO IT' if zeroed and not self.bar else seat}, THEN RECORD"
        else:
            text = f"{seat}, {'ZERO IT' if zeroed else 'KEEP ITS ZERO'}"
        return [*found, Step(kind="stop", text=text)]

    def closing(self) -> list[Step]:
        """The stop at which the instrument is freed, and the last moves."""
        self.seated = False
        freed = f"{'REMOVE' if self.bar else 'FREE'} {self._ball}"
        found = self.last_moves(f"STORED? {freed}" if self.run.dynamic else f"{freed}, START")
        upright = self.circle is not None and self.circle.plane != "XY"
        return [*found, Step(kind="contour", text="XY")] if upright else found

    @property
    def _ball(self) -> str:
        words = [i.seated for i in instruments_of(self.run)]
        return next((word for word in words if word != Instrument.seated), Instrument.seated).split()[-1].upper()

    def first_moves(self) -> list[Step]:
        """The tool's axis alone to the top, rotary axes, plane, down to the lifted pose; a look at it; creep in."""
        lifted = self._way_to(0)[-1]
        pose = self._entry(0)
        away = self._apart(pose, lifted)
        return [
            Step(kind="comment", text=f"spindle stopped and locked; {self.upright} goes up first, alone"),
            Step(kind="stop", text=f"CLEAR? {self.upright} GOES TO TOP FIRST"),
            *self._orient(0),
            *self._centred(False, {}),
            self._to_the_top(0),
            *self._alone(lifted, 0),
            *self._centred(True, lifted),
            Step(kind="stop", text=f"BALL {away:.0f} MM FROM POSE 1?"),
            *self._creep(lifted, pose, 0),
        ]

    def _alone(self, lifted: Positions, row: int) -> list[Step]:
        """From the top, wherever else the axes stand: rotary axes, plane, tool's axis, each by themselves; only the last way is
        known, and so its time."""
        words, top = self._words(lifted, np.zeros(3)), at_the_top(self.machine, lifted)
        known: tuple[tuple[list[str], Positions], ...] = (
            (self.rotary, {}),
            (self.plane, top),
            ([self.upright], lifted),
        )
        return [
            Step(
                kind="rapid",
                positions={n: v for n, v in words.items() if n in names},
                commands=dict(there),
                towards=row,
                seconds=self._rapidly(top, lifted) if names == [self.upright] else 0.0,
            )
            for names, there in known
            if names
        ]

    def last_moves(self, text: str) -> list[Step]:
        """Creep out, the tool's axis alone to the top, rotary axes home one by one."""
        rows = self.run.rows
        lifted, top, *turned = self._way_to(rows)
        found = [Step(kind="stop", text=text), *self._creep(lifted, self._entry(rows - 1), rows, out=True)]
        up = replace(self._to_the_top(rows, top), seconds=self._rapidly(lifted, top))
        found += [*self._centred(False, lifted), up]
        return [*found, *(self._rapid(before, after, rows) for before, after in itertools.pairwise([top, *turned]))]

    def _to_the_top(self, towards: int, commands: Positions | None = None) -> Step:
        positions = {self.upright: self.post.machine_top}
        return Step(kind="retract", positions=positions, commands=dict(commands or {}), towards=towards)

    def _centred(self, wanted: bool, there: Positions) -> list[Step]:
        """The user's text that switches tool-centre control; from here on the words are the ball's place, or the axes'. `there`
        is where the axes stand, so that the way of the next block is known in the words that it is written in."""
        if wanted and self.circle is not None:
            return []  # no rotary axis moves: a circle of the linear axes themselves
        self.centred = wanted and self.post.centred
        self.frame = None
        if (
            self.centred and self.post.frame_of_start
        ):  # the workpiece frame as the table stands, in that with all axes at 0
            rotary = {n: np.array([there[n] if n in self.rotary else 0.0]) for n in self.names}
            self.frame = self.nominal.workpiece_origin(rotary)[0], self.nominal.workpiece_rotation(rotary)[0]
        text = self.post.tool_centre_on if wanted else self.post.tool_centre_off
        if "{words}" in text and not there:
            return []  # the head of the program has switched it off
        words = self._words(there, self._place(there)) if there else {}
        return [Step(kind="text", text=text, positions=words)] if text else []

    def _poses(self) -> list[Step]:
        found = [Step(kind="dwell", seconds=self.post.dwell_s), *self._read(0)]
        around = set(self.post.unsafe.get(self.run.id, ()))
        for row in range(1, self.run.rows):
            seconds = float(self.run.time[row] - self.run.time[row - 1]) - self.post.rest_s
            seconds -= ORIENT_S if self.turned(row) else 0.0
            found.append(Step(kind="comment", text=f"to pose {row + 1}"))
            found += self._detour(row) if row in around else self._way(row, seconds)
            early = seconds - self.seconds_to(row) if row in around else 0.0
            found += [
                *self._orient(row),
                Step(kind="dwell", seconds=self.post.dwell_s + tenths(early)),
                *self._read(row),
            ]
        return found

    def _orient(self, row: int) -> list[Step]:
        """The spindle turned to where a row wants it, the ball being in its place already."""
        angle = self.turned(row)
        return [Step(kind="orient", text=angle)] if angle else []

    def _read(self, row: int) -> list[Step]:
        """What a settled pose is read by."""
        if self.post.at_pose == "stop":
            return [Step(kind="stop", text=f"READ POSE {row + 1} OF {self.run.rows}")]
        return [Step(kind="trigger", text=self.post.trigger)] if self.post.at_pose == "trigger" else []

    def seconds_to(self, row: int) -> float:
        """How long the way to a row takes, s, without the dwell."""
        if row not in self.post.unsafe.get(self.run.id, ()):
            return 0.0 if self._stays(row) else sum(self._spread(self._paces(row), 0.0))
        steps = self._detour(row)
        return sum(HAND_S if step.kind == "stop" else step.seconds for step in steps)

    def _way(self, row: int, seconds: float) -> list[Step]:
        """From the pose before to this one in so many seconds, or as long as the axes need."""
        if self._stays(row):
            return [self._pose(row, max(seconds, 0.0))]
        paces = self._paces(row)
        share = self._spread(paces, seconds)[0] / max(sum(own for own, _ in paces), 1e-12)
        steps = [
            self._feed(dict(zip(self.names, ends, strict=True)), place, share * own / len(places), row)
            for (commands, places, _), (own, _) in zip(self._blocks(row), paces, strict=True)
            for ends, place in zip(commands.tolist(), places, strict=True)
        ]
        return [*steps[:-1], self._pose(row, steps[-1].seconds)]

    def _paces(self, row: int) -> list[tuple[float, float]]:
        """How long the axes need for each leg of the way to a row, and to get up to speed and to rest, s."""
        return [pace(self.machine, path) for *_, path in self._blocks(row)]

    @staticmethod
    def _spread(paces: Sequence[tuple[float, float]], seconds: float) -> tuple[float, float]:
        """The time of a whole way that is to take so many seconds, and what comes on top to get up to speed and to rest."""
        own, ramps = (sum(parts) for parts in zip(*paces, strict=True))
        return spread(own, ramps, seconds)

    def _stays(self, row: int) -> bool:
        return all(self.run.commands[n][row] == self.run.commands[n][row - 1] for n in self.names)

    def _blocks(self, row: int) -> list[tuple[Array, Array, Array]]:
        """The legs of the way to a row with the ball in its nest (`Seat.blocks`); those of all rows are found at once."""
        if self.centred not in self._known:
            around = self.post.unsafe.get(self.run.id, ())
            rows = [r for r in range(1, self.run.rows) if r not in around and not self._stays(r)]
            via = self.post.via.get(self.run.id, {})
            stands = [[pose_of(self.run, r - 1), *via.get(r, ()), pose_of(self.run, r)] for r in rows]
            legs = [(a, b, r) for r, places in zip(rows, stands, strict=True) for a, b in itertools.pairwise(places)]
            known: dict[int, list[tuple[Array, Array, Array]]] = {r: [] for r in rows}
            for (*_, r), blocks in zip(legs, self.seat.blocks(legs, self.centred), strict=True):
                known[r].append(blocks)
            self._known[self.centred] = known
        return self._known[self.centred][row]

    def recording(self) -> list[Step]:
        """A dynamic run: the control's own circle, or straight blocks."""
        if self.circle is not None:
            return circular(self.run, self.circle, bar=self.bar)
        blocks = straight_blocks(self.run, self.nominal, self.places, centred=self.post.centred)
        found, first = [Step(kind="comment", text=said(blocks))], 0
        for row, seconds in blocks:
            way = {r: pose_of(self.run, r) for r in range(first + 1, row + 1)} if self.post.centred else {}
            found.append(replace(self._pose(row, seconds), way=way))
            first = row
        return found

    def _entry(self, row: int) -> Positions:
        """Where the instrument is seated and freed: the pose itself, or before and after a bar's circle pulled out from it."""
        return pulled_out(self.run, self.circle, row) if self.circle and self.bar else pose_of(self.run, row)

    def _detour(self, row: int) -> list[Step]:
        """Out of the nest, around, and in again; a bar is removed meanwhile."""
        way = self._way_to(row)
        self.seated = False
        steps = [Step(kind="stop", text="REMOVE THE BAR")] if self.bar else []
        steps += [
            *self._creep(way[0], pose_of(self.run, row - 1), row, out=True),
            *self._centred(False, way[0]),
            *(self._rapid(before, after, row) for before, after in itertools.pairwise(way)),
            *self._centred(True, way[-1]),
            *self._creep(way[-1], pose_of(self.run, row), row),
        ]
        self.seated = True
        return [*steps, *([Step(kind="stop", text="MOUNT THE BAR")] if self.bar else [])]

    def _way_to(self, row: int) -> Way:
        """The way given, or the usual one."""
        given = self.post.ways.get(self.run.id, {}).get(row)
        if given is not None:
            return given
        rows = [r for r in (row - 1, row) if 0 <= r < self.run.rows]
        lifted = [
            usual_lift(self.nominal, self.run, r, max(self.post.retract_mm, self.least_lift), self.least_lift)
            for r in rows
        ]
        if len(lifted) == 2:
            return over_the_top(self.machine, *lifted)
        return out_to_the_top(self.machine, lifted[0]) if row else (lifted[0],)

    def retracts(self) -> dict[int, float]:
        """How far the tool is drawn back, mm, from the rows that the program enters or leaves."""
        rows = self.run.rows
        around = range(rows + 1) if is_probed(self.run) else {0, *self.post.unsafe.get(self.run.id, ()), rows}
        found = dict[int, float]()
        for row in sorted(around):
            way = self._way_to(row)
            ends = {r: way[place] for r, place in ((row - 1, 0), (row, -1)) if 0 <= r < rows}
            found |= {r: self._apart(self._entry(r), lifted) for r, lifted in ends.items()}
        return found

    def _creep(self, lifted: Positions, pose: Positions, row: int, *, out: bool = False) -> list[Step]:
        """Between a pose and its lifted one, slowest near the pose; `row` is the one it leads to."""
        away = self._apart(pose, lifted)
        share = min(1.0, LAST_MM / max(away, LAST_MM))
        near = {n: pose[n] + share * (lifted[n] - pose[n]) for n in self.names}
        places, speeds = [pose, near, lifted], [SLOWEST_MM_PER_MIN, CREEP_MM_PER_MIN]
        if not out:
            places, speeds = places[::-1], speeds[::-1]
        steps = []
        for before, after, speed in zip(places, places[1:], speeds, strict=False):
            least, more = self._pace(before, after)
            seconds = max(60.0 * self._apart(before, after) / speed, least + more)
            steps.append(self._feed(after, self._place(after), seconds, row))
        return steps if out else [*steps[:-1], replace(steps[-1], row=row)]

    def _apart(self, a: Positions, b: Positions) -> float:
        return float(np.linalg.norm(self._place(a) - self._place(b)))

    def _pace(self, before: Positions, after: Positions, share: float = CAUTION) -> tuple[float, float]:
        return pace(self.machine, np.array([[p[n] for n in self.names] for p in (before, after)]), share)

    def _rapidly(self, before: Positions, after: Positions) -> float:
        """Seconds of a rapid: the control drives it as fast as the axes can."""
        return sum(self._pace(before, after, 1.0))

    def _pose(self, row: int, seconds: float) -> Step:
        return replace(self._feed(pose_of(self.run, row), self.places[row], seconds, row), row=row)

    def _feed(self, commands: Positions, place: Array, seconds: float, towards: int) -> Step:
        words = self._words(commands, place)
        return Step(
            kind="feed", positions=words, seconds=seconds, towards=towards, seated=self.seated, commands=dict(commands)
        )

    def _rapid(self, before: Positions, after: Positions, row: int) -> Step:
        """A rapid that names only the axes that move."""
        words = self._words(after, np.zeros(3))
        moved = {n: v for n, v in words.items() if abs(after[n] - before[n]) >= STANDSTILL} or words
        seconds = self._rapidly(before, after)
        return Step(kind="rapid", positions=moved, commands=dict(after), towards=row, seconds=seconds)

    def _place(self, commands: Mapping[str, float]) -> Array:
        return np.asarray(self.nominal.ball({n: np.array([v]) for n, v in commands.items()}, self.run.tool_ball)[0])

    def _words(self, commands: Mapping[str, float], place: Array) -> dict[str, float]:
        words = {name: sign * commands[name] for name, sign in self.signs.items()}
        if self.centred:
            nest = np.asarray(self.run.table_ball)
            if not self.bar and np.abs(place - nest).max() < STANDSTILL:
                place = nest  # a last digit that changes would be a move of the tool's centre, with a feed of its own
            if self.frame is not None:
                origin, rotation = self.frame
                place = origin + rotation @ place
            words |= dict(zip("XYZ", place.tolist(), strict=True))
        return words
