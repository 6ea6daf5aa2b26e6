"""Whether a correction is entered on a control, and with which digits.

A change is entered where it exceeds its expanded uncertainty U = 2 u (k = 2, JCGM 100:2008, 6.2) and the control's resolution;
below that the value that stands is as good. No digit is printed beyond the second of U or beyond the resolution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from symfive.numbers import decimals

COVERAGE = 2.0


@dataclass(frozen=True)
class Change:
    """One number of a control: `old` by design, `new` by the model, the smallest step `resolution` of its field, and the expanded
    uncertainty U of the change, None where nothing was measured; all in the number's unit."""

    old: float
    new: float
    resolution: float
    uncertainty: float | None

    @property
    def difference(self) -> float:
        """New minus old."""
        return self.new - self.old

    @property
    def entered(self) -> bool:
        """Whether it exceeds its expanded uncertainty and the resolution."""
        return self.uncertainty is not None and abs(self.difference) >= max(self.uncertainty, self.resolution)

    @property
    def reason(self) -> str:
        """Why it is not entered; empty where it is."""
        if self.uncertainty is None:
            return "its uncertainty is not known"
        if self.entered:
            return ""
        below = abs(self.difference) < self.uncertainty
        return "within uncertainty, not entered" if below else "below the control's resolution, not entered"

    @property
    def places(self) -> int:
        """Decimals of the control's field."""
        return max(0, -math.floor(math.log10(self.resolution)))

    @property
    def decimals(self) -> int:
        """Decimals that the uncertainty and the resolution leave."""
        return min(self.places, digits_of(self.uncertainty)) if self.uncertainty else self.places

    @property
    def typed(self) -> float:
        """What stands in the field afterwards."""
        return round(self.new, self.decimals) if self.entered else self.old

    @property
    def spread(self) -> str:
        """The uncertainty with two digits, as far as a tenth of the resolution."""
        if self.uncertainty is None:
            return "not known"
        least = self.places + 1
        if self.uncertainty < 10.0**-least:
            return f"below {10.0**-least:.{least}f}"
        return f"{self.uncertainty:.{min(least, digits_of(self.uncertainty))}f}"

    def differs(self, value: float) -> bool:
        """Whether the field shows the value as another than the old one."""
        return abs(value - self.old) >= 0.5 * self.resolution

    def field(self, value: float, sign: str = "") -> str:
        """A value as the control's field shows it; `sign` as in a format."""
        return _written(value, self.places, sign)

    def said(self, value: float, sign: str = "") -> str:
        """A value with the decimals that its uncertainty leaves."""
        return _written(value, self.decimals, sign)


def _written(value: float, decimals: int, sign: str = "") -> str:
    return f"{round(value, decimals) + 0.0:{sign}.{decimals}f}".replace("-", "−")


def digits_of(uncertainty: float) -> int:
    """Decimals that show two digits of an uncertainty, none before the point."""
    return max(0, decimals(uncertainty))
