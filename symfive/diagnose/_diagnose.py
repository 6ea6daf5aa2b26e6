"""`diagnose`: detect, locate, name, model and prove, from a campaign with readings to an expert's letter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from symfive.campaign import Campaign
from symfive.diagnose._detect import detect
from symfive.diagnose._findings import doubted, findings_of, withdrawn
from symfive.diagnose._locate import locate
from symfive.diagnose._prove import prove, with_next_test
from symfive.diagnose._result import Diagnosis
from symfive.diagnose._search import name_effects
from symfive.given import campaign_given
from symfive.threads import one_thread

__all__ = ["diagnose"]


@one_thread
def diagnose(
    campaign: Campaign | Path | str,
    *,
    false_alarms: float = 0.01,
    exclude: Sequence[str] = (),
    progress: Callable[[str], None] = lambda message: None,
) -> Diagnosis:
    """Find, name and model the physics that the baseline leaves out.

    `campaign` with readings, or the path of its folder;
    `false_alarms` is the rate at which a clean campaign may raise any finding, over the whole catalogue and the tests that
    need no name; `exclude` takes effects (by id) out of the catalogue, as a control. Raises `InputError` for a campaign
    without readings.

    The steps are usable alone: `detect`, `locate`, `name_effects`, `findings_of`, `prove`.
    """
    campaign = campaign_given(campaign)
    level = 0.5 * false_alarms  # one half for what has a name or a coordinate, one for disagreement without one
    detection = detect(campaign, level=level, progress=progress)
    location = locate(detection, exclude=exclude, progress=progress)
    naming = name_effects(location, level=level, exclude=exclude, progress=progress)
    progress("looking for the next test")
    findings = tuple(with_next_test(naming, finding) for finding in findings_of(naming))
    remaining = detect(naming.after, level=level) if naming.members else detection
    progress("leaving out runs in turn")
    return Diagnosis(
        p_value=min([1.0, *(float(np.exp(max(m.log_p, -690.0))) for m in naming.members), location.p_value]),
        noise_um=float(np.sqrt(np.mean([n.white**2 for n in naming.after.noises.values()]))),
        findings=findings,
        fit=prove(naming.before, naming.after),
        detection=detection,
        location=location,
        remaining=remaining,
        before=naming.before,
        after=doubted(naming),
        false_alarms=false_alarms,
        withdrawn=withdrawn(naming),
    )
