"""Components of an axis' error motion or location error by their ISO 230-1 symbol, as `EYX` or `EA0C`."""

from __future__ import annotations

from dataclasses import dataclass

from symfive.errors import InputError
from symfive.machine import ErrorTerm, Machine, unknown_axis


@dataclass(frozen=True)
class Component:
    """`name` the symbol, `letter` X Y Z A B C, `axis` whose error it is, `unit` um or urad."""

    name: str
    letter: str
    axis: str

    @property
    def angular(self) -> bool:
        """Whether it is a rotation."""
        return self.letter in "ABC"

    @property
    def unit(self) -> str:
        """The unit of its size."""
        return "urad" if self.angular else "um"


def component_of(name: str, machine: Machine) -> Component:
    """An error motion of the machine. Raises `InputError` for another symbol."""
    term = ErrorTerm(name=name, sigma=1.0, basis=("polynomial",), order=(1,), over=("",))
    return _checked(term, machine)


def location_of(name: str, machine: Machine) -> Component:
    """A location error of the machine. Raises `InputError` for another symbol."""
    term = ErrorTerm(name=name, sigma=1.0)
    component = _checked(term, machine)
    if not machine.axes[component.axis].rotary and not component.angular:
        raise InputError(
            f"{name}: a linear axis has no position of its own, only a direction",
            remedy=f"use EA0{component.axis}, EB0{component.axis} or EC0{component.axis}",
        )
    return component


def _checked(term: ErrorTerm, machine: Machine) -> Component:
    if term.axis not in machine.axes:
        raise unknown_axis(term.name, term.axis, machine.axes)
    return Component(term.name, term.component, term.axis)
