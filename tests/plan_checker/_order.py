"""What a program does in which order: first move, modal states, poses visited, stops and the end."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ._events import BY_HAND, Event, Finding
from ._path import OFF, ON, Path

NEEDED = {
    "iso": ("G17", "G21", "G40", "G80", "G90", "G49", "datum"),
    "linuxcnc": ("G17", "G21", "G40", "G80", "G90", "G49", "datum"),
    "siemens": ("G17", ("G71", "G710"), "G40", "G90", ("D0", "D1"), "datum"),
    "heidenhain": ("MM", ("length off", "length on"), ("datum", "datum shift")),
}
"""States that a program sets before its first motion, by dialect; of those in brackets one."""
TURNING = {"siemens": ("TRAFOOF",), "heidenhain": ("TCP off",)}
"""Those that only machines with rotary axes need; G49 cancels it elsewhere."""


def modal(path: Path) -> Iterator[Finding]:
    """Every modal state that the program relies on is set before the first motion."""
    first = next((e.line for e in path.events if e.motion), 1)
    wanted_states = [*NEEDED[path.dialect], *(TURNING.get(path.dialect, ()) if path.machine.rotary.any() else ())]
    needed = [(wanted,) if isinstance(wanted, str) else wanted for wanted in wanted_states]
    if missing := [" or ".join(names) for names in needed if not set(names) & path.control.before_motion]:
        yield path.fault("modal", first, f"the first motion comes before these are set: {', '.join(missing)}")


def first_move(path: Path) -> Iterator[Finding]:
    """From an unknown position: the tool axis alone to its top in machine coordinates, then the rotary axes, then the others."""
    known = np.zeros(len(path.machine.names), bool)
    for event in path.events:
        if event.kind == "stop" and BY_HAND.search(event.text):
            known[:] = False
        if not event.motion:
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
    if not known[tool]:
        alone = event.machine and moved[tool] and moved.sum() == 1
        return "" if alone else f"{axes} move before {names[tool]} alone has gone to its top in machine coordinates"
    high = abs(event.start[tool] - path.machine.top) < 1.0 and not moved[tool]
    if (rotary & ~known).any():
        return (
            "" if high and not (moved & ~rotary).any() else f"{axes} move before the rotary axes are where they belong"
        )
    if not (known | moved)[[i for i in range(len(names)) if i != tool]].all():
        return f"{axes} move together while another axis stands at an unknown position"
    return "" if high else f"{axes} move while {names[tool]} is not at its top"


def visits(path: Path) -> Iterator[Finding]:
    """Each row of a static run is a position at which the program rests, in the file's order; a recording follows its rows."""
    if path.run.static:
        yield from _static(path)
    else:
        yield from _recorded(path)


def _resolution(path: Path) -> float:
    return 0.51 * 10.0**-path.control.decimals + 1e-9


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


CHORD = 0.005
"""mm or degree that a recording's chords may stand off its rows."""


def _recorded(path: Path) -> Iterator[Finding]:
    """A dynamic run: the seated feed moves go through the rows at their times."""
    whole = [e for e in (path.events[i] for i in np.flatnonzero(path.seated)) if e.kind in ("feed", "dwell")]
    known = [e for e in whole if e.kind == "feed" and np.isfinite(e.end - e.start).all()]
    if not known:
        yield path.fault("poses", 1, "no move is made while the instrument is seated")
        return
    corners = [known[0].start]
    for event in whole:
        corners.append(event.end if event.kind == "feed" else corners[-1])
    times = np.concatenate([[0.0], np.cumsum([e.seconds for e in whole])])
    wanted = path.run.t - path.run.t[0]
    scale = times[-1] / wanted[-1]
    if not 0.99 < scale < 1.01:
        yield path.fault("poses", known[-1].line, f"the recording takes {times[-1]:.2f} s, its file {wanted[-1]:.2f} s")
        return
    there = np.stack([np.interp(wanted * scale, times, q) for q in np.array(corners).T], axis=1)
    off = np.abs(there - path.run.rows)
    k, i = np.unravel_index(np.argmax(off), off.shape)
    if off[k, i] > CHORD:
        unit = "degree" if path.machine.rotary[i] else "mm"
        says = f"line {k + 2} of {path.run.file.name}: {path.machine.names[i]} is {off[k, i]:.4f} {unit} from its row"
        yield path.fault("poses", known[0].line, says)


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
        if event.kind == "switch" and path.seated[i] and event.text not in ("G93", "G94", "G90", "G64", "G61"):
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
        ("length offset", control.length_on),
        ("tool-centre control", control.centred),
    ):
        if is_on:
            yield path.fault("end", line, f"the program ends with {state} on")
    if not any(e.kind == "end" for e in path.events):
        yield path.fault("end", line, "the program has no end (M30 or M2)")
