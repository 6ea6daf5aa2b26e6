"""`assess`: what a plan or a campaign can tell, before or after it is measured."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.effects import Effect
from symfive.inference import Confounding, Problem, confounded_combinations, data_rank
from symfive.model import Model

__all__ = ["SCHEMA", "Assessment", "assess"]

SCHEMA = "symfive.assessment/1"
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Assessment:
    """Expected covariance of all parameters (k, k), rank, confounded combinations and each run's share.

    `gain` run → nats of information about the machine that would be lost without it (½ log det ratio of the machine's and
    effects' covariance, set-ups marginalised); 0 means that the run tells nothing new.
    """

    model: Model
    covariance: Array
    rank: int
    confounded: tuple[Confounding, ...]
    gain: dict[str, float]

    @property
    def std(self) -> Array:
        """Expected posterior standard deviations (k,), file units."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def to_data(self) -> dict[str, Any]:
        """`assessment.json`."""
        rows = zip(self.model.parameters, self.std, strict=True)
        return {
            "schema": SCHEMA,
            "parameters": {p.name: {"std": float(s), "prior": p.sigma, "unit": p.unit} for p, s in rows},
            "rank": self.rank,
            "confounded": [list(c.names) for c in self.confounded],
            "says": [c.words for c in self.confounded],
            "gain_nats": self.gain,
        }

    def __str__(self) -> str:
        shown = [(p, s) for p, s in zip(self.model.parameters, self.std, strict=True) if p.run is None]
        width = max([len(p.name) for p, _ in shown] + [9])
        lines = [f"{'parameter':<{width}} {'expected 1σ':>12} {'prior 1σ':>10} unit"]
        lines += [f"{p.name:<{width}} {s:12.3g} {p.sigma:10.3g} {p.unit}" for p, s in shown]
        lines.append(f"rank {self.rank} of {len(self.model.parameters)}")
        machine = {p.name for p in self.model.parameters if p.kind != "setup"}
        lines += [c.words for c in self.confounded if machine & set(c.names)]
        lines += [f"run {run}: {gain:.2f} nats" for run, gain in self.gain.items()]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        import html

        return f"<pre>{html.escape(str(self))}</pre>"


def assess(campaign: Campaign | Model, *, effects: Iterable[Effect] = ()) -> Assessment:
    """What the campaign's runs tell about every parameter, with the declared noise and priors; no readings needed."""
    model = campaign if isinstance(campaign, Model) else Model(campaign, effects)
    problem = Problem.of(model)
    blocks = problem.blocks(model.start, readings=False)
    prior = np.diag(problem.prior_precision)
    by_run: dict[str, Array] = {}
    for key, block in blocks.items():
        by_run[key[0]] = by_run.get(key[0], 0.0) + problem.information({key: block}).matrix
    total = sum(by_run.values(), start=np.zeros_like(prior))
    kept = np.array([i for i, p in enumerate(model.parameters) if p.run is None], dtype=int)
    gain = {}
    if kept.size:
        full = _log_volume(prior + total, kept)
        gain = {run: _log_volume(prior + total - part, kept) - full for run, part in by_run.items()}
    sigma = model.prior_sigma
    return Assessment(
        model,
        np.asarray(np.linalg.inv(prior + total), dtype=float),
        data_rank(total, sigma),
        confounded_combinations(total, model.parameters),
        gain,
    )


def _log_volume(precision: Array, kept: NDArray[np.int64]) -> float:
    """½ log det of the covariance of the kept parameters."""
    covariance = np.linalg.inv(precision)[np.ix_(kept, kept)]
    return 0.5 * float(np.linalg.slogdet(covariance)[1])
