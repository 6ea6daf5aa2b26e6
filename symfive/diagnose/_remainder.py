"""What is left of a named effect's own family, so that no other effect is invented to mop up a misfit of shape.

Where the true form is a little off the library's, the rest of it lies on the same channel (the axis, the tool, the
component) over the same coordinate. A `FamilyShape` for every effect found, each coefficient with a prior of a share of
the effect's own size, joins the fit before any other effect is looked for, and before rivals are weighed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symfive.effects import Effect
from symfive.effects.family_shape import FamilyShape
from symfive.errors import InputError
from symfive.model import Model

__all__ = ["SHARE", "remainder"]

SHARE = 0.3
"""Prior 1σ of one coefficient as a share of the effect's size on its channel."""
URAD_PER_UM = 10.0
"""Of a rotary axis read at 100 mm."""
NOTHING = 1e-3
"""µm or µrad: an effect this small has no shape of its own."""

_FAMILY = {
    "backlash": ("reversal", "axis"), "counterbalance": ("reversal", "axis"), "friction": ("friction", "axis"),
    "reversal_spike": ("friction", "axis"), "servo_mismatch": ("servo", "axis"), "lateral_play": ("reversal", "component"),
    "transmission_error": ("periodic", "axis"), "scale_error": ("smooth", "axis"), "table_step": ("smooth", "axis"),
    "gravity_sag": ("hysteresis", "component"), "error_motion": ("smooth", "component"), "thermal_drift": ("time", "tool"),
    "spindle_growth": ("time", "tool"), "setup_shift": ("time", "tool"), "inertial_compliance": ("inertial", "tool"),
}  # fmt: skip


def _swing(model: Model, values: NDArray[np.float64], effect: Effect) -> float:
    """The largest change that an effect makes to a reading about its mean, µm: its size where its parameters are gains."""
    changes = model.contribution(effect, values).values()
    return max((float(np.abs(c - c.mean(axis=0)).max()) for c in changes), default=0.0)


def remainder(model: Model, values: NDArray[np.float64], held: Sequence[Effect]) -> tuple[Effect, ...]:
    """A family shape for every effect of `held`, of the size that the fit gives it."""
    found = []
    present = {effect.of for effect in model.effects if isinstance(effect, FamilyShape)}
    for effect in held:
        if effect.id not in _FAMILY or effect.key in present:
            continue
        family, channel = _FAMILY[effect.id]
        component = getattr(effect, "component", None)
        axis = effect.axis or (component[2:] if isinstance(component, str) else None)
        size = effect.extent(model.campaign, lambda name: float(values[model.index[name]]))
        if size == 0.0:
            turning = axis is not None and model.machine.axes[axis].rotary and channel == "axis"
            size = _swing(model, values, effect) * (URAD_PER_UM if turning else 1.0)
        if size < NOTHING:
            continue
        shape = FamilyShape(
            of=effect.key, axis=axis, family=family, size=SHARE * size,
            channel=str(component) if channel == "component" else channel, period=getattr(effect, "period", 0.0),
        )  # fmt: skip
        try:
            found.append(shape.prepare(model.campaign))
        except InputError:
            continue
    return tuple(found)
