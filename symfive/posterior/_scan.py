"""Scans: the location on a grid at which an effect explains most of the residual.

With the whitened columns X of one place (a channel's tangent times a course along the run) and J of all that is fitted,

    Δ = sᵀ(H + w⁻²)⁻¹s - log|w²H + 1|,   H = XᵀX - XᵀJ(JᵀJ + 1)⁻¹JᵀX,   s = Xᵀr - XᵀJ(JᵀJ + 1)⁻¹(Jᵀr - δ),

is what it lowers the cost by (C. R. Rao 1948) at the best of the widths w of its prior. Sines over a coordinate are scored on a
whole grid of frequencies by one FFT of the twice whitened residual's answer, as if nothing were fitted beside them; between the
highest the first part of Δ decides (M. Zechmeister & M. Kürster 2009). The best places become forms; what they are worth, the
moments say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from symfive.arrays import Array, Indices
from symfive.campaign import Run
from symfive.effects import Effect, Form, Scan, Tone
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.inference import whiten
from symfive.model import Linearisation, Model
from symfive.posterior._noise import Node
from symfive.posterior._tangents import Channel, probes, tangent
from symfive.posterior._widths import WIDTHS

__all__ = ["placed"]

USUAL = 10.0
"""1σ of a channel's answer in a scan, µm or µrad: of usual size, which the widths multiply."""
PADDED = 4
"""Frequencies per resolved one, over 2, so that a sine between two of them loses 1 % of its power at most (sinc²)."""
CELLS = 2**20
"""Rows times frequencies of which Δ is computed: all that are looked for of some hundred targets, where what is fitted takes a
different share of each frequency; the highest peaks of a spectrum where rows are many and the shares alike."""
FINE = 8
"""Cells of the grid per shortest period, so that sharing a reading between two of them loses 5 % of it at most (sinc²)."""


def placed(fit: Identification, scans: Sequence[Scan | Tone], nodes: Iterable[Node]) -> tuple[Form, ...]:
    """The best place of each scan under each noise, as forms that can join the fit: slow noise hides what is slow."""
    taken, found, drafts = {effect.key for effect in fit.model.effects}, list[Form](), set[Effect]()
    channels = [(scan.channel, scan.axis) for scan in scans]
    model = Model(fit.model.campaign, (*fit.model.added, *probes(channels)))
    lines = {run.id: model.linearise(run, model.vector(fit.named), ahead=True) for run in fit.model.campaign.runs}
    for node in {(node.size, node.time, node.decades): node for node in nodes}.values():
        seen = _Seen(fit, model, lines, node)
        for scan in scans:
            for form in seen.tone(scan) if isinstance(scan, Tone) else seen.course(scan):
                effect = form.effect
                if effect in drafts:
                    continue
                drafts.add(effect)
                while effect.key in taken:  # a second one beside the one that is held
                    effect = replace(effect, tag=f"{effect.tag or 1}+")
                try:
                    found.append(replace(form, effect=effect.prepare(fit.model.campaign)))
                    taken.add(effect.key)
                except InputError:
                    continue
    return tuple(found)


