"""Colours of pictures, distinguishable for everybody (M. Okabe & K. Ito 2008; the yellow left out, too pale on paper)."""

from __future__ import annotations

BLUE, ORANGE, GREEN, PURPLE = "#0072b2", "#d55e00", "#009e73", "#cc79a7"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, "#e69f00", "#56b4e9")
INK, FAINT, GRID, PAPER = "#1d2a36", "#6b7885", "#d9dfe5", "#fdfefe"
"""Lines of the page itself; the report replaces them by the colours of the reader's light or dark theme."""
