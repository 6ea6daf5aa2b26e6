"""Dynamic paths: the most informative circles for drives and backlash, with centring errors and set-up as nuisances.

A synchronous circle (rotary and linear axis together, paper 3) has a radius r, a distance X_T of its centre from the rotary
axis, a feed, a height and a direction. Near X_T/r = 1 the rotary axis must turn at F/|X_T - r|, so the drives' lag is seen well
there, up to the axis' limits; a backlash is seen only where the axis reverses, which needs X_T > r. A planar circle has a
centre, a radius and a feed. Balls and bar stay mounted from run to run, but may creep: circles are chosen as if every run had
set-up errors of its own. Its information with these marginalised adds to that of the others, so circles are chosen like poses
(greedy and exchange), the chosen ones refined together (`_refine_circles`) and compared with a dense set of circles at the same
cost (`_circle_certificate`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from symfive.campaign import Campaign
from symfive.design._assess import Assessment, assess, assessment_data
from symfive.design._circle_certificate import CircleCertificate, certify_circles, farthest, fastest
from symfive.design._circle_words import (
    circle_words,
    gain_words,
    limit_words,
    list_end_words,
    sigma_words,
    slow_noise_words,
    warnings_of,
)
from symfive.design._circles import Circle, Goal, check_clear, chosen_clear, circle_of_runs, measured
from symfive.design._information import Information, expected_information
from symfive.design._paths import FAMILIES, CircleShape, circle_runs
from symfive.design._refine_circles import CircleObjective, refined_shapes
from symfive.design._request import check_robust
from symfive.design._write import SCHEMA, Written, write_recordings
from symfive.effects import Effect
from symfive.errors import InputError, among
from symfive.given import machine_given
from symfive.machine import Machine
from symfive.model import Model
from symfive.nc import Post
from symfive.optimal import criterion_of
from symfive.parameters import Parameter
from symfive.procedures import PLANES, campaign_of, circle_frame, heights, left_in_place, senses
from symfive.screen import listed, plural
from symfive.threads import one_thread

RATIOS = (0.0, 0.3, 0.5, 0.7, 0.8, 0.85, 0.9, 1.1, 1.15, 1.2, 1.3, 1.5, 1.8)
FREE = {"synchronous": ("ratio", "feed"), "planar": ("feed", "x", "y", "z")}
WIDER = 1.4
"""Step of further ratios, as between the last of these."""
SLOWEST = 500.0
"""mm/min of the slowest circles where no feeds are given; faster ones double it up to the fastest linear axis."""
RATE_HZ = 50.0
DRAWS = 4
TO_RUN = {"ratio": 1e-4, "radius": 1e-3, "feed": 1.0, "height": 1.0, "x": 1.0, "y": 1.0, "z": 1.0}
"""To what a refined value is rounded, mm and mm/min."""
BACK = (1.0, 0.99, 0.97, 0.9, 0.7, 0.4)
"""Shares of the way from the listed circle to the refined one: the first that the axes can follow is taken."""
LEAST_GAIN = 1e-6


@dataclass(frozen=True, repr=False)
class CirclePlan(Written):
    """Circles chosen together: the campaign; its `circles`; the expected 1σ of the effects' `parameters` (file units); all
    circles `considered`; ψ of the best of these (`grid_value`) and of the refined ones (`value`); `notes` in plain
    words: limits and ends of lists that were reached, repeated circles, parameters that no circle determines; the
    `certificate` and the expected `information`, None if not asked for."""

    campaign: Campaign
    circles: tuple[Circle, ...]
    sigma: dict[str, float]
    considered: tuple[Circle, ...]
    value: float
    grid_value: float
    effects: tuple[Effect, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    notes: tuple[str, ...] = ()
    certificate: CircleCertificate | None = None
    information: Information | None = None

    @cached_property
    def assessment(self) -> Assessment:
        """What is expected of the machine's errors and the effects together."""
        return assess(self.campaign, effects=self.effects)

    def to_data(self) -> dict[str, Any]:
        """plan.json as nested mappings."""
        shapes = [
            {"family": c.shape.family, "direction": c.shape.direction, "plane": c.shape.plane, **c.shape.values}
            for c in self.circles
        ]
        return {
            "schema": SCHEMA, "machine": self.campaign.machine.name, "circles": shapes, "minutes": self.minutes,
            "certificate": None if self.certificate is None else self.certificate.to_data(),
            "information": None if self.information is None else self.information.to_data(),
            "value": self.value, "value_of_the_grid": self.grid_value, "considered": len(self.considered),
            **assessment_data(self.assessment), "notes": list(self.notes),
        }  # fmt: skip

    def _write_into(self, folder: Path, nc: tuple[str, ...], post: Post | None) -> None:
        worth = "" if self.certificate is None else f"Certificate: {self.certificate.says}"
        write_recordings(self.campaign, self.assessment, self.to_data(), folder, nc, post, worth)

    def __str__(self) -> str:
        lines = [
            f"{plural(len(self.circles), 'circle')} of {len(self.considered)} considered, {self.minutes:.1f} min of recording"
        ]
        lines += [f"  {circle_words(circle)}" for circle in self.circles]
        lines += listed(sigma_words(self.parameters, self.sigma), "plan.sigma")
        notes = listed(self.notes, "plan.notes", 10)
        says = [each.says for each in (self.certificate, self.information) if each is not None]
        return "\n".join([*lines, gain_words(self.grid_value, self.value), *says, *notes])

    @property
    def minutes(self) -> float:
        """Time of the recordings, without set-up."""
        return sum(circle.seconds for circle in self.circles) / 60.0


