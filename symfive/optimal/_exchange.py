"""Designs from a list of candidate rows by Fedorov's exchange (V. V. Fedorov 1972); rows may repeat."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Indices
from symfive.optimal._information import Layout, Task, inverse

WORTH = 1e-6
"""An exchange must lower ψ by more than this."""
LOWER = 1e-9
"""What an exchange of whole set-ups or circles must lower ψ by."""
PASSES = 12
AT_ONCE = 16
"""Candidates about which is asked together."""
Allowed = Callable[[Indices], Sequence[bool]]
"""Whether each of some candidates, by their numbers, may be read."""


@dataclass(frozen=True)
class Candidates:
    """Candidate rows: variables `z` (n, nz), constants `k` (n, 1), the `group` (set-up) of each, sensitivities `rows`."""

    z: Array
    k: Array
    group: Indices
    rows: Array

    def __len__(self) -> int:
        return len(self.z)

    def take(self, chosen: Indices) -> Candidates:
        """Some of them, in that order."""
        return Candidates(self.z[chosen], self.k[chosen], self.group[chosen], self.rows[chosen])

    def joined(self, other: Candidates) -> Candidates:
        """These, then the others."""
        return Candidates(
            *(np.concatenate([getattr(c, n) for c in (self, other)]) for n in ("z", "k", "group", "rows"))
        )


class _State:
    """Covariance of the present design and, for every candidate, what one more reading of it would bring.

    For a determinant the gain of a candidate with rows J is log det(I + J C Jᵀ) less the same over the parameters that do
    not count; for other criteria tr((I + J C Jᵀ)⁻¹ J G Jᵀ), exact for A and V and first order for E and G.
    """

    def __init__(self, task: Task, layout: Layout, whole: Array, information: Array) -> None:
        self.task, self.layout, self.whole = task, layout, whole
        self.information = information
        n, size, ny = whole.shape
        self.flat = np.ascontiguousarray(whole.transpose(0, 2, 1).reshape(n * ny, size))
        self.others = np.setdiff1d(np.arange(size), task.interest)
        self.update()

    def update(self) -> None:
        self.covariance = inverse(self.information)
        self.quadratic = self._forms(self.covariance)
        self.other_covariance = np.zeros((0, 0))
        if self.task.criterion.determinant and self.others.size:
            self.other_covariance = inverse(self.information[np.ix_(self.others, self.others)])
            self.other_flat = np.ascontiguousarray(self.flat[:, self.others])
            self.other_quadratic = self._forms(self.other_covariance, self.other_flat)
        if not self.task.criterion.determinant:
            slope = self.task.criterion.slope(self.task.of_interest(self.covariance))
            self.weight = np.zeros_like(self.covariance)
            self.weight[np.ix_(self.task.interest, self.task.interest)] = slope
            self.weighted = (self.flat @ self.covariance) @ self.weight
            self.pulled = self._forms(self.covariance @ self.weight @ self.covariance)

    def _forms(self, matrix: Array, flat: Array | None = None) -> Array:
        """J M Jᵀ of every candidate (n, ny, ny)."""
        n, _, ny = self.whole.shape
        left = self.flat if flat is None else flat
        right = (left @ matrix).reshape(n, ny, -1)
        return np.asarray(right @ left.reshape(n, ny, -1).transpose(0, 2, 1))

    def gains(self, leaving: int | None = None) -> Array:
        """What each candidate brings (n,), after the candidate `leaving` has been taken out once."""
        if not self.task.criterion.determinant:
            return self._trace_gains(leaving)
        gain = _log_det_plus(self._without(self.covariance, self.flat, self.quadratic, leaving))
        if self.others.size:
            gain -= _log_det_plus(self._without(self.other_covariance, self.other_flat, self.other_quadratic, leaving))
        return gain

    def _without(self, covariance: Array, flat: Array, quadratic: Array, leaving: int | None) -> Array:
        """J C Jᵀ of every candidate after one has left (Sherman, Morrison & Woodbury)."""
        if leaving is None:
            return quadratic
        n, _, ny = self.whole.shape
        row = flat[leaving * ny : (leaving + 1) * ny]
        cross = (flat @ (covariance @ row.T)).reshape(n, ny, ny)
        back = np.linalg.inv(np.eye(ny) - quadratic[leaving])
        return np.asarray(quadratic + (cross.reshape(-1, ny) @ back).reshape(n, ny, ny) @ cross.transpose(0, 2, 1))

    def _trace_gains(self, leaving: int | None) -> Array:
        n, _, ny = self.whole.shape
        quadratic, pulled = self.quadratic, self.pulled
        if leaving is not None:
            row = self.flat[leaving * ny : (leaving + 1) * ny]
            seen = row @ self.covariance
            back = np.linalg.inv(np.eye(ny) - quadratic[leaving]) @ seen
            cross = (self.flat @ seen.T).reshape(n, ny, ny)
            mixed = cross @ (self.weighted @ back.T).reshape(n, ny, ny).transpose(0, 2, 1)
            pulled = pulled + mixed + mixed.transpose(0, 2, 1)
            pulled = pulled + (cross @ (back @ self.weight @ back.T)) @ cross.transpose(0, 2, 1)
            quadratic = self._without(self.covariance, self.flat, self.quadratic, leaving)
        inside = np.linalg.inv(np.eye(ny) + quadratic)
        return np.asarray(np.einsum("nab,nba->n", inside, pulled))


def _log_det_plus(forms: Array) -> Array:
    """log det(I + Q) of many small matrices."""
    ny = forms.shape[1]
    if ny == 1:
        return np.asarray(np.log1p(forms[:, 0, 0]))
    if ny == 3:
        a, b, c = forms[:, 0, 0] + 1.0, forms[:, 1, 1] + 1.0, forms[:, 2, 2] + 1.0
        d, e, f = forms[:, 0, 1], forms[:, 1, 2], forms[:, 0, 2]
        return np.asarray(np.log(np.maximum(a * (b * c - e * e) - d * (d * c - e * f) + f * (d * e - b * f), 1e-300)))
    return np.asarray(np.linalg.slogdet(np.eye(ny) + forms)[1])


def _state(task: Task, candidates: Candidates, groups: int, chosen: Indices) -> _State:
    layout = task.layout(groups)
    whole = layout.embed(candidates.rows, candidates.group)
    taken = whole[chosen].transpose(1, 0, 2).reshape(layout.size, -1)
    return _State(task, layout, whole, task.prior_information(groups) + taken @ taken.T)


def exchange(
    task: Task, candidates: Candidates, groups: int, chosen: Indices, passes: int = PASSES, allowed: Allowed | None = None
) -> Indices:  # fmt: skip
    """Each row in turn is replaced by the candidate that lowers ψ most, until a whole pass changes nothing.

    Of candidates that are not `allowed` none enters, and those that are chosen leave for the best that is, if there is one.
    """
    chosen, asked = chosen.copy(), _Asked(allowed, chosen)
    state = _state(task, candidates, groups, chosen)
    value = task.value(state.information)
    for _ in range(passes):
        settled = True
        for place in sorted(range(len(chosen)), key=lambda i: not asked.refused(int(chosen[i]))):
            gains, here = state.gains(int(chosen[place])), int(chosen[place])
            refused = asked.refused(here)
            best = asked.best(gains, -np.inf if refused else gains[here] * (1.0 + WORTH))
            if best is None:
                continue
            entering, leaving = state.whole[best], state.whole[here]
            trial = state.information + entering @ entering.T - leaving @ leaving.T
            if (reached := task.value(trial)) < value - WORTH or refused:
                value, state.information, settled = reached, trial, False
                chosen[place] = best
                state.update()
        if settled:
            break
    return chosen


class _Asked:
    """What is known of which candidates are allowed: all of them where nobody is to be asked."""

    def __init__(self, allowed: Allowed | None, chosen: Indices) -> None:
        self.allowed = allowed
        self._known: dict[int, bool] = {}
        if allowed is not None:
            self._ask(np.unique(chosen))

    def refused(self, candidate: int) -> bool:
        """Whether a candidate that was asked about is not allowed."""
        return not self._known.get(candidate, True)

    def best(self, gains: Array, least: float) -> int | None:
        """The allowed candidate with the largest of the gains (n,), if that is above `least`."""
        if self.allowed is not None:
            gains = gains.copy()
            gains[[i for i, good in self._known.items() if not good]] = -np.inf
        while gains[best := int(np.argmax(gains))] > least:
            if self.allowed is None or self._known.get(best):
                return best
            if best not in self._known:
                ranked = np.argsort(gains)[::-1][:AT_ONCE]
                self._ask(np.array([i for i in ranked if i not in self._known and gains[i] > least]))
            gains[[i for i, good in self._known.items() if not good]] = -np.inf
        return None

    def _ask(self, some: Indices) -> None:
        assert self.allowed is not None
        self._known |= dict(zip(some.tolist(), map(bool, self.allowed(some)), strict=True))


def exchanged_options(count: int, values: Callable[[list[int], int], Sequence[float]]) -> tuple[float, list[int]]:
    """One option for each of `count` places, greedily and then by exchange until nothing lowers ψ: ψ and the options.

    `values` is ψ with each option at a place, beside those chosen for the others.
    """
    chosen: list[int] = []
    value, improved = math.inf, True
    while improved:
        improved = False
        for place in range(count):
            reached = values(chosen[:place] + chosen[place + 1 :], place)
            best = int(np.argmin(reached))
            if place == len(chosen) or reached[best] < value - LOWER:
                chosen[place : place + 1] = [best]
                value, improved = reached[best], True
    return value, chosen
