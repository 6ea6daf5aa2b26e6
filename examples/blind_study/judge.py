"""What symfive says of a sealed campaign: it sees the recordings and nothing else."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import symfive
from symfive.campaign import Campaign, read_campaign, write_campaign
from symfive.diagnose import Diagnosis, diagnose
from symfive.identify import Identification, fitted_model, predict


def judge(folder: Path, exclude: Sequence[str] = (), next_test: Path | None = None) -> dict[str, Any]:
    """The verdict on `folder`/fit, and how the diagnosed model predicts `folder`/heldout; plain data.

    The plan of the test that the diagnosis asks for, if it does, is written to `next_test`.
    """
    campaign = read_campaign(folder / "fit")
    began = time.process_time()
    found = diagnose(campaign, exclude=exclude)
    seconds = time.process_time() - began
    heldout = read_campaign(folder / "heldout")
    data = found.to_data()
    data["observability"] = [o for o in data["observability"] if o["sigmas"] > 3.0]
    asked = next((f.test for f in found.findings if f.test is not None and f.test.useful), None)
    if asked is not None and next_test is not None:
        write_campaign(asked.test, next_test)
    return {
        "diagnosis": data,
        "seconds": seconds,
        "heldout_rms_um": {"before": _held(found.before, heldout), "after": _held(found.after, heldout)},
        "geometry": {"before": geometry(found.before), "after": geometry(found.after)},
        "code": code(),
    }


def judge_again(folder: Path, measured: Path) -> dict[str, Any]:
    """The verdict on the campaign together with the recordings of the next test."""
    both = read_campaign(folder / "fit").joined(read_campaign(measured))
    found: Diagnosis = diagnose(both)
    return {"diagnosis": found.to_data(), "code": code()}


def geometry(result: Identification) -> dict[str, list[float]]:
    """Location errors of the baseline with their standard deviations, um and urad."""
    names = [p.name for p in result.parameters if p.kind == "location_error" and p.run is None and "." not in p.name]
    return {name: [result[name], result.uncertainty(name)] for name in names}


def _held(result: Identification, heldout: Campaign) -> float:
    return float(np.sqrt(np.mean(np.square(list(predict(fitted_model(result), heldout).rms_kept.values())))))


def code() -> str:
    """Digest of symfive's source: verdicts say which code gave them."""
    root = Path(symfive.__file__).parent
    return hashlib.sha256(b"\0".join(p.read_bytes() for p in sorted(root.rglob("*.py")))).hexdigest()[:12]