@one_thread
def plan_circles(
    machine: Machine | Path | str, effects: Sequence[Effect], *, family: str = "synchronous", count: int = 2,
    radii: Sequence[float] = (50.0,), ratios: Sequence[float] | None = None, feeds: Sequence[float] | None = None,
    centres: Sequence[Sequence[float]] = (), planes: Sequence[str] = ("XY",), directions: Sequence[str] = ("both",),
    for_: Iterable[str] = (), criterion: str = "D", robust: str = "nominal", draws: int = DRAWS,
    per_minute: bool = False, refine: bool = True, free: Sequence[str] | None = None, noise_um: float = 0.3,
    rate_hz: float = RATE_HZ, certify: bool = True,
) -> CirclePlan:  # fmt: skip
    """The `count` circles that together tell most about the parameters of the effects.

    `family` `synchronous` (ratios X_T/r × radii × feeds) or `planar` (centres, mm in the workpiece frame, × planes × radii ×
    feeds); `ratios` by default up to the table's edge, `feeds` (mm/min) from 500 up to the fastest linear
    axis; `directions` `both`, `ccw`, `cw` to choose from; `for_` names of the parameters that count (default: all of the
    effects'); `robust` `nominal`, or the `mean` or `worst` case over `draws` of the effects' parameters from their priors;
    `per_minute` weights the recording time. `refine`: the best circles are refined in the variables `free` (default ratio and
    feed; feed and centre) within the ranges of the lists, and kept only if better. `certify`: they are compared
    with a dense set of circles in as many runs, or in the same time (`CirclePlan.certificate`), and their expected
    information, averaged over the priors, is bounded (`CirclePlan.information`). Circles that an axis cannot
    follow, with the ball off the table (`table_radius`) or with a collision are left out. Raises
    `InputError` if none is left or a name is unknown.
    """
    machine = machine_given(machine)
    _check(family, robust, count, planes, directions, free)
    offered = feeds_of(machine) if feeds is None else feeds
    wide = ratios_of(machine, radii) if ratios is None else ratios
    shapes = _shapes(machine, family, radii, wide, offered, centres, planes, directions)
    extra = 0 if robust == "nominal" else draws
    circles = _followed(machine, effects, shapes, noise_um, rate_hz, extra)
    model = Model(Campaign(machine=machine, runs=circles[0].runs), effects)
    wanted = tuple(for_)
    goal = _goal(model, wanted, criterion, robust, per_minute)
    chosen, circles = chosen_clear(machine, goal, circles, count)
    best, notes = chosen, []
    if refine:
        movable = tuple(free or FREE[family])
        bounds = _bounds(machine, shapes, movable)
        try:
            objective = CircleObjective(machine, effects, chosen, movable, bounds, goal, rate_hz)
        except InputError as error:
            notes.append(str(error))
        else:
            best = _kept(machine, effects, goal, chosen, refined_shapes(objective), noise_um, rate_hz, extra)
    best = _by_mounting(best)
    most = {"feed": fastest(machine) or math.inf, "ratio": farthest(machine) / min(radii)}
    notes += [*limit_words(machine, best), *list_end_words(best, shapes, most)]
    found = _plan_of(machine, model, goal, effects, circles, chosen, best, notes)
    if not certify:
        return found
    certificate = certify_circles(machine, effects, goal, best, circles, noise_um=noise_um, rate_hz=rate_hz)
    own = tuple(replace(run, mounting={}) for run in found.campaign.runs)
    information = expected_information(replace(found.campaign, runs=own), effects, for_=wanted)
    return replace(found, certificate=certificate, information=information)


