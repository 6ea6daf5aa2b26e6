"""One row per case: verdict against answer. Nothing here is tuned to a case."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .effects import INSTRUMENT
from .forms import honest
from .frozen import FROZEN
from .oracle import TEXTBOOK, form_of
from .others import coordinates

Name = tuple[str, str | None]
Row = dict[str, Any]
SHOWN = ("effect", "axis", "form", "confidence", "rivals", "alias", "next_test", "next_test_separation_sigma")
CONFIDENT = 0.9
LISTED = 0.01
"""Confidence from which a rival counts as listed."""
SEEN = 5.0
"""SNR of the orthogonal part from which an effect is to be named."""
INSTRUMENTS_OWN = {"sensor_error", "latency", "setup_shift"}


def as_well(mine: float, best: float) -> bool:
    """Whether a fit explains the readings nearly as well as the best one: χ²/dof within 5 % and 0.02."""
    return mine <= 1.05 * best + 0.02


def names_of(fact: Mapping[str, Any]) -> list[Name]:
    """Names that are right: the effect's own, and those that the recordings cannot distinguish from it."""
    return [_name(fact["name"]), *map(_name, fact["same"])]


def _name(pair: Sequence[str | None]) -> Name:
    return str(pair[0]), pair[1]


def found_names(finding: Mapping[str, Any]) -> list[Name]:
    """A finding's name, then its rivals by confidence."""
    rivals = sorted(finding["rivals"], key=lambda r: -r["confidence"])
    return [(finding["effect"], finding["axis"]), *((r["effect"], r["axis"]) for r in rivals)]


def score(
    answer: Mapping[str, Any], verdict: Mapping[str, Any], oracle: Mapping[str, Any] | None, again: Any = None
) -> Row:
    """Everything that the tables need of one case."""
    findings, facts = verdict["diagnosis"]["findings"], answer["facts"]
    right = [_right(f, facts) for f in findings]
    first = findings[0] if findings else None
    row: Row = {
        "id": answer["id"], "stratum": answer["stratum"], "kind": answer["kind"], "topology": answer["topology"],
        "truth": [
            dict(f, acting=None, form=form_of(e), effect=e["effect"]) for f, e in zip(facts, answer["effects"], strict=True)
        ],
        "found": [{k: f[k] for k in SHOWN} for f in findings],
        "coordinates_found": [f["where"]["coordinate"] for f in findings],
        "detected": verdict["diagnosis"]["mismatch"], "unnamed": verdict["diagnosis"].get("unnamed", []), "right": right,
        "named": bool(right) and right[0] is not None,
        "named_in_two": bool(first) and any(n in names_of(f) for f in facts for n in found_names(first)[:2]),
        "all_named": len(facts) > 0 and {r for r in right if r is not None} == set(range(len(facts))),
        "invented": sum(r is None for r in right),
        "unknown": sum(f["effect"] == "unknown" for f in findings),
        "confident_wrong": bool(first) and right[0] is None and first["effect"] != "unknown" and first["confidence"] >= CONFIDENT,
        "heldout": {k: v / answer["heldout_noise_um"] for k, v in verdict["heldout_rms_um"].items()},
        "chi2_dof": verdict["diagnosis"]["fit"]["chi2_dof_after"],
        "oracle_chi2_dof": (oracle or {}).get("chi2_dof"), "seconds": verdict["seconds"], "code": verdict["code"],
        "f1": _f1(oracle, right),
        "parameters": [
            p for f, r in zip(findings, right, strict=True) if r is not None for p in parameters(answer["effects"][r], f)
        ],
        "geometry": _geometry(verdict["geometry"], oracle, answer["location_errors_um_urad"]),
    }  # fmt: skip
    if answer["stratum"] == "alias":
        row["class_complete"] = bool(findings) and class_complete(
            facts[0], findings[0], verdict["diagnosis"]["classes"]
        )
        row["likely_complete"] = bool(findings) and class_complete(
            facts[0], findings[0], verdict["diagnosis"]["classes"], (oracle or {}).get("oversized", [])
        )
        row["named_again"] = named_again(facts[0], (oracle or {}).get("inseparable", []), verdict, again)
        last = (again or verdict)["diagnosis"]["findings"]
        row["told_alike"] = not row["named_again"] and bool(last) and _indistinguishable(facts[0], last[0])
        row["found_again"] = [{k: f[k] for k in SHOWN} for f in again["diagnosis"]["findings"]] if again else []
    if answer["stratum"] == "outside":
        row["honest"] = (
            bool(first)
            and first["effect"] == "unknown"
            and bool(set(first["where"]["coordinate"].split(", ")) & coordinates(answer["effects"][0]))
        )
    if answer["stratum"] in FROZEN:
        (spec,) = answer["effects"]
        row["honest"] = honest(FROZEN[answer["stratum"]][spec["effect"]], spec, first, row["heldout"])
    if answer["stratum"] == "instrument":
        row["told"] = bool(findings) and all(_of_instrument(f) for f in findings)
    return row


