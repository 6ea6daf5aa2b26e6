"""What all scans need: per run the channels' columns and the whitened residual."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run
from symfive.diagnose._catalogue import AxisOffset, ToolShift, moving_axes
from symfive.diagnose._scores import Board
from symfive.effects import Effect
from symfive.inference import Problem, whiten

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
        self.problem = Problem.of(board.result.model)
        self.campaign = board.model.campaign
        self.axes = moving_axes(self.campaign)
        self.twice: dict[str, Array] = {}
        self.power: dict[str, Array] = {}
        self.residuals: dict[str, Array] = {}
        for run in self.campaign.runs:
            residual = np.asarray(board.result.residuals[run.id])
            for outlier in board.result.outliers:
                if outlier.run == run.id:
                    names = [c.name for c in board.result.model.columns(run)]
                    residual = residual.copy()
                    residual[outlier.row, names.index(outlier.column)] = 0.0
            self.residuals[run.id] = residual
            self.twice[run.id] = self._white(run, self._white(run, residual)[::-1])[::-1]
            self.power[run.id] = np.sum(self._white(run, board.tangents[run.id]) ** 2, axis=1)

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
        line = model.linearise(run, self.board.result.values)
        names = [model.parameters[c].name.removeprefix(f"setup.{run.id}.") for c in line.columns]
        artefact = [i for i, name in enumerate(names) if name.startswith(("table_ball.", "zero."))]
        if not artefact:
            return np.zeros(courses.shape[1])
        size = line.jacobian.shape[0] * line.jacobian.shape[1]

        def white(table: Array) -> Array:
            return self._white(run, table).reshape(size, -1)

        fitted = white(line.jacobian)
        residual = white(np.asarray(self.board.result.residuals[run.id])[:, :, None])[:, 0]
        sigma = self.board.result.model.prior_sigma[line.columns]
        normal = fitted.T @ fitted + np.diag(sigma**-2.0)
        tangents = line.jacobian[:, :, artefact]
        count = len(artefact)
        columns = white(np.einsum("ncd,nk->nckd", tangents, courses).reshape(*tangents.shape[:2], -1))
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
