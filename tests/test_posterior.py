"""One posterior: moments against exact whitening and dense algebra, the sweep against direct evidence."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from posterior_world import NOISE, bars
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from symfive.campaign import Campaign
from symfive.effects import EFFECTS, Form, make_effect
from symfive.inference import whiten
from symfive.model import Model
from symfive.posterior import (
    WHITE,
    WIDTHS,
    Candidates,
    Moments,
    Posterior,
    Sweep,
    _coarse,  # its misfit is set by hand
    baseline,
    candidates,
    coarsened,
    contradicted,
    decide,
    expanded,
    explore,
    fitted,
    grams,
    log_evidence,
    log_width,
    misfit,
    moments_about,
    moments_of,
    nodes_of,
    refitted,
    solution,
    usual_noises,
    widths_of,
)
from symfive.posterior._evidence import Turned
from symfive.posterior._explore import log_prior  # of a subset, with nothing that the readings say
from symfive.posterior._scale import least, solved  # two scales of the noise, matrices that rounding has spoilt


@cache
def moments_with(angles: int) -> Moments:
    """Of the baseline of circles of so many angles with a play; when each was read is known, or the fit would explain by
    it what it can of the play."""
    whole = bars({"X": 5.0}, angles=angles)
    campaign = replace(whole, runs=tuple(replace(run, clock_sigma_ms=0.0) for run in whole.runs))
    return moments_of(baseline(campaign), (), candidates(campaign).forms)


@pytest.fixture(scope="module")
def moments() -> Moments:
    """Of short circles."""
    return moments_with(200)


def stated(moments: Moments, *names: str) -> Candidates:
    """What these effects alone state for the campaign of the moments."""
    return candidates(moments.fit.model.campaign, EFFECTS.keys() - set(names))


@pytest.mark.parametrize("rows", [1500, 4000])
def test_bands_agree_with_exact_whitening_within_two_nats(rows: int) -> None:
    rng, interval = np.random.default_rng(rows), 0.01
    nodes, t = nodes_of(2.0 * rows * interval), np.linspace(0.0, 1.0, rows)
    shapes = np.stack([np.ones(rows), t, np.sin(9.0 * t), np.sign(np.sin(40.0 * t)), rng.normal(size=rows)], axis=1)
    walk = np.cumsum(rng.normal(size=rows)) * 0.02
    table = np.column_stack([shapes, walk + rng.normal(size=rows)])[:, None, :]
    banded, logs = grams(table, interval, nodes)
    for node, gram, log in zip(nodes, banded, logs, strict=True):
        white, exact_log = whiten(table, node.noise(1.0), interval)
        exact = white[:, 0].T @ white[:, 0]

        def gain(g: np.ndarray, used: int) -> float:
            a = g[:used, :used] + np.eye(used)
            return float(0.5 * g[:used, -1] @ np.linalg.solve(a, g[:used, -1]) - 0.5 * np.linalg.slogdet(a)[1])

        for used in (3, 5):  # what further terms gain beside what is always fitted
            assert gain(gram, used) - gain(gram, 1) == pytest.approx(gain(exact, used) - gain(exact, 1), abs=2.0)
        assert log == pytest.approx(exact_log, abs=4.0)  # of -2 log evidence


def test_flicker_noise_is_more_probable_as_such_than_with_one_time() -> None:
    rows, interval = 800, 0.05
    nodes, lags = nodes_of(rows * interval, flicker=True), interval * np.arange(rows)
    slow = next(node for node in nodes if node.size == 3.0 and node.decades > 1)
    law = sum(
        3.0 * np.exp(-lags / time) for time in slow.noise(1.0).times
    )  # 3² in three parts, beside white noise of 1
    drawn = np.linalg.cholesky(law[np.abs(np.subtract.outer(*[np.arange(rows)] * 2))] + np.eye(rows))
    read = drawn @ np.random.default_rng(7).standard_normal(rows)

    def log_likelihood(node) -> float:
        white, logs = whiten(read[:, None], node.noise(1.0), interval)
        return -0.5 * (float(np.sum(white**2)) + logs)

    assert log_likelihood(slow) > max(log_likelihood(node) for node in nodes if node.decades == 1) + 10.0


def with_slow_noise(angles: int, size: float, rows: float) -> Campaign:
    """Clean circles whose noise has a Gauss-Markov part of so many NOISE, correlated over so many rows."""
    rng, phi = np.random.default_rng(11), np.exp(-1.0 / rows)
    whole, runs = bars({}, angles=angles), []
    for run in whole.runs:
        drawn = rng.normal(size=run.rows) * size * NOISE * np.sqrt(1.0 - phi**2)
        drawn[0] /= np.sqrt(1.0 - phi**2)
        slow = lfilter([1.0], [1.0, -phi], drawn)
        runs.append(run.with_readings({name: values + slow for name, values in run.readings.items()}))
    return replace(whole, runs=tuple(runs))


def test_noise_between_the_nodes_is_found_as_well_as_the_readings_know_it() -> None:
    campaign = with_slow_noise(3000, 0.55, 40.0)
    fit = baseline(campaign)
    here, _ = expanded(fit, (), replace(candidates(campaign), sharp=True))
    interval = campaign.runs[0].interval
    *usual, own = here.noises
    by_node = log_evidence(moments_of(fit, (), ()), ()).by_node
    ahead = log_evidence(moments_of(fit, (), (), here.noises), ()).by_node.max() - by_node.max()
    assert own.size == pytest.approx(0.55, rel=0.2)
    assert own.time / interval == pytest.approx(40.0, rel=0.5)
    assert ahead > 5.0
    assert here.node.size == own.size
    assert own.log_prior < min(node.log_prior for node in usual if node.size <= 1.0)  # it stands for less than a node


def test_noise_that_few_readings_hardly_know_is_that_of_the_nodes() -> None:
    campaign = with_slow_noise(60, 0.55, 40.0)
    here, _ = expanded(baseline(campaign), (), replace(candidates(campaign), sharp=True))
    assert here.noises == usual_noises(here.fit)


@pytest.mark.parametrize(("angles", "few"), [(240, False), (60, True)])
def test_evidence_is_the_dense_marginal_likelihood(angles: int, few: bool) -> None:
    """Of white noise and one term, from the model's own derivatives and all priors at once; of more readings than columns, and of
    fewer, which are eliminated as rows."""
    moments = moments_with(angles)
    assert (moments.rows is not None) == few
    fit = moments.fit
    number = next(k for k, t in enumerate(moments.terms) if t.effect.key == "lateral_play.EYX")
    model = Model(fit.model.campaign, [moments.terms[number].effect])
    parts, residual, excluded = [], [], {(outlier.run, outlier.row) for outlier in fit.outliers}
    for run in model.campaign.runs:
        line = model.linearise(run, model.vector(fit.named))
        j = np.zeros((run.rows, len(model.parameters)))
        j[:, line.columns] = line.jacobian[:, 0]
        kept = [row for row in range(run.rows) if (run.id, row) not in excluded]
        parts.append((fit.weights[run.id] * j * model.prior_sigma)[kept])
        residual.append((fit.weights[run.id] * fit.residuals[run.id])[kept, 0])
    j, r = np.concatenate(parts), np.concatenate(residual)
    at = np.array([(fit.named.get(p.name, p.mean) - p.mean) / p.sigma for p in model.parameters])
    own = [k for k, p in enumerate(model.parameters) if p.name.startswith("lateral_play")]
    at[own] = 0.0
    # readings about what the priors alone would predict
    dense = multivariate_normal(cov=NOISE**2 * np.eye(len(r)) + j @ j.T).logpdf(r + j @ at)
    evidence = log_evidence(moments, [(number, 1.0)])
    assert evidence.kappa2 == 1.0 or evidence.by_node[0] < evidence.by_node.max()
    white = evidence.by_node[0] - moments.log_prior[0] - len(r) * (np.log(NOISE) + 0.5 * np.log(2.0 * np.pi))
    kappa_free = log_evidence_at_unit_scale(moments, number)
    assert kappa_free - len(r) * (np.log(NOISE) + 0.5 * np.log(2.0 * np.pi)) == pytest.approx(dense, abs=1e-3)
    assert white >= dense - 1e-6  # a fitted scale of the noise is never worse


def test_the_noise_scale_is_the_more_probable_of_two() -> None:
    """Of 20 readings 18 columns explain nearly all: much noise and hardly an effect, or the declared noise."""
    power, size = np.full((1, 18), 1000.0**2), 1000.0 * np.random.default_rng(2).standard_normal(18)
    form = Turned(power, 1000.0 * size[None], np.array([size @ size + 2.0]), np.zeros((1, 18)), np.eye(18)[None])
    for start in (1.0, form.q[0] / 20):
        (cost,), (kappa2,) = least(np.array([start]), 20, 18, form.weighed)
        (left,), (rest,) = form.weighed(np.array([0]), np.array([1.0]))
        assert cost <= left + rest + 1e-9 and kappa2 < 30.0


def log_evidence_at_unit_scale(moments: Moments, number: int) -> float:
    """Closed form for one column under white noise."""
    (at,) = moments.columns[number].where
    gram = moments.gram[0]
    a = gram[at, at] + 1.0
    return float(-0.5 * (gram[-1, -1] - gram[at, -1] ** 2 / a + np.log(a) + moments.const[0]))


@pytest.mark.parametrize(("others", "least", "most"), [(5.0, 0.0, 1.0), (0.0, 100.0, np.inf)])
def test_a_play_is_contradicted_by_circles_without_it(others: float, least: float, most: float) -> None:
    """Fitted to all circles it makes those without it worse."""
    campaign, without = bars({"X": 5.0}, angles=300), bars({"X": others}, angles=300)
    more = [replace(run, id=f"{run.id}-2", file=f"{run.id}-2.csv") for run in without.runs]
    campaign = replace(campaign, runs=(*campaign.runs, *more))
    plain, white = baseline(campaign), nodes_of(1.0)[0]
    after = fitted(Model(campaign, [make_effect("backlash", axis="X")]), [plain.named], white, 1.0, plain)
    assert least <= contradicted(after, white, 1.0) <= most


@pytest.mark.parametrize("members", [(), ((3, 1.0),), ((3, 3.0), (7, 1.0))])
def test_what_stays_is_the_same_by_rows_and_by_products(members: tuple[tuple[int, float], ...]) -> None:
    moments = moments_with(60)
    assert moments.rows is not None
    expected = misfit(replace(moments, rows=None), members)
    assert expected > 1.0
    assert misfit(moments, members) == pytest.approx(expected, rel=1e-6)


def test_a_member_without_a_name_may_be_wrong_by_a_third(moments: Moments) -> None:
    """0.3² of what it explains, as of an unidentified effect."""
    members = ((3, 3.0), (7, 1.0))
    evidence = log_evidence(moments, members)
    (x, _), own = solution(moments, members, evidence), moments.columns[3]
    explained = x @ moments.gram[evidence.node][np.ix_(own.where, own.where)] @ x / evidence.kappa2
    assert explained > 1.0
    assert misfit(moments, members, {3}) - misfit(moments, members) == pytest.approx(0.09 * explained)


@pytest.mark.parametrize("members", [(), ((3, 1.0),), ((3, 3.0), (7, 1.0), (12, 30.0))])
def test_sweep_is_the_direct_evidence_in_the_best_width(
    moments: Moments, members: tuple[tuple[int, float], ...]
) -> None:
    """A guess from what the narrowest prior leaves of an amplitude missed 17 nats of a pitch table of two cycles."""
    chosen = [k for k in range(len(moments.terms)) if k not in {t for t, _ in members}]
    node = log_evidence(moments, members).node
    swept, widths = Sweep.of(moments, members).best(chosen)
    for k, mass, width in list(zip(chosen, swept, widths, strict=True))[::5]:
        each = {w: log_evidence(moments, [*members, (k, w)]) for w in widths_of(moments, k)}
        assert mass == pytest.approx(each[width].total, abs=0.05)
        if moments.proportional[k]:
            odds = {w: e.by_node[node] + log_width(w, widths_of(moments, k)) for w, e in each.items()}
            assert odds[width] == pytest.approx(max(odds.values()), abs=1e-2)


@pytest.fixture(scope="module")
def beside_play(moments: Moments) -> Moments:
    """About a fit that holds the play of X."""
    play = next(k for k, term in enumerate(moments.terms) if term.effect.key == "backlash.X")
    return moments_about(refitted(moments, ((play, 1.0),)), stated(moments, "backlash", "lateral_play"))


@pytest.mark.parametrize("energy", [0.1, 2.0])
def test_a_misfit_takes_a_share_of_what_a_name_gains(monkeypatch, energy: float) -> None:
    """In every kind of noise. What each costs was left out: of many readings one that was far too large decided."""
    monkeypatch.setattr(_coarse, "contradicted", lambda *_: energy)
    monkeypatch.setattr(_coarse, "misfit", lambda *_: 0.0)
    play = make_effect("backlash", axis="X")
    before = baseline(bars({"X": 0.2}, angles=3000))
    after = fitted(Model(before.model.campaign, [play]), [before.named], nodes_of(1.0)[0], 1.0, before)
    moments = moments_of(after, [Form(effect=play)], [])
    posterior = explore(moments, {0})

    def gain(of: Posterior) -> float:
        mass = {s: m - log_prior(moments, s) for s, m in of.mass.items()}
        return mass[(0, 1.0),] - mass[()]

    plain = gain(posterior)
    assert 10.0 < plain < 100.0
    assert gain(coarsened(posterior)) == pytest.approx(plain / (1.0 + 0.5 * energy), rel=0.1)


def test_an_alias_is_what_cannot_be_distinguished_however_large_it_would_have_to_be(beside_play: Moments) -> None:
    """That large sizes are rare decides between the names; it does not separate their readings."""
    held, terms = beside_play, beside_play.terms
    other = next(k for k, term in enumerate(terms) if term.effect.key == "lateral_play.EBX")
    prior = [term.log_prior + log_width(w, WIDTHS) for term, w in ((terms[0], 1.0), (terms[other], 100.0))]
    for worse, alias in ((1.0, (other,)), (3.0, ())):
        masses = {((0, 1.0),): prior[0], ((other, 100.0),): prior[1] - worse}
        posterior = Posterior(held, masses)
        (verdict,) = decide(posterior, posterior)
        assert verdict.alias == alias and verdict.names[0] == terms[0].name


def test_another_component_that_fits_as_well_is_an_alias_and_leaves_the_name_sure(moments: Moments) -> None:
    """A straightness that no polynomial fits exactly was a yaw of 99.9 %, and the straightness was not mentioned."""
    first = next(k for k, t in enumerate(moments.terms) if t.effect.key == "lateral_play.EBX")
    held = moments_about(refitted(moments, ((first, 1.0),)), stated(moments, "lateral_play"))
    other = next(k for k, t in enumerate(held.terms) if t.effect.key == "lateral_play.EYX")
    prior = [held.terms[k].log_prior + log_width(1.0, WIDTHS) for k in (0, other)]
    posterior = Posterior(held, {((0, 1.0),): prior[0], ((other, 1.0),): prior[1] - 1.0})
    (verdict,) = decide(posterior, posterior)
    assert verdict.alias == (other,) and not verdict.by_experience


def test_sizes_are_stated_under_the_name_of_what_is_fitted(beside_play: Moments) -> None:
    """Of two equally probable axes the gain of X was stated as that of Y, which was one percent more probable."""
    held = beside_play
    other = next(k for k, term in enumerate(held.terms) if term.effect.key == "lateral_play.EBX")
    mine, its = ((0, 1.0),), ((other, 1.0),)
    (verdict,) = decide(Posterior(held, {mine: 0.1, its: 0.0}), Posterior(held, {mine: 0.0, its: 0.1}))
    assert verdict.names == (held.terms[0].name, held.terms[other].name) and verdict.probability < 0.5


def test_a_name_in_the_place_of_one_member_is_no_rival_of_another(moments: Moments) -> None:
    """A servo mismatch of Y instead of X, without a period of the screw, was the rival of that period too."""
    keys = "backlash.X", "thermal_drift"
    both = [next(k for k, term in enumerate(moments.terms) if term.effect.key == key) for key in keys]
    few = stated(moments, "backlash", "thermal_drift", "lateral_play")
    held = moments_about(refitted(moments, tuple((k, 1.0) for k in both)), few)
    other = next(k for k, term in enumerate(held.terms) if term.effect.key == "lateral_play.EYX")
    mine, instead = ((0, 1.0), (1, 1.0)), ((other, 1.0),)
    plain, coarse = Posterior(held, {mine: 0.0, instead: -30.0}), Posterior(held, {mine: 0.0, instead: 0.0})
    rivals = {verdict.term: verdict.rivals.get(held.terms[other].name, 0.0) for verdict in decide(plain, coarse)}
    assert rivals[1] > 0.45 and rivals[0] < 0.05


def test_a_rival_in_a_held_law_is_none_of_the_effects_that_the_fit_holds(moments: Moments) -> None:
    """Backlash that began as a step was considered as the play that the fit held already; that ended the diagnosis."""
    keys = "backlash.X", "lateral_play.EBX"
    play, other = (next(t.form for t in moments.terms if t.effect.key == key) for key in keys)
    gradual = next(shape for shape in other.shapes if shape.shape == "play")
    fit = fitted(Model(moments.fit.model.campaign, [play.effect, gradual]), [{}], WHITE, 1.0)
    few = stated(moments, "backlash", "lateral_play")
    here, _ = expanded(fit, [play, replace(other, effect=gradual)], few)
    terms = moments_about(here, few).terms
    assert [t.effect.key for t in terms if t.effect.key in keys and not t.needs] == list(keys)


def test_large_sizes_are_rare_and_none_is_excluded() -> None:
    """Half-Cauchy in steps of equal ratio: far above the usual size ten times as large is ten times as rare."""
    logs = np.array([log_width(w, WIDTHS) for w in WIDTHS])
    assert np.exp(logs).sum() == pytest.approx(1.0)
    assert np.all(np.diff(logs) < 0.0)
    assert logs[-1] - logs[-3] == pytest.approx(np.log(0.1), abs=0.01)
    assert log_width(1.0, WIDTHS[:1]) == 0.0


def test_a_contact_may_begin_anywhere_before_its_axis_first_moves(moments: Moments) -> None:
    """The state in which a recording begins is a column of the term, one a run where it is not known."""
    campaign = moments.fit.model.campaign
    number = next(k for k, t in enumerate(moments.terms) if t.effect.key == "backlash.X")
    effect = moments.terms[number].effect
    states = sum(len(effect.starts(run)) for run in campaign.runs)
    assert states > 0
    assert len(moments.columns[number].where) == len(effect.parameters(campaign)) + states


def test_a_name_is_rare_only_once(moments: Moments) -> None:
    """Beside one error motion of an axis another one, 2.6 nats behind, was as improbable as if there were none: a matrix of the
    sensors was named, 97.9 %."""
    plays = [k for k, term in enumerate(moments.terms) if term.name == ("lateral_play", "X")]
    first, second, other = (log_prior(moments, [(k, 1.0)]) for k in (plays[0], plays[1], 0))
    both = log_prior(moments, [(plays[0], 1.0), (plays[1], 1.0)])
    assert moments.terms[0].name != ("lateral_play", "X")
    assert both > first + second + 1.0 and both < first - 1.0
    assert log_prior(moments, [(plays[0], 1.0), (0, 1.0)]) == pytest.approx(first + other)


def test_all_unidentified_effects_share_one_prior(moments: Moments) -> None:
    """Else it grows with the coordinates of a campaign, and an exact tie goes to what has no name."""
    priors = [t.log_prior + np.log(t.form.places) for t in moments.terms if t.effect.unidentified]
    assert len(priors) > 10 and np.logaddexp.reduce(priors) == pytest.approx(-5.0)


def test_search_finds_what_all_pairs_hold(moments: Moments) -> None:
    found = explore(moments)
    (best, _), *_ = found.best
    assert moments.terms[best].name == ("backlash", "X")
    assert sum(found.weights.values()) == pytest.approx(1.0)
    assert found.names()["backlash", "X"] > 0.99


def test_what_a_refit_says_of_a_subset_is_no_claim_for_others_of_its_names(moments: Moments) -> None:
    """One that the moments think little of may have been refitted to what it is: its rivals of the same names gain nothing."""
    found = explore(moments)
    names = found.named(found.best)
    poorest = min((s for s in found.mass if found.named(s) == names), key=lambda s: found.mass[s])
    count = sum(found.named(s) == names for s in found.mass)
    assert count > 1 and found.mass[poorest] < found.mass[found.best] - 3.0
    assert 0.0 <= found.worth(poorest, 0.0) <= np.log(count) + 1e-9


def test_unidentified_effects_are_asked_after_named_ones(moments: Moments) -> None:
    """A place times the side from which it came holds every play of that axis, and would stand in its place."""
    first, later = (
        {moments.terms[t].effect.unidentified for subset in explore(moments, named=named).mass for t, _ in subset}
        for named in (True, False)
    )
    assert first == {False} and later == {False, True}


@pytest.mark.parametrize("columns", [3, 20])
@pytest.mark.parametrize("definite", [True, False])
def test_a_subset_is_solved_whatever_its_size_and_where_rounding_leaves_no_cholesky_factor(
    columns: int, definite: bool
) -> None:
    rng = np.random.default_rng(columns)
    rows = rng.standard_normal((4, 50, columns))
    h = np.swapaxes(rows, 1, 2) @ rows
    if not definite:
        h[2, 0, 0] = -1e6  # as no product of rows is
    b, kappa2 = rng.standard_normal((4, columns)), rng.uniform(1.0, 2.0, 4)
    x, log_det = solved(h.copy(), b, kappa2)
    for k in range(4):
        whole = h[k] + kappa2[k] * np.eye(columns)
        np.testing.assert_allclose(whole @ x[k], b[k], atol=1e-9)
        assert log_det[k] == pytest.approx(np.linalg.slogdet(whole / kappa2[k])[1])
