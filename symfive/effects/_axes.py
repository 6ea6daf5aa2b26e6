"""How a campaign moves the axes of its machine, and the errors of an axis by their ISO 230-1 symbols."""

from __future__ import annotations

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError
from symfive.instruments import positioning_instrument
from symfive.machine import ErrorTerm, Machine, unknown_axis
from symfive.runs import Campaign

SAME_PLACE = 4
"""Decimals (mm, degree) to which places agree that are one."""
MOST_PLACES = 40
"""Of a table, each of which is a column of the moments by either side; more of them are a curve."""
ROUND = 200.0
"""An axis that goes further than this (degree) in one run is described by harmonics and not by polynomials."""


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
