"""What a program does in which order: first move, modal states, poses visited, stops and the end."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ._events import BY_HAND, Event, Finding
from ._path import OFF, ON, Path
from ._touching import touches
from .dialects import DIALECTS


def modal(path: Path) -> Iterator[Finding]:
    """Every modal state that the program relies on is set before the first motion."""
    first = next((e.line for e in path.events if e.motion), 1)
    words = DIALECTS[path.dialect]
    wanted_states = [*words.needed, *(words.turning if path.machine.rotary.any() else ())]
    needed = [(wanted,) if isinstance(wanted, str) else wanted for wanted in wanted_states]
    if missing := [" or ".join(names) for names in needed if not set(names) & path.control.before_motion]:
        yield path.fault("modal", first, f"the first motion comes before these are set: {', '.join(missing)}")


def first_move(path: Path) -> Iterator[Finding]:
    """From an unknown position: the tool axis alone to its top in machine coordinates, then the rotary axes, then the others."""
    known = np.zeros(len(path.machine.names), bool)
    for event in path.events:
        if event.kind == "stop" and BY_HAND.search(event.text):
            known[:] = False
        if (
            event.kind == "switch"
            and event.text in DIALECTS[path.dialect].moves_alone
            and not known[path.machine.tool_axis]
        ):
            yield path.fault("first move", event.line, f"{event.text} may move the tool by its length where it stands")
            return
        if not event.motion or known.all():
            continue
        moved = np.isin(np.arange(len(known)), event.moved)
        if not known.all() and (says := _out_of_order(path, event, known, moved)):
            yield path.fault("first move", event.line, says)
            return
        known |= moved & np.isfinite(event.end)
    if not known.all():
        yield path.fault("first move", path.events[-1].line, "some axes are never moved to a known position")


def _out_of_order(path: Path, event: Event, known: np.ndarray, moved: np.ndarray) -> str:
    names, tool, rotary = path.machine.names, path.machine.tool_axis, path.machine.rotary
    axes = ", ".join(n for n, m in zip(names, moved, strict=True) if m)
    if event.machine and moved[tool] and moved.sum() == 1:
        return ""
    if not known[tool]:
        return f"{axes} move before {names[tool]} alone has gone to its top in machine coordinates"
    high = abs(event.start[tool] - path.machine.top) < 1.0 and not moved[tool]
    if (rotary & ~known).any():
        return (
            "" if high and not (moved & ~rotary).any() else f"{axes} move before the rotary axes are where they belong"
        )
    if not (known | moved)[[i for i in range(len(names)) if i != tool]].all():
        return f"{axes} move together while another axis stands at an unknown position"
    return "" if high else f"{axes} move while {names[tool]} is not at its top"


def visits(path: Path) -> Iterator[Finding]:
    """Each row of a static run is a position at which the program rests, or which it probes, in the file's order; a recording
    follows its rows."""
    if path.run.probe:
        yield from touches(path)
    elif path.run.static:
        yield from _static(path)
    else:
        yield from _recorded(path)


def _resolution(path: Path) -> float:
    """How far rounding moves an axis: by half the last digit of its word, and under tool-centre control, where an axis follows
    from three words of the ball's place, by √3 of that."""
    words = 3 if any(event.centred for event in path.events) else 1
    return float(np.sqrt(words)) * 0.51 * 10.0**-path.control.decimals + 1e-9


def _static(path: Path) -> Iterator[Finding]:
    rests = [(path.events[i].line, here) for i, here in rests_of(path)]
    rows, tolerance, pointer = path.run.rows, _resolution(path), 0
    for k, row in enumerate(rows):
        match = next((i for i in range(pointer, len(rests)) if np.abs(rests[i][1] - row).max() <= tolerance), None)
        if match is None:
            line = rests[min(pointer, len(rests) - 1)][0] if rests else 1
            at = _nearest(path, row)
            says = f"line {k + 2} of {path.run.file.name} is not visited in its turn ({at}; resolution {tolerance:.6f})"
            yield path.fault("poses", line, says)
            return
        for line, here in rests[pointer:match]:
            if k == 0 or np.abs(here - rows[k - 1]).max() > tolerance:
                yield path.fault("poses", line, f"the program rests before line {k + 2} where no row of the file is")
                return
        pointer = match + 1


