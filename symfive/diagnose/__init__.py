"""Diagnosis: where the model is wrong, what was left out, and the proof that it is that.

Five steps, each usable alone: `detect`, `locate`, `name_effects`, `amend` (or `findings_of`), `prove`; `diagnose` does all.
"""

from symfive.diagnose._detect import Detection, Disagreement, Test, detect
from symfive.diagnose._diagnose import diagnose
from symfive.diagnose._findings import amend, findings_of, moved
from symfive.diagnose._groups import partitions
from symfive.diagnose._locate import Location, Observability, Suspect, locate
from symfive.diagnose._next_test import next_test, possible_tests
from symfive.diagnose._places import Interval, direction_of, intervals_of
from symfive.diagnose._prove import prove
from symfive.diagnose._refit import Trial
from symfive.diagnose._result import Diagnosis, Finding, Fit, RivalName
from symfive.diagnose._search import Member, Naming, name_effects
from symfive.diagnose._words import sentence_of

__all__ = [
    "Detection", "Diagnosis", "Disagreement", "Finding", "Fit", "Interval", "Location", "Member", "Naming",
    "Observability", "RivalName", "Suspect", "Test", "Trial", "amend", "detect", "diagnose", "direction_of", "findings_of",
    "intervals_of", "locate", "moved", "name_effects", "next_test", "partitions", "possible_tests", "prove", "sentence_of",
]  # fmt: skip
