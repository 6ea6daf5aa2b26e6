"""`predict`: readings that a fitted model expects, with each run's own set-up fitted where it has readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from symfive.campaign import Campaign
from symfive.errors import InputError
from symfive.identify._identify import identify
from symfive.identify._result import Identification
from symfive.model import FittedModel, Model
from symfive.threads import one_thread

__all__ = ["Prediction", "fitted_model", "predict"]


@dataclass(frozen=True)
class Prediction:
    """`campaign` with predicted readings; `rms` run → root mean square of measured minus predicted (measured runs only),
    over all its reading columns; `setup` run → fitted nuisances (file units)."""

    campaign: Campaign
    rms: Mapping[str, float]
    setup: Mapping[str, Mapping[str, float]]


def fitted_model(result: Identification) -> FittedModel:
    """What an identification leaves for later use: everything that is not one run's own."""
    from symfive.effects import baseline_effects

    keep = [i for i, p in enumerate(result.parameters) if p.run is None]
    names = tuple(result.parameters[i].name for i in keep)
    baseline = set(baseline_effects(result.model.machine))
    return FittedModel(
        machine=result.model.machine,
        effects=tuple(e for e in result.model.effects if e not in baseline),
        values={n: float(result.values[i]) for n, i in zip(names, keep, strict=True)},
        std={n: float(result.std[i]) for n, i in zip(names, keep, strict=True)},
        units={n: result.parameters[i].unit for n, i in zip(names, keep, strict=True)},
        names=names,
        covariance=result.covariance[np.ix_(keep, keep)],
    )


@one_thread
def predict(fitted: FittedModel, campaign: Campaign) -> Prediction:
    """Predicted readings of a plan or campaign. Raises `InputError` where the machines differ.

    The machine's errors and the effects stay as fitted; zeros and set-up errors of a run are fitted on its own readings,
    and stand at zero where it has none.
    """
    if campaign.machine.structure != fitted.machine.structure:
        raise InputError(
            f'the model is of a machine "{fitted.machine.structure.code}", the campaign of "{campaign.machine.structure.code}"',
            remedy="use the model of the same machine",
        )
    campaign = campaign.with_machine(fitted.machine)
    predicted, rms, setup = [], {}, {}
    for run in campaign.runs:
        model = Model(replace(campaign, runs=(run,)), fitted.effects)
        known = {name: value for name, value in fitted.values.items() if name in model.index}
        values = model.vector(known)
        if run.measured:
            result = identify(model, fixed=known)
            values = result.values
            left_out = np.zeros_like(result.residuals[run.id], dtype=bool)
            for outlier in result.outliers:
                left_out[outlier.row, [c.name for c in model.columns(run)].index(outlier.column)] = True
            rms[run.id] = float(np.sqrt(np.mean(result.residuals[run.id][~left_out] ** 2)))
            setup[run.id] = {p.name: float(v) for p, v in zip(model.parameters, values, strict=True) if p.run == run.id}
        readings = model.predict_run(run, values)
        columns = model.columns(run)
        predicted.append(run.with_readings({c.name: readings[:, i] for i, c in enumerate(columns)}))
    return Prediction(replace(campaign, runs=tuple(predicted)), rms, setup)