def _right(finding: Mapping[str, Any], facts: Sequence[Mapping[str, Any]]) -> int | None:
    """Which true effect a finding names, None if none."""
    name = (finding["effect"], finding["axis"])
    return next((i for i, fact in enumerate(facts) if name in names_of(fact)), None)


def _of_instrument(finding: Mapping[str, Any]) -> bool:
    form = finding["form"]
    return finding["effect"] in INSTRUMENTS_OWN or form.startswith(INSTRUMENT) or form.endswith("reading")


def class_complete(
    fact: Mapping[str, Any],
    finding: Mapping[str, Any],
    classes: Sequence[Sequence[str]],
    oversized: Sequence[Sequence[str | None]] = (),
) -> bool:
    """Whether all names that the recordings cannot distinguish are listed, but for `oversized` ones: the finding, its rivals,
    aliases and class."""
    listed = {(finding["effect"], finding["axis"])}
    listed |= {(r["effect"], r["axis"]) for r in finding["rivals"] if r["confidence"] >= LISTED}
    keys = {finding["form"], *finding["alias"]}
    listed |= {key_name(k) for group in classes if keys & set(group) for k in group} | {key_name(k) for k in keys}
    return set(names_of(fact)) - set(map(_name, oversized)) <= listed


def key_name(key: str) -> Name:
    """Name of a form's key such as `location_error.EC0X` or `gravity_sag.B.EZB`."""
    effect, *parts = key.split(".")
    if not parts:
        return effect, None
    part = parts[0]
    return effect, part if len(part) < 3 else part[3:] if part[2] == "0" else part[2:]


def named_again(
    fact: Mapping[str, Any],
    inseparable: Sequence[Sequence[str | None]],
    verdict: Mapping[str, Any],
    again: Mapping[str, Any] | None,
) -> bool | None:
    """Whether the effect's own name comes first once the next test is recorded, or one that no measurement parts from it.

    None where no test was asked for, but for effects of which no measurement parts any alias: there the verdict stands.
    """
    alike = {_name(fact["name"]), *map(_name, inseparable)}
    if again is None and not set(names_of(fact)) <= alike:
        return None
    findings = (again or verdict)["diagnosis"]["findings"]
    return bool(findings) and (findings[0]["effect"], findings[0]["axis"]) in alike


def _indistinguishable(fact: Mapping[str, Any], finding: Mapping[str, Any]) -> bool:
    """Whether the finding is the truth or states that both cannot be distinguished, and no test at hand separates them."""
    return _name(fact["name"]) in map(key_name, (finding["form"], *finding["alias"])) and not finding["next_test"]


def _f1(oracle: Mapping[str, Any] | None, right: Sequence[int | None]) -> list[float]:
    table = (oracle or {}).get("f1", [])
    return [table[k][i] for k, i in enumerate(right) if i is not None and k < len(table)]


def f1_table(fit: Path, findings: Sequence[Mapping[str, Any]], facts: Sequence[Mapping[str, Any]]) -> list[list[float]]:
    """F1 of the rows in which a finding acts (its intervals) against those in which the effect does: finding x effect."""
    times = {run: _times(fit / f"{run}.csv") for run in (facts[0]["acting"] if facts else {})}
    return [[_overlap(times, f["where"]["intervals"], fact["acting"]) for fact in facts] for f in findings]


