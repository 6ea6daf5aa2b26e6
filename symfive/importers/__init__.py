"""Machines and campaigns from what users have: files of instruments and controls that are not campaigns yet."""

from symfive.importers.mapping import Meaning, guessed_meanings, meanings, shown_meanings, taken
from symfive.importers.mtconnect import read_mtconnect
from symfive.importers.polar import (
    FITTED,
    along_run,
    as_planned,
    check_arc,
    check_other,
    cut_short,
    polar_doubts,
    polar_run,
    read_polar,
)
from symfive.importers.recording import Setting, positioning_run, probe_run, recorded_run, runs_of
from symfive.importers.rests import Matched, cut_at_rests, read_recording
from symfive.importers.split import SPLITS, cycles_of, every, moved_pieces, prepared, rows_of, split, turns_of
from symfive.importers.table import Table, read_table
from symfive.importers.touch_log import Probed, fitted_centres, probed_run, read_touches

__all__ = [
    "FITTED", "SPLITS", "Matched", "Meaning", "Probed", "Setting", "Table", "along_run", "as_planned", "check_arc",
    "check_other", "cut_at_rests", "cut_short", "cycles_of", "every", "fitted_centres", "guessed_meanings", "meanings",
    "moved_pieces", "polar_doubts", "polar_run", "positioning_run", "prepared", "probe_run", "probed_run", "read_mtconnect",
    "read_polar", "read_recording", "read_table", "read_touches", "recorded_run", "rows_of", "runs_of", "shown_meanings",
    "split", "taken", "turns_of",
]  # fmt: skip
