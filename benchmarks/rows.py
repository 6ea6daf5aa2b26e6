"""What the benchmarks found, as the lines of one table: numbers in, text out. Nothing is measured here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp
from typing import Any

import numpy as np

HEADS = ("what", "symfive", "peer or limit", "ratio", "target")
LEGEND = (
    "Ratio: the peer's time over symfive's, or symfive's over the limit. Exponents: fitted to the three largest sizes. "
    "✓ ahead, ✗ behind (reason below the table)."
)
UNEXPLAINED = "no reason known"
ABSOLUTE = "the target is in absolute seconds, and other programs ran beside (load above)"
PEERS_WRITE_NS = 32.7
"""Writing a Jacobian where the targets were set (PEERS.md), ns a pose."""
POWER_SIZES = 3
"""An exponent is fitted to so many of the largest sizes: below them, what is done once outweighs what grows."""
RIVALS = {
    "white": "plain BIC",
    "whitened": "BIC whitened once",
    "ARMA, clipped": "BIC whitened by ARMA(1,1) at every step and outliers clipped",
    "PySINDy": "PySINDy (STLSQ, threshold 5 σ)",
}


@dataclass(frozen=True)
class Row:
    """A line of the table. `ahead`: target reached or, without one, peer beaten (None: neither there); `why` if not."""

    what: str
    ours: str
    peer: str = "–"
    ratio: str = "–"
    target: str = "–"
    ahead: bool | None = None
    why: str = UNEXPLAINED


def table(rows: Sequence[Row], heading: str) -> str:
    """The Markdown: heading, the table, and a line with the reason for each row that is behind."""
    lines = [heading, LEGEND, "", f"| {' | '.join(HEADS)} |", f"|{' --- |' * len(HEADS)}"]
    for row in rows:
        mark = "" if row.ahead is None else " ✓" if row.ahead else " ✗"
        cells = (row.what, row.ours, row.peer, row.ratio, row.target + mark)
        lines.append(f"| {' | '.join(' '.join(cell.replace('|', '/').split()) for cell in cells)} |")
    behind = [
        f"- ✗ {row.what}{'' if row.peer == '–' else f', {row.peer}'}: {row.why}." for row in rows if row.ahead is False
    ]
    return "\n".join([*lines, *([""] if behind else []), *behind])


def faster(
    what: str,
    ours: float,
    peer: str,
    theirs: float | str,
    scale: str,
    at_least: float | None = None,
    why: str = UNEXPLAINED,
) -> Row:
    """A peer's time over ours; `theirs` as text is why the peer was skipped. `scale` formats a time."""
    target = f"≥ {at_least:g} ×" if at_least else "–"
    if isinstance(theirs, str):
        return Row(what, scale.format(ours), f"{peer}: {theirs}", target=target)
    ratio = theirs / ours
    shown = f"{peer}: {scale.format(theirs)}"
    return Row(what, scale.format(ours), shown, f"{short(ratio)} ×", target, bool(ratio >= (at_least or 1.0)), why)


def limited(what: str, ours: float, limit: str, value: float, at_most: float | None, why: str = UNEXPLAINED) -> Row:
    """Our time a pose over what the computer needs at least, ns."""
    ratio = ours / value
    target = f"≤ {at_most:g} ×" if at_most else "–"
    met = bool(ratio <= at_most) if at_most else None
    return Row(what, f"{ours:.1f} ns", f"{limit}: {value:.1f} ns", f"{ratio:.2f} ×", target, met, why)


def within(what: str, seconds: float, at_most: float) -> Row:
    """Seconds against a target in seconds."""
    return Row(what, f"{seconds:.3g} s", target=f"≤ {at_most:g} s", ahead=bool(seconds <= at_most), why=ABSOLUTE)


def exponent(costs: Sequence[tuple[float, float]]) -> float:
    """Slope of log cost over log size, least squares over the largest sizes."""
    sizes, spent = np.log(np.array(costs[-POWER_SIZES:], dtype=float)).T
    return float(np.polyfit(sizes, spent, 1)[0])


