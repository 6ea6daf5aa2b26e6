"""What is stated of set-up and geometry may be wrong altogether, and that speaks for no effect."""

from dataclasses import replace

import numpy as np
import plant
import pytest

from symfive.arrays import Array
from symfive.campaign import Campaign, read_campaign
from symfive.diagnose import diagnose
from symfive.identify import Identification
from symfive.posterior import WIDTHS, baseline, log_evidence, log_width, moments_of
from symfive.posterior._tables import Tables

OFF_MM = (0.3, 0.1, 0.0), (-0.2, 0.2, 0.1)


@pytest.fixture(scope="module")
def misplaced(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Two circles about balls that are not where the file has them."""
    folder, machine = tmp_path_factory.mktemp("off"), plant.planar_table()
    senses = (("ccw", 1), ("cw", -1))
    circles = [plant.planar_circle(machine, name, direction=sense, dt=0.1) for name, sense in senses]
    plant.write_campaign(folder, machine, circles)
    told = read_campaign(folder)
    moved = [
        replace(run, table_ball=tuple(c + d for c, d in zip(run.table_ball, off, strict=True)))
        for run, off in zip(told.runs, OFF_MM, strict=True)
    ]
    return replace(told, runs=tuple(moved))


def density(fit: Identification, scale: tuple[float, float], kappa2: float) -> float:
    """Log density of the readings, linear about the fit, where geometry and set-up have so many times their stated 1σ; all
    variances times `kappa2`, by which the engine scales what is left once these are eliminated."""
    model, found = fit.model, list[tuple[Array, Array]]()
    wide = np.array([p.sigma * scale[p.run is not None] for p in fit.parameters])
    for run in model.campaign.runs:
        line, noise = model.linearise(run, fit.values), model.noise(run)
        slopes = np.zeros((*line.prediction.shape, len(wide)))
        slopes[:, :, line.columns] = line.jacobian
        y = fit.residuals[run.id] + slopes @ (fit.values - model.prior_mean)
        counts = fit.problem().counts(run)
        kept = counts > 0.0
        found.append(((y * counts / noise)[kept], (slopes * (counts / noise)[:, :, None])[kept]))
    y, slopes = (np.concatenate(part) for part in zip(*found, strict=True))
    covariance = kappa2 * (np.eye(len(y)) + slopes @ (wide[:, None] ** 2 * slopes.T))
    return -0.5 * float(y @ np.linalg.solve(covariance, y) + np.linalg.slogdet(covariance)[1])


def test_both_stand_in_the_moments_and_the_readings_decide(misplaced: Campaign) -> None:
    fit = baseline(misplaced)
    moments, (stated, wrong) = moments_of(fit, (), ()), Tables(fit, (), ()).scales
    assert stated == (1.0, 1.0)
    assert wrong.setup >= 3.0
    evidence, behind = log_evidence(moments, ()), len(moments.nodes) // 2
    chance = sum(log_width(w, WIDTHS) - log_width(1.0, WIDTHS) for w in wrong)
    expected = density(fit, wrong, evidence.scales[behind]) - density(fit, stated, evidence.scales[0]) + chance
    assert evidence.by_node[behind] - evidence.by_node[0] == pytest.approx(expected, rel=1e-3)
    assert expected > 10.0


@pytest.mark.slow
def test_a_ball_that_is_not_where_the_file_has_it_is_no_fault(misplaced: Campaign) -> None:
    assert diagnose(misplaced).findings == ()
