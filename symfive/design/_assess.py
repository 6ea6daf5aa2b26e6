"""Assessment of a plan or campaign: expected uncertainties, rank, confounded combinations, worth of each pose."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from symfive.arrays import Array, Indices
from symfive.campaign import FIRST_LINE, Campaign, Run
from symfive.design._digits import six_digits
from symfive.design._space import Space, make_space
from symfive.disk import new_table, release
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.given import campaign_given
from symfive.inference import (
    Confounding,
    Noise,
    Whitening,
    confounded_combinations,
    data_rank,
    not_separated,
    windows_of,
)
from symfive.instruments import fitted_parts
from symfive.machine import Machine
from symfive.model import Model
from symfive.numbers import plain_number, unit_words
from symfive.optimal import inverse, marginal
from symfive.parameters import Parameter
from symfive.runs import MOUNTED
from symfive.screen import OnScreen, listed, plural
from symfive.threads import one_thread

LEVER_MM = 100.0
WORTHLESS = 1e-4
CREEP_UM = 1.0
"""1σ by which balls and bar that stay mounted move from run to run: steel of 100 mm grows by 1.2 µm at 1 K."""


@dataclass(frozen=True, repr=False)
class Assessment(OnScreen):
    """Expected uncertainties of a campaign, before it is measured.

    `parameters` of the model; `covariance` (k, k), priors included, in the files' units; `rank` the number of combinations that
    the readings determine better than the priors, `confounded` the others; `tool_centre_um` mean and largest 1σ of the tool
    centre point over the workspace (None without a workspace); `valuation` the quality number of each rotary axis; `worth` run →
    (rows,) by how much each row lowers ψ of D, per parameter (nats); `run_worth` the same for whole runs.
    """

    parameters: tuple[Parameter, ...]
    covariance: Array
    rank: int
    confounded: tuple[Confounding, ...]
    tool_centre_um: tuple[float, float] | None
    valuation: Mapping[str, float]
    worth: Mapping[str, Array]
    run_worth: Mapping[str, float]
    value: float

    @property
    def sigma(self) -> dict[str, float]:
        """Expected 1σ by name, in the parameter's unit."""
        return {p.name: float(s) for p, s in zip(self.parameters, np.sqrt(np.diag(self.covariance)), strict=True)}

    @property
    def inseparable(self) -> list[str]:
        """What stays confounded, in words, where an error of the machine is in it."""
        return not_separated(c for c in self.confounded if c.of_machine)

    @property
    def tool_centre_words(self) -> str:
        """Its expected uncertainty at the tool centre point."""
        mean, worst = map(plain_number, self.tool_centre_um or (0.0, 0.0))
        return f"tool centre point over the workspace, 1σ: {mean} µm on average, {worst} µm at worst"

    def to_data(self) -> dict[str, Any]:
        """The assessment as nested mappings (`assessment.json`)."""
        return {"schema": "symfive.assessment/1", **assessment_data(self)}

    def __str__(self) -> str:
        lines = [f"the readings determine {self.rank} of {len(self.parameters)} parameters"]
        lines += listed(self._expected_in_words(), "assessment.sigma")
        if self.tool_centre_um is not None:
            lines.append(self.tool_centre_words)
        lines += [
            f"quality number of axis {axis}: {number:.1f} (4 or more is good)"
            for axis, number in self.valuation.items()
        ]
        run, row = self.most()
        idle = sum(map(len, self.idle.values()))
        rest = f"; {plural(idle, 'row')} add{'s' * (idle == 1)} almost nothing" if idle else ""
        lines.append(f"most informative: line {row + FIRST_LINE} of run {run}{rest}")
        lines += self._runs_in_words()
        return "\n".join([*lines, *listed(self.inseparable, "assessment.confounded")])

    def _expected_in_words(self) -> list[str]:
        """Expected and prior 1σ, the terms of one error motion on one line."""
        sigma, lines = self.sigma, []
        shown = (p for p in self.parameters if p.kind != "setup")
        for name, group in groupby(shown, lambda p: p.name.partition(".")[0] if p.kind == "error_motion" else p.what):
            terms = list(group)
            spread = [sigma[p.name] for p in terms]
            said = [plain_number(value, terms[0].unit) for value in (min(spread), max(spread))]
            subject = name if len(terms) == 1 else f"{name} ({len(terms)} terms)"
            lines.append(
                f"  {subject:24} {' … '.join(dict.fromkeys(said)):>14} {unit_words(terms[0].unit):5} (prior {terms[0].sigma:g})"
            )
        return lines

    def _runs_in_words(self) -> list[str]:
        """Runs in the order of what each adds, and which rows add nothing."""
        idle = {run: rows + FIRST_LINE for run, rows in self.idle.items()}
        if len(self.run_worth) < 2 and not any(map(len, idle.values())):
            return []
        ordered = sorted(self.run_worth, key=lambda run: -self.run_worth[run])
        worth = [
            f"  run {run}: without it 1σ grows by {plain_number(100.0 * math.expm1(0.5 * self.run_worth[run]), '%')} %"
            + (f"; lines {_spans(idle[run])} add almost nothing" if len(idle[run]) else "")
            for run in ordered
        ]
        return listed(worth, "assessment.run_worth", 10)

    def most(self) -> tuple[str, int]:
        """The most informative run and row (from 0)."""
        return max(
            ((run, int(np.argmax(w))) for run, w in self.worth.items()),
            key=lambda place: self.worth[place[0]][place[1]],
        )

    @property
    def idle(self) -> dict[str, Indices]:
        """Run → rows (from 0) that add almost no information."""
        return {run: np.flatnonzero(w < WORTHLESS / max(len(w), 1)) for run, w in self.worth.items()}


