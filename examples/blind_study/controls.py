"""Controls: with the true effect out of the catalogue it is `unknown`; the noise of real instruments is no effect; with
shuffled answers nobody has skill."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .figures import Line, share
from .score import CONFIDENT, names_of
from .store import Store


def controls(store: Store, ids: Sequence[str]) -> list[Line]:
    """Lines of the table for the controls that have been run."""
    lines = []
    runs = [store.get("controls", i) for i in ids if store.has("controls", i)]
    if runs:
        lines += _excluded("true effect excluded", "", [rounds[0] for rounds in runs])
        last = [rounds[-1] for rounds in runs]
        lines += _excluded("… and all names that explain the readings nearly as well", "none", last)
    noisy = [v for v in (store.get("recorded", i) for i in ids if store.has("recorded", i)) if v is not None]
    sources = {v["source"]: v["series"] for v in noisy}
    if noisy:
        what = f"noise of real instruments ({sum(sources.values())} series), no effect: a mismatch"
        lines.append(share(what, "none", (v["diagnosis"]["mismatch"] for v in noisy)))
        for source, series in sorted(sources.items()):
            hits = (v["diagnosis"]["mismatch"] for v in noisy if v["source"] == source)
            lines.append(share(f"… of {source} ({series})", "", hits))
    if ids:
        lines.append(shuffled(store, ids))
    return lines


def _excluded(what: str, target: str, verdicts: Sequence[dict[str, Any]]) -> list[Line]:
    first = [_first(v) for v in verdicts]
    named = [f if first_name(v) is not None else None for f, v in zip(first, verdicts, strict=True)]
    return [
        share(f"{what}: `unknown`", "", (f is not None and f["effect"] == "unknown" for f in first)),
        share(f"{what}: no finding", "", (f is None for f in first)),
        share(f"{what}: a confident name", target, (f is not None and f["confidence"] >= CONFIDENT for f in named)),
    ]


def first_name(verdict: dict[str, Any]) -> str | None:
    """The library's id of the first finding; None where it has no name."""
    first = _first(verdict)
    return None if first is None or first["effect"] == "unknown" else str(first["form"]).split(".")[0]


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
    """The first finding, if any."""
    findings: list[dict[str, Any]] = verdict["diagnosis"]["findings"]
    return findings[0] if findings else None
