"""`simulate`: a plan measured on a machine whose true errors are drawn from the priors or given."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from symfive.campaign import Campaign
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.given import campaign_given
from symfive.model import Model, effect_to_data
from symfive.parameters import Parameter
from symfive.screen import OnScreen, plural
from symfive.threads import one_thread

__all__ = ["Simulation", "simulate"]

WIDEST_SETUP_UM = 100.0
"""A zero with a practically flat prior is drawn with this 1σ."""


@dataclass(frozen=True, repr=False)
class Simulation(OnScreen):
    """`campaign` with readings and the `truth` (parameter name → value in its file unit) that made them."""

    campaign: Campaign
    truth: Mapping[str, float]
    effects: tuple[Effect, ...]
    seed: int

    def __str__(self) -> str:
        effects = f", effects {', '.join(effect.key for effect in self.effects)}" if self.effects else ""
        head, *lines = str(self.campaign).split("\n")
        return "\n".join(
            [f"simulation of {head}; seed {self.seed}, {plural(len(self.truth), 'true value')}{effects}", *lines]
        )

    def to_data(self) -> dict[str, Any]:
        """`truth.json`."""
        return {
            "schema": "symfive.truth/1",
            "seed": self.seed,
            "effects": [effect_to_data(effect) for effect in self.effects],
            "parameters": dict(self.truth),
        }


@one_thread
def simulate(
    plan: Campaign | Path | str,
    *,
    truth: Mapping[str, float] | None = None,
    effects: Iterable[Effect] = (),
    seed: int = 0,
    noise: bool = True,
) -> Simulation:
    """Simulated readings of a plan, with the declared white noise.

    `plan`: a campaign, a plan, or the path of its folder; `truth`: true values by name; all other parameters are drawn from
    their priors. The same `seed` gives the same machine and the same noise. Raises `InputError` for a name that the model
    does not have.
    """
    plan, effects = campaign_given(plan), tuple(effects)
    model = Model(plan, effects)
    given = dict(truth or {})
    for name in given:
        if name not in model.index:
            raise InputError(
                f'the truth names "{name}", which the model does not have', remedy="see symfive assess for the names"
            )
    machine_seed, *run_seeds = np.random.SeedSequence(seed).spawn(1 + len(plan.runs))
    generator = np.random.default_rng(machine_seed)
    values = np.array([given.get(p.name, _draw(p, generator)) for p in model.parameters])
    runs = []
    for run, run_seed in zip(plan.runs, run_seeds, strict=True):
        readings = model.predict_run(run, values)
        if noise:
            readings = readings + np.random.default_rng(run_seed).standard_normal(readings.shape) * model.noise(run)
        runs.append(run.with_readings({c.name: readings[:, i] for i, c in enumerate(model.columns(run))}))
    named = model.named(values)
    return Simulation(replace(plan, runs=tuple(runs)), named, effects, seed)


def _draw(parameter: Parameter, generator: np.random.Generator) -> float:
    """One draw from the prior (always one number, so that the others do not depend on it)."""
    if parameter.kind == "setup":
        parameter = replace(parameter, sigma=min(parameter.sigma, WIDEST_SETUP_UM))
    return parameter.drawn(generator)
