"""Score tests of the whole catalogue from exact tangents, orthogonal to everything that is fitted.

With the whitened residual r, the Jacobian J of all fitted parameters (priors P, departure δ from their means) and the
tangents G of one effect,

    A = JᵀJ + P⁻¹,   H = GᵀG - GᵀJ A⁻¹ JᵀG,   s = Gᵀr - GᵀJ A⁻¹ (Jᵀr - P⁻¹δ),   Δ = sᵀ (H + Q⁻¹)⁻¹ s

is the drop of the cost if the effect joins (C. R. Rao 1948; orthogonalised: J. Neyman 1959), without a refit.
H/GᵀG is the share of the effect that the campaign can see at all; what is missing is swallowed by J.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln
from scipy.stats import chi2

from symfive.effects import Effect
from symfive.identify import Identification
from symfive.inference import whiten
from symfive.model import Model

__all__ = ["Board", "Score", "Secant", "log_tail", "score_catalogue"]

Array = NDArray[np.float64]
REACH = 3.0


@dataclass(frozen=True)
class Score:
    """One effect against the residual.

    `drop` of the cost, effective `dof`, `log_p` natural log of its p-value before any correction, `visible` share (0..1)
    of its energy that the fit leaves, `size` in σ of a typical effect, `step` the parameters the score suggests (file
    units, by name), `looks` places at which a scan looked for it.
    """

    effect: Effect
    drop: float
    dof: float
    log_p: float
    visible: float
    size: float
    step: Mapping[str, float]
    looks: int = 1

    @classmethod
    def unscored(cls, effect: Effect, step: Mapping[str, float], looks: int) -> Score:
        """A candidate that needs no score to be tried."""
        return cls(effect, np.inf, 1.0, -np.inf, 1.0, 1.0, step, looks)


@dataclass(frozen=True, eq=False)
class Secant:
    """An effect at a finite size, `levels` by parameter: what it adds to the readings, id → (N, ny)."""

    effect: Effect
    levels: Mapping[str, float]
    adds: Mapping[str, Array] = field(repr=False)


@dataclass
class Board:
    """The whitened system of one fit: Gram matrix of [fitted | shapes | candidates | residual | secants], and who is where;
    `gradient` of the fitted ones and the shapes, their priors' pull included (0 at the fit but for shapes)."""

    result: Identification
    model: Model
    gram: Array
    base: NDArray[np.int64]
    prior: Array
    gradient: Array
    effects: Sequence[Effect]
    tangents: dict[str, Array] = field(default_factory=dict)
    residual_index: int = -1
    secants: Sequence[Secant] = ()

    def columns_of(self, effect: Effect) -> NDArray[np.int64]:
        """Columns of an effect's parameters."""
        names = [p.name for p in effect.parameters(self.model.campaign)]
        return np.array([self.model.index[n] for n in names], dtype=np.int64)

    def score(self, effect: Effect) -> Score:
        """The score test of one effect."""
        return self.scores(effect, (1.0,))[0]

    def scores(self, effect: Effect, times: Sequence[float]) -> list[Score]:
        """The score tests of an effect with a prior so many times as wide as its own."""
        h, s, full = self.reduced(self.columns_of(effect))
        return [self._scored(replace(effect, spread=wide * effect.spread), h, s, full) for wide in times]

    def _scored(self, effect: Effect, h: Array, s: Array, full: Array) -> Score:
        parameters = effect.parameters(self.model.campaign)
        sigma = np.array([p.sigma for p in parameters])
        scaled_h, scaled_s = h * np.outer(sigma, sigma), s * sigma
        solution = np.linalg.solve(scaled_h + np.eye(len(sigma)), scaled_s)
        drop = float(scaled_s @ solution)
        seen = np.linalg.eigvalsh(scaled_h)
        dof = float(np.sum(np.maximum(seen, 0.0) / (1.0 + np.maximum(seen, 0.0))))
        energy = float(np.trace(full * np.outer(sigma, sigma)))
        left = float(np.trace(scaled_h))
        step = {p.name: float(x) for p, x in zip(parameters, solution * sigma, strict=True)}
        log_p = log_tail(drop, max(dof, 0.5))
        return Score(
            effect,
            drop,
            dof,
            log_p,
            max(left, 0.0) / energy if energy > 0 else 0.0,
            float(np.sqrt(max(left, 0.0))),
            step,
        )

    def score_secant(self, secant: Secant) -> Score:
        """The score of an effect at a finite size: how far the readings go towards it, between a third of the way and three
        times as far."""
        column = np.array([self.residual_index + 1 + self.secants.index(secant)])
        h, s, full = (float(part.item()) for part in self.reduced(column))
        sigma = {p.name: p.sigma for p in secant.effect.parameters(self.model.campaign)}
        usual = min(sigma[name] / abs(level) for name, level in secant.levels.items())
        far = s / (h + usual**-2)
        drop = s * far if far > 0.0 else 0.0
        step = {name: float(np.clip(far, 1.0 / REACH, REACH)) * level for name, level in secant.levels.items()}
        h = max(h, 0.0)
        visible = h / full if full > 0.0 else 0.0
        return Score(secant.effect, drop, 1.0, log_tail(drop, 1.0), visible, h**0.5 * usual, step)

    def reduced(self, columns: NDArray[np.int64]) -> tuple[Array, Array, Array]:
        """(H, s, GᵀG) of some columns."""
        a = self.gram[np.ix_(self.base, self.base)] + np.diag(self.prior)
        cross = self.gram[np.ix_(self.base, columns)]
        full = self.gram[np.ix_(columns, columns)]
        solved = np.linalg.solve(a, np.column_stack([cross, self.gradient]))
        return full - cross.T @ solved[:, :-1], self.gram[columns, self.residual_index] - cross.T @ solved[:, -1], full

    def cosine(self, first: Effect, second: Effect) -> float:
        """Largest canonical correlation of two effects' visible parts: 1 means that they cannot be told apart."""
        one, two = self.columns_of(first), self.columns_of(second)
        h, _, _ = self.reduced(np.concatenate([one, two]))
        k = len(one)
        return _canonical(h[:k, :k], h[k:, k:], h[:k, k:])


