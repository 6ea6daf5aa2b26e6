"""One posterior over what may be missing in a model: the diagnosis, designed anew.

terms     = candidates(campaign)          every effect states its own forms, places and how common it is
moments   = moments_of(fit, held, fresh)  whitened Gram matrices, all that the search sees
posterior = explore(moments)              subsets of terms: birth, death, swap, width
posterior = polish(before, candidates)    exact refits of the best few, relinearised, until nothing moves
verdicts  = decide(posterior)             one rule from stated losses: name, class, unknown, nothing
"""

from symfive.posterior._decide import Verdict, decide
from symfive.posterior._diagnose import diagnose
from symfive.posterior._evidence import log_evidence, sweep
from symfive.posterior._explore import Posterior, explore
from symfive.posterior._fit import Expansion, baseline, fitted
from symfive.posterior._moments import Moments, moments_of
from symfive.posterior._polish import polish
from symfive.posterior._terms import Candidates, Term, candidates

__all__ = [
    "Candidates", "Expansion", "Moments", "Posterior", "Term", "Verdict", "baseline", "candidates", "decide", "diagnose",
    "explore", "fitted", "log_evidence", "moments_of", "polish", "sweep",
]  # fmt: skip
