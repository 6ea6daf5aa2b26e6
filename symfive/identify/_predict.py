"""`predict`: readings that a fitted model expects, with each run's own set-up fitted where it has readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign, Run
from symfive.disk import new_table, release
from symfive.errors import InputError
from symfive.given import campaign_given, model_given
from symfive.identify._identify import identify
from symfive.identify._result import Identification
from symfive.inference import square_of, windows_of
from symfive.instruments import columns_of
from symfive.model import FittedModel, Model
from symfive.numbers import with_unit
from symfive.screen import OnScreen, listed
from symfive.threads import one_thread


@dataclass(frozen=True, repr=False)
class Prediction(OnScreen):
    """`campaign` with predicted readings; `rms` run → root mean square of measured minus predicted (measured runs only) over
    all readings in the unit that the run reads in, µm where any of its columns does; `rms_kept` the same without those that
    the fit of its set-up excludes as outliers; `rms_by_column` run → column → over all readings of that column; `setup` run →
    fitted nuisances (file units). A recording that is taken for the motion is not predicted and has none."""

    campaign: Campaign
    rms: Mapping[str, float]
    rms_kept: Mapping[str, float]
    rms_by_column: Mapping[str, Mapping[str, float]]
    setup: Mapping[str, Mapping[str, float]]

    def __str__(self) -> str:
        return "\n".join([f"prediction of {self.campaign.name}", *listed(self.lines, "prediction.rms")])

    @property
    def lines(self) -> list[str]:
        """Of every run with readings the rms of measured minus predicted, with its unit, and the noise that it declares."""
        return [
            f"{run}: rms of measured minus predicted {self._by_unit(run, rms)}" for run, rms in self.rms.items()
        ] or ["no run has readings: nothing to compare with"]

    def _by_unit(self, run: str, rms: float) -> str:
        """The rms with its unit; of a run that reads in several units, of each column."""
        found, each = self.campaign.run(run), self.rms_by_column[run]
        columns = [column for column in columns_of(found, self.campaign.machine) if column.name in each]
        if len({c.unit for c in columns}) == 1:
            noises = dict.fromkeys(with_unit(found.noise(name), columns[0].unit) for name in found.instrument)
            return f"{with_unit(rms, columns[0].unit)} (declared noise {' and '.join(noises)})"
        return ", ".join(f"{c.name} {with_unit(each[c.name], c.unit)}" for c in columns)


def fitted_model(result: Identification) -> FittedModel:
    """The fitted model of an identification: all values and covariances except those of single runs."""
    from symfive.effects import baseline_effects

    keep = [i for i, p in enumerate(result.parameters) if not p.of_setup]
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
def predict(fitted: FittedModel | Identification | Path | str, campaign: Campaign | Path | str) -> Prediction:
    """Predicted readings of a plan or campaign. Raises `InputError` where the machines differ.

    `fitted`: a fitted model, an identification, or the path of a `model.json`; `campaign`: a campaign or the path of its folder.
    The machine's errors and the effects stay as fitted; zeros and set-up errors of a run are fitted to its own readings,
    and are zero without readings. Runs of more than 50,000 rows are predicted window by window, and the result stays on disk.
    """
    fitted = fitted_model(fitted) if isinstance(fitted, Identification) else model_given(fitted)
    campaign = campaign_given(campaign)
    if campaign.machine.structure != fitted.machine.structure:
        raise InputError(
            f'the model is of a machine "{fitted.machine.structure.code}", the campaign of "{campaign.machine.structure.code}"',
            remedy="use the model of the same machine",
        )
    campaign = campaign.with_machine(fitted.machine)
    predicted, rms, kept, by_column, setup = [], {}, {}, {}, {}
    for run in campaign.runs:
        model = Model(replace(campaign, runs=(run,)), fitted.effects)
        known = {name: value for name, value in fitted.values.items() if name in model.index}
        values = model.vector(known)
        if run.measured:
            result = identify(model, fixed=known)
            values = result.values
            rms[run.id], kept[run.id] = result.rms_um, result.rms_kept.get(result.file_unit, 0.0)
            by_column[run.id] = _by_column(result)
            setup[run.id] = {p.name: float(v) for p, v in zip(model.parameters, values, strict=True) if p.of_setup}
        predicted.append(_predicted(model, run, values))
    return Prediction(replace(campaign, runs=tuple(predicted)), rms, kept, by_column, setup)


def _predicted(model: Model, run: Run, values: Array) -> Run:
    """The run with the model's readings, computed window by window; on disk where they are long."""
    columns = model.columns(run)
    table = new_table(len(columns), run.rows)
    for window in windows_of(model, run, values, {}, slopes=0):
        table[:, window.rows] = window.prediction[window.inside].T
        release(table)
    return run.with_readings({column.name: table[i] for i, column in enumerate(columns)})


def _by_column(result: Identification) -> dict[str, float]:
    """The rms of every column that is fitted, of the only run."""
    (run,) = result.model.campaign.runs
    columns, residual = result.model.columns(run), result.residuals[run.id]
    none = np.zeros((run.rows, 1), dtype=bool)
    return {
        columns[j].name: float(np.sqrt(square_of(residual[:, j : j + 1], none) / run.rows))
        for _, part in result.problem().parts(run)
        for j in range(len(columns))[part]
    }
