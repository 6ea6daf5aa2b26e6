"""What N readings can tell about more than N parameters: the bound of whole poses holds, and is sharper than that of weights."""

from __future__ import annotations

import numpy as np
import pytest

from symfive.arrays import Array, Indices
from symfive.optimal import Candidates, Task, Volume, relax
from symfive.optimal._rank import LimitedRank  # its derivatives, against differences

POSES, READINGS, SHARED, OWN = 30, 5, 9, 3


@pytest.fixture(params=[range(SHARED), (0, 2, 3, 5, 7, 8)], ids=["all", "some"])
def problem(request: pytest.FixtureRequest) -> tuple[Task, Candidates]:
    """Random rows in two set-ups, with a prior that is no diagonal."""
    generator = np.random.default_rng(0)
    prior = np.eye(SHARED) + 0.3 * np.ones((SHARED, SHARED))
    task = Task(Volume(), prior, np.full(OWN, 20.0), np.array(request.param))
    rows = generator.normal(size=(POSES, SHARED + OWN, 1))
    nothing = np.zeros((POSES, 1))
    return task, Candidates(nothing, nothing, generator.integers(0, 2, POSES), rows)


def _at(task: Task, rows: Candidates, weights: Array) -> LimitedRank:
    information = task.information(rows.rows, rows.group, 2, weights)
    return LimitedRank.at(task, information, task.prior_information(2), READINGS)


def _value(task: Task, rows: Candidates, some: Indices) -> float:
    return task.value(task.information(rows.rows[some], rows.group[some], 2))


def test_no_whole_poses_are_better_than_their_bound(problem: tuple[Task, Candidates]) -> None:
    task, rows = problem
    whole = relax(task, rows, 2, READINGS, tolerance=1e-6, whole_poses=True)
    weighted = relax(task, rows, 2, READINGS, tolerance=1e-6)
    assert whole.bound <= whole.value <= whole.bound + 1e-6
    generator = np.random.default_rng(1)
    designs = [generator.integers(0, POSES, READINGS) for _ in range(2000)]
    assert min(_value(task, rows, some) for some in designs) > whole.bound
    assert weighted.bound + 0.05 < whole.bound  # -1.656 against -1.408 of all, -1.797 against -1.737 of some


def test_few_readings_are_worth_what_the_criterion_says(problem: tuple[Task, Candidates]) -> None:
    task, rows = problem
    for some in np.random.default_rng(2).integers(0, POSES, (20, READINGS)):
        weights = np.bincount(some, minlength=POSES).astype(float)
        assert _at(task, rows, weights).value == pytest.approx(_value(task, rows, some), abs=1e-12)


def test_slopes_and_second_derivatives_by_differences(problem: tuple[Task, Candidates]) -> None:
    task, rows = problem
    weights = np.random.default_rng(3).uniform(0.5, 1.5, POSES)
    weights *= READINGS / weights.sum()
    whole = task.layout(2).embed(rows.rows, rows.group)
    here, step = _at(task, rows, weights), 1e-5
    slope, bent = here.derivatives(whole)
    beside = [[_at(task, rows, weights + sign * step * e) for sign in (1.0, -1.0)] for e in np.eye(POSES)]
    assert slope == pytest.approx(np.array([(a.value - b.value) / (2 * step) for a, b in beside]), abs=1e-8)
    assert -slope == pytest.approx(np.einsum("nky,kl,nly->n", whole, here.pull, whole))
    differences = [(a.derivatives(whole)[0] - b.derivatives(whole)[0]) / (2 * step) for a, b in beside]
    above = bent - np.array(differences)
    assert np.linalg.eigvalsh(0.5 * (above + above.T)).min() > -1e-6  # from above, so that steps are safe