def rests_of(path: Path) -> Iterator[tuple[int, np.ndarray]]:
    """Each dwell and where the axes stand then (n,)."""
    here = np.full(len(path.machine.names), np.nan)
    for i, event in enumerate(path.events):
        if event.motion:
            here = _end(path, event)
        elif event.kind == "dwell":
            yield i, here


def _end(path: Path, event: Event) -> np.ndarray:
    if not event.centred:
        return event.end
    return path.machine.following(event.end[None, :], event.end[None, path.control.linear], path.run.tool_ball)[0]


def _nearest(path: Path, row: np.ndarray) -> str:
    ends = [_end(path, e) for e in path.events if e.motion and np.isfinite(e.end).all()]
    if not ends:
        return "no position of the program is known"
    off = np.abs(np.array(ends) - row)
    k = int(np.argmin(off.max(axis=1)))
    i = int(np.argmax(off[k]))
    return f"nearest position: {path.machine.names[i]} off by {off[k, i]:.6f} {'degree' if path.machine.rotary[i] else 'mm'}"


CHORD_MM, CHORD_DEG = 0.001, 0.002
"""How far a recording's chords may take the tool ball off its place in the workpiece frame, and a rotary axis off its row. A
linear axis that follows a turning table is off by as much as its lever makes of this, and the ball is not."""
CLOCK_S, LATE_S = 1e-3, 0.01
"""What feeds that are written with three decimals may add up to, and by how much a first block that creeps may delay all."""


def _driven(path: Path, moves: list[tuple[Event, float]], when: np.ndarray) -> np.ndarray:
    """Positions (N, n) at times (N,) of moves that begin at times of their own: between two moves at the end of the first."""
    number = np.maximum(np.searchsorted([begin for _, begin in moves], when, side="right") - 1, 0)
    found = np.empty((len(when), len(path.machine.names)))
    for k in np.unique(number):
        (event, begin), rows = moves[k], number == k
        found[rows] = path.along(event, np.clip((when[rows] - begin) / max(event.seconds, 1e-9), 0.0, 1.0))
    return found


def _recorded(path: Path) -> Iterator[Finding]:
    """A dynamic run: the seated feed moves go through the rows at their times."""
    whole = [e for e in (path.events[i] for i in np.flatnonzero(path.seated)) if e.kind in ("feed", "dwell")]
    if any(e.arc is not None for e in whole):
        yield from _circular(path, [e for e in whole if e.kind == "feed"])
        return
    ends = np.cumsum([e.seconds for e in whole])
    moves = [
        (e, float(end - e.seconds))
        for e, end in zip(whole, ends, strict=True)
        if e.kind == "feed" and np.isfinite(e.end - e.start).all()
    ]
    if not moves:
        yield path.fault("poses", 1, "no move is made while the instrument is seated")
        return
    wanted = path.run.t - path.run.t[0]
    if not 0.99 < ends[-1] / wanted[-1] < 1.01:
        yield path.fault(
            "poses", moves[-1][0].line, f"the recording takes {ends[-1]:.2f} s, its file {wanted[-1]:.2f} s"
        )
        return
    rate = np.gradient(path.run.rows, wanted, axis=0)
    quick = np.arange(len(rate)), np.argmax(np.abs(rate), axis=1)
    there = _driven(path, moves, wanted)
    with np.errstate(divide="ignore", invalid="ignore"):
        late = float(np.nanmedian(((path.run.rows - there)[quick] / rate[quick])[rate[quick] != 0.0]))
    there = _driven(path, moves, wanted + np.clip(late, -LATE_S, LATE_S))
    balls, own = (path.machine.points(p, path.run.tool_ball[None])[:, 0] for p in (there, path.run.rows))
    turning, names = path.machine.rotary, np.array(path.machine.names)
    for what, found, rows, most, unit in (
        (np.array(["the ball"]), balls, own, CHORD_MM, "mm"),
        (names[turning], there[:, turning], path.run.rows[:, turning], CHORD_DEG, "degree"),
    ):
        off = np.abs(found - rows) - CLOCK_S * np.abs(np.gradient(rows, wanted, axis=0))
        if off.size and off.max() > most:
            k, i = np.unravel_index(np.argmax(off), off.shape)
            says = f"line {k + 2} of {path.run.file.name}: {what[min(i, len(what) - 1)]} is {off[k, i]:.4f} {unit} from its row"
            yield path.fault("poses", moves[0][0].line, says)


