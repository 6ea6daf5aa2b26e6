"""The next test: the one with the same instrument that separates rivals best."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, zip_longest

import numpy as np

from symfive.campaign import Campaign, Run, Vector
from symfive.design import APART, PAUSE_S, Candidate, Discrimination, discriminate, in_addition, in_common
from symfive.effects import Effect, moving
from symfive.errors import InputError
from symfive.model import Model
from symfive.motion import programme_of
from symfive.procedures import Nominal, planar_circle, r_test_grid

SHIFT_MM = 150.0
RUN_UP_DEG = 15.0
HALF_DEG = 180.0 - 2.0 * RUN_UP_DEG
LIFT_MM = 100.0
FACTOR = 2.0
IMPROBABLE = 0.05
"""Two rivals that are together less probable than this need not be separated from each other."""
MOST_ROTARY = 2
"""A grid over the rotary axes is a test for machine tools; for an arm of seven it is none."""


def next_test(
    campaign: Campaign,
    first: Effect,
    *rivals: Effect,
    held: tuple[Effect, ...] = (),
    values: Mapping[str, float] | None = None,
    rival_values: Sequence[Mapping[str, float]] = (),
    chances: Sequence[float] = (),
) -> Discrimination | None:
    """Which further test separates an explanation from its rivals, by how many σ; None where no test can be varied.

    `held` effects are in all models, and what cannot stand beside them is no rival any more; `values` parameters at which
    the first is true and `rival_values` those at which each rival is (default: of typical size). Of several rivals as many
    as can be separated at all count. The first may be wrong, so rivals are separated from each other too: those that the best
    test leaves get a further one. `chances` of the rivals (default: all count).
    """
    tests = list(possible_tests(campaign))
    if not tests or not rivals:
        return None
    plan = replace(campaign, runs=tuple(run.with_readings({}) for run in campaign.runs))
    models = {first.key: (Model(plan, (*held, first)), values)}
    for rival, theirs in zip_longest(rivals, rival_values):
        try:
            models[rival.key] = Model(plan, (*held, rival)), theirs
        except InputError:
            continue

    def parted(a: str, b: str, tests: Sequence[Candidate]) -> Discrimination:
        (one, at), (other, there) = models[a], models[b]
        return discriminate(one, other, tests, values_a=at, values_b=there)

    others = [key for key in models if key != first.key]
    if not others:
        return None
    own = {key: parted(first.key, key, tests) for key in others}
    best = in_common(own, tests)
    if not best.useful:
        return best
    probable = dict(zip_longest((rival.key for rival in rivals), chances, fillvalue=1.0))
    pairs = [(a, b) for a, b in combinations(others, 2) if probable[a] + probable[b] > IMPROBABLE]
    between = {pair: parted(*pair, tests) for pair in pairs}
    every = own | {" from ".join(pair): part for pair, part in between.items()}
    chosen = in_addition(every, best.test.runs[0].id)
    if len(chosen) == 1:
        return best
    runs = _in_turn([run for name in chosen for run in tests if run.id == name])
    together = in_common({key: parted(first.key, key, [runs]) for key in others}, [runs])
    also = [pair for pair, part in between.items() if max(s.sigmas for s in part.table if s.name in chosen) >= APART]
    return replace(together, table=(*together.table, *best.table), also=tuple(also))


def _in_turn(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Runs one after the other."""
    found = [runs[0]]
    for run in runs[1:]:
        found.append(replace(run, start_s=found[-1].start_s + found[-1].duration + PAUSE_S))
    return tuple(found)


def possible_tests(campaign: Campaign) -> Iterator[Run]:
    """Variations of the campaign's own tests that stay inside the travels: a repeat, other feeds, the other direction,
    another place, height or radius, other nests."""
    seen: set[tuple[str, ...]] = set()
    for run in campaign.runs:
        kind = (*run.instrument, *(n for n in moving(replace(campaign, runs=(run,)))), run.sampling)
        if kind in seen:
            continue
        seen.add(kind)
        bare = programme_of(run)
        variants = _dynamic(campaign, bare) if run.dynamic else _static(campaign, bare)
        yield from (v for v in (_named(bare, "repeat", bare), *variants) if _inside(campaign, v))


