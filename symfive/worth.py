"""What a correction is worth: the share of the deviation on circles and of the error at the tool that it removes.

Of parameters p with values v, the model without them is the model with p at its mean. On a measured run

    share = 1 - rms(y - Δ) / rms(y),    Δ = f(v) - f(v without p),

y the readings less what set-up alone explains of them (least squares in the run's own parameters: centre, radius, zeros), and
y - Δ likewise. In the workspace the same is the rms distance of the tool from where it was sent, over poses spread evenly over
all axes' travels, less its mean (which a work offset removes); there only what moves the tool counts, not what moves the
instrument's reading. A negative share: the error makes up for another one, and corrected alone the rest grows.

A correction below its own uncertainty is not entered (ISO 14253-1, and every control's resolution): with C the covariance of
p it is worth nothing where vᵀ C⁻¹ v is below the 95.45 % quantile of χ², for one parameter |v| < 2σ.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.special import gammaincinv

from symfive.arrays import Array, Flags, Indices
from symfive.campaign import Campaign, Run, SetupSigma
from symfive.circles import CircleFinder
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.machine import Machine
from symfive.model import Model
from symfive.numbers import percent
from symfive.screen import aligned

__all__ = [
    "DO_NOT", "LONGEST", "Worth", "effect_worth", "effect_worths", "location_worths", "signed", "worth_of", "worth_text",
]  # fmt: skip

DO_NOT = "do not correct: below the uncertainty"
CERTAIN = 0.9545
"""Probability of two standard deviations."""
POSES = 256
TURN = 180.0
"""Degree either way of a rotary axis that turns endlessly."""
LONGEST = 50_000
"""Runs of more rows are not looked at."""
NOTHING = 1e-3
"""So small a share is no gain and no loss."""
UNSEEN = 1e-3
"""A direction of the set-up that moves all readings together by so little of their noise, at 1σ of its prior, is none."""
AT_THE_TOOL = ("drive", "axis", "structure")
"""The stages of effects that move the tool; the others are the instrument's."""


@dataclass(frozen=True)
class Worth:
    """The worth of correcting `names`: `circles` run → share of the deviation of each circle, `readings` that of all readings
    together, `tool` that of the error at the tool in the workspace, None where it is not there; `certain` whether it is larger
    than its uncertainty; `confounded` what it cannot be separated from, of the machine and, `by_setup`, of the set-up;
    `words` says them in words; `of_machine`: whether it is an error of the machine, not of the instrument or the set-up;
    `explained`: whether the model explains the readings down to their noise."""

    names: tuple[str, ...]
    circles: Mapping[str, float]
    readings: float
    tool: float | None
    certain: bool
    confounded: tuple[str, ...] = ()
    of_machine: bool = True
    by_setup: tuple[str, ...] = ()
    explained: bool = True
    words: Mapping[str, str] = field(default_factory=dict)

    @property
    def advice(self) -> str:
        """Whether to correct it, in a few words."""
        if not self.of_machine:
            return "not an error of the machine: correct the instrument or the set-up"
        if not self.certain:
            return DO_NOT
        if self.confounded:
            others = ", ".join(map(self._said, self.confounded[:4]))
            return f"correct only together with {others}: these readings cannot separate them"
        gain, where = (self.readings, "in these readings") if self.tool is None else (self.tool, "at the tool")
        if gain < -NOTHING:
            return "do not correct alone: it compensates for another error"
        if gain < NOTHING:
            return f"no gain {where}"
        if self.by_setup:
            return f"correct only if {self._said(self.by_setup[0])} is known to its 1σ: these readings cannot separate them"
        return "correct" if self.explained else "correct, then measure again: the model does not explain the readings"

    def _said(self, name: str) -> str:
        return self.words.get(name, name)

    def to_data(self) -> dict[str, Any]:
        """As JSON."""
        return {"names": list(self.names), "circles": dict(self.circles), "readings": self.readings, "tool": self.tool,
                "certain": self.certain, "confounded": list(self.confounded), "of_machine": self.of_machine,
                "by_setup": list(self.by_setup), "explained": self.explained, "advice": self.advice}  # fmt: skip


def location_worths(identification: Identification) -> tuple[Worth, ...]:
    """The worth of every identified location error, the largest at the tool first; none of a fit that did not converge, whose
    values and uncertainties may be wrong."""
    if not identification.converged:
        return ()
    names = [p.name for p in identification.parameters if p.kind == "location_error"]
    found = worth_of(identification, [(name,) for name in names])
    return tuple(sorted(found, key=lambda worth: -(worth.tool or 0.0)))


def effect_worth(identification: Identification, effect: Effect) -> Worth:
    """Worth of correcting an effect of the fitted model. Raises `InputError` where the model lacks it."""
    return effect_worths(identification, [effect])[0]


