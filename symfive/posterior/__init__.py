"""The engine of a diagnosis: one posterior over what may be missing in a model.

terms     = candidates(campaign)          every effect states its own forms, places and how common it is
moments   = moments_of(fit, held, fresh)  whitened Gram matrices, the search's only data
posterior = explore(moments)              subsets of terms: birth, death, swap, width
posterior = polish(before, candidates)    exact refits of the best few, relinearised, until converged
coarse    = coarsened(posterior)          tempered by the misfit that no named effect explains, and by what they make worse
verdicts  = decide(posterior, coarse)     one rule from stated losses: name, class, unknown, nothing
verdicts  = verdicts_on(posterior)        both, until all that stays unidentified counts as misfit
"""

from symfive.posterior._about import moments_about
from symfive.posterior._apart import laws_apart
from symfive.posterior._coarse import coarsened, contradicted, misfit
from symfive.posterior._decide import SAME, Verdict, decide, verdicts_on
from symfive.posterior._evidence import log_evidence, solution
from symfive.posterior._explore import Posterior, Subset, explore
from symfive.posterior._fit import (
    WHITE,
    Expansion,
    baseline,
    fitted,
    linear_estimate,
    over_all,
    refitted,
    sigmas_from_nothing,
)
from symfive.posterior._moments import Moments, moments_of, usual_noises
from symfive.posterior._noise import grams, nodes_of
from symfive.posterior._polish import expanded, polish
from symfive.posterior._sweep import Sweep, widths_of
from symfive.posterior._terms import EXPECTED, Candidates, Name, Term, candidates, name_of
from symfive.posterior._widths import WIDTHS, log_width, nearest_width

__all__ = [
    "EXPECTED", "SAME", "WHITE", "WIDTHS", "Candidates", "Expansion", "Moments", "Name", "Posterior", "Subset", "Sweep", "Term",
    "Verdict", "baseline", "candidates", "coarsened", "contradicted", "decide", "expanded", "explore", "fitted", "grams",
    "laws_apart", "linear_estimate", "log_evidence", "log_width", "misfit", "moments_about", "moments_of", "name_of",
    "nearest_width", "nodes_of", "over_all", "polish", "refitted", "sigmas_from_nothing", "solution", "usual_noises",
    "verdicts_on", "widths_of",
]  # fmt: skip