def _named(run: Run, name: str, changed: Run) -> Run:
    """What a run is changed to under a name of its own; what is mounted otherwise has a mounting of its own."""
    label, balls = f"{run.id}-{name}", ("table_ball", "tool_ball")

    def stays(*places: str) -> bool:
        return all(getattr(changed, place) == getattr(run, place) for place in places)

    kept = {k: v for k, v in run.mounting.items() if (stays(k) if hasattr(run, k) else stays(*balls))}
    return replace(changed, id=label, file=f"{label}.csv", mounting=kept)


def _reversed(run: Run) -> Run:
    """The same rows in the opposite order, each with its angle of the spindle."""
    back = {axis: values[::-1] for axis, values in run.commands.items()}
    spindle = None if run.spindle is None else run.spindle[::-1]
    return _named(run, "reversed", replace(run, commands=back, spindle=spindle))


def _dynamic(campaign: Campaign, run: Run) -> Iterator[Run]:
    for name, factor in (("faster", 1.0 / FACTOR), ("slower", FACTOR)):
        yield _named(run, name, replace(run, time=run.time * factor))
    yield _reversed(run)
    if _planar(campaign, run):
        yield from _centres(campaign, run)
    elif run.instrument in (("ball_bar",), ("r_test",)):
        yield from _mounted_elsewhere(campaign, run)
    if _planar(campaign, run) or _synchronous(campaign, run):
        yield from _planes(campaign, run)


def _static(campaign: Campaign, run: Run) -> Iterator[Run]:
    yield _reversed(run)
    if _planar(campaign, run):
        yield from _centres(campaign, run)
    elif run.instrument == ("ball_bar",):
        yield from _mounted_elsewhere(campaign, run)
    elif run.instrument == ("r_test",) and sum(a.rotary for a in campaign.machine.axes.values()) <= MOST_ROTARY:
        for name, (nest, tool) in _mountings(run).items():
            try:
                for grid in r_test_grid(campaign.machine, nests=(nest,), tool_ball=tool):
                    noise = replace(grid, noise_um=run.noise_um, setup_sigma_um=run.setup_sigma_um)
                    yield _named(run, name, noise)
            except InputError:
                continue


def _mountings(run: Run) -> dict[str, tuple[Vector, Vector]]:
    """Other places of the table ball, and a longer tool: name → table ball and tool ball, mm."""
    (x, y, z), tool = run.table_ball, run.tool_ball
    places: dict[str, Vector] = {"opposite": (-x, -y, z), "higher": (x, y, z + LIFT_MM), "turned": (-y, x, z)}
    longer = (tool[0], tool[1], tool[2] - LIFT_MM)
    others = {name: (ball, tool) for name, ball in places.items() if ball != run.table_ball}
    return others | {"longer-tool": (run.table_ball, longer)}


def _mounted_elsewhere(campaign: Campaign, run: Run) -> Iterator[Run]:
    """The same poses or path of a bar or an R-test with the table ball at another place, or with a longer tool."""
    nominal, (x, y, z) = Nominal(campaign.machine), run.table_ball
    turned = {n: run.commands[n] for n, a in campaign.machine.axes.items() if a.rotary}
    bar = nominal.ball(run.commands, run.tool_ball) - np.asarray(run.table_ball)
    for name, (ball, tool) in (_mountings(run) | {"beside": ((x + SHIFT_MM, y, z), run.tool_ball)}).items():
        try:
            commands = nominal.follow(bar + np.asarray(ball), tool, turned, run.id)
        except InputError:
            continue
        yield _named(run, name, replace(run, commands=commands, table_ball=ball, tool_ball=tool))


