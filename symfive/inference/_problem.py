"""The estimation problem of a campaign: whitened residuals, information and gradient, run by run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from symfive.campaign import Run
from symfive.inference._noise import Block, Noise, estimate_noise, long_run_variance, plain_noise, whiten
from symfive.instruments import INSTRUMENTS, instruments_of
from symfive.model import Model

__all__ = ["Information", "Outlier", "Problem"]

Array = NDArray[np.float64]
OUTLIER_LEVEL = 0.01
SHORT = 100
LOUD = 2.0
"""An instrument's noise does not differ from run to run by more than this factor."""
LONGEST_OUTLIER = 3
RESPONSE_ROWS = 200


@dataclass(frozen=True)
class Outlier:
    """A reading that the noise cannot explain: run, row (from 0), column, residual in the column's unit, in σ."""

    run: str
    row: int
    column: str
    residual: float
    sigmas: float


@dataclass(frozen=True)
class Information:
    """Of the data, without the priors: `matrix` (k, k), `gradient` (k,) towards the readings, `square` Σ of whitened
    residuals squared, `count` readings that entered."""

    matrix: Array
    gradient: Array
    square: float
    count: int


@dataclass
class Problem:
    """Readings, priors and noise of a model. `free` marks the parameters that may move; `noises` by (run, instrument);
    `repeats` groups of runs whose differences may show the noise."""

    model: Model
    free: NDArray[np.bool_]
    noises: dict[tuple[str, str], Noise] = field(default_factory=dict)
    left_out: dict[str, NDArray[np.bool_]] = field(default_factory=dict)
    outliers: list[Outlier] = field(default_factory=list)
    repeats: tuple[tuple[str, ...], ...] = ()

    @classmethod
    def of(
        cls, model: Model, free: NDArray[np.bool_] | None = None, noises: Mapping[tuple[str, str], Noise] | None = None
    ) -> Problem:
        """The problem with declared white noise and no outliers."""
        problem = cls(model, np.ones(len(model.parameters), dtype=bool) if free is None else free)
        for run in model.campaign.runs:
            for instrument in instruments_of(run):
                declared = run.noise(instrument.name)
                problem.noises[run.id, instrument.name] = Noise(declared, declared=declared)
            problem.left_out[run.id] = np.zeros((run.rows, len(model.columns(run))), dtype=bool)
        problem.noises.update(noises or {})
        return problem

    @property
    def prior_precision(self) -> Array:
        """Diagonal of the prior's information (k,)."""
        return np.asarray(self.model.prior_sigma**-2.0)

    def parts(self, run: Run) -> list[tuple[str, slice]]:
        """The instruments of a run whose readings are fitted, each with its columns."""
        found, first = [], 0
        for instrument in instruments_of(run):
            count = len(instrument.columns(run, self.model.machine))
            part = slice(first, first + count)
            first += count
            taken = instrument.name == "encoder" and run.options.get("motion_from") == "encoder"
            if not taken:  # else the recording is the motion itself
                found.append((instrument.name, part))
        return found

    def blocks(self, values: Array, *, readings: bool = True) -> dict[tuple[str, str], Block]:
        """Residuals and sensitivities of every run and instrument at `values`."""
        found: dict[tuple[str, str], Block] = {}
        for run in self.model.campaign.runs:
            line = self.model.linearise(run, values)
            residual = self.model.readings(run) - line.prediction if readings else np.zeros_like(line.prediction)
            used = self.free[line.columns]
            jacobian, columns = line.jacobian if used.all() else line.jacobian[:, :, used], line.columns[used]
            interval = float(np.median(np.diff(run.time))) if run.rows > 1 else 1.0
            for name, part in self.parts(run):
                found[run.id, name] = Block(
                    residual[:, part], jacobian[:, part], columns, interval, self.left_out[run.id][:, part]
                )
        return found

    def information(self, blocks: Mapping[tuple[str, str], Block]) -> Information:
        """Sum over the blocks, each whitened by its own noise."""
        size = len(self.model.parameters)
        gram = np.zeros((size + 1, size + 1))
        count = 0
        for key, block in blocks.items():
            white, _ = whiten(block.stacked(), self.noises[key], block.interval)
            flat = white.reshape(-1, white.shape[2])
            where = np.append(block.columns, size)
            gram[np.ix_(where, where)] += flat.T @ flat
            count += block.kept
        return Information(gram[:size, :size], gram[:size, size], float(gram[size, size]), count)

    def estimate_noises(self, blocks: Mapping[tuple[str, str], Block]) -> None:
        """Noise per instrument and sampling, shared by all runs that declare the same.

        What the model lacks swells the noise of the residuals, what changes in time that of differences between repeats:
        where both can be had, the smaller one counts. Runs far louder than most do not count: what happened in them is
        no noise.
        """
        groups: dict[tuple[str, bool, float], list[tuple[str, str]]] = {}
        for run, instrument in blocks:
            data = self.model.campaign.run(run)
            groups.setdefault((instrument, data.dynamic, self.noises[run, instrument].declared), []).append(
                (run, instrument)
            )
        for (_, _, declared), keys in groups.items():
            others = {key: block for key, block in blocks.items() if key not in keys}
            quiet = self._quiet({key: blocks[key] for key in keys})
            chosen = [blocks[key] for key in quiet]
            if INSTRUMENTS[keys[0][1]].plain_weights:
                noise = plain_noise(chosen, declared)
            else:
                precision = np.diag(self.prior_precision) + self.information(others).matrix
                noise = estimate_noise(chosen, declared, precision)
                differences = self._differences({key: blocks[key] for key in quiet})
                if differences:
                    repeated = estimate_noise(differences, declared, np.diag(self.prior_precision))
                    noise = min(noise, repeated, key=lambda n: n.total)
            for key in keys:
                self.noises[key] = noise

    def _quiet(self, blocks: Mapping[tuple[str, str], Block]) -> list[tuple[str, str]]:
        """Recordings that are no more than `LOUD` times as loud, once whitened, as their median, or too short to tell. The
        largest tenth of a recording's readings does not count: these may be outliers."""
        powers = {}
        for key, block in blocks.items():
            white, _ = whiten(np.where(block.left_out, 0.0, block.residual), self.noises[key], block.interval)
            squares = np.sort(white[~block.left_out] ** 2)
            powers[key] = float(np.mean(squares[: max(1, int(0.9 * len(squares)))])) if len(squares) else 0.0
        limit = LOUD**2 * float(np.median(list(powers.values())))
        return [key for key, power in powers.items() if power <= limit or len(blocks[key].residual) < SHORT]

    def _differences(self, blocks: Mapping[tuple[str, str], Block]) -> list[Block]:
        """Orthonormal contrasts of repeated runs: what the model lacks and both share cancels."""
        found = []
        for group in self.repeats:
            for name in {instrument for _, instrument in blocks}:
                members = [blocks[run, name] for run in group if (run, name) in blocks]
                for count in range(1, len(members)):
                    weights = np.array([1.0] * count + [-float(count)]) / np.sqrt(count * (count + 1.0))
                    found.append(_contrast(members[: count + 1], weights))
        return found

    def excess(self, blocks: Mapping[tuple[str, str], Block]) -> Array:
        """What correlation of the residual adds to the information matrix' variance, for instruments of plain weights.

        Σ over lags l of w_l·(Γ_l + Γ_lᵀ) of the score series u = J·e, Bartlett weights, with the lag window of
        D. W. K. Andrews (1991) for a first-order process; minus JᵀJ, plus ΣuuT (W. Newey & K. West 1987).
        """
        size = len(self.model.parameters)
        total = np.zeros((size, size))
        for key, block in blocks.items():
            if INSTRUMENTS[key[1]].plain_weights:
                white, _ = whiten(block.stacked(), self.noises[key], block.interval)
                jacobian, residual = white[:, :, :-1], white[:, :, -1]
                scores = np.einsum("ncj,nc->nj", jacobian, residual)
                flat = jacobian.reshape(-1, jacobian.shape[2])
                total[np.ix_(block.columns, block.columns)] += long_run_variance(scores) - flat.T @ flat
        return total

    def flag_outliers(self, blocks: Mapping[tuple[str, str], Block]) -> bool:
        """Mark isolated readings beyond what noise gives once in 1/OUTLIER_LEVEL campaigns; True where the set changed.

        More than a few neighbouring rows, or a level that stays, are no outlier but a mismatch, and count.
        """
        total = sum(block.residual.size for block in blocks.values())
        limit = float(norm.isf(0.5 * OUTLIER_LEVEL / max(total, 1)))
        fresh: dict[str, NDArray[np.bool_]] = {run: np.zeros_like(mask) for run, mask in self.left_out.items()}
        found: list[Outlier] = []
        places = {(run.id, n): part.start for run in self.model.campaign.runs for n, part in self.parts(run)}
        for (run, name), block in blocks.items():
            first = places[run, name]
            table, _ = whiten(block.residual, self.noises[run, name], block.interval)
            response = _response(self.noises[run, name], block.interval)
            for j in range(block.residual.shape[1]):
                for rows in _isolated(np.flatnonzero(np.abs(table[:, j]) > limit)):
                    if not _returns(table[rows[0] :, j], response):
                        continue
                    worst = max(rows, key=lambda r: abs(block.residual[r, j]))
                    fresh[run][worst, first + j] = True
                    column = self.model.columns(run)[first + j].name
                    sigmas = float(table[worst, j])
                    found.append(Outlier(run, int(worst), column, float(block.residual[worst, j]), sigmas))
        changed = any(not np.array_equal(fresh[run], self.left_out[run]) for run in fresh)
        for run, mask in fresh.items():
            self.left_out[run] = mask
        self.outliers = found
        return changed


