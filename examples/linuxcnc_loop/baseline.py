"""The model that is identified: a preset, and beside what its file varies the error motions of every axis."""

from __future__ import annotations

from dataclasses import replace

from symfive.machine import Axis, ErrorTerm, Machine

LINEAR_UM, ANGULAR_URAD = 1.5, 5.0
"""Prior 1σ of a coefficient of an error motion that the machine file does not name: axes of a good machine."""
POLYNOMIAL, FOURIER = 3, 2
"""Orders: over a travel, and over full turns."""
FULL_TURN_DEG = 360.0


def with_error_motions(machine: Machine) -> Machine:
    """The machine with all six error motions (ISO 230-1) of every axis; those of its file keep their prior."""
    found = dict(machine.errors)
    for axis in machine.axes.values():
        for component in ("EX", "EY", "EZ", "EA", "EB", "EC"):
            name = component + axis.name
            sigma = LINEAR_UM if component[1] in "XYZ" else ANGULAR_URAD
            basis, order = ("fourier", FOURIER) if _turns(axis) else ("polynomial", POLYNOMIAL)
            found.setdefault(name, ErrorTerm(name=name, sigma=sigma, basis=(basis,), order=(order,)))
    return replace(machine, errors=found)


def _turns(axis: Axis) -> bool:
    """Whether the axis goes round, so that its error motions repeat."""
    return axis.rotary and axis.travel[1] - axis.travel[0] >= FULL_TURN_DEG
