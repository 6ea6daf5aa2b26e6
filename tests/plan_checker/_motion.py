"""What the moves of one program do to the axes and to the bodies: travel, feeds, clearances, the bar's length."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ._bodies import Box, Cylinder, box_clearance, clearance
from ._events import Finding
from ._path import Path

Array = NDArray[np.float64]
TOUCH = 0.01
"""mm: what rounding of words may take."""
RAPID_MM = 5.0
"""What a rapid keeps off everything: the operator's real tool is that much longer or shorter."""
PROMISED = 0.5
"""Of every axis' feed: the share that the time table of a plan uses (docs/design.md)."""
BALL_RADIUS = 6.35
"""mm: half an inch across, as the balls of the usual bars are."""
NEST_MM = 10.0
"""Within this of its nest the ball moves at a feed, and not faster than `CREEP`."""
CREEP = 1000.0
LEAN_DEG = 0.05
OUT_MM = 1.75
"""How far a bar may be pulled out where it is fed in or out of a circle."""


def travel(path: Path) -> Iterator[Finding]:
    """Every axis stays within its travel along every block, linear ones clear of its ends at a feed."""
    low, high = path.machine.travel.T
    spare = np.where(path.machine.rotary, 0.0, np.minimum(_clearance(path), 0.1 * (high - low)))
    kept = np.where(path.rapid[:, None], 0.0, spare)
    beyond = np.maximum(low - path.q, path.q - high) + kept
    yield from _worst(path, "travel", beyond.max(axis=1), 1e-3, lambda k: _axis_beyond(path, beyond, k))


def _clearance(path: Path) -> float:
    """What bodies keep off each other, and linear axes off the ends of their travel, mm."""
    return float(path.machine.workspace.get("clearance", 2.0))


def _axis_beyond(path: Path, beyond: Array, k: int) -> str:
    i = int(np.argmax(beyond[k]))
    low, high = path.machine.travel[i]
    unit = _unit(path, i)
    where = f"{path.machine.names[i]} {path.q[k, i]:.3f} {unit}"
    return f"{where} leaves its travel of {low:g} to {high:g} {unit}, or comes near its end"


def feeds(path: Path) -> Iterator[Finding]:
    """No axis is asked for more than its greatest feed, nor in a static run for more than the promised share of it."""
    limit = path.machine.limit("max_feed")
    speed = np.zeros((len(path.known), len(limit)))
    for k, i in enumerate(path.known):
        event = path.events[i]
        if event.kind != "feed":
            continue
        if not np.isfinite(event.seconds) or event.seconds <= 0.0:
            yield path.fault("feed", event.line, "a feed move without a feed")
            continue
        own = path.q[path.owner == i] if event.centred or event.arc is not None else None
        way = (
            np.abs(event.end - event.start)
            if own is None
            else np.abs(np.diff(own, axis=0)).max(axis=0) * (len(own) - 1)
        )
        speed[k] = way / event.seconds * 60.0
    seated = path.seated[path.known] & path.run.static
    share = speed / limit / np.where(seated, PROMISED, 1.0)[:, None]
    for allowed, which in ((PROMISED, seated), (1.0, ~seated)):
        bad = np.flatnonzero((share.max(axis=1) > 1.01) & which)
        if bad.size:
            k = int(bad[np.argmax(share[bad].max(axis=1))])
            i = int(np.argmax(share[k]))
            says = (
                f"{path.machine.names[i]} is asked for {speed[k, i]:.0f} {_unit(path, i)}/min, {speed[k, i] / limit[i]:.2f} × "
                f"its greatest feed of {limit[i]:.0f}; {allowed:g} × is allowed here ({bad.size} such blocks)"
            )
            yield path.fault("feed", path.events[path.known[k]].line, says)