OUT_MM = (1.0, 1.75)
"""How far a bar is pulled out before it is fed in: its software must see it, its stroke ends."""
ON_CIRCLE_MM = 2e-3
"""From a circle's radius: two roundings of a word, and of a centre."""
STEADY = 0.005
"""Share by which the rows' steady speed may differ from the feed."""
WHOLE, OVER, PART_OVER = 360.0, 180.0, 2.0
"""Degrees of a whole circle, and of overshoot at either end of it and of a shorter arc."""


def joined(events: list[Event]) -> list[Event]:
    """The events with arcs on one circle that follow one another taken as one."""
    found: list[Event] = []
    for event in events:
        last = found[-1] if found else None
        a, b = (last.arc if last else None), event.arc
        if (
            last
            and a
            and b
            and a.plane == b.plane
            and a.sweep * b.sweep > 0.0
            and np.allclose(a.centre, b.centre, atol=2e-4)
        ):
            arc, seconds = replace(a, sweep=a.sweep + b.sweep), last.seconds + event.seconds
            found[-1] = replace(last, end=event.end, arc=arc, seconds=seconds)
        else:
            found.append(event)
    return found


def _circular(path: Path, moves: list[Event]) -> Iterator[Finding]:
    """A recording by the control's circular interpolation: one arc that is the rows' circle, in their sense, from their first to
    their last angle, at their speed, with overshoot; a bar is fed in and out radially."""
    line, file = moves[0].line, path.run.file.name
    arcs = [e for e in joined(moves) if e.arc is not None]
    others = [e for e in moves if e.arc is None]
    if len(arcs) != 1 or len(moves) >= 10 or len(others) != (2 if path.run.bar else 0):
        yield path.fault("arc", line, f"{len(arcs)} arcs and {len(others)} straight moves while the instrument is on")
        return
    (event,), rows = arcs, path.run.rows
    arc = event.arc
    assert arc is not None
    i, j = arc.plane
    spokes = rows[:, [i, j]] - arc.centre
    radius = float(np.hypot(*(event.start[[i, j]] - arc.centre)))
    away = np.abs(np.hypot(*spokes.T) - radius)
    if away.max() > ON_CIRCLE_MM:
        yield path.fault(
            "arc", event.line, f"line {int(np.argmax(away)) + 2} of {file} is {away.max():.4f} mm off the circle"
        )
    still = np.delete(np.abs(rows - event.start), [i, j], axis=1)
    if still.size and still.max() > _resolution(path):
        yield path.fault("arc", event.line, f"an axis that stands in the program moves by {still.max():.4f} in {file}")
    angle = np.unwrap(np.arctan2(spokes[:, 1], spokes[:, 0]))
    turned = np.degrees(angle[-1] - angle[0])
    if abs(turned - np.degrees(arc.sweep)) > 0.01:
        yield path.fault("arc", event.line, f"the arc turns by {np.degrees(arc.sweep):.3f}°, the rows by {turned:.3f}°")
    for what, here, row in (("begins", event.start, rows[0]), ("ends", event.end, rows[-1])):
        if np.abs(here - row).max() > ON_CIRCLE_MM:
            yield path.fault("arc", event.line, f"the arc {what} {np.abs(here - row).max():.4f} from the rows")
    speed = float(np.median(np.abs(np.diff(angle)) / np.diff(path.run.t))) * radius * 60.0
    feeds = [60.0 * e.length(~path.machine.rotary) / e.seconds for e in (event, *others)]
    if np.abs(np.array(feeds) / speed - 1.0).max() > STEADY:
        says = f"the rows go at {speed:.1f} mm/min, the program's feeds are {', '.join(f'{f:.1f}' for f in feeds)}"
        yield path.fault("arc", event.line, says)
    data = abs(turned) - 2.0 * (OVER if abs(turned) > WHOLE else PART_OVER)
    if not (abs(data - WHOLE) < 0.01 or (0.0 < data < WHOLE and abs(turned) <= WHOLE)):
        yield path.fault("arc", event.line, f"{abs(turned):.1f}° leave {data:.1f}° of data within overshoot")
    if path.run.bar:
        yield from _fed_in(path, event, others, np.array(arc.centre), radius)


