"""Diagnosis: where the model is wrong, what was left out, and the proof that it is that."""

from symfive.diagnose._diagnose import diagnose
from symfive.diagnose._next_test import next_test, possible_tests
from symfive.diagnose._result import Diagnosis, Finding, Fit, Interval, Observability, RivalName

__all__ = [
    "Diagnosis",
    "Finding",
    "Fit",
    "Interval",
    "Observability",
    "RivalName",
    "diagnose",
    "next_test",
    "possible_tests",
]