def grows(what: str, costs: Sequence[tuple[float, float]], size: str, unit: str, at_most: float | None = None) -> Row:
    """Cost of several sizes, and the exponent of its growth."""
    power, (last, cost) = exponent(costs), costs[-1]
    first, least = costs[-POWER_SIZES:][0]
    ours = f"{short(least)} {unit} at {first:.0f}, {short(cost)} {unit} at {last:.0f}"
    target = f"linear (≤ {at_most:g})" if at_most else "–"
    met = bool(power <= at_most) if at_most else None
    return Row(what, ours, ratio=f"{size}^{power:.2f}", target=target, ahead=met)


def short(value: float) -> str:
    """Two significant digits below ten, three from there on, no exponent."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}" if value >= 10.0 else f"{value:.2g}"


def jacobian_rows(found: Mapping[str, Any]) -> list[Row]:
    """From what `codegen.py` found: ns a pose."""
    ours, used, ns, what = found["ours"], found["used"], "{:.0f} ns", "point and Jacobian stored"
    writing, peak = min(found["past limit"], found["kept limit"]), f"FMA peak ({found['Gflop/s']:.0f} Gflop/s)"
    compiled = found["CasADi compiled"]
    writes = (
        f"7 × would be {compiled / 7.0:.0f} ns, of which writing alone takes {writing:.0f} ns here; median of pairs timed "
        f"side by side {found['CasADi pairs']:.1f} ×; with J used where it is made {compiled / used:.0f} ×"
    )
    kept = (
        f"this way of writing is the quicker one, and computing, {used:.0f} ns when nothing is stored and "
        f"{found['cached']:.0f} ns when J stays in the cache, is not hidden behind it"
    )
    rows = [
        limited(f"{what} past the caches", found["past"], "write bandwidth", found["past limit"], 1.15),
        limited(
            f"{what} through the caches",
            found["kept"],
            "write bandwidth, fetched ahead",
            found["kept limit"],
            1.15,
            kept,
        ),
        limited("J d, J used where it is made", used, peak, found["used limit"], 2.2),
        limited("JᵀJ, Jᵀr and rᵀr, J used where it is made", found["sums"], peak, found["sums limit"], 2.2),
        faster(what, ours, "CasADi's C, compiled", compiled, ns, 7.0, writes),
        faster(what, ours, "CasADi `.map`", found["CasADi map"], ns, 80.0),
    ]
    for name, at_least in (
        ("pinocchio", 25.0),
        ("SymForce", None),
        ("CppADCodeGen", None),
        ("JAX", None),
        ("numpy", None),
    ):
        key = next(k for k in found if k.startswith(name))
        theirs, why = found[key], UNEXPLAINED
        if name == "pinocchio" and not isinstance(theirs, str):
            why = (
                f"ours writes every J to memory, {writing:.0f} ns here ({PEERS_WRITE_NS:g} ns where the target was set), the "
                f"peer's loop leaves it in the cache; with J used where it is made {theirs / used:.0f} ×"
            )
        rows.append(faster(what, ours, key.replace(":", ","), theirs, ns, at_least, why))
    return rows


def design_rows(found: Mapping[str, Any], parameters: int) -> list[Row]:
    """From what `design.py` found: log det and seconds by name."""
    best, seconds = found["candidates"]
    rows, ours = [], f"{best:.3f} in {seconds:.3f} s"
    for name in ("FIGAROH DETMAX", "pydex"):
        what, theirs = "20 of 1000 poses: log det", found[name]
        if isinstance(theirs, str):
            rows.append(Row(what, ours, f"{name}: {theirs}", target="better"))
            continue
        shown = f"{name}: {theirs[0]:.3f} in {short(theirs[1])} s"
        rows.append(Row(what, ours, shown, f"{short(theirs[1] / seconds)} ×", "better", bool(best > theirs[0])))
    many = next(k for k in found if k.startswith("best of"))
    starts = int(many.split()[-1])
    refined, (reached, spent) = "20 poses refined over all positions", found["structured"]
    for key, text, at_least in (("automatic", "automatic Hessian", 10.0), ("L-BFGS", "L-BFGS", None)):
        peer = f"IPOPT, {text} (log det {found[key][0]:.3f}, ours {reached:.3f})"
        row = faster(refined, spent, peer, found[key][1], "{:.2f} s", at_least)
        better = (
            f"quicker, but from the same start it comes to a lower local optimum, as it does against the automatic Hessian; the "
            f"best of {starts} starts and one from the relaxed design has {found[many][0]:.3f}"
        )
        beaten = bool(row.ahead and (at_least is not None or reached >= found[key][0] - 1e-3))
        rows.append(replace(row, ahead=beaten, why=better if row.ahead else UNEXPLAINED))
    efficiency = exp((found[many][0] - found["bound"][0]) / parameters)
    return [
        *rows,
        within("1000 candidates chosen and bounded", seconds + found["bound on candidates"][1], 0.05),
        within(f"{refined}, one start", spent, 0.10),
        within(f"the same from {starts} starts", found[many][1], 0.12 * starts),
        within("bound on every design", found["bound"][1], 5.0),
        Row(
            "D-efficiency of the best, certified", f"≥ {efficiency:.3f}", "none bounds it", target="≥ 0.99",
            ahead=bool(efficiency >= 0.99),
        ),
    ]  # fmt: skip


def identification_rows(found: Mapping[str, Any]) -> list[Row]:
    """From what `least_squares.py` and `identify.py` found."""
    what, made = f"identification of {found['rows']} rows, {found['parameters']} parameters", []
    for method, fit in found["fits"].items():
        peer = f"scipy `least_squares`, {method}, tolerances {fit['tolerance']:.0e} ({fit['distance']:.0e} σ away)"
        made.append(faster(what, found["seconds"], peer, fit["seconds"], "{:.2f} s"))
    s = found["sensitivities"]
    what = f"sensitivities of {s['rows']} rows to {s['parameters']} parameters"
    peer = f"central differences of the same model ({s['largest']:.0e} of the largest entry away)"
    return [*made, faster(what, s["exact"], peer, s["differences"], "{:.3f} s")]


def growth_rows(found: Mapping[str, Any]) -> list[Row]:
    """From what `identify.py` and `growth.py` found: entries by rows, and pairs of size and seconds."""
    steps, memory = ([(e["rows"], e[name]) for e in found["rows"]] for name in ("step", "memory"))
    whole = [(e["rows"], e["identify"]) for e in found["rows"] if "identify" in e]
    return [
        grows("one Gauss–Newton step over rows", steps, "rows", "s", 1.1),
        grows("whole identification over rows", whole, "rows", "s"),
        grows("resident memory over rows", memory, "rows", "MB", 1.1),
        grows("R-test identified, over poses", found["poses"], "poses", "s"),
        grows("one Gauss–Newton step over parameters", found["parameters"], "parameters", "s"),
        grows("mismatch located, over the catalogue's effects", found["effects"], "effects", "s"),
    ]


def diagnosis_rows(found: Mapping[str, Mapping[str, Any]], campaigns: int) -> list[Row]:
    """From what `diagnosis.py` found: tallies by name."""
    what, ours, rows = f"{campaigns} open campaigns diagnosed: names right, false, missed", found["symfive"], []
    there = {name: text for name, text in RIVALS.items() if not found[name]["skipped"]}
    for name, text in RIVALS.items():
        theirs = found[name]
        if name not in there:
            rows.append(Row(what, _names(ours), f"{text}: {theirs['skipped']}"))
            continue
        wrong, worse = (t["false"] + t["missed"] for t in (ours, theirs))
        shown = f"{text}: {_names(theirs)}"
        rows.append(
            Row(what, _names(ours), shown, f"{wrong} : {worse} wrong", ahead=wrong < worse, why="as many are wrong")
        )
    quickest = min(there, key=lambda name: found[name]["seconds"])
    why = (
        "the rivals rank what they were given and stop; symfive's time holds scans, a fit with its noise for every name, "
        "leaving runs out and the search for the next test"
    )
    return [
        *rows,
        faster(
            "the same, CPU time", ours["seconds"], there[quickest], found[quickest]["seconds"], "{:.0f} s", None, why
        ),
    ]


def _names(t: Mapping[str, Any]) -> str:
    return f"{t['right']}, {t['false']}, {t['missed']}"
