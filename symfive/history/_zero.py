"""One zero for all visits: what the values deviate from differs where a machine file or the control's corrections changed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symfive.arrays import Array
from symfive.history._visit import Visit
from symfive.machine import Structure

MICRO = 1e3, 1e6
"""µm in a mm, µrad in a rad."""


def shifts(visit: Visit, zero: Visit) -> dict[str, float]:
    """What to add to the visit's location errors so that they count from the nominal machine of `zero`, control uncorrected.

    Where the nominal origin o of a rotary axis or its direction e moved by the twist ξ = (d, ω) about o, the chain

        Trans(o + P0) R0 Rot(e, s) Trans(-o)

    stays as it is to first order where ξ joins the axis' own location errors (P0, R0) and leaves those of the next rotary axis
    outward, carried over to its origin: P0 -= d + ω × (o_next - o), R0 -= ω. A linear axis takes the tilt of its direction
    and hands nothing on. The last axis hands on to workpiece or tool, which is set-up. To this the control's corrections
    are added: the machine's error is what is left and what was corrected.
    """
    found: dict[str, float] = dict(visit.corrections)
    if visit.nominal == zero.nominal:
        return found
    structure = Structure.parse(zero.machine.structure)
    for side in (tuple(reversed(structure.workpiece)), structure.tool):
        before: tuple[Array, Sequence[float]] | None = None
        for axis in side:
            if axis not in visit.nominal or axis not in zero.nominal:
                continue
            (here, along), (there, nominal) = visit.nominal[axis], zero.nominal[axis]
            turn = np.cross(nominal, along)
            if here is None or there is None:
                _add(found, axis, np.concatenate([np.zeros(3), turn]))
                continue
            own = np.concatenate([np.subtract(here, there), turn])
            handed = np.zeros(6)
            if before is not None:
                twist, place = before
                handed = np.concatenate([twist[:3] + np.cross(twist[3:], np.subtract(there, place)), twist[3:]])
            _add(found, axis, own - handed)
            before = own, there
    return found


def _add(found: dict[str, float], axis: str, own: Array) -> None:
    for letter, value, scale in zip("XYZABC", own, (MICRO[0],) * 3 + (MICRO[1],) * 3, strict=True):
        if abs(value * scale) > 1e-9:
            name = f"E{letter}0{axis}"
            found[name] = found.get(name, 0.0) + float(value * scale)