def assessment_data(assessment: Assessment) -> dict[str, Any]:
    """An assessment as nested mappings: expected 1σ, rank, what stays confounded, valuation, worth of rows and runs."""
    sigma, centre = assessment.sigma, assessment.tool_centre_um
    most, row = assessment.most()
    return {
        "expected": {
            p.name: {"std": six_digits(sigma[p.name]), "prior_std": six_digits(p.sigma), "unit": p.unit}
            for p in assessment.parameters
        },
        "joint_value": six_digits(assessment.value),
        "tool_centre_point_um": None
        if centre is None
        else {"mean": six_digits(centre[0]), "largest": six_digits(centre[1])},
        "rank": assessment.rank,
        "parameters": len(assessment.parameters),
        "confounded": [list(c.names) for c in assessment.confounded],
        "confounded_in_words": [c.words for c in assessment.confounded],
        "valuation": {axis: six_digits(v) for axis, v in assessment.valuation.items()},
        "tells_most": {"run": most, "row": row + FIRST_LINE},
        "tells_nothing": {run: len(rows) for run, rows in assessment.idle.items()},
        "run_worth": {run: six_digits(v) for run, v in assessment.run_worth.items()},
    }


def _spans(lines: Indices) -> str:
    """Numbers in words: 3, 7-12."""
    spans = np.split(lines, np.flatnonzero(np.diff(lines) != 1) + 1)
    shown = [f"{span[0]}" if len(span) == 1 else f"{span[0]}-{span[-1]}" for span in spans[:8]]
    return ", ".join(shown) + (", …" if len(spans) > 8 else "")


@one_thread
def assess(
    campaign: Campaign | Path | str, *, effects: Iterable[Effect] = (), given: Campaign | Path | str | None = None,
    noise: Noise | None = None,
) -> Assessment:  # fmt: skip
    """Expected uncertainties of a plan or campaign, or of the one in a folder; its readings are not used.

    `given`: a campaign measured before on this machine; `noise`: that of recordings with correlated rows (`coloured` in
    proportion to `white`)."""
    campaign, effects = campaign_given(campaign), tuple(effects)
    model = Model(campaign, effects)
    told, margins = _data_information(model, noise), dict[str, int]()
    seen = _creeping(model, told)
    known = np.zeros((len(model.parameters), len(model.parameters)))
    machine = np.array([p.kind != "setup" for p in model.parameters])
    if given is not None:
        names = [p.name for p in model.parameters if p.kind != "setup"]
        known[np.ix_(machine, machine)] += machine_information(campaign_given(given), names, effects, noise)
    matrix, steady = (sum(each.values(), known) for each in (seen, told))
    precision = np.diag(model.prior_sigma**-2.0)
    covariance = inverse(matrix + precision)
    chosen = np.flatnonzero(machine)
    value = _volume(matrix + precision, chosen, model.prior_sigma)
    still = steady + precision, inverse(steady + precision)
    worth = {run.id: _worth(model, run, *still, chosen, margins, noise) for run in model.campaign.runs}
    whole = {run: _volume(matrix - mine + precision, chosen, model.prior_sigma) - value for run, mine in seen.items()}
    return Assessment(
        parameters=model.parameters, covariance=covariance, rank=data_rank(matrix, model.prior_sigma),
        confounded=confounded_combinations(matrix, model.parameters),
        tool_centre_um=_tool_centre(campaign.machine, model, covariance),
        valuation=_valuation(campaign, model, matrix + precision), worth=worth, run_worth=whole, value=value,
    )  # fmt: skip


