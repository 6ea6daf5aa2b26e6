"""Coarsened posterior: confidence in named effects when the library may be incomplete.

No law is exactly the machine's. If the readings' distribution is only near to what the model says, within a relative entropy that
is exponentially distributed with mean R a reading, the likelihood counts to the power (J. W. Miller & D. B. Dunson 2019)

    ζ = 1/(1 + n·R),   n·R = M/2,

M the energy, in units of the noise, of what is wrong about the best fit though it is no noise: what stays behind it, and what it
adds to runs that are explained better without it. So a name is believed only if what it explains is large beside that.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import ndtr

from symfive.arrays import Array
from symfive.identify import Identification
from symfive.inference import whiten
from symfive.model import Model
from symfive.posterior._evidence import SHARE, LogEvidence, beside, explained, log_evidence
from symfive.posterior._explore import Posterior, Subset, explore, held_by, log_prior
from symfive.posterior._fit import fitted
from symfive.posterior._moments import Moments
from symfive.posterior._noise import NEGLIGIBLE, Node, share_of
from symfive.posterior._noise import SIZES as NOISE
from symfive.posterior._scale import STEPS
from symfive.posterior._terms import UNIDENTIFIED

__all__ = ["coarsened", "contradicted", "misfit"]

SIZES = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
"""1σ of the coefficients of what stays, in units of the unidentified terms' usual one, half a decade apart."""


def coarsened(posterior: Posterior, unnamed: Collection[int] = ()) -> Posterior:
    """The posterior over the same terms by the coarsened likelihood; the same one where all that stays is noise. `unnamed` are
    members (numbers of terms) that are taken for unidentified effects.

    Slow noise of a size that instruments hardly have may be no noise: then it is one more unidentified effect.
    """
    moments = posterior.moments
    held = held_by(moments)
    evidence = log_evidence(moments, held)
    node = moments.nodes[evidence.node]
    energy = misfit(moments, held, unnamed) + contradicted(moments.fit, node, evidence.kappa2)
    nodes = evidence.by_node - np.logaddexp.reduce(evidence.by_node)
    usual = _tempered(posterior, energy, nodes, evidence.kappa2)
    doubt = _no_noise(node)
    if doubt == 0.0:
        return usual
    white = np.where([each.size == 0.0 for each in moments.nodes], moments.log_prior, -np.inf)
    white -= np.logaddexp.reduce(white)
    slow = moments.count * node.size**2
    other = _tempered(posterior, energy + SHARE**2 * slow, white, evidence.kappa2)
    return replace(posterior, mass=_mixed([(usual, 1.0 - doubt), (other, doubt)]))


def _tempered(posterior: Posterior, energy: float, nodes: Array, kappa2: float) -> Posterior:
    """The posterior by the likelihood to the power 1/(1 + `energy`/2), under noise whose nodes are so probable with what the fit
    holds (log)."""
    moments, power = posterior.moments, 1.0 / (1.0 + 0.5 * energy)
    if energy < 2.0 * NEGLIGIBLE:
        return posterior
    held, nothing = held_by(moments), np.zeros_like(nodes)
    own = log_evidence(moments.tempered(power / kappa2, nothing, nothing), held).by_node
    found = explore(moments.tempered(power / kappa2, nodes, 2.0 * own), range(moments.held))

    def tempered(subset: Subset, mass: float) -> float:
        prior = log_prior(moments, subset) - log_prior(moments, held)
        return found.mass[held] + prior + power * (mass - posterior.mass[held] - prior)

    return found.corrected({subset: tempered(subset, mass) for subset, mass in posterior.exact.items()})


def _no_noise(node: Node) -> float:
    """How probable it is that what a node holds is no noise of an instrument: an unidentified effect may have any size."""
    if node.size == 0.0:
        return 0.0
    odds = UNIDENTIFIED / len(NOISE) / share_of(node.size)
    return odds / (1.0 + odds)