def effect_worths(identification: Identification, effects: Iterable[Effect | tuple[Effect, ...]]) -> tuple[Worth, ...]:
    """The worth of several effects, or of several together, each corrected alone."""
    model, groups, machines = identification.model, [], []
    for one in effects:
        together, names = one if isinstance(one, tuple) else (one,), list[str]()
        for effect in together:
            own = [p.name for p in effect.parameters(model.campaign) if p.name in model.index]
            if effect not in model.effects or not own:
                raise InputError(
                    f"the model has no effect {effect.key}", remedy="give one of identification.model.effects"
                )
            names += own
        groups.append(names)
        machines.append(all(effect.stage in AT_THE_TOOL for effect in together))
    found = worth_of(identification, groups)
    return tuple(replace(worth, of_machine=machine) for worth, machine in zip(found, machines, strict=True))


def worth_of(identification: Identification, groups: Iterable[Sequence[str]]) -> tuple[Worth, ...]:
    """The worth of each group of parameters, corrected together. Raises `InputError` for a name that the model lacks."""
    model = identification.model
    wanted = [tuple(names) for names in groups]
    for name in {name for names in wanted for name in names}:
        if name not in model.index:
            raise InputError(f'the model has no parameter "{name}"', remedy="see result.parameters")
    finder = CircleFinder(model.machine)
    runs, space = _measured(identification), _workspace(identification)
    circles = {seen.run.id for seen in runs if finder.find(seen.run) is not None}
    return tuple(_worth(identification, names, runs, circles, space) for names in wanted)


def _worth(
    identification: Identification,
    names: tuple[str, ...],
    runs: Sequence[_Seen],
    circles: set[str],
    space: _Seen | None,
) -> Worth:
    squares, shares = np.zeros(2), {}
    for seen in runs:
        before, after = seen.squares(names)
        squares += (before, after)
        if seen.run.id in circles:
            shares[seen.run.id] = _share(before, after)
    there = space is not None and any(name in space.model.index for name in names)
    tool = _share(*space.squares(names)) if space is not None and there else None
    others = _confounded(identification, names)
    shared = {p.name for p in identification.parameters if not p.of_setup}
    return Worth(
        names, shares, _share(*squares), tool, _certain(identification, names),
        confounded=tuple(name for name in others if name in shared),
        by_setup=tuple(name for name in others if name not in shared),
        explained=identification.fits != "no", words={p.name: p.words for p in identification.parameters if p.name in others},
    )  # fmt: skip


def _share(before: float, after: float) -> float:
    return 1.0 - float(np.sqrt(after / before)) if before > 0.0 else 0.0


def _certain(identification: Identification, names: Sequence[str]) -> bool:
    model = identification.model
    where = [model.index[name] for name in names if identification.uncertainty(name) > 0.0]
    if not where:
        return False
    change = identification.values[where] - model.prior_mean[where]
    covariance = identification.covariance[np.ix_(where, where)]
    return bool(
        change @ np.linalg.pinv(covariance) @ change > 2.0 * gammaincinv(0.5 * len(where), CERTAIN)
    )  # χ²'s quantile


def _confounded(identification: Identification, names: Sequence[str]) -> tuple[str, ...]:
    """The other parameters in combinations of which the data say nothing."""
    found = dict.fromkeys(
        other for combination in identification.confounded if set(combination.names) & set(names)
        for other in combination.names if other not in names
    )  # fmt: skip
    return tuple(found)


@dataclass(frozen=True)
class _Seen:
    """A run as its own set-up leaves it: `deviation` (n,) of the kept readings over their noise, the set-up's orthonormal
    `basis` (n, k), and how a prediction (N, ny) becomes such (`rows` (n,) of its flat entries, `weights` (n,))."""

    model: Model
    run: Run
    values: Array
    prediction: Array
    rows: Indices
    weights: Array
    deviation: Array
    basis: Array

    @classmethod
    def of(cls, model: Model, run: Run, values: Array, readings: Array, kept: Flags, sigma: Array) -> _Seen:
        """`readings` (N, ny), those that are `kept`, and 1σ of each column (ny,)."""
        line = model.linearise(run, values)
        rows = np.flatnonzero(kept.ravel())
        weights = np.broadcast_to(1.0 / sigma, kept.shape).ravel()[rows]
        own = [i for i, column in enumerate(line.columns) if model.parameters[column].of_setup]
        prior = np.array([model.parameters[line.columns[i]].sigma for i in own])
        slopes = line.jacobian.reshape(-1, len(line.columns))[rows][:, own] * weights[:, None] * prior
        left, size, _ = np.linalg.svd(slopes, full_matrices=False)
        basis = left[:, size > UNSEEN]
        plain = model.predict_run(run, model.prior_mean)
        return cls(
            model, run, values, line.prediction, rows, weights, weights * (readings - plain).ravel()[rows], basis
        )

    def squares(self, names: Sequence[str]) -> tuple[float, float]:
        """Sum of the deviation's squares, and what it would be with these parameters corrected."""
        without = self.values.copy()
        for i in (self.model.index[name] for name in names if name in self.model.index):
            without[i] = self.model.parameters[i].mean
        gone = self.prediction - self.model.predict_run(self.run, without)
        return self._left(self.deviation), self._left(self.deviation - self.weights * gone.ravel()[self.rows])

    def _left(self, deviation: Array) -> float:
        rest = deviation - self.basis @ (self.basis.T @ deviation)
        return float(rest @ rest)


