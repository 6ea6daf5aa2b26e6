"""What all scans need: per run the channels' columns and the whitened residual."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run
from symfive.diagnose._catalogue import AxisOffset, ToolShift, moving_axes
from symfive.diagnose._scores import Board
from symfive.effects import Effect
from symfive.inference import whiten
from symfive.model import Linearisation

__all__ = ["Channels", "Finding", "peaks", "probes"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Finding:
    """A peak of a scan: the exact effect, and how many independent places were looked at."""

    effect: Effect
    looks: int


def probes(campaign: Campaign) -> list[Effect]:
    """The channels: the tool's three directions and every moving axis."""
    return [ToolShift(), *(AxisOffset(axis=name) for name in moving_axes(campaign))]


class Channels:
    """Per run: the channels' columns, and the residual whitened twice."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self.problem = board.result.problem()
        self.campaign = board.model.campaign
        self.axes = moving_axes(self.campaign)
        self.twice: dict[str, Array] = {}
        self.power: dict[str, Array] = {}
        self.residuals: dict[str, Array] = {}
        self._lines: dict[str, tuple[Linearisation, Array]] = {}
        for run in self.campaign.runs:
            residual = self._kept(run, np.asarray(board.result.residuals[run.id]))
            self.residuals[run.id] = residual
            self.twice[run.id] = self._kept(run, self._white(run, self._white(run, residual)[::-1])[::-1])
            self.power[run.id] = np.sum(self._white(run, self._kept(run, board.tangents[run.id])) ** 2, axis=1)

    def _kept(self, run: Run, table: Array) -> Array:
        """A table (N, ny, …) with what the fit leaves out as outliers at zero: it carries no information."""
        left_out = self.problem.left_out[run.id]
        return np.where(left_out.reshape(*left_out.shape, *(1,) * (table.ndim - 2)), 0.0, table)

    def _white(self, run: Run, table: Array) -> Array:
        """Each instrument's columns (N, ny, …) whitened by its own noise; columns that are not fitted are zero."""
        white = np.zeros_like(table)
        for name, part in self.problem.parts(run):
            white[:, part] = whiten(table[:, part], self.board.result.noises[run.id, name], run.interval)[0]
        return white

    def answer(self, run: Run, index: int) -> Array:
        """g·ρ summed over the columns (N,), for the channel at `index`."""
        return np.asarray(np.einsum("nc,nc->n", self.board.tangents[run.id][:, :, index], self.twice[run.id]))

    def shift_scores(self, run: Run, courses: Array) -> Array:
        """Score of a shift of the artefact on the table that takes each of `courses` (N, K) along the run, orthogonal to what
        the run fits itself."""
        model = self.board.result.model
        line, fitted = self._fitted(run)
        names = [model.parameters[c].name.removeprefix(f"setup.{run.id}.") for c in line.columns]
        artefact = [i for i, name in enumerate(names) if name.startswith(("table_ball.", "zero."))]
        if not artefact:
            return np.zeros(courses.shape[1])
        residual = self._flat(run, np.asarray(self.board.result.residuals[run.id])[:, :, None])[:, 0]
        sigma = model.prior_sigma[line.columns]
        normal = fitted.T @ fitted + np.diag(sigma**-2.0)
        tangents = line.jacobian[:, :, artefact]
        count = len(artefact)
        moved = np.einsum("ncd,nk->nckd", tangents, courses).reshape(*tangents.shape[:2], -1)
        columns = self._flat(run, moved)
        cross = fitted.T @ columns
        solved = np.linalg.solve(normal, np.column_stack([cross, fitted.T @ residual]))
        answer = (columns.T @ residual - cross.T @ solved[:, -1]).reshape(-1, count)
        scores = np.zeros(courses.shape[1])
        for k in range(len(scores)):
            part = slice(count * k, count * (k + 1))
            h = columns[:, part].T @ columns[:, part] - cross[:, part].T @ solved[:, part]
            # tangents are per µm; a prior of 10 µm keeps unseen directions out
            scores[k] = answer[k] @ np.linalg.solve(h + 1e-2 * np.eye(count), answer[k])
        return scores

    def axis_scores(self, axis: str, courses: Mapping[str, Array]) -> Array:
        """Score of an error of an axis that takes each of `courses`, run → (N, K), orthogonal to all that is fitted."""
        return self._course_scores([self.axis_index(axis)], courses)

    def tool_scores(self, courses: Mapping[str, Array]) -> Array:
        """The same of a shift of the tool in any direction; `courses` (N, K, M) may have M parts."""
        return self._course_scores([0, 1, 2], courses)

    def _course_scores(self, channels: Sequence[int], courses: Mapping[str, Array]) -> Array:
        """Score of something that takes each of `courses` in all `channels`, each with its own factor, also of each part; in runs
        that these leave out it does not act."""
        parts = {id: course.reshape(*course.shape[:2], -1) for id, course in courses.items()}
        count, ways = next(iter(parts.values())).shape[1:]
        size, wide = len(self.board.result.model.parameters), len(channels) * ways
        base = self.board.base[:size]
        normal = self.board.gram[np.ix_(base, base)] + np.diag(self.board.prior[:size])
        cross, own, answer = np.zeros((size, count * wide)), np.zeros((count, wide, wide)), np.zeros(count * wide)
        for run in (self.campaign.run(id) for id in parts):
            tangents = self.board.tangents[run.id][:, :, channels]
            moved = np.einsum("ncd,nkm->nckdm", tangents, parts[run.id]).reshape(*tangents.shape[:2], -1)
            columns, (line, fitted) = self._flat(run, moved), self._fitted(run)
            residual = self._flat(run, self.residuals[run.id][:, :, None])[:, 0]
            cross[line.columns] += fitted.T @ columns
            each = columns.reshape(-1, count, wide)
            own += np.einsum("nkd,nke->kde", each, each)
            answer += columns.T @ residual
        solved = np.linalg.solve(normal, cross)
        taken = np.einsum("pkd,pke->kde", cross.reshape(size, count, wide), solved.reshape(size, count, wide))
        slope = (answer - self.board.gradient[:size] @ solved).reshape(count, wide)
        power, axes = np.linalg.eigh(own - taken)
        along = np.einsum("kde,kd->ke", axes, slope)
        # tangents are per µm; a prior of 10 µm keeps unseen directions out
        return np.asarray(np.sum(along**2 / (np.maximum(power, 0.0) + 1e-2), axis=1))

    def _fitted(self, run: Run) -> tuple[Linearisation, Array]:
        """A run's derivatives by what is fitted, and the same whitened."""
        if run.id not in self._lines:
            line = self.board.result.model.linearise(run, self.board.result.values)
            self._lines[run.id] = line, self._flat(run, line.jacobian)
        return self._lines[run.id]

    def _flat(self, run: Run, table: Array) -> Array:
        """Columns (N, ny, m) without the outliers, whitened, as (N·ny, m)."""
        return self._white(run, self._kept(run, table)).reshape(-1, table.shape[2])

    def energy(self, run: Run) -> tuple[Array, int]:
        """Square of the whitened residual, summed over the columns that are fitted (N,), and how many these are."""
        white = self._white(run, np.asarray(self.residuals[run.id]))
        columns = sum(part.stop - part.start for _, part in self.problem.parts(run))
        return np.asarray(np.sum(white**2, axis=1)), columns

    def axis_index(self, axis: str) -> int:
        """Where an axis' channel stands."""
        return 3 + self.axes.index(axis)


def peaks(score: Array, count: int) -> list[int]:
    """Highest local maxima."""
    inner = np.flatnonzero((score >= np.roll(score, 1)) & (score >= np.roll(score, -1)))
    return [int(i) for i in inner[np.argsort(-score[inner])][:count]]
