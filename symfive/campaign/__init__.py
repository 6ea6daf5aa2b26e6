"""Campaigns as plain data: runs of commands and readings, read from and written to folders."""

from symfive.campaign._read import campaign_problems, read_campaign, write_campaign, write_campaign_files
from symfive.runs import FIRST_LINE, Campaign, Run, SetupSigma, Vector

__all__ = [
    "FIRST_LINE", "Campaign", "Run", "SetupSigma", "Vector", "campaign_problems", "read_campaign", "write_campaign",
    "write_campaign_files",
]  # fmt: skip
