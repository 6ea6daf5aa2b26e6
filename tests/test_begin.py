"""The instant at which a ball slipped has the uncertainty that the readings leave of it."""

from dataclasses import replace

import numpy as np
import pytest

from symfive.diagnose import amend, with_begin
from symfive.effects import make_effect
from symfive.identify import identify
from symfive.machine import preset
from symfive.model import Model
from symfive.procedures import campaign_of, planar_circle
from symfive.simulate import simulate


@pytest.mark.parametrize(("size", "seed"), [(0.6, 1), (1.2, 2), (6.0, 3)])
def test_the_begin_of_a_slip_is_as_uncertain_as_refits_from_every_row_say(size: float, seed: int) -> None:
    """Beside it: the density of all rows by linear least squares of geometry, set-up and slip, each row in turn."""
    machine = preset("three-axis")
    first, *_ = planar_circle(machine, plane="XY", feed=3000.0, rate_hz=8.0)
    plan = campaign_of(machine, [first])
    (run,) = plan.runs
    row = run.rows // 3
    slip = make_effect("setup_shift", run=run.id, t_s=0.5 * float(run.time[row - 1] + run.time[row]))
    truth = {f"{slip.key}.shift.{c}": size * part for c, part in zip("xy", (0.6, -0.8), strict=True)}
    measured = simulate(plan, truth=truth, effects=[slip], seed=seed).campaign
    fit = amend(identify(measured), slip)

    model = Model(measured)
    line = model.linearise(run.id, model.start)
    noise = fit.noises[run.id, "ball_bar"].white
    reading = (measured.runs[0].readings["dL_um"] - line.prediction[:, 0]) / noise
    slopes = line.jacobian[:, 0, :] * model.prior_sigma[line.columns] / noise
    always = Model(measured, [replace(slip, t_s=float(run.time[1]))])
    shift = always.linearise(run.id, always.start)
    own = [k for k, n in enumerate(shift.columns) if ".shift." in always.parameters[n].name]
    answer = 10.0 * shift.jacobian[:, 0, own] / noise
    answer[0] = answer[1]
    square = []
    for begin in range(3, run.rows - 3):
        late = answer * (np.arange(run.rows) >= begin)[:, None]
        table = np.vstack([np.hstack([slopes, late]), np.eye(slopes.shape[1] + answer.shape[1])])
        right = np.concatenate([reading, np.zeros(table.shape[1])])
        square.append(float(np.sum((right - table @ np.linalg.lstsq(table, right, rcond=None)[0]) ** 2)))
    density = np.exp(-0.5 * (np.array(square) - min(square)))
    away = np.arange(3, run.rows - 3) - row
    expected = np.sqrt(density @ away**2 / density.sum())

    found = with_begin(fit, slip)
    assert found.rows_off == pytest.approx(expected, rel=0.25, abs=0.1)
    quantity = found.describe(measured, fit.named, {})["t_s"]
    assert quantity.std == pytest.approx(run.interval * np.hypot(found.rows_off, 12.0**-0.5))
