"""`study.json`, `study.md`, `failures.md` and the pictures."""

from __future__ import annotations

import json
import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from .figures import BEYOND, Line, calibration, confusion, oracle_power, severity, table, wilson
from .score import SEEN, Row, as_well

logging.getLogger("matplotlib.font_manager").setLevel(logging.ERROR)
PROBABILITIES = [1.0 / (1.0 + 10.0 ** (-0.05 * k)) for k in range(-10, 68)]
"""0.24 to 0.9996, evenly in log odds."""


def write(
    root: Path, rows: Sequence[Row], seed: int, total: int, errors: Mapping[str, str], extra: Sequence[Line] = ()
) -> None:
    """Write table, calibration, failures and pictures of the cases finished so far into `root`."""
    lines = [*table(rows), *extra]
    data = {
        "seed": seed, "cases": total, "finished": len(rows), "code": dict(Counter(r["code"] for r in rows)),
        "table": [{**vars(line), "text": line.text} for line in lines], "calibration": calibration(rows),
        "severity": severity(rows), "rows": rows, "errors": dict(errors),
    }  # fmt: skip
    (root / "study.json").write_text(json.dumps(data, indent=1, default=float))
    (root / "study.md").write_text(_page(rows, lines, seed, total, data["code"], errors))
    (root / "failures.md").write_text(failures(rows, seed, errors))
    _pictures(root, rows)


def _page(
    rows: Sequence[Row],
    lines: Sequence[Line],
    seed: int,
    total: int,
    code: Mapping[str, int],
    errors: Mapping[str, str],
) -> str:
    out = [
        "# Blind study", "",
        f"Seed {seed}, {len(rows)} of {total} cases, {len(errors)} ended in an error. "
        f"Code (digest: cases): {', '.join(f'{k}: {v}' for k, v in code.items())}.", "",
        "| what | target | result, Wilson 95 % |", "| --- | --- | --- |",
        *(f"| {line.what} | {line.target} | {line.text} |" for line in lines), "",
        *_confusion(rows), "",
        "## Severity", "",
        "| SNR of the orthogonal part | cases | detected | named | oracle that knows the form |",
        "| --- | --- | --- | --- | --- |",
        *(f"| {s:.1f} | {n} | {100 * d:.0f} % | {100 * k:.0f} % | {100 * o:.0f} % |" for s, d, k, o, n in severity(rows)), "",
        "## Calibration of the names", "", "| stated | right | names |", "| --- | --- | --- |",
        *(f"| {p:.3f} | {r:.3f} | {n} |" for p, r, n in calibration(rows)), "",
        "Failures one by one: `failures.md`.", "",
    ]  # fmt: skip
    return "\n".join(out)


def _confusion(rows: Sequence[Row]) -> list[str]:
    lines, columns, counts = confusion(rows)
    head = [
        "## Truth against first finding",
        "",
        f"| truth | {' | '.join(columns)} |",
        "| --- |" + " --- |" * len(columns),
    ]
    return head + [f"| {t} | {' | '.join(str(counts[t, c] or '') for c in columns)} |" for t in lines]


def shortcomings(row: Row) -> list[str]:
    """Shortcomings of a case, in words; empty if there are none."""
    stratum, out = row["stratum"], []
    truth = row["truth"][0] if row["truth"] else None
    if stratum == "none":
        return ["false alarm"] if row["detected"] else []
    if not row["detected"]:
        faint = truth is not None and truth["snr"] < SEEN
        return [f"not detected{' (SNR below 5: excused)' if faint else ''}"]
    if stratum in ("visible", "masked", "alias") and not row["named"]:
        out.append(
            "no name" if not row["found"] else "wrong name" + (", and confident" if row["confident_wrong"] else "")
        )
    if stratum == "pairs" and not row["all_named"]:
        out.append("not both named")
    if stratum in BEYOND and not row["honest"]:
        out.append("not an unknown over the right coordinate")
    if stratum == "instrument" and not row["told"]:
        out.append("not distinguished from the machine")
    if row["invented"] and stratum not in BEYOND and (row["named"] or stratum == "pairs"):
        out.append("further effect invented")
    if stratum == "alias" and row["named"] and not row["class_complete"]:
        out.append("class not complete")
    if stratum == "alias" and row["named_again"] is not True:
        out.append("no next test" if row["named_again"] is None else "wrong after its next test")
    if stratum == "alias":
        return out
    if row["geometry"] and row["geometry"]["after"] > 2.0:
        out.append(
            f"geometry {row['geometry']['after']:.1f}σ off the oracle's (before {row['geometry']['before']:.1f})"
        )
    if row["heldout"]["after"] > 1.15:
        out.append(f"held-out {row['heldout']['after']:.2f} × noise")
    if row["f1"] and min(row["f1"]) < 0.5:
        out.append(f"place: F1 {min(row['f1']):.2f}")
    out += [
        f"{p['parameter']} {p['value']:.4g} ± {p['std']:.2g}, true {p['true']:.4g}"
        for p in row["parameters"]
        if p["textbook"] and p["z"] > 3.0 and p["error"] > 0.05
    ]
    return out


