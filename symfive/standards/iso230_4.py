"""Circular tests (ISO 230-4): circular deviation G, bi-directional G(b), radial deviation F, mean radial deviation D.

With d(φ) the radius read less the nominal one, the least-squares circle removes its centre (a, b) and leaves
e = d - a cos φ - b sin φ - (a sin φ - b cos φ)²/2R, the last one exactly and only where a bar is read; then

    G    = max e - min e                       one direction, its own centre
    G(b) = max e - min e                       both directions, their common centre
    F    = max e, min e                        one direction, its own centre; needs the bar's true length
    D    = mean of e                           both directions, their common centre; needs the bar's true length
    S    = -2 s / R                            squareness, s the sine of 2φ in the mean of both directions

S > 0: the angle from the first to the second positive axis is 90° + S. Least squares is the accepted evaluation of the
minimum zone that the standard defines. Only the 360° amid the run are evaluated. An expanded uncertainty holds the
declared noise of a reading (1σ, at the extreme readings through the fit of the centre) and for F and D the length's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symfive.arrays import Array, Flags
from symfive.campaign import Campaign, Run
from symfive.circles import INSTRUMENTS, Circle, CircleFinder, grouped
from symfive.instruments import columns_of, has_bar
from symfive.numbers import plain_number
from symfive.screen import plural
from symfive.standards._value import COVERAGE, StandardValue, moved, place_of

STANDARD = "ISO 230-4"
KNOWN_LENGTH_UM = 50.0
"""From this prior 1σ of the bar's length on it was not calibrated: F and D are not stated."""
LEAST_TURN = 0.4
"""Of a shorter arc no centre is known."""
GAP = 3.0
"""A step of the angle so many times the usual one is a place without readings."""
FULL = 2.0 * np.pi
SENSES = {1: "CCW", -1: "CW"}


@dataclass(frozen=True)
class _Fitted:
    """Deviations (N,) µm about their least-squares centre: `left` (N,) and the design (N, 3) orthonormal."""

    left: Array
    basis: Array
    centre: Array

    @classmethod
    def of(cls, angle: Array, deviation: Array) -> _Fitted:
        waves = np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)], axis=1)
        a, b, _ = np.linalg.lstsq(waves, deviation, rcond=None)[0]
        return cls(deviation - a * waves[:, 0] - b * waves[:, 1], np.linalg.qr(waves)[0], np.array([a, b]))

    @property
    def range(self) -> float:
        return float(np.ptp(self.left))

    @property
    def noise_of_range(self) -> float:
        """1σ of the range per 1σ of a reading: through the two extreme readings and the fit."""
        weights = np.zeros_like(self.left)
        weights[np.argmax(self.left)], weights[np.argmin(self.left)] = 1.0, -1.0
        return float(np.linalg.norm(weights - self.basis @ (self.basis.T @ weights)))


def circular_values(campaign: Campaign) -> tuple[StandardValue, ...]:
    """G of every measured circle of the linear axes, G(b), D and the squareness of each pair of directions, F where the length
    is known."""
    finder, rotary = CircleFinder(campaign.machine), set(campaign.machine.rotary_axes)
    found = [finder.find(run) for run in campaign.runs if run.measured]
    circles = [
        circle for circle in found
        if circle is not None and circle.turns > LEAST_TURN and not moved(circle.run) & rotary
    ]  # fmt: skip
    values: list[StandardValue] = []
    for group in grouped(circles):
        for circle in group:
            values += _one_sense(campaign, circle)
        senses = [[circle for circle in group if circle.sense == sense] for sense in (1, -1)]
        for ccw, cw in zip(*senses, strict=False):
            values += _both(campaign, ccw, cw)
    return tuple(values)


def _one_sense(campaign: Campaign, circle: Circle) -> list[StandardValue]:
    angle, deviation = _data(circle, campaign)
    fitted, noise, run = _Fitted.of(angle, deviation), _noise(circle.run), circle.run
    g = StandardValue(
        standard=STANDARD, name="G", what=_named(circle, SENSES[circle.sense]), value=fitted.range,
        u=COVERAGE * noise * fitted.noise_of_range, unit="um", runs=(run.id,),
        conditions=_conditions(campaign, circle, SENSES[circle.sense], angle), limits=_limits(circle, angle),
    )  # fmt: skip
    if _length(run) >= KNOWN_LENGTH_UM or not circle.whole:
        return [g]
    u = COVERAGE * float(np.hypot(noise, _length(run)))  # of the reading itself and the length
    extremes = {"Fmax": fitted.left.max(), "Fmin": fitted.left.min()}
    return [g, *(replace(g, name=name, value=float(value), u=u) for name, value in extremes.items())]


