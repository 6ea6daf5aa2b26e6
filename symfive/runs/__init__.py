"""Runs and campaigns as plain data: commands and readings. `symfive.campaign` reads them from folders and writes them."""

from symfive.runs._campaign import MOUNTED, Campaign
from symfive.runs._options import OPTIONS
from symfive.runs._run import FIRST_LINE, Column, Piece, Run, SetupSigma, Vector, instrument_words

__all__ = [
    "FIRST_LINE", "MOUNTED", "OPTIONS", "Campaign", "Column", "Piece", "Run", "SetupSigma", "Vector", "instrument_words",
]  # fmt: skip
