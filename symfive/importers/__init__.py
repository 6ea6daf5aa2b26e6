"""Machines and campaigns from what users have: files of instruments and controls that are not campaigns yet."""

from symfive.importers.mtconnect import read_mtconnect
from symfive.importers.polar import FITTED, polar_doubts, polar_run, read_polar

__all__ = ["FITTED", "polar_doubts", "polar_run", "read_mtconnect", "read_polar"]
