"""ψ of a relaxed design that knows how many readings there are: of D, where these are fewer than the parameters that count.

N readings add information of rank r ≤ N about s parameters. Weights on many poses do not keep to that, and the bound of their
best design is far too low where r < s. In parameters of prior covariance I, with λ the eigenvalues of the information X added,
largest first,

    s ψ = -Σ log(1 + λ_i),    s ψ_r = -Σ_{i ≤ h} log(1 + λ_i) - (r - h) log(1 + m),

m the sum of all λ behind the first h over r - h, and h the one number with λ_h > m ≥ λ_{h+1}. ψ_r is convex, and equals ψ where
X has at most the rank r (after A. Nikolov 2015 and Y. Li & W. Xie 2020, here with a prior). So with G = -dψ_r/dM every plan of N
readings has ψ(M*) ≥ ψ_r(M) + ⟨G, M⟩ - ⟨G, M*⟩.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Indices
from symfive.optimal._information import Task, inverse


@dataclass(frozen=True)
class LimitedRank:
    """ψ_r at one information matrix: `value`, G = `half` diag(`gains`) `half`ᵀ/s, `held` ⟨G, M⟩; `head` h, `behind` r - h, and
    `others` the indices and the inverse information of what does not count."""

    value: float
    held: float
    half: Array
    gains: Array
    head: int
    behind: int
    others: tuple[Indices, Array]

    @classmethod
    def at(cls, task: Task, information: Array, prior: Array, rank: int) -> LimitedRank:
        """At an information matrix (size, size), `prior` of it known before, for readings of this rank."""
        covariance, before = inverse(information), task.of_interest(inverse(prior))
        own = np.linalg.inv(task.of_interest(covariance))
        root, s = np.linalg.cholesky(before), len(before)
        values, vectors = np.linalg.eigh(root.T @ own @ root)
        added, vectors = np.maximum(values[::-1] - 1.0, 0.0), vectors[:, ::-1]
        head, mean = _head(added, rank)
        kept = np.concatenate([added[:head], np.full(s - head, mean)])
        told = np.log1p(added[:head]).sum() + (rank - head) * np.log1p(mean)
        gains = 1.0 / (1.0 + kept)
        others = np.setdiff1d(np.arange(len(prior)), task.interest)
        return cls(
            value=float(np.linalg.slogdet(before)[1] - told) / s, held=float(gains @ (1.0 + added)) / s,
            half=covariance[:, task.interest] @ own @ root @ vectors, gains=gains, head=head, behind=rank - head,
            others=(others, inverse(information[np.ix_(others, others)])),
        )  # fmt: skip

    @property
    def pull(self) -> Array:
        """G (size, size)."""
        return np.asarray((self.half * self.gains) @ self.half.T / len(self.gains))

    def derivatives(self, whole: Array) -> tuple[Array, Array]:
        """Slope (n,) of ψ_r in the weights of rows (n, size, ny), and second derivatives (n, n), from above where eigenvalues
        behind the first h differ."""
        which, inverted = self.others
        rows = whole.transpose(2, 0, 1)
        seen, aside = rows @ self.half, rows[..., which]
        slope = np.einsum("yni,i->n", seen**2, self.gains)
        tail = seen[..., self.head :]
        sizes = np.einsum("yni->n", tail**2)
        last = float(self.gains[-1])
        bent = np.outer(sizes, sizes) * (last**2 / self.behind)
        firsts = zip(seen * self.gains, last * tail, aside @ inverted, strict=True)
        for i, (one, tail_one, aside_one) in enumerate(firsts):
            for j in range(i + 1):
                form = one @ seen[j].T
                pair = form * (form + 2.0 * aside_one @ aside[j].T) - (tail_one @ tail[j].T) ** 2
                bent += pair if i == j else pair + pair.T
        return -slope / len(self.gains), bent / len(self.gains)


def _head(added: Array, rank: int) -> tuple[int, float]:
    """h and m of eigenvalues (s,), largest first."""
    behind = np.cumsum(added[::-1])[::-1][:rank] / (rank - np.arange(rank))
    head = int(np.argmax(behind >= added[:rank] * (1.0 - 1e-12)))
    return head, float(behind[head])