def log_tail(drop: float, dof: float) -> float:
    """log P(χ² > drop); far out by its leading term (M. Abramowitz & I. Stegun 1964, 26.4.12), where it is below the least
    number that is not 0."""
    exact = float(chi2.logsf(drop, dof))
    if np.isfinite(exact):
        return exact
    return float((0.5 * dof - 1.0) * np.log(0.5 * drop) - 0.5 * drop - gammaln(0.5 * dof))


def _canonical(a: Array, b: Array, cross: Array) -> float:
    def root(matrix: Array) -> Array:
        values, vectors = np.linalg.eigh(matrix)
        keep = values > 1e-9 * max(values.max(), 1e-300)
        return np.asarray(vectors[:, keep] / np.sqrt(values[keep]))

    left, right = root(a), root(b)
    if not left.size or not right.size:
        return 0.0
    return float(np.linalg.svd(left.T @ cross @ right, compute_uv=False).max(initial=0.0))


def score_catalogue(
    result: Identification,
    effects: Sequence[Effect],
    shapes: Sequence[Effect] = (),
    probes: Sequence[Effect] = (),
    secants: Sequence[Secant] = (),
) -> Board:
    """Tangents of all `effects` (and `probes`) in one linearisation, and `secants`, whitened and gathered.

    `shapes` join the fit at zero with their priors: what they can explain does not count for any effect.
    """
    fitted = result.model
    model = Model(fitted.campaign, [*fitted.added, *shapes, *effects, *probes])
    values = model.vector(result.named)
    size = len(model.parameters)
    gram = np.zeros((size + 1 + len(secants), size + 1 + len(secants)))
    problem = result.problem()
    tangents: dict[str, Array] = {}
    probe_columns = [model.index[p.name] for probe in probes for p in probe.parameters(model.campaign)]
    blocks = problem.blocks(result.values)
    for run in fitted.campaign.runs:
        line = model.linearise(run, values)
        if probe_columns:
            place = {int(c): i for i, c in enumerate(line.columns)}
            tangents[run.id] = np.stack([line.jacobian[:, :, place[c]] for c in probe_columns], axis=2)
        where = np.concatenate([line.columns, np.arange(size, len(gram))])
        for name, part in problem.parts(run):
            block = blocks[run.id, name]
            added = [secant.adds[run.id][:, part, None] for secant in secants]
            stacked = np.concatenate([line.jacobian[:, part], block.residual[:, :, None], *added], axis=2)
            table = np.where(block.left_out[:, :, None], 0.0, stacked)
            white, _ = whiten(table, result.noises[run.id, name], block.interval)
            flat = white.reshape(-1, white.shape[2])
            gram[np.ix_(where, where)] += flat.T @ flat
    shape_names = [p.name for shape in shapes for p in shape.parameters(fitted.campaign)]
    names = [*(p.name for p in fitted.parameters), *shape_names]
    base = np.array([model.index[name] for name in names], dtype=np.int64)
    prior = model.prior_sigma[base] ** -2.0
    gradient = gram[base, size] - prior * (values - model.prior_mean)[base]
    return Board(result, model, gram, base, prior, gradient, effects, tangents, size, secants)