def _measured(identification: Identification) -> list[_Seen]:
    """The runs of the fit, of the long ones none: they would have to be held in memory as a whole."""
    model, problem = identification.model, identification.problem()
    found = []
    for run in (run for run in model.campaign.runs if run.rows <= LONGEST):
        kept = np.zeros((run.rows, len(model.columns(run))), dtype=bool)
        sigma = model.noise(run)
        for name, part in problem.parts(run):
            kept[:, part] = ~problem.left_out[run.id][:, part]
            sigma[part] = problem.noises[run.id, name].white
        found.append(_Seen.of(model, run, identification.values, model.readings(run), kept, sigma))
    return found


def _workspace(identification: Identification) -> _Seen | None:
    """The tool at poses spread over all travels, as an ideal R-test would read it; its zeros are the work offset."""
    machine = identification.model.machine
    campaign = Campaign(machine=machine, runs=(_poses(machine),), name="workspace")
    effects = [
        effect for effect in identification.model.added if effect.stage in AT_THE_TOOL and _joins(effect, campaign)
    ]
    model = Model(campaign, effects)
    values = model.vector({name: value for name, value in identification.named.items() if name in model.index})
    (run,) = campaign.runs
    if all(p.of_setup for p in model.parameters):
        return None
    readings = model.predict_run(run, values)
    return _Seen.of(model, run, values, readings, np.ones_like(readings, dtype=bool), np.ones(readings.shape[1]))


def _joins(effect: Effect, campaign: Campaign) -> bool:
    """Whether an effect has a meaning at rest and without the campaign that it was found in."""
    if effect.dynamic_only or effect.over_time:
        return False
    try:
        Model(campaign, [effect])
    except InputError:
        return False
    return True


def _poses(machine: Machine) -> Run:
    """A static run spread evenly over the travels, the tool of middle length."""
    names = machine.axis_names
    travels = np.array([machine.axes[name].travel for name in names])
    turning = [machine.axes[name].rotary for name in names]
    travels[turning] = np.clip(travels[turning], -TURN, TURN)
    spread = travels[:, 0] + _spread(POSES, len(names)) * np.ptp(travels, axis=1)
    lengths = machine.workspace.tool_length
    length = 0.0 if lengths is None else float(np.mean(lengths))
    return Run(
        id="workspace", instrument=("r_test",), sampling="static", clock="none", time=np.arange(float(POSES)),
        commands=dict(zip(names, spread.T, strict=True)), tool_ball=(0.0, 0.0, -length),
        setup_sigma_um=SetupSigma(table_ball=0.0, tool_ball=0.0, length=0.0),
    )  # fmt: skip


def _spread(count: int, over: int) -> Array:
    """Points (count, over) between 0 and 1, evenly spread: multiples of the powers of the generalised golden section, the root
    of x^(n+1) = x + 1 (M. Roberts 2018)."""
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (over + 1))
    return np.asarray((0.5 + np.outer(np.arange(1.0, count + 1.0), root ** -np.arange(1.0, over + 1.0))) % 1.0)


def worth_text(worths: Sequence[Worth], most: int = 12) -> str:
    """A line for each: how much less rms the readings and the tool have with it, and whether to correct it; "" where there is
    none."""
    rows = [
        (
            ", ".join(worth.names[:2]),
            signed(worth.readings),
            "–" if worth.tool is None else signed(worth.tool),
            worth.advice,
        )
        for worth in worths[:most]
    ]
    head = ("correction", "readings", "tool", "advice")
    said = "How much each correction alone lowers the rms of the readings and the error at the tool (negative: raises):"
    return "\n".join([said, *aligned([head, *rows], right=(1, 2))]) if rows else ""


def signed(share: float) -> str:
    """A share in percent, negative where the deviation would grow."""
    if abs(share) < NOTHING:
        return "below 0.1 %"
    return percent(share) if share > 0.0 else f"−{percent(-share)}"