def _fed_in(path: Path, event: Event, others: list[Event], centre: np.ndarray, radius: float) -> Iterator[Finding]:
    """Straight along the arc's radius from outside before it and to outside after it, nothing else moving."""
    assert event.arc is not None
    plane = list(event.arc.plane)
    for e, ring, out in ((others[0], others[0].end, others[0].start), (others[1], others[1].start, others[1].end)):
        a, b = ring[plane] - centre, out[plane] - centre
        pulled = float(np.linalg.norm(b)) - radius
        across = abs(float(a[0] * b[1] - a[1] * b[0])) / radius
        still = np.delete(np.abs(e.end - e.start), plane)
        least = min(OUT_MM[0], float(path.machine.workspace.get("bar_stroke", 1.0)))
        if not least <= pulled <= OUT_MM[1] or across > ON_CIRCLE_MM or (still.size and still.max() > 0.0):
            says = f"the bar is fed {pulled:.3f} mm outside its circle, {across:.4f} mm beside the radius"
            yield path.fault("arc", e.line, says)
    if not others[0].line < event.line < others[1].line:
        yield path.fault("arc", event.line, "the bar is not fed in before the arc and out after it")


def stops(path: Path) -> Iterator[Finding]:
    """Where a hand must act the program stops, and the control shows what to do."""
    for event in path.events:
        if event.kind == "stop" and not event.text.strip():
            yield path.fault("stop", event.line, "a stop without a text that this control shows")
    if not (path.run.bar or path.run.nest):
        return
    dwells = [i for i, e in enumerate(path.events) if e.kind == "dwell"]
    thing = "bar" if path.run.bar else "ball"
    for i in dwells if path.run.static else []:
        if not path.seated[i]:
            yield path.fault(
                "stop", path.events[i].line, f"a reading is taken without a stop at which the {thing} was seated"
            )
            return
    if not path.seated.any():
        yield path.fault("stop", 1, f"no stop says that the {thing} is to be seated")
    if path.seated.size and path.seated[-1]:
        yield path.fault("stop", path.events[-1].line, f"the program ends with the {thing} seated")
    said = [e.text for e in path.events if e.kind == "stop"]
    if not any(ON.search(t) for t in said) or not any(OFF.search(t) for t in said):
        yield path.fault("stop", 1, f"the stops do not say when to seat and when to remove the {thing}")


def quiet(path: Path) -> Iterator[Finding]:
    """Nothing is switched while the instrument is seated: no datum, length offset or tool-centre control."""
    for i, event in enumerate(path.events):
        if (
            event.kind == "switch"
            and path.seated[i]
            and event.text not in ("G93", "G94", "G90", "G64", "G61", "G17", "G18", "G19")
        ):
            yield path.fault("stop", event.line, f"{event.text} is called while the instrument is seated")
            return


def end(path: Path) -> Iterator[Finding]:
    """The program ends with the tool at the top and with all states cancelled that it had set."""
    tool, turning = path.machine.tool_axis, set(np.flatnonzero(path.machine.rotary).tolist())
    line = path.events[-1].line if path.events else 1
    last = [e for e in path.events if e.motion and not set(e.moved) <= turning][-1:]
    if not last or not (last[0].machine and last[0].moved == (tool,)):
        says = f"the last move, but for rotary axes, is not {path.machine.names[tool]} alone to its top in machine coordinates"
        yield path.fault("end", line, says)
    control = path.control
    for state, is_on in (
        ("G93", control.inverse_time),
        (
            "length offset",
            control.length_on and not DIALECTS[path.dialect].klartext,
        ),  # there the tool in the spindle has its length
        ("tool-centre control", control.centred),
    ):
        if is_on:
            yield path.fault("end", line, f"the program ends with {state} on")
    if not any(e.kind == "end" for e in path.events):
        yield path.fault("end", line, "the program has no end (M30 or M2)")
