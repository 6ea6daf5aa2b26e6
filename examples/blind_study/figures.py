"""Numbers over rows: proportions with Wilson intervals, the issue's targets, confusion, calibration, severity."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from .frozen import FROZEN
from .score import SEEN, Row

MATERIAL_BIAS = 2.0
"""Geometry counts as falsified by an effect if it is this many sigmas off the oracle's before the repair."""


@dataclass(frozen=True)
class Line:
    """One line of the table: what, target, how many of how many with a 95 % interval, or a figure over n."""

    what: str
    target: str
    n: int
    value: float
    interval: tuple[float, float] | None = None

    @property
    def text(self) -> str:
        """As printed."""
        if self.n == 0:
            return "no case yet"
        if self.interval is None:
            return f"{self.value:.3g} (n = {self.n})"
        low, high = (100.0 * v for v in self.interval)
        return f"{100.0 * self.value:.1f} % of {self.n} [{low:.0f}, {high:.0f}]"


def wilson(k: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a proportion (E. B. Wilson 1927)."""
    if n == 0:
        return 0.0, 1.0
    p, q = k / n, z * z / n
    middle, half = (p + q / 2.0) / (1.0 + q), z * math.sqrt(p * (1.0 - p) / n + q / (4.0 * n)) / (1.0 + q)
    return min(p, max(0.0, middle - half)), max(p, min(1.0, middle + half))  # rounding leaves p out at 0 and 1


def share(what: str, target: str, hits: Iterable[bool]) -> Line:
    """A proportion."""
    values = [bool(h) for h in hits]
    k, n = sum(values), len(values)
    return Line(what, target, n, k / max(n, 1), wilson(k, n))


def figure(what: str, target: str, values: Iterable[float], measure: Callable[[Any], Any]) -> Line:
    """A statistic."""
    data = np.array(list(values), float)
    return Line(what, target, len(data), float(measure(data)) if len(data) else math.nan)


BEYOND = ("outside", *FROZEN)
"""Strata of physics that the vocabulary has no word for."""


def stated(rows: Sequence[Row]) -> list[tuple[float, bool]]:
    """Stated probability of every name given, and whether it was right."""
    return [
        (f["confidence"], r is not None)
        for row in rows
        for f, r in zip(row["found"], row["right"], strict=True)
        if f["effect"] != "unknown" and row["stratum"] not in ("none", *BEYOND)
    ]


BINS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0001)


def calibration(rows: Sequence[Row]) -> list[tuple[float, float, int]]:
    """Per bin of stated probability: its mean, the share that was right, how many."""
    pairs, out = stated(rows), []
    for low, high in pairwise(BINS):
        inside = [(p, r) for p, r in pairs if low <= p < high]
        if inside:
            out.append((float(np.mean([p for p, _ in inside])), float(np.mean([r for _, r in inside])), len(inside)))
    return out


def expected_calibration_error(rows: Sequence[Row]) -> float:
    """Mean |stated - true| over the bins, weighed by their numbers."""
    bins = calibration(rows)
    return sum(n * abs(p - r) for p, r, n in bins) / max(sum(n for *_, n in bins), 1)


def table(rows: Sequence[Row]) -> list[Line]:
    """The issue's targets, line by line."""
    by = {
        s: [r for r in rows if r["stratum"] == s]
        for s in ("none", "visible", "masked", "alias", "pairs", "instrument", *BEYOND)
    }
    seen = [r for r in by["masked"] if r["truth"][0]["snr"] >= SEEN]
    known = [*by["visible"], *by["masked"], *by["pairs"], *by["instrument"]]
    geometry = [r["geometry"] for r in rows if r["geometry"] and r["stratum"] in ("visible", "masked", "pairs")]
    false = [g for g in geometry if g["before"] > MATERIAL_BIAS]
    magnitudes = [p for r in rows for p in r["parameters"] if p["textbook"]]
    left = [r for r in by["alias"] if not r["named_again"]]
    f1 = [v for r in known for v in r["f1"]]
    held = [r["heldout"]["after"] for r in rows]
    return [
        share("false alarms on `none`", "≤ 2 %", (r["detected"] for r in by["none"])),
        share("visible: detected", "≥ 98 %", (r["detected"] for r in by["visible"])),
        share("visible: named, axis and family, top 1", "≥ 97 %", (r["named"] for r in by["visible"])),
        share("visible: named in the top 2", "≥ 99 %", (r["named"] or r["named_in_two"] for r in by["visible"])),
        share("visible: a second effect invented", "", (r["invented"] > 0 for r in by["visible"])),
        figure("location: F1 over intervals, median", "≥ 0.90", f1, np.median),
        figure("location: F1 over intervals, mean", "≥ 0.90", f1, np.mean),
        share("masked, SNR ≥ 5: named", "≥ 90 %", (r["named"] for r in seen)),
        share("masked: confident wrong name", "none", (r["confident_wrong"] for r in by["masked"])),
        share("geometry after repair within 2σ of the oracle's", "all", (g["after"] <= 2.0 for g in geometry)),
        share("… of oracle's and its own stated uncertainty", "", (g["both"] <= 2.0 for g in geometry)),
        share("… its 95 % intervals hold the truth", "", (abs(z) <= 1.96 for g in geometry for z in g["truth_z"])),
        share("… the oracle's hold it", "", (abs(z) <= 1.96 for g in geometry for z in g["oracle_truth_z"])),
        figure("falsified geometry: bias before over after, median", "≥ 10", map(_relief, false), np.median),
        share("alias: class complete", "≥ 95 %", (r["class_complete"] for r in by["alias"])),
        share("… but for names that need 100 times the motion", "", (r["likely_complete"] for r in by["alias"])),
        share("alias: named after its own next test", "≥ 95 %", (bool(r["named_again"]) for r in by["alias"])),
        share("alias: of the others, in the class stated, no known test separates it", "", (r["told_alike"] for r in left)),
        share("pairs: both named", "≥ 85 %", (r["all_named"] for r in by["pairs"])),
        share("pairs: a third invented", "≤ 5 %", (r["invented"] > 0 for r in by["pairs"])),
        share("outside: `unknown` over the right coordinate", "≥ 85 %", (r["honest"] for r in by["outside"])),
        *(share(f"{s}: `unknown` or what predicts, over the right coordinate", "", (r["honest"] for r in by[s])) for s in FROZEN),
        share("known called `unknown`", "≤ 5 %", (r["unknown"] > 0 for r in known)),
        share("instrument separated from machine", "≥ 90 %", (r["told"] for r in by["instrument"])),
        figure("parameter error, median", "≤ 0.05", (p["error"] for p in magnitudes), np.median),
        share("95 % interval covers", "92–98 %", (p["z"] <= 1.96 for p in magnitudes)),
        Line("stated probability: expected calibration error", "≤ 0.05", len(stated(rows)), expected_calibration_error(rows)),
        figure("held-out rms over noise, median", "≤ 1.05", held, np.median),
        figure("held-out rms over noise, 90th percentile", "≤ 1.15", held, lambda v: np.percentile(v, 90.0)),
        figure("seconds a diagnosis (processor), median", "", (r["seconds"] for r in rows), np.median),
    ]  # fmt: skip


def _relief(geometry: Row) -> float:
    return float(geometry["before"] / max(geometry["after"], 0.01))


def confusion(rows: Sequence[Row]) -> tuple[list[str], list[str], Counter[tuple[str, str]]]:
    """Truth (rows) against the first finding (columns) for cases of one effect; `class`: an alias was named instead."""
    counts: Counter[tuple[str, str]] = Counter()
    for row in rows:
        if len(row["truth"]) > 1:
            continue
        truth = row["truth"][0]["name"][0] if row["truth"] else "none"
        truth = f"({truth})" if row["stratum"] in BEYOND else truth
        counts[truth, _column(row)] += 1
    lines = sorted({t for t, _ in counts})
    columns = [*sorted({c for _, c in counts} - {"class", "unknown", "none"}), "class", "unknown", "none"]
    return lines, columns, counts


def _column(row: Row) -> str:
    if not row["found"]:
        return "none"
    first = row["found"][0]
    if row["named"] and [first["effect"], first["axis"]] != list(row["truth"][0]["name"]):
        return "class"
    if not row["named"] and row["truth"] and first["effect"] == row["truth"][0]["name"][0]:
        return f"{first['effect']}, other axis"
    return str(first["effect"])


SNR_EDGES = (2.0, 4.0, 6.0, 10.0, 20.0, 60.0, 1e9)


def severity(rows: Sequence[Row]) -> list[tuple[float, float, float, float, int]]:
    """Per bin of the orthogonal part's SNR: its median, share detected, share named, what an oracle would detect, n."""
    singles = [(r["truth"][0]["snr"], r["detected"], r["named"]) for r in rows if r["stratum"] in ("visible", "masked")]
    out = []
    for low, high in zip((0.0, *SNR_EDGES[:-1]), SNR_EDGES, strict=True):
        inside = [s for s in singles if low <= s[0] < high]
        if inside:
            snr = [s[0] for s in inside]
            out.append((
                float(np.median(snr)), float(np.mean([s[1] for s in inside])), float(np.mean([s[2] for s in inside])),
                float(np.mean([oracle_power(v) for v in snr])), len(inside),
            ))  # fmt: skip
    return out


def oracle_power(snr: float, threshold: float = 2.326) -> float:
    """Power of the matched filter that knows the effect's form, at 1 % false alarms."""
    return 0.5 * math.erfc((threshold - snr) / math.sqrt(2.0))
