"""Diagnosis: where the model is wrong, what was left out, and the proof that it is that.

Five steps, each usable alone: `detect`, `locate`, `name_effects`, `amend` (or `findings_of`), `prove`; `diagnose` does all.
"""

from symfive.diagnose._detect import Detection, Disagreement, Test, detect
from symfive.diagnose._diagnose import diagnose
from symfive.diagnose._findings import amend, findings_of, moved
from symfive.diagnose._groups import partitions
from symfive.diagnose._locate import Location, Observability, Suspect, locate
from symfive.diagnose._next_test import next_test, possible_tests
from symfive.diagnose._places import Interval, direction_of, in_the_drive, intervals_of
from symfive.diagnose._prove import prove
from symfive.diagnose._refit import Trial
from symfive.diagnose._result import EXPLAINED, SHOWN_SHARE, Diagnosis, Finding, Fit, RivalName, named, wrapped
from symfive.diagnose._search import Member, Naming, name_effects
from symfive.diagnose._words import facts_of, place_words, sentence_of

__all__ = [
    "EXPLAINED", "SHOWN_SHARE", "Detection", "Diagnosis", "Disagreement", "Finding", "Fit", "Interval", "Location",
    "Member", "Naming", "Observability", "RivalName", "Suspect", "Test", "Trial", "amend", "detect", "diagnose",
    "direction_of", "facts_of", "findings_of", "in_the_drive", "intervals_of", "locate", "moved", "name_effects",
    "named", "next_test", "partitions", "place_words", "possible_tests", "prove", "sentence_of", "wrapped",
]  # fmt: skip
