"""The certificate of circles against every set of a small list, evaluated here with NumPy alone."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lean import varying

from symfive.design import Circle, CircleShape, plan_circles
from symfive.design._circles import Goal  # as above
from symfive.design._optimal_weights import relaxed_bound  # brute force needs circles without a machine
from symfive.effects import make_effect
from symfive.machine import preset
from symfive.optimal import criterion_of

MACHINE = preset("tsutsumi-2007")
LEAN = varying(MACHINE, "EC0Y", "EX0C", "EY0C")
EFFECTS = [make_effect("servo_mismatch", "C", gains=("position_gain",)), make_effect("backlash", "C")]
INTEREST, NUISANCE = 3, 2
DRAWS, COUNT, TAKEN = 3, 9, 4


class Given(Circle):
    """A circle of given seconds."""

    @property
    def seconds(self) -> float:
        return float(self.sigma["seconds"])


def _circles(seed: int, equal: bool) -> tuple[list[Circle], np.ndarray]:
    """Random circles and the prior 1σ of their parameters, in units far apart."""
    random = np.random.default_rng(seed)
    scale = 10.0 ** random.uniform(-3.0, 3.0, INTEREST + NUISANCE)
    shape, found = CircleShape(family="planar", values={}), []
    for _ in range(COUNT):
        seconds = 10.0 if equal else random.uniform(5.0, 20.0)
        rows = random.normal(size=(DRAWS, len(scale), 2)) * np.sqrt(seconds) / scale[:, None]
        matrices = tuple(rows @ rows.transpose(0, 2, 1))
        found.append(Given(shape, (), matrices[0], matrices, {"seconds": seconds}))
    return found, scale


def _size(circles: tuple[Circle, ...], scale: np.ndarray, criterion: str, robust: str) -> float:
    """log of the size of the posterior covariance, by the definition."""
    sizes = []
    for d in range(1 if robust == "nominal" else DRAWS):
        information = np.diag(scale**-2.0) + sum(c.matrices[d] for c in circles)
        unit = np.diag(1.0 / scale[:INTEREST])
        S = unit @ np.linalg.inv(information)[:INTEREST, :INTEREST] @ unit
        sizes.append(np.log(np.linalg.det(S)) / INTEREST if criterion == "D" else np.log(np.trace(S) / INTEREST))
    return float(max(sizes) if robust == "worst" else np.mean(sizes))


@pytest.mark.parametrize("equal", [True, False], ids=["equal times", "unequal times"])
@pytest.mark.parametrize(
    ("criterion", "robust"),
    [("D", "nominal"), ("A", "nominal"), ("D", "mean"), ("A", "mean"), ("D", "worst"),
     pytest.param("A", "worst", marks=pytest.mark.slow)],
)  # fmt: skip
def test_no_set_of_circles_is_better_than_the_bound(criterion: str, robust: str, equal: bool) -> None:
    for seed in range(3):
        circles, scale = _circles(seed, equal)
        measure = criterion_of(criterion, INTEREST, np.zeros((0, 3, INTEREST)))
        goal = Goal(measure, np.arange(INTEREST), scale, robust)
        seconds = 10.0 * TAKEN
        weights, bound = relaxed_bound(goal, circles, np.array([c.seconds for c in circles]), seconds)
        sets = [
            chosen
            for count in range(1, 2 * TAKEN)
            for chosen in itertools.combinations_with_replacement(circles, count)
            if sum(c.seconds for c in chosen) <= seconds
        ]
        best = min(_size(chosen, scale, criterion, robust) for chosen in sets)
        assert bound <= best + 1e-9
        split = tuple(
            replace(c, matrices=tuple(m * w / c.seconds for m in c.matrices))
            for c, w in zip(circles, weights, strict=True)
        )
        slack = _size(split, scale, criterion, robust) - bound
        assert -1e-9 <= slack <= (0.02 if robust == "worst" else 2.1e-3)
        assert weights.sum() == pytest.approx(seconds)


@pytest.mark.slow
def test_slow_circles_are_certified_lower_and_faster_ones_by_default(tmp_path: Path) -> None:
    """Lag grows with the feed: a list of slow feeds is certified low, and the default goes to the machine's limit."""
    options = {"count": 1, "rate_hz": 25.0, "per_minute": True}
    slow = plan_circles(LEAN, EFFECTS, feeds=(500.0, 1000.0), **options)
    free = plan_circles(LEAN, EFFECTS, **options)
    assert slow.certificate is not None
    assert free.certificate is not None
    assert slow.certificate.efficiency < 0.5 * free.certificate.efficiency
    assert free.circles[0].feed > 1000.0
    feed = [[note for note in plan.notes if note.startswith("feed ")] for plan in (slow, free)]
    assert [len(notes) for notes in feed] == [1, 0]
    assert any("edge of the table" in note for note in free.notes)
    free.write(tmp_path / "plan")
    data = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert free.information is not None and free.information.says in str(free)
    assert data["information"]["upper_nats"] == pytest.approx(free.information.upper[0], rel=1e-5)
    said = data["certificate"]
    assert said["says"] == free.certificate.says
    assert said["efficiency"] == pytest.approx(free.certificate.efficiency, rel=1e-5)
    assert f"≥ {int(free.certificate.efficiency * 1e3) / 1e3:.3f}" in (tmp_path / "plan" / "setup.html").read_text()
