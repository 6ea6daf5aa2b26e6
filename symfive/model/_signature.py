"""The signature of an effect: how it changes the readings of a campaign."""

from __future__ import annotations

from collections.abc import Mapping

from symfive.arrays import Array
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.model._model import Model
from symfive.runs import Campaign


def signature(effect: Effect, campaign: Campaign, size: Mapping[str, float] | None = None) -> dict[str, Array]:
    """Change of the readings when the effect is added to the model, all else unchanged: run id → (N, ny), in the
    columns' units.

    `size`: parameters by their names without the effect's `key` (file units), e.g. `{"width": 41.0}`;
    all others are of usual size (`Effect.typical`). Raises `InputError` for
    a name that the effect lacks, and if it cannot act in the campaign.
    """
    model = Model(campaign, (effect,))
    joined = model.effects[-1]
    values = joined.typical(campaign)
    for name, value in (size or {}).items():
        if f"{joined.key}.{name}" not in values:
            known = ", ".join(n.removeprefix(joined.key + ".") for n in values)
            raise InputError(f'{joined.key} has no parameter "{name}"', remedy=f"use one of {known}")
        values[f"{joined.key}.{name}"] = value
    without = {p.name: p.mean for p in joined.parameters(campaign)}
    rest = dict(zip(model.index, model.prior_mean, strict=True))
    with_it, base = model.predict(rest | values), model.predict(rest | without)
    return {run.id: with_it[run.id] - base[run.id] for run in campaign.runs}
