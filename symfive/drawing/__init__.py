"""Drawings that set-up sheets and reports share: the poses of a campaign in space, and the colours of all pictures."""

from symfive.drawing._colours import BLUE, FAINT, GREEN, GRID, INK, ORANGE, PAPER, PURPLE, SERIES
from symfive.drawing._poses import SCRIPT, poses_figure

__all__ = ["BLUE", "FAINT", "GREEN", "GRID", "INK", "ORANGE", "PAPER", "PURPLE", "SCRIPT", "SERIES", "poses_figure"]
