"""The frozen strata: physics for which nothing in the search was written. Each is asked for by number and belongs to no total."""

from __future__ import annotations

from collections.abc import Mapping

from . import foreign, strange
from .forms import Form

FROZEN: Mapping[str, Mapping[str, Form]] = {"foreign": foreign.FORMS, "strange": strange.FORMS}
"""Stratum -> its forms; case number k of a stratum has the form k modulo their number."""


def frozen_ids(stratum: str, count: int) -> list[str]:
    """Names of the first cases of a stratum; every form comes once before any comes again."""
    return [f"{stratum}-{k:03d}" for k in range(count)]


def form_of_case(stratum: str, number: int) -> Form:
    """The form of the case with that number."""
    forms = list(FROZEN[stratum].values())
    return forms[number % len(forms)]
