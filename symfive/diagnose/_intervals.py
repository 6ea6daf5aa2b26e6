"""Where an effect acts: intervals of the runs, direction in space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign
from symfive.effects import Effect
from symfive.identify import Identification
from symfive.machine import Machine
from symfive.model import Model


@dataclass(frozen=True)
class Interval:
    """A stretch of a run in which the effect acts most (s)."""

    run: str
    begin_s: float
    end_s: float


def intervals_of(campaign: Campaign, contribution: Mapping[str, Array], limit: int = 40) -> tuple[Interval, ...]:
    """Stretches in which the effect exceeds half of its largest deviation from its own mean; where there are more than
    `limit`, those with the shortest pauses between them are one."""
    away = {run: np.abs(c - np.median(c, axis=0)) for run, c in contribution.items()}
    largest = max((float(a.max()) for a in away.values()), default=0.0)
    found: list[Interval] = []
    for run in campaign.runs:
        strong = away[run.id].max(axis=1) > 0.5 * largest
        edges = np.flatnonzero(np.diff(np.concatenate([[False], strong, [False]]).astype(int)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            found.append(Interval(run.id, float(run.time[begin]), float(run.time[end - 1])))
    pauses = sorted(b.begin_s - a.end_s for a, b in pairwise(found) if a.run == b.run)
    longest = pauses[min(len(found) - limit, len(pauses)) - 1] if len(found) > limit and pauses else -1.0
    joined: list[Interval] = []
    for piece in found:
        last = joined[-1] if joined else None
        if last is not None and last.run == piece.run and piece.begin_s - last.end_s <= longest:
            joined[-1] = Interval(last.run, last.begin_s, piece.end_s)
        else:
            joined.append(piece)
    return tuple(joined)


def with_begin(fit: Identification, effect: Effect) -> Effect:
    """An effect that begins in a row of a run with the 1σ of that row: the density of all rows follows from what each does to the
    residual of the fit under its white noise, all else as it is."""
    for run in fit.model.campaign.runs:
        begin = effect.begins(run)
        if begin is not None:
            model = Model(fit.model.campaign, [begin.always if e.key == effect.key else e for e in fit.model.added])
            problem = fit.problem()
            kept = np.zeros((run.rows, len(fit.model.columns(run))))
            for instrument, part in problem.parts(run):
                kept[:, part] = problem.counts(run)[:, part] / fit.noises[run.id, instrument].white
            size, left = (each[run.id] * kept for each in (model.contribution(begin.always, fit.named), fit.residuals))
            with_, without = (np.sum(size * (size + sign * left), axis=1) for sign in (-2.0, 2.0))
            sooner, later = np.cumsum(with_[: begin.row][::-1])[::-1], np.cumsum(without[begin.row :])
            square = np.concatenate([sooner, [0.0], later])
            density = np.exp(-0.5 * (square - square.min()))
            away = np.arange(run.rows + 1) - begin.row
            return begin.within(float(np.sqrt(density @ away**2 / density.sum())))
    return effect


def direction_of(machine: Machine, effect: Effect, values: Mapping[str, float]) -> tuple[float, float, float] | None:
    """Direction of space in which it acts, machine frame: of its three amplitudes, its component or its axis."""
    vector = [values[name] for c in "xyz" for name in values if name.startswith(effect.key) and name.endswith(f".{c}")]
    if len(vector) == 3:
        norm = float(np.linalg.norm(vector))
        return (vector[0] / norm, vector[1] / norm, vector[2] / norm) if norm > 0.0 else None
    component = getattr(effect, "component", None)
    if isinstance(component, str):
        return tuple(float(i == "XYZABC".index(component[1]) % 3) for i in range(3))  # type: ignore[return-value]
    axis = effect.belongs_to
    return None if axis is None else machine.axes[axis].direction
