"""Figures and reports of what symfive found."""
