"""What is a law's and what its discrepancy's: a law is off by what none of its amplitudes explains (M. Plumlee 2017)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from symfive.arrays import Indices
from symfive.effects import Effect
from symfive.identify import Identification
from symfive.posterior._eliminate import eliminated
from symfive.posterior._fit import Expansion
from symfive.posterior._terms import own_parameters

__all__ = ["laws_apart"]


def laws_apart(here: Expansion) -> Identification:
    """The fit in which each law has the amplitudes that come closest to it and its discrepancy together, behind set-up and
    geometry, and the discrepancy is what they leave: values and covariance, for what is said of them."""
    fit = here.fit
    if not here.discrepancies:
        return fit
    scale = fit.model.prior_sigma
    gram = fit.problem().information_at(fit.values).matrix * np.outer(scale, scale)
    turn = np.eye(len(scale))
    for laws, beside in _pairs(here):
        others, first = _of_no_effect(here), len(laws)
        order = np.concatenate([others, laws, beside])
        (reduced,), _ = eliminated(gram[None, order[:, None], order], len(others), np.zeros(len(others)))
        h, cross, g = reduced[:first, :first], reduced[:first, first:], reduced[first:, first:]
        held = np.linalg.lstsq(h, cross, rcond=None)[0]
        turn[np.ix_(laws, beside)] = held
        turn[np.ix_(beside, beside)] -= np.linalg.lstsq(g, cross.T @ held, rcond=None)[0]
    turn *= scale[:, None] / scale
    mean = fit.model.prior_mean
    return replace(fit, values=mean + turn @ (fit.values - mean), covariance=turn @ fit.covariance @ turn.T)


def _pairs(here: Expansion) -> Iterator[tuple[Indices, Indices]]:
    """Of each discrepancy the places of the amplitudes of its laws, and of its own."""
    for form in here.discrepancies:
        what = form.channel, form.effect.coordinate
        laws = [law.effect for law in here.held if law.effect.answers == what]
        yield np.concatenate([_amplitudes(here.fit, law) for law in laws]), _amplitudes(here.fit, form.effect)


def _amplitudes(fit: Identification, effect: Effect) -> Indices:
    return np.array([fit.model.index[p.name] for p in effect.amplitudes(fit.model.campaign)], dtype=np.int64)


def _of_no_effect(here: Expansion) -> Indices:
    """The places of set-up and geometry."""
    fit = here.fit
    effects = {p.name for effect in fit.model.added for p in own_parameters(effect, fit.model.campaign)}
    return np.array([k for k, p in enumerate(fit.parameters) if p.name not in effects], dtype=np.int64)
