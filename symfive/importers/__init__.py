"""Machines and campaigns from what users have: files of instruments and controls that are not campaigns yet."""

from symfive.importers.mtconnect import read_mtconnect
from symfive.importers.polar import FITTED, polar_doubts, polar_run, read_polar
from symfive.importers.rests import Matched, cut_at_rests, read_recording

__all__ = [
    "FITTED", "Matched", "cut_at_rests", "polar_doubts", "polar_run", "read_mtconnect", "read_polar", "read_recording",
]  # fmt: skip