def _both(campaign: Campaign, ccw: Circle, cw: Circle) -> list[StandardValue]:
    parts = [_data(circle, campaign) for circle in (ccw, cw)]
    angle, deviation = (np.concatenate(part) for part in zip(*parts, strict=True))
    fitted, noise = _Fitted.of(angle, deviation), _noise(ccw.run)
    apart = float(np.linalg.norm(np.subtract(*(_Fitted.of(*part).centre for part in parts))))
    limits = list(dict.fromkeys(s for c, part in zip((ccw, cw), parts, strict=True) for s in _limits(c, part[0])))
    if 2.0 * apart > fitted.range:
        limits.append("most of G(b) is the shift of the centre: was the ball remounted between the two directions?")
    conditions = _conditions(campaign, ccw, "CCW and CW", angle)
    conditions["centres of the two directions"] = f"{plain_number(apart)} µm apart"
    found = StandardValue(
        standard=STANDARD, name="G(b)", what=_named(ccw, ""), value=fitted.range,
        u=COVERAGE * noise * fitted.noise_of_range, unit="um", runs=(ccw.run.id, cw.run.id), conditions=conditions,
        limits=tuple(limits),
    )  # fmt: skip
    values = [found]
    if _length(ccw.run) < KNOWN_LENGTH_UM and ccw.whole and cw.whole:
        u = COVERAGE * float(np.hypot(noise / np.sqrt(len(angle)), _length(ccw.run)))
        values.append(replace(found, name="D", value=float(fitted.left.mean()), u=u))
    return [*values, _squareness(found, parts, ccw, noise)] if ccw.marks is not None else values


def _squareness(
    both: StandardValue, parts: Sequence[tuple[Array, Array]], circle: Circle, noise: float
) -> StandardValue:
    """From the sine of 2φ, which both directions share: the mean of their fits with centre, radius, lag and squareness."""
    slopes, variance = [], 0.0
    for angle, deviation in parts:
        waves = np.stack(
            [np.cos(angle), np.sin(angle), np.ones_like(angle), np.cos(2.0 * angle), np.sin(2.0 * angle)], axis=1
        )
        slopes.append(np.linalg.lstsq(waves, deviation, rcond=None)[0][4])
        variance += float(np.linalg.inv(waves.T @ waves)[4, 4]) * noise**2 / len(parts) ** 2
    assert circle.marks is not None
    first, second = (mark[-1] for mark in circle.marks)
    per = 2e3 / circle.radius  # µm of the wave → µm/m
    return replace(
        both, standard="ISO 230-1", name=f"squareness {second} to {first}", what="(circle)",
        value=-per * float(np.mean(slopes)), u=COVERAGE * per * float(np.sqrt(variance)), unit="um/m",
        conditions={**both.conditions, "sign": f"+{first} to +{second} is 90° + value"},
        limits=("of this circle only: straightness and angular errors change it with the position",),
    )  # fmt: skip


def _data(circle: Circle, campaign: Campaign) -> tuple[Array, Array]:
    """Angle (M,) rad and deviation (M,) µm of the 360° amid the run, or of all of a shorter one."""
    run = circle.run
    readings = [run.readings[column.name] for column in columns_of(run, campaign.machine)]
    deviation = circle.measured(np.stack(readings, axis=1))
    rows = _evaluated(circle)
    return circle.angle[rows], deviation[rows]


def _evaluated(circle: Circle) -> Flags:
    middle = 0.5 * (circle.angle.min() + circle.angle.max())
    return np.asarray(np.abs(circle.angle - middle) <= 0.5 * FULL + 1e-9)


def _named(circle: Circle, sense: str) -> str:
    plane = "".join(mark[-1] for mark in circle.marks) if circle.marks else circle.over
    arc = "" if circle.turns > 1.0 - 1e-2 else f" partial arc {np.degrees(np.ptp(circle.angle)):.0f}°"
    return f"{plane} {sense}{arc}".replace("  ", " ").strip()


def _conditions(campaign: Campaign, circle: Circle, sense: str, angle: Array) -> dict[str, str]:
    run = circle.run
    rows = _evaluated(circle)
    first, last = np.flatnonzero(rows)[[0, -1]]
    way = circle.radius * abs(circle.angle[last] - circle.angle[first])
    feed = (
        f"{plain_number(60.0 * way / (run.time[last] - run.time[first]))} mm/min (mean)" if run.dynamic else "at rest"
    )
    return {
        "diameter": f"{plain_number(2.0 * circle.radius)} mm", "feed": feed, "direction": sense,
        "from": f"{np.degrees(circle.angle[first]) % 360.0:.0f}°", "readings": str(len(angle)),
        "evaluation": "least-squares centre, no filter", **place_of(campaign.machine, run),
    }  # fmt: skip


def _limits(circle: Circle, angle: Array) -> tuple[str, ...]:
    said = []
    if circle.turns < 1.0 - 1e-2:
        said.append("less than 360°: not a value of ISO 230-4")
    steps = np.diff(np.sort(angle))
    gaps = steps[steps > GAP * np.median(steps)]
    if len(gaps):
        where = f"{plural(len(gaps), 'gap')} without readings, the widest {np.degrees(gaps.max()):.2g}°"
        said.append(f"{where} (excluded near reversals?): peaks there do not count; import with --angle-error 0")
    if _length(circle.run) >= KNOWN_LENGTH_UM:
        said.append("the length of the bar is not calibrated: no F and no D")
    return tuple(said)


def _noise(run: Run) -> float:
    return run.noise(next(name for name in run.instrument if name in INSTRUMENTS))


def _length(run: Run) -> float:
    return run.setup_sigma_um.length if has_bar(run) else 0.0
