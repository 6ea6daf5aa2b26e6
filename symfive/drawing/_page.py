"""The style of every page: light or dark as the reader's system, narrow or wide, on paper."""

from __future__ import annotations

from importlib.resources import files

__all__ = ["PAGE_STYLE"]

PAGE_STYLE = (files("symfive.drawing") / "page.css").read_text(encoding="utf-8")
"""CSS for a page whose content stands in `<main>`; wide tables stand in `<div class="wide">`, or are cut nowhere else."""
