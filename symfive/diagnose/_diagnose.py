"""`diagnose`: search for missing effects, decide, describe and validate."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from symfive.campaign import Campaign
from symfive.diagnose._cross_validation import cross_validated
from symfive.diagnose._detect import detect
from symfive.diagnose._findings import findings_of, model_averaged
from symfive.diagnose._hold_out import HoldOut, held_out, validated, variations_withdrawn, withdraw, worse_held_out
from symfive.diagnose._locate import located
from symfive.diagnose._result import Diagnosis
from symfive.diagnose._split import Split, parted
from symfive.diagnose._stretches import stretches_of
from symfive.effects import Effect, Varying
from symfive.errors import InputError
from symfive.given import campaign_given
from symfive.identify import Identification, wiring_doubts
from symfive.plausible import unreadable
from symfive.posterior import EXPECTED, Posterior, baseline, candidates, fitted, over_all, polish, verdicts_on
from symfive.threads import one_thread

UNSEEN = "the rows outside the search"


@one_thread
def diagnose(
    campaign: Campaign | Path | str,
    *,
    false_alarms: float = 0.01,
    exclude: Collection[str] = (),
    hold_out: str | Split | None = None,
    progress: Callable[[str], None] = lambda message: None,
) -> Diagnosis:
    """Find the effects missing from the baseline model, with location, size and all parameters identified.

    `campaign` with readings, or the path of its folder; `false_alarms` the rate at which the general tests for lack of fit may
    fail a clean campaign (names follow from probabilities and losses: `symfive.posterior.decide`); `exclude` removes
    effects (by id) from the catalogue, as a control. With `hold_out` (`half`, `cycles`, `runs:NAMES`: see `parted`) only
    the rest is fitted; a finding that worsens the prediction of the held-out part is withdrawn. In recordings with more than
    20,000 rows in total the search uses a subset (`stretches_of`); a finding that worsens the prediction of the other rows is
    withdrawn, and every value is identified from all rows, window by window. Raises `InputError` for a campaign without readings,
    for readings outside the range of the instrument, and if nothing is left to fit.

    The steps are usable alone: `detect`, `locate`; `candidates`, `moments_of`, `explore`, `polish`, `coarsened`, `decide` and
    `verdicts_on` of `symfive.posterior`; `withdraw`, `findings_of`, `cross_validated`, `held_out`.
    """
    whole = campaign = campaign_given(campaign)
    if said := unreadable(campaign):
        raise InputError(said[0], remedy=said[1])
    split = None
    if hold_out is not None:
        whole, split = parted(campaign, hold_out)
        campaign = split.fitted(whole)
    seen, rows = stretches_of(campaign)
    stated = candidates(seen, exclude)
    progress("fitting the baseline")
    before = baseline(seen)
    posterior, here = polish(before, stated, progress)
    searched: HoldOut | None = None
    hold_out_result: HoldOut | None = None
    if seen is not campaign:
        progress("predicting the rows outside the search")
        here, searched = validated(before, here, campaign, Split(UNSEEN, lambda run: rows[run.id]))
    start, first = before, here
    if seen is not campaign:
        progress("identifying from all rows")
        before, here = baseline(campaign), over_all(here, campaign)
    if split is not None:
        progress("predicting the held-out part")
        full, (here, withdrawn) = here, withdraw(here, before, whole, split)
        if any(isinstance(form.effect, Varying) for form in full.held):
            other, same = polish(start, replace(stated, vary=False), progress)
            laws = same if seen is campaign else over_all(same, campaign)
            plain, gone = withdraw(laws, before, whole, split)
            if worse_held_out(here, plain, whole, split):
                withdrawn = (*variations_withdrawn(full, laws, whole, split), *gone)
                posterior, here, first = other, plain, same
        hold_out_result = held_out(before, here.fit, whole, split, withdrawn)
    verdicts = verdicts_on(posterior)
    if searched is not None or hold_out_result is not None:
        kept = {form.effect.key for form in here.held}
        verdicts = tuple(v for v in verdicts if posterior.moments.terms[v.term].effect.key in kept)
    after = here.fit
    remaining = detect(after, level=false_alarms)
    detection = remaining
    if after.model.added:  # the baseline under the noise of the final fit
        detection = detect(fitted(before.model, [before.named], here.node, here.kappa2, after), level=false_alarms)
    location = located(posterior.moments, detection)
    progress("planning the next test")
    findings = findings_of(posterior, here, before, verdicts, location, first)
    progress("cross-validation: leaving out runs in turn")
    return Diagnosis(
        p_value=_p_value(posterior),
        noise_um=after.white_noise,
        findings=findings,
        fit=cross_validated(before, after),
        detection=detection,
        location=location,
        remaining=remaining,
        before=before,
        after=model_averaged(posterior, first, after),
        false_alarms=false_alarms,
        hold_out=hold_out_result,
        searched=searched,
        other_readings=wiring_doubts(before, _named_slopes(posterior, before)),
    )


def _named_slopes(posterior: Posterior, fit: Identification) -> list[Effect]:
    """The named effects of the posterior that can all join a fit: of each form one, without those that free what others do."""
    held = {effect.key for effect in fit.model.effects}
    forms = [term.form for term in posterior.moments.terms if term.form.sloped]
    own = [form.effect for form in forms if not form.effect.unidentified and not form.effect.frees()]
    return list({effect.key: effect for effect in own if effect.key not in held}.values())


def _p_value(posterior: Posterior) -> float:
    """Bound of the p-value of a clean campaign: the posterior odds of nothing over its prior odds. Where nothing is missing an
    evidence ratio exceeds r with a probability of 1/r at most (V. Vovk & R. Wang 2021)."""
    nothing = posterior.weights.get(frozenset(), 0.0)
    odds = EXPECTED + sum(term.form.measured for term in posterior.moments.terms)
    return float(np.clip(odds * nothing / max(1.0 - nothing, 1e-300), 1e-300, 1.0))