def _mixed(parts: Sequence[tuple[Posterior, float]]) -> dict[Subset, float]:
    """Log mass of every subset in a mixture of posteriors."""
    found: dict[Subset, float] = {}
    for part, share in parts:
        total = float(np.logaddexp.reduce(list(part.mass.values())))
        for subset, mass in part.mass.items():
            found[subset] = float(np.logaddexp(found.get(subset, -np.inf), mass - total + np.log(share)))
    return found


def contradicted(after: Identification, node: Node, kappa2: float) -> float:
    """The energy that a fit leaves in runs beyond what the model without its effects, under the same noise, leaves in them: these
    are not what acts there. What chance makes of it is subtracted.

    Where the effects are the truth, a run gains N(-d², 4d²) by them, d² the energy of what they change in it; the positive part
    of that is 2d·φ(d/2) - d²·Φ(-d/2) on average.
    """
    if not after.model.added:
        return 0.0
    plain = fitted(Model(after.model.campaign), [after.named], node, kappa2, after)
    problem, found = plain.problem(), 0.0
    for run in after.model.campaign.runs:
        for name, part in problem.parts(run):
            kept = problem.counts(run)[:, part]
            before, behind = (
                whiten(fit.residuals[run.id][:, part] * kept, plain.noises[run.id, name], run.interval)[0]
                for fit in (plain, after)
            )
            d = float(np.linalg.norm(behind - before))
            chance = d * np.sqrt(2.0 / np.pi) * np.exp(-(d**2) / 8.0) - d**2 * ndtr(-0.5 * d)
            found += max(float(np.sum(behind**2) - np.sum(before**2)), 0.0) - float(chance)
    return max(found, 0.0)


def misfit(moments: Moments, subset: Subset, unnamed: Collection[int] = ()) -> float:
    """M of a subset: what its unidentified members and the `unnamed` ones are wrong by, and what no member explains."""
    evidence = log_evidence(moments, subset)
    open_ = [t in unnamed or moments.terms[t].effect.unidentified for t, _ in subset]
    energies = explained(moments, subset, evidence)
    return SHARE**2 * float(np.dot(energies, open_)) + left_over(moments, subset, evidence)


def left_over(moments: Moments, subset: Subset, plain: LogEvidence) -> float:
    """What all unidentified terms that a subset does not hold would explain together beyond what they find in noise, times the
    probability that they do, from the evidence of each size and of none, prior odds even."""
    taken = {int(column) for number, _ in subset for column in moments.columns[number].where}
    free = [
        c.where for t, c in zip(moments.terms, moments.columns, strict=True) if t.effect.unidentified and t.form.basis
    ]
    columns = np.array(sorted({int(column) for where in free for column in where} - taken), dtype=np.int64)
    if not len(columns):
        return 0.0
    power, slope, left = beside(moments, subset, columns, plain.kappa2)
    power, slope = power[:, None], slope[:, None]
    square, scale = np.square(SIZES)[None, :, None], np.maximum(1.0, left / moments.count)
    kappa2 = np.repeat(scale[:, None, None], len(SIZES), axis=1)
    for step in range(STEPS):
        x = square * slope / (kappa2 + square * power)
        stays = left[:, None] + np.sum(x * (power * x - 2.0 * slope), axis=2)
        if step < STEPS - 1:
            kappa2 = np.maximum(1.0, stays / moments.count)[:, :, None]
    seen, log = square * power / kappa2, moments.count * np.log(kappa2[:, :, 0])
    cost = stays / kappa2[:, :, 0] + np.sum(x * x / square + np.log1p(seen), axis=2) + log
    without = left / scale + moments.count * np.log(scale)
    gains = plain.by_node[:, None] - 0.5 * (cost - without[:, None])
    energy = np.sum(power * x * x / kappa2 - (seen / (1.0 + seen)) ** 2, axis=2)
    gain = float(np.logaddexp.reduce(gains.ravel()) - np.log(len(SIZES))) - plain.total
    return max(float(energy.flat[np.argmax(gains)]), 0.0) / (1.0 + float(np.exp(-gain)))