def ratios_of(machine: Machine, radii: Sequence[float]) -> tuple[float, ...]:
    """Ratios X_T/r where none are given: `RATIOS`, further ones in steps of `WIDER` up to the table's edge."""
    top = farthest(machine) / min(radii, default=math.inf)
    steps = max(math.ceil(math.log(max(top / RATIOS[-1], 1.0), WIDER)), 1)
    further = (*(RATIOS[-1] * WIDER**i for i in range(1, steps)), top)
    return tuple(ratio for ratio in (*RATIOS, *further) if ratio <= top)


def feeds_of(machine: Machine) -> tuple[float, ...]:
    """Feeds of circles where none are given, mm/min: doubled from `SLOWEST` up to the fastest linear axis."""
    top = fastest(machine) or 2.0 * SLOWEST
    steps = max(math.ceil(math.log2(top / SLOWEST)), 0)
    return (*(SLOWEST * 2.0**i for i in range(steps)), top)


def _check(
    family: str, robust: str, count: int, planes: Sequence[str], directions: Sequence[str], free: Sequence[str] | None
) -> None:
    among(family, FAMILIES, f'there are no "{family}" circles')
    check_robust(robust)
    if count < 1:
        raise InputError(f"count = {count} is too few", remedy="give at least 1")
    for name in free or ():
        if name not in FAMILIES[family]:
            raise InputError(f"a {family} circle has no variable {name}", remedy=f"use {', '.join(FAMILIES[family])}")
    for plane in planes:
        among(plane, PLANES, f'plane "{plane}" is unknown')
    for direction in directions:
        senses(direction)


def _shapes(
    machine: Machine, family: str, radii: Sequence[float], ratios: Sequence[float], feeds: Sequence[float],
    centres: Sequence[Sequence[float]], planes: Sequence[str], directions: Sequence[str],
) -> list[CircleShape]:  # fmt: skip
    level = sum(heights(machine)) / 2.0
    if not (radii and feeds):
        raise InputError("no circle is described", remedy="give at least one radius and one feed")
    if family == "synchronous":
        circle_frame(machine)
        return [
            CircleShape(
                family=family, direction=direction,
                values={"ratio": ratio, "radius": radius, "feed": feed, "height": level},
            )
            for radius, ratio, feed, direction in itertools.product(radii, ratios, feeds, directions)
        ]  # fmt: skip
    return [
        CircleShape(
            family=family, direction=direction, plane=plane,
            values={"radius": radius, "feed": feed, "x": centre[0], "y": centre[1], "z": centre[2]},
        )
        for centre, plane, radius, feed, direction in itertools.product(
            centres or ((*machine.table_centre, level),), planes, radii, feeds, directions
        )
    ]  # fmt: skip


def _followed(
    machine: Machine,
    effects: Sequence[Effect],
    shapes: Sequence[CircleShape],
    noise_um: float,
    rate_hz: float,
    draws: int,
) -> list[Circle]:
    """The circles that the axes can follow, with the ball on the table. Raises `InputError` where there is none."""
    circles, refused = [], None
    for shape in shapes:
        try:
            runs = circle_runs(machine, shape, noise_um=noise_um, rate_hz=rate_hz)
        except InputError as error:
            refused = error
        else:
            circles.append(circle_of_runs(machine, effects, shape, runs, draws))
    if not circles and refused is not None:
        raise InputError(f"no circle can be run: {refused.problem}", remedy=refused.remedy)
    return circles


