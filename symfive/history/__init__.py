"""A machine's history: many machines, many years; what changed, what steps or drifts, when to come back.

    with History("history/", create=True) as history:
        history.add("results/")
        print(trend_text(history.trend("tilting table BC")))

Results stay where they are and stay the truth: `visit.json` among them is what the index reads, and the index can be rebuilt.
"""

from symfive.history._alarms import Alarm, Cause
from symfive.history._certificate import Office, certificate
from symfive.history._change import Change, FindingChange, change_between
from symfive.history._forecast import Forecast
from symfive.history._history import FOLDER, Added, History, Rebuilt, rebuilt
from symfive.history._limits import RATE, Limits, ewma_run_length
from symfive.history._page import fleet_page, machine_page
from symfive.history._serve import Server
from symfive.history._take import RECORD, Details, read_record, record_bytes, taken
from symfive.history._trend import Trend, trend_of
from symfive.history._visit import KINDS, STAGES, Event, Finding, MachineId, Visit, instant
from symfive.history._watched import Watched
from symfive.history._words import MachineRow, MachineTable, trend_text

__all__ = [
    "FOLDER", "KINDS", "RATE", "RECORD", "STAGES", "Added", "Alarm", "Cause", "Change", "Details", "Event",
    "Finding", "FindingChange", "Forecast", "History", "Limits", "MachineId", "MachineRow", "MachineTable",
    "Office", "Rebuilt", "Server", "Trend", "Visit", "Watched", "certificate", "change_between", "ewma_run_length",
    "fleet_page", "instant", "machine_page", "read_record", "rebuilt", "record_bytes", "taken", "trend_of",
    "trend_text",
]  # fmt: skip
