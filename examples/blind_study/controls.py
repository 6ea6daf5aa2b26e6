"""Controls: with the true effect out of the catalogue nobody may name it; with shuffled answers nobody has skill."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .figures import Line, share
from .score import names_of
from .store import Store


def controls(store: Store, ids: Sequence[str]) -> list[Line]:
    """Lines of the table for the controls that have been run."""
    lines = []
    done = [i for i in ids if store.has("controls", i)]
    if done:
        first = [_first(store.get("controls", i)) for i in done]
        lines.append(
            share(
                "true effect excluded: `unknown` or no finding",
                "",
                (f is None or f["effect"] == "unknown" for f in first),
            )
        )
        confident = (f is not None and f["effect"] != "unknown" and f["confidence"] >= 0.9 for f in first)
        lines.append(share("true effect excluded: a confident wrong name", "", confident))
    if ids:
        lines.append(shuffled(store, ids))
    return lines


def shuffled(store: Store, ids: Sequence[str]) -> Line:
    """How often the first finding of one case names the effect of another one (mean over all rotations of the list)."""
    singles = [(store.get("answers", i)["facts"], _first(store.get("verdicts", i))) for i in ids]
    singles = [(facts[0], first) for facts, first in singles if len(facts) == 1 and first is not None]
    hits = [
        (found["effect"], found["axis"]) in names_of(singles[(k + turn) % len(singles)][0])
        for turn in range(1, len(singles))
        for k, (_, found) in enumerate(singles)
    ]
    return Line("labels shuffled: named by chance", "", len(singles), float(np.mean(hits)) if hits else 0.0)


def _first(verdict: dict[str, Any]) -> dict[str, Any] | None:
    findings = verdict["diagnosis"]["findings"]
    return findings[0] if findings else None