def _contrast(blocks: Sequence[Block], weights: Array) -> Block:
    """The weighted sum of blocks with one shape, over the columns of all of them."""
    columns = np.unique(np.concatenate([b.columns for b in blocks]))
    residual = np.asarray(sum(w * b.residual for w, b in zip(weights, blocks, strict=True)))
    jacobian = np.zeros((*residual.shape, len(columns)))
    for w, b in zip(weights, blocks, strict=True):
        jacobian[:, :, np.searchsorted(columns, b.columns)] += w * b.jacobian
    left_out = np.any([b.left_out for b in blocks], axis=0)
    return Block(residual, jacobian, columns, blocks[0].interval, left_out)


def _response(noise: Noise, interval: float) -> Array:
    """Innovations that a disturbance of one reading causes, long after the start of a run."""
    impulse = np.zeros((2 * RESPONSE_ROWS, 1))
    impulse[RESPONSE_ROWS] = 1.0
    return whiten(impulse, noise, interval)[0][RESPONSE_ROWS:, 0]


def _returns(innovations: Array, response: Array) -> bool:
    """Whether a disturbance is one of a single reading and not a new level, by the larger of both likelihood ratios
    (I. Chang, G. Tiao & C. Chen 1988)."""
    count = min(len(innovations), len(response))
    single, level = response[:count], np.cumsum(response[:count])
    part = innovations[:count]
    return bool(abs(part @ single) / np.linalg.norm(single) >= abs(part @ level) / np.linalg.norm(level))


def _isolated(rows: NDArray[np.int64]) -> list[list[int]]:
    """Groups of neighbouring rows short enough to be an outlier (an outlier also disturbs the innovation after it)."""
    groups: list[list[int]] = []
    for row in rows.tolist():
        if groups and row - groups[-1][-1] <= 1:
            groups[-1].append(row)
        else:
            groups.append([row])
    return [group for group in groups if len(group) <= LONGEST_OUTLIER]