def _goal(model: Model, for_: tuple[str, ...], criterion: str, robust: str, per_minute: bool) -> Goal:
    shared = [p for p in model.parameters if p.kind != "setup"]
    wanted = [p.name for p in shared if p.kind == "effect"]
    for name in for_:
        if name not in {p.name for p in shared}:
            raise InputError(f"there is no parameter {name}", remedy=f"use one of {', '.join(wanted)}")
    interest = np.array([i for i, p in enumerate(shared) if p.name in (for_ or wanted)], dtype=np.int64)
    measure = criterion_of(criterion, len(interest), np.zeros((0, 3, len(interest))))
    return Goal(measure, interest, np.array([p.sigma for p in shared]), robust, per_minute)


def _bounds(machine: Machine, shapes: Sequence[CircleShape], free: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Ranges of the lists; height and centre may go wherever a ball may stand."""
    reach, (x, y) = machine.workspace.table_radius or 0.0, machine.table_centre
    room = {"height": heights(machine), "z": heights(machine), "x": (x - reach, x + reach), "y": (y - reach, y + reach)}
    return {
        name: room.get(name, (min(s.values[name] for s in shapes), max(s.values[name] for s in shapes)))
        for name in free
    }


def _kept(
    machine: Machine, effects: Sequence[Effect], goal: Goal, chosen: list[Circle], shapes: Sequence[CircleShape],
    noise_um: float, rate_hz: float, draws: int,
) -> list[Circle]:  # fmt: skip
    """The refined circles as they would be run, where they are better than those they came from."""
    found = []
    for shape, circle in zip(shapes, chosen, strict=True):
        start = circle.shape.values
        for share in BACK:
            values = {name: start[name] + share * (value - start[name]) for name, value in shape.values.items()}
            rounded = replace(shape, values={n: round(v / TO_RUN[n]) * TO_RUN[n] for n, v in values.items()})
            try:
                refined = measured(machine, effects, rounded, noise_um=noise_um, rate_hz=rate_hz, draws=draws)
                check_clear(machine, refined.runs)
                found.append(refined)
                break
            except InputError:
                continue
        else:
            return chosen
    return found if goal.value(found) < goal.value(chosen) - LEAST_GAIN else chosen


def _by_mounting(circles: Sequence[Circle]) -> list[Circle]:
    """The circles, those with balls and bar alike one after another, so that these can stay."""
    stand = [circle.runs[0].stands for circle in circles]
    return [circles[i] for i in sorted(range(len(circles)), key=lambda i: stand.index(stand[i]))]


def _plan_of(
    machine: Machine, model: Model, goal: Goal, effects: Sequence[Effect], circles: Sequence[Circle],
    chosen: list[Circle], best: list[Circle], notes: Sequence[str],
) -> CirclePlan:  # fmt: skip
    shared = [p for p in model.parameters if p.kind != "setup"]
    total = np.sum([circle.matrix for circle in best], axis=0)
    spread = np.sqrt(np.diag(goal.covariance(total))) * goal.scale
    sought = tuple(p for p in shared if p.kind == "effect")
    sigma = {p.name: float(s) for p, s in zip(shared, spread, strict=True) if p in sought}
    runs = [
        replace(run, id=f"{i + 1}-{run.id}", file=f"{i + 1}-{run.id}.csv")
        for i, circle in enumerate(best)
        for run in circle.runs
    ]
    campaign = campaign_of(machine, [*left_in_place(runs)], "circles")
    warnings = [*warnings_of(best, effects, sought, sigma), *slow_noise_words(campaign, effects, sought)]
    return CirclePlan(
        campaign=campaign, circles=tuple(best), sigma=sigma, considered=tuple(circles),
        value=goal.value(best), grid_value=goal.value(chosen), effects=tuple(effects), parameters=sought,
        notes=(*notes, *warnings),
    )  # fmt: skip
