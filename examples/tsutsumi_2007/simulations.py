"""All simulations of the paper's section 3 and of its figures 10 to 14, integrated side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .drives import PAPER, Drives
from .path import Circle
from .readings import Case, Lap, Trace, simulate

Array = NDArray[np.float64]
RATIOS = (0.3, 0.5, 0.7, 0.8, 0.85, 0.9, 0.95, 1.05, 1.1, 1.15, 1.2, 1.25, 1.3, 1.35, 1.4, 1.5, 1.65, 1.8)
"""X_T/r of figure 10."""
FEEDS = (500.0, 1000.0, 1500.0)
"""mm/min, figure 6."""
SIZES = ((50.0, 45.0), (100.0, 90.0))
"""(r, X_T) mm, figure 6."""
ECCENTRIC_UM = tuple(float(v) for v in range(-30, 31, 5))
"""dx and dy of figure 14."""
FORMS = {
    "full": (True, True, True),
    "without play": (True, True, False),
    "linear": (False, False, False),
    "linear, play": (False, False, True),
    "linear, worm": (False, True, False),
    "linear, friction": (True, False, False),
}
"""What of the paper's model takes part: friction, worm, play."""
ROUND = ("full", "without play", "linear", "linear, play")
"""What figure 10 compares."""
DRAWN = (0.9, 1.0, 1.1)
"""X_T/r of figure 5, of which every form is simulated."""


def case_of(circle: Circle, form: str = "full", drives: Drives = PAPER) -> Case:
    """A circle with what `FORMS` says of the form."""
    friction, worm, play = FORMS[form]
    return Case(circle, drives, friction=friction, worm=worm, play=play)


def _servos() -> dict[str, Drives]:
    """Drives with other gains: feed-forward as in figure 7, two equal servos, a position gain that does not match."""
    ahead = replace(PAPER, x=replace(PAPER.x, feedforward=1.0), c=replace(PAPER.c, feedforward=1.0))
    return {
        "table 1": PAPER,
        "feed-forward": ahead,
        "feed-forward and matched": replace(ahead, c=replace(ahead.c, velocity_gain=PAPER.x.velocity_gain)),
        "equal servos": replace(PAPER, c=replace(PAPER.x, reduction=PAPER.c.reduction)),
        "C at 35 1/s": replace(PAPER, c=replace(PAPER.c, position_gain=35.0)),
    }


SERVOS = _servos()


@dataclass(frozen=True)
class Simulations:
    """Laps at r = 50 mm and 1000 mm/min by (X_T/r, form), clockwise ones, those with other servos at 0.9 by (servo, form),
    and, for figure 6, the stretch 150°…210° by (r, feed)."""

    laps: Mapping[tuple[float, str], Lap]
    clockwise: Mapping[float, Lap]
    servos: Mapping[tuple[str, str], Lap]
    stretches: Mapping[tuple[float, float], Trace]

    def trace(self, u: float, form: str = "full") -> Trace:
        """The trace without eccentricity."""
        return self.laps[u, form].trace()

    def effect(self, u: float, form: str) -> Trace:
        """What one addition to the linear loops changes, µm."""
        return self.trace(u, form).minus(self.trace(u, "linear"))

    def roundness(self, form: str) -> Array:
        """Over `RATIOS`, µm."""
        return np.array([self.trace(u, form).roundness for u in RATIOS])

    def eccentric(self, *, axis: str, fitted: bool) -> Array:
        """Roundness at X_T/r = 0.9 over `ECCENTRIC_UM` in `x` or `y`, raw or with the least-squares circle taken out, µm."""
        lap = self.laps[0.9, "full"]
        traces = [lap.trace(**{f"d{axis}_um": size}) for size in ECCENTRIC_UM]
        return np.array([(trace.without_circle() if fitted else trace).roundness for trace in traces])


def run_all(*, step_s: float = 2e-4) -> Simulations:
    """Everything, in two sweeps: whole laps, and the stretches of figure 6."""
    laps = {
        (u, form): case_of(Circle(50.0 * u), form)
        for u in sorted({*RATIOS, 1.0})
        for form in FORMS
        if u in DRAWN or form in ROUND
    }
    clockwise = {u: case_of(Circle(50.0 * u, direction=-1)) for u in DRAWN}
    servos = {(name, form): case_of(Circle(45.0), form, d) for name, d in SERVOS.items() for form in ("linear", "full")}
    cases: dict[tuple[str, object], Case] = {
        **{("lap", key): case for key, case in laps.items()},
        **{("clockwise", key): case for key, case in clockwise.items()},
        **{("servo", key): case for key, case in servos.items()},
    }
    found = dict(zip(cases, simulate(list(cases.values()), step_s=step_s), strict=True))
    slow = {(r, feed): case_of(Circle(x_t, r, feed), "linear") for r, x_t in SIZES for feed in FEEDS}
    stretches = simulate(list(slow.values()), span_deg=(150.0, 210.0), step_s=step_s)
    return Simulations(
        laps={key: found["lap", key] for key in laps},
        clockwise={u: found["clockwise", u] for u in clockwise},
        servos={key: found["servo", key] for key in servos},
        stretches={key: lap.trace() for key, lap in zip(slow, stretches, strict=True)},
    )
