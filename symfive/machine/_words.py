"""What a machine file declares, in a few lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from symfive.machine._axis import UNREAD, Axis
from symfive.machine._errors import ErrorTerm
from symfive.numbers import plain_number, unit_words

if TYPE_CHECKING:
    from symfive.machine._data import EffectEntry, Machine


def machine_lines(machine: Machine) -> list[str]:
    """Name and structure, axes with their travels, errors with their priors, effects of the model."""
    effects = ", ".join(map(_effect_words, machine.effects))
    return [
        f"machine {machine.name}: {machine.structure.code}",
        f"axes: {', '.join(_axis_words(machine.axes[name]) for name in machine.axis_names)}",
        *_table_lines(machine),
        f"errors, prior 1σ: {', '.join(map(_error_words, machine.errors.values())) or 'none'}",
        *([f"effects in the model: {effects}"] if effects else []),
    ]


def _effect_words(entry: EffectEntry) -> str:
    return entry.effect if entry.axis is None else f"{entry.effect} of {entry.axis}"


def _table_lines(machine: Machine) -> list[str]:
    """Which centre the table's radius counts from."""
    radius, (x, y) = machine.workspace.table_radius, machine.table_centre
    if radius is None:
        return []
    given, axis = machine.workspace.table_centre, machine.table_axis
    source = "table_centre" if given is not None else "the workpiece frame's origin" if axis is None else f"axis {axis}"
    about = f"x = {plain_number(x)}, y = {plain_number(y)} mm of the workpiece frame ({source})"
    return [f"table: radius {plain_number(radius)} mm about {about}"]


def _axis_words(axis: Axis) -> str:
    if axis.travel == UNREAD:
        return f"{axis.name} (not read)"
    low, high = (plain_number(v) for v in axis.travel)
    drive = " with drive" if axis.drive is not None else ""
    return f"{axis.name} {low}…{high} {unit_words(axis.unit)}{drive}"


def _error_words(term: ErrorTerm) -> str:
    form = "" if term.is_location else f" {'×'.join(f'{b} {o}' for b, o in zip(term.basis, term.order, strict=True))}"
    over = "" if term.over in ((), (term.axis,)) else f" over {', '.join(term.over)}"
    return f"{term.name}{form}{over} ±{plain_number(term.sigma)} {'µrad' if term.angular else 'µm'}"
