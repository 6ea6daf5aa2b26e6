"""Colour maps from the same family as the lines: blue through white to vermilion, white to blue."""

from __future__ import annotations

from matplotlib.colors import LinearSegmentedColormap

DIVERGING = LinearSegmentedColormap.from_list(
    "symfive_diverging", ["#00568a", "#5aa6d6", "#f7f8f9", "#e8935a", "#b84f00"]
)
SEQUENTIAL = LinearSegmentedColormap.from_list("symfive_sequential", ["#f7f8f9", "#9cc9e3", "#0072b2", "#00456d"])
