"""The catalogue: every effect that could act in this campaign, as exact forward models to be scored."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from symfive.campaign import Campaign
from symfive.effects import Effect, make_effect
from symfive.errors import InputError
from symfive.instruments import instruments_of
from symfive.instruments.drive_force import driven_axis
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.row import Row

__all__ = ["AxisOffset", "MotionOffset", "ToolShift", "catalogue", "moving_axes", "reversing_axes"]

LETTERS = "XYZABC"
FOURIER_ORDER = 3
POLYNOMIAL_ORDER = 3


@dataclass(frozen=True, kw_only=True)
class AxisOffset(Effect):
    """A probe: the coordinate of an axis moved by a constant. Its tangent says how readings answer to that axis."""

    id: ClassVar[str] = "probe_axis"
    stage: ClassVar[str] = "axis"

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        rotary = campaign.machine.axes[str(self.axis)].rotary
        return (self.own("offset", "urad" if rotary else "um", 100.0 if rotary else 10.0),)

    def apply(self, row: Row) -> None:
        row.axis[str(self.axis)] += self.parameter(row, "offset")


@dataclass(frozen=True, kw_only=True)
class ToolShift(Effect):
    """A probe: the tool moved by a constant in the machine frame."""

    id: ClassVar[str] = "probe_tool"

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return tuple(self.own(c, "um", 10.0) for c in "xyz")

    def apply(self, row: Row) -> None:
        for i, c in enumerate("xyz"):
            row.shift[i] += self.parameter(row, c)


@dataclass(frozen=True, kw_only=True)
class MotionOffset(Effect):
    """A probe: one component of an axis' error motion by a constant."""

    id: ClassVar[str] = "probe_motion"
    component: str

    @property
    def key(self) -> str:
        return self._key(self.component)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        angular = self.component[1] in "ABC"
        return (self.own("offset", "urad" if angular else "um", 100.0 if angular else 10.0),)

    def apply(self, row: Row) -> None:
        row.add_motion(self.component, self.parameter(row, "offset"))


def moving_axes(campaign: Campaign) -> tuple[str, ...]:
    """Axes whose command changes within a run."""
    return tuple(
        name for name in campaign.machine.axis_names if any(np.ptp(run.commands[name]) > 0.0 for run in campaign.runs)
    )


def reversing_axes(campaign: Campaign) -> tuple[str, ...]:
    """Axes that are approached from both sides within the campaign."""
    found = []
    for name in moving_axes(campaign):
        signs = [np.sign(np.diff(run.commands[name])) for run in campaign.runs]
        joined = np.concatenate(signs)
        if (joined > 0).any() and (joined < 0).any():
            found.append(name)
    return tuple(found)


def catalogue(campaign: Campaign, held: Sequence[Effect] = ()) -> list[Effect]:
    """Effects of the library that can join the model with the effects it already holds, in their plain form."""
    taken = {effect.key for effect in held}
    freed = {place for effect in held for place in effect.frees()}
    found: list[Effect] = []
    for draft in _drafts(campaign):
        try:
            effect = draft.prepare(campaign)
            seen = bool(effect.parameters(campaign))
        except InputError:
            continue  # the baseline holds it, or the machine lacks what it needs
        if not seen or not any(effect.applies(run) for run in campaign.runs):
            continue
        if effect.key in taken or set(effect.frees()) & freed:
            continue
        taken.add(effect.key)
        found.append(effect)
    return found


def _drafts(campaign: Campaign) -> Iterator[Effect]:
    machine = campaign.machine
    moving = moving_axes(campaign)
    for axis in reversing_axes(campaign):
        yield make_effect("backlash", axis)
        if _own_letter(campaign, axis) == "Z":  # gravity acts along it
            yield make_effect("counterbalance", axis)
        yield make_effect("friction", axis)
        yield make_effect("reversal_spike", axis)
        for letter in LETTERS:
            if letter != _own_letter(campaign, axis):  # sideways: along its own motion it would be backlash
                yield make_effect("lateral_play", component=f"E{letter}{axis}")
    for axis in moving:
        yield make_effect("servo_mismatch", axis)
        yield make_effect("inertial_compliance", axis)
        if not machine.axes[axis].rotary:
            yield make_effect("scale_error", axis)
        else:
            yield from _sags(axis)
            yield make_effect("eccentric_mass", axis)
        yield from _motions(campaign, axis)
    for axis in machine.axis_names:
        for letter in _located(campaign, axis):
            yield make_effect("location_error", component=f"E{letter}0{axis}")
    for driven in sorted({own for run in campaign.runs if (own := driven_axis(run)) is not None}):
        yield make_effect("force_friction", driven)
    yield make_effect("latency")
    yield make_effect("sensor_low_pass")
    yield make_effect("thermal_drift")
    if any(machine.axes[axis].rotary for axis in machine.structure.tool):  # else it is a drift along z
        yield make_effect("spindle_growth")
    if any("ball_bar" in run.instrument for run in campaign.runs):
        yield make_effect("bar_temperature")
    probes = [i for run in campaign.runs for i in instruments_of(run) if not i.on_control]
    several = sorted({i.name for i in probes if len(i.columns(campaign.runs[0], machine)) > 1})
    for name in several[:1]:
        yield _optional("sensor_error", instrument=name, shape="matrix")
    yield _optional("sensor_error", shape="gain")


def _own_letter(campaign: Campaign, axis: str) -> str:
    """The component along which the axis itself moves."""
    return ("ABC" if campaign.machine.axes[axis].rotary else "XYZ")[_along(campaign, axis)]


def _located(campaign: Campaign, axis: str) -> Iterator[str]:
    """The components of an axis' location (ISO 230-1, 3.4): of a rotary axis all but the place along itself, which it does not
    have, of a linear axis two tilts: about itself none is its own."""
    along = _along(campaign, axis)
    other = [i for i in range(3) if i != along]
    if campaign.machine.axes[axis].rotary:
        yield from ("XYZ"[i] for i in other)
        yield from "ABC"
    else:
        yield from ("ABC"[i] for i in other)


def _along(campaign: Campaign, axis: str) -> int:
    return int(np.argmax(np.abs(campaign.machine.axes[axis].direction)))


def _optional(effect: str, **options: Any) -> Effect:
    return make_effect(effect, **options)


def _sags(axis: str) -> Iterator[Effect]:
    for letter in LETTERS:
        yield make_effect("gravity_sag", axis, component=f"E{letter}{axis}")


def _motions(campaign: Campaign, axis: str) -> Iterator[Effect]:
    rotary = campaign.machine.axes[axis].rotary
    reach = max(float(np.ptp(run.commands[axis])) for run in campaign.runs)
    basis, order = ("fourier", FOURIER_ORDER) if rotary and reach > 200.0 else ("polynomial", POLYNOMIAL_ORDER)
    for letter in LETTERS:
        yield make_effect("error_motion", component=f"E{letter}{axis}", basis=basis, order=order)