def _planes(campaign: Campaign, run: Run) -> Iterator[Run]:
    """Circles of linear axes in other planes about the same ball at the same feed: whole ones in XY, else the half above the
    centre. Two axes together show only in what they differ; with a third one each is seen by itself."""
    linear = {c: run.commands[n] for n, a in campaign.machine.axes.items() for c in _along(a.direction)}
    moved = {c for c, way in linear.items() if np.ptp(way) > 0.0}
    if _synchronous(campaign, run):
        moved.add("a rotary axis")
    radius = run.length if run.length is not None else 0.5 * max(float(np.ptp(way)) for way in linear.values())
    for plane, start, sweep in (("XY", 0.0, 360.0), ("YZ", RUN_UP_DEG, HALF_DEG), ("ZX", RUN_UP_DEG - 90.0, HALF_DEG)):
        if moved == {c.lower() for c in plane}:
            continue
        try:
            arcs = planar_circle(
                campaign.machine, plane=plane, instrument=run.instrument[0], radius=radius, feed=_feed(campaign, run),
                direction="ccw", centre=run.table_ball, start_deg=start, sweep_deg=sweep, run_up_deg=RUN_UP_DEG,
                tool_ball=run.tool_ball, rate_hz=1.0 / run.interval, noise_um=run.noise(run.instrument[0]),
                setup_sigma_um=run.setup_sigma_um,
            )  # fmt: skip
        except InputError:
            continue
        for arc in arcs:
            yield _named(run, f"in-{plane}", arc)


def _synchronous(campaign: Campaign, run: Run) -> bool:
    """One linear and one rotary axis make a circle together."""
    kinds = [campaign.machine.axes[n].rotary for n in moving(replace(campaign, runs=(run,)))]
    return run.length is not None and sorted(kinds) == [False, True]


def _feed(campaign: Campaign, run: Run) -> float:
    """Usual speed of the tool over the table, mm/min; a rotary axis turns at the distance of the linear one that moves."""
    driven = {n: campaign.machine.axes[n] for n in moving(replace(campaign, runs=(run,)))}
    reach = max((np.abs(run.commands[n]) for n, a in driven.items() if not a.rotary), key=np.ptp)
    steps = [np.diff(run.commands[n] * a.to_internal) * (reach[1:] if a.rotary else 1.0) for n, a in driven.items()]
    return 60.0 * float(np.median(np.linalg.norm(steps, axis=0) / np.diff(run.time)))


def _along(direction: Sequence[float]) -> Iterator[str]:
    """The coordinate along which an axis moves."""
    yield from (c for c, d in zip("xyz", direction, strict=True) if abs(d) > 0.99)


def _planar(campaign: Campaign, run: Run) -> bool:
    """Linear axes alone move: then a test can be shifted in space as it is."""
    return bool(moving(replace(campaign, runs=(run,)))) and all(
        np.ptp(run.commands[name]) == 0.0 and run.commands[name][0] == 0.0
        for name, axis in campaign.machine.axes.items()
        if axis.rotary
    )


def _centres(campaign: Campaign, run: Run) -> Iterator[Run]:
    axes = {
        c: name
        for name, a in campaign.machine.axes.items()
        for c, d in zip("xyz", a.direction, strict=True)
        if abs(d) > 0.99 and not a.rotary
    }
    for c, distance in (("x", SHIFT_MM), ("y", SHIFT_MM), ("z", LIFT_MM)):
        if c not in axes:
            continue
        for sign, word in ((1.0, "plus"), (-1.0, "minus")):
            step = sign * distance
            commands = {n: v + step if n == axes[c] else v for n, v in run.commands.items()}
            moved = [b + step if k == c else b for k, b in zip("xyz", run.table_ball, strict=True)]
            place = replace(run, commands=commands, table_ball=(moved[0], moved[1], moved[2]))
            yield _named(run, f"centre-{word}-{distance:.0f}-{c}", place)
    if run.length is not None:
        centre = {axes[c]: 0.0 for c in axes}
        for name in centre:
            way = run.commands[name]
            centre[name] = 0.5 * float(way.max() + way.min()) if np.ptp(way) > 0 else float(way[0])
        commands = {n: centre[n] + (v - centre[n]) / FACTOR if n in centre else v for n, v in run.commands.items()}
        yield _named(run, "half-radius", replace(run, commands=commands, length=run.length / FACTOR))


def _inside(campaign: Campaign, run: Run) -> bool:
    for name, axis in campaign.machine.axes.items():
        values = run.commands[name]
        if values.min() < axis.travel[0] or values.max() > axis.travel[1]:
            return False
        if run.dynamic and axis.max_feed is not None and run.fastest(values) > axis.max_feed:
            return False
    return True
