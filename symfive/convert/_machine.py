"""The machines of recordings: one axis, or a serial chain of axes."""

from __future__ import annotations

from collections.abc import Mapping

from symfive.campaign import Vector
from symfive.machine import ErrorTerm, Machine, Structure, Workspace, make_axis


def one_axis(name: str, code: str, axis: str, travel: tuple[float, float] = (-360.0, 360.0)) -> Machine:
    """A machine of one axis with the structural code `code`; `travel` in mm or degree."""
    return Machine(name=name, structure=Structure.parse(code), axes={axis: make_axis(axis, travel=travel)})


def serial_chain(
    name: str, axes: Mapping[str, tuple[Vector, Vector]], *, sigma: tuple[float, float] | None = None,
    linear: Mapping[str, tuple[float, float]] | None = None, travel: tuple[float, float] = (-360.0, 360.0),
    workspace: Workspace | None = None,
) -> Machine:  # fmt: skip
    """A chain from the bed to the tool: name → direction and a point on the axis (mm), all axes at zero.

    `linear` the axes that slide, with their travels in mm; the others turn, within `travel` in degree, and have all six location
    errors with the prior 1σ `sigma` (µm, µrad) where that is given.
    """
    sliding = linear or {}
    made = {
        axis: make_axis(axis, kind="linear" if axis in sliding else "rotary", direction=direction, origin=origin,
                        travel=sliding.get(axis, travel))
        for axis, (direction, origin) in axes.items()
    }  # fmt: skip
    terms = [
        ErrorTerm(name=f"E{letter}0{axis}", sigma=sigma[letter in "ABC"])
        for axis in axes if sigma is not None and axis not in sliding for letter in "XYZABC"
    ]  # fmt: skip
    return Machine(
        name=name, structure=Structure.parse(f"w b {' '.join(axes)} t"), axes=made,
        errors={term.name: term for term in terms}, workspace=workspace or Workspace(),
    )  # fmt: skip