def reason(row: Row) -> str:
    """Explanation of a failure by the oracle's fit."""
    best, mine = row["oracle_chi2_dof"], row["chi2_dof"]
    if best is None:
        return "the library does not have this form, so there is no oracle"
    if not as_well(mine, best):
        return f"the library could explain it (oracle χ²/dof {best:.3f}): the search ended elsewhere"
    if not as_well(best, mine):
        return f"the library's nearest form does not explain it (oracle χ²/dof {best:.3f}), what was found does"
    return f"what was found explains the readings as well as the truth (oracle χ²/dof {best:.3f})"


def failures(rows: Sequence[Row], seed: int, errors: Mapping[str, str]) -> str:
    """All cases with a shortcoming, most frequent kinds first, and how to reproduce one."""
    bad = [(row, shortcomings(row)) for row in rows]
    bad = [(row, words) for row, words in bad if words]
    kinds = Counter(
        words[0].split(":")[0].split(" (")[0] if not words[0][:1].isdigit() else words[0] for _, words in bad
    )
    out = [
        "# Failures", "",
        f"{len(bad)} of {len(rows)} cases have a shortcoming, {len(errors)} ended in an error. To reproduce one: "
        f"`python -m examples.blind_study --seed {seed} --case ID -o DIR` (recordings in DIR/cases/ID/fit, answer in "
        "DIR/answers/ID.json).",
        "", *(f"* {n} × {k}" for k, n in kinds.most_common()), "",
    ]  # fmt: skip
    for row, words in sorted(bad, key=lambda item: item[0]["id"]):
        out += [
            f"## {row['id']} ({row['kind']}, {row['topology']}, code {row['code']})",
            "",
            f"**{'; '.join(words)}**",
            "",
        ]
        out += [f"* truth: {_truth(t)}" for t in row["truth"]]
        out += [f"* unidentified: {words}" for words in row["unnamed"]]
        out += [
            f"* found: {_found(f)}, over {where}"
            for f, where in zip(row["found"], row["coordinates_found"], strict=True)
        ]
        out += [f"* after its next test: {_found(f)}" for f in row.get("found_again", [])]
        out += [
            *([f"* why: {reason(row)}"] if row["truth"] else []),
            f"* χ²/dof after {row['chi2_dof']:.3f}, "
            f"held-out {row['heldout']['before']:.2f} → {row['heldout']['after']:.2f} × noise",
            "",
        ]
    out += [f"## {id}: error\n\n```\n{text}\n```\n" for id, text in errors.items()]
    return "\n".join(out)


def _truth(t: Mapping[str, Any]) -> str:
    same = f", same as {t['same']}" if t["same"] else ""
    close = f", close to {t['close']}" if t["close"] else ""
    size = f"{t['size']:.2f} × noise, {100 * t['masked']:.0f} % masked, SNR {t['snr']:.1f}"
    return f"{t['effect']} {t['name'][1]} ({t['form']}), {size}{same}{close}"


