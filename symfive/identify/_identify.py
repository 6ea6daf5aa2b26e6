"""`identify`: parameters and their uncertainties from a campaign with readings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.given import campaign_given
from symfive.identify._ipopt import solve_with_ipopt
from symfive.identify._mounted import mounting_notes
from symfive.identify._result import Identification
from symfive.identify._tension import tension_notes
from symfive.identify._wiring import wiring_doubts
from symfive.inference import Noise, Problem, confounded_combinations, data_rank, solve, square_of
from symfive.instruments import INSTRUMENTS
from symfive.model import Model
from symfive.threads import one_thread

FEW, QUIET = 10, 0.2
"""Residuals this many times smaller than the noise that is declared are no luck where the readings are more than a few."""


@one_thread
def identify(
    campaign: Campaign | Model | Path | str, *, effects: Iterable[Effect] = (), free: Iterable[str] | None = None,
    fixed: Mapping[str, float] | None = None, noise: str = "estimate", solver: str = "gauss_newton",
    loss: str = "square", start: Mapping[str, float] | None = None,
    start_noise: Mapping[tuple[str, str], Noise] | None = None, refine: bool = True,
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:  # fmt: skip
    """Maximum a posteriori estimate of every parameter of the baseline, the effects and the set-ups.

    `campaign` with readings, the path of its folder, or its `Model`; `effects` join the baseline. `free` names the only
    parameters that may change; `fixed` holds some at given values (file units). `noise`: `estimate` finds white noise (never
    below the declared one), coloured noise and outliers; `repeats` finds them from differences of repeated runs, where these
    show less noise; `declared` takes the data sheet. `solver`: `gauss_newton` or `ipopt` (bounds by an interior point);
    `loss`: `square` or `huber` (IPOPT). `start` and `start_noise` (by run and instrument) are the initial values. `refine`:
    IPOPT continues where a bound is active and Gauss–Newton has not converged. Runs of more than 50,000 rows are identified
    window by window, and their residuals stay on disk.

    Raises `InputError` where there are no readings. Source of the estimator: Gaussian prior and noise (A. Tarantola
    2005, ch. 3), restricted likelihood for the noise.
    """
    model = campaign if isinstance(campaign, Model) else Model(campaign_given(campaign), effects)
    _check_choice("noise", noise, ("estimate", "repeats", "declared"))
    _check_choice("solver", solver, ("gauss_newton", "ipopt"))
    _check_choice("loss", loss, ("square", "huber"))
    values = model.vector(dict(start or {}))
    movable = np.ones(len(model.parameters), dtype=bool)
    if free is not None:
        chosen = [model.index[name] for name in model.index if name in set(free)]
        movable[:] = False
        movable[chosen] = True
    for name, value in (fixed or {}).items():
        values[_place(model, name)] = value
        movable[_place(model, name)] = False
    problem = Problem.of(model, movable, start_noise)
    if noise == "repeats":
        problem.repeats = model.campaign.repeats
    progress(f"{model.campaign.rows} rows, {int(movable.sum())} parameters")
    values, converged = solve(problem, values, noise=noise, progress=progress)
    notes = []
    at_bound = any(v in (p.lower, p.upper) for p, v in zip(model.parameters, values, strict=True))
    if solver == "ipopt" or loss != "square" or (refine and at_bound and not converged):
        progress("refining with IPOPT")
        values, converged, note = solve_with_ipopt(problem, values, loss)
        notes += [note] if note else []
    result = summarise(problem, values, converged, tuple(notes))
    held = [f"run {run} was held in memory as a whole: its rows depend on rows far away" for run in problem.held_whole]
    doubts = wiring_doubts(result) or tension_notes(result)
    return replace(result, notes=(*result.notes, *held, *doubts, *mounting_notes(problem, result)))


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise InputError(f'{name} = "{value}" is unknown', remedy=f"use one of {', '.join(choices)}")


def _place(model: Model, name: str) -> int:
    if name not in model.index:
        raise InputError(f'the model has no parameter "{name}"', remedy="see model.parameters")
    return model.index[name]


def summarise(
    problem: Problem, values: Array, converged: bool, notes: tuple[str, ...] = (), method: str = "joint"
) -> Identification:
    """Covariance, rank, confounded combinations and residual statistics at the solution."""
    model = problem.model
    information, residuals = problem.information_at(values), problem.residuals_at(values)
    free = np.flatnonzero(problem.free)
    inner = np.ix_(free, free)
    covariance = np.zeros_like(information.matrix)
    covariance[inner] = np.linalg.inv(information.matrix[inner] + np.diag(problem.prior_precision[free]))
    spent = float(np.trace(covariance[inner] @ information.matrix[inner]))
    excess = problem.excess_at(values)[inner]
    covariance[inner] += covariance[inner] @ excess @ covariance[inner]
    declared, rms, rms_kept = _squares(problem, residuals)
    dof = max(information.count - spent, 1.0)
    runs = model.campaign.runs
    sizes = zip(values.tolist(), np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist(), strict=True)
    found = {p.name: size for p, size in zip(model.parameters, sizes, strict=True)}
    read = ((run, INSTRUMENTS[name]) for run in runs for name, _ in problem.parts(run))
    notes = (*notes, *(said for run, each in read for said in each.remarks(run, model.machine, found)))
    if not converged:
        notes = (*notes, "the fit did not converge; the values are the best found and their uncertainties may be wrong")
    if information.count <= spent:
        notes = (*notes, "there are no more readings than parameters: the fit cannot be judged")
    if dof > FEW and declared / dof < QUIET**2:
        notes = (
            *notes,
            f"the residuals are {(declared / dof) ** -0.5:.3g} times smaller than the noise declared: are the readings in "
            "the units that their columns name (µm, not mm), and is noise_um the 1σ of one of them?",
        )
    notes = (*notes, *_weighed(problem))
    active = [model.parameters[i] for i in free]
    sigma = np.array([p.sigma for p in active])
    return Identification(
        model=model,
        values=values,
        covariance=covariance,
        converged=converged,
        rank=data_rank(information.matrix[inner], sigma),
        confounded=confounded_combinations(information.matrix[inner], active),
        outliers=tuple(problem.outliers),
        noises=dict(problem.noises),
        residuals=residuals,
        rms=rms,
        rms_kept=rms_kept,
        chi2_dof=declared / dof,
        chi2_dof_whitened=information.square / dof,
        dof=dof,
        notes=notes,
        method=method,
        weights=dict(problem.weights),
    )


def _weighed(problem: Problem) -> Iterator[str]:
    """Of runs with readings that depend on what their rows do not show."""
    for run in problem.model.campaign.runs:
        less = np.any(~problem.judged(run) & ~problem.undetermined[run.id], axis=1)
        if less.any():
            yield (
                f"run {run.id}: {int(less.sum())} of {run.rows} rows hardly count: what they show depends on how the axes moved "
                "between the recorded rows or before the first, as where an axis starts; record more rows a second, from rest on"
            )


def _squares(problem: Problem, residuals: Mapping[str, Array]) -> tuple[float, dict[str, float], dict[str, float]]:
    """Sum of the kept residuals' squares over the declared noise's; the residuals' root mean square by unit of reading, of all
    of them and of those that were kept."""
    declared = 0.0
    every: dict[str, list[float]] = {}
    kept: dict[str, list[float]] = {}
    for run in problem.model.campaign.runs:
        for name, part in problem.parts(run):
            residual, left_out = residuals[run.id][:, part], problem.left_out[run.id][:, part]
            never = ~problem.judged(run)[:, part]
            out = left_out | never
            square = square_of(residual, out)
            whole = square_of(residual, never) if out.any() else square
            weighed = residual * problem.counts(run)[:, part] if run.id in problem.weights else None
            counted = square if weighed is None else square_of(weighed, left_out)
            declared += counted / problem.noises[run.id, name].declared ** 2
            unit = problem.unit_of(run, part)
            for sums, part_square, apart in ((every, whole, never), (kept, square, out)):
                entry = sums.setdefault(unit, [0.0, 0.0])
                entry[0] += part_square
                entry[1] += apart.size - int(apart.sum())
    return declared, _root_means(every), _root_means(kept)


def _root_means(sums: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """Unit → root of (sum of squares, number)."""
    return {unit: float(np.sqrt(square / max(count, 1.0))) for unit, (square, count) in sums.items()}
