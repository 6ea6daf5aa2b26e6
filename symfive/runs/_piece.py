"""Pieces: what a run consists of that holds some stretches of a longer recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from symfive.runs._data import Run

__all__ = ["Piece"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """One stretch: `run` without readings, of which the first `lead` rows are not the stretch's own. In them
    drives, plays and friction forget how it began."""

    run: Run
    lead: int

    @property
    def rows(self) -> int:
        """Rows of the stretch."""
        return self.run.rows - self.lead