def _found(finding: Mapping[str, Any]) -> str:
    rivals = [r for r in finding["rivals"] if r["confidence"] >= 0.005]
    words = [f"{finding['form']} on {finding['axis']}, confidence {finding['confidence']:.3f}"]
    words += [f"rival {r['effect']} {r['axis']} {r['component'] or ''} {r['confidence']:.2f}" for r in rivals]
    words += [f"alias {', '.join(finding['alias'])}"] if finding["alias"] else []
    if finding["next_test_separation_sigma"] is not None:
        words.append(f"next test {finding['next_test'] or 'useless'} ({finding['next_test_separation_sigma']:.1f}σ)")
    return "; ".join(words)


def _pictures(root: Path, rows: Sequence[Row]) -> None:
    _severity(rows, root / "severity.png")
    _calibration(rows, root / "calibration.png")
    _matrix(rows, root / "confusion.png")


def _severity(rows: Sequence[Row], path: Path) -> None:
    curve, (figure, axes) = severity(rows), _figure(6.5, 4.5)
    grid = [0.5 * 1.05**k for k in range(150)]
    axes.semilogx(grid, [oracle_power(s) for s in grid], "k--", label="oracle that knows the form (1 % false alarms)")
    for column, marker, shift, label in ((1, "o", 0.97, "detected"), (2, "s", 1.03, "named")):
        at, found = [shift * c[0] for c in curve], [c[column] for c in curve]
        bounds = [wilson(round(c[column] * c[-1]), c[-1]) for c in curve]
        reach = [[f - low for f, (low, _) in zip(found, bounds, strict=True)],
                 [high - f for f, (_, high) in zip(found, bounds, strict=True)]]  # fmt: skip
        axes.errorbar(at, found, reach, fmt=f"{marker}-", capsize=3, label=f"{label}, Wilson's 95 %")
    for snr, *_, count in curve:
        axes.annotate(str(count), (snr, -0.09), ha="center", fontsize="small")
    axes.set(
        xlabel="SNR of what geometry and set-up leave of the effect\n(root of the sum of squares over all readings, in 1σ)",
        ylabel="share of cases", ylim=(-0.12, 1.03),
    )  # fmt: skip
    axes.annotate("cases:", (grid[0], -0.09), ha="center", fontsize="small")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.1))
    figure.savefig(path, dpi=120)


def _calibration(rows: Sequence[Row], path: Path) -> None:
    bins, (figure, axes) = calibration(rows), _figure(6.5, 4.5)
    axes.plot(PROBABILITIES, PROBABILITIES, "k--", label="calibrated")
    for k, (stated, right, count) in enumerate(bins):
        low, high = wilson(round(right * count), count)
        label = "names, with their number and Wilson's 95 %" if k == 0 else None
        axes.errorbar(stated, right, [[right - low], [high - right]], fmt="o", color="tab:blue", capsize=3, label=label)
        axes.annotate(str(count), (stated, low), (0, -4), textcoords="offset points", ha="center", va="top")
    axes.set_xscale("logit", use_overline=False)
    ticks = [0.3, 0.5, 0.7, 0.9, 0.97, 0.99, 0.999]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.set_xticks([], minor=True)
    axes.set(xlabel="stated probability of the name", ylabel="share that was right", ylim=(0, 1.05))
    axes.set_xlim(PROBABILITIES[0], PROBABILITIES[-1])
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=120)


def _matrix(rows: Sequence[Row], path: Path) -> None:
    """Counts, shaded by their share of the truth's cases."""
    lines, columns, counts = confusion(rows)
    figure, axes = _figure(2.0 + 0.45 * len(columns), 2.0 + 0.35 * len(lines))
    shares = [[counts[t, c] / max(sum(counts[t, k] for k in columns), 1) for c in columns] for t in lines]
    if lines:
        axes.imshow(shares, cmap="Blues", aspect="auto", vmin=0.0, vmax=1.0)
    for (t, c), count in counts.items():
        i, j = lines.index(t), columns.index(c)
        axes.text(j, i, str(count), ha="center", va="center", color="white" if shares[i][j] > 0.5 else "black")
    axes.set_xticks(range(len(columns)), columns, rotation=60, ha="right")
    axes.set_yticks(range(len(lines)), lines)
    axes.set(xlabel="first finding", ylabel="truth (in brackets: no effect of the library)")
    figure.savefig(path, dpi=120)


def _figure(width: float, height: float) -> tuple[Figure, Any]:
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.add_subplot()