def _times(path: Path) -> np.ndarray:
    with path.open(newline="") as file:
        return np.array([float(line[0]) for line in list(csv.reader(file))[1:]])


def _overlap(
    times: Mapping[str, np.ndarray], intervals: Sequence[Mapping[str, Any]], acting: Mapping[str, list[bool]]
) -> float:
    both = said = true = 0
    for run, t in times.items():
        mine = np.zeros(len(t), bool)
        for i in intervals:
            if i["run"] == run:
                mine |= (t >= i["t_s"][0] - 1e-9) & (t <= i["t_s"][1] + 1e-9)
        theirs = np.array(acting[run])
        both, said, true = both + int((mine & theirs).sum()), said + int(mine.sum()), true + int(theirs.sum())
    return 2.0 * both / max(said + true, 1)


def _geometry(verdict: Mapping[str, Any], oracle: Mapping[str, Any] | None, truth: Mapping[str, float]) -> Row | None:
    """Departures from the oracle in its own sigmas, before and after, and in `both` the oracle's and the verdict's; departures of
    both from the truth, each in its own; None without an oracle or a geometry."""
    if not oracle or not oracle.get("geometry"):
        return None
    reference = oracle["geometry"]
    names = [n for n in reference if n in verdict["after"] and reference[n][1] > 0.0]
    if not names:
        return None

    def departure(which: Mapping[str, Any], own: bool = False) -> float:
        return max(
            abs(which[n][0] - reference[n][0]) / np.hypot(reference[n][1], which[n][1] if own else 0.0) for n in names
        )

    def from_truth(which: Mapping[str, Any]) -> list[float]:
        return [(which[n][0] - truth[n]) / which[n][1] for n in names if n in truth and which[n][1] > 0.0]

    return {
        "before": departure(verdict["before"]), "after": departure(verdict["after"]),
        "both": departure(verdict["after"], own=True),
        "truth_z": from_truth(verdict["after"]), "oracle_truth_z": from_truth(reference),
    }  # fmt: skip


def parameters(spec: Mapping[str, Any], finding: Mapping[str, Any]) -> list[Row]:
    """Magnitudes that mean the same in the plant and in the library, with error and departure in sigmas."""
    said, pairs = finding["parameters"], _magnitudes(spec)
    if spec.get("component") and said.get("component", spec["component"]) != spec["component"]:
        return []
    if spec.get("axis") and finding["axis"] not in (None, spec["axis"]):
        return []  # an alias: the gain of another axis' loop
    out = []
    for keys, true in pairs:
        entry = next((said[k] for k in keys if k in said), None)
        if entry is None or not isinstance(entry.get("value"), float) or not entry.get("std"):
            continue
        value = entry["value"] if entry["value"] * true > 0.0 else abs(entry["value"])
        out.append({
            "effect": spec["effect"], "parameter": keys[0], "form": form_of(spec), "textbook": form_of(spec) in TEXTBOOK,
            "true": true, "value": value, "std": entry["std"],
            "error": abs(value - true) / abs(true), "z": abs(value - true) / entry["std"],
        })  # fmt: skip
    return out


def _magnitudes(spec: Mapping[str, Any]) -> list[tuple[tuple[str, ...], float]]:
    plain = {
        "backlash": ("width",), "transmission_error": ("amplitude", "period"), "scale_error": ("ppm",),
        "location_error": ("value",), "thermal_drift": ("amplitude", "time_constant_s"), "lateral_play": ("width",),
        "servo_mismatch": ("position_gain", "velocity_gain", "feedforward"), "friction": ("coulomb",),
        "vibration": ("amplitude", "frequency_hz"), "inertial_compliance": ("compliance",), "latency": ("delay_ms",),
    }  # fmt: skip
    if spec["effect"] == "gravity_sag":
        first = ("amplitude_one_minus_cos",) if spec.get("form") == "one_minus_cos" else ()
        return [((*first, "amplitude"), abs(float(spec["amplitude"])))]
    return [((key,), float(spec[key])) for key in plain.get(spec["effect"], ()) if spec.get(key)]
