"""The estimation problem of a campaign: whitened residuals, information and gradient, run by run."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.disk import new_table, release
from symfive.effects import Effect
from symfive.inference._between import unresolved
from symfive.inference._information import Information, NormalEquations
from symfive.inference._noise import Block, Key, estimate_noise, long_run_variance, plain_noise, quiet_ones
from symfive.inference._outliers import (
    OUTLIER_LEVEL,
    Outlier,
    isolated_outliers,
    leverage_of,
    one_by_one,
    outlier_limit,
    short_groups,
)
from symfive.inference._repeats import alike, alone_among_repeats, contrasts, repeats_say_so
from symfive.inference._whitening import TRANSIENT, Noise, Whitening, whiten
from symfive.inference._windows import predicted, windows_of
from symfive.instruments import INSTRUMENTS, fitted_parts, instruments_of
from symfive.model import Model
from symfive.runs import Run

NOISE_ROWS = 60_000
"""The noise of an instrument is estimated from so many rows, the first ones of each of its runs."""


@dataclass
class Problem:
    """Readings, priors and noise of a model. `free` marks the parameters that may move; `noises` by (run, instrument); `weights`
    run → (N, ny), how much each reading counts, of runs whose rows may not tell all of the motion between them (`weigh`);
    `repeats` groups of runs whose differences may show the noise. What is said `at` parameter values is computed window by
    window and takes no more memory for long runs."""

    model: Model
    free: Flags
    noises: dict[Key, Noise] = field(default_factory=dict)
    left_out: dict[str, Flags] = field(default_factory=dict)
    undetermined: dict[str, Flags] = field(default_factory=dict)
    weights: dict[str, Array] = field(default_factory=dict)
    outliers: list[Outlier] = field(default_factory=list)
    repeats: tuple[tuple[str, ...], ...] = ()
    _margins: dict[str, int] = field(default_factory=dict, repr=False)
    _last: tuple[tuple[object, ...], Information] | None = field(default=None, repr=False)

    @classmethod
    def of(
        cls, model: Model, free: Flags | None = None, noises: Mapping[tuple[str, str], Noise] | None = None
    ) -> Problem:
        """The problem with declared white noise and no outliers; readings that no parameter determines are left out."""
        problem = cls(model, np.ones(len(model.parameters), dtype=bool) if free is None else free)
        for run in model.campaign.runs:
            for instrument in instruments_of(run):
                declared = run.noise(instrument.name)
                problem.noises[run.id, instrument.name] = Noise(declared, declared=declared)
            rows = [
                (i.undetermined(run, model.machine), len(i.columns(run, model.machine))) for i in instruments_of(run)
            ]
            problem.undetermined[run.id] = np.concatenate([np.tile(r[:, None], ny) for r, ny in rows], axis=1)
            problem.left_out[run.id] = problem.undetermined[run.id].copy()
        problem.noises.update(noises or {})
        return problem

    @property
    def prior_precision(self) -> Array:
        """Diagonal of the prior's information (k,)."""
        return np.asarray(self.model.prior_sigma**-2.0)

    @property
    def held_whole(self) -> tuple[str, ...]:
        """Long runs that went through memory as a whole, because windows of them did not agree."""
        runs = self.model.campaign.runs
        return tuple(run.id for run in runs if 2 * self._margins.get(run.id, 0) > run.rows)

    def parts(self, run: Run) -> list[tuple[str, slice]]:
        """The instruments of a run whose readings are fitted, each with its columns."""
        return fitted_parts(run, self.model.machine)

    def unit_of(self, run: Run, part: slice) -> str:
        """The unit of some columns of a run, `mixed` where they have several."""
        units = {column.unit for column in self.model.columns(run)[part]}
        return units.pop() if len(units) == 1 else "mixed"

    @property
    def readings(self) -> int:
        """Number of readings that are fitted, outliers included."""
        runs = self.model.campaign.runs
        return sum(int(np.sum(~self.undetermined[run.id][:, part])) for run in runs for _, part in self.parts(run))

    def blocks(self, values: Array, *, readings: bool = True) -> dict[Key, Block]:
        """Residuals and sensitivities of every run and instrument at `values`, all rows."""
        found: dict[Key, Block] = {}
        for run in self.model.campaign.runs:
            line = self.model.linearise(run, values, ahead=True)
            residual = self.model.readings(run) - line.prediction if readings else np.zeros_like(line.prediction)
            found |= self._cut(run, slice(0, run.rows), residual, line.jacobian, line.columns)
        return found

    def _cut(self, run: Run, rows: slice, residual: Array, slopes: Array, columns: Indices) -> dict[Key, Block]:
        """Residuals (n, ny) of some rows of a run and slopes (n, ny, k), by instrument, with the free parameters' slopes."""
        used, interval = self.free[columns], run.interval
        if not used.all():
            slopes, columns = slopes[:, :, used], columns[used]
        if run.id in self.weights:
            weight = self.weights[run.id][rows]
            residual, slopes = residual * weight, slopes * weight[: len(slopes), :, None]
        return {
            (run.id, name): Block(
                residual[:, part], slopes[:, part], columns, interval, self.left_out[run.id][rows, part]
            )
            for name, part in self.parts(run)
        }

    def whitened_at(
        self, values: Array, only: Container[Key] | None = None, of: Mapping[str, Array] | None = None
    ) -> Iterator[tuple[Key, Block, Array]]:
        """Every recording (or `only` some) by blocks of rows, each with its whitened table (n, ny, k + 1). `of`: run → (N, ny),
        what stands in the place of the residuals."""
        for run in self.model.campaign.runs:
            wanted = [name for name, _ in self.parts(run) if only is None or (run.id, name) in only]
            whitenings: dict[str, Whitening] = {}
            for window in windows_of(self.model, run, values, self._margins) if wanted else ():
                assert window.jacobian is not None
                inside = window.inside
                if of is None:
                    residual = (self.model.readings(window.run) - window.prediction)[inside]
                else:
                    residual = np.array(of[run.id][window.rows])
                cut = self._cut(run, window.rows, residual, window.jacobian[inside], window.columns)
                for name in wanted:
                    key, block = (run.id, name), cut[run.id, name]
                    whitening = whitenings.setdefault(name, Whitening(self.noises[key], block.interval))
                    yield key, block, whitening(block.stacked())

    def information_at(
        self, values: Array, only: Container[Key] | None = None, of: Mapping[str, Array] | None = None
    ) -> Information:
        """Sum over all recordings (or `only` some), each whitened by its own noise; of the residuals or of what `of` holds.

        The last sum over all residuals is kept: where one search ends, the next begins.
        """
        whole = only is None and of is None
        asked = self._state(values) if whole else None
        if asked is not None and self._last is not None and self._last[0] == asked:
            return self._last[1]
        total = NormalEquations(len(self.model.parameters))
        for _, block, white in self.whitened_at(values, only, of):
            total.add(block, white)
        found = total.information
        if asked is not None:
            self._last = asked, found
        return found

    def _state(self, values: Array) -> tuple[object, ...]:
        """All that the sum at `values` depends on."""
        left_out = (np.packbits(mask).tobytes() if mask.any() else b"" for mask in self.left_out.values())
        weights = (weight.tobytes() for weight in self.weights.values())
        return values.tobytes(), self.free.tobytes(), tuple(self.noises.items()), *left_out, *weights

    def weigh(self, values: Array) -> None:
        """Readings count less where they depend on what the rows do not show of the motion between them."""
        self.weights = {}
        for run in self.model.campaign.runs:
            variance = unresolved(self.model, run, values, self._margins)
            if variance is not None:
                weight = np.ones_like(variance)
                for name, part in self.parts(run):
                    weight[:, part] = (1.0 + variance[:, part] / self.noises[run.id, name].white ** 2) ** -0.5
                self.weights[run.id] = weight

    def counts(self, run: Run) -> Array:
        """How much each reading of a run counts (N, ny): outliers not at all."""
        return np.asarray(~self.left_out[run.id] * self.weights.get(run.id, 1.0), dtype=float)

    def judged(self, run: Run) -> Flags:
        """Which readings of a run (N, ny) a fit is judged by: those that a parameter determines, and that depend less on what the
        rows do not show of the motion than on noise."""
        return ~self.undetermined[run.id] & (2.0 * self.weights.get(run.id, 1.0) ** 2 >= 1.0)

    def information(self, blocks: Mapping[Key, Block]) -> Information:
        """Sum over the blocks, each whitened by its own noise."""
        total = NormalEquations(len(self.model.parameters))
        for key, block in blocks.items():
            total.add(block, whiten(block.stacked(), self.noises[key], block.interval)[0])
        return total.information

    def contribution(self, effect: Effect, values: Array) -> dict[str, Array]:
        """Readings with an effect of the model less those without it (its parameters at their means): run → (N, ny)."""
        without = values.copy()
        for p in effect.parameters(self.model.campaign):
            without[self.model.index[p.name]] = p.mean
        found = {run.id: predicted(self.model, run, values, self._margins) for run in self.model.campaign.runs}
        for run in self.model.campaign.runs:
            for window in windows_of(self.model, run, without, self._margins, slopes=0):
                found[run.id][window.rows] -= window.prediction[window.inside]
                release(found[run.id])
        return found

    def less(
        self, tables: Sequence[Mapping[str, Array]], values: Array, steps: Sequence[Array]
    ) -> list[dict[str, Array]]:
        """Each of some tables (run → (N, ny)) less what its own step (k,) of the parameters from `values` does to the readings,
        linearised."""
        found = [{run: new_table(*table.shape) for run, table in each.items()} for each in tables]
        for run in self.model.campaign.runs:
            for window in windows_of(self.model, run, values, self._margins):
                assert window.jacobian is not None
                slopes, rows = window.jacobian[window.inside], window.rows
                for left, table, step in zip(found, tables, steps, strict=True):
                    left[run.id][rows] = table[run.id][rows] - slopes @ step[window.columns]
                    release(left[run.id])
        return found

    def residuals_at(self, values: Array) -> dict[str, Array]:
        """Readings less predictions: run → (N, ny), all columns, on disk where they are long."""
        return {run.id: self._residuals(run, values, 0)[0] for run in self.model.campaign.runs}

    def _residuals(self, run: Run, values: Array, head: int) -> tuple[Array, list[Array], Indices]:
        """Residuals (N, ny), slopes of the first `head` rows piece by piece, and the parameters that these are of."""
        residual, slopes, columns = new_table(run.rows, len(self.model.columns(run))), [], np.zeros(0, dtype=np.int64)
        for window in windows_of(self.model, run, values, self._margins, head):
            residual[window.rows] = (self.model.readings(window.run) - window.prediction)[window.inside]
            release(residual)
            if window.jacobian is not None:
                slopes.append(window.jacobian[window.inside][: head - window.first])
                columns = window.columns
        return residual, slopes, columns

    def survey(self, values: Array) -> dict[Key, Block]:
        """What the noise is estimated from: residuals of all rows, sensitivities of the first ones."""
        found: dict[Key, Block] = {}
        heads = {key: rows for keys in self._groups().values() for key, rows in self._heads(keys).items()}
        for run in self.model.campaign.runs:
            rows = {name: heads[run.id, name] for name, _ in self.parts(run)}
            if rows:
                residual, slopes, columns = self._residuals(run, values, max(rows.values()))
                table = slopes[0] if len(slopes) == 1 else np.concatenate(slopes)
                for key, block in self._cut(run, slice(0, run.rows), residual, table, columns).items():
                    found[key] = replace(block, jacobian=block.jacobian[: rows[key[1]]])
        return found

    def _groups(self) -> dict[tuple[str, bool, float], list[Key]]:
        """Recordings that share their noise: of one instrument and sampling that declare the same."""
        groups: dict[tuple[str, bool, float], list[Key]] = {}
        for run in self.model.campaign.runs:
            for name, _ in self.parts(run):
                groups.setdefault((name, run.dynamic, self.noises[run.id, name].declared), []).append((run.id, name))
        return groups

    def _heads(self, keys: Sequence[Key]) -> dict[Key, int]:
        """How many rows of each recording of a group the noise is estimated from."""
        rows = {key: self.model.campaign.run(key[0]).rows for key in keys}
        total = sum(rows.values())
        if total <= NOISE_ROWS:
            return rows
        return {key: min(n, max(TRANSIENT, n * NOISE_ROWS // total)) for key, n in rows.items()}

    def estimate_noises(self, survey: Mapping[Key, Block], values: Array) -> None:
        """Noise per instrument and sampling, shared by all runs that declare the same.

        What the model lacks swells the noise of the residuals, what changes in time that of differences between repeats:
        where both can be had, the smaller one counts. Runs far louder than most do not count: what happened in them is
        no noise.
        """
        for (instrument, _, declared), keys in self._groups().items():
            quiet = quiet_ones({key: survey[key] for key in keys}, self.noises)
            chosen = [survey[key] for key in quiet]
            if INSTRUMENTS[instrument].plain_weights:
                noise = plain_noise(chosen, declared)
            else:
                precision = np.diag(self.prior_precision) + self._elsewhere(survey, values, keys)
                noise = estimate_noise(chosen, declared, precision)
                differences = contrasts({key: survey[key].head for key in quiet}, self.repeats)
                if differences:
                    repeated = estimate_noise(differences, declared, np.diag(self.prior_precision))
                    noise = min(noise, repeated, key=lambda n: n.total)
            for key in keys:
                self.noises[key] = noise

    def _elsewhere(self, survey: Mapping[Key, Block], values: Array, keys: Sequence[Key]) -> Array:
        """Information (k, k) of all recordings but these."""
        others = {key: block for key, block in survey.items() if key not in keys}
        if all(block.whole for block in others.values()):
            return self.information(others).matrix
        return self.information_at(values, others).matrix

    def excess_at(self, values: Array) -> Array:
        """What correlation of the residual adds to the information matrix' variance, for instruments of plain weights.

        Σ over lags l of w_l·(Γ_l + Γ_lᵀ) of the score series u = J·e, Bartlett weights, with the lag window of
        D. W. K. Andrews (1991) for a first-order process; minus JᵀJ, plus ΣuuT (W. Newey & K. West 1987). The series of all
        rows are held.
        """
        size = len(self.model.parameters)
        total = np.zeros((size, size))
        series: dict[Key, list[Array]] = {}
        columns: dict[Key, Indices] = {}
        plain = {key for key in self.noises if INSTRUMENTS[key[1]].plain_weights}
        for key, block, white in self.whitened_at(values, plain):
            if not len(block.columns):  # nothing is free there: no information, and none to be in excess
                continue
            jacobian, residual = white[:, :, :-1], white[:, :, -1]
            series.setdefault(key, []).append(np.einsum("ncj,nc->nj", jacobian, residual))
            flat = jacobian.reshape(residual.size, jacobian.shape[2])
            total[np.ix_(block.columns, block.columns)] -= flat.T @ flat
            columns[key] = block.columns
        for key, parts in series.items():
            total[np.ix_(columns[key], columns[key])] += long_run_variance(np.concatenate(parts))
        return total

    def flag_outliers(self, survey: Mapping[Key, Block], values: Array) -> bool:
        """Mark isolated readings beyond what noise gives and what the same reading showed at other times; True where the set
        changed. They are judged by the fit under the present noise, to which `values` lead by one step; readings at rest that
        repeat each other also by each other, which no mismatch of the model hides."""
        limit = outlier_limit(sum(block.residual.size for block in survey.values()))
        judged = {key: (block, np.broadcast_to(0.0, block.residual.shape)) for key, block in survey.items()}
        if all(block.whole for block in survey.values()):  # of a long recording no reading draws the fit
            apart = one_by_one(*self._refitted(survey, values), self.noises, limit)
            without = {key: replace(block, left_out=apart[key]) for key, block in survey.items()}
            judged = leverage_of(*self._refitted(without, values), self.noises)
        isolated = {key: isolated_outliers(block, self.noises[key], limit, h) for key, (block, h) in judged.items()}
        innovations = {key: table for key, (_, table) in isolated.items()}
        beyond = {
            (key, row, j): float(innovations[key][row, j]) for key, (found, _) in isolated.items() for row, j in found
        }
        static = {k: block.residual for k, (block, _) in judged.items() if not self.model.campaign.run(k[0]).dynamic}
        ways = alike(self.model, list(survey)) if beyond or static else {}
        beyond = {
            (key, row, j): sigmas
            for (key, row, j), sigmas in beyond.items()
            if not repeats_say_so(key, row, j, innovations, ways[key], limit)
        }
        declared = {key: self.noises[key].declared for key in static}
        for key, over in alone_among_repeats(static, ways, declared, OUTLIER_LEVEL).items():
            short = short_groups(np.abs(over) > 0.5)  # what is far off for longer is a mismatch, and so are its ends
            for row, j in np.argwhere(short & (np.abs(over) > 1.0)).tolist():
                beyond.setdefault((key, row, j), float(over[row, j]) * limit)
        places = {(run.id, n): part.start for run in self.model.campaign.runs for n, part in self.parts(run)}
        fresh = {run: mask.copy() for run, mask in self.undetermined.items()}
        outliers: list[Outlier] = []
        for (key, row, j), sigmas in sorted(beyond.items()):
            place = places[key] + j
            fresh[key[0]][row, place] = True
            counted = self.weights[key[0]][row, place] if key[0] in self.weights else 1.0
            residual = float(judged[key][0].residual[row, j] / counted)
            outliers.append(Outlier(key[0], row, self.model.columns(key[0])[place].name, residual, sigmas))
        changed = any(not np.array_equal(fresh[run], self.left_out[run]) for run in fresh)
        for run, mask in fresh.items():
            self.left_out[run] = mask
        self.outliers = outliers
        return changed

    def _refitted(self, survey: Mapping[Key, Block], values: Array) -> tuple[dict[Key, Block], Array]:
        """The residuals one Gauss-Newton step further, under the present noise, and the covariance (k, k) there."""
        information, model = self.information(survey), self.model
        covariance = np.asarray(np.linalg.inv(information.matrix + np.diag(self.prior_precision)))
        step = covariance @ (information.gradient - (values - model.prior_mean) * self.prior_precision)
        lowest, highest = (np.array([getattr(p, side) for p in model.parameters]) for side in ("lower", "upper"))
        step = np.clip(step, lowest - values, highest - values)
        moved = {key: replace(b, residual=b.residual - b.jacobian @ step[b.columns]) for key, b in survey.items()}
        return moved, covariance
