"""Answers and verdicts that tests of the blind study share."""

from typing import Any


def verdict_with(findings: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "diagnosis": {"mismatch": bool(findings), "findings": findings, "classes": [], "fit": {"chi2_dof_after": 1.0}},
        "seconds": 1.0, "heldout_rms_um": {"before": 1.0, "after": 0.4}, "geometry": {"before": {}, "after": {}}, "code": "x",
    }  # fmt: skip


SPEC = {"effect": "backlash", "axis": "C", "width": 60.0, "form": "hard"}


def finding_of(effect: str, axis: str | None, **more: Any) -> dict[str, Any]:
    plain = {"form": f"{effect}.{axis}", "confidence": 0.95, "rivals": [], "alias": [], "parameters": {}}
    where = {"runs": [], "coordinate": "C", "intervals": [], "direction": None}
    tests = {"next_test": None, "next_test_separation_sigma": None}
    return {"effect": effect, "axis": axis, "where": where, **plain, **tests, **more}


def said_of(effect: str, axis: str | None, confidence: float, **more: Any) -> dict[str, Any]:
    return {"effect": effect, "axis": axis, "confidence": confidence, **more}