def clearances(path: Path) -> Iterator[Finding]:
    """Spindle nose, tool, bar, post and table keep apart along the whole path."""
    on_bar = path.seated[path.owner] & path.run.bar
    pairs: list[tuple[str, Cylinder, Cylinder, NDArray[np.bool_]]] = []
    stands = np.full(len(path.q), path.run.bar or path.run.nest)
    for name, body in (("spindle nose", path.nose), ("tool", path.stem)):
        if body is None:
            continue
        pairs.append((f"{name} and table", body, path.table, body.lowest() < RAPID_MM))
        pairs.append((f"{name} and what carries the table ball", body, path.post, stands))
    if path.nose is not None:
        pairs.append(("spindle nose and ball bar", path.nose, path.bar, on_bar))
    pairs.append(("ball bar and table", path.bar, path.table, on_bar & (path.bar.lowest() < 0.0)))
    pairs.append(("ball bar and what carries the table ball", path.bar, path.post, on_bar))
    for name, a, b, where in pairs:
        near = "ball bar and" in name or (path.run.probe and name == "tool and what carries the table ball")
        kept = np.where(path.rapid, max(RAPID_MM, _clearance(path)), 0.0 if near else _clearance(path))
        found = np.full(len(where), np.inf)
        if where.any():
            found[where] = clearance(a.at(where), b.at(where))
        yield from _worst(path, "clearance", kept - found, TOUCH, partial(_close, name, found))
    yield from _table_ball(path, stands)
    yield from _obstacles(path, on_bar)


def _obstacles(path: Path, on_bar: NDArray[np.bool_]) -> Iterator[Finding]:
    """Spindle nose, tool and bar keep off the boxes of the machine file, which turn with the table."""
    everywhere = np.ones(len(path.q), bool)
    for name, corners in path.machine.workspace.get("obstacles", {}).items():
        box = Box(*np.array(corners, float))
        for body, cylinder, where in (
            ("spindle nose", path.nose, everywhere), ("tool", path.stem, everywhere), ("ball bar", path.bar, on_bar),
        ):  # fmt: skip
            if cylinder is None or not where.any():
                continue
            found = np.full(len(where), np.inf)
            found[where] = box_clearance(cylinder.at(where), box)
            kept = np.where(path.rapid, max(RAPID_MM, _clearance(path)), _clearance(path))
            yield from _worst(path, "clearance", kept - found, TOUCH, partial(_close, f"{body} and {name}", found))


def _table_ball(path: Path, stands: NDArray[np.bool_]) -> Iterator[Finding]:
    """Spindle nose and, where the tool ball is not at the table ball, tool keep off the table ball."""
    centre = np.broadcast_to(path.run.table_ball, path.ball.shape)[:, None, :]
    apart = np.linalg.norm(path.ball - path.run.table_ball, axis=1) > 2.0 * BALL_RADIUS
    for name, body, where in (("spindle nose", path.nose, stands), ("tool", path.stem, stands & apart)):
        if body is not None:
            found = np.where(where, body.distance(centre)[:, 0] - BALL_RADIUS, np.inf)
            kept = np.where(path.rapid, RAPID_MM, _clearance(path) if name == "spindle nose" else 0.0)
            yield from _worst(path, "clearance", kept - found, TOUCH, partial(_close, f"{name} and table ball", found))


def _close(name: str, found: Array, k: int) -> str:
    return f"{name} meet by {-found[k]:.1f} mm" if found[k] < 0.0 else f"{name} come as close as {found[k]:.1f} mm"


def bar_length(path: Path) -> Iterator[Finding]:
    """While the bar is on it keeps its length within its stroke and nothing moves at a rapid."""
    if not path.run.bar:
        return
    on = path.seated[path.owner]
    length, stroke = float(path.run.table["length"]), float(path.machine.workspace.get("bar_stroke", 1.0))
    longer = path.bar.length - length
    circular = any(path.events[i].arc is not None for i in path.known)
    fed = np.array([circular and e.kind == "feed" and e.arc is None for e in path.events], bool)[path.owner]
    most = np.where(fed, np.maximum(stroke, OUT_MM), stroke)
    off = np.where(on, np.maximum(longer - most, -longer - stroke), -np.inf)
    yield from _worst(
        path, "bar", off, 1e-6,
        lambda k: f"the bar of {length:g} ± {stroke:g} mm is on and would have to be {path.bar.length[k]:.3f} mm long",
    )  # fmt: skip
    yield from _worst(path, "bar", (on & path.rapid).astype(float), 0.5, lambda k: "a rapid while the bar is on")


