"""Diagnosis: whether the model explains the readings, which effects are missing, and their cross-validation.

`diagnose` runs all steps. Each step also works alone: `detect` and `locate` before any name, the search in `symfive.posterior`,
`findings_of` in words, `amend` with effects that the user names, `next_test` to separate rivals, `cross_validated` on readings
left out in turn, `withdraw` and `held_out` on a part that takes no part in any fit.
"""

from symfive.diagnose._cross_validation import Fit, cross_validated
from symfive.diagnose._detect import Detection, Disagreement, Test, detect, log_tail
from symfive.diagnose._diagnose import diagnose
from symfive.diagnose._finding import Finding, RivalName
from symfive.diagnose._findings import amend, findings_of, model_averaged, moved
from symfive.diagnose._groups import partitions
from symfive.diagnose._hold_out import WORSE, HoldOut, Withdrawn, held_out, held_out_square, over_whole, root, withdraw
from symfive.diagnose._intervals import Interval, direction_of, intervals_of, with_begin
from symfive.diagnose._locate import Location, Observability, Suspect, locate, located
from symfive.diagnose._next_test import next_test, possible_tests
from symfive.diagnose._result import EXPLAINED, SHOWN_SHARE, Diagnosis
from symfive.diagnose._split import Split, first_half, parted, runs_of
from symfive.diagnose._stretches import stretches_of
from symfive.diagnose._words import facts_of, place_words, sentence_of

__all__ = [
    "EXPLAINED", "SHOWN_SHARE", "WORSE", "Detection", "Diagnosis", "Disagreement", "Finding", "Fit", "HoldOut", "Interval",
    "Location", "Observability", "RivalName", "Split", "Suspect", "Test", "Withdrawn", "amend", "cross_validated", "detect",
    "diagnose", "direction_of", "facts_of", "findings_of", "first_half", "held_out", "held_out_square",
    "intervals_of", "locate", "located", "log_tail", "model_averaged", "moved", "next_test", "over_whole", "parted",
    "partitions", "place_words", "possible_tests", "root", "runs_of", "sentence_of", "stretches_of", "with_begin",
    "withdraw",
]  # fmt: skip
