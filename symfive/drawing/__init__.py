"""What pages share: their frame and style, the picture of a campaign's poses in space, and the colours of all pictures."""

from symfive.drawing._page import (
    BLUE,
    FAINT,
    GREEN,
    GRID,
    INK,
    ORANGE,
    PAGE_STYLE,
    PAPER,
    PURPLE,
    SERIES,
    page,
    templates,
)
from symfive.drawing._poses import SCRIPT, poses_figure

__all__ = [
    "BLUE", "FAINT", "GREEN", "GRID", "INK", "ORANGE", "PAGE_STYLE", "PAPER", "PURPLE", "SCRIPT", "SERIES", "page",
    "poses_figure", "templates",
]  # fmt: skip
