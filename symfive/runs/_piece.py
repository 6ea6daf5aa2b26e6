"""A column of readings in a run's file, and a piece: what a run consists of that holds some stretches of a longer recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symfive.runs._run import Run


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """One stretch: of `run`, which has no readings, row `lead` and every `step`th after it. In the rows before that drives, plays
    and friction forget how it began."""

    run: Run
    lead: int
    step: int = 1

    @property
    def own(self) -> slice:
        """The rows that are kept."""
        return slice(self.lead, None, self.step)

    @property
    def rows(self) -> int:
        """How many they are."""
        return len(range(self.lead, self.run.rows, self.step))


@dataclass(frozen=True)
class Column:
    """A reading column of a CSV: internal value (mm, rad, …) = `scale` × the number in the file."""

    name: str
    unit: str
    scale: float