def _data_information(model: Model, noise: Noise | None = None) -> dict[str, Array]:
    """Run → Σ JᵀJ (k, k) of the slopes over the noise."""
    size, margins = len(model.parameters), dict[str, int]()
    found = {}
    for run in model.campaign.runs:
        found[run.id] = np.zeros((size, size))
        for _, columns, rows in _whitened(model, run, margins, noise):
            flat = rows.reshape(-1, len(columns))
            found[run.id][np.ix_(columns, columns)] += flat.T @ flat
    return found


def _creeping(model: Model, told: Mapping[str, Array]) -> dict[str, Array]:
    """The information of the runs (k, k) where what stays mounted has an error of its own in each, of `CREEP_UM`, beside the one
    that they share."""
    stays = [i for i, p in enumerate(model.parameters) if p.mounting and p.quantity.partition(".")[0] in MOUNTED]
    own = CREEP_UM**-2.0 * np.eye(len(stays))
    return {
        run: mine - mine[:, stays] @ inverse(mine[np.ix_(stays, stays)] + own) @ mine[stays] if stays else mine
        for run, mine in told.items()
    }


def _whitened(
    model: Model, run: Run, margins: dict[str, int], noise: Noise | None
) -> Iterator[tuple[slice, Indices, Array]]:  # fmt: skip
    """A run by windows: which rows, which parameters (c,) they depend on, and the sensitivities over the noise (n, ny, c), the
    declared white one or, of a recording, `noise`."""
    weights = np.zeros(len(model.columns(run)))
    for _, part in fitted_parts(run, model.machine):
        weights[part] = 1.0 / model.noise(run)[part]
    correlated = noise if noise is not None and run.dynamic else Noise(1.0)
    white, whitening = correlated.white, Whitening(correlated, run.interval)
    for window in windows_of(model, run, model.start, margins):
        assert window.jacobian is not None
        rows = window.jacobian[window.inside] * (white * weights)[:, None]
        yield window.rows, window.columns, whitening(rows)


def machine_information(
    campaign: Campaign, names: Iterable[str], effects: Iterable[Effect] = (), noise: Noise | None = None
) -> Array:
    """Information of a campaign about the machine's parameters `names`, all else marginalised, without priors (n, n).

    In the files' units. Parameters that its machine file does not vary are taken as not seen; `effects`, `noise` as in `assess`.
    """
    model = Model(campaign, effects)
    matrix = np.sum(list(_creeping(model, _data_information(model, noise)).values()), axis=0)
    wanted = list(names)
    chosen = np.array([model.index[name] for name in wanted if name in model.index], dtype=np.int64)
    priors = model.prior_sigma**-2.0
    priors[chosen] = 0.0
    values, vectors = np.linalg.eigh(marginal(matrix + np.diag(priors), chosen))
    found = np.zeros((len(wanted), len(wanted)))
    place = np.array([i for i, name in enumerate(wanted) if name in model.index], dtype=np.int64)
    found[np.ix_(place, place)] = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return found


def _volume(information: Array, chosen: Indices, sigma: Array) -> float:
    """ψ of D for the parameters `chosen`, per prior 1σ."""
    covariance = inverse(information)[np.ix_(chosen, chosen)] / np.outer(sigma[chosen], sigma[chosen])
    return float(np.linalg.slogdet(covariance)[1]) / max(len(chosen), 1)


