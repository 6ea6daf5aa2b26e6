"""What an effect says of itself to a diagnosis: the forms it may take, where it could be, how common it is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError
from symfive.instruments import positioning_instrument
from symfive.machine import ErrorTerm, Machine, unknown_axis
from symfive.runs import Campaign, Run

if TYPE_CHECKING:
    from symfive.effects._base import Effect

TOOL, AXIS, CARRIED, BALL, FORCE, READING = "tool", "axis", "carried", "ball", "force", "reading"
"""Channels by which readings answer: a shift of the tool (3), of an axis, of what it carries (3), of the table's ball (3);
a force in the recording of an axis' drive; a constant in each reading column of an instrument."""
SAME_PLACE = 4
"""Decimals (mm, degree) to which places agree that are one."""
MOST_PLACES = 40
"""Of a table, each of which is a column of the moments by either side; more of them are a curve."""
ROUND = 200.0
"""An axis that goes further than this (degree) in one run is described by harmonics and not by polynomials."""


@dataclass(frozen=True, kw_only=True)
class Form:
    """One way in which an effect may act. `shapes`: the same cause in other shapes, which only an exact refit can weigh. `at`:
    the parameters, by name, about which its change of the readings is linear; where estimation begins if none are given.

    `places`: among how many equally probable places this one was picked. `channel` and `basis`, (run) → (N, m): where given,
    the readings answer to the effect as to this channel (of an `axis`) times the functions, each with its own factor of the
    prior 1σ `sigma`. `directions`: of those that the readings see, so many are kept at least. `measured`: it is just what the
    readings are deviations of, so that whether it is there is an even question and no surprise.
    """

    effect: Effect
    shapes: tuple[Effect, ...] = ()
    at: Mapping[str, float] = field(default_factory=dict)
    places: float = 1.0
    channel: str = ""
    axis: str | None = None
    basis: Callable[[Run], Array] | None = None
    sigma: float = 1.0
    directions: int = 0
    measured: bool = False
    once: bool = False
    partner: str = ""

    @property
    def sloped(self) -> bool:
        """Whether the readings answer to it by slopes of the model about where estimation begins."""
        return self.basis is None and not self.at

    @property
    def placed(self) -> bool:
        """Whether a scan picked its place; then others of its name may act at other places."""
        return self.places > 1.0 and not self.once

    def proportional(self, campaign: Campaign) -> bool:
        """Whether the readings are proportional to its amplitudes, whatever their size: it moves no drive and no play, and no
        signal depends on its parameters. Of axes at rest only the direction counts from which they came."""
        effect = self.effect
        moves = bool(effect.frees()) or any(signal.parameters for signal in effect.signals())
        return self.basis is not None or not (moves and any(run.dynamic for run in campaign.runs))


@dataclass(frozen=True, kw_only=True)
class Scan:
    """Forms of which one parameter is a place, to be found on a grid: `count` places, each a course in time of a `channel`.

    `courses` (run) → (N, count); `form` makes the exact form of one place. `axis`: of the channel `axis`.
    `run`: the only one in which it acts. `finer` (place): the places about one of them, where these are some of more.
    """

    channel: str
    count: int
    courses: Callable[[Run], Array]
    form: Callable[[int], Form]
    axis: str | None = None
    run: str | None = None
    finer: Callable[[int], Scan] | None = None


@dataclass(frozen=True, kw_only=True)
class Begin:
    """Where an effect begins whose place a scan picked: the first `row` (from 0) of a run in which it acts, the same effect
    `always`, and as it is described where that row has a 1σ, `within` so many rows."""

    row: int
    always: Effect
    within: Callable[[float], Effect]


@dataclass(frozen=True, kw_only=True)
class Tone:
    """Forms that are a sine over a coordinate, (run) → (N,): cycles per unit from `lowest` to `highest` are looked for.

    `form` (cycles per unit, their resolution, number of places) makes the exact form. `apart`: of each run with its own phase.
    """

    channel: str
    coordinate: Callable[[Run], Array]
    lowest: float
    highest: float
    form: Callable[[float, float, int], Form]
    axis: str | None = None
    runs: tuple[str, ...] = field(default=())
    apart: bool = False


Forms = Iterable[Form | Scan | Tone]
"""In which an effect may act in a campaign."""


def moving(campaign: Campaign) -> tuple[str, ...]:
    """Axes whose command changes within a run."""
    return tuple(a for a in campaign.machine.axis_names if any(np.ptp(r.commands[a]) > 0.0 for r in campaign.runs))


def positioned(campaign: Campaign) -> tuple[str, ...]:
    """Axes whose positions a positioning test by ISO 230-2 compares with a laser: their deviations are what it measures."""
    at: dict[object, list[Array]] = {}
    for run in campaign.runs:
        if positioning_instrument(run) and not run.dynamic:
            axis = run.options.get("axis")
            at.setdefault(axis, []).append(run.commands[str(axis)])
    return tuple(a for a in campaign.machine.axis_names if a in at and np.ptp(np.concatenate(at[a])) > 0.0)


def reversing(campaign: Campaign) -> tuple[str, ...]:
    """Axes that are approached from both sides within the campaign."""
    found = []
    for axis in moving(campaign):
        signs = np.concatenate([np.sign(np.diff(run.commands[axis])) for run in campaign.runs])
        if signs.min() < 0.0 < signs.max():
            found.append(axis)
    return tuple(found)


def revisited(campaign: Campaign, axis: str) -> tuple[float, ...]:
    """The places (mm, degree) of an axis that is read more than once at each, if they are few (two or more), else none."""
    values = np.round(np.concatenate([run.commands[axis] for run in campaign.runs]), SAME_PLACE)
    places, counts = np.unique(values, return_counts=True)
    return tuple(places.tolist()) if counts.min() > 1 and 1 < len(places) <= MOST_PLACES else ()


def goes_round(campaign: Campaign, axis: str) -> bool:
    """Whether harmonics describe what happens along a rotary axis."""
    return campaign.machine.axes[axis].rotary and max(float(np.ptp(r.commands[axis])) for r in campaign.runs) > ROUND


def own_component(machine: Machine, axis: str) -> str:
    """The letter of the component along (about) which an axis itself moves."""
    found = machine.axes[axis]
    return ("ABC" if found.rotary else "XYZ")[int(np.argmax(np.abs(found.direction)))]


def across(machine: Machine, axis: str) -> tuple[str, ...]:
    """The components of what an axis carries but for its own motion, as `EYX`."""
    return tuple(f"E{letter}{axis}" for letter in "XYZABC" if letter != own_component(machine, axis))


def component_of(name: str, machine: Machine) -> ErrorTerm:
    """An error motion of the machine by its ISO 230-1 symbol, as `EYX`. Raises `InputError` for another symbol."""
    return _on_axis(ErrorTerm(name=name, sigma=1.0, basis=("polynomial",), order=(1,), over=("",)), machine)


def location_of(name: str, machine: Machine) -> ErrorTerm:
    """A location error of the machine by its ISO 230-1 symbol, as `EA0C`. Raises `InputError` for another symbol."""
    term = _on_axis(ErrorTerm(name=name, sigma=1.0), machine)
    if not machine.axes[term.axis].rotary and not term.angular:
        raise InputError(
            f"{name}: a linear axis has no position of its own, only a direction",
            remedy=f"use EA0{term.axis}, EB0{term.axis} or EC0{term.axis}",
        )
    return term


def _on_axis(term: ErrorTerm, machine: Machine) -> ErrorTerm:
    if term.axis not in machine.axes:
        raise unknown_axis(term.name, term.axis, machine.axes)
    return term