def nest(path: Path) -> Iterator[Finding]:
    """The ball comes to its nest and leaves it from above at a creeping feed, between poses it stays in or goes out, and the tool
    leans no further than the nest opens."""
    if not path.run.nest:
        return
    away = np.linalg.norm(path.ball - path.run.table_ball, axis=1)
    near = away < NEST_MM
    yield from _worst(
        path, "nest", np.where(near & path.rapid, NEST_MM - away, -np.inf), TOUCH,
        lambda k: f"a rapid passes the nest at {away[k]:.2f} mm",
    )  # fmt: skip
    low = path.run.table_ball[2] - path.ball[:, 2]
    sensor = float(path.machine.workspace.get("sensor_range", 1.0))
    yield from _worst(
        path, "nest", np.where(near & (away > sensor), low, -np.inf), 2.0 * sensor,
        lambda k: f"the ball comes to its nest from {low[k]:.2f} mm below",
    )  # fmt: skip
    yield from _dragged(path, away, sensor)
    lean = np.degrees(np.arccos(np.clip(path.tool[:, 2], -1.0, 1.0)))
    opening = float(path.machine.workspace.get("nest_opening", 180.0))
    yield from _worst(
        path, "nest", np.where(near, lean - opening, -np.inf), LEAN_DEG,
        lambda k: f"the tool leans {lean[k]:.1f}° in a nest that opens to {opening:g}°",
    )  # fmt: skip


def _dragged(path: Path, away: Array, sensor: float) -> Iterator[Finding]:
    """From rest to rest the ball stays within the sensors' range or goes out of the nest, slowly where it is near it."""
    rests = np.cumsum([event.kind in ("dwell", "stop") for event in path.events])
    for part in np.unique(rests[path.known]):
        inside = rests[path.owner] == part
        farthest, k = float(away[inside].max()), int(np.flatnonzero(inside)[np.argmax(away[inside])])
        if sensor < farthest <= NEST_MM:
            says = f"the ball leaves its nest by {farthest:.3f} mm, the sensors reach {sensor:g} mm"
            yield path.fault("nest", path.events[path.owner[k]].line, says)
        for i in np.unique(path.owner[inside & (away <= NEST_MM)]) if farthest > NEST_MM else ():
            event, own = path.events[i], path.owner == i
            speed = 60.0 * np.linalg.norm(np.diff(path.ball[own], axis=0), axis=1).sum() / event.seconds
            if event.kind == "feed" and speed > CREEP:
                yield path.fault(
                    "nest", event.line, f"the ball passes its nest's edge at {speed:.0f} mm/min, above {CREEP:g}"
                )


def _worst(path: Path, check: str, excess: Array, allowed: float, says: Callable[[int], str]) -> Iterator[Finding]:
    """One finding at the worst sample where `excess` is above what is allowed, with the number of blocks."""
    bad = np.flatnonzero(excess > allowed)
    if not bad.size:
        return
    k = int(bad[np.argmax(excess[bad])])
    event, blocks = path.events[path.owner[k]], len(set(path.owner[bad].tolist()))
    pose = " ".join(f"{name}{value:.3f}" for name, value in zip(path.machine.names, path.q[k], strict=True))
    more = f" ({blocks} such blocks)" if blocks > 1 else ""
    yield path.fault(check, event.line, f"{says(k)} in a {event.kind} move, at {pose}{more}")


def _unit(path: Path, axis: int) -> str:
    return "degree" if path.machine.rotary[axis] else "mm"