def _worth(
    model: Model, run: Run, information: Array, covariance: Array, chosen: Indices, margins: dict[str, int],
    noise: Noise | None,
) -> Array:  # fmt: skip
    """How much ψ of D rises when one row is taken out (N,): log det(I - J C Jᵀ) less that of what does not count. Between runs
    nothing creeps."""
    other = np.setdiff1d(np.arange(len(covariance)), chosen)
    of_other = np.zeros_like(covariance)
    if other.size:
        of_other[np.ix_(other, other)] = inverse(information[np.ix_(other, other)])
    found: Array = new_table(1, run.rows)[0]
    for place, columns, rows in _whitened(model, run, margins, noise):
        turned, inner = rows.transpose(0, 2, 1), np.ix_(columns, columns)
        lost = _log_det_minus(rows @ of_other[inner] @ turned) - _log_det_minus(rows @ covariance[inner] @ turned)
        found[place] = np.maximum(lost, 0.0) / max(len(chosen), 1)
        release(found)
    return found


def _log_det_minus(forms: Array) -> Array:
    return np.asarray(np.linalg.slogdet(np.eye(forms.shape[1]) - forms)[1])


def workspace_places(space: Space) -> Array:
    """The tool centre point's sensitivities (places, 3, shared), µm per prior 1σ, over the reachable workspace.

    Centre and rim of the table, lowest and highest ball, each rotary axis at both ends and the middle of its range.
    """
    low, high = space.lower, space.upper
    levels = [np.linspace(low[i], high[i], 5)[:: 1 if i < space.poses else 4] for i in range(len(low))]
    for i, name in enumerate(space.names):
        if name.startswith("bar") or name == "tool.length":
            levels[i] = np.array([0.5 * (low[i] + high[i])])
        elif name == "table_ball.angle":
            levels[i] = np.array([0.0, 0.5 * math.pi])
        elif name == "table_ball.radius":
            levels[i] = np.unique([0.0, high[i]])
    z = np.stack(np.meshgrid(*levels, indexing="ij"), axis=-1).reshape(-1, len(low))
    k = np.full((len(z), 1), max(space.lengths[0], 1e-3))
    z, k = (part[np.all(space.kernel.limits(z, k) >= -1e-9, axis=1)] for part in (z, k))
    shared = len(space.shared)
    return space.centre(z, k)[0].reshape(len(z), shared, 3).transpose(0, 2, 1)


def _space_of(machine: Machine) -> Space | None:
    if machine.workspace.table_radius is None:
        return None
    for instrument in ("r_test", "ball_bar"):
        try:
            return make_space(machine, instrument)
        except InputError:
            continue
    return None


def _tool_centre(machine: Machine, model: Model, covariance: Array) -> tuple[float, float] | None:
    space = _space_of(machine)
    if space is None:
        return None
    places = workspace_places(space)
    if not len(places):
        return None
    index = np.array([model.index[p.name] for p in space.shared], dtype=np.int64)
    sigma = np.array([p.sigma for p in space.shared])
    scaled = covariance[np.ix_(index, index)] / np.outer(sigma, sigma)
    variance = np.einsum("kya,ab,kyb->k", places, scaled, places, optimize=True)
    return float(np.sqrt(variance.mean())), float(np.sqrt(variance.max()))


def _valuation(campaign: Campaign, model: Model, information: Array) -> dict[str, float]:
    """Per rotary axis: how many times better than one reading its location errors come out (angles at 100 mm).

    The geometric mean over them, zeros, table ball and bar length marginalised, the tool ball and the other axes taken as
    known: it depends on the poses only. Below 2 the poses suit the axis badly, from 4 on they suit it well.
    """
    unknown = [i for i, p in enumerate(model.parameters) if p.kind == "setup" and ".tool_ball." not in p.name]
    noise = float(np.mean([model.noise(run).mean() for run in campaign.runs]))
    found = {}
    for name, axis in campaign.machine.axes.items():
        own = [
            model.index[t.name] for t in campaign.machine.location_errors if t.axis == name and t.name in model.index
        ]
        if not axis.rotary or not own:
            continue
        open_ = [*own, *unknown]
        inner = marginal(information[np.ix_(open_, open_)], np.arange(len(own)))
        lever = np.array([LEVER_MM * 1e-3 if model.parameters[i].unit == "urad" else 1.0 for i in own])
        inner = inner / np.outer(lever, lever)
        found[name] = noise * math.exp(0.5 * float(np.linalg.slogdet(inner)[1]) / len(own))
    return found
