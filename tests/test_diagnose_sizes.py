"""What a finding may claim: a size that the readings determine, and no more confidence than they give."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from examples.wang_li_2016.plates import yawed  # noqa: E402
from symfive.campaign import read_campaign  # noqa: E402
from symfive.diagnose._alike import SAME, levelled  # noqa: E402
from symfive.diagnose._catalogue import catalogue  # noqa: E402
from symfive.diagnose._determined import log_chance_of_nothing, sigmas_from_nothing  # noqa: E402
from symfive.diagnose._evidence import evidence_of, marginal  # noqa: E402
from symfive.diagnose._refit import Trial  # noqa: E402
from symfive.diagnose._scores import log_tail, score_catalogue  # noqa: E402
from symfive.effects import make_effect  # noqa: E402
from symfive.identify import Identification, identify  # noqa: E402
from symfive.model import Model  # noqa: E402

CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"


@pytest.fixture(scope="module")
def clean():
    return read_campaign(CAMPAIGNS / "static-none" / "fit")


@pytest.fixture(scope="module")
def sagging():
    campaign = read_campaign(CAMPAIGNS / "static-sag-and-drift" / "fit")
    return identify(Model(campaign, [make_effect("gravity_sag", "B", component="EZB"), make_effect("thermal_drift")]))


@pytest.mark.slow
def test_a_false_drift_without_a_size_is_withdrawn_and_said():
    """60 µrad of yaw in a plate that is believed aligned: 79 ± 53 µm of drift have evidence, but no size."""
    diagnosis = yawed().diagnosis
    assert diagnosis.findings == ()
    assert diagnosis.mismatch  # that something is wrong stays true
    (said,) = diagnosis.withdrawn
    assert said in diagnosis.letter and said in " ".join(str(diagnosis).split())
    assert "EC0X is not the same between the groups by time" in diagnosis.letter
    assert said.startswith("Thermal drift would explain more") and " ± " in said


def test_what_is_there_differs_from_nothing_and_what_is_not_does_not(sagging, clean):
    for effect in sagging.model.added:
        assert sigmas_from_nothing(sagging, effect) > 20.0
        assert log_chance_of_nothing(sagging, effect) < -100.0
    nothing = identify(Model(clean, [make_effect("gravity_sag", "B", component="EZB"), make_effect("thermal_drift")]))
    for effect in nothing.model.added:
        assert log_chance_of_nothing(nothing, effect) > np.log(1e-3)


def test_the_square_of_the_sigmas_is_what_the_score_takes_off_the_cost(sagging):
    """Of a linear effect: the score test of the fit without it, and dᵀ C⁻¹ d of the fit with it, are one number."""
    campaign, scale = sagging.model.campaign, make_effect("scale_error", "X")
    plain = identify(campaign, noise="declared")
    joined = identify(Model(campaign, [scale]), noise="declared")
    drop = score_catalogue(plain, [scale.prepare(campaign)]).score(scale).drop
    assert sigmas_from_nothing(joined, scale) ** 2 == pytest.approx(drop, rel=0.02)


def test_amplitudes_that_are_uncertain_by_one_factor_have_a_size_of_that_many_sigmas(sagging):
    """A drift along three axes whose time constant is open: 2.5σ is a size, 1.4σ is none, however well its direction is known."""
    drift, model = sagging.model.added[1], sagging.model
    own = [model.index[p.name] for p in drift.amplitudes(model.campaign)]

    def loose(share: float) -> Identification:
        covariance = sagging.covariance.copy()
        covariance[np.ix_(own, own)] += share**2 * np.outer(sagging.values[own], sagging.values[own])
        return replace(sagging, covariance=covariance)

    assert log_chance_of_nothing(loose(0.4), drift) == pytest.approx(log_tail(0.4**-2, 1.0), rel=0.05)
    assert log_chance_of_nothing(loose(0.4), drift) < log_tail(SAME, 1.0) < log_chance_of_nothing(loose(0.7), drift)
    assert sigmas_from_nothing(loose(0.4), drift) == pytest.approx(2.5, rel=0.05)


def test_without_a_family_the_evidence_is_the_marginal_likelihood(clean):
    """No half of it goes to a family that the effects do not have."""
    fit = identify(Model(clean, [make_effect("location_error", component="EC0Y")]))
    problem = fit.problem()
    assert evidence_of(problem, fit.values) == pytest.approx(marginal(problem, fit.model, fit.values), abs=1e-9)


def test_a_counterbalance_is_looked_for_on_a_vertical_axis_that_turns_back(clean):
    proposed = {effect.key for effect in catalogue(clean)}
    assert "counterbalance.Z" in proposed
    assert not {key for key in proposed if key.startswith("counterbalance")} - {"counterbalance.Z"}


def _trial(effect, evidence, misfit, prior=0.0):
    return Trial(effect, evidence, {p.name: 1e-3 for p in effect.parameters(_CLEAN)}, 1.0, 1, misfit, prior)


_CLEAN = read_campaign(CAMPAIGNS / "static-none" / "fit")


def test_names_that_the_readings_do_not_tell_apart_share_by_the_odds_beforehand():
    play, sideways = make_effect("backlash", "Y"), make_effect("lateral_play", component="EAY")
    sag = make_effect("gravity_sag", "B", component="EZB", parts=("sin",)).prepare(_CLEAN)
    trials = [
        _trial(sideways, 107.0, 50.0, np.log(0.2)),  # 7 nats by the room of its priors alone
        _trial(play, 100.0, 50.0),
        _trial(sag, 99.0, 60.0),  # 3σ worse: that the readings do tell
    ]
    after = levelled(_CLEAN, trials)
    weights = np.exp([t.evidence for t in after[:2]])
    assert weights[1] / weights[0] == pytest.approx(5.0)
    assert np.logaddexp(after[0].evidence, after[1].evidence) == pytest.approx(np.logaddexp(107.0, 100.0))
    assert after[2] == trials[2]


def test_what_little_the_readings_say_of_two_alike_counts():
    play, sideways = make_effect("backlash", "Y"), make_effect("lateral_play", component="EAY")
    first, second = levelled(_CLEAN, [_trial(play, 100.0, 50.0), _trial(sideways, 107.0, 53.0)])
    assert first.evidence - second.evidence == pytest.approx(1.5)


def test_the_size_of_a_term_without_a_name_is_what_the_readings_determine(clean):
    """A direction of its amplitudes that they leave to the prior adds neither size nor doubt."""
    term = make_effect("unknown", over=("t",), order=4, directions="x").prepare(clean)
    parameters = term.parameters(clean)
    names, sigma = [p.name for p in parameters], np.array([p.sigma for p in parameters])
    seen = np.eye(len(names))[0]
    spread = np.outer(sigma, sigma) * (np.eye(len(names)) - 0.9996 * np.outer(seen, seen))
    pairs = {(a, b): spread[i, j] for i, a in enumerate(names) for j, b in enumerate(names)}
    exact = dict.fromkeys(names, 0.0) | {names[0]: sigma[0]}
    vague = {n: 0.3 * s for n, s in zip(names, sigma, strict=True)} | {names[0]: sigma[0]}
    wanted, found = (term.describe(clean, values, pairs)["rms"] for values in (exact, vague))
    assert found.value == pytest.approx(wanted.value) and found.std == pytest.approx(0.02 * found.value)