class _Seen:
    """A fit, whitened: per run what is fitted J (rows, k) and the residual, and the answers of the channels, by the model with
    these and its `lines` about the fit."""

    def __init__(self, fit: Identification, model: Model, lines: Mapping[str, Linearisation], node: Node) -> None:
        self.campaign, self._node = fit.model.campaign, node
        self._model, self._lines, self._problem = model, lines, fit.problem()
        self._noise = {run.id: fit.model.noise(run) for run in self.campaign.runs}
        self._fitted, self._residual, self._twice = {}, {}, {}
        fitted = np.array([p.name in fit.model.index for p in self._model.parameters])
        sigma, size = self._model.prior_sigma, len(self._model.parameters)
        self._normal, self._slope = np.eye(size), np.zeros(size)
        self._slope[fitted] = -((fit.values - fit.model.prior_mean) / fit.model.prior_sigma)
        for run in self.campaign.runs:
            line = lines[run.id]
            own = fitted[line.columns]
            where = line.columns[own]
            flat = self._white(run, self._scaled(run, line.jacobian[:, :, own] * sigma[where]))
            residual = self._white(run, self._scaled(run, np.array(fit.residuals[run.id])[:, :, None]))
            self._twice[run.id] = self._white(run, residual[::-1])[::-1, :, 0]
            self._fitted[run.id] = where, flat.reshape(residual.size, flat.shape[2])
            self._residual[run.id] = residual.ravel()
            self._normal[np.ix_(where, where)] += self._fitted[run.id][1].T @ self._fitted[run.id][1]
            self._slope[where] += self._fitted[run.id][1].T @ self._residual[run.id]

    def _scaled(self, run: Run, table: Array) -> Array:
        """Readings (N, ny, m) in declared noise; columns that are not fitted, and outliers, at zero."""
        kept = np.zeros(table.shape[:2])
        for _, part in self._problem.parts(run):
            kept[:, part] = self._problem.counts(run)[:, part] / self._noise[run.id][part]
        return np.asarray(table * kept[:, :, None])

    def _white(self, run: Run, table: Array) -> Array:
        return whiten(table, self._node.noise(1.0), run.interval)[0]

    def _tangent(self, run: Run, channel: Channel) -> Array:
        return USUAL * self._scaled(run, tangent(self._model, self._lines[run.id], run, channel))

    def course(self, scan: Scan) -> Iterator[Form]:
        """The place with the largest Δ."""
        runs = [run for run in self.campaign.runs if scan.run in (None, run.id)]
        h, s = self._beside((scan.channel, scan.axis), runs, lambda run: scan.courses(run)[:, :, None])
        if len(s):
            best = int(np.argmax(np.max([_gain(h, s, width) for width in WIDTHS], axis=0)))
            yield from self.course(scan.finer(best)) if scan.finer else [scan.form(best)]

    def _beside(self, channel: Channel, runs: Sequence[Run], courses_of: Callable[[Run], Array]) -> tuple[Array, Array]:
        """H (count, d, d) and s (count, d) of a channel's answer along the courses (N, count, m) of every place."""
        cross, own, slope = list[Array](), np.zeros(()), np.zeros(())
        rows = list[Indices]()
        for run in runs:
            answer, courses = self._tangent(run, channel), courses_of(run)
            count, parts = courses.shape[1], answer.shape[2] * courses.shape[2]
            if not parts or not courses.any():
                continue
            moved = answer[:, :, None, :, None] * courses[:, None, :, None, :]
            white = self._white(run, moved.reshape(*answer.shape[:2], -1)).reshape(-1, count * parts)
            where, fitted = self._fitted[run.id]
            cross.append(fitted.T @ white)
            rows.append(where)
            each = white.reshape(-1, count, parts)
            own = own + np.einsum("nkd,nke->kde", each, each, optimize=True)
            slope = slope + white.T @ self._residual[run.id]
        if not cross:
            return np.zeros((0, 0, 0)), np.zeros((0, 0))
        total = np.zeros((len(self._normal), cross[0].shape[1]))
        for where, part in zip(rows, cross, strict=True):
            total[where] += part
        solved = np.linalg.solve(self._normal, total)
        taken = np.einsum("pkd,pke->kde", *(t.reshape(-1, *own.shape[:2]) for t in (total, solved)), optimize=True)
        return own - taken, (slope - solved.T @ self._slope).reshape(own.shape[:2])

    def tone(self, tone: Tone) -> Iterator[Form]:
        """The frequency that takes most off the cost, whatever its size: Δ would prefer those that are fitted already."""
        runs = [run for run in self.campaign.runs if not tone.runs or run.id in tone.runs]
        at = {run.id: tone.coordinate(run) for run in runs}
        together = [[run] for run in runs] if tone.apart else [runs]
        ends = [[each(each(at[run.id]) for run in some) for each in (min, max)] for some in together]
        step = 1.0 / (FINE * tone.highest)
        count = int(2 ** np.ceil(np.log2(2.0 * PADDED * max(high - low for low, high in ends) / step + 2.0)))
        score = np.zeros(count // 2 + 1)
        parts = range(self._tangent(runs[0], (tone.channel, tone.axis)).shape[2])
        for part, (some, (low, _)) in product(parts, zip(together, ends, strict=True)):
            grid, power = np.zeros(count), 1.0
            for run in some:
                answer = self._tangent(run, (tone.channel, tone.axis))[:, :, part]
                grid += _spread(at[run.id] - low, np.sum(answer * self._twice[run.id], axis=1), step, count)
                power += 0.5 * float(np.sum(self._white(run, answer[:, :, None]) ** 2))
            score += np.abs(_spectrum(grid)) ** 2 / power
        cycles = np.arange(len(score)) / (count * step)
        seen = (cycles >= tone.lowest) & (cycles <= tone.highest)
        if not seen.any():
            return

        def best_of(where: Indices) -> int:
            def waves(run: Run) -> Array:
                turns = 2.0 * np.pi * np.outer(at[run.id], cycles[where])
                return np.stack([np.cos(turns), np.sin(turns)], axis=2)

            each = [self._beside((tone.channel, tone.axis), some, waves) for some in together]
            return int(where[np.argmax(sum(_drop(h, s, WIDTHS[-1]) for h, s in each if len(s)))])

        where, few = np.flatnonzero(seen), CELLS // sum(run.rows for run in runs)
        if len(where) > few:
            inside = np.where(seen, score, 0.0)
            peaks = where[(score[where] >= inside[where - 1]) & (score[where] >= inside[(where + 1) % len(inside)])]
            highest = peaks[np.argsort(-score[peaks])[: max(1, few // (2 * PADDED))]]
            where = where[np.abs(where - best_of(highest)) < PADDED]
        best = best_of(where)
        yield tone.form(float(cycles[best]), PADDED * float(cycles[1]), int(seen.sum()) // (2 * PADDED) + 1)


def _gain(h: Array, s: Array, width: float) -> Array:
    """Twice the log evidence (places,) of an effect whose 1σ is `width` times the usual one."""
    return np.asarray(_drop(h, s, width) - np.linalg.slogdet(width**2 * h + np.eye(h.shape[-1]))[1])


def _drop(h: Array, s: Array, width: float) -> Array:
    """What it lowers the cost by (places,)."""
    solved = np.linalg.solve(h + width**-2.0 * np.eye(h.shape[-1]), s[:, :, None])
    return np.asarray(np.sum(s * solved[:, :, 0], axis=1))


def _spread(at: Array, answer: Array, step: float, count: int) -> Array:
    """An answer at the places q `at` ≥ 0 on a grid (count,), shared linearly between neighbours."""
    left = np.floor(at / step).astype(int)
    share = at / step - left
    grid = np.bincount(left, answer * (1.0 - share), count)[:count]
    grid += np.bincount(left + 1, answer * share, count)[:count]
    return np.asarray(grid, dtype=float)


def _spectrum(grid: Array) -> Array:
    """Σ answer·exp(-2πi·f·q) (count // 2 + 1,) at f = k/(count·step), of an answer on a grid (count,): the loss of its being
    shared there, sinc², is undone."""
    spectrum = np.fft.rfft(grid)
    return np.asarray(spectrum / np.sinc(np.arange(len(spectrum)) / len(grid)) ** 2)
